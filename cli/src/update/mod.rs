//! `plumb update`: a new program for both channels, one after the other, over the bus.
//!
//! In: files of images, a bus, node-ids. Out: nodes that run the new program and have confirmed
//! it, one line for each; or one sentence that states what is wrong, and nodes that run what they
//! ran. Before anything is changed every node is asked whether the image suits it and whether it
//! measures, since one channel works while the other is updated.
//!
//! A node's update: PRE-OPERATIONAL, clear, download of what is missing, start, and then to wait
//! for the check of its signature and the node's own judgement of its new program
//! (docs/canopen.md). A node that was OPERATIONAL gets there again, also when the update fails or
//! is interrupted.
//!
//! Left out: building images (`image`).

mod error;
pub mod file;
mod told;
mod version;

use std::path::PathBuf;
use std::process::ExitCode;
use std::thread::sleep;
use std::time::{Duration, Instant};

use canopen::object::Abort;
use clap::Args;
use flash::layout::Slot;

use bus_master::diagnosis;
use bus_master::nmt::{self, Command, State, Told as Heard};
use bus_master::node::Node;
use bus_master::nodes;
use bus_master::sdo::Client;
use bus_master::{Bus, BusEnd, BusOptions};
pub use error::UpdateError;
use file::Image;
use output::progress::Progress;
use told::{NodeEvent, Told};
pub use version::version;

/// 2080h sub 4.
const ON_TRIAL: u32 = 1;
const ROLLED_BACK: u32 = 2;

/// How long a clear may take: 54 pages of 80 ms at most, a tenth of a second each.
const CLEARING: Duration = Duration::from_secs(15);

/// How long a node may take to come back, from its start to its boot-up message: a second for the
/// check of the image, and a restart.
const RESTART: Duration = Duration::from_secs(10);

/// How long the trial may take: three starts of ten seconds, and what is between them.
const TRIAL: Duration = Duration::from_secs(60);

/// How long a node may take until it measures again.
const MEASURING: Duration = Duration::from_secs(10);

/// For how long the other channel has to have had a valid angle before this one is taken out of
/// the pair: it goes on alone once the two have agreed for half a second (docs/safety.md). After a
/// try in vain the time is doubled.
const TOGETHER: Duration = Duration::from_millis(1500);

/// Behind the end of the pair: by then its last comparison makes no angle valid any more.
const APART: Duration = Duration::from_millis(1500);

/// Within this time after that the other channel has to measure alone, also where it produces SYNC
/// first, in place of this one.
const ALONE: Duration = Duration::from_secs(3);

/// How long a heartbeat is waited for.
const HEARTBEAT: Duration = Duration::from_secs(2);

/// How often a transfer is tried that loses its answers, and a clear.
const TRIES: usize = 3;

/// The abort code of an object that a node does not have (CiA 301 7.2.4.3.17).
const NO_OBJECT: u32 = Abort::NoSuchObject.code();

/// 1F57h of a memory that is clear: there is no program.
const EMPTY: u32 = 1 << 1;

/// Between two questions.
const PAUSE: Duration = Duration::from_millis(100);

/// What is updated, and with what.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Files of images; of each node's two slots the one that it does not run in needs one
    #[arg(required = true, value_name = "IMAGE")]
    pub images: Vec<PathBuf>,
    /// The nodes, in the order of their update
    #[arg(
        long,
        default_value = "1,2",
        value_delimiter = ',',
        value_parser = clap::value_parser!(u8).range(1..=127),
        value_name = "ID,ID,..."
    )]
    pub nodes: Vec<u8>,
    /// Update also while a node has no valid angle
    #[arg(long)]
    pub force: bool,
    /// Print a line of JSON for each node
    #[arg(long)]
    pub json: bool,
    /// The bus
    #[command(flatten)]
    pub bus: BusOptions,
}

/// Updates the nodes.
///
/// Errors: see [`UpdateError`]; a node that would not have the program is exit status 1.
pub fn run(arguments: &Arguments, progress: &Progress) -> Result<ExitCode, UpdateError> {
    match update(arguments, progress) {
        Err(error) if error.is_verdict() => {
            eprintln!("plumb: {error}");
            Ok(ExitCode::from(1))
        }
        ended => ended.map(|()| ExitCode::SUCCESS),
    }
}

