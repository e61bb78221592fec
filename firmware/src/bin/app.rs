//! The product's application: `firmware::shell` around the product's image.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
firmware::application!(firmware::image::Product);

#[cfg(not(target_os = "none"))]
fn main() {
    println!("linked for the part by `cargo xtask image`; nothing to run");
}
