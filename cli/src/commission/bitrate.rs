//! `plumb bitrate`: the bit rate of the bus, read or changed on all nodes at once.
//!
//! In: nothing, or a rate in kbit/s. Out: the rate of each node, or nodes that have changed and
//! stored it. Every node on the bus has to follow, or the bus stands still: so nothing is changed
//! while a node does not answer LSS, or the other channel of an instrument does not answer at all,
//! unless it is forced. The nodes are told, store it, and change together after a pause; then the
//! adapter has to follow as well. What ends it before the change has the rate in use stored again.
//! A forced change names the nodes that it has not reached.
//!
//! Left out: the adapter's own rate, but for SLCAN, whose channel is opened anew with it.

use std::process::ExitCode;
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;

use super::answer::Answer;
use super::common::{CommonOptions, left, unknown};
use super::error::{CommissionError, listed};
use bus_master::Bus;
use bus_master::fault::Fault;
use bus_master::lss::{BIT_RATES, Identity, Master};
use bus_master::nmt::{self, Command, State};
use bus_master::node::Node;
use bus_master::nodes::{self, Meant};
use bus_master::survey::{Survey, survey};
use output::object;

/// How long is listened for who is there.
const ASKING: Duration = Duration::from_millis(1000);

/// How long nodes may take to answer at the new rate, behind both pauses.
const BACK: Duration = Duration::from_secs(5);

/// What is changed.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// The new bit rate, kbit/s: 1000, 800, 500, 250, 125, 50, 20 or 10; when not given, the one in
    /// use is read
    #[arg(value_parser = rate, value_name = "KBIT/S")]
    pub rate: Option<u16>,
    /// Pause before and after the change, ms
    #[arg(long, default_value_t = 500, value_name = "MS",
        value_parser = clap::value_parser!(u16).range(10..=10_000))]
    pub delay: u16,
    /// Take nodes that are OPERATIONAL or STOPPED to PRE-OPERATIONAL for the change, and back
    #[arg(long)]
    pub stop: bool,
    /// Change also while nodes that cannot follow are on the bus, or the other channel of an
    /// instrument does not answer
    #[arg(long)]
    pub force: bool,
    /// Which nodes are read; all channels on the bus when not given
    #[command(flatten)]
    pub common: CommonOptions,
}

fn rate(text: &str) -> Result<u16, String> {
    let rate = text
        .parse()
        .ok()
        .filter(|rate| *rate > 0 && BIT_RATES.contains(rate));
    let known: Vec<_> = BIT_RATES.iter().filter(|rate| **rate > 0).collect();
    rate.ok_or_else(|| format!("take one of {known:?} kbit/s"))
}

/// The rate of one node.
#[derive(Clone, Debug, Serialize)]
struct Rate {
    node: u8,
    bit_rate_kbit_s: Option<u32>,
    automatic: Option<bool>,
}

/// What a change came to.
#[derive(Debug, Default)]
struct Outcome {
    /// Those that have changed, at their new rate.
    rates: Vec<Rate>,
    /// Those that keep theirs: they do not answer LSS, or not at all.
    not_reached: Vec<u8>,
    /// Those that stay in PRE-OPERATIONAL, since their state before is not known.
    left: Vec<u8>,
}

/// Reads or changes, and prints.
///
/// Errors: see [`CommissionError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, CommissionError> {
    let mut bus = arguments.common.join()?;
    let (outcome, meant) = match arguments.rate {
        Some(_) if arguments.common.nodes.node.is_some() => return Err(CommissionError::AllOnly),
        Some(rate) => (change(&mut bus, rate, arguments)?, Meant::default()),
        None => {
            let meant = arguments.common.nodes.readable(&mut bus)?;
            let rates = read(&mut bus, &meant.nodes)?;
            let outcome = Outcome {
                rates,
                ..Outcome::default()
            };
            (outcome, meant)
        }
    };
    let changed = arguments.rate.is_some();
    let content = object! {
        changed: changed,
        nodes: &outcome.rates,
        not_reached: &outcome.not_reached,
        left_nodes: &outcome.left,
    };
    answer(arguments).show(&bus, content, || {
        let rates = outcome.rates.iter().map(|rate| line(rate, changed));
        let rate = arguments.rate.into_iter();
        let note = rate.filter_map(|rate| note(&outcome.not_reached, rate));
        let left = outcome.left.iter().map(|id| left(*id, true));
        rates.chain(note).chain(left).collect()
    })?;
    meant.complete()?;
    Ok(ExitCode::SUCCESS)
}

/// The rates of these nodes.
fn read(bus: &mut Bus, nodes: &[u8]) -> Result<Vec<Rate>, CommissionError> {
    let mut rates = Vec::new();
    for id in nodes {
        let mut node = Node::new(bus, *id);
        rates.push(Rate {
            node: *id,
            bit_rate_kbit_s: node.number(0x2053, 1)?,
            automatic: node.number(0x2053, 2)?.map(|number| number != 0),
        });
    }
    Ok(rates)
}