fn update(arguments: &Arguments, progress: &Progress) -> Result<(), UpdateError> {
    if let Some(node) = twice(&arguments.nodes) {
        return Err(UpdateError::Twice(node));
    }
    let images = file::read(&arguments.images)?;
    let mut bus = arguments.bus.join().map_err(UpdateError::Join)?;
    let mut plans = Vec::new();
    for node in &arguments.nodes {
        let asked = match Renewal::of(&mut bus, *node).plan(&images) {
            // Nothing has begun yet, so there is time to find out why.
            Err(UpdateError::Silent(node)) => {
                let why = diagnosis::silence(&mut bus, Some(node)).map_err(BusEnd::from)?;
                Err(UpdateError::NotThere(why))
            }
            asked => asked,
        };
        plans.push((*node, asked?));
    }
    let told = Told {
        progress,
        json: arguments.json,
    };
    let mut works = false;
    if !arguments.force {
        works = rejoin(&mut bus, &arguments.nodes, told)?;
        for node in &arguments.nodes {
            Renewal::of(&mut bus, *node).must_measure(Duration::ZERO)?;
        }
    }
    for (node, plan) in plans {
        match plan {
            Plan::Nothing(runs) => told.tell(node, NodeEvent::Already(runs)),
            Plan::Send(image) => {
                let others = arguments.nodes.iter().filter(|other| **other != node);
                let others: Vec<u8> = match arguments.force {
                    true => Vec::new(),
                    false => others.copied().collect(),
                };
                Renewal::of(&mut bus, node).renew(image, &others, works, told)?;
            }
        }
    }
    Ok(())
}

/// Starts the nodes of a pair at work that are not OPERATIONAL: an update that was killed has left
/// one so, and while it measures for nobody the other one must not be taken out. Whether the pair
/// is at work: one of its nodes is OPERATIONAL.
fn rejoin(bus: &mut Bus, nodes: &[u8], told: Told) -> Result<bool, UpdateError> {
    let mut states = Vec::new();
    for node in nodes {
        states.push((*node, Renewal::of(bus, *node).state()?));
    }
    let works = |(_, state): &(u8, Option<Heard>)| *state == Some(Ok(State::Operational));
    if !states.iter().any(works) {
        return Ok(false);
    }
    for (node, state) in states.iter().filter(|one| !works(one)) {
        // It does nothing to one that is OPERATIONAL and was not heard.
        Renewal::of(bus, *node).command(Command::Start)?;
        if state.is_some() {
            told.tell(*node, NodeEvent::Started);
        }
    }
    Ok(true)
}

/// A node that is named twice, if there is one.
fn twice(nodes: &[u8]) -> Option<u8> {
    let mut numbered = nodes.iter().enumerate();
    let again = numbered.find(|(number, node)| nodes[..*number].contains(node));
    again.map(|(_, node)| *node)
}

/// What is to be done with a node.
#[derive(Clone, Copy, Debug)]
enum Plan<'a> {
    /// It runs this version, bit for bit.
    Nothing(u32),
    /// It gets this image.
    Send(&'a Image),
}

/// A node under update. A silent one is come back to, so its silence is not looked into.
struct Renewal<'a>(Node<'a>);

impl<'a> Renewal<'a> {
    const fn of(bus: &'a mut Bus, node: u8) -> Self {
        Self(Node::patient(bus, node))
    }

