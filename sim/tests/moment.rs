//! Angle and rates of the moment by the variant with a gyroscope, as a foreign master reads them.
//!
//! In: two nodes without errors of their own on the motor of the bench, SYNC every 20 ms. A master
//! switches TPDO 5 and 6 on, which are off as delivered, and has that saved. Out: what they carry
//! while the motor turns at 40 deg/s, against where it was at that SYNC; TPDO 1 stays the aligned
//! angle that it is in the product. Nothing was calibrated, so the uncertainty is that of the
//! part's data sheet.

mod recorded;

use canopen::Frame;
use device::calibration::deliver;
use device::factory::DYNAMIC_LATENCY_US;
use device::objects::table::Channel;
use sim::bench::{Mode, World};
use sim::can_bus::{Event, Port};
use sim::error_model::ErrorModel;
use sim::memory;
use sim::network::Network;
use sim::network::instrument::{Delivered, Fitting};
use sim::rig::{Mount, Rig, RigSetup};
use sim::rng::Rng;
use tilt::chain::Calibration;
use tilt::rate::RateCorrection;

use recorded::Recorded;

const SYNC_NS: u64 = 20_000_000;
const SPEED_DEG_S: f64 = 40.0;

const WORLD: World = World {
    parts: ErrorModel::PERFECT,
    rig: RigSetup::PERFECT,
    ..World::NOMINAL
};

struct OnTheBus {
    network: Network,
    host: Port,
    nodes: [usize; 2],
    motor: Recorded,
}

/// The PDOs of one node at one SYNC, whose time is `sync_s`.
#[derive(Clone, Copy, Debug, Default)]
struct Told {
    sync_s: f64,
    aligned: Option<[i16; 2]>,
    now: Option<([i16; 2], u16, [u8; 2])>,
    rates: Option<([i16; 3], u8)>,
}

fn number(bytes: &[u8], place: usize) -> i16 {
    i16::from_le_bytes([bytes[2 * place], bytes[2 * place + 1]])
}

impl Told {
    fn take(&mut self, kind: u16, bytes: &[u8]) {
        if !matches!(kind, 0x180 | 0x200 | 0x300) {
            return;
        }
        let [x, y] = [0, 1].map(|place| number(bytes, place));
        match kind {
            0x180 => self.aligned = Some([x, y]),
            0x200 => {
                assert_eq!(bytes.len(), 8);
                let uncertainty = number(bytes, 2) as u16;
                self.now = Some(([x, y], uncertainty, [bytes[6], bytes[7]]));
            }
            _ => {
                assert_eq!(bytes.len(), 7);
                self.rates = Some(([x, y, number(bytes, 2)], bytes[6]));
            }
        }
    }
}

impl OnTheBus {
    fn new() -> Self {
        let delivered = Delivered::bare(Mode::Dynamic, &WORLD, 1, 1);
        let mut network = Network::new(250_000, 1);
        let host = network.attach_host();
        let calibration = Calibration {
            rates: Some(RateCorrection::IDENTITY),
            ..WORLD.settings(Mode::Dynamic).chain.calibration
        };
        let fittings = [Channel::A, Channel::B].map(|channel| {
            let mut memory = memory::blank();
            deliver(&mut memory, &calibration).expect("room");
            Fitting {
                node_id: channel.node_id(),
                kbit_s: 250,
                memory,
            }
        });
        let nodes = delivered.join(&mut network, fittings);
        let mut rig = Rig::new(&WORLD.rig, &mut Rng::stream(1, "bench"));
        rig.remount(Mount::X, 0.0, 0.0);
        nodes.iter().for_each(|node| network.power_on(*node));
        let mut bus = Self {
            network,
            host,
            nodes,
            motor: Recorded::new(rig),
        };
        bus.pass(10);
        bus
    }

    fn offer(&mut self, cob_id: u16, data: &[u8]) {
        let frame = Frame::data_frame(cob_id, data);
        self.network.bus.offer(self.host, frame).expect("room");
    }

    /// So many SYNCs; what both nodes told at each of them.
    fn pass(&mut self, syncs: u32) -> Vec<[Told; 2]> {
        let one = |_| {
            self.offer(0x80, &[]);
            let until_ns = self.network.now_ns() + SYNC_NS;
            let mut told = [Told::default(); 2];
            self.network.run_until(&mut self.motor, until_ns, |event| {
                let Event::Delivered { frame, at_ns, .. } = event else {
                    return;
                };
                match frame.cob_id() {
                    Some(0x80) => told
                        .iter_mut()
                        .for_each(|t| t.sync_s = *at_ns as f64 * 1e-9),
                    Some(id) if (1..=2).contains(&(id & 0x7F)) => {
                        told[usize::from(id & 0x7F) - 1].take(id & 0x780, frame.bytes());
                    }
                    _ => {}
                }
            });
            told
        };
        (0..syncs).map(one).collect()
    }

