//! Which faults, in which scenes, how often.
//!
//! In: a label and a number. Out: [`Case`]s, each drawn from a stream of its own, so that more
//! runs don't change the first ones. Unit, axis, sign, channel and moment are drawn; the same
//! draws serve both modes.

use sim::bench::Mode;
use sim::excavator::Scene;
use sim::fault::{NodeFault, SensorFault};
use sim::rng::Rng;
use sim::trial::inject::What;

use crate::world::Case;

/// What was published for a fault by the study, stop-and-go.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    /// Detected, per cent.
    pub detected: u32,
    /// Median delay, s; `None` for "at the first".
    pub delay_s: Option<f64>,
    /// Isolated, per cent, where the study has it.
    pub isolated: Option<u32>,
}

const fn study(detected: u32, delay_s: f64) -> Option<Reference> {
    Some(Reference {
        detected,
        delay_s: Some(delay_s),
        isolated: None,
    })
}

const fn isolated(delay_s: f64) -> Option<Reference> {
    Some(Reference {
        detected: 100,
        delay_s: Some(delay_s),
        isolated: Some(100),
    })
}

/// One kind of fault; axis and sign are left open.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// As it stands in the tables.
    pub name: &'static str,
    /// The fault on an axis, with a sign.
    make: fn(usize, f64) -> What,
    /// How long it is watched, s.
    pub watch_s: f64,
    /// What the study has for it.
    pub reference: Option<Reference>,
    /// True for a fault of the bus, where each channel may hold the other for silent.
    pub of_the_bus: bool,
    /// False for a fault that paper mode has no place for.
    pub in_paper: bool,
}

/// How long a fault is watched unless its kind has a time of its own, s.
const WATCH_S: f64 = 10.0;
/// Paper mode is watched for longer, s.
const PAPER_WATCH_S: f64 = 20.0;
/// When faults begin, s: the residual has learned what the pair is used to by then.
const FROM_S: (f64, f64) = (8.0, 15.0);
/// Temperatures at which false alarms are looked for, degC.
const TEMPERATURES_C: (f64, f64) = (0.0, 50.0);

const fn sensor(
    name: &'static str,
    make: fn(usize, f64) -> What,
    reference: Option<Reference>,
) -> Kind {
    Kind {
        name,
        make,
        watch_s: WATCH_S,
        reference,
        of_the_bus: false,
        in_paper: true,
    }
}

const fn bus(name: &'static str, make: fn(usize, f64) -> What) -> Kind {
    Kind {
        of_the_bus: true,
        ..sensor(name, make, None)
    }
}

const fn bias(axis: usize, mg: f64) -> What {
    What::Sensor(SensorFault::Bias { axis, mg })
}

const fn drift(axis: usize, mg_per_s: f64) -> What {
    What::Sensor(SensorFault::Drift { axis, mg_per_s })
}

const fn noise(factor: f64) -> What {
    What::Sensor(SensorFault::Noise { factor })
}

const fn late(s: f64) -> What {
    What::Sensor(SensorFault::Late { s })
}

const fn loss(share: f64) -> What {
    What::Sensor(SensorFault::SampleLoss { share })
}

const fn late_frames(ms: u32) -> What {
    What::Node(NodeFault::LateFrames { ms })
}

/// Spikes come 5 times a second in the mean.
const SPIKES: What = What::Sensor(SensorFault::Spikes { g: 0.2, per_s: 5.0 });
/// The supply is away for 10 ms.
const BROWN_OUT: What = What::Sensor(SensorFault::BrownOut { s: 0.01 });
/// An identifier that nobody owns and that wins against everything but NMT.
const BABBLING: What = What::Node(NodeFault::Babbling {
    id: 0x07F,
    share: 1.0,
});

