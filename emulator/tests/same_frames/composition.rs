//! What an image is composed of, on the host: the same as `firmware::image` on the chip.
//!
//! In: what the flash holds. Out: instrument, sensor, memory and factory setting for the device;
//! the images, and a calibration that suits parts without errors.

use device::calibration::{deliver, stage};
use device::device::Factory;
use device::instrument::{self, Instrument};
use device::memory::ed25519::Ed25519;
use device::memory::records_only::RecordMemory;
use device::memory::{Build, FlashMemory};
use device::objects::device_objects;
use device::objects::table::Channel;
use device::records::{Record, RecordStore};
use device::sensor::ism330dhcx::Ism330dhcx;
use device::sensor::{Lis2dw12, Part};
use emulator::build;
use emulator::chip::flash_controller::Dice;
use emulator::pair::{Outfit, Pair};
use emulator_golden::calibration;
use firmware::factory;
use firmware::part::{LAYOUT, PAPER, SIGNATURES};
use flash::layout::{Layout, Slot};
use flash::nor::Page;
use flash::nor::medium::Medium;
use tilt::ONE_G;
use tilt::angle::{Angle, Axes};
use tilt::chain::{Calibration, Correction};
use tilt::rate::RateCorrection;
use tilt::table::{Point, Table};
use tilt::temperature::TemperatureModel;
use tilt::vector::Vector;

use crate::node::{Cells, Wire};
use crate::refused;

/// An image with the device in it.
pub trait Composition {
    /// The stages and services of the device.
    type Instrument: Instrument;
    /// The driver of its sensor.
    type Sensor: Part;
    /// What the device keeps.
    type Memory: device_objects::Memory;
    /// Different frames of TPDO 1 in half a minute, at least.
    const ANGLES: usize;
    /// The error code by which a node tells that its sensor's supply was away for a moment.
    const FAULT: u16;
    /// How the burst begins that reads a sample, and how many bytes later the high one of the
    /// acceleration along X comes.
    const SAMPLE: (u8, usize);

    /// What is flashed.
    fn pieces() -> Vec<(u32, Vec<u8>)>;
    /// The part, with these pieces.
    fn outfit(pieces: &[(u32, Vec<u8>)]) -> Outfit<'_>;
    /// The driver over these wires.
    fn sensor(wire: Wire) -> Self::Sensor;
    /// A memory over these cells, as the chip's program makes it.
    fn memory(cells: Cells) -> Self::Memory;
    /// These cells with a calibration in them.
    fn calibrated(cells: Cells) -> Cells;
    /// The node as it is delivered.
    fn factory(channel: Channel, serial: u32) -> Factory;
    /// What else the nodes do at the end.
    fn end(pair: &mut Pair);
}

/// From OUT_T on, read (DS11811 table 17): OUT_T, STATUS, low and high of X.
const OF_LIS2DW12: (u8, usize) = (0x80 | 0x26, 4);
/// From STATUS_REG on, read (DS13012): it, 1Fh, OUT_TEMP, three rates, low and high of X.
const OF_ISM330DHCX: (u8, usize) = (0x80 | 0x1E, 12);

const ROOM: &str = "there is room in the records";

fn build(layout: &'static Layout) -> Build {
    Build {
        layout,
        running: Slot::A,
        hardware: layout.hardware,
    }
}

/// The product.
pub struct Product;

impl Composition for Product {
    type Instrument = instrument::Product;
    type Sensor = Lis2dw12<Wire>;
    type Memory = FlashMemory<Cells, Ed25519>;
    const ANGLES: usize = 1_000;
    /// It gives no samples: the set-up is looked at less often than they come.
    const FAULT: u16 = 0xFF02;
    const SAMPLE: (u8, usize) = OF_LIS2DW12;

    fn pieces() -> Vec<(u32, Vec<u8>)> {
        let images = build::Product::build();
        images.expect("the images build").pieces()
    }

    fn outfit(pieces: &[(u32, Vec<u8>)]) -> Outfit<'_> {
        Outfit::from(pieces)
    }

    fn sensor(wire: Wire) -> Self::Sensor {
        Lis2dw12::new(wire)
    }

    fn memory(cells: Cells) -> Self::Memory {
        FlashMemory::new(cells, build(&LAYOUT), SIGNATURES)
    }

    fn calibrated(cells: Cells) -> Cells {
        let mut memory = Self::memory(cells);
        deliver(&mut memory, &mild()).expect(ROOM);
        memory.flash().clone()
    }

    fn factory(channel: Channel, serial: u32) -> Factory {
        factory::product(channel, serial)
    }

    /// A new program comes and is found to be signed with a key that they do not have.
    fn end(pair: &mut Pair) {
        for (node, erase_ns) in [(1, Some(40_000_000)), (2, None)] {
            let chip = pair.board(node - 1).machine_mut().chip_mut();
            chip.flash.set_erase_ns(erase_ns);
            refused(pair, node as u8);
        }
    }
}

/// The variant with a gyroscope.
pub struct Dynamic;

