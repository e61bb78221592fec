//! A CANopen slave as a whole: frames and time in, frames out (CiA 301, 7.3).
//!
//! In: every frame on the bus with the time of its end, the time, and the state of the CAN
//! controller. Out: one frame at a time, the one that arbitration would let through first, made
//! when the controller has room for it. Nothing queues up: each service holds what it has to
//! send, so output is bounded and a new value replaces an old one that could not be sent.
//!
//! What the device itself has to do (measure at SYNC, reset, switch the bit rate) is told through
//! [`Application::event`].
//!
//! Left out: the dictionary above 1FFFh and everything it means.

mod due;
mod transmit;
mod view;

#[cfg(test)]
mod tests;

use self::view::{Mapped, View};
use crate::communication::Communication;
use crate::emcy;
use crate::error_control::{ERROR_CONTROL, Event as Control};
use crate::frame::Frame;
use crate::lss::{self, Lss, Request};
use crate::nmt::{self, Command, State};
use crate::object::packed::Form;
use crate::object::{Abort, Address, Objects, Value, at};
use crate::pdo::{PDOS, Received, Tpdo, Tpdos};
use crate::sdo::Server;
use crate::srdo::{self, SafetyReceived};
use crate::storage::{self, Group};
use crate::time::Deadline;
use instant::Instant;

/// The node-id of a device that has none (CiA 305).
pub const UNCONFIGURED: u8 = 255;

/// What the device is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The NMT state is another one now.
    State(State),
    /// A master asks for a reset of the whole device: call [`Node::start`] after it.
    ResetNode,
    /// Communication was reset; stored communication parameters are in force again.
    ResetCommunication,
    /// A SYNC has come or gone out; TPDOs are sampled right after this returns.
    Sync,
    /// A supervised node's heartbeat has begun, stopped or come back.
    Heartbeat {
        /// The supervised node.
        node: u8,
        /// True while it is heard.
        alive: bool,
    },
    /// The master has stopped guarding this node, or guards it again.
    LifeGuarding {
        /// True while it guards.
        alive: bool,
    },
    /// RPDO number (0 to 3) was applied.
    Received(u8),
    /// LSS: be silent for the delay, change the bit rate, be silent for the delay again.
    BitRate {
        /// The new rate; `None` asks for automatic detection.
        kbit_s: Option<u16>,
        /// The delay, twice.
        delay_ms: u16,
    },
    /// The pair of SRDO number (0 or 1) has stopped coming, or its halves disagree.
    SafetyLost(u8),
    /// Somebody demands the safe state by GFC.
    FailSafe,
}

/// The device behind the node: its objects, its memory, and what it does on events.
pub trait Application: Objects {
    /// Vendor-id, product code, revision and serial number, as in 1018h.
    fn identity(&self) -> [u32; 4];

    /// Something has happened. Not called re-entrantly.
    fn event(&mut self, event: Event, now: Instant);

    /// Puts a default or stored value of the device's own objects in place, without effects.
    fn load(&mut self, at: Address, value: Value);

    /// Opens a record for a group; the old one counts until [`Application::commit_store`].
    fn begin_store(&mut self, group: Group) -> Result<(), Abort>;

    /// Adds a value to the open record.
    fn put(&mut self, at: Address, value: Value) -> Result<(), Abort>;

    /// Closes the record: it counts, whole, from now on.
    fn commit_store(&mut self) -> Result<(), Abort>;

    /// Forgets a group's record.
    fn erase(&mut self, group: Group) -> Result<(), Abort>;

    /// A stored value.
    fn stored(&mut self, group: Group, at: Address) -> Option<Value>;

    /// Keeps node-id and bit rate (kbit/s, 0: to be detected) over a power cut (LSS); false when
    /// that fails. A rate that is `None` stays as it was.
    fn store_lss(&mut self, node_id: u8, kbit_s: Option<u16>) -> bool;
}

/// The CAN controller's error state (ISO 11898-1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BusState {
    /// Takes part, and flags errors actively.
    #[default]
    Active,
    /// Takes part, and flags errors passively.
    Passive,
    /// Takes no part.
    Off,
}

