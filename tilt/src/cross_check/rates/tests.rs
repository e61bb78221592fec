//! Two gyroscopes on a housing that swings and pauses: what is told, and who is named.

use super::*;
use crate::ONE_G;
use crate::chain::Invalid;
use crate::health::Activity;
use crate::motion::Rate;
use crate::rate::RateCorrection;
use crate::sample::Temperature;
use crate::turned::{TurnedState, per_period_q32};

/// A pair is judged every 20 ms, a gyroscope sampled every 2.5 ms.
const SYNC_US: u32 = 20_000;
const SAMPLE_S: f64 = 0.0025;

/// Two channels on a housing that turns about x alone, and what is wrong with their gyroscopes.
struct Housing {
    check: RateCheck,
    state: RateState,
    turned: [TurnedState; 2],
    pitch: f64,
    /// At the pair before, rad/s.
    rate: f64,
    /// The acceleration of the pair before, g: it comes a pair later than the turn.
    felt: [f64; 3],
    /// Distance from the pivot along y, m.
    lever_m: f64,
    /// See [`Turned::scale_share`].
    scale_share: u16,
}

impl Housing {
    fn new() -> Self {
        Self {
            check: RateCheck::PRODUCT,
            state: RateState::default(),
            turned: Default::default(),
            pitch: 0.0,
            rate: 0.0,
            felt: [0.0, 0.0, 1.0],
            lever_m: 0.0,
            scale_share: 0,
        }
    }

    /// What both channels observe while it turns by so many deg/s; either gyroscope reads so much
    /// more, deg/s about each axis, and either accelerometer, mg.
    fn observe(&mut self, dps: f64, errors: [[f64; 3]; 2], mg: [[f64; 3]; 2]) -> [Observation; 2] {
        for _ in 0..8 {
            for (turned, error) in self.turned.iter_mut().zip(errors) {
                let read = [dps + error[0], error[1], error[2]];
                let rate = read.map(|dps| (dps.to_radians() * 16_777_216.0).round() as i32);
                turned.turn(Rate { rate }, per_period_q32(SAMPLE_S), 1);
            }
        }
        let now = self.feels(dps);
        let felt = core::mem::replace(&mut self.felt, now);
        [0, 1].map(|node| {
            let accel = [0, 1, 2].map(|axis| felt[axis] + mg[node][axis] * 1e-3);
            let turned = self.turned[node].take(0, 0).map(|turned| Turned {
                bias: Some([0; 3]),
                activity: Activity::OWN,
                scale_share: self.scale_share,
                ..turned
            });
            Observation {
                vector: Some(crate::vector::Corrected {
                    accel: accel.map(|a| (a * f64::from(ONE_G)).round() as i32),
                }),
                turned,
                ..Observation::absent(Invalid::NoSample)
            }
        })
    }

    /// Turns by so many deg/s until the next pair; the acceleration half-way, g.
    fn feels(&mut self, dps: f64) -> [f64; 3] {
        let rate = dps.to_radians();
        let half = rate * f64::from(SYNC_US) * 0.5e-6;
        let (sin, cos) = (self.pitch + half).sin_cos();
        self.pitch += 2.0 * half;
        let change =
            (rate - core::mem::replace(&mut self.rate, rate)) / (f64::from(SYNC_US) * 1e-6);
        [
            0.0,
            sin - self.lever_m * rate * rate / 9.81,
            cos + self.lever_m * change / 9.81,
        ]
    }

    /// One pair, judged; either accelerometer reads so much more along y, mg.
    fn pair(&mut self, dps: f64, errors: [[f64; 3]; 2], mg: [f64; 2]) -> Found {
        let [own, peer] = &self.observe(dps, errors, mg.map(|mg| [0.0, mg, 0.0]));
        let apart = (mg[0] - mg[1]).abs() > 3.0;
        (self.check).step(&mut self.state, [own, peer], (apart, false), SYNC_US)
    }

    /// Swings to and fro for so many pairs without an error; nothing may be found.
    fn swings(&mut self, pairs: u32) {
        for pair in 0..pairs {
            let found = self.pair(swing(pair), [[0.0; 3]; 2], [0.0; 2]);
            assert_eq!(found, Found::default(), "{pair}");
        }
    }

    /// The pairs until the rates differ, and those until a channel is named, within a minute.
    fn found(
        &mut self,
        moves: bool,
        errors: [[f64; 3]; 2],
    ) -> (Option<u32>, Option<(u32, Member)>) {
        let (mut told, mut named) = (None, None);
        for pair in 0..3_000 {
            let dps = if moves { swing(pair) } else { 0.0 };
            let found = self.pair(dps, errors, [0.0; 2]);
            if found.differ {
                told = told.or(Some(pair));
            }
            if let Some(member) = found.contradicts {
                named = named.or(Some((pair, member)));
            }
        }
        (told, named)
    }
}

