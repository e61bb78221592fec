//! The product's thresholds for parts that are noisier than the product's.
//!
//! In: the healthy pairs of the first third of a recording. Out: [`Tuned`]: a [`ProductCheck`], and
//! every number of it that isn't the product's, with what was measured. A threshold is raised to
//! [`TIMES_RMS`] times the root mean square of what it judges, and never lowered.

use tilt::ONE_G;
use tilt::chain::Measurement;
use tilt::cross_check::{Latch, ProductCheck, residual};

use super::board::{PAIR_US, Pair};
use crate::recordings::windows::quantile;

/// A threshold is so many times the healthy root mean square. The length of a vector of three
/// equal Gaussians is above 4 times its own once in 10^9 looks; of one axis alone, in 10^4.
pub const TIMES_RMS: f64 = 4.0;

/// The gate of a standstill is so many times the healthy median of what it judges.
pub const TIMES_MEDIAN: f64 = 2.0;

/// How long a finding stays, us: nobody can reset a recording.
pub const LATCH_US: u32 = 1_000_000;

/// One number of the check.
pub struct Changed {
    /// What it is, in words.
    pub what: String,
    /// Its unit.
    pub unit: &'static str,
    /// In the product.
    pub product: f64,
    /// Measured on the healthy pair.
    pub healthy: f64,
    /// Here.
    pub here: f64,
}

/// A check for the parts of a recording.
pub struct Tuned {
    /// The check.
    pub check: ProductCheck,
    /// What differs from the product's, or was looked at and left.
    pub changed: Vec<Changed>,
    /// Combined standard uncertainty of the pair, as the check takes it: median, mg.
    pub uncertainty_mg: f64,
}

/// 2^-26 g as mg.
pub fn mg(steps: f64) -> f64 {
    steps * 1000.0 / f64::from(ONE_G)
}

fn steps(mg: f64) -> u32 {
    (mg / 1000.0 * f64::from(ONE_G)).round() as u32
}

/// The product's check with the product's thresholds, for a recording that nobody resets.
pub fn product() -> ProductCheck {
    ProductCheck {
        latch: Latch::Healthy(LATCH_US),
        ..ProductCheck::PRODUCT
    }
}

/// Scales the product's thresholds by the healthy pairs at standstill.
pub fn tuned(pairs: &[Pair]) -> Tuned {
    let mut tuned = Tuned {
        check: product(),
        changed: Vec::new(),
        uncertainty_mg: median(pairs.iter().filter_map(uncertainty_mg).collect()),
    };
    tuned.scale_residual(pairs);
    tuned.scale_standstill(pairs);
    tuned
}

impl Tuned {
    fn note(&mut self, what: String, unit: &'static str, numbers: [f64; 3]) {
        let [product, healthy, here] = numbers;
        self.changed.push(Changed {
            what,
            unit,
            product,
            healthy,
            here,
        });
    }

    fn scale_residual(&mut self, pairs: &[Pair]) {
        let baseline = mean(pairs);
        for index in 0..residual::STAGES {
            let stage = &mut self.check.residual.stages[index];
            let tau_us = stage.tau_us;
            let numbers = scaled(
                [&mut stage.calm, &mut stage.shaken],
                tau_us,
                pairs,
                baseline,
            );
            let what = format!("difference, low-passed {} s", seconds(tau_us));
            self.note(what, "mg", numbers);
        }
        let residual = &mut self.check.residual;
        let tau_us = residual.whole_us;
        let numbers = scaled([&mut residual.whole], tau_us, pairs, [0.0; 3]);
        let what = format!("whole difference, {} s", seconds(tau_us));
        self.note(what, "mg", numbers);
    }

    fn scale_standstill(&mut self, pairs: &[Pair]) {
        let gate = &mut self.check.movement;
        let blocks: Vec<&[Pair]> = pairs
            .chunks(gate.pairs.into())
            .filter(|block| block.iter().all(|pair| pair.lies))
            .collect();
        let still_mg = mg(f64::from(gate.still));
        let step_mg = step_rms_mg(&blocks);
        let here_mg = still_mg.max(TIMES_RMS * step_mg);
        // What counts as moved is as many times what counts as still as in the product.
        gate.moved = steps(mg(f64::from(gate.moved)) * here_mg / still_mg);
        gate.still = steps(here_mg);
        let calm_mg = mg(f64::from(gate.calm));
        let change_mg = median(blocks.iter().map(|block| change_mg(block)).collect());
        let calm_here_mg = calm_mg.max(TIMES_MEDIAN * change_mg);
        gate.calm = steps(calm_here_mg);
        let what = "standstill: mean of a block against its place";
        self.note(what.to_owned(), "mg", [still_mg, step_mg, here_mg]);
        let what = "standstill: change from pair to pair";
        self.note(what.to_owned(), "mg", [calm_mg, change_mg, calm_here_mg]);
    }
}

fn seconds(us: u32) -> f64 {
    f64::from(us) / 1e6
}

