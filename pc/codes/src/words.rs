//! What the numbers of the fault log say, in words.
//!
//! In: the numbers of docs/canopen.md: EMCY codes, states of the pair (2021h), reasons (2025h),
//! channels that are blamed (2027h). Out: a few words each; a number that nobody knows keeps its
//! number.

use std::borrow::Cow;

use device::exchange;
use device::fault::Fault;
use tilt::chain::Invalid;

/// What an EMCY code says.
pub fn code(code: u16) -> Cow<'static, str> {
    let mut faults = Fault::ALL.into_iter();
    if let Some(fault) = faults.find(|fault| fault.report().0 == code) {
        return fault.text().into();
    }
    let text = match code {
        0 => "faults have gone",
        0x6101 => "the program ended by a panic",
        0x6102 => "the program ended by a hard fault",
        0x6103 => "an interrupt without a handler occurred",
        0x6104 => "the watchdog ended the program",
        0x6105 => "the bootloader found nothing to start",
        0x8110 => "frames were lost (overrun)",
        0x8120 => "the node is error passive",
        0x8130 => "the other node's heartbeat was lost",
        0x8140 => "back from bus-off",
        0x8200 => "an RPDO was refused",
        0x8210 => "an RPDO was too short",
        0x8220 => "an RPDO was too long",
        0x8240 => "a SYNC had a wrong length",
        0x8250 => "an RPDO did not come in time",
        _ => return format!("unknown code {code:04X}h").into(),
    };
    text.into()
}

/// What a state of the pair says (2021h).
pub fn state(state: u8) -> Cow<'static, str> {
    let text = match state {
        0 => "nothing compared yet",
        1 => "both agree",
        2 => "warning",
        3 => "warning: stop the motion",
        4 => "warning: data were late",
        5 => "physical fault",
        6 => "the channels disagree",
        7 => "this channel is faulty",
        8 => "the other channel is faulty",
        9 => "neither measures",
        _ => return format!("unknown state {state}").into(),
    };
    text.into()
}

/// What a reason says (2025h); `None` for 0, which is no reason.
pub fn reason(reason: u8) -> Option<Cow<'static, str>> {
    let text = match reason {
        0 => return None,
        1 => "no sample yet",
        2 => "the filter settles",
        3 => "samples have stopped",
        4 => "over full scale",
        5 => "temperature not known",
        6 => "this axis is not measured",
        7 => "the part has lost its set-up",
        8 => "the part does not answer",
        9 => "codes stand still",
        10 => "noise in one channel only",
        11 => "single samples are far off",
        12 => "the temperature jumps",
        13 => "it moved alone, or its gravity is of the wrong length",
        14 => "the calibration is damaged",
        15 => "silent",
        16 => "late",
        17 => "the channels differ",
        18 => "the other channel was not received",
        19 => "degraded operation is forbidden",
        _ => return Some(format!("unknown reason {reason}").into()),
    };
    Some(text.into())
}

/// Who is blamed (2027h sub 1), seen from channel A (0) or B (1); `None` for nobody.
pub fn blamed(blamed: u8, side: usize) -> Option<&'static str> {
    match (blamed, side) {
        (1, 0) | (2, 1) => Some("A"),
        (1, _) | (2, _) => Some("B"),
        (3, _) => Some("A and B"),
        _ => None,
    }
}

/// The name of a channel.
pub const fn channel(side: usize) -> &'static str {
    if side == 0 { "A" } else { "B" }
}

/// The reason behind a code of 2025h or 2027h.
pub fn because(code: u8) -> String {
    let Some(reason) = exchange::reason(code) else {
        return format!("reason {code}");
    };
    let text = match reason {
        Invalid::NoSample => "no sample yet",
        Invalid::Settling => "settling",
        Invalid::Stale => "samples have stopped",
        Invalid::OverRange => "over range",
        Invalid::NoTemperature => "temperature not known",
        Invalid::NotMeasured => "axis not measured",
        Invalid::PartReset => "sensor has lost its set-up",
        Invalid::Bus => "sensor does not answer",
        Invalid::Stuck => "codes stand still",
        Invalid::Noise => "too noisy",
        Invalid::Spikes => "spikes",
        Invalid::Thermometer => "thermometer jumps",
        Invalid::Biased => "gravity of the wrong length",
        Invalid::Corrupt => "calibration corrupted",
        Invalid::Silent => "not heard",
        Invalid::Late => "data late",
        Invalid::Refused => "channels disagree",
        Invalid::Unconfirmed => "other channel not received yet",
        Invalid::Alone => "alone, which 2005h forbids",
        Invalid::Unlike => "presets, offsets or inversion differ from the other channel's",
    };
    text.to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    const DOCUMENT: &str = include_str!("../../../docs/canopen.md");

    #[test]
    fn every_code_that_is_documented_has_words() {
        let known = |text: &str| !text.starts_with("unknown");
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
            assert!(known(&code(number)), "{word}");
        }
        assert!(seen > 30);
        assert!(!known(&code(0x1234)));
    }

    #[test]
    fn every_reason_and_state_that_is_documented_has_words() {
        for number in 1..=19 {
            let words = reason(number).unwrap();
            assert!(!words.starts_with("unknown"), "{number}");
        }
        assert_eq!(reason(0), None);
        assert!((0..=9).all(|number| !state(number).starts_with("unknown")));
        assert_eq!(state(13), "unknown state 13");
    }

    #[test]
    fn blame_is_told_from_the_teller_s_side() {
        assert_eq!([blamed(1, 0), blamed(2, 1)], [Some("A"); 2]);
        assert_eq!([blamed(2, 0), blamed(1, 1)], [Some("B"); 2]);
        assert_eq!(blamed(0, 0), None);
    }
}
