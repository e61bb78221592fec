//! The arithmetic of the profile for inclinometers (CiA 410), in integers.
//!
//! In: an angle as measured, and what a master has written to a slope's parameters. Out: the
//! number that the slope displays, or the reason why a parameter is refused.
//!
//! - [`resolution`]: the unit, and whether everything fits into 16 bit.
//! - [`slope`]: inversion, preset, offset, differential offset.
//! - [`state`]: the code of a judgement on two channels.
//!
//! Left out: the rows (`objects`), the measuring range's EMCY (`fault`), limits and cams.

pub mod resolution;
pub mod slope;
pub mod state;

pub use resolution::{Form, Range, Refused, Resolution, Scale, narrow};
pub use slope::{Parameter, Slope};

#[cfg(test)]
mod tests;
