//! One instrument under way: what stands between two of its frames.
//!
//! In: what `listen` makes of each frame, with the frame's time. Out: its [`Summary`], its
//! [`Events`], the [`Recorder`]'s captures and its gaps.
//!
//! Left out: frames of no instrument (`collector`).

use canopen::nmt::State;
use serde::{Deserialize, Serialize};

use super::bins::Extremes;
use super::capture::Recorder;
use super::days::DAY_NS;
use super::event::{End, What};
use super::events::Events;
use super::gaps::Gap;
use super::identity::Identity;
use super::join::Join;
use super::kind::Kind;
use super::motion::MotionSummary;
use super::summary::{ChannelSummary, Summary, Unusable};
use listen::{
    Beat, Detail, Emergency, GAP_NS, Meaning, Measured, Pair, Round, SAME_START_NS, Slopes,
};

/// A slope counts as such until the next one, for no longer than this, ns.
const HOLD_NS: u64 = 1_000_000_000;

/// Events closer than this to the one before are one incident, ns.
const INCIDENT_NS: u64 = 1_000_000_000;

/// Activity without a value: too few samples, and samples that are missing.
const TOO_FEW: u8 = 0;
const MISSING: u8 = 255;

/// Where a frame stands in the log.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Its time, ns.
    pub now_ns: u64,
    /// The frame of anybody before it, ns.
    pub before_ns: u64,
}

/// What is remembered of a channel.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Under {
    /// Since when its slopes are as they are: usable, or why not.
    #[serde(skip)]
    since: Option<(u64, Option<Unusable>)>,
    #[serde(skip)]
    reason: u8,
    #[serde(skip)]
    warned: bool,
    /// When it was seen first.
    #[serde(skip)]
    first_ns: Option<u64>,
    /// What it has answered about itself, where the log has it.
    identity: Identity,
}

/// One instrument.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Instrument {
    /// What has no end of its size: of the day under way, and after the end of the whole log.
    pub summary: Summary,
    /// Single events.
    pub events: Events,
    /// The SYNCs around them.
    pub recorder: Recorder,
    /// First and last frame of it, ns.
    pub span_ns: Option<(u64, u64)>,
    /// All days before.
    #[serde(skip)]
    done: Summary,
    /// When the day under way began, ns.
    #[serde(skip)]
    day_ns: u64,
    #[serde(skip)]
    last_ns: Option<u64>,
    #[serde(skip)]
    incident_ns: Option<u64>,
    /// SYNCs of the pair that were taken.
    #[serde(skip)]
    rounds: u64,
    sides: [Under; 2],
}

impl Instrument {
    /// Takes what a frame of channel `side` means, by now; with `keeps` a boot-up takes no fault
    /// back.
    #[inline]
    pub fn take(&mut self, at: Moment, news: Meaning, side: usize, pair: &Pair, keeps: bool) {
        self.rounds(pair);
        let Some(sent) = pair.sides.get(side) else {
            return;
        };
        let now_ns = at.now_ns;
        match news {
            Meaning::Slopes(..) => {
                if let Some(slopes) = &sent.slopes {
                    let other_unit = sent.has_another_unit();
                    self.slopes(now_ns, side, slopes, other_unit);
                }
            }
            Meaning::Detail(_) => {
                if let Some(detail) = &sent.detail {
                    self.detail(now_ns, side, detail);
                    self.difference_sent(side, pair);
                }
            }
            Meaning::Exchange(_, part) => {
                if let Some(told) = sent.told {
                    if part.has_angles() {
                        self.measured(side, Measured::of(&told.exchange));
                    }
                    if part.has_vector() {
                        self.activity(now_ns, side, told.exchange.activity);
                    }
                }
            }
            Meaning::Angle(_) => self.motion(side, |motion| motion.take_angle(now_ns, &sent.now)),
            Meaning::Rates(_) => self.motion(side, |motion| motion.take_rates(now_ns, &sent.now)),
            Meaning::Emergency(_, emergency) => {
                self.emergency(now_ns, side, &emergency, sent.faults);
            }
            Meaning::Heartbeat(_, beat) => self.heartbeat(now_ns, side, beat, keeps),
            Meaning::Malformed(_) => return self.malformed(side),
            _ => {}
        }
        self.seen(at, side);
    }

