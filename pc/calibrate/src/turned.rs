//! What a gyroscope has measured between two looks at its node, and what spoils it.
//!
//! In: 2034h sub 5 of a node, again and again: its samples and the sums of its rate, which wrap.
//! Out: a [`Log`] of [`Step`]s without a loss, or with the reason where there is one. As sums are
//! read and no samples, nothing is missed between two looks and nothing aliases.
//!
//! A turn needs each of its steps. A rest needs a mean: a look that comes too late leaves out its
//! own step, and as a housing at rest has a small rate, a look comes too late much later.
//!
//! Left out: the bus (`session`), and what the steps are for (`gains`).

use device::objects::moment::SUM_STEP;

/// Samples between two looks beyond which the sums may have wrapped unseen: 0.24 s. At the end of
/// the part's range, 573 deg/s, that is half of what they wrap in.
pub const FARTHEST: u16 = 100;

/// The same at a rest: 4.6 s. The sums wrap unseen from 1024 rad/s times a sample on, which is
/// [`AT_REST`] for 1955 samples.
const FARTHEST_AT_REST: u16 = 1900;

/// The largest rate of a step at rest that is longer than [`FARTHEST`], rad/s: 30 deg/s. The bias
/// of a part in order is below 20 deg/s.
const AT_REST: f64 = std::f64::consts::FRAC_PI_6;

/// Fewest samples of the mean of a rest: 0.12 s, which leaves 0.01 deg/s of noise of 5 mdps.
const FEWEST_AT_REST: f64 = 50.0;

/// Mean rate of a step that is too near the end of the range of 500 deg/s, rad/s: 450 deg/s.
const LARGEST: f64 = 7.854;

/// Why a turn comes to nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Spoilt {
    /// The node was not looked at for too long, or has begun anew.
    #[error("the bus was too slow to follow it, or its node has begun anew")]
    Unfollowed,
    /// The node itself has missed samples.
    #[error("the node has missed samples of its sensor")]
    Gap,
    /// Too fast for the gyroscope.
    #[error("it was faster than the 450 deg/s that can be measured")]
    OverRange,
    /// The node's gyroscope gives no samples.
    #[error("the gyroscope gives no samples")]
    Silent,
}

/// What was measured between two looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Samples; at least one.
    pub samples: u16,
    /// Their sum along the sensor's axes, rad/s.
    pub sum: [f64; 3],
}

impl Step {
    fn is_within(&self, largest: f64) -> bool {
        let largest = largest * f64::from(self.samples) + SUM_STEP;
        self.sum.iter().all(|sum| sum.abs() <= largest)
    }

    /// As a part of a turn.
    fn of_turn(self) -> Result<Self, Spoilt> {
        match self.samples {
            1..=FARTHEST if self.is_within(LARGEST) => Ok(self),
            1..=FARTHEST => Err(Spoilt::OverRange),
            _ => Err(Spoilt::Unfollowed),
        }
    }

    /// As a part of a rest.
    fn of_rest(self) -> Result<Self, Spoilt> {
        match self.samples {
            ..=FARTHEST => self.of_turn(),
            ..=FARTHEST_AT_REST if self.is_within(AT_REST) => Ok(self),
            _ => Err(Spoilt::Unfollowed),
        }
    }
}

/// All that was measured since one has begun to follow.
#[derive(Clone, Debug, Default)]
pub struct Log {
    last: Option<(u16, [i16; 3])>,
    steps: Vec<Step>,
}

impl Log {
    /// Takes 2034h sub 5.
    pub fn take(&mut self, [n0, n1, x0, x1, y0, y1, z0, z1]: [u8; 8]) {
        let samples = u16::from_le_bytes([n0, n1]);
        let sums = [[x0, x1], [y0, y1], [z0, z1]].map(i16::from_le_bytes);
        let Some((before, from)) = self.last.replace((samples, sums)) else {
            return;
        };
        let samples = samples.wrapping_sub(before);
        if samples > 0 {
            let axis = |axis: usize| f64::from(sums[axis].wrapping_sub(from[axis])) * SUM_STEP;
            let sum = [0, 1, 2].map(axis);
            self.steps.push(Step { samples, sum });
        }
    }

    /// Where one is: the number of steps so far.
    pub fn mark(&self) -> usize {
        self.steps.len()
    }

    /// The mean rate of a rest between two marks, rad/s: of the samples of all steps that were
    /// followed.
    ///
    /// Errors: [`Spoilt::OverRange`], [`Spoilt::Silent`] without a sample, and
    /// [`Spoilt::Unfollowed`] where fewer than 50 samples are left.
    pub fn rest(&self, from: usize, to: usize) -> Result<[f64; 3], Spoilt> {
        let all = self.steps.get(from..to.max(from)).unwrap_or(&[]);
        let (mut count, mut sum) = (0.0, [0.0; 3]);
        for step in all {
            let step = match step.of_rest() {
                Ok(step) => step,
                Err(Spoilt::Unfollowed) => continue,
                Err(spoilt) => return Err(spoilt),
            };
            count += f64::from(step.samples);
            sum = [0, 1, 2].map(|axis| sum[axis] + step.sum[axis]);
        }
        match () {
            () if all.is_empty() => Err(Spoilt::Silent),
            () if count < FEWEST_AT_REST => Err(Spoilt::Unfollowed),
            () => Ok(sum.map(|sum| sum / count)),
        }
    }

