//! What the code exchanges with sensor, clock and CAN controller, written down in its order.
//!
//! In: loads and stores of TIM2 and CAN, and the sensor's bytes. Out: [`Entry`]s, with which
//! another machine that runs the same code can be fed, and whose doings can be compared with it.
//!
//! Left out: everything else that the code can see: the flash, and registers that do not change.

use std::mem;
use std::ops::RangeInclusive;

/// TIM2 (RM0008 3.3).
pub const TIM2: u32 = 0x4000_0000;
/// CAN (RM0008 3.3).
pub const CAN: u32 = 0x4000_6400;
/// Bytes of a peripheral.
const SIZE: u32 = 0x400;

/// What has happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Deed {
    /// A load from this address gave this.
    Load(u32, u32),
    /// A store of this went to this address.
    Store(u32, u32),
    /// The sensor was selected, or let go.
    Select(bool),
    /// A byte went to the sensor, and this one came back.
    Byte(u8, u8),
}

/// Something that has happened, and in the handler of which exception: 0 for none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Number of the exception.
    pub exception: u32,
    /// What has happened.
    pub deed: Deed,
}

/// Who writes it down.
#[derive(Clone, Debug, Default)]
pub struct Tap {
    entries: Option<Vec<Entry>>,
    exception: u32,
    /// Who has selected the sensor: its bytes are that one's.
    selector: u32,
}

impl Tap {
    /// Begins, or begins anew.
    pub fn start(&mut self) {
        self.entries = Some(Vec::new());
    }

    /// What was written down since, and no more from now on.
    pub fn take(&mut self) -> Vec<Entry> {
        mem::take(&mut self.entries).unwrap_or_default()
    }

    /// Whether what happens at this address is written down.
    #[inline]
    pub(super) fn wants(&self, address: u32) -> bool {
        let of = |base: u32| -> RangeInclusive<u32> { base..=base + SIZE - 1 };
        self.entries.is_some() && (of(TIM2).contains(&address) || of(CAN).contains(&address))
    }

    /// The code is in the handler of this exception from now on.
    pub(super) fn enter(&mut self, exception: u32) {
        self.exception = exception;
    }

    /// Writes down what the code does.
    pub(super) fn note(&mut self, deed: Deed) {
        if matches!(deed, Deed::Select(_)) {
            self.selector = self.exception;
        }
        let exception = match deed {
            Deed::Byte(..) => self.selector,
            _ => self.exception,
        };
        if let Some(entries) = &mut self.entries {
            entries.push(Entry { exception, deed });
        }
    }
}
