//! Speed of the world: samples per second of an instrument on the excavator's arm.
//!
//! In: one seed. Out: criterion's figures for one second of virtual time with both nodes sampling,
//! compared 50 times, at 400 Hz (product) and at 50 Hz (paper); throughput in samples of the two
//! parts together. The same with two whole devices on a 50 Hz bus, where the throughput is in
//! seconds of virtual time, so "4 Kelem/s" is 4000 times real time; a line before it has the same
//! of one longer run. The arm by itself and the rig's commissioning stand beside them.

mod dig;

use std::hint::black_box;
use std::time::Instant;

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

/// Seconds of virtual time in the run whose ratio to real time is printed.
const RUN_S: u32 = 500;

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

/// How many times faster than real time the bus's world goes on one core.
fn times_real_time(dig: &mut dig::Dig) -> f64 {
    let started = Instant::now();
    (0..RUN_S).for_each(|_| dig.second());
    f64::from(RUN_S) / started.elapsed().as_secs_f64()
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("world");
    let mut dig = dig::Dig::new();
    let ratio = times_real_time(&mut dig);
    let (frames, fingerprint) = dig.seen();
    println!("two product nodes on a 50 Hz bus: {ratio:.0} times real time");
    println!("{RUN_S} s, {frames} frames, fingerprint {fingerprint:016x}");
    group.throughput(Throughput::Elements(1));
    group.bench_function(
        "two product nodes on a 50 Hz bus dig for a second",
        |bencher| {
            bencher.iter(|| dig.second());
        },
    );
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
