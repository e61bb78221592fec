//! The instrument's chain, tuned to a recording: its range, its rate, its calibration.
//!
//! In: a [`Prepared`] recording and the mode. Out: the same [`Chain`] that runs on the chip. The
//! corner is 10 Hz as there, or a quarter of the rate where a recording is slower than 40
//! samples/s. Two channels have one corner and declare one latency, the larger of the two
//! ([`common_latency_us`]): else a swing would make a difference of its own between them. Paper
//! mode keeps the paper's pole, exp(-2 pi 10 Hz / rate), its timing and its check; its one-axis
//! table needs a run on a motor, so the angle comes from the three-axis correction in both modes.
//!
//! What a recording's sensor filtered by itself isn't known; no delay is taken for it.

use std::f64::consts::TAU;

use tilt::chain::{Chain, Timing};
use tilt::filter::LowPass;

use super::arguments::Mode;
use super::prepare::Prepared;

/// The corner of both modes, Hz.
const CORNER_HZ: f64 = 10.0;

/// The chains of all channels.
pub fn chains(channels: &[Prepared], mode: Mode) -> Vec<Chain> {
    let slowest_us = channels.iter().map(Prepared::period_us).max().unwrap_or(1);
    let slowest_hz = 1e6 / slowest_us.max(1) as f64;
    let one = |channel| chain(channel, mode, slowest_hz);
    channels.iter().map(one).collect()
}

/// The chain of one channel; `slowest_hz` is the rate of the slower channel.
fn chain(channel: &Prepared, mode: Mode, slowest_hz: f64) -> Chain {
    let period_us = channel.period_us().max(1);
    let filter = filter(1e6 / period_us as f64, slowest_hz, mode);
    // A recording has at least 25 samples per second.
    let period_us = u32::try_from(period_us).unwrap_or(u32::MAX);
    let delay_us = delay_us(&filter, period_us);
    let timing = match mode {
        Mode::Paper => Timing::AsItArrives,
        // One period more, so that the instant lies between two samples. Two would look back past
        // the last two samples, which are all that the chain keeps.
        Mode::Product => Timing::Aligned {
            latency_us: delay_us.saturating_add(period_us),
        },
    };
    Chain {
        filter,
        full_scale: channel.recording.full_scale(),
        period_us,
        part_delay_q16: 0,
        timing,
        fusion: None,
        calibration: channel.record.calibration(),
    }
}

/// The latency that all chains declare together, the largest of theirs; 0 in paper mode, which
/// aligns nothing.
pub fn common_latency_us(chains: &[Chain]) -> u32 {
    let aligned = chains.iter().map(|chain| match chain.timing {
        Timing::AsItArrives => 0,
        Timing::Aligned { latency_us } => latency_us,
    });
    aligned.max().unwrap_or(0)
}

/// How much earlier than the others a chain is fed and read, so that its readings belong to the
/// common instant, microseconds. It keeps two samples only and can't look back further itself.
pub fn held_back_us(chain: &Chain, common_us: u32) -> u32 {
    match chain.timing {
        Timing::AsItArrives => 0,
        Timing::Aligned { latency_us } => common_us.saturating_sub(latency_us),
    }
}

/// The latency that a chain declares, ms: that of the filter alone where readings are not aligned.
pub fn latency_ms(chain: &Chain, common_us: u32) -> f64 {
    let micros = match chain.timing {
        Timing::AsItArrives => delay_us(&chain.filter, chain.period_us),
        Timing::Aligned { .. } => common_us,
    };
    f64::from(micros) / 1000.0
}

fn delay_us(filter: &LowPass, period_us: u32) -> u32 {
    let micros = (u64::from(filter.delay_q16()) * u64::from(period_us)) >> 16;
    u32::try_from(micros).unwrap_or(u32::MAX)
}

fn filter(rate_hz: f64, slowest_hz: f64, mode: Mode) -> LowPass {
    let one_pole = LowPass::one_pole((-TAU * CORNER_HZ / rate_hz).exp());
    match mode {
        Mode::Paper => one_pole,
        // A quarter of the rate is always a possible corner.
        Mode::Product => {
            LowPass::butterworth(CORNER_HZ.min(0.25 * slowest_hz), rate_hz).unwrap_or(one_pole)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_the_chips_rates_the_filters_are_the_chips() {
        assert_eq!(
            filter(50.0, 50.0, Mode::Paper).delay_q16(),
            LowPass::PAPER.delay_q16()
        );
        assert_eq!(
            filter(400.0, 400.0, Mode::Product).delay_q16(),
            LowPass::PRODUCT.delay_q16()
        );
    }

    #[test]
    fn a_slow_recording_has_a_lower_corner() {
        // sqrt(2) / (2 pi fc) of delay: 22.5 ms at 10 Hz, 36 ms at 6.25 Hz.
        let delay = |rate: f64| {
            let period_us = (1e6 / rate) as u32;
            delay_us(&filter(rate, rate, Mode::Product), period_us)
        };
        assert!((20_000..24_000).contains(&delay(62.5)), "{}", delay(62.5));
        assert!((28_000..38_000).contains(&delay(25.0)), "{}", delay(25.0));
    }
}
