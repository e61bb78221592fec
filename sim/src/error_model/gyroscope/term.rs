//! The terms of the gyroscope's error model by name, to switch one off or leave only one on.
//!
//! In: a model and a [`GyroscopeTerm`]. Out: another model. A gyroscope drawn from the same stream
//! keeps all its other numbers, because [`super::Gyroscope::draw`] draws every term, whatever its
//! size.

use super::GyroscopeModel;

/// One named term, for one field of [`GyroscopeModel`], where its size and source are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GyroscopeTerm {
    /// White noise.
    WhiteNoise,
    /// Zero-rate level at 25 degC.
    Bias,
    /// Bias over temperature.
    BiasOverTemperature,
    /// Curvature of the bias over temperature.
    BiasCurvature,
    /// Turn-on repeatability.
    TurnOn,
    /// Bias instability.
    Flicker,
    /// Random walk of the bias.
    Walk,
    /// Scale error at 25 degC.
    Scale,
    /// Scale over temperature.
    ScaleOverTemperature,
    /// Angles between the sensitive axes.
    NonOrthogonality,
    /// Rotation against the accelerometer.
    Misalignment,
    /// Response to specific force.
    GSensitivity,
    /// Growth of white noise in a sag.
    SagNoise,
}

impl GyroscopeTerm {
    /// Every term, in the order of the model's fields.
    pub const ALL: [GyroscopeTerm; 13] = [
        GyroscopeTerm::WhiteNoise,
        GyroscopeTerm::Bias,
        GyroscopeTerm::BiasOverTemperature,
        GyroscopeTerm::BiasCurvature,
        GyroscopeTerm::TurnOn,
        GyroscopeTerm::Flicker,
        GyroscopeTerm::Walk,
        GyroscopeTerm::Scale,
        GyroscopeTerm::ScaleOverTemperature,
        GyroscopeTerm::NonOrthogonality,
        GyroscopeTerm::Misalignment,
        GyroscopeTerm::GSensitivity,
        GyroscopeTerm::SagNoise,
    ];
}

impl GyroscopeModel {
    /// This model with one term switched off.
    pub const fn without(self, term: GyroscopeTerm) -> GyroscopeModel {
        self.with(term, &GyroscopeModel::PERFECT)
    }

    /// A perfect gyroscope but for one term, which is as in this model.
    pub const fn only(self, term: GyroscopeTerm) -> GyroscopeModel {
        GyroscopeModel::PERFECT.with(term, &self)
    }

    /// This model with one term taken from another.
    pub const fn with(mut self, term: GyroscopeTerm, from: &GyroscopeModel) -> GyroscopeModel {
        let (to, value) = match term {
            GyroscopeTerm::WhiteNoise => (&mut self.noise_density_dps, from.noise_density_dps),
            GyroscopeTerm::Bias => (&mut self.bias_dps, from.bias_dps),
            GyroscopeTerm::BiasOverTemperature => (&mut self.bias_dps_per_c, from.bias_dps_per_c),
            GyroscopeTerm::BiasCurvature => (&mut self.bias_dps_per_c2, from.bias_dps_per_c2),
            GyroscopeTerm::TurnOn => (&mut self.turn_on_dps, from.turn_on_dps),
            GyroscopeTerm::Flicker => (&mut self.flicker_dps, from.flicker_dps),
            GyroscopeTerm::Walk => (&mut self.walk_dps_per_rts, from.walk_dps_per_rts),
            GyroscopeTerm::Scale => (&mut self.scale_ratio, from.scale_ratio),
            GyroscopeTerm::ScaleOverTemperature => {
                (&mut self.scale_ratio_per_c, from.scale_ratio_per_c)
            }
            GyroscopeTerm::NonOrthogonality => {
                (&mut self.non_orthogonality_deg, from.non_orthogonality_deg)
            }
            GyroscopeTerm::Misalignment => (&mut self.misalignment_deg, from.misalignment_deg),
            GyroscopeTerm::GSensitivity => (&mut self.g_sensitivity_dps, from.g_sensitivity_dps),
            GyroscopeTerm::SagNoise => (&mut self.sag_noise_ratio, from.sag_noise_ratio),
        };
        *to = value;
        self
    }
}
