//! The chain with a gyroscope: the angle of this moment while the housing turns.

use super::*;
use crate::fusion::Fusion;
use crate::motion::Expected;
use crate::rate::{RateCorrection, RealRateCorrection};
use crate::sample::{RateCounts, RateRange};
use crate::temperature::TemperatureModel;
use crate::uncertainty::Span;

const PERIOD_S: f64 = 0.0024;
const LATENCY_US: u32 = 5_000;

fn expected() -> Expected {
    Expected {
        period_s: PERIOD_S,
        rate_noise: 1e-4,
        rate_defect: 3e-4,
        bias: 0.003,
        bias_walk: 3e-5,
        gain: 0.001,
        accel_offset: 0.0,
        accel_range: 3.99,
        rate_range: 8.7,
        ..Expected::INDUSTRIAL
    }
}

fn chain() -> Chain {
    let fusion = Fusion::new(&expected(), RateRange::Dps500, LATENCY_US);
    Chain {
        filter: LowPass::PRODUCT,
        full_scale: FullScale::G4,
        period_us: 2400,
        part_delay_q16: 0,
        timing: Timing::Aligned { latency_us: 25_000 },
        calibration: Calibration {
            temperature: TemperatureModel::None,
            correction: Correction::TwoAxis {
                vector: Vector::IDENTITY,
                harmonics: Axes::default(),
            },
            budget: Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::CHAMBER),
            rates: Some(RateCorrection::IDENTITY),
        },
        // Its rates have no noise.
        fusion: fusion.map(Fusion::without_noise),
    }
}

/// Sampled at this time, s, from when a swing begins.
const START_S: f64 = 3.0;
const SPEED: f64 = 80.0;
const ACCELERATION: f64 = 800.0;
const REST_S: f64 = 0.2;

/// The paper's swing of +-40 deg at 80 deg/s (R17): the angle, deg, and its second derivative.
fn swing(t: f64) -> (f64, f64) {
    let ramp_s = SPEED / ACCELERATION;
    let leg_s = 80.0 / SPEED + ramp_s;
    let whole_s = leg_s + REST_S;
    let leg = (t / whole_s).floor().max(0.0);
    let t = (t - leg * whole_s).clamp(0.0, leg_s);
    let sign = if leg as i64 % 2 == 0 { 1.0 } else { -1.0 };
    let left = leg_s - t;
    let (way, bend) = if t <= 0.0 || left <= 0.0 {
        (if left <= 0.0 { 80.0 } else { 0.0 }, 0.0)
    } else if t < ramp_s {
        (0.5 * ACCELERATION * t * t, ACCELERATION)
    } else if left < ramp_s {
        (80.0 - 0.5 * ACCELERATION * left * left, -ACCELERATION)
    } else {
        (SPEED * (t - 0.5 * ramp_s), 0.0)
    };
    (sign * (way - 40.0), sign * bend)
}

/// A part on the swing, so far from its axis, m, whose clock is as much too slow.
struct Part {
    lever_m: f64,
    period_s: f64,
}

impl Part {
    fn angle(t: f64) -> f64 {
        swing(t - START_S).0
    }

    /// The sample of time `t`; the rate is the mean of the period before it.
    fn sample(&self, t: f64) -> Sample {
        let (angle, bend) = swing(t - START_S);
        let rate = (angle - Self::angle(t - self.period_s)) / self.period_s;
        let (s, c) = angle.to_radians().sin_cos();
        let lever = self.lever_m / 9.80665;
        let turning = rate.to_radians();
        let force = [
            s - lever * bend.to_radians(),
            0.0,
            c - lever * turning * turning,
        ];
        Sample {
            counts: Counts(force.map(|v| (v * 8192.0).round() as i16)),
            rate: Some(RateCounts([0, (-rate / 0.0175).round() as i16, 0])),
        }
    }
}

