//! What a node of each mode is set up for before anything was stored in it.
//!
//! Out: part, filter and timing of a [`Setup`]. Firmware, simulation and tests take them from here,
//! so that the node on the chip and the one on the bench are the same.
//!
//! Left out: who the node is ([`Factory`](crate::device::Factory)), and the rule of the pair
//! ([`CrossCheck`](tilt::cross_check::CrossCheck)).

use tilt::chain::Timing;
use tilt::composition::{Composition, Place};
use tilt::filter::LowPass;
use tilt::fusion::Fusion;
use tilt::motion::Expected;
use tilt::table::Rule;

use crate::channel::Setup;
use crate::sensor::ism330dhcx::{self, GYROSCOPE_DELAY_MILLISAMPLES};
use crate::sensor::{Config, PartConfig};

/// Latency that the product declares, us: 22.4 ms of filter and 1.1 ms of part (LIS2DW12), and
/// what the interpolation to a common instant needs.
pub const PRODUCT_LATENCY_US: u32 = 25_000;

/// Latency that paper mode declares when both nodes report one instant, us: the delays of the pole
/// (8.0 ms) and of the part (9.0 ms), and up to one period of the slowest part (20.6 ms).
pub const PAPER_LATENCY_US: u32 = 40_000;

/// How a value between two points of a table becomes an angle (eq 7, E3, E4), in paper mode and of
/// tables made over the bus (2060h).
pub const RULE: Rule = Rule::Linear;

/// The product: 400 samples/s, Butterworth.
pub const fn product() -> Setup {
    Setup {
        part: PartConfig::Lis2dw12(Config::PRODUCT),
        filter: LowPass::PRODUCT,
        timing: Timing::Aligned {
            latency_us: PRODUCT_LATENCY_US,
        },
        noise: 0,
    }
}

/// The variant with a gyroscope: 417 samples/s, Butterworth beside the estimator.
pub const fn dynamic() -> Setup {
    Setup {
        part: PartConfig::Ism330dhcx(ism330dhcx::Config::PRODUCT),
        ..product()
    }
}

/// Latency of the aligned angle where there is a gyroscope, us: two periods of a slow part, so that
/// the instant lies between two samples in both channels.
pub const DYNAMIC_LATENCY_US: u32 = 5_000;

/// What is expected of a calibrated ISM330DHCX and of the machine that moves it.
const CALIBRATED: Expected = Expected {
    period_s: ism330dhcx::Config::PRODUCT.rate.period_us() as f64 * 1e-6,
    delay_s: rate_delay_s(),
    rate_range: 8.7,
    accel_range: 3.99,
    ..Expected::CALIBRATED
};

/// How late the vertical is that follows the part's rates, s.
///
/// The rate's own delay, but for half a period: a rate counts for the period before its sample, in
/// whose middle it would be right.
const fn rate_delay_s() -> f64 {
    let samples = GYROSCOPE_DELAY_MILLISAMPLES as f64 * 1e-3 - 0.5;
    samples * ism330dhcx::Config::PRODUCT.rate.period_us() as f64 * 1e-6
}

/// A part whose noise is known to be less stands still by right: 0.4 steps at +-4 g, 2^-26 g.
const STANDS_STILL: u32 = (tilt::ONE_G / 20_480) as u32;

/// How the vertical follows the gyroscope of this part; `None` where it has none.
///
/// `noise` is that of [`Setup::noise`]: codes of a part without noise may repeat.
pub fn fusion<C: Composition>(part: &PartConfig, noise: u32) -> Option<C::Fusion> {
    const DYNAMIC: Option<Fusion> = Fusion::new(
        &CALIBRATED,
        ism330dhcx::Config::PRODUCT.range,
        DYNAMIC_LATENCY_US,
    );
    match part {
        PartConfig::Lis2dw12(_) => None,
        PartConfig::Ism330dhcx(_) => DYNAMIC.and_then(|fusion| {
            C::Fusion::put(|| match noise {
                1..STANDS_STILL => fusion.without_noise(),
                _ => fusion,
            })
        }),
    }
}

/// The paper's instrument (R1, R2): 50 samples/s, one pole, both nodes' angles of one instant.
pub const fn paper() -> Setup {
    Setup {
        part: PartConfig::Lis2dw12(Config::PAPER),
        filter: LowPass::PAPER,
        timing: Timing::Aligned {
            latency_us: PAPER_LATENCY_US,
        },
        noise: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tilt::cross_check::gravity::Gravity;

    #[test]
    fn an_acceleration_is_older_than_a_turn_by_the_difference_of_the_latencies() {
        let turn_us = f64::from(DYNAMIC_LATENCY_US) + rate_delay_s() * 1e6;
        let older_us = f64::from(PRODUCT_LATENCY_US) - turn_us;
        assert!((f64::from(Gravity::PRODUCT.older_us) - older_us).abs() < 5.0);
    }
}
