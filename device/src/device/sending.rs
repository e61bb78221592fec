//! How late what this node says gets onto the bus.
//!
//! In: frames handed to the controller, frames that have gone out, SYNCs. Out: whether PDOs go
//! out after later SYNCs than the one that they were made for. Who hears such a PDO takes what
//! was for what is.
//!
//! Frames of one identifier go out in the order of their handing over, so counting them by
//! identifier tells of which SYNC the one is that has gone.
//!
//! Left out: what to do about it, which is `pair`'s.

/// Identifiers of PDOs in the predefined connection set (CiA 301, table 39).
pub(super) const PDOS: core::ops::RangeInclusive<u16> = 0x180..=0x57F;

/// TPDOs that a node has.
const TPDOS: usize = 4;

/// SYNCs in a row that may find a PDO of an earlier one still waiting.
const WAITS_ALLOWED: u8 = 2;

/// PDOs in a row that may go out after a later SYNC; the bus may have been busy for one.
const LATE_ALLOWED: u8 = 1;

/// PDOs of one identifier that the controller has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Waiting {
    cob_id: u16,
    /// Handed over before the last SYNC.
    old: u8,
    /// Handed over since.
    new: u8,
}

/// PDOs on their way.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sending {
    waiting: [Waiting; TPDOS],
    /// SYNCs in a row that have found something waiting.
    waits: u8,
    /// PDOs in a row that went out after a later SYNC.
    late: u8,
}

impl Sending {
    /// Nothing on its way.
    pub(super) const fn new() -> Self {
        const NONE: Waiting = Waiting {
            cob_id: 0,
            old: 0,
            new: 0,
        };
        Self {
            waiting: [NONE; TPDOS],
            waits: 0,
            late: 0,
        }
    }

    fn of(&mut self, cob_id: u16) -> Option<&mut Waiting> {
        self.waiting.iter_mut().find(|w| w.cob_id == cob_id)
    }

    /// A frame goes to the controller.
    pub(super) fn hand_over(&mut self, cob_id: u16) {
        if !PDOS.contains(&cob_id) {
            return;
        }
        let is_known = self.of(cob_id).is_some();
        // A place whose PDOs have all gone is free for another identifier.
        let place = if is_known {
            self.of(cob_id)
        } else {
            self.waiting.iter_mut().find(|w| w.old == 0 && w.new == 0)
        };
        if let Some(place) = place {
            place.cob_id = cob_id;
            place.new = place.new.saturating_add(1);
        }
    }

    /// The controller has sent a frame.
    pub(super) fn gone(&mut self, cob_id: u16) {
        let Some(place) = self.of(cob_id) else {
            return;
        };
        if let Some(rest) = place.old.checked_sub(1) {
            place.old = rest;
            self.late = self.late.saturating_add(1);
        } else if let Some(rest) = place.new.checked_sub(1) {
            place.new = rest;
            self.late = 0;
            self.waits = 0;
        }
    }

    /// A SYNC was obeyed: what waits has missed its own.
    pub(super) fn sync(&mut self) {
        let mut waits = false;
        for place in &mut self.waiting {
            place.old = place.old.saturating_add(place.new);
            place.new = 0;
            waits |= place.old != 0;
        }
        self.waits = if waits {
            self.waits.saturating_add(1)
        } else {
            0
        };
    }

    /// True when what this node says gets onto the bus too late to be told from what is new.
    pub(super) const fn is_late(&self) -> bool {
        self.waits > WAITS_ALLOWED || self.late > LATE_ALLOWED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A PDO handed over at each SYNC goes out `late_syncs` SYNCs later; when that is noticed.
    fn noticed_after(late_syncs: usize) -> Option<usize> {
        let mut sending = Sending::new();
        (0..100).find(|n| {
            sending.sync();
            sending.hand_over(0x181);
            sending.hand_over(0x381);
            if *n >= late_syncs {
                sending.gone(0x181);
                sending.gone(0x381);
            }
            sending.is_late()
        })
    }

    #[test]
    fn in_time_is_never_late_and_late_is_noticed_within_four_syncs() {
        assert_eq!(noticed_after(0), None);
        for late_syncs in [1, 2, 3, 10, 90] {
            let after = noticed_after(late_syncs);
            assert!(after.is_some_and(|n| n <= 3), "{late_syncs}: {after:?}");
        }
    }

    #[test]
    fn frames_that_stayed_as_late_as_they_were_passed_for_timely_ones() {
        let mut sending = Sending::new();
        for n in 0..100 {
            sending.sync();
            sending.hand_over(0x181);
            if n >= 3 {
                // The PDO of three SYNCs ago goes right behind the new one.
                sending.gone(0x181);
                assert!(sending.is_late(), "{n}");
            }
        }
    }

    #[test]
    fn a_busy_bus_may_hold_a_pdo_past_one_sync() {
        let mut sending = Sending::new();
        for _ in 0..100 {
            sending.sync();
            sending.hand_over(0x181);
            sending.sync();
            sending.gone(0x181);
            sending.hand_over(0x181);
            sending.gone(0x181);
            assert!(!sending.is_late());
        }
    }

    #[test]
    fn what_is_no_pdo_and_more_identifiers_than_a_node_has_do_no_harm() {
        let mut sending = Sending::new();
        for id in [
            0x000, 0x080, 0x701, 0x581, 0x181, 0x182, 0x183, 0x184, 0x185,
        ] {
            sending.hand_over(id);
            sending.gone(id);
        }
        for id in 0x181..=0x186 {
            sending.hand_over(id);
        }
        for id in 0x181..=0x186 {
            sending.gone(id);
        }
        (0..10).for_each(|_| sending.sync());
        assert!(!sending.is_late());
    }
}
