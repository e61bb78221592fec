//! Two boards in one housing, on one bus with a host: an instrument as it is built.
//!
//! In: the part and an image for both, time, frames of the host. Out: what was on the bus.
//! Everything is drawn from one seed. Left out: a third party on the bus; the network takes one.

use std::fmt;
use std::marker::PhantomData;

use canopen::Frame;
use device::calibration::stage;
use device::factory;
use device::memory::Build;
use device::memory::records_only::RecordMemory;
use device::objects::table::{Channel, Models};
use device::records::{Record, RecordStore};
use device::sensor::PartConfig;
use embedded_storage::nor_flash::ReadNorFlash;
use flash::layout::{C8, Layout, PAGE, RC, Region, Slot};
use flash::nor::medium::Medium;
use flash::nor::{Nor, Page};
use sim::can_bus::{Busy, Event, Port};
use sim::electronics::Electronics;
use sim::error_model::ErrorModel;
use sim::memory::{self, Memory};
use sim::network::Network;
use sim::network::guest::Switch;
use sim::network::hand::Hand;
use sim::network::instrument::{Delivered, commission};
use sim::rng::Rng;

use crate::board::{Board, FlashError, Parts};
use crate::chip::flash_controller::Dice;
use crate::cortex_m3::CortexM3;
use crate::cpu::Cpu;

/// The watchdog's oscillator as the data sheet has it typically, Hz (RM0008 7.2.5).
const LSI_HZ: u32 = 40_000;

/// What is to be flashed: pieces with their addresses.
pub type Pieces<'a> = &'a [(u32, Vec<u8>)];

/// The parts of a board, and what is to be flashed into it. Pieces alone are for the product's.
#[derive(Clone, Copy, Debug)]
pub struct Outfit<'a> {
    /// The map of the chip.
    pub layout: Layout,
    /// The sensor. Boards that come from the bench have their own.
    pub sensor: PartConfig,
    /// What is to be flashed.
    pub pieces: Pieces<'a>,
}

impl<'a> Outfit<'a> {
    /// The paper's parts with these pieces.
    pub const fn paper(pieces: Pieces<'a>) -> Self {
        Self {
            layout: C8,
            sensor: factory::paper().part,
            pieces,
        }
    }

    /// The parts of the variant with a gyroscope, with these pieces.
    pub const fn dynamic(pieces: Pieces<'a>) -> Self {
        Self {
            layout: RC,
            sensor: factory::dynamic().part,
            pieces,
        }
    }
}

impl<'a> From<Pieces<'a>> for Outfit<'a> {
    fn from(pieces: Pieces<'a>) -> Self {
        Self {
            layout: RC,
            sensor: factory::product().part,
            pieces,
        }
    }
}

impl<'a> From<&'a Vec<(u32, Vec<u8>)>> for Outfit<'a> {
    fn from(pieces: &'a Vec<(u32, Vec<u8>)>) -> Self {
        Self::from(pieces.as_slice())
    }
}

impl<'a, const N: usize> From<&'a [(u32, Vec<u8>); N]> for Outfit<'a> {
    fn from(pieces: &'a [(u32, Vec<u8>); N]) -> Self {
        Self::from(pieces.as_slice())
    }
}

/// A frame that was on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Heard {
    /// When it counted as received, ns.
    pub at_ns: u64,
    /// What it was.
    pub frame: Frame,
}

/// Why an object was not read or written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SdoError {
    /// The host's mailboxes are full.
    BusFull,
    /// No answer within a second.
    Silent,
    /// The node has refused, with this abort code.
    Abort(u32),
    /// An answer that is none to this request, with this command byte.
    Form(u8),
}

/// The instrument with its bus.
pub struct Pair<C = CortexM3> {
    /// The bus with the boards as guests 0 (channel A) and 1 (channel B).
    pub network: Network,
    /// The host's controller.
    pub host: Port,
    /// What holds the housing.
    pub hand: Hand,
    /// Frames so far, of nodes and host.
    pub heard: Vec<Heard>,
    /// The core of its boards.
    core: PhantomData<C>,
}

