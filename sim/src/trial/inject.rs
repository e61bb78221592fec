//! What goes wrong in a trial, when, and on which channel.
//!
//! In: a list of [`Injection`]s. Out: faults that begin and end in a [`Network`].

use std::fmt;

use crate::fault::{NodeFault, SensorFault};
use crate::network::Network;
use crate::rng::Rng;
use crate::trial::timed::Timed;

/// One thing that goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What {
    /// On the way from the housing to the samples.
    Sensor(SensorFault),
    /// With the node.
    Node(NodeFault),
}

impl What {
    /// Whether the channel that has it is the one to be blamed. Where the bus fails, each may hold
    /// the other for silent.
    pub fn is_own(&self) -> bool {
        match self {
            Self::Sensor(_) => true,
            Self::Node(fault) => matches!(
                fault,
                NodeFault::Silent | NodeFault::Halted | NodeFault::CorruptCalibration
            ),
        }
    }

    /// Whether what is found of it stays until a reset, whatever the policy.
    pub fn needs_reset(&self) -> bool {
        *self == Self::Node(NodeFault::CorruptCalibration)
    }

    /// Whether every frame still gets through.
    pub fn leaves_bus_sound(&self) -> bool {
        matches!(
            self,
            Self::Sensor(_) | Self::Node(NodeFault::CorruptCalibration)
        )
    }
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Sensor(fault) => fault.fmt(f),
            Self::Node(fault) => fault.fmt(f),
        }
    }
}

/// One thing that goes wrong for a while.
pub type Injection = Timed<What>;

impl Injection {
    /// Begins; `rng` is the fault's own.
    pub fn begin(&self, network: &mut Network, node: usize, mut rng: Rng) {
        match self.what {
            What::Sensor(fault) => network.node(node).electronics.inject(fault, rng),
            What::Node(fault) => network.inject(node, fault, &mut rng),
        }
    }

    /// Ends.
    pub fn heal(&self, network: &mut Network, node: usize) {
        match self.what {
            What::Sensor(_) => network.node(node).electronics.heal(),
            What::Node(_) => network.heal(node),
        }
    }
}
