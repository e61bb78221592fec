//! SYNC: consumer and producer (CiA 301, 7.2.5; objects 1005h, 1006h, 1007h, 1019h).
//!
//! In: frames, the time, and the request to stand in when nobody else makes SYNC. Out: whether a
//! frame is a SYNC and its counter, and this node's own SYNC at absolute deadlines, so that late
//! calls don't add up.
//!
//! Left out: what happens at a SYNC (`pdo`, and the device).

use crate::frame::{Frame, is_restricted};
use crate::nmt::State;
use crate::object::{Abort, Address, Place, Value};
use crate::time::Deadline;
use instant::Instant;

/// Bit 30 of 1005h: this node produces.
pub(crate) const PRODUCE: u32 = 1 << 30;

/// A SYNC that has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Synced {
    /// Its counter, where one is used (1019h).
    pub counter: Option<u8>,
}

/// SYNC: parameters and state.
#[derive(Clone, Copy, Debug)]
pub struct Sync {
    cob_id: u32,
    period_us: u32,
    window_us: u32,
    overflow: u8,
    /// Period of a SYNC that this node makes because nobody else does.
    absence_us: Option<u32>,
    counter: u8,
    due: Deadline,
    /// This node's SYNC waits for the bus.
    under_way: bool,
}

impl Sync {
    /// COB-ID 80h, nothing produced, no counter, no window.
    pub const fn new() -> Self {
        Self {
            cob_id: 0x80,
            period_us: 0,
            window_us: 0,
            overflow: 0,
            absence_us: None,
            counter: 0,
            due: Deadline::NONE,
            under_way: false,
        }
    }

    const fn id(&self) -> u16 {
        (self.cob_id & 0x7FF) as u16
    }

    /// 1007h, us; 0 for no window.
    pub const fn window_us(&self) -> u32 {
        self.window_us
    }

    /// True for a frame with the identifier of SYNC.
    pub fn recognises(&self, frame: &Frame) -> bool {
        frame.cob_id() == Some(self.id()) && !frame.is_remote()
    }

    /// True for a frame of this node that has gone out and is its SYNC.
    ///
    /// One of another service that was given the same identifier is not: a PDO that answers SYNC
    /// would otherwise answer itself without end.
    pub fn is_own(&mut self, frame: &Frame) -> bool {
        self.recognises(frame) && core::mem::take(&mut self.under_way)
    }

    /// A frame that [`Sync::recognises`]: its counter. Errors: its length, when that does not fit
    /// 1019h; such a SYNC is not obeyed.
    pub fn receive(&mut self, frame: &Frame) -> Result<Synced, u8> {
        match (self.overflow, frame.bytes()) {
            (0, []) => Ok(Synced { counter: None }),
            (1.., &[counter]) => Ok(Synced {
                counter: Some(counter),
            }),
            (_, bytes) => Err(bytes.len() as u8),
        }
    }

    /// The period that this node produces at now.
    fn producing(&self) -> Option<u32> {
        let commanded = self.cob_id & PRODUCE != 0 && self.period_us != 0;
        let period = commanded.then_some(self.period_us);
        period.or(self.absence_us)
    }

    /// A reset is over: the producer begins with counter 1.
    pub fn start(&mut self, now: Instant) {
        self.counter = 0;
        self.restart(now);
    }

    fn restart(&mut self, now: Instant) {
        self.due = Deadline::in_us(now, self.producing().unwrap_or(0).into());
    }

    /// Asks for SYNC at this period although 1005h does not; `None` ends it.
    ///
    /// A period that is commanded (1005h, 1006h) goes before, and its deadlines stay.
    pub fn produce_for_absence(&mut self, period_us: Option<u32>, now: Instant) {
        let before = self.producing();
        self.absence_us = period_us;
        if self.producing() != before {
            self.restart(now);
        }
    }

    /// When the producer wants to send next.
    pub const fn poll(&self, state: State) -> Deadline {
        if state.allows_sync() {
            self.due
        } else {
            Deadline::NONE
        }
    }

    /// The identifier of a SYNC that is due.
    pub fn next_cob_id(&self, state: State, now: Instant) -> Option<u16> {
        let due = self.poll(state).is_due(now);
        due.then_some(self.id())
    }

