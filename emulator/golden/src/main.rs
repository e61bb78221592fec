//! The image: runs [`emulator_golden::Outcome::run`] once and leaves what it has found in the RAM.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("an image for the emulated board; nothing to run");
}

#[cfg(target_os = "none")]
mod image {
    use core::cell::RefCell;
    use core::panic::PanicInfo;

    use cortex_m::interrupt::Mutex;
    use cortex_m_rt::entry;
    use emulator_golden::Outcome;

    /// What was found; the test looks here by this name. Only the one entry borrows it.
    // SAFETY: no other symbol has this name.
    #[unsafe(no_mangle)]
    static GOLDEN: Mutex<RefCell<Outcome>> = Mutex::new(RefCell::new(Outcome::NOTHING));

    #[panic_handler]
    fn panic(_: &PanicInfo) -> ! {
        loop {
            cortex_m::asm::nop();
        }
    }

    #[entry]
    fn main() -> ! {
        cortex_m::interrupt::free(|section| {
            GOLDEN.borrow(section).borrow_mut().run();
        });
        loop {
            cortex_m::asm::wfi();
        }
    }
}
