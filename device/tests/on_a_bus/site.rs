//! One device with a part that lies level, a memory, a master and a clock.

use canopen::Frame;
use canopen::node::{BusState, UNCONFIGURED};
use canopen::object::{Address, Value};
use device::calibration::deliver;
use device::device::{BoardRequest, Device, Factory};
use device::memory::update::Anybody;
use device::memory::{Build, FlashMemory};
use device::objects::table::{Channel, Models};
use device::sensor::{Config, Lis2dw12, PartConfig};
use flash::layout::{PAGE, RC, Slot};
use flash::nor::{Draw, Nor, Page};
use flash::slots::{self, Decision};
use instant::Instant;
use tilt::cross_check::CrossCheck;

pub use crate::registers::delivered;
use crate::registers::{self, Hurry, Part};

/// The most frames that one instant can bring; counted in the tests of `canopen::node`, with one
/// more EMCY queue for what the device finds wrong while frames go out.
const MOST: usize = 154 + 8;

/// A part that is always ready and sees 1 g along one axis; `output` is the register of the upper
/// half of that axis: 29h of X, 2Dh of Z.
pub fn along(output: usize) -> Part {
    let mut registers = registers::ready();
    registers[output] = 0x40;
    Part::new(registers)
}

/// The device's memory, on the model of its flash.
pub type Memory = FlashMemory<Nor<Vec<Page>, Seeded>>;

/// Random words for what a cut leaves half done: xorshift.
#[derive(Clone, Debug)]
pub struct Seeded(pub u64);

impl Draw for Seeded {
    fn draw(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 32) as u32
    }
}

/// The hardware id of the board.
pub const HARDWARE: u32 = 1;

/// A memory in which nothing was written but the calibration of a perfect part: no program.
pub fn blank() -> Memory {
    let pages = vec![Page::new(); (RC.flash / PAGE) as usize];
    let build = Build {
        layout: &RC,
        running: Slot::A,
        hardware: HARDWARE,
    };
    let mut memory = FlashMemory::new(Nor::new(pages, Seeded(1)), build, Anybody);
    deliver(&mut memory, &delivered()).unwrap();
    memory
}

/// This part's codes stand still, as those of one without noise may.
pub fn factory(channel: Channel) -> Factory {
    let part = PartConfig::Lis2dw12(Config::PRODUCT);
    registers::factory((part, Models::WHOLE), channel, 7, 1)
}

fn made(channel: Channel, part: Part, memory: Memory) -> Device<Lis2dw12<Part>, Memory> {
    Device::new(
        Lis2dw12::new(part),
        CrossCheck::product(),
        factory(channel),
        memory,
    )
}

/// The device and what is around it.
pub struct Site {
    pub device: Device<Lis2dw12<Part>, Memory>,
    pub channel: Channel,
    /// SDO downloads that were accepted, and aborted.
    pub taken: u32,
    pub refused: u32,
    pub now: Instant,
    answer: Option<[u8; 8]>,
}

impl Site {
    /// Powered, and booted; the part lies level.
    pub fn new(channel: Channel) -> Self {
        Self::with(channel, along(0x2D), blank())
    }

    /// The same with slope X at 90 deg.
    pub fn upright(channel: Channel) -> Self {
        Self::with(channel, along(0x29), blank())
    }

    /// A part of one's own, and what is in a memory.
    pub fn with(channel: Channel, part: Part, memory: Memory) -> Self {
        let mut site = Self {
            device: made(channel, part, memory),
            channel,
            taken: 0,
            refused: 0,
            now: Instant(1_000_000),
            answer: None,
        };
        site.boot();
        site
    }

    /// What the bootloader does, and then the program.
    fn boot(&mut self) {
        let memory = self.device.memory();
        if let Decision::Run(slot, ..) = slots::boot(memory.flash_mut(), &RC, HARDWARE) {
            memory.set_running(slot);
        }
        let started = self.device.start_sensor(&mut Hurry, self.now);
        assert_eq!(started, Ok(()));
        self.now = self.now.offset(20_000);
        self.device.start_bus(self.now);
        self.listen();
    }

    /// Everything goes but what is stored; the part lies level then.
    pub fn power_cycle(&mut self) {
        let mut memory = self.device.memory().clone();
        memory.flash_mut().power_up();
        self.device = made(self.channel, along(0x2D), memory);
        self.boot();
    }

    /// Everything the device sends now, acknowledged by the bus, and what it wishes.
    fn listen(&mut self) {
        self.device.poll(self.now);
        let server = 0x580 + u16::from(self.device.bus().node_id());
        let mut count = 0;
        while let Some(frame) = self.device.transmit(self.now) {
            self.device.sent(&frame, self.now);
            if frame.cob_id() == Some(server) {
                self.answer = frame.bytes().try_into().ok();
            }
            count += 1;
            assert!(count <= MOST);
        }
        match self.device.take_request() {
            Some(BoardRequest::Reset) => self.boot(),
            Some(BoardRequest::Sensor) => {
                let now = self.now;
                let _ = self.device.restart_sensor(&mut Hurry, now);
            }
            Some(BoardRequest::BitRate { .. }) | None => {}
        }
    }

