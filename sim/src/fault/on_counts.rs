//! A sensor fault on the counts of a recording.
//!
//! In: the samples of one part with their times. Out: the samples with the fault on them, or
//! none where a sample does not arrive. Before the fault's beginning samples pass as they are.
//!
//! A recording has been rounded and clipped already, and holds the noise of its own part. So what
//! is added is rounded to one count once more, which is finer than the step of a 14-bit part; and
//! more noise is made by adding as much as is missing, with the data sheet's density for what the
//! part has. The supply of a recording is not known: a brown-out ends the samples for good, as the
//! part stays in power-down until somebody sets it up.

use super::{Injected, SensorFault};
use crate::error_model::ErrorModel;
use crate::rng::Rng;

/// Noise density of the part in its high-performance mode with low-noise on, g/rtHz. `[DS]`
const NOISE_G_PER_ROOT_HZ: f64 = 90e-6;
/// Time constant of a sag's wander, s. `[ASSUME]`
const SAG_TAU_S: f64 = 2.0;

/// A fault on a stream of counts: its state.
#[derive(Clone, Debug)]
pub struct OnCounts {
    injected: Injected,
    from_s: f64,
    /// White noise of one sample of the part, g, 1 sigma.
    own_noise_g: f64,
    wander: [f64; 3],
    before_s: f64,
}

impl OnCounts {
    /// The fault begins at `from_s` of the recording's time; `rate_hz` is its sampling rate, which
    /// sets how much white noise there is in one sample; `rng` is the fault's own.
    pub fn new(fault: SensorFault, from_s: f64, rate_hz: f64, rng: Rng) -> Self {
        Self {
            injected: Injected::new(fault, from_s, rng),
            from_s,
            own_noise_g: NOISE_G_PER_ROOT_HZ * (rate_hz / 2.0).sqrt(),
            wander: [0.0; 3],
            before_s: from_s,
        }
    }

    /// What the thermometer reads instead of `die_c`, degC, once the fault has begun.
    pub fn thermometer_c(&self, die_c: f64) -> f64 {
        self.injected.thermometer_c(die_c)
    }

    /// The sample taken at `time_s`, at `counts_per_g` (above 0): what arrives instead, with the
    /// time of its capture, s. Times may not go back.
    pub fn apply(
        &mut self,
        time_s: f64,
        counts: [i16; 3],
        counts_per_g: f64,
    ) -> Option<(f64, [i16; 3])> {
        if time_s < self.from_s {
            return Some((time_s, counts));
        }
        if matches!(self.injected.fault(), SensorFault::BrownOut { .. }) || !self.injected.arrives()
        {
            return None;
        }
        let felt_g = counts.map(|c| f64::from(c) / counts_per_g);
        let disturbed_g = self.disturb(felt_g, time_s);
        let force_g = self.injected.force_g(disturbed_g, time_s);
        // A cast saturates, as the converter does.
        let codes = force_g.map(|g| (g * counts_per_g).round() as i16);
        let codes = self.injected.codes(codes, time_s);
        Some((self.injected.captured_s(time_s), codes))
    }

    /// Adds the noise and the wander that the part's own model adds in the world.
    fn disturb(&mut self, felt_g: [f64; 3], time_s: f64) -> [f64; 3] {
        let model = ErrorModel::NOMINAL;
        let sags = self.injected.fault() == SensorFault::Sag;
        let factor = if sags {
            1.0 + model.sag_noise_ratio
        } else {
            self.injected.noise()
        };
        if factor == 1.0 {
            return felt_g;
        }
        let missing_g = self.own_noise_g * (factor * factor - 1.0).max(0.0).sqrt();
        let rms_g = if sags {
            model.sag_wander_mg * 1e-3
        } else {
            0.0
        };
        self.wander_on(time_s);
        let (wander, rng) = (self.wander, self.injected.rng());
        [0, 1, 2].map(|i| felt_g[i] + missing_g * rng.normal() + rms_g * wander[i])
    }

