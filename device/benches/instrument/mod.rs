//! A node with everything behind its rows, for counting and timing: no sensor, no memory.
//!
//! In: frames. Out: frames. Values are those from the factory; nothing is measured or kept.
//!
//! Left out: the passing of time.

#[path = "../../tests/both/nothing.rs"]
mod nothing;

use canopen::Frame;
use canopen::node::Node;
use device::black_box::BlackBox;
use device::calibration::motor::{MOTOR, Motor, TableSettings};
use device::channel::Settings;
use device::fault_log::FaultLog;
use device::objects::device_objects::{DeviceObjects, Identity, Parts, Source, Work};
use device::objects::table::{Channel, Models};
use device::objects::values::Values;
use device::pair::Pair;
use device::sensor::{Config, PartConfig};
use instant::Instant;
use nothing::Nothing;
use tilt::angle::{Axes, Harmonics};
use tilt::chain::{Calibration, Chain, Correction, Invalid, PART_DELAY_Q16, Reading, Timing};
use tilt::cross_check::CrossCheck;
use tilt::filter::{Filtered, LowPass};
use tilt::observation::Observation;
use tilt::sample::{FullScale, Temperature};
use tilt::table::Rule;
use tilt::temperature::TemperatureModel;
use tilt::uncertainty::{Budget, Span, Uncertainty};
use tilt::vector::Vector;

const NODE_ID: u8 = 1;

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

    fn fault(&self) -> Option<Invalid> {
        None
    }
}

/// The node and what it works with.
pub struct Instrument {
    node: Node,
    parts: Parts<Nothing, Nothing>,
}

fn settings() -> Settings {
    Settings {
        part: PartConfig::Lis2dw12(Config::PRODUCT),
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
                rates: None,
            },
            fusion: None,
        },
        noise: 0,
    }
}

impl Instrument {
    /// Started, with its boot-up message gone.
    pub fn new() -> Self {
        let work = Work {
            motor: Some(Motor::new()),
            table_settings: TableSettings {
                rule: Rule::Linear,
                reference: MOTOR,
            },
        };
        let mut instrument = Self {
            node: Node::new(),
            parts: Parts {
                identity: Identity {
                    channel: Channel::A,
                    serial: 1,
                    models: Models::WHOLE,
                },
                values: Values::new(),
                channel: Nothing::NEW,
                memory: Nothing::NEW,
                settings: settings(),
                work,
                pair: Pair::new(CrossCheck::product()),
                moment: None,
                log: FaultLog::new(),
                black_box: BlackBox::new(),
            },
        };
        instrument.with(|node, objects| node.start(objects, NODE_ID, Instant(0)));
        instrument.with(|node, objects| {
            if let Some(boot_up) = node.transmit(objects, Instant(0)) {
                node.sent(objects, &boot_up, Instant(0));
            }
        });
        instrument
    }

    fn with<T>(
        &mut self,
        act: impl FnOnce(&mut Node, &mut DeviceObjects<'_, Nothing, Nothing>) -> T,
    ) -> T {
        let mut objects = DeviceObjects {
            parts: &mut self.parts,
            now: Instant(0),
        };
        act(&mut self.node, &mut objects)
    }

    /// Reads the vendor-id, 1018h sub 1, by SDO: the request goes in, the response comes out.
    pub fn upload(&mut self) -> Option<Frame> {
        let request = Frame::data_frame(
            0x600 + u16::from(NODE_ID),
            &[0x40, 0x18, 0x10, 0x01, 0, 0, 0, 0],
        );
        self.with(|node, objects| {
            node.receive(objects, &request, Instant(0));
            node.transmit(objects, Instant(0))
        })
    }
}
