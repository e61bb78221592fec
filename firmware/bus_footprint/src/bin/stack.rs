//! The CANopen stack with the instrument's whole dictionary, over a device that is hidden.
//!
//! In: nothing. Out: a binary for the part whose code, tables, state and frames are the stack's.
#![cfg_attr(target_os = "none", no_std, no_main)]

use bus_footprint::Entries;
use bus_footprint::stand_in::Hidden;
use canopen::node::Node;

/// What is measured; the linker script keeps it by its name.
#[used]
static REACHED: Entries<Hidden> = Entries::all();

/// As much room as the node's state takes.
#[used]
static RAM_OF_NODE: [u8; size_of::<Node>()] = [0; size_of::<Node>()];

#[cfg(not(target_os = "none"))]
fn main() {
    println!("measured for the part by `cargo xtask size`; nothing to run");
}
