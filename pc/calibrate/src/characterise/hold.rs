//! One dwell: when the air has arrived, how long it stays, and when the sensors have followed.
//!
//! In, again and again: the time (s, by the nodes' samples), what the chamber reports of its air
//! and the sensors of their temperature (degC). Out: the phase that the dwell is in, or why it
//! comes to nothing. Nothing here waits or asks, so that every case is a test.
//!
//! The dwell's clock starts when the air is stable, and anew when it leaves its set point. Behind
//! its end each sensor's temperature must have stayed within a degree, which is as fine as 6511h
//! tells it, for a quarter of the dwell.
//!
//! Left out: asking chamber and nodes (`run`).

use std::collections::VecDeque;

use super::air::Air;
use super::profile::Step;

/// Air that is said to be stable stands no further from its set point, degC.
const NEAR_C: f64 = 2.0;

/// How long air further off may be reported as stable, s: the chamber may not have taken the new
/// set point up yet.
const ELSEWHERE_S: f64 = 300.0;

/// Air that goes further past its set point, or away from it, has overshot, degC.
const BEYOND_C: f64 = 5.0;

/// The slowest ramp that is waited for, degC/min, and the time that comes on top of it, min.
const SLOWEST_C_MIN: f64 = 0.2;
const PATIENCE_MIN: f64 = 60.0;

/// How often the dwell's clock may start anew.
const RESTARTS: u32 = 5;

/// Share of the dwell for which the sensors have to stand still.
const SETTLED_SHARE: f64 = 0.25;

/// What a temperature that stands still moves by, degC: told to a degree, it may lie on an edge.
const STILL_C: f64 = 1.0;

/// How many dwells longer the sensors may take, and the minutes that come on top.
const LONGER: f64 = 2.0;
const LONGER_MIN: f64 = 30.0;

/// What a sensor's change of temperature may differ from the chamber's by: degC, and a share.
const ASTRAY_C: f64 = 5.0;
const ASTRAY_SHARE: f64 = 0.15;

/// Why a dwell comes to nothing. Temperatures in degC, times in minutes.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HoldError {
    /// The air went past its set point, or away from it: set point, air.
    #[error(
        "the chamber was sent to {0} degC and its air is at {1:.1} degC: it overshoots or does \
         not regulate"
    )]
    Overshoot(f64, f64),
    /// The air does not become stable: set point, air, minutes waited.
    #[error(
        "the chamber's air does not become and stay stable at {0} degC within {2:.0} min{a}",
        a = at(.1)
    )]
    Unstable(f64, Option<f64>, f64),
    /// The air is said to be stable, and is not at its set point: set point, air.
    #[error("the chamber reports stable air at {0} degC, but its temperature is {1:.1} degC")]
    Elsewhere(f64, f64),
    /// The sensor of a node does not settle: node-id, set point, how much it moves, minutes.
    #[error(
        "the sensor of node {0} does not settle at {1} degC: it still moves by {2:.0} degC after \
         {3:.0} min; take longer dwells"
    )]
    Unsettled(u8, f64, f64, f64),
    /// The sensor of a node does not follow the chamber: node-id, and both changes.
    #[error(
        "the sensor of node {0} has changed by {1:+.0} degC where the chamber was sent by \
         {2:+.0} degC: is the instrument in this chamber?"
    )]
    Astray(u8, f64, f64),
}

fn at(air: &Option<f64>) -> String {
    air.map_or(String::new(), |air| format!("; it is at {air:.1} degC"))
}

/// Where a dwell stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    /// The air is on its way.
    Ramp,
    /// It has been stable for so many minutes.
    Dwell(f64),
    /// The dwell is over and the sensors still move.
    Settling,
    /// It can be measured.
    Ready,
}

/// A dwell under way.
#[derive(Clone, Debug)]
pub struct Hold {
    step: Step,
    /// The nodes whose sensors are looked at.
    ids: Vec<u8>,
    begun_s: f64,
    /// The air when it was sent off.
    from_c: Option<f64>,
    /// How long the ramp may take, min.
    ramp_min: f64,
    stable_s: Option<f64>,
    /// Since when it is said to be stable elsewhere.
    elsewhere_s: Option<f64>,
    restarts: u32,
    /// Times and temperatures of the sensors over the last part of the dwell.
    window: VecDeque<(f64, Vec<f64>)>,
}

impl Hold {
    /// Begins a dwell of these nodes at `now_s`, from air of this temperature.
    pub fn new(step: Step, now_s: f64, from_c: Option<f64>, ids: Vec<u8>) -> Self {
        let way = from_c.map_or(100.0, |from| (step.temperature_degc - from).abs());
        Self {
            step,
            ids,
            begun_s: now_s,
            from_c,
            ramp_min: way / SLOWEST_C_MIN + PATIENCE_MIN,
            stable_s: None,
            elsewhere_s: None,
            restarts: 0,
            window: VecDeque::new(),
        }
    }

