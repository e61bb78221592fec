//! Device configuration of one channel with a node-id (CiA 306).
//!
//! In: the rows, a channel and its node-id. Out: the text of a `.dcf` file: the data sheet, what
//! the node is called, and as `ParameterValue` every writable number that depends on the channel
//! or on the node-id, so that a tool that loads the file makes the node what it was delivered as.
//!
//! Left out: the other channel's node-id, which stays the delivered one in 1016h, 1400h to 1402h
//! and 2001h; whoever moves one channel writes these on the other.

use canopen::object::Access;
use device::objects::row::{Default, Row};
use device::objects::table::Channel;

use super::dictionary;
use super::eds::{self, Extra, File};

/// Bit rate as delivered, in kbit/s.
pub const BIT_RATE: u16 = 250;

/// What the configuration adds.
struct Configured {
    channel: Channel,
    node_id: u8,
    /// The name of the data sheet.
    sheet: String,
}

impl Extra for Configured {
    fn file_info(&self, file: &mut File) {
        file.key("LastEDS", &self.sheet);
    }

    fn entry(&self, file: &mut File, row: &Row) {
        let depends = matches!(row.default, Default::NodeId(_) | Default::Channel(..));
        if !depends || !row.access.has(Access::WRITE) {
            return;
        }
        if let Some(number) = dictionary::delivered(row, self.channel, self.node_id) {
            file.key("ParameterValue", dictionary::number(row, number));
        }
    }
}

/// The configuration of a channel under this node-id, 1 to 127.
pub fn configuration(rows: &[Row], channel: Channel, node_id: u8) -> String {
    let mut file = File::default();
    let name = eds::file_name(rows, channel, "dcf");
    eds::write(
        &mut file,
        rows,
        channel,
        &name,
        &Configured {
            channel,
            node_id,
            sheet: eds::file_name(rows, channel, "eds"),
        },
    );
    // The format spells this section with one m.
    file.section("DeviceComissioning");
    file.key("NodeID", node_id);
    file.key("NodeName", format!("Plumb {}", dictionary::letter(channel)));
    file.key("Baudrate", BIT_RATE);
    file.key("NetNumber", 1);
    file.key("NetworkName", "Plumb");
    file.key("CANopenManager", 0);
    // 0 stands for a piece whose number is not known, as in a file for all of them.
    file.key("LSS_SerialNumber", 0);
    file.into_text()
}
