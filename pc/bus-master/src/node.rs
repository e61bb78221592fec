//! Objects of a node, read and written with silence looked into.
//!
//! In: a bus, a node, objects. Out: what they hold, shown with the node's own resolution, which is
//! asked for once. A guard brings a node out of OPERATIONAL and back where the user allows it. One
//! that sends no heartbeat is OPERATIONAL where it sends PDOs; otherwise its state is not known,
//! and it stays in PRE-OPERATIONAL. Who comes back to a silent node has its transfers as they end,
//! without the look into the silence.
//!
//! Left out: which nodes and which objects.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::io;
use std::time::Duration;

use super::fault::Fault;
use crate::diagnosis::Silence;
use crate::nmt::{self, Command, State, Told};
use crate::sdo::{Client, SdoError};
use crate::{Bus, BusEnd};
use codes::name::Named;
use codes::value::{self, Shown};

/// How long a heartbeat is waited for: five of those that are delivered.
const HEARTBEAT: Duration = Duration::from_secs(1);

/// How often a question is asked of a node that answers others.
const ROUNDS: usize = 3;

/// The communication parameters of TPDOs, as many as a Plumb has at most.
const TPDOS: std::ops::Range<u16> = 0x1800..0x1808;

/// Bits 31 and 29 of a COB-ID: the PDO is off, or has an identifier of 29 bit.
const NOT_HEARD: u32 = 1 << 31 | 1 << 29;

/// How long a node has to be in the state that it was told.
const CHANGE: Duration = Duration::from_secs(2);

/// The node asked.
#[derive(Debug)]
pub struct Node<'a> {
    /// The bus.
    pub bus: &'a mut Bus,
    /// Its id.
    pub id: u8,
    /// It was taken to PRE-OPERATIONAL and stays there, since its state before is not known.
    pub is_left: bool,
    patient: bool,
    resolutions: BTreeMap<u16, Option<u32>>,
}

impl<'a> Node<'a> {
    /// Asks this node.
    pub const fn new(bus: &'a mut Bus, id: u8) -> Self {
        Self {
            bus,
            id,
            is_left: false,
            patient: false,
            resolutions: BTreeMap::new(),
        }
    }

    /// Asks a node that may be at work for seconds.
    pub const fn patient(bus: &'a mut Bus, id: u8) -> Self {
        let mut node = Self::new(bus, id);
        node.patient = true;
        node
    }

