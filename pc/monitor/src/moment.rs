//! From what the model has to what a view shows at one moment.
//!
//! In: a [`Model`]. Out: its [`Snapshot`]. A value that is too old is left out, and the reason
//! states how old it is and, where that is known, why no newer one comes.
//!
//! Left out: anything that changes the model.

use canopen::nmt::State;

use super::events::{NAMES, seconds, seen_from};
use super::level::{self, Level};
use super::model::{DETAIL, Extra, Model, PairExtra, SLOPES};
use super::pace::{Pace, Patience};
use super::snapshot::{
    Bus, Channel, Compared, FORMAT, FindingCount, Instrument, Snapshot, SourceState, StandingFault,
    VERSION, Verdict,
};
use codes::words;
use listen::{Detail, Now, Pair, Side, Slopes};

/// k of the expanded uncertainty.
const COVERAGE: f64 = 2.0;

/// Each of two slopes is rounded to a count of 0.01 deg, so their difference may be off by one.
const RESOLUTION_DEG: f64 = 0.01;

/// What is shown where no PDO carries the state.
const NOT_SENT: &str = "no verdict: the state of the pair (2021h) is not sent";

/// Why slopes that the node marks as valid are not shown.
const OTHER_UNIT: &str = "another unit (6000h) than taken: state it by --eds";

/// TPDO 3's quality is a reason up to this.
const LAST_REASON: u8 = 31;

/// Everything at this moment.
pub fn snapshot(model: &Model) -> Snapshot {
    let instruments = model.watch.pairs().iter().zip(&model.pairs).enumerate();
    Snapshot {
        format: FORMAT,
        version: VERSION,
        record: "state",
        time_s: seconds(model.now_ns),
        bus: bus(model),
        instruments: instruments
            .map(|(number, (pair, extra))| instrument(model, number + 1, pair, extra))
            .collect(),
    }
}

fn bus(model: &Model) -> Bus {
    let rates = model.load.per_second();
    let counts = model.watch.counts();
    let (state, state_text) = source(model);
    let load = model.setup.bit_rate.filter(|rate| *rate > 0);
    let recording = &model.recording;
    Bus {
        name: model.setup.name.clone(),
        state,
        state_text,
        frames: counts.frames,
        frames_per_s: rates.frames,
        syncs_per_s: rates.syncs,
        bits_per_s: rates.bits,
        bit_rate_per_s: load,
        load_percent: load.map(|rate| rates.bits as f64 * 100.0 / f64::from(rate)),
        load_reason: load
            .is_none()
            .then(|| "the bit rate is not known: give it by --bitrate".to_owned()),
        malformed: counts.malformed,
        unreadable: model.unreadable,
        others: counts.others,
        backwards: counts.backwards,
        recording: recording.name.clone(),
        recorded: recording.frames,
        recording_reason: recording.ended.clone(),
    }
}

fn source(model: &Model) -> (SourceState, Option<String>) {
    if let Some((state, why)) = &model.ended {
        return (*state, Some(why.clone()));
    }
    let advice = |text: String| match &model.advice {
        Some(advice) => format!("{text}: {advice}"),
        None => text,
    };
    match model.any_ns {
        None => {
            let text = "nothing was received yet".to_owned();
            (SourceState::Waiting, Some(advice(text)))
        }
        Some(last) if model.any.stopped => {
            let age = model.now_ns.saturating_sub(last) as f64 / 1e9;
            let text = format!("nothing has come for {age:.0} s");
            (SourceState::Silent, Some(advice(text)))
        }
        Some(_) => (SourceState::Running, None),
    }
}

/// Age of what was seen at a time; `None` when it belongs to another time: before the node's
/// restart, or before the source's time went back.
fn age_ns(model: &Model, extra: &Extra, time_ns: u64) -> Option<u64> {
    let age = model.now_ns.checked_sub(time_ns);
    // Frames out of order by a little are of now.
    let age = age.or_else(|| (time_ns - model.now_ns < 1_000_000_000).then_some(0))?;
    (time_ns >= extra.floor_ns).then_some(age)
}

