//! Calibration by hand: a housing put down in poses, without any reference but gravity.
//!
//! In: mean readings of each channel in the poses of a plan, in g, compensated for temperature.
//! Out: a correction for each channel in the housing's frame, and what is known of its quality.
//!
//! What the reference is: gravity's length, which is 1 g in every pose, gives nine parameters of
//! a channel (scale, axes' angles to each other, zero-g offset). It shows nothing of how the sensor
//! is turned in its housing. That comes from two pairs of poses, each on one face on the same
//! surface, turned by 180 deg about the vertical between: the mean of both directions is the normal
//! of that face, whether the surface is level or not. The base gives the zero of both slopes, the
//! side face the direction of X in the base. So slopes are referred to the base, and X to the side
//! face as far as it stands square on the base.
//!
//! What cannot be told without a reference: whether the faces are flat and square, whether the turn
//! was 180 deg (half the surface's tilt times the turn's error, in radians, goes into the zero),
//! and what of the sensor's nonlinearity all poses share.
//!
//! Left out: standstill, and who puts the housing down (`by_hand`).

use tilt::angle::Axes;
use tilt::calibration::algebra::{cross, dot, plus};
use tilt::calibration::least_squares::times;
use tilt::calibration::{FitError, poses};
use tilt::chain::{Calibration, Correction};
use tilt::sample::Temperature;
use tilt::vector::Vector;

use super::fit::budget;

/// What a pose is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Use {
    /// For gravity's length.
    Length,
    /// Also one of the pair on the base.
    Base,
    /// Also one of the pair on the side face.
    Side,
}

/// One pose of the plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandPose {
    /// How to put the housing, in words.
    pub words: &'static str,
    /// What points up, in the housing's axes; of any length.
    pub up: [f64; 3],
    /// What it is for.
    pub of: Use,
}

const fn pose(words: &'static str, up: [f64; 3], of: Use) -> HandPose {
    HandPose { words, up, of }
}

/// All poses in the order in which they are asked for; the first [`FEWEST`] make a calibration.
pub const POSES: [HandPose; 18] = [
    pose("on its base", [0.0, 0.0, 1.0], Use::Base),
    pose(
        "on its base at the same place, turned by 180 deg",
        [0.0, 0.0, 1.0],
        Use::Base,
    ),
    pose("on its side, X up", [1.0, 0.0, 0.0], Use::Side),
    pose(
        "on the same side at the same place, X up, turned by 180 deg",
        [1.0, 0.0, 0.0],
        Use::Side,
    ),
    pose(
        "on the opposite side, X down",
        [-1.0, 0.0, 0.0],
        Use::Length,
    ),
    pose("on its side, Y up", [0.0, 1.0, 0.0], Use::Length),
    pose(
        "on the opposite side, Y down",
        [0.0, -1.0, 0.0],
        Use::Length,
    ),
    pose("upside down", [0.0, 0.0, -1.0], Use::Length),
    pose("leaning, X and Z half up", [1.0, 0.0, 1.0], Use::Length),
    pose(
        "leaning, X half down, Z half up",
        [-1.0, 0.0, 1.0],
        Use::Length,
    ),
    pose("leaning, Y and Z half up", [0.0, 1.0, 1.0], Use::Length),
    pose(
        "leaning, Y half down, Z half up",
        [0.0, -1.0, 1.0],
        Use::Length,
    ),
    pose("leaning, X and Y half up", [1.0, 1.0, 0.0], Use::Length),
    pose(
        "leaning, X half down, Y half up",
        [-1.0, 1.0, 0.0],
        Use::Length,
    ),
    pose(
        "leaning, X half up, Z half down",
        [1.0, 0.0, -1.0],
        Use::Length,
    ),
    pose(
        "leaning, Y half up, Z half down",
        [0.0, 1.0, -1.0],
        Use::Length,
    ),
    pose("leaning, X and Z half down", [-1.0, 0.0, -1.0], Use::Length),
    pose("leaning, Y and Z half down", [0.0, -1.0, -1.0], Use::Length),
];

