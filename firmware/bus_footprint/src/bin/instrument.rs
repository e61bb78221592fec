//! The CANopen stack with the instrument's dictionary and everything behind its rows.
//!
//! In: nothing. Out: a binary for the part whose code, tables, state and frames are those of the
//! whole bus side: stack, slopes, calibration over the bus, settings, program download.
#![cfg_attr(target_os = "none", no_std, no_main)]

use bus_footprint::Entries;
use bus_footprint::stand_in::{Measuring, Memory};
use canopen::node::Node;
use device::instrument::Product;
use device::objects::device_objects::DeviceObjects;
use device::objects::values::Values;

/// What is measured; the linker script keeps it by its name.
#[used]
static REACHED: Entries<DeviceObjects<'static, Memory, Measuring, Product>> = Entries::all();

/// As much room as the node's state takes.
#[used]
static RAM_OF_NODE: [u8; size_of::<Node>()] = [0; size_of::<Node>()];

/// As much room as the values behind the rows take.
#[used]
static RAM_OF_VALUES: [u8; size_of::<Values>()] = [0; size_of::<Values>()];

#[cfg(not(target_os = "none"))]
fn main() {
    println!("measured for the part by `cargo xtask size`; nothing to run");
}