/// The last identifier of SDO answers: above it there are none of PDOs (CiA 301, 7.3.5).
const LAST_TRANSMITTED: u16 = 0x5FF;

/// Error register bit 4: communication.
const COMMUNICATION: u8 = 0x10;

/// A CANopen slave: configuration and state. What is small comes first, also in memory: short
/// instructions reach it.
#[derive(Clone, Debug)]
#[repr(C)]
pub struct Node<T = [Tpdo; PDOS]> {
    node_id: u8,
    bus: BusState,
    boot_up: BootUp,
    /// Error register bits that the device has set.
    device_bits: u8,
    /// Communication errors that are present: nodes not heard (0 to 3), guarding, bus.
    present: u8,
    overruns: u16,
    /// Nothing has changed since the last [`Node::poll`], which returned when there is more to do.
    settled: bool,
    next: Deadline,
    lss: Lss,
    server: Server,
    communication: Communication<T>,
}

/// Nodes not heard and guarding, as [`ErrorControl::lost`](crate::error_control::ErrorControl).
const SUPERVISED: u8 = 0x1F;
const GUARDING: u8 = 0x10;
const PASSIVE: u8 = 0x20;
const OFF: u8 = 0x40;

/// Services of one node, in no order: arbitration decides.
#[derive(Clone, Copy)]
enum Service {
    Lss,
    BootUp,
    Sync,
    Emergency,
    Pdo,
    Safety,
    Sdo,
    ErrorControl,
}

/// Where the boot-up message is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum BootUp {
    /// It is to be sent.
    Due,
    /// The controller has it.
    HandedOver,
    /// It has gone out.
    Sent,
}

/// A service that has something to send.
#[derive(Clone, Copy)]
pub struct Waiting {
    /// The identifier of its frame.
    pub cob_id: u16,
    service: Service,
}

/// A frame for the controller.
#[derive(Clone, Copy, Debug)]
pub struct Outgoing {
    /// The frame.
    pub frame: Frame,
    /// From when on it may not go out any more, as [`Node::expires`] returns; `None`: at any time.
    pub until: Option<Instant>,
}

impl<T: Tpdos> Node<T> {
    /// A node that is not on the bus: call [`Node::start`].
    #[inline(never)]
    pub const fn new() -> Self {
        Self {
            node_id: UNCONFIGURED,
            bus: BusState::Active,
            boot_up: BootUp::Due,
            device_bits: 0,
            present: 0,
            overruns: 0,
            settled: false,
            next: Deadline::NONE,
            lss: Lss::new(),
            server: Server::new(),
            communication: Communication::new(),
        }
    }

    /// Power-on or reset of the whole device: everything stored comes back, boot-up is due.
    ///
    /// `node_id` is 1 to 127, or [`UNCONFIGURED`]: then only LSS is served.
    pub fn start<A: Application>(&mut self, app: &mut A, node_id: u8, now: Instant) {
        self.settled = false;
        self.lss = Lss::new();
        self.lss.start(node_id);
        self.device_bits = 0;
        self.bring_back(app, &[Group::Manufacturer, Group::Profile]);
        self.reset_communication(app, now);
    }

    /// The node-id in force; [`UNCONFIGURED`] without one.
    pub const fn node_id(&self) -> u8 {
        self.node_id
    }

    /// The NMT state.
    pub const fn state(&self) -> State {
        self.communication.state
    }

    /// The services, for looking at.
    pub const fn communication(&self) -> &Communication<T> {
        &self.communication
    }

    /// Defaults, then what was stored, for every row of these groups that is kept.
    fn bring_back<A: Application>(&mut self, app: &mut A, groups: &[Group]) {
        let dictionary = app.dictionary();
        for group in groups {
            for entry in storage::rows(&dictionary, *group) {
                for sub in entry.sub..=entry.last {
                    let address = at(entry.index, sub);
                    if A::SERVICES.serve(address).is_err() {
                        continue;
                    }
                    let storage = A::SERVICES.storage;
                    let kept = if storage {
                        app.stored(*group, address)
                    } else {
                        None
                    };
                    // A value of a former version that no longer fits is not taken.
                    let kept = kept.filter(|v| dictionary.admits(&Form::of(&entry), v).is_ok());
                    let Some(value) = kept.or_else(|| dictionary.default(&entry, self.node_id))
                    else {
                        continue;
                    };
                    if !self.communication.load::<A>(address, value) {
                        app.load(address, value);
                    }
                }
            }
        }
    }

