//! The plain view: a line for each second, and one for each event.
//!
//! In: snapshots and events. Out: text for a person, and objects for `--json`. What is absent is
//! `--`, and the line's end states why.
//!
//! Left out: when they are printed.

use std::fmt::Write as _;

use serde::Serialize;

use super::clock::clock;
use super::events::Event;
use super::level::Level;
use super::snapshot::{Bus, Channel, Compared, FORMAT, Instrument, Snapshot, SourceState, VERSION};
use output::{plural, printable};

/// What `--json` prints for an event, and first where there is a page.
#[derive(Serialize)]
pub struct Record<T> {
    format: &'static str,
    version: u32,
    record: &'static str,
    #[serde(flatten)]
    content: T,
}

impl<T> Record<T> {
    /// The object.
    pub const fn new(record: &'static str, content: T) -> Self {
        Self {
            format: FORMAT,
            version: VERSION,
            record,
            content,
        }
    }
}

/// A signed angle, or `--`.
pub fn degrees(value: Option<f64>) -> String {
    value.map_or_else(|| "--".to_owned(), |deg| format!("{deg:+.3}"))
}

/// A word for how bad something is.
pub const fn level(level: Level) -> &'static str {
    match level {
        Level::Good => "ok",
        Level::Unknown => "?",
        Level::Warning => "warning",
        Level::Fault => "FAULT",
    }
}

/// A line for each instrument, each with its line feed.
pub fn state(snapshot: &Snapshot) -> String {
    let mut text = String::new();
    let many = snapshot.instruments.len() > 1;
    for instrument in &snapshot.instruments {
        let time = clock(snapshot.time_s);
        let number = if many {
            format!("{} ", instrument.number)
        } else {
            String::new()
        };
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "{time}  {number}{}  {}",
            values(instrument),
            bus(&snapshot.bus)
        );
    }
    text
}

fn values(instrument: &Instrument) -> String {
    let [a, b] = &instrument.channels;
    let band = instrument.band_deg.map_or_else(String::new, |band| {
        let word = match instrument.inside_band {
            Some(false) => ", beyond it as 1 of 20 is",
            _ => "",
        };
        format!(" (band {band:.3}{word}{})", of(instrument))
    });
    format!(
        "{}  {}  A-B {} {}{band}  {}",
        channel(a),
        channel(b),
        degrees(instrument.difference_x_deg),
        degrees(instrument.difference_y_deg),
        verdict(instrument)
    )
}

/// What a difference holds besides, where it is not of what was measured.
pub fn of(instrument: &Instrument) -> &'static str {
    match instrument.difference_of {
        Compared::Measured => "",
        Compared::Slopes => ", of slopes with their presets",
    }
}

fn channel(channel: &Channel) -> String {
    let [x, y] = [channel.slope_x_deg, channel.slope_y_deg].map(degrees);
    let temperature = channel
        .temperature_degc
        .map_or_else(String::new, |degc| format!(" {degc} degC"));
    format!("{} {x} {y}{temperature}{}", channel.name, motion(channel))
}

/// What an instrument with a gyroscope tells of this moment, where it does; begins with a space.
pub fn motion(channel: &Channel) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let slopes = [channel.slope_x_now_deg, channel.slope_y_now_deg];
    if slopes != [None; 2] {
        let [x, y] = slopes.map(degrees);
        let _ = write!(text, " now {x} {y}");
    }
    if let Some([x, y, z]) = channel.rates_deg_s {
        let _ = write!(text, " turning {x:+.2} {y:+.2} {z:+.2} deg/s");
    }
    text
}

/// The verdict in one line: how bad, what, and why.
pub fn verdict(instrument: &Instrument) -> String {
    let verdict = &instrument.verdict;
    let why = verdict
        .reason
        .as_ref()
        .map_or_else(String::new, |reason| format!(" ({reason})"));
    format!("{}: {}{why}", level(verdict.level), verdict.text)
}

/// How many lines can't be read.
pub fn unreadable(count: u64) -> String {
    format!("{} unreadable", plural(count, "line", "lines"))
}

/// Load and rates of the bus, or why there are none.
pub fn bus(bus: &Bus) -> String {
    let load = match bus.load_percent {
        Some(percent) => format!("{percent:.1} %"),
        None => format!("{:.1} kbit/s", bus.bits_per_s as f64 / 1000.0),
    };
    let mut text = format!("{} frames/s {load}", bus.frames_per_s);
    if bus.malformed > 0 {
        let _ = write!(text, ", {} malformed", bus.malformed);
    }
    if bus.unreadable > 0 {
        let _ = write!(text, ", {}", unreadable(bus.unreadable));
    }
    if let Some(state) = &bus.state_text
        && bus.state != SourceState::Running
    {
        let _ = write!(text, ", {}", printable(state));
    }
    text
}

