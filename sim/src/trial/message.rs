//! What a receiver on the bus understands of the two channels, and nothing more.
//!
//! In: frames. Out: [`Message`], with the node-id it comes from: slopes (TPDO 1), state (TPDO 2),
//! EMCY, safety frames (SRDO 1 as delivered), boot-up, heartbeat and SDO answers; SYNC as well. The
//! identifiers are the predefined ones of CiA 301.
//!
//! Left out: what an SDO answers, the exchange between the nodes, and the inverted twins of safety
//! frames.

use canopen::Frame;

use crate::trial::CHANNELS;

/// Identifier of SYNC.
pub const SYNC: u16 = 0x80;
/// Node state OPERATIONAL in a heartbeat (CiA 301).
pub const OPERATIONAL: u8 = 5;
/// Identifiers of the first half of SRDO 1, channel A and B.
const SAFETY: [u16; CHANNELS] = [0x101, 0x103];
/// A slope in 16 bit without an angle.
const NO_SLOPE: i16 = i16::MIN;
/// Unit of a slope in TPDO 1, deg.
const SLOPE_DEG: f64 = 0.01;
/// Unit of 2022h, deg.
const UNCERTAINTY_DEG: f64 = 0.001;

/// TPDO 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slopes {
    /// Slope X and Y, deg, where they are marked valid.
    pub deg: [Option<f64>; 2],
    /// 2021h, where the frame carries it.
    pub state: Option<u8>,
}

/// TPDO 2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// 2021h.
    pub state: u8,
    /// Standard uncertainty of the angles, the larger one (2022h sub 3), deg; none where it is not
    /// known.
    pub uncertainty_deg: Option<f64>,
}

/// EMCY.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Emergency {
    /// Error code; 0: something has gone.
    pub code: u16,
    /// Error register.
    pub register: u8,
    /// The set of faults that stand, bit n for fault n.
    pub faults: u32,
    /// Whom the node holds for faulty: 0 nobody, 1 itself, 2 the other, 3 both.
    pub blamed: u8,
    /// Why: a reason as in 2025h.
    pub reason: u8,
    /// 2021h.
    pub state: u8,
}

/// One thing said on the bus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// SYNC, whoever sent it.
    Sync,
    /// TPDO 1.
    Slopes(Slopes),
    /// TPDO 2.
    State(State),
    /// SRDO 1: slope X and Y, deg.
    Safety([f64; 2]),
    /// EMCY.
    Emergency(Emergency),
    /// The node has started.
    BootUp,
    /// The node's NMT state.
    Heartbeat(u8),
    /// An answer to an SDO.
    Answer,
}

impl Message {
    /// The message of a frame and the channel it comes from, 0 or 1 (0 for SYNC); `None` for
    /// what doesn't concern the trial. The channels have node-ids 1 and 2.
    pub fn of(frame: &Frame) -> Option<(usize, Self)> {
        let id = frame.cob_id()?;
        if frame.is_remote() {
            return None;
        }
        if id == SYNC {
            return Some((0, Self::Sync));
        }
        if let Some(channel) = SAFETY.iter().position(|safety| *safety == id) {
            return safety(frame.bytes()).map(|deg| (channel, Self::Safety(deg)));
        }
        let channel = usize::from(id & 0x7F).checked_sub(1)?;
        let bytes = frame.bytes();
        let message = match (id & 0x780, bytes) {
            (0x180, [a, b, c, d, rest @ ..]) => Self::Slopes(slopes([*a, *b, *c, *d], rest)),
            (0x280, [_, state, rest @ ..]) => Self::State(State {
                state: *state,
                uncertainty_deg: rest.first_chunk().and_then(stated),
            }),
            (0x080, _) => Self::Emergency(emergency(bytes.try_into().ok()?)),
            (0x580, _) => Self::Answer,
            (0x700, [0]) => Self::BootUp,
            (0x700, [state]) => Self::Heartbeat(*state),
            _ => return None,
        };
        (channel < CHANNELS).then_some((channel, message))
    }

    /// 2021h, where the message carries it.
    pub fn state(&self) -> Option<u8> {
        match self {
            Self::Slopes(slopes) => slopes.state,
            Self::State(state) => Some(state.state),
            Self::Emergency(emergency) => Some(emergency.state),
            Self::Sync | Self::Safety(_) | Self::BootUp | Self::Heartbeat(_) | Self::Answer => None,
        }
    }
}

/// A slope counts when it isn't 8000h and its bit of the validity, where that is there, is set.
fn slopes([a, b, c, d]: [u8; 4], rest: &[u8]) -> Slopes {
    let marked = rest.first().copied().unwrap_or(0b11);
    let raw = [i16::from_le_bytes([a, b]), i16::from_le_bytes([c, d])];
    let valid = |i: usize| raw[i] != NO_SLOPE && marked >> i & 1 == 1;
    Slopes {
        deg: [0, 1].map(|i| valid(i).then(|| f64::from(raw[i]) * SLOPE_DEG)),
        state: rest.get(1).copied(),
    }
}

fn stated(bytes: &[u8; 2]) -> Option<f64> {
    let raw = u16::from_le_bytes(*bytes);
    (raw < u16::MAX).then(|| f64::from(raw) * UNCERTAINTY_DEG)
}

fn safety(bytes: &[u8]) -> Option<[f64; 2]> {
    let [a, b, c, d] = *bytes else { return None };
    let raw = [i16::from_le_bytes([a, b]), i16::from_le_bytes([c, d])];
    Some(raw.map(|slope| f64::from(slope) * SLOPE_DEG))
}

fn emergency([low, high, register, a, b, c, blame, state]: [u8; 8]) -> Emergency {
    Emergency {
        code: u16::from_le_bytes([low, high]),
        register,
        faults: u32::from_le_bytes([a, b, c, 0]),
        blamed: blame >> 6,
        reason: blame & 0x3F,
        state,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(id: u16, bytes: &[u8]) -> Option<(usize, Message)> {
        Message::of(&Frame::data_frame(id, bytes))
    }

    #[test]
    fn a_slope_counts_when_value_and_validity_are_good() {
        let slopes = |bytes: &[u8]| match of(0x182, bytes) {
            Some((1, Message::Slopes(slopes))) => slopes,
            other => panic!("{other:?}"),
        };
        let short = slopes(&[0x10, 0x27, 0x00, 0x80]);
        assert_eq!(short.deg, [Some(100.0), None]);
        assert_eq!(short.state, None);
        let marked = slopes(&[1, 0, 1, 0, 0b10, 7]);
        assert_eq!(marked.deg, [None, Some(0.01)]);
        assert_eq!(marked.state, Some(7));
    }

    #[test]
    fn an_emergency_tells_faults_blame_and_state() {
        let told = of(0x81, &[0x14, 0xFF, 0x81, 1, 0x20, 0, 0x42, 7]);
        let want = Emergency {
            code: 0xFF14,
            register: 0x81,
            faults: 0x2001,
            blamed: 1,
            reason: 2,
            state: 7,
        };
        assert_eq!(told, Some((0, Message::Emergency(want))));
    }

    #[test]
    fn what_others_send_is_no_message() {
        assert_eq!(of(0x183, &[0; 6]), None);
        assert_eq!(of(0x381, &[0; 8]), None);
        assert_eq!(of(0x81, &[0; 7]), None);
        assert_eq!(of(0x102, &[0; 4]), None);
        assert_eq!(of(0x80, &[]), Some((0, Message::Sync)));
        assert_eq!(of(0x702, &[0]), Some((1, Message::BootUp)));
        assert_eq!(of(0x701, &[5]), Some((0, Message::Heartbeat(5))));
    }
}
