//! What a wire format does for one client.
//!
//! In: the bytes of the client. Out: [`Heard`]: bytes to answer, frames for the bus, and what else
//! follows from them.
//!
//! Left out: the wire formats themselves, and how the bytes travel.

use std::time::Duration;

use canopen::Frame;

use super::outlet::Tap;

/// What a piece of a client's bytes came to.
#[derive(Debug, Default)]
pub struct Heard {
    /// Bytes to send back.
    pub answer: Vec<u8>,
    /// Frames for the bus, in order.
    pub frames: Vec<Frame>,
    /// A new form of the frames it gets, and how long the first of them are held back.
    pub tap: Option<(Tap, Duration)>,
    /// Something the person at the bus should know.
    pub notice: Option<String>,
    /// Why the conversation ends here.
    pub close: Option<String>,
}

/// A wire format, as one client speaks it.
pub trait Dialogue: Send {
    /// Takes the next bytes of the client; adds to `heard` what they came to.
    fn hear(&mut self, bytes: &[u8], heard: &mut Heard);

    /// True while the client has the bus open.
    fn is_open(&self) -> bool;

    /// The bytes that tell the client why it has to go; nothing where the format has no words.
    fn refusal(&self, _why: &str) -> Vec<u8> {
        Vec::new()
    }
}
