//! One device and a peer that is played: what the pair makes of angles, EMCY, log and safety
//! frames.
//!
//! In: samples of a part whose registers the test holds, SYNCs, and the two exchange frames of a
//! healthy or unhealthy peer. Out: what the device says on the bus.

#[expect(
    dead_code,
    reason = "only the memory of the other tests' site is of use here"
)]
mod site;

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;

use canopen::Frame;
use canopen::node::BusState;
use canopen::object::{Address, Value, at};
use device::calibration::motor::Terms;
use device::channel::Settings;
use device::device::{Device, Factory, Wish};
use device::exchange;
use device::fault::Fault;
use device::objects::panel::Identity;
use device::objects::table::Channel;
use device::sensor::Config;
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use site::Store;
use tilt::angle::{Angle, Axes, Harmonics, slopes};
use tilt::chain::{Calibration, Chain, Correction, Invalid, Measurement, PART_DELAY_Q16, Timing};
use tilt::cross_check::CrossCheck;
use tilt::filter::LowPass;
use tilt::health::Activity;
use tilt::observation::Observation;
use tilt::sample::{FullScale, Instant};
use tilt::table::Rule;
use tilt::temperature::TemperatureModel;
use tilt::uncertainty::{Budget, Uncertainty};
use tilt::vector::{Corrected, Vector};

const SYNC_US: i64 = 20_000;
const SAMPLE_US: i64 = 2_500;
const SAVE: u32 = canopen::storage::SAVE;
/// A slope in 16 bit that is no angle.
const NO_SLOPE: i16 = i16::MIN;

/// A part's registers, which the test may change under the driver.
#[derive(Clone, Debug)]
struct Part(Rc<RefCell<[u8; 64]>>);

impl Part {
    /// Level, always ready, 25 degC.
    fn level() -> Self {
        let mut registers = [0; 64];
        registers[0x0F] = 0x44;
        registers[0x27] = 0x01;
        registers[0x2D] = 0x40;
        Self(Rc::new(RefCell::new(registers)))
    }

    fn set(&self, register: usize, value: u8) {
        self.0.borrow_mut()[register] = value;
    }

    fn warm(&self, celsius: f64) {
        let [low, high] = (((celsius - 25.0) * 256.0) as i16 & !0xF).to_le_bytes();
        self.set(0x0D, low);
        self.set(0x0E, high);
    }

    fn take(&self, bytes: &[u8], address: &mut usize) {
        let Some((first, values)) = bytes.split_first() else {
            return;
        };
        *address = usize::from(first & 0x3F);
        for value in values {
            // CTRL2: boot and soft reset end at once.
            let kept = if *address == 0x21 {
                value & !0xC0
            } else {
                *value
            };
            self.set(*address, kept);
            *address = (*address + 1) & 0x3F;
        }
    }
}

impl ErrorType for Part {
    type Error = Infallible;
}

impl SpiDevice for Part {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        let mut address = 0;
        for operation in operations {
            match operation {
                Operation::Write(bytes) => self.take(bytes, &mut address),
                Operation::Read(bytes) => {
                    for byte in bytes.iter_mut() {
                        *byte = self.0.borrow()[address];
                        address = (address + 1) & 0x3F;
                    }
                }
                other => panic!("the driver does not use {other:?}"),
            }
        }
        Ok(())
    }
}

struct Hurry;

impl DelayNs for Hurry {
    fn delay_ns(&mut self, _ns: u32) {}
}

fn settings() -> Settings {
    let part = Config::PRODUCT;
    let chain = Chain {
        filter: LowPass::PRODUCT,
        full_scale: FullScale::G2,
        period_us: part.rate.period_us(),
        part_delay_q16: PART_DELAY_Q16,
        timing: Timing::Aligned { latency_us: 25_000 },
        calibration: Calibration {
            temperature: TemperatureModel::None,
            correction: Correction::TwoAxis {
                vector: Vector::IDENTITY,
                harmonics: Axes::<Harmonics>::default(),
            },
            budget: Budget::default(),
        },
    };
    // This part's codes stand still, as those of one without noise may.
    Settings {
        part,
        chain,
        noise: 1,
    }
}