const fn answer(arguments: &Arguments) -> Answer {
    arguments.common.answer("plumb-bitrate")
}

fn line(rate: &Rate, changed: bool) -> String {
    let number = match rate.bit_rate_kbit_s {
        Some(0) => "no bit rate yet: it listens for one".to_owned(),
        Some(number) => format!("{number} kbit/s"),
        None => "an unknown bit rate".to_owned(),
    };
    let automatic = match rate.automatic {
        Some(true) => ", found by listening",
        _ => "",
    };
    let stored = if changed { ", changed and stored" } else { "" };
    format!("node {}: {number}{automatic}{stored}\n", rate.node)
}

/// What follows for nodes that a change to this rate has not reached, if there are some.
fn note(nodes: &[u8], rate: u16) -> Option<String> {
    let nodes = (!nodes.is_empty()).then(|| listed(nodes))?;
    Some(format!(
        "note: these nodes were not reached and keep their bit rate: {nodes}; on a bus at {rate} \
         kbit/s they disturb the others, so connect them to a bus of their own at their rate, and \
         use `plumb bitrate {rate} --force` there\n"
    ))
}

/// Changes all nodes, and takes those back that were taken to PRE-OPERATIONAL for it; the rates
/// that they have, which no node tells in STOPPED.
fn change(bus: &mut Bus, rate: u16, arguments: &Arguments) -> Result<Outcome, CommissionError> {
    let heard = survey(bus, ASKING).map_err(Fault::bus)?;
    if heard.nodes().is_empty() {
        return Err(Fault::nobody(bus).into());
    }
    let in_state = |wanted: State| {
        let nodes = heard.heartbeats.iter();
        let nodes = nodes.filter(move |(_, state)| **state == Ok(wanted));
        nodes.map(|(node, _)| *node).collect::<Vec<u8>>()
    };
    let (mut working, halted) = (in_state(State::Operational), in_state(State::Stopped));
    let mut unheard = Vec::new();
    let silent = heard.answers.keys();
    for id in silent.filter(|id| !heard.heartbeats.contains_key(id)) {
        match Node::new(bus, *id).state_or_work()? {
            Some(Ok(State::Operational)) => working.push(*id),
            None => unheard.push(*id),
            _ => {}
        }
    }
    if !arguments.stop && !halted.is_empty() {
        return Err(CommissionError::Halted(halted));
    }
    if !arguments.stop {
        return change_these(bus, rate, arguments, &heard, &working);
    }
    let mut heard_of = working.iter().chain(&halted);
    let stopped = heard_of.try_for_each(|id| Node::new(bus, *id).enter_heard());
    let stopped = stopped.and_then(|()| {
        let mut unheard = unheard.iter();
        unheard.try_for_each(|id| Node::new(bus, *id).enter_unheard())
    });
    let stopped = stopped.map_err(CommissionError::from);
    let changed = stopped.and_then(|()| change_these(bus, rate, arguments, &heard, &[]));
    // Those that did not follow have not heard it; what went wrong before shows more.
    let working = working.iter().map(|node| (Command::Start, node));
    let halted = halted.iter().map(|node| (Command::Stop, node));
    let started = working
        .chain(halted)
        .try_for_each(|(command, node)| nmt::command(bus, command, *node));
    let changed = changed.map_err(|why| unknown(why, &unheard))?;
    started.map_err(Fault::bus)?;
    Ok(Outcome {
        left: unheard,
        ..changed
    })
}

/// Changes those that are there; some of them work and were not stopped.
fn change_these(
    bus: &mut Bus,
    rate: u16,
    arguments: &Arguments,
    heard: &Survey,
    working: &[u8],
) -> Result<Outcome, CommissionError> {
    let missing = nodes::missing(bus, heard)?;
    if let (false, Some(missing)) = (arguments.force, missing.first()) {
        return Err(CommissionError::Half(*missing));
    }
    let (follow, mut not_reached) = match told(bus, rate, arguments, heard, working) {
        Ok(told) => told,
        Err(error) => {
            // Nobody is left behind in the configuration state; why it ended shows more.
            let _ = Master::new(bus).switch_all(false);
            return Err(error);
        }
    };
    let rates = arrived(bus, rate, arguments, &follow);
    let rates = rates.map_err(|error| match error {
        CommissionError::Fault(why) => CommissionError::Changed(why, follow, rate),
        error => error,
    })?;
    not_reached.extend(missing.iter().map(|missing| missing.peer));
    not_reached.sort_unstable();
    not_reached.dedup();
    Ok(Outcome {
        rates,
        not_reached,
        left: Vec::new(),
    })
}

