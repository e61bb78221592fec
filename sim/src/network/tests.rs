//! Two nodes on one bus, as a master and the world see them.

mod erases;
mod faulty;
mod preempted;
mod safety;
mod stale;

use super::*;

use canopen::Frame;
use canopen::nmt::State;
use canopen::object::Value;
use device::calibration::deliver;
use device::calibration::motor::{MOTOR, TableSettings};
use device::fault::Fault;
use device::objects::device_objects::Identity;
use device::objects::process::SyncSource;
use device::objects::table::{Channel, Models};
use device::records::{Record, RecordStore, parameters};
use tilt::chain::Calibration;
use tilt::uncertainty::{Budget, Span, Uncertainty};

use crate::bench::Mode;
use crate::can_bus::Rates;
use crate::error_model::ErrorModel;
use crate::memory;
use crate::motion::{Attitude, Motion};
use crate::rng::Rng;

const MS: u64 = 1_000_000;

/// A housing that turns about one axis at a steady rate; slope X follows.
struct Turning {
    rate_deg_s: f64,
    from_s: f64,
}

fn level() -> Turning {
    Turning {
        rate_deg_s: 0.0,
        from_s: 0.0,
    }
}

impl Turning {
    fn slope_deg(&self, time_s: f64) -> f64 {
        self.rate_deg_s * (time_s - self.from_s).max(0.0)
    }
}

impl Mover for Turning {
    fn step(&mut self, time_s: f64) -> Motion {
        let slope_x_deg = self.slope_deg(time_s);
        let (sin, cos) = slope_x_deg.to_radians().sin_cos();
        Motion {
            force_g: [sin, 0.0, cos],
            rate_dps: [0.0; 3],
            attitude: Attitude {
                slope_x_deg,
                ..Attitude::default()
            },
        }
    }
}

fn factory(channel: Channel, kbit_s: u16) -> Factory {
    let mut settings = Mode::Product.settings();
    settings.noise = ErrorModel::PERFECT.known_noise();
    Factory {
        identity: Identity {
            channel,
            serial: 100 + channel as u32,
            models: Models::WHOLE,
        },
        node_id: channel.node_id(),
        kbit_s,
        table_settings: TableSettings {
            rule: tilt::table::Rule::Nearest,
            reference: MOTOR,
        },
        setup: settings.setup(),
    }
}

/// The memory of a perfect part as it left the factory.
fn delivered() -> Memory {
    let mut memory = memory::blank();
    let calibration = Calibration {
        budget: Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::CHAMBER),
        ..Calibration::NOMINAL
    };
    deliver(&mut memory, &calibration).unwrap();
    memory
}

/// Two nodes with perfect parts but clocks of their own, powered, on a bus with a host.
struct Site {
    network: Network,
    host: Port,
    trace: Vec<(u64, Frame)>,
}

impl Site {
    fn new(kbit_s: u16) -> Self {
        let mut network = Network::new(u32::from(kbit_s) * 1000, 1);
        for channel in [Channel::A, Channel::B] {
            let rng = Rng::stream(1, &format!("network {channel:?}"));
            let electronics = Electronics::new(&ErrorModel::PERFECT, rng);
            let check = Mode::Product.check();
            network.add(electronics, check, factory(channel, kbit_s), delivered());
        }
        let host = network.attach_host();
        network.power_on(0);
        network.power_on(1);
        Self {
            network,
            host,
            trace: Vec::new(),
        }
    }

    fn run(&mut self, mover: &mut impl Mover, duration_ns: u64) {
        let until_ns = self.network.now_ns() + duration_ns;
        let trace = &mut self.trace;
        self.network.run_until(mover, until_ns, |event| {
            if let Event::Delivered { frame, at_ns, .. } = event {
                trace.push((*at_ns, *frame));
            }
        });
    }

    fn send(&mut self, id: u16, bytes: &[u8]) {
        let frame = Frame::data_frame(id, bytes);
        self.network.bus.offer(self.host, frame).unwrap();
    }

    /// Past the set-up and the settling of the filters, everybody OPERATIONAL.
    fn working(kbit_s: u16) -> Self {
        let mut site = Self::new(kbit_s);
        site.run(&mut level(), 600 * MS);
        site.send(0, &[1, 0]);
        site.run(&mut level(), 10 * MS);
        site
    }

    fn times_of(&self, id: u16) -> Vec<u64> {
        let of = |(at, frame): &(u64, Frame)| (frame.cob_id() == Some(id)).then_some(*at);
        self.trace.iter().filter_map(of).collect()
    }

    fn state(&self, node: usize) -> u8 {
        self.network.shown(node).state()
    }

    fn process(&self, node: usize) -> device::objects::process::Process {
        self.network.nodes()[node].device.values().process
    }
}

