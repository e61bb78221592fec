//! What the numbers that nodes send mean, in words; the only table of them.
//!
//! In: the numbers of docs/canopen.md: states of the pair (2021h), reasons (2025h, 2027h sub 2),
//! channels that are blamed (2027h sub 1), validity (2020h), EMCY codes, faults, error register
//! (1001h), NMT states. Out: a few words each, short enough for the column of a table; a number
//! without a meaning keeps its number, but for an EMCY code, which stands beside its words.
//!
//! Left out: how bad something is, which is the monitor's; names of objects (`name`).

use std::borrow::Cow;

use canopen::nmt::State;
use device::exchange;
use device::fault::Fault;
use tilt::chain::Invalid;

/// A channel and the other one, where neither has a name.
pub const CHANNELS: [&str; 2] = ["this channel", "the other channel"];

/// The name of a channel.
pub const fn channel(side: usize) -> &'static str {
    if side == 0 { "A" } else { "B" }
}

/// The state of the pair (2021h) as one channel reports it, which is called `own`; see
/// [`CHANNELS`].
pub fn state(state: u8, [own, other]: [&str; 2]) -> Cow<'static, str> {
    let text = match state {
        0 => "not compared",
        1 => "both agree",
        2 => "the channels differ for a short time",
        3 => "stop the motion: the channels differ",
        4 => "both agree after late data",
        5 => "physical fault: the channels differ at standstill",
        6 => "the channels disagree and neither can be blamed",
        7 => return format!("{own} is faulty").into(),
        8 => return format!("{other} is faulty").into(),
        9 => "neither channel measures",
        _ => return format!("unknown state {state}").into(),
    };
    text.into()
}

/// A reason (2025h, 2027h sub 2) by its code; `None` for 0, which is no reason.
pub fn reason(code: u8) -> Option<Cow<'static, str>> {
    match exchange::reason(code) {
        Some(reason) => Some(invalid(reason).into()),
        None if code == 0 => None,
        None => Some(format!("unknown reason {code}").into()),
    }
}

/// [`reason`] where one has to be given.
pub fn because(code: u8) -> Cow<'static, str> {
    reason(code).unwrap_or("no reason given".into())
}

/// Why a channel has no angle.
pub const fn invalid(reason: Invalid) -> &'static str {
    match reason {
        Invalid::NoSample => "no sample yet",
        Invalid::Settling => "the filter settles",
        Invalid::Stale => "samples have stopped",
        Invalid::OverRange => "over full scale",
        Invalid::NoTemperature => "temperature not known",
        Invalid::NotMeasured => "this axis is not measured",
        Invalid::PartReset => "the sensor has lost its set-up",
        Invalid::Bus => "the sensor does not answer",
        Invalid::Stuck => "the sensor's codes stand still",
        Invalid::Noise => "noise in one channel only",
        Invalid::Spikes => "single samples are far off",
        Invalid::Thermometer => "the sensor's temperature jumps",
        Invalid::Biased => "moved alone, or gravity of the wrong length",
        Invalid::Corrupt => "the calibration is damaged",
        Invalid::Silent => "silent",
        Invalid::Late => "late data",
        Invalid::Refused => "the channels disagree",
        Invalid::Unconfirmed => "not compared with the other channel",
        Invalid::Alone => "degraded operation is forbidden",
        Invalid::Unlike => "the channels are set to show different angles",
        Invalid::Uncertain => "the uncertainty is above its limit",
    }
}

/// Why a channel sends no slope, from the state of the pair alone.
pub fn no_slope(state: u8) -> Cow<'static, str> {
    match state {
        0 => invalid(Invalid::Unconfirmed).into(),
        5 | 6 => invalid(Invalid::Refused).into(),
        7 | 9 => self::state(state, CHANNELS),
        8 => "the other channel is faulty, and this one may not go on alone".into(),
        _ => "the channel reports that it must not be used".into(),
    }
}

/// Which channel is blamed (2027h sub 1), by what the channel that reports it, the other one, and
/// both of them are called; `None` for neither.
pub const fn blamed(blamed: u8, [own, other, both]: [&str; 3]) -> Option<&str> {
    match blamed {
        1 => Some(own),
        2 => Some(other),
        3 => Some(both),
        _ => None,
    }
}

/// The bits of the validity (2020h) that a person has to know of.
pub fn validity(bits: u8) -> Vec<&'static str> {
    let slopes = match bits & 3 {
        0 => Some("not valid"),
        1 => Some("Y not valid"),
        2 => Some("X not valid"),
        _ => None,
    };
    let words = [
        slopes,
        (bits & 0x30 != 0x30).then_some("not compared"),
        (bits & 0x40 == 0).then_some("not calibrated"),
        (bits & 0x80 != 0).then_some("fault latched until a reset"),
    ];
    let mut words: Vec<_> = words.into_iter().flatten().collect();
    if words.is_empty() {
        words.push("valid");
    }
    words
}