fn instrument(model: &Model, number: usize, pair: &Pair, extra: &PairExtra) -> Instrument {
    let [a, b] = &pair.sides;
    let [extra_a, extra_b] = &extra.sides;
    let channels = [channel(model, 0, a, extra_a), channel(model, 1, b, extra_b)];
    let [x, y] = [0, 1].map(|axis| difference(model, extra, &channels, axis));
    let reason = x.as_ref().err().or(y.as_ref().err()).cloned();
    let band = band(&channels);
    let there: Vec<f64> = [&x, &y].into_iter().flatten().copied().collect();
    let inside = |band: f64| there.iter().all(|d| d.abs() <= band + RESOLUTION_DEG);
    Instrument {
        number,
        difference_x_deg: x.ok(),
        difference_y_deg: y.ok(),
        difference_of: if measured(model, extra).is_some() {
            Compared::Measured
        } else {
            Compared::Slopes
        },
        difference_reason: reason,
        band_deg: band,
        inside_band: band.filter(|_| !there.is_empty()).map(inside),
        verdict: verdict(extra, &channels),
        channels,
    }
}

fn difference(
    model: &Model,
    extra: &PairExtra,
    channels: &[Channel; 2],
    axis: usize,
) -> Result<f64, String> {
    // What is compared is what was measured; slopes have each channel's preset in them. It is there
    // while the pair disagrees, too.
    let measured = measured(model, extra);
    if let Some(mdeg) = measured.and_then(|mdeg| mdeg.get(axis).copied().flatten()) {
        return Ok(f64::from(mdeg) / 1000.0);
    }
    let without = channels
        .iter()
        .filter(|channel| channel.slope_deg(axis).is_none());
    let without: Vec<_> = without.map(|channel| channel.name).collect();
    if !without.is_empty() {
        return Err(format!("no angle of {}", without.join(" and ")));
    }
    let limit = SLOPES.limit_ns(extra.sides[0].slopes.interval_ns());
    let is_fresh = |time_ns: u64| model.now_ns.saturating_sub(time_ns) <= limit;
    let sloped = extra.delta.filter(|(time_ns, _)| is_fresh(*time_ns));
    let sloped = sloped.and_then(|(_, delta)| delta.mdeg.get(axis).copied().flatten());
    match sloped.filter(|_| measured.is_none()) {
        Some(mdeg) => Ok(f64::from(mdeg) / 1000.0),
        None => Err("the two channels have not reported the same SYNC".to_owned()),
    }
}

/// The difference of the angles as measured (TPDO 3), 0.001 deg, while it is fresh.
fn measured(model: &Model, extra: &PairExtra) -> Option<[Option<i32>; 2]> {
    let limit = SLOPES.limit_ns(extra.sides[0].slopes.interval_ns());
    let measured = extra.measured;
    let fresh = measured.filter(|(time_ns, ..)| model.now_ns.saturating_sub(*time_ns) <= limit);
    fresh.map(|(_, mdeg, _)| mdeg)
}

fn band(channels: &[Channel; 2]) -> Option<f64> {
    let [a, b] = channels;
    Some(a.uncertainty_deg?.hypot(b.uncertainty_deg?))
}

/// 2020h in words, also where the slopes come without it.
fn validity_text(bits: Option<u8>) -> String {
    bits.map_or("not sent".to_owned(), |bits| {
        words::validity(bits).join(", ")
    })
}

