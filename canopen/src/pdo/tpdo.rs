//! One PDO that the device transmits (CiA 301, 7.2.2).
//!
//! In: SYNC, the application's word that data have changed, remote frames and time. Out: samples
//! of the mapped objects, each with the time in which it may go out. It holds one sample: a newer
//! one takes the place of one that the bus has not taken, and one that the bus does not take for
//! long is dropped, since old process data help nobody.
//!
//! Left out: which TPDO goes first (`pdo`).

use super::setup::Setup;
use crate::frame::{Frame, standard};
use crate::object::{Objects, Value};
use crate::time::Deadline;
use core::fmt::Debug;
use instant::Instant;

const NEVER: Instant = Instant(u64::MAX);

/// A sample that has waited for so long is not sent any more, us.
const LIFE_US: u64 = 30_000;

/// When a sample may go out, both ends included.
#[derive(Clone, Copy, Debug)]
struct Window {
    from: Instant,
    until: Instant,
}

impl Window {
    /// Nothing waits. No window ends at the start of the clock.
    const NONE: Self = Self {
        from: Instant(0),
        until: Instant(0),
    };
}

/// A TPDO: configuration and state.
#[derive(Clone, Debug)]
pub struct Tpdo {
    /// The configuration.
    pub(super) setup: Setup,
    /// The newest sample, sent or waiting.
    sample: Option<Value>,
    /// The sample waits for the bus.
    waiting: Window,
    /// From when on the newest sample of a SYNC, or the one handed over, may not be sent any more.
    pub(super) stale: Instant,
    /// The event has come: type 0 waits for SYNC, types 254 and 255 for the next poll.
    due: bool,
    /// SYNCs up to the next sample; `None` before the first SYNC that counts.
    left: Option<u8>,
    /// End of the inhibit time, which begins when a frame has ended on the bus; up to then it is
    /// the end of the clock.
    quiet_until: Instant,
    /// When the event timer runs out.
    timer: Deadline,
}

/// The TPDOs of a device: as many as an array of its choice has.
pub trait Tpdos: AsRef<[Tpdo]> + AsMut<[Tpdo]> + Clone + Debug {
    /// How many there are.
    const COUNT: usize;
    /// None of them exists. All its bytes are 0.
    const NONE: Self;
}

impl<const COUNT: usize> Tpdos for [Tpdo; COUNT] {
    const COUNT: usize = COUNT;
    const NONE: Self = [const { Tpdo::new() }; COUNT];
}

impl Default for Tpdo {
    fn default() -> Self {
        Self::new()
    }
}

impl Tpdo {
    /// A TPDO that does not exist.
    pub(super) const fn new() -> Self {
        Self {
            setup: Setup::new(),
            sample: None,
            waiting: Window::NONE,
            stale: Instant(0),
            due: false,
            left: None,
            quiet_until: Instant(0),
            timer: Deadline::NONE,
        }
    }

    /// Forgets what waits, and begins anew: event-driven types are due once.
    pub fn restart(&mut self) {
        self.sample = None;
        self.waiting = Window::NONE;
        self.due = !self.setup.is_synchronous();
        self.left = None;
        self.quiet_until = Instant(0);
        self.timer = Deadline::NONE;
    }