    /// The steps of a turn between two marks.
    ///
    /// Errors: the first thing that spoils them.
    pub fn between(&self, from: usize, to: usize) -> Result<Vec<Step>, Spoilt> {
        let steps = self.steps.get(from..to.max(from)).unwrap_or(&[]);
        steps.iter().map(|step| step.of_turn()).collect()
    }
}

#[cfg(test)]
impl Log {
    /// The log of a gyroscope that measures another sum.
    pub fn changed(&self, sum: &dyn Fn([f64; 3]) -> [f64; 3]) -> Self {
        let change = |step: &Step| Step {
            sum: sum(step.sum),
            ..*step
        };
        Self {
            last: self.last,
            steps: self.steps.iter().map(change).collect(),
        }
    }
}

#[cfg(test)]
pub mod made {
    use super::*;

    /// 2034h sub 5 behind so many samples with these sums, rad/s.
    pub fn snapshot(samples: u64, sums: [f64; 3]) -> [u8; 8] {
        let [n0, n1, ..] = samples.to_le_bytes();
        let steps = sums.map(|sum| ((sum / SUM_STEP).floor() as i64).to_le_bytes());
        let [[x0, x1, ..], [y0, y1, ..], [z0, z1, ..]] = steps;
        [n0, n1, x0, x1, y0, y1, z0, z1]
    }
}

#[cfg(test)]
mod tests {
    use super::made::snapshot;
    use super::*;

    #[test]
    fn sums_that_wrap_lose_nothing_however_uneven_the_looks_are() {
        let mut log = Log::default();
        let mut samples = 65_000_u64;
        let rate = [7.5, -7.5, 0.011];
        for look in 0..2000_u64 {
            samples += look % 97;
            log.take(snapshot(samples, rate.map(|rate| rate * samples as f64)));
        }
        let steps = log.between(0, log.mark()).unwrap();
        let count: u64 = steps.iter().map(|step| u64::from(step.samples)).sum();
        for (axis, rate) in rate.iter().enumerate() {
            let sum: f64 = steps.iter().map(|step| step.sum[axis]).sum();
            assert!((sum - rate * count as f64).abs() <= SUM_STEP, "{sum}");
        }
        assert!(count > 90_000, "{count}");
    }

    #[test]
    fn looks_too_far_apart_and_rates_too_large_spoil_their_own_time_only() {
        let mut log = Log::default();
        let all = [
            (0, 0.0),
            (100, 1.0),
            (201, 2.0),
            (211, 2.0),
            (212, 12.0),
            (213, 12.0),
        ];
        for (samples, sum) in all {
            log.take(snapshot(samples, [sum, 0.0, 0.0]));
        }
        assert_eq!(log.between(0, 1).unwrap().len(), 1);
        assert_eq!(log.between(0, 2), Err(Spoilt::Unfollowed));
        assert_eq!(log.between(2, 5), Err(Spoilt::OverRange));
        assert_eq!(log.between(4, 5).unwrap().len(), 1);
        // A node that has begun anew counts from 0.
        log.take(snapshot(5, [0.0; 3]));
        assert_eq!(log.between(5, 6), Err(Spoilt::Unfollowed));
    }

    #[test]
    fn a_late_look_spoils_a_turn_but_leaves_a_rest_its_mean() {
        let mut log = Log::default();
        let rate = [0.3, -0.02, 0.001];
        let looks = [0, 10, 1900, 1910, 6000, 6060_u64];
        for samples in looks {
            log.take(snapshot(samples, rate.map(|rate| rate * samples as f64)));
        }
        // 1890 samples at a small rate count, 4090 do not: the sum of x has wrapped meanwhile.
        assert_eq!(log.between(0, 2), Err(Spoilt::Unfollowed));
        assert!(log.steps[3].sum[0] < 0.0);
        for (mean, rate) in log.rest(0, 5).unwrap().into_iter().zip(rate) {
            assert!((mean - rate).abs() < 2.0 * SUM_STEP / 1900.0, "{mean}");
        }
        // Too little, nothing, and no rest at all.
        assert_eq!(log.rest(2, 4), Err(Spoilt::Unfollowed));
        assert_eq!(log.rest(5, 5), Err(Spoilt::Silent));
        log.take(snapshot(6061, [2000.0, 0.0, 0.0]));
        assert_eq!(log.rest(0, 6), Err(Spoilt::OverRange));
    }
}
