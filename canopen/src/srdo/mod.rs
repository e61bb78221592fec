//! CANopen Safety: two SRDOs, their configuration, and the global fail-safe command
//! (EN 50325-5).
//!
//! In: frames, time, and the application's consent; objects are read and written through
//! [`Objects`]. Out: frames, always in pairs; what became of frames received; why an SRDO cannot
//! be relied on. The safe state of a producer is to send nothing.
//!
//! Left out: the sending of GFC, and any claim beyond the protocol: the safety of a machine is
//! not a property of its messages.

mod consumer;
mod producer;
mod setup;

#[cfg(test)]
mod tests;

use crate::frame::Frame;
use crate::object::{Abort, Address, Dictionary, Number, Objects, Value};
use crate::time::Deadline;
use consumer::Consumer;
use instant::Instant;
use producer::Producer;
use setup::{CONSUME, OFF, PRODUCE, Part, Setup};

/// SRDOs of a node.
pub const SRDOS: usize = 2;
/// Value of 13FEh that makes the configuration valid.
const VALID: u8 = 0xA5;
/// Identifier of the global fail-safe command.
const GFC_ID: u16 = 0x001;
/// The last identifier that a safety frame can have.
pub(crate) const LAST_ID: u16 = 0x180;

/// What became of a frame of CANopen Safety; SRDOs are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SafetyReceived {
    /// A frame of a consumed SRDO. [`Safety::state`] tells whether its pairs are relied on.
    Taken,
    /// The pairs of this SRDO cannot be relied on from now on.
    Lost(u8),
    /// Somebody demands the safe state of all devices.
    FailSafe,
}

/// What is known of an SRDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SrdoState {
    /// Not configured, configuration not valid, or node not OPERATIONAL.
    Off,
    /// Consumer: no pair has come yet, within the safeguard cycle time after the start.
    Waiting,
    /// Pairs come or go.
    Running,
    /// Producer: the application does not consent, so nothing is sent.
    Withheld,
    /// The halves are not each other's inverse, have a wrong length, or an object refused them.
    Inconsistent,
    /// Consumer: a frame without its twin, within the safety-related validation time.
    Unpaired,
    /// Consumer: no pair within the safeguard cycle time.
    TimedOut,
}

// With a tag of its own, `Off` is 0.
#[derive(Clone, Debug)]
#[repr(u8)]
enum Role {
    Off,
    Produce(Producer),
    Consume(Consumer),
}

#[derive(Clone, Debug)]
struct Srdo {
    setup: Setup,
    role: Role,
}

impl Srdo {
    const fn new() -> Self {
        Self {
            setup: Setup::new(),
            role: Role::Off,
        }
    }

    fn start(&mut self, valid: bool, now: Instant) {
        let armed = valid && self.setup.signature == self.setup.computed();
        self.role = match self.setup.direction {
            PRODUCE if armed => Role::Produce(Producer::new(now)),
            CONSUME if armed => Role::Consume(Consumer::new(&self.setup, now)),
            _ => Role::Off,
        };
    }

    fn producer(&self) -> Option<&Producer> {
        match &self.role {
            Role::Produce(producer) => Some(producer),
            Role::Consume(_) | Role::Off => None,
        }
    }

    fn ready(&self, now: Instant) -> Option<u16> {
        self.producer()?.ready(&self.setup, now)
    }
}

/// CANopen Safety of a node: configuration and state.
#[derive(Clone, Debug)]
pub struct Safety {
    srdos: [Srdo; SRDOS],
    /// 1300h: 1 when GFC is obeyed.
    gfc: u8,
    /// 13FEh is A5h.
    valid: bool,
    /// The node is OPERATIONAL.
    running: bool,
    /// The application lets producers send, and has checked then what they carry.
    checked: Option<Instant>,
}

/// Where a parameter is kept.
enum Place {
    Gfc,
    Valid,
    Signature,
    Parameter(usize, Part),
}

/// `None` when the address is not one of CANopen Safety here.
fn place(at: Address) -> Option<Place> {
    let n = usize::from(at.index & 0x7F).wrapping_sub(1);
    Some(match at.index {
        0x1300 => Place::Gfc,
        0x13FE => Place::Valid,
        0x13FF => Place::Signature,
        0x1301..=0x1302 => Place::Parameter(n, Part::Communication),
        0x1381..=0x1382 => Place::Parameter(n, Part::Mapping),
        _ => return None,
    })
}

// Its places are counted above.
const _: () = assert!(SRDOS == 2);

impl Safety {
    /// As [`Safety::new`], and a constant for the reason that [`crate::pdo::Pdos`] has.
    pub(crate) const NONE: Self = Self {
        srdos: [const { Srdo::new() }; SRDOS],
        gfc: 0,
        valid: false,
        running: false,
        checked: None,
    };

    /// Nothing configured, not valid, and no consent; defaults come in through [`Safety::load`].
    // Within a whole node it would be cleared by a second and third form of the library's memclr.
    #[inline(never)]
    pub const fn new() -> Self {
        Self::NONE
    }

