//! One sensor's personality: what the model's terms came to for this part.
//!
//! In: the force at the instant of a sample, g, the noise of the part's mode, the die's
//! temperature, power-ons and sags. Out: what the part measures, g, before it is rounded to
//! counts; its thermometer's reading; its clock. The equation, per axis i:
//! `out_i = s_i + q_i s_i^2 + c_i s_i^3 + b_i(T) + noise`, where `s = (1 + k(T)) M R f`: the
//! mounting R turns the force into the part's frame, M projects it on the sensitive axes.
//!
//! Thermal hysteresis `[ASSUME]`: a play of 10 degC moves a state from -1 to 1 (a full reversal
//! takes 20 degC, so reversing by 10 degC from one branch leads to the middle of the loop). The
//! offset is the state times the part's own half-opening times 1 - ((T - 30)/40)^2, so the loop
//! is widest at 30 degC and closed at -10 and 70 degC. A new part is at 25 degC in the middle.

use super::ErrorModel;
use super::flicker::{Flicker, Markov};
use crate::rng::Rng;

/// Temperature at which offset and scale are drawn, degC. `[DS]` reference of TyOff, TCO and TCS
const REFERENCE_C: f64 = 25.0;
/// Change of temperature that moves the hysteresis from the middle to one branch, degC. `[ASSUME]`
const PLAY_C: f64 = 10.0;
/// Middle and half-width of the hysteresis loop, degC. `[ASSUME]`
const LOOP_C: (f64, f64) = (30.0, 40.0);
/// Time constant of a sag's wander, s. `[ASSUME]`
const SAG_TAU_S: f64 = 2.0;
/// Rows of a matrix.
pub(super) type Matrix = [[f64; 3]; 3];
const MILLI: f64 = 1e-3;
const MICRO: f64 = 1e-6;

/// The numbers drawn once for a part.
#[derive(Clone, Debug)]
struct Personality {
    bias_g: [f64; 3],
    tco_g_per_c: [f64; 3],
    curvature_g_per_c2: [f64; 3],
    hysteresis_g: [f64; 3],
    scale: [f64; 3],
    scale_per_c: [f64; 3],
    /// Two small angles for each sensitive axis: M.
    angles_rad: [[f64; 3]; 2],
    /// The part in the housing about x, then y, then z: R.
    turn_rad: [f64; 3],
    quadratic_per_g: [f64; 3],
    cubic_per_g2: [f64; 3],
    clock_factor: f64,
    thermometer_offset_c: f64,
    thermometer_gain: f64,
}

impl Personality {
    fn draw(model: &ErrorModel, rng: &mut Rng) -> Personality {
        let mut three = |sigma: f64| rng.normals().map(|n| sigma * n);
        let angle_rad = model.non_orthogonality_deg.to_radians();
        Personality {
            bias_g: three(model.bias_mg * MILLI),
            tco_g_per_c: three(model.tco_mg_per_c * MILLI),
            curvature_g_per_c2: three(model.curvature_ug_per_c2 * MICRO),
            hysteresis_g: three(model.hysteresis_mg * MILLI),
            scale: three(model.scale_ratio),
            scale_per_c: three(model.scale_ratio_per_c),
            quadratic_per_g: three(model.quadratic_mg_per_g2 * MILLI),
            cubic_per_g2: three(model.cubic_mg_per_g3 * MILLI),
            angles_rad: [three(angle_rad), three(angle_rad)],
            turn_rad: three(model.mounting_deg.to_radians()),
            clock_factor: 1.0 + rng.range(-model.clock_ratio, model.clock_ratio),
            thermometer_offset_c: model.thermometer_offset_c * rng.normal(),
            thermometer_gain: 1.0 + model.thermometer_gain_ratio * rng.normal(),
        }
    }

    /// Sensitive axes, rows of M R, with the scale of this temperature.
    fn matrix(&self, axes: &Matrix, die_c: f64) -> Matrix {
        let warm = die_c - REFERENCE_C;
        [0, 1, 2].map(|i| {
            let gain = (1.0 + self.scale[i]) * (1.0 + self.scale_per_c[i] * warm);
            axes[i].map(|a| gain * a)
        })
    }

    /// Offset at this temperature with the hysteresis in this state, without the turn-on's, g.
    fn bias_g(&self, die_c: f64, hysteresis: f64) -> [f64; 3] {
        let warm = die_c - REFERENCE_C;
        let open = (1.0 - ((die_c - LOOP_C.0) / LOOP_C.1).powi(2)).max(0.0);
        [0, 1, 2].map(|i| {
            self.bias_g[i]
                + self.tco_g_per_c[i] * warm
                + self.curvature_g_per_c2[i] * warm * warm
                + self.hysteresis_g[i] * hysteresis * open
        })
    }
}

/// Rows of M R: six small angles (two for each sensitive axis), rad, and a rotation.
pub(super) fn sensitive_axes(first: [f64; 3], second: [f64; 3], rotation: Matrix) -> Matrix {
    let rows = [
        [1.0, first[0], second[0]],
        [first[1], 1.0, second[1]],
        [first[2], second[2], 1.0],
    ];
    rows.map(|row| {
        // A unit row keeps the angles apart from the scale.
        let length = row.iter().map(|r| r * r).sum::<f64>().sqrt();
        [0, 1, 2].map(|j| (0..3).map(|k| row[k] * rotation[k][j]).sum::<f64>() / length)
    })
}

