//! What the instrument shows: the values behind the read-only rows, at one instant.
//!
//! In: readings, judgements and counters, as they arise. Out: the numbers that the dictionary's
//! rows promise, with their units. A reading that is not there leaves its reason and no number.
//!
//! Left out: parameters (`parameters`), and turning an angle into the configured resolution
//! (`profile`).

use tilt::angle::{Angle, Axes};
use tilt::chain::{Invalid, Measurement};
use tilt::cross_check::{Judgement, Node, Verdict};
use tilt::uncertainty::Uncertainty;

use crate::exchange::{self, Exchange};
use crate::objects::manufacturer::{NO_DIFFERENCE, UNKNOWN_UNCERTAINTY};
use crate::profile::state::state_code;

/// 2021h before the first comparison, and when comparisons have stopped.
pub const NOT_JUDGED: u8 = 0;

/// Where SYNC comes from, 2026h sub 3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum SyncSource {
    /// None for longer than the time-out.
    #[default]
    None = 0,
    /// Another node.
    Bus = 1,
    /// This node.
    Own = 2,
}

/// The state of the CAN controller and what it has counted, 2052h.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Bus {
    /// 0 error active, 1 error passive, 2 bus-off.
    pub state: u8,
    /// Transmit error counter.
    pub transmit_errors: u8,
    /// Receive error counter.
    pub receive_errors: u8,
    /// Share of the last second that the bus was busy, per cent.
    pub load_percent: u8,
    /// Frames and samples lost to overruns.
    pub overruns: u16,
    /// Times that the controller went bus-off.
    pub bus_offs: u16,
}

/// Everything that is shown.
#[derive(Clone, Copy, Debug)]
pub struct Process {
    /// Slopes X and Y of this channel, then of the peer, without preset and offset.
    pub slopes: [Option<Angle>; 4],
    /// What this node tells its peer, 2010h.
    pub sent: Exchange,
    /// What the peer has told, 2011h.
    pub received: Exchange,
    /// The bits of 2020h.
    pub validity: u8,
    /// The code of 2021h.
    pub state: u8,
    /// The channel that is blamed, 2027h sub 1: 0 none, 1 this one, 2 the other.
    pub blamed: u8,
    /// Why, 2027h sub 2: a reason code, 0 for none.
    pub why: u8,
    /// When the state of the pair became what it is, 2027h sub 3: ms since the start.
    pub since_ms: u32,
    /// This channel's acceleration minus the other's, low-passed, 0.1 mg.
    pub residual: [i16; 3],
    /// Standard uncertainty of X and Y, 0.001 deg, or [`UNKNOWN_UNCERTAINTY`].
    pub uncertainty: [u16; 2],
    /// Age of the reading at its SYNC, us.
    pub latency_us: u32,
    /// This channel minus the peer, 0.001 deg, or [`NO_DIFFERENCE`].
    pub delta: [i16; 2],
    /// Reason codes of X and Y, 0 when valid.
    pub reason: [u8; 2],
    /// SYNCs obeyed.
    pub syncs: u32,
    /// SYNCs for which the peer said nothing in time.
    pub missed: u16,
    /// Where SYNC comes from.
    pub source: SyncSource,
    /// The newest filtered acceleration, 2^-26 g.
    pub filtered: [i32; 3],
    /// Samples taken since the start.
    pub samples: u32,
    /// Measured time between samples, 1/256 us.
    pub period_q8: u32,
    /// The part's temperature, degC.
    pub temperature_c: i8,
    /// The CAN controller.
    pub bus: Bus,
}

/// Bits of 2020h.
pub mod validity {
    /// Slope X of this channel is valid; Y is the next bit.
    pub const OWN: u8 = 0x01;
    /// Slope X of the peer is valid; Y is the next bit.
    pub const PEER: u8 = 0x04;
    /// X was compared; Y is the next bit.
    pub const COMPARED: u8 = 0x10;
    /// The channel has a calibration of its own.
    pub const CALIBRATED: u8 = 0x40;
    /// A fault stands that only a reset takes away.
    pub const LATCHED: u8 = 0x80;
}

