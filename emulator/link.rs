//! Tells the linker where a bare program of this folder stands: from the start of the flash up to the
//! records. The build script of `fixture` and of `golden`.

use std::path::Path;
use std::{env, fs};

use flash::layout::{BASE, RAM, RC};

fn main() {
    println!("cargo::rerun-if-changed=../link.rs");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() != Ok("none") {
        return;
    }
    let out = env::var("OUT_DIR").expect("cargo names the folder for what is generated");
    let (room, ram) = (RC.records.start, RC.ram);
    let text = format!(
        "MEMORY\n{{\n  FLASH : ORIGIN = {BASE:#010X}, LENGTH = {room}\n  \
         RAM : ORIGIN = {RAM:#010X}, LENGTH = {ram}\n}}\n"
    );
    fs::write(Path::new(&out).join("memory.x"), text).expect("the linker script");
    println!("cargo::rustc-link-arg-bins=-L{out}");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    println!("cargo::rustc-link-arg-bins=--nmagic");
}
