//! Time per sample of both chains: the filter alone, and the filter with a reading behind it.
//!
//! In: counts of a part that swings +-40 deg, one sample per step. Out: criterion's figures, with
//! samples per second. On the host these compare one version with another; what the part needs
//! is measured on the part.

use std::hint::black_box;

use criterion::{Criterion, Throughput};
use instant::Instant;
use tilt::ONE_G;
use tilt::angle::{Angle, Axes, Harmonics};
use tilt::chain::{Calibration, Chain, ChainState, Correction, PART_DELAY_Q16, Timing};
use tilt::filter::LowPass;
use tilt::sample::{Counts, FullScale, Temperature};
use tilt::table::{Point, Rule, Table};
use tilt::temperature::{DataSheet, TemperatureModel};
use tilt::uncertainty::{Budget, Span, Uncertainty};
use tilt::vector::Vector;

/// 400 samples/s, Butterworth, twelve parameters, three harmonics per axis.
fn product() -> Chain {
    let matrix = [
        [1.01, 0.002, -0.01],
        [0.004, 0.99, 0.02],
        [-0.003, 0.01, 1.0],
    ];
    let harmonics = Harmonics {
        cosine: [9000, -4000, 700],
        sine: [-2000, 5000, 300],
    };
    Chain {
        filter: LowPass::PRODUCT,
        full_scale: FullScale::G2,
        period_us: 2500,
        part_delay_q16: PART_DELAY_Q16,
        timing: Timing::Aligned { latency_us: 25_000 },
        calibration: Calibration {
            temperature: TemperatureModel::DataSheet(DataSheet { tco_q8: [900; 3] }),
            correction: Correction::TwoAxis {
                vector: Vector::from_real(matrix, [0.01, -0.02, 0.005]).unwrap_or(Vector::IDENTITY),
                harmonics: Axes {
                    x: harmonics,
                    y: harmonics,
                },
            },
            budget: Budget {
                noise: ONE_G as u32 / 800,
                ..Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::CHAMBER)
            },
            rates: None,
        },
        fusion: None,
    }
}

/// 50 samples/s, one pole, a table per axis, nearest point.
fn paper() -> Chain {
    let points: Vec<_> = (-90..=90)
        .map(|degrees| Point {
            accel: (f64::from(degrees).to_radians().sin() * f64::from(ONE_G)) as i32,
            angle: Angle::from_degrees(f64::from(degrees)),
        })
        .collect();
    let mut chain = product();
    chain.filter = LowPass::PAPER;
    chain.period_us = 20_000;
    chain.timing = Timing::AsItArrives;
    if let Ok(table) = Table::new(&points) {
        chain.calibration.correction = Correction::Tables {
            tables: Axes {
                x: table.clone(),
                y: table,
            },
            rule: Rule::Nearest,
        };
    }
    chain
}

/// One swing of +-40 deg in 256 samples.
fn swing() -> Vec<Counts> {
    let at = |step: i32| {
        let angle = 40.0 * (f64::from(step) / 256.0 * std::f64::consts::TAU).sin();
        let (sin, cos) = angle.to_radians().sin_cos();
        Counts([sin, 0.1, cos].map(|g| (g * 16384.0) as i16 & !3))
    };
    (0..256).map(at).collect()
}

/// A chain that runs: each call of `step` is the next sample.
struct Running {
    chain: Chain,
    state: ChainState,
    swing: Vec<Counts>,
    now: Instant,
    next: usize,
}

impl Running {
    fn new(chain: Chain) -> Self {
        let mut state = ChainState::default();
        chain.temperature(&mut state, Temperature::from_celsius(31));
        let mut running = Self {
            chain,
            state,
            swing: swing(),
            now: Instant(1_000_000),
            next: 0,
        };
        (0..1000).for_each(|_| running.step());
        running
    }

    fn step(&mut self) {
        self.now = self.now.offset(i64::from(self.chain.period_us));
        self.next = (self.next + 1) % self.swing.len();
        let counts = self.swing[self.next];
        self.chain.sample(&mut self.state, counts, self.now);
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("chain");
    group.throughput(Throughput::Elements(1));
    for (name, chain) in [("paper", paper()), ("product", product())] {
        let mut running = Running::new(chain);
        group.bench_function(format!("{name}/sample"), |bencher| {
            bencher.iter(|| running.step());
        });
        group.bench_function(format!("{name}/sample and reading"), |bencher| {
            bencher.iter(|| {
                running.step();
                black_box(running.chain.reading(&running.state, running.now))
            });
        });
    }
    group.finish();
    criterion.final_summary();
}
