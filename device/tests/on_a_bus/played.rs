//! One device with a part whose registers the test holds, on a bus with a peer that is played.
//!
//! In: registers, what the peer sends, SYNCs. Out: every frame of the device, and an SDO client.

use crate::registers::{Hurry, Part};
use crate::site::{Memory, along, blank, factory};
use canopen::Frame;
use canopen::object::{Address, Value, at};
use device::device::{BoardRequest, Device};
use device::exchange;
use device::fault::Fault;
use device::objects::table::Channel;
use device::presentation::Presentation;
use device::sensor::Lis2dw12;
use instant::Instant;
use tilt::angle::{Angle, Axes, slopes};
use tilt::chain::Measurement;
use tilt::cross_check::CrossCheck;
use tilt::health::Activity;
use tilt::observation::Observation;
use tilt::uncertainty::Uncertainty;
use tilt::vector::Corrected;

const SYNC_US: i64 = 20_000;
const SAMPLE_US: i64 = 2_500;
/// A slope in 16 bit that is no angle.
pub const NO_SLOPE: i16 = i16::MIN;

/// What a healthy channel reports that is tilted about one axis.
pub fn tilted(degrees: f64) -> Observation {
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
        turned: None,
    }
}

pub fn level() -> Observation {
    tilted(0.0)
}

/// The other channel as this test plays it.
#[derive(Clone, Copy, Debug)]
pub struct Peer {
    pub sends: Observation,
    pub shows: Presentation,
    pub silent: bool,
    /// Whether the second frame of the exchange comes.
    pub backed: bool,
}

/// TPDO 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Told {
    pub slopes: [i16; 2],
    pub validity: u8,
    pub state: u8,
}

impl Told {
    pub fn is_valid(&self) -> bool {
        let marked = self.validity & 3 == 3;
        let shown = !self.slopes.contains(&NO_SLOPE);
        assert_eq!(marked, shown, "value and validity agree: {self:?}");
        marked
    }
}

/// The device, its part, and the bus with the other channel.
pub struct Pair {
    pub device: Device<Lis2dw12<Part>, Memory>,
    part: Part,
    pub peer: Peer,
    pub now: Instant,
    next_sample: Instant,
    sent: Vec<(Instant, Frame)>,
    pub sensor_restarts: u32,
    /// The controller does not get rid of its frame.
    pub blocked: bool,
    waiting: Option<Frame>,
    /// The controller is off the bus.
    pub off: bool,
}

impl Pair {
    /// Powered and settled, not started.
    pub fn new() -> Self {
        let part = along(0x2D);
        let mut pair = Self {
            device: Device::new(
                Lis2dw12::new(part.clone()),
                CrossCheck::product(),
                factory(Channel::A),
                blank(),
            ),
            part,
            peer: Peer {
                sends: level(),
                shows: Presentation::AS_MEASURED,
                silent: false,
                backed: true,
            },
            now: Instant(1_000_000),
            next_sample: Instant(1_000_000),
            sent: Vec::new(),
            sensor_restarts: 0,
            blocked: false,
            waiting: None,
            off: false,
        };
        pair.boot();
        pair.syncs(40);
        pair
    }

    /// OPERATIONAL, agreeing, with every baseline known.
    pub fn working() -> Self {
        Self::new().at_work()
    }

    pub fn at_work(mut self) -> Self {
        self.hears(0, &[1, 0]);
        self.syncs(400);
        assert_eq!(self.state(), 1, "{:?}", self.device.values().process);
        assert!(self.told().is_valid());
        self.sent.clear();
        self
    }

    pub fn boot(&mut self) {
        assert_eq!(self.device.start_sensor(&mut Hurry, self.now), Ok(()));
        self.now = self.now.offset(20_000);
        self.next_sample = self.now.offset(SAMPLE_US);
        self.device.start_bus(self.now);
        self.listen();
    }

    /// Time with its samples.
    pub fn pass(&mut self, us: i64) {
        let until = self.now.offset(us);
        while self.next_sample <= until {
            self.now = self.next_sample;
            self.next_sample = self.now.offset(SAMPLE_US);
            self.device.data_ready(self.now);
            self.listen();
        }
        self.now = until;
    }

