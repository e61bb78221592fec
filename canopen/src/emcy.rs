//! Emergency: messages, the error register and the list of past errors (CiA 301, 7.2.7; objects
//! 1001h, 1003h, 1014h, 1015h).
//!
//! In: errors that appear or go, with the register as it then is; what has gone out. Out: messages
//! in their order, no closer than the inhibit time, and the list. A message waits until it has gone
//! out: one that the controller has lost is sent again. When more wait than there is room for, the
//! oldest unsent stays (the cause) and the newest is taken (the state); what lies between them
//! still stands in the list.
//!
//! Left out: what an error means; consuming the messages of others.

use crate::frame::{Frame, is_restricted};
use crate::nmt::State;
use crate::object::{Abort, Address, Number, Value};
use crate::time::Deadline;
use instant::Instant;

/// Errors kept in 1003h.
pub const HISTORY: usize = 8;

/// Messages that can wait.
const WAITING: usize = 8;

/// Error code of a message that something has gone: 00xxh.
const RESET: u16 = 0;

/// Error passive (CiA 301, table 26).
pub const PASSIVE: u16 = 0x8120;

/// Recovered from bus-off (CiA 301, table 26).
pub const RECOVERED: u16 = 0x8140;

/// Bit 0 of the error register stands whenever any other does.
const GENERIC: u8 = 1;

/// Bit 31 of 1014h: no messages.
const OFF: u32 = 1 << 31;

/// A message as it goes out: code, register, detail.
type Message = [u8; 8];

/// EMCY: parameters and state.
#[derive(Clone, Debug)]
pub struct Emergency {
    /// 1014h with bit 31 turned over, so that all bytes of one that has nothing are 0.
    turned: u32,
    inhibit_100us: u16,
    register: u8,
    /// The oldest first; code 0 behind the last.
    waiting: [Message; WAITING],
    count_waiting: u8,
    /// The first of them is with the controller.
    handed_over: bool,
    history: [u32; HISTORY],
    count: u8,
    free_at: Instant,
}

impl Emergency {
    /// As [`Emergency::new`], and a constant for the reason that [`crate::pdo::Pdos`] has.
    pub(crate) const NONE: Self = Self {
        turned: 0,
        inhibit_100us: 0,
        register: 0,
        waiting: [[0; 8]; WAITING],
        count_waiting: 0,
        handed_over: false,
        history: [0; HISTORY],
        count: 0,
        free_at: Instant(0),
    };

    /// No error; the COB-ID is loaded later.
    // Within a whole node it would be cleared by a second and third form of the library's memclr.
    #[inline(never)]
    pub const fn new() -> Self {
        Self::NONE
    }

    /// 1014h.
    const fn cob_id(&self) -> u32 {
        self.turned ^ OFF
    }

    const fn id(&self) -> u16 {
        (self.turned & 0x7FF) as u16
    }

    /// 1001h.
    pub const fn register(&self) -> u8 {
        self.register
    }

    /// Sets the error register without a message.
    pub const fn set_register(&mut self, bits: u8) {
        self.register = bits | if bits != 0 { GENERIC } else { 0 };
    }

    /// An error has appeared; `bits` is the whole register as it now is.
    ///
    /// What is to be told of the bus itself and waits is not told twice: a node that tries to come
    /// back to a bus that takes nothing would have nothing else to tell in the end.
    pub fn raise(&mut self, code: u16, bits: u8, detail: [u8; 5]) {
        self.set_register(bits);
        let [low, high] = code.to_le_bytes();
        let waits = |[a, b, ..]: &Message| (*a, *b) == (low, high);
        if matches!(code, PASSIVE | RECOVERED) && self.waiting.iter().any(waits) {
            return;
        }
        let [first, second, ..] = detail;
        let mut newer = u32::from_le_bytes([low, high, first, second]);
        // One place further each; `rotate_right` would bring the library's memmove along.
        for kept in &mut self.history {
            newer = core::mem::replace(kept, newer);
        }
        self.count = (self.count + 1).min(HISTORY as u8);
        // The message reports at least that there is an error, even when nothing of it stays.
        self.queue(code, self.register | GENERIC, detail);
    }

