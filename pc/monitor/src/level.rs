//! How bad what a node reports is.
//!
//! In: 2021h, an EMCY and the faults before it. Out: a level, which each view shows in its own way,
//! and for an EMCY its words (`codes::words`) with the faults that are gone.
//!
//! Left out: judgement of its own.

use codes::words;
use listen::Emergency;

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

/// How bad a state of the pair is.
pub const fn of_state(state: u8) -> Level {
    match state {
        0 => Level::Unknown,
        1 => Level::Good,
        2 | 4 => Level::Warning,
        _ => Level::Fault,
    }
}

/// What an EMCY reports, given the faults that stood before it.
pub fn of_emergency(emergency: &Emergency, before: u32) -> (Level, String) {
    let [b3, b4, b5, ..] = emergency.bytes;
    let code = emergency.code;
    let level = match code {
        0 => Level::Good,
        code if words::fault(code).is_some() => Level::Fault,
        _ => Level::Warning,
    };
    let set = u32::from_le_bytes([b3, b4, b5, 0]);
    let gone = if code == 0 { before & !set } else { 0 };
    let gone: Vec<_> = words::faults(gone).map(|fault| fault.text()).collect();
    let text = match gone.as_slice() {
        [] => words::emergency(code, [b3, b4]).into_owned(),
        gone => format!("gone: {}", gone.join("; ")),
    };
    (level, text)
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
    fn what_has_gone_is_told_by_name() {
        let before = 1 << 12 | 1 << 7;
        let (level, text) = of_emergency(&emcy(0, [1 << 7, 0, 0, 0, 1]), before);
        assert_eq!(level, Level::Good);
        assert_eq!(text, "gone: the channels differ for too long");
        let (_, nothing) = of_emergency(&emcy(0, [0; 5]), 0);
        assert_eq!(nothing, "faults have gone");
    }

    #[test]
    fn codes_of_faults_of_the_bus_and_unknown_ones_have_words() {
        let (level, text) = of_emergency(&emcy(0xFF13, [0; 5]), 0);
        assert_eq!(level, Level::Fault);
        assert_eq!(text, "the channels differ for too long");
        let (level, text) = of_emergency(&emcy(0x8130, [2, 0, 0, 0, 0]), 0);
        assert_eq!(level, Level::Warning);
        assert_eq!(text, "the heartbeat of node 2 was lost");
        assert_eq!(of_emergency(&emcy(0x1234, [0; 5]), 0).1, "unknown code");
    }
}
