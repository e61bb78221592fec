//! The product's signal chain on samples that every machine makes alike.
//!
//! In: nothing. Out: angles, uncertainties and vectors of two channels and what their comparison
//! says, for each sample, as [`Outcome`]. The chip's image runs it, the test runs it on the host,
//! and each bit has to be the same. Samples come from integers alone.
//!
//! Left out: the golden values themselves, which `tilt/tests/golden.rs` has.
#![cfg_attr(target_os = "none", no_std)]

pub mod float;

use instant::Instant;
use tilt::angle::{Axes, Harmonics};
use tilt::chain::{Calibration, Chain, ChainState, Correction, PART_DELAY_Q16, Timing};
use tilt::filter::LowPass;
use tilt::sample::{Counts, FullScale, Temperature};
use tilt::temperature::{Quadratic, TemperatureModel};
use tilt::uncertainty::{Budget, Span, TCO, Uncertainty};
use tilt::vector::Vector;

/// Samples that are run.
pub const SAMPLES: u32 = 4_000;
/// Between two whole readings that are kept.
const EVERY: u32 = 100;
/// Readings that are kept whole.
pub const KEPT: usize = (SAMPLES / EVERY) as usize;

/// What the run came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(C)]
pub struct Outcome {
    /// Every hundredth reading: slope X, its uncertainty, slope Y, its uncertainty; 0 for none.
    pub readings: [[i32; 4]; KEPT],
    /// All readings mixed, 32-bit FNV-1a over words.
    pub hash: u32,
    /// Readings with both slopes.
    pub valid: u32,
    /// Samples run; [`SAMPLES`] once it is done.
    pub done: u32,
}

impl Outcome {
    /// Nothing yet.
    pub const NOTHING: Self = Self {
        readings: [[0; 4]; KEPT],
        hash: 0x811C_9DC5,
        valid: 0,
        done: 0,
    };

    /// Runs everything.
    pub fn run(&mut self) {
        let chain = product();
        let mut state = ChainState::default();
        let mut noise = 1u32;
        for number in 0..SAMPLES {
            if number % 400 == 0 {
                let warm = 20 * 256 + (number / 8) as i32;
                chain.temperature(&mut state, Temperature(warm));
            }
            let after = u64::from(number) * u64::from(chain.period_us) * 101 / 100;
            let now = Instant(5_000_000 + after);
            chain.sample(&mut state, counts(number, &mut noise), now);
            let reading = chain.reading(&state, now.offset(i64::from(number % 2_500)));
            let words = match (&reading.x, &reading.y) {
                (Ok(x), Ok(y)) => {
                    self.valid += 1;
                    let [ux, uy] = [x, y].map(|slope| slope.uncertainty.0 as i32);
                    [x.angle.0, ux, y.angle.0, uy]
                }
                _ => [0; 4],
            };
            self.take(number, words);
        }
    }

    fn take(&mut self, number: u32, words: [i32; 4]) {
        for word in words {
            self.hash = (self.hash ^ word as u32).wrapping_mul(0x0100_0193);
        }
        let place = self.readings.get_mut((number / EVERY) as usize);
        if let Some(place) = place.filter(|_| number % EVERY == EVERY - 1) {
            *place = words;
        }
        self.done = number + 1;
    }
}

/// A swing over +-60 deg with a little of Y, and noise of some counts.
fn counts(number: u32, noise: &mut u32) -> Counts {
    let mut draw = || {
        *noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (*noise >> 27) as i16 - 16
    };
    let (_, swing) = idsp::cossin((number as i32).wrapping_mul(8_000_000));
    let (c, s) = idsp::cossin(swing / 3);
    Counts([
        (s >> 17) as i16 + draw(),
        900 + draw(),
        (c >> 17) as i16 + draw(),
    ])
}

/// The product's chain, with that calibration.
fn product() -> Chain {
    Chain {
        filter: LowPass::PRODUCT,
        full_scale: FullScale::G2,
        period_us: 2500,
        part_delay_q16: PART_DELAY_Q16,
        timing: Timing::Aligned { latency_us: 25_000 },
        calibration: calibration(),
        fusion: None,
    }
}

/// A calibration in which no term is 0 or 1.
pub fn calibration() -> Calibration {
    let wave = Harmonics {
        cosine: [120_000, -80_000, 30_000],
        sine: [-50_000, 20_000, 10_000],
    };
    Calibration {
        temperature: TemperatureModel::Quadratic(Quadratic {
            offset1_q8: [3_435_973, -2_000_000, 1_000_000],
            offset2_q16: [-3_518_437, 1_200_000, 0],
            gain1_q38: [-27_487_790, 13_000_000, 5_000_000],
            gain2_q46: [703_687, 0, -100_000],
        }),
        correction: Correction::TwoAxis {
            vector: Vector {
                matrix: [
                    [1_084_479_242, -9_663_676, 5_368_709],
                    [8_589_934, 1_063_004_406, -7_516_192],
                    [-6_442_450, 4_294_967, 1_079_110_533],
                ],
                offset: [-1_342_177, 872_415, 402_653],
            },
            harmonics: Axes { x: wave, y: wave },
        },
        budget: Budget {
            noise: 85_000,
            repeatability: 20_000,
            hysteresis: 24_000,
            reference: Uncertainty(160_000),
            residual: Uncertainty(100_000),
            fitted_at: Temperature::REFERENCE,
            tco: TCO,
            span: Span::CHAMBER,
        },
        rates: None,
    }
}