fn factory() -> Factory {
    let settings = settings();
    Factory {
        identity: Identity {
            channel: Channel::A,
            serial: 7,
        },
        node_id: 1,
        kbit_s: 250,
        terms: Terms {
            rule: Rule::Nearest,
            budget: settings.chain.calibration.budget,
        },
        settings,
        calibrated: true,
    }
}

/// What a healthy channel says that is tilted about one axis.
fn tilted(degrees: f64) -> Observation {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let vector = Corrected {
        accel: [sin, 0.0, cos].map(|g| (g * f64::from(tilt::ONE_G)) as i32),
    };
    let axis = |angle: Angle| {
        Ok(Measurement {
            angle,
            uncertainty: Uncertainty::from_degrees(0.02),
            unshared: Uncertainty::from_degrees(0.02),
            at: Instant(0),
            latency_us: 25_000,
        })
    };
    let angles = slopes(vector);
    Observation {
        reading: Axes {
            x: axis(angles.x),
            y: axis(angles.y),
        },
        vector: Some(vector),
        activity: Activity::OWN,
    }
}

fn level() -> Observation {
    tilted(0.0)
}

/// The other channel as this test plays it.
#[derive(Clone, Copy, Debug)]
struct Peer {
    says: Observation,
    silent: bool,
    /// Whether the second frame of the exchange comes.
    backed: bool,
}

/// TPDO 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Told {
    slopes: [i16; 2],
    validity: u8,
    state: u8,
}

impl Told {
    fn is_valid(&self) -> bool {
        let marked = self.validity & 3 == 3;
        let shown = !self.slopes.contains(&NO_SLOPE);
        assert_eq!(marked, shown, "value and validity say the same: {self:?}");
        marked
    }
}

/// The device, its part, and the bus with the other channel.
struct Pair {
    device: Device<Part, Store>,
    part: Part,
    peer: Peer,
    now: Instant,
    next_sample: Instant,
    said: Vec<(Instant, Frame)>,
    sensor_restarts: u32,
    /// The controller does not get rid of its frame.
    blocked: bool,
    waiting: Option<Frame>,
    /// The controller is off the bus.
    off: bool,
}

impl Pair {
    /// Powered and settled, not started.
    fn new() -> Self {
        let part = Part::level();
        let mut pair = Self {
            device: Device::new(
                part.clone(),
                CrossCheck::product(),
                factory(),
                Store::default(),
            ),
            part,
            peer: Peer {
                says: level(),
                silent: false,
                backed: true,
            },
            now: Instant(1_000_000),
            next_sample: Instant(1_000_000),
            said: Vec::new(),
            sensor_restarts: 0,
            blocked: false,
            waiting: None,
            off: false,
        };
        pair.device.power_lost();
        pair.boot();
        pair.syncs(40);
        pair
    }

    /// OPERATIONAL, agreeing, with every habit known.
    fn working() -> Self {
        Self::new().at_work()
    }

    fn at_work(mut self) -> Self {
        self.hears(0, &[1, 0]);
        self.syncs(400);
        assert_eq!(self.state(), 1, "{:?}", self.device.values().process);
        assert!(self.told().is_valid());
        self.said.clear();
        self
    }

    fn boot(&mut self) {
        assert_eq!(self.device.start_sensor(&mut Hurry, self.now), Ok(()));
        self.now = self.now.offset(20_000);
        self.next_sample = self.now.offset(SAMPLE_US);
        self.device.start_bus(self.now);
        self.listen();
    }

    /// Time with its samples.
    fn pass(&mut self, us: i64) {
        let until = self.now.offset(us);
        while self.next_sample <= until {
            self.now = self.next_sample;
            self.next_sample = self.now.offset(SAMPLE_US);
            self.device.data_ready(self.now);
            self.listen();
        }
        self.now = until;
    }

