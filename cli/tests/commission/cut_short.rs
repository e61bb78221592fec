//! Verbs that write, cut short at any frame that they send, and called again.
//!
//! In: each verb, each of its frames, and an event: the user interrupts the program, it is killed,
//! its adapter is unplugged, or a node loses its supply. Out: what the verb prints names each node
//! that it has changed, no node is left in another state without a word, and the same command then
//! does the whole work.
//!
//! Left out: changes of the bit rate (`bitrate`) and of the program (the tests of `update`).

use super::bench::*;
use crate::program::relay::{self, Next};
use crate::program::{each_case, interrupt, is_long};

/// NMT: start.
const START: u8 = 1;

/// Identifier and data.
type Frame = (u16, Vec<u8>);

/// The verbs, and what an object of both nodes shows once one is done.
const VERBS: [(&[&str], &str, &str); 5] = [
    (
        &["set", "slope-long.preset", "3deg", "--stop"],
        "slope-long.preset",
        "3.00 deg",
    ),
    (
        &["set", "heartbeat", "500ms", "--stop"],
        "heartbeat",
        "500 ms",
    ),
    (
        &["zero", "--to", "1deg", "--axis", "x"],
        "slope-long.preset",
        "1.00 deg",
    ),
    (&["save", "--stop"], "heartbeat", "200 ms"),
    (&["restore", "--stop"], "heartbeat", "200 ms"),
];

/// What comes when a frame was sent and before it is on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    /// Ctrl-C.
    Interrupt,
    /// The program is killed.
    Kill,
    /// The adapter is gone.
    Unplugged,
    /// This channel loses its supply.
    Off(char),
}

const EVENTS: [Event; 5] = [
    Event::Interrupt,
    Event::Kill,
    Event::Unplugged,
    Event::Off('a'),
    Event::Off('b'),
];

/// One way to cut a verb short.
#[derive(Clone, Copy, Debug)]
struct Case {
    verb: usize,
    /// At this frame of those that it sends.
    frame: usize,
    event: Event,
}

/// State and object of each node, by node-id less one; `None` where a node is not there.
#[derive(Debug, PartialEq)]
struct Seen([Option<(String, String)>; 2]);

impl Seen {
    fn of(bench: &Bench, object: &str) -> Self {
        let scan = bench.json(&["scan"]);
        let nodes = scan["nodes"].as_array().unwrap();
        let seen = |id: u64| {
            let node = nodes.iter().find(|node| node["node"] == id)?;
            let (_, held, _) = bench.run(&["get", object, "--node", &id.to_string()]);
            Some((node["state"].as_str()?.to_owned(), held))
        };
        Self([seen(1), seen(2)])
    }
}

/// A verb with its nodes.
fn words(verb: usize) -> Vec<&'static str> {
    [VERBS[verb].0, &["--node", "1,2"]].concat()
}

/// An instrument at work.
fn started() -> Bench {
    let mut bench = Bench::quick(&[]);
    bench.nmt(START, 0);
    bench
}

/// The frames that a verb sends, by their order; one that is sent again and again counts once.
fn frames(verb: usize) -> Vec<(usize, Frame)> {
    let bench = started();
    let mut sent: Vec<(usize, Frame)> = Vec::new();
    let (status, _, err) = relay::run(&bench.bus, &words(verb), |_, id, data| {
        sent.push((sent.len(), (id, data.to_vec())));
        Next::Goes
    });
    assert_eq!(status, Some(0), "{err}");
    sent.dedup_by(|(_, later), (_, before)| later == before);
    sent
}

/// Runs a verb and cuts it short; what it prints.
fn cut_short(bench: &mut Bench, case: Case) -> Said {
    let bus = bench.bus.clone();
    let mut count = 0;
    relay::run(&bus, &words(case.verb), |program, _, _| {
        let is_here = count == case.frame;
        count += 1;
        match case.event {
            _ if !is_here => {}
            Event::Interrupt => interrupt(program),
            Event::Kill => program.kill().unwrap(),
            Event::Unplugged => return Next::Ends,
            Event::Off(channel) => bench.word(&format!("power {channel} off")),
        }
        Next::Goes
    })
}

/// What is wrong with what a verb has printed, given what it left.
fn not_told(case: Case, told: &Said, before: &Seen, after: &Seen) -> Vec<String> {
    let (status, out, err) = told;
    let mut wrong = Vec::new();
    let is_told =
        *status == Some(0) && err.is_empty() || *status == Some(2) && err.lines().count() == 1;
    if !is_told {
        wrong.push("no single sentence".to_owned());
    }
    for (id, (before, after)) in (1..).zip(before.0.iter().zip(&after.0)) {
        let (Some(before), Some(after)) = (before, after) else {
            continue;
        };
        let is_named =
            out.contains(&format!("node {id}: ")) || err.contains(&format!("node {id} "));
        if before.1 != after.1 && !is_named {
            wrong.push(format!("node {id} has changed without a word"));
        }
        let left = format!("node {id} is left in PRE-OPERATIONAL");
        if before.0 != after.0 && !(case.event == Event::Unplugged && err.contains(&left)) {
            wrong.push(format!("node {id} was {} and is {}", before.0, after.0));
        }
    }
    wrong
}

/// What went wrong with a case, if anything did.
fn carry_out(case: Case) -> Option<String> {
    let mut bench = started();
    let (_, object, shown) = VERBS[case.verb];
    let before = Seen::of(&bench, object);
    let told = cut_short(&mut bench, case);
    let after = Seen::of(&bench, object);
    let mut wrong = match case.event {
        Event::Kill => Vec::new(),
        _ => not_told(case, &told, &before, &after),
    };
    if let Event::Off(channel) = case.event {
        bench.word(&format!("power {channel} on"));
        bench.pass(1.2);
    }
    let again = bench.run(&words(case.verb));
    let end = Seen::of(&bench, object);
    let is_done =
        |node: &Option<(String, String)>| matches!(node, Some((_, held)) if held.contains(shown));
    if again.0 != Some(0) || !end.0.iter().all(is_done) {
        wrong.push(format!("not done by a second call: {again:?}, {end:?}"));
    }
    let wrong = wrong.join("; ");
    (!wrong.is_empty()).then(|| {
        let verb = VERBS[case.verb].0.join(" ");
        format!("{verb}: {case:?}: {wrong}\n    {told:?}")
    })
}

/// Every event at those frames of a verb that are wanted.
fn cases(verb: usize, wanted: impl Fn(&Frame) -> bool) -> Vec<Case> {
    let frames = frames(verb).into_iter();
    let frames = frames.filter(|(_, frame)| wanted(frame));
    let case = |frame| EVENTS.map(|event| Case { verb, frame, event });
    frames.flat_map(|(frame, _)| case(frame)).collect()
}

/// A long run tries every frame of every verb; any other one two frames of the first: the write to
/// one node, and the command by which the other one leaves OPERATIONAL.
#[test]
fn a_verb_cut_short_at_any_frame_names_what_it_changed_and_is_done_by_a_second_call() {
    let few = |(id, data): &Frame| match id {
        0 => *data == [0x80, 2],
        _ => *id == 0x601 && data[0] & 0xE0 == 0x20,
    };
    let chosen = match is_long() {
        true => (0..VERBS.len())
            .flat_map(|verb| cases(verb, |_| true))
            .collect(),
        false => cases(0, few),
    };
    assert!(chosen.len() >= 10, "{chosen:?}");
    each_case(chosen, carry_out);
}
