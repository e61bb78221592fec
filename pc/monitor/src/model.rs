//! What a view has: the watch on the frames, and what only time shows.
//!
//! In: frames with their time, and time without frames, both on the source's clock. Out: a
//! [`Snapshot`] of any moment, traces, and events. A heartbeat, a SYNC or an angle that comes no
//! more is found by the time alone; supervision begins with the first one.
//!
//! Left out: where frames come from, and how anything is drawn.

use canopen::Frame;
use canopen::nmt::State;

use super::events::{Events, Kind, Whom, seen_from};
use super::level::{self, Level};
use super::load::Load;
use super::pace::{Pace, Patience};
use super::snapshot::SourceState;
use super::trace::Trace;
use codes::words;
use listen::{Beat, Check, Delta, Emergency, Meaning, Place, Plan, Side, Watch};

const S: u64 = 1_000_000_000;

/// A channel's slopes: three of them, one second at least (docs/canopen.md, state 0).
pub const SLOPES: Patience = Patience {
    intervals: 3,
    least_ns: S,
    most_ns: 10 * S,
    unknown_ns: S,
};

/// TPDO 2 comes every tenth SYNC.
pub const DETAIL: Patience = Patience {
    intervals: 3,
    least_ns: 2 * S,
    most_ns: 100 * S,
    unknown_ns: 10 * S,
};

const SYNC: Patience = Patience {
    intervals: 5,
    least_ns: S / 2,
    most_ns: 50 * S,
    unknown_ns: 5 * S,
};

/// A bus on which nothing comes for so long is silent.
const SILENCE: Patience = Patience {
    intervals: 0,
    least_ns: 2 * S,
    most_ns: 2 * S,
    unknown_ns: 2 * S,
};

/// Frames may be out of order by so much: an adapter's queues.
const DISORDER_NS: u64 = S;

/// What the model is told of its source.
#[derive(Clone, Debug, Default)]
pub struct Setup {
    /// What the user calls the source.
    pub name: String,
    /// Bit rate, bit/s, where it is known.
    pub bit_rate: Option<u32>,
}

/// Where frames are kept besides.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// The file.
    pub name: Option<String>,
    /// Frames that it has.
    pub frames: u64,
    /// Why it has ended.
    pub ended: Option<String>,
}

/// What is known of a channel besides its frames' content.
#[derive(Clone, Debug, Default)]
pub struct Extra {
    /// TPDO 1.
    pub slopes: Pace,
    /// TPDO 2.
    pub detail: Pace,
    /// Whether its heartbeat was reported as lost and has not come since.
    pub is_lost: bool,
    /// What was seen before this time is of a node before its restart, or of another time.
    pub floor_ns: u64,
    /// Quality bytes of its latest TPDO 3, and their time.
    pub quality: Option<(u64, [u8; 2])>,
    /// Blamed channels and the reason, by its latest EMCY.
    pub blame: Option<std::borrow::Cow<'static, str>>,
    /// State of the pair that was told last.
    pub state: Option<u8>,
    /// Kinds of findings that were told, bit n for check n.
    pub checked: u16,
    /// Faults that were told and not taken back.
    pub told: u32,
}

/// What is known of an instrument besides its frames' content.
#[derive(Clone, Debug, Default)]
pub struct PairExtra {
    /// Channel A and B.
    pub sides: [Extra; 2],
    /// The latest difference, and when it came.
    pub delta: Option<(u64, Delta)>,
    /// The latest difference of the angles as measured, 0.001 deg, when it came, and which it is.
    pub measured: Option<(u64, [Option<i32>; 2], u64)>,
    /// The last hours.
    pub trace: Trace,
}

/// All that a view has.
#[derive(Clone, Debug)]
pub struct Model {
    pub(super) setup: Setup,
    pub(super) watch: Watch,
    pub(super) pairs: Vec<PairExtra>,
    pub(super) load: Load,
    pub(super) sync: Pace,
    pub(super) any: Pace,
    pub(super) any_ns: Option<u64>,
    /// Whether any frame has set the time, one of our own too.
    is_begun: bool,
    pub(super) now_ns: u64,
    /// Set once, when the source has come to its end.
    pub(super) ended: Option<(SourceState, String)>,
    /// What a silence may come from, for a person.
    pub(super) advice: Option<String>,
    /// Lines of the source that can't be read.
    pub(super) unreadable: u64,
    /// Where frames are recorded.
    pub recording: Recording,
    /// What has happened.
    pub events: Events,
    strangers: u128,
}

