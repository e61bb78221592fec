//! The chain as a whole: its order, its sense of time, and its reasons for saying nothing.

use super::*;
use crate::ONE_G;
use crate::table::Point;
use crate::temperature::DataSheet;
use crate::uncertainty::Span;
use std::vec::Vec;

fn product() -> Chain {
    Chain {
        filter: LowPass::PRODUCT,
        full_scale: FullScale::G2,
        period_us: 2500,
        part_delay_q16: PART_DELAY_Q16,
        timing: Timing::Aligned { latency_us: 25_000 },
        calibration: Calibration {
            temperature: TemperatureModel::None,
            correction: Correction::TwoAxis {
                vector: Vector::IDENTITY,
                harmonics: Axes::default(),
            },
            budget: Budget {
                noise: ONE_G as u32 / 800,
                ..Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::CHAMBER)
            },
            rates: None,
        },
        fusion: None,
    }
}

fn paper() -> Chain {
    let points: Vec<_> = (-90..=90)
        .map(|d| Point {
            accel: (f64::from(d).to_radians().sin() * f64::from(ONE_G)) as i32,
            angle: Angle::from_degrees(f64::from(d)),
        })
        .collect();
    let table = Table::new(&points).unwrap();
    let mut chain = product();
    chain.filter = LowPass::PAPER;
    chain.period_us = 20_000;
    chain.timing = Timing::AsItArrives;
    chain.calibration.correction = Correction::Tables {
        tables: Axes {
            x: table.clone(),
            y: table,
        },
        rule: Rule::Linear,
    };
    chain
}

/// Counts of a part at slope X `degrees`.
fn at(degrees: f64) -> Counts {
    let (s, c) = degrees.to_radians().sin_cos();
    Counts([s, 0.0, c].map(|v| (v * 16384.0).round() as i16))
}

/// Feeds `seconds` of a motion sampled every `period_us`, from time 1 s on.
fn feed(
    chain: &Chain,
    state: &mut ChainState,
    seconds: f64,
    period_us: f64,
    angle: impl Fn(f64) -> f64,
) {
    let count = (seconds * 1e6 / period_us) as u32;
    for i in 0..count {
        let t_us = f64::from(i) * period_us;
        // The part's own low-pass delays what it samples by 0.45 sample.
        let felt = t_us - 0.450_16 * period_us;
        chain.sample(
            state,
            at(angle(felt * 1e-6)),
            Instant(1_000_000 + t_us as u64),
        );
    }
}

#[test]
fn a_standing_sensor_reads_its_angle() {
    for chain in [product(), paper()] {
        let mut state = ChainState::default();
        feed(&chain, &mut state, 2.0, f64::from(chain.period_us), |_| {
            30.0
        });
        let reading = chain.reading(&state, Instant(3_000_000));
        assert!(
            (reading.x.unwrap().angle.degrees() - 30.0).abs() < 0.005,
            "{reading:?}"
        );
        assert!(reading.y.unwrap().angle.degrees().abs() < 0.005);
    }
}