/// The members of a set of faults (EMCY bytes 3 to 5), bit n for fault n.
pub fn faults(bits: u32) -> impl Iterator<Item = Fault> {
    let stands = move |fault: &Fault| bits >> (*fault as u8) & 1 != 0;
    Fault::ALL.into_iter().filter(stands)
}

/// The fault of the instrument that an EMCY code reports.
pub fn fault(code: u16) -> Option<Fault> {
    Fault::ALL
        .into_iter()
        .find(|fault| fault.report().0 == code)
}

/// An EMCY code where the bytes that came with it are not known.
pub fn code(code: u16) -> Cow<'static, str> {
    emergency(code, [0; 2])
}

/// An EMCY code with bytes 3 and 4 of its message, which name a node, a PDO, a length or a number
/// of frames; 0 is none.
pub fn emergency(code: u16, [low, high]: [u8; 2]) -> Cow<'static, str> {
    if let Some(fault) = fault(code) {
        return fault.text().into();
    }
    let rpdo = |what: &str| match low {
        0 => format!("an RPDO {what}").into(),
        pdo => format!("RPDO {pdo} {what}").into(),
    };
    match code {
        0 => "faults have gone".into(),
        0x6101 => "the previous program ended by a panic".into(),
        0x6102 => "the previous program ended by a hard fault".into(),
        0x6103 => "the previous program met an interrupt without a handler".into(),
        0x6104 => "the watchdog ended the previous program".into(),
        0x6105 => "the bootloader found nothing to start".into(),
        0x8110 => match u16::from_le_bytes([low, high]) {
            0 => "CAN overrun, frames were lost".into(),
            lost => format!("CAN overrun, frames lost: {lost}").into(),
        },
        0x8120 => "CAN error passive".into(),
        0x8130 => match low {
            0 => "the heartbeat of a supervised node was lost".into(),
            node => format!("the heartbeat of node {node} was lost").into(),
        },
        0x8140 => "back from bus-off".into(),
        0x8150 => "two nodes sent the same identifier".into(),
        0x8200 => rpdo("was refused"),
        0x8210 => rpdo("was too short"),
        0x8220 => rpdo("was too long"),
        0x8240 => match low {
            0 => "a SYNC had a wrong length".into(),
            length => format!("a SYNC had a wrong length, {length}").into(),
        },
        0x8250 => rpdo("was missed"),
        _ => "unknown code".into(),
    }
}

/// The bits of the error register (1001h) but the generic one.
pub fn error_register(bits: u8) -> impl Iterator<Item = &'static str> {
    const BITS: [&str; 7] = [
        "current",
        "voltage",
        "temperature",
        "communication",
        "profile",
        "reserved",
        "manufacturer",
    ];
    (1..)
        .zip(BITS)
        .filter(move |(bit, _)| bits >> bit & 1 != 0)
        .map(|(_, name)| name)
}

/// An NMT state (CiA 301).
pub const fn nmt(state: State) -> &'static str {
    match state {
        State::Initialising => "initialising",
        State::Stopped => "stopped",
        State::Operational => "operational",
        State::PreOperational => "pre-operational",
    }
}

