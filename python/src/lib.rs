//! The native half of the Python package `plumb`, behind `plumb/__init__.py`.
//!
//! In: what Python hands over, checked there for its types and shapes. Out: what the crates of the
//! workspace make of it; no concept of theirs is written again here. Errors are `plumb.Error` with
//! the sentence of the program. The interpreter goes on while Rust works.
//!
//! Left out: conveniences, which are Python (`python/plumb/`).

mod calibration;
mod chain;
mod count;
mod decode;
mod error;
mod fit;
mod signals;
mod summary;
mod twin;

use pyo3::prelude::*;

/// The native half of the package `plumb`.
#[pymodule]
mod _plumb {
    #[pymodule_export]
    use super::chain::{Chain, reasons};
    #[pymodule_export]
    use super::count::{Counted, count};
    #[pymodule_export]
    use super::decode::Decoder;
    #[pymodule_export]
    use super::error::{Error, IncompleteWarning};
    #[pymodule_export]
    use super::fit::{Fitted, fit_motor, fit_poses};
    #[pymodule_export]
    use super::summary::{figures, fleet_page, merge, merge_named, report, summarise};
    #[pymodule_export]
    use super::twin::World;
}