    /// Everything the device says now, acknowledged unless the controller is kept from it.
    fn listen(&mut self) {
        self.device.poll(self.now);
        while !self.off {
            let frame = match self.waiting.take() {
                Some(frame) => Some(frame),
                None => self.device.transmit(self.now),
            };
            let Some(frame) = frame else { break };
            if self.blocked {
                self.waiting = Some(frame);
                break;
            }
            self.device.sent(&frame, self.now);
            self.said.push((self.now, frame));
        }
        match self.device.take_wish() {
            Some(Wish::Reset) => self.boot(),
            Some(Wish::Sensor) => {
                self.sensor_restarts += 1;
                let _ = self.device.restart_sensor(&mut Hurry, self.now);
            }
            Some(Wish::BitRate { .. }) | None => {}
        }
    }

    /// A frame from somebody else.
    fn hears(&mut self, id: u16, bytes: &[u8]) {
        if self.off {
            return;
        }
        self.pass(200);
        self.device.receive(&Frame::data_frame(id, bytes), self.now);
        self.listen();
    }

    /// A period with SYNC at its end and what the other channel says to it.
    fn sync(&mut self) {
        let end = self.now.offset(SYNC_US);
        self.pass(SYNC_US - 1000);
        let sync = self.now.offset(200);
        self.hears(0x80, &[]);
        let [first, second] = self.exchange(sync);
        if !self.peer.silent {
            self.hears(0x702, &[5]);
            self.hears(0x382, &first);
            if self.peer.backed {
                self.hears(0x482, &second);
            }
        }
        self.pass(end.micros_since(self.now));
    }

    fn exchange(&self, at: Instant) -> [[u8; 8]; 2] {
        let bytes = exchange::encode(&self.peer.says, at).bytes();
        let (first, second) = bytes.split_at(8);
        [first.try_into().unwrap(), second.try_into().unwrap()]
    }

    fn syncs(&mut self, count: u32) {
        (0..count).for_each(|_| self.sync());
    }

    fn seconds(&mut self, seconds: f64) {
        self.syncs((seconds * 50.0).round() as u32);
    }

    /// SYNCs until TPDO 1 carries no angle; how long that took, s.
    fn until_refused(&mut self, most_s: f64) -> Option<f64> {
        let count = (most_s * 50.0) as u32;
        let found = (0..count).find(|_| {
            self.sync();
            !self.told().is_valid()
        })?;
        Some(f64::from(found + 1) / 50.0)
    }

    /// The bytes of all frames of an identifier.
    fn of(&self, id: u16) -> Vec<Vec<u8>> {
        let of = self
            .said
            .iter()
            .filter(|(_, frame)| frame.cob_id() == Some(id));
        of.map(|(_, frame)| frame.bytes().to_vec()).collect()
    }

    /// The newest TPDO 1.
    fn told(&self) -> Told {
        let frames = self.of(0x181);
        let bytes = frames.last().expect("a TPDO 1");
        let [a, b, c, d, validity, state] = bytes[..] else {
            panic!("{bytes:?}")
        };
        Told {
            slopes: [i16::from_le_bytes([a, b]), i16::from_le_bytes([c, d])],
            validity,
            state,
        }
    }

    /// Error codes of the EMCYs, in their order.
    fn emergencies(&self) -> Vec<u16> {
        let code = |bytes: Vec<u8>| u16::from_le_bytes([bytes[0], bytes[1]]);
        self.of(0x81).into_iter().map(code).collect()
    }

    fn state(&self) -> u8 {
        self.device.values().process.state
    }

    fn has(&self, fault: Fault) -> bool {
        self.device.faults().has(fault)
    }

    fn ask(&mut self, request: [u8; 8]) -> Vec<Vec<u8>> {
        let before = self.of(0x581).len();
        self.hears(0x601, &request);
        self.of(0x581).split_off(before)
    }