/// Fewest poses of the plan.
pub const FEWEST: u8 = 13;

/// A pose further than this from what was asked for is another one, deg.
pub const NEAR_DEG: f64 = 20.0;

/// A surface tilted by more than this makes the turn's error count too much, deg.
pub const SURFACE_DEG: f64 = 2.0;

/// A side face further than this from square is no reference for X, deg.
pub const SQUARE_DEG: f64 = 2.0;

/// Length of gravity that one pose may miss, mg: more is no standstill, or another sensor.
pub const LENGTH_MG: f64 = 3.0;

/// Condition beyond which a set is refused; the plan itself has under 30.
pub const CONDITION: f64 = 1000.0;

/// Standard uncertainty of a turn by hand against an edge, deg. `[ASSUME]`
pub const TURN_DEG: f64 = 2.0;

/// What nine parameters from the poses leave of a sensor's nonlinearity beyond what gravity's
/// length shows, deg rms over poses and sensors: with 1 mg/g^2 and 1 mg/g^3 of each axis 0.042 deg,
/// of which the length shows 0.018. `[ASSUME]`
const NONLINEARITY_DEG: f64 = 0.038;

/// What one channel reads in a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Taken {
    /// The pose, as a place in [`POSES`].
    pub pose: usize,
    /// Mean of the channel in g, compensated for temperature, in the sensor's axes.
    pub mean_g: [f64; 3],
}

/// The fit of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct HandFit {
    /// Housing axis by sensor axis, g per g.
    pub matrix: [[f64; 3]; 3],
    /// Added after the matrix, g.
    pub offset_g: [f64; 3],
    /// Condition figure of the fit.
    pub condition: f64,
    /// What each pose misses of 1 g, mg, in the order given.
    pub length_mg: Vec<f64>,
}

impl HandFit {
    /// The corrected acceleration, g.
    pub fn apply(&self, accel_g: [f64; 3]) -> [f64; 3] {
        let [x, y, z] = times(&self.matrix, accel_g);
        let [a, b, c] = self.offset_g;
        [x + a, y + b, z + c]
    }

    /// Root mean square of what the poses miss of 1 g, mg, as one with so many free parameters.
    pub fn length_rms_mg(&self) -> f64 {
        let free = self.length_mg.len().saturating_sub(9).max(1) as f64;
        (self.length_mg.iter().map(|l| l * l).sum::<f64>() / free).sqrt()
    }

    /// Standard uncertainty of a vertical by it, deg.
    pub fn vertical_deg(&self, faces: &Faces) -> f64 {
        let shown_deg = (self.length_rms_mg() / 1000.0).to_degrees();
        shown_deg
            .hypot(NONLINEARITY_DEG)
            .hypot(faces.zero_uncertainty_deg())
    }

    /// The calibration that it makes of the one `before`, taken at these temperatures.
    pub fn calibration(
        &self,
        before: &Calibration,
        temperatures: impl IntoIterator<Item = Temperature>,
        faces: &Faces,
    ) -> Calibration {
        let vector = Vector::from_real(self.matrix, self.offset_g);
        let shown_deg = (self.length_rms_mg() / 1000.0).to_degrees();
        let residual_deg = shown_deg.hypot(NONLINEARITY_DEG);
        Calibration {
            temperature: before.temperature,
            correction: Correction::TwoAxis {
                // The fit has refused what does not fit the chain's numbers.
                vector: vector.unwrap_or(Vector::IDENTITY),
                harmonics: Axes::default(),
            },
            budget: budget(
                before,
                temperatures,
                faces.zero_uncertainty_deg(),
                residual_deg,
            ),
            rates: before.rates,
        }
    }

    fn turned(self, rotation: &[[f64; 3]; 3]) -> Self {
        Self {
            matrix: poses::product(rotation, &self.matrix),
            offset_g: times(rotation, self.offset_g),
            ..self
        }
    }
}

