//! From rests and the turns between them to the correction of a node's gyroscope.
//!
//! In: what a node read at each rest, the log of its gyroscope, and its calibration with the new
//! accelerometer. Out: its new correction with uncertainties, or why it has none. Before and after
//! each turn the reference is gravity, as the node's own accelerometer shows it; how far a motor or
//! a hand has turned takes no part.
//!
//! The fit goes over the turns twice (`tilt::calibration::gyroscope`). Between two looks at the
//! node the rate is taken to change evenly, so that an axis that moves meanwhile does no harm: see
//! [`rotations`].
//!
//! The bias is that of all rests. How it changes with temperature, and the scale, is what the node
//! held before: nobody heats the housing here. So is what the turns do not show: gains of an axis
//! of the sensor about which the housing was hardly turned.
//!
//! Left out: following the nodes (`session`), and who turns (`turns`, `by_hand`).

use tilt::calibration::FitError;
use tilt::calibration::algebra::cross;
use tilt::calibration::gyroscope::{
    Accuracy, BiasFit, FittedBias, FittedGains, GainFit, Rotation, Turn,
};
use tilt::chain::{Calibration, Correction};
use tilt::rate::{RateCorrection, RealRateCorrection};
use tilt::sample::Temperature;

use super::fit::{compensated, temperature};
use super::hand::angle_deg;
use super::reading::Reading;
use super::turned::{Log, Spoilt, Step};

/// Noise density of the gyroscope, (rad/s)/sqrt(Hz): 5 mdps. `[ASSUME]`
const NOISE: f64 = 8.73e-5;

/// What the bias of a turn is known to, rad/s: 0.015 deg/s, of which the earth has 0.004, and most
/// of the rest is what acceleration does to it on the way between two poses. `[ASSUME]`
const BIAS: f64 = 2.62e-4;

/// The longest turn, s: behind it the bias of the rest before shows too little.
const LONGEST_S: f64 = 60.0;

/// Largest standard uncertainty of a gain that the turns are to show.
pub const LARGEST: f64 = 0.003;

/// Turns kept out of the fit may end so far from where it leads, deg.
const LARGEST_CHECK_DEG: f64 = 0.5;

/// A sensor that stands still, and its gyroscope meanwhile.
#[derive(Clone, Debug)]
pub struct Rest {
    /// What the node read.
    pub reading: Reading,
    /// From where to where in its log.
    pub marks: [usize; 2],
    /// 2034h sub 6 meanwhile.
    pub gaps: u16,
    /// The turn that ends here checks the fit and takes no part in it.
    pub checks: bool,
}

/// What was asked of the turns.
#[derive(Clone, Copy, Debug)]
pub struct Demand {
    /// Standard uncertainty of the accelerometer's vertical, deg.
    pub vertical_deg: f64,
    /// Fewest turns that go into the fit.
    pub fewest: usize,
    /// Sensor axes whose gains have to be shown, and others that may stay open.
    pub shown: [bool; 3],
}

/// Why a turn does not count.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BadTurn {
    /// It could not be followed.
    #[error(transparent)]
    Spoilt(#[from] Spoilt),
    /// It took too long.
    #[error("it took more than 60 s")]
    Long,
    /// It came back by the same path, or was hardly one.
    #[error("it shows too little: less than about 6 deg, or back by the same path")]
    Short,
    /// It does not end where the rates lead.
    #[error("the gyroscope does not lead to where the accelerometer ends")]
    Elsewhere,
}

impl From<FitError> for BadTurn {
    fn from(error: FitError) -> Self {
        match error {
            FitError::IllConditioned { .. } | FitError::TooFew { .. } => Self::Short,
            _ => Self::Elsewhere,
        }
    }
}

