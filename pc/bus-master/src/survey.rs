//! Who is on the bus: everybody who is heard, and everybody who answers.
//!
//! In: a bus and some time. Out: nodes by their heartbeats, by their answer to the question for
//! 1000h, by other frames of theirs, and whether one without a node-id is there. Asking is
//! harmless: 1000h is read, and only nodes without a node-id answer the LSS question.
//!
//! Left out: what the nodes are; `scan` asks those that are found.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::time::{Duration, Instant};

use canopen::Frame;
use canopen::lss::{REQUEST, RESPONSE};

use super::nmt::{self, Told};
use super::{Bus, Received};

/// Between two questions, so that neither an adapter's queue nor the bus is filled by them.
const PAUSE: Duration = Duration::from_millis(2);

/// LSS: whoever has no node-id is to report, and the answer.
const IDENTIFY_UNCONFIGURED: u8 = 0x4C;
const UNCONFIGURED_HERE: u8 = 0x50;

/// What was heard.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Survey {
    /// Frames of any kind, answers to our questions included.
    pub frames: u64,
    /// State in the last heartbeat of each node.
    pub heartbeats: BTreeMap<u8, Told>,
    /// Nodes whose SDO server answers, with their device type or `None` for a refusal.
    pub answers: BTreeMap<u8, Option<u32>>,
    /// Nodes that send EMCYs or PDOs by the identifiers of CiA's predefined set.
    pub senders: BTreeSet<u8>,
    /// Nodes that somebody else asks over SDO.
    pub asked_by_others: BTreeSet<u8>,
    /// A node without a node-id is there.
    pub unconfigured: bool,
}

impl Survey {
    /// Nodes that are surely there.
    pub fn nodes(&self) -> BTreeSet<u8> {
        let heard = self.heartbeats.keys().chain(self.answers.keys());
        heard.copied().collect()
    }

    fn note(&mut self, received: &Received) {
        self.frames += 1;
        if let Some((node, state)) = nmt::heartbeat(received) {
            self.heartbeats.insert(node, state);
            return;
        }
        let Some(id) = received.frame.cob_id() else {
            return;
        };
        let node = (id & 0x7F) as u8;
        let bytes = received.frame.bytes();
        match (id & 0x780, bytes) {
            (0x580, [command, 0, 0x10, 0, a, b, c, d]) if node > 0 => {
                let number = u32::from_le_bytes([*a, *b, *c, *d]);
                let is_answer = command & 0xE0 == 0x40;
                if is_answer || *command == 0x80 {
                    self.answers.insert(node, is_answer.then_some(number));
                }
            }
            (0x600, _) if node > 0 => {
                self.asked_by_others.insert(node);
            }
            (0x080 | 0x180..=0x500, _) if node > 0 && !received.frame.is_remote() => {
                self.senders.insert(node);
            }
            _ if id == RESPONSE && bytes.first() == Some(&UNCONFIGURED_HERE) => {
                self.unconfigured = true;
            }
            _ => {}
        }
    }

    fn listen(&mut self, bus: &mut Bus, until: Instant) -> io::Result<()> {
        while let Some(received) = bus.receive(until)? {
            self.note(&received);
        }
        Ok(())
    }
}

/// Asks everybody and listens for this time.
///
/// Errors: the bus is lost, or the user has ended it.
pub fn survey(bus: &mut Bus, time: Duration) -> io::Result<Survey> {
    let mut survey = Survey::default();
    let until = Instant::now() + time;
    bus.send(&Frame::data_frame(
        REQUEST,
        &[IDENTIFY_UNCONFIGURED, 0, 0, 0, 0, 0, 0, 0],
    ))?;
    for node in 1..=127_u16 {
        let question = [0x40, 0, 0x10, 0, 0, 0, 0, 0];
        bus.send(&Frame::data_frame(0x600 + node, &question))?;
        survey.listen(bus, Instant::now() + PAUSE)?;
    }
    survey.listen(bus, until.max(Instant::now() + 50 * PAUSE))?;
    Ok(survey)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noted(frames: &[(u16, &[u8])]) -> Survey {
        let mut survey = Survey::default();
        for (id, bytes) in frames {
            survey.note(&Received {
                time_ns: 0,
                frame: Frame::data_frame(*id, bytes),
            });
        }
        survey
    }

    #[test]
    fn each_kind_of_frame_tells_what_it_can() {
        let survey = noted(&[
            (0x701, &[5]),
            (0x582, &[0x43, 0, 0x10, 0, 0x9A, 1, 4, 0x30]),
            (0x583, &[0x80, 0, 0x10, 0, 0, 0, 2, 6]),
            // An answer to somebody's question for another object.
            (0x584, &[0x43, 0x18, 0x10, 1, 0, 0, 0, 0]),
            (0x605, &[0x40, 0, 0x10, 0, 0, 0, 0, 0]),
            (0x186, &[0; 6]),
            (0x087, &[0; 8]),
            (0x080, &[]),
            (0x7E4, &[0x50, 0, 0, 0, 0, 0, 0, 0]),
        ]);
        assert_eq!(survey.frames, 9);
        assert_eq!(
            survey.heartbeats,
            BTreeMap::from([(1, Ok(nmt::State::Operational))])
        );
        let answers = BTreeMap::from([(2, Some(0x3004_019A)), (3, None)]);
        assert_eq!(survey.answers, answers);
        assert_eq!(survey.nodes(), BTreeSet::from([1, 2, 3]));
        assert_eq!(survey.asked_by_others, BTreeSet::from([5]));
        assert_eq!(survey.senders, BTreeSet::from([6, 7]));
        assert!(survey.unconfigured);
    }
}