fn channel(model: &Model, number: usize, side: &Side, extra: &Extra) -> Channel {
    let slopes = fresh(model, extra, SLOPES, extra.slopes, side.slopes, |s| {
        s.time_ns
    });
    let detail = fresh(model, extra, DETAIL, extra.detail, side.detail, |d| {
        d.time_ns
    });
    let why = |old: &Option<f64>| absent(model, side, *old);
    let other_unit = slopes.is_ok() && side.has_another_unit();
    let [x, y] = [0, 1].map(|axis| match other_unit {
        true => Err(OTHER_UNIT.to_owned()),
        false => slope(model, extra, slopes.as_ref(), axis, why),
    });
    let angle_now = Some(side.now).filter(|now| is_young(model, extra, now.angle_ns));
    let heartbeat_ns = side.nmt.map(|(_, time_ns)| time_ns);
    let now_ns = model.now_ns;
    let detail_value: Option<Detail> = detail.as_ref().ok().copied();
    let slopes_value: Option<Slopes> = slopes.as_ref().ok().copied();
    let validity = slopes_value.and_then(|slopes| slopes.validity);
    Channel {
        name: NAMES[number & 1],
        node_id: side.node_id,
        slope_x_deg: x.as_ref().ok().copied(),
        slope_y_deg: y.as_ref().ok().copied(),
        slope_x_reason: x.err(),
        slope_y_reason: y.err(),
        other_unit,
        stale: slopes.is_err(),
        slopes_age_s: side
            .slopes
            .and_then(|s| age_ns(model, extra, s.time_ns))
            .map(|age| age as f64 / 1e9),
        validity,
        validity_text: slopes_value.map(|slopes| validity_text(slopes.validity)),
        state: slopes_value.and_then(|s| s.state),
        uncertainty_deg: detail_value
            .and_then(|d| d.uncertainty_mdeg)
            .map(|mdeg| COVERAGE * f64::from(mdeg) / 1000.0),
        difference_deg: detail_value
            .and_then(|d| d.difference_mdeg)
            .map(|mdeg| f64::from(mdeg) / 1000.0),
        latency_ms: detail_value.and_then(|d| d.latency_ms),
        temperature_degc: detail_value.and_then(|d| d.temperature_degc),
        detail_reason: detail.err().map(|old| why(&old)),
        slope_x_now_deg: angle_now.and_then(|now| now.mdeg[0]).map(degrees),
        slope_y_now_deg: angle_now.and_then(|now| now.mdeg[1]).map(degrees),
        uncertainty_now_deg: angle_now
            .and_then(|now| now.uncertainty_mdeg)
            .map(|mdeg| COVERAGE * degrees(i32::from(mdeg))),
        rates_deg_s: rates_deg_s(model, extra, &side.now),
        nmt: side.nmt.map(|(state, _)| words::nmt(state).to_owned()),
        heartbeat_age_s: heartbeat_ns.map(|ns| now_ns.saturating_sub(ns) as f64 / 1e9),
        heartbeat_lost: side.heartbeat.lost_since_ns().is_some(),
        boots: side.boots,
        faults: faults(side.faults),
        findings: findings(side),
    }
}

/// Whether what came at this time is as young as slopes have to be.
fn is_young(model: &Model, extra: &Extra, time_ns: Option<u64>) -> bool {
    let age = time_ns.and_then(|time_ns| age_ns(model, extra, time_ns));
    age.is_some_and(|age| age <= SLOPES.limit_ns(extra.slopes.interval_ns()))
}

fn rates_deg_s(model: &Model, extra: &Extra, now: &Now) -> Option<[f64; 3]> {
    let [x, y, z] = now.rates.map(|rate| Some(f64::from(rate?) / 100.0));
    let young = is_young(model, extra, now.rates_ns);
    Some([x?, y?, z?]).filter(|_| young)
}

fn degrees(mdeg: i32) -> f64 {
    f64::from(mdeg) / 1000.0
}

fn faults(bits: u32) -> Vec<StandingFault> {
    let standing = |fault: device::fault::Fault| StandingFault {
        number: fault as u8,
        code: fault.report().0,
        text: fault.text(),
    };
    words::faults(bits).map(standing).collect()
}