    fn write(&mut self, at: Address, value: Value) {
        let [low, high] = at.index.to_le_bytes();
        let mut request = [
            0x23 | (4 - value.bytes().len() as u8) << 2,
            low,
            high,
            at.sub,
            0,
            0,
            0,
            0,
        ];
        request[4..4 + value.bytes().len()].copy_from_slice(value.bytes());
        let answer = self.ask(request).pop().expect("an answer");
        assert_eq!(answer[0], 0x60, "{at:?}: {answer:X?}");
    }

    fn read(&mut self, at: Address) -> u32 {
        let [low, high] = at.index.to_le_bytes();
        let answer = self.ask([0x40, low, high, at.sub, 0, 0, 0, 0]).pop();
        let answer = answer.expect("an answer");
        assert_eq!(answer[0] & 0xF3, 0x43, "{at:?}: {answer:X?}");
        let length = 4 - usize::from(answer[0] >> 2 & 3);
        let mut bytes = [0; 4];
        bytes[..length].copy_from_slice(&answer[4..4 + length]);
        u32::from_le_bytes(bytes)
    }

    /// A segmented upload.
    fn upload(&mut self, at: Address) -> Vec<u8> {
        let [low, high] = at.index.to_le_bytes();
        let answer = self
            .ask([0x40, low, high, at.sub, 0, 0, 0, 0])
            .pop()
            .unwrap();
        assert_eq!(answer[0], 0x41, "{answer:X?}");
        let size = u32::from_le_bytes(answer[4..8].try_into().unwrap());
        let mut bytes = Vec::new();
        for n in 0..10_000 {
            let toggle = (n as u8 & 1) << 4;
            let segment = self
                .ask([0x60 | toggle, 0, 0, 0, 0, 0, 0, 0])
                .pop()
                .unwrap();
            assert_eq!(segment[0] & 0xF0, toggle, "{segment:X?}");
            bytes.extend(&segment[1..8 - usize::from(segment[0] >> 1 & 7)]);
            if segment[0] & 1 == 1 {
                break;
            }
        }
        assert_eq!(bytes.len(), size as usize);
        bytes
    }

    /// A block upload without check sum.
    fn block_upload(&mut self, at: Address) -> Vec<u8> {
        let [low, high] = at.index.to_le_bytes();
        let answer = self
            .ask([0xA0, low, high, at.sub, 127, 0, 0, 0])
            .pop()
            .unwrap();
        assert_eq!(answer[0] & 0xFB, 0xC2, "{answer:X?}");
        let size = u32::from_le_bytes(answer[4..8].try_into().unwrap()) as usize;
        let mut segments = self.ask([0xA3, 0, 0, 0, 0, 0, 0, 0]);
        let mut bytes = Vec::new();
        loop {
            let last = segments.last().expect("segments")[0];
            segments
                .iter()
                .for_each(|segment| bytes.extend(&segment[1..]));
            segments = self.ask([0xA2, last & 0x7F, 127, 0, 0, 0, 0, 0]);
            if last & 0x80 != 0 {
                break;
            }
        }
        let end = segments.pop().unwrap();
        assert_eq!(end[0] & 0xE3, 0xC1, "{end:X?}");
        bytes.truncate(bytes.len() - usize::from(end[0] >> 2 & 7));
        assert_eq!(bytes.len(), size);
        self.ask([0xA1, 0, 0, 0, 0, 0, 0, 0]);
        bytes
    }

    fn set_policy(mut self, latch_s: u16, degraded: u8) -> Self {
        self.write(at(0x2004, 0), Value::u16(latch_s));
        self.write(at(0x2005, 0), Value::u8(degraded));
        self
    }

    /// The part has lost its supply and is in power-down.
    fn brown_out(&self) {
        self.part.set(0x20, 0);
    }

    /// Safety frames within a second.
    fn safety_frames(&mut self) -> usize {
        let before = self.of(0x101).len();
        self.seconds(1.0);
        self.of(0x101).len() - before
    }
}

#[test]
fn angles_are_shown_as_measured_until_somebody_works_by_them() {
    let mut pair = Pair::new();
    assert_eq!(pair.read(at(0x6010, 0)), 0);
    assert_eq!(pair.read(at(0x2020, 0)) & 3, 3);
}

