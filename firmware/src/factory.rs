//! What a node is before anything was stored in it.
//!
//! In: the channel that the board straps to this chip, and the serial number. Out: the device's
//! [`Factory`]: uncalibrated, 250 kbit/s, set up as `device::factory` sets for the mode.

use device::calibration::motor::{MOTOR, TableSettings};
use device::channel::Setup;
use device::device::Factory;
use device::factory;
use device::objects::device_objects::Identity;
use device::objects::table::{Channel, Models};

/// Bit rate as delivered, kbit/s.
const KBIT_S: u16 = 250;

/// A node of the product as it leaves the soldering line.
pub fn product(channel: Channel, serial: u32) -> Factory {
    of(channel, serial, Models::PRODUCT, factory::product())
}

/// A node of the variant with a gyroscope as it leaves the soldering line.
pub fn dynamic(channel: Channel, serial: u32) -> Factory {
    of(channel, serial, Models::DYNAMIC, factory::dynamic())
}

/// A node of the paper's instrument as it leaves the soldering line.
pub fn paper(channel: Channel, serial: u32) -> Factory {
    of(channel, serial, Models::PAPER, factory::paper())
}

fn of(channel: Channel, serial: u32, models: Models, setup: Setup) -> Factory {
    Factory {
        identity: Identity {
            channel,
            serial,
            models,
        },
        node_id: channel.node_id(),
        kbit_s: KBIT_S,
        setup,
        table_settings: TableSettings {
            rule: factory::RULE,
            reference: MOTOR,
        },
    }
}
