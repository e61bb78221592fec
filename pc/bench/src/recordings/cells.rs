//! A cell of a recording as a number.
//!
//! In: its text. Out: a finite number, or the [`Reason`] why there is none.

use super::skips::Reason;

/// A cell that must not be empty.
///
/// Errors: it is empty, or no finite number.
pub fn required(cell: &str) -> Result<f64, Reason> {
    if cell.is_empty() {
        return Err(Reason::MissingCell);
    }
    let value: f64 = cell.parse().map_err(|_| Reason::UnparsableCell)?;
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Reason::NotFinite)
    }
}

/// A cell that may be empty.
///
/// Errors: it is no finite number.
pub fn optional(cell: &str) -> Result<Option<f64>, Reason> {
    match required(cell) {
        Err(Reason::MissingCell) => Ok(None),
        other => other.map(Some),
    }
}
