//! Why nobody answers, in one sentence that states what to look at.
//!
//! In: a bus on which a node was asked in vain. Out: what can be told from here: nothing is heard
//! at all (and whether the adapter reports errors, as with a wrong bit rate), other node-ids are
//! there, the node is heard but its SDO server is silent, or somebody else uses it.
//!
//! Left out: what only a look at the wires shows.

use std::io;
use std::time::Duration;

use super::nmt::{State, Told};
use super::survey::{Survey, survey};
use super::{Bus, Trouble};
use codes::words;

/// How long is listened: longer than the heartbeats of most nodes.
const LISTENING: Duration = Duration::from_millis(1500);

/// Errors of an adapter from which on the bit rate is the likely reason.
const MANY_ERRORS: u64 = 3;

/// Why nobody answers.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Silence {
    /// Nothing is heard at all.
    #[error(
        "no frame is received on {bus}: no node has power, its wires are open, or the bit rate is \
         another one"
    )]
    BusSilent {
        /// The bus.
        bus: String,
    },
    /// Nothing is heard but errors.
    #[error(
        "no frame but {errors} errors are received on {bus}: most likely the bit rate is another \
         one (plumb -b, or `ip link set can0 type can bitrate ...`), or a terminating resistor is \
         missing"
    )]
    BitRate {
        /// The bus.
        bus: String,
        /// Errors that the adapter tells of.
        errors: u64,
    },
    /// The adapter cannot send: nobody acknowledges.
    #[error(
        "the adapter of {bus} cannot send, since no node acknowledges: no node has power, the \
         wires are open, or the bit rate is another one"
    )]
    Unacknowledged {
        /// The bus.
        bus: String,
    },
    /// Only nodes without a node-id are there.
    #[error(
        "{a}a node without a node-id is on the bus: give it one with `plumb node-id`",
        a = absent(.node)
    )]
    Unconfigured {
        /// The node that was asked, `None` for any.
        node: Option<u8>,
    },
    /// Frames come, but none that a node of this kind sends.
    #[error(
        "{frames} frames are received, but no heartbeat and no answer of a CANopen node: is it \
         the right bus?"
    )]
    NoNodes {
        /// Frames heard.
        frames: u64,
    },
    /// Other nodes are there.
    #[error("there is no node {node}; {a} there: name one of these", a = listed(.others))]
    Others {
        /// The node that was asked.
        node: u8,
        /// Who is there.
        others: Vec<u8>,
    },
    /// Frames by its identifiers come, but no heartbeat and no answer.
    #[error(
        "node {0} does not answer and sends no heartbeat, but PDOs or EMCYs by its identifiers \
         come: is it in STOPPED, or is its SDO channel elsewhere?"
    )]
    OnlySends(u8),
    /// It is in the state STOPPED.
    #[error(
        "node {0} is in STOPPED, where no node answers SDO: send it the NMT command Enter \
         PRE-OPERATIONAL first (frame 000h 80 {0:02X}, as `cansend can0 000#80{0:02X}`), or use \
         --node {0} --stop, which `plumb set`, `save` and `restore` have"
    )]
    Stopped(u8),
    /// It has just started.
    #[error("node {0} sends boot-up messages and does not get further: is its supply weak?")]
    Starts(u8),
    /// Its heartbeat comes, its SDO server is silent.
    #[error(
        "node {0} is {state} by its heartbeat, but its SDO server does not answer: the frames to \
         it are lost, or it is at work for long",
        state = words::told(*.1)
    )]
    OnlyHeartbeats(u8, Told),
    /// Somebody else asks it.
    #[error("another tool uses the SDO server of node {0}: end the other tool, or wait for it")]
    Busy(u8),
    /// It answers now.
    #[error(
        "node {0} did not answer in time, but answers now: frames are lost, or it was at work; \
         try again"
    )]
    AnswersNow(u8),
}

fn absent(node: &Option<u8>) -> String {
    node.map_or(String::new(), |node| format!("node {node} is not there; "))
}

/// "node 1 is" or "nodes 1, 2 and 3 are".
fn listed(nodes: &[u8]) -> String {
    let names: Vec<String> = nodes.iter().map(u8::to_string).collect();
    match names.split_last() {
        Some((last, rest)) if !rest.is_empty() => {
            format!("nodes {} and {last} are", rest.join(", "))
        }
        Some((only, _)) => format!("node {only} is"),
        None => "nobody is".to_owned(),
    }
}

