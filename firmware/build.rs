//! Tells the linker where boot and application stand, from the flash map.
//!
//! In: `PLUMB_SLOT`, which of the images is built: `A` (default) or `B` of the STM32F103CB, or
//! `C8` for the only slot of the STM32F103C8. It changes addresses and sizes, never behaviour.
//! Out: a `memory.x` for each binary, and `PLUMB_PART`, by which the code knows its map.
//!
//! An image is position dependent, so an update is offered for both slots; `cargo xtask image`
//! builds them all.

use std::path::Path;
use std::{env, fs};

use flash::layout::{C8, CB, Layout, Program, Slot};

fn main() {
    println!("cargo::rerun-if-env-changed=PLUMB_SLOT");
    println!("cargo::rerun-if-changed=build.rs");
    let wanted = env::var("PLUMB_SLOT").unwrap_or_else(|_| "A".to_string());
    let (layout, slot) = match wanted.as_str() {
        "A" => (CB, Slot::A),
        "B" => (CB, Slot::B),
        "C8" => (C8, Slot::A),
        other => panic!("PLUMB_SLOT is {other:?}; it can be A, B or C8"),
    };
    println!("cargo::rustc-env=PLUMB_PART={}", layout.part);
    if env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("none") {
        script("boot", &layout, Program::Boot);
        script("app", &layout, Program::Application(slot));
    }
}

/// Writes `memory.x` into a folder of its own and links `binary` with it.
fn script(binary: &str, layout: &Layout, program: Program) {
    let out = env::var("OUT_DIR").expect("cargo names the folder for what is generated");
    let folder = Path::new(&out).join(binary);
    let text = layout.memory_x(program).expect("the part has this slot");
    fs::create_dir_all(&folder).expect("a folder for the linker script");
    // The last bytes of the RAM are no program's: `chip::trap` leaves there why one has ended.
    let text = format!("{text}_stack_start = ORIGIN(RAM) + LENGTH(RAM) - 32;\n");
    fs::write(folder.join("memory.x"), text).expect("the linker script");
    println!("cargo::rustc-link-arg-bin={binary}=-L{}", folder.display());
    println!("cargo::rustc-link-arg-bin={binary}=-Tlink.x");
    // Without it the linker pads segments to pages of an operating system.
    println!("cargo::rustc-link-arg-bin={binary}=--nmagic");
}