/// What a heartbeat tells: an NMT state, or a number that stands for none.
pub fn told(state: Result<State, u8>) -> Cow<'static, str> {
    match state {
        Ok(state) => nmt(state).into(),
        Err(other) => format!("state {other}").into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOCUMENT: &str = include_str!("../../../docs/canopen.md");

    /// The cells of each row of the table in docs/canopen.md with this head.
    fn table(head: &str) -> Vec<Vec<&'static str>> {
        let (_, rest) = DOCUMENT.split_once(head).unwrap();
        let lines = rest
            .lines()
            .skip(2)
            .take_while(|line| line.starts_with('|'));
        let cells = |line: &'static str| line.trim_matches('|').split('|').map(str::trim).collect();
        lines.map(cells).collect()
    }

    #[test]
    fn the_document_s_reasons_are_these() {
        let rows = table("| reason | | reason | | reason | |");
        let cells = rows.iter().flat_map(|row| row.chunks(2));
        let mut listed: Vec<_> = cells.map(|c| (c[0].parse::<u8>().unwrap(), c[1])).collect();
        listed.sort_unstable();
        let all = (1..=u8::MAX).filter(|code| exchange::reason(*code).is_some());
        assert!(all.eq(listed.iter().map(|(code, _)| *code)));
        for (code, words) in listed {
            assert_eq!(reason(code).unwrap(), words, "{code}");
        }
    }

    #[test]
    fn the_document_s_states_are_these() {
        let mut seen = 0;
        for row in table("| 2021h | state | this channel's slopes | 2025h when 8000h |") {
            let number = row[0].parse().unwrap();
            let words = state(number, CHANNELS);
            assert!(row[1].starts_with(&*words), "{number}: {words}");
            seen |= 1 << number;
        }
        assert_eq!(seen, 0b11_1111_1111);
    }

    #[test]
    fn every_code_that_is_documented_has_words() {
        let words = DOCUMENT.split(|c: char| !c.is_ascii_alphanumeric());
        let mut seen = 0;
        for word in words.filter(|word| word.len() == 5 && word.ends_with('h')) {
            let number = u16::from_str_radix(&word[..4], 16);
            let Some(number) = number.ok().filter(|n| {
                matches!(
                    n,
                    0x3200 | 0x4200 | 0x5010 | 0x5020 | 0x6101..=0x6105 | 0x6110
                ) || matches!(n, 0x8110..=0x8250 | 0xFF01..=0xFF22)
            }) else {
                continue;
            };
            seen += 1;
            assert!(!code(number).starts_with("unknown"), "{word}");
        }
        assert!(seen > 30);
        assert_eq!(code(0x1234), "unknown code");
    }

    #[test]
    fn every_code_that_a_node_can_send_has_words_of_its_own() {
        let crashes = 0x6101..=0x6105;
        let bus = [
            0x8110,
            canopen::emcy::PASSIVE,
            0x8130,
            canopen::emcy::RECOVERED,
            0x8200,
            0x8210,
            0x8220,
            0x8240,
            0x8250,
        ];
        let faults = Fault::ALL.into_iter().map(|fault| fault.report().0);
        let sent: Vec<_> = faults.chain(crashes).chain(bus).chain([0]).collect();
        let mut words: Vec<_> = sent.iter().map(|number| code(*number)).collect();
        assert!(words.iter().all(|text| !text.starts_with("unknown")));
        words.sort_unstable();
        words.dedup();
        assert_eq!(words.len(), sent.len());
    }

    #[test]
    fn an_emcy_names_what_its_bytes_name() {
        assert_eq!(
            emergency(0x8130, [2, 0]),
            "the heartbeat of node 2 was lost"
        );
        assert_eq!(emergency(0x8110, [1, 1]), "CAN overrun, frames lost: 257");
        assert_eq!(emergency(0x8200, [3, 0]), "RPDO 3 was refused");
        assert_eq!(emergency(0x8240, [9, 0]), "a SYNC had a wrong length, 9");
        assert_eq!(code(0x8210), "an RPDO was too short");
        // A fault of the instrument has its set there.
        assert_eq!(emergency(0xFF13, [7, 7]), Fault::Disagree.text());
    }

    #[test]
    fn every_number_has_words_and_a_number_without_a_meaning_keeps_it() {
        assert_eq!(reason(0), None);
        assert_eq!(because(0), "no reason given");
        for number in 0..=u8::MAX {
            let known = exchange::reason(number).is_some() || number == 0;
            let unknown = format!("unknown reason {number}");
            assert_eq!(because(number) != unknown, known, "{number}");
            let unknown = format!("unknown state {number}");
            assert_eq!(state(number, CHANNELS) != unknown, number <= 9, "{number}");
            assert!(!no_slope(number).is_empty() && !validity(number).is_empty());
            assert!(!told(State::of(number)).is_empty());
        }
        assert_eq!(state(7, ["channel A", "channel B"]), "channel A is faulty");
        assert_eq!(state(8, ["channel A", "channel B"]), "channel B is faulty");
    }

    #[test]
    fn blame_is_named_from_the_side_that_reports_it() {
        let names = [1, 2, 3, 0].map(|number| blamed(number, ["B", "A", "A and B"]));
        assert_eq!(names, [Some("B"), Some("A"), Some("A and B"), None]);
    }

    #[test]
    fn validity_names_what_is_missing_or_that_nothing_is() {
        assert_eq!(validity(0x7F), ["valid"]);
        let words = validity(0x82);
        let expected = [
            "X not valid",
            "not compared",
            "not calibrated",
            "fault latched until a reset",
        ];
        assert_eq!(words, expected);
    }

    #[test]
    fn the_register_s_bits_and_the_states_of_nmt() {
        let named: Vec<_> = error_register(0x91).collect();
        assert_eq!(named, ["communication", "manufacturer"]);
        assert_eq!(
            [0x85, 127, 7].map(|byte| told(State::of(byte))),
            ["operational", "pre-operational", "state 7"]
        );
    }
}
