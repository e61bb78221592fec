//! What a node is before anything was stored in it.
//!
//! In: the channel that the board straps to this chip, and the serial number. Out: the device's
//! [`Factory`]: product mode, uncalibrated, 250 kbit/s.

use device::calibration::motor::{MOTOR, Terms};
use device::channel::Setup;
use device::device::Factory;
use device::objects::panel::Identity;
use device::objects::table::Channel;
use device::sensor::Config;
use tilt::chain::Timing;
use tilt::filter::LowPass;
use tilt::table::Rule;

/// Latency that the product declares, us: 22.4 ms of filter and 1.1 ms of part (LIS2DW12), and
/// what the interpolation to a common instant needs.
const LATENCY_US: u32 = 25_000;

/// Bit rate as delivered, kbit/s.
const KBIT_S: u16 = 250;

/// A node as it leaves the soldering line.
pub fn factory(channel: Channel, serial: u32) -> Factory {
    Factory {
        identity: Identity { channel, serial },
        node_id: channel.node_id(),
        kbit_s: KBIT_S,
        setup: Setup {
            part: Config::PRODUCT,
            filter: LowPass::PRODUCT,
            timing: Timing::Aligned {
                latency_us: LATENCY_US,
            },
            noise: 0,
        },
        terms: Terms {
            rule: Rule::Linear,
            reference: MOTOR,
        },
    }
}
