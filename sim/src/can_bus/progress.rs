//! How frames run over the bus: arbitration, delivery, the end, and a bus held dominant.
//!
//! In: the state of a [`Bus`] and the instant that has come. Out: events and counters. Left out:
//! how an attempt ends; that is decided when it begins.

use std::cmp::Ordering;

use super::attempt::{Attempt, DELIMITER_BITS, Decision, FLAG_BITS, Failure, resolve};
use super::confinement::ErrorState;
use super::event::{ErrorKind, Event};
use super::ports::{Port, Ports};
use super::wire::INTERMISSION_BITS;
use super::{Bus, Harmony, Held, Phase, SUSPEND_BITS};

/// A level that stays dominant after an error flag counts again after so many bits.
const HELD_BITS: u64 = 8;

/// Those who begin together.
struct Contest {
    winners: Ports,
    /// The winners' priority; above all that there are while nobody has entered.
    best: u32,
    contenders: u64,
    rate_ns: Option<u64>,
    rates_differ: bool,
}

impl Contest {
    fn enter(&mut self, port: Port, priority: u32, bit_ns: u64) {
        self.contenders += 1;
        self.rates_differ |= *self.rate_ns.get_or_insert(bit_ns) != bit_ns;
        match priority.cmp(&self.best) {
            Ordering::Less => (self.winners, self.best) = (Ports::only(port), priority),
            Ordering::Equal => self.winners.insert(port),
            Ordering::Greater => {}
        }
    }
}

impl Bus {
    /// All who are ready begin at once; the one with the lowest arbitration field goes on.
    pub(super) fn begin(&mut self, start_ns: u64) {
        self.pass_idle(start_ns);
        self.now_ns = start_ns;
        let mut contest = Contest {
            winners: Ports::NONE,
            best: u32::MAX,
            contenders: 0,
            rate_ns: None,
            rates_differ: false,
        };
        for port in self.pending.iter() {
            let controller = &self.controllers[port.index()];
            if controller.speaks()
                && controller.ready_ns <= start_ns
                && let Some((_, waiting)) = controller.next()
            {
                contest.enter(port, waiting.priority, controller.bit_ns);
            }
        }
        self.launch(start_ns, &contest);
    }

    /// Looks whether all who are on the bus get on with each other.
    fn harmony(&self) -> Harmony {
        let mut found = None;
        for (controller, port) in self.controllers.iter().zip(super::attempt::all()) {
            if !controller.hears() {
                continue;
            }
            let (among, bit_ns) = found.get_or_insert((Ports::NONE, controller.bit_ns));
            if !controller.flags() || *bit_ns != controller.bit_ns {
                return Harmony::Not;
            }
            among.insert(port);
        }
        found.map_or(Harmony::Not, |(among, bit_ns)| {
            Harmony::Among(among, bit_ns)
        })
    }

    /// The attempt of a lone sender that nothing can disturb; `None` where how it ends has to be
    /// worked out.
    fn smooth(&mut self, start_ns: u64, winners: Ports) -> Option<Attempt> {
        if matches!(self.harmony, Harmony::Unknown) {
            self.harmony = self.harmony();
        }
        let Harmony::Among(all, bit_ns) = self.harmony else {
            return None;
        };
        let port = winners.lone().filter(|_| self.faults.are_none())?;
        let receivers = all.without(winners);
        if receivers.is_empty() {
            return None;
        }
        let controller = self.controller(port);
        let (source, waiting) = controller.next()?;
        let attempt = Attempt::smooth(waiting, port, receivers, start_ns, bit_ns);
        controller.sending = Some(source);
        Some(attempt)
    }

    /// The winners' frame goes onto the wire.
    fn launch(&mut self, start_ns: u64, contest: &Contest) {
        let Some(attempt) = self
            .smooth(start_ns, contest.winners)
            .or_else(|| self.rough(start_ns, contest))
        else {
            return;
        };
        match &mut self.spare {
            Some(place) => **place = attempt,
            place => *place = Some(Box::new(attempt)),
        }
        if let Some(place) = self.spare.take() {
            self.phase = Phase::Busy(place);
        }
        self.statistics.attempts += 1;
        let winners = match contest.winners.lone() {
            Some(_) => 1,
            None => contest.winners.count() as u64,
        };
        self.statistics.arbitrations_lost += contest.contenders - winners;
    }