    /// A first-order Gauss-Markov process on each axis, from 0 at the beginning of the fault.
    fn wander_on(&mut self, time_s: f64) {
        let keep = (-(time_s - self.before_s).max(0.0) / SAG_TAU_S).exp();
        let drive = (1.0 - keep * keep).sqrt();
        let rng = self.injected.rng();
        self.wander = self.wander.map(|w| keep * w + drive * rng.normal());
        self.before_s = time_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 400.0;
    const PER_G: f64 = 16384.0;
    /// When the fault begins, s.
    const FROM_S: f64 = 1.0;

    /// A time, s, and the codes.
    type Sample = (f64, [i16; 3]);

    /// Five seconds of a part at rest: what goes in, and what comes out.
    fn pairs(fault: SensorFault) -> Vec<(Sample, Option<Sample>)> {
        let mut part = Rng::stream(1, "part");
        let mut on_counts = OnCounts::new(fault, FROM_S, RATE_HZ, Rng::stream(1, "fault"));
        let own_g = on_counts.own_noise_g;
        (0..2000)
            .map(|number| {
                let time_s = f64::from(number) / RATE_HZ;
                let mut noisy = |g: f64| ((g + own_g * part.normal()) * PER_G).round() as i16;
                let counts = [noisy(0.3), noisy(-0.5), noisy(0.8)];
                ((time_s, counts), on_counts.apply(time_s, counts, PER_G))
            })
            .collect()
    }

    /// What comes out instead of what, once the fault has begun; nothing is missing or late.
    fn begun(fault: SensorFault) -> Vec<([i16; 3], [i16; 3])> {
        let in_time = |((time_s, into), out): (Sample, Option<Sample>)| {
            let (captured_s, out) = out.expect("a sample");
            assert_eq!(captured_s, time_s);
            (time_s >= FROM_S).then_some((into, out))
        };
        pairs(fault).into_iter().filter_map(in_time).collect()
    }

    fn sigma(values: impl Iterator<Item = i16> + Clone) -> f64 {
        let count = values.clone().count() as f64;
        let mean = values.clone().map(f64::from).sum::<f64>() / count;
        let squares = values.map(|v| (f64::from(v) - mean).powi(2));
        (squares.sum::<f64>() / count).sqrt()
    }

    #[test]
    fn nothing_happens_before_the_beginning() {
        for fault in [
            SensorFault::BrownOut { s: 0.01 },
            SensorFault::Noise { factor: 10.0 },
            SensorFault::SwappedAxes,
            SensorFault::Late { s: 0.05 },
        ] {
            let mut before = pairs(fault).into_iter().take(400);
            assert!(before.all(|(into, out)| out == Some(into)), "{fault}");
        }
    }

    #[test]
    fn bias_drift_and_gain_are_as_large_as_was_set() {
        let axis = 0;
        for (into, out) in begun(SensorFault::Bias { axis, mg: 50.0 }) {
            assert_eq!(out, [into[0] + 819, into[1], into[2]]);
        }
        let off = begun(SensorFault::Drift {
            axis,
            mg_per_s: 2.0,
        });
        let last = off.last().expect("samples");
        assert_eq!(off[0].0, off[0].1);
        assert_eq!(last.1[0] - last.0[0], 131);
        for (into, out) in begun(SensorFault::Gain { axis, ratio: -0.02 }) {
            let want = f64::from(into[0]) * 0.98;
            assert!((f64::from(out[0]) - want).abs() <= 0.5 && out[1..] == into[1..]);
        }
    }

    #[test]
    fn noise_and_sag_grow_by_their_factors() {
        for (fault, low, high) in [
            (SensorFault::Noise { factor: 3.0 }, 2.85, 3.15),
            (SensorFault::Noise { factor: 10.0 }, 9.5, 10.5),
            (SensorFault::Sag, 3.0, 20.0),
        ] {
            let samples = begun(fault);
            let into = sigma(samples.iter().map(|(into, _)| into[1]));
            let ratio = sigma(samples.iter().map(|(_, out)| out[1])) / into;
            assert!((low..high).contains(&ratio), "{fault}: {ratio}");
            // From one sample to the next the wander of a sag hardly moves.
            let steps = samples.windows(2).map(|w| w[1].1[1] - w[0].1[1]);
            let noise = sigma(steps) / 2f64.sqrt() / into;
            let want = if fault == SensorFault::Sag {
                2.0
            } else {
                ratio
            };
            assert!((noise / want - 1.0).abs() < 0.12, "{fault}: {noise}");
        }
    }

    #[test]
    fn codes_are_repeated_swapped_and_clipped() {
        let samples = begun(SensorFault::Stuck { axis: None });
        assert!(samples.iter().all(|(_, out)| *out == samples[0].0));
        for ([x, y, z], out) in begun(SensorFault::SwappedAxes) {
            assert_eq!(out, [y, x, z]);
        }
        let samples = begun(SensorFault::Spikes { g: 9.0, per_s: 0.0 });
        let out = samples[0].1;
        assert!(out.contains(&i16::MAX) || out.contains(&i16::MIN));
        assert!(samples[1..].iter().all(|(into, out)| into == out));
    }

    #[test]
    fn samples_are_late_lost_or_gone() {
        let late = pairs(SensorFault::Late { s: 0.05 });
        // 20 periods of 2.5 ms.
        for number in 420..2000 {
            assert_eq!(late[number].1, Some(late[number - 20].0));
        }
        assert!((400..420).all(|number| late[number].1 == Some(late[400].0)));
        let lost = pairs(SensorFault::SampleLoss { share: 0.1 });
        let missing = lost.iter().filter(|(_, out)| out.is_none()).count();
        assert!((130..190).contains(&missing), "{missing}");
        let gone = pairs(SensorFault::BrownOut { s: 0.01 });
        assert!(gone[400..].iter().all(|(_, out)| out.is_none()));
    }

    #[test]
    fn a_thermometer_reads_something_else() {
        let fault = SensorFault::Thermometer { c: 5.0 };
        let on_counts = OnCounts::new(fault, FROM_S, RATE_HZ, Rng::stream(1, "fault"));
        assert_eq!(on_counts.thermometer_c(20.0), 25.0);
        assert!(begun(fault).iter().all(|(into, out)| into == out));
    }
}