/// Why a gyroscope stays as it was.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Refused {
    /// Too few turns: how many there are, how many are needed, and what was wrong with most of the
    /// others.
    #[error("{0} of its turns can be used and {1} are needed{a}", a = most(.2))]
    TooFew(usize, usize, Option<BadTurn>),
    /// The fit came to nothing.
    #[error("its turns contradict each other or the nominal axes: {0}")]
    Fit(FitError),
    /// An axis of the sensor that was turned too little: its letter, and the uncertainty, percent.
    #[error("its turns about axis {0} show too little: a gain is known to {1:.2} % only (k = 1)")]
    Open(char, f64),
    /// The turns kept out of the fit do not agree with it, deg.
    #[error("a turn that checks it ends {0:.2} deg from where it leads")]
    Check(f64),
    /// A bias that no gyroscope in order has.
    #[error("its bias is none of a gyroscope in order: {0}")]
    Bias(FitError),
    /// The node refuses angles with it.
    #[error("with the new correction it gives no angle (reason {0})")]
    NoAngle(u8),
}

fn most(bad: &Option<BadTurn>) -> String {
    bad.map_or(String::new(), |bad| format!("; of most others: {bad}"))
}

/// The new correction of a gyroscope.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// It.
    pub rates: RateCorrection,
    /// Scale and axes.
    pub gains: FittedGains,
    /// The bias at rest; its slopes are left out.
    pub bias: FittedBias,
    /// Sensor axes whose gains the turns do not show: they are those of before.
    pub open: [bool; 3],
    /// How far the turns kept out of the fit end from where it leads, at most, deg; none without
    /// such turns.
    pub check_deg: Option<f64>,
}

/// What has come of the turns of a node.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Turns that could be used, those that check the fit included.
    pub used: usize,
    /// Those that could not, by their number from 1.
    pub bad: Vec<(usize, BadTurn)>,
    /// The correction, or why there is none.
    pub found: Result<Found, Refused>,
}

/// A turn ready for the fit.
struct Path {
    before: [f64; 3],
    after: [f64; 3],
    /// Rotations by the gyroscope along the sensor's axes, rad, each with how long it took, s.
    rotations: Vec<([f64; 3], f64)>,
    checks: bool,
}

/// The correction that these rests give, with the calibration whose accelerometer is new.
pub fn solve(
    calibration: &Calibration,
    period_s: f64,
    log: &Log,
    rests: &[Rest],
    demand: &Demand,
) -> Outcome {
    let node = Sensor {
        calibration,
        period_s,
        log,
        before: calibration.rates.unwrap_or(RateCorrection::IDENTITY).real(),
        rests,
    };
    let start = node.start();
    let mut paths = Vec::new();
    let mut bad = Vec::new();
    for (number, pair) in (1..).zip(rests.windows(2)) {
        let path = node.path(&pair[0], &pair[1]);
        match path.and_then(|path| Ok(path.turn(start).map(|_| path)?)) {
            Ok(path) => paths.push(path),
            Err(error) => bad.push((number, error)),
        }
    }
    let found = node.found(&paths, &bad, demand);
    Outcome {
        used: paths.len(),
        bad,
        found,
    }
}

/// One node with all that was measured.
struct Sensor<'a> {
    calibration: &'a Calibration,
    period_s: f64,
    log: &'a Log,
    /// The correction that it had.
    before: RealRateCorrection,
    rests: &'a [Rest],
}

