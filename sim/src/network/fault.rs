//! Faults of a node on the bus.
//!
//! In: a [`NodeFault`] and a stream of random numbers of its own. Out: a node that has the fault
//! until it is healed; one fault per node at a time.
//!
//! Left out: faults of the node's sensor, which its electronics take.

use std::collections::VecDeque;

use canopen::Frame;

use super::Network;
use super::node::NetworkNode;
use crate::can_bus::{Bus, Port};
use crate::fault::{Corruption, NodeFault};
use crate::rng::Rng;

/// A babbling node's turn: part of it babbles, the rest is quiet, ns.
const TURN_NS: u64 = 10_000_000;

/// What a fault has made of a node's way to the bus.
#[derive(Debug, Default)]
pub(super) struct Faulty {
    fault: Option<NodeFault>,
    late_ns: u64,
    /// Frames on their way to the controller, each with the time at which it gets there.
    late: VecDeque<(u64, Frame)>,
    babble: Option<Babble>,
    corruption: Option<Corruption>,
}

/// A node that floods the bus.
#[derive(Debug)]
struct Babble {
    frame: Frame,
    /// How much of a turn it does so, ns.
    loud_ns: u64,
    on: bool,
    next_ns: u64,
}

impl Faulty {
    /// True while frames go to the controller by way of [`Faulty::delay`].
    pub(super) fn is_late(&self) -> bool {
        self.late_ns != 0 || !self.late.is_empty()
    }

    /// The code has handed over a frame at `now_ns`.
    pub(super) fn delay(&mut self, frame: Frame, now_ns: u64) {
        self.late.push_back((now_ns + self.late_ns, frame));
    }

    /// The frame that is to go to the controller next, if its time has come.
    pub(super) fn arriving(&self, now_ns: u64) -> Option<Frame> {
        let (at_ns, frame) = self.late.front()?;
        (*at_ns <= now_ns).then_some(*frame)
    }

    /// It has gone.
    pub(super) fn arrived(&mut self) {
        self.late.pop_front();
    }

    /// True for a frame that the node does not hear.
    pub(super) fn is_deaf_to_sync(&self) -> bool {
        self.fault == Some(NodeFault::SyncLost)
    }

    /// When this next wants to be polled, ns, after `now_ns`; what is due already waits for
    /// something else.
    #[inline]
    pub(super) fn next_ns(&self, now_ns: u64) -> Option<u64> {
        if self.late.is_empty() && self.babble.is_none() {
            return None;
        }
        let late = self.late.front().map(|(at_ns, _)| *at_ns);
        let late = late.filter(|at_ns| *at_ns > now_ns);
        let babble = self.babble.as_ref().map(|babble| babble.next_ns);
        late.into_iter().chain(babble).min()
    }

    /// Begins and ends the turns of a node that babbles.
    pub(super) fn poll(&mut self, bus: &mut Bus, port: Port, now_ns: u64) {
        let Some(babble) = &mut self.babble else {
            return;
        };
        if now_ns < babble.next_ns {
            return;
        }
        let quiet_ns = TURN_NS.saturating_sub(babble.loud_ns);
        babble.on = !babble.on || quiet_ns == 0;
        let length_ns = if babble.on { babble.loud_ns } else { quiet_ns };
        babble.next_ns = now_ns + length_ns.max(1);
        bus.babble(port, babble.on.then_some(babble.frame));
    }

    /// The controller has been reset: what was on its way is gone, and a turn begins anew.
    pub(super) fn forget(&mut self) {
        self.late.clear();
        if let Some(babble) = &mut self.babble {
            babble.on = false;
            babble.next_ns = 0;
        }
    }
}

impl NetworkNode {
    fn inject(&mut self, fault: NodeFault, bus: &mut Bus, rng: &mut Rng) {
        self.faulty.fault = Some(fault);
        match fault {
            NodeFault::Silent => self.power_off(bus),
            NodeFault::Halted => self.halt(),
            NodeFault::LateFrames { ms } => self.faulty.late_ns = u64::from(ms) * 1_000_000,
            NodeFault::Babbling { id, share } => {
                self.faulty.babble = Some(Babble {
                    frame: Frame::data_frame(id, &[0; 8]),
                    loud_ns: (share.clamp(0.0, 1.0) * TURN_NS as f64) as u64,
                    on: false,
                    next_ns: bus.now_ns(),
                });
            }
            NodeFault::BusOff => bus.faults().spoil(self.port, true),
            NodeFault::SyncLost => {}
            NodeFault::CorruptCalibration => {
                let calibration = &mut self.device.settings_mut().chain.calibration;
                self.faulty.corruption = Corruption::flip(calibration, rng);
            }
        }
    }

    fn heal(&mut self, bus: &mut Bus) {
        let now_ns = bus.now_ns();
        match self.faulty.fault.take() {
            None | Some(NodeFault::SyncLost) => {}
            Some(NodeFault::Silent) => self.power_on(bus, now_ns),
            Some(NodeFault::Halted) => self.reset(bus, now_ns),
            Some(NodeFault::LateFrames { .. }) => {
                self.faulty.late_ns = 0;
                for (at_ns, _) in &mut self.faulty.late {
                    // What is still under way goes out in its order as soon as there is room.
                    *at_ns = now_ns;
                }
                self.poll(bus, now_ns);
            }
            Some(NodeFault::Babbling { .. }) => {
                self.faulty.babble = None;
                bus.babble(self.port, None);
            }
            Some(NodeFault::BusOff) => bus.faults().spoil(self.port, false),
            Some(NodeFault::CorruptCalibration) => {
                if let Some(corruption) = self.faulty.corruption.take() {
                    corruption.undo(&mut self.device.settings_mut().chain.calibration);
                }
            }
        }
    }
}

impl Network {
    /// From now on this goes wrong with a node; what went wrong before is healed first. `rng` is
    /// the fault's own.
    pub fn inject(&mut self, number: usize, fault: NodeFault, rng: &mut Rng) {
        self.heal(number);
        self.nodes[number].inject(fault, &mut self.bus, rng);
    }

    /// Ends a node's fault.
    pub fn heal(&mut self, number: usize) {
        self.nodes[number].heal(&mut self.bus);
    }

    /// The fault of a node.
    pub fn fault(&self, number: usize) -> Option<NodeFault> {
        self.nodes[number].faulty.fault
    }
}
