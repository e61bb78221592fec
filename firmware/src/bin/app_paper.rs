//! The application of the paper's instrument on the paper's part, an STM32F103C8: `firmware::shell`
//! around the paper's image.
//!
//! What the paper did not have is not in it: a second slot with signed updates, safety frames,
//! black box and event log. It has nothing that erases flash; the bootloader does that for it
//! (R10).
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
firmware::application!(firmware::image::Paper);

#[cfg(not(target_os = "none"))]
fn main() {
    println!("linked for the part by `cargo xtask image`; nothing to run");
}