impl<C> fmt::Debug for Pair<C> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pair")
            .field("heard", &self.heard.len())
            .finish()
    }
}

/// A board of channel A (0) or B (1), without power, with what is to be in its flash.
///
/// Errors: see [`FlashError`].
///
/// # Panics
/// When the bus is full, or for want of memory.
pub fn board<C: Cpu>(
    network: &mut Network,
    electronics: Electronics,
    seed: u64,
    number: usize,
    outfit: Outfit<'_>,
) -> Result<Board<C>, FlashError> {
    let parts = Parts {
        layout: outfit.layout,
        electronics,
        identity: [seed as u32, (seed >> 32) as u32, number as u32],
        lsi_hz: LSI_HZ,
        seed: seed ^ number as u64,
        strapped: number % 2 == 1,
    };
    let mut board = Board::new(parts, &mut network.bus);
    for (address, bytes) in outfit.pieces {
        board.flash_at(*address, bytes)?;
    }
    Ok(board)
}

/// Node-ids and bit rate (kbit/s) that the image has by itself (`firmware::factory`).
pub const AS_BUILT: ([u8; 2], u16) = ([1, 2], 250);

/// Puts both boards of an instrument on the bus, without power: its parts, this outfit, and in the
/// flash behind it the records that they leave the bench with. Node-ids and bit rate other
/// than [`AS_BUILT`] are stored as LSS does it.
///
/// Errors: see [`FlashError`].
///
/// # Panics
/// When the bus is full, or for want of memory.
pub fn deliver(
    network: &mut Network,
    delivered: &Delivered,
    settings: ([u8; 2], u16),
    seed: u64,
    outfit: Outfit<'_>,
) -> Result<(), FlashError> {
    deliver_with::<CortexM3>(network, delivered, settings, seed, outfit)
}

/// [`deliver`], with this core.
fn deliver_with<C: Cpu + 'static>(
    network: &mut Network,
    delivered: &Delivered,
    settings: ([u8; 2], u16),
    seed: u64,
    outfit: Outfit<'_>,
) -> Result<(), FlashError> {
    let records = records(delivered, settings, &outfit.layout);
    for (number, (channel, records)) in CHANNELS.into_iter().zip(records).enumerate() {
        let electronics = delivered.electronics(channel);
        let mut board = board::<C>(network, electronics, seed, number, outfit)?;
        board.flash_at(outfit.layout.records.address(), &records)?;
        network.add_guest(Box::new(board));
    }
    Ok(())
}

const CHANNELS: [Channel; 2] = [Channel::A, Channel::B];

const ROOM: &str = "a blank flash has room for a few records";

/// The records that both nodes leave the bench with, written by the same code on the host.
fn records(delivered: &Delivered, settings: ([u8; 2], u16), layout: &Layout) -> [Vec<u8>; 2] {
    let region = layout.records;
    if layout.b.is_none() {
        let mut memories = CHANNELS.map(|channel| of_paper(delivered, channel));
        settle(&mut memories, settings, delivered.models());
        return memories.map(|mut memory| held(memory.flash_mut(), region));
    }
    let mut memories = CHANNELS.map(|channel| of_product(delivered, channel));
    settle(&mut memories, settings, delivered.models());
    memories.map(|mut memory| held(memory.flash_mut(), region))
}

/// A node's memory as the bench leaves it.
fn of_product(delivered: &Delivered, channel: Channel) -> Memory {
    let mut memory = memory::blank();
    RecordStore::start(&mut memory).expect(ROOM);
    delivered.write_to(channel, &mut memory).expect(ROOM);
    memory
}