    /// An error has gone; `bits` is what is left of the register.
    pub fn clear(&mut self, bits: u8, detail: [u8; 5]) {
        self.set_register(bits);
        self.queue(RESET, self.register, detail);
    }

    fn queue(&mut self, code: u16, register: u8, detail: [u8; 5]) {
        let [low, high] = code.to_le_bytes();
        let [a, b, c, d, e] = detail;
        let place = self.count_waiting.min(WAITING as u8 - 1);
        if let Some(message) = self.waiting.get_mut(usize::from(place)) {
            *message = [low, high, register, a, b, c, d, e];
        }
        self.count_waiting = place + 1;
    }

    fn waits(&self, state: State) -> bool {
        let ready = !self.handed_over && self.count_waiting != 0;
        self.turned & OFF != 0 && state.allows_emergency() && ready
    }

    /// When a message that waits may go.
    pub fn poll(&self, state: State) -> Deadline {
        if self.waits(state) {
            Deadline::at(self.free_at)
        } else {
            Deadline::NONE
        }
    }

    /// The identifier of a message that may go now.
    pub fn next_cob_id(&self, state: State, now: Instant) -> Option<u16> {
        let due = self.waits(state) && self.free_at <= now;
        due.then_some(self.id())
    }

    /// The message that may go now; the next one follows when it has gone out.
    pub fn transmit(&mut self) -> Option<Frame> {
        let ready = !self.handed_over && self.count_waiting != 0;
        let message = self.waiting.first().filter(|_| ready)?;
        self.handed_over = true;
        Some(Frame::data_frame(self.id(), message))
    }

    /// A frame of this identifier has ended on the bus at `now`; true when it was a message, and
    /// another may go behind the inhibit time.
    pub fn sent(&mut self, cob_id: u16, now: Instant) -> bool {
        let is_told = cob_id == self.id() && core::mem::take(&mut self.handed_over);
        if is_told {
            self.free_at = now.after(u64::from(self.inhibit_100us) * 100);
            let mut next = [0; 8];
            // One place further each; `rotate_left` would bring the library's memmove along.
            for kept in self.waiting.iter_mut().rev() {
                next = core::mem::replace(kept, next);
            }
            self.count_waiting = self.count_waiting.saturating_sub(1);
        }
        is_told
    }

    /// The controller has lost what it had: that is sent again.
    pub const fn lost(&mut self) {
        self.handed_over = false;
    }

    /// 1001h, 1003h, 1014h, 1015h.
    pub fn read(&self, at: Address) -> Option<Result<Number, Abort>> {
        Some(match (at.index, at.sub) {
            (0x1001, _) => Ok(Number::u8(self.register)),
            (0x1003, 0) => Ok(Number::u8(self.count)),
            (0x1003, sub) if sub <= self.count => {
                let error = self.history.get(usize::from(sub).wrapping_sub(1));
                error.map(|e| Number::u32(*e)).ok_or(Abort::NoSuchSubIndex)
            }
            (0x1003, _) => Err(Abort::NoData),
            (0x1014, _) => Ok(Number::u32(self.cob_id())),
            _ => Ok(Number::u16(self.inhibit_100us)),
        })
    }

    /// A write by SDO. 0 to 1003h sub 0 empties the list, and nothing else may be written there.
    pub fn write(&mut self, at: Address, value: Value) -> Option<Result<(), Abort>> {
        let number = value.unsigned() as u32;
        let allowed = match (at.index, at.sub) {
            (0x1003, 0) => number == 0,
            (0x1014, _) => self.admits_cob_id(number),
            (0x1015, _) => true,
            _ => return Some(Err(Abort::ReadOnly)),
        };
        if !allowed {
            return Some(Err(Abort::InvalidValue));
        }
        if at.index == 0x1003 {
            self.count = 0;
            self.history = [0; HISTORY];
        } else {
            self.load(at, value);
        }
        Some(Ok(()))
    }

