//! Every sequence of evidence, up to the depth at which no new state comes up, held against rules
//! that are written down apart from the code.

use std::collections::{HashSet, VecDeque};
use std::vec;
use std::vec::Vec;

use super::*;

/// Pairs come this far apart.
const STEP_US: u32 = MOST_CREDIT_US;

/// Something that happens to the findings of one node.
#[derive(Clone, Copy, Debug)]
enum Event {
    Pair(Evidence),
    OwnAway,
    PeerRestarted,
    Reset,
    /// As many pairs as a disagreement may wait for gravity or a movement, all of which differ.
    LongDifference,
}

const fn found(reason: Invalid) -> Option<Against> {
    let told = false;
    Some(Against { reason, told })
}

const fn told(reason: Invalid) -> Option<Against> {
    let told = true;
    Some(Against { reason, told })
}

const fn pair(
    against: [Option<Against>; 2],
    measures: [bool; 2],
    comparison: Comparison,
    elapsed_us: u32,
) -> Event {
    Event::Pair(Evidence {
        against,
        measures,
        comparison,
        elapsed_us,
    })
}

/// Every kind of pair: both measure and compare in each way, by their angles or by what is behind
/// them, with each kind of finding against either; one or both give no angle for each kind of
/// reason; one starts and is waited for.
fn events() -> Vec<Event> {
    use Invalid::{Biased, Noise, Silent, Stuck, Unconfirmed};
    let mut all = vec![
        Event::OwnAway,
        Event::PeerRestarted,
        Event::Reset,
        Event::LongDifference,
    ];
    let compared = [
        Comparison::Alike,
        Comparison::Agree,
        Comparison::Excess,
        Comparison::Differ,
    ];
    for comparison in compared {
        for own in [None, found(Noise), found(Biased)] {
            for peer in [None, found(Noise), found(Biased)] {
                all.push(pair([own, peer], [true; 2], comparison, STEP_US));
            }
        }
        all.push(pair([None; 2], [true; 2], comparison, 0));
    }
    let absent = |against, measures| pair(against, measures, Comparison::Absent, STEP_US);
    for own in [found(Stuck), found(Silent), found(Unconfirmed)] {
        all.push(absent([own, None], [false, true]));
    }
    for peer in [told(Stuck), told(Silent), told(Unconfirmed), told(Biased)] {
        all.push(absent([None, peer], [true, false]));
        all.push(absent([found(Silent), peer], [false, false]));
    }
    for measures in [[true, false], [false, true], [false, false]] {
        all.push(absent([None; 2], measures));
    }
    all
}

/// The events in this one, one after the other.
fn single(event: Event) -> (Event, u32) {
    match event {
        Event::LongDifference => (
            pair([None; 2], [true; 2], Comparison::Differ, STEP_US),
            WEIGHED_CAUSE_US / STEP_US + 1,
        ),
        event => (event, 1),
    }
}

/// What happened so far, as far as the rules ask for it. Each time stops where no rule asks for
/// more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
struct Past {
    /// Pairs in a row that agree, or are alike behind their angles, us.
    agreeing_us: u32,
    /// Agreeing pairs since this channel was away, us.
    agreed_us: u32,
    /// The newest two that were compared did not agree, and nobody was named for it.
    contested: bool,
    /// Time between the two pairs before, us.
    before_us: u32,
    /// Since the two have disagreed, us.
    disagreed_us: u32,
    /// For each channel: pairs since something spoke against it, us: any at which it measured,
    /// and those that this node compared or at which the channel reported a fault itself.
    measured_us: [u32; 2],
    compared_us: [u32; 2],
}

/// The longest time that the latch asks for.
fn latch_us(latch: Latch) -> u32 {
    match latch {
        Latch::UntilReset => 0,
        Latch::Healthy(us) => us,
    }
}