/// The same of a node of the paper's instrument: it keeps one calibration, its own.
fn of_paper(delivered: &Delivered, channel: Channel) -> RecordMemory<Medium<Vec<Page>, Dice>> {
    let pages = vec![Page::new(); (C8.flash / PAGE) as usize];
    let build = Build {
        layout: &C8,
        running: Slot::A,
        hardware: C8.hardware,
    };
    let mut memory = RecordMemory::new(Medium(Nor::new(pages, Dice::new(0))), build);
    RecordStore::start(&mut memory).expect(ROOM);
    if let Some(calibration) = delivered.calibration(channel) {
        let staged = stage(&mut memory, Record::Calibration, calibration);
        let kept = staged.and_then(|()| RecordStore::commit(&mut memory));
        kept.expect(ROOM);
    }
    memory
}

/// Tells both who they are, where that is not what they are built with.
fn settle<M: RecordStore>(memories: &mut [M; 2], (ids, kbit_s): ([u8; 2], u16), models: Models) {
    if (ids, kbit_s) != AS_BUILT {
        commission(memories, ids, kbit_s, models).expect(ROOM);
    }
}

/// What a region holds.
fn held<F: ReadNorFlash>(flash: &mut F, region: Region) -> Vec<u8> {
    let mut bytes = vec![0; region.length as usize];
    let read = flash.read(region.start, &mut bytes);
    assert!(read.is_ok(), "the records are in the flash");
    bytes
}

impl Pair {
    /// Both boards with power, at 250 kbit/s.
    ///
    /// Errors: see [`FlashError`].
    pub fn new<'a>(seed: u64, outfit: impl Into<Outfit<'a>>) -> Result<Self, FlashError> {
        Self::of(2, seed, outfit)
    }

    /// So many boards with power, of nominal parts.
    ///
    /// Errors: see [`FlashError`].
    pub fn of<'a>(
        boards: usize,
        seed: u64,
        outfit: impl Into<Outfit<'a>>,
    ) -> Result<Self, FlashError> {
        Self::with(&ErrorModel::NOMINAL, boards, seed, outfit)
    }

    /// So many boards with power, of parts drawn from this model.
    ///
    /// Errors: see [`FlashError`].
    pub fn with<'a>(
        model: &ErrorModel,
        boards: usize,
        seed: u64,
        outfit: impl Into<Outfit<'a>>,
    ) -> Result<Self, FlashError> {
        let outfit = outfit.into();
        let mut network = Network::new(250_000, seed);
        let host = network.attach_host();
        for number in 0..boards {
            let rng = Rng::stream(seed, &format!("board {number}"));
            let electronics = Electronics::with(&outfit.sensor, model, rng);
            let board = board::<CortexM3>(&mut network, electronics, seed, number, outfit)?;
            network.add_guest(Box::new(board));
        }
        Ok(Self::powered(network, host, seed))
    }

    /// Both boards with power, as they come from the bench: calibrated.
    ///
    /// Errors: see [`FlashError`].
    pub fn delivered<'a>(
        delivered: &Delivered,
        seed: u64,
        outfit: impl Into<Outfit<'a>>,
    ) -> Result<Self, FlashError> {
        Self::delivered_with(delivered, seed, outfit)
    }
}

