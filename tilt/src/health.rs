//! One channel watched sample by sample: codes that stand still, and noise that is not its own.
//!
//! In: the [`Counts`] of every sample, before the low-pass. Out: whether the codes are
//! [stuck](Health::stuck), and once per look an [`Activity`], the energy above 150 Hz against the
//! unit's own noise. Stuck codes name the channel by themselves; an activity does so unless the
//! other channel's is raised too.
//!
//! # Stuck
//! White noise of several steps hardly ever gives the same code many times running. The
//! probability of n identical codes is the sum over all codes of p^n, not the probability of one
//! repeat to the power n - 1: the likeliest code carries most of it, and that is 13 times more at
//! n = 12. How many are needed is computed from the noise, so that a healthy part comes to less
//! than 1e-13 per sample (one in 790 years at 400 samples/s). At 400 samples/s and 1.27 mg that
//! is 5 identical codes of all three axes (12.5 ms) or 13 of any one (32.5 ms); at 50 samples/s
//! and 0.45 mg it is 8 (160 ms) and 21 (420 ms). A part with less than 0.4 steps of noise stands
//! still by right, and is never called stuck.
//!
//! # Activity
//! A machine shakes below 100 Hz; above 150 Hz there is the part's noise and little else. A
//! high-pass of nine integer taps, (1 - z)^4 (8 - 5 z + 8 z^2)^2, has a fourfold zero at DC and a
//! double one near 80 Hz, where engines sit: -56 dB at 88 Hz, -64 dB at 72 Hz and -70 dB at 25 Hz
//! against its top at 200 Hz (all at 400 samples/s; at other rates the frequencies go along).
//! A shock rings at 30 to 60 Hz but begins suddenly: one of 3 g at 45 Hz gives 300 to 9000 times
//! the noise's energy in the eight samples of its onset. Both channels feel it alike, so whoever
//! judges an activity has to compare the two.
//!
//! Left out: the judgement, which needs the other channel (`cross_check`); parts with codes
//! coarser than 14 bits, whose repeats are likelier than assumed here; noise that is not white up
//! to half the rate, whose level above 150 Hz is not the one in the budget.

use crate::root::root;
use crate::sample::{Counts, FullScale};

/// Taps of the high-pass; symmetric, so the group delay is 4 samples.
const TAPS: [i64; 9] = [64, -336, 857, -1428, 1686, -1428, 857, -336, 64];

/// Samples after a start whose output still contains what was not measured.
const WARM_UP: u8 = 8;

/// Sum of the squared taps: energy of the output for white noise of variance 1.
const POWER: u64 = {
    let mut sum = 0;
    let mut at = 0;
    while at < TAPS.len() {
        sum += TAPS[at] * TAPS[at];
        at += 1;
    }
    sum.unsigned_abs()
};

/// Fewest repeats that count, however large the noise: four identical codes.
const LEAST_REPEATS: u8 = 3;

/// More repeats than are ever counted: a part that may stand still.
const NEVER: u8 = u8::MAX;

/// Samples of one window at least: 8 scatter by 2.4 dB, and one alone by 4.2.
const SHORTEST: u16 = 6;

/// Samples of one window at most; a longer one forgets its older half.
const LONGEST: u16 = 1024;

/// What is expected of one channel: how often its codes repeat, and how strong its noise is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Health {
    /// Repeats of all three codes at once that no healthy part makes.
    repeats_all: u8,
    /// Repeats of one axis' code that no healthy part makes.
    repeats_axis: u8,
    /// log2 of the energy per sample of the unit's own noise, three axes, in 1/256.
    level_q8: i32,
}

/// What watching remembers between samples. The default is that of a start.
#[derive(Clone, Debug, Default)]
pub struct HealthState {
    axes: [Axis; 3],
    /// Samples since the start, up to [`WARM_UP`].
    warm: u8,
    /// Energy and samples since the last look.
    energy: u64,
    samples: u16,
    /// Some of what there was since the last look is not in them.
    gap: bool,
}

/// One axis' memory.
#[derive(Clone, Debug)]
struct Axis {
    code: i16,
    /// How often `code` has repeated, up to 254.
    repeats: u8,
    high_pass: HighPass,
}

/// The high-pass: four differences one after the other, then five taps in transposed form, which
/// keeps sums instead of samples and so needs no ring.
#[derive(Clone, Copy, Debug, Default)]
struct HighPass {
    before: [i32; 4],
    sums: [i32; 4],
}

/// Energy above 150 Hz since the last look, against the unit's own noise.
///
/// In eighths of an octave of energy (0.376 dB): 64 is the own noise, 72 twice its energy, 89
/// three times its amplitude, 254 the most. 1 is the least, 2^-7.9; 0 means that there have
/// been too few samples to judge by, 255 that some are missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Activity(pub u8);

impl Activity {
    /// Too few samples since the last look.
    pub const NONE: Self = Self(0);

    /// The unit's own noise.
    pub const OWN: Self = Self(64);

    /// Samples are missing since the last look: what the others have heard may be in those.
    pub const GAP: Self = Self(255);

