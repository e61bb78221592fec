//! The cross-check of a replay, counted and cut into stretches of time.
//!
//! In: [`Moment`]s in order of time. Out: the comparison and the verdicts of the report. Only
//! `tilt::cross_check` judges; here its judgements are counted and put into words. One recording
//! has nobody to compare with: its stretches show whether it measured.

use instant::Instant;
use tilt::angle::Angle;
use tilt::chain::{Invalid, Measurement, Reading};
use tilt::cross_check::{
    Judgement, Member, PaperCheck, PaperState, THRESHOLD, Verdict, WindowCheck, WindowState,
};

use super::arguments::Mode;
use super::figures::{Sums, seconds};
use super::play::Moment;
use crate::report::data::Axis;
use crate::report::replay_data::{CrossCheck, SlopeDelta, VerdictInterval};
use codes::words::invalid;
use output::series::{Binner, MAX_BINS};

/// More stretches than this are counted, but not kept.
const MOST_STRETCHES: usize = 2000;

/// What judges two recordings.
#[derive(Clone, Debug)]
enum Check {
    Paper(PaperCheck, Box<PaperState>),
    /// The two angles are all that a recording has.
    Window(WindowCheck, WindowState),
}

impl Check {
    fn step(&mut self, own: Reading, peer: Reading, now: Instant) -> Verdict {
        match self {
            Self::Paper(check, state) => check.step(state, own, peer, now),
            Self::Window(check, state) => check.step(state, own, peer, now),
        }
    }
}

/// What holds at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Said {
    /// One channel, and it measures.
    Alone,
    /// One channel, and it does not.
    NoAngle(Invalid),
    /// Two channels.
    Pair(Judgement),
}

impl Said {
    fn trusted(self) -> bool {
        matches!(
            self,
            Self::Alone | Self::Pair(Judgement::Agree | Judgement::DataDelay)
        )
    }

    fn words(self) -> String {
        match self {
            Self::Alone => "measures (one channel, not cross-checked)".to_owned(),
            Self::NoAngle(reason) => format!("no angle: {}", invalid(reason)),
            Self::Pair(judgement) => judgement_words(judgement),
        }
    }
}

fn judgement_words(judgement: Judgement) -> String {
    let fixed = match judgement {
        Judgement::Agree => "agree",
        Judgement::Warning => "warning: they differ by more than the threshold",
        Judgement::StopMotion => "too many warnings: stop and stand still",
        Judgement::DataDelay => "data delay: they agree after the stop, work resumes",
        Judgement::PhysicalFault => "physical fault: check the supply and reset",
        Judgement::Disagree => "disagree",
        Judgement::OneChannel { faulty, reason } => {
            let number = match faulty {
                Member::Own => 1,
                Member::Peer => 2,
            };
            return format!("channel {number} is faulty: {}", invalid(reason));
        }
        Judgement::NoChannel(reason) => {
            return format!("both channels are faulty: {}", invalid(reason));
        }
        Judgement::Waiting(reason) => {
            return format!("no comparison yet: {}", invalid(reason));
        }
    };
    fixed.to_owned()
}

/// Nobody can reset a recording, so a disagreement ends with its cause instead of lasting to the
/// end of the file.
const UNLATCHED: WindowCheck = WindowCheck {
    latched: false,
    ..WindowCheck::PRODUCT
};

/// One slope of the comparison.
struct Delta {
    all: Sums,
    at_rest: Sums,
    warnings: u64,
    bins: Binner,
}

/// The comparison and the verdicts, as they grow.
pub struct Judge {
    check: Check,
    mode: Mode,
    origin_us: u64,
    slopes: [Delta; 2],
    compared: u64,
    stops: u64,
    faults: u64,
    in_fault: bool,
    current: Option<(Said, u64)>,
    stretches: Vec<(Said, u64, u64)>,
    /// Stretches that were not kept.
    dropped: u64,
    last_us: u64,
}

impl Judge {
    /// Nothing seen yet. The span of the bins is in seconds of the report.
    pub fn new(mode: Mode, origin_us: u64, span_s: (f64, f64)) -> Self {
        let delta = || Delta {
            all: Sums::default(),
            at_rest: Sums::default(),
            warnings: 0,
            bins: Binner::new(span_s.0, span_s.1, MAX_BINS),
        };
        Self {
            check: match mode {
                Mode::Paper => Check::Paper(PaperCheck::PAPER, Box::default()),
                Mode::Product => Check::Window(UNLATCHED, WindowState::default()),
            },
            mode,
            origin_us,
            slopes: [delta(), delta()],
            compared: 0,
            stops: 0,
            faults: 0,
            in_fault: false,
            current: None,
            stretches: Vec::new(),
            dropped: 0,
            last_us: 0,
        }
    }

