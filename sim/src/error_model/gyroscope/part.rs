//! One gyroscope's personality: what the model's terms came to for this part.
//!
//! In: the rate of turn and the specific force at the instant of a sample, the white noise of the
//! part's mode, the die's temperature, power-ons and sags. Out: what the part measures, dps,
//! before it is rounded to counts. The equation: `out = (1 + k(T)) M A R w + G R f + b(T) + noise`,
//! where the mounting R turns rate w and force f into the part's frame, A into the gyroscope's, and
//! M projects on its sensitive axes.

use super::super::flicker::Flicker;
use super::super::part::{Matrix, rotation, sensitive_axes};
use super::GyroscopeModel;
use crate::motion::add;
use crate::rng::Rng;

/// Temperature at which bias and scale are drawn, degC. `[DS]`
const REFERENCE_C: f64 = 25.0;
/// The random walk takes a step when so much time has passed, s; each for the time that did.
const WALK_STEP_S: f64 = 1.0;
/// No rotation.
const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// The numbers drawn once for a part.
#[derive(Clone, Debug)]
struct Personality {
    bias_dps: [f64; 3],
    bias_dps_per_c: [f64; 3],
    bias_dps_per_c2: [f64; 3],
    scale: [f64; 3],
    scale_per_c: [f64; 3],
    /// Sensitive axes in the part's frame, unit length: rows of M A.
    axes: Matrix,
    /// Response to force in the part's frame, dps/g: G.
    g_sensitivity_dps: Matrix,
}

impl Personality {
    fn draw(model: &GyroscopeModel, rng: &mut Rng) -> Personality {
        let mut three = |sigma: f64| rng.normals().map(|n| sigma * n);
        let angle_rad = model.non_orthogonality_deg.to_radians();
        Personality {
            bias_dps: three(model.bias_dps),
            bias_dps_per_c: three(model.bias_dps_per_c),
            bias_dps_per_c2: three(model.bias_dps_per_c2),
            scale: three(model.scale_ratio),
            scale_per_c: three(model.scale_ratio_per_c),
            axes: sensitive_axes(
                three(angle_rad),
                three(angle_rad),
                rotation(three(model.misalignment_deg.to_radians())),
            ),
            g_sensitivity_dps: [model.g_sensitivity_dps; 3].map(three),
        }
    }

    /// Sensitive axes with the scale of this temperature.
    fn matrix(&self, die_c: f64) -> Matrix {
        let warm = die_c - REFERENCE_C;
        [0, 1, 2].map(|i| {
            let gain = (1.0 + self.scale[i]) * (1.0 + self.scale_per_c[i] * warm);
            self.axes[i].map(|a| gain * a)
        })
    }

    /// Bias at this temperature without the turn-on's, dps.
    fn bias_dps(&self, die_c: f64) -> [f64; 3] {
        let warm = die_c - REFERENCE_C;
        [0, 1, 2].map(|i| {
            let slope = self.bias_dps_per_c[i] + self.bias_dps_per_c2[i] * warm;
            self.bias_dps[i] + slope * warm
        })
    }
}

/// Bias that walks away since power-on.
#[derive(Clone, Debug, Default)]
struct Walk {
    waited_s: f64,
    dps: [f64; 3],
}

impl Walk {
    fn step(&mut self, dps_per_rts: f64, dt_s: f64, rng: &mut Rng) {
        self.waited_s += dt_s;
        if self.waited_s >= WALK_STEP_S {
            let sigma_dps = dps_per_rts * std::mem::take(&mut self.waited_s).sqrt();
            self.dps = add(self.dps, rng.normals().map(|n| sigma_dps * n));
        }
    }
}

/// One gyroscope with its errors and their present state.
#[derive(Clone, Debug)]
pub struct Gyroscope {
    model: GyroscopeModel,
    personality: Personality,
    mounting: Matrix,
    die_c: f64,
    turn_on_dps: [f64; 3],
    flicker: Flicker,
    walk: Walk,
    sags: bool,
    /// What turns the housing's rate into the sensed one: (1 + k) M A R.
    matrix: Matrix,
    /// G R, dps/g.
    force_matrix: Matrix,
    bias_dps: [f64; 3],
}