    /// One look.
    ///
    /// Errors: see [`HoldError`].
    pub fn look(&mut self, now_s: f64, air: Air, parts_c: &[f64]) -> Result<Phase, HoldError> {
        let stable = self.is_stable(now_s, air)?;
        self.note(now_s, parts_c);
        let minutes = (now_s - self.begun_s) / 60.0;
        match (stable, self.stable_s) {
            (true, None) => self.stable_s = Some(now_s),
            (false, Some(_)) => {
                self.stable_s = None;
                self.restarts += 1;
            }
            _ => {}
        }
        let set = self.step.temperature_degc;
        let Some(stable_s) = self.stable_s else {
            let limit = self.ramp_min + f64::from(self.restarts) * self.step.dwell_min;
            if minutes > limit || self.restarts > RESTARTS {
                return Err(HoldError::Unstable(set, air.degc, minutes));
            }
            return Ok(Phase::Ramp);
        };
        let dwelt_min = (now_s - stable_s) / 60.0;
        if dwelt_min < self.step.dwell_min {
            return Ok(Phase::Dwell(dwelt_min));
        }
        match self.moving() {
            None => Ok(Phase::Ready),
            Some((place, moved)) if dwelt_min > self.longest_min() => {
                Err(HoldError::Unsettled(self.ids[place], set, moved, dwelt_min))
            }
            Some(_) => Ok(Phase::Settling),
        }
    }

    fn longest_min(&self) -> f64 {
        self.step.dwell_min * (1.0 + LONGER) + LONGER_MIN
    }

    /// Whether the air is stable where it should be.
    fn is_stable(&mut self, now_s: f64, air: Air) -> Result<bool, HoldError> {
        let (set, Some(now)) = (self.step.temperature_degc, air.degc) else {
            return Ok(air.stable);
        };
        let from = self.from_c.unwrap_or(now);
        let (low, high) = (from.min(set) - BEYOND_C, from.max(set) + BEYOND_C);
        if !(low..=high).contains(&now) {
            return Err(HoldError::Overshoot(set, now));
        }
        if !air.stable || (now - set).abs() <= NEAR_C {
            self.elsewhere_s = None;
            return Ok(air.stable);
        }
        let since_s = *self.elsewhere_s.get_or_insert(now_s);
        match now_s - since_s > ELSEWHERE_S {
            true => Err(HoldError::Elsewhere(set, now)),
            false => Ok(false),
        }
    }

    fn note(&mut self, now_s: f64, parts_c: &[f64]) {
        let wide_s = self.step.dwell_min * 60.0 * SETTLED_SHARE;
        self.window.push_back((now_s, parts_c.to_vec()));
        // The one before the window's begin stays: it is what the window begins with.
        while self
            .window
            .get(1)
            .is_some_and(|(at, _)| now_s - at > wide_s)
        {
            self.window.pop_front();
        }
    }

    /// The place and the movement of the sensor that moves most, if one does not stand still.
    fn moving(&self) -> Option<(usize, f64)> {
        let sensors = self.window.back().map_or(0, |(_, parts)| parts.len());
        let moved = |place: usize| {
            let all = || {
                self.window
                    .iter()
                    .filter_map(move |(_, parts)| parts.get(place))
            };
            let high = all().copied().fold(f64::MIN, f64::max);
            high - all().copied().fold(f64::MAX, f64::min)
        };
        let most = (0..sensors).map(|place| (place, moved(place)));
        let most = most.reduce(|a, b| if b.1 > a.1 { b } else { a });
        most.filter(|(_, moved)| *moved > STILL_C)
    }
}

