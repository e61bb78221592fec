//! What is due at a node, and when there is more to do.
//!
//! In: the time. Out: what is late or has come to its end, and the earliest of the deadlines that
//! lie ahead, worked out anew only when something has changed.
//!
//! Left out: what waits for the controller (`transmit`).

use super::view::Mapped;
use super::{Application, Event, Node, UNCONFIGURED};
use crate::nmt::State;
use crate::pdo::Tpdos;
use crate::time::Deadline;
use instant::Instant;

/// The earliest of the instants after `now`.
struct Next {
    now: Instant,
    first: Deadline,
    /// Something is due already. It hides what else its service waits for.
    hides: bool,
}

impl Next {
    /// What is due already waits for the controller and needs no further call.
    // Its callers would each hold a copy of it.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn not_after(&mut self, at: Deadline) {
        if at.is_due(self.now) {
            self.hides = true;
        } else {
            self.first.add(at);
        }
    }
}

impl<T: Tpdos> Node<T> {
    /// What is due by `now`; returns when to call again, always later than `now`.
    pub fn poll<A: Application>(&mut self, app: &mut A, now: Instant) -> Option<Instant> {
        if !self.settled || self.next.is_due(now) {
            self.next = self.serve(app, now);
        }
        self.next.get()
    }

    /// What is due by `now`, and when there is more to do.
    // Apart, because mostly nothing is due, and one look tells.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn serve<A: Application>(&mut self, app: &mut A, now: Instant) -> Deadline {
        if self.node_id == UNCONFIGURED || self.communication.state == State::Initialising {
            return Deadline::NONE;
        }
        let mut silence = self.communication.error_control.poll();
        if silence.is_due(now) {
            while let Some(event) = self.communication.error_control.expired(now) {
                self.control(app, event, now);
            }
            silence = self.communication.error_control.poll();
        }
        let (server, mut view) = self.serving(app, now);
        let mut next = Next {
            now,
            first: Deadline::NONE,
            hides: false,
        };
        next.not_after(server.poll(&mut view, now));
        let services = &mut self.communication;
        next.not_after(silence);
        if A::SERVICES.sync_producer {
            next.not_after(services.sync.poll(services.state));
        }
        next.not_after(services.emergency.poll(services.state));
        self.settled = true;
        if self.communication.state.allows_pdo() {
            self.serve_process_data(app, &mut next);
        }
        self.settled &= !next.hides;
        next.first
    }

    fn serve_process_data<A: Application>(&mut self, app: &mut A, next: &mut Next) {
        let services = &mut self.communication;
        let now = next.now;
        let mut mapped = Mapped {
            application: app,
            register: services.emergency.register(),
        };
        next.not_after(services.pdo.poll(&mut mapped, now));
        // What is told one at a time may have more behind it.
        self.settled = !services.pdo.tries_again();
        if A::SERVICES.safety {
            next.not_after(services.safety.poll(&mut mapped, now));
            if let Some(srdo) = services.safety.take_lost() {
                self.settled = false;
                app.event(Event::SafetyLost(srdo), now);
            }
        }
        if A::SERVICES.pdo_timers
            && let Some(rpdo) = self.communication.pdo.take_missed()
        {
            self.settled = false;
            self.emergency(0x8250, [rpdo + 1, 0, 0, 0, 0]);
        }
    }
}