/// Root mean squares of what the chain is off by, deg: of this moment, and aligned; and the largest
/// share of the uncertainty that was stated.
fn errors(part: &Part) -> ([f64; 2], f64) {
    let chain = chain();
    let mut state = ChainState::default();
    let (mut squares, mut count, mut worst) = ([0.0; 2], 0.0, 0.0f64);
    for i in 0..(30.0 / part.period_s) as u32 {
        let t = f64::from(i) * part.period_s;
        let at = Instant(1_000_000 + (t * 1e6).round() as u64);
        chain.sample(&mut state, part.sample(t), at);
        // Asked for between two samples, from their beginning to their end.
        let later_s = part.period_s * f64::from(i % 10) * 0.1;
        let now = at.offset((later_s * 1e6).round() as i64);
        if t < START_S - 0.5 {
            continue;
        }
        let readings = [chain.reading_now(&state, now), chain.reading(&state, now)];
        for (square, reading) in squares.iter_mut().zip(readings) {
            let found = reading.x.expect("an angle");
            let truth = Part::angle(t + later_s - f64::from(found.latency_us) * 1e-6);
            let error = found.angle.degrees() - truth;
            *square += error * error;
            worst = worst.max(error.abs() / found.uncertainty.degrees());
        }
        count += 1.0;
    }
    (squares.map(|square| (square / count).sqrt()), worst)
}

#[test]
fn the_swing_of_r17_is_followed_as_it_arrives() {
    for (lever_m, most_deg) in [(0.0, 0.006), (0.02, 0.012), (0.05, 0.04)] {
        let (rms, worst) = errors(&Part {
            lever_m,
            period_s: PERIOD_S,
        });
        assert!(rms.iter().all(|rms| *rms < most_deg), "{lever_m}: {rms:?}");
        assert!(worst < 2.0, "{lever_m}: {worst}");
    }
}

#[test]
fn a_slow_clock_of_the_part_does_not_look_like_scale() {
    let (rms, _) = errors(&Part {
        lever_m: 0.0,
        period_s: PERIOD_S * 1.03,
    });
    assert!(rms.iter().all(|rms| *rms < 0.01), "{rms:?}");
}

#[test]
fn both_instants_are_declared_with_their_latency() {
    let chain = chain();
    let mut state = ChainState::default();
    let still = Part {
        lever_m: 0.0,
        period_s: PERIOD_S,
    };
    let at = |i: u64| Instant(1_000_000 + i * 2_400);
    for i in 0..400 {
        chain.sample(&mut state, still.sample(0.0), at(i));
    }
    let now = at(399).offset(1_000);
    let latency = |reading: Reading| reading.x.map(|x| (x.latency_us, now.micros_since(x.at)));
    assert_eq!(latency(chain.reading_now(&state, now)), Ok((0, 0)));
    let aligned = i64::from(LATENCY_US);
    assert_eq!(
        latency(chain.reading(&state, now)),
        Ok((LATENCY_US, aligned))
    );
}

#[test]
fn a_gap_begins_anew_and_three_missing_samples_do_not() {
    let chain = chain();
    let part = Part {
        lever_m: 0.0,
        period_s: PERIOD_S,
    };
    let at = |t: f64| Instant(1_000_000 + (t * 1e6).round() as u64);
    for (missing, is_valid) in [(3, true), (5, false)] {
        let mut state = ChainState::default();
        let (mut t, end) = (0.0, START_S + 0.5);
        while t < end {
            chain.sample(&mut state, part.sample(t), at(t));
            t += PERIOD_S;
        }
        t += PERIOD_S * f64::from(missing);
        chain.sample(&mut state, part.sample(t), at(t));
        t += PERIOD_S;
        chain.sample(&mut state, part.sample(t), at(t));
        let found = chain.reading_now(&state, at(t)).x;
        assert_eq!(found.is_ok(), is_valid, "{missing}: {found:?}");
        if let Ok(found) = found {
            // The rate behind the gap stands for that within it: 80 deg/s all the time.
            let error = found.angle.degrees() - Part::angle(t);
            assert!(error.abs() < 0.05, "{error}");
        }
    }
}