    /// The way to another node.
    const fn beside(&mut self, node: u8) -> Renewal<'_> {
        Renewal::of(self.0.bus, node)
    }

    fn client(&mut self) -> Client<'_> {
        self.0.client()
    }

    fn read(&mut self, index: u16, sub: u8) -> Result<u32, UpdateError> {
        Ok(self.client().read_u32(index, sub)?)
    }

    fn write(&mut self, index: u16, sub: u8, value: u32, length: usize) -> Result<(), UpdateError> {
        let bytes = &value.to_le_bytes()[..length];
        Ok(self.client().download_again(index, sub, bytes)?)
    }

    fn command(&mut self, command: Command) -> Result<(), UpdateError> {
        Ok(nmt::command(self.0.bus, command, self.0.id).map_err(BusEnd::from)?)
    }

    /// What this node needs of these images. Nothing is changed.
    fn plan<'i>(&mut self, images: &'i [Image]) -> Result<Plan<'i>, UpdateError> {
        let node = self.0.id;
        self.client().give_up(0x1F50, 1)?;
        if nodes::channel_of(self.read(0x1018, 2)?).is_none() {
            return Err(UpdateError::Stranger(node));
        }
        let hardware = match self.read(0x2080, 1) {
            Err(UpdateError::Refused(_, _, _, NO_OBJECT)) => return Err(UpdateError::Fixed(node)),
            answer => answer?,
        };
        let runs = self.read(0x2080, 2)?;
        let mut fitting = images.iter().filter(|i| i.header.hardware == hardware);
        let version = fitting.clone().next().map(|image| image.header.version.0);
        let version = version.ok_or(UpdateError::Hardware(node, hardware))?;
        let (slot, name) = match self.read(0x2080, 3)? {
            0 => (Slot::A, 'B'),
            _ => (Slot::B, 'A'),
        };
        let crc = self.read(0x1F56, 1)?;
        let same = |image: &Image| image.slot == slot && image.header.crc == crc;
        if runs == version && fitting.clone().any(same) {
            return Ok(Plan::Nothing(runs));
        }
        if runs > version {
            return Err(UpdateError::Older(node, runs, version));
        }
        if self.read(0x2080, 4)? == ON_TRIAL {
            return Err(UpdateError::OnTrial(node));
        }
        let other = fitting.find(|image| image.slot == slot.other());
        other.map(Plan::Send).ok_or(UpdateError::Slot(node, name))
    }

    /// Whether it has a valid angle of its own, 2020h.
    fn measures(&mut self) -> Result<bool, UpdateError> {
        Ok(self.read(0x2020, 0)? & 3 != 0)
    }

    /// All of a node's update; it ends in the NMT state in which it was found, or OPERATIONAL where
    /// its `pair_works`. `others` have to measure when the new program is started.
    fn renew(
        &mut self,
        image: &Image,
        others: &[u8],
        pair_works: bool,
        told: Told,
    ) -> Result<(), UpdateError> {
        let works = pair_works || self.state()? == Some(Ok(State::Operational));
        let ended = match self.leave(others, works) {
            Ok(()) => self.exchange(image, (others, works), told),
            Err(error) => Err(error),
        };
        // Whoever has taken the node over would be disturbed.
        if matches!(ended, Err(UpdateError::Taken(_))) {
            return ended;
        }
        // What ended it shows more than what may go wrong now.
        let given_up = match ended {
            Ok(()) => Ok(()),
            Err(_) => self.client().give_up(0x1F50, 1).map_err(UpdateError::from),
        };
        let back = match works {
            true => self.command(Command::Start),
            false => Ok(()),
        };
        ended.and(given_up).and(back)?;
        told.tell(self.0.id, NodeEvent::Now(image.header.version.0));
        if works {
            self.together(others)?;
        }
        Ok(())
    }

    /// Waits until the node measures beside each of the others, in OPERATIONAL again: what they
    /// find in each other there takes the angles away.
    fn together(&mut self, others: &[u8]) -> Result<(), UpdateError> {
        for other in others {
            for node in [self.0.id, *other] {
                if !self.beside(node).measures_for(TOGETHER, MEASURING)? {
                    return Err(UpdateError::Apart(node));
                }
            }
        }
        Ok(())
    }

    /// To PRE-OPERATIONAL, once the others go on without this node, which was OPERATIONAL if it
    /// `works`.
    fn leave(&mut self, others: &[u8], works: bool) -> Result<(), UpdateError> {
        let mut together = TOGETHER;
        for left in (0..TRIES).rev() {
            for other in others {
                self.beside(*other).must_stand_in(works, together)?;
            }
            self.command(Command::EnterPreOperational)?;
            sleep(APART);
            match self.first_without_angle(others)? {
                None => break,
                Some(other) if left == 0 || !works => return Err(UpdateError::NoAngle(other)),
                // Both have to agree for longer.
                Some(_) => self.command(Command::Start)?,
            }
            together *= 2;
        }
        Ok(())
    }

    /// The first of the others that does not measure alone.
    fn first_without_angle(&mut self, others: &[u8]) -> Result<Option<u8>, UpdateError> {
        for other in others {
            if !self.beside(*other).measures_for(Duration::ZERO, ALONE)? {
                return Ok(Some(*other));
            }
        }
        Ok(None)
    }

    /// The way from one program to the other.
    fn exchange(
        &mut self,
        image: &Image,
        (others, works): (&[u8], bool),
        told: Told,
    ) -> Result<(), UpdateError> {
        self.transfer(image, told)?;
        for other in others {
            self.beside(*other).must_stand_in(works, Duration::ZERO)?;
        }
        self.start()?;
        self.wait_for_trial(image.header.version.0)?;
        self.wait_for_angle()
    }

    /// Brings all of the image to the node, behind what it has of it.
    fn transfer(&mut self, image: &Image, told: Told) -> Result<(), UpdateError> {
        let mut tries = 1;
        loop {
            let sent = self.transfer_once(image, told);
            match sent {
                Err(UpdateError::Silent(_) | UpdateError::Transfer(_)) if tries < TRIES => {
                    tries += 1;
                    self.client().give_up(0x1F50, 1)?;
                }
                ended => return ended,
            }
        }
    }

    fn transfer_once(&mut self, image: &Image, told: Told) -> Result<(), UpdateError> {
        let node = self.0.id;
        let held = self.held(image)?;
        match held {
            0 => self.clear()?,
            _ => told.tell(node, NodeEvent::GoesOn(held)),
        }
        let rest = image.bytes.get(held..).unwrap_or(&[]);
        let task = told
            .progress
            .task(&format!("node {node}"), image.bytes.len() as u64);
        task.advance(held as u64);
        let mut client = self.client();
        let sent = client.download_blocks(0x1F50, 1, rest, |count| task.advance(count));
        drop(task);
        self.judged(sent.map_err(UpdateError::from))
    }

    /// Starts the new program. An answer that was lost does not matter: its trial shows it.
    fn start(&mut self) -> Result<(), UpdateError> {
        let started = self.client().download(0x1F51, 1, &[1]);
        match self.judged(started.map_err(UpdateError::from)) {
            Ok(()) | Err(UpdateError::Silent(_)) => self.wait_for_boot(),
            Err(error) => Err(error),
        }
    }

    /// Bytes of this image that the node holds from a transfer that was broken off; they count
    /// then.
    fn held(&mut self, image: &Image) -> Result<usize, UpdateError> {
        let (crc, bytes) = (self.read(0x2080, 5)?, self.read(0x2080, 6)?);
        let length = image.bytes.len() as u32;
        if crc != image.identity() || !(1..length).contains(&bytes) {
            return Ok(0);
        }
        // It refuses where the transfer was not broken off but found wrong.
        match self.write(0x2080, 6, bytes, 4) {
            Ok(()) => Ok(bytes as usize),
            Err(UpdateError::Refused(..)) => Ok(0),
            Err(error) => Err(error),
        }
    }

    /// Stop, clear, and wait until that is done.
    fn clear(&mut self) -> Result<(), UpdateError> {
        // Another client may have begun one and left.
        self.wait_for_memory()?;
        self.write(0x1F51, 1, 0, 1)?;
        let mut status = 0;
        for _ in 0..TRIES {
            // It is refused while it runs, so it is not said twice: whether it was heard is read.
            match self
                .client()
                .download(0x1F51, 1, &[3])
                .map_err(UpdateError::from)
            {
                Err(UpdateError::Silent(_)) => {}
                answer => self.judged(answer)?,
            }
            status = self.wait_for_memory()?;
            if status == EMPTY {
                return Ok(());
            }
        }
        Err(UpdateError::Found(self.0.id, status))
    }

    /// Waits until the node does not work at its memory any more: what 1F57h reads then.
    fn wait_for_memory(&mut self) -> Result<u32, UpdateError> {
        let until = Instant::now() + CLEARING;
        loop {
            let status = self.read(0x1F57, 1)?;
            if status & 1 == 0 {
                return Ok(status);
            }
            if Instant::now() > until {
                return Err(UpdateError::Clearing(self.0.id));
            }
            sleep(PAUSE);
        }
    }

    /// A refusal is told by what the node reports of the image, if it does.
    fn judged(&mut self, outcome: Result<(), UpdateError>) -> Result<(), UpdateError> {
        let Err(UpdateError::Refused(..)) = outcome else {
            return outcome;
        };
        match self.read(0x1F57, 1) {
            Ok(status) if status & 1 == 0 && status != 0 => {
                Err(UpdateError::Found(self.0.id, status))
            }
            _ => outcome,
        }
    }

    /// The state that the node's next heartbeat tells; `None` when none comes.
    fn state(&mut self) -> Result<Option<Heard>, UpdateError> {
        Ok(self.0.heartbeat(HEARTBEAT).map_err(BusEnd::from)?)
    }

    /// Waits until the image is checked, for which the node goes on, and the node has restarted.
    fn wait_for_boot(&mut self) -> Result<(), UpdateError> {
        let until = Instant::now() + RESTART;
        while Instant::now() < until {
            if self.state()? == Some(Ok(State::Initialising)) {
                return Ok(());
            }
            match self.read(0x1F57, 1) {
                Ok(status) if status & 1 != 0 => {}
                // It reports nothing of the image any more: it has restarted meanwhile, and its
                // boot-up message came with the answer.
                Ok(0) | Err(UpdateError::Silent(_)) => return Ok(()),
                Ok(status) => return Err(UpdateError::Found(self.0.id, status)),
                Err(error) => return Err(error),
            }
        }
        Err(UpdateError::Gone(self.0.id))
    }

    /// Waits until the program is confirmed. Between its starts the node does not answer.
    fn wait_for_trial(&mut self, wanted: u32) -> Result<(), UpdateError> {
        let until = Instant::now() + TRIAL;
        while Instant::now() < until {
            let asked = self.read(0x2080, 2);
            match asked.and_then(|runs| Ok((runs, self.read(0x2080, 4)?))) {
                Ok((runs, ROLLED_BACK)) => return Err(UpdateError::RolledBack(self.0.id, runs)),
                Ok((runs, standing)) if runs == wanted && standing != ON_TRIAL => return Ok(()),
                Ok(_) | Err(UpdateError::Silent(_)) => sleep(PAUSE),
                Err(error) => return Err(error),
            }
        }
        Err(UpdateError::Undecided(self.0.id))
    }

    /// Waits until it measures, so that the other one may be updated; one that could not before
    /// need not now.
    fn wait_for_angle(&mut self) -> Result<(), UpdateError> {
        self.measures_for(Duration::ZERO, MEASURING).map(drop)
    }

    /// Waits until it has measured for so long, in place of a node that `works`: then it has to be
    /// OPERATIONAL itself, since in any other state its angles reach nobody.
    fn must_stand_in(&mut self, works: bool, long: Duration) -> Result<(), UpdateError> {
        if works {
            let state = self.state()?;
            if state.is_some_and(|state| state != Ok(State::Operational)) {
                return Err(UpdateError::Idle(self.0.id));
            }
        }
        self.must_measure(long)
    }

    /// Waits until it has measured for so long; nothing leads on without.
    fn must_measure(&mut self, long: Duration) -> Result<(), UpdateError> {
        match self.measures_for(long, MEASURING + long)? {
            true => Ok(()),
            false => Err(UpdateError::NoAngle(self.0.id)),
        }
    }

    /// Whether it comes to measure for so `long` without a break `within` a time.
    fn measures_for(&mut self, long: Duration, within: Duration) -> Result<bool, UpdateError> {
        let until = Instant::now() + within;
        let mut since = None;
        while Instant::now() < until {
            since = match self.measures()? {
                true => Some(since.unwrap_or_else(Instant::now)),
                false => None,
            };
            if since.is_some_and(|since: Instant| since.elapsed() >= long) {
                return Ok(true);
            }
            sleep(PAUSE);
        }
        Ok(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_is_written_with_dots() {
        assert_eq!(version(0x0102_0304), "1.2.772");
    }

    #[test]
    fn a_node_named_twice_was_updated_twice() {
        assert_eq!(twice(&[1, 2, 1]), Some(1));
        assert_eq!(twice(&[2, 1]), None);
    }
}