#[test]
fn in_operational_an_angle_counts_when_it_was_compared_once() {
    let mut pair = Pair::new();
    pair.peer.silent = true;
    pair.hears(0, &[1, 0]);
    for _ in 0..50 {
        pair.sync();
        assert!(!pair.told().is_valid(), "{:?}", pair.told());
        assert_eq!(pair.read(at(0x2025, 1)), 18);
    }
    pair.peer.silent = false;
    pair.syncs(2);
    assert!(
        pair.told().is_valid() && pair.told().state == 1,
        "{:?}",
        pair.told()
    );
    assert_eq!(pair.read(at(0x2025, 1)), 0);
}

#[test]
fn a_peer_that_never_speaks_leaves_an_angle_that_says_so() {
    for (degraded, valid) in [(1, true), (0, false)] {
        let mut pair = Pair::new().set_policy(0, degraded);
        pair.peer.silent = true;
        pair.hears(0, &[1, 0]);
        pair.seconds(4.0);
        let told = pair.told();
        assert_eq!((told.is_valid(), told.state), (valid, 8), "{told:?}");
        assert!(pair.has(Fault::PeerChannel));
    }
}

#[test]
fn a_disagreement_takes_the_angles_away_until_a_reset() {
    let mut pair = Pair::working();
    pair.peer.says = tilted(2.0);
    let after = pair.until_refused(1.0);
    assert!(after.is_some_and(|s| s <= 0.3), "{after:?}");
    pair.syncs(2);
    assert_eq!(pair.told().state, 6);
    assert_eq!(pair.read(at(0x2025, 1)), 17);
    assert_eq!(pair.read(at(0x2027, 1)), 0, "nobody is named");
    pair.peer.says = level();
    pair.seconds(10.0);
    let told = pair.told();
    assert!(!told.is_valid() && told.validity & 0x80 != 0, "{told:?}");
    pair.hears(0, &[129, 1]);
    pair.seconds(1.0);
    let pair = pair.at_work();
    assert!(pair.device.faults().is_empty());
}

#[test]
fn an_emcy_tells_faults_blame_and_state_and_its_end_is_told_too() {
    let mut pair = Pair::new().set_policy(1, 1).at_work();
    pair.peer.says = tilted(2.0);
    pair.seconds(1.0);
    let told = pair.of(0x81);
    // FF13h, register: any and device-specific, fault 12, nobody blamed, state 6.
    assert_eq!(told, [[0x13, 0xFF, 0x81, 0, 0x10, 0, 0, 6]]);
    pair.peer.says = level();
    pair.seconds(3.0);
    assert_eq!(pair.of(0x81)[1..], [[0, 0, 0, 0, 0, 0, 0, 1]]);
    assert!(pair.told().is_valid());
}

#[test]
fn a_peer_s_own_word_is_told_with_its_reason() {
    let mut pair = Pair::working();
    pair.peer.says = level().refused(Invalid::Noise);
    pair.seconds(0.5);
    // FF15h: fault 14; the peer is blamed for noise; state 8.
    assert_eq!(
        pair.of(0x81),
        [[0x15, 0xFF, 0x81, 0, 0x40, 0, 2 << 6 | 10, 8]]
    );
    assert_eq!(
        (pair.read(at(0x2027, 1)), pair.read(at(0x2027, 2))),
        (2, 10)
    );
    // It takes its word back, and a second later it counts again: its latch is its own.
    pair.peer.says = level();
    pair.seconds(1.5);
    assert_eq!(pair.emergencies(), [0xFF15, 0]);
    assert_eq!(pair.told().state, 1);
}

#[test]
fn one_channel_alone_works_on_or_does_not() {
    for (degraded, valid) in [(1, true), (0, false)] {
        let mut pair = Pair::new().set_policy(0, degraded).at_work();
        pair.peer.says = level().refused(Invalid::PartReset);
        pair.seconds(0.5);
        let told = pair.told();
        assert_eq!((told.is_valid(), told.state), (valid, 8), "{told:?}");
        let reason = if valid { 0 } else { 19 };
        assert_eq!(pair.read(at(0x2025, 1)), reason);
    }
}