impl Past {
    fn with(mut self, before: &Findings, event: &Event, latch: Latch) -> Self {
        let evidence = match event {
            Event::Reset => return Self::default(),
            Event::OwnAway => {
                (self.agreed_us, self.before_us) = (0, 0);
                return self;
            }
            Event::PeerRestarted => return self,
            Event::LongDifference => unreachable!("it is many single ones"),
            Event::Pair(evidence) => evidence,
        };
        let before_us = std::mem::replace(&mut self.before_us, evidence.elapsed_us);
        let passed_us = evidence.elapsed_us.min(before_us);
        let comparison = evidence.comparison;
        let compared = !matches!(comparison, Comparison::Absent | Comparison::Alike);
        self.disagreed_us = match before.disagree() {
            true if evidence.elapsed_us == 0 => WEIGHED_CAUSE_US,
            true => (self.disagreed_us + passed_us).min(WEIGHED_CAUSE_US),
            false => 0,
        };
        let alike = matches!(comparison, Comparison::Agree | Comparison::Alike);
        match comparison {
            Comparison::Agree | Comparison::Alike => {
                self.agreeing_us = (self.agreeing_us + passed_us).min(latch_us(latch));
            }
            Comparison::Absent => {}
            Comparison::Excess | Comparison::Differ => self.agreeing_us = 0,
        }
        if comparison == Comparison::Agree {
            self.agreed_us = (self.agreed_us + passed_us).min(PROOF_US);
        }
        if compared {
            self.contested = comparison != Comparison::Agree;
        }
        let named = attributes(evidence, self.disagreed_us);
        self.contested &= !named;
        for n in 0..2 {
            let against = evidence.against[n];
            let by_this_node = against.is_some_and(|against| !against.told);
            let measured = against.is_none() && evidence.measures[n];
            self.measured_us[n] = match (against, measured) {
                (Some(_), _) => 0,
                (None, true) => {
                    (self.measured_us[n] + passed_us).min(RECOVERY_US.max(latch_us(latch)))
                }
                (None, false) => self.measured_us[n],
            };
            let reports =
                |against: Against| against.told && !against.reason.passes_with_its_cause();
            let counts = alike || against.is_some_and(reports);
            self.compared_us[n] = if by_this_node || comparison == Comparison::Differ {
                0
            } else if counts {
                (self.compared_us[n] + passed_us).min(latch_us(latch))
            } else {
                self.compared_us[n]
            };
        }
        self
    }
}

fn apply(mut findings: Findings, event: &Event, latch: Latch) -> Findings {
    match event {
        Event::Pair(evidence) => findings.take(evidence, latch),
        Event::OwnAway => findings.own_away(),
        Event::PeerRestarted => findings.peer_restarted(),
        Event::Reset => findings = Findings::default(),
        Event::LongDifference => unreachable!("it is many single ones"),
    }
    findings
}

/// A difference is attributed to a channel by this pair, `disagreed_us` after it was found.
fn attributes(evidence: &Evidence, disagreed_us: u32) -> bool {
    let mut against = evidence.against.iter().flatten();
    against.any(|against| {
        let weighed = against.reason == Invalid::Biased && disagreed_us < WEIGHED_CAUSE_US;
        weighed || against.reason.measures_wrongly() && disagreed_us < ONE_CAUSE_US
    })
}

fn has_lasted(us: u32, latch: Latch) -> bool {
    matches!(latch, Latch::Healthy(enough) if us >= enough)
}

/// What is latched ends only as the latch and a reset of the channel concerned allow.
fn nothing_is_forgotten(before: &Findings, event: &Event, after: &Findings, past: &Past, l: Latch) {
    if matches!(event, Event::Reset) {
        return;
    }
    if before.disagree() && !after.disagree() {
        let Event::Pair(evidence) = event else {
            panic!("a disagreement ended without a pair");
        };
        let over = has_lasted(past.agreeing_us, l) || attributes(evidence, past.disagreed_us);
        assert!(over, "a disagreement was forgotten");
    }
    for n in 0..2 {
        let Some(held) = before.faulty[n] else {
            continue;
        };
        let same = after.faulty[n].is_some_and(|f| f.reason == held.reason);
        let restarted = n == 1 && matches!(event, Event::PeerRestarted);
        if same || restarted {
            continue;
        }
        if held.passes() {
            let away = matches!(event, Event::OwnAway);
            let replaced = after.faulty[n].is_some();
            let over = past.measured_us[n] >= RECOVERY_US;
            assert!(away || replaced || over, "channel {n}");
        } else {
            let judged = held.was_compared();
            let sound_us = if judged {
                past.compared_us[n]
            } else {
                past.measured_us[n]
            };
            let over = has_lasted(sound_us, l);
            assert!(over, "a fault of channel {n} was forgotten");
        }
    }
}

