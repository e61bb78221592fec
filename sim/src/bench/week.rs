//! The week on the excavator (R18): days of digging, one of them with an unstable supply.
//!
//! In: a calibrated instrument and the number of days. Out: one [`Day`] each, handed to the caller
//! as it ends, so that memory does not grow with the days. Every day has three hours; the readings
//! are compared 50 times a second; the supply of node 2 becomes unstable an hour into day 5.
//!
//! The world obeys the instrument: it stops the arm for the 45 s that the paper's rule asks for,
//! and on a fault it stands until the supply has been checked (and mended, if it was the cause)
//! and the instrument reset, after which work goes on (Table I). Between a fault and the reset no
//! warnings are counted: the instrument has reported what it has to report.
//!
//! [`super::scene`] has the same for a single stretch of work of whole devices on a bus, with
//! trouble of the caller's choice: both rows of Table I are provoked with it.
//!
//! Left out: the operator's own mistakes, and what the machine does with the angle.

use tilt::angle::Axes;
use tilt::chain::Invalid;
use tilt::cross_check::{CrossCheck, Judgement, PaperCheck, PaperState};

use super::interpretation::Interpretation;
use super::statistics::Tally;
use super::{Bench, Mode, run};
use crate::excavator::{Excavator, ExcavatorSetup};
use crate::instrument::Instrument;
use crate::rng::Rng;
use crate::supply::Supply;

/// R18: working time of a day.
pub const HOURS_PER_DAY: f64 = 3.0;
/// R18: the day with the unstable supply.
pub const FAULT_DAY: u32 = 5;
/// The supply becomes unstable this long after the day's start \[ASSUME\].
pub const UNSTABLE_FROM_S: f64 = 3600.0;
/// Checking the supply takes this long \[ASSUME\].
pub const SUPPLY_CHECK_S: f64 = 300.0;
/// Fig 21: a healthy instrument's difference stays below this, deg.
pub const HEALTHY_DEG: f64 = 0.20;
/// Readings are compared every 20 ms (50 samples per second), s.
pub(super) const SYNC_S: f64 = 0.020;
/// Width of one bin of the trace, s.
pub const BIN_S: f64 = 10.0;

/// What the instrument's most serious message of the day led to (Table I).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Outcome {
    /// Nothing happened.
    #[default]
    None,
    /// Single warnings, never enough to act.
    Warnings,
    /// Told to be late data: in paper mode after 45 s of standstill, in product mode by the reason.
    DataDelay,
    /// A fault was reported; the supply was found good; reset.
    FaultWithoutCause,
    /// A fault was reported; the supply was found unstable, mended, and the instrument reset.
    SupplyFault,
}

/// What goes wrong, and when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trouble {
    /// Nothing.
    None,
    /// Node 2's supply is unstable from this second on, until somebody mends it.
    Supply {
        /// Since the start of the scene, s.
        from_s: f64,
    },
    /// What node 2 sends is late from this second on, until the machine stands.
    Delay {
        /// Since the start of the scene, s.
        from_s: f64,
        /// How late, ms.
        ms: u32,
    },
}

/// When a scene ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Until {
    /// When its time is over.
    Over,
    /// As soon as its trouble is settled and work goes on.
    Settled,
}

/// Extremes of the difference between the nodes in one bin of time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Since the start of the day, s.
    pub time_s: f64,
    /// Smallest and largest difference on slope Y, deg.
    pub range_deg: [f64; 2],
}

/// One day.
#[derive(Clone, Debug, Default)]
pub struct Day {
    /// 1 is the first.
    pub day: u32,
    /// Pairs compared.
    pub pairs: u64,
    /// Pairs of which at least one node had no reading for a passing reason (over range, settling).
    pub waiting: u64,
    /// Warnings.
    pub warnings: u64,
    /// Stops of 45 s asked for.
    pub stops: u64,
    /// Faults reported.
    pub faults: u64,
    /// From the time at which the trouble may begin to the first fault or stop, s.
    pub detection_s: Option<f64>,
    /// Faults after a reset that followed a mended supply: 0 means that the reset cured it.
    pub after_cure: u64,
    /// What it led to.
    pub outcome: Outcome,
    /// Size of the difference on slope Y when the last stop of 45 s was over, deg.
    pub delta_after_stop_deg: Option<f64>,
    /// Difference between the nodes on slope Y, deg.
    pub difference: Tally,
    /// Comparisons on slope Y that differed by more than [`HEALTHY_DEG`].
    pub above_healthy: u64,
    /// The difference over the day, in bins of [`BIN_S`]; their number depends on the hours only.
    pub trace: Vec<Bin>,
}

/// What the world is doing for the instrument.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Doing {
    Digging,
    Stopped,
    Checking { until_s: f64 },
}