impl<C: Cpu + 'static> Pair<C> {
    /// [`Pair::delivered`], with the core that the type names.
    ///
    /// Errors: see [`FlashError`].
    pub fn delivered_with<'a>(
        delivered: &Delivered,
        seed: u64,
        outfit: impl Into<Outfit<'a>>,
    ) -> Result<Self, FlashError> {
        let mut network = Network::new(250_000, seed);
        let host = network.attach_host();
        deliver_with::<C>(&mut network, delivered, AS_BUILT, seed, outfit.into())?;
        Ok(Self::powered(network, host, seed))
    }

    fn powered(mut network: Network, host: Port, seed: u64) -> Self {
        for guest in 0..network.guest_count() {
            network.switch_guest(guest, Switch::On);
        }
        Self {
            network,
            host,
            hand: Hand::new(Rng::stream(seed, "hand")),
            heard: Vec::new(),
            core: PhantomData,
        }
    }

    /// Goes on for so long, s.
    pub fn run(&mut self, seconds: f64) {
        let until_ns = self.network.now_ns() + (seconds * 1e9) as u64;
        let heard = &mut self.heard;
        self.network.run_until(&mut self.hand, until_ns, |event| {
            if let Event::Delivered { frame, at_ns, .. } = event {
                heard.push(Heard {
                    at_ns: *at_ns,
                    frame: *frame,
                });
            }
        });
    }

    /// Goes on with a SYNC every 10 ms, for so many of them.
    ///
    /// Errors: [`Busy`] when the bus does not take them any more.
    pub fn run_synced(&mut self, syncs: u32) -> Result<(), Busy> {
        for _ in 0..syncs {
            self.send(Frame::data_frame(0x080, &[]))?;
            self.run(0.01);
        }
        Ok(())
    }

    /// The host sends a frame.
    ///
    /// Errors: [`Busy`] while its mailboxes are full.
    pub fn send(&mut self, frame: Frame) -> Result<(), Busy> {
        self.network.bus.offer(self.host, frame).map(|_| ())
    }

    /// Asks a node over its default SDO channel and waits for the answer, up to a second.
    fn ask(&mut self, node: u8, request: [u8; 8]) -> Result<[u8; 8], SdoError> {
        let answers = 0x580 + u16::from(node);
        let before = self.of_id(answers).len();
        let frame = Frame::data_frame(0x600 + u16::from(node), &request);
        self.send(frame).map_err(|_| SdoError::BusFull)?;
        for _ in 0..1000 {
            self.run(0.001);
            if let Some(heard) = self.of_id(answers).get(before) {
                let answer = heard.frame.padded();
                let [command, _, _, _, code @ ..] = answer;
                return match command {
                    0x80 => Err(SdoError::Abort(u32::from_le_bytes(code))),
                    _ => Ok(answer),
                };
            }
        }
        Err(SdoError::Silent)
    }

    /// Reads an object of up to four bytes (CiA 301 7.2.4.3.6, expedited upload).
    ///
    /// Errors: see [`SdoError`].
    pub fn read(&mut self, node: u8, index: u16, sub: u8) -> Result<u32, SdoError> {
        let [low, high] = index.to_le_bytes();
        let answer = self.ask(node, [0x40, low, high, sub, 0, 0, 0, 0])?;
        let [command, _, _, _, bytes @ ..] = answer;
        let unused = 8 * u32::from(command >> 2 & 3);
        match command & 0xF3 {
            0x43 => Ok(u32::from_le_bytes(bytes) << unused >> unused),
            _ => Err(SdoError::Form(command)),
        }
    }

    /// Writes an object of `size` bytes, 1 to 4 (CiA 301 7.2.4.3.3, expedited download).
    ///
    /// Errors: see [`SdoError`].
    pub fn write(
        &mut self,
        node: u8,
        (index, sub): (u16, u8),
        size: u8,
        value: u32,
    ) -> Result<(), SdoError> {
        let [low, high] = index.to_le_bytes();
        let command = 0x23 | (4 - size.clamp(1, 4)) << 2;
        let [a, b, c, d] = value.to_le_bytes();
        match self.ask(node, [command, low, high, sub, a, b, c, d])? {
            [0x60, ..] => Ok(()),
            [command, ..] => Err(SdoError::Form(command)),
        }
    }

    /// The frames of an identifier so far.
    pub fn of_id(&self, id: u16) -> Vec<Heard> {
        let of = |heard: &&Heard| heard.frame.cob_id() == Some(id);
        self.heard.iter().filter(of).copied().collect()
    }

    /// The board of channel A (0) or B (1).
    ///
    /// # Panics
    /// When there is no such board.
    pub fn board(&mut self, number: usize) -> &mut Board<C> {
        let board = self.network.guest_as(number);
        board.expect("its guests are boards: ask for one that there is")
    }
}