/// Selects those that are there and tells them, where all of them can follow; who does, and who
/// does not.
fn told(
    bus: &mut Bus,
    rate: u16,
    arguments: &Arguments,
    heard: &Survey,
    working: &[u8],
) -> Result<(Vec<u8>, Vec<u8>), CommissionError> {
    Master::begin(bus).map_err(Fault::from)?;
    let (mut follow, mut behind) = (Vec::new(), Vec::new());
    for id in heard.nodes() {
        match selected(bus, id)? {
            true => follow.push(id),
            false => behind.push(id),
        }
    }
    let (working, behind): (Vec<u8>, Vec<u8>) =
        behind.into_iter().partition(|id| working.contains(id));
    let may = arguments.force || behind.is_empty();
    match (working.is_empty(), may && !follow.is_empty()) {
        // Not even by force: these can follow.
        (false, _) => Err(CommissionError::Operational(working)),
        (true, true) => tell(bus, &follow, rate, arguments.delay).map(|()| (follow, behind)),
        (true, false) => Err(CommissionError::Behind(behind)),
    }
}

/// Follows nodes that change, until all answer; the rates that they have then.
fn arrived(
    bus: &mut Bus,
    rate: u16,
    arguments: &Arguments,
    follow: &[u8],
) -> Result<Vec<Rate>, CommissionError> {
    answer(arguments).say(format!(
        "commanded to change to {rate} kbit/s: nodes {}\n",
        listed(follow)
    ))?;
    // Both pauses of the nodes.
    sleep(2 * Duration::from_millis(u64::from(arguments.delay)));
    // Other adapters have their rate set elsewhere.
    bus.set_bit_rate(u32::from(rate)).map_err(Fault::bus)?;
    let silent = silent(bus, follow);
    // Nobody is left behind in the configuration state, whatever became of it.
    let back = Master::new(bus).switch_all(false);
    let silent = silent?;
    back.map_err(Fault::from)?;
    match silent.is_empty() {
        true => read(bus, follow),
        false => Err(CommissionError::NotFollowed(silent, rate)),
    }
}

/// Brings a node into the configuration state by its identity; false where it does not answer.
fn selected(bus: &mut Bus, id: u8) -> Result<bool, Fault> {
    let mut identity: Identity = [0; 4];
    for (sub, number) in (1..).zip(&mut identity) {
        let Some(found) = Node::new(bus, id).number_once(0x1018, sub)? else {
            return Ok(false);
        };
        *number = found;
    }
    Ok(Master::new(bus).select(&identity)?)
}

/// Tells those in the configuration state, which store it and change. Where that ends before the
/// change, they are told the rate in use again, and store it where they were to store the new one.
fn tell(bus: &mut Bus, nodes: &[u8], rate: u16, delay: u16) -> Result<(), CommissionError> {
    let rates = read(bus, nodes)?;
    // All have the same one, and not every device tells it.
    let mut in_use = rates.iter().filter_map(|rate| rate.bit_rate_kbit_s);
    let before = in_use.find_map(|rate| index(u16::try_from(rate).ok()?));
    let mut master = Master::new(bus);
    if let Err(why) = master.configure_bit_timing(index(rate).unwrap_or(0)) {
        // What another tool has them store later is not the new rate.
        let _ = before.map(|before| master.configure_bit_timing(before));
        return Err(Fault::from(why).into());
    }
    let stored = master.store();
    let Err(why) = stored.and_then(|_| master.activate_bit_timing(delay)) else {
        return Ok(());
    };
    let why = Fault::from(why);
    match before.map(|before| master.store_bit_timing_instead(before)) {
        Some(Ok(_)) => Err(why.into()),
        _ => Err(CommissionError::StillStored(why, nodes.to_vec(), rate)),
    }
}

/// The index of a rate in [`BIT_RATES`].
fn index(rate: u16) -> Option<u8> {
    let mut known = (0..).zip(BIT_RATES).filter(|(_, known)| *known > 0);
    known.find_map(|(index, known)| (known == rate).then_some(index))
}

/// Waits until all answer; who does not.
fn silent(bus: &mut Bus, nodes: &[u8]) -> Result<Vec<u8>, Fault> {
    let until = Instant::now() + BACK;
    let mut silent = nodes.to_vec();
    while !silent.is_empty() && Instant::now() < until {
        let mut still = Vec::new();
        for id in silent {
            if Node::new(bus, id).number_once(0x1000, 0)?.is_none() {
                still.push(id);
            }
        }
        silent = still;
    }
    Ok(silent)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_those_of_the_standard_and_the_reserved_one_is_none() {
        assert_eq!(rate("500"), Ok(500));
        for wrong in ["0", "100", "250000", "fast", ""] {
            assert!(rate(wrong).is_err(), "{wrong}");
        }
        assert_eq!(
            [1000, 500, 10, 0, 100].map(index),
            [Some(0), Some(2), Some(8), None, None]
        );
    }
}