    /// Takes one moment; `at_rest` when both channels stood still at its instant.
    pub fn see(&mut self, moment: &Moment, at_rest: bool) {
        let said = match moment.peer {
            None => alone(moment.own),
            Some(peer) => self.judge(moment, peer, at_rest),
        };
        self.last_us = moment.now.0;
        match self.current {
            Some((before, _)) if before == said => {}
            _ => self.turn(said),
        }
    }

    /// Ends the stretch under way and begins another.
    fn turn(&mut self, said: Said) {
        self.close();
        self.current = Some((said, self.last_us));
        if let Said::Pair(judgement) = said {
            self.stops += u64::from(judgement == Judgement::StopMotion);
            // A fault that only changes its name is one fault.
            self.faults += u64::from(judgement.is_fault() && !self.in_fault);
            self.in_fault = judgement.is_fault();
        }
    }

    fn close(&mut self) {
        let Some((said, from_us)) = self.current.take() else {
            return;
        };
        if self.stretches.len() < MOST_STRETCHES {
            self.stretches.push((said, from_us, self.last_us));
        } else {
            self.dropped += 1;
        }
    }

    fn judge(&mut self, moment: &Moment, peer: Reading, at_rest: bool) -> Said {
        let verdict = self.check.step(moment.own, peer, moment.now);
        let delta = verdict.delta();
        let pairs = [
            (delta.x, moment.own.x, peer.x),
            (delta.y, moment.own.y, peer.y),
        ];
        let mut compared = false;
        for (slope, (delta, own, peer)) in self.slopes.iter_mut().zip(pairs) {
            let (Some(delta), Ok(own), Ok(peer)) = (delta, own, peer) else {
                continue;
            };
            compared = true;
            slope.all.push(delta.degrees());
            if at_rest {
                slope.at_rest.push(delta.degrees());
            }
            let passed = delta.magnitude() > threshold(self.mode, own, peer);
            slope.warnings += u64::from(passed);
            slope
                .bins
                .push(seconds(own.at.0, self.origin_us), delta.degrees());
        }
        self.compared += u64::from(compared);
        Said::Pair(verdict.judgement())
    }

    /// The stretches of time under one verdict, and how many more there were than are kept.
    pub fn intervals(&mut self) -> (Vec<VerdictInterval>, u64) {
        self.close();
        let origin_us = self.origin_us;
        let interval = |&(said, from_us, to_us): &(Said, u64, u64)| VerdictInterval {
            from_s: seconds(from_us, origin_us),
            to_s: seconds(to_us, origin_us),
            verdict: said.words(),
            trusted: said.trusted(),
        };
        (self.stretches.iter().map(interval).collect(), self.dropped)
    }

    /// The comparison, for the report.
    pub fn cross_check(self) -> CrossCheck {
        let named = self.slopes.into_iter().zip([Axis::X, Axis::Y]);
        let slope = |(delta, axis): (Delta, Axis)| SlopeDelta {
            axis,
            rms_deg: delta.all.rms(),
            max_deg: delta.all.largest(),
            standstill_rms_deg: delta.at_rest.rms(),
            warnings: delta.warnings,
            bins: delta.bins.finish(),
        };
        CrossCheck {
            threshold_deg: Angle(THRESHOLD.cast_signed()).degrees(),
            compared: self.compared,
            stops: self.stops,
            faults: self.faults,
            slopes: named.map(slope).collect(),
        }
    }
}

/// The threshold of one pair; in product mode it follows the uncertainty.
fn threshold(mode: Mode, own: Measurement, peer: Measurement) -> u32 {
    match mode {
        Mode::Paper => THRESHOLD,
        Mode::Product => {
            let combined = own.unshared.combined_with(peer.unshared);
            let WindowCheck { coverage, .. } = WindowCheck::PRODUCT;
            THRESHOLD.max(combined.0.saturating_mul(coverage))
        }
    }
}

fn alone(reading: Reading) -> Said {
    match reading.x.and(reading.y) {
        Ok(_) => Said::Alone,
        Err(reason) => Said::NoAngle(reason),
    }
}