    /// The attempt, with all that may come of it.
    fn rough(&mut self, start_ns: u64, contest: &Contest) -> Option<Attempt> {
        for port in contest.winners.iter() {
            let controller = self.controller(port);
            controller.sending = controller.next().map(|(source, _)| source);
        }
        let tie = resolve(&self.controllers, contest.winners);
        let first = tie.senders.iter().next();
        let controller = first.map(|port| &self.controllers[port.index()]);
        let (controller, waiting) = controller.and_then(|c| Some((c, c.next()?.1)))?;
        let attempt_number = self.statistics.attempts;
        let decision = Decision {
            controllers: &self.controllers,
            tie,
            waiting: *waiting,
            start_ns,
            bit_ns: controller.bit_ns,
            rates_differ: contest.rates_differ,
        };
        let (faults, senders) = (&mut self.faults, contest.winners);
        Some(decision.attempt(|receivers| faults.strike(attempt_number, senders, receivers)))
    }

    /// The wire has come to the next instant that matters.
    pub(super) fn advance(&mut self, at_ns: u64) {
        self.now_ns = at_ns;
        let idle = Phase::Idle { since_ns: at_ns };
        match std::mem::replace(&mut self.phase, idle) {
            Phase::Busy(attempt) => self.run(attempt),
            Phase::Held(held) => self.hold(held),
            Phase::Idle { .. } => {}
        }
    }

    fn run(&mut self, mut attempt: Box<Attempt>) {
        match (attempt.take, attempt.end) {
            (Some((at_ns, to)), _) if at_ns <= self.now_ns => {
                attempt.take = None;
                self.deliver(&attempt, to);
            }
            (_, Some((_, None))) => {
                attempt.end = None;
                self.succeed(&attempt);
            }
            (_, Some((_, Some(failure)))) => {
                attempt.end = None;
                self.break_off(&attempt, &failure);
            }
            (_, None) => {}
        }
        if attempt.next_ns().is_none() {
            self.fall_idle(attempt.start_ns, attempt.idle_ns);
            self.spare = Some(attempt);
        } else {
            self.phase = Phase::Busy(attempt);
        }
    }

    fn deliver(&mut self, attempt: &Attempt, to: Ports) {
        // Somebody may have been cut off since the frame began; and most have nothing to count.
        let (mut listening, mut counting) = (to, Ports::NONE);
        for port in to.iter() {
            let controller = &self.controllers[port.index()];
            if !controller.hears() {
                listening.remove(port);
            } else if controller.counters.receive() != 0 {
                counting.insert(port);
            }
        }
        let to = listening;
        if to.is_empty() {
            return;
        }
        self.emit(Event::Delivered {
            frame: attempt.frame,
            senders: attempt.senders,
            to,
            start_ns: attempt.start_ns,
            at_ns: self.now_ns,
        });
        for port in counting.iter() {
            self.controller(port).counters.received();
            self.tell(port);
        }
    }

    fn succeed(&mut self, attempt: &Attempt) {
        self.statistics.sent += u64::from(!attempt.senders.is_empty());
        for port in attempt.senders.iter() {
            let sent = self.controller(port).finish();
            self.settle(port);
            self.emit(Event::Sent {
                port,
                mailbox: sent.map(|(mailbox, _)| mailbox),
                frame: attempt.frame,
                start_ns: attempt.start_ns,
                end_ns: self.now_ns,
            });
            let controller = self.controller(port);
            if controller.counters.transmit() != 0 || controller.told >= ErrorState::Passive {
                controller.counters.sent();
                self.suspend(attempt, port);
            }
        }
        if !attempt.dropped.with(attempt.bewildered).is_empty() {
            self.blame(attempt, attempt.dropped, true);
            self.count(attempt.bewildered, 1);
        }
    }