impl Process {
    /// Nothing measured, nothing heard.
    pub const NOTHING: Self = Self {
        slopes: [None; 4],
        sent: Exchange::NOTHING,
        received: Exchange::NOTHING,
        validity: 0,
        state: NOT_JUDGED,
        blamed: 0,
        why: 0,
        since_ms: 0,
        residual: [0; 3],
        uncertainty: [UNKNOWN_UNCERTAINTY; 2],
        latency_us: 0,
        delta: [NO_DIFFERENCE; 2],
        reason: [1; 2],
        syncs: 0,
        missed: 0,
        source: SyncSource::None,
        filtered: [0; 3],
        samples: 0,
        period_q8: 0,
        temperature_c: 0,
        bus: Bus {
            state: 0,
            transmit_errors: 0,
            receive_errors: 0,
            load_percent: 0,
            overruns: 0,
            bus_offs: 0,
        },
    };

    /// Shows this channel's reading, X and Y.
    pub fn show(&mut self, axes: [Result<&Measurement, Invalid>; 2]) {
        self.mark(validity::OWN, axes.map(|a| a.is_ok()));
        let codes = self.reason.iter_mut().zip(&mut self.uncertainty);
        for ((axis, slope), (reason, uncertainty)) in axes.iter().zip(&mut self.slopes).zip(codes) {
            *slope = axis.ok().map(|m| m.angle);
            (*reason, *uncertainty) = match axis {
                Ok(m) => (0, thousandths(m.uncertainty)),
                Err(reason) => (exchange::reason_code(*reason), UNKNOWN_UNCERTAINTY),
            };
        }
        if let [Ok(m), _] | [_, Ok(m)] = axes {
            self.latency_us = m.latency_us;
        }
    }

    /// Shows the comparison of both channels; `residual` is own minus peer, 2^-26 g.
    pub fn judge(&mut self, verdict: &Verdict, residual: [i32; 3]) {
        let judgement = verdict.judgement();
        self.state = state_code(judgement);
        (self.blamed, self.why) = blame(judgement);
        self.residual = residual.map(tenths_of_mg);
        let Axes { x, y } = match judgement {
            // What cannot be trusted isn't shown as a number.
            Judgement::Disagree
            | Judgement::PhysicalFault
            | Judgement::NoChannel(_)
            | Judgement::OneChannel {
                ill: Node::Peer, ..
            } => Axes {
                x: Err(Invalid::Refused),
                y: Err(Invalid::Refused),
            },
            _ => verdict.peer(),
        };
        let peer: [Result<Measurement, _>; 2] = [x, y];
        self.mark(validity::PEER, peer.map(|a| a.is_ok()));
        for (i, axis) in peer.iter().enumerate() {
            self.set_slope(2 + i, axis.ok().map(|m| m.angle));
        }
        let delta = verdict.delta();
        self.mark(validity::COMPARED, [delta.x.is_some(), delta.y.is_some()]);
        self.delta = [delta.x, delta.y].map(|d| d.map_or(NO_DIFFERENCE, small_thousandths));
    }

    /// Comparisons have stopped: what they showed is not shown any longer.
    pub fn not_judged(&mut self) {
        self.state = NOT_JUDGED;
        (self.blamed, self.why) = (0, 0);
        self.mark(validity::PEER, [false; 2]);
        self.mark(validity::COMPARED, [false; 2]);
        self.delta = [NO_DIFFERENCE; 2];
        self.set_slope(2, None);
        self.set_slope(3, None);
    }

    /// Sets or clears a bit of 2020h and the one above it.
    fn mark(&mut self, bit: u8, set: [bool; 2]) {
        let [first, second] = set;
        self.flag(bit, first);
        self.flag(bit << 1, second);
    }

    /// Sets or clears a bit of 2020h.
    pub fn flag(&mut self, bit: u8, set: bool) {
        self.validity = (self.validity & !bit) | if set { bit } else { 0 };
    }

