//! The error model of one sensor: every way a part may differ from a perfect one, by name.
//!
//! In: nothing but constants; each term is a field in the unit of its name, 1 sigma unless its
//! comment has another, with the tag of its source: `[DS]` data sheet, `[ASSUME]` engineering
//! assumption to be replaced by bench data. Setting a field to 0 (or false) switches its term
//! off. Out: an [`ErrorModel`], from which [`Part::draw`] makes one sensor's personality.
//! A gyroscope has a model of its own, [`gyroscope`].
//! Left out: shock damage, ageing over years, and clipping at full scale (the register model's).
//!
//! ```
//! use sim::error_model::{ErrorModel, Part, Term};
//! use sim::rng::Rng;
//! let study = ErrorModel::NOMINAL.only(Term::Bias);
//! let mut rng = Rng::stream(1, "part");
//! let mut part = Part::draw(&study, &mut rng);
//! part.power_on(&mut rng);
//! let felt = part.feel([0.0, 0.0, 1.0], 0.0, 0.0025, &mut rng);
//! assert!(felt[0] != 0.0 && felt[0].abs() < 0.1);
//! ```

mod flicker;
pub mod gyroscope;
mod part;
mod term;

pub use part::Part;
pub use term::Term;

use gyroscope::GyroscopeModel;

/// Sizes of all error terms of one sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ErrorModel {
    /// Zero-g offset per axis at 25 degC, mg. `[DS]` TyOff
    pub bias_mg: f64,
    /// Change of the offset per degree, mg/degC. `[DS]` TCO
    pub tco_mg_per_c: f64,
    /// Curvature of the offset over temperature, ug/degC^2. `[ASSUME]`
    pub curvature_ug_per_c2: f64,
    /// Half the opening of the offset's thermal hysteresis loop at 30 degC, mg. `[ASSUME]`
    pub hysteresis_mg: f64,
    /// Change of the offset from one power-on to the next, mg. `[ASSUME]`
    pub turn_on_mg: f64,
    /// Scale error per axis at 25 degC, as a ratio. `[ASSUME]` 1 %
    pub scale_ratio: f64,
    /// Change of scale per degree, as a ratio. `[DS]` TCS 0.01 %/degC
    pub scale_ratio_per_c: f64,
    /// Each of the six small angles between sensitive axes and the part's frame, degrees.
    /// `[ASSUME]`
    pub non_orthogonality_deg: f64,
    /// Rotation of the part in the housing about each axis, degrees. `[ASSUME]`
    pub mounting_deg: f64,
    /// Quadratic nonlinearity, mg/g^2. `[ASSUME]`
    pub quadratic_mg_per_g2: f64,
    /// Cubic nonlinearity, mg/g^3. `[ASSUME]`
    pub cubic_mg_per_g3: f64,
    /// Factor on the white noise of the part's mode: 1 as in the data sheet, 0 none. `[DS]`
    pub white_noise: f64,
    /// The 1/f floor per axis, ug rms: three Gauss-Markov processes together. `[ASSUME]`
    pub flicker_ug: f64,
    /// Error of the output data rate, as a ratio either side, uniform. `[ASSUME]` +-3 %
    pub clock_ratio: f64,
    /// Offset of the temperature sensor, degC. `[DS]` at most +-15, 1 sigma 5 `[ASSUME]`
    pub thermometer_offset_c: f64,
    /// Gain error of the temperature sensor about 25 degC, as a ratio. `[ASSUME]`
    pub thermometer_gain_ratio: f64,
    /// Noise of one temperature reading, degC. `[ASSUME]`
    pub thermometer_noise_c: f64,
    /// Whether readings are rounded to counts: the register model does it, at 0.244 mg for
    /// +-2 g, and takes the world's word from here. `[DS]`
    pub quantisation: bool,
    /// How much white noise grows in a sag, as a ratio: 1 doubles it. `[ASSUME]`
    pub sag_noise_ratio: f64,
    /// Wander of the offset per axis during a sag, mg rms once it has built up. `[ASSUME]`
    pub sag_wander_mg: f64,
    /// The gyroscope beside it, where the part has one.
    pub gyroscope: GyroscopeModel,
}

impl ErrorModel {
    /// The nominal column of spec/sensor.md.
    pub const NOMINAL: ErrorModel = ErrorModel {
        bias_mg: 20.0,
        tco_mg_per_c: 0.2,
        curvature_ug_per_c2: 0.8,
        hysteresis_mg: 0.5,
        turn_on_mg: 0.3,
        scale_ratio: 0.01,
        scale_ratio_per_c: 1e-4,
        non_orthogonality_deg: 0.5,
        mounting_deg: 1.0,
        quadratic_mg_per_g2: 1.0,
        cubic_mg_per_g3: 1.0,
        white_noise: 1.0,
        flicker_ug: 40.0,
        clock_ratio: 0.03,
        thermometer_offset_c: 5.0,
        thermometer_gain_ratio: 0.02,
        thermometer_noise_c: 0.1,
        quantisation: true,
        sag_noise_ratio: 1.0,
        sag_wander_mg: 12.0,
        gyroscope: GyroscopeModel::NOMINAL,
    };

    /// Every term off: a part that reports what it feels.
    pub const PERFECT: ErrorModel = ErrorModel {
        bias_mg: 0.0,
        tco_mg_per_c: 0.0,
        curvature_ug_per_c2: 0.0,
        hysteresis_mg: 0.0,
        turn_on_mg: 0.0,
        scale_ratio: 0.0,
        scale_ratio_per_c: 0.0,
        non_orthogonality_deg: 0.0,
        mounting_deg: 0.0,
        quadratic_mg_per_g2: 0.0,
        cubic_mg_per_g3: 0.0,
        white_noise: 0.0,
        flicker_ug: 0.0,
        clock_ratio: 0.0,
        thermometer_offset_c: 0.0,
        thermometer_gain_ratio: 0.0,
        thermometer_noise_c: 0.0,
        quantisation: false,
        sag_noise_ratio: 0.0,
        sag_wander_mg: 0.0,
        gyroscope: GyroscopeModel::PERFECT,
    };

    /// What a device has to be given for parts without noise, whose codes stand still by right:
    /// [`device::channel::Settings::noise`]. 0, which states nothing, for others.
    pub fn known_noise(&self) -> u32 {
        u32::from(self.white_noise == 0.0)
    }

    /// A pessimistic column: nominal with hysteresis and turn-on repeatability multiplied. The
    /// columns of spec/sensor.md are (2, 3) and (3, 6). `[ASSUME]`
    pub const fn pessimistic(hysteresis_factor: f64, turn_on_factor: f64) -> ErrorModel {
        ErrorModel {
            hysteresis_mg: Self::NOMINAL.hysteresis_mg * hysteresis_factor,
            turn_on_mg: Self::NOMINAL.turn_on_mg * turn_on_factor,
            ..Self::NOMINAL
        }
    }
}

#[cfg(test)]
mod tests;