    /// The value of 1300h to 1302h, 1381h, 1382h, 13FEh or 13FFh; `None` for any other index.
    pub fn read(&self, at: Address) -> Option<Result<Number, Abort>> {
        let single = |value: u8| match at.sub {
            0 => Ok(Number::u8(value)),
            _ => Err(Abort::NoSuchSubIndex),
        };
        Some(match place(at)? {
            Place::Gfc => single(self.gfc),
            Place::Valid => single(if self.valid { VALID } else { 0 }),
            Place::Signature => match at.sub.checked_sub(1) {
                None => Ok(Number::u8(SRDOS as u8)),
                Some(n) => match self.srdos.get(usize::from(n)) {
                    Some(srdo) => Ok(Number::u16(srdo.setup.signature)),
                    None => Err(Abort::NoSuchSubIndex),
                },
            },
            Place::Parameter(n, part) => self.srdos.get(n)?.setup.read(part, at.sub),
        })
    }

    /// Takes a value by SDO, under all the rules; `None` for an index of somebody else.
    ///
    /// A write to a parameter makes the configuration invalid (13FEh reads 0), also when it
    /// repeats the value: the tool is at work, and confirms when it has done. Errors:
    /// [`Abort::WrongState`] in OPERATIONAL, else the abort code of the rule that is broken;
    /// nothing has changed then.
    pub fn write(
        &mut self,
        dictionary: &Dictionary,
        at: Address,
        value: Value,
        operational: bool,
    ) -> Option<Result<(), Abort>> {
        let place = place(at)?;
        if operational {
            return Some(Err(Abort::WrongState));
        }
        Some(self.take(dictionary, place, at, value))
    }

    fn take(
        &mut self,
        dictionary: &Dictionary,
        place: Place,
        at: Address,
        value: Value,
    ) -> Result<(), Abort> {
        let byte = value.unsigned() as u8;
        match place {
            Place::Gfc | Place::Valid if at.sub != 0 => return Err(Abort::NoSuchSubIndex),
            Place::Gfc if byte > 1 => return Err(Abort::InvalidValue),
            Place::Gfc => {
                self.valid = false;
                self.gfc = byte;
            }
            Place::Valid => {
                if byte == VALID {
                    self.sound(dictionary)?;
                }
                self.valid = byte == VALID;
            }
            Place::Signature => return self.sign(at.sub, value),
            Place::Parameter(n, part) => {
                let srdo = self.srdos.get_mut(n).ok_or(Abort::NoSuchObject)?;
                srdo.setup.write(dictionary, part, at.sub, value)?;
                self.valid = false;
            }
        }
        Ok(())
    }

    /// 13FFh takes nothing but the signature of the parameters as they are, so that whoever
    /// writes it proves to have them.
    fn sign(&mut self, sub: u8, value: Value) -> Result<(), Abort> {
        let n = sub.checked_sub(1).ok_or(Abort::ReadOnly)?;
        let srdo = self.srdos.get_mut(usize::from(n));
        let setup = &mut srdo.ok_or(Abort::NoSuchSubIndex)?.setup;
        let computed = setup.computed();
        if value.unsigned() != u64::from(computed) {
            return Err(Abort::InvalidValue);
        }
        setup.signature = computed;
        Ok(())
    }

    /// Whether the whole configuration may be called valid.
    fn sound(&self, dictionary: &Dictionary) -> Result<(), Abort> {
        for srdo in &self.srdos {
            srdo.setup.check(dictionary)?;
        }
        let [a, b] = &self.srdos;
        let [a, b] = [&a.setup, &b.setup];
        if a.direction != OFF && b.direction != OFF && a.cob_ids == b.cob_ids {
            return Err(Abort::ParameterIncompatible);
        }
        Ok(())
    }

    /// Puts a default or stored value in place, in any order; false when it is somebody else's.
    pub fn load(&mut self, at: Address, value: Value) -> bool {
        let byte = value.unsigned() as u8;
        match place(at) {
            None => return false,
            Some(Place::Gfc) => self.gfc = byte,
            Some(Place::Valid) => self.valid = byte == VALID,
            Some(Place::Signature) => {
                let n = usize::from(at.sub).wrapping_sub(1);
                let Some(srdo) = self.srdos.get_mut(n) else {
                    return false;
                };
                srdo.setup.signature = value.unsigned() as u16;
            }
            Some(Place::Parameter(n, part)) => {
                let srdo = self.srdos.get_mut(n);
                return srdo.is_some_and(|srdo| srdo.setup.load(part, at.sub, value));
            }
        }
        true
    }

    /// After [`Safety::load`]: a configuration that calls itself valid and is not, loses A5h.
    ///
    /// Errors: what is wrong with it.
    pub fn check(&mut self, dictionary: &Dictionary) -> Result<(), Abort> {
        if !self.valid {
            return Ok(());
        }
        let result = self.sound(dictionary);
        self.valid = result.is_ok();
        result
    }

    /// The signature over the parameters of SRDO `srdo`, from 0; 0 when there is none.
    pub fn signature(&self, srdo: usize) -> u16 {
        self.srdos.get(srdo).map_or(0, |s| s.setup.computed())
    }