/// Every fault of the page, in the order of its tables.
pub const KINDS: [Kind; 29] = [
    sensor("bias step 5 mg", |a, s| bias(a, 5.0 * s), study(98, 0.8)),
    sensor(
        "bias step 10 mg",
        |a, s| bias(a, 10.0 * s),
        study(100, 0.24),
    ),
    sensor(
        "bias step 50 mg",
        |a, s| bias(a, 50.0 * s),
        study(100, 0.04),
    ),
    Kind {
        watch_s: 60.0,
        ..sensor("drift 0.2 mg/s", |a, s| drift(a, 0.2 * s), None)
    },
    sensor("drift 2 mg/s", |a, s| drift(a, 2.0 * s), study(100, 2.5)),
    sensor("stuck, one axis", |a, _| stuck(Some(a)), None),
    sensor("stuck, all axes", |_, _| stuck(None), isolated(0.02)),
    sensor("noise x3", |_, _| noise(3.0), isolated(0.06)),
    sensor("noise x10", |_, _| noise(10.0), None),
    sensor(
        "spikes 200 mg",
        |_, _| SPIKES,
        Some(Reference {
            detected: 100,
            delay_s: None,
            isolated: None,
        }),
    ),
    sensor("gain -2 %", |a, _| gain(a), study(100, 0.24)),
    sensor("gain -2 %, axis z", |_, _| gain(2), study(100, 0.24)),
    sensor("delay 50 ms", |_, _| late(0.05), study(100, 0.02)),
    sensor("delay 200 ms", |_, _| late(0.2), None),
    sensor("sample loss 10 %", |_, _| loss(0.1), None),
    sensor("sample loss 50 %", |_, _| loss(0.5), None),
    sensor("sample loss 100 %", |_, _| loss(1.0), None),
    sensor("brown-out", |_, _| BROWN_OUT, study(100, 0.0)),
    sensor("sag", |_, _| What::Sensor(SensorFault::Sag), None),
    sensor("thermometer +5 degC", |_, _| thermometer(), None),
    sensor("swapped axes", |_, _| swapped(), None),
    Kind {
        in_paper: false,
        ..sensor("corrupted calibration", |_, _| corrupted(), None)
    },
    sensor("silent", |_, _| What::Node(NodeFault::Silent), None),
    sensor("halted", |_, _| What::Node(NodeFault::Halted), None),
    bus("frames 50 ms late", |_, _| late_frames(50)),
    bus("frames 200 ms late", |_, _| late_frames(200)),
    bus("babbling", |_, _| BABBLING),
    bus("SYNC lost", |_, _| What::Node(NodeFault::SyncLost)),
    bus("bus-off", |_, _| What::Node(NodeFault::BusOff)),
];

const fn stuck(axis: Option<usize>) -> What {
    What::Sensor(SensorFault::Stuck { axis })
}

const fn gain(axis: usize) -> What {
    What::Sensor(SensorFault::Gain { axis, ratio: -0.02 })
}

const fn thermometer() -> What {
    What::Sensor(SensorFault::Thermometer { c: 5.0 })
}

const fn swapped() -> What {
    What::Sensor(SensorFault::SwappedAxes)
}

const fn corrupted() -> What {
    What::Node(NodeFault::CorruptCalibration)
}

/// Faults that have to be told and pinned to their channel at once.
pub const PROMISED: [&str; 8] = [
    "stuck, one axis",
    "stuck, all axes",
    "brown-out",
    "silent",
    "halted",
    "delay 50 ms",
    "delay 200 ms",
    "spikes 200 mg",
];

/// The fault of the second promise.
pub const STEP: &str = "bias step 5 mg";

/// A kind by its name.
pub fn kind(name: &str) -> Option<&'static Kind> {
    KINDS.iter().find(|kind| kind.name == name)
}

/// The scenes, as they are headed.
pub const SCENES: [(Scene, &str); 3] = [
    (Scene::Digging, "Digging"),
    (Scene::StopAndGo, "Stop-and-go"),
    (Scene::Standstill, "Standstill"),
];

