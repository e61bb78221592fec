//! One classical CAN frame, as it stands on the bus (ISO 11898-1: 11 or 29 bit identifier).
//!
//! In and out of everything in this crate. CANopen itself speaks in 11-bit data frames; remote
//! frames come for node guarding and for PDOs, 29-bit frames only as somebody else's traffic.
//!
//! Left out: CAN FD, and bit timing.

pub use embedded_can::{ExtendedId, Id, StandardId};

/// A data or remote frame of 0 to 8 bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    id: Id,
    remote: bool,
    length: u8,
    data: [u8; 8],
}

/// Cuts a number to the 11 bits of a CANopen identifier.
pub const fn standard(id: u16) -> StandardId {
    match StandardId::new(id & 0x7FF) {
        Some(id) => id,
        None => StandardId::ZERO,
    }
}

/// Identifiers that no configurable service may take, since fixed ones own them
/// (CiA 301, 7.3.5): NMT, safety, SDO, and error control.
pub(crate) const fn is_restricted(id: u32) -> bool {
    matches!(id, 0..=0x07F | 0x101..=0x180 | 0x581..=0x5FF | 0x601..=0x67F | 0x6E0..=0x6FF)
        || id > 0x700
}

impl Frame {
    /// A data frame of no bytes with the identifier 0, in the place of one that is not there.
    pub const EMPTY: Self = Self {
        id: Id::Standard(StandardId::ZERO),
        remote: false,
        length: 0,
        data: [0; 8],
    };

    /// A data frame with an 11-bit identifier (upper bits cut) and at most 8 bytes (rest cut).
    ///
    /// For frames whose form is known where they are made; from outside use [`Frame::with`].
    pub fn data_frame(id: u16, bytes: &[u8]) -> Self {
        let mut data = [0; 8];
        let mut length = 0;
        for (to, from) in data.iter_mut().zip(bytes) {
            *to = *from;
            length += 1;
        }
        Self {
            id: Id::Standard(standard(id)),
            remote: false,
            length,
            data,
        }
    }

    /// A data frame with any identifier and the lowest `length` bytes of a number, at most 8.
    pub fn of_number(id: impl Into<Id>, number: u64, length: u8) -> Self {
        let beyond = match length {
            0..8 => u64::MAX << (8 * u32::from(length)),
            _ => 0,
        };
        Self {
            id: id.into(),
            remote: false,
            length: length.min(8),
            data: (number & !beyond).to_le_bytes(),
        }
    }

    /// A data frame with any identifier; `None` when there are more than 8 bytes.
    pub fn with(id: impl Into<Id>, bytes: &[u8]) -> Option<Self> {
        let frame = Self::data_frame(0, bytes);
        (bytes.len() <= 8).then_some(Self {
            id: id.into(),
            ..frame
        })
    }

    /// A remote frame that asks for `length` bytes; `None` above 8.
    pub fn remote(id: impl Into<Id>, length: usize) -> Option<Self> {
        let length = u8::try_from(length).ok().filter(|l| *l <= 8)?;
        Some(Self {
            id: id.into(),
            remote: true,
            length,
            data: [0; 8],
        })
    }

    /// A frame of the parts that [`Frame::id`], [`Frame::is_remote`], [`Frame::length`] (rest cut)
    /// and [`Frame::padded`] give: bytes past the length are zero, as are all of a remote one.
    pub const fn of_parts(id: Id, remote: bool, length: u8, data: [u8; 8]) -> Self {
        Self {
            id,
            remote,
            length: if length > 8 { 8 } else { length },
            data,
        }
    }

    /// The identifier.
    pub const fn id(&self) -> Id {
        self.id
    }

    /// The 11-bit identifier; `None` for a 29-bit one.
    pub fn cob_id(&self) -> Option<u16> {
        match self.id {
            Id::Standard(id) => Some(id.as_raw()),
            Id::Extended(_) => None,
        }
    }

    /// True for a remote frame.
    pub const fn is_remote(&self) -> bool {
        self.remote
    }

    /// The data length code: bytes carried, or asked for by a remote frame.
    pub const fn length(&self) -> usize {
        self.length as usize
    }

    /// The bytes carried; empty for a remote frame.
    pub fn bytes(&self) -> &[u8] {
        let length = if self.remote { 0 } else { self.length() };
        self.data.get(..length).unwrap_or(&[])
    }

    /// All eight bytes, zero past the length.
    pub const fn padded(&self) -> [u8; 8] {
        self.data
    }
}

impl embedded_can::Frame for Frame {
    fn new(id: impl Into<Id>, data: &[u8]) -> Option<Self> {
        Self::with(id, data)
    }

    fn new_remote(id: impl Into<Id>, dlc: usize) -> Option<Self> {
        Self::remote(id, dlc)
    }

    fn is_extended(&self) -> bool {
        matches!(self.id, Id::Extended(_))
    }

    fn is_remote_frame(&self) -> bool {
        self.remote
    }

    fn id(&self) -> Id {
        self.id
    }

    fn dlc(&self) -> usize {
        self.length()
    }

    fn data(&self) -> &[u8] {
        self.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_made_anew_of_its_parts() {
        let id = Id::Extended(ExtendedId::MAX);
        let frames = [
            Frame::data_frame(0x123, &[1, 2, 3]),
            Frame::of_number(id, u64::MAX, 8),
            Frame::remote(id, 5).unwrap(),
        ];
        for frame in frames {
            let length = frame.length() as u8;
            let made = Frame::of_parts(frame.id(), frame.is_remote(), length, frame.padded());
            assert_eq!(made, frame);
        }
        assert_eq!(Frame::of_parts(id, false, 9, [0; 8]).length(), 8);
    }

    #[test]
    fn nine_bytes_are_no_frame() {
        assert_eq!(Frame::with(standard(1), &[0; 9]), None);
        assert_eq!(Frame::remote(standard(1), 9), None);
    }

    #[test]
    fn a_number_is_cut_to_the_length() {
        for length in 0..=9 {
            let frame = Frame::of_number(standard(1), 0x8877_6655_4433_2211, length);
            let bytes = [0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88];
            let kept = usize::from(length.min(8));
            assert_eq!(frame, Frame::data_frame(1, &bytes[..kept]));
        }
    }

    #[test]
    fn a_remote_frame_carries_nothing_but_its_length() {
        let frame = Frame::remote(standard(0x701), 1).unwrap();
        assert_eq!((frame.length(), frame.bytes()), (1, &[][..]));
    }

    #[test]
    fn an_extended_identifier_is_no_cob_id() {
        let frame = Frame::with(ExtendedId::new(0x181).unwrap(), &[]).unwrap();
        assert_eq!(frame.cob_id(), None);
    }
}
