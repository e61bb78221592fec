//! An update over the bus, step by step, and programs to update to that do not work.
//!
//! In: a bench, the file of an image. Out: what the node makes of it.

use emulator::pair::SdoError;
use flash::image::Version;
use flash::layout::{HEADER, RC, Slot};
use sim::memory::image;

use crate::bench::{Bench, product};

/// The version of the update: higher than any that the product has now.
pub const NEW: Version = Version::new(0x40, 0, 0);

/// What is running after the update and its confirmation: version, slot, confirmed.
pub const RENEWED: [u32; 3] = [NEW.0, 1, 0];

/// The product's own body for slot B.
pub fn body() -> Vec<u8> {
    product().update(Slot::B)[HEADER as usize..].to_vec()
}

/// The file of an image for slot B with this body, signed.
pub fn file(body: &[u8]) -> Vec<u8> {
    image(Slot::B, NEW, body)
}

/// A body whose first instruction is this half-word: the program does no more than that.
pub fn body_that_begins_with(instruction: u16) -> Vec<u8> {
    let mut body = body();
    let [_, _, _, _, a, b, c, d, ..] = body[..] else {
        panic!("a vector table");
    };
    let start = u32::from_le_bytes([a, b, c, d]) & !1;
    let room = RC.b.expect("two slots").address() + HEADER;
    let at = (start - room) as usize;
    body[at..at + 2].copy_from_slice(&instruction.to_le_bytes());
    body
}

/// Erases the slot that does not run; panics when that takes longer than ten seconds.
pub fn clear(bench: &mut Bench) {
    for command in [0, 3] {
        let done = bench.pair.write(1, (0x1F51, 1), 1, command);
        done.unwrap_or_else(|error| panic!("command {command}: {error:?}"));
    }
    for _ in 0..100 {
        bench.pair.run(0.1);
        // Nothing is answered while a page is erased; bit 0 is set while there are more.
        if bench.pair.read(1, 0x1F57, 1) == Ok(2) {
            return;
        }
    }
    panic!("not erased within ten seconds");
}

/// Clears the slot and sends the file. Errors: those of the node.
pub fn send(bench: &mut Bench, file: &[u8]) -> Result<(), SdoError> {
    clear(bench);
    bench.pair.download(1, (0x1F50, 1), file)
}

/// Asks for the start of what was sent; the node answers, or is away at once.
pub fn begin(bench: &mut Bench) -> Result<(), SdoError> {
    match bench.pair.write(1, (0x1F51, 1), 1, 1) {
        Err(SdoError::Silent) | Ok(()) => Ok(()),
        refused => refused,
    }
}
