//! Numbers of the bus in words: states, reasons, validity, faults.
//!
//! In: 2020h, 2021h, the codes of 2025h and 2027h, a set of faults, an EMCY. Out: text for a
//! person, as docs/canopen.md has it.
//!
//! Left out: judgement of its own.

use device::exchange;
use device::fault::Fault;
use tilt::chain::Invalid;

use listen::{Emergency, Nmt};

/// How bad it is; each view has a word for it, and a colour where it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Level {
    /// As it should be.
    Good,
    /// Nothing is known.
    Unknown,
    /// Worth a look.
    Warning,
    /// The angle must not be used, or something is broken.
    Fault,
}

/// The state of the pair (2021h) as the channel `own` sees it.
pub fn state(state: u8, own: &str, other: &str) -> String {
    match state {
        0 => "not compared".to_owned(),
        1 => "both agree".to_owned(),
        2 => "the channels differ, not for long yet".to_owned(),
        3 => "stop the motion: the channels differ".to_owned(),
        4 => "agreement with data that were late".to_owned(),
        5 => "physical fault: the channels differ at standstill".to_owned(),
        6 => "the channels disagree and neither can be blamed".to_owned(),
        7 => format!("channel {own} is faulty"),
        8 => format!("channel {other} is faulty"),
        9 => "neither channel measures".to_owned(),
        other => format!("unknown state {other}"),
    }
}

/// How bad a state of the pair is.
pub const fn state_level(state: u8) -> Level {
    match state {
        0 => Level::Unknown,
        1 => Level::Good,
        2 | 4 => Level::Warning,
        _ => Level::Fault,
    }
}

/// A reason by its code (2025h, 2027h sub 2); `None` for 0, which is no reason.
pub fn reason(code: u8) -> Option<String> {
    let Some(reason) = exchange::reason(code) else {
        return (code != 0).then(|| format!("reason {code}, which is unknown to this program"));
    };
    let text = match reason {
        Invalid::NoSample => "no sample yet",
        Invalid::Settling => "the filter settles",
        Invalid::Stale => "samples have stopped",
        Invalid::OverRange => "over full scale",
        Invalid::NoTemperature => "temperature not known",
        Invalid::NotMeasured => "this axis is not measured",
        Invalid::PartReset => "the part has lost its set-up",
        Invalid::Bus => "the part does not answer",
        Invalid::Stuck => "codes stand still",
        Invalid::Noise => "noise, or a step above 150 Hz, in this channel only",
        Invalid::Spikes => "single samples are far off",
        Invalid::Thermometer => "the sensor's temperature jumps",
        Invalid::Biased => "it moved alone, or at standstill its gravity is of the wrong length",
        Invalid::Corrupt => "the calibration is damaged",
        Invalid::Silent => "silent: nothing has come in time",
        Invalid::Late => "late: the data received are out of date",
        Invalid::Refused => "the channels differ and neither can be blamed",
        Invalid::Unconfirmed => "the other channel was not received, or not compared",
        Invalid::Alone => "degraded operation is forbidden (2005h)",
        Invalid::Unlike => "presets, offsets or inversion differ from the other channel's (2006h)",
    };
    Some(text.to_owned())
}

/// Why a channel sends no slope, from the state of the pair alone.
pub const fn no_slope(state: u8) -> &'static str {
    match state {
        0 => "not compared with the other channel",
        5 | 6 => "the channels differ and neither can be blamed",
        7 => "this channel is faulty",
        8 => "the other channel is faulty, and this one may not go on alone",
        9 => "neither channel measures",
        _ => "the channel reports that it must not be used",
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
        (bits & 0x80 != 0).then_some("waits for a reset"),
    ];
    let mut words: Vec<_> = words.into_iter().flatten().collect();
    if words.is_empty() {
        words.push("valid");
    }
    words
}

/// The members of a set of faults (EMCY bytes 3 to 5), bit n for fault n.
pub fn faults(bits: u32) -> Vec<Fault> {
    let stands = |fault: &Fault| bits >> (*fault as u8) & 1 != 0;
    Fault::ALL.into_iter().filter(stands).collect()
}

/// The name of an NMT state (CiA 301).
pub const fn nmt(state: Nmt) -> &'static str {
    match state {
        Nmt::BootUp => "initialising",
        Nmt::PreOperational => "pre-operational",
        Nmt::Operational => "operational",
        Nmt::Stopped => "stopped",
    }
}

/// Who is blamed and why, by byte 6 of an EMCY: channels A and B, and the reason in words.
pub fn blame(byte: u8, side: usize) -> ([bool; 2], Option<String>) {
    let (own, other) = (byte >> 6 & 1 != 0, byte >> 7 != 0);
    let blamed = if side == 0 {
        [own, other]
    } else {
        [other, own]
    };
    (blamed, reason(byte & 0x3F))
}