    /// The identifier changes only while messages are off (CiA 301, 7.5.2.17).
    fn admits_cob_id(&self, number: u32) -> bool {
        let id = number & 0x7FF;
        if number & !(OFF | 0x7FF) != 0 || (number & OFF == 0 && is_restricted(id)) {
            return false;
        }
        let stays_on = (self.cob_id() | number) & OFF == 0;
        !stays_on || id == u32::from(self.id())
    }

    /// A default or stored value.
    pub fn load(&mut self, at: Address, value: Value) -> bool {
        let number = value.unsigned() as u32;
        match at.index {
            0x1014 => {
                self.turned = number ^ OFF;
                // Who listens to another identifier has not heard what goes out under the old one.
                self.lost();
            }
            0x1015 => self.inhibit_100us = number as u16,
            _ => {}
        }
        true
    }
}

impl Default for Emergency {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::at;

    const OP: State = State::Operational;

    fn emergency() -> Emergency {
        let mut emergency = Emergency::new();
        emergency.load(at(0x1014, 0), Value::u32(0x85));
        emergency
    }

    /// The next message, which goes out at once.
    fn sent(emergency: &mut Emergency, now: Instant) -> Option<Frame> {
        let frame = emergency.transmit()?;
        emergency.sent(frame.cob_id()?, now);
        Some(frame)
    }

    fn number(emergency: &Emergency, index: u16, sub: u8) -> Result<u64, Abort> {
        let value = emergency.read(at(index, sub)).unwrap();
        value.map(|v| v.unsigned())
    }

    #[test]
    fn an_error_is_told_when_it_comes_and_when_it_goes() {
        let mut e = emergency();
        e.raise(0x5010, 0x20, [1, 2, 3, 4, 5]);
        assert_eq!(e.next_cob_id(OP, Instant(0)), Some(0x85));
        let told = sent(&mut e, Instant(0)).unwrap();
        assert_eq!(
            told,
            Frame::data_frame(0x85, &[0x10, 0x50, 0x21, 1, 2, 3, 4, 5])
        );
        e.clear(0, [0; 5]);
        let gone = sent(&mut e, Instant(0)).unwrap();
        assert_eq!(gone, Frame::data_frame(0x85, &[0; 8]));
        assert_eq!(number(&e, 0x1001, 0), Ok(0));
        assert_eq!(number(&e, 0x1003, 1), Ok(0x0201_5010));
        assert_eq!(number(&e, 0x1003, 2), Err(Abort::NoData));
    }

    #[test]
    fn the_inhibit_time_keeps_messages_apart() {
        let mut e = emergency();
        e.load(at(0x1015, 0), Value::u16(50));
        e.raise(0x1000, 0x80, [0; 5]);
        e.raise(0x1001, 0x80, [0; 5]);
        assert!(e.transmit().is_some());
        // It has waited for the bus: the time counts from where others have seen it.
        assert_eq!(
            (e.next_cob_id(OP, Instant(90)), e.poll(OP).get()),
            (None, None)
        );
        assert!(e.sent(0x85, Instant(100)));
        assert_eq!(e.next_cob_id(OP, Instant(5_099)), None);
        assert_eq!(e.poll(OP).get(), Some(Instant(5_100)));
        assert_eq!(e.next_cob_id(OP, Instant(5_100)), Some(0x85));
    }

    #[test]
    fn a_flood_keeps_the_first_cause_and_the_newest_state() {
        let mut e = emergency();
        for code in 0..20_u16 {
            e.raise(0xFF00 + code, 0x80, [0; 5]);
        }
        let first = sent(&mut e, Instant(0)).unwrap();
        assert_eq!(first.bytes()[..2], [0x00, 0xFF]);
        let rest = core::iter::from_fn(|| sent(&mut e, Instant(0)));
        assert_eq!(rest.last().unwrap().bytes()[..2], [19, 0xFF]);
        assert_eq!(number(&e, 0x1003, 0), Ok(HISTORY as u64));
        assert_eq!(number(&e, 0x1003, 1), Ok(0xFF13));
    }

