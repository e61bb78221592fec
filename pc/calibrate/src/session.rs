//! The nodes under calibration: found, held in PRE-OPERATIONAL, read, written, and left as found.
//!
//! In: node-ids on a bus. Out: means of what their sensors feel and what they read, at a
//! standstill; their calibrations. Time is told by the nodes' own samples, so a virtual bus may run
//! at any speed.
//!
//! A node that restarts or is commanded by somebody else meanwhile is noticed: by its boot-up
//! message, by its heartbeat, and by its counter of samples.
//!
//! Left out: what the readings are for.

use std::time::{Duration, Instant};

use canopen::object::Abort;
use device::calibration::encoding::{decode_into, identity, length, read_at};
use device::calibration::motor;
use device::objects::table::Channel;
use tilt::angle::Axes;
use tilt::chain::{Calibration, Correction};
use tilt::table::Rule;

use super::error::CalibrateError;
use super::presented::{self, Presented};
use super::reading::{Reading, Upset, mean_near, wrap};
use super::turned::Log;
use bus_master::diagnosis;
use bus_master::nmt::{self, Command, State, Told};
use bus_master::sdo::{Client, SdoError};
use bus_master::{Bus, BusEnd, Received};
use bus_master::{node, nodes};

/// How long a heartbeat is waited for, beyond one and a half of its periods.
const HEARTBEAT: Duration = Duration::from_millis(1000);

/// How long samples may stay away.
const PATIENCE: Duration = Duration::from_secs(10);

/// The shortest and the longest pause between two looks at the counters of samples.
const LOOK: (Duration, Duration) = (Duration::from_millis(2), Duration::from_millis(200));

/// Samples behind a new calibration after which a node does not begin to count anew: in the paper's
/// mode they take 0.2 s, else 0.03 s.
const GOES_ON: u32 = 12;

/// Angle of one step of 2010h, deg.
const ANGLE_STEP: f64 = 360.0 / 16_777_216.0;

/// Qualities of 2010h from here on are angles, those below reasons.
const QUALITY: u32 = 32;

/// A calibration from its bytes.
pub fn decode(bytes: &[u8]) -> Option<Calibration> {
    let mut calibration = Calibration::NOMINAL;
    let decoded = decode_into(&mut calibration, &mut |offset, into| {
        let rest = bytes.get(offset as usize..).unwrap_or(&[]);
        let count = rest.len().min(into.len());
        into[..count].copy_from_slice(&rest[..count]);
        count
    });
    decoded.ok().map(|()| calibration)
}

/// The kind of a node that makes tables: 2062h sub 2.
const TABLES: u8 = 0;

/// What stands in for the calibration of a node of this kind (2062h sub 2) that makes tables and
/// has not made any: its 2061h has no point, which nothing takes for a calibration.
fn without_tables(kind: u8, calibrated: bool) -> Option<Calibration> {
    let correction = Correction::Tables {
        tables: Axes::default(),
        rule: Rule::Linear,
    };
    (kind == TABLES && !calibrated).then_some(Calibration {
        correction,
        ..Calibration::NOMINAL
    })
}

/// The bytes of a calibration, as 2061h has them.
pub fn encode(calibration: &Calibration) -> Vec<u8> {
    let mut bytes = vec![0; length(calibration) as usize];
    read_at(calibration, 0, &mut bytes);
    bytes
}