impl Model {
    /// Nothing in it yet.
    pub fn new(plan: &Plan, setup: Setup) -> Self {
        Self {
            setup,
            watch: Watch::new(plan),
            pairs: vec![PairExtra::default(); plan.pairs.len()],
            load: Load::default(),
            sync: Pace::default(),
            any: Pace::default(),
            any_ns: None,
            is_begun: false,
            now_ns: 0,
            ended: None,
            advice: None,
            unreadable: 0,
            recording: Recording::default(),
            events: Events::default(),
            strangers: 0,
        }
    }

    /// The trace of an instrument, from 0 on.
    pub fn trace(&self, instrument: usize) -> Option<&Trace> {
        self.pairs.get(instrument).map(|pair| &pair.trace)
    }

    /// Frames seen.
    pub const fn frames(&self) -> u64 {
        self.watch.counts().frames
    }

    /// How many instruments there are.
    pub const fn instruments(&self) -> usize {
        self.pairs.len()
    }

    /// Time of the source, ns.
    pub const fn now_ns(&self) -> u64 {
        self.now_ns
    }

    /// The source has ended, or is lost, for this reason.
    pub fn end(&mut self, state: SourceState, why: String) {
        let level = if state == SourceState::Lost {
            Level::Fault
        } else {
            Level::Good
        };
        self.note(Kind::Source, level, why.clone());
        self.ended = Some((state, why));
    }

    /// The source is there again.
    pub fn resume(&mut self, why: String) {
        self.note(Kind::Source, Level::Good, why);
        self.ended = None;
    }

    /// Whether nothing comes, so that somebody may ask why.
    pub fn is_quiet(&self) -> bool {
        self.any_ns.is_none() || self.any.stopped
    }

    /// Sets what a silence may come from; shown while nothing comes.
    pub fn advise(&mut self, advice: Option<String>) {
        self.advice = advice;
    }

    /// How many lines of the source can't be read; the first one is an event.
    pub fn unreadable(&mut self, count: u64) {
        let is_first = self.unreadable == 0 && count > 0;
        self.unreadable = count;
        if is_first {
            let text = "lines of the adapter can't be read, and their frames are missing: check \
                        its cable and the baud rate of its port";
            self.note(Kind::Source, Level::Warning, text.to_owned());
        }
    }

    /// Something of no instrument has happened just now.
    pub fn note(&mut self, kind: Kind, level: Level, text: String) {
        let whom = Whom::default();
        self.events.add(self.now_ns, whom, kind, level, text);
    }

    /// A frame was seen at this time.
    pub fn take(&mut self, time_ns: u64, frame: &Frame) {
        self.reach(time_ns);
        self.heard();
        self.count(time_ns, frame);
    }

    /// A frame of our own was sent at this time: it is on the bus, and nobody was heard by it.
    pub fn take_own(&mut self, time_ns: u64, frame: &Frame) {
        self.reach(time_ns);
        self.count(time_ns, frame);
    }

    fn reach(&mut self, time_ns: u64) {
        if !self.is_begun {
            self.is_begun = true;
            self.load.restart(time_ns);
            self.now_ns = time_ns;
        } else if time_ns.saturating_add(DISORDER_NS) < self.now_ns {
            self.jump_back(time_ns);
        }
        self.advance(time_ns.max(self.now_ns));
    }

    fn count(&mut self, time_ns: u64, frame: &Frame) {
        let news = self.watch.take(time_ns, frame);
        let is_sync = news == Meaning::Sync;
        self.load.take(self.now_ns, frame, is_sync);
        self.losses();
        self.read(news, frame);
        self.check();
    }

    /// Time goes on without a frame.
    pub fn pass(&mut self, now_ns: u64) {
        self.advance(now_ns);
        self.watch.pass(self.now_ns);
        self.losses();
    }

    fn advance(&mut self, now_ns: u64) {
        self.now_ns = self.now_ns.max(now_ns);
        let now_ns = self.now_ns;
        self.load.advance(now_ns);
        if let Some(age) = self.any.overdue_ns(now_ns, SILENCE) {
            self.any.stopped = true;
            let text = format!("nothing has come for {:.1} s", age as f64 / 1e9);
            self.note(Kind::Silence, Level::Warning, text);
        }
        if let Some(age) = self.sync.overdue_ns(now_ns, SYNC) {
            self.sync.stopped = true;
            let text = format!("SYNC has stopped: none for {:.1} s", age as f64 / 1e9);
            self.note(Kind::Sync, Level::Warning, text);
        }
    }

    /// Tells of heartbeats that are lost by now.
    fn losses(&mut self) {
        for pair in 0..self.pairs.len() {
            for side in 0..2 {
                let place = Place {
                    pair: pair as u16,
                    side,
                };
                let lost = self
                    .side(place)
                    .and_then(|side| side.heartbeat.lost_since_ns());
                lost.into_iter()
                    .for_each(|since_ns| self.lost(place, since_ns));
            }
        }
    }

