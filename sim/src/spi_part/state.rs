//! The state that every part has: its registers, its time, what it is busy with, its wires.
//!
//! In: bytes, times, faults. Out: what the registers hold and whether the part answers. What a
//! register means is the part's own.

use super::{Fault, Phase, Wire};

/// Addresses on the wire: seven bits.
pub const ADDRESSES: usize = 128;

/// The register contents, indexed by address.
pub type Registers = [u8; ADDRESSES];

/// One part's state.
#[derive(Clone, Debug)]
pub struct State {
    /// What the bus sees.
    pub registers: Registers,
    /// What the part is busy with.
    pub phase: Phase,
    phase_end_ns: u64,
    /// The part's time in nanoseconds.
    pub now_ns: u64,
    /// Where the transaction stands.
    pub wire: Wire,
    /// The fault injected at present.
    pub fault: Option<Fault>,
}

impl State {
    /// Without supply; the registers' reset values.
    pub fn new(reset: Registers) -> Self {
        Self {
            registers: reset,
            phase: Phase::Off,
            phase_end_ns: u64::MAX,
            now_ns: 0,
            wire: Wire::Idle,
            fault: None,
        }
    }

    /// What a register holds.
    #[inline]
    pub fn register(&self, address: u8) -> u8 {
        self.registers[usize::from(address) % ADDRESSES]
    }

    /// Overwrites a register.
    pub fn put(&mut self, address: u8, value: u8) {
        self.registers[usize::from(address) % ADDRESSES] = value;
    }

    /// Sets bits of a register.
    #[inline]
    pub fn set(&mut self, address: u8, bits: u8) {
        self.registers[usize::from(address) % ADDRESSES] |= bits;
    }

    /// Clears bits of a register.
    #[inline]
    pub fn clear(&mut self, address: u8, bits: u8) {
        self.registers[usize::from(address) % ADDRESSES] &= !bits;
    }

    /// A byte from the bus. Only `writable` bits take it, and only while the part is ready; true
    /// when it was taken.
    pub fn accept(&mut self, address: u8, value: u8, writable: &Registers) -> bool {
        if self.phase != Phase::Ready || self.fault == Some(Fault::WriteRefused(address)) {
            return false;
        }
        let mask = writable[usize::from(address) % ADDRESSES];
        self.put(address, (self.register(address) & !mask) | (value & mask));
        true
    }

    /// Whether the part sends anything at all.
    #[inline]
    pub fn answers(&self) -> bool {
        !matches!(self.phase, Phase::Off | Phase::PowerUp)
    }

    /// The supply is gone.
    pub fn power_off(&mut self) {
        self.phase = Phase::Off;
        self.phase_end_ns = u64::MAX;
    }

    /// The part is busy with this for so long from now, in nanoseconds.
    pub fn enter(&mut self, phase: Phase, duration_ns: u64) {
        self.phase = phase;
        self.phase_end_ns = self.now_ns.saturating_add(duration_ns);
    }

    /// Moves the time on; true when a boot or a reset has ended by it. An earlier time than the
    /// last changes nothing.
    pub fn advance_to(&mut self, time_ns: u64) -> bool {
        self.now_ns = self.now_ns.max(time_ns);
        let over = self.now_ns >= self.phase_end_ns && self.fault != Some(Fault::ResetStuck);
        if over {
            self.phase = Phase::Ready;
            self.phase_end_ns = u64::MAX;
        }
        over
    }
}