/// One node.
#[derive(Clone, Debug)]
pub struct Node {
    /// Its node-id.
    pub id: u8,
    /// Which channel it is.
    pub channel: Channel,
    /// 1018h sub 4.
    pub serial: u32,
    /// 1018h sub 2.
    pub product: u32,
    /// 100Ah.
    pub software: String,
    /// 2062h sub 2: 0 tables, 1 two slopes, 2 one angle of 360 deg.
    pub kind: u8,
    /// Whether it had a calibration of its own (bit 6 of 2020h).
    pub calibrated: bool,
    /// NMT state in which it was found; `None` when it told none.
    pub state: Option<Told>,
    /// 2061h as it was found.
    pub bytes: Vec<u8>,
    /// The same, understood.
    pub calibration: Calibration,
    /// 2063h as it was found: the hash of the report that belongs to it.
    pub hash: Option<Vec<u8>>,
    /// Slopes that do not read as measured.
    pub presented: Vec<Presented>,
    /// Time between two heartbeats (1017h); none where it sends none.
    pub heartbeat: Option<Duration>,
    /// Time between two samples, s.
    pub period_s: f64,
    /// Whether something was written to it.
    pub changed: bool,
    /// What has happened to it that was none of this session's doing.
    pub upset: Option<Upset>,
    /// Its counter of samples when it was last read.
    pub counted: Option<u32>,
}

impl Node {
    /// A or B.
    pub const fn letter(&self) -> &'static str {
        match self.channel {
            Channel::A => "A",
            Channel::B => "B",
        }
    }

    /// It makes tables and has not made any: there is nothing that it could be given back.
    pub const fn is_blank(&self) -> bool {
        self.kind == TABLES && !self.calibrated
    }

    /// 2062h sub 1 of the calibration that was found.
    pub fn found_sum(&self) -> u32 {
        identity(&self.calibration)
    }
}

/// The nodes on their bus.
#[derive(Debug)]
pub struct Session {
    bus: Bus,
    /// The nodes, channel A first.
    pub nodes: Vec<Node>,
    /// What the gyroscope of each node measures, as long as it is followed; empty where it is not.
    followed: Vec<Log>,
}

impl Session {
    /// Finds the nodes and takes them to PRE-OPERATIONAL.
    ///
    /// Errors: a node that does not answer, is no Plumb, or holds what can't be understood. The
    /// nodes are then in the state in which they were found.
    pub fn open(bus: Bus, ids: &[u8]) -> Result<Self, CalibrateError> {
        let mut session = Self::look(bus, ids)?;
        session.one_instrument()?;
        for place in 0..session.nodes.len() {
            session.nodes[place].state = session.state(place)?;
        }
        for place in 0..session.nodes.len() {
            if let Err(error) = session.enter(place) {
                session.leave();
                return Err(error);
            }
        }
        Ok(session)
    }

    /// Finds the nodes and leaves them as they are.
    ///
    /// Errors: as [`Session::open`].
    pub fn look(bus: Bus, ids: &[u8]) -> Result<Self, CalibrateError> {
        let mut session = Self {
            bus,
            nodes: Vec::new(),
            followed: Vec::new(),
        };
        for id in ids {
            let met = session.meet(*id);
            let node = met.map_err(|error| session.reason(*id, error))?;
            session.nodes.push(node);
        }
        session.nodes.sort_by_key(|node| node.channel as u8);
        Ok(session)
    }

    /// What an error of a node means; silence is looked into.
    fn reason(&mut self, id: u8, error: CalibrateError) -> CalibrateError {
        if !error.is_silence() {
            return error;
        }
        match diagnosis::silence(&mut self.bus, Some(id)) {
            Ok(why) => CalibrateError::Silent(why),
            Err(lost) => BusEnd::from(lost).into(),
        }
    }

    /// Two nodes are the two channels of one instrument, by what they are and by whom they name.
    ///
    /// Errors: [`CalibrateError::SameChannel`], [`CalibrateError::NotOnePair`].
    pub fn one_instrument(&mut self) -> Result<(), CalibrateError> {
        let [a, b] = &self.nodes[..] else {
            return Ok(());
        };
        let (one, other) = (a.id, b.id);
        if a.channel == b.channel {
            return Err(CalibrateError::SameChannel([one, other], a.letter()));
        }
        for (id, peer) in [(one, other), (other, one)] {
            let named = self.client(id).read_u32(0x2001, 0)?;
            if named != u32::from(peer) {
                return Err(CalibrateError::NotOnePair([id, peer], named));
            }
        }
        Ok(())
    }

