//! PDOs: four that the device receives, four or more that it transmits (CiA 301, 7.2.2).
//!
//! In: frames, SYNC, the application's word that data have changed, and time; the objects are
//! read and written through [`Objects`]. Out: frames, the lowest identifier first, and what became
//! of a frame that was received. Configuration comes by SDO or from memory; no way of writing it
//! leaves a PDO at work with a mapping that does not hold.
//!
//! How many it transmits is a type of the device's choice ([`Tpdos`]), so that a device of four has
//! no room for more in its memory.
//!
//! Left out: multiplexed PDOs, and transmission types 252 and 253.

mod rpdo;
mod setup;
mod tpdo;

#[cfg(test)]
mod configuration_tests;
#[cfg(test)]
mod tests;

use crate::frame::Frame;
use crate::object::{Abort, Access, Address, Dictionary, Number, Objects, Value};
use crate::time::Deadline;
use instant::Instant;
use rpdo::Rpdo;
use setup::{Part, Setup};
pub use tpdo::{Tpdo, Tpdos};

/// PDOs that a device receives, and that it transmits where it does not choose ([`Tpdos`]).
pub const PDOS: usize = 4;

/// What became of a frame that is for a PDO; RPDOs are counted from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received {
    /// Written to the objects.
    Taken(u8),
    /// Kept for the next SYNC.
    Waiting,
    /// Too short, not used: EMCY 8210h.
    TooShort(u8),
    /// Longer than what is mapped, used (or kept for SYNC) as far as it is: EMCY 8220h.
    TooLong(u8),
    /// A value is out of its range, or the application does not take it now.
    Refused(u8),
    /// A remote frame has asked for a TPDO; the answer waits for the bus.
    Requested,
}

/// All PDOs of a node: configuration and state.
#[derive(Clone, Debug)]
pub struct Pdos<T = [Tpdo; PDOS]> {
    /// Length of the synchronous window in µs (1007h); 0 is none.
    pub window_us: u32,
    tx: T,
    rx: [Rpdo; PDOS],
    /// The node is OPERATIONAL.
    running: bool,
    /// A TPDO that is due has not been sampled.
    again: bool,
    overruns: u16,
}

/// Where a PDO's parameter is kept.
enum Place {
    Receive(usize, Part),
    Transmit(usize, Part),
}

/// `None` when the address is not that of a PDO here.
fn place<T: Tpdos>(at: Address) -> Option<Place> {
    let n = usize::from(at.index & 0x1FF);
    // As constants the larger of the two is one number.
    if n >= PDOS && n >= T::COUNT {
        return None;
    }
    // Indices lie 200h apart: small numbers are looked at.
    Some(match at.index >> 9 {
        0xA => Place::Receive(n, Part::Communication(Access::RPDO)),
        0xB => Place::Receive(n, Part::Mapping(Access::RPDO)),
        0xC => Place::Transmit(n, Part::Communication(Access::TPDO)),
        0xD => Place::Transmit(n, Part::Mapping(Access::TPDO)),
        _ => return None,
    })
}

impl<T: Tpdos> Pdos<T> {
    /// As [`Pdos::new`]. All its bytes are 0, and as a constant it is cleared in its place; made
    /// field by field it would stand on the stack and be copied.
    pub(crate) const NONE: Self = Self {
        window_us: 0,
        tx: T::NONE,
        rx: [const { Rpdo::new() }; PDOS],
        running: false,
        again: false,
        overruns: 0,
    };

    /// No PDO exists; defaults come in through [`Pdos::load`].
    // Within a whole node it would be cleared by a second and third form of the library's memclr.
    #[inline(never)]
    pub const fn new() -> Self {
        Self::NONE
    }

    fn setup(&mut self, at: Address) -> Option<(&mut Setup, Part)> {
        match place::<T>(at)? {
            Place::Receive(n, part) => Some((&mut self.rx.get_mut(n)?.setup, part)),
            Place::Transmit(n, part) => Some((&mut self.tx.as_mut().get_mut(n)?.setup, part)),
        }
    }

    /// The value of a PDO's parameter, from 1400h, 1600h, 1800h or 1A00h on; `None` for any other
    /// index.
    pub fn read(&mut self, at: Address) -> Option<Result<Number, Abort>> {
        let (setup, part) = self.setup(at)?;
        Some(setup.read(part, at.sub))
    }

