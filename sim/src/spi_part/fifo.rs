//! A FIFO of samples, oldest first.
//!
//! In: a sample per conversion. Out: the oldest one per read, the level and whether samples were
//! lost. A ring in place; nothing is allocated.

/// What the FIFO does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FifoMode {
    /// Off.
    #[default]
    Bypass,
    /// Stops when full.
    StopWhenFull,
    /// The oldest sample gives way.
    Continuous,
}

/// The ring of samples.
#[derive(Clone, Debug)]
pub struct Fifo<T, const DEPTH: usize> {
    levels: [T; DEPTH],
    oldest: usize,
    count: usize,
    overrun: bool,
}

impl<T: Copy + Default, const DEPTH: usize> Default for Fifo<T, DEPTH> {
    fn default() -> Self {
        Self {
            levels: [T::default(); DEPTH],
            oldest: 0,
            count: 0,
            overrun: false,
        }
    }
}

impl<T: Copy, const DEPTH: usize> Fifo<T, DEPTH> {
    /// Samples waiting, 0 to its depth.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Whether a sample was lost since the last one was taken.
    pub fn overrun(&self) -> bool {
        self.overrun
    }

    /// Empties it.
    pub fn clear(&mut self) {
        self.oldest = 0;
        self.count = 0;
        self.overrun = false;
    }

    /// Adds the newest sample, or loses one when full: this one or the oldest, by the mode.
    pub fn push(&mut self, mode: FifoMode, sample: T) {
        if self.count < DEPTH {
            self.levels[(self.oldest + self.count) % DEPTH] = sample;
            self.count += 1;
            return;
        }
        self.overrun = true;
        if mode == FifoMode::Continuous {
            self.levels[self.oldest % DEPTH] = sample;
            self.oldest = (self.oldest + 1) % DEPTH;
        }
    }

    /// Takes the oldest sample.
    pub fn pop(&mut self) -> Option<T> {
        if self.count == 0 {
            return None;
        }
        let sample = self.levels[self.oldest % DEPTH];
        self.oldest = (self.oldest + 1) % DEPTH;
        self.count -= 1;
        self.overrun = false;
        Some(sample)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(mode: FifoMode, samples: u8) -> Fifo<[u8; 6], 32> {
        let mut fifo = Fifo::default();
        for value in 0..samples {
            fifo.push(mode, [value; 6]);
        }
        fifo
    }

    #[test]
    fn a_full_fifo_stops_or_forgets_the_oldest() {
        let mut stopped = filled(FifoMode::StopWhenFull, 35);
        let mut continuous = filled(FifoMode::Continuous, 35);
        assert!(stopped.overrun() && continuous.overrun());
        assert_eq!(stopped.pop(), Some([0; 6]));
        assert_eq!(continuous.pop(), Some([3; 6]));
        assert!(!continuous.overrun());
        let last = std::iter::from_fn(|| continuous.pop()).last();
        assert_eq!(last, Some([34; 6]));
    }

    #[test]
    fn thirty_two_samples_are_no_overrun() {
        let mut fifo = filled(FifoMode::Continuous, 32);
        assert!(!fifo.overrun());
        assert_eq!(fifo.count(), 32);
        fifo.clear();
        assert_eq!(fifo.pop(), None);
    }
}
