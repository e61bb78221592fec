//! The air around an instrument, as whoever regulates it reports it.

/// What a chamber reports of its air.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// Its temperature; `None` where it is not known.
    pub degc: Option<f64>,
    /// Whether it is stable at the set point.
    pub stable: bool,
}
