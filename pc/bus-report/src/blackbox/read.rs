//! Asking a node for what it remembers.
//!
//! In: a bus and a node-id. Out: the bytes of its fault log and of its boxes, by SDO, as they
//! came. Nothing is changed in the node: emptying the log is somebody's decision, not a reader's.

use bus_master::Bus;
use bus_master::fault::Fault;
use bus_master::sdo::{Client, SdoError};
use canopen::object::Abort;

/// The fault log.
const LOG: u16 = 0x2070;

/// The black box.
const BOX: u16 = 0x2071;

/// Boxes.
pub const BOXES: u8 = 2;

/// What a node has given.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Bytes {
    /// Its fault log.
    pub log: Vec<u8>,
    /// Its boxes; `None` for an empty one.
    pub boxes: [Option<Vec<u8>>; BOXES as usize],
}

/// Asks a node.
///
/// Errors: see [`Fault`]; a node that is silent is looked for.
pub fn ask(bus: &mut Bus, node: u8) -> Result<Bytes, Fault> {
    try_ask(bus, node).map_err(|why| Fault::sdo(bus, node, why))
}

fn try_ask(bus: &mut Bus, node: u8) -> Result<Bytes, SdoError> {
    let mut client = Client::new(bus, node);
    let mut bytes = Bytes {
        log: client.upload(LOG, 0)?,
        ..Bytes::default()
    };
    for (sub, place) in (1..).zip(&mut bytes.boxes) {
        *place = match client.upload(BOX, sub) {
            // It is empty.
            Err(why) if why.is_refusal(Abort::NoData) => None,
            content => Some(content?),
        };
    }
    Ok(bytes)
}
