//! The terms of the error model by name, for studies that switch one off or leave only one on.
//!
//! In: a model and a [`Term`]. Out: another model. A part drawn from the same stream keeps all
//! its other numbers, because [`super::Part::draw`] draws every term, whatever its size.

use super::ErrorModel;

/// One named term, for one field of [`ErrorModel`], where its size and source are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Term {
    /// Zero-g offset at 25 degC.
    Bias,
    /// Offset over temperature.
    Tco,
    /// Curvature of the offset over temperature.
    Curvature,
    /// Thermal hysteresis of the offset.
    Hysteresis,
    /// Turn-on repeatability.
    TurnOn,
    /// Scale error at 25 degC.
    Scale,
    /// Scale over temperature.
    ScaleOverTemperature,
    /// Angles between the sensitive axes.
    NonOrthogonality,
    /// Rotation of the part in the housing.
    Mounting,
    /// Quadratic nonlinearity.
    Quadratic,
    /// Cubic nonlinearity.
    Cubic,
    /// White noise of the part's mode.
    WhiteNoise,
    /// The 1/f floor.
    Flicker,
    /// Error of the output data rate.
    Clock,
    /// Offset of the temperature sensor.
    ThermometerOffset,
    /// Gain error of the temperature sensor.
    ThermometerGain,
    /// Noise of the temperature sensor.
    ThermometerNoise,
    /// Rounding to counts.
    Quantisation,
    /// Growth of white noise in a sag.
    SagNoise,
    /// Wander of the offset in a sag.
    SagWander,
}

impl Term {
    /// Every term, in the order of the model's fields.
    pub const ALL: [Term; 20] = [
        Term::Bias,
        Term::Tco,
        Term::Curvature,
        Term::Hysteresis,
        Term::TurnOn,
        Term::Scale,
        Term::ScaleOverTemperature,
        Term::NonOrthogonality,
        Term::Mounting,
        Term::Quadratic,
        Term::Cubic,
        Term::WhiteNoise,
        Term::Flicker,
        Term::Clock,
        Term::ThermometerOffset,
        Term::ThermometerGain,
        Term::ThermometerNoise,
        Term::Quantisation,
        Term::SagNoise,
        Term::SagWander,
    ];
}

impl ErrorModel {
    /// This model with one term switched off.
    pub const fn without(self, term: Term) -> ErrorModel {
        self.with(term, &ErrorModel::PERFECT)
    }

    /// A perfect part but for one term, which is as in this model.
    pub const fn only(self, term: Term) -> ErrorModel {
        ErrorModel::PERFECT.with(term, &self)
    }

    /// This model with one term taken from another.
    pub const fn with(mut self, term: Term, from: &ErrorModel) -> ErrorModel {
        match term {
            Term::Bias => self.bias_mg = from.bias_mg,
            Term::Tco => self.tco_mg_per_c = from.tco_mg_per_c,
            Term::Curvature => self.curvature_ug_per_c2 = from.curvature_ug_per_c2,
            Term::Hysteresis => self.hysteresis_mg = from.hysteresis_mg,
            Term::TurnOn => self.turn_on_mg = from.turn_on_mg,
            Term::Scale => self.scale_ratio = from.scale_ratio,
            Term::ScaleOverTemperature => self.scale_ratio_per_c = from.scale_ratio_per_c,
            Term::NonOrthogonality => self.non_orthogonality_deg = from.non_orthogonality_deg,
            Term::Mounting => self.mounting_deg = from.mounting_deg,
            Term::Quadratic => self.quadratic_mg_per_g2 = from.quadratic_mg_per_g2,
            Term::Cubic => self.cubic_mg_per_g3 = from.cubic_mg_per_g3,
            Term::WhiteNoise => self.white_noise = from.white_noise,
            Term::Flicker => self.flicker_ug = from.flicker_ug,
            Term::Clock => self.clock_ratio = from.clock_ratio,
            Term::ThermometerOffset => self.thermometer_offset_c = from.thermometer_offset_c,
            Term::ThermometerGain => self.thermometer_gain_ratio = from.thermometer_gain_ratio,
            Term::ThermometerNoise => self.thermometer_noise_c = from.thermometer_noise_c,
            Term::Quantisation => self.quantisation = from.quantisation,
            Term::SagNoise => self.sag_noise_ratio = from.sag_noise_ratio,
            Term::SagWander => self.sag_wander_mg = from.sag_wander_mg,
        }
        self
    }
}