    /// Takes a value by SDO, under all the rules; `None` for an index that is not a PDO's.
    ///
    /// The PDO begins anew with its new parameters. Errors: the abort code of the rule that is
    /// broken; nothing has changed then.
    pub fn write<O: Objects>(
        &mut self,
        dictionary: &Dictionary,
        at: Address,
        value: Value,
    ) -> Option<Result<(), Abort>> {
        let (setup, part) = self.setup(at)?;
        let result = setup.write::<O>(dictionary, part, at.sub, value);
        if result.is_ok() {
            match place::<T>(at)? {
                Place::Receive(n, _) => self.rx.get_mut(n)?.restart(),
                Place::Transmit(n, _) => self.tx.as_mut().get_mut(n)?.restart(),
            }
        }
        Some(result)
    }

    /// Puts a default or stored value in place, in any order; false when it is not a PDO's.
    pub fn load(&mut self, at: Address, value: Value) -> bool {
        let found = self.setup(at);
        found.is_some_and(|(setup, part)| setup.load(part, at.sub, value))
    }

    /// After [`Pdos::load`]: switches off every PDO whose parameters do not hold.
    ///
    /// Errors: what is wrong with the first one of them.
    pub fn check(&mut self, dictionary: &Dictionary) -> Result<(), Abort> {
        let mut result = Ok(());
        for pdo in &mut self.rx {
            result = result.and(pdo.setup.check(dictionary, Access::RPDO));
        }
        for pdo in self.tx.as_mut() {
            result = result.and(pdo.setup.check(dictionary, Access::TPDO));
        }
        result
    }

    fn restart(&mut self, running: bool) {
        self.running = running;
        self.tx.as_mut().iter_mut().for_each(Tpdo::restart);
        self.rx.iter_mut().for_each(Rpdo::restart);
    }

    /// The node enters OPERATIONAL: timers run, event-driven TPDOs are due once, and nothing of
    /// before counts. Their first samples are taken by the next [`Pdos::poll`].
    pub fn start(&mut self, _now: Instant) {
        self.restart(true);
    }

    /// The node leaves OPERATIONAL: what waits is dropped.
    pub fn stop(&mut self) {
        self.restart(false);
    }

    fn count(&mut self, lost: usize) {
        let lost = u16::try_from(lost).unwrap_or(u16::MAX);
        self.overruns = self.overruns.saturating_add(lost);
    }

    /// SYNC: applies the RPDOs that were received before, then samples the TPDOs whose turn it is.
    ///
    /// Returns the RPDOs that were applied, bit n for RPDO n. Ignored outside OPERATIONAL.
    pub fn sync<O: Objects>(&mut self, objects: &mut O, counter: Option<u8>, now: Instant) -> u8 {
        if !self.running {
            return 0;
        }
        let mut applied = 0;
        for (n, pdo) in self.rx.iter_mut().enumerate() {
            applied |= u8::from(pdo.sync(objects)) << n;
        }
        let mut lost = 0;
        for pdo in self.tx.as_mut() {
            lost += usize::from(pdo.sync(objects, counter, self.window_us, now));
        }
        self.count(lost);
        applied
    }

    /// Takes a frame; `None` when it is for no PDO here, or the node is not OPERATIONAL.
    pub fn receive<O: Objects>(
        &mut self,
        objects: &mut O,
        frame: &Frame,
        now: Instant,
    ) -> Option<Received> {
        let id = frame.cob_id().filter(|_| self.running)?;
        let is_named = |setup: &Setup| setup.id() == id && setup.is_active();
        if frame.is_remote() {
            if !O::SERVICES.pdo_remote {
                return None;
            }
            let named = |pdo: &&mut Tpdo| is_named(&pdo.setup) && pdo.setup.answers_remote();
            let lost = self
                .tx
                .as_mut()
                .iter_mut()
                .find(named)?
                .request(objects, now);
            self.count(usize::from(lost));
            return Some(Received::Requested);
        }
        let mut rx = (0..).zip(&mut self.rx);
        let (n, pdo) = rx.find(|(_, pdo)| is_named(&pdo.setup))?;
        Some(pdo.receive(objects, n, frame, now))
    }

