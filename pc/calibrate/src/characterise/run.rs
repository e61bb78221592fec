//! The run: from dwell to dwell through the profile, with readings at the end of each.
//!
//! In: a session, a chamber, and what turns the housing. Out: what was measured, handed on after
//! each dwell so that it can be kept. Time is told by the nodes' samples, so a virtual bus may run
//! at any speed. A node that restarts or is commanded by somebody else spoils the dwell under way,
//! which then begins anew; one that stays silent ends the run.
//!
//! Left out: when a dwell is over (`hold`), the motor's way through it (`stands`), and what follows
//! from the readings (`thermal`, `bias`, `scale`).

use std::time::Duration;

use tilt::ONE_G;

use super::chamber::Chamber;
use super::hold::{Hold, Phase, follows};
use super::left::Left;
use super::measured::{Dwelt, Felt, Measured};
use super::model::Model;
use super::profile::{Profile, Step};
use super::stands::{READINGS, Stands, Stood};
use super::thermal::alike;
use super::turns::{Followed, followed};
use crate::CalibrateError;
use crate::by_hand;
use crate::by_motor::{Kind, still};
use crate::console::{Console, GLANCE};
use crate::hand::{NEAR_DEG, POSES, angle_deg};
use crate::motor::Motor;
use crate::reading::Reading;
use crate::session::Session;

/// Looks at chamber and nodes in a dwell, and bounds of the time between two of them, s.
const LOOKS: f64 = 40.0;
const LOOK_S: (f64, f64) = (0.25, 10.0);

/// How often a dwell is begun anew before the run is given up.
const REPEATS: u32 = 3;

/// How long a silent node is waited for.
const BACK: Duration = Duration::from_secs(10);

/// Four of the poses by hand, on sides of the housing that a person finds in a cold chamber: base,
/// upside down, X up, Y up.
const BY_HAND: [usize; 4] = [0, 7, 2, 5];

/// What turns the housing.
pub enum Turner<'a> {
    /// Nothing: it lies level.
    Nothing,
    /// A motor with two axes.
    Motor(&'a mut Motor),
    /// A person.
    Hand(&'a Console),
}

/// Everything of a run.
pub struct Bench<'a> {
    /// The nodes.
    pub session: &'a mut Session,
    /// The chamber around them.
    pub chamber: &'a mut dyn Chamber,
    /// What turns the housing.
    pub turner: Turner<'a>,
    /// Where a line goes for each dwell, and what is asked for.
    pub tell: &'a dyn Fn(&str),
    /// How much of the run is left.
    pub left: Left<'a>,
    /// Whether the motor turns an axis while the other one is tilted, as far as is known.
    pub tilts: bool,
}

/// What the readings of a dwell have given: by orientation, and by turn.
struct Taken {
    orientations: Vec<Vec<Felt>>,
    turns: Vec<Vec<Followed>>,
}

/// A dwell that was held: how long it took, and the air at its end.
struct Held {
    minutes: f64,
    air_degc: Option<f64>,
    sensors_degc: Vec<f64>,
}

