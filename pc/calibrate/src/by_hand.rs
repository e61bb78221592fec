//! Calibration by hand: pose after pose, each when the housing stands still.
//!
//! In: a session and a person. Out: what was taken in each pose, the fit, and the zero of both
//! slopes as left. The sensor tells whether the housing stands still and whether it lies as it was
//! asked to; a person is asked by line, or, with `--yes`, the sensor also tells when it was moved.
//!
//! Left out: the fit (`hand`).

use tilt::chain::Calibration;

use super::by_motor::{APART_S, SETTLE_S, STILL_MG};
use super::console::{Answer, Console};
use super::error::CalibrateError;
use super::fit::{compensated_g, temperature};
use super::gains::{Demand, Outcome, Rest};
use super::hand::{self, Faces, HandFit, NEAR_DEG, POSES, Taken, angle_deg};
use super::reading::Reading;
use super::session::{Node, Session, encode};
use super::turns;

/// Readings of a pose: the mean of 1.2 s.
const READINGS: u32 = 40;

/// Readings that tell whether the housing stands still.
const GLANCE: u32 = 8;

/// Fewest turns between poses that a gyroscope is calibrated by: of 13 poses there are 14.
const FEWEST_TURNS: usize = 8;

/// What is said first where there are gyroscopes.
const DIRECTLY: &str = "the gyroscopes are followed: turn the housing from each pose to the next \
    directly and within a minute, not by way of its base";

/// What two means of a housing at rest may differ by, mg.
const DRIFT_MG: f64 = 2.0;

/// What a housing that was moved differs by from where it stood, mg.
const MOVED_MG: f64 = 50.0;

/// A round by hand.
#[derive(Debug)]
pub struct Handled {
    /// What each node read in each pose, in the order of the plan.
    pub poses: Vec<Vec<Reading>>,
    /// The same as the fit has taken it, by node.
    pub taken: Vec<Vec<Taken>>,
    /// The fit of each node.
    pub fits: Vec<HandFit>,
    /// The new calibration of each node.
    pub calibrations: Vec<Calibration>,
    /// What the faces have told.
    pub faces: Faces,
    /// Readings on the base with the calibration left, the second one turned by 180 deg.
    pub left: [Vec<Reading>; 2],
    /// What has come of the turns from pose to pose for the gyroscope of each node; empty where
    /// they have none.
    pub gyroscopes: Vec<Outcome>,
}

/// The nodes with whoever puts them down.
pub struct Bench<'a> {
    /// The nodes.
    pub session: &'a mut Session,
    /// Who is asked.
    pub console: &'a Console,
    /// Where requests and live figures go, a line each.
    pub tell: &'a dyn Fn(&str),
    /// Where the housing stood still so far, all nodes each time, while gyroscopes are followed.
    pub rests: Vec<Vec<Rest>>,
}

