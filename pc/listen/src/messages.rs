//! What single messages carry, without the node that sent them.
//!
//! Left out: how they are decoded (`decode`), and what they mean with others (`Meaning`).

/// What a PDO of the exchange carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The angles and their quality (TPDO 3).
    Angles,
    /// The vector behind them (TPDO 4).
    Vector,
    /// Both: a PDO that was mapped so.
    Both,
}

impl Part {
    /// Whether the angles are in it.
    pub const fn has_angles(self) -> bool {
        !matches!(self, Self::Vector)
    }

    /// Whether the vector is in it.
    pub const fn has_vector(self) -> bool {
        !matches!(self, Self::Angles)
    }
}

/// An EMCY message (CiA 301, 7.2.7), its manufacturer bytes as docs/canopen.md has them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Emergency {
    /// Error code; 0 when faults have gone.
    pub code: u16,
    /// Error register (1001h).
    pub register: u8,
    /// Bytes 3 to 7 as they came.
    pub bytes: [u8; 5],
}