    /// The SYNC that is due. One that is late by more than a period is not made up for.
    pub fn transmit(&mut self, now: Instant) -> Option<Frame> {
        if !self.due.is_due(now) {
            return None;
        }
        let period_us = u64::from(self.producing()?);
        self.due = self.due.in_step(period_us, now);
        self.under_way = true;
        if self.overflow == 0 {
            return Some(Frame::data_frame(self.id(), &[]));
        }
        self.counter = if self.counter >= self.overflow {
            1
        } else {
            self.counter + 1
        };
        Some(Frame::data_frame(self.id(), &[self.counter]))
    }

    /// 1005h, 1006h, 1007h, 1019h.
    // Two callers, each of which would hold a copy of it.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub const fn place(&mut self, at: Address) -> Place<'_> {
        match at.index {
            0x1005 => Place::U32(&mut self.cob_id),
            0x1006 => Place::U32(&mut self.period_us),
            0x1007 => Place::U32(&mut self.window_us),
            _ => Place::U8(&mut self.overflow),
        }
    }

    /// A write by SDO.
    ///
    /// The identifier stays while this node produces, and the counter's overflow while a period
    /// is set (CiA 301, 7.5.2.5 and 7.5.2.22).
    pub fn write(&mut self, at: Address, value: Value, now: Instant) -> Option<Result<(), Abort>> {
        let number = value.unsigned() as u32;
        let refused = match at.index {
            0x1005 => self.refuse_cob_id(number),
            // Faster than this it would take the bus, and nobody could take it back.
            0x1006 if matches!(number, 1..1000) => Some(Abort::ValueTooLow),
            0x1019 if self.period_us != 0 => Some(Abort::WrongState),
            0x1019 if number == 1 || number > 240 => Some(Abort::InvalidValue),
            _ => None,
        };
        if let Some(abort) = refused {
            return Some(Err(abort));
        }
        let before = self.producing();
        self.place(at).set(value);
        if self.producing() != before {
            self.start(now);
        }
        Some(Ok(()))
    }

    fn refuse_cob_id(&self, number: u32) -> Option<Abort> {
        let produces = self.cob_id & PRODUCE != 0;
        let keeps_id = number & 0x7FF == u32::from(self.id());
        let other_bits = number & !(PRODUCE | 0x7FF | 1 << 31) != 0;
        let wrong = other_bits || is_restricted(number & 0x7FF);
        (wrong || (produces && !keeps_id)).then_some(Abort::InvalidValue)
    }
}

impl Default for Sync {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::at;

    const OP: State = State::Operational;

    fn write(sync: &mut Sync, index: u16, number: u32) -> Result<(), Abort> {
        let value = if index == 0x1019 {
            Value::u8(number as u8)
        } else {
            Value::u32(number)
        };
        sync.write(at(index, 0), value, Instant(0)).unwrap()
    }

    #[test]
    fn a_producer_keeps_to_absolute_deadlines() {
        let mut sync = Sync::new();
        assert_eq!(write(&mut sync, 0x1006, 10_000), Ok(()));
        assert_eq!(sync.poll(OP).get(), None);
        assert_eq!(write(&mut sync, 0x1005, PRODUCE | 0x80), Ok(()));
        assert_eq!(sync.poll(OP).get(), Some(Instant(10_000)));
        assert_eq!(sync.transmit(Instant(9_999)), None);
        // 3 ms late: the next one is due where it was.
        assert_eq!(
            sync.transmit(Instant(13_000)),
            Some(Frame::data_frame(0x80, &[]))
        );
        assert_eq!(sync.poll(OP).get(), Some(Instant(20_000)));
        assert_eq!(sync.poll(State::Stopped).get(), None);
        // Three periods late: one SYNC, and no burst after it.
        assert!(sync.transmit(Instant(50_000)).is_some());
        assert_eq!(sync.poll(OP).get(), Some(Instant(60_000)));
    }