/// What is to be said of a survey, of a node or of any.
pub fn judge(survey: &Survey, trouble: Trouble, bus: &str, node: Option<u8>) -> Silence {
    let bus = bus.to_owned();
    if survey.frames == 0 {
        return match trouble {
            Trouble { errors, .. } if errors >= MANY_ERRORS => Silence::BitRate { bus, errors },
            Trouble { unsent: true, .. } => Silence::Unacknowledged { bus },
            _ => Silence::BusSilent { bus },
        };
    }
    // Where nobody has answered in particular, the first one that is heard tells most.
    if let Some(node) = node.or_else(|| survey.nodes().first().copied()) {
        let state = survey.heartbeats.get(&node);
        let busy = survey.asked_by_others.contains(&node);
        match (state, survey.answers.contains_key(&node)) {
            (_, _) if busy => return Silence::Busy(node),
            (_, true) => return Silence::AnswersNow(node),
            (Some(Ok(State::Stopped)), _) => return Silence::Stopped(node),
            (Some(Ok(State::Initialising)), _) => return Silence::Starts(node),
            (Some(state), _) => return Silence::OnlyHeartbeats(node, *state),
            (None, _) if survey.senders.contains(&node) => return Silence::OnlySends(node),
            (None, _) => {}
        }
    }
    let others: Vec<u8> = survey.nodes().into_iter().collect();
    match (node, others.is_empty()) {
        (Some(node), false) => Silence::Others { node, others },
        _ if survey.unconfigured => Silence::Unconfigured { node },
        _ => Silence::NoNodes {
            frames: survey.frames,
        },
    }
}

/// Finds out why a node, or nobody at all, answers.
///
/// Errors: the bus is lost, or the user has ended it.
pub fn silence(bus: &mut Bus, node: Option<u8>) -> io::Result<Silence> {
    let heard = survey(bus, LISTENING);
    // Where nobody acknowledges, sending fails, and that is the finding.
    let heard = match heard {
        Err(error) if error.kind() == io::ErrorKind::TimedOut => Survey::default(),
        heard => heard?,
    };
    let trouble = bus.trouble()?;
    Ok(judge(&heard, trouble, bus.name(), node))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::{BTreeMap, BTreeSet};

    fn told(survey: &Survey, trouble: Trouble, node: Option<u8>) -> String {
        judge(survey, trouble, "slcan://pi:1", node).to_string()
    }

    fn heard() -> Survey {
        Survey {
            frames: 9,
            heartbeats: BTreeMap::from([(1, Ok(State::Operational)), (2, Ok(State::Stopped))]),
            answers: BTreeMap::from([(1, Some(0x3004_019A))]),
            senders: BTreeSet::from([7]),
            ..Survey::default()
        }
    }

    #[test]
    fn a_silent_bus_is_told_from_a_wrong_bit_rate_and_from_an_adapter_alone() {
        let nothing = Survey::default();
        let quiet = told(&nothing, Trouble::default(), Some(1));
        assert!(
            quiet.starts_with("no frame is received on slcan://pi:1"),
            "{quiet}"
        );
        let (errors, unsent) = (40, true);
        let wrong = told(&nothing, Trouble { errors, unsent }, None);
        assert!(
            wrong.contains("40 errors") && wrong.contains("bit rate"),
            "{wrong}"
        );
        let alone = told(&nothing, Trouble { errors: 0, unsent }, None);
        assert!(alone.contains("no node acknowledges"), "{alone}");
    }

    #[test]
    fn another_node_id_is_named() {
        let other = told(&heard(), Trouble::default(), Some(5));
        assert_eq!(
            other,
            "there is no node 5; nodes 1 and 2 are there: name one of these"
        );
    }

    #[test]
    fn a_node_that_is_heard_and_does_not_answer_is_told_by_its_state() {
        let node = |node| told(&heard(), Trouble::default(), Some(node));
        assert!(node(2).starts_with("node 2 is in STOPPED"), "{}", node(2));
        assert!(node(1).contains("answers now"), "{}", node(1));
        assert!(node(7).contains("PDOs or EMCYs"), "{}", node(7));
        let mut deaf = heard();
        deaf.heartbeats.insert(3, Ok(State::PreOperational));
        let deaf = told(&deaf, Trouble::default(), Some(3));
        assert!(deaf.contains("pre-operational by its heartbeat"), "{deaf}");
    }

    #[test]
    fn nodes_that_were_heard_were_told_to_send_no_heartbeat() {
        let mut deaf = heard();
        deaf.answers.clear();
        let told = told(&deaf, Trouble::default(), None);
        assert!(told.contains("node 1 is operational"), "{told}");
    }

    #[test]
    fn somebody_else_and_fresh_nodes_are_told() {
        let mut survey = heard();
        survey.asked_by_others.insert(1);
        assert!(told(&survey, Trouble::default(), Some(1)).contains("another tool"));
        let fresh = Survey {
            frames: 1,
            unconfigured: true,
            ..Survey::default()
        };
        let fresh = told(&fresh, Trouble::default(), Some(1));
        assert!(
            fresh.contains("node 1 is not there; a node without a node-id"),
            "{fresh}"
        );
        let strange = Survey {
            frames: 500,
            ..Survey::default()
        };
        assert!(told(&strange, Trouble::default(), None).contains("500 frames"));
    }
}