    /// The energy as a ratio to the own noise's, in 1/256: 256 at [`Activity::OWN`], 2^31.9 at
    /// most. [`Activity::NONE`] gives 0.
    pub const fn energy_q8(self) -> u32 {
        /// 2^(k/8) in 1/32768.
        const ROOTS: [u32; 8] = [
            32_768, 35_734, 38_968, 42_495, 46_341, 50_535, 55_109, 60_097,
        ];
        if self.0 == 0 {
            return 0;
        }
        let root = ROOTS[(self.0 % 8) as usize] as u64;
        // At 1/32768 the sum is rounded; 2^31.9 is the largest, so nothing is cut.
        (((root << (self.0 / 8)) + (1 << 14)) >> 15) as u32
    }

    /// The activity of so much energy in so many samples, where a sample of the own noise has
    /// log2 `level_q8`, in 1/256. No samples count as one.
    pub(crate) fn of_energy(energy: u64, samples: u16, level_q8: i32) -> Self {
        if energy == 0 {
            return Self(1);
        }
        Self::from_octaves(log2_q8(energy) - log2_q8(u64::from(samples.max(1))) - level_q8)
    }

    /// The nearest activity to 2^(`octaves_q8` / 256) times the own noise's energy.
    const fn from_octaves(octaves_q8: i32) -> Self {
        let steps = Self::OWN.0 as i32 + ((octaves_q8 + 16) >> 5);
        if steps < 1 {
            Self(1)
        } else if steps > 254 {
            Self(254)
        } else {
            Self(steps as u8)
        }
    }
}

impl Health {
    /// What to expect of a part with 14-bit codes.
    ///
    /// `noise` is the standard deviation of a single sample of one axis in 2^-26 g per step, as
    /// [`Budget::noise`](crate::uncertainty::Budget::noise) has it; more than 0.5 g counts as
    /// 0.5 g. 0 means unknown and takes the LIS2DW12's data sheet: 90 ug/rtHz up to half the rate.
    /// `period_us` is the nominal time between samples.
    pub const fn new(noise: u32, full_scale: FullScale, period_us: u32) -> Self {
        let variance_q16 = variance(noise, full_scale, period_us);
        // Rounding to steps adds a twelfth of a step squared.
        let energy_q16 = 3 * POWER * (variance_q16 + 65_536 / 12);
        Self {
            repeats_all: repeats(variance_q16, true),
            repeats_axis: repeats(variance_q16, false),
            level_q8: log2_q8(energy_q16) - (16 << 8),
        }
    }

    /// Takes in one sample.
    pub fn sample(&self, state: &mut HealthState, counts: Counts) {
        let Counts([x, y, z]) = counts;
        let [of_x, of_y, of_z] = &mut state.axes;
        let energy = of_x.take_in(x) + of_y.take_in(y) + of_z.take_in(z);
        if state.warm < WARM_UP {
            state.warm += 1;
            return;
        }
        // 1024 times 3 (7056 * 8192)^2 is under 2^64.
        state.energy += energy;
        state.samples += 1;
        if state.samples >= LONGEST {
            state.energy /= 2;
            state.samples /= 2;
        }
    }

    /// Marks that samples are missing before the next one: the high-pass starts anew, and the next
    /// eight samples add nothing to the activity.
    ///
    /// Repeats count on: a code is no likelier to come back after a gap than without one.
    pub fn restart(&self, state: &mut HealthState) {
        state.warm = 0;
        state.gap = true;
    }

    /// Whether the codes have stood still for longer than a healthy part's ever do.
    ///
    /// Holds until a code differs. A code at full scale shows nothing: it is clipped, not stuck.
    pub fn stuck(&self, state: &HealthState) -> bool {
        let [x, y, z] = &state.axes;
        if x.repeats | y.repeats | z.repeats < LEAST_REPEATS {
            // None of them is as large as that, nor as what counts.
            return false;
        }
        let least = x.repeats.min(y.repeats).min(z.repeats);
        let most = x.repeats.max(y.repeats).max(z.repeats);
        least >= self.repeats_all || most >= self.repeats_axis
    }

    /// The activity since the last time this gave one; of the newest 512 to 1023 samples, if that
    /// is longer ago.
    ///
    /// Fewer than six samples give [`Activity::NONE`] and are kept for the next look, as in paper
    /// mode, where each look brings one. A look with a gap in it gives [`Activity::GAP`], and so
    /// does the one after it as long as the high-pass starts.
    pub fn take_activity(&self, state: &mut HealthState) -> Activity {
        if state.gap {
            state.gap = state.warm < WARM_UP;
            (state.energy, state.samples) = (0, 0);
            return Activity::GAP;
        }
        if state.samples < SHORTEST {
            return Activity::NONE;
        }
        let energy = core::mem::take(&mut state.energy);
        let samples = core::mem::take(&mut state.samples);
        Activity::of_energy(energy, samples, self.level_q8)
    }
}

impl Default for Axis {
    fn default() -> Self {
        Self {
            // A clipped code: whatever comes first is no repeat.
            code: i16::MIN,
            repeats: 0,
            high_pass: HighPass::default(),
        }
    }
}