impl Composition for Dynamic {
    type Instrument = instrument::Dynamic;
    type Sensor = Ism330dhcx<Wire>;
    type Memory = FlashMemory<Cells, Ed25519>;
    const ANGLES: usize = 1_000;
    const FAULT: u16 = Product::FAULT;
    const SAMPLE: (u8, usize) = OF_ISM330DHCX;

    fn pieces() -> Vec<(u32, Vec<u8>)> {
        let images = build::Product::dynamic();
        images.expect("the images build").pieces()
    }

    fn outfit(pieces: &[(u32, Vec<u8>)]) -> Outfit<'_> {
        Outfit::dynamic(pieces)
    }

    fn sensor(wire: Wire) -> Self::Sensor {
        Ism330dhcx::new(wire)
    }

    fn memory(cells: Cells) -> Self::Memory {
        Product::memory(cells)
    }

    fn calibrated(cells: Cells) -> Cells {
        let calibration = Calibration {
            rates: Some(rates()),
            ..mild()
        };
        let mut memory = Self::memory(cells);
        deliver(&mut memory, &calibration).expect(ROOM);
        memory.flash().clone()
    }

    fn factory(channel: Channel, serial: u32) -> Factory {
        factory::dynamic(channel, serial)
    }

    fn end(pair: &mut Pair) {
        Product::end(pair);
    }
}

/// The paper's instrument.
pub struct Paper;

impl Composition for Paper {
    type Instrument = instrument::Paper;
    type Sensor = Lis2dw12<Wire>;
    type Memory = RecordMemory<Medium<Vec<Page>, Dice>>;
    const ANGLES: usize = 500;
    /// Its set-up is lost, which is seen before the next sample is missed.
    const FAULT: u16 = 0x3200;
    const SAMPLE: (u8, usize) = OF_LIS2DW12;

    fn pieces() -> Vec<(u32, Vec<u8>)> {
        let images = build::Paper::build();
        images.expect("the images build").pieces()
    }

    fn outfit(pieces: &[(u32, Vec<u8>)]) -> Outfit<'_> {
        Outfit::paper(pieces)
    }

    fn sensor(wire: Wire) -> Self::Sensor {
        Lis2dw12::new(wire)
    }

    fn memory(cells: Cells) -> Self::Memory {
        RecordMemory::new(Medium(cells), build(&PAPER))
    }

    fn calibrated(cells: Cells) -> Cells {
        let mut memory = Self::memory(cells);
        RecordStore::start(&mut memory).expect(ROOM);
        stage(&mut memory, Record::Calibration, &tables()).expect(ROOM);
        RecordStore::commit(&mut memory).expect(ROOM);
        memory.flash().0.clone()
    }

    fn factory(channel: Channel, serial: u32) -> Factory {
        factory::paper(channel, serial)
    }

    fn end(_: &mut Pair) {}
}

/// A calibration that parts without errors bear: a hundredth of the terms that are not theirs.
fn mild() -> Calibration {
    let mut calibration = calibration();
    if let TemperatureModel::Quadratic(terms) = &mut calibration.temperature {
        let small = |terms: &mut [i32; 3]| terms.iter_mut().for_each(|term| *term /= 100);
        small(&mut terms.offset1_q8);
        small(&mut terms.offset2_q16);
        small(&mut terms.gain1_q38);
        small(&mut terms.gain2_q46);
    }
    if let Correction::TwoAxis { vector, .. } = &mut calibration.correction {
        let ideal = Vector::IDENTITY;
        let both = vector.matrix.iter_mut().flatten();
        for (term, ideal) in both.zip(ideal.matrix.into_iter().flatten()) {
            *term = ideal + (*term - ideal) / 100;
        }
        vector.offset.iter_mut().for_each(|term| *term /= 100);
    }
    calibration
}

/// Errors of a gyroscope, each so small that a part without errors bears it.
fn rates() -> RateCorrection {
    let mut rates = RateCorrection {
        scale1_q38: [2_000, -3_000, 5_000],
        // 0.01 deg/s.
        bias_q30: [187_000, -187_000, 90_000],
        bias1_q38: [100_000, -50_000, 70_000],
        bias2_q46: [30_000, 20_000, -10_000],
        ..RateCorrection::IDENTITY
    };
    // 0.01 % of the largest entry.
    let both = rates.matrix.iter_mut().flatten();
    both.zip(1..).for_each(|(entry, n)| *entry += 12_345 * n);
    rates
}

/// Two full tables, of parts without errors.
fn tables() -> Calibration {
    let point = |deg: i32| {
        let angle = f64::from(deg);
        Point {
            accel: (angle.to_radians().sin() * f64::from(ONE_G)).round() as i32,
            angle: Angle::from_degrees(angle),
        }
    };
    let points: Vec<_> = (-90..=90).map(point).collect();
    let table = Table::new(&points).expect("a table");
    let mut calibration = Calibration {
        correction: Correction::Tables {
            tables: Axes {
                x: table.clone(),
                y: table,
            },
            rule: device::factory::RULE,
        },
        ..Calibration::NOMINAL
    };
    calibration.temperature = TemperatureModel::None;
    calibration
}