    /// How the bus is named.
    pub fn bus_name(&self) -> &str {
        self.bus.name()
    }

    fn client(&mut self, id: u8) -> Client<'_> {
        Client::new(&mut self.bus, id)
    }

    fn meet(&mut self, id: u8) -> Result<Node, CalibrateError> {
        let product = self.client(id).read_u32(0x1018, 2)?;
        let channel = nodes::channel_of(product).ok_or(CalibrateError::Stranger(id))?;
        let serial = self.client(id).read_u32(0x1018, 4)?;
        let software = self.client(id).upload(0x100A, 0)?;
        let kind = self.client(id).read_u32(0x2062, 2)? as u8;
        let calibrated = self.client(id).read_u32(0x2020, 0)? & 0x40 != 0;
        let period = self.client(id).read_u32(0x2033, 0)?;
        let producer_ms = self.client(id).read_u32(0x1017, 0)?;
        let bytes = Client::patient(&mut self.bus, id).upload(0x2061, 0)?;
        let calibration = decode(&bytes).or_else(|| without_tables(kind, calibrated));
        let calibration = calibration.ok_or(CalibrateError::Undecodable(id))?;
        Ok(Node {
            id,
            channel,
            serial,
            product,
            software: String::from_utf8_lossy(&software).into_owned(),
            kind,
            calibrated,
            state: None,
            bytes,
            calibration,
            hash: hash_of(&mut self.bus, id)?,
            presented: presented::of(&mut node::Node::new(&mut self.bus, id))?,
            heartbeat: (producer_ms != 0).then(|| Duration::from_millis(producer_ms.into())),
            period_s: f64::from(period) / 256e6,
            changed: false,
            upset: None,
            counted: None,
        })
    }

    /// The state in which a node is found: by its heartbeat, and where it sends none by its PDOs.
    fn state(&mut self, place: usize) -> Result<Option<Told>, CalibrateError> {
        match self.heartbeat(place)? {
            Some(state) => Ok(Some(state)),
            None => {
                let id = self.nodes[place].id;
                Ok(node::Node::new(&mut self.bus, id).state_or_work()?)
            }
        }
    }

    /// The state that the node's next heartbeat tells; `None` where it sends none.
    fn heartbeat(&mut self, place: usize) -> Result<Option<Told>, CalibrateError> {
        let id = self.nodes[place].id;
        let Some(period) = self.nodes[place].heartbeat else {
            return Ok(None);
        };
        let until = Instant::now() + period * 3 / 2 + HEARTBEAT;
        while let Some(received) = self.hear(until)? {
            if let Some((from, state)) = nmt::heartbeat(&received)
                && from == id
            {
                return Ok(Some(state));
            }
        }
        Ok(None)
    }

    fn command(&mut self, command: Command, id: u8) -> Result<(), CalibrateError> {
        Ok(nmt::command(&mut self.bus, command, id).map_err(BusEnd::from)?)
    }

    fn enter(&mut self, place: usize) -> Result<(), CalibrateError> {
        let id = self.nodes[place].id;
        self.command(Command::EnterPreOperational, id)?;
        // Answered in PRE-OPERATIONAL and not in STOPPED.
        self.client(id).read_u32(0x1000, 0)?;
        (self.nodes[place].upset, self.nodes[place].counted) = (None, None);
        Ok(())
    }

    /// Takes every node back to the state in which it was found; the nodes that are left in
    /// PRE-OPERATIONAL, since nothing has told their state.
    pub fn leave(&mut self) -> Vec<u8> {
        let mut left = Vec::new();
        let states: Vec<_> = self
            .nodes
            .iter()
            .map(|node| (node.id, node.state))
            .collect();
        for (id, state) in states {
            let command = match state {
                Some(Ok(State::Operational)) => Command::Start,
                Some(Ok(State::Stopped)) => Command::Stop,
                Some(_) => continue,
                None => {
                    left.push(id);
                    continue;
                }
            };
            // The last thing that is done: a bus that is lost tells so elsewhere.
            let _ = self.command(command, id);
        }
        left
    }

    /// Waits for as long as that many seconds of each node's samples take.
    ///
    /// Errors: [`CalibrateError::NoSamples`], and [`CalibrateError::Upset`] when a node has
    /// restarted or was commanded meanwhile.
    pub fn settle(&mut self, seconds: f64) -> Result<(), CalibrateError> {
        let places = 0..self.nodes.len();
        let from = places.map(|place| self.samples(place));
        let from = from.collect::<Result<Vec<_>, _>>()?;
        for (place, from) in from.into_iter().enumerate() {
            let wanted = (seconds / self.nodes[place].period_s.max(1e-4)).ceil() as u32;
            self.await_samples(place, from, wanted)?;
        }
        self.undisturbed()
    }

    /// Samples that a node has taken since its reset (2032h).
    ///
    /// Errors: a node that does not answer, and [`CalibrateError::Upset`] when there are fewer than
    /// before.
    pub fn samples(&mut self, place: usize) -> Result<u32, CalibrateError> {
        let id = self.nodes[place].id;
        let now = self.client(id).read_u32(0x2032, 0)?;
        let before = self.nodes[place].counted.replace(now);
        if before.is_some_and(|before| now.wrapping_sub(before) > u32::MAX / 2) {
            self.nodes[place].upset = Some(Upset::Restarted);
            self.undisturbed()?;
        }
        Ok(now)
    }

    fn await_samples(
        &mut self,
        place: usize,
        from: u32,
        wanted: u32,
    ) -> Result<(), CalibrateError> {
        let begun = Instant::now();
        let (mut last, mut until) = (from, begun + PATIENCE);
        loop {
            let now = self.samples(place)?;
            if now.wrapping_sub(from) >= wanted {
                return Ok(());
            }
            if now != last {
                (last, until) = (now, Instant::now() + PATIENCE);
            }
            if Instant::now() > until {
                return Err(CalibrateError::NoSamples(self.nodes[place].id));
            }
            // A long wait needs no dense looks, and a fast virtual bus no long ones.
            self.rest((begun.elapsed() / 8).clamp(LOOK.0, LOOK.1))?;
        }
    }

    /// The next frame, with a look at what it reports of the nodes.
    fn hear(&mut self, until: Instant) -> Result<Option<Received>, CalibrateError> {
        let received = self.bus.receive(until).map_err(BusEnd::from)?;
        if let Some((from, state)) = received.as_ref().and_then(nmt::heartbeat) {
            for node in self.nodes.iter_mut().filter(|node| node.id == from) {
                node.upset = node.upset.or_else(|| upset(state));
            }
        }
        Ok(received)
    }

    /// Lets the bus pass by for so long; ends early, as an error, when the user has enough.
    pub fn rest(&mut self, pause: Duration) -> Result<(), CalibrateError> {
        let until = Instant::now() + pause;
        while !self.followed.is_empty() {
            self.follow()?;
            let next = until.min(Instant::now() + LOOK.0);
            while self.hear(next)?.is_some() {}
            if next == until {
                return Ok(());
            }
        }
        while self.hear(until)?.is_some() {}
        Ok(())
    }

    /// Follows the gyroscopes from now on, whatever else is done meanwhile; false where a node has
    /// none (2034h).
    ///
    /// Errors: a node that does not answer.
    pub fn begin_to_follow(&mut self) -> Result<bool, CalibrateError> {
        for place in 0..self.nodes.len() {
            match self.gaps(place) {
                Ok(_) => {}
                Err(CalibrateError::Sdo(why)) if why.is_refusal(Abort::NoSuchObject) => {
                    return Ok(false);
                }
                Err(error) => return Err(error),
            }
        }
        self.followed = self.nodes.iter().map(|_| Log::default()).collect();
        self.follow()?;
        Ok(true)
    }

    /// What the gyroscope of each node has measured; it is followed no longer.
    pub fn end_to_follow(&mut self) -> Vec<Log> {
        std::mem::take(&mut self.followed)
    }

    /// How many gyroscopes are followed: of each node one, or none.
    pub const fn followed(&self) -> usize {
        self.followed.len()
    }

    /// Where the log of each gyroscope is now.
    ///
    /// Errors: a node that does not answer.
    pub fn marks(&mut self) -> Result<Vec<usize>, CalibrateError> {
        self.follow()?;
        Ok(self.followed.iter().map(Log::mark).collect())
    }

    /// Samples that a node's gyroscope has missed since the start, and long gaps (2034h sub 6).
    ///
    /// Errors: a node that does not answer.
    pub fn gaps(&mut self, place: usize) -> Result<u16, CalibrateError> {
        let id = self.nodes[place].id;
        Ok(self.client(id).read_u32(0x2034, 6)? as u16)
    }

    /// One look at each gyroscope that is followed.
    fn follow(&mut self) -> Result<(), CalibrateError> {
        for place in 0..self.followed.len() {
            let id = self.nodes[place].id;
            let bytes = self.client(id).upload(0x2034, 5)?;
            if let (Ok(bytes), Some(log)) = (bytes.try_into(), self.followed.get_mut(place)) {
                log.take(bytes);
            }
        }
        Ok(())
    }

    /// Does something that takes its time beside the bus. `work` gets what it has to call again and
    /// again meanwhile: that hears the bus for `pause`, and is false when nobody waits any longer.
    ///
    /// Errors: a lost bus, and [`CalibrateError::Interrupted`].
    pub fn meanwhile<T>(
        &mut self,
        pause: Duration,
        work: impl FnOnce(&mut dyn FnMut() -> bool) -> T,
    ) -> Result<T, CalibrateError> {
        let mut ended = None;
        let done = work(&mut || match self.rest(pause) {
            Ok(()) => true,
            Err(error) => {
                ended = Some(error);
                false
            }
        });
        ended.map_or(Ok(done), Err)
    }

    fn undisturbed(&self) -> Result<(), CalibrateError> {
        let upset = |node: &Node| Some(CalibrateError::Upset(node.id, node.upset?));
        self.nodes.iter().find_map(upset).map_or(Ok(()), Err)
    }

    /// Waits for a heartbeat of each node that has one: nothing has happened to any of them up to
    /// now.
    ///
    /// Errors: [`CalibrateError::Upset`].
    pub fn confirm(&mut self) -> Result<(), CalibrateError> {
        for place in 0..self.nodes.len() {
            if self.nodes[place].state.is_some() {
                self.heartbeat(place)?;
            }
        }
        self.undisturbed()
    }

    /// Takes the nodes back to PRE-OPERATIONAL after something has happened to one of them, and
    /// waits `patience` for one that is silent.
    ///
    /// Errors: a node that stays silent; [`CalibrateError::Exchanged`] when one has come back with
    /// another serial number or calibration.
    pub fn recover(&mut self, patience: Duration) -> Result<(), CalibrateError> {
        let until = Instant::now() + patience;
        for place in 0..self.nodes.len() {
            while let Err(error) = self.enter(place) {
                if !error.is_silence() || Instant::now() > until {
                    return Err(error);
                }
                self.rest(LOOK.1)?;
            }
            let (id, serial) = (self.nodes[place].id, self.nodes[place].serial);
            let sum = self.nodes[place].found_sum();
            let same = self.client(id).read_u32(0x1018, 4)? == serial
                && self.client(id).read_u32(0x2062, 1)? == sum;
            if !same {
                return Err(CalibrateError::Exchanged(id));
            }
        }
        Ok(())
    }

    /// What each sensor reports of its temperature, degC, to a degree (6511h).
    ///
    /// Errors: a node that does not answer.
    pub fn temperatures_c(&mut self) -> Result<Vec<f64>, CalibrateError> {
        let ids: Vec<_> = self.nodes.iter().map(|node| node.id).collect();
        ids.into_iter().map(|id| self.temperature_c(id)).collect()
    }

    fn temperature_c(&mut self, id: u8) -> Result<f64, CalibrateError> {
        let told = self.client(id).read_u32(0x6511, 0)?;
        Ok(f64::from(told as u8 as i8))
    }

    /// Mean of `count` readings of every node, `apart_s` of its samples apart.
    ///
    /// Errors: a node that does not answer or takes no samples.
    pub fn read(&mut self, count: u32, apart_s: f64) -> Result<Vec<Reading>, CalibrateError> {
        let from = self.marks()?;
        let mut sums: Vec<Sum> = self.nodes.iter().map(|_| Sum::default()).collect();
        for _ in 0..count.max(1) {
            self.settle(apart_s)?;
            for (place, sum) in sums.iter_mut().enumerate() {
                let id = self.nodes[place].id;
                sum.add(self.read_once(id)?);
            }
        }
        let mut readings: Vec<Reading> = sums.into_iter().map(Sum::mean).collect();
        let logs = self.followed.iter().zip(from);
        for (reading, (log, from)) in readings.iter_mut().zip(logs) {
            reading.rate_rad_s = log.rest(from, log.mark()).ok();
        }
        Ok(readings)
    }

    fn read_once(&mut self, id: u8) -> Result<Single, CalibrateError> {
        self.follow()?;
        let mut client = self.client(id);
        let mut accel = [0.0; 3];
        for (sub, axis) in (1..).zip(&mut accel) {
            *axis = f64::from(client.read_u32(0x2031, sub)? as i32);
        }
        let mut angle_deg = [Err(0); 2];
        for (place, angle) in (0..2).zip(&mut angle_deg) {
            let quality = client.read_u32(0x2010, 3 + place)?;
            let raw = client.read_u32(0x2010, 1 + place)?;
            *angle = match quality {
                QUALITY.. => Ok(f64::from((raw << 8) as i32 >> 8) * ANGLE_STEP),
                reason => Err(reason as u8),
            };
        }
        Ok(Single {
            accel,
            temperature_c: self.temperature_c(id)?,
            angle_deg,
        })
    }

    /// Writes a calibration, reads it back and compares byte by byte.
    ///
    /// Errors: a refusal, and [`CalibrateError::Differs`].
    pub fn write(&mut self, place: usize, bytes: &[u8]) -> Result<(), CalibrateError> {
        let id = self.nodes[place].id;
        self.nodes[place].changed = true;
        let before = self.client(id).read_u32(0x2032, 0)?;
        Client::patient(&mut self.bus, id).download(0x2061, 0, bytes)?;
        self.await_new_count(place, before)?;
        if self.calibration(place)? != bytes {
            return Err(CalibrateError::Differs(id));
        }
        Ok(())
    }

    /// 2061h as it is now.
    ///
    /// Errors: a node that does not answer.
    pub fn calibration(&mut self, place: usize) -> Result<Vec<u8>, CalibrateError> {
        let id = self.nodes[place].id;
        Ok(Client::patient(&mut self.bus, id).upload(0x2061, 0)?)
    }

    /// 2063h: the hash of the report of the calibration in force; `None` when it has none.
    ///
    /// Errors: a node that does not answer.
    pub fn hash(&mut self, place: usize) -> Result<Option<Vec<u8>>, CalibrateError> {
        let id = self.nodes[place].id;
        hash_of(&mut self.bus, id)
    }

    /// Writes 2063h, and reads it back.
    ///
    /// Errors: a refusal, and [`CalibrateError::Differs`].
    pub fn write_hash(&mut self, place: usize, hash: &[u8]) -> Result<(), CalibrateError> {
        let id = self.nodes[place].id;
        self.client(id).download(0x2063, 0, hash)?;
        match self.hash(place)? {
            Some(kept) if kept == hash => Ok(()),
            _ => Err(CalibrateError::Differs(id)),
        }
    }

    /// 2060h sub 1: a command of the motor's run.
    ///
    /// Errors: a refusal.
    pub fn run_command(
        &mut self,
        place: usize,
        command: motor::Command,
    ) -> Result<(), CalibrateError> {
        let id = self.nodes[place].id;
        let finishes = command == motor::Command::Finish;
        let before = finishes.then(|| self.client(id).read_u32(0x2032, 0));
        let before = before.transpose()?;
        Client::patient(&mut self.bus, id).download(0x2060, 1, &[command as u8])?;
        before.map_or(Ok(()), |before| self.await_new_count(place, before))
    }

    /// With a new calibration a node sets its sensor up anew, and counts samples from 0. What 2032h
    /// shows is up to 11 ms old; programs of before go on counting.
    fn await_new_count(&mut self, place: usize, before: u32) -> Result<(), CalibrateError> {
        let id = self.nodes[place].id;
        let until = Instant::now() + PATIENCE;
        self.nodes[place].counted = None;
        loop {
            let now = self.client(id).read_u32(0x2032, 0)?;
            if now < before || now - before > GOES_ON || Instant::now() > until {
                return Ok(());
            }
            self.rest(LOOK.0)?;
        }
    }

    /// 2060h sub 2: the housing stands at `deg`; what the table in force read there less that.
    ///
    /// Errors: [`CalibrateError::Point`] for a point that is not taken.
    pub fn memorise(&mut self, place: usize, deg: f64) -> Result<(), CalibrateError> {
        let id = self.nodes[place].id;
        let thousandths = (deg * 1000.0).round() as i32;
        match self
            .client(id)
            .download(0x2060, 2, &thousandths.to_le_bytes())
        {
            Err(SdoError::Refused(..)) => {
                let result = self.client(id).read_u32(0x2060, 8)? as u8;
                Err(CalibrateError::Point(id, deg, result))
            }
            done => Ok(done?),
        }
    }

    /// Gives each node that was changed what it had, and tells which of them did not take it.
    pub fn roll_back(&mut self) -> Vec<u8> {
        let mut left = Vec::new();
        for place in 0..self.nodes.len() {
            let node = &self.nodes[place];
            let (id, changed, bytes) = (node.id, node.changed, node.bytes.clone());
            let blank = node.is_blank();
            let hash = node.hash.clone();
            if !changed {
                continue;
            }
            // An interrupted transfer may be open, and a signal that waits ends the first try.
            let restored = !blank && (0..2).any(|_| self.write(place, &bytes).is_ok());
            let belongs = matches!(self.hash(place), Ok(now) if now == hash);
            if let (true, false, Some(hash)) = (restored, belongs, &hash) {
                // Without it the report of before is no longer vouched for, which verify tells.
                let _ = self.write_hash(place, hash);
            }
            if restored {
                self.nodes[place].changed = false;
            } else {
                left.push(id);
            }
        }
        left
    }
}