    /// The SDO server, and what it serves.
    fn serving<'a, A>(
        &'a mut self,
        app: &'a mut A,
        now: Instant,
    ) -> (&'a mut Server, View<'a, A, T>) {
        let view = View {
            communication: &mut self.communication,
            application: app,
            node_id: self.node_id,
            now,
        };
        (&mut self.server, view)
    }

    fn end_transfer<A: Application>(&mut self, app: &mut A, now: Instant) {
        let (server, mut view) = self.serving(app, now);
        server.reset(&mut view);
    }

    fn reset_communication<A: Application>(&mut self, app: &mut A, now: Instant) {
        self.end_transfer(app, now);
        self.node_id = self.lss.take_node_id();
        self.communication.clear();
        self.boot_up = BootUp::Due;
        // What the controller reports of the bus holds until it reports otherwise.
        self.present &= PASSIVE | OFF;
        self.bring_back(app, &[Group::Communication]);
        let dictionary = app.dictionary();
        let sound = self.communication.pdo.check(&dictionary).is_ok()
            & (!A::SERVICES.safety || self.communication.safety.check(&dictionary).is_ok());
        self.communication.pdo.window_us = self.communication.sync.window_us();
        app.event(Event::ResetCommunication, now);
        if !sound {
            self.emergency(nmt::SOFTWARE, [1, 0, 0, 0, 0]);
        }
        self.set_register();
    }

    /// Takes a frame that has ended on the bus at `now`. Frames of no concern are ignored, which
    /// gives false: nothing has changed then.
    pub fn receive<A: Application>(&mut self, app: &mut A, frame: &Frame, now: Instant) -> bool {
        let Some(id) = frame.cob_id() else {
            return false;
        };
        // Most frames are process data, of this node's or of others.
        if (id == 0 || id > LAST_TRANSMITTED)
            && let Some(taken) = self.command_frame(app, frame, id, now)
        {
            self.settled &= !taken;
            return taken;
        }
        if self.node_id == UNCONFIGURED {
            return false;
        }
        if self.communication.sync.recognises(frame) {
            self.sync_frame(app, frame, now);
            return true;
        }
        // Error control may have taken it without anything to tell.
        let taken = self.process_data(app, frame, id, now) || id >= ERROR_CONTROL;
        self.settled &= !taken;
        taken
    }

    /// Services whose identifiers no PDO has: LSS, NMT, error control, SDO. Whether somebody here
    /// has taken it; `None` when it may be another's.
    // Apart, because most calls are for process data, which would set up what only these need.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn command_frame<A: Application>(
        &mut self,
        app: &mut A,
        frame: &Frame,
        id: u16,
        now: Instant,
    ) -> Option<bool> {
        if A::SERVICES.lss
            && id == lss::REQUEST
            && let Some(request) = self.lss_frame(app, frame)
        {
            self.lss_request(app, request, now);
            return Some(true);
        }
        if self.node_id == UNCONFIGURED {
            return Some(false);
        }
        if let Some(command) = nmt::command(frame, self.node_id) {
            self.command(app, command, now);
            return Some(true);
        }
        let services = &mut self.communication;
        let event = services
            .error_control
            .receive::<A>(frame, self.node_id, now);
        if let Some(event) = event {
            self.control(app, event, now);
        } else if id == 0x600 + u16::from(self.node_id) && !frame.is_remote() {
            if services.state.allows_sdo() {
                self.request(app, frame, now);
            }
        } else {
            return None;
        }
        Some(true)
    }

    fn request<A: Application>(&mut self, app: &mut A, frame: &Frame, now: Instant) {
        let (server, mut view) = self.serving(app, now);
        server.request(&mut view, frame, now);
        self.communication.pdo.window_us = self.communication.sync.window_us();
        // A loss that is no longer supervised cannot end by itself.
        let forgotten = self.present & SUPERVISED & !self.communication.error_control.lost();
        if forgotten != 0 {
            self.present ^= forgotten;
            self.cleared(self.device_bits, [0; 5]);
        }
    }

    /// True when somebody here has taken it.
    fn process_data<A: Application>(
        &mut self,
        app: &mut A,
        frame: &Frame,
        id: u16,
        now: Instant,
    ) -> bool {
        if !self.communication.state.allows_pdo() {
            return false;
        }
        if !A::SERVICES.safety || id > srdo::LAST_ID {
            return self.pdo_frame(app, frame, now);
        }
        let register = self.communication.emergency.register();
        let mut mapped = Mapped {
            application: app,
            register,
        };
        match self.communication.safety.receive(&mut mapped, frame, now) {
            Some(SafetyReceived::FailSafe) => app.event(Event::FailSafe, now),
            Some(SafetyReceived::Lost(srdo)) => app.event(Event::SafetyLost(srdo), now),
            Some(SafetyReceived::Taken) => {}
            None => return self.pdo_frame(app, frame, now),
        }
        true
    }

    /// True when it is for one of the PDOs.
    fn pdo_frame<A: Application>(&mut self, app: &mut A, frame: &Frame, now: Instant) -> bool {
        let register = self.communication.emergency.register();
        let mut mapped = Mapped {
            application: app,
            register,
        };
        match self.communication.pdo.receive(&mut mapped, frame, now) {
            Some(Received::Taken(rpdo)) => app.event(Event::Received(rpdo), now),
            Some(Received::TooShort(rpdo)) => self.emergency(0x8210, [rpdo + 1, 0, 0, 0, 0]),
            Some(Received::TooLong(rpdo)) => self.emergency(0x8220, [rpdo + 1, 0, 0, 0, 0]),
            // What a master may not write by SDO it may not write by PDO either, but nobody
            // waits for an answer; the message names at least whose data were not taken.
            Some(Received::Refused(rpdo)) => self.emergency(0x8200, [rpdo + 1, 0, 0, 0, 0]),
            Some(Received::Waiting) | Some(Received::Requested) => {}
            None => return false,
        }
        true
    }

    /// A SYNC has come from somebody else, or this node's own has gone out.
    fn sync_frame<A: Application>(&mut self, app: &mut A, frame: &Frame, now: Instant) {
        if !self.communication.state.allows_sync() {
            return;
        }
        self.settled = false;
        match self.communication.sync.receive(frame) {
            Ok(sync) => {
                app.event(Event::Sync, now);
                if self.communication.state.allows_pdo() {
                    let register = self.communication.emergency.register();
                    let mut mapped = Mapped {
                        application: app,
                        register,
                    };
                    let applied = self.communication.pdo.sync(&mut mapped, sync.counter, now);
                    if applied != 0 {
                        Self::tell_applied(app, applied, now);
                    }
                }
            }
            // 8240h: a SYNC of a length that does not fit 1019h is not obeyed.
            Err(length) => self.emergency(0x8240, [length, 0, 0, 0, 0]),
        }
    }

    /// RPDOs that waited for SYNC were applied, bit n for number n.
    fn tell_applied<A: Application>(app: &mut A, applied: u8, now: Instant) {
        for rpdo in (0..8).filter(|n| applied >> n & 1 != 0) {
            app.event(Event::Received(rpdo), now);
        }
    }

    fn command<A: Application>(&mut self, app: &mut A, command: Command, now: Instant) {
        match command {
            Command::Start => self.enter(app, State::Operational, now),
            Command::Stop => self.enter(app, State::Stopped, now),
            Command::EnterPreOperational => self.enter(app, State::PreOperational, now),
            Command::ResetCommunication => self.reset_communication(app, now),
            Command::ResetNode => app.event(Event::ResetNode, now),
        }
    }

    fn enter<A: Application>(&mut self, app: &mut A, state: State, now: Instant) {
        // Before its boot-up message has gone out a node is still initialising.
        if self.communication.state == state || self.communication.state == State::Initialising {
            return;
        }
        if self.communication.state == State::Operational {
            self.communication.pdo.stop();
            if A::SERVICES.safety {
                self.communication.safety.stop();
            }
        }
        if self.communication.state == State::Stopped {
            // The counter begins anew (CiA 301, SYNC protocol), and nothing missed is made up for.
            self.communication.sync.start(now);
        }
        self.communication.state = state;
        if state == State::Operational {
            // LSS ends here; its slave begins by waiting when it is served again.
            self.lss.wait();
            self.communication.pdo.start(now);
            if A::SERVICES.safety {
                self.communication.safety.start(now);
            }
        }
        if state == State::Stopped {
            self.end_transfer(app, now);
        }
        app.event(Event::State(state), now);
    }

    fn control<A: Application>(&mut self, app: &mut A, event: Control, now: Instant) {
        match event {
            Control::Heartbeat { slot, node, alive } => {
                self.communication_error(app, 1 << (slot & 3), !alive, 0x8130, node, now);
                app.event(Event::Heartbeat { node, alive }, now);
            }
            Control::LifeGuarding { alive } => {
                self.communication_error(app, GUARDING, !alive, 0x8130, 0, now);
                app.event(Event::LifeGuarding { alive }, now);
            }
        }
    }

    /// A communication error appears or goes: EMCY, error register, and what 1029h sub 1 asks.
    fn communication_error<A: Application>(
        &mut self,
        app: &mut A,
        which: u8,
        present: bool,
        code: u16,
        detail: u8,
        now: Instant,
    ) {
        if (self.present & which != 0) == present {
            return;
        }
        self.present ^= which;
        if !present {
            return self.cleared(self.device_bits, [0; 5]);
        }
        self.emergency(code, [detail, 0, 0, 0, 0]);
        self.communication_failed(app, now);
    }

    /// 1029h sub 1.
    fn communication_failed<A: Application>(&mut self, app: &mut A, now: Instant) {
        let services = &self.communication;
        if let Some(state) = services.behaviour.after(1, services.state) {
            self.enter(app, state, now);
        }
    }

    const fn register(&self) -> u8 {
        let communication = if self.present != 0 { COMMUNICATION } else { 0 };
        self.device_bits | communication
    }

    fn set_register(&mut self) {
        let register = self.register();
        self.communication.emergency.set_register(register);
    }

    /// A communication error that is told once and leaves no state.
    fn emergency(&mut self, code: u16, detail: [u8; 5]) {
        self.settled = false;
        let register = self.register();
        self.communication.emergency.raise(code, register, detail);
    }

    /// The device has found something wrong. `bits` is its whole share of the error register.
    pub fn report<A: Application>(
        &mut self,
        app: &mut A,
        code: u16,
        bits: u8,
        detail: [u8; 5],
        now: Instant,
    ) {
        self.device_bits = bits;
        self.emergency(code, detail);
        if let Some(state) = self
            .communication
            .behaviour
            .after(2, self.communication.state)
        {
            self.enter(app, state, now);
        }
    }

    /// Something has gone again; `bits` is what is left. EMCY 0000h with the register that remains.
    pub fn cleared(&mut self, bits: u8, detail: [u8; 5]) {
        self.settled = false;
        self.device_bits = bits;
        let register = self.register();
        self.communication.emergency.clear(register, detail);
    }

    /// What the CAN controller reports of itself. Bus-off recovery is the device's to ask for; the
    /// frames that the controller had then are to be thrown away.
    pub fn bus_state<A: Application>(&mut self, app: &mut A, state: BusState, now: Instant) {
        let before = core::mem::replace(&mut self.bus, state);
        if before == state {
            return;
        }
        self.settled = false;
        if state == BusState::Off {
            // Nobody hears that it is no longer passive, and it is no better for that.
            self.present = self.present & !PASSIVE | OFF;
            self.set_register();
            self.lose_frames();
            return self.communication_failed(app, now);
        }
        if before == BusState::Off {
            self.present &= !OFF;
            self.emergency(emcy::RECOVERED, [0; 5]);
        }
        let passive = state == BusState::Passive;
        if passive {
            // A warning: CiA 301 names bus-off and lost nodes as what 1029h acts on, not this.
            self.present |= PASSIVE;
            self.emergency(emcy::PASSIVE, [0; 5]);
        } else if self.present & PASSIVE != 0 {
            self.present &= !PASSIVE;
            self.cleared(self.device_bits, [0; 5]);
        }
    }

    /// What was in the controller is gone. What is told once is told again: boot-up, EMCY, and what
    /// is sent on events. A client of SDO or LSS waits for its answer no longer than its own
    /// time-out and would take a late one for that to its next request; heartbeat, SYNC and process
    /// data come anew by themselves.
    fn lose_frames(&mut self) {
        if self.boot_up == BootUp::HandedOver {
            self.boot_up = BootUp::Due;
        }
        self.communication.emergency.lost();
        self.communication.error_control.bus_off();
        self.communication.pdo.bus_off();
    }

    /// Frames were lost because nobody took them out of the controller in time.
    ///
    /// They are counted. Of those before the boot-up message there is no EMCY: whoever sent them
    /// did not expect this node yet.
    pub fn overrun(&mut self, lost: u16) {
        self.overruns = self.overruns.saturating_add(lost);
        if self.boot_up == BootUp::Sent {
            self.emergency(0x8110, [lost as u8, (lost >> 8) as u8, 0, 0, 0]);
        }
    }

    /// The processor stood still until `now`, so frames may have been lost that were sent: nobody
    /// is held to be silent for that time.
    pub fn excuse(&mut self, now: Instant) {
        self.settled = false;
        self.communication.error_control.excuse(now);
    }

    /// Frames lost on the way in, and samples that were replaced before they could be sent.
    pub fn overruns(&self) -> u16 {
        self.overruns
            .saturating_add(self.communication.pdo.overruns())
    }

    /// The device's data have changed by themselves: event-driven PDOs are due.
    pub fn data_changed<A: Application>(&mut self, app: &mut A, now: Instant) {
        if self.communication.state.allows_pdo() {
            self.settled = false;
            let register = self.communication.emergency.register();
            let mut mapped = Mapped {
                application: app,
                register,
            };
            self.communication.pdo.event(&mut mapped, now);
        }
    }

    /// Asks for SYNC by this node although 1005h does not: there is none on the bus. Without effect
    /// where [`Services::sync_producer`](crate::services::Services) is left out.
    pub fn stand_in_for_sync(&mut self, period_us: Option<u32>, now: Instant) {
        self.settled = false;
        self.communication.sync.produce_for_absence(period_us, now);
    }

    /// Whether the device consents to SRDOs, and when it has checked last what they carry. Without
    /// consent the producer stops: the safe state. True when consent begins or ends.
    pub fn consent_to_safety(&mut self, checked: Option<Instant>) -> bool {
        let has_changed = self.communication.safety.release(checked);
        self.settled &= !has_changed;
        has_changed
    }

    fn lss_frame<A: Application>(&mut self, app: &A, frame: &Frame) -> Option<Request> {
        // CiA 305: LSS is served where configuring can do no harm.
        if !self.communication.state.allows_lss() && self.node_id != UNCONFIGURED {
            return None;
        }
        let fastscan = A::SERVICES.fastscan;
        self.lss.serve(frame, &app.identity(), fastscan)
    }

    fn lss_request<A: Application>(&mut self, app: &mut A, request: Request, now: Instant) {
        match request {
            Request::Answered => {}
            Request::Store { node_id, kbit_s } => {
                let kept = app.store_lss(node_id, kbit_s);
                self.lss.respond_store(kept);
            }
            Request::Activate { kbit_s, delay_ms } => {
                app.event(Event::BitRate { kbit_s, delay_ms }, now);
            }
            Request::Initialise => self.reset_communication(app, now),
        }
    }
}

impl<T: Tpdos> Default for Node<T> {
    fn default() -> Self {
        Self::new()
    }
}
