//! Which map of the flash this image was linked for.
//!
//! Out: constants, chosen by `build.rs`. They change addresses, never behaviour.

use flash::layout::{C8, CB, Layout};

/// The map that the linker used.
pub const LAYOUT: Layout = if is_c8(env!("PLUMB_PART")) { C8 } else { CB };

const fn is_c8(part: &str) -> bool {
    matches!(part.as_bytes(), [.., b'C', b'8'])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_is_known_by_its_name() {
        assert!(is_c8(C8.part) && !is_c8(CB.part));
        assert_ne!(CB.hardware, C8.hardware);
    }
}