/// Whether the sensors have followed the chamber since the first dwell. Each is known against
/// itself only: its thermometer may be off by 15 degC (LIS2DW12).
///
/// Errors: [`HoldError::Astray`].
pub fn follows(
    ids: &[u8],
    (first_set, first): (f64, &[f64]),
    (set, parts): (f64, &[f64]),
) -> Result<(), HoldError> {
    let asked = set - first_set;
    for (id, (before, now)) in ids.iter().zip(first.iter().zip(parts)) {
        let changed = now - before;
        if (changed - asked).abs() > ASTRAY_C + ASTRAY_SHARE * asked.abs() {
            return Err(HoldError::Astray(*id, changed, asked));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: Step = Step {
        temperature_degc: 50.0,
        dwell_min: 40.0,
    };

    fn air(degc: f64) -> Air {
        Air {
            degc: Some(degc),
            stable: (degc - 50.0).abs() < 0.5,
        }
    }

    /// Looks each minute: from, to, and what air and sensors do at that minute.
    fn run(minutes: u32, look: impl Fn(f64) -> (Air, Vec<f64>)) -> Result<(u32, Phase), HoldError> {
        let mut hold = Hold::new(STEP, 0.0, Some(40.0), vec![1, 2]);
        let mut last = Phase::Ramp;
        for minute in 0..minutes {
            let (air, parts) = look(f64::from(minute));
            last = hold.look(f64::from(minute) * 60.0, air, &parts)?;
            if last == Phase::Ready {
                return Ok((minute, last));
            }
        }
        Ok((minutes, last))
    }

    #[test]
    fn a_dwell_counts_from_stable_air_and_ends_with_settled_sensors() {
        let ramp = |minute: f64| (40.0 + 2.0 * minute).min(50.0);
        let ready = run(100, |m| (air(ramp(m)), vec![51.0, 48.0]));
        assert_eq!(ready, Ok((45, Phase::Ready)));
        // A sensor that creeps by a degree in four minutes is not settled; one on an edge is.
        let creeps = |m: f64| (30.0 + m / 4.0).min(50.0).round();
        let ready = run(200, |m| (air(ramp(m)), vec![creeps(m), 50.0]));
        assert!(matches!(ready, Ok((84..=92, Phase::Ready))), "{ready:?}");
        let edge = |m: f64| 50.0 + m % 2.0;
        let ready = run(100, |m| (air(ramp(m)), vec![edge(m)]));
        assert_eq!(ready, Ok((45, Phase::Ready)));
    }

    #[test]
    fn air_that_leaves_its_set_point_starts_the_dwell_anew() {
        let door = |m: f64| match m as u32 {
            20..25 => 46.0,
            _ => 50.0,
        };
        let ready = run(100, |m| (air(door(m)), vec![50.0]));
        assert_eq!(ready, Ok((65, Phase::Ready)));
    }

    #[test]
    fn a_chamber_that_overshoots_is_stopped() {
        let told = run(100, |m| (air(40.0 + 2.0 * m), vec![50.0])).unwrap_err();
        assert_eq!(told, HoldError::Overshoot(50.0, 56.0));
        assert!(told.to_string().contains("overshoots"));
        let away = run(100, |m| (air(40.0 - m), vec![40.0])).unwrap_err();
        assert_eq!(away, HoldError::Overshoot(50.0, 34.0));
    }

    #[test]
    fn a_chamber_that_never_becomes_stable_is_given_up() {
        let told = run(1000, |_| (air(48.0), vec![48.0])).unwrap_err();
        assert_eq!(told, HoldError::Unstable(50.0, Some(48.0), 111.0));
        let flutters = |m: f64| if m % 10.0 < 5.0 { 50.0 } else { 48.0 };
        let told = run(1000, |m| (air(flutters(m)), vec![50.0])).unwrap_err();
        assert!(matches!(told, HoldError::Unstable(..)), "{told:?}");
    }

    #[test]
    fn a_chamber_that_reports_stable_elsewhere_is_not_believed() {
        let lies = Air {
            degc: Some(45.0),
            stable: true,
        };
        let told = run(10, |_| (lies, vec![45.0])).unwrap_err();
        assert_eq!(told, HoldError::Elsewhere(50.0, 45.0));
        // One that has not taken its new set point up yet reports stable for a while.
        let slow = |m: f64| Air {
            degc: Some(if m < 3.0 { 40.0 } else { 50.0 }),
            stable: true,
        };
        let ready = run(100, |m| (slow(m), vec![50.0]));
        assert_eq!(ready, Ok((43, Phase::Ready)));
    }

    #[test]
    fn a_sensor_that_never_settles_is_named() {
        let told = run(1000, |m| (air(50.0), vec![50.0, (m / 4.0).round()])).unwrap_err();
        assert!(matches!(told, HoldError::Unsettled(2, ..)), "{told:?}");
        let sentence = told.to_string();
        assert!(
            sentence.contains("the sensor of node 2 does not settle"),
            "{sentence}"
        );
    }

    #[test]
    fn a_person_s_word_is_taken_where_no_air_is_told() {
        let unknown = Air {
            degc: None,
            stable: true,
        };
        let ready = run(100, |_| (unknown, vec![50.0]));
        assert_eq!(ready, Ok((40, Phase::Ready)));
    }

    #[test]
    fn an_instrument_outside_the_chamber_is_noticed() {
        let first = (25.0, &[31.0, 22.0][..]);
        assert_eq!(follows(&[3, 7], first, (70.0, &[77.5, 66.0])), Ok(()));
        let told = follows(&[3, 7], first, (0.0, &[7.0, 21.0])).unwrap_err();
        assert_eq!(told, HoldError::Astray(7, -1.0, -25.0));
        let sentence = told.to_string();
        assert!(
            sentence.contains("is the instrument in this chamber"),
            "{sentence}"
        );
    }
}