impl Bench<'_> {
    /// Goes on with what is missing, to the end of the profile, and conditions the part. `keep`
    /// gets what was measured after each dwell.
    ///
    /// Errors: see [`CalibrateError`]; what `keep` has got so far stands.
    pub fn run(
        &mut self,
        measured: &mut Measured,
        keep: &dyn Fn(&Measured) -> Result<(), CalibrateError>,
    ) -> Result<(), CalibrateError> {
        let profile = measured.begun.profile.clone();
        let missing = measured.missing();
        let begun = !measured.dwells.is_empty();
        if let (true, Some((run, step))) = (begun, missing.first()) {
            self.approach(&profile, *run, *step)?;
        }
        for (run, step) in missing {
            self.announce(&profile, run, step);
            let dwelt = self.dwell(measured, run, step)?;
            self.tell_dwelt(&dwelt);
            measured.dwells.push(dwelt);
            keep(measured)?;
            if measured.dwells.len() == 1 {
                self.judge_orientations(measured)?;
            }
            self.left.over(run, step);
        }
        (self.tell)("conditioning: past 25 degC and back");
        let dwell_min = profile.steps.iter().map(|step| step.dwell_min);
        let dwell_min = dwell_min.fold(0.0, f64::max);
        for temperature_degc in profile.conditioning() {
            let step = Step {
                temperature_degc,
                dwell_min,
            };
            self.again_and_again(&step, |bench| bench.hold(&step))?;
        }
        Ok(())
    }

    /// Takes up the way where it was left: the dwell before the next one, without readings, so that
    /// the next one lies on the branch of the hysteresis that it belongs to.
    fn approach(&mut self, profile: &Profile, run: u32, step: usize) -> Result<(), CalibrateError> {
        let Some(before) = profile.before(run, step) else {
            return Ok(());
        };
        let degc = before.temperature_degc;
        (self.tell)(&format!("going on from {degc} degC, which was measured"));
        self.again_and_again(&before, |bench| bench.hold(&before))?;
        Ok(())
    }

    fn announce(&self, profile: &Profile, run: u32, step: usize) {
        let (steps, runs) = (profile.steps.len(), profile.runs);
        let degc = profile.steps[step].temperature_degc;
        let left = self.left.words();
        (self.tell)(&format!(
            "run {run} of {runs}, dwell {} of {steps}: {degc} degC; {left}",
            step + 1
        ));
    }

    fn tell_dwelt(&self, dwelt: &Dwelt) {
        let mut line = "  taken:".to_owned();
        let first = dwelt.orientations.first();
        for (node, felt) in self.session.nodes.iter().zip(first.into_iter().flatten()) {
            line += &format!(" {} {:.1} degC,", node.letter(), felt.sensor_degc);
        }
        if let Some(air) = dwelt.air_degc {
            line += &format!(" air {air:.1} degC,");
        }
        (self.tell)(&format!("{line} after {:.1} min", dwelt.minutes));
    }

    /// One dwell with its readings.
    fn dwell(
        &mut self,
        measured: &Measured,
        run: u32,
        step: usize,
    ) -> Result<Dwelt, CalibrateError> {
        let profile = &measured.begun.profile;
        let this = profile.steps[step];
        let model = measured.begun.model;
        let first = measured.dwells.first().map(|first| {
            let sensors = first.orientations.first().into_iter().flatten();
            let sensors: Vec<f64> = sensors.map(|felt| felt.sensor_degc).collect();
            (profile.steps[first.step].temperature_degc, sensors)
        });
        let ((held, taken), repeated) = self.again_and_again(&this, |bench| {
            let held = bench.hold(&this)?;
            if let Some((set, sensors)) = &first {
                let now = (this.temperature_degc, &held.sensors_degc[..]);
                follows(&bench.ids(), (*set, sensors), now)?;
            }
            let taken = bench.taken(model, this.temperature_degc)?;
            bench.session.confirm()?;
            Ok((held, taken))
        })?;
        Ok(Dwelt {
            run,
            step,
            air_degc: held.air_degc,
            minutes: held.minutes,
            repeated,
            orientations: taken.orientations,
            turns: taken.turns,
        })
    }

    /// Does it until no node was disturbed meanwhile; how often it was begun anew.
    fn again_and_again<T>(
        &mut self,
        step: &Step,
        mut work: impl FnMut(&mut Self) -> Result<T, CalibrateError>,
    ) -> Result<(T, u32), CalibrateError> {
        let mut repeated = 0;
        loop {
            let error = match work(self) {
                Ok(done) => return Ok((done, repeated)),
                Err(error) if error.is_upset() => error,
                Err(error) => return Err(error),
            };
            if repeated == REPEATS {
                return Err(CalibrateError::Spoilt(
                    step.temperature_degc,
                    Box::new(error),
                ));
            }
            self.session.recover(BACK)?;
            repeated += 1;
            (self.tell)(&format!("  {error}: this dwell starts again"));
        }
    }

    fn ids(&self) -> Vec<u8> {
        self.session.nodes.iter().map(|node| node.id).collect()
    }

    /// Brings air and sensors to a temperature and keeps it.
    fn hold(&mut self, step: &Step) -> Result<Held, CalibrateError> {
        let from = self.chamber.air()?.degc;
        self.set(step.temperature_degc)?;
        let look_s = (step.dwell_min * 60.0 / LOOKS).clamp(LOOK_S.0, LOOK_S.1);
        let begun = self.session.samples(0)?;
        let mut hold = Hold::new(*step, 0.0, from, self.ids());
        let mut ramp_min = None;
        loop {
            self.session.settle(look_s)?;
            let passed = self.session.samples(0)?.wrapping_sub(begun);
            let now_s = f64::from(passed) * self.session.nodes[0].period_s;
            let air = self.chamber.air()?;
            let sensors_degc = self.session.temperatures_c()?;
            match hold.look(now_s, air, &sensors_degc)? {
                Phase::Ready => {
                    let way = from.map(|from| (step.temperature_degc - from).abs());
                    self.left.ramped(way, ramp_min);
                    return Ok(Held {
                        minutes: now_s / 60.0,
                        air_degc: air.degc,
                        sensors_degc,
                    });
                }
                Phase::Ramp => ramp_min = Some(now_s / 60.0),
                Phase::Dwell(minutes) => self.left.dwelt(minutes),
                Phase::Settling => {}
            }
        }
    }

    /// Sets the chamber; the bus is heard meanwhile, Ctrl-C included.
    fn set(&mut self, degc: f64) -> Result<(), CalibrateError> {
        let Self {
            session, chamber, ..
        } = self;
        let set = session.meanwhile(GLANCE, |wait| chamber.set(degc, wait))?;
        Ok(set?)
    }

    /// The readings of a dwell; gyroscopes are followed meanwhile.
    fn taken(&mut self, model: Model, degc: f64) -> Result<Taken, CalibrateError> {
        let follows = self.session.begin_to_follow()?;
        let stood = self.turned_about(degc, follows);
        let logs = self.session.end_to_follow();
        let Stood { readings, rests } = stood?;
        debug_assert_eq!(readings.len(), model.orientations());
        Ok(Taken {
            orientations: readings
                .iter()
                .map(|all| all.iter().map(felt).collect())
                .collect(),
            turns: followed(&self.session.nodes, &logs, &rests),
        })
    }

    fn turned_about(&mut self, degc: f64, followed: bool) -> Result<Stood, CalibrateError> {
        let settle_s = Kind::of(self.session)?.settle_s();
        let Self {
            session,
            turner,
            tell,
            tilts,
            ..
        } = self;
        match turner {
            Turner::Nothing => level(session, settle_s, degc),
            Turner::Motor(motor) => Stands {
                session,
                motor,
                settle_s,
                followed,
                tilts,
                tell: *tell,
            }
            .go(),
            Turner::Hand(console) => by_person(session, console, *tell, degc),
        }
    }

    /// Whether the first dwell's orientations tell offset from gain, before days are spent on them.
    fn judge_orientations(&self, measured: &Measured) -> Result<(), CalibrateError> {
        if measured.begun.model == Model::Piecewise {
            return Ok(());
        }
        for (place, node) in self.session.nodes.iter().enumerate() {
            if let Some(axis) = alike(&measured.mean_readings(place)) {
                return Err(CalibrateError::Alike(node.id, axis));
            }
        }
        Ok(())
    }
}