    fn set_slope(&mut self, which: usize, slope: Option<Angle>) {
        put(&mut self.slopes, which, slope);
    }

    /// The larger uncertainty of the axes that have one.
    pub fn larger_uncertainty(&self) -> u16 {
        let known = self
            .uncertainty
            .iter()
            .filter(|u| **u != UNKNOWN_UNCERTAINTY);
        known.max().copied().unwrap_or(UNKNOWN_UNCERTAINTY)
    }

    /// The difference of larger magnitude.
    pub fn larger_delta(&self) -> i16 {
        let known = self.delta.iter().filter(|d| **d != NO_DIFFERENCE);
        let largest = known.max_by_key(|d| d.unsigned_abs());
        largest.copied().unwrap_or(NO_DIFFERENCE)
    }

    /// The latency in whole milliseconds, rounded, stopping at 255.
    pub fn latency_ms(&self) -> u8 {
        let ms = self.latency_us.saturating_add(500) / 1000;
        u8::try_from(ms).unwrap_or(u8::MAX)
    }
}

/// The channel that a judgement blames, and the code of why.
pub const fn blame(judgement: Judgement) -> (u8, u8) {
    match judgement {
        Judgement::OneChannel {
            ill: Node::Own,
            reason,
        } => (1, exchange::reason_code(reason)),
        Judgement::OneChannel {
            ill: Node::Peer,
            reason,
        } => (2, exchange::reason_code(reason)),
        // Both are; the reason is this channel's.
        Judgement::NoChannel(reason) => (3, exchange::reason_code(reason)),
        _ => (0, 0),
    }
}

/// 2^-26 g per step to 0.1 mg, stopping at +-3.2767 g.
fn tenths_of_mg(accel: i32) -> i16 {
    let tenths = (i64::from(accel) * 10_000 + (1 << 25)) >> 26;
    tenths.clamp(-i64::from(i16::MAX), i64::from(i16::MAX)) as i16
}

fn put<T: Copy>(places: &mut [T], which: usize, value: T) {
    if let Some(place) = places.get_mut(which) {
        *place = value;
    }
}

/// 360 000 thousandths of a degree are the full circle, 2^32.
fn scaled(steps: u64) -> u64 {
    (steps * 360_000 + (1 << 31)) >> 32
}

/// An uncertainty in 0.001 deg, rounded up, since a smaller one would be a promise not made.
fn thousandths(uncertainty: Uncertainty) -> u16 {
    let steps = u64::from(uncertainty.0);
    let up = (steps * 360_000 + u64::from(u32::MAX)) >> 32;
    u16::try_from(up).map_or(UNKNOWN_UNCERTAINTY - 1, |u| u.min(UNKNOWN_UNCERTAINTY - 1))
}

/// A difference in 0.001 deg, stopping at +-32.767 deg.
fn small_thousandths(delta: Angle) -> i16 {
    let magnitude = scaled(u64::from(delta.magnitude()));
    let magnitude = i16::try_from(magnitude).unwrap_or(i16::MAX);
    if delta.0 < 0 { -magnitude } else { magnitude }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousandth_of_a_degree_is_one() {
        let step = Angle::from_degrees(0.001);
        assert_eq!(small_thousandths(step), 1);
        assert_eq!(small_thousandths(Angle::from_degrees(-40.0)), -i16::MAX);
        assert_eq!(thousandths(Uncertainty::from_degrees(0.0001)), 1);
        assert_eq!(thousandths(Uncertainty(u32::MAX)), UNKNOWN_UNCERTAINTY - 1);
    }

    #[test]
    fn bits_of_one_pair_leave_the_others_alone() {
        let mut process = Process::NOTHING;
        process.mark(validity::PEER, [true, false]);
        process.flag(validity::LATCHED, true);
        process.mark(validity::OWN, [true, true]);
        assert_eq!(process.validity, 0x87);
        process.mark(validity::PEER, [false, true]);
        assert_eq!(process.validity, 0x8B);
    }
}