/// What the faces show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Faces {
    /// Tilt of the surface under the base, deg.
    pub base_surface_deg: f64,
    /// Tilt of the surface under the side face, deg.
    pub side_surface_deg: f64,
    /// What the side face is off the right angle to the base, deg.
    pub off_square_deg: f64,
    /// Angle that is left between the channels over all poses, deg rms; 0 of one channel.
    pub between_deg: f64,
}

impl Faces {
    /// Standard uncertainty that an unequal turn leaves in the zero of the slopes, deg.
    pub fn zero_uncertainty_deg(&self) -> f64 {
        self.base_surface_deg * TURN_DEG.to_radians() / 2.0
    }
}

/// Why poses make no calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HandError {
    /// These poses of the plan are missing.
    #[error("poses are missing: {a}", a = names(.0))]
    Missing(Vec<usize>),
    /// A channel's fit came to nothing; its letter.
    #[error("channel {0}: {1}")]
    Fit(char, FitError),
    /// A channel's poses leave a combination of the parameters nearly open.
    #[error(
        "channel {0}: the poses are too alike (condition {1:.0}): lean the housing by about 45 \
         deg where the plan has half"
    )]
    IllConditioned(char, f64),
    /// A channel misses gravity's length in a pose, by so many mg.
    #[error(
        "channel {0}: gravity is {2:.1} mg off 1 g in the pose {a:?}: it did not stand still, or \
         its temperature had not settled; take all poses again",
        a = name(*.1)
    )]
    Length(char, usize, f64),
    /// The surface under this pair is tilted by so many deg.
    #[error(
        "the surface under the pose {a:?} is tilted by {1:.1} deg, or the housing was not turned \
         by 180 deg at one place: take a surface within {SURFACE_DEG} deg of level",
        a = name(*.0)
    )]
    Surface(usize, f64),
    /// The side face is off square by so many deg.
    #[error(
        "the side that X stands on is {0:.1} deg off the right angle to the base: it gives no \
         direction of X; was it another side?"
    )]
    Square(f64),
}

fn name(place: usize) -> &'static str {
    POSES.get(place).map_or("", |pose| pose.words)
}

fn names(places: &[usize]) -> String {
    let names: Vec<_> = places.iter().map(|place| name(*place)).collect();
    names.join("; ")
}

/// Corrections for one or two channels, each with its letter, that stood in the same poses; the
/// second one in the first one's frame. `wanted` is how many poses of the plan there have to be.
///
/// Errors: see [`HandError`].
pub fn fit(
    channels: &[(char, Vec<Taken>)],
    wanted: usize,
) -> Result<(Vec<HandFit>, Faces), HandError> {
    for (_, taken) in channels {
        let there = |place: &usize| taken.iter().any(|t| t.pose == *place);
        let missing: Vec<usize> = (0..wanted).filter(|place| !there(place)).collect();
        if !missing.is_empty() {
            return Err(HandError::Missing(missing));
        }
    }
    let mut fits: Vec<HandFit> = channels
        .iter()
        .map(|(channel, taken)| length_fit(*channel, taken))
        .collect::<Result<_, _>>()?;
    let between_deg = match (&mut fits[..], channels) {
        ([a, b], [(_, for_a), (channel, for_b)]) => {
            let turned = bring_together(a, b, for_a, for_b);
            turned.map_err(|error| HandError::Fit(*channel, error))?
        }
        _ => 0.0,
    };
    let (rotation, faces) = frame(&fits, channels, between_deg)?;
    let fits = fits.into_iter().map(|fit| fit.turned(&rotation)).collect();
    Ok((fits, faces))
}

/// What the poses so far miss of 1 g, mg rms with nine parameters free; `None` while they are too
/// few or too alike.
pub fn length_so_far_mg(taken: &[Taken]) -> Option<f64> {
    let enough = taken.len() > poses::FEWEST_POSES;
    let fitted = enough.then(|| length_fit(' ', taken))?;
    fitted.ok().map(|fit| fit.length_rms_mg())
}