#[test]
fn a_pair_boots_measures_and_agrees() {
    let mut site = Site::working(250);
    let boots: Vec<_> = site.trace.iter().take(2).map(|(_, f)| *f).collect();
    let boot = |id| Frame::data_frame(id, &[0]);
    assert_eq!(boots, [boot(0x701), boot(0x702)]);
    for _ in 0..50 {
        site.send(0x80, &[]);
        site.run(&mut level(), 20 * MS);
    }
    for node in 0..2 {
        let process = site.process(node);
        let shown = site.network.shown(node);
        assert_eq!(shown.state(), 1, "{process:?}");
        assert_eq!(shown.validity(), 0x7F, "{process:?}");
        assert_eq!(process.missed, 0);
        assert!(shown.delta()[0].abs() < 20, "{process:?}");
        assert!(site.network.nodes()[node].device.faults().is_empty());
    }
    assert_eq!(site.times_of(0x181).len(), 50);
    assert_eq!(site.times_of(0x281).len(), 5);
}

#[test]
fn both_nodes_report_the_same_instant_within_a_tenth_of_a_millisecond() {
    let mut site = Site::working(250);
    let rate_deg_s = 80.0;
    let mut turning = Turning {
        rate_deg_s,
        from_s: site.network.now_s(),
    };
    site.run(&mut turning, 300 * MS);
    for _ in 0..25 {
        site.send(0x80, &[]);
        site.run(&mut turning, 20 * MS);
        let [x, y] = [0, 1].map(|node| site.process(node).sent.angle[0]);
        let apart_deg = f64::from(x - y) * 360.0 / f64::from(1 << 24);
        let skew_ms = apart_deg.abs() / rate_deg_s * 1000.0;
        assert!(skew_ms < 0.1, "{skew_ms} ms");
    }
}

#[test]
fn at_1_khz_every_reading_goes_out_within_its_sync_window() {
    let mut site = Site::working(1000);
    site.trace.clear();
    for _ in 0..1000 {
        site.send(0x80, &[]);
        site.run(&mut level(), MS);
    }
    let syncs = site.times_of(0x80);
    assert_eq!(syncs.len(), 1000);
    let mut latest_ns = 0;
    for id in [0x181, 0x182, 0x381, 0x382] {
        let sent = site.times_of(id);
        assert_eq!(sent.len(), 1000, "{id:X}");
        for (sync, sent) in syncs.iter().zip(&sent) {
            latest_ns = latest_ns.max(sent - sync);
        }
    }
    println!("1 kHz SYNC at 1 Mbit/s: the last of the pair's PDOs ends {latest_ns} ns after SYNC");
    assert!(latest_ns < MS);
    assert_eq!(site.times_of(0x281).len(), 100);
    for node in 0..2 {
        let process = site.process(node);
        assert_eq!((site.state(node), process.missed), (1, 0));
        assert_eq!(process.bus.overruns, 0);
    }
}

#[test]
fn without_sync_the_lower_node_id_makes_it_and_the_other_one_after_it() {
    let mut site = Site::working(250);
    site.run(&mut level(), 480 * MS);
    assert_eq!(site.times_of(0x80).len(), 0);
    site.run(&mut level(), 520 * MS);
    let own = site.times_of(0x80);
    assert!((20..30).contains(&own.len()), "{}", own.len());
    assert_eq!(site.process(0).source, SyncSource::Own);
    assert_eq!(site.process(1).source, SyncSource::Bus);
    // A master's SYNC ends it.
    site.send(0x80, &[]);
    site.run(&mut level(), 400 * MS);
    assert!(site.times_of(0x80).len() <= own.len() + 2);
    assert_eq!(site.process(0).source, SyncSource::Bus);
    // The lower one is gone: the other takes over after twice the time.
    site.network.power_off(0);
    let before = site.times_of(0x80).len();
    site.run(&mut level(), 500 * MS);
    assert_eq!(site.times_of(0x80).len(), before);
    site.send(0, &[1, 2]);
    site.run(&mut level(), 1500 * MS);
    assert!(site.times_of(0x80).len() > before + 10);
}

#[test]
fn a_silent_peer_is_reported_and_counts_again_when_it_returns() {
    let mut site = Site::working(250);
    let sync = |site: &mut Site, count: usize| {
        for _ in 0..count {
            site.send(0x80, &[]);
            site.run(&mut level(), 20 * MS);
        }
    };
    sync(&mut site, 10);
    site.network.power_off(1);
    sync(&mut site, 50);
    let faults = site.network.nodes()[0].device.faults();
    assert!(faults.has(Fault::PeerChannel), "{faults:?}");
    // EMCY of the lost heartbeat and of the channel; this one goes on (1029h).
    let told: Vec<_> = (site.trace.iter())
        .filter(|(_, f)| f.cob_id() == Some(0x81))
        .map(|(_, f)| u16::from_le_bytes([f.bytes()[0], f.bytes()[1]]))
        .collect();
    assert!(
        told.contains(&0x8130) && told.contains(&0xFF15),
        "{told:X?}"
    );
    assert_eq!(
        site.network.nodes()[0].device.bus().state(),
        State::Operational
    );
    site.network.power_on(1);
    site.run(&mut level(), 1000 * MS);
    site.send(0, &[1, 0]);
    site.run(&mut level(), 10 * MS);
    sync(&mut site, 60);
    assert_eq!(site.state(0), 1, "{:?}", site.process(0));
    assert!(site.network.nodes()[0].device.faults().is_empty());
}

