//! The bootloader of the paper's image: starts the clocks and the watchdog, then the application if
//! that is as it was linked (R9).
//!
//! In: the one slot of an STM32F103C8. Out: a jump, with the vector table of the application in
//! force. A damaged application is not started: the chip is left to the watchdog, which resets it
//! after a second.
//!
//! What erases a page of records stands in it, and nowhere else (R10); the application calls it
//! ([`eraser`](firmware::chip::eraser)).
//!
//! Left out: slots to choose from, signatures, any protocol. A program comes over the debug port.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod boot {
    use firmware::chip::nor::Reader;
    use firmware::chip::{board, eraser, handover};
    use firmware::part::PAPER;
    use flash::image::{ImageError, verify};
    use flash::slots::NoStart;
    use stm32f1xx_hal::pac::Peripherals;

    /// At the end of the bootloader's region, where the application finds the eraser.
    #[used]
    // SAFETY: the linker script gives this section a place of its own.
    #[unsafe(link_section = ".seal")]
    static SEAL: eraser::Seal = eraser::SEAL;

    #[cortex_m_rt::entry]
    fn main() -> ! {
        // SAFETY: nothing has run before, so these are the only handles.
        board::start_boot(unsafe { Peripherals::steal() });
        match verify(&mut Reader(&PAPER), PAPER.a, PAPER.hardware) {
            // SAFETY: the image is whole and linked to its slot. No interrupt was switched on
            // before.
            Ok(header) => unsafe { handover::start(header.address) },
            Err(ImageError::Magic) => handover::stay(NoStart::Empty),
            Err(_) => handover::stay(NoStart::Bad),
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    println!("linked for the part by `cargo xtask image`; nothing to run");
}
