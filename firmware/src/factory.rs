//! What a node is before anything was stored in it.
//!
//! In: the channel that the board straps to this chip, and the serial number. Out: the device's
//! [`Factory`]: product mode, uncalibrated, 250 kbit/s.
//!
//! The tables that a calibration has room for make it large, so each level is a call, whose result
//! is written right into its place: see [`Device::new`](device::device::Device::new).

use device::calibration::motor::{MOTOR, Terms};
use device::channel::Settings;
use device::device::Factory;
use device::objects::panel::Identity;
use device::objects::table::Channel;
use device::sensor::Config;
use tilt::angle::{Axes, Harmonics};
use tilt::chain::{Calibration, Chain, Correction, PART_DELAY_Q16, Timing};
use tilt::filter::LowPass;
use tilt::sample::FullScale;
use tilt::table::Rule;
use tilt::temperature::TemperatureModel;
use tilt::uncertainty::Budget;
use tilt::vector::Vector;

/// Latency that the product declares, us: 22.4 ms of filter and 1.1 ms of part (LIS2DW12), and
/// what the interpolation to a common instant needs.
const LATENCY_US: u32 = 25_000;

/// Bit rate as delivered, kbit/s.
const KBIT_S: u16 = 250;

/// A node as it leaves the soldering line.
#[inline(never)]
pub fn factory(channel: Channel, serial: u32) -> Factory {
    Factory {
        identity: Identity { channel, serial },
        node_id: channel.node_id(),
        kbit_s: KBIT_S,
        settings: settings(),
        terms: Terms {
            rule: Rule::Linear,
            reference: MOTOR,
        },
    }
}

/// Part and chain of the product, not calibrated.
#[inline(never)]
fn settings() -> Settings {
    Settings {
        part: Config::PRODUCT,
        chain: chain(),
        noise: 0,
    }
}

#[inline(never)]
fn chain() -> Chain {
    Chain {
        filter: LowPass::PRODUCT,
        full_scale: FullScale::G2,
        period_us: Config::PRODUCT.rate.period_us(),
        part_delay_q16: PART_DELAY_Q16,
        timing: Timing::Aligned {
            latency_us: LATENCY_US,
        },
        calibration: calibration(),
    }
}

#[inline(never)]
fn calibration() -> Calibration {
    Calibration {
        temperature: TemperatureModel::None,
        correction: correction(),
        budget: Budget::DATA_SHEET,
    }
}

#[inline(never)]
fn correction() -> Correction {
    Correction::TwoAxis {
        vector: Vector::IDENTITY,
        harmonics: Axes::<Harmonics>::default(),
    }
}
