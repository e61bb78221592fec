//! The part that the firmware is for.
//!
//! Out: its map, which the linker has too (`build.rs`).

use flash::layout::{Layout, RC};

/// The map that the image was linked with.
pub const LAYOUT: Layout = RC;
