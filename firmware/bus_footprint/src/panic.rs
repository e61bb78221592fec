//! What would be called on a panic: present so that `footprint.ld` can see whether it is reached.
//!
//! A panic pulls this handler into the binary, and the linker script refuses a binary that holds
//! it. On the host the standard library has a handler of its own.

#[cfg(target_os = "none")]
#[inline(never)]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    loop {
        core::hint::spin_loop();
    }
}
