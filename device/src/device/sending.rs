//! What this node sends and the bus has not taken yet: how late it is, and when it is too old.
//!
//! In: frames handed to the controller, frames that have gone out, SYNCs, the time. Out: whether
//! PDOs go out after later SYNCs than the one that they were made for, since who hears such a PDO
//! takes what was for what is; and the frames that the controller has to give back.
//!
//! A frame waits in the controller for as long as the bus is busy, and goes out when that ends. One
//! with an angle would then tell of a pose that was left seconds ago. So it is withdrawn when the
//! next SYNC has come, when its time is over, and a safety frame as soon as consent ends.
//!
//! Frames of one identifier go out in the order of their handing over, so counting them by
//! identifier tells of which SYNC the one is that has gone.
//!
//! Left out: what to do about it, which is `pair`'s and the driver's.

use instant::Instant;

/// Identifiers of PDOs in the predefined connection set (CiA 301, table 39).
pub(super) const PDOS: core::ops::RangeInclusive<u16> = 0x180..=0x57F;

/// The last identifier of a safety frame (EN 50325-5). Its frames belong to no SYNC.
const LAST_SAFETY: u16 = 0x180;

/// Identifiers of which frames may be on their way at once: three mailboxes, and five places beside
/// them for what was taken out ([`mailboxes`](crate::mailboxes)), however many PDOs a node has.
const PLACES: usize = 8;

/// SYNCs in a row that may find a PDO of an earlier one still waiting.
const WAITS_ALLOWED: u8 = 2;

/// PDOs in a row that may go out after a later SYNC; the bus may have been busy for one.
const LATE_ALLOWED: u8 = 1;

const NEVER: Instant = Instant(u64::MAX);

/// What is to become of a frame in the controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Course {
    /// It may go out.
    #[default]
    Free,
    /// The driver is to take it back.
    Recalled,
    /// The driver has been given the recall.
    Told,
}

/// Frames of one identifier that the controller has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Waiting {
    cob_id: u16,
    /// Handed over before the last SYNC.
    old: u8,
    /// Handed over since.
    new: u8,
    /// When the newest of them is too old.
    until: Instant,
    course: Course,
}

impl Waiting {
    const NONE: Self = Self {
        cob_id: 0,
        old: 0,
        new: 0,
        until: NEVER,
        course: Course::Free,
    };

    const fn is_empty(&self) -> bool {
        self.old | self.new == 0
    }

    const fn is_safety(&self) -> bool {
        self.cob_id <= LAST_SAFETY
    }

    fn recall(&mut self) {
        if !self.is_empty() && self.course == Course::Free {
            self.course = Course::Recalled;
        }
    }

    /// The oldest of them is no longer there: whether it was for an earlier SYNC.
    fn leave(&mut self) -> Option<bool> {
        self.course = Course::Free;
        if let Some(rest) = self.old.checked_sub(1) {
            self.old = rest;
            return Some(true);
        }
        self.new = self.new.checked_sub(1)?;
        Some(false)
    }
}

/// Frames on their way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sending {
    waiting: [Waiting; PLACES],
    /// When the first of them is too old.
    pub(super) next: Instant,
    /// SYNCs in a row that have found something waiting.
    waits: u8,
    /// PDOs in a row that went out after a later SYNC.
    late: u8,
    /// A PDO was withdrawn before the SYNC that would have found it waiting.
    missed: bool,
    /// The driver may have to be told of one.
    recalls: bool,
}

impl Sending {
    /// Nothing on its way.
    pub(super) const fn new() -> Self {
        Self {
            waiting: [Waiting::NONE; PLACES],
            next: NEVER,
            waits: 0,
            late: 0,
            missed: false,
            recalls: false,
        }
    }

    fn of(&mut self, cob_id: u16) -> Option<&mut Waiting> {
        self.waiting.iter_mut().find(|w| w.cob_id == cob_id)
    }

    /// A frame goes to the controller, and is worth sending until then; `None`: for ever.
    pub(super) fn hand_over(&mut self, cob_id: u16, until: Option<Instant>) {
        let Some(until) = until else {
            return;
        };
        // A place whose frames have all gone is free for another identifier.
        let mut places = self.waiting.iter();
        let known = places.position(|w| w.cob_id == cob_id);
        let place = known.or_else(|| self.waiting.iter().position(Waiting::is_empty));
        let Some(place) = place.and_then(|place| self.waiting.get_mut(place)) else {
            return;
        };
        let was_empty = place.is_empty();
        place.cob_id = cob_id;
        place.new = place.new.saturating_add(1);
        place.until = until;
        place.course = Course::Free;
        if was_empty {
            self.next = self.next.min(until);
        } else {
            self.plan();
        }
    }

    /// The controller has sent a frame.
    pub(super) fn gone(&mut self, cob_id: u16) {
        let Some(place) = self.of(cob_id) else {
            return;
        };
        let is_safety = place.is_safety();
        match place.leave() {
            _ if is_safety => {}
            None => {}
            Some(true) => self.late = self.late.saturating_add(1),
            Some(false) => (self.late, self.waits, self.missed) = (0, 0, false),
        }
        self.plan();
    }

