//! Frames of several clients, served in turn.
//!
//! In: frames, each with the client that sent it. Out: the clients' frames one by one: each
//! client's in its own order, and one of every client that has some before the second of any. So
//! a client that floods delays itself, and every other client by one frame at most.
//!
//! Left out: how many may wait, which the caller sets.

use std::collections::VecDeque;

use canopen::Frame;

/// One client for as long as it stays; never given twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClientId(pub u32);

/// A frame that a client wants on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Incoming {
    /// Who wants it.
    pub client: ClientId,
    /// What.
    pub frame: Frame,
}

/// What waits of each client. Those who have nothing have no place here.
#[derive(Debug, Default)]
pub struct RoundRobin(VecDeque<(ClientId, VecDeque<Frame>)>);

impl RoundRobin {
    /// How many frames of this client wait.
    pub fn waiting(&self, client: ClientId) -> usize {
        let place = self.0.iter().find(|(other, _)| *other == client);
        place.map_or(0, |(_, frames)| frames.len())
    }

    /// True when nothing waits.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// One more frame, behind all others of its client.
    pub fn push(&mut self, Incoming { client, frame }: Incoming) {
        match self.0.iter_mut().find(|(other, _)| *other == client) {
            Some((_, frames)) => frames.push_back(frame),
            None => self.0.push_back((client, VecDeque::from([frame]))),
        }
    }

    /// Whether a frame waits of a client that is `wanted`.
    pub fn any(&self, mut wanted: impl FnMut(ClientId) -> bool) -> bool {
        self.0.iter().any(|(client, _)| wanted(*client))
    }

    /// The frame whose turn it is, of those clients that are `wanted`.
    pub fn pop(&mut self, mut wanted: impl FnMut(ClientId) -> bool) -> Option<Incoming> {
        let place = self.0.iter().position(|(client, _)| wanted(*client))?;
        let (client, mut frames) = self.0.remove(place)?;
        let frame = frames.pop_front()?;
        if !frames.is_empty() {
            // The next turn is after that of everybody else.
            self.0.push_back((client, frames));
        }
        Some(Incoming { client, frame })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(turns: &mut RoundRobin) -> Vec<u16> {
        let popped = std::iter::from_fn(|| turns.pop(|_| true));
        popped.filter_map(|one| one.frame.cob_id()).collect()
    }

    fn filled(ids: &[(usize, u16)]) -> RoundRobin {
        let clients = [0, 1, 2].map(ClientId);
        let mut turns = RoundRobin::default();
        for (client, id) in ids {
            let frame = Frame::data_frame(*id, &[]);
            let client = clients[*client];
            turns.push(Incoming { client, frame });
        }
        turns
    }

    #[test]
    fn one_of_each_before_the_second_of_any_and_each_in_its_own_order() {
        let mut turns = filled(&[(0, 1), (0, 2), (0, 3), (1, 11), (2, 21), (1, 12)]);
        assert_eq!(frames(&mut turns), [1, 11, 21, 2, 12, 3]);
        assert!(turns.is_empty());
    }

    #[test]
    fn who_comes_late_is_served_after_one_frame_of_whoever_was_there() {
        let [flooder, guest, _] = [0, 1, 2].map(ClientId);
        let mut turns = filled(&[(0, 1); 100]);
        turns.pop(|_| true);
        let frame = Frame::data_frame(9, &[]);
        turns.push(Incoming {
            client: guest,
            frame,
        });
        assert_eq!(frames(&mut turns)[..3], [1, 9, 1]);
        assert_eq!(turns.waiting(flooder), 0);
    }

    #[test]
    fn who_is_not_wanted_keeps_its_place() {
        let [first, second, _] = [0, 1, 2].map(ClientId);
        let mut turns = filled(&[(0, 1), (0, 2), (1, 11)]);
        assert!(!turns.any(|client| client != first && client != second));
        let popped = turns.pop(|client| client == second).map(|one| one.client);
        assert_eq!(popped, Some(second));
        assert_eq!((turns.waiting(first), turns.waiting(second)), (2, 0));
        assert_eq!(frames(&mut turns), [1, 2]);
    }
}
