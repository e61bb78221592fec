//! What a node sends: which frame waits, handing it over, and what became of it.
//!
//! In: what each service has to send, and which frames have gone out. Out: one frame at a time, the
//! one with the lowest identifier.
//!
//! Left out: the mailboxes.

use super::{Application, BootUp, Event, Node, Service, UNCONFIGURED, Waiting};
use crate::error_control::{ERROR_CONTROL, boot_up};
use crate::frame::Frame;
use crate::nmt::{self, State};
use crate::time::Instant;

impl Node {
    /// The frame to send now: of all that wait, the one with the lowest identifier.
    ///
    /// Hand it to the controller, and call [`Node::sent`] when it has gone out, or
    /// [`Node::withdrawn`] when it was taken back because it [`expires`](Node::expires).
    pub fn transmit<A: Application>(&mut self, app: &mut A, now: Instant) -> Option<Frame> {
        let waiting = self.waiting(now)?;
        self.hand_out(app, waiting, now)
    }

    /// The frame of a service that [`Node::waiting`] has named at the same instant.
    pub fn hand_out<A: Application>(
        &mut self,
        app: &mut A,
        waiting: Waiting,
        now: Instant,
    ) -> Option<Frame> {
        match waiting.service {
            Service::Lss => {
                let answer = self.lss.transmit()?;
                Some(Frame::data_frame(waiting.cob_id, &answer))
            }
            Service::BootUp => {
                self.boot_up = BootUp::HandedOver;
                if self.communication.state == State::Initialising {
                    self.booted(app, now);
                }
                Some(boot_up(self.node_id))
            }
            Service::Sync => self.communication.sync.transmit(now),
            Service::Emergency => self.communication.emergency.transmit(now),
            Service::Safety => self.communication.safety.transmit(now),
            Service::Pdo => self.communication.pdo.hand_out(waiting.cob_id, now),
            Service::Sdo => self.response(app, now),
            Service::ErrorControl => {
                let state = self.communication.state;
                self.communication
                    .error_control
                    .transmit(self.node_id, state, now)
            }
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
    pub fn next_cob_id(&self, now: Instant) -> Option<u16> {
        self.waiting(now).map(|waiting| waiting.cob_id)
    }

    /// From when on the frame of this identifier that was handed over last may not go out any
    /// more; `None` when it may at any time. Process data and safety frames grow old, the others do
    /// not.
    pub fn expires(&self, cob_id: u16) -> Option<Instant> {
        let services = &self.communication;
        let safety = services.safety.expires(cob_id);
        safety.or_else(|| services.pdo.expires(cob_id))
    }

    /// A frame from [`Node::transmit`] was taken back from the controller.
    pub fn withdrawn(&mut self, cob_id: u16) {
        self.communication.pdo.withdrawn(cob_id);
    }

    /// What [`Node::transmit`] would give: its identifier and whose it is.
    pub fn waiting(&self, now: Instant) -> Option<Waiting> {
        if self.lss.is_pending() {
            return Some(Waiting {
                cob_id: crate::lss::RESPONSE,
                service: Service::Lss,
            });
        }
        match self.communication.state {
            _ if self.node_id == UNCONFIGURED => None,
            State::Initialising => Some(Waiting {
                cob_id: ERROR_CONTROL + u16::from(self.node_id),
                service: Service::BootUp,
            }),
            _ => self.first(now),
        }
    }

    /// Which service holds the lowest identifier.
    fn first(&self, now: Instant) -> Option<Waiting> {
        let services = &self.communication;
        let id = u16::from(self.node_id);
        let sdo = self.server.is_pending() && services.state.allows_sdo();
        let error_control = services.error_control.is_due(now);
        let mut lowest = u16::MAX;
        let mut first = None;
        let mut waits = |cob_id: Option<u16>, service| {
            if let Some(cob_id) = cob_id.filter(|cob_id| *cob_id < lowest) {
                lowest = cob_id;
                first = Some(Waiting { cob_id, service });
            }
        };
        waits(
            services.sync.next_cob_id(services.state, now),
            Service::Sync,
        );
        waits(
            services.emergency.next_cob_id(services.state, now),
            Service::Emergency,
        );
        waits(services.safety.next_cob_id(now), Service::Safety);
        waits(services.pdo.next_cob_id(now), Service::Pdo);
        waits(sdo.then_some(0x580 + id), Service::Sdo);
        let boot_up = self.boot_up == BootUp::Due;
        waits(boot_up.then_some(ERROR_CONTROL + id), Service::BootUp);
        waits(
            error_control.then_some(ERROR_CONTROL + id),
            Service::ErrorControl,
        );
        first
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
        let sync = self.told(frame);
        if sync {
            self.sync_frame(app, frame, now);
        }
        sync
    }

    /// Notes that a frame from [`Node::transmit`] has gone out, all but the effect of a SYNC; true
    /// when it was this node's own SYNC, which [`Node::sync_sent`] has to follow.
    pub fn told(&mut self, frame: &Frame) -> bool {
        if let Some(cob_id) = frame.cob_id() {
            self.communication.emergency.sent(cob_id);
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