impl Sensor<'_> {
    /// The turn from one rest to the next.
    fn path(&self, from: &Rest, to: &Rest) -> Result<Path, BadTurn> {
        let upright = |rest: &Rest| {
            let reading = &rest.reading;
            upright(self.calibration, reading.accel, reading.temperature_c)
        };
        Ok(Path {
            before: upright(from),
            after: upright(to),
            rotations: way(self.log, self.period_s, from, to)?,
            checks: to.checks,
        })
    }

    fn found(
        &self,
        paths: &[Path],
        bad: &[(usize, BadTurn)],
        demand: &Demand,
    ) -> Result<Found, Refused> {
        let into: Vec<&Path> = paths.iter().filter(|path| !path.checks).collect();
        if into.len() < demand.fewest {
            let most = most_of(bad);
            return Err(Refused::TooFew(into.len(), demand.fewest, most));
        }
        let gains = passes(&into, self.start(), demand).map_err(Refused::Fit)?;
        let bias = self.bias().map_err(Refused::Bias)?;
        let open = open(&gains, demand)?;
        let checks = paths.iter().filter(|path| path.checks);
        let check_deg = checks
            .map(|path| path.misses_deg(gains.gains))
            .reduce(f64::max);
        if let Some(deg) = check_deg.filter(|deg| *deg > LARGEST_CHECK_DEG) {
            return Err(Refused::Check(deg));
        }
        let [x, y, z] = self.scale();
        let rates = RateCorrection::from_real(&RealRateCorrection {
            matrix: gains.gains.map(|[a, b, c]| [a / x, b / y, c / z]),
            bias: bias.bias,
            ..self.before
        });
        Ok(Found {
            rates: rates.ok_or(Refused::Fit(FitError::Implausible))?,
            gains,
            bias,
            open,
            check_deg,
        })
    }

    /// The gains before, at the temperature of the rests.
    fn start(&self) -> [[f64; 3]; 3] {
        let [x, y, z] = self.scale();
        self.before.matrix.map(|[a, b, c]| [a * x, b * y, c * z])
    }

    /// What the slope of the scale makes of it at the temperature of the rests.
    fn scale(&self) -> [f64; 3] {
        let sum: f64 = self
            .rests
            .iter()
            .map(|rest| rest.reading.temperature_c)
            .sum();
        let d = sum / self.rests.len().max(1) as f64 - 25.0;
        self.before.scale1.map(|slope| 1.0 + slope * d)
    }

    /// The bias at 25 degC, from all rests less what its slopes make at their temperature.
    fn bias(&self) -> Result<FittedBias, FitError> {
        let mut fit = BiasFit::default();
        for rest in self.rests {
            let Ok(rate) = rest.rate(self.log) else {
                continue;
            };
            let d = rest.reading.temperature_c - 25.0;
            let RealRateCorrection { bias1, bias2, .. } = self.before;
            let flat = [0, 1, 2].map(|axis| rate[axis] - d * (bias1[axis] + d * bias2[axis]));
            // All of one temperature: these rests show no slopes.
            fit.add(flat, Temperature::REFERENCE);
        }
        fit.solve()
    }
}

impl Path {
    /// The turn as its equations, where it begins with these gains.
    fn turn(&self, gains: [[f64; 3]; 3]) -> Result<Turn, FitError> {
        rotation(&self.rotations, gains).between(self.before, self.after)
    }

    /// How far its end is from where these gains lead, deg.
    fn misses_deg(&self, gains: [[f64; 3]; 3]) -> f64 {
        let leads_to = rotation(&self.rotations, gains).expected(self.before);
        angle_deg(leads_to, self.after)
    }
}

impl Rest {
    /// Its mean rate, rad/s.
    fn rate(&self, log: &Log) -> Result<[f64; 3], Spoilt> {
        log.rest(self.marks[0], self.marks[1])
    }
}

/// The way from one rest to the next without the bias of both: its rotations along the sensor's
/// axes, rad, each with how long it took, s.
///
/// Errors: what spoils the turn, and [`BadTurn::Long`].
pub fn way(
    log: &Log,
    period_s: f64,
    from: &Rest,
    to: &Rest,
) -> Result<Vec<([f64; 3], f64)>, BadTurn> {
    if from.gaps != to.gaps {
        return Err(Spoilt::Gap.into());
    }
    let (before, after) = (from.rate(log)?, to.rate(log)?);
    let bias = [0, 1, 2].map(|axis| (before[axis] + after[axis]) / 2.0);
    let steps = log.between(from.marks[1], to.marks[0])?;
    let rotations = rotations(&steps, bias, period_s);
    match rotations.iter().map(|(_, dt_s)| dt_s).sum::<f64>() > LONGEST_S {
        true => Err(BadTurn::Long),
        false => Ok(rotations),
    }
}

/// What a way comes to with these gains.
pub fn rotation(way: &[([f64; 3], f64)], gains: [[f64; 3]; 3]) -> Rotation {
    let mut sum = Rotation::new(gains);
    for (rotation, dt_s) in way {
        let angle = rotation.iter().map(|a| a.abs()).fold(0.0, f64::max);
        let parts = (angle / LARGEST_PART).ceil().max(1.0);
        // A step of a few degrees goes in parts: the sum takes each as small.
        let part_s = dt_s / parts;
        let rate = rotation.map(|a| a / dt_s);
        for _ in 0..parts as u32 {
            sum.sample(rate, part_s);
        }
    }
    sum
}

