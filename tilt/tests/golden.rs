//! Golden vectors: the same samples give the same bits, on every machine and in every release.
//!
//! The samples come from integers alone, so a Cortex-M3 can make the very same ones. When a
//! change of the chain is meant to change the bits, the new values are printed by the failing
//! test; say in the change log why they moved.

use instant::Instant;
use tilt::ONE_G;
use tilt::angle::{Angle, Axes, Harmonics};
use tilt::chain::{Calibration, Chain, ChainState, Correction, PART_DELAY_Q16, Timing};
use tilt::filter::LowPass;
use tilt::sample::{Counts, FullScale, Temperature};
use tilt::table::{Point, Rule, Table};
use tilt::temperature::{Quadratic, TemperatureModel};
use tilt::uncertainty::{Budget, Span, TCO, Uncertainty};
use tilt::vector::Vector;

/// A temperature that is known from the start on, 1/256 degC.
pub const TEMPERATURE_Q8: i32 = 40 * 256 + 77;

/// A swing of slope X over +-60 deg with a little of Y and noise of some counts.
pub fn samples(count: u32) -> impl Iterator<Item = Counts> {
    let mut noise = 1u32;
    (0..count).map(move |i| {
        let mut draw = || {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (noise >> 27) as i16 - 16
        };
        let (_, swing) = idsp::cossin((i as i32).wrapping_mul(8_000_000));
        let (c, s) = idsp::cossin(swing / 3);
        Counts([
            (s >> 17) as i16 + draw(),
            900 + draw(),
            (c >> 17) as i16 + draw(),
        ])
    })
}

/// The product, with a calibration that has something in every field.
pub fn product() -> Chain {
    let vector = Vector {
        matrix: [
            [1_084_479_242, -9_663_676, 5_368_709],
            [8_589_934, 1_063_004_406, -7_516_192],
            [-6_442_450, 4_294_967, 1_079_110_533],
        ],
        offset: [-1_342_177, 872_415, 402_653],
    };
    let quadratic = Quadratic {
        offset1_q8: [3_435_973, -2_000_000, 1_000_000],
        offset2_q16: [-3_518_437, 1_200_000, 0],
        gain1_q38: [-27_487_790, 13_000_000, 5_000_000],
        gain2_q46: [703_687, 0, -100_000],
    };
    let wave = Harmonics {
        cosine: [120_000, -80_000, 30_000],
        sine: [-50_000, 20_000, 10_000],
    };
    Chain {
        filter: LowPass::PRODUCT,
        full_scale: FullScale::G2,
        period_us: 2500,
        part_delay_q16: PART_DELAY_Q16,
        timing: Timing::Aligned { latency_us: 25_000 },
        calibration: Calibration {
            temperature: TemperatureModel::Quadratic(quadratic),
            correction: Correction::TwoAxis {
                vector,
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
        },
        fusion: None,
    }
}

/// The paper's instrument, with a table of a perfect part.
pub fn paper() -> Chain {
    let points: Vec<_> = (-90..=90i32)
        .map(|d| {
            let angle = Angle(d * 11_930_465);
            Point {
                accel: idsp::cossin(angle.0).1 >> 5,
                angle,
            }
        })
        .collect();
    let table = Table::new(&points).unwrap();
    assert!(points[180].accel > ONE_G - 1000);
    let mut chain = product();
    chain.filter = LowPass::PAPER;
    chain.period_us = 20_000;
    chain.timing = Timing::AsItArrives;
    chain.calibration.correction = Correction::Tables {
        tables: Axes {
            x: table.clone(),
            y: table,
        },
        rule: Rule::Nearest,
    };
    chain
}

/// Microseconds on the device's clock at which a sample of this number is captured.
pub fn captured_us(chain: &Chain, number: u64) -> u64 {
    5_000_000 + number * u64::from(chain.period_us) * 101 / 100
}

/// (slope X, uncertainty of X, slope Y) at every hundredth sample.
fn run(chain: &Chain) -> Vec<(i32, u32, i32)> {
    let mut state = ChainState::default();
    chain.temperature(&mut state, Temperature(TEMPERATURE_Q8));
    let mut out = Vec::new();
    for (i, counts) in samples(900).enumerate() {
        let now = Instant(captured_us(chain, i as u64));
        chain.sample(&mut state, counts, now);
        if i % 100 == 99 && i > 150 {
            let reading = chain.reading(&state, now.offset(700));
            let (x, y) = (reading.x.unwrap(), reading.y.unwrap());
            out.push((x.angle.0, x.uncertainty.0, y.angle.0));
        }
    }
    out
}

#[test]
fn product_mode_bits() {
    assert_eq!(run(&product()), GOLDEN_PRODUCT);
}

#[test]
fn paper_mode_bits() {
    assert_eq!(run(&paper()), GOLDEN_PAPER);
}

/// What [`product`] reads.
pub const GOLDEN_PRODUCT: &[(i32, u32, i32)] = &[
    (559_186_102, 2_082_328, 48_518_159),
    (-188_058_546, 11_519_851, 40_647_287),
    (-707_737_156, 21_024_145, 38_899_886),
    (-382_699_337, 15_541_394, 39_328_735),
    (403_864_024, 422_308, 46_624_928),
    (689_250_616, 3_678_345, 49_886_625),
    (116_530_214, 3_822_946, 43_392_825),
    (-601_285_845, 19_672_644, 38_813_799),
];

/// What [`paper`] reads.
pub const GOLDEN_PAPER: &[(i32, u32, i32)] = &[
    (513_009_995, 3_589_200, 35_791_395),
    (-250_539_765, 3_533_962, 35_791_395),
    (-715_827_900, 3_741_643, 35_791_395),
    (-310_192_090, 3_541_800, 35_791_395),
    (465_288_135, 3_573_487, 35_791_395),
    (668_106_040, 3_687_805, 35_791_395),
    (47_721_860, 3_524_176, 35_791_395),
    (-632_314_645, 3_655_425, 35_791_395),
];