fn findings(side: &Side) -> Vec<FindingCount> {
    let found = side.checks.found();
    found
        .map(|(check, finding)| FindingCount {
            name: check.name(),
            text: check.words(),
            count: finding.count,
        })
        .collect()
}

/// What is young enough; else its age in s, where it has one.
fn fresh<T: Copy>(
    model: &Model,
    extra: &Extra,
    patience: Patience,
    pace: Pace,
    value: Option<T>,
    time_ns: impl Fn(&T) -> u64,
) -> Result<T, Option<f64>> {
    let value = value.ok_or(None)?;
    let age = age_ns(model, extra, time_ns(&value)).ok_or(None)?;
    if age <= patience.limit_ns(pace.interval_ns()) {
        Ok(value)
    } else {
        Err(Some(age as f64 / 1e9))
    }
}

fn slope(
    model: &Model,
    extra: &Extra,
    slopes: Result<&Slopes, &Option<f64>>,
    axis: usize,
    why: impl Fn(&Option<f64>) -> String,
) -> Result<f64, String> {
    let slopes = match slopes {
        Ok(slopes) => slopes,
        Err(old) => return Err(why(old)),
    };
    if let Some(mdeg) = slopes.mdeg.get(axis).copied().flatten() {
        return Ok(f64::from(mdeg) / 1000.0);
    }
    // TPDO 3 has it for each axis, where it has no angle either.
    let limit = SLOPES.limit_ns(extra.slopes.interval_ns());
    let told = extra
        .quality
        .filter(|(time_ns, _)| age_ns(model, extra, *time_ns).is_some_and(|age| age <= limit));
    let code = told.and_then(|(_, quality)| quality.get(axis).copied());
    let reason = code
        .filter(|code| *code <= LAST_REASON)
        .and_then(words::reason);
    let by_state = || match slopes.state {
        Some(state) => words::no_slope(state),
        None => "the channel reports that it must not be used".into(),
    };
    Err(reason.unwrap_or_else(by_state).into_owned())
}

/// Why a channel has nothing fresh to show.
fn absent(model: &Model, side: &Side, old_s: Option<f64>) -> String {
    let why = if side.heartbeat.lost_since_ns().is_some() {
        "its heartbeat is lost"
    } else {
        match side.nmt.map(|(state, _)| state) {
            None if side.seen_ns.is_none() => "nothing was received from it",
            Some(State::Initialising) => "it has just started",
            Some(State::PreOperational) => "it is pre-operational, start it (NMT)",
            Some(State::Stopped) => "it is stopped, start it (NMT)",
            _ if model.sync.interval_ns().is_none() || model.sync.stopped => "there is no SYNC",
            _ => "its PDO does not come",
        }
    };
    match old_s {
        Some(age) => format!("stale, {age:.1} s old: {why}"),
        None => why.to_owned(),
    }
}

/// A state of the pair with the channels by their places, so that two views of it can be compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum View {
    Faulty(usize),
    Of(u8),
}

fn view(side: usize, state: u8) -> View {
    match state {
        7 => View::Faulty(side),
        8 => View::Faulty(1 - (side & 1)),
        state => View::Of(state),
    }
}