/// What turns are known to beside an accelerometer of this standard uncertainty, deg.
pub fn accuracy(vertical_deg: f64) -> Accuracy {
    Accuracy {
        vertical: vertical_deg.to_radians(),
        noise: NOISE,
        bias: BIAS,
    }
}

/// The largest part of a rotation that goes into a sum at once, rad: 1 deg.
const LARGEST_PART: f64 = 0.0175;

/// Both passes over the turns that go into the fit.
fn passes(paths: &[&Path], start: [[f64; 3]; 3], demand: &Demand) -> Result<FittedGains, FitError> {
    let accuracy = accuracy(demand.vertical_deg);
    let mut first = GainFit::near(start, accuracy);
    for path in paths {
        first.add(&path.turn(first.present())?);
    }
    let gains = first.present();
    let mut second = GainFit::near(start, accuracy);
    for path in paths {
        second.add(&path.turn(gains)?);
    }
    second.solve()
}

/// The sensor axes whose gains the turns leave open.
fn open(gains: &FittedGains, demand: &Demand) -> Result<[bool; 3], Refused> {
    let mut open = [false; 3];
    for (axis, open) in open.iter_mut().enumerate() {
        let of_axis = gains.uncertainty.iter().map(|row| row[axis]);
        let worst = of_axis.fold(0.0, f64::max);
        *open = worst > LARGEST;
        if *open && demand.shown[axis] {
            return Err(Refused::Open(['x', 'y', 'z'][axis], 100.0 * worst));
        }
    }
    Ok(open)
}

/// The reason that most of the turns have that cannot be used.
fn most_of(bad: &[(usize, BadTurn)]) -> Option<BadTurn> {
    let like = |reason: &BadTurn| bad.iter().filter(|(_, other)| other == reason).count();
    let reasons = bad.iter().map(|(_, reason)| *reason);
    reasons.max_by_key(like)
}

/// The vertical that a node's accelerometer shows, of length 1 in the housing's axes, from its mean
/// (2^-26 g, sensor's axes) and its temperature.
pub fn upright(calibration: &Calibration, accel: [f64; 3], temperature_c: f64) -> [f64; 3] {
    let at = temperature(temperature_c);
    let felt = compensated(&calibration.temperature, accel, at);
    let accel = match &calibration.correction {
        Correction::TwoAxis { vector, .. } | Correction::OneAxis { vector, .. } => {
            vector.apply(felt).accel
        }
        Correction::Tables { .. } => felt.accel,
    };
    let accel = accel.map(f64::from);
    let length = accel.iter().map(|a| a * a).sum::<f64>().sqrt();
    accel.map(|a| a / length)
}

/// The rotation of each step, rad along the sensor's axes, and how long it took, s.
///
/// Where the axis of the turn moves within a step, the rotation is more than the integral of the
/// rate (coning): with a rate that changes evenly by `r` rad/s^2 it is more by T^3/12 rate x r.
/// What a step leaves then grows with T^5; the test has the figures.
pub fn rotations(steps: &[Step], bias: [f64; 3], period_s: f64) -> Vec<([f64; 3], f64)> {
    let rates: Vec<([f64; 3], f64)> = steps
        .iter()
        .map(|step| {
            let count = f64::from(step.samples);
            let rate = [0, 1, 2].map(|axis| step.sum[axis] / count - bias[axis]);
            (rate, count * period_s)
        })
        .collect();
    let around = |place: usize| {
        let (own, own_s) = rates[place];
        let (before, before_s) = *rates.get(place.wrapping_sub(1)).unwrap_or(&rates[place]);
        let (after, after_s) = *rates.get(place + 1).unwrap_or(&rates[place]);
        let apart_s = (before_s + after_s) / 2.0 + own_s;
        let change = [0, 1, 2].map(|axis| (after[axis] - before[axis]) / apart_s);
        let more = cross(own, change).map(|more| more * own_s.powi(3) / 12.0);
        ([0, 1, 2].map(|axis| own[axis] * own_s + more[axis]), own_s)
    };
    (0..rates.len()).map(around).collect()
}

#[cfg(test)]
#[path = "gains_tests.rs"]
mod tests;
