//! What a node of each mode is set up for before anything was stored in it.
//!
//! Out: part, filter and timing of a [`Setup`]. Firmware, simulation and tests take them from here,
//! so that the node on the chip and the one on the bench are the same.
//!
//! Left out: who the node is ([`Factory`](crate::device::Factory)), and the rule of the pair
//! ([`CrossCheck`](tilt::cross_check::CrossCheck)).

use tilt::chain::Timing;
use tilt::filter::LowPass;
use tilt::table::Rule;

use crate::channel::Setup;
use crate::sensor::Config;

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
        part: Config::PRODUCT,
        filter: LowPass::PRODUCT,
        timing: Timing::Aligned {
            latency_us: PRODUCT_LATENCY_US,
        },
        noise: 0,
    }
}

/// The paper's instrument (R1, R2): 50 samples/s, one pole, both nodes' angles of one instant.
pub const fn paper() -> Setup {
    Setup {
        part: Config::PAPER,
        filter: LowPass::PAPER,
        timing: Timing::Aligned {
            latency_us: PAPER_LATENCY_US,
        },
        noise: 0,
    }
}