/// Nine parameters of a channel, in a frame of its own.
fn length_fit(channel: char, taken: &[Taken]) -> Result<HandFit, HandError> {
    let means: Vec<_> = taken.iter().map(|t| t.mean_g).collect();
    let fitted = poses::fit(&means).map_err(|error| match error {
        FitError::IllConditioned { condition } => HandError::IllConditioned(channel, condition),
        other => HandError::Fit(channel, other),
    })?;
    if fitted.condition > CONDITION {
        return Err(HandError::IllConditioned(channel, fitted.condition));
    }
    let mut fit = HandFit {
        matrix: fitted.matrix,
        offset_g: fitted.offset_g,
        condition: fitted.condition,
        length_mg: Vec::new(),
    };
    let length_mg = means.iter().map(|m| 1000.0 * (length(fit.apply(*m)) - 1.0));
    fit.length_mg = length_mg.collect();
    for (t, mg) in taken.iter().zip(&fit.length_mg) {
        if mg.abs() > LENGTH_MG {
            return Err(HandError::Length(channel, t.pose, *mg));
        }
    }
    Ok(fit)
}

/// Turns the second channel into the frame of the first; the angle that is left, deg rms.
fn bring_together(
    a: &HandFit,
    b: &mut HandFit,
    for_a: &[Taken],
    for_b: &[Taken],
) -> Result<f64, FitError> {
    let unit = |fit: &HandFit, t: &Taken| normal(fit.apply(t.mean_g));
    let to: Vec<_> = for_a.iter().map(|t| unit(a, t)).collect();
    let from: Vec<_> = for_b.iter().map(|t| unit(b, t)).collect();
    let rotation = poses::align(&from, &to)?;
    let left = from.iter().zip(&to);
    let squares = left.map(|(f, t)| angle_deg(times(&rotation, *f), *t).powi(2));
    let rms = (squares.sum::<f64>() / to.len().max(1) as f64).sqrt();
    *b = b.clone().turned(&rotation);
    Ok(rms)
}

/// From the channels' common frame to the housing's.
fn frame(
    fits: &[HandFit],
    channels: &[(char, Vec<Taken>)],
    between_deg: f64,
) -> Result<([[f64; 3]; 3], Faces), HandError> {
    let pair = |of: Use| {
        let both = fits.iter().zip(channels).map(|(fit, (_, taken))| {
            let mut found = taken.iter().filter(|t| POSES[t.pose].of == of);
            let mut next = || found.next().map(|t| normal(fit.apply(t.mean_g)));
            [next(), next()].map(Option::unwrap_or_default)
        });
        let sums = both.fold([[0.0; 3]; 2], |[s, t], [u, v]| [plus(s, u), plus(t, v)]);
        let [one, other] = sums.map(normal);
        (normal(plus(one, other)), angle_deg(one, other) / 2.0)
    };
    let (z, base_surface_deg) = pair(Use::Base);
    let (side, side_surface_deg) = pair(Use::Side);
    let along = dot(side, z);
    let x = normal([
        side[0] - along * z[0],
        side[1] - along * z[1],
        side[2] - along * z[2],
    ]);
    let faces = Faces {
        base_surface_deg,
        side_surface_deg,
        off_square_deg: along.asin().to_degrees(),
        between_deg,
    };
    for (place, deg) in [(0, base_surface_deg), (2, side_surface_deg)] {
        if deg > SURFACE_DEG {
            return Err(HandError::Surface(place, deg));
        }
    }
    if faces.off_square_deg.abs() > SQUARE_DEG {
        return Err(HandError::Square(faces.off_square_deg));
    }
    Ok(([x, cross(z, x), z], faces))
}

/// The angle between two directions, deg.
pub fn angle_deg(a: [f64; 3], b: [f64; 3]) -> f64 {
    length(cross(a, b)).atan2(dot(a, b)).to_degrees()
}

fn length(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

fn normal(v: [f64; 3]) -> [f64; 3] {
    let length = length(v);
    v.map(|c| c / length)
}

#[cfg(test)]
#[path = "hand_tests.rs"]
mod tests;