/// What an EMCY tells, given the faults that stood before it.
pub fn emergency(emergency: &Emergency, before: u32) -> (Level, String) {
    let [b3, b4, b5, ..] = emergency.bytes;
    let code = emergency.code;
    if code == 0 {
        let set = u32::from_le_bytes([b3, b4, b5, 0]);
        let gone: Vec<_> = faults(before & !set).iter().map(|f| f.text()).collect();
        let text = match gone.as_slice() {
            [] => "a fault has gone".to_owned(),
            gone => format!("gone: {}", gone.join("; ")),
        };
        return (Level::Good, text);
    }
    if let Some(fault) = Fault::ALL.into_iter().find(|f| f.report().0 == code) {
        return (Level::Fault, fault.text().to_owned());
    }
    let text = match code {
        0x6101 => "the previous program ended by a panic".to_owned(),
        0x6102 => "the previous program ended by a hard fault".to_owned(),
        0x6103 => "the previous program met an interrupt without a handler".to_owned(),
        0x6104 => "the previous program hung: the watchdog ended it".to_owned(),
        0x6105 => "the bootloader found nothing to start".to_owned(),
        0x8110 => "CAN overrun: frames were lost".to_owned(),
        0x8120 => "CAN error passive".to_owned(),
        0x8130 => format!("it has lost the heartbeat of node {b3}"),
        0x8140 => "back from bus-off".to_owned(),
        0x8200 => "an RPDO was refused".to_owned(),
        0x8210 => format!("RPDO {b3} is too short"),
        0x8220 => format!("RPDO {b3} is too long"),
        0x8240 => format!("SYNC of a wrong length, {b3}"),
        0x8250 => format!("RPDO {b3} was missed"),
        code => format!("error code {code:04X}h, which is unknown to this program"),
    };
    (Level::Warning, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn emcy(code: u16, bytes: [u8; 5]) -> Emergency {
        let register = 0;
        Emergency {
            code,
            register,
            bytes,
        }
    }

    #[test]
    fn every_state_and_every_reason_has_words() {
        for number in 0..=9 {
            assert!(!state(number, "A", "B").contains("unknown"), "{number}");
        }
        assert_eq!(state(8, "A", "B"), "channel B is faulty");
        assert_eq!(state(10, "A", "B"), "unknown state 10");
        for code in 1..=19 {
            assert!(
                !reason(code).unwrap().contains("unknown to this program"),
                "{code}"
            );
        }
        assert_eq!(reason(0), None);
        assert!(reason(21).unwrap().contains("reason 21"));
    }

    #[test]
    fn the_blamed_channel_is_named_from_either_side() {
        assert_eq!(blame(0x40 | 13, 0).0, [true, false]);
        assert_eq!(blame(0x80 | 13, 0).0, [false, true]);
        assert_eq!(blame(0x40 | 13, 1).0, [false, true]);
        assert_eq!(blame(0xC0, 1), ([true, true], None));
        assert!(blame(0x40 | 13, 0).1.unwrap().contains("wrong length"));
    }

    #[test]
    fn what_has_gone_is_told_by_name() {
        let before = 1 << 12 | 1 << 7;
        let (level, text) = emergency(&emcy(0, [1 << 7, 0, 0, 0, 1]), before);
        assert_eq!(level, Level::Good);
        assert_eq!(text, "gone: the channels differ for too long");
        let (_, nothing) = emergency(&emcy(0, [0; 5]), 0);
        assert_eq!(nothing, "a fault has gone");
    }

    #[test]
    fn codes_of_faults_of_the_bus_and_unknown_ones_have_words() {
        let (level, text) = emergency(&emcy(0xFF13, [0; 5]), 0);
        assert_eq!(level, Level::Fault);
        assert_eq!(text, "the channels differ for too long");
        let (level, text) = emergency(&emcy(0x8130, [2, 0, 0, 0, 0]), 0);
        assert_eq!(level, Level::Warning);
        assert_eq!(text, "it has lost the heartbeat of node 2");
        assert!(emergency(&emcy(0x1234, [0; 5]), 0).1.contains("1234h"));
    }

    #[test]
    fn validity_says_what_is_missing_or_that_nothing_is() {
        assert_eq!(validity(0x7F), ["valid"]);
        let words = validity(0x82);
        let expected = [
            "X not valid",
            "not compared",
            "not calibrated",
            "waits for a reset",
        ];
        assert_eq!(words, expected);
    }
}