/// An instrument on the machine, as the one who obeys it sees it.
pub(super) trait AtWork {
    /// Virtual time, s.
    fn time_s(&self) -> f64;
    /// Lets the machine move it for so long, s.
    fn run(&mut self, arm: &mut Excavator, duration_s: f64);
    /// What node 1 reports of the pair now.
    fn compare(&mut self) -> Compared;
    /// Power off and on: the code of both nodes starts anew.
    fn power_cycle(&mut self);
    /// The supply of node 2.
    fn supply(&mut self) -> &mut Supply;
    /// What node 2 sends is late by this from now on, ms; 0 is in time again.
    fn delay(&mut self, ms: u32);
}

/// What node 1 reports of a pair.
#[derive(Clone, Copy, Debug)]
pub(super) struct Compared {
    /// The judgement.
    pub judgement: Judgement,
    /// Own less peer on slope Y, deg.
    pub delta_deg: Option<f64>,
}

impl AtWork for Instrument {
    fn time_s(&self) -> f64 {
        Self::time_s(self)
    }

    fn run(&mut self, arm: &mut Excavator, duration_s: f64) {
        run(self, arm, duration_s);
    }

    fn compare(&mut self) -> Compared {
        let verdict = self.sync().verdict;
        Compared {
            judgement: verdict.judgement(),
            delta_deg: verdict.delta().y.map(|delta| delta.degrees()),
        }
    }

    fn power_cycle(&mut self) {
        Self::power_cycle(self);
    }

    fn supply(&mut self) -> &mut Supply {
        &mut self.sides[1].electronics.supply
    }

    /// Nothing is on its way where there is no bus, and no day of the week has this trouble.
    fn delay(&mut self, _ms: u32) {}
}

struct DayRun<'a, I> {
    instrument: &'a mut I,
    arm: &'a mut Excavator,
    day: Day,
    start_s: f64,
    doing: Doing,
    bin: Option<Bin>,
    trouble: Trouble,
    delayed: bool,
    cured: bool,
    until: Until,
}

impl Bench {
    /// Digs for `days` days; `done` gets each day as it ends.
    pub fn week(&mut self, days: u32, seed: u64, mut done: impl FnMut(Day)) {
        let mut rng = Rng::stream(seed, "week");
        let mut arm = Excavator::new(&machine(self.mode, &self.paper), &mut rng);
        for day in 1..=days {
            let unstable = Trouble::Supply {
                from_s: UNSTABLE_FROM_S,
            };
            let trouble = if day == FAULT_DAY {
                unstable
            } else {
                Trouble::None
            };
            let hours_s = HOURS_PER_DAY * 3600.0;
            let [own, _] = &mut self.instrument.sides;
            own.node.set_check(check(self.mode));
            let ends = (hours_s, Until::Over);
            let result = work(&mut self.instrument, &mut arm, ends, trouble, &mut rng);
            done(Day { day, ..result });
        }
    }
}

/// Starts the instrument at standstill and works with it, for a time in s at the most.
pub(super) fn work(
    instrument: &mut impl AtWork,
    arm: &mut Excavator,
    (duration_s, until): (f64, Until),
    trouble: Trouble,
    rng: &mut Rng,
) -> Day {
    arm.stop(instrument.time_s());
    instrument.run(arm, 3.0);
    instrument.power_cycle();
    instrument.run(arm, 1.5);
    let start_s = instrument.time_s();
    arm.resume(start_s);
    if let Trouble::Supply { from_s } = trouble {
        *instrument.supply() = Supply::unstable(start_s + from_s, rng);
    }
    let mut run = DayRun {
        instrument,
        arm,
        day: Day::default(),
        start_s,
        doing: Doing::Digging,
        bin: None,
        trouble,
        delayed: false,
        cured: false,
        until,
    };
    run.all(duration_s);
    run.day
}

/// The machine of a mode: the paper's by Fig 21, the product's the harder one.
pub(super) fn machine(mode: Mode, paper: &Interpretation) -> ExcavatorSetup {
    match mode {
        Mode::Paper => paper.machine,
        Mode::Product | Mode::Dynamic | Mode::OneAxis => ExcavatorSetup::NOMINAL,
    }
}

/// The check of a mode on the machine, fresh. The paper's excavator is measured on one axis, Y; the
/// product goes on comparing both.
pub(super) fn check(mode: Mode) -> CrossCheck {
    match mode {
        Mode::Paper => {
            let check = PaperCheck {
                watch: Axes { x: false, y: true },
                ..PaperCheck::PAPER
            };
            CrossCheck::Paper(check, PaperState::default())
        }
        Mode::Product | Mode::Dynamic | Mode::OneAxis => mode.check(),
    }
}