    /// A transfer with it; its silence is not looked into.
    pub fn client(&mut self) -> Client<'_> {
        match self.patient {
            true => Client::patient(self.bus, self.id),
            false => Client::new(self.bus, self.id),
        }
    }

    /// What an object holds, or the abort code with which the node refuses it.
    ///
    /// Errors: see [`Fault`].
    pub fn try_read(&mut self, index: u16, sub: u8) -> Result<Result<Vec<u8>, u32>, Fault> {
        match self.asked(|client| client.upload(index, sub))? {
            Err(SdoError::Refused(.., code)) => Ok(Err(code)),
            read => read.map(Ok).map_err(Fault::Sdo),
        }
    }

    /// Asks, and again where the node is there all the same: where frames get lost, three
    /// questions in vain are no rarity. What is left is no silence.
    fn asked<T>(
        &mut self,
        ask: impl Fn(&mut Client) -> Result<T, SdoError>,
    ) -> Result<Result<T, SdoError>, Fault> {
        for left in (0..ROUNDS).rev() {
            match ask(&mut self.client()) {
                Ok(read) => return Ok(Ok(read)),
                Err(SdoError::Step(..)) if left > 0 => {}
                Err(error @ (SdoError::Refused(..) | SdoError::Length(..))) => {
                    return Ok(Err(error));
                }
                Err(error) => match Fault::sdo(self.bus, self.id, error) {
                    Fault::Silent(Silence::AnswersNow(_)) if left > 0 => {}
                    fault => return Err(fault),
                },
            }
        }
        Err(Fault::Silent(Silence::AnswersNow(self.id)))
    }

    /// The number that an object holds; `None` where the node refuses it.
    ///
    /// Errors: see [`Fault`].
    pub fn number(&mut self, index: u16, sub: u8) -> Result<Option<u32>, Fault> {
        Ok(self.asked(|client| client.read_u32(index, sub))?.ok())
    }

    /// The same, asked for once: `None` also where nobody answers, as a node in STOPPED.
    ///
    /// Errors: the bus is lost, or the user has ended it.
    pub fn number_once(&mut self, index: u16, sub: u8) -> Result<Option<u32>, Fault> {
        match self.client().read_u32(index, sub) {
            Ok(number) => Ok(Some(number)),
            Err(SdoError::Bus(end)) => Err(end.into()),
            Err(_) => Ok(None),
        }
    }

    /// The node-id of the other channel (2001h); `None` where the node has no such object.
    ///
    /// Errors: see [`Fault`].
    pub fn peer(&mut self) -> Result<Option<u8>, Fault> {
        let peer = self.number(0x2001, 0)?;
        Ok(peer.and_then(|peer| u8::try_from(peer).ok()))
    }

    /// Writes an object, once.
    ///
    /// Errors: see [`Fault`].
    pub fn write(&mut self, index: u16, sub: u8, bytes: &[u8]) -> Result<(), Fault> {
        let written = self.client().download(index, sub, bytes);
        written.map_err(|error| Fault::sdo(self.bus, self.id, error))
    }

    /// What the object holds that a row's unit depends on.
    ///
    /// Errors: see [`Fault`].
    pub fn resolution(&mut self, named: &Named) -> Result<Option<u32>, Fault> {
        let Some(index) = named.row.and_then(value::depends_on) else {
            return Ok(None);
        };
        if let Some(known) = self.resolutions.get(&index) {
            return Ok(*known);
        }
        let number = self.number(index, 0)?;
        self.resolutions.insert(index, number);
        Ok(number)
    }

    /// What an object holds, to be shown; the bytes as well. A refusal is its abort code.
    ///
    /// Errors: see [`Fault`].
    pub fn shown(&mut self, named: &Named) -> Result<Result<(Vec<u8>, Shown), u32>, Fault> {
        let resolution = self.resolution(named)?;
        let read = self.try_read(named.index, named.sub)?;
        Ok(read.map(|bytes| {
            let shown = value::show(named, &bytes, resolution);
            (bytes, shown)
        }))
    }

    /// The state that the next heartbeat tells; `None` for a node that sends none.
    ///
    /// Errors: see [`Fault`].
    pub fn state(&mut self) -> Result<Option<Told>, Fault> {
        self.heartbeat(HEARTBEAT).map_err(Fault::bus)
    }

    /// The state that the next heartbeat within `patience` tells; `None` when none comes.
    ///
    /// Errors: the bus is lost, or the user has ended it.
    pub fn heartbeat(&mut self, patience: Duration) -> io::Result<Option<Told>> {
        nmt::state(self.bus, self.id, patience)
    }

    /// The state by its next heartbeat; one that sends none is OPERATIONAL where it sends PDOs,
    /// which no node does in another state. `None` where neither tells.
    ///
    /// Errors: see [`Fault`].
    pub fn state_or_work(&mut self) -> Result<Option<Told>, Fault> {
        let heard = nmt::state_or_pdos(self.bus, self.id, HEARTBEAT).map_err(Fault::bus)?;
        let pdos = match heard {
            Ok(state) => return Ok(Some(state)),
            Err(pdos) => pdos,
        };
        if pdos.is_empty() {
            return Ok(None);
        }
        for index in TPDOS {
            // The first one that it does not have is the last one to ask for.
            let Some(cob_id) = self.number_once(index, 1)? else {
                break;
            };
            if cob_id & NOT_HEARD == 0 && pdos.contains(&((cob_id & 0x7FF) as u16)) {
                return Ok(Some(Ok(State::Operational)));
            }
        }
        Ok(None)
    }

    /// Sends an NMT command to it.
    ///
    /// Errors: see [`Fault`].
    pub fn command(&mut self, command: Command) -> Result<(), Fault> {
        nmt::command(self.bus, command, self.id).map_err(Fault::bus)
    }

    /// Takes a node that sends a heartbeat to PRE-OPERATIONAL, and waits until it is there.
    ///
    /// Errors: see [`Fault`].
    pub fn enter_heard(&mut self) -> Result<(), Fault> {
        self.command(Command::EnterPreOperational)?;
        let there = nmt::wait_for(self.bus, self.id, State::PreOperational, CHANGE);
        there.map(drop).map_err(Fault::bus)
    }

    /// Does something in PRE-OPERATIONAL and returns to the state in which the node was,
    /// OPERATIONAL or STOPPED, also when it failed. In STOPPED no node answers SDO: where it may
    /// not be brought out of it, the work reports this. Where the state is not known, the node
    /// stays in PRE-OPERATIONAL ([`Node::is_left`]).
    ///
    /// Errors: `Err(None)` when the node is OPERATIONAL and may not be stopped, those of `work`,
    /// [`Fault::Left`] and [`Fault::Unknown`].
    pub fn set_up<T, E: From<Fault> + Display>(
        &mut self,
        may_stop: bool,
        work: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, Option<E>> {
        let fault = |fault| Some(E::from(fault));
        let state = self.state_or_work().map_err(fault)?;
        let done = match state {
            Some(Ok(State::Operational)) if !may_stop => return Err(None),
            Some(Ok(State::Operational)) => self.apart(Command::Start, work),
            Some(Ok(State::Stopped)) if may_stop => self.apart(Command::Stop, work),
            None if may_stop => self.left(work),
            None => {
                // It sends no heartbeat, or is not there: then nothing is written.
                self.number(0x1000, 0).map_err(fault)?;
                work(self)
            }
            _ => work(self),
        };
        done.map_err(Some)
    }

    /// The same of a node that may be stopped.
    ///
    /// Errors: those of `work`, [`Fault::Left`] and [`Fault::Unknown`].
    pub fn set_up_stopped<T, E: From<Fault> + Display>(
        &mut self,
        work: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        let interrupted = || Fault::from(BusEnd::Interrupted).into();
        let done = self.set_up(true, work);
        done.map_err(|error| error.unwrap_or_else(interrupted))
    }

    /// Does something in PRE-OPERATIONAL, where the node stays: nothing has told its state.
    fn left<T, E: From<Fault> + Display>(
        &mut self,
        work: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        self.enter_unheard()?;
        self.is_left = true;
        work(self).map_err(|error| Fault::Unknown(error.to_string(), self.id).into())
    }

    /// Takes a node to PRE-OPERATIONAL that sends no heartbeat. It is there where it answers
    /// behind the command, which comes first on the bus.
    ///
    /// Errors: see [`Fault`]; a node that is heard in no way was sent the command all the same,
    /// since it may be in STOPPED.
    pub fn enter_unheard(&mut self) -> Result<(), Fault> {
        use Silence::{BusSilent, NoNodes, OnlySends, Others};
        match self.number(0x1000, 0) {
            Ok(_) => {}
            Err(Fault::Silent(
                BusSilent { .. } | NoNodes { .. } | OnlySends(_) | Others { .. },
            )) => {}
            Err(fault) => return Err(fault),
        }
        self.command(Command::EnterPreOperational)?;
        self.number(0x1000, 0).map(drop)
    }

    /// Does something in PRE-OPERATIONAL; `back` returns to the state in which the node was.
    fn apart<T, E: From<Fault> + Display>(
        &mut self,
        back: Command,
        work: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        self.command(Command::EnterPreOperational)?;
        let done = match nmt::wait_for(self.bus, self.id, State::PreOperational, CHANGE) {
            Ok(_) => work(self),
            Err(error) => Err(Fault::bus(error).into()),
        };
        let Err(lost) = self.command(back) else {
            return done;
        };
        // What went wrong before explains more than what goes wrong now.
        let why = done
            .err()
            .map_or(lost.to_string(), |error| error.to_string());
        Err(Fault::Left(why, self.id, back).into())
    }
}