    /// Takes the SYNC that has ended, if one has.
    #[inline]
    pub fn rounds(&mut self, pair: &Pair) {
        let (round, count) = pair.ended();
        if count == self.rounds {
            return;
        }
        self.rounds = count;
        if let Some(round) = round {
            self.close(round);
        }
    }

    fn close(&mut self, round: &Round) {
        let differences = [0, 1].map(|axis| round.difference(axis));
        let day = self.summary.days.at(round.time_ns);
        day.syncs += 1;
        let all = differences.into_iter().flatten();
        if let Some(mdeg) = all.max_by_key(|mdeg| mdeg.unsigned_abs()) {
            day.largest_mdeg = day.largest_mdeg.max(Some(mdeg.unsigned_abs()));
            let bins = &mut self.summary.difference.bins;
            bins.add(round.time_ns, Extremes::of(mdeg));
            self.judge(round, differences);
        }
        self.recorder.record(round);
    }

    fn judge(&mut self, round: &Round, differences: [Option<i32>; 2]) {
        let difference = &mut self.summary.difference;
        let (mut known, mut above) = (false, false);
        let axes = difference.own.iter_mut().zip(differences);
        for (axis, (own, mdeg)) in axes.enumerate() {
            let Some(mdeg) = mdeg else {
                continue;
            };
            own.add(mdeg);
            if let Some(band) = round.band_mdeg(axis) {
                known = true;
                above |= f64::from(mdeg.unsigned_abs()) > band;
            }
        }
        difference.by_measured += u64::from(round.is_of_measured());
        difference.by_slopes += u64::from(!round.is_of_measured());
        difference.judged += u64::from(known);
        difference.above += u64::from(above);
    }

    /// Turns to the day of this time.
    #[cold]
    fn turn_to(&mut self, now_ns: u64) {
        self.day_ns = now_ns - now_ns % DAY_NS;
        self.done.join(&std::mem::take(&mut self.summary));
    }

    /// Any frame of the instrument that has the form it should have.
    #[inline]
    fn seen(&mut self, at: Moment, side: usize) {
        let now = at.now_ns;
        if now.wrapping_sub(self.day_ns) >= DAY_NS {
            self.turn_to(now);
        }
        let (first, last) = self.span_ns.unwrap_or((now, now));
        self.span_ns = Some((first.min(now), last.max(now)));
        if let Some(side) = self.sides.get_mut(side) {
            side.first_ns.get_or_insert(now);
        }
        let last = self.last_ns.replace(now).unwrap_or(now);
        let since = now.saturating_sub(last);
        if since <= GAP_NS {
            self.summary.days.at(last).covered_ns += since;
            return;
        }
        self.summary.gaps.add(Gap {
            from_ns: last,
            to_ns: now,
            whole_bus: at.before_ns <= last.saturating_add(GAP_NS),
        });
    }

    /// TPDO 1.
    fn slopes(&mut self, now_ns: u64, number: usize, slopes: &Slopes, other_unit: bool) {
        let warns = matches!(slopes.state, Some(2..=4));
        let is_new = warns && self.sides.iter().all(|side| !side.warned);
        let Some(side) = self.sides.get_mut(number) else {
            return;
        };
        let usable = slopes.mdeg.iter().any(Option::is_some);
        let unusable = (!usable).then_some(Unusable {
            state: slopes.state,
            reason: side.reason,
            other_unit,
        });
        side.warned = warns;
        let since = side.since.replace((now_ns, unusable));
        if let Some(channel) = self.summary.channels.get_mut(number) {
            hold(channel, since, now_ns);
            note_slopes(channel, now_ns, slopes);
        }
        if is_new {
            self.happened(now_ns, Kind::Warning);
        }
    }