impl Gyroscope {
    /// Makes a gyroscope from `rng`, at 25 degC, not yet powered on (its turn-on change is 0) and
    /// mounted in line with the housing. Always takes the same amount of numbers from `rng`,
    /// whichever terms are off, but for the rejections of the normal draw, which do not depend on
    /// the model either.
    pub fn draw(model: &GyroscopeModel, rng: &mut Rng) -> Gyroscope {
        let personality = Personality::draw(model, rng);
        let flicker = Flicker::settled(model.flicker_dps, rng);
        let mut gyroscope = Gyroscope {
            model: *model,
            personality,
            mounting: IDENTITY,
            die_c: REFERENCE_C,
            turn_on_dps: [0.0; 3],
            flicker,
            walk: Walk::default(),
            sags: false,
            matrix: IDENTITY,
            force_matrix: IDENTITY,
            bias_dps: [0.0; 3],
        };
        gyroscope.renew();
        gyroscope
    }

    /// The same gyroscope in a part that is mounted like this: the rotation from the housing into
    /// the part, by rows, which [`Part::mounting`](super::super::Part::mounting) gives for the
    /// accelerometer on the same die.
    pub fn mounted(mut self, mounting: [[f64; 3]; 3]) -> Gyroscope {
        self.mounting = mounting;
        self.renew();
        self
    }

    /// Power comes on: the turn-on change is drawn anew, bias instability and random walk start
    /// anew.
    pub fn power_on(&mut self, rng: &mut Rng) {
        self.turn_on_dps = rng.normals().map(|n| self.model.turn_on_dps * n);
        self.flicker = Flicker::settled(self.model.flicker_dps, rng);
        self.walk = Walk::default();
        self.renew();
    }

    /// The die is now at this temperature, degC.
    pub fn set_die_temperature(&mut self, die_c: f64) {
        self.die_c = die_c;
        self.renew();
    }

    /// The supply has begun or ceased to sag: white noise grows meanwhile.
    pub fn set_sag(&mut self, active: bool) {
        self.sags = active;
    }

    /// What turns the housing's rate into the sensed one at the present temperature, by rows.
    pub fn matrix(&self) -> [[f64; 3]; 3] {
        self.matrix
    }

    /// True temperature of the die, degC.
    pub fn die_c(&self) -> f64 {
        self.die_c
    }

    /// White noise of one sample at this nominal data rate, dps, 1 sigma.
    pub fn sample_sigma_dps(&self, odr_hz: f64) -> f64 {
        self.model.sample_sigma_dps(odr_hz)
    }

    /// One sample: the rate at its instant, dps, as the internal filters passed it, and the
    /// specific force, g, both in the housing's axes; the white noise of one sample, dps, 1 sigma
    /// ([`Gyroscope::sample_sigma_dps`]; without effect where that term is off); the time since
    /// the sample before, s (above 0). Returns dps about the part's axes before rounding.
    #[inline]
    pub fn feel(
        &mut self,
        rate_dps: [f64; 3],
        force_g: [f64; 3],
        sample_sigma_dps: f64,
        dt_s: f64,
        rng: &mut Rng,
    ) -> [f64; 3] {
        self.flicker.step(dt_s, rng);
        self.walk.step(self.model.walk_dps_per_rts, dt_s, rng);
        let drift_dps = add(self.flicker.sum, self.walk.dps);
        let sigma_dps = self.sigma_dps(sample_sigma_dps);
        let noise = rng.normals();
        let [p, q, r] = rate_dps;
        let [x, y, z] = force_g;
        // A loop: `map` over an array is not always inlined, and this runs at every sample.
        let mut felt_dps = [0.0; 3];
        for i in 0..3 {
            let ([a, b, c], [d, e, f]) = (self.matrix[i], self.force_matrix[i]);
            let sensed = a * p + b * q + c * r + (d * x + e * y + f * z);
            felt_dps[i] = sensed + self.bias_dps[i] + drift_dps[i] + sigma_dps * noise[i];
        }
        felt_dps
    }

    /// The white noise of one sample with the term's switch and the sag.
    fn sigma_dps(&self, sample_sigma_dps: f64) -> f64 {
        if self.model.noise_density_dps == 0.0 {
            0.0
        } else if self.sags {
            sample_sigma_dps * (1.0 + self.model.sag_noise_ratio)
        } else {
            sample_sigma_dps
        }
    }

    /// Brings what depends on temperature, power-on and mounting up to date.
    fn renew(&mut self) {
        self.matrix = times(&self.personality.matrix(self.die_c), &self.mounting);
        self.force_matrix = times(&self.personality.g_sensitivity_dps, &self.mounting);
        self.bias_dps = add(self.personality.bias_dps(self.die_c), self.turn_on_dps);
    }
}

/// The product of two matrices.
fn times(left: &Matrix, right: &Matrix) -> Matrix {
    left.map(|row| [0, 1, 2].map(|j| (0..3).map(|k| row[k] * right[k][j]).sum::<f64>()))
}