#[test]
fn a_brown_out_takes_the_channel_s_own_angles_and_tells_the_peer_why() {
    let mut pair = Pair::working();
    pair.brown_out();
    let after = pair.until_refused(1.0);
    assert!(after.is_some_and(|s| s <= 0.14), "{after:?}");
    pair.syncs(2);
    assert_eq!(pair.told().state, 7);
    assert_eq!((pair.read(at(0x2027, 1)), pair.read(at(0x2027, 2))), (1, 7));
    let exchange = pair.of(0x381).pop().unwrap();
    assert_eq!(exchange[6..], [7, 7], "quality: the reason");
    let mut told = pair.emergencies();
    told.sort_unstable();
    assert_eq!(told, [0x3200, 0xFF14]);
    // As delivered nothing is mended before a reset.
    pair.seconds(30.0);
    assert_eq!(pair.sensor_restarts, 0);
    assert!(!pair.told().is_valid());
    assert!(pair.told().validity & 0x80 != 0);
    pair.hears(0, &[129, 1]);
    pair.seconds(1.0);
    assert!(pair.at_work().device.faults().is_empty());
}

#[test]
fn with_a_latch_time_the_sensor_is_set_up_anew() {
    let mut pair = Pair::new().set_policy(2, 1).at_work();
    pair.brown_out();
    pair.seconds(1.9);
    assert_eq!(pair.sensor_restarts, 0);
    pair.seconds(0.4);
    assert_eq!(pair.sensor_restarts, 1);
    pair.seconds(4.0);
    assert!(pair.told().is_valid(), "{:?}", pair.told());
    assert_eq!(pair.sensor_restarts, 1);
    assert!(pair.device.faults().is_empty());
    assert_eq!(pair.emergencies().last(), Some(&0));
    assert_eq!(
        pair.of(0x81).last().unwrap()[2],
        0,
        "the error register is clear"
    );
}

#[test]
fn a_flipped_bit_of_the_calibration_is_told_within_half_a_second() {
    for bit in [0, 7, 15, 25] {
        let mut pair = Pair::working();
        let calibration = &mut pair.device.settings_mut().chain.calibration;
        let Correction::TwoAxis { vector, .. } = &mut calibration.correction else {
            panic!("two axes")
        };
        vector.matrix[1][0] ^= 1 << bit;
        let after = pair.until_refused(0.5);
        assert!(after.is_some(), "bit {bit}: {:?}", pair.told());
        pair.syncs(2);
        assert_eq!(pair.read(at(0x2025, 1)), 14);
        assert!(
            pair.emergencies().contains(&0xFF21),
            "{:X?}",
            pair.emergencies()
        );
        assert!(pair.told().validity & 0x80 != 0);
    }
}

#[test]
fn a_temperature_that_jumps_is_no_temperature() {
    for step in [-5.0, 5.0] {
        let mut pair = Pair::working();
        pair.part.warm(25.0 + step);
        assert!(pair.until_refused(0.6).is_some(), "{step}");
        pair.syncs(2);
        assert_eq!(pair.read(at(0x2025, 1)), 12);
        assert!(pair.emergencies().contains(&0xFF07));
    }
    // A die that warms up in the sun is believed.
    let mut pair = Pair::working();
    for n in 0..1200 {
        pair.part
            .warm(25.0 + 5.0 / 60.0 * f64::from(n) / 50.0 * 3.0);
        pair.sync();
        assert!(pair.told().is_valid(), "{n}");
    }
}

#[test]
fn without_the_second_frame_the_angles_are_compared_alone() {
    let mut pair = Pair::working();
    let missed = pair.device.values().process.missed;
    pair.peer.backed = false;
    pair.seconds(5.0);
    assert!(
        pair.told().is_valid() && pair.told().state == 1,
        "{:?}",
        pair.told()
    );
    assert_eq!(pair.device.values().process.missed, missed);
    pair.peer.says = tilted(1.0);
    pair.seconds(0.5);
    assert_eq!(pair.told().state, 6);
    assert!(!pair.told().is_valid());
}