#[test]
fn a_part_without_a_gyroscope_and_tables_go_without_it() {
    let mut chain = chain();
    let mut state = ChainState::default();
    for i in 0..400 {
        let counts = Counts([0, 0, 8192]);
        chain.sample(&mut state, counts, Instant(1_000_000 + i * 2_400));
    }
    let now = Instant(1_000_000 + 399 * 2_400);
    assert_eq!(chain.reading(&state, now).x, Err(Invalid::NoSample));
    chain.calibration.rates = None;
    assert!(chain.reading(&state, now).x.is_ok());
    chain.calibration.rates = Some(RateCorrection::IDENTITY);
    chain.fusion = None;
    assert!(chain.reading(&state, now).x.is_ok());
    assert_eq!(chain.reading_now(&state, now), chain.reading(&state, now));
}

#[test]
fn a_gyroscope_whose_codes_stand_still_takes_the_angle_away_and_gives_it_back() {
    let mut chain = chain();
    let at = |i: u64| Instant(1_000_000 + i * 2_400);
    let noise = |i: u64, axis: u64| (i.wrapping_mul(7 + 2 * axis) % 13) as i16 - 6;
    for (stuck, most) in [([true; 3], 12), ([false, true, false], 42)] {
        chain.fusion = Fusion::new(&expected(), RateRange::Dps500, LATENCY_US);
        let mut state = ChainState::default();
        let mut told = None;
        for i in 0..700 {
            let is_stuck = |axis: u64| (500..600).contains(&i) && stuck[axis as usize];
            let code = |axis| noise(if is_stuck(axis) { 500 } else { i }, axis);
            let sample = Sample {
                counts: Counts([0, 0, 8192]),
                rate: Some(RateCounts([code(0), code(1), code(2)])),
            };
            chain.sample(&mut state, sample, at(i));
            let found = chain.reading_now(&state, at(i)).x;
            match found {
                Err(Invalid::Stuck) => told = told.or(Some(i)),
                _ => assert!(i < 500 || told.is_none() || i >= 600, "{i}: {found:?}"),
            }
        }
        assert!(told.is_some_and(|told| told - 500 <= most), "{told:?}");
        assert!(chain.reading_now(&state, at(699)).x.is_ok());
    }
}

#[test]
fn the_rate_is_that_of_the_last_sample_about_the_housing_s_axes_or_why_there_is_none() {
    let mut chain = chain();
    // A gyroscope that shows 1 % too much.
    let scaled = RateCorrection::from_real(&RealRateCorrection {
        matrix: [[1.0, 0.0, 0.0], [0.0, 1.0 / 1.01, 0.0], [0.0, 0.0, 1.0]],
        scale1: [0.0; 3],
        bias: [0.0; 3],
        bias1: [0.0; 3],
        bias2: [0.0; 3],
    });
    chain.calibration.rates = scaled;
    let mut state = ChainState::default();
    let at = |i: u64| Instant(1_000_000 + i * 2_400);
    assert_eq!(chain.rate(&state, at(0)), Err(Invalid::NoSample));
    let mut turning = |dps: f64, from: u64, samples: u64| {
        for i in from..from + samples {
            let count = (-dps * 1.01 / 0.0175).round() as i16;
            let sample = Sample {
                counts: Counts([0, 0, 8192]),
                rate: Some(RateCounts([0, count, 0])),
            };
            chain.sample(&mut state, sample, at(i));
        }
        let end = at(from + samples - 1);
        let later = [0, 9_000, 10_000].map(|later| chain.rate(&state, end.offset(later)));
        later.map(|rate| rate.map(|rate| rate.rad_s().map(f64::to_degrees)))
    };
    let [now, later, late] = turning(0.0, 0, 600);
    assert!(now.is_ok() && later == now, "{now:?} {later:?}");
    assert_eq!(late, Err(Invalid::Stale));
    let [x, y, z] = turning(40.0, 600, 4)[0].expect("a rate");
    assert!((y + 40.0).abs() < 0.05, "{y}");
    assert!(x.abs() < 0.05 && z.abs() < 0.05, "{x} {z}");
    assert_eq!(turning(505.0, 604, 1)[0], Err(Invalid::OverRange));
    chain.fusion = None;
    assert_eq!(chain.rate(&state, at(604)), Err(Invalid::NotMeasured));
}
