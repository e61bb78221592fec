//! What a node sends: which frame waits, handing it over, and what became of it.
//!
//! In: what each service has to send, and which frames have gone out. Out: one frame at a time, the
//! one with the lowest identifier.
//!
//! Left out: the mailboxes.

use super::{Application, BootUp, Event, Node, Outgoing, Service, UNCONFIGURED, Waiting};
use crate::error_control::{ERROR_CONTROL, boot_up};
use crate::frame::Frame;
use crate::nmt::{self, State};
use crate::pdo::Tpdos;
use instant::Instant;

impl<T: Tpdos> Node<T> {
    /// The frame to send now: of all that wait, the one with the lowest identifier.
    ///
    /// Hand it to the controller, and call [`Node::sent`] when it has gone out, or
    /// [`Node::withdrawn`] when it was taken back because it [`expires`](Node::expires).
    pub fn transmit<A: Application>(&mut self, app: &mut A, now: Instant) -> Option<Frame> {
        let waiting = self.waiting::<A>(now)?;
        Some(self.hand_out(app, waiting, now)?.frame)
    }

    /// The frame of a service that [`Node::waiting`] has named at the same instant.
    pub fn hand_out<A: Application>(
        &mut self,
        app: &mut A,
        waiting: Waiting,
        now: Instant,
    ) -> Option<Outgoing> {
        self.settled = false;
        let services = &mut self.communication;
        let timely = match waiting.service {
            Service::Pdo => services.pdo.hand_out(waiting.cob_id, now),
            Service::Safety if A::SERVICES.safety => services.safety.hand_out(now),
            _ => {
                let frame = self.lasting(app, waiting, now)?;
                return Some(Outgoing { frame, until: None });
            }
        };
        let (frame, until) = timely?;
        let until = Some(until);
        Some(Outgoing { frame, until })
    }

    /// The frame of a service whose frames do not grow old.
    fn lasting<A: Application>(
        &mut self,
        app: &mut A,
        waiting: Waiting,
        now: Instant,
    ) -> Option<Frame> {
        let services = &mut self.communication;
        match waiting.service {
            Service::Lss if A::SERVICES.lss => {
                let answer = self.lss.transmit()?;
                Some(Frame::data_frame(waiting.cob_id, &answer))
            }
            Service::BootUp => {
                self.boot_up = BootUp::HandedOver;
                if services.state == State::Initialising {
                    self.booted(app, now);
                }
                Some(boot_up(self.node_id))
            }
            Service::Sync if A::SERVICES.sync_producer => services.sync.transmit(now),
            Service::Emergency => services.emergency.transmit(),
            Service::Sdo => self.response(app, now),
            Service::ErrorControl => {
                let state = services.state;
                services.error_control.transmit(self.node_id, state, now)
            }
            Service::Lss | Service::Sync | Service::Safety | Service::Pdo => None,
        }
    }

    fn response<A: Application>(&mut self, app: &mut A, now: Instant) -> Option<Frame> {
        let (server, mut view) = self.serving(app, now);
        let data = server.transmit(&mut view, now)?;
        Some(Frame::data_frame(0x580 + u16::from(self.node_id), &data))
    }

    /// The identifier of what [`Node::transmit`] would give now.
    ///
    /// For a driver with few mailboxes: it keeps one free for what outranks all that wait there.
    pub fn next_cob_id<A: Application>(&self, now: Instant) -> Option<u16> {
        self.waiting::<A>(now).map(|waiting| waiting.cob_id)
    }

    /// From when on the frame of this identifier that was handed over last may not go out any
    /// more; `None` when it may at any time. Process data and safety frames grow old, the others do
    /// not.
    pub fn expires<A: Application>(&self, cob_id: u16) -> Option<Instant> {
        let services = &self.communication;
        let safety = A::SERVICES.safety.then(|| services.safety.expires(cob_id));
        safety.flatten().or_else(|| services.pdo.expires(cob_id))
    }

    /// A frame from [`Node::transmit`] was taken back from the controller.
    pub fn withdrawn(&mut self, cob_id: u16) {
        self.settled = false;
        self.communication.pdo.withdrawn(cob_id);
    }

