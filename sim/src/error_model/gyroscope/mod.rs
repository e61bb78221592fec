//! The error model of a gyroscope: every way it may differ from a perfect one, by name.
//!
//! In: nothing but constants; each term is a field in the unit of its name, 1 sigma unless its
//! comment has another, with the tag of its source: `[DS]` the ISM330DHCX's data sheet (DS13012
//! rev 6, table 2, as `docs/gyroscope-parts.md` has it), `[ASSUME]` engineering assumption to be
//! replaced by bench data. Setting a field to 0 switches its term off. Out: a [`GyroscopeModel`],
//! from which [`Gyroscope::draw`] makes one part's personality. A typical figure of the data sheet
//! is taken for 1 sigma `[ASSUME]`. Left out: thermal hysteresis, ageing, nonlinearity, the
//! response to vibration beyond its mean, start-up, clipping and rounding (the register model's).
//!
//! ```
//! use sim::error_model::gyroscope::{Gyroscope, GyroscopeModel, GyroscopeTerm};
//! use sim::rng::Rng;
//! let study = GyroscopeModel::NOMINAL.only(GyroscopeTerm::Bias);
//! let mut rng = Rng::stream(1, "gyroscope");
//! let mut gyroscope = Gyroscope::draw(&study, &mut rng);
//! gyroscope.power_on(&mut rng);
//! let felt_dps = gyroscope.feel([0.0; 3], [0.0, 0.0, 1.0], 0.0, 0.0024, &mut rng);
//! assert!(felt_dps[0] != 0.0 && felt_dps[0].abs() < 5.0);
//! ```

mod part;
mod term;

#[cfg(test)]
mod tests;

pub use part::Gyroscope;
pub use term::GyroscopeTerm;

/// Sizes of all error terms of one gyroscope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroscopeModel {
    /// White noise density, dps/rtHz. `[DS]` rate noise density, typical
    pub noise_density_dps: f64,
    /// Zero-rate level per axis at 25 degC, dps. `[DS]` typical; 3 at most
    pub bias_dps: f64,
    /// Change of the bias per degree, dps/degC. `[DS]` typical, by a secondary source
    pub bias_dps_per_c: f64,
    /// Curvature of the bias over temperature, dps/degC^2. `[ASSUME]`
    pub bias_dps_per_c2: f64,
    /// Change of the bias from one power-on to the next, dps. `[ASSUME]`
    pub turn_on_dps: f64,
    /// The 1/f floor per axis, dps rms: three Gauss-Markov processes together. `[DS]` 3 deg/h of
    /// bias instability, the lowest Allan deviation, which this floor has at 1.8 times its size
    /// `[ASSUME]`
    pub flicker_dps: f64,
    /// Random walk of the bias since power-on, dps per root second. `[ASSUME]`
    pub walk_dps_per_rts: f64,
    /// Scale error per axis at 25 degC, as a ratio. `[ASSUME]` 1 %
    pub scale_ratio: f64,
    /// Change of scale per degree, as a ratio. `[ASSUME]` 0.005 %/degC
    pub scale_ratio_per_c: f64,
    /// Each of the six small angles between sensitive axes and the gyroscope's frame, degrees.
    /// `[ASSUME]` half a per cent
    pub non_orthogonality_deg: f64,
    /// Rotation of the gyroscope's frame against the accelerometer's on the same die about each
    /// axis, degrees; the part's mounting comes on top ([`Gyroscope::mounted`]). `[ASSUME]`
    pub misalignment_deg: f64,
    /// Each of the nine responses to specific force, dps/g. `[ASSUME]`
    pub g_sensitivity_dps: f64,
    /// How much white noise grows in a sag, as a ratio: 1 doubles it. `[ASSUME]`
    pub sag_noise_ratio: f64,
}

impl GyroscopeModel {
    /// An ISM330DHCX out of the box.
    pub const NOMINAL: GyroscopeModel = GyroscopeModel {
        noise_density_dps: 0.005,
        bias_dps: 1.0,
        bias_dps_per_c: 0.005,
        bias_dps_per_c2: 2e-5,
        turn_on_dps: 0.05,
        flicker_dps: 1.5e-3,
        walk_dps_per_rts: 2e-5,
        scale_ratio: 0.01,
        scale_ratio_per_c: 5e-5,
        non_orthogonality_deg: 0.3,
        misalignment_deg: 0.2,
        g_sensitivity_dps: 0.02,
        sag_noise_ratio: 1.0,
    };

    /// Every term off: a gyroscope that reports what it feels.
    pub const PERFECT: GyroscopeModel = GyroscopeModel {
        noise_density_dps: 0.0,
        bias_dps: 0.0,
        bias_dps_per_c: 0.0,
        bias_dps_per_c2: 0.0,
        turn_on_dps: 0.0,
        flicker_dps: 0.0,
        walk_dps_per_rts: 0.0,
        scale_ratio: 0.0,
        scale_ratio_per_c: 0.0,
        non_orthogonality_deg: 0.0,
        misalignment_deg: 0.0,
        g_sensitivity_dps: 0.0,
        sag_noise_ratio: 0.0,
    };

    /// White noise of one sample, dps, 1 sigma: the density times sqrt(ODR / 2), as for the
    /// accelerometer; the nominal data rate in Hz. 0 with the term off.
    pub fn sample_sigma_dps(&self, odr_hz: f64) -> f64 {
        self.noise_density_dps * (odr_hz / 2.0).sqrt()
    }
}
