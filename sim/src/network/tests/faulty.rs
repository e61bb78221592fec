//! Nodes with faults: what the bus and the other node see of them, and that healing ends it.

use super::*;

use canopen::node::BusState;
use device::objects::process::Process;
use tilt::chain::Correction;

use crate::can_bus::ErrorState;
use crate::fault::{NodeFault, SensorFault};

fn rng() -> Rng {
    Rng::stream(1, "fault")
}

impl Site {
    /// SYNCs 20 ms apart from the host.
    fn sync(&mut self, count: usize) {
        for _ in 0..count {
            self.send(0x80, &[]);
            self.run(&mut level(), 20 * MS);
        }
    }

    fn inject(&mut self, fault: NodeFault) {
        self.trace.clear();
        self.network.inject(1, fault, &mut rng());
        assert_eq!(self.network.fault(1), Some(fault));
    }

    fn heal(&mut self) {
        self.trace.clear();
        self.network.heal(1);
        assert_eq!(self.network.fault(1), None);
    }

    /// Lets everybody start who has to, and sees that the pair works as if nothing had been.
    fn works_again(&mut self) {
        self.run(&mut level(), 1500 * MS);
        self.send(0, &[1, 0]);
        self.run(&mut level(), 10 * MS);
        self.sync(100);
        self.trace.clear();
        self.sync(20);
        for (node, id) in [(0, 0x181), (1, 0x182)] {
            assert_eq!(self.times_of(id).len(), 20);
            let device = &self.network.nodes()[node].device;
            assert!(
                device.faults().is_empty(),
                "node {node} {:?} {:?}",
                device.faults(),
                self.process(node)
            );
        }
        assert_eq!(self.state(0), 1, "{:?}", self.process(0));
    }
}

fn working() -> Site {
    let mut site = Site::working(250);
    site.sync(30);
    assert_eq!(site.state(0), 1);
    site
}

/// When the answers of the node with the fault to SYNC came, ns.
fn answers(site: &Site) -> Vec<u64> {
    site.times_of(0x182)
}

#[test]
fn a_silent_node_sends_nothing_until_it_is_healed() {
    let mut site = working();
    site.inject(NodeFault::Silent);
    site.sync(50);
    assert_eq!(answers(&site), []);
    assert_eq!(site.times_of(0x702), []);
    assert!(!site.network.nodes()[1].is_powered());
    site.heal();
    site.works_again();
}

#[test]
fn a_halted_node_sends_nothing_but_acknowledges() {
    let mut site = Site::working(250);
    // Alone with the host: nobody else acknowledges.
    site.network.power_off(0);
    site.sync(10);
    site.inject(NodeFault::Halted);
    site.sync(50);
    assert_eq!(answers(&site), []);
    assert_eq!(site.times_of(0x80).len(), 50);
    site.heal();
    site.network.power_on(0);
    site.works_again();
}

#[test]
fn late_frames_keep_their_order_and_come_as_late_as_was_set() {
    for ms in [5, 200] {
        let mut site = working();
        let ids = |site: &Site| -> Vec<u16> {
            let ids = site.trace.iter().filter_map(|(_, f)| f.cob_id());
            ids.filter(|id| [0x182, 0x382].contains(id)).collect()
        };
        site.trace.clear();
        site.sync(30);
        let order = ids(&site);
        site.inject(NodeFault::LateFrames { ms });
        site.sync(30);
        site.run(&mut level(), 200 * MS);
        let (syncs, answers) = (site.times_of(0x80), answers(&site));
        assert!(answers.len() >= 30);
        for (sync, answer) in syncs.iter().zip(&answers).take(30) {
            let late_ns = answer - sync;
            let least_ns = u64::from(ms) * MS;
            assert!(
                (least_ns..least_ns + 3 * MS).contains(&late_ns),
                "{late_ns}"
            );
        }
        assert_eq!(ids(&site)[..order.len()], order);
        site.heal();
        site.works_again();
    }
}

#[test]
fn what_was_late_goes_out_when_the_fault_is_healed() {
    let mut site = working();
    site.inject(NodeFault::LateFrames { ms: 200 });
    site.sync(5);
    assert_eq!(answers(&site), []);
    site.heal();
    site.run(&mut level(), 20 * MS);
    assert_eq!(answers(&site).len(), 5);
    site.works_again();
}

#[test]
fn a_babbling_node_takes_the_bus_or_its_share_of_it() {
    let mut floods = Vec::new();
    for (share, low, high) in [(1.0, 99, 100), (0.5, 50, 70)] {
        let mut site = working();
        site.inject(NodeFault::Babbling { id: 0x10, share });
        site.run(&mut level(), 2500 * MS);
        let load = site.network.load_percent();
        assert!((low..=high).contains(&load), "{load} %");
        floods.push(site.times_of(0x10).len());
        assert_eq!(site.times_of(0x701).is_empty(), share == 1.0);
        site.heal();
        site.run(&mut level(), 50 * MS);
        site.trace.clear();
        site.works_again();
        assert_eq!(site.times_of(0x10), []);
    }
    assert!(floods[0] > 4000, "{floods:?}");
    assert!(floods[1].abs_diff(floods[0] / 2) < 150, "{floods:?}");
}

