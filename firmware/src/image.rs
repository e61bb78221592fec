//! What an image is made of, beside what all images share: the product's, its variant's with a
//! gyroscope, and the paper's.
//!
//! In: what the board has. Out: instrument, sensor, memory and factory setting for the device, and
//! what is done in the background.

use device::device::Factory;
use device::instrument::{self, Instrument};
use device::memory::records_only::RecordMemory;
use device::memory::{Build, FlashMemory};
use device::objects::device_objects;
use device::objects::table::Channel;
use device::sensor::ism330dhcx::Ism330dhcx;
use device::sensor::{Lis2dw12, Part};
use flash::layout::Layout;

use crate::chip::board::Select;
use crate::chip::eraser::Lent;
use crate::chip::nor::{Controller, Erase, Nor};
use crate::chip::spi::Sensor;
use crate::factory;
use crate::new_program::{Background, check_new};
use crate::part::{LAYOUT, PAPER};
use crate::self_check::running_slot;

/// An image's own choices.
pub trait Image {
    /// The stages and services of its device.
    type Instrument: Instrument;
    /// The driver of its sensor.
    type Sensor: Part;
    /// What erases its flash.
    type Eraser: Erase;
    /// Where the device keeps what outlives a reset.
    type Memory: device_objects::Memory;
    /// The driver over the wires of the sensor.
    fn sensor(wires: Sensor<Select>) -> Self::Sensor;
    /// The memory over the chip's flash.
    fn memory(nor: Nor<Self::Eraser>) -> Self::Memory;
    /// What the node is before anything was stored in it.
    fn factory(channel: Channel, serial: u32) -> Factory;
    /// What else is done when nothing else is to be done; everything interrupts it.
    fn background();
}

/// What a program linked with this map states of itself.
fn build(layout: &'static Layout) -> Build {
    Build {
        layout,
        running: running_slot(layout),
        hardware: layout.hardware,
    }
}

/// The product: two slots with signed updates, records, an event log.
pub struct Product;

impl Image for Product {
    type Instrument = instrument::Product;
    type Sensor = Lis2dw12<Sensor<Select>>;
    type Eraser = Controller;
    type Memory = FlashMemory<Nor, Background>;

    fn sensor(wires: Sensor<Select>) -> Self::Sensor {
        Lis2dw12::new(wires)
    }

    fn memory(nor: Nor) -> Self::Memory {
        FlashMemory::new(nor, build(&LAYOUT), Background)
    }

    fn factory(channel: Channel, serial: u32) -> Factory {
        factory::product(channel, serial)
    }

    fn background() {
        check_new();
    }
}

/// The variant with a gyroscope: the product around another sensor.
pub struct Dynamic;

impl Image for Dynamic {
    type Instrument = instrument::Dynamic;
    type Sensor = Ism330dhcx<Sensor<Select>>;
    type Eraser = Controller;
    type Memory = FlashMemory<Nor, Background>;

    fn sensor(wires: Sensor<Select>) -> Self::Sensor {
        Ism330dhcx::new(wires)
    }

    fn memory(nor: Nor) -> Self::Memory {
        Product::memory(nor)
    }

    fn factory(channel: Channel, serial: u32) -> Factory {
        factory::dynamic(channel, serial)
    }

    fn background() {
        Product::background();
    }
}

/// The paper's instrument on the paper's part: one slot, records, and nothing in the application
/// that erases.
pub struct Paper;

impl Image for Paper {
    type Instrument = instrument::Paper;
    type Sensor = Lis2dw12<Sensor<Select>>;
    type Eraser = Lent;
    type Memory = RecordMemory<Nor<Lent>>;

    fn sensor(wires: Sensor<Select>) -> Self::Sensor {
        Lis2dw12::new(wires)
    }

    fn memory(nor: Nor<Lent>) -> Self::Memory {
        RecordMemory::new(nor, build(&PAPER))
    }

    fn factory(channel: Channel, serial: u32) -> Factory {
        factory::paper(channel, serial)
    }

    fn background() {}
}