    /// Writes a number of 32 bit into an object of a node.
    fn write(&mut self, node_id: u8, index: u16, sub: u8, number: u32) {
        let [low, high] = index.to_le_bytes();
        let mut request = [0x23, low, high, sub, 0, 0, 0, 0];
        request[4..].copy_from_slice(&number.to_le_bytes());
        self.offer(0x600 + u16::from(node_id), &request);
        let until_ns = self.network.now_ns() + 500_000_000;
        let mut answer = None;
        self.network.run_until(&mut self.motor, until_ns, |event| {
            if let Event::Delivered { frame, .. } = event
                && frame.cob_id() == Some(0x580 + u16::from(node_id))
            {
                answer = Some(frame.bytes()[0]);
            }
        });
        assert_eq!(answer, Some(0x60), "{index:04X}h sub {sub}");
    }

    fn start(&mut self) {
        self.offer(0, &[1, 0]);
        self.pass(150);
    }

    /// As a master sets both nodes up once.
    fn switch_on(&mut self) {
        for node_id in [1, 2] {
            self.write(node_id, 0x1804, 1, 0x200 + u32::from(node_id));
            self.write(node_id, 0x1805, 1, 0x300 + u32::from(node_id));
            self.write(node_id, 0x1010, 1, u32::from_le_bytes(*b"save"));
        }
    }
}

#[test]
fn the_two_tpdos_are_off_as_delivered_and_stay_on_once_saved() {
    let mut bus = OnTheBus::new();
    bus.start();
    let told = bus.pass(5);
    let silent = |t: &Told| t.aligned.is_some() && t.now.is_none() && t.rates.is_none();
    assert!(told.iter().flatten().all(silent), "{told:?}");
    bus.offer(0, &[0x80, 0]);
    bus.switch_on();
    for node in bus.nodes {
        bus.network.power_off(node);
        bus.network.power_on(node);
    }
    bus.pass(50);
    bus.start();
    let told = bus.pass(5);
    let speaks = |t: &Told| t.aligned.is_some() && t.now.is_some() && t.rates.is_some();
    assert!(told.iter().flatten().all(speaks), "{told:?}");
}

#[test]
fn while_it_turns_they_carry_angle_and_rate_of_that_sync_and_tpdo_1_the_aligned_angle() {
    let mut bus = OnTheBus::new();
    bus.switch_on();
    bus.start();
    let at_rest = bus.pass(5);
    for Told { now, rates, .. } in at_rest.iter().flatten() {
        assert!(
            matches!(now, Some(([-1..=1, -1..=1], 1..2000, [0, 0]))),
            "{now:?}"
        );
        assert!(
            matches!(rates, Some(([-5..=5, -5..=5, -5..=5], 0))),
            "{rates:?}"
        );
    }
    bus.motor.rig.command(60.0, SPEED_DEG_S).expect("it stands");
    // Past the ramp, and up to the other.
    bus.pass(20);
    let told = bus.pass(30);
    let latency_s = f64::from(DYNAMIC_LATENCY_US) * 1e-6;
    for Told {
        sync_s,
        aligned,
        now,
        rates,
    } in told.iter().flatten()
    {
        let (truth, before) = (bus.motor.at(*sync_s), bus.motor.at(sync_s - latency_s));
        assert!(truth - before > 0.19, "it turns");
        let deg = |slope: i16| f64::from(slope) / 100.0;
        let ([x, y], uncertainty, reasons) = now.expect("TPDO 5");
        assert!((deg(x) - truth).abs() < 0.1, "{} {truth}", deg(x));
        assert!(
            deg(y).abs() < 0.1 && uncertainty < 2000,
            "{y} {uncertainty}"
        );
        let [x, _] = aligned.expect("TPDO 1");
        assert!((deg(x) - before).abs() < 0.1, "{} {before}", deg(x));
        // Slope X rises as the housing turns the negative way about Y.
        let ([x, y, z], reason) = rates.expect("TPDO 6");
        assert!((deg(y) + SPEED_DEG_S).abs() < 0.2, "{y}");
        assert!(deg(x).abs() < 0.1 && deg(z).abs() < 0.1, "{x} {z}");
        assert_eq!((reasons, reason), ([0, 0], 0));
    }
}
