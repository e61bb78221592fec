//! `plumb calibrate`.

mod fit;
mod hand;
