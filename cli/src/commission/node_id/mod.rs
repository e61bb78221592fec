//! `plumb node-id`: node-ids by LSS, and what the two channels of an instrument hold of each
//! other.
//!
//! In: a new node-id for one node (`--node`, or the one that has none), or two for the channels A
//! and B of an instrument (`--pair 10,11`; the two without node-ids, or those named). Out: nodes
//! that have it, now and after a power cut, and that find each other: what was done, line by
//! line, or one JSON object. A step that fails ends it. Before the reset that makes the new
//! node-ids count, the old ones are stored again (`give`); after it, what was printed is done.
//!
//! The channels find each other by numbers that stay as they are: 2001h, the heartbeat that is
//! supervised (1016h:1), and what RPDO 1 and 2 receive (1400h:1, 1401h:1; with a gyroscope that of
//! RPDO 3, 1402h:1, too). They are written, saved, and count from the reset at the end. Then both
//! are started, to see that they compare, and taken back. Identifiers that follow the node-id as
//! delivered do so no longer once they have been saved; those that are still as delivered for the
//! old node-id are written anew.
//!
//! Left out: identifiers of safety frames, which do not follow the node-id; a sentence states it.

mod give;
mod known;

use std::borrow::Cow;
use std::process::ExitCode;
use std::str::FromStr;
use std::time::{Duration, Instant};

use clap::Args;

use super::answer::Answer;
use super::common::{CommonOptions, unknown};
use super::error::CommissionError;
use bus_master::Bus;
use bus_master::fault::{self, Fault};
use bus_master::lss::{Identity, Master};
use bus_master::nmt::{self, Command, State};
use bus_master::node::Node;
use bus_master::nodes::{self, Missing, NodeOption, Nodes};
use bus_master::survey::{Survey, survey};
use codes::words;
use give::Member;
use output::object;

/// How long is listened for who is there.
const ASKING: Duration = Duration::from_millis(400);

/// How long a node may take until it answers by its new node-id.
const RESTART: Duration = Duration::from_secs(10);

/// How long two channels may take until they have compared: SYNC of their own after half a
/// second, and two seconds in which each waits for the other.
const COMPARING: Duration = Duration::from_secs(8);

/// Between two questions.
const PAUSE: Duration = Duration::from_millis(100);

/// 2021h of two channels that have found each other: agree, warning.
const COMPARED: [u32; 2] = [1, 2];

/// Two node-ids, of channel A and channel B.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pair(u8, u8);

impl FromStr for Pair {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let id = |text: &str| text.trim().parse().ok().filter(|id| (1..=127).contains(id));
        let ids = text.split_once(',').and_then(|(a, b)| id(a).zip(id(b)));
        match ids {
            Some((a, b)) if a != b => Ok(Self(a, b)),
            _ => Err("write two different node-ids from 1 to 127: A,B".to_owned()),
        }
    }
}

/// Which node-ids, and for whom.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// The new node-id of one node: the one of --node, or the one that has none
    #[arg(
        required_unless_present = "pair",
        conflicts_with = "pair",
        value_parser = clap::value_parser!(u8).range(1..=127),
        value_name = "ID"
    )]
    pub id: Option<u8>,
    /// The new node-ids of channel A and channel B of one instrument
    #[arg(long, value_name = "A,B")]
    pub pair: Option<Pair>,
    /// Take nodes that are OPERATIONAL to PRE-OPERATIONAL for the change, and back
    #[arg(long)]
    pub stop: bool,
    /// Change one node also where its other channel, which refers to it, does not answer
    #[arg(long, conflicts_with = "pair")]
    pub force: bool,
    /// The rest; where no nodes are named, those without a node-id.
    #[command(flatten)]
    pub common: CommonOptions,
}

/// What does not follow the node-id.
const SAFETY: &str = "safety frames (SRDO) keep their identifiers, 1301h and 1302h: with a second \
                      instrument on the bus give one of them others before safety is commissioned";

/// What the nodes are told, and how much of it is printed.
struct Work<'a> {
    bus: &'a mut Bus,
    answer: Answer,
    may_stop: bool,
    /// The other channel may be left behind.
    may_leave: bool,
    /// Old and new node-ids of those that were taken out of OPERATIONAL.
    stopped: Vec<[u8; 2]>,
    /// The same of those whose state before is not known, and that stay in PRE-OPERATIONAL.
    unheard: Vec<[u8; 2]>,
    /// Those that have their new node-ids.
    changed: Vec<u8>,
    /// What is left to be done.
    notes: Vec<String>,
}