/// The rotation about x, then y, then z by these angles, rad.
pub(super) fn rotation([x, y, z]: [f64; 3]) -> Matrix {
    let ((sx, cx), (sy, cy), (sz, cz)) = (x.sin_cos(), y.sin_cos(), z.sin_cos());
    [
        [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
        [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
        [-sy, cy * sx, cy * cx],
    ]
}

/// One sensor with its errors and their present state.
#[derive(Clone, Debug)]
pub struct Part {
    model: ErrorModel,
    personality: Personality,
    /// Sensitive axes in the housing's frame, unit length: rows of M R.
    axes: Matrix,
    die_c: f64,
    hysteresis: f64,
    turn_on_g: [f64; 3],
    flicker: Flicker,
    sag: Option<Markov>,
    matrix: [[f64; 3]; 3],
    bias_g: [f64; 3],
}

impl Part {
    /// Makes a part from `rng`, at 25 degC and not yet powered on (its turn-on offset is 0).
    /// Always takes the same amount of numbers from `rng`, whichever terms are off, but for the
    /// rejections of the normal draw, which do not depend on the model either.
    pub fn draw(model: &ErrorModel, rng: &mut Rng) -> Part {
        let personality = Personality::draw(model, rng);
        let flicker = Flicker::settled(model.flicker_ug * MICRO, rng);
        let [first, second] = personality.angles_rad;
        let axes = sensitive_axes(first, second, rotation(personality.turn_rad));
        let mut part = Part {
            model: *model,
            matrix: personality.matrix(&axes, REFERENCE_C),
            axes,
            bias_g: [0.0; 3],
            personality,
            die_c: REFERENCE_C,
            hysteresis: 0.0,
            turn_on_g: [0.0; 3],
            flicker,
            sag: None,
        };
        part.renew_bias();
        part
    }

    /// Power comes on: the turn-on offset is drawn anew and the 1/f floor starts anew.
    pub fn power_on(&mut self, rng: &mut Rng) {
        self.turn_on_g = rng.normals().map(|n| self.model.turn_on_mg * MILLI * n);
        self.flicker = Flicker::settled(self.model.flicker_ug * MICRO, rng);
        self.renew_bias();
    }

    /// The die is now at this temperature, degC. Call it at each thermal step, powered or not:
    /// the hysteresis follows the path of the temperature, and a step must not hide a reversal.
    pub fn set_die_temperature(&mut self, die_c: f64) {
        let moved = (die_c - self.die_c) / PLAY_C;
        self.hysteresis = (self.hysteresis + moved).clamp(-1.0, 1.0);
        self.die_c = die_c;
        self.matrix = self.personality.matrix(&self.axes, die_c);
        self.renew_bias();
    }

    fn renew_bias(&mut self) {
        let thermal = self.personality.bias_g(self.die_c, self.hysteresis);
        self.bias_g = [0, 1, 2].map(|i| thermal[i] + self.turn_on_g[i]);
    }

    /// The supply has begun or ceased to sag. In a sag white noise grows and the offset wanders,
    /// from 0 at its beginning; with its end both are gone at once.
    pub fn set_sag(&mut self, active: bool) {
        match (active, &self.sag) {
            (true, None) => self.sag = Some(Markov::at_rest(SAG_TAU_S)),
            (false, Some(_)) => self.sag = None,
            _ => {}
        }
    }

    /// One sample: the force at its instant, g, as the analogue filter passed it; the white
    /// noise of one sample in the part's mode, g, 1 sigma, which is the density times
    /// sqrt(ODR / 2); the time since the sample before, s (above 0). Returns g before rounding.
    #[inline]
    pub fn feel(
        &mut self,
        force_g: [f64; 3],
        sample_sigma_g: f64,
        dt_s: f64,
        rng: &mut Rng,
    ) -> [f64; 3] {
        let mut sigma_g = sample_sigma_g * self.model.white_noise;
        self.flicker.step(dt_s, rng);
        let mut offset_g = crate::motion::add(self.bias_g, self.flicker.sum);
        if let Some(wander) = &mut self.sag {
            wander.step(dt_s, rng);
            sigma_g *= 1.0 + self.model.sag_noise_ratio;
            let rms_g = self.model.sag_wander_mg * MILLI;
            offset_g = crate::motion::add(offset_g, wander.value.map(|w| rms_g * w));
        }
        let [x, y, z] = force_g;
        let [quadratic, cubic] = [
            &self.personality.quadratic_per_g,
            &self.personality.cubic_per_g2,
        ];
        let noise = rng.normals();
        // A loop: `map` over an array is not always inlined, and this runs at every sample.
        let mut felt_g = [0.0; 3];
        for i in 0..3 {
            let [a, b, c] = self.matrix[i];
            let sensed = a * x + b * y + c * z;
            let bend = quadratic[i] + cubic[i] * sensed;
            felt_g[i] = sensed + sensed * sensed * bend + offset_g[i] + sigma_g * noise[i];
        }
        felt_g
    }

    /// One reading of the part's thermometer, degC, before rounding.
    pub fn thermometer(&mut self, rng: &mut Rng) -> f64 {
        let personality = &self.personality;
        REFERENCE_C
            + personality.thermometer_gain * (self.die_c - REFERENCE_C)
            + personality.thermometer_offset_c
            + self.model.thermometer_noise_c * rng.normal()
    }

    /// True over nominal output data rate: 1 within +- the model's clock term.
    pub fn clock_factor(&self) -> f64 {
        self.personality.clock_factor
    }

    /// The rotation from the housing into the part, by rows, also of a gyroscope on its die.
    pub fn mounting(&self) -> [[f64; 3]; 3] {
        rotation(self.personality.turn_rad)
    }

    /// Whether readings are to be rounded to counts.
    pub fn quantises(&self) -> bool {
        self.model.quantisation
    }

    /// True temperature of the die, degC.
    pub fn die_c(&self) -> f64 {
        self.die_c
    }
}
