//! Tells the linker where bootloaders and applications stand, from the flash maps of the
//! STM32F103RC (the product) and the STM32F103C8 (the paper's instrument).
//!
//! In: `PLUMB_SLOT`, for which slot the product's application is linked: `A` (default) or `B`. It
//! changes addresses, never behaviour. Out: a `memory.x` for each binary.
//!
//! An image is position dependent, so an update is offered for both slots; `cargo xtask image`
//! builds them both.
//!
//! `PLUMB_KEY` is the public Ed25519 key, 64 hexadecimal digits, whose holder signs updates.
//! Without it the key is blank, which no signature fits: such a node takes no update over the bus.
//! `PLUMB_UNSIGNED=1` builds a node that takes images without a signature too, for a developer's
//! table and nothing else.

use std::path::Path;
use std::{env, fs};

use flash::layout::{C8, Layout, Program, RC, Slot};

fn main() {
    println!("cargo::rerun-if-env-changed=PLUMB_SLOT");
    println!("cargo::rerun-if-changed=build.rs");
    let slot = match env::var("PLUMB_SLOT").as_deref() {
        Ok("A") | Err(_) => Slot::A,
        Ok("B") => Slot::B,
        Ok(other) => panic!("PLUMB_SLOT is {other:?}; it can be A or B"),
    };
    println!("cargo::rerun-if-env-changed=PLUMB_KEY");
    println!("cargo::rerun-if-env-changed=PLUMB_UNSIGNED");
    let key = env::var("PLUMB_KEY").unwrap_or_else(|_| "0".repeat(64));
    assert!(
        key.len() == 64 && key.bytes().all(|digit| digit.is_ascii_hexdigit()),
        "PLUMB_KEY is {key:?}; it must be the 64 hexadecimal digits of a public key"
    );
    let unsigned = match env::var("PLUMB_UNSIGNED").as_deref() {
        Ok("1") => "1",
        Err(_) | Ok("" | "0") => "0",
        Ok(other) => panic!("PLUMB_UNSIGNED is {other:?}; it can be 0 or 1"),
    };
    println!("cargo::rustc-env=PLUMB_KEY={key}");
    println!("cargo::rustc-env=PLUMB_UNSIGNED={unsigned}");
    if env::var("CARGO_CFG_TARGET_OS").as_deref() == Ok("none") {
        script("boot", &RC, Program::Boot);
        script("app", &RC, Program::Application(slot));
        script("app-dynamic", &RC, Program::Application(slot));
        script("boot-paper", &C8, Program::Boot);
        script("app-paper", &C8, Program::Application(Slot::A));
    }
}

/// Where a bootloader tells of what it lends to applications.
const SEAL_SECTION: &str = "SECTIONS { .seal : { KEEP(*(.seal)) } > SEAL } INSERT AFTER .rodata;\n";

/// Writes `memory.x` into a folder of its own and links `binary` with it.
fn script(binary: &str, layout: &Layout, program: Program) {
    let out = env::var("OUT_DIR").expect("cargo names the folder for what is generated");
    let folder = Path::new(&out).join(binary);
    let text = layout.memory_x(program).expect("the part has the slot");
    // The last bytes of the RAM are no program's: `chip::trap` leaves there why one has ended.
    let text = format!("{text}_stack_start = ORIGIN(RAM) + LENGTH(RAM) - 32;\n");
    let text = match program {
        Program::Boot => text + SEAL_SECTION,
        Program::Application(_) => text,
    };
    fs::create_dir_all(&folder).expect("a folder for the linker script");
    fs::write(folder.join("memory.x"), text).expect("the linker script");
    println!("cargo::rustc-link-arg-bin={binary}=-L{}", folder.display());
    println!("cargo::rustc-link-arg-bin={binary}=-Tlink.x");
    // Without it the linker pads segments to pages of an operating system.
    println!("cargo::rustc-link-arg-bin={binary}=--nmagic");
    // Functions that came out alike are there once. Nothing here compares their addresses.
    println!("cargo::rustc-link-arg-bin={binary}=--icf=all");
}