#[test]
fn a_peer_that_falls_silent_is_told_and_comes_back_by_itself() {
    let mut pair = Pair::working();
    pair.peer.silent = true;
    pair.syncs(2);
    assert_eq!(pair.told().state, 1, "two may be missed");
    pair.syncs(4);
    assert_eq!(pair.told().state, 8);
    assert_eq!(pair.read(at(0x2027, 2)), 15);
    pair.seconds(5.0);
    pair.peer.silent = false;
    pair.seconds(0.9);
    assert_eq!(pair.told().state, 8);
    pair.seconds(0.4);
    assert_eq!(pair.told().state, 1);
    assert!(pair.device.faults().is_empty());
}

#[test]
fn a_peer_s_boot_up_ends_what_is_held_against_it() {
    let noisy = Observation {
        activity: Activity(130),
        ..level()
    };
    let mut pair = Pair::working();
    pair.peer.says = noisy;
    pair.seconds(1.0);
    pair.peer.says = level();
    pair.seconds(10.0);
    assert_eq!(pair.told().state, 8, "latched here");
    pair.hears(0x702, &[0]);
    pair.seconds(1.0);
    assert_eq!(pair.told().state, 1);
    assert_eq!(pair.emergencies(), [0xFF15, 0]);
}

#[test]
fn a_channel_whose_frames_go_out_late_takes_its_angles_back() {
    let mut pair = Pair::working();
    // Each frame leaves the controller some SYNCs after it was handed over.
    for _ in 0..10 {
        pair.blocked = true;
        pair.syncs(4);
        pair.blocked = false;
        pair.listen();
    }
    assert_eq!(pair.state(), 7, "{:?}", pair.device.values().process);
    assert_eq!(pair.device.values().process.why, 16);
    assert!(!pair.told().is_valid());
    pair.seconds(2.0);
    assert!(
        pair.told().is_valid() && pair.told().state == 1,
        "{:?}",
        pair.told()
    );
}

#[test]
fn who_is_off_the_bus_blames_nobody_else() {
    let mut pair = Pair::working();
    pair.device.bus_state(BusState::Off, 255, 0, pair.now);
    pair.off = true;
    for n in 0..250 {
        pair.sync();
        assert_ne!(pair.state(), 8, "{n}");
        assert!(!pair.has(Fault::PeerChannel), "{n}");
    }
    let process = &pair.device.values().process;
    assert_eq!(
        process.validity & 3,
        0,
        "nobody has compared it: {process:?}"
    );
    pair.device.bus_state(BusState::Active, 0, 0, pair.now);
    pair.off = false;
    pair.hears(0, &[1, 0]);
    pair.seconds(3.0);
    assert_eq!(pair.told().state, 1);
    assert!(pair.told().is_valid());
    assert!(
        !pair.emergencies().contains(&0xFF15),
        "{:X?}",
        pair.emergencies()
    );
}

#[test]
fn the_paper_s_rule_is_taken_at_the_next_reset() {
    let mut pair = Pair::new();
    pair.write(at(0x2003, 0), Value::u8(1));
    pair.write(at(0x1010, 1), Value::u32(SAVE));
    let mut pair = pair.at_work();
    pair.peer.says = tilted(1.0);
    pair.seconds(1.0);
    assert_eq!(pair.told().state, 6, "still the product's");
    pair.hears(0, &[129, 1]);
    pair.peer.says = level();
    pair.seconds(1.0);
    let mut pair = pair.at_work();
    pair.peer.says = tilted(1.0);
    pair.seconds(1.0);
    assert_eq!(pair.told().state, 2);
    assert!(pair.told().is_valid(), "a warning is part of the work");
    assert_eq!(pair.emergencies(), [0_u16; 0]);
    pair.seconds(1.5);
    assert_eq!(pair.told().state, 3);
    assert_eq!(pair.emergencies(), [0xFF11]);
}