    #[test]
    fn a_period_that_would_take_the_whole_bus_is_refused() {
        let mut sync = Sync::new();
        assert_eq!(write(&mut sync, 0x1006, 1), Err(Abort::ValueTooLow));
        assert_eq!(write(&mut sync, 0x1006, 999), Err(Abort::ValueTooLow));
        assert_eq!(write(&mut sync, 0x1006, 1000), Ok(()));
        assert_eq!(write(&mut sync, 0x1006, 0), Ok(()));
    }

    #[test]
    fn the_counter_runs_from_1_to_its_overflow() {
        let mut sync = Sync::new();
        assert_eq!(write(&mut sync, 0x1019, 3), Ok(()));
        write(&mut sync, 0x1006, 1000).unwrap();
        write(&mut sync, 0x1005, PRODUCE | 0x80).unwrap();
        let counters = (1..=5).map(|n| sync.transmit(Instant(n * 1000)).unwrap().bytes()[0]);
        assert!(counters.eq([1, 2, 3, 1, 2]));
        assert_eq!(write(&mut sync, 0x1019, 4), Err(Abort::WrongState));
    }

    #[test]
    fn a_sync_of_the_wrong_length_is_not_obeyed() {
        let mut sync = Sync::new();
        let plain = Frame::data_frame(0x80, &[]);
        let counted = Frame::data_frame(0x80, &[7]);
        assert_eq!(sync.receive(&plain), Ok(Synced { counter: None }));
        assert_eq!(sync.receive(&counted), Err(1));
        write(&mut sync, 0x1019, 10).unwrap();
        assert_eq!(sync.receive(&plain), Err(0));
        assert_eq!(sync.receive(&counted), Ok(Synced { counter: Some(7) }));
    }

    #[test]
    fn the_identifier_stays_while_producing_and_is_nobody_elses() {
        let mut sync = Sync::new();
        for number in [0, 0x7F, 0x101, 0x581, 0x601, 0x701, 1 << 29 | 0x80, 0x800] {
            assert_eq!(
                write(&mut sync, 0x1005, number),
                Err(Abort::InvalidValue),
                "{number:X}"
            );
        }
        assert_eq!(write(&mut sync, 0x1005, 0x90), Ok(()));
        assert!(sync.recognises(&Frame::data_frame(0x90, &[])));
        write(&mut sync, 0x1005, PRODUCE | 0x90).unwrap();
        assert_eq!(
            write(&mut sync, 0x1005, PRODUCE | 0x80),
            Err(Abort::InvalidValue)
        );
        assert_eq!(write(&mut sync, 0x1019, 1), Err(Abort::InvalidValue));
    }

    #[test]
    fn it_stands_in_only_while_asked() {
        let mut sync = Sync::new();
        sync.produce_for_absence(Some(20_000), Instant(5));
        assert_eq!(sync.poll(OP).get(), Some(Instant(20_005)));
        sync.produce_for_absence(None, Instant(6));
        assert_eq!(sync.poll(OP).get(), None);
    }

    #[test]
    fn standing_in_stretches_the_period_that_is_commanded() {
        let mut sync = Sync::new();
        write(&mut sync, 0x1006, 1_000_000).unwrap();
        write(&mut sync, 0x1005, PRODUCE | 0x80).unwrap();
        sync.produce_for_absence(Some(20_000), Instant(500_000));
        assert_eq!(sync.poll(OP).get(), Some(Instant(1_000_000)));
        sync.produce_for_absence(None, Instant(1_000_300));
        assert_eq!(sync.poll(OP).get(), Some(Instant(1_000_000)));
    }

    #[test]
    fn a_start_begins_with_counter_1() {
        let mut sync = Sync::new();
        write(&mut sync, 0x1019, 240).unwrap();
        write(&mut sync, 0x1006, 1000).unwrap();
        write(&mut sync, 0x1005, PRODUCE | 0x80).unwrap();
        let counter = |sync: &mut Sync, now| sync.transmit(Instant(now)).unwrap().bytes()[0];
        assert_eq!(
            (1..=3).map(|n| counter(&mut sync, n * 1000)).last(),
            Some(3)
        );
        sync.start(Instant(10_500));
        assert_eq!(sync.poll(OP).get(), Some(Instant(11_500)));
        assert_eq!(counter(&mut sync, 11_500), 1);
    }
}
