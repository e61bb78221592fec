//! Fault confinement of one controller: transmit and receive error counters, and what they mean.
//!
//! In: what became of each frame. Out: the counters and the [`ErrorState`] they put the controller
//! in (ISO 11898-1, fault confinement). Left out: when an error counts; that is the bus's business.

/// From here on software should be told.
const WARNING: u16 = 96;
/// From here on error flags are recessive.
const PASSIVE: u16 = 128;
/// From here on the transmitter is off the bus.
const BUS_OFF: u16 = 256;
/// Where a passive receiver's counter falls to at a good frame; the standard allows 119 to 127.
const AFTER_PASSIVE: u16 = 120;
/// Where the receive counter stops, as in a register of eight bits.
const MOST_RECEIVE: u16 = 255;

/// How far a controller may still take part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum ErrorState {
    /// Error active, both counters below 96.
    #[default]
    Active,
    /// Error active, a counter at 96 or more.
    Warning,
    /// Error passive: a counter at 128 or more; its error flags disturb nobody.
    Passive,
    /// The transmit counter reached 256: neither sends nor receives until it has recovered.
    BusOff,
}

/// The two error counters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    transmit: u16,
    receive: u16,
}

impl Counters {
    /// Transmit error counter, 0 to 263; 256 and above is bus-off.
    pub const fn transmit(&self) -> u16 {
        self.transmit
    }

    /// Receive error counter, 0 to 255.
    pub const fn receive(&self) -> u16 {
        self.receive
    }

    /// What the counters mean.
    pub fn state(&self) -> ErrorState {
        match self.transmit.max(self.receive) {
            _ if self.transmit >= BUS_OFF => ErrorState::BusOff,
            PASSIVE.. => ErrorState::Passive,
            WARNING.. => ErrorState::Warning,
            _ => ErrorState::Active,
        }
    }

    /// A frame was sent and acknowledged: -1.
    pub(super) fn sent(&mut self) {
        self.transmit = self.transmit.saturating_sub(1);
    }

    /// A frame was received without error: -1, or back below passive.
    pub(super) fn received(&mut self) {
        self.receive = match self.receive {
            PASSIVE.. => AFTER_PASSIVE,
            counter => counter.saturating_sub(1),
        };
    }

    /// An error while sending: +8. A controller that is off the bus doesn't count.
    pub(super) fn transmit_error(&mut self) {
        if self.transmit < BUS_OFF {
            self.transmit += 8;
        }
    }

    /// An error while receiving: +1, or +8 where this node's flag came first, or both.
    pub(super) fn receive_error(&mut self, by: u16) {
        self.receive = (self.receive + by).min(MOST_RECEIVE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(transmit_errors: usize, receive_errors: u16) -> Counters {
        let mut counters = Counters::default();
        (0..transmit_errors).for_each(|_| counters.transmit_error());
        counters.receive_error(receive_errors);
        counters
    }

    #[test]
    fn each_limit_is_the_first_value_of_its_state() {
        let states = [
            (11, 95, ErrorState::Active),
            (12, 0, ErrorState::Warning),
            (0, 96, ErrorState::Warning),
            (15, 127, ErrorState::Warning),
            (16, 0, ErrorState::Passive),
            (0, 128, ErrorState::Passive),
            (31, 255, ErrorState::Passive),
            (32, 0, ErrorState::BusOff),
        ];
        for (transmit, receive, state) in states {
            assert_eq!(
                after(transmit, receive).state(),
                state,
                "{transmit} {receive}"
            );
        }
    }

    #[test]
    fn a_receiver_never_goes_off_the_bus() {
        let counters = after(0, 60_000);
        assert_eq!(
            (counters.receive(), counters.state()),
            (255, ErrorState::Passive)
        );
    }

    #[test]
    fn good_frames_count_down_to_zero_and_no_further() {
        let mut counters = after(1, 2);
        (0..7).for_each(|_| counters.sent());
        assert_eq!(counters.transmit(), 1);
        (0..3).for_each(|_| counters.sent());
        (0..3).for_each(|_| counters.received());
        assert_eq!(counters, Counters::default());
    }

    #[test]
    fn one_good_frame_makes_a_passive_receiver_active() {
        let mut counters = after(0, 200);
        counters.received();
        assert_eq!(
            (counters.receive(), counters.state()),
            (120, ErrorState::Warning)
        );
    }

    #[test]
    fn off_the_bus_the_counter_stands() {
        assert_eq!(after(40, 0).transmit(), 256);
    }
}
