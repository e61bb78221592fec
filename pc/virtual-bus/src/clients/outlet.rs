//! What waits to be written to one client, bounded.
//!
//! In: answers to the client's commands, and frames of the bus when its channel is open. Out: one
//! run of bytes for a single write, as soon as there is any. Frames that come while a write is
//! under way go out together in the next one. Nobody ever waits here but the client's own writer.
//!
//! Left out: how the bytes travel.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use canopen::Frame;

use can_text::{slcan, socketcand};

use crate::threads::lock;

/// Bytes of frames that may wait for one client: about 20 000 frames.
pub const FRAMES_LIMIT: usize = 1 << 20;

/// Bytes of answers that may wait for one client.
pub const ANSWERS_LIMIT: usize = 1 << 16;

/// The form in which a client gets the frames of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tap {
    /// Not at all: its channel isn't open.
    Closed,
    /// As socketcand text.
    Socketcand,
    /// As SLCAN lines.
    Slcan(slcan::Form),
}

impl Tap {
    fn put(self, out: &mut Vec<u8>, frame: &Frame, time_us: u64) {
        match self {
            Self::Closed => {}
            Self::Socketcand => socketcand::put_frame(out, frame, time_us),
            Self::Slcan(form) => form.put_frame(out, frame, time_us),
        }
    }
}

/// More waits than may wait: the client doesn't read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Full;

/// The queue of one client.
#[derive(Debug)]
pub struct Outlet {
    queue: Mutex<Queue>,
    news: Condvar,
}

#[derive(Debug)]
struct Queue {
    answers: Vec<u8>,
    frames: Vec<u8>,
    tap: Tap,
    held_until: Option<Instant>,
    ended: bool,
    /// Clients that have left, where one follows another on the same line.
    left: u32,
}

impl Queue {
    /// Moves what may go out now to `out`; tells how long the rest is held back.
    fn take(&mut self, out: &mut Vec<u8>) -> Option<Duration> {
        out.append(&mut self.answers);
        if self.frames.is_empty() {
            return None;
        }
        let now = Instant::now();
        let left = self
            .held_until
            .and_then(|at| at.checked_duration_since(now));
        match left.filter(|left| !left.is_zero()) {
            None => {
                self.held_until = None;
                out.append(&mut self.frames);
                None
            }
            left => left,
        }
    }
}

impl Outlet {
    /// An empty queue with the channel closed.
    pub fn new() -> Self {
        Self {
            queue: Mutex::new(Queue {
                answers: Vec::new(),
                frames: Vec::new(),
                tap: Tap::Closed,
                held_until: None,
                ended: false,
                left: 0,
            }),
            news: Condvar::new(),
        }
    }