    /// Keeps a sample to be sent in `window`; true when it takes the place of one that was free
    /// to go.
    // Four callers, each of which would hold a copy of it.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn keep(&mut self, sample: Value, window: Window, now: Instant) -> bool {
        let lost = self.is_waiting() && self.waiting.from <= now;
        self.sample = Some(sample);
        self.waiting = window;
        lost
    }

    /// Keeps a sample of an event-driven type, which the inhibit time may hold back.
    fn keep_event<O: Objects>(&mut self, sample: Value, now: Instant) -> bool {
        let window = Window {
            from: self.quiet_until,
            until: NEVER,
        };
        self.due = false;
        self.wind::<O>(now);
        self.keep(sample, window, now)
    }

    /// Sets the event timer. It keeps its own rhythm while nothing else starts it anew.
    fn wind<O: Objects>(&mut self, now: Instant) {
        if !O::SERVICES.pdo_timers {
            return;
        }
        let period_us = u64::from(self.setup.event_ms) * 1000;
        self.timer = if self.timer.is_due(now) {
            self.timer.in_step(period_us, now)
        } else {
            Deadline::in_us(now, period_us)
        };
    }

    /// SYNC: samples when it is this PDO's turn; true when a sample was lost by that.
    pub fn sync<O: Objects>(
        &mut self,
        objects: &mut O,
        counter: Option<u8>,
        window_us: u32,
        now: Instant,
    ) -> bool {
        if !self.setup.is_active() || !self.wants_sync(counter) {
            return false;
        }
        let Ok(sample) = self.setup.mapping.pack(objects) else {
            return false;
        };
        let life_us = match window_us {
            0 => LIFE_US,
            us => u64::from(us).min(LIFE_US),
        };
        let until = now.after(life_us);
        self.stale = until;
        self.keep(sample, Window { from: now, until }, now)
    }

    fn wants_sync(&mut self, counter: Option<u8>) -> bool {
        match self.setup.kind {
            0 => core::mem::take(&mut self.due),
            n if self.setup.is_synchronous() => self.counts_down(n, counter),
            _ => false,
        }
    }

    /// True on every n-th SYNC.
    ///
    /// With a SYNC start value the SYNC of that counter is the first, and the PDO goes with it:
    /// inferred from what the start value is for, spreading the PDOs of a machine over SYNCs.
    fn counts_down(&mut self, n: u8, counter: Option<u8>) -> bool {
        let left = match (self.left, self.setup.sync_start, counter) {
            (Some(left), _, _) => left,
            (None, 0, _) | (None, _, None) => n,
            (None, start, Some(counter)) if start == counter => 1,
            _ => return false,
        };
        let left = left.saturating_sub(1);
        self.left = Some(if left == 0 { n } else { left });
        left == 0
    }

    /// The application's data have changed: samples when any of it is mapped here; true when a
    /// sample was lost by that.
    pub fn event<O: Objects>(&mut self, objects: &mut O, now: Instant) -> bool {
        if !self.setup.is_active() || matches!(self.setup.kind, 1..=240) {
            return false;
        }
        let Ok(sample) = self.setup.mapping.pack(objects) else {
            return false;
        };
        if self.sample == Some(sample) {
            return false;
        }
        if self.setup.is_synchronous() {
            self.due = true;
            return false;
        }
        self.keep_event::<O>(sample, now)
    }

    /// A remote frame asks for it. Synchronous types answer with what SYNC has sampled last, while
    /// that may still go out.
    ///
    /// True when a sample was lost by that.
    pub fn request<O: Objects>(&mut self, objects: &mut O, now: Instant) -> bool {
        let synchronous = self.setup.is_synchronous();
        let kept = self.sample.filter(|_| synchronous && now <= self.stale);
        let until = match kept {
            Some(_) => self.stale,
            None => now.after(LIFE_US),
        };
        let Some(sample) = kept.or_else(|| self.setup.mapping.pack(objects).ok()) else {
            return false;
        };
        // The same sample once more is an answer, and nothing is lost by sending it once.
        let lost = self.sample != Some(sample);
        self.stale = until;
        self.keep(sample, Window { from: now, until }, now) && lost
    }

    /// Drops a synchronous sample whose window has ended, and samples when the event timer has;
    /// true when a sample was lost by that. `again`: more may be due already.
    pub fn poll<O: Objects>(&mut self, objects: &mut O, again: &mut bool, now: Instant) -> bool {
        if !self.setup.is_active() {
            return false;
        }
        if self.is_waiting() && self.waiting.until < now {
            self.waiting = Window::NONE;
            self.withdrawn();
            *again = true;
            return true;
        }
        if self.setup.is_synchronous() || !(self.due || self.timer.is_due(now)) {
            return false;
        }
        match self.setup.mapping.pack(objects) {
            Ok(sample) => self.keep_event::<O>(sample, now),
            Err(_) => {
                self.wind::<O>(now);
                *again = true;
                false
            }
        }
    }

    /// The frame has ended on the bus at `now`; true when a sample has waited for that.
    pub fn sent(&mut self, now: Instant) -> bool {
        self.quiet(now.after(u64::from(self.setup.inhibit) * 100))
    }

    /// Sets the end of the inhibit time; true when a sample waits for it.
    fn quiet(&mut self, until: Instant) -> bool {
        let waits = !self.setup.is_synchronous() && self.is_waiting();
        self.quiet_until = until;
        if waits {
            self.waiting.from = until;
        }
        waits
    }

    /// The sample did not get onto the bus: types 0, 254 and 255 owe it still.
    pub fn withdrawn(&mut self) {
        self.quiet(Instant(0));
        if !self.is_waiting() {
            self.sample = None;
            self.due = true;
        }
    }

    const fn is_waiting(&self) -> bool {
        self.waiting.until.0 != 0
    }

    /// When [`Tpdo::poll`] or the bus has to look again.
    pub fn deadlines(&self, now: Instant, next: &mut Deadline) {
        next.add(self.timer);
        if !self.is_waiting() {
            return;
        }
        let Window { from, until } = self.waiting;
        // The end of the clock stays there.
        next.add(Deadline::at(if from > now { from } else { until.after(1) }));
    }

    /// True when its frame may go out now.
    pub fn is_ready(&self, now: Instant) -> bool {
        let Window { from, until } = self.waiting;
        self.is_waiting() && from <= now && now <= until
    }

    /// The frame, when [`Tpdo::is_ready`] tells of one. With an inhibit time no other one follows
    /// before [`Tpdo::sent`] or [`Tpdo::withdrawn`].
    pub fn take(&mut self, now: Instant) -> Option<Frame> {
        self.waiting = Window::NONE;
        if !self.setup.is_synchronous() {
            self.stale = now.after(LIFE_US);
            self.quiet_until = if self.setup.inhibit == 0 { now } else { NEVER };
        }
        let id = standard(self.setup.id());
        self.sample
            .map(|sample| Frame::of_number(id, sample.unsigned(), sample.length()))
    }
}