/// The other channel of an instrument.
#[derive(Clone, Copy, Debug)]
enum Other {
    /// No node refers to this one.
    None,
    /// This node does.
    There(u8),
    /// It does not answer, and is left behind.
    Behind(Missing),
}

/// Gives node-ids and prints. Exit status 1: everything was done, and the two do not agree.
///
/// Errors: see [`CommissionError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, CommissionError> {
    let mut bus = arguments.common.join()?;
    let answer = arguments.common.answer("plumb-node-id");
    let mut work = Work {
        bus: &mut bus,
        answer,
        may_stop: arguments.stop,
        may_leave: arguments.force,
        stopped: Vec::new(),
        unheard: Vec::new(),
        changed: Vec::new(),
        notes: Vec::new(),
    };
    let done = match (arguments.pair, arguments.id) {
        (Some(pair), _) => work.pair(pair, &arguments.common.nodes),
        (None, id) => work.single(id.unwrap_or(1), &arguments.common.nodes),
    };
    let back = work.start_again(done.is_ok());
    let changed = std::mem::take(&mut work.changed);
    let unheard = work.unheard.iter();
    let left = unheard.map(|[old, new]| if changed.contains(new) { *new } else { *old });
    let left: Vec<u8> = left.collect();
    let (members, compare) = done.map_err(|error| match error {
        CommissionError::Fault(why) if !changed.is_empty() => {
            unknown(CommissionError::Given(why, changed), &left)
        }
        error => unknown(error, &left),
    })?;
    back?;
    let mut notes = std::mem::take(&mut work.notes);
    notes.extend(left.into_iter().map(fault::unknown));
    notes.extend(compare.map(|_| SAFETY.to_owned()));
    let lines: String = notes.iter().map(|note| format!("note: {note}\n")).collect();
    let content = object! {
        nodes: members,
        // Both compare and agree; null where there is no pair.
        agree: compare,
        notes: notes,
    };
    answer.show(&bus, content, || lines)?;
    Ok(match compare {
        Some(false) => ExitCode::from(1),
        _ => ExitCode::SUCCESS,
    })
}