fn felt(reading: &Reading) -> Felt {
    Felt {
        accel_g: reading.accel.map(|a| a / f64::from(ONE_G)),
        scatter_mg: reading.scatter_mg,
        sensor_degc: reading.temperature_c,
        rate_rad_s: reading.rate_rad_s,
    }
}

/// A housing that nothing turns.
///
/// Errors: those of the nodes, and [`CalibrateError::Tilted`].
fn level(session: &mut Session, settle_s: f64, degc: f64) -> Result<Stood, CalibrateError> {
    let readings = still(session, settle_s, READINGS, &format!("at {degc} degC"))?;
    let tilted = |r: &Reading| angle_deg(r.accel, [0.0, 0.0, 1.0]) > NEAR_DEG;
    if let Some(place) = readings.iter().position(tilted) {
        return Err(CalibrateError::Tilted(session.nodes[place].id));
    }
    Ok(Stood {
        readings: vec![readings],
        rests: Vec::new(),
    })
}

fn by_person(
    session: &mut Session,
    console: &Console,
    tell: &dyn Fn(&str),
    degc: f64,
) -> Result<Stood, CalibrateError> {
    let mut stood = Stood::default();
    for (number, place) in BY_HAND.into_iter().enumerate() {
        let words = POSES[place].words;
        let what = format!("at {degc} degC, {} of 4: {words}", number + 1);
        let mut bench = by_hand::Bench {
            session: &mut *session,
            console,
            tell,
            rests: Vec::new(),
        };
        let before = stood.readings.last().cloned();
        let taken = bench.pose(place, &what, before.as_deref())?;
        stood.rests.append(&mut bench.rests);
        let ended = || CalibrateError::Ended(words.to_owned());
        stood.readings.push(taken.ok_or_else(ended)?);
    }
    Ok(stood)
}