#[test]
fn r7_order_is_filter_temperature_correction_angle() {
    // One step of acceleration while the part is at 65 degC: the filter must smooth the raw
    // counts, then 8 mg of temperature bias go, then scale 1.1 multiplies the rest. Any other
    // order of the last two gives 0.55 mg more, any other place of the filter another transient.
    let mut chain = product();
    let mg = f64::from(ONE_G) / 1000.0;
    let tco = DataSheet {
        tco_q8: [(0.2 * mg * 256.0) as i32, 0, 0],
    };
    chain.calibration.temperature = TemperatureModel::DataSheet(tco);
    let vector = Vector::from_real(
        [[1.1, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [0.0; 3],
    )
    .unwrap();
    chain.calibration.correction = Correction::TwoAxis {
        vector,
        harmonics: Axes::default(),
    };
    let mut state = ChainState::default();
    chain.temperature(&mut state, Temperature::from_celsius(65));
    let mut bare = FilterState::default();
    for i in 0..200u64 {
        let counts = if i < 150 {
            at(0.0)
        } else {
            Counts([1638, 0, 16384])
        };
        chain.sample(&mut state, counts, Instant(1_000_000 + 2500 * i));
        if i == 0 {
            bare = FilterState::standing_at(scale(counts, FullScale::G2));
        }
        let [x, y, z] = chain
            .filter
            .step(&mut bare, scale(counts, FullScale::G2))
            .accel;
        let filtered = Filtered { accel: [x, y, z] };
        let want = (f64::from(x) - 8.0 * mg) * 1.1;
        let found = chain
            .evaluate(filtered, Temperature::from_celsius(65))
            .x
            .unwrap()
            .angle;
        assert!((found.degrees() - want.atan2(f64::from(z)).to_degrees()).abs() < 3e-4);
        assert_eq!(
            state.filtered().unwrap().0,
            filtered,
            "the state holds what the filter gave"
        );
    }
}

#[test]
fn e2_the_lag_on_a_ramp_is_the_declared_latency() {
    // 80 deg/s: the paper's filter alone lags 0.64 deg, its part 0.72 more.
    let ramp = |t: f64| 80.0 * (t - 0.5) - 40.0;
    for (chain, arrives) in [(product(), 2.0), (paper(), 1.357)] {
        let mut state = ChainState::default();
        feed(&chain, &mut state, 1.0, f64::from(chain.period_us), ramp);
        let now = Instant(2_000_000 - u64::from(chain.period_us));
        let now_s = 1.0 - f64::from(chain.period_us) * 1e-6;
        let m = chain.reading(&state, now).x.unwrap();
        let lag = ramp(now_s) - m.angle.degrees();
        assert!((lag - arrives).abs() < 0.02, "{lag}");
        let aligned = ramp(now_s - f64::from(m.latency_us) * 1e-6) - m.angle.degrees();
        assert!(aligned.abs() < 0.02, "{aligned}");
    }
    let filter_alone = f64::from(LowPass::PAPER.delay_q16()) / 65536.0 * 0.020 * 80.0;
    assert!((filter_alone - 0.64).abs() < 0.005);
}

#[test]
fn two_clocks_report_the_same_instant() {
    // Parts 3 % fast and 3 % slow, same motion: readings for one instant agree.
    let ramp = |t: f64| 80.0 * (t - 0.5);
    let chain = product();
    let angles = [2425.0, 2575.0].map(|period_us| {
        let mut state = ChainState::default();
        feed(&chain, &mut state, 1.0, period_us, ramp);
        chain
            .reading(&state, Instant(1_998_000))
            .x
            .unwrap()
            .angle
            .degrees()
    });
    assert!((angles[0] - angles[1]).abs() < 0.01, "{angles:?}");
}

#[test]
fn absence_is_a_reason_in_every_case() {
    let chain = product();
    let mut state = ChainState::default();
    let reason = |state: &ChainState, us| chain.reading(state, Instant(us)).x.unwrap_err();
    assert_eq!(reason(&state, 0), Invalid::NoSample);
    chain.sample(&mut state, at(5.0), Instant(1_000_000));
    assert_eq!(reason(&state, 1_000_001), Invalid::Settling);
    feed(&chain, &mut state, 1.0, 2500.0, |_| 5.0);
    assert!(chain.reading(&state, Instant(1_998_000)).x.is_ok());
    assert_eq!(reason(&state, 2_020_000), Invalid::Stale);
    chain.sample(&mut state, Counts([i16::MAX, 0, 0]), Instant(2_000_000));
    assert_eq!(reason(&state, 2_000_001), Invalid::OverRange);
    let mut needs = product();
    needs.calibration.temperature = TemperatureModel::DataSheet(DataSheet::default());
    let mut state = ChainState::default();
    feed(&needs, &mut state, 1.0, 2500.0, |_| 5.0);
    let cold = needs.reading(&state, Instant(1_998_000)).x.unwrap_err();
    assert_eq!(cold, Invalid::NoTemperature);
    needs.temperature(&mut state, Temperature::REFERENCE);
    assert!(needs.reading(&state, Instant(1_998_000)).x.is_ok());
}

#[test]
fn first_valid_angle_within_a_second_of_the_start() {
    for chain in [product(), paper()] {
        let period = u64::from(chain.period_us);
        let mut state = ChainState::default();
        let first = (0..400u64).find(|i| {
            chain.sample(&mut state, at(40.0), Instant(i * period));
            chain.reading(&state, Instant(i * period)).x.is_ok()
        });
        assert!(first.unwrap() * period < 1_000_000);
    }
}

#[test]
fn gaps_are_filled_or_start_the_filter_anew() {
    let chain = product();
    let mut state = ChainState::default();
    feed(&chain, &mut state, 1.0, 2500.0, |_| 12.0);
    let last = state.filtered().unwrap().1;
    chain.sample(&mut state, at(12.0), last.offset(3 * 2500));
    assert_eq!(state.filled(), 2);
    assert!(chain.reading(&state, last.offset(3 * 2500)).x.is_ok());
    chain.sample(&mut state, at(12.0), last);
    assert_eq!(
        state.filtered().unwrap().1,
        last.offset(3 * 2500),
        "older samples are ignored"
    );
    chain.sample(&mut state, at(12.0), last.offset(20 * 2500));
    assert_eq!(
        chain.reading(&state, last.offset(20 * 2500)).x,
        Err(Invalid::Settling)
    );
}

#[test]
fn the_period_is_measured() {
    let chain = product();
    let mut state = ChainState::default();
    feed(&chain, &mut state, 1.0, 2430.0, |_| 0.0);
    let period_us = f64::from(state.period_q8()) / 256.0;
    assert!((period_us - 2430.0).abs() < 1.0, "{period_us}");
}

#[test]
fn the_turn_of_one_axis_is_less_certain_the_more_it_is_tilted_across() {
    let share = |y: f64, z: f64| {
        let accel = [0.0, y, z].map(|g| (g * f64::from(crate::ONE_G)) as i32);
        across(Corrected { accel }).degrees()
    };
    assert_eq!(share(0.06, 1.0), 0.0, "an offset is no tilt");
    // 10 deg across: 2 % of tan 10 deg, less what counts as none.
    assert!((share(0.1736, 0.9848) - 0.190).abs() < 0.001);
    assert_eq!(share(-0.5, 0.866), share(0.5, 0.866));
    assert!((share(0.5, 0.866) - 0.657).abs() < 0.001);
    assert!(share(1.0, 0.0) > 100.0, "flat on its side there is no turn");
    for extreme in [i32::MIN, i32::MAX, 0] {
        across(Corrected {
            accel: [extreme, extreme, extreme],
        });
    }
}

#[test]
fn one_axis_does_not_measure_y() {
    let mut chain = product();
    chain.calibration.correction = Correction::OneAxis {
        vector: Vector::IDENTITY,
        harmonics: Harmonics::default(),
    };
    let mut state = ChainState::default();
    feed(&chain, &mut state, 1.0, 2500.0, |_| 170.0);
    let reading = chain.reading(&state, Instant(1_998_000));
    assert!((reading.x.unwrap().angle.degrees() - 170.0).abs() < 0.01);
    assert_eq!(reading.y, Err(Invalid::NotMeasured));
    let (_, vector) = chain.reading_and_vector(&state, Instant(1_998_000));
    assert_eq!(vector, None, "of the third axis nothing is known");
}

proptest::proptest! {
    /// Whatever the samples, times and temperatures: no panic, no overflow.
    #[test]
    fn any_samples_leave_a_reading_or_a_reason(
        steps in proptest::collection::vec((proptest::array::uniform3(proptest::num::i16::ANY),
            0u64..40_000, proptest::num::i32::ANY), 1..200),
        full_scale in 0usize..4,
    ) {
        for mut chain in [product(), paper()] {
            chain.full_scale =
                [FullScale::G2, FullScale::G4, FullScale::G8, FullScale::G16][full_scale];
            let mut state = ChainState::default();
            let mut now = Instant(0);
            for (counts, elapsed, temperature) in &steps {
                now = now.offset(*elapsed as i64);
                chain.sample(&mut state, Counts(*counts), now);
                chain.temperature(&mut state, Temperature(*temperature));
                let _ = chain.reading(&state, now);
                let _ = chain.reading(&state, Instant(u64::MAX));
            }
        }
    }
}

#[test]
fn a_quotient_is_the_same_by_either_way() {
    for a in [0, 1, 2_499, 2_500, 7_501, 30_000, 1 << 33, i64::MAX] {
        for b in [i64::MIN, -3, 0, 1, 2_500, 65_535, 65_536, 1 << 40] {
            for a in [a, -a] {
                let exact = (i128::from(a) << 16).checked_div(b.into());
                let exact = exact.and_then(|q| i64::try_from(q).ok());
                let fits = a.checked_mul(1 << 16).is_some();
                assert_eq!(quotient_q16(a, b), exact.filter(|_| fits), "{a} {b}");
            }
        }
    }
}
