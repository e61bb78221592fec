//! What the user hears of an update: a line for each node, as text or as JSON, and bars.
//!
//! In: what has become of a node. Out: one line on the standard output. That it can't be printed
//! is no reason to leave a node in the middle of its update.
//!
//! Left out: errors, which end the update.

use serde::Serialize;

use output::progress::Progress;
use output::stdout;

use super::version::version;

/// Where it is told.
#[derive(Clone, Copy, Debug)]
pub struct Told<'a> {
    /// The bars.
    pub progress: &'a Progress,
    /// Whether the lines are JSON.
    pub json: bool,
}

/// What has become of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeEvent {
    /// It runs this version, and did before.
    Already(u32),
    /// It was not OPERATIONAL in a pair at work, and was started.
    Started,
    /// It has so many bytes of the image from a transfer that was broken off.
    GoesOn(usize),
    /// It runs this version now.
    Now(u32),
}

#[derive(Debug, Serialize)]
struct Line {
    format: &'static str,
    version: u32,
    node_id: u8,
    event: &'static str,
    program_version: Option<String>,
    held_bytes: Option<usize>,
}

impl Told<'_> {
    /// Tells it.
    pub fn tell(self, node: u8, event: NodeEvent) {
        // Whoever reads has gone or has no room; the nodes must not suffer from it.
        let text = || sentence(node, event) + "\n";
        let _ = stdout::print_as(self.json, &line(node, event), text);
    }
}

fn sentence(node: u8, event: NodeEvent) -> String {
    match event {
        NodeEvent::Already(runs) => format!("node {node} runs {} already", version(runs)),
        NodeEvent::Started => format!("node {node} was not OPERATIONAL, and is started"),
        NodeEvent::GoesOn(held) => format!("node {node} continues after {held} bytes"),
        NodeEvent::Now(runs) => format!("node {node} runs {} now", version(runs)),
    }
}

fn line(node_id: u8, event: NodeEvent) -> Line {
    let (event, runs, held_bytes) = match event {
        NodeEvent::Already(runs) => ("runs_already", Some(runs), None),
        NodeEvent::Started => ("started", None, None),
        NodeEvent::GoesOn(held) => ("goes_on", None, Some(held)),
        NodeEvent::Now(runs) => ("runs_now", Some(runs), None),
    };
    Line {
        format: "plumb-update",
        version: 1,
        node_id,
        event,
        program_version: runs.map(version),
        held_bytes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_is_told_of_in_words_and_as_json() {
        let event = NodeEvent::Now(0x0102_0003);
        assert_eq!(sentence(2, event), "node 2 runs 1.2.3 now");
        assert_eq!(
            serde_json::to_string(&line(2, event)).unwrap(),
            "{\"format\":\"plumb-update\",\"version\":1,\"node_id\":2,\"event\":\"runs_now\",\
             \"program_version\":\"1.2.3\",\"held_bytes\":null}"
        );
        assert_eq!(line(1, NodeEvent::GoesOn(7)).held_bytes, Some(7));
    }
}