impl Bench<'_> {
    /// Takes the first `count` poses of the plan, fits, writes, and looks at the zero as left.
    ///
    /// Errors: whatever goes wrong; the nodes may then hold something new.
    pub fn calibrate(&mut self, count: usize) -> Result<Handled, CalibrateError> {
        let follows = self.session.begin_to_follow()?;
        if follows {
            (self.tell)(DIRECTLY);
        }
        let mut poses: Vec<Vec<Reading>> = Vec::new();
        while poses.len() < count {
            let place = poses.len();
            let what = format!("pose {} of {count}: {}", place + 1, POSES[place].words);
            let before = poses.last().cloned();
            let Some(readings) = self.pose(place, &what, before.as_deref())? else {
                let missing: Vec<usize> = (place..count).collect();
                return Err(CalibrateError::Ended(names(&missing)));
            };
            (self.tell)(&live(&readings, self.session));
            poses.push(readings);
            self.tell_length(&poses);
        }
        let taken = self.taken(&poses);
        let letters = self.session.nodes.iter().map(letter);
        let lettered: Vec<_> = letters.zip(taken.iter().cloned()).collect();
        let (fits, faces) = hand::fit(&lettered, count)?;
        let calibrations = self.calibrations(&poses, &fits, &faces);
        for (place, calibration) in calibrations.iter().enumerate() {
            self.session.write(place, &encode(calibration))?;
        }
        let left = self.zero(poses.last().cloned())?;
        let gyroscopes = match follows {
            true => self.gyroscopes(&fits, &faces)?,
            false => Vec::new(),
        };
        Ok(Handled {
            poses,
            taken,
            fits,
            calibrations,
            faces,
            left,
            gyroscopes,
        })
    }

    /// The gyroscopes from the turns between all rests, by the accelerometers' new calibration.
    fn gyroscopes(
        &mut self,
        fits: &[HandFit],
        faces: &Faces,
    ) -> Result<Vec<Outcome>, CalibrateError> {
        let logs = self.session.end_to_follow();
        let demand = |place: usize| Demand {
            vertical_deg: fits[place].vertical_deg(faces),
            fewest: FEWEST_TURNS,
            shown: [true; 3],
        };
        turns::solve_all(self.session, &logs, &self.rests, demand, self.tell)
    }

    /// The live residual: what the poses so far miss of gravity's length.
    fn tell_length(&self, poses: &[Vec<Reading>]) {
        let mut line = String::new();
        for (node, taken) in self.session.nodes.iter().zip(self.taken(poses)) {
            if let Some(mg) = hand::length_so_far_mg(&taken) {
                line += &format!(" {} {mg:.2} mg;", node.letter());
            }
        }
        if !line.is_empty() {
            let line = line.trim_end_matches(';');
            (self.tell)(&format!("  gravity's length so far, rms:{line}"));
        }
    }

    fn taken(&self, poses: &[Vec<Reading>]) -> Vec<Vec<Taken>> {
        let nodes = self.session.nodes.iter().enumerate();
        nodes
            .map(|(place, node)| {
                let model = &node.calibration.temperature;
                let one = |(pose, readings): (usize, &Vec<Reading>)| {
                    let Reading {
                        accel,
                        temperature_c,
                        ..
                    } = &readings[place];
                    let mean_g = compensated_g(model, *accel, temperature(*temperature_c));
                    Taken { pose, mean_g }
                };
                poses.iter().enumerate().map(one).collect()
            })
            .collect()
    }

    /// A calibration for each node: that of before with another correction and budget.
    fn calibrations(
        &self,
        poses: &[Vec<Reading>],
        fits: &[HandFit],
        faces: &Faces,
    ) -> Vec<Calibration> {
        let nodes = self.session.nodes.iter().zip(fits).enumerate();
        nodes
            .map(|(place, (node, fit))| {
                let temperatures = poses.iter().map(|p| temperature(p[place].temperature_c));
                fit.calibration(&node.calibration, temperatures, faces)
            })
            .collect()
    }

    /// Both poses on the base once more, with the new calibration.
    fn zero(&mut self, before: Option<Vec<Reading>>) -> Result<[Vec<Reading>; 2], CalibrateError> {
        let mut both: Vec<Vec<Reading>> = Vec::new();
        for (place, number) in [(0, "first"), (1, "second")] {
            let what = format!("verification, {number} of 2: {}", POSES[place].words);
            let before = both.last().cloned().or_else(|| before.clone());
            let readings = self.pose(place, &what, before.as_deref())?;
            let Some(readings) = readings else {
                return Err(CalibrateError::Ended(names(&[place])));
            };
            (self.tell)(&live(&readings, self.session));
            both.push(readings);
        }
        let second = both.pop().unwrap_or_default();
        Ok([both.pop().unwrap_or_default(), second])
    }

    /// Asks for a pose until the housing stands in it; `None` when nobody answers any more.
    ///
    /// Errors: those of the nodes, a lost bus, and [`CalibrateError::Interrupted`].
    pub fn pose(
        &mut self,
        place: usize,
        what: &str,
        before: Option<&[Reading]>,
    ) -> Result<Option<Vec<Reading>>, CalibrateError> {
        let mut stood: Option<Vec<Reading>> = before.map(<[Reading]>::to_vec);
        loop {
            let then = if self.console.asks() {
                "; then press Enter"
            } else {
                ""
            };
            (self.tell)(&format!("{what}{then}"));
            if !self.console.asks() {
                self.await_movement(stood.as_deref())?;
            }
            if self.console.wait(self.session)? == Answer::Ended {
                return Ok(None);
            }
            let readings = self.stillness()?;
            let [x, y, z] = readings.first().map_or([0.0; 3], |r| r.accel);
            let off = angle_deg([x, y, z], POSES[place].up);
            if off <= NEAR_DEG {
                return Ok(Some(readings));
            }
            (self.tell)(&format!(
                "  that is another pose: {off:.0} deg off, {} is up",
                side([x, y, z])
            ));
            stood = Some(readings);
        }
    }

    /// Waits until the housing no longer stands as it did.
    fn await_movement(&mut self, before: Option<&[Reading]>) -> Result<(), CalibrateError> {
        let Some(before) = before.and_then(<[Reading]>::first) else {
            return Ok(());
        };
        loop {
            let now = self.session.read(1, APART_S)?;
            if now
                .first()
                .is_some_and(|now| apart_mg(now, before) > MOVED_MG)
            {
                return Ok(());
            }
        }
    }

    /// Waits until the housing stands still, and takes its mean.
    fn stillness(&mut self) -> Result<Vec<Reading>, CalibrateError> {
        let mut told = false;
        loop {
            self.session.settle(SETTLE_S)?;
            let glance = self.session.read(GLANCE, APART_S)?;
            if glance.iter().all(|r| r.scatter_mg <= STILL_MG) {
                let read = |session: &mut Session| session.read(READINGS, APART_S);
                let (mean, rests) = turns::followed(self.session, false, read)?;
                let still = mean.iter().zip(&glance).all(|(mean, glance)| {
                    mean.scatter_mg <= STILL_MG && apart_mg(mean, glance) <= DRIFT_MG
                });
                if still {
                    if !rests.is_empty() {
                        self.rests.push(rests);
                    }
                    return Ok(mean);
                }
            }
            if !told {
                (self.tell)("  it does not stand still yet: let go of it");
                told = true;
            }
        }
    }
}