#[test]
fn bus_off_is_reported_counted_and_left_again() {
    let mut site = Site::working(250);
    let every = Rates {
        corrupt: 1.0,
        ..Rates::default()
    };
    site.network.bus.faults().set_rates(every);
    site.run(&mut level(), 400 * MS);
    let off = site.process(0).bus;
    assert_eq!((off.state, off.bus_offs), (2, 1), "{off:?}");
    site.network.bus.faults().set_rates(Rates::default());
    site.trace.clear();
    // 2051h as delivered: 1 s until the attempt to return.
    site.run(&mut level(), 1500 * MS);
    let back = site.process(0).bus;
    assert_eq!((back.state, back.bus_offs), (0, 1), "{back:?}");
    let told = site.trace.iter().filter(|(_, f)| f.cob_id() == Some(0x81));
    let codes: Vec<_> = told
        .map(|(_, f)| u16::from_le_bytes([f.bytes()[0], f.bytes()[1]]))
        .collect();
    assert!(codes.contains(&0x8140), "{codes:X?}");
    site.send(0, &[1, 0]);
    site.run(&mut level(), 900 * MS);
    assert!(site.times_of(0x181).len() > 5);
}

#[test]
fn a_node_finds_the_bit_rate_by_listening_and_disturbs_nobody() {
    let mut network = Network::new(125_000, 1);
    let electronics = Electronics::new(&ErrorModel::PERFECT, Rng::stream(1, "finder"));
    let mut memory = memory::blank();
    RecordStore::begin(
        &mut memory,
        Record::Manufacturer,
        Record::Manufacturer.longest(),
    )
    .unwrap();
    let automatic = canopen::object::at(0x2053, 2);
    parameters::put(&mut memory, automatic, &Value::u8(1)).unwrap();
    RecordStore::commit(&mut memory).unwrap();
    let factory = factory(Channel::A, 1000);
    network.add(electronics, Mode::Product.check(), factory, memory);
    let (host, other) = (network.attach_host(), network.attach_host());
    let _ = other;
    network.power_on(0);
    let mut site = Site {
        network,
        host,
        trace: Vec::new(),
    };
    for _ in 0..60 {
        site.send(0x70A, &[5]);
        site.run(&mut level(), 100 * MS);
    }
    assert_eq!(site.times_of(0x70A).len(), 60);
    assert_eq!(site.network.bus.statistics().errors, 0);
    assert!(site.times_of(0x701).len() > 10);
    assert_eq!(site.network.nodes()[0].device.values().bit_rate, 125);
}

#[test]
fn a_sync_is_not_held_up_by_what_waits_behind_a_flood() {
    let mut site = Site::working(250);
    // Node 1 makes SYNC; everything else that it sends has a higher number than the flood.
    site.run(&mut level(), 600 * MS);
    let flood = Frame::data_frame(0x100, &[0; 8]);
    site.network.bus.babble(site.host, Some(flood));
    site.run(&mut level(), 100 * MS);
    site.trace.clear();
    site.run(&mut level(), 1000 * MS);
    assert_eq!(site.times_of(0x80).len(), 50);
    assert_eq!(site.times_of(0x181).len(), 0);
}

#[test]
fn the_same_seed_gives_the_same_bus() {
    let run = || {
        let mut site = Site::working(250);
        site.run(&mut level(), 1000 * MS);
        site.network.bus.fingerprint()
    };
    assert_eq!(run(), run());
}

/// A sample that is missed is asked after when it is, not at the next look at everything.
#[test]
fn a_part_that_falls_silent_is_noticed_within_5_ms() {
    let mut site = Site::working(250);
    site.run(&mut level(), 1000 * MS);
    let now_ns = site.network.now_ns();
    let chip = site
        .network
        .node(0)
        .electronics
        .lis2dw12()
        .cloned()
        .expect("an LIS2DW12");
    chip.borrow_mut().brown_out(now_ns);
    site.run(&mut level(), 5 * MS);
    let reason = |node: usize| site.network.nodes()[node].device.channel().reason();
    assert_eq!(
        [reason(0), reason(1)],
        [Some(tilt::chain::Invalid::Stale), None]
    );
}