fn rules(before: &Findings, event: &Event, after: &Findings, past: &Past, latch: Latch) {
    nothing_is_forgotten(before, event, after, past, latch);
    let explains = |faulty: &Faulty| faulty.explains();
    let explained = after.faulty.iter().flatten().any(explains);
    if let Event::Pair(evidence) = event
        && evidence.comparison == Comparison::Differ
    {
        assert!(explained || after.disagree(), "a difference was ignored");
    }
    if let Event::Pair(evidence) = event {
        for (faulty, against) in after.faulty.iter().zip(evidence.against) {
            assert!(
                faulty.is_some() || against.is_none(),
                "evidence was ignored"
            );
        }
    }
    if after.have_agreed() {
        let proven = past.agreed_us >= PROOF_US && !past.contested && !after.disagree();
        assert!(proven, "alone without having agreed");
    }
    let judgement = after.judgement();
    let faulty = after.faulty.iter().flatten().count() != 0;
    assert_eq!(judgement.is_some(), faulty || after.disagree());
    assert!(judgement.is_none_or(Judgement::is_fault));
    if after.disagree() && !faulty {
        assert_eq!(judgement, Some(Judgement::Disagree));
    }
}

/// What has lasted longer than any rule asks for is all alike; so are the times between which no
/// rule tells.
fn alike((mut findings, mut past): (Findings, Past), latch: Latch) -> (Findings, Past) {
    for faulty in findings.faulty.iter_mut().flatten() {
        let most_us = if faulty.passes() {
            RECOVERY_US
        } else {
            latch_us(latch)
        };
        faulty.sound_us = faulty.sound_us.min(most_us);
    }
    if let Some(held) = &mut findings.disagreement {
        held.agreed_us = held.agreed_us.min(latch_us(latch));
        held.age_us = waited(held.age_us);
    }
    past.disagreed_us = waited(past.disagreed_us);
    (findings, past)
}

/// The age of a disagreement: what is between the two times that count is the first of them.
fn waited(us: u32) -> u32 {
    match us {
        ONE_CAUSE_US..WEIGHED_CAUSE_US => ONE_CAUSE_US,
        us => us,
    }
}

/// Goes through all states that any sequence of events leads to; how many there are, and the
/// number of events that leads to the last of them.
fn explore(latch: Latch) -> (usize, usize) {
    let events = events();
    let start = (Findings::default(), Past::default());
    let mut known = HashSet::from([start]);
    let mut open = VecDeque::from([(start, 0)]);
    let mut deepest = 0;
    while let Some(((before, past), steps)) = open.pop_front() {
        deepest = steps;
        for event in &events {
            let (event, times) = single(*event);
            // What comes before is gone through step by step.
            if times > 1 && past.disagreed_us != ONE_CAUSE_US {
                continue;
            }
            let mut state = (before, past);
            for _ in 0..times {
                let (before, past) = state;
                let after = apply(before, &event, latch);
                let now = past.with(&before, &event, latch);
                rules(&before, &event, &after, &now, latch);
                state = (after, now);
            }
            let state = alike(state, latch);
            if known.insert(state) {
                open.push_back((state, steps + 1));
            }
        }
    }
    (known.len(), deepest)
}

#[test]
fn no_sequence_of_evidence_forgets_or_ignores_anything() {
    for latch in [
        Latch::UntilReset,
        Latch::Healthy(STEP_US),
        Latch::Healthy(2 * STEP_US),
        Latch::Healthy(3 * STEP_US),
    ] {
        let (states, depth) = explore(latch);
        std::println!("{latch:?}: {states} states, none new after {depth} events");
        assert!(states > 1000, "{states}");
    }
}
