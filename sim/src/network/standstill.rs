//! A processor that stands still while a page of its flash is erased, as the chip's does: its code
//! runs from the same flash (PM0075 2.3).
//!
//! In: until when, and what comes to the node meanwhile. Out: the same behind it, in the order in
//! which `firmware` finds it; and how many frames there was no room for. The controller goes on by
//! itself: it sends what it has, and keeps three frames of a master's and three others (RM0008
//! 24.7.3; `firmware::chip::can` has the filter). Of the sensor's edges the last one counts.
//!
//! Left out: the time that programming takes.

use std::collections::VecDeque;

use canopen::Frame;

use crate::can_bus::ErrorState;

/// Frames that a FIFO of the controller holds.
const FIFO: usize = 3;

/// Something that has waited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Held {
    /// A data-ready edge of this time, ns.
    Edge(u64),
    /// The frame in this mailbox has gone out.
    Sent(usize, Frame),
    /// A frame has come in.
    Received(Frame),
    /// The controller's error state is another one.
    Changed(ErrorState),
}

/// The standstill under way, if there is one, and what of the last one is still to be looked at.
#[derive(Debug, Default)]
pub(super) struct Standstill {
    until_ns: Option<u64>,
    edge: Option<u64>,
    sent: Vec<(usize, Frame)>,
    asked: Vec<Frame>,
    heard: Vec<Frame>,
    changed: Option<ErrorState>,
    lost: u16,
    held: VecDeque<Held>,
}

/// Whether a frame is one with which a master has to be heard by this node: NMT, LSS, a request of
/// its SDO.
fn is_masters(frame: &Frame, node_id: u8) -> bool {
    let request = 0x600 + u16::from(node_id);
    frame
        .cob_id()
        .is_some_and(|id| [0, 0x7E5, request].contains(&id))
}

impl Standstill {
    /// The processor stands still from now on.
    pub(super) const fn begin(&mut self, until_ns: u64) {
        self.until_ns = Some(until_ns);
    }

    /// When it goes on, ns, while it stands still.
    pub(super) const fn until_ns(&self) -> Option<u64> {
        self.until_ns
    }

    /// True while the node stands still, in which case it gets this later.
    pub(super) fn takes(&mut self, held: Held, node_id: u8) -> bool {
        if self.until_ns.is_none() {
            return false;
        }
        match held {
            Held::Edge(captured_ns) => self.edge = Some(captured_ns),
            Held::Sent(mailbox, frame) => self.sent.push((mailbox, frame)),
            Held::Changed(state) => self.changed = Some(state),
            Held::Received(frame) => {
                let fifo = match is_masters(&frame, node_id) {
                    true => &mut self.asked,
                    false => &mut self.heard,
                };
                match fifo.len() < FIFO {
                    true => fifo.push(frame),
                    false => self.lost += 1,
                }
            }
        }
        true
    }

    /// It goes on: how many frames were lost.
    pub(super) fn end(&mut self) -> u16 {
        self.until_ns = None;
        let held = &mut self.held;
        held.extend(self.edge.take().map(Held::Edge));
        held.extend(self.sent.drain(..).map(|(at, frame)| Held::Sent(at, frame)));
        held.extend(self.asked.drain(..).map(Held::Received));
        held.extend(self.heard.drain(..).map(Held::Received));
        held.extend(self.changed.take().map(Held::Changed));
        std::mem::take(&mut self.lost)
    }

    /// True while the node has still to be told that the frame in this mailbox has gone out.
    pub(super) fn has_sent(&self, mailbox: usize) -> bool {
        let is_it = |held: &Held| matches!(held, Held::Sent(of, _) if *of == mailbox);
        self.held.iter().any(is_it)
    }

    /// The next thing that has waited; nothing while it stands still.
    pub(super) fn next(&mut self) -> Option<Held> {
        match self.until_ns {
            Some(_) => None,
            None => self.held.pop_front(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_frames_of_each_kind_stay_and_the_last_edge() {
        let mut standstill = Standstill::default();
        let received = |id| Held::Received(Frame::data_frame(id, &[]));
        assert!(!standstill.takes(received(0x80), 1));
        standstill.begin(40);
        for id in [0x80, 0x181, 0x601, 0x281, 0x602, 0] {
            assert!(standstill.takes(received(id), 1));
        }
        for edge in [1, 2] {
            assert!(standstill.takes(Held::Edge(edge), 1));
        }
        assert_eq!((standstill.until_ns(), standstill.next()), (Some(40), None));
        assert_eq!(standstill.end(), 1);
        let order: Vec<_> = std::iter::from_fn(|| standstill.next()).collect();
        let expected = [0x601, 0, 0x80, 0x181, 0x281].map(received);
        assert_eq!(order, [&[Held::Edge(2)], &expected[..]].concat());
        assert_eq!(standstill.end(), 0);
    }

    #[test]
    fn what_a_second_standstill_leaves_of_the_first_one_comes_before_its_own() {
        let mut standstill = Standstill::default();
        let received = |id| Held::Received(Frame::data_frame(id, &[]));
        standstill.begin(40);
        standstill.takes(received(0x601), 1);
        standstill.takes(received(0x181), 1);
        standstill.end();
        assert_eq!(standstill.next(), Some(received(0x601)));
        standstill.begin(80);
        assert!(standstill.takes(Held::Edge(60), 1));
        assert_eq!(standstill.next(), None);
        standstill.end();
        assert_eq!(standstill.next(), Some(received(0x181)));
        assert_eq!(standstill.next(), Some(Held::Edge(60)));
    }

    #[test]
    fn a_frame_that_went_out_meanwhile_was_taken_for_one_that_was_given_up() {
        let mut standstill = Standstill::default();
        standstill.begin(40);
        let sent = Held::Sent(1, Frame::data_frame(0x181, &[]));
        assert!(standstill.takes(sent, 1));
        standstill.end();
        assert!(standstill.has_sent(1) && !standstill.has_sent(0));
        assert_eq!(standstill.next(), Some(sent));
        assert!(!standstill.has_sent(1));
    }
}
