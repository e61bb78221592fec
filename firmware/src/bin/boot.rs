//! The bootloader: starts the clocks and the watchdog, then the image that `flash::slots` chooses.
//!
//! In: both slots. Out: a jump, with the vector table of the image in force. An image on trial has
//! used up one attempt by then, so one that hangs is rolled back by the watchdog's resets.
//!
//! When nothing can be started the chip is left to the watchdog, which resets it after a second.
//! Why nothing was started stands in the RAM (`chip::trap`) and is told by the first application
//! that does start.
//!
//! The verifier of signatures stands beside it ([`verifier`](firmware::chip::verifier)); only
//! applications call it.
//!
//! Left out: any protocol. An update is received by the running application.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod boot {
    use firmware::chip::{board, handover, verifier};
    use firmware::part::LAYOUT;
    use flash::slots::{Decision, boot};
    use stm32f1xx_hal::pac::Peripherals;

    /// At the end of the bootloader's region, where both applications find the verifier.
    #[used]
    // SAFETY: the linker script gives this section a place of its own.
    #[unsafe(link_section = ".seal")]
    static SEAL: verifier::Seal = verifier::SEAL;

    #[cortex_m_rt::entry]
    fn main() -> ! {
        // SAFETY: nothing has run before, so these are the only handles.
        let mut nor = board::start_boot(unsafe { Peripherals::steal() });
        match boot(&mut nor, &LAYOUT, LAYOUT.hardware) {
            // SAFETY: `boot` has found the image whole and linked to its slot. No interrupt was
            // switched on before.
            Decision::Run(_, header, _) => unsafe { handover::start(header.address) },
            Decision::Stay(why) => handover::stay(why),
        }
    }
}

#[cfg(not(target_os = "none"))]
fn main() {
    println!("linked for the part by `cargo xtask image`; nothing to run");
}