    /// The node enters OPERATIONAL: SRDOs run when the configuration is valid and signed.
    pub fn start(&mut self, now: Instant) {
        self.running = true;
        for srdo in &mut self.srdos {
            srdo.start(self.valid, now);
        }
    }

    /// The node leaves OPERATIONAL: nothing is sent or relied on.
    pub fn stop(&mut self) {
        self.running = false;
        for srdo in &mut self.srdos {
            srdo.role = Role::Off;
        }
    }

    /// The application lets producers send what it has checked at that instant, or withdraws that.
    /// Without consent nothing is sent, not even the other half of a pair that has begun; nor is
    /// anything whose check is older than its SRDO's cycle time. True when consent begins or ends.
    pub fn release(&mut self, checked: Option<Instant>) -> bool {
        let before = core::mem::replace(&mut self.checked, checked);
        if before.is_some() == checked.is_some() {
            return false;
        }
        for srdo in &mut self.srdos {
            if let (Role::Produce(producer), None) = (&mut srdo.role, checked) {
                producer.withhold();
            }
        }
        true
    }

    /// Samples producers that are due, watches over consumers; when to call again.
    pub fn poll<O: Objects>(&mut self, objects: &mut O, now: Instant) -> Deadline {
        let mut next = Deadline::NONE;
        for Srdo { setup, role } in &mut self.srdos {
            let deadline = match (role, self.checked) {
                (Role::Produce(producer), Some(checked)) => {
                    Deadline::at(producer.poll(setup, objects, checked, now))
                }
                (Role::Consume(consumer), _) => consumer.poll(setup, now),
                (Role::Produce(_) | Role::Off, _) => Deadline::NONE,
            };
            next.add(deadline);
        }
        next
    }

    /// The frame of the lowest identifier that waits: the plain one first, then its twin.
    pub fn transmit(&mut self, now: Instant) -> Option<Frame> {
        Some(self.hand_out(now)?.0)
    }

    /// As [`Safety::transmit`], and from when on the frame may not go out any more.
    pub(crate) fn hand_out(&mut self, now: Instant) -> Option<(Frame, Instant)> {
        let id = self.next_cob_id(now)?;
        let srdo = self.srdos.iter_mut().find(|s| s.ready(now) == Some(id))?;
        match &mut srdo.role {
            Role::Produce(producer) => {
                let frame = producer.take(&srdo.setup, now)?;
                Some((frame, producer.stale))
            }
            Role::Consume(_) | Role::Off => None,
        }
    }

    /// The identifier of what [`Safety::transmit`] would give.
    pub fn next_cob_id(&self, now: Instant) -> Option<u16> {
        self.srdos.iter().filter_map(|srdo| srdo.ready(now)).min()
    }

    /// From when on a frame of this identifier may not go out any more; `None` when no producer
    /// sends it.
    pub fn expires(&self, cob_id: u16) -> Option<Instant> {
        let sends = |srdo: &&Srdo| srdo.setup.cob_ids.contains(&cob_id.into());
        let producer = self.srdos.iter().find(sends)?.producer()?;
        Some(producer.stale)
    }

    /// Takes a frame; `None` when it is none of CANopen Safety, or the node is not OPERATIONAL.
    pub fn receive<O: Objects>(
        &mut self,
        objects: &mut O,
        frame: &Frame,
        now: Instant,
    ) -> Option<SafetyReceived> {
        let id = frame.cob_id().filter(|_| self.running)?;
        if frame.is_remote() {
            return None;
        }
        if id == GFC_ID && frame.length() == 0 && self.gfc == 1 {
            return Some(SafetyReceived::FailSafe);
        }
        for (n, Srdo { setup, role }) in (0..).zip(&mut self.srdos) {
            let [plain, inverted] = setup.cob_ids.map(|cob_id| cob_id as u16);
            if let Role::Consume(consumer) = role
                && (id == plain || id == inverted)
            {
                let lost = consumer.receive(setup, objects, frame, id == plain, now);
                return Some(if lost {
                    SafetyReceived::Lost(n)
                } else {
                    SafetyReceived::Taken
                });
            }
        }
        None
    }

    /// An SRDO that was lost by time, counted from 0 and told once.
    pub fn take_lost(&mut self) -> Option<u8> {
        let mut srdos = (0..).zip(&mut self.srdos);
        srdos.find_map(|(n, srdo)| match &mut srdo.role {
            Role::Consume(consumer) => consumer.take_lost().then_some(n),
            Role::Produce(_) | Role::Off => None,
        })
    }

    /// What is known of SRDO `srdo`, from 0.
    pub fn state(&self, srdo: usize) -> SrdoState {
        match self.srdos.get(srdo).map(|s| &s.role) {
            Some(Role::Produce(_)) if self.checked.is_none() => SrdoState::Withheld,
            Some(Role::Produce(producer)) if producer.consistent => SrdoState::Running,
            Some(Role::Produce(_)) => SrdoState::Inconsistent,
            Some(Role::Consume(consumer)) => consumer.state,
            Some(Role::Off) | None => SrdoState::Off,
        }
    }
}

impl Default for Safety {
    fn default() -> Self {
        Self::new()
    }
}