    /// A frame that ends 200 us later.
    pub fn hears(&mut self, id: u16, bytes: &[u8]) {
        self.now = self.now.offset(200);
        self.device.receive(&Frame::data_frame(id, bytes), self.now);
        self.listen();
    }

    pub fn nmt(&mut self, specifier: u8) {
        self.hears(0, &[specifier, 0]);
    }

    /// Silence; a poll every 10 ms as in a main loop that is not in a hurry.
    pub fn pass(&mut self, ms: u32) {
        for _ in 0..=ms / 10 {
            self.now = self.now.offset(10_000);
            self.listen();
        }
    }

    /// The processor does nothing for so long.
    pub fn stand_still(&mut self, us: i64) {
        self.now = self.now.offset(us);
        self.device.stood_still(self.now);
    }

    /// Samples at the part's rate, with a poll after each.
    pub fn measure(&mut self, samples: u16) {
        let period_us = i64::from(Config::PRODUCT.rate.period_us());
        for _ in 0..samples {
            self.now = self.now.offset(period_us);
            self.device.data_ready(self.now);
            self.listen();
        }
    }

    pub fn controller(&mut self, state: u8) {
        let state = match state {
            0 => BusState::Active,
            1 => BusState::Passive,
            _ => BusState::Off,
        };
        self.device.bus_state(state, 100, 100, self.now);
        self.listen();
    }

    /// A segmented download; `None` without an answer, else the abort code as error.
    pub fn download(&mut self, at: Address, bytes: &[u8]) -> Option<Result<(), u32>> {
        let [low, high] = at.index.to_le_bytes();
        let [a, b, c, d] = (bytes.len() as u32).to_le_bytes();
        if let Err(code) = self.request([0x21, low, high, at.sub, a, b, c, d])? {
            return Some(Err(code));
        }
        let last = bytes.len().div_ceil(7).saturating_sub(1);
        for (number, piece) in bytes.chunks(7).enumerate() {
            let mut segment = [0; 8];
            let toggle = (number as u8 & 1) << 4;
            segment[0] = toggle | (7 - piece.len() as u8) << 1 | u8::from(number == last);
            segment[1..=piece.len()].copy_from_slice(piece);
            if let Err(code) = self.request(segment)? {
                return Some(Err(code));
            }
        }
        Some(Ok(()))
    }

    /// An SDO request; `None` without an answer, else the abort code as error.
    pub fn request(&mut self, request: [u8; 8]) -> Option<Result<[u8; 8], u32>> {
        let id = self.device.bus().node_id();
        if id == UNCONFIGURED {
            return None;
        }
        self.answer = None;
        self.device.receive(
            &Frame::data_frame(0x600 + u16::from(id), &request),
            self.now,
        );
        self.listen();
        let answer = self.answer.take()?;
        let [command, _, _, _, code @ ..] = answer;
        Some(match command {
            0x80 => Err(u32::from_le_bytes(code)),
            _ => Ok(answer),
        })
    }

    /// An expedited download; `None` without an answer, else the abort code as error.
    pub fn write(&mut self, at: Address, value: Value) -> Option<Result<(), u32>> {
        let [low, high] = at.index.to_le_bytes();
        let [a, b, c, d, ..] = value.unsigned().to_le_bytes();
        let command = 0x23 | (4 - value.bytes().len() as u8) << 2;
        let answer = self.request([command, low, high, at.sub, a, b, c, d])?;
        *if answer.is_ok() {
            &mut self.taken
        } else {
            &mut self.refused
        } += 1;
        Some(answer.map(|_| ()))
    }

    /// An upload, expedited or of eight bytes; `None` without an answer, else the abort code as
    /// error.
    pub fn read(&mut self, at: Address) -> Option<Result<Value, u32>> {
        let [low, high] = at.index.to_le_bytes();
        let answer = self.request([0x40, low, high, at.sub, 0, 0, 0, 0])?;
        if answer.is_ok_and(|[command, ..]| command == 0x41) {
            return self.read_segments().map(Ok);
        }
        Some(answer.map(|[command, _, _, _, data @ ..]| {
            assert_eq!(command & 0xF3, 0x43);
            let length = 4 - usize::from(command >> 2 & 3);
            Value::new(&data[..length]).unwrap()
        }))
    }

    /// The segments of an upload of eight bytes.
    fn read_segments(&mut self) -> Option<Value> {
        let mut all = Vec::new();
        for toggle in [0, 0x10] {
            let answer = self.request([0x60 | toggle, 0, 0, 0, 0, 0, 0, 0])?;
            let [command, data @ ..] = answer.ok()?;
            assert_eq!(command & 0x10, toggle);
            all.extend(&data[..7 - usize::from(command >> 1 & 7)]);
        }
        Value::new(&all)
    }

    /// LSS for a device that has lost its node-id.
    pub fn give_node_id(&mut self) {
        if self.device.bus().node_id() == UNCONFIGURED {
            self.hears(0x7E5, &[4, 1, 0, 0, 0, 0, 0, 0]);
            self.hears(0x7E5, &[0x11, 42, 0, 0, 0, 0, 0, 0]);
            self.hears(0x7E5, &[0x17, 0, 0, 0, 0, 0, 0, 0]);
            self.hears(0x7E5, &[4, 0, 0, 0, 0, 0, 0, 0]);
        }
    }
}