    /// TPDO 3.
    fn measured(&mut self, number: usize, measured: Measured) {
        if let Some(side) = self.sides.get_mut(number) {
            side.reason = measured.reason().unwrap_or(0);
        }
    }

    /// TPDO 4.
    fn activity(&mut self, now_ns: u64, number: usize, activity: u8) {
        let is_measured = !matches!(activity, TOO_FEW | MISSING);
        if let (true, Some(channel)) = (is_measured, self.summary.channels.get_mut(number)) {
            let activity = i32::from(activity);
            channel.activity.add(activity);
            let bins = &mut channel.activity_bins;
            bins.add(now_ns, Extremes::of(activity));
        }
    }

    /// TPDO 5 or 6.
    fn motion(&mut self, number: usize, take: impl FnOnce(&mut MotionSummary)) {
        if let Some(channel) = self.summary.channels.get_mut(number) {
            take(channel.motion.get_or_insert_default());
        }
    }

    /// TPDO 2.
    fn detail(&mut self, now_ns: u64, number: usize, detail: &Detail) {
        let Some(channel) = self.summary.channels.get_mut(number) else {
            return;
        };
        if let Some(temperature) = detail.temperature_degc.map(i32::from) {
            channel.temperature.add(temperature);
            let bins = &mut channel.temperature_bins;
            bins.add(now_ns, Extremes::of(temperature));
        }
        match detail.uncertainty_mdeg.map(i32::from) {
            Some(mdeg) => {
                channel.uncertainty.add(mdeg);
                let bins = &mut channel.uncertainty_bins;
                bins.add(now_ns, Extremes::of(mdeg));
            }
            None => channel.uncertainty_unknown += 1,
        }
    }

    /// 2024h, against the differences of the last SYNCs.
    fn difference_sent(&mut self, number: usize, pair: &Pair) {
        let difference = &mut self.summary.difference;
        if let Some(mdeg) = pair.difference_sent(number) {
            difference.told.add(mdeg);
        }
        if let Some(off) = pair.difference_off(number) {
            difference.told_off.add(off.try_into().unwrap_or(i32::MAX));
        }
    }

    /// EMCY.
    fn emergency(&mut self, now_ns: u64, number: usize, told: &Emergency, faults: u32) {
        if let Some(channel) = self.summary.channels.get_mut(number) {
            channel.faults |= faults;
            *channel.emergencies.entry(told.code).or_default() += 1;
        }
        let placed = self.events.emergency(now_ns, number as u8, told);
        if told.code == 0 {
            return;
        }
        let kind = Kind::of(told.code);
        self.happened(now_ns, kind);
        if let (Some((place, true)), true) = (placed, kind.is_fault())
            && let Some(plot) = self.recorder.trigger(now_ns)
        {
            self.events.in_plot(place, plot);
        }
    }

    /// Counts an event, and an incident with it when it stands apart.
    fn happened(&mut self, now_ns: u64, kind: Kind) {
        self.summary.note(now_ns, kind);
        if !kind.is_fault() && kind != Kind::Warning {
            return;
        }
        let last = self.incident_ns.replace(now_ns);
        if last.is_none_or(|last| now_ns.abs_diff(last) > INCIDENT_NS) {
            self.summary.days.at(now_ns).incidents += 1;
        }
    }

    /// A heartbeat or boot-up.
    fn heartbeat(&mut self, now_ns: u64, number: usize, beat: Beat, keeps: bool) {
        let Some(side) = self.sides.get_mut(number) else {
            return;
        };
        let restarted = beat.changed == Some(State::Initialising);
        // What is sent at a start may overtake its boot-up message.
        let was_seen = side
            .first_ns
            .is_some_and(|first_ns| now_ns.abs_diff(first_ns) >= SAME_START_NS);
        if restarted {
            side.since = None;
            side.reason = 0;
            side.warned = false;
        }
        self.events.beat(now_ns, number as u8);
        if let Some(from_ns) = beat.lost_since_ns {
            self.lost(number, from_ns, now_ns, End::Over(now_ns));
        }
        if !restarted {
            return;
        }
        if let Some(channel) = self.summary.channels.get_mut(number) {
            channel.boots += 1;
        }
        if !keeps {
            self.events.restarted(now_ns, number as u8);
        }
        if was_seen {
            let side = number as u8;
            self.events
                .other(now_ns, side, What::Restart, End::Momentary);
            self.happened(now_ns, Kind::Restart);
        }
    }

