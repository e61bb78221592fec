//! The one source of chance: a seed and a label in, independent streams of numbers out.
//!
//! In: the seed of a world (any `u64`) and the label of the part that draws ("node 1 part",
//! "supply"). Out: uniform and standard normal `f64` numbers. Two labels give streams that have
//! nothing to do with each other, so a part that draws one number more does not change the fate
//! of the others. Left out: anything secret; these numbers can be foretold.
//!
//! ```
//! use sim::rng::Rng;
//! let mut node_1 = Rng::stream(7, "node 1");
//! let mut node_2 = Rng::stream(7, "node 2");
//! assert_ne!(node_1.normal(), node_2.normal());
//! assert_eq!(Rng::stream(7, "node 1"), Rng::stream(7, "node 1"));
//! ```

use rand_core::{Rng as _, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// A stream of random numbers; a clone repeats what its original will draw.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rng(Xoshiro256PlusPlus);

impl Rng {
    /// The stream that belongs to this seed and this label.
    pub fn stream(seed: u64, label: &str) -> Rng {
        Rng(Xoshiro256PlusPlus::seed_from_u64(mix(seed) ^ fnv_1a(label)))
    }

    /// A new stream that starts from a number drawn here; this stream moves on by that number.
    pub fn fork(&mut self) -> Rng {
        Rng(Xoshiro256PlusPlus::seed_from_u64(self.0.next_u64()))
    }

    /// A draw from the normal distribution with mean 0 and standard deviation 1.
    #[inline]
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Three independent draws of [`Rng::normal`], one for each axis.
    #[inline]
    pub fn normals(&mut self) -> [f64; 3] {
        [self.normal(), self.normal(), self.normal()]
    }

    /// A draw from [0, 1), in steps of 2^-53.
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        const STEP: f64 = 1.0 / (1u64 << 53) as f64;
        (self.0.next_u64() >> 11) as f64 * STEP
    }

    /// A draw from [low, high), each value as likely as any other.
    #[inline]
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// +1 or -1, each half of the time.
    #[inline]
    pub fn sign(&mut self) -> f64 {
        if self.0.next_u64() >> 63 == 0 {
            1.0
        } else {
            -1.0
        }
    }

    /// A direction in space, all directions alike; its length is 1.
    pub fn direction(&mut self) -> [f64; 3] {
        loop {
            let v = self.normals();
            let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
            // Dividing by a length near zero would only magnify rounding: draw again.
            if length > 1e-6 {
                return v.map(|c| c / length);
            }
        }
    }
}

/// FNV-1a of a label, 64 bit.
fn fnv_1a(label: &str) -> u64 {
    label.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// The output function of SplitMix64: neighbouring seeds end far apart.
fn mix(seed: u64) -> u64 {
    let z = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_seed_and_label_give_the_same_bits() {
        let (mut a, mut b) = (Rng::stream(3, "motor"), Rng::stream(3, "motor"));
        assert!((0..1000).all(|_| a.normal().to_bits() == b.normal().to_bits()));
    }

    #[test]
    fn labels_and_seeds_part_the_streams() {
        let n = 20_000;
        for (seed, label) in [(3, "motor 2"), (4, "motor")] {
            let (mut a, mut b) = (Rng::stream(3, "motor"), Rng::stream(seed, label));
            let product: f64 = (0..n).map(|_| a.normal() * b.normal()).sum();
            assert!((product / f64::from(n)).abs() < 0.03, "{seed} {label}");
        }
    }

    #[test]
    fn a_fork_does_not_repeat_its_parent() {
        let mut parent = Rng::stream(1, "x");
        let mut child = parent.fork();
        assert_ne!(parent, child);
        assert_ne!(parent.uniform(), child.uniform());
    }

    #[test]
    fn moments_are_those_of_the_distributions() {
        let mut rng = Rng::stream(1, "moments");
        let n = 100_000;
        let mut sums = [0.0; 5];
        for _ in 0..n {
            let (g, u, s) = (rng.normal(), rng.range(-2.0, 4.0), rng.sign());
            assert!((-2.0..4.0).contains(&u));
            assert!(s.abs() == 1.0);
            let terms = [g, g * g, g * g * g * g, u, s];
            sums.iter_mut()
                .zip(terms)
                .for_each(|(sum, term)| *sum += term / f64::from(n));
        }
        for (got, (want, within)) in sums.iter().zip([
            (0.0, 0.02),
            (1.0, 0.03),
            (3.0, 0.15),
            (1.0, 0.03),
            (0.0, 0.02),
        ]) {
            assert!((got - want).abs() < within, "{got} instead of {want}");
        }
    }

    #[test]
    fn directions_have_unit_length_and_no_favourite() {
        let mut rng = Rng::stream(1, "directions");
        let mut sum = [0.0; 3];
        for _ in 0..20_000 {
            let d = rng.direction();
            assert!((d.iter().map(|c| c * c).sum::<f64>() - 1.0).abs() < 1e-12);
            (0..3).for_each(|i| sum[i] += d[i] / 20_000.0);
        }
        assert!(sum.iter().all(|s| s.abs() < 0.02), "{sum:?}");
    }
}