/// One event, without a line feed.
pub fn event(event: &Event) -> String {
    format!(
        "{}  {}{}",
        clock(event.time_s),
        level_mark(event.level),
        told(event)
    )
}

fn level_mark(of: Level) -> String {
    match of {
        Level::Good | Level::Unknown => String::new(),
        worse => format!("{}: ", level(worse)),
    }
}

/// Whom an event is about and what has happened.
pub fn told(event: &Event) -> String {
    let whom = match (event.instrument, event.channel) {
        (Some(number), Some(channel)) if number > 1 => format!("{channel} of {number}: "),
        (_, Some(channel)) => format!("{channel}: "),
        _ => String::new(),
    };
    let times = match event.times {
        1 => String::new(),
        times => format!(" ({times} times)"),
    };
    format!("{whom}{}{times}", printable(&event.text))
}

#[cfg(test)]
mod tests {
    use super::super::events::{Kind, Whom};
    use super::super::model::{Model, Setup};
    use super::super::moment;
    use super::*;
    use canopen::Frame;
    use listen::Plan;

    fn seen() -> Snapshot {
        let mut model = Model::new(&Plan::default(), Setup::default());
        let start = 1_700_000_000_000_000_000;
        model.take(start, &Frame::data_frame(0x80, &[]));
        let a = Frame::data_frame(0x181, &[0xE8, 3, 0x9C, 0xFF, 0x7F, 1]);
        model.take(start, &a);
        let b = Frame::data_frame(0x182, &[0xE6, 3, 0, 0x80, 0x7D, 1]);
        model.take(start, &b);
        moment::snapshot(&model)
    }

    #[test]
    fn a_line_has_both_angles_and_what_is_missing() {
        let text = state(&seen());
        let start = "22:13:20.0  A +10.000 -1.000  B +9.980 --  A-B +0.020 --  ok: both agree";
        assert!(text.starts_with(start), "{text}");
        assert_eq!(text.lines().count(), 1);
    }

    #[test]
    fn angle_and_rates_of_the_moment_are_in_the_line_while_they_come() {
        let mut model = Model::new(&Plan::default(), Setup::default());
        let start = 1_700_000_000_000_000_000;
        model.take(start, &Frame::data_frame(0x181, &[0, 0, 0, 0, 0x7F, 1]));
        let now = Frame::data_frame(0x201, &[0xE8, 3, 0x9C, 0xFF, 20, 0, 0, 0]);
        model.take(start, &now);
        let rates = Frame::data_frame(0x301, &[0x60, 0xF0, 0, 0, 1, 0, 0]);
        model.take(start, &rates);
        let snapshot = moment::snapshot(&model);
        assert_eq!(
            motion(&snapshot.instruments[0].channels[0]),
            " now +10.000 -1.000 turning -40.00 +0.00 +0.01 deg/s"
        );
        assert_eq!(motion(&snapshot.instruments[0].channels[1]), "");
        model.pass(start + 3_000_000_000);
        let snapshot = moment::snapshot(&model);
        assert_eq!(motion(&snapshot.instruments[0].channels[0]), "");
    }

    #[test]
    fn nothing_from_outside_breaks_a_line() {
        let mut snapshot = seen();
        snapshot.bus.state = SourceState::Lost;
        snapshot.bus.state_text = Some("gone\n\u{1b}[2J".to_owned());
        assert_eq!(state(&snapshot).lines().count(), 1);
        assert!(!state(&snapshot).contains('\u{1b}'));
    }

    #[test]
    fn an_event_is_a_line_and_an_object() {
        let mut model = Model::new(&Plan::default(), Setup::default());
        let whom = Whom {
            instrument: Some(0),
            side: Some(1),
        };
        let text = "heartbeat lost".to_owned();
        let events = &mut model.events;
        events.add(0, whom, Kind::Heartbeat, Level::Fault, text);
        let one = model.events.since(0).next().unwrap();
        assert_eq!(event(one), "0.0 s  FAULT: B: heartbeat lost");
        let object = serde_json::to_string(&Record::new("event", one)).unwrap();
        let start = r#"{"format":"plumb-monitor","version":1,"record":"event","number":1,"#;
        assert!(object.starts_with(start), "{object}");
        assert!(object.contains(r#""kind":"heartbeat","level":"fault","#));
    }
}