    fn lost(&mut self, place: Place, since_ns: u64) {
        let age_s = self.now_ns.saturating_sub(since_ns) as f64 / 1e9;
        let extra = self.extra(place).filter(|extra| !extra.is_lost);
        let Some(extra) = extra else {
            return;
        };
        extra.is_lost = true;
        let text = format!("heartbeat lost: none for {age_s:.1} s");
        self.add_event(place, Kind::Heartbeat, Level::Fault, text);
    }

    fn heard(&mut self) {
        if self.any.stopped
            && let Some(last) = self.any_ns
        {
            let gap = self.now_ns.saturating_sub(last) as f64 / 1e9;
            let text = format!("received again after {gap:.1} s");
            self.note(Kind::Silence, Level::Good, text);
        }
        self.any.take(self.now_ns);
        self.any_ns = Some(self.now_ns);
    }

    fn jump_back(&mut self, time_ns: u64) {
        let back = (self.now_ns - time_ns) as f64 / 1e9;
        self.now_ns = time_ns;
        self.note(
            Kind::Time,
            Level::Warning,
            format!("the source's time goes back by {back:.1} s"),
        );
        self.load.restart(time_ns);
        self.any.restart(time_ns);
        self.sync.restart(time_ns);
        for pair in &mut self.pairs {
            pair.trace.clear();
            pair.delta = None;
            pair.measured = None;
            for extra in &mut pair.sides {
                extra.quality = None;
                // Nothing of before is younger than now.
                extra.floor_ns = 0;
            }
        }
    }

    fn read(&mut self, news: Meaning, frame: &Frame) {
        match news {
            Meaning::Sync => self.synced(),
            Meaning::Slopes(place, delta) => self.sloped(place, delta),
            Meaning::Detail(place) => {
                let now_ns = self.now_ns;
                if let Some(extra) = self.extra(place) {
                    extra.detail.take(now_ns);
                }
            }
            Meaning::Exchange(place, _) => self.exchanged(place),
            Meaning::Emergency(place, emergency) => self.emergency(place, &emergency),
            Meaning::Heartbeat(place, beat) => self.heartbeat(place, beat),
            // Shown while it is young, by its own time.
            Meaning::Angle(_) | Meaning::Rates(_) | Meaning::Turned(_) => {}
            Meaning::Malformed(place) => self.malformed(place, frame),
            Meaning::Other => self.stranger(frame),
        }
    }

    fn extra(&mut self, place: Place) -> Option<&mut Extra> {
        let pair = self.pairs.get_mut(usize::from(place.pair))?;
        pair.sides.get_mut(usize::from(place.side))
    }

    fn add_event(&mut self, place: Place, kind: Kind, level: Level, text: String) {
        let whom = whom(usize::from(place.pair), usize::from(place.side));
        self.events.add(self.now_ns, whom, kind, level, text);
    }

    fn synced(&mut self) {
        if self.sync.stopped {
            self.note(Kind::Sync, Level::Good, "SYNC is there again".to_owned());
        }
        self.sync.take(self.now_ns);
    }

    fn sloped(&mut self, place: Place, delta: Option<Delta>) {
        let now_ns = self.now_ns;
        let [pair, side] = [usize::from(place.pair), usize::from(place.side)];
        let slopes = self.watch.pairs().get(pair).and_then(|p| {
            let side = p.sides.get(side)?;
            side.slopes
        });
        let (Some(slopes), Some(known)) = (slopes, self.pairs.get_mut(pair)) else {
            return;
        };
        known.trace.add(now_ns, 2 * side, &slopes.mdeg);
        if let Some(delta) = delta {
            if known.measured.is_none() {
                known.trace.add(now_ns, 4, &delta.mdeg);
            }
            known.delta = Some((now_ns, delta));
        }
        let Some(extra) = known.sides.get_mut(side) else {
            return;
        };
        extra.slopes.take(now_ns);
        // Slopes that come without a state say nothing new of it.
        let Some(state) = slopes.state else {
            return;
        };
        if extra.state.replace(state) == Some(state) {
            return;
        }
        let text = words::state(state, seen_from(side)).into_owned();
        self.add_event(place, Kind::Verdict, level::of_state(state), text);
    }