    /// Serves event timers, the end of the synchronous window and the deadlines of RPDOs; when to
    /// call again, or when a frame that is held back may go.
    pub fn poll<O: Objects>(&mut self, objects: &mut O, now: Instant) -> Deadline {
        let mut next = Deadline::NONE;
        if !self.running {
            return next;
        }
        let mut lost = 0;
        self.again = false;
        for pdo in self.tx.as_mut() {
            lost += usize::from(pdo.poll(objects, &mut self.again, now));
            pdo.deadlines(now, &mut next);
        }
        if O::SERVICES.pdo_timers {
            for pdo in &mut self.rx {
                next.add(pdo.poll(now));
            }
        }
        self.count(lost);
        next
    }

    /// True when the last [`Pdos::poll`] has left something to be tried again at the next.
    pub(crate) const fn tries_again(&self) -> bool {
        self.again
    }

    /// The application's data have changed. TPDOs of types 254 and 255 that carry any of it are
    /// due, held back by their inhibit times; those of type 0 go with the next SYNC.
    pub fn event<O: Objects>(&mut self, objects: &mut O, now: Instant) {
        if !self.running {
            return;
        }
        let mut lost = 0;
        for pdo in self.tx.as_mut() {
            lost += usize::from(pdo.event(objects, now));
        }
        self.count(lost);
    }

    /// The frame of the lowest identifier that may go out now.
    pub fn transmit(&mut self, now: Instant) -> Option<Frame> {
        Some(self.hand_out(self.next_cob_id(now)?, now)?.0)
    }

    /// The frame of this identifier, which [`Pdos::next_cob_id`] has named at the same instant, and
    /// from when on it may not go out any more.
    pub fn hand_out(&mut self, cob_id: u16, now: Instant) -> Option<(Frame, Instant)> {
        let mut tx = self.tx.as_mut().iter_mut();
        let pdo = tx.find(|pdo| pdo.setup.id() == cob_id && pdo.is_ready(now))?;
        let frame = pdo.take(now)?;
        Some((frame, pdo.stale))
    }

    /// The identifier of what [`Pdos::transmit`] would give.
    pub fn next_cob_id(&self, now: Instant) -> Option<u16> {
        let ready = self.tx.as_ref().iter().filter(|pdo| pdo.is_ready(now));
        ready.map(|pdo| pdo.setup.id()).min()
    }

    /// From when on a frame of this identifier may not go out any more; `None` when no TPDO has it.
    pub fn expires(&self, cob_id: u16) -> Option<Instant> {
        let pdo = self
            .tx
            .as_ref()
            .iter()
            .find(|pdo| pdo.setup.id() == cob_id && pdo.setup.is_active())?;
        Some(pdo.stale)
    }

    /// A frame of this identifier has ended on the bus at `now`; true when a sample has waited for
    /// that.
    pub fn sent(&mut self, cob_id: u16, now: Instant) -> bool {
        let mut waits = false;
        // None of several TPDOs of one identifier may wait for ever.
        for pdo in self
            .tx
            .as_mut()
            .iter_mut()
            .filter(|pdo| pdo.setup.id() == cob_id)
        {
            waits |= pdo.sent(now);
        }
        waits
    }

    /// The controller has given back a frame of this identifier, which has not gone out: its sample
    /// counts as lost.
    pub fn withdrawn(&mut self, cob_id: u16) {
        let mut tx = self.tx.as_mut().iter_mut();
        if let Some(pdo) = tx.find(|pdo| pdo.setup.id() == cob_id) {
            pdo.withdrawn();
            self.count(1);
        }
    }

    /// The controller has gone bus-off and has lost what it had: what is sent on events is owed
    /// still, as it is then.
    pub fn bus_off(&mut self) {
        self.tx.as_mut().iter_mut().for_each(Tpdo::withdrawn);
    }

    /// An RPDO whose event timer has run out, counted from 0 and told once: EMCY 8250h.
    pub fn take_missed(&mut self) -> Option<u8> {
        let mut rx = (0..).zip(&mut self.rx);
        rx.find_map(|(n, pdo)| pdo.take_missed().then_some(n))
    }

    /// Samples that gave way to newer ones, or missed the synchronous window, before the bus took
    /// them. Stops at 65 535.
    pub const fn overruns(&self) -> u16 {
        self.overruns
    }
}

impl<T: Tpdos> Default for Pdos<T> {
    fn default() -> Self {
        Self::new()
    }
}