/// Two seconds up, one of pause, two down, one of pause; 30 deg/s at most.
fn swing(pair: u32) -> f64 {
    match pair % 300 {
        at @ 0..100 => 30.0 * (f64::from(at) * 0.01 * core::f64::consts::PI).sin(),
        at @ 150..250 => -30.0 * (f64::from(at - 150) * 0.01 * core::f64::consts::PI).sin(),
        _ => 0.0,
    }
}

#[test]
fn a_bias_about_any_axis_is_told_at_once_and_its_channel_named_while_it_swings() {
    for (dps, within) in [(0.5, 20), (2.0, 2)] {
        for axis in 0..3 {
            for (node, member) in [(0, Member::Own), (1, Member::Peer)] {
                let mut housing = Housing::new();
                housing.swings(1500);
                let mut errors = [[0.0; 3]; 2];
                errors[node][axis] = dps;
                let (told, named) = housing.found(true, errors);
                let case = (dps, axis, node);
                assert!(
                    told.is_some_and(|pairs| pairs <= within),
                    "{case:?}: {told:?}"
                );
                assert_eq!(named.map(|(_, who)| who), Some(member), "{case:?}");
            }
        }
    }
}

/// Nothing was compared with SYNCs of more than 250 ms. A turn of more than 45 deg between two
/// pairs, which one channel alone cannot tell, is no difference.
#[test]
fn a_bias_was_not_told_where_pairs_were_far_apart() {
    for pairs in [13, 25, 50, 100] {
        for (dps, within) in [(0.0, None), (2.0, Some(2)), (0.5, Some(20))] {
            let mut housing = Housing::new();
            let differs = |judged: u32, swing: f64, error: f64, housing: &mut Housing| {
                let mut errors = [[0.0; 3]; 2];
                errors[1][0] = error;
                let swing = if judged % 7 < 4 { swing } else { -0.9 * swing };
                for _ in 1..pairs {
                    housing.observe(swing, errors, [[0.0; 3]; 2]);
                }
                let [own, peer] = &housing.observe(swing, errors, [[0.0; 3]; 2]);
                let elapsed_us = pairs * SYNC_US;
                let (check, state) = (&housing.check, &mut housing.state);
                let found = check.step(state, [own, peer], (false, false), elapsed_us);
                assert_eq!((found.loud, found.contradicts), (None, None));
                found.differ
            };
            let healthy = (0..100).all(|judged| !differs(judged, 120.0, 0.0, &mut housing));
            assert!(healthy, "{pairs}");
            let told = (0..100).position(|judged| differs(judged, 20.0, dps, &mut housing));
            let told = told.map(|judged| judged + 1);
            assert_eq!(told.is_some(), within.is_some(), "{pairs} {dps}: {told:?}");
            assert!(told <= within, "{pairs} {dps}: {told:?}");
        }
    }
}

#[test]
fn a_rate_about_gravity_itself_is_not_named_while_the_housing_stands() {
    for node in [0, 1] {
        let mut housing = Housing::new();
        for _ in 0..1000 {
            housing.pair(0.0, [[0.0; 3]; 2], [0.0; 2]);
        }
        let mut errors = [[0.0; 3]; 2];
        errors[node][2] = 2.0;
        let (told, named) = housing.found(false, errors);
        assert!(told.is_some_and(|pairs| pairs < 3), "{told:?}");
        assert_eq!(named, None);
    }
}

#[test]
fn a_dead_axis_names_nobody_while_the_machine_slews_slowly_and_steadily() {
    // Both stand level and slew about gravity by 2 deg/s; the own gyroscope reads none of it.
    let mut housing = Housing::new();
    housing.swings(1500);
    let errors = [[0.0; 3], [0.0, 0.0, 2.0]];
    let (told, named) = housing.found(false, errors);
    assert!(told.is_some());
    assert_eq!(named, None);
}

#[test]
fn an_acceleration_that_leaves_gravity_names_its_channel() {
    for (node, member) in [(0, Member::Own), (1, Member::Peer)] {
        let mut housing = Housing::new();
        housing.swings(1500);
        let mut mg = [0.0; 2];
        mg[node] = 20.0;
        let mut named = None;
        for pair in 0..1500 {
            let found = housing.pair(swing(pair), [[0.0; 3]; 2], mg);
            assert!(!found.differ);
            named = named.or(found.contradicts);
        }
        assert_eq!(named, Some(member));
    }
}

#[test]
fn a_power_on_bias_is_no_fault() {
    let mut housing = Housing::new();
    let bias = [[0.2, -0.1, 0.1], [-0.1, 0.2, 0.0]];
    for pair in 0..3000 {
        let found = housing.pair(swing(pair), bias, [0.0; 2]);
        assert!(
            !found.differ && found.contradicts.is_none(),
            "{pair}: {found:?}"
        );
    }
}