    fn exchanged(&mut self, place: Place) {
        let now_ns = self.now_ns;
        let told = self.side(place).and_then(|side| side.told);
        if let (Some(told), Some(extra)) = (told, self.extra(place)) {
            extra.quality = Some((now_ns, told.exchange.quality));
        }
        let at = usize::from(place.pair);
        let (Some(pair), Some(known)) = (self.watch.pairs().get(at), self.pairs.get_mut(at)) else {
            return;
        };
        let counted = known.measured.map_or(0, |(_, _, count)| count);
        if pair.exchanges > counted {
            known.trace.add(now_ns, 4, &pair.exchanged_mdeg);
            known.measured = Some((now_ns, pair.exchanged_mdeg, pair.exchanges));
        }
    }

    fn side(&self, place: Place) -> Option<&Side> {
        let pair = self.watch.pairs().get(usize::from(place.pair))?;
        pair.sides.get(usize::from(place.side))
    }

    /// Tells of each kind of thing that does not fit together when it is found first.
    fn check(&mut self) {
        for (instrument, pair) in self.watch.pairs().iter().enumerate() {
            let extras = self.pairs.get_mut(instrument).map(|pair| &mut pair.sides);
            for (number, (side, extra)) in pair
                .sides
                .iter()
                .zip(extras.into_iter().flatten())
                .enumerate()
            {
                for (check, _) in side.checks.found() {
                    let bit = 1 << check as u16;
                    // A frame of a wrong length is told with its identifier.
                    if extra.checked & bit != 0 || check == Check::Length {
                        continue;
                    }
                    extra.checked |= bit;
                    let text = format!("first of: {}", check.words());
                    let whom = whom(instrument, number);
                    let (kind, level) = (Kind::Check, Level::Warning);
                    self.events.add(self.now_ns, whom, kind, level, text);
                }
            }
        }
    }

    fn emergency(&mut self, place: Place, emergency: &Emergency) {
        let faults = self.side(place).map_or(0, |side| side.faults);
        let Some(extra) = self.extra(place) else {
            return;
        };
        // A set that has a new fault may already lack one whose 0000h is still to come.
        let before = extra.told;
        extra.told = if emergency.code == 0 {
            faults
        } else {
            before | faults
        };
        let (level, mut text) = level::of_emergency(emergency, before);
        let [.., b6, _] = emergency.bytes;
        let of_the_bus = matches!(emergency.code, 0x6101..=0x6105 | 0x8000..=0x8FFF);
        if !of_the_bus {
            let why = words::reason(b6 & 0x3F);
            if let (Some(why), true) = (&why, level == Level::Fault) {
                text = format!("{text} ({why})");
            }
            if let Some(extra) = self.extra(place) {
                extra.blame = why;
            }
        }
        let text = match emergency.code {
            0 => text,
            code => format!("EMCY {code:04X}h: {text}"),
        };
        self.add_event(place, Kind::Emergency, level, text);
    }

    fn heartbeat(&mut self, place: Place, beat: Beat) {
        if let Some(since_ns) = beat.lost_since_ns {
            self.lost(place, since_ns);
        }
        let (now_ns, state) = (self.now_ns, beat.changed);
        let Some(extra) = self.extra(place) else {
            return;
        };
        let again = std::mem::take(&mut extra.is_lost);
        if state == Some(State::Initialising) {
            extra.floor_ns = now_ns;
            extra.state = None;
            extra.blame = None;
            extra.quality = None;
            extra.told = 0;
        }
        if again {
            let text = "heartbeat is there again".to_owned();
            self.add_event(place, Kind::Heartbeat, Level::Good, text);
        }
        let (level, text) = match state {
            Some(State::Initialising) => (Level::Warning, "the node has started".to_owned()),
            Some(state) => (Level::Good, format!("the node is {}", words::nmt(state))),
            None => return,
        };
        self.add_event(place, Kind::Nmt, level, text);
    }

    fn malformed(&mut self, place: Place, frame: &Frame) {
        let id = frame.cob_id().unwrap_or_default();
        let text = format!(
            "frame {id:03X}h of {} bytes has not the form that was delivered",
            frame.bytes().len()
        );
        self.add_event(place, Kind::Stranger, Level::Warning, text);
    }

    /// A heartbeat of a node that is not watched is told once.
    fn stranger(&mut self, frame: &Frame) {
        let Some(id) = frame.cob_id().filter(|id| id & 0x780 == 0x700) else {
            return;
        };
        let bit = 1 << (id & 0x7F);
        if frame.bytes().len() == 1 && self.strangers & bit == 0 {
            self.strangers |= bit;
            let text = format!("node {} is also on the bus and is not monitored", id & 0x7F);
            self.note(Kind::Stranger, Level::Good, text);
        }
    }
}

const fn whom(instrument: usize, side: usize) -> Whom {
    Whom {
        instrument: Some(instrument),
        side: Some(side),
    }
}