    #[test]
    fn a_message_waits_until_the_one_before_it_has_gone_out() {
        let mut e = emergency();
        e.raise(0x1000, 0x80, [0; 5]);
        e.raise(0x1001, 0x80, [0; 5]);
        let first = e.transmit();
        assert!(first.is_some());
        assert_eq!(
            (e.next_cob_id(OP, Instant(0)), e.poll(OP).get()),
            (None, None)
        );
        assert_eq!(e.transmit(), None);
        // What another service sends is no answer to that.
        e.sent(0x181, Instant(0));
        assert_eq!(e.next_cob_id(OP, Instant(0)), None);
        e.sent(0x85, Instant(0));
        assert_eq!(e.next_cob_id(OP, Instant(0)), Some(0x85));
    }

    #[test]
    fn a_message_that_bus_off_took_was_never_sent_again() {
        let mut e = emergency();
        e.raise(PASSIVE, 0x10, [0; 5]);
        e.raise(0x1000, 0x80, [1; 5]);
        e.raise(0x1001, 0x80, [2; 5]);
        assert!(sent(&mut e, Instant(0)).is_some());
        let taken = e.transmit().unwrap();
        for _ in 0..9 {
            e.lost();
            e.raise(RECOVERED, 0, [0; 5]);
        }
        let codes: [_; 3] = core::array::from_fn(|n| {
            let frame = sent(&mut e, Instant(0)).unwrap();
            assert!(n > 0 || frame == taken);
            u16::from_le_bytes([frame.bytes()[0], frame.bytes()[1]])
        });
        assert_eq!(codes, [0x1000, 0x1001, RECOVERED]);
        assert_eq!(sent(&mut e, Instant(0)), None);
    }

    #[test]
    fn another_identifier_does_not_end_the_messages() {
        let mut e = emergency();
        e.raise(0x1000, 0x80, [0; 5]);
        assert!(e.transmit().is_some());
        e.write(at(0x1014, 0), Value::u32(OFF | 0x85));
        e.write(at(0x1014, 0), Value::u32(0x90));
        // The old one goes out late, and is not taken for the one under the new identifier.
        assert_eq!(e.next_cob_id(OP, Instant(0)), Some(0x90));
        e.sent(0x85, Instant(0));
        assert_eq!(e.next_cob_id(OP, Instant(0)), Some(0x90));
    }

    #[test]
    fn zero_to_1003_0_clears_and_anything_else_is_refused() {
        let mut e = emergency();
        e.raise(0x1000, 0x80, [0; 5]);
        let refused = e.write(at(0x1003, 0), Value::u8(1));
        assert_eq!(refused, Some(Err(Abort::InvalidValue)));
        assert_eq!(number(&e, 0x1003, 0), Ok(1));
        assert_eq!(e.write(at(0x1003, 0), Value::u8(0)), Some(Ok(())));
        assert_eq!(number(&e, 0x1003, 0), Ok(0));
        assert_eq!(number(&e, 0x1003, 1), Err(Abort::NoData));
    }

    #[test]
    fn in_stopped_messages_wait() {
        let mut e = emergency();
        e.raise(0x1000, 0x80, [0; 5]);
        assert_eq!(e.next_cob_id(State::Stopped, Instant(0)), None);
        assert_eq!(e.next_cob_id(State::PreOperational, Instant(0)), Some(0x85));
    }

    #[test]
    fn the_identifier_changes_only_while_off() {
        let mut e = emergency();
        let cob_id = at(0x1014, 0);
        assert_eq!(
            e.write(cob_id, Value::u32(0x90)),
            Some(Err(Abort::InvalidValue))
        );
        assert_eq!(e.write(cob_id, Value::u32(OFF | 0x85)), Some(Ok(())));
        e.raise(0x1000, 0x80, [0; 5]);
        assert_eq!(e.next_cob_id(OP, Instant(0)), None);
        assert_eq!(
            e.write(cob_id, Value::u32(0x701)),
            Some(Err(Abort::InvalidValue))
        );
        assert_eq!(e.write(cob_id, Value::u32(0x90)), Some(Ok(())));
        assert_eq!(e.next_cob_id(OP, Instant(0)), Some(0x90));
    }
}
