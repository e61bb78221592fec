//! The high-pass, the statistics of repeats and of activity, and what machines do to both.

use super::*;
use crate::ONE_G;
use std::f64::consts::{PI, TAU};
use std::vec::Vec;

/// The data sheet's noise at 400 samples/s in mg, and in steps of 0.244 mg.
const OWN_MG: f64 = 1.2728;
const STEP_MG: f64 = 1000.0 / 4096.0;

/// Product mode with the data sheet's noise.
const PRODUCT: Health = Health::new(0, FullScale::G2, 2500);
/// Paper mode likewise.
const PAPER: Health = Health::new(0, FullScale::G2, 20_000);

/// A stream of normal deviates: xorshift64* behind Box and Muller.
struct Normal(u64);

impl Normal {
    fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        ((self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 + 0.5) / 2f64.powi(53)
    }

    fn next(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

/// The counts of a part that feels `mg` on its axes.
fn counts(mg: [f64; 3]) -> Counts {
    Counts(mg.map(|a| ((a / STEP_MG).round().clamp(-8192.0, 8191.0) * 4.0) as i16))
}

/// Activities of `looks` windows of eight samples; `felt` is told the sample's number and gives
/// what comes beside noise of `noise_mg`.
fn activities(
    health: &Health,
    looks: u32,
    noise_mg: f64,
    mut felt: impl FnMut(u32) -> [f64; 3],
) -> Vec<Activity> {
    let mut normal = Normal(0x9E37_79B9_7F4A_7C15);
    let mut state = HealthState::default();
    let mut found = Vec::new();
    for n in 0..looks * 8 + u32::from(WARM_UP) {
        let at = felt(n).map(|a| a + noise_mg * normal.next());
        health.sample(&mut state, counts(at));
        if n >= u32::from(WARM_UP) && n % 8 == 7 {
            found.push(health.take_activity(&mut state));
        }
    }
    found
}

/// Mean energy in eighths of an octave: 64 is the own noise.
fn level(activities: &[Activity]) -> f64 {
    let sum: f64 = activities.iter().map(|a| f64::from(a.energy_q8())).sum();
    (sum / activities.len() as f64).log2() * 8.0
}

fn at_rest(_: u32) -> [f64; 3] {
    [3.1, -17.2, 999.4]
}

/// Gain in dB against the top, at `frequency_hz` of 400 samples/s.
fn gain_db(frequency_hz: f64) -> f64 {
    let step = TAU * frequency_hz / 400.0;
    let sum = |wave: fn(f64) -> f64| -> f64 {
        let taps = TAPS.iter().enumerate();
        taps.map(|(n, &tap)| tap as f64 * wave(step * n as f64))
            .sum()
    };
    20.0 * (sum(f64::cos).hypot(sum(f64::sin)) / 7056.0).log10()
}

#[test]
fn the_high_pass_has_its_taps_in_this_order() {
    let mut high_pass = HighPass::default();
    for (n, &tap) in TAPS.iter().enumerate() {
        assert_eq!(i64::from(high_pass.step(i32::from(n == 0))), tap);
    }
    for _ in 0..20 {
        assert_eq!(high_pass.step(0), 0);
    }
}

#[test]
fn the_high_pass_keeps_noise_and_loses_machines() {
    assert_eq!(TAPS.iter().map(|tap| tap.abs()).sum::<i64>(), 7056);
    assert_eq!(TAPS.iter().sum::<i64>(), 0);
    assert!(gain_db(200.0).abs() < 1e-9);
    assert!((gain_db(150.0) + 7.1).abs() < 0.1, "{}", gain_db(150.0));
    for (frequency_hz, most_db) in [
        (25.0, -70.0),
        (45.0, -55.0),
        (60.0, -54.0),
        (72.0, -64.0),
        (80.0, -120.0),
        (88.0, -56.0),
        (88.9, -54.0),
    ] {
        let db = gain_db(frequency_hz);
        assert!(db < most_db && db > most_db - 3.0, "{frequency_hz} Hz {db}");
    }
    // Of white noise, 94 % of what passes is above 150 Hz.
    let power = |from: u32| -> f64 {
        (from..4000)
            .map(|n| 10f64.powf(gain_db((f64::from(n) + 0.5) / 20.0) / 10.0))
            .sum()
    };
    let share = power(3000) / power(0);
    assert!((share - 0.937).abs() < 0.001, "{share}");
}

#[test]
fn extremes_do_not_overflow() {
    for fs in [FullScale::G2, FullScale::G16] {
        for noise in [0, 1, 1000, u32::MAX] {
            for period_us in [0, 1, 2500, u32::MAX] {
                let health = Health::new(noise, fs, period_us);
                let mut state = HealthState::default();
                for n in 0..5000 {
                    let code = if n % 2 == 0 { i16::MIN } else { i16::MAX };
                    health.sample(&mut state, Counts([code; 3]));
                }
                assert!(!health.stuck(&state));
                assert!(health.take_activity(&mut state) > Activity::OWN);
            }
        }
    }
    let mut state = HealthState::default();
    for n in 0..100 {
        let code = if n % 2 == 0 { i16::MIN } else { i16::MAX };
        PRODUCT.sample(&mut state, Counts([code; 3]));
    }
    let sixteen_octaves = Activity(64 + 8 * 16);
    assert!(PRODUCT.take_activity(&mut state) > sixteen_octaves);
}

#[test]
fn logarithm_and_power_are_right_to_their_last_place() {
    for value in [1, 2, 3, 5, 1000, 65_535, 1 << 40, u64::MAX / 3, u64::MAX] {
        let exact = (value as f64).log2() * 256.0;
        let found = f64::from(log2_q8(value));
        assert!(found <= exact && found > exact - 1.1, "{value} {found}");
    }
    assert_eq!(log2_q8(0), 0);
    for steps in 1..=255 {
        let exact = 2f64.powf(f64::from(steps) / 8.0);
        let found = f64::from(Activity(steps).energy_q8());
        let allowed = 0.51 + exact * 2e-5;
        assert!((found - exact).abs() < allowed, "{steps} {found}");
    }
    assert_eq!(Activity::OWN.energy_q8(), 256);
    assert_eq!(Activity::NONE.energy_q8(), 0);
    assert_eq!(Activity::from_octaves(i32::MIN / 2), Activity(1));
    assert_eq!(Activity::from_octaves(i32::MAX / 2), Activity(254));
}

/// The normal distribution below `x`, by Simpson's rule.
fn normal_below(x: f64) -> f64 {
    let step = x / 200.0;
    let density = |n: u32| (-0.5 * (f64::from(n) * step).powi(2)).exp();
    let weight = |n: u32| {
        if n == 0 || n == 200 {
            1.0
        } else {
            f64::from(2 + 2 * (n % 2))
        }
    };
    let sum: f64 = (0..=200).map(|n| weight(n) * density(n)).sum();
    0.5 + sum * step / 3.0 / (2.0 * PI).sqrt()
}

/// Probability that `codes` readings of noise `sigma` (in steps) are identical, at the worst mean.
fn identical(sigma: f64, codes: i32) -> f64 {
    let reach = (8.0 * sigma) as i32 + 2;
    let sum = |mean: f64| -> f64 {
        let share = |code: i32| {
            let edge = |side| normal_below((f64::from(code) + side - mean) / sigma);
            (edge(0.5) - edge(-0.5)).max(0.0)
        };
        (-reach..=reach).map(|code| share(code).powi(codes)).sum()
    };
    (0..=5)
        .map(|n| sum(f64::from(n) / 10.0))
        .fold(0.0, f64::max)
}

#[test]
fn a_healthy_part_is_called_stuck_less_than_once_in_1e13_samples() {
    for steps in [0.45, 0.6, 1.0, 1.84, 3.0, 5.21, 10.0, 40.0, 300.0] {
        let noise = (steps * f64::from(ONE_G) / 4096.0) as u32;
        let health = Health::new(noise, FullScale::G2, 2500);
        let [all, axis] = [health.repeats_all, health.repeats_axis].map(i32::from);
        let [all_again, axis_again] =
            [all, axis].map(|repeats| [0, 1].map(|less| identical(steps, repeats + 1 - less)));
        assert!(all_again[0].powi(3) < 1e-13, "{steps} {all}");
        assert!(3.0 * axis_again[0] < 1e-13, "{steps} {axis}");
        // Nor does it wait much longer than it must; below a step the bound is loose.
        let least = i32::from(LEAST_REPEATS);
        if steps > 1.0 {
            assert!(
                all == least || all_again[1].powi(3) > 1e-14,
                "{steps} {all}"
            );
            assert!(axis == least || 3.0 * axis_again[1] > 1e-14, "{axis}");
        }
    }
}

#[test]
fn repeats_of_both_modes_and_of_a_quiet_part() {
    assert_eq!((PRODUCT.repeats_all, PRODUCT.repeats_axis), (4, 12));
    assert_eq!((PAPER.repeats_all, PAPER.repeats_axis), (7, 20));
    let quiet = Health::new(
        (0.35 * f64::from(ONE_G) / 4096.0) as u32,
        FullScale::G2,
        2500,
    );
    assert_eq!((quiet.repeats_all, quiet.repeats_axis), (NEVER, NEVER));
    let mut state = HealthState::default();
    for _ in 0..1000 {
        quiet.sample(&mut state, counts([0.0, 0.0, 1000.0]));
    }
    assert!(!quiet.stuck(&state));
}

#[test]
fn repeats_of_drawn_noise_are_as_frequent_as_computed() {
    const SAMPLES: u32 = 4_000_000;
    let sigma = OWN_MG / STEP_MG;
    let mut normal = Normal(7);
    let mut axis = Axis::default();
    let mut runs = [0u32; 8];
    for _ in 0..SAMPLES {
        let [code, ..] = counts([0.3 * STEP_MG + OWN_MG * normal.next(); 3]).0;
        axis.note(code);
        for run in runs.iter_mut().take(usize::from(axis.repeats) + 1) {
            *run += 1;
        }
    }
    for (repeats, &found) in runs.iter().enumerate().take(6).skip(1) {
        let expected = f64::from(SAMPLES) * identical(sigma, repeats as i32 + 1);
        let scatter = 6.0 * expected.sqrt() * 1.2 + 1.0;
        let off = (f64::from(found) - expected).abs();
        assert!(off < scatter, "{repeats}: {found} of {expected}");
    }
}

/// Feeds noise in which `stuck` axes stand still from sample 100 on; returns after how many
/// samples of standing still it was seen.
fn seen_after(health: &Health, noise_mg: f64, stuck: [bool; 3]) -> Option<u32> {
    let mut normal = Normal(11);
    let mut state = HealthState::default();
    let mut held = Counts::default();
    for n in 0..200 {
        let mut now = counts(at_rest(n).map(|a| a + noise_mg * normal.next()));
        for ((code, &old), &stuck) in now.0.iter_mut().zip(&held.0).zip(&stuck) {
            if stuck && n >= 100 {
                *code = old;
            }
        }
        held = now;
        health.sample(&mut state, now);
        if health.stuck(&state) {
            return Some(n - 99);
        }
    }
    None
}

#[test]
fn a_stuck_part_is_seen_in_12_ms_and_a_stuck_axis_in_32() {
    // The sample they froze at is the first of the identical codes.
    assert_eq!(seen_after(&PRODUCT, OWN_MG, [true; 3]), Some(4));
    assert_eq!(seen_after(&PRODUCT, OWN_MG, [false, true, false]), Some(12));
    assert_eq!(seen_after(&PAPER, 0.45, [true; 3]), Some(7));
    assert_eq!(seen_after(&PAPER, 0.45, [false, false, true]), Some(20));
    assert_eq!(seen_after(&PRODUCT, OWN_MG, [false; 3]), None);
}

#[test]
fn stuck_ends_with_the_first_code_that_differs() {
    let mut state = HealthState::default();
    for _ in 0..5 {
        assert!(!PRODUCT.stuck(&state));
        PRODUCT.sample(&mut state, Counts([40, -8, 16_384]));
    }
    assert!(PRODUCT.stuck(&state));
    // One axis alone moves: not all are stuck now, and the others not for long enough.
    PRODUCT.sample(&mut state, Counts([44, -8, 16_384]));
    assert!(!PRODUCT.stuck(&state));
    for _ in 0..8 {
        PRODUCT.sample(&mut state, Counts([40, -8, 16_384]));
    }
    assert!(PRODUCT.stuck(&state));
    // A gap is no reason to believe in it.
    PRODUCT.restart(&mut state);
    assert!(PRODUCT.stuck(&state));
    // Parts with 16-bit codes: the lowest bits count.
    PRODUCT.sample(&mut state, Counts([41, -7, 16_385]));
    assert!(!PRODUCT.stuck(&state));
}

#[test]
fn codes_at_full_scale_are_clipped_and_not_stuck() {
    for clipped in [i16::MIN, -32_752, 32_752, 32_764, i16::MAX] {
        let mut state = HealthState::default();
        for n in 0..100 {
            PRODUCT.sample(&mut state, Counts([clipped, 4 * n, 4 * n]));
            assert!(!PRODUCT.stuck(&state));
        }
        let mut state = HealthState::default();
        for _ in 0..12 {
            PRODUCT.sample(&mut state, Counts([clipped, 8, 8]));
            assert!(!PRODUCT.stuck(&state), "too few of y and z");
        }
    }
    let mut state = HealthState::default();
    for n in 0..100 {
        PRODUCT.sample(&mut state, Counts([32_748, 4 * n, 4 * n]));
    }
    assert!(PRODUCT.stuck(&state));
}

#[test]
fn own_noise_gives_64_and_three_times_as_much_25_more() {
    let own = activities(&PRODUCT, 20_000, OWN_MG, at_rest);
    assert!((level(&own) - 64.0).abs() < 0.2, "{}", level(&own));
    let scatter = {
        let mean = own.iter().map(|a| f64::from(a.0)).sum::<f64>() / own.len() as f64;
        let squares = own.iter().map(|a| (f64::from(a.0) - mean).powi(2));
        (squares.sum::<f64>() / own.len() as f64).sqrt()
    };
    // Each look of eight samples scatters by 2.4 dB, or 54 % of the energy.
    assert!((scatter - 6.35).abs() < 0.2, "{scatter}");
    let tripled = activities(&PRODUCT, 20_000, 3.0 * OWN_MG, at_rest);
    let more = level(&tripled) - level(&own);
    assert!((more - 8.0 * 9f64.log2()).abs() < 0.4, "{more}");
    let paper = activities(&PAPER, 20_000, 0.45, at_rest);
    assert!((level(&paper) - 64.0).abs() < 0.2, "{}", level(&paper));
}

#[test]
fn the_level_is_the_units_own() {
    let noise = (2.0 * OWN_MG * f64::from(ONE_G) / 1000.0) as u32;
    let loud = Health::new(noise, FullScale::G2, 2500);
    let found = level(&activities(&loud, 5000, 2.0 * OWN_MG, at_rest));
    assert!((found - 64.0).abs() < 0.3, "{found}");
    // At another range a step is larger, and the same noise fewer steps.
    let health = Health::new(noise, FullScale::G4, 2500);
    let found = level(&activities(&health, 5000, OWN_MG, at_rest));
    assert!((found - 64.0).abs() < 0.3, "{found}");
}

#[test]
fn a_machine_at_work_does_not_change_it() {
    let own = level(&activities(&PRODUCT, 4000, OWN_MG, at_rest));
    for rate_hz in [360.0, 400.0, 440.0] {
        let found = activities(&PRODUCT, 4000, OWN_MG, |n| {
            let t = f64::from(n) / rate_hz;
            let tone = 50.0 * 2f64.sqrt() * (TAU * 80.0 * t).sin();
            // Five tones of 30 mg rms together, up to the edge of the band.
            let rumble: f64 = [3.1, 7.7, 13.3, 19.9, 25.0]
                .iter()
                .map(|f| 19.0 * (TAU * f * t).sin())
                .sum();
            [tone + rumble, 0.7 * tone - rumble, 1000.0 + tone + rumble]
        });
        let more = level(&found) - own;
        assert!(more.abs() < 2.0, "{rate_hz} Hz: {more}");
    }
}

#[test]
fn a_slow_motion_does_not_change_it() {
    let own = level(&activities(&PRODUCT, 4000, OWN_MG, at_rest));
    let found = activities(&PRODUCT, 4000, OWN_MG, |n| {
        let angle = 0.7 * (TAU * 0.3 * f64::from(n) / 400.0).sin();
        [1000.0 * angle.sin(), 0.0, 1000.0 * angle.cos()]
    });
    assert!((level(&found) - own).abs() < 0.3);
}

#[test]
fn a_spike_of_one_sample_stands_out_wherever_it_falls() {
    for place in 0..8 {
        let found = activities(&PRODUCT, 6, OWN_MG, |n| {
            let [x, y, z] = at_rest(n);
            [x, y, z + if n == 16 + place { 200.0 } else { 0.0 }]
        });
        let most = found.iter().max().unwrap();
        assert!(most.0 > 64 + 8 * 7, "{place} {most:?}");
    }
}

#[test]
fn a_stuck_part_has_no_activity() {
    let found = activities(&PRODUCT, 3, 0.0, at_rest);
    assert!(found.iter().all(|&a| a == Activity(1)), "{found:?}");
}

#[test]
fn a_shock_of_3_g_looks_like_a_fault_in_its_onset() {
    // Why the cross-check compares both channels: they feel it alike.
    let mut most = [u8::MAX, 0];
    for place in 0..16 {
        let found = activities(&PRODUCT, 20, OWN_MG, |n| {
            let t = (f64::from(n) - 24.0 - f64::from(place) / 2.0) / 400.0;
            let ring = if t < 0.0 {
                0.0
            } else {
                3000.0 * (TAU * 45.0 * t).sin() * (-t / 0.02).exp()
            };
            [0.6 * ring, 0.0, 0.8 * ring - 900.0]
        });
        let top = found.iter().max().unwrap().0;
        most = [most[0].min(top), most[1].max(top)];
    }
    let octaves = most.map(|top| (f64::from(top) - 64.0) / 8.0);
    assert!((octaves[0] - 8.2).abs() < 0.5, "{most:?}");
    assert!((octaves[1] - 13.1).abs() < 0.5, "{most:?}");
}

#[test]
fn after_a_start_or_a_gap_eight_samples_are_not_judged() {
    let mut state = HealthState::default();
    for first in [Activity::NONE, Activity::GAP] {
        for _ in 0..WARM_UP {
            PRODUCT.sample(&mut state, counts([1000.0, 0.0, 0.0]));
        }
        assert_eq!(PRODUCT.take_activity(&mut state), first);
        for _ in 0..5 {
            PRODUCT.sample(&mut state, counts([1000.0, 0.0, 0.0]));
        }
        assert_eq!(PRODUCT.take_activity(&mut state), Activity::NONE);
        PRODUCT.sample(&mut state, counts([1000.0, 0.0, 0.0]));
        assert_eq!(PRODUCT.take_activity(&mut state), Activity(1));
        assert_eq!(PRODUCT.take_activity(&mut state), Activity::NONE);
        // A jump across the gap is not seen as one.
        PRODUCT.restart(&mut state);
        PRODUCT.sample(&mut state, counts([-1000.0; 3]));
        PRODUCT.restart(&mut state);
    }
}

#[test]
fn a_look_tells_of_a_gap_until_the_high_pass_has_started_again() {
    let mut state = HealthState::default();
    let mut look = |count: u32, gap: bool| {
        if gap {
            PRODUCT.restart(&mut state);
        }
        for _ in 0..count {
            PRODUCT.sample(&mut state, counts([1000.0, 0.0, 0.0]));
        }
        PRODUCT.take_activity(&mut state)
    };
    look(20, false);
    assert_eq!(look(8, false), Activity(1));
    assert_eq!(look(5, true), Activity::GAP);
    assert_eq!(look(8, false), Activity::GAP, "it began within this look");
    assert_eq!(look(8, false), Activity(1));
}

#[test]
fn with_one_sample_per_look_every_sixth_look_sees_six() {
    let mut normal = Normal(3);
    let mut state = HealthState::default();
    let looks: Vec<_> = (0..8 + 60)
        .map(|n| {
            let at = at_rest(n).map(|a| a + 0.45 * normal.next());
            PAPER.sample(&mut state, counts(at));
            PAPER.take_activity(&mut state)
        })
        .collect();
    let seen: Vec<_> = (0..looks.len())
        .filter(|&n| looks.get(n) != Some(&Activity::NONE))
        .collect();
    assert_eq!(seen, (13..68).step_by(6).collect::<Vec<_>>());
}

#[test]
fn a_look_after_a_long_time_is_of_the_newer_half() {
    let mut normal = Normal(5);
    let mut state = HealthState::default();
    for n in 0..100_000 {
        let sigma_mg = if n < 80_000 { 100.0 } else { OWN_MG };
        let at = at_rest(n).map(|a| a + sigma_mg * normal.next());
        PRODUCT.sample(&mut state, counts(at));
    }
    let found = PRODUCT.take_activity(&mut state);
    assert!(found.0.abs_diff(64) <= 2, "{found:?}");
}
