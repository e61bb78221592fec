//! A device broken on purpose: the trial must find it out, or it finds nothing.
//!
//! In: a node without power. Out: the same node with other code.

use device::calibration::deliver;
use device::calibration::motor::{MOTOR, TableSettings};
use device::device::{Device, Factory};
use device::objects::device_objects::Identity;
use device::objects::table::{Channel, Models};
use tilt::cross_check::residual::{Residual, STAGES, Stage};
use tilt::cross_check::{CrossCheck, ProductCheck, ProductState, WindowCheck};
use tilt::table::Rule;

use crate::bench::Mode;
use crate::network::Network;
use crate::trial::Setup;

/// No difference is large enough.
const BLIND: ProductCheck = ProductCheck {
    window: WindowCheck {
        threshold: u32::MAX,
        ..ProductCheck::PRODUCT.window
    },
    residual: Residual {
        stages: [Stage {
            tau_us: 0,
            calm: u32::MAX,
            shaken: u32::MAX,
        }; STAGES],
        whole: u32::MAX,
        ..Residual::PRODUCT
    },
    ..ProductCheck::PRODUCT
};

/// What is broken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sabotage {
    /// Nothing.
    #[default]
    None,
    /// The cross-check sees no difference, however large.
    Blind,
}

impl Sabotage {
    /// Puts the broken code into a node; before power comes on.
    pub fn apply(self, setup: &Setup, network: &mut Network, node: usize) {
        match self {
            Self::None => {}
            Self::Blind => {
                let check = CrossCheck::Product(BLIND, ProductState::default(), None);
                replace(setup, network, node, check);
            }
        }
    }
}

/// The same device with another check.
fn replace(setup: &Setup, network: &mut Network, node: usize, check: CrossCheck) {
    let unit = network.node(node);
    let settings = unit.device.settings().clone();
    let channel = [Channel::A, Channel::B][node % 2];
    let paper = setup.mode == Mode::Paper;
    let factory = Factory {
        identity: Identity {
            channel,
            serial: 2 * setup.unit + node as u32 + 1,
            models: Models::WHOLE,
        },
        node_id: channel.node_id(),
        kbit_s: setup.kbit_s,
        table_settings: TableSettings {
            rule: if paper { Rule::Nearest } else { Rule::Linear },
            reference: MOTOR,
        },
        setup: settings.setup(),
    };
    let mut memory = setup.memory();
    deliver(&mut memory, &settings.chain.calibration).expect("a new memory");
    unit.device = Device::new(unit.electronics.driver(), check, factory, memory);
}