    fn break_off(&mut self, attempt: &Attempt, failure: &Failure) {
        self.statistics.errors += 1;
        self.emit(Event::Error {
            kind: failure.kind,
            senders: attempt.senders,
            start_ns: attempt.start_ns,
            at_ns: self.now_ns,
        });
        // A passive sender that lacks an acknowledgement doesn't count that, or a lone node
        // would end up off the bus.
        let passive_counts = failure.kind != ErrorKind::Acknowledge;
        self.blame(attempt, attempt.senders, passive_counts);
        self.blame(attempt, attempt.dropped, true);
        self.count(failure.primary, failure.primary_count);
        let others = attempt.receivers.without(failure.primary);
        if failure.all_count {
            self.count(others, 1);
        }
        self.count(attempt.bewildered, 1);
    }

    /// Senders whose attempt failed.
    fn blame(&mut self, attempt: &Attempt, senders: Ports, passive_counts: bool) {
        for port in senders.iter() {
            let controller = self.controller(port);
            controller.fail();
            if passive_counts || controller.told < ErrorState::Passive {
                controller.counters.transmit_error();
            }
            self.settle(port);
            self.suspend(attempt, port);
        }
    }

    /// An error passive sender leaves the bus to others for a while.
    fn suspend(&mut self, attempt: &Attempt, port: Port) {
        self.tell(port);
        let controller = self.controller(port);
        if controller.told >= ErrorState::Passive {
            controller.ready_ns = attempt.idle_ns + SUSPEND_BITS * controller.bit_ns;
        }
    }

    /// Receivers that found an error; true when a counter moved.
    fn count(&mut self, receivers: Ports, by: u16) -> bool {
        let mut moved = false;
        for port in receivers.iter() {
            let controller = self.controller(port);
            let before = controller.counters;
            if controller.hears() {
                controller.counters.receive_error(by);
            }
            moved |= controller.counters != before;
            self.tell(port);
        }
        moved
    }

    /// One more count on a bus that is held dominant, or its end.
    fn hold(&mut self, mut held: Held) {
        let flag_ns = FLAG_BITS * self.bit_ns;
        let flagged_ns = held.flagged_ns.unwrap_or(self.now_ns);
        let end_ns = held.until_ns.max(flagged_ns + flag_ns);
        if held.flagged_ns.is_some() && self.now_ns >= end_ns {
            let rest_ns = (DELIMITER_BITS + INTERMISSION_BITS) * self.bit_ns;
            return self.fall_idle(held.start_ns, end_ns + rest_ns);
        }
        let next_ns = if held.flagged_ns.is_none() {
            self.flag(&held, flagged_ns + flag_ns < held.until_ns);
            self.now_ns + flag_ns + HELD_BITS * self.bit_ns
        } else if self.count_held(&held, 8) {
            self.now_ns + HELD_BITS * self.bit_ns
        } else {
            // All counters stand at their ends: nothing more to see until the bus is released.
            end_ns
        };
        held.flagged_ns = Some(flagged_ns);
        held.next_ns = next_ns.min(end_ns);
        self.phase = Phase::Held(held);
    }

    /// The first error flag on a bus held dominant; `goes_on` tells that it outlasts the flag.
    fn flag(&mut self, held: &Held, goes_on: bool) {
        self.statistics.errors += 1;
        self.emit(Event::Error {
            kind: ErrorKind::Dominant,
            senders: held.senders,
            start_ns: held.start_ns,
            at_ns: self.now_ns,
        });
        for port in held.senders.iter() {
            self.controller(port).fail();
            self.settle(port);
        }
        // A receiver also counts the dominant bit after its own flag.
        self.count_held(held, if goes_on { 9 } else { 1 });
    }

    fn count_held(&mut self, held: &Held, receivers_by: u16) -> bool {
        let mut moved = false;
        for port in held.senders.iter() {
            let controller = self.controller(port);
            moved |= controller.hears();
            if controller.hears() {
                controller.counters.transmit_error();
            }
            self.tell(port);
        }
        let numbered = self.controllers.iter().zip(super::attempt::all());
        let everybody: Ports = numbered.map(|(_, port)| port).collect();
        self.count(everybody.without(held.senders), receivers_by) || moved
    }
}
