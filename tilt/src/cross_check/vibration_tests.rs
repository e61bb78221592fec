//! A machine that vibrates above 150 Hz, of all sizes and frequencies, in front of the detector of
//! noise: neither channel is faulty, and neither is held to be. What both channels measure is
//! equal but for the place, the time and the scatter of their samples.

use super::activity::{ActivityCheck, ActivityState};
use super::random_tests::Dice;
use crate::health::{Activity, Health, HealthState};
use crate::sample::{Counts, FullScale};

/// Looks of both channels at a vibration of so many times the energy of their own noise, of which
/// the first channel measures `times` as much.
struct Vibration {
    energy: f64,
    times: f64,
    samples: u32,
    dice: Dice,
}

impl Vibration {
    fn looks(mut self) -> impl Iterator<Item = (Activity, Activity)> {
        std::iter::repeat_with(move || {
            let own = self
                .dice
                .look_at(1.0 + self.times * self.energy, self.samples);
            let peer = self.dice.look_at(1.0 + self.energy, self.samples);
            (own, peer)
        })
    }
}

/// The looks at which somebody is held faulty, of looks so many microseconds apart.
fn held(
    looks: impl Iterator<Item = (Activity, Activity)>,
    period_us: u32,
) -> impl Iterator<Item = usize> {
    let mut state = ActivityState::default();
    let mut is_held = move |(own, peer)| {
        let verdict = ActivityCheck::PRODUCT.step(&mut state, own, peer, period_us);
        verdict.is_some()
    };
    let all = looks.enumerate();
    all.filter_map(move |(n, look)| is_held(look).then_some(n))
}

#[test]
fn a_weak_steady_vibration_was_taken_for_the_noise_of_one_channel() {
    /// Its beginning has a test of its own.
    const BEGINNING: usize = 100;
    for samples in [8, 20, 40] {
        for times in [1.0, 1.5, 2.0] {
            for quarters in 0..80_u32 {
                let vibration = Vibration {
                    energy: f64::from(quarters) / 4.0,
                    times,
                    samples,
                    dice: Dice(0x9E37_79B9_7F4A_7C15 + u64::from(quarters)),
                };
                let looks = vibration.looks().take(2000);
                let found = held(looks, 2500 * samples).find(|n| *n >= BEGINNING);
                assert_eq!(
                    found, None,
                    "{samples} samples, {quarters}/4, {times} times"
                );
            }
        }
    }
}

#[test]
fn of_ten_thousand_weak_vibrations_that_begin_at_most_five_are_taken_for_noise() {
    let mut found = 0;
    for n in 0..10_000_u32 {
        let vibration = |energy| Vibration {
            energy,
            times: 1.1,
            samples: 8,
            dice: Dice(0x9E37_79B9_7F4A_7C15_u64.wrapping_mul(2 * u64::from(n) + 1)),
        };
        // Half of them are there from power-on.
        let quiet = vibration(0.0).looks().take(30 * (n % 2) as usize);
        let begins = vibration(f64::from(n / 2 % 40) / 4.0).looks().take(60);
        found += u32::from(held(quiet.chain(begins), 20_000).next().is_some());
    }
    std::println!("{found} of 10 000");
    assert!(found <= 5, "{found} of 10 000");
}

/// Looks, 20 ms apart, of two channels at a tone of one axis. Each samples at its own rate.
fn tone(hz: f64, mg: f64, rates_hz: [f64; 2]) -> impl Iterator<Item = (Activity, Activity)> {
    const OWN_MG: f64 = 1.2728;
    const STEPS_PER_MG: f64 = 4.096;
    let health = Health::new(0, FullScale::G2, 2500);
    let mut dice = Dice(hz.to_bits());
    let mut channels = rates_hz.map(|rate_hz| (rate_hz, 0_u32, HealthState::default()));
    (1_u32..).map(move |look| {
        let [own, peer] = channels.each_mut().map(|(rate_hz, taken, state)| {
            while f64::from(*taken) / *rate_hz < 0.02 * f64::from(look) {
                let phase = core::f64::consts::TAU * hz * f64::from(*taken) / *rate_hz;
                let felt = [mg * phase.sin(), 0.0, 1000.0].map(|at| at + OWN_MG * dice.normal());
                health.sample(
                    state,
                    Counts(felt.map(|at| 4 * (at * STEPS_PER_MG).round() as i16)),
                );
                *taken += 1;
            }
            health.take_activity(state)
        });
        (own, peer)
    })
}

/// Half the rate of a channel is where its samples of a tone beat slowly: the tone is there for
/// half a second, and then not. That is the limit that `docs/safety.md` states.
#[test]
fn a_tone_is_taken_for_noise_only_within_three_hertz_of_half_the_rate_of_a_channel() {
    const LIMIT_HZ: f64 = 3.0;
    let mut inside = 0;
    for rates_hz in [[400.0, 400.5], [400.0, 404.0], [396.0, 404.0]] {
        for hz in (240..540).map(|half| f64::from(half) / 2.0) {
            let is_near = rates_hz
                .iter()
                .any(|rate| (hz - rate / 2.0).abs() <= LIMIT_HZ);
            for mg in [1.0, 2.0, 3.0, 5.0, 8.0, 15.0, 50.0] {
                let found = held(tone(hz, mg, rates_hz).take(250), 20_000).next();
                assert!(
                    is_near || found.is_none(),
                    "{hz} Hz, {mg} mg, {rates_hz:?}: {found:?}"
                );
                inside += u32::from(found.is_some());
            }
        }
    }
    assert!(inside > 0, "the limit is not needed any more");
}