impl Work<'_> {
    /// Prints what is done.
    fn say(&self, sentence: &str) -> Result<(), CommissionError> {
        self.answer.say(format!("{sentence}\n"))
    }

    /// One node, and the other channel that refers to it.
    fn single(
        &mut self,
        id: u8,
        named: &NodeOption,
    ) -> Result<(Vec<Member>, Option<bool>), CommissionError> {
        let mut members = self.members(named, 1)?;
        let survey = survey(self.bus, ASKING).map_err(Fault::bus)?;
        let Some(member) = members.first_mut() else {
            return Err(CommissionError::Fresh(0, 1));
        };
        if survey.nodes().contains(&id) && member.old_node != Some(id) {
            return Err(CommissionError::Taken(id));
        }
        member.node = id;
        let other = match member.old_node {
            Some(old) => self.other(&survey, old)?,
            None => Other::None,
        };
        if let (Other::There(other), Some(channel)) = (other, members[0].channel) {
            let own = self.look(other)?;
            if own.channel.is_some_and(|letter| letter != channel) {
                members.push(Member { node: other, ..own });
            }
        }
        self.give(&members[..1])?;
        match members.len() {
            2 => self.join(&mut members).map(|agree| (members, Some(agree))),
            _ => {
                self.keep_lss(&members[0], other)?;
                Ok((members, None))
            }
        }
    }

    /// The other channel of a node that has a node-id.
    ///
    /// Errors: [`CommissionError::Alone`] where it does not answer, and may not be left behind.
    fn other(&mut self, survey: &Survey, old: u8) -> Result<Other, CommissionError> {
        let there: Vec<u8> = survey.nodes().into_iter().collect();
        if let Some(other) = self.who_knows(&there, old)? {
            return Ok(Other::There(other));
        }
        // A channel as delivered has the node-id of the other one, too: whether that one has ever
        // been there can't be told from here.
        let missing = nodes::missing(self.bus, survey)?;
        match missing.into_iter().find(|one| one.node == old) {
            Some(missing) if !self.may_leave => Err(CommissionError::Alone(missing)),
            Some(missing) => Ok(Other::Behind(missing)),
            None => {
                // One whose answer to everybody was lost.
                let late = Node::new(self.bus, old).peer()?;
                let late: Vec<u8> = late
                    .filter(|peer| !there.contains(peer))
                    .into_iter()
                    .collect();
                let other = self.who_knows(&late, old)?;
                Ok(other.map_or(Other::None, Other::There))
            }
        }
    }

    /// Both channels of an instrument.
    fn pair(
        &mut self,
        Pair(a, b): Pair,
        named: &NodeOption,
    ) -> Result<(Vec<Member>, Option<bool>), CommissionError> {
        let mut members = self.members(named, 2)?;
        members.sort_by_key(|member| member.channel);
        match members.as_slice() {
            [one, other] if one.channel == Some('A') && other.channel == Some('B') => {}
            _ => return Err(CommissionError::NoPair),
        }
        let olds: Vec<_> = members
            .iter()
            .filter_map(|member| member.old_node)
            .collect();
        for (member, id) in members.iter_mut().zip([a, b]) {
            member.node = id;
        }
        let there = self.there()?;
        let taken = |id: &&u8| there.contains(id) && !olds.contains(id);
        if let Some(id) = [a, b].iter().find(taken) {
            return Err(CommissionError::Taken(*id));
        }
        self.give(&members)?;
        let agree = self.join(&mut members)?;
        Ok((members, Some(agree)))
    }

    /// Node-ids in use.
    fn there(&mut self) -> Result<Vec<u8>, Fault> {
        let survey = survey(self.bus, ASKING).map_err(Fault::bus)?;
        Ok(survey.nodes().into_iter().collect())
    }

    /// The nodes named, or those without a node-id.
    fn members(
        &mut self,
        named: &NodeOption,
        needed: usize,
    ) -> Result<Vec<Member>, CommissionError> {
        let ids = match &named.node {
            None => return self.fresh(needed),
            Some(Nodes::These(ids)) => ids.clone(),
            Some(Nodes::All) => nodes::channels(self.bus)?.nodes,
        };
        if ids.len() != needed {
            return Err(CommissionError::Count(needed, ids.len()));
        }
        let looked: Result<Vec<_>, _> = ids.into_iter().map(|id| self.look(id)).collect();
        Ok(looked?)
    }

    /// A node that has a node-id.
    fn look(&mut self, id: u8) -> Result<Member, Fault> {
        let mut node = Node::new(self.bus, id);
        let mut identity = [0; 4];
        for (sub, number) in (1..).zip(&mut identity) {
            *number = node.number(0x1018, sub)?.unwrap_or(0);
        }
        let old_node = Some(id);
        Ok(Member {
            old_node,
            node: id,
            ..member(identity)
        })
    }

    /// The nodes without a node-id, of which there have to be as many as are needed.
    fn fresh(&mut self, needed: usize) -> Result<Vec<Member>, CommissionError> {
        let mut master = Master::begin(self.bus).map_err(Fault::from)?;
        let found = master.fastscan_all(needed + 1).map_err(Fault::from)?;
        // On a dead bus it is the bus that has to be told of.
        if found.is_empty() && self.there()?.is_empty() {
            return Err(Fault::nobody(self.bus).into());
        }
        if found.len() != needed {
            return Err(CommissionError::Fresh(found.len(), needed));
        }
        let members: Vec<_> = found.into_iter().map(member).collect();
        for member in &members {
            let serial = member.serial_number;
            self.say(&format!("found: {}, serial number {serial}", named(member)))?;
        }
        Ok(members)
    }

    /// Who takes this node-id for the other channel's.
    fn who_knows(&mut self, there: &[u8], id: u8) -> Result<Option<u8>, Fault> {
        for other in there.iter().filter(|other| **other != id) {
            let mut node = Node::new(self.bus, *other);
            let known = nodes::channel(node.bus, *other)?.is_some();
            if known && node.number(0x2001, 0)? == Some(u32::from(id)) {
                return Ok(Some(*other));
            }
        }
        Ok(None)
    }

    /// Takes those that are OPERATIONAL, where no node answers LSS, to PRE-OPERATIONAL.
    ///
    /// Errors: [`CommissionError::Operational`] where they may not be; all of them are as before.
    fn stop(&mut self, members: &[Member]) -> Result<(), CommissionError> {
        let mut working = Vec::new();
        let changed = members.iter().filter(|m| m.old_node != Some(m.node));
        for (old, new) in changed.filter_map(|m| Some((m.old_node?, m.node))) {
            match Node::new(self.bus, old).state_or_work()? {
                Some(Ok(State::Operational)) => working.push([old, new]),
                // It may be OPERATIONAL: in PRE-OPERATIONAL it answers LSS.
                None if self.may_stop => {
                    Node::new(self.bus, old).enter_unheard()?;
                    self.unheard.push([old, new]);
                }
                _ => {}
            }
        }
        if !working.is_empty() && !self.may_stop {
            let olds = working.iter().map(|[old, _]| *old);
            return Err(CommissionError::Operational(olds.collect()));
        }
        for [old, new] in working {
            self.stopped.push([old, new]);
            Node::new(self.bus, old).enter_heard()?;
        }
        Ok(())
    }

    /// Starts those again that were stopped, by their new node-ids, or by both where it is not
    /// known which one they have.
    fn start_again(&mut self, done: bool) -> Result<(), Fault> {
        for [old, new] in std::mem::take(&mut self.stopped) {
            let ids = if done { &[new][..] } else { &[old, new] };
            for id in ids {
                nmt::command(self.bus, Command::Start, *id).map_err(Fault::bus)?;
            }
        }
        Ok(())
    }

    /// Node-ids by LSS, stored; they count at the end of this.
    fn give(&mut self, members: &[Member]) -> Result<(), CommissionError> {
        self.stop(members)?;
        let is_new = |member: &&Member| member.old_node != Some(member.node);
        let new: Vec<_> = members.iter().filter(is_new).collect();
        for (place, member) in new.iter().enumerate() {
            let given = give::give(self.bus, member).and_then(|()| {
                let id = member.node;
                self.say(&format!(
                    "{}: node-id {id} is given and stored",
                    named(member)
                ))
            });
            given.map_err(|why| give::take_back(self.bus, &new[..place], why))?;
        }
        for old in members.iter().filter_map(|member| member.old_node) {
            nmt::command(self.bus, Command::ResetCommunication, old).map_err(Fault::bus)?;
        }
        self.changed = new.iter().map(|member| member.node).collect();
        for member in members {
            self.wait(member.node)?;
            self.renumber(member)?;
        }
        Ok(())
    }

    /// Identifiers that were saved for the old node-id.
    fn renumber(&mut self, member: &Member) -> Result<(), CommissionError> {
        let Some(old) = member.old_node.filter(|old| *old != member.node) else {
            return Ok(());
        };
        let id = member.node;
        let mut node = Node::new(self.bus, id);
        let changed = node.set_up_stopped(|node| known::renumber(node, old))?;
        if !changed.is_empty() {
            let list = changed.join(", ");
            self.say(&format!(
                "node {id}: identifiers follow the node-id: {list}, saved"
            ))?;
        }
        Ok(())
    }

    /// Waits until a node answers.
    fn wait(&mut self, id: u8) -> Result<(), CommissionError> {
        let until = Instant::now() + RESTART;
        while Instant::now() < until {
            nmt::state(self.bus, id, PAUSE).map_err(Fault::bus)?;
            if Node::new(self.bus, id).number_once(0x1000, 0)?.is_some() {
                return Ok(());
            }
        }
        Err(CommissionError::Gone(id))
    }

    /// Nothing but the node-id was to be kept: LSS has done so.
    fn keep_lss(&mut self, member: &Member, other: Other) -> Result<(), CommissionError> {
        let id = member.node;
        let Other::Behind(Missing { node, peer, .. }) = other else {
            return self.say(&format!(
                "node {id} answers; no other channel refers to it yet"
            ));
        };
        self.say(&format!("node {id} answers"))?;
        self.notes.push(format!(
            "node {peer}, its other channel, was not reached and looks for node {node}: when it \
             is back, use `plumb node-id --pair {pair} --node {pair}`",
            pair = match member.channel {
                Some('B') => format!("{peer},{id}"),
                _ => format!("{id},{peer}"),
            }
        ));
        Ok(())
    }

    /// Tells both channels of each other, saves, resets, and sees whether they agree.
    fn join(&mut self, members: &mut [Member]) -> Result<bool, CommissionError> {
        let [one, other] = members else {
            return Err(CommissionError::NoPair);
        };
        one.peer = Some(other.node);
        other.peer = Some(one.node);
        let (a, b) = (one.node, other.node);
        for (id, peer) in [(a, b), (b, a)] {
            let mut node = Node::new(self.bus, id);
            let told = node.set_up_stopped(|node| known::tell(node, peer))?;
            let told = told.join(", ");
            self.say(&format!(
                "node {id}: the other channel is node {peer} ({told}), saved"
            ))?;
        }
        for id in [a, b] {
            // One that keeps its node-id may be at work all this time; the reset ends that.
            match Node::new(self.bus, id).state_or_work()? {
                Some(Ok(State::Operational)) => self.stopped.push([id, id]),
                None if !self.changed.contains(&id) => self.unheard.push([id, id]),
                _ => {}
            }
            nmt::command(self.bus, Command::ResetNode, id).map_err(Fault::bus)?;
        }
        for (id, peer) in [(a, b), (b, a)] {
            self.wait(id)?;
            known::check(&mut Node::new(self.bus, id), peer)?;
        }
        self.say(&format!(
            "nodes {a} and {b} are back from their reset and hold it"
        ))?;
        self.compare(a, b)
    }

    /// Starts both until they agree, and takes back what was not started before.
    fn compare(&mut self, a: u8, b: u8) -> Result<bool, CommissionError> {
        let mut started = Vec::new();
        for id in [a, b] {
            let mut node = Node::new(self.bus, id);
            if node.state_or_work()? != Some(Ok(State::Operational)) {
                node.command(Command::Start)?;
                started.push(id);
            }
        }
        let states = self.states(a, b)?;
        for id in started {
            Node::new(self.bus, id).command(Command::EnterPreOperational)?;
        }
        let [one, other] = states;
        let agree = [one, other].iter().all(|state| COMPARED.contains(state));
        match (agree, one.max(other)) {
            (true, _) => {
                self.say(&format!(
                    "nodes {a} and {b} compare their angles: {}",
                    pair_state(one)
                ))?;
            }
            (false, 0) => return Err(CommissionError::Apart(a, b)),
            (false, _) => self.say(&format!(
                "node {a} reports: {}; node {b} reports: {}; `plumb info` shows why",
                pair_state(one),
                pair_state(other)
            ))?,
        }
        Ok(agree)
    }

    /// 2021h of both, when they have compared or the time is over.
    fn states(&mut self, a: u8, b: u8) -> Result<[u32; 2], Fault> {
        let until = Instant::now() + COMPARING;
        loop {
            let mut states = [0; 2];
            for (state, id) in states.iter_mut().zip([a, b]) {
                *state = Node::new(self.bus, id).number(0x2021, 0)?.unwrap_or(0);
            }
            let done = states.iter().all(|state| COMPARED.contains(state));
            if done || Instant::now() > until {
                return Ok(states);
            }
            nmt::state(self.bus, a, PAUSE).map_err(Fault::bus)?;
        }
    }
}

/// 2021h in words.
fn pair_state(state: u32) -> Cow<'static, str> {
    words::state(u8::try_from(state).unwrap_or(u8::MAX), words::CHANNELS)
}

/// A node by its identity.
fn member(identity: Identity) -> Member {
    Member {
        channel: nodes::channel_of(identity[1]).map(codes::dictionary::letter),
        old_node: None,
        node: 0,
        serial_number: identity[3],
        peer: None,
        identity,
    }
}

fn named(member: &Member) -> String {
    match (member.channel, member.old_node) {
        (Some(channel), Some(old)) => format!("channel {channel} (node {old} until now)"),
        (Some(channel), None) => format!("channel {channel}"),
        (None, Some(old)) => format!("node {old}"),
        (None, None) => format!("a device with product code {:08X}h", member.identity[1]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_has_two_different_node_ids() {
        assert_eq!("10,11".parse(), Ok(Pair(10, 11)));
        assert_eq!(" 127 , 1 ".parse(), Ok(Pair(127, 1)));
        for wrong in ["10", "10,10", "0,1", "1,128", "a,b", "1,2,3", ""] {
            assert!(wrong.parse::<Pair>().is_err(), "{wrong:?}");
        }
    }
}