    /// What [`Node::transmit`] would give: its identifier and whose it is.
    pub fn waiting<A: Application>(&self, now: Instant) -> Option<Waiting> {
        if A::SERVICES.lss && self.lss.is_pending() {
            return Some(Waiting {
                cob_id: crate::lss::RESPONSE,
                service: Service::Lss,
            });
        }
        // Nothing overtakes the boot-up message, not in a mailbox beside it either: it is what a
        // master begins anew with, and forgets what came before (CiA 301 v4.2.0, 7.3.2.2).
        match self.boot_up {
            // Both in one arm: the image is smaller.
            _ if self.node_id == UNCONFIGURED || self.boot_up == BootUp::HandedOver => None,
            BootUp::Due => Some(Waiting {
                cob_id: ERROR_CONTROL + u16::from(self.node_id),
                service: Service::BootUp,
            }),
            _ => self.first::<A>(now),
        }
    }

    /// Which service holds the lowest identifier.
    fn first<A: Application>(&self, now: Instant) -> Option<Waiting> {
        let services = &self.communication;
        let state = services.state;
        let mut first = Waiting {
            cob_id: u16::MAX,
            service: Service::Lss,
        };
        let mut waits = |cob_id: Option<u16>, service| {
            if let Some(cob_id) = cob_id.filter(|cob_id| *cob_id < first.cob_id) {
                first = Waiting { cob_id, service };
            }
        };
        if A::SERVICES.sync_producer {
            waits(services.sync.next_cob_id(state, now), Service::Sync);
        }
        waits(
            services.emergency.next_cob_id(state, now),
            Service::Emergency,
        );
        if A::SERVICES.safety {
            waits(services.safety.next_cob_id(now), Service::Safety);
        }
        waits(services.pdo.next_cob_id(now), Service::Pdo);
        if self.server.is_pending() && state.allows_sdo() {
            waits(Some(0x580 + u16::from(self.node_id)), Service::Sdo);
        }
        if services.error_control.is_due(now) {
            let error_control = ERROR_CONTROL + u16::from(self.node_id);
            waits(Some(error_control), Service::ErrorControl);
        }
        (first.cob_id != u16::MAX).then_some(first)
    }

    /// The boot-up message is handed over: the node is pre-operational, or starts itself (1F80h).
    fn booted<A: Application>(&mut self, app: &mut A, now: Instant) {
        let services = &mut self.communication;
        services.state = State::PreOperational;
        services.error_control.start(now);
        services.sync.start(now);
        let starts = nmt::self_starting(services.startup);
        app.event(Event::State(State::PreOperational), now);
        if starts {
            self.enter(app, State::Operational, now);
        }
    }

    /// A frame from [`Node::transmit`] has ended on the bus at `now`.
    ///
    /// Only then has it been told, and is not told again after bus-off. And only then has this
    /// node's own SYNC happened, at the same instant as for everybody else; true when that was it.
    pub fn sent<A: Application>(&mut self, app: &mut A, frame: &Frame, now: Instant) -> bool {
        if let Some(cob_id) = frame.cob_id() {
            self.pdo_sent(cob_id, now);
        }
        let sync = self.told(frame, now);
        if sync {
            self.sync_frame(app, frame, now);
        }
        sync
    }

    /// Notes that a frame of this identifier, which is one of a PDO, has ended on the bus at `now`;
    /// true when a sample has waited for that.
    pub fn pdo_sent(&mut self, cob_id: u16, now: Instant) -> bool {
        let waits = self.communication.pdo.sent(cob_id, now);
        self.settled &= !waits;
        waits
    }

    /// Notes that a frame from [`Node::transmit`] has ended on the bus at `now`, all but the effect
    /// of a SYNC and what [`Node::pdo_sent`] does; true when it was this node's own SYNC, which
    /// [`Node::sync_sent`] has to follow.
    pub fn told(&mut self, frame: &Frame, now: Instant) -> bool {
        if let Some(cob_id) = frame.cob_id() {
            self.settled &= !self.communication.emergency.sent(cob_id, now);
            if cob_id == ERROR_CONTROL + u16::from(self.node_id) {
                self.error_control_sent(frame);
            }
        }
        self.communication.sync.is_own(frame)
    }

    /// This node's own SYNC, of which [`Node::told`] has told, has gone out at `now`.
    pub fn sync_sent<A: Application>(&mut self, app: &mut A, frame: &Frame, now: Instant) {
        self.sync_frame(app, frame, now);
    }

    /// A boot-up message, a heartbeat or an answer to guarding has gone out.
    fn error_control_sent(&mut self, frame: &Frame) {
        if frame.bytes() != [0] {
            self.communication.error_control.sent();
        } else if self.boot_up == BootUp::HandedOver {
            self.boot_up = BootUp::Sent;
        }
    }
}