#[test]
fn a_turn_that_the_peer_told_late_was_held_against_it() {
    // Three exchanges of the peer are lost while both turn; its next one has all of it.
    let mut housing = Housing::new();
    housing.swings(1500);
    let level = Observation::absent(Invalid::NoSample);
    for _ in 0..3 {
        for turned in &mut housing.turned {
            let rate = Rate {
                rate: [8_000_000, 0, 0],
            };
            (0..8).for_each(|_| turned.turn(rate, per_period_q32(SAMPLE_S), 1));
        }
        let own = Observation {
            turned: housing.turned[0].take(0, 0),
            ..level
        };
        let lost =
            (housing.check).step(&mut housing.state, [&own, &level], (false, false), SYNC_US);
        assert_eq!(lost, Found::default());
        let _ = housing.turned[1].take(0, 0);
    }
    assert!(!housing.pair(27.0, [[0.0; 3]; 2], [0.0; 2]).differ);
}

/// A gyroscope that claims far more than a rotation has room for stopped a host by an overflow.
#[test]
fn turns_and_accelerations_at_their_ends_overflow_nothing() {
    let (check, mut state) = (RateCheck::PRODUCT, RateState::default());
    let mut angle = [[0_i16; 3]; 2];
    for pair in 0..4000_u32 {
        let observed = [0, 1].map(|node: usize| {
            for (axis, angle) in angle[node].iter_mut().enumerate() {
                let bit = pair >> (node * 3 + axis) & 1;
                *angle = angle.wrapping_add([i16::MIN, i16::MAX][bit as usize]);
            }
            let turned = Turned {
                angle: angle[node],
                bias: Some([i32::MIN, i32::MAX, 0]),
                activity: Activity::OWN,
                accel: u32::MAX,
                scale_share: u16::MAX,
            };
            let end = [i32::MIN, i32::MAX][(pair >> 6) as usize & 1];
            Observation {
                vector: Some(crate::vector::Corrected { accel: [end; 3] }),
                turned: Some(turned),
                ..Observation::absent(Invalid::NoSample)
            }
        });
        let [own, peer] = &observed;
        let differ = pair % 1000 > 600;
        let elapsed_us = match pair % 2000 {
            ..1000 => LONGEST_OF_GRAVITY_US,
            _ => LONGEST_US,
        };
        let _ = check.step(&mut state, [own, peer], (differ, false), elapsed_us);
    }
    // Both were wide apart all the time.
    let wide = [f64::from(u32::MAX) as i64; 3];
    assert!((check.residual).take(&mut state.residual, wide, 0, false, 20_000));
}

/// Whether two gyroscopes differ whose scales are so far apart, %, while the housing spins up to
/// 80 deg/s within 0.2 s, spins on for 2 s, and is down at 20 deg/s within 0.2 s, to and fro.
fn differ_in_spins(percent: f64, scale_share: u16) -> bool {
    let mut housing = Housing::new();
    housing.scale_share = scale_share;
    housing.swings(1500);
    (0..3000).any(|pair| {
        let dps = match pair % 300 {
            at @ 0..10 => 20.0 + 6.0 * f64::from(at),
            10..110 => 80.0,
            at @ 110..120 => 80.0 - 6.0 * f64::from(at - 110),
            _ => 20.0,
        };
        let dps = if pair % 600 < 300 { dps } else { -dps };
        let more = [dps * percent / 100.0, 0.0, 0.0];
        housing.pair(dps, [more, [0.0; 3]], [0.0; 2]).differ
    })
}

#[test]
fn what_was_left_of_a_fast_turn_was_held_against_a_slow_one() {
    assert!(!differ_in_spins(0.65, 0));
    assert!(differ_in_spins(1.0, 0));
}

/// What a calibration with these slopes of the scale (1 per degC) lets two channels differ by, so
/// far from 25 degC.
fn scale_share(slopes: [f64; 3], away_c: i32) -> u16 {
    let mut real = RateCorrection::IDENTITY.real();
    real.scale1 = slopes;
    let correction = RateCorrection::from_real(&real).unwrap();
    let at = Temperature((25 + away_c) << 8);
    correction.at(at).scale_share()
}

#[test]
fn a_scale_over_temperature_that_nobody_calibrated_was_a_fault() {
    // Each is more than four standard deviations of two parts so far from 25 degC. One axis
    // without a slope is enough.
    for slopes in [[0.0; 3], [5e-5, -5e-5, 0.0]] {
        for away_c in [-35_i32, 10, 20, 35, 45] {
            let percent = 0.65 + 0.018 * f64::from(away_c.abs());
            let share = scale_share(slopes, away_c);
            assert!(!differ_in_spins(percent, share), "{away_c}");
            assert!(differ_in_spins(percent + 0.5, share), "{away_c}");
        }
    }
}

#[test]
fn a_scale_over_temperature_that_is_calibrated_leaves_little_room() {
    for away_c in [-35_i32, 10, 20, 35, 45] {
        let percent = 0.65 + 0.0035 * f64::from(away_c.abs());
        let share = scale_share([5e-5, -5e-5, 1e-6], away_c);
        assert!(!differ_in_spins(percent, share), "{away_c}");
        assert!(differ_in_spins(percent + 0.35, share), "{away_c}");
    }
}
mod events;