/// Raises the thresholds of one low-pass; what the first was, what the healthy pair has, and what
/// it is.
fn scaled<const N: usize>(
    thresholds: [&mut u32; N],
    tau_us: u32,
    pairs: &[Pair],
    baseline: [f64; 3],
) -> [f64; 3] {
    let rms_mg = low_passed_mg(pairs, seconds(tau_us), baseline);
    let [product_mg, here_mg] = thresholds
        .into_iter()
        .rev()
        .fold([f64::NAN; 2], |_, threshold| {
            let product_mg = mg(f64::from(*threshold));
            let here_mg = product_mg.max(TIMES_RMS * rms_mg);
            *threshold = steps(here_mg);
            [product_mg, here_mg]
        });
    [product_mg, rms_mg, here_mg]
}

/// Own minus peer, mg.
fn difference(pair: &Pair) -> Option<[f64; 3]> {
    let (a, b) = (pair.own.vector?.accel, pair.peer.vector?.accel);
    let of = |i: usize| mg(f64::from(a[i]) - f64::from(b[i]));
    Some([of(0), of(1), of(2)])
}

/// Root mean square length of the difference, mg.
pub fn rms_mg<'a>(pairs: impl Iterator<Item = &'a Pair>) -> f64 {
    let squares = |d: [f64; 3]| d.iter().map(|c| c * c).sum::<f64>();
    let all: Vec<f64> = pairs.filter_map(difference).map(squares).collect();
    (all.iter().sum::<f64>() / all.len().max(1) as f64).sqrt()
}

/// Combined uncertainty of what the channels of a pair don't share, of the surer slope, mg.
fn uncertainty_mg(pair: &Pair) -> Option<f64> {
    let (own, peer) = (pair.own.reading, pair.peer.reading);
    let of = |a: Measurement, b: Measurement| a.unshared.combined_with(b.unshared).degrees();
    let (x, y) = (of(own.x.ok()?, peer.x.ok()?), of(own.y.ok()?, peer.y.ok()?));
    Some(1000.0 * x.min(y).to_radians())
}

fn mean(pairs: &[Pair]) -> [f64; 3] {
    let still = pairs.iter().filter(|pair| pair.lies);
    let all: Vec<[f64; 3]> = still.filter_map(difference).collect();
    [0, 1, 2].map(|i| all.iter().map(|d| d[i]).sum::<f64>() / all.len().max(1) as f64)
}

/// Root mean square length of the difference behind one pole, over the standstills.
fn low_passed_mg(pairs: &[Pair], tau_s: f64, baseline: [f64; 3]) -> f64 {
    let step_s = PAIR_US as f64 / 1e6;
    let share = step_s / (step_s + tau_s);
    let (mut low, mut squares, mut count) = ([0.0; 3], 0.0, 0);
    for pair in pairs {
        let Some(now) = difference(pair) else {
            continue;
        };
        low = [0, 1, 2].map(|i| low[i] + share * (now[i] - baseline[i] - low[i]));
        if pair.lies {
            squares += low.iter().map(|l| l * l).sum::<f64>();
            count += 1;
        }
    }
    (squares / f64::from(count.max(1))).sqrt()
}

fn vectors_mg(pair: &Pair) -> [[f64; 3]; 2] {
    [pair.own.vector, pair.peer.vector]
        .map(|vector| vector.map_or([0.0; 3], |v| v.accel.map(|c| mg(f64::from(c)))))
}

/// How far the mean of a block is from that of the block before, root mean square over the axes of
/// both channels; a place moves less than a block.
fn step_rms_mg(blocks: &[&[Pair]]) -> f64 {
    let mean = |block: &&[Pair]| -> [f64; 6] {
        let vectors = block.iter().map(vectors_mg);
        let sum = vectors.fold([0.0; 6], |sum, vectors| {
            let all = vectors.as_flattened();
            std::array::from_fn(|i| sum[i] + all[i])
        });
        sum.map(|sum| sum / block.len() as f64)
    };
    let means: Vec<[f64; 6]> = blocks.iter().map(mean).collect();
    // From one rest to the next the board was turned.
    let steps = means
        .windows(2)
        .flat_map(|w| (0..6).map(|i| w[1][i] - w[0][i]));
    let steps: Vec<f64> = steps.filter(|step| step.abs() < 10.0).collect();
    (steps.iter().map(|step| step * step).sum::<f64>() / steps.len().max(1) as f64).sqrt()
}

/// The mean change from pair to pair of the axis that changes most.
fn change_mg(block: &[Pair]) -> f64 {
    let vectors: Vec<[[f64; 3]; 2]> = block.iter().map(vectors_mg).collect();
    let of = |channel: usize, axis: usize| {
        let changes = vectors.windows(2);
        let all = changes.map(|w| (w[1][channel][axis] - w[0][channel][axis]).abs());
        all.sum::<f64>() / block.len() as f64
    };
    let axes = (0..6).map(|i| of(i / 3, i % 3));
    axes.fold(0.0, f64::max)
}

fn median(values: Vec<f64>) -> f64 {
    quantile(values, 0.5).unwrap_or(0.0)
}
