//! Names of the bits of bxCAN's control and status registers (RM0008 24.9.2).
//!
//! In, out: numbers. Left out: bits that nobody asks for.

/// Master control.
pub mod mcr {
    /// Initialisation is asked for.
    pub const INRQ: u32 = 1;
    /// Sleep is asked for.
    pub const SLEEP: u32 = 1 << 1;
    /// A full FIFO is locked against newer frames.
    pub const RFLM: u32 = 1 << 3;
    /// No automatic retransmission.
    pub const NART: u32 = 1 << 4;
    /// Automatic return from bus-off.
    pub const ABOM: u32 = 1 << 6;
    /// Master reset.
    pub const RESET: u32 = 1 << 15;
}

/// Master status.
pub mod msr {
    /// Initialisation mode.
    pub const INAK: u32 = 1;
    /// Sleep mode.
    pub const SLAK: u32 = 1 << 1;
    /// An error's interrupt.
    pub const ERRI: u32 = 1 << 2;
    /// A wake-up's interrupt.
    pub const WKUI: u32 = 1 << 3;
    /// Sleep's interrupt.
    pub const SLAKI: u32 = 1 << 4;
    /// The level of the last sample point; the bus is taken to be recessive.
    pub const SAMP: u32 = 1 << 10;
    /// The level of the pin.
    pub const RX: u32 = 1 << 11;
}

/// Transmit status; those of mailbox 0, the others 8 and 16 bits higher.
pub mod tsr {
    /// The request is completed.
    pub const RQCP: u32 = 1;
    /// It was sent.
    pub const TXOK: u32 = 1 << 1;
    /// It lost an arbitration.
    pub const ALST: u32 = 1 << 2;
    /// An attempt failed.
    pub const TERR: u32 = 1 << 3;
    /// It is to be taken back.
    pub const ABRQ: u32 = 1 << 7;
    /// Mailbox 0 is empty; those of the others follow.
    pub const TME0: u32 = 1 << 26;
    /// Mailbox 0 is last in line; those of the others follow.
    pub const LOW0: u32 = 1 << 29;
}

/// Interrupt enable.
pub mod ier {
    /// A mailbox has fallen empty.
    pub const TMEIE: u32 = 1;
    /// FIFO 0 has a frame; FIFO 1's three are 3 bits higher.
    pub const FMPIE0: u32 = 1 << 1;
    /// FIFO 0 is full.
    pub const FFIE0: u32 = 1 << 2;
    /// FIFO 0 had an overrun.
    pub const FOVIE0: u32 = 1 << 3;
    /// Warning limit.
    pub const EWGIE: u32 = 1 << 8;
    /// Error passive.
    pub const EPVIE: u32 = 1 << 9;
    /// Bus-off.
    pub const BOFIE: u32 = 1 << 10;
    /// A new error code.
    pub const LECIE: u32 = 1 << 11;
    /// Any of the last four.
    pub const ERRIE: u32 = 1 << 15;
    /// Wake-up.
    pub const WKUIE: u32 = 1 << 16;
    /// Sleep.
    pub const SLKIE: u32 = 1 << 17;
}

/// Error status.
pub mod esr {
    /// A counter is at 96 or more.
    pub const EWGF: u32 = 1;
    /// A counter is beyond 127.
    pub const EPVF: u32 = 1 << 1;
    /// Off the bus.
    pub const BOFF: u32 = 1 << 2;
}