/// How many runs of each sort.
#[derive(Clone, Copy, Debug)]
pub struct Counts {
    /// Calibrated units.
    pub units: usize,
    /// Of each fault and scene.
    pub cell: usize,
    /// Of each fault with a promise.
    pub promise: usize,
    /// Healthy worlds of each scene, product mode.
    pub worlds: usize,
    /// Healthy worlds of each scene, paper mode.
    pub paper_worlds: usize,
    /// Length of a healthy world, s.
    pub world_s: f64,
    /// Whether paper mode has a place in the tables of faults.
    pub paper: bool,
}

impl Counts {
    /// What every run of the tests repeats.
    pub const SHORT: Self = Self {
        units: 4,
        cell: 20,
        promise: 200,
        worlds: 12,
        paper_worlds: 2,
        world_s: 300.0,
        paper: false,
    };
    /// What the page is about.
    pub const LONG: Self = Self {
        units: 10,
        cell: 60,
        promise: 1000,
        worlds: 200,
        paper_worlds: 2,
        world_s: 1800.0,
        paper: true,
    };
}

/// A whole number below `count`.
fn below(rng: &mut Rng, count: usize) -> usize {
    ((rng.uniform() * count as f64) as usize).min(count.saturating_sub(1))
}

/// One run; without a kind nothing goes wrong.
pub fn case(label: &str, scene: Scene, kind: Option<&Kind>, number: usize, units: usize) -> Case {
    let name = kind.map_or("healthy", |kind| kind.name);
    let mut rng = Rng::stream(number as u64, &format!("faults {label} {name} {scene:?}"));
    let seed = (rng.uniform() * (1u64 << 53) as f64) as u64;
    let from_s = rng.range(FROM_S.0, FROM_S.1);
    let (axis, sign, channel) = (below(&mut rng, 3), rng.sign(), below(&mut rng, 2));
    Case {
        seed,
        mode: Mode::Product,
        unit: below(&mut rng, units),
        power_cycles: below(&mut rng, 16) as u32,
        scene,
        start_c: 25.0,
        ramp_c_per_min: 0.0,
        fault: kind.map(|kind| ((kind.make)(axis, sign), channel)),
        from_s,
        watch_s: kind.map_or(WATCH_S, |kind| kind.watch_s),
        ends_early: true,
        wants_plain: true,
        obeys: false,
    }
}

/// The same run of the instrument that the paper built.
pub fn in_paper_mode(case: Case) -> Case {
    Case {
        mode: Mode::Paper,
        watch_s: case.watch_s.max(PAPER_WATCH_S),
        ends_early: false,
        ..case
    }
}

/// A run for a promise: nothing but the product's own verdict counts.
pub fn promised(kind: &Kind, number: usize, units: usize) -> Case {
    let (scene, _) = if kind.name == STEP {
        SCENES[1]
    } else {
        SCENES[number % SCENES.len()]
    };
    Case {
        wants_plain: false,
        ..case("promise", scene, Some(kind), number, units)
    }
}

/// A healthy world of some length; every second one lives through a change of temperature.
pub fn healthy(mode: Mode, scene: Scene, number: usize, counts: &Counts) -> Case {
    let label = format!("healthy {mode:?}");
    let mut rng = Rng::stream(number as u64, &format!("faults {label} {scene:?} weather"));
    let (from_c, to_c) = (
        rng.range(TEMPERATURES_C.0, TEMPERATURES_C.1),
        rng.range(TEMPERATURES_C.0, TEMPERATURES_C.1),
    );
    let steady = number.is_multiple_of(2);
    let length_s = counts.world_s;
    Case {
        mode,
        start_c: if steady { 25.0 } else { from_c },
        ramp_c_per_min: if steady {
            0.0
        } else {
            (to_c - from_c) / (length_s / 60.0)
        },
        from_s: 0.0,
        watch_s: length_s,
        ends_early: false,
        obeys: true,
        ..case(&label, scene, None, number, counts.units)
    }
}
