//! A node with everything behind its rows, for counting and timing: no sensor, no memory.
//!
//! In: frames. Out: frames. Values are those from the factory; nothing is measured or kept.
//!
//! Left out: the passing of time.

use canopen::node::Node;
use canopen::{Frame, Instant as BusInstant};
use device::black_box::BlackBox;
use device::calibration::motor::{MOTOR, Motor, Terms};
use device::channel::Settings;
use device::fault_log::ENTRY;
use device::fault_log::FaultLog;
use device::objects::panel::{Identity, Panel, Source, Work};
use device::objects::table::Channel;
use device::objects::values::Values;
use device::program::{Held, ProgramError, ProgramMemory, Running, Standing};
use device::records::{EventStore, Record, RecordStore, StoreError};
use device::sensor::Config;
use flash::Progress;
use tilt::angle::{Axes, Harmonics};
use tilt::chain::{Calibration, Chain, Correction, Invalid, PART_DELAY_Q16, Reading, Timing};
use tilt::filter::{Filtered, LowPass};
use tilt::observation::Observation;
use tilt::sample::{FullScale, Instant, Temperature};
use tilt::table::Rule;
use tilt::temperature::TemperatureModel;
use tilt::uncertainty::{Budget, Span, Uncertainty};
use tilt::vector::Vector;

const NODE_ID: u8 = 1;

/// A memory with nothing in it, which refuses everything.
struct Nothing;

impl RecordStore for Nothing {
    fn start(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn needs_erase(&self, _length: u32) -> bool {
        false
    }

    fn read(&mut self, _: Record, _: u32, _: &mut [u8]) -> usize {
        0
    }

    fn begin(&mut self, _: Record, _: u32) -> Result<(), StoreError> {
        Err(StoreError::Hardware)
    }

    fn append(&mut self, _: &[u8]) -> Result<(), StoreError> {
        Err(StoreError::NotBegun)
    }

    fn staged(&mut self, _: u32, _: &mut [u8]) -> usize {
        0
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        Err(StoreError::NotBegun)
    }

    fn discard(&mut self) {}

    fn erase(&mut self, _: Record) -> Result<(), StoreError> {
        Err(StoreError::Hardware)
    }
}

impl EventStore for Nothing {
    fn recall_events(&mut self, _: &mut dyn FnMut(&[u8; ENTRY])) {}

    fn keep_event(&mut self, _: &[u8; ENTRY]) -> Result<(), StoreError> {
        Err(StoreError::Hardware)
    }

    fn clear_events(&mut self) -> Result<(), StoreError> {
        Err(StoreError::Hardware)
    }

    fn needs_room(&self) -> bool {
        false
    }

    fn make_room(&mut self) -> Result<(), StoreError> {
        Ok(())
    }
}

impl ProgramMemory for Nothing {
    fn clear(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::Write)
    }

    fn erase(&mut self) -> Result<Progress, ProgramError> {
        Err(ProgramError::Write)
    }

    fn begin(&mut self, _: Option<u32>) -> Result<(), ProgramError> {
        Err(ProgramError::Write)
    }

    fn append(&mut self, _: &[u8]) -> Result<(), ProgramError> {
        Err(ProgramError::Write)
    }

    fn commit(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::Write)
    }

    fn discard(&mut self) {}

    fn activate(&mut self) -> Result<(), ProgramError> {
        Err(ProgramError::NoProgram)
    }

    fn held(&self) -> Option<Held> {
        None
    }

    fn running(&mut self) -> Running {
        Running {
            hardware: 0,
            version: 0,
            crc: 0,
            slot: 0,
            standing: Standing::Confirmed,
        }
    }

    fn confirm(&mut self) -> Result<(), ProgramError> {
        Ok(())
    }
}

impl Source for Nothing {
    fn reading(&self, _: &Settings, _: Instant) -> Reading {
        Observation::absent(Invalid::Stale).reading
    }

    fn observe(&mut self, _: &Settings, _: Instant) -> Observation {
        Observation::absent(Invalid::Stale)
    }

    fn filtered(&self) -> Option<Filtered> {
        None
    }

    fn temperature(&self) -> Option<Temperature> {
        None
    }
}

/// The node and what it works with.
pub struct Instrument {
    node: Node,
    values: Values,
    settings: Settings,
    work: Work,
    memory: Nothing,
    log: FaultLog,
    black_box: BlackBox,
}

fn settings() -> Settings {
    Settings {
        part: Config::PRODUCT,
        chain: Chain {
            filter: LowPass::PRODUCT,
            full_scale: FullScale::G2,
            period_us: 2500,
            part_delay_q16: PART_DELAY_Q16,
            timing: Timing::Aligned { latency_us: 25_000 },
            calibration: Calibration {
                temperature: TemperatureModel::None,
                correction: Correction::TwoAxis {
                    vector: Vector::IDENTITY,
                    harmonics: Axes::<Harmonics>::default(),
                },
                budget: Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::CHAMBER),
            },
        },
        noise: 0,
    }
}

impl Instrument {
    /// Started, with its boot-up message gone.
    pub fn new() -> Self {
        let settings = settings();
        let work = Work {
            motor: Motor::new(),
            terms: Terms {
                rule: Rule::Linear,
                reference: MOTOR,
            },
        };
        let mut instrument = Self {
            node: Node::new(),
            values: Values::new(),
            settings,
            work,
            memory: Nothing,
            log: FaultLog::new(),
            black_box: BlackBox::new(),
        };
        instrument.with(|node, panel| node.start(panel, NODE_ID, BusInstant(0)));
        instrument.with(|node, panel| node.transmit(panel, BusInstant(0)));
        instrument
    }

    fn with<T>(&mut self, act: impl FnOnce(&mut Node, &mut Panel<'_, Nothing, Nothing>) -> T) -> T {
        let mut panel = Panel {
            values: &mut self.values,
            settings: &mut self.settings,
            memory: &mut self.memory,
            source: &mut Nothing,
            log: &mut self.log,
            black_box: &mut self.black_box,
            work: &mut self.work,
            identity: Identity {
                channel: Channel::A,
                serial: 1,
            },
            now: Instant(0),
        };
        act(&mut self.node, &mut panel)
    }

    /// Reads the vendor-id, 1018h sub 1, by SDO: the request goes in, the response comes out.
    pub fn upload(&mut self) -> Option<Frame> {
        let request = Frame::data_frame(
            0x600 + u16::from(NODE_ID),
            &[0x40, 0x18, 0x10, 0x01, 0, 0, 0, 0],
        );
        self.with(|node, panel| {
            node.receive(panel, &request, BusInstant(0));
            node.transmit(panel, BusInstant(0))
        })
    }
}