impl<I: AtWork> DayRun<'_, I> {
    fn now_s(&self) -> f64 {
        self.instrument.time_s()
    }

    /// Since the start of the scene, s.
    fn since_s(&self) -> f64 {
        self.now_s() - self.start_s
    }

    /// Whether the trouble may have begun and has not been mended.
    fn troubled(&self) -> bool {
        let from_s = match self.trouble {
            Trouble::None => return false,
            Trouble::Supply { from_s } | Trouble::Delay { from_s, .. } => from_s,
        };
        !self.cured && self.since_s() > from_s
    }

    fn delay(&mut self) {
        let Trouble::Delay { ms, .. } = self.trouble else {
            return;
        };
        let delayed = self.troubled();
        if delayed != self.delayed {
            self.delayed = delayed;
            self.instrument.delay(if delayed { ms } else { 0 });
        }
    }

    fn all(&mut self, duration_s: f64) {
        let syncs = (duration_s / SYNC_S) as u64;
        for _ in 0..syncs {
            self.instrument.run(self.arm, SYNC_S);
            if self.until == Until::Settled && self.cured && self.doing == Doing::Digging {
                break;
            }
            self.delay();
            let compared = self.instrument.compare();
            self.note(compared.delta_deg);
            self.obey(&compared);
        }
        self.day.trace.extend(self.bin.take());
    }

    fn note(&mut self, delta_deg: Option<f64>) {
        self.day.pairs += 1;
        let Some(delta_deg) = delta_deg else {
            return;
        };
        self.day.difference.add(delta_deg);
        self.day.above_healthy += u64::from(delta_deg.abs() > HEALTHY_DEG);
        let since_s = self.since_s();
        match &mut self.bin {
            Some(bin) if since_s - bin.time_s < BIN_S => {
                bin.range_deg[0] = bin.range_deg[0].min(delta_deg);
                bin.range_deg[1] = bin.range_deg[1].max(delta_deg);
            }
            _ => {
                self.day.trace.extend(self.bin.take());
                self.bin = Some(Bin {
                    time_s: since_s,
                    range_deg: [delta_deg; 2],
                });
            }
        }
    }

    fn obey(&mut self, compared: &Compared) {
        let judgement = compared.judgement;
        if self.doing == Doing::Stopped && judgement != Judgement::StopMotion {
            self.day.delta_after_stop_deg = compared.delta_deg.map(f64::abs);
        }
        match self.doing {
            Doing::Checking { until_s } if self.now_s() < until_s => {}
            Doing::Checking { .. } => self.reset(judgement),
            _ if judgement.is_fault() => self.fault(),
            Doing::Digging if judgement == Judgement::StopMotion => {
                self.day.stops += 1;
                self.day.warnings += 1;
                self.note_detection();
                self.arm.stop(self.now_s());
                // Data that are late catch up while the machine stands (Table I, first row).
                self.cured |= matches!(self.trouble, Trouble::Delay { .. }) && self.troubled();
                self.doing = Doing::Stopped;
            }
            Doing::Stopped if judgement == Judgement::DataDelay => {
                self.outcome(Outcome::DataDelay);
                self.arm.resume(self.now_s());
                self.doing = Doing::Digging;
            }
            Doing::Stopped => {}
            Doing::Digging => self.count(judgement),
        }
    }

    fn count(&mut self, judgement: Judgement) {
        if matches!(judgement, Judgement::Waiting(_)) {
            self.day.waiting += 1;
        }
        if judgement.is_warning() {
            self.day.warnings += 1;
            self.outcome(Outcome::Warnings);
        }
    }

    fn fault(&mut self) {
        let now_s = self.now_s();
        self.day.warnings += 1;
        self.day.faults += 1;
        self.day.after_cure += u64::from(self.cured);
        self.note_detection();
        self.arm.stop(now_s);
        self.doing = Doing::Checking {
            until_s: now_s + SUPPLY_CHECK_S,
        };
    }

    fn note_detection(&mut self) {
        if let (Trouble::Supply { from_s } | Trouble::Delay { from_s, .. }, true) =
            (self.trouble, self.troubled())
        {
            let since_s = self.since_s() - from_s;
            self.day.detection_s.get_or_insert(since_s);
        }
    }

    /// What is told has been looked after: mend it if it was the cause, reset, and go on. A channel
    /// that sends late is silent at first; what is shown at the end of the check counts.
    fn reset(&mut self, told: Judgement) {
        let now_s = self.now_s();
        if self.troubled() {
            self.instrument.supply().repair(now_s);
            self.cured = true;
            self.outcome(match told {
                Judgement::OneChannel {
                    reason: Invalid::Late,
                    ..
                } => Outcome::DataDelay,
                _ => Outcome::SupplyFault,
            });
        } else {
            self.outcome(Outcome::FaultWithoutCause);
        }
        self.delay();
        // A tick with the mended supply comes first, so that the reset finds it good.
        self.instrument.run(self.arm, 0.1);
        self.instrument.power_cycle();
        self.instrument.run(self.arm, 1.5);
        self.arm.resume(self.now_s());
        self.doing = Doing::Digging;
    }

    fn outcome(&mut self, outcome: Outcome) {
        self.day.outcome = self.day.outcome.max(outcome);
    }
}
