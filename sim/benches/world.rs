//! Speed of the world: samples per second of an instrument on the excavator's arm.
//!
//! In: one seed. Out: criterion's figures for one second of virtual time with both nodes sampling,
//! compared 50 times, at 400 Hz (product) and at 50 Hz (paper); throughput in samples of the two
//! parts together. The arm by itself and the rig's commissioning stand beside them.

use std::hint::black_box;

use criterion::{Criterion, SamplingMode, Throughput};
use sim::TICK_S;
use sim::bench::{Bench, Mode, World};
use sim::error_model::ErrorModel;
use sim::excavator::{Excavator, ExcavatorSetup};
use sim::instrument::Instrument;
use sim::motion::Mover;
use sim::rng::Rng;

/// Ticks in a second of the world, and between two readings.
const TICKS: u64 = 1000;
const SYNC_TICKS: u64 = 20;

/// An instrument on the arm; the correction is not calibrated, which costs the same time.
struct Digging {
    arm: Excavator,
    instrument: Instrument,
}

impl Digging {
    fn new(mode: Mode) -> Self {
        let parts = ErrorModel::NOMINAL;
        let mut instrument = Instrument::new(&mode.settings(), &mode.check(), &parts, 1, 1);
        instrument.power_cycle();
        Self {
            arm: Excavator::new(&ExcavatorSetup::NOMINAL, &mut Rng::stream(1, "arm")),
            instrument,
        }
    }

    fn second(&mut self) {
        for tick in 0..TICKS {
            let motion = self.arm.step(self.instrument.time_s() + TICK_S);
            self.instrument.tick(&motion);
            if tick % SYNC_TICKS == 0 {
                black_box(self.instrument.sync());
            }
        }
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("world");
    for (name, mode) in [("paper", Mode::Paper), ("product", Mode::Product)] {
        let mut digging = Digging::new(mode);
        group.throughput(Throughput::Elements(2 * mode.rate_hz() as u64));
        group.bench_function(format!("{name} digs for a second"), |bencher| {
            bencher.iter(|| digging.second());
        });
    }
    let mut arm = Excavator::new(&ExcavatorSetup::NOMINAL, &mut Rng::stream(1, "arm"));
    let mut now_s = 0.0;
    group.throughput(Throughput::Elements(1));
    group.bench_function("one tick of the arm", |bencher| {
        bencher.iter(|| {
            now_s += TICK_S;
            black_box(arm.step(now_s))
        });
    });
    group.sample_size(10);
    group.sampling_mode(SamplingMode::Flat);
    group.throughput(Throughput::Elements(1));
    group.bench_function("product is commissioned", |bencher| {
        bencher.iter(|| black_box(Bench::commissioned(Mode::Product, &World::NOMINAL, 1, 1)));
    });
    group.finish();
    criterion.final_summary();
}