    /// Everything the device sends now, acknowledged unless the controller is kept from it.
    pub fn listen(&mut self) {
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
            self.sent.push((self.now, frame));
        }
        match self.device.take_request() {
            Some(BoardRequest::Reset) => self.boot(),
            Some(BoardRequest::Sensor) => {
                self.sensor_restarts += 1;
                let _ = self.device.restart_sensor(&mut Hurry, self.now);
            }
            Some(BoardRequest::BitRate { .. }) | None => {}
        }
    }

    /// A frame from somebody else.
    pub fn hears(&mut self, id: u16, bytes: &[u8]) {
        if self.off {
            return;
        }
        self.pass(200);
        self.device.receive(&Frame::data_frame(id, bytes), self.now);
        self.listen();
    }

    /// A period with SYNC at its end and what the other channel sends for it.
    pub fn sync(&mut self) {
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

    pub fn exchange(&self, at: Instant) -> [[u8; 8]; 2] {
        let bytes = exchange::encode(&self.peer.sends, self.peer.shows, at).bytes();
        let (first, second) = bytes.split_at(8);
        [first.try_into().unwrap(), second.try_into().unwrap()]
    }

    pub fn syncs(&mut self, count: u32) {
        (0..count).for_each(|_| self.sync());
    }

    pub fn seconds(&mut self, seconds: f64) {
        self.syncs((seconds * 50.0).round() as u32);
    }

    /// SYNCs until TPDO 1 carries no angle; how long that took, s.
    pub fn until_refused(&mut self, most_s: f64) -> Option<f64> {
        let count = (most_s * 50.0) as u32;
        let found = (0..count).find(|_| {
            self.sync();
            !self.told().is_valid()
        })?;
        Some(f64::from(found + 1) / 50.0)
    }

    /// The bytes of all frames of an identifier.
    pub fn of(&self, id: u16) -> Vec<Vec<u8>> {
        let of = self
            .sent
            .iter()
            .filter(|(_, frame)| frame.cob_id() == Some(id));
        of.map(|(_, frame)| frame.bytes().to_vec()).collect()
    }

    /// The newest TPDO 1.
    pub fn told(&self) -> Told {
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
    pub fn emergencies(&self) -> Vec<u16> {
        let code = |bytes: Vec<u8>| u16::from_le_bytes([bytes[0], bytes[1]]);
        self.of(0x81).into_iter().map(code).collect()
    }

    pub fn state(&self) -> u8 {
        self.device.shown(self.now).state()
    }

    pub fn has(&self, fault: Fault) -> bool {
        self.device.faults().has(fault)
    }

    pub fn ask(&mut self, request: [u8; 8]) -> Vec<Vec<u8>> {
        let before = self.of(0x581).len();
        self.hears(0x601, &request);
        self.of(0x581).split_off(before)
    }

    pub fn write(&mut self, at: Address, value: Value) {
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

    pub fn read(&mut self, at: Address) -> u32 {
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
    pub fn upload(&mut self, at: Address) -> Vec<u8> {
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
    pub fn block_upload(&mut self, at: Address) -> Vec<u8> {
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

    pub fn set_policy(mut self, latch_s: u16, degraded: u8) -> Self {
        self.write(at(0x2004, 0), Value::u16(latch_s));
        self.write(at(0x2005, 0), Value::u8(degraded));
        self
    }

    /// Sets a register of the part behind the driver.
    pub fn set_register(&self, register: usize, value: u8) {
        self.part.with(|registers| registers[register] = value);
    }

    /// The part takes on another temperature.
    pub fn warm(&self, celsius: f64) {
        let codes = (((celsius - 25.0) * 256.0) as i16 & !0xF).to_le_bytes();
        for (register, value) in (0x0D..).zip(codes) {
            self.set_register(register, value);
        }
    }

    /// The part has lost its supply and is in power-down.
    pub fn brown_out(&self) {
        self.set_register(0x20, 0);
    }

    /// Safety frames within a second.
    pub fn safety_frames(&mut self) -> usize {
        let before = self.of(0x101).len();
        self.seconds(1.0);
        self.of(0x101).len() - before
    }
}
