//! What one node measures at a standstill, and what spoils it.
//!
//! In: nothing but numbers. Out: a [`Reading`], or an [`Upset`] in its place.
//!
//! Left out: how a reading is taken (`session`).

/// The means of one node at a standstill.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Mean acceleration in the sensor's axes, 2^-26 g.
    pub accel: [f64; 3],
    /// Scatter of single readings around it, mg, all axes together.
    pub scatter_mg: f64,
    /// The temperature of the sensor by itself, degC, to a degree.
    pub temperature_c: f64,
    /// Mean of the angles X and Y, deg; the reason of 2025h where one has none.
    pub angle_deg: [Result<f64, u8>; 2],
    /// Mean rate of the gyroscope in the sensor's axes before any correction, rad/s; none where it
    /// is not followed, or hardly.
    pub rate_rad_s: Option<[f64; 3]>,
}

/// What spoils the work with a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Upset {
    /// It has started anew.
    #[error("has restarted in the middle: look at its supply")]
    Restarted,
    /// It was taken to another NMT state than PRE-OPERATIONAL.
    #[error(
        "was taken out of PRE-OPERATIONAL (NMT) in the middle: no other master may command it \
         meanwhile"
    )]
    Commanded,
}

/// The mean of angles that are close to each other: the differences to the first one go the shorter
/// way round, wherever the full circle has its seam. It lies near the first one, and may be beyond
/// the seam; `None` without any.
pub fn mean_near(angles_deg: &[f64]) -> Option<f64> {
    let first = *angles_deg.first()?;
    let off: f64 = angles_deg.iter().map(|deg| wrap(deg - first)).sum();
    Some(first + off / angles_deg.len() as f64)
}

/// To -180..=180 deg.
pub fn wrap(deg: f64) -> f64 {
    deg - 360.0 * (deg / 360.0).round()
}