fn letter(node: &Node) -> char {
    node.letter().chars().next().unwrap_or('?')
}

fn names(places: &[usize]) -> String {
    let names: Vec<_> = places.iter().map(|place| POSES[*place].words).collect();
    names.join("; ")
}

/// The largest difference of an axis between two readings, mg.
fn apart_mg(a: &Reading, b: &Reading) -> f64 {
    let mg = f64::from(tilt::ONE_G) / 1000.0;
    let apart = a.accel.iter().zip(b.accel).map(|(a, b)| (a - b).abs() / mg);
    apart.fold(0.0, f64::max)
}

/// Which side of the housing is up, in words.
fn side(accel: [f64; 3]) -> &'static str {
    const SIDES: [[&str; 2]; 3] = [["X", "minus X"], ["Y", "minus Y"], ["Z", "minus Z"]];
    let along = (0..3).max_by(|a, b| accel[*a].abs().total_cmp(&accel[*b].abs()));
    let along = along.unwrap_or(2);
    SIDES[along][usize::from(accel[along] < 0.0)]
}

/// A line about a pose: what each channel reads, and how still it was.
fn live(readings: &[Reading], session: &Session) -> String {
    let mut line = "  taken:".to_owned();
    for (reading, node) in readings.iter().zip(&session.nodes) {
        line += &format!(" {}", node.letter());
        for (axis, angle) in ["X", "Y"].iter().zip(reading.angle_deg) {
            line +=
                &angle.map_or_else(|_| format!(" {axis} -"), |deg| format!(" {axis} {deg:+.2}"));
        }
        line += &format!(" deg, scatter {:.2} mg;", reading.scatter_mg);
    }
    line.trim_end_matches(';').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_side_that_is_up_is_named() {
        assert_eq!(side([0.1, -0.9, 0.3]), "minus Y");
        assert_eq!(side([0.1, -0.3, 0.9]), "Z");
    }

    #[test]
    fn missing_poses_are_named_by_their_words() {
        assert_eq!(names(&[7]), "upside down");
    }
}