#[test]
fn log_and_black_box_hold_the_event_and_what_was_on_the_bus_around_it() {
    let mut pair = Pair::working();
    pair.seconds(1.0);
    pair.peer.says = tilted(2.0);
    pair.seconds(2.0);
    let log = pair.upload(at(0x2070, 0));
    assert_eq!(log[..2], [1, 20]);
    let entry = &log[4..24];
    assert_eq!(entry[8..10], [0x13, 0xFF]);
    assert_eq!(
        entry[10..18],
        [0, 0x10, 0, 0, 6, 0, 0, 1],
        "faults, state, blame, box"
    );
    let black_box = pair.upload(at(0x2071, 1));
    assert_eq!(black_box[..4], [1, 34, 32, 16]);
    assert_eq!(black_box[4..8], 20_000_u32.to_le_bytes());
    assert_eq!(black_box[8..28], *entry);
    let frames: Vec<&[u8]> = black_box[28..].chunks(34).collect();
    assert_eq!(frames.len(), 48);
    assert_eq!((frames[30][32], frames[31][32], frames[32][32]), (1, 6, 6));
    // Both halves of what this channel said, one SYNC after the other, are on the bus's record.
    for (id, from) in [(0x381, 0), (0x481, 8)] {
        let said = pair.of(id);
        let kept: Vec<&[u8]> = frames.iter().map(|frame| &frame[from..from + 8]).collect();
        let mut runs = said.windows(kept.len());
        assert!(
            runs.any(|run| run.iter().eq(kept.iter().copied())),
            "{id:X}"
        );
    }
    // The peer's angle before and after it went off.
    let angle = |frame: &[u8]| i32::from_le_bytes([0, frame[16], frame[17], frame[18]]);
    assert_eq!(angle(frames[0]), 0);
    let off = Angle(angle(frames[47])).degrees();
    assert!((off - 2.0).abs() < 0.001, "{off}");
    // By block transfer they are the same.
    assert_eq!(pair.block_upload(at(0x2070, 0)), log);
    assert_eq!(pair.block_upload(at(0x2071, 1)), black_box);
    // A reset leaves both, a loss of the supply doesn't.
    pair.hears(0, &[129, 1]);
    pair.seconds(0.5);
    assert_eq!(pair.upload(at(0x2071, 1)), black_box);
    pair.device.power_lost();
    assert_eq!(
        pair.read(at(0x2070, 0)),
        0x1401,
        "head only: version and length, no entries"
    );
}

#[test]
fn no_safety_frame_goes_out_in_any_fault() {
    type Begin = fn(&mut Pair);
    let faults: [(&str, Begin); 9] = [
        ("disagreement", |pair| pair.peer.says = tilted(2.0)),
        ("peer ill", |pair| {
            pair.peer.says = level().refused(Invalid::Stuck)
        }),
        ("peer silent", |pair| pair.peer.silent = true),
        ("peer over range", |pair| {
            pair.peer.says = level().refused(Invalid::OverRange)
        }),
        ("brown-out", |pair| pair.brown_out()),
        ("thermometer", |pair| pair.part.warm(35.0)),
        ("sensor's bus", |pair| pair.part.set(0x0F, 0)),
        ("calibration", |pair| {
            pair.device
                .settings_mut()
                .chain
                .calibration
                .budget
                .hysteresis ^= 1 << 20;
        }),
        ("frames late", |pair| pair.blocked = true),
    ];
    for (name, begin) in faults {
        let mut pair = Pair::new();
        pair.write(at(0x63FE, 0), Value::u8(0xA5));
        pair.write(at(0x13FE, 0), Value::u8(0xA5));
        let mut pair = pair.at_work();
        let healthy = pair.safety_frames();
        assert!(healthy > 30, "{name}: {healthy}");
        begin(&mut pair);
        pair.seconds(0.6);
        assert_eq!(
            pair.safety_frames(),
            0,
            "{name}: {:?}",
            pair.device.faults()
        );
    }
}