    fn queue(&self) -> MutexGuard<'_, Queue> {
        lock(&self.queue)
    }

    /// Queues an answer to a command.
    pub fn answer(&self, bytes: &[u8]) -> Result<(), Full> {
        let mut queue = self.queue();
        if queue.answers.len() + bytes.len() > ANSWERS_LIMIT {
            return Err(Full);
        }
        queue.answers.extend_from_slice(bytes);
        self.news.notify_one();
        Ok(())
    }

    /// Opens, changes or closes the flow of frames; the first ones are held back for `hold`.
    pub fn tap(&self, tap: Tap, hold: Duration) {
        let mut queue = self.queue();
        queue.tap = tap;
        queue.held_until = Instant::now().checked_add(hold);
        if tap == Tap::Closed {
            queue.frames.clear();
        }
    }

    /// Holds nothing back any longer.
    pub fn release(&self) {
        let mut queue = self.queue();
        queue.held_until = None;
        self.news.notify_one();
    }

    /// Queues a frame of the bus, when the channel is open.
    pub fn offer(&self, frame: &Frame, time_us: u64) -> Result<(), Full> {
        let mut queue = self.queue();
        let idle = queue.frames.is_empty();
        if queue.frames.len() > FRAMES_LIMIT {
            return Err(Full);
        }
        let tap = queue.tap;
        tap.put(&mut queue.frames, frame, time_us);
        // With bytes waiting the writer is at work or has been called already.
        if idle && !queue.frames.is_empty() {
            self.news.notify_one();
        }
        Ok(())
    }

    /// Bytes of frames that wait.
    pub fn waiting(&self) -> usize {
        self.queue().frames.len()
    }

    /// True while frames flow.
    pub fn is_open(&self) -> bool {
        self.queue().tap != Tap::Closed
    }

    /// Waits for bytes and moves them to `out` (which is emptied first); `None` when the client is
    /// gone and nothing is left for it. Returns how many clients had left when the bytes were
    /// taken, because they are for nobody who comes later.
    pub fn next(&self, out: &mut Vec<u8>) -> Option<u32> {
        out.clear();
        let mut queue = self.queue();
        loop {
            let held = queue.take(out);
            if !out.is_empty() {
                return Some(queue.left);
            }
            if queue.ended {
                return None;
            }
            queue = match held {
                None => self
                    .news
                    .wait(queue)
                    .unwrap_or_else(PoisonError::into_inner),
                Some(left) => {
                    let woken = self.news.wait_timeout(queue, left);
                    woken.unwrap_or_else(PoisonError::into_inner).0
                }
            };
        }
    }

    /// The client has left and another may come: what waits is for nobody, and the channel is
    /// closed. Returns how many have left by now.
    pub fn leave(&self) -> u32 {
        let mut queue = self.queue();
        queue.tap = Tap::Closed;
        queue.answers.clear();
        queue.frames.clear();
        queue.left = queue.left.wrapping_add(1);
        queue.left
    }

    /// Ends the queue: answers that wait still go out, frames don't.
    pub fn end(&self) {
        let mut queue = self.queue();
        queue.ended = true;
        queue.tap = Tap::Closed;
        queue.frames.clear();
        self.news.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(outlet: &Outlet) -> String {
        let mut out = Vec::new();
        outlet.next(&mut out);
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn frames_that_wait_go_out_in_one_write() {
        let outlet = Outlet::new();
        outlet.tap(Tap::Slcan(slcan::Form::default()), Duration::ZERO);
        for _ in 0..3 {
            outlet.offer(&Frame::data_frame(0x80, &[]), 0).unwrap();
        }
        assert_eq!(taken(&outlet), "t0800\rt0800\rt0800\r");
    }

    #[test]
    fn bytes_that_were_taken_before_a_client_left_are_told_from_the_next_ones() {
        let outlet = Outlet::new();
        let mut out = Vec::new();
        outlet.answer(b"\r").unwrap();
        assert_eq!(outlet.next(&mut out), Some(0));
        outlet.answer(b"z\r").unwrap();
        assert_eq!(outlet.leave(), 1);
        outlet.answer(b"\x07").unwrap();
        assert_eq!(outlet.next(&mut out), Some(1));
        assert_eq!(out, b"\x07");
    }

    #[test]
    fn answers_overtake_frames_that_are_held_back() {
        let outlet = Outlet::new();
        let asked = Instant::now();
        // So long that a busy machine takes the answer before the frame goes out.
        let held = Duration::from_secs(4);
        outlet.tap(Tap::Slcan(slcan::Form::default()), held);
        outlet.offer(&Frame::data_frame(0x80, &[]), 0).unwrap();
        outlet.answer(b"\r").unwrap();
        assert_eq!(taken(&outlet), "\r");
        assert_eq!(taken(&outlet), "t0800\r");
        assert!(asked.elapsed() >= held);
    }

    #[test]
    fn frames_that_are_held_back_go_out_when_they_are_released() {
        let outlet = Outlet::new();
        let asked = Instant::now();
        outlet.tap(Tap::Socketcand, Duration::from_secs(600));
        outlet.offer(&Frame::data_frame(0x80, &[]), 0).unwrap();
        std::thread::scope(|scope| {
            let writer = scope.spawn(|| taken(&outlet));
            outlet.release();
            assert_eq!(writer.join().unwrap(), "< frame 080 0.000000  >");
        });
        assert!(asked.elapsed() < Duration::from_secs(60));
    }

    #[test]
    fn a_client_that_reads_nothing_fills_its_queue_and_no_more() {
        let outlet = Outlet::new();
        outlet.tap(Tap::Socketcand, Duration::ZERO);
        let frame = Frame::data_frame(0x181, &[0; 8]);
        let taken = (0..)
            .take_while(|_| outlet.offer(&frame, 0).is_ok())
            .count();
        assert!((10_000..100_000).contains(&taken), "{taken}");
        assert!(outlet.waiting() < FRAMES_LIMIT + 100);
        let answers = (0..).take_while(|_| outlet.answer(b"\r").is_ok()).count();
        assert_eq!(answers, ANSWERS_LIMIT);
    }

    #[test]
    fn the_last_answer_still_goes_out() {
        let outlet = Outlet::new();
        outlet.answer(b"< error >").unwrap();
        outlet.end();
        assert_eq!(taken(&outlet), "< error >");
        assert_eq!(outlet.next(&mut Vec::new()), None);
    }
}