    fn lost(&mut self, number: usize, from_ns: u64, to_ns: u64, end: End) {
        if let Some(channel) = self.summary.channels.get_mut(number) {
            channel.heartbeat_losses += 1;
            channel.heartbeat_lost_ns += to_ns.saturating_sub(from_ns);
        }
        let side = number as u8;
        self.events.other(from_ns, side, What::HeartbeatLost, end);
        self.happened(from_ns, Kind::Heartbeat);
    }

    /// A frame of another form than the plan has.
    fn malformed(&mut self, number: usize) {
        if let Some(channel) = self.summary.channels.get_mut(number) {
            channel.malformed += 1;
        }
    }

    /// An answer to an SDO: what it has of the identity is kept.
    pub fn sdo(&mut self, now_ns: u64, number: usize, bytes: &[u8]) {
        if let Some(side) = self.sides.get_mut(number) {
            side.identity.take(now_ns, bytes);
        }
    }

    /// What a channel has answered about itself.
    pub fn identity(&self, number: usize) -> Option<&Identity> {
        self.sides.get(number).map(|side| &side.identity)
    }

    /// True when nothing of it was seen.
    pub fn is_empty(&self) -> bool {
        let is_known = |side: &Under| !side.identity.is_empty();
        self.span_ns.is_none()
            && self.summary == Summary::default()
            && !self.sides.iter().any(is_known)
    }

    /// Takes what another log has of it; both have ended.
    pub fn merge(&mut self, other: &Self) {
        self.summary.join(&other.summary);
        let places = self.recorder.merge(&other.recorder);
        self.events.merge(&other.events, &places);
        self.span_ns = match (self.span_ns, other.span_ns) {
            (Some(own), Some(other)) => Some((own.0.min(other.0), own.1.max(other.1))),
            (own, other) => own.or(other),
        };
        for (own, other) in self.sides.iter_mut().zip(&other.sides) {
            own.identity.merge(&other.identity);
        }
    }

    /// The log has ended at this time, with the pair as it is.
    pub fn finish(&mut self, now_ns: u64, pair: &Pair) {
        self.rounds(pair);
        if !pair.under_way().is_empty() {
            self.close(pair.under_way());
        }
        for (number, side) in pair.sides.iter().enumerate() {
            if let Some(from_ns) = side.heartbeat.lost_since_ns() {
                self.lost(number, from_ns, now_ns, End::Standing);
            }
            if let Some(channel) = self.summary.channels.get_mut(number) {
                channel.checks.join(&side.checks);
            }
        }
        self.events.finish(now_ns);
        let last = std::mem::take(&mut self.summary);
        self.done.join(&last);
        self.summary = std::mem::take(&mut self.done);
    }
}

/// Counts the time since the slopes before, as what these were.
fn hold(channel: &mut ChannelSummary, since: Option<(u64, Option<Unusable>)>, now_ns: u64) {
    let Some((from_ns, unusable)) = since else {
        return;
    };
    let held_ns = now_ns.saturating_sub(from_ns);
    if held_ns > HOLD_NS {
        return;
    }
    match unusable {
        None => channel.usable_ns += held_ns,
        Some(why) => *channel.unusable_ns.entry(why).or_default() += held_ns,
    }
}

fn note_slopes(channel: &mut ChannelSummary, now_ns: u64, slopes: &Slopes) {
    channel.read(slopes.state);
    let axes = channel.slope.iter_mut().zip(&mut channel.slope_bins);
    for ((tally, bins), mdeg) in axes.zip(slopes.mdeg) {
        if let Some(mdeg) = mdeg {
            tally.add(mdeg);
            bins.add(now_ns, Extremes::of(mdeg));
        }
    }
}