impl Axis {
    /// Energy of the high-pass's output for the next code.
    fn take_in(&mut self, code: i16) -> u64 {
        self.note(code);
        let high = i64::from(self.high_pass.step(i32::from(code >> 2)));
        (high * high) as u64
    }

    fn note(&mut self, code: i16) {
        /// From the code below the top one of a 12-bit left-justified reading to its negative;
        /// 14-bit readings clip outside as well. Counted from the lowest.
        const INSIDE: u16 = 2 * 32_751;
        let clipped = code.wrapping_add(32_751) as u16 > INSIDE;
        self.repeats = if code != self.code || clipped {
            0
        } else {
            self.repeats + u8::from(self.repeats < NEVER - 1)
        };
        self.code = code;
    }
}

impl HighPass {
    /// Takes in a code of 14 bits; the output is at most 7056 times as large (sum of all taps'
    /// sizes), so that nothing overflows.
    fn step(&mut self, input: i32) -> i32 {
        let [b0, b1, b2, b3] = self.before;
        let d1 = input - b0;
        let d2 = d1 - b1;
        let d3 = d2 - b2;
        let d4 = d3 - b3;
        self.before = [input, d1, d2, d3];
        let [s1, s2, s3, s4] = self.sums;
        let (outer, inner) = (64 * d4, 80 * d4);
        self.sums = [s2 - inner, s3 + 153 * d4, s4 - inner, outer];
        s1 + outer
    }
}

/// The data sheet's white noise of one axis, 2^-26 g, for samples so many microseconds apart:
/// 90 ug/rtHz up to half the rate (LIS2DW12, table 3, high performance, low noise).
pub const fn noise(period_us: u32) -> u32 {
    root(data_sheet(period_us))
}

/// Its variance in 2^-52 g^2.
const fn data_sheet(period_us: u32) -> u64 {
    /// (90e-6 * 2^26)^2 / 2 * 1e6, for one microsecond.
    const ONE_US: u64 = 18_239_578_000_000;
    ONE_US / if period_us == 0 { 1 } else { period_us as u64 }
}

/// The noise's variance in steps of 14 bits squared, 1/65536.
const fn variance(noise: u32, full_scale: FullScale, period_us: u32) -> u64 {
    const MOST: u32 = crate::ONE_G as u32 / 2;
    let square = if noise == 0 {
        data_sheet(period_us)
    } else {
        let noise = if noise < MOST { noise } else { MOST } as u64;
        noise * noise
    };
    // A step is 4 counts, 2^14 at +-2 g.
    square >> (2 * (14 + full_scale.log2()) - 16)
}

/// How many repeats a healthy part makes with less than 1e-13 per sample, in all axes at once
/// (`all`) or in any of the three.
///
/// n codes of noise s (in steps) are identical with the sum over k of p_k^n. No p_k is above
/// q = 1 / (s sqrt(2 pi)), and p_k^n falls off as a Gauss curve of width s / sqrt(n), so the sum
/// is below q^n (1 + s sqrt(2 pi / n)) wherever the mean lies between two codes.
const fn repeats(variance_q16: u64, all: bool) -> u8 {
    /// -log2(1e-13) = 43.185, log2(3) and log2(sqrt(2 pi)) in 1/256, each to the safe side.
    const SELDOM: i32 = 11_056;
    const ANY_OF_THREE: i32 = 406;
    const ROOT_TWO_PI: i32 = 339;
    if variance_q16 == 0 {
        return NEVER;
    }
    let bits = (log2_q8(variance_q16) - (16 << 8)) / 2 + ROOT_TWO_PI;
    let mut last = LEAST_REPEATS;
    while last < NEVER {
        let codes = last as i32 + 1;
        let width_q8 = root(variance_q16 * 6434 / (1024 * codes as u64)) as u64;
        let sum = log2_q8(257 + width_q8) + 1 - (8 << 8);
        let one = codes * bits - sum;
        let evidence = if all { 3 * one } else { one - ANY_OF_THREE };
        if evidence >= SELDOM {
            return last;
        }
        last += 1;
    }
    NEVER
}

/// log2 in 1/256, rounded down; 0 for 0.
pub(crate) const fn log2_q8(value: u64) -> i32 {
    let zeros = value.leading_zeros();
    if zeros > 63 {
        return 0;
    }
    let mut bits = 63 - zeros as i32;
    // 1 to 2 in 2^-31. Squaring doubles the logarithm, whose next bit is whether 2 is passed.
    let mut mantissa = ((value << zeros) >> 32) as u32;
    let mut left = 8;
    while left > 0 {
        // 1 to 4 in 2^-62.
        let square = mantissa as u64 * mantissa as u64;
        let high = (square >> 32) as u32;
        let carry = high >> 31;
        mantissa = match carry {
            0 => high << 1 | square as u32 >> 31,
            _ => high,
        };
        bits = 2 * bits + carry as i32;
        left -= 1;
    }
    bits
}

#[cfg(test)]
mod tests;
