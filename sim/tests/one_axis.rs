//! A one-axis instrument of 360 deg on its bus, turned about its axis and tilted across it.
//!
//! In: calibrated pairs, poses. Out: what the pair reports of itself where nothing is wrong.

use std::sync::LazyLock;

use canopen::Frame;
use device::fault::Fault;
use sim::bench::{Mode, World};
use sim::can_bus::Port;
use sim::fault::SensorFault;
use sim::memory;
use sim::network::Network;
use sim::network::hand::{Hand, Pose};
use sim::network::instrument::{Delivered, Fitting};
use sim::rng::Rng;

const MS: u64 = 1_000_000;
/// Pairs that are looked at.
const UNITS: u32 = 6;

/// A pair with a master that starts it and sends SYNC every 20 ms.
struct Site {
    network: Network,
    host: Port,
    hand: Hand,
}

impl Site {
    fn new(unit: u32) -> Self {
        static DELIVERED: LazyLock<Vec<Delivered>> = LazyLock::new(|| {
            let one = |unit| Delivered::calibrated(Mode::OneAxis, &World::NOMINAL, 1, unit);
            (0..UNITS)
                .map(|unit| one(unit).expect("a good unit"))
                .collect()
        });
        let fitting = |node_id| Fitting {
            node_id,
            kbit_s: 500,
            memory: memory::blank(),
        };
        let mut network = Network::new(500_000, 1);
        let delivered = DELIVERED[unit as usize].clone();
        delivered.join(&mut network, [fitting(1), fitting(2)]);
        let host = network.attach_host();
        network.power_on(0);
        network.power_on(1);
        let hand = Hand::new(Rng::stream(1, "hand"));
        let mut site = Self {
            network,
            host,
            hand,
        };
        site.hand.set_rate(40.0);
        site
    }

    fn start(&mut self) {
        self.syncs(50);
        self.send(0, &[1, 0]);
    }

    fn send(&mut self, id: u16, bytes: &[u8]) {
        let frame = Frame::data_frame(id, bytes);
        self.network.bus.offer(self.host, frame).expect("a mailbox");
    }

    fn syncs(&mut self, count: u32) {
        for _ in 0..count {
            self.send(0x80, &[]);
            let until_ns = self.network.now_ns() + 20 * MS;
            self.network.run_until(&mut self.hand, until_ns, |_| {});
        }
    }

    fn go(&mut self, pitch_deg: f64, roll_deg: f64) {
        let pose = Pose {
            pitch_deg,
            roll_deg,
        };
        assert!(self.hand.go(pose));
        while !self.hand.is_still() {
            self.syncs(10);
        }
        self.syncs(50);
    }

    /// State, differences and slope X of both.
    fn summary(&self) -> String {
        let of = |number: usize| {
            let shown = self.network.shown(number);
            let slope = shown.slope(0).map(tilt::angle::Angle::degrees);
            format!(
                "{number}: state {}, why {}, delta {:?}, {slope:?}, uncertainty {:?}",
                shown.state(),
                shown.blame().1,
                shown.delta(),
                shown.uncertainty(0)
            )
        };
        format!("{}; {}", of(0), of(1))
    }

    fn agrees(&self) -> bool {
        [0, 1].into_iter().all(|number| {
            let shown = self.network.shown(number);
            let sound = self.network.nodes()[number].device.faults().is_empty();
            shown.state() == 1 && shown.validity() & 1 == 1 && sound
        })
    }
}

#[test]
fn a_one_axis_pair_that_was_tilted_across_accused_itself() {
    for unit in 0..UNITS {
        for pitch in [5.0, 10.0, -20.0, 45.0] {
            // Before the start, when nothing is known of either, and at work.
            let mut site = Site::new(unit);
            site.go(pitch, 0.0);
            site.start();
            site.syncs(300);
            assert!(
                site.agrees(),
                "unit {unit} at {pitch} deg: {}",
                site.summary()
            );
            for roll in [30.0, f64::abs(pitch) - 80.0] {
                site.go(pitch, roll);
                site.syncs(150);
                let summary = site.summary();
                assert!(
                    site.agrees(),
                    "unit {unit} at {pitch}, {roll} deg: {summary}"
                );
            }
        }
    }
}

#[test]
fn what_is_left_to_one_axis_finds_an_offset_and_names_nobody() {
    let mut site = Site::new(0);
    site.start();
    site.syncs(150);
    assert!(site.agrees(), "{}", site.summary());
    let bias = SensorFault::Bias { axis: 0, mg: 20.0 };
    let electronics = &mut site.network.node(1).electronics;
    electronics.inject(bias, Rng::stream(1, "bias"));
    site.syncs(50);
    for number in [0, 1] {
        let shown = site.network.shown(number);
        assert_eq!(
            (shown.state(), shown.blame().0),
            (6, 0),
            "{}",
            site.summary()
        );
    }
}

#[test]
fn a_full_turn_is_within_the_range_and_agreed_upon() {
    let mut site = Site::new(0);
    site.start();
    for roll in [90.0, 135.0, 179.9, -90.0, -175.0] {
        site.go(0.0, roll);
        for _ in 0..100 {
            site.syncs(1);
            assert!(site.agrees(), "{roll} deg: {}", site.summary());
        }
        let slope = site.network.shown(0).slope(0).expect("an angle");
        let off = slope
            .minus(tilt::angle::Angle::from_degrees(roll))
            .degrees();
        assert!(off.abs() < 0.2, "{roll} deg: {off}");
        assert!(!site.network.nodes()[0].device.faults().has(Fault::RangeX));
    }
}