/// What a heartbeat or a boot-up message tells of a node that should be in PRE-OPERATIONAL.
const fn upset(told: Told) -> Option<Upset> {
    match told {
        Ok(State::Initialising) => Some(Upset::Restarted),
        Ok(State::PreOperational) => None,
        _ => Some(Upset::Commanded),
    }
}

fn hash_of(bus: &mut Bus, id: u8) -> Result<Option<Vec<u8>>, CalibrateError> {
    match Client::new(bus, id).upload(0x2063, 0) {
        Ok(hash) => Ok(Some(hash)),
        Err(why) if why.is_refusal(Abort::NoData) => Ok(None),
        // A program of before this object has none either.
        Err(why) if why.is_refusal(Abort::NoSuchObject) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// One reading.
struct Single {
    accel: [f64; 3],
    temperature_c: f64,
    angle_deg: [Result<f64, u8>; 2],
}

/// Readings on their way to a mean.
#[derive(Default)]
struct Sum {
    singles: Vec<Single>,
}

impl Sum {
    fn add(&mut self, single: Single) {
        self.singles.push(single);
    }

    fn mean(self) -> Reading {
        let count = self.singles.len().max(1) as f64;
        let mean = |of: &dyn Fn(&Single) -> f64| self.singles.iter().map(of).sum::<f64>() / count;
        let accel: [f64; 3] = std::array::from_fn(|axis| mean(&|s| s.accel[axis]));
        let square = |s: &Single| -> f64 {
            let off = s.accel.iter().zip(accel).map(|(a, m)| (a - m).powi(2));
            off.sum()
        };
        let mg = f64::from(tilt::ONE_G) / 1000.0;
        Reading {
            accel,
            scatter_mg: mean(&square).sqrt() / mg,
            temperature_c: mean(&|s| s.temperature_c),
            angle_deg: [0, 1].map(|axis| mean_angle(&self.singles, axis)),
            rate_rad_s: None,
        }
    }
}

/// The mean of angles that may lie on both sides of +-180 deg.
fn mean_angle(singles: &[Single], axis: usize) -> Result<f64, u8> {
    let angles: Result<Vec<_>, _> = singles
        .iter()
        .map(|single| single.angle_deg[axis])
        .collect();
    mean_near(&angles?).map(wrap).ok_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn single(accel: f64, deg: Result<f64, u8>) -> Single {
        Single {
            accel: [accel, 0.0, 0.0],
            temperature_c: 25.0,
            angle_deg: [deg, Err(6)],
        }
    }

    #[test]
    fn a_mean_keeps_scatter_reasons_and_the_short_way_round() {
        let mg = f64::from(tilt::ONE_G) / 1000.0;
        let mut sum = Sum::default();
        sum.add(single(0.0, Ok(179.9)));
        sum.add(single(2.0 * mg, Ok(-179.7)));
        let mean = sum.mean();
        assert_eq!(mean.accel[0], mg);
        assert!((mean.scatter_mg - 1.0).abs() < 1e-9);
        assert!((mean.angle_deg[0].unwrap() + 179.9).abs() < 1e-9);
        assert_eq!(mean.angle_deg[1], Err(6));
    }

    #[test]
    fn boot_up_and_other_states_are_upsets_and_pre_operational_is_none() {
        assert_eq!(upset(Ok(State::Initialising)), Some(Upset::Restarted));
        for state in [Ok(State::Stopped), Ok(State::Operational), Err(9)] {
            assert_eq!(upset(state), Some(Upset::Commanded), "{state:?}");
        }
        assert_eq!(upset(Ok(State::PreOperational)), None);
    }

    #[test]
    fn a_calibration_comes_back_from_its_bytes_and_half_of_them_are_none() {
        let bytes = encode(&Calibration::NOMINAL);
        assert_eq!(decode(&bytes), Some(Calibration::NOMINAL));
        assert_eq!(decode(&bytes[..bytes.len() - 4]), None);
    }

    /// Its 2061h has no point, and was taken for the format of another release.
    #[test]
    fn a_new_instrument_that_makes_tables_could_not_be_calibrated() {
        let blank = without_tables(TABLES, false).unwrap();
        assert_eq!(decode(&encode(&blank)), None);
        assert!(matches!(blank.correction, Correction::Tables { .. }));
        assert_eq!(without_tables(TABLES, true), None);
        assert_eq!(without_tables(1, false), None);
    }
}
