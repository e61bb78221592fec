//! The application of the variant with a gyroscope: `firmware::shell` around its image. The
//! product's bootloader starts it.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
firmware::application!(firmware::image::Dynamic);

#[cfg(not(target_os = "none"))]
fn main() {
    println!("linked for the part by `cargo xtask image`; nothing to run");
}
