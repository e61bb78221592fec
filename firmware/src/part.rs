//! Which map of the flash this image was linked for, and which hardware it is made for.
//!
//! Out: constants, chosen by `build.rs`. They change addresses, never behaviour.

use flash::layout::{C8, CB, Layout};

/// The map that the linker used.
pub const LAYOUT: Layout = if is_c8(env!("PLUMB_PART")) { C8 } else { CB };

/// What the bootloader asks of an image: "PLM" and the revision of the board.
///
/// The board is the same with either part, but their maps are not, so the part is in it too.
pub const HARDWARE: u32 = hardware(&LAYOUT);

/// The hardware id of the board with the part that `layout` belongs to.
pub const fn hardware(layout: &Layout) -> u32 {
    let part = if is_c8(layout.part) { 0xC8 } else { 0xCB };
    u32::from_le_bytes([part, 1, b'L', b'P'])
}

const fn is_c8(part: &str) -> bool {
    matches!(part.as_bytes(), [.., b'C', b'8'])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_has_a_hardware_id_of_its_own() {
        assert_eq!(hardware(&CB), 0x504C_01CB);
        assert_eq!(hardware(&C8), 0x504C_01C8);
    }
}
