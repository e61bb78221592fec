//! The image: runs [`emulator_golden::float::Compared::run`] once, counted by the core's own
//! counter, and leaves what it has found in the RAM.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("an image for the emulated board; nothing to run");
}

#[cfg(target_os = "none")]
mod image {
    use core::cell::RefCell;
    use core::panic::PanicInfo;

    use cortex_m::Peripherals;
    use cortex_m::interrupt::Mutex;
    use cortex_m::peripheral::DWT;
    use cortex_m_rt::entry;
    use emulator_golden::float::Compared;

    /// What was found; `emulator::cost` looks here by this name. Only the one entry borrows it.
    // SAFETY: no other symbol has this name.
    #[unsafe(no_mangle)]
    static COMPARED: Mutex<RefCell<Compared>> = Mutex::new(RefCell::new(Compared::NOTHING));

    #[panic_handler]
    fn panic(_: &PanicInfo) -> ! {
        loop {
            cortex_m::asm::nop();
        }
    }

    #[entry]
    fn main() -> ! {
        if let Some(mut core) = Peripherals::take() {
            core.DCB.enable_trace();
            core.DWT.enable_cycle_counter();
        }
        cortex_m::interrupt::free(|section| {
            COMPARED.borrow(section).borrow_mut().run(DWT::cycle_count);
        });
        loop {
            cortex_m::asm::wfi();
        }
    }
}