fn verdict(extra: &PairExtra, channels: &[Channel; 2]) -> Verdict {
    let [a, b] = channels;
    let text = |side: usize, state: u8| words::state(state, seen_from(side)).into_owned();
    let (level, text) = match (a.state, b.state) {
        (None, None) if !a.stale && !b.stale => (Level::Unknown, NOT_SENT.to_owned()),
        (None, None) if !a.stale => (Level::Fault, alone(NOT_SENT.to_owned(), b)),
        (None, None) if !b.stale => (Level::Fault, alone(NOT_SENT.to_owned(), a)),
        (None, None) => {
            let are_lost = a.heartbeat_lost && b.heartbeat_lost;
            let level = if are_lost {
                Level::Fault
            } else {
                Level::Unknown
            };
            (level, format!("no verdict: {}", a.slope_reason(0)))
        }
        (Some(one), Some(two)) if view(0, one) == view(1, two) => {
            (level::of_state(one), text(0, one))
        }
        (Some(one), Some(two)) => {
            let level = level::of_state(one).max(level::of_state(two));
            (
                level,
                format!("A reports: {}; B reports: {}", text(0, one), text(1, two)),
            )
        }
        (Some(state), None) if !b.stale => half(level::of_state(state), &text(0, state), b),
        (None, Some(state)) if !a.stale => half(level::of_state(state), &text(1, state), a),
        (Some(state), None) => (Level::Fault, alone(text(0, state), b)),
        (None, Some(state)) => (Level::Fault, alone(text(1, state), a)),
    };
    let (level, text) = with_unusable(level, text, channels);
    let (level, text) = with_units(level, text, channels);
    let (blamed, reason) = blamed(extra, [a.state, b.state]);
    Verdict {
        level,
        text,
        blamed,
        reason,
    }
}

/// The other channel is there, and its PDOs do not carry the state.
fn half(level: Level, text: &str, other: &Channel) -> (Level, String) {
    let text = format!("{text}; {} does not send its state (2021h)", other.name);
    (level.max(Level::Unknown), text)
}

/// Two channels may agree while their angles must not be used, as where these are too uncertain.
fn with_unusable(level: Level, text: String, channels: &[Channel; 2]) -> (Level, String) {
    if !matches!(level, Level::Good | Level::Warning) {
        return (level, text);
    }
    let unusable = |channel: &&Channel| {
        let none = channel.slope_x_deg.or(channel.slope_y_deg).is_none();
        channel.state.is_some() && !channel.other_unit && none
    };
    let found: Vec<_> = channels.iter().filter(unusable).collect();
    let Some(first) = found.first() else {
        return (level, text);
    };
    let names: Vec<_> = found.iter().map(|channel| channel.name).collect();
    let (names, why) = (names.join(" and "), first.slope_reason(0));
    (Level::Fault, format!("{text}; no angle of {names}: {why}"))
}

/// A verdict is of what the nodes compare; that slopes are not shown is said beside it.
fn with_units(level: Level, text: String, channels: &[Channel; 2]) -> (Level, String) {
    let others = channels.iter().filter(|channel| channel.other_unit);
    let names: Vec<_> = others.map(|channel| channel.name).collect();
    if names.is_empty() {
        return (level, text);
    }
    let units = format!("slopes of {}: {OTHER_UNIT}", names.join(" and "));
    // A line of a terminal has room for one of them.
    match level {
        Level::Fault => (level, format!("{text}; {units}")),
        _ => (Level::Warning, format!("{units}; {text}")),
    }
}

fn alone(text: String, silent: &Channel) -> String {
    let why = silent.slope_reason(0);
    format!("{text}; nothing from {}: {why}", silent.name)
}

/// Who is blamed, by the states of now, and why, by the latest EMCY that blames somebody.
fn blamed(extra: &PairExtra, states: [Option<u8>; 2]) -> (Vec<&'static str>, Option<String>) {
    let mut blamed = [false; 2];
    for (side, state) in states.into_iter().enumerate() {
        match state.map(|state| view(side, state)) {
            Some(View::Faulty(faulty)) => blamed[faulty & 1] = true,
            Some(View::Of(9)) => blamed = [true; 2],
            _ => {}
        }
    }
    let names = NAMES.into_iter().zip(blamed);
    let names: Vec<_> = names.filter(|(_, is)| *is).map(|(name, _)| name).collect();
    let wrong = |state: Option<u8>| state.is_some_and(|state| state >= 5);
    let told = extra.sides.iter().zip(states);
    let reason = told
        .filter(|(_, state)| wrong(*state))
        .find_map(|(side, _)| side.blame.clone().map(Into::into));
    (names, reason)
}