    /// The controller has given a frame back.
    pub(super) fn withdrawn(&mut self, cob_id: u16) {
        let Some(place) = self.of(cob_id) else {
            return;
        };
        let is_safety = place.is_safety();
        // An earlier SYNC's has been counted when that SYNC was followed by the next.
        self.missed |= place.leave() == Some(false) && !is_safety;
        self.plan();
    }

    /// A SYNC was obeyed: what waits has missed its own.
    pub(super) fn sync(&mut self) {
        let mut waits = core::mem::take(&mut self.missed);
        for place in self.waiting.iter_mut().filter(|w| !w.is_safety()) {
            place.old = place.old.saturating_add(place.new);
            place.new = 0;
            waits |= place.old != 0;
            place.recall();
        }
        if waits {
            self.waits = self.waits.saturating_add(1);
            self.plan();
        } else {
            self.waits = 0;
        }
    }

    /// Time passes.
    pub(super) fn expire(&mut self, now: Instant) {
        if now >= self.next {
            let old = self.waiting.iter_mut().filter(|w| w.until <= now);
            old.for_each(Waiting::recall);
            self.plan();
        }
    }

    /// Safety frames may no more be sent.
    pub(super) fn withhold_safety(&mut self) {
        let safety = self.waiting.iter_mut().filter(|w| w.is_safety());
        safety.for_each(Waiting::recall);
        self.plan();
    }

    fn plan(&mut self) {
        self.next = NEVER;
        for waiting in &self.waiting {
            if waiting.is_empty() {
                continue;
            }
            match waiting.course {
                Course::Free => self.next = self.next.min(waiting.until),
                Course::Recalled => self.recalls = true,
                Course::Told => {}
            }
        }
    }

    /// A frame that the controller has to give back, told once.
    pub(super) fn recalled(&mut self) -> Option<u16> {
        if !self.recalls {
            return None;
        }
        let mut waiting = self.waiting.iter_mut();
        let place = waiting.find(|w| w.course == Course::Recalled);
        self.recalls = place.is_some();
        let place = place?;
        place.course = Course::Told;
        Some(place.cob_id)
    }

    /// True when what this node sends gets onto the bus too late to be told from what is new.
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
            sending.hand_over(0x181, Some(NEVER));
            sending.hand_over(0x381, Some(NEVER));
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
            sending.hand_over(0x181, Some(NEVER));
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
            sending.hand_over(0x181, Some(NEVER));
            sending.sync();
            sending.gone(0x181);
            sending.hand_over(0x181, Some(NEVER));
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
            sending.hand_over(id, Some(NEVER));
            sending.gone(id);
        }
        for id in 0x181..=0x18A {
            sending.hand_over(id, Some(NEVER));
        }
        for id in 0x181..=0x18A {
            sending.gone(id);
        }
        (0..10).for_each(|_| sending.sync());
        assert!(!sending.is_late());
    }

    fn ms(time: u64) -> Instant {
        Instant(time * 1000)
    }

    #[test]
    fn a_frame_is_recalled_once_when_its_time_is_over_or_the_next_sync_has_come() {
        let mut sending = Sending::new();
        sending.sync();
        sending.hand_over(0x181, Some(ms(30)));
        sending.hand_over(0x101, Some(ms(10)));
        assert_eq!(sending.next, ms(10));
        sending.expire(ms(9));
        assert_eq!(sending.recalled(), None);
        sending.expire(ms(10));
        assert_eq!((sending.recalled(), sending.next), (Some(0x101), ms(30)));
        sending.sync();
        assert_eq!((sending.recalled(), sending.next), (Some(0x181), NEVER));
        sending.expire(ms(40));
        assert_eq!(sending.recalled(), None);
        sending.withdrawn(0x101);
        sending.withdrawn(0x181);
        sending.hand_over(0x181, Some(ms(70)));
        sending.gone(0x181);
        sending.expire(ms(80));
        assert_eq!(sending.recalled(), None);
    }

    #[test]
    fn the_end_of_consent_recalls_safety_frames_only() {
        let mut sending = Sending::new();
        sending.hand_over(0x181, Some(ms(30)));
        sending.hand_over(0x102, Some(ms(10)));
        sending.withhold_safety();
        assert_eq!(
            (sending.recalled(), sending.recalled()),
            (Some(0x102), None)
        );
    }

    #[test]
    fn a_node_whose_frames_are_withdrawn_before_each_sync_is_late() {
        let mut sending = Sending::new();
        for n in 0..4 {
            sending.sync();
            assert_eq!(sending.is_late(), n > 2, "{n}");
            sending.hand_over(0x181, Some(ms(n * 100 + 30)));
            sending.expire(ms(n * 100 + 30));
            assert_eq!(sending.recalled(), Some(0x181));
            sending.withdrawn(0x181);
        }
    }

    #[test]
    fn a_safety_frame_belongs_to_no_sync() {
        let mut sending = Sending::new();
        for n in 0..10 {
            sending.hand_over(0x101, Some(ms(n * 10 + 9)));
            sending.sync();
            assert_eq!(sending.recalled(), None);
            sending.gone(0x101);
            assert!(!sending.is_late());
        }
    }
}