#[test]
fn a_node_that_babbles_goes_on_after_a_reset() {
    let mut site = working();
    site.inject(NodeFault::Babbling {
        id: 0x10,
        share: 1.0,
    });
    site.run(&mut level(), 100 * MS);
    site.network.reset(1);
    site.run(&mut level(), 100 * MS);
    site.trace.clear();
    site.run(&mut level(), 100 * MS);
    assert!(site.times_of(0x10).len() > 100);
}

#[test]
fn a_spoiled_sender_goes_bus_off_alone_and_recovers() {
    let mut site = working();
    site.inject(NodeFault::BusOff);
    site.sync(10);
    let off: Process = site.process(1);
    assert_eq!((off.bus.state, off.bus.bus_offs), (2, 1), "{:?}", off.bus);
    assert_eq!(answers(&site), []);
    let [own, host] = [site.network.nodes()[0].port, site.host];
    for port in [own, host] {
        assert!(site.network.bus.state(port) < ErrorState::Passive);
    }
    assert_eq!(site.times_of(0x181).len(), 10);
    // It tries to come back, and fails.
    site.run(&mut level(), 3000 * MS);
    assert!(site.process(1).bus.bus_offs > 1);
    site.heal();
    site.works_again();
    assert_eq!(site.process(1).bus.state, BusState::Active as u8);
}

/// Its boot-up message was lost by bus-off and never sent again: a master waited for ever, and the
/// other channel went on blaming the node for what had been before.
#[test]
fn a_boot_up_message_that_bus_off_took_was_never_sent_again() {
    let mut site = working();
    let spikes = SensorFault::Spikes { g: 0.2, per_s: 5.0 };
    site.network.node(1).electronics.inject(spikes, rng());
    site.sync(150);
    let shown = site.network.shown(0);
    assert_eq!((shown.state(), shown.blame().0), (8, 2));
    site.network.node(1).electronics.heal();
    site.inject(NodeFault::BusOff);
    site.network.reset(1);
    site.run(&mut level(), 3000 * MS);
    assert_eq!(site.times_of(0x702), []);
    assert!(site.process(1).bus.bus_offs > 1);
    site.heal();
    site.run(&mut level(), 1500 * MS);
    let said = site.trace.iter().map(|(_, frame)| frame);
    let said: Vec<_> = said.filter(|f| f.cob_id() == Some(0x702)).collect();
    let boots = said.iter().filter(|frame| frame.bytes() == [0]).count();
    assert_eq!((said[0].bytes(), boots), (&[0][..], 1));
    site.works_again();
}

#[test]
fn without_sync_a_node_hears_everything_else() {
    let mut site = working();
    site.inject(NodeFault::SyncLost);
    site.sync(15);
    assert_eq!(answers(&site), []);
    assert_eq!(site.times_of(0x181).len(), 15);
    site.send(0x602, &[0x40, 0x00, 0x10, 0, 0, 0, 0, 0]);
    site.run(&mut level(), 5 * MS);
    assert_eq!(site.times_of(0x582).len(), 1);
    site.heal();
    site.works_again();
}

#[test]
fn a_corrupt_calibration_is_sound_again_after_healing() {
    let mut site = working();
    let matrix = |site: &Site| {
        let chain = &site.network.nodes()[1].device.settings().chain;
        let Correction::TwoAxis { vector, .. } = &chain.calibration.correction else {
            panic!("the product has a matrix")
        };
        vector.matrix
    };
    let sound = matrix(&site);
    site.inject(NodeFault::CorruptCalibration);
    assert_ne!(matrix(&site), sound);
    site.heal();
    assert_eq!(matrix(&site), sound);
    // A reset brings back the calibration in memory, and healing leaves that alone.
    site.inject(NodeFault::CorruptCalibration);
    site.network.reset(1);
    site.run(&mut level(), 200 * MS);
    assert_eq!(matrix(&site), sound);
    site.heal();
    assert_eq!(matrix(&site), sound);
}

#[test]
fn another_fault_heals_the_one_before() {
    let mut site = working();
    site.inject(NodeFault::Silent);
    site.sync(5);
    site.inject(NodeFault::SyncLost);
    assert!(site.network.nodes()[1].is_powered());
    site.heal();
    site.works_again();
}

#[test]
fn late_samples_reach_a_node_with_their_old_times() {
    let late = |fault: Option<SensorFault>| {
        let mut site = working();
        if let Some(fault) = fault {
            let electronics = &mut site.network.node(1).electronics;
            electronics.inject(fault, rng());
        }
        site.run(&mut level(), 500 * MS);
        let unit = &site.network.nodes()[1];
        let now = unit.electronics.clock(site.network.now_s());
        let (_, captured) = unit.device.channel().filtered().expect("samples");
        now.micros_since(captured)
    };
    assert!((0..4000).contains(&late(None)));
    let age_us = late(Some(SensorFault::Late { s: 0.05 }));
    assert!((50_000..55_000).contains(&age_us), "{age_us}");
}
