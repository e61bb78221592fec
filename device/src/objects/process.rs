//! What the instrument shows: the values behind the read-only rows, at one instant.
//!
//! In: readings, the pair, and counters, as they arise. Out: the numbers that the dictionary's
//! rows promise, with their units. A reading that is not there leaves its reason and no number.
//! Whether an angle may be used is derived when a row is read ([`Shown`]).
//!
//! Left out: parameters (`parameters`), and turning an angle into the configured resolution
//! (`profile`).

use canopen::nmt::State;
use instant::Instant;
use tilt::angle::{Angle, Axes};
use tilt::chain::{Invalid, Measurement, Reading};
use tilt::composition::{Composition, Whole};
use tilt::cross_check::{Judgement, Member};
use tilt::observation::Observation;
use tilt::uncertainty::Uncertainty;

use super::values::Values;
use crate::exchange::{self, Exchange};
use crate::objects::manufacturer::{NO_DIFFERENCE, UNKNOWN_UNCERTAINTY};
use crate::pair::Pair;
use crate::profile::state::state_code;

/// Thousandths of a degree in steps of 2^-32 of a circle, of which one has 11 930.46: rounded down,
/// so that what is within a limit is never shown above it.
const fn steps(thousandths: u16) -> u32 {
    let thousandths = thousandths as u32;
    thousandths * 11_930 + ((thousandths * 118) >> 8)
}

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

/// What was measured, exchanged and counted; what is derived of it at an instant is [`Shown`].
#[derive(Clone, Copy, Debug)]
pub struct Process {
    /// What this channel has measured last, whether it may be used or not.
    pub measured: Reading,
    /// When that was asked for.
    pub measured_at: Instant,
    /// Its angles a second time, with every bit inverted.
    pub inverted: [i32; 2],
    /// What this node tells its peer, 2010h.
    pub sent: Exchange,
    /// What the peer has told, 2011h.
    pub received: Exchange,
    /// When the judgement became what it is, 2027h sub 3: ms since the start.
    pub since_ms: u32,
    /// Age of the reading at its SYNC, us.
    pub latency_us: u32,
    /// SYNCs obeyed.
    pub syncs: u32,
    /// SYNCs for which the peer sent nothing in time.
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
        measured: Observation::absent(Invalid::NoSample).reading,
        measured_at: Instant(0),
        inverted: [-1; 2],
        sent: Exchange::NOTHING,
        received: Exchange::NOTHING,
        since_ms: 0,
        latency_us: 0,
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

    /// Takes in this channel's reading at `now`.
    pub fn measure(&mut self, reading: &Reading, now: Instant) {
        self.measured = *reading;
        self.measured_at = now;
        self.inverted = [reading.x, reading.y].map(|axis| axis.map_or(-1, |m| !m.angle.0));
        if let Ok(m) = reading.x.or(reading.y) {
            self.latency_us = m.latency_us;
        }
    }

    /// The latency in whole milliseconds, rounded, stopping at 255.
    pub fn latency_ms(&self) -> u8 {
        let ms = self.latency_us.saturating_add(500) / 1000;
        u8::try_from(ms).unwrap_or(u8::MAX)
    }
}

/// What the dictionary shows of both channels at an instant. Nothing of it is stored.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a, C: Composition = Whole> {
    values: &'a Values,
    pair: &'a Pair<C>,
    /// The fault that this channel has latched.
    fault: Option<Invalid>,
    now: Instant,
}

impl<'a, C: Composition> Shown<'a, C> {
    /// What is shown at `now` of a channel that has latched `fault`.
    pub const fn new(
        values: &'a Values,
        pair: &'a Pair<C>,
        fault: Option<Invalid>,
        now: Instant,
    ) -> Self {
        Self {
            values,
            pair,
            fault,
            now,
        }
    }

    /// The judgement; `None` while nothing is compared.
    pub fn judgement(&self) -> Option<Judgement> {
        self.pair.judgement(self.now)
    }

    /// Whether this channel's angles may be used, and why not.
    ///
    /// Outside OPERATIONAL nobody works by them, and whoever sets the instrument up has to see
    /// them, so there they are shown as measured.
    pub fn usable(&self) -> Result<(), Invalid> {
        self.measured_usable()?;
        if self.is_unlike() {
            return Err(Invalid::Unlike);
        }
        Ok(())
    }

    /// True while the two channels are set to show different angles, which 2006h forbids.
    pub fn is_unlike(&self) -> bool {
        let operational = self.values.state == State::Operational;
        operational && self.values.parameters.alike != 0 && self.pair.is_shown_apart()
    }

    /// [`Shown::usable`] of the angles as measured, however they are shown.
    pub fn measured_usable(&self) -> Result<(), Invalid> {
        if self.values.state != State::Operational {
            return Ok(());
        }
        self.pair.usable(self.now, self.values.parameters.policy())
    }

    /// Whether an angle is as certain as 2007h demands. Like [`Shown::usable`], it is shown as
    /// measured outside OPERATIONAL.
    fn certain(&self, measured: &Measurement) -> Result<(), Invalid> {
        let limit = steps(self.values.parameters.uncertainty_limit);
        let operational = self.values.state == State::Operational;
        if operational && limit != 0 && measured.uncertainty.0 > limit {
            return Err(Invalid::Uncertain);
        }
        Ok(())
    }

    /// This channel's X or Y for a safety frame, which has neither preset nor offset, and a second
    /// time from the copy that was kept inverted.
    pub fn measured(&self, axis: usize) -> Option<(Angle, Angle)> {
        self.measured_usable().ok()?;
        let Axes { x, y } = &self.values.process.measured;
        let measured = if axis == 0 { x } else { y }.as_ref().ok()?;
        self.certain(measured).ok()?;
        let inverted = self.values.process.inverted.get(axis)?;
        Some((measured.angle, Angle(!inverted)))
    }

    /// X or Y of a reading of this channel, as far as it may be used.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn of<'m>(
        &self,
        Axes { x, y }: &'m Reading,
        axis: usize,
    ) -> Result<&'m Measurement, Invalid> {
        // A channel that measures nothing reports why, whatever is found of it.
        let measured = if axis == 0 { x } else { y }.as_ref();
        let measured = measured.map_err(|reason| *reason)?;
        self.usable()?;
        self.certain(measured).map(|()| measured)
    }

    /// This channel's X or Y as far as it may be used.
    pub fn own(&self, axis: usize) -> Result<&'a Measurement, Invalid> {
        self.of(&self.values.process.measured, axis)
    }

    /// The peer's X and Y as far as they may be used.
    fn peer(&self) -> [Option<Angle>; 2] {
        let Some(Axes { x, y }) = self.pair.peer(self.now) else {
            return [None; 2];
        };
        [x, y].map(|axis| {
            let measured = axis.as_ref().ok()?;
            self.certain(measured).ok().map(|()| measured.angle)
        })
    }

    /// Slopes X and Y of this channel, then of the peer, without preset and offset.
    pub fn slope(&self, which: usize) -> Option<Angle> {
        if which < 2 {
            return self.own(which).ok().map(|m| m.angle);
        }
        let [x, y] = self.peer();
        if which == 2 { x } else { y }
    }

    /// [`Shown::slope`] as a preset takes it: a preset is what ends that the two are set to show
    /// different angles, so it is taken then as well.
    pub fn preset_slope(&self, which: usize) -> Option<Angle> {
        if which < 2 {
            return self.measured(which).map(|(angle, _)| angle);
        }
        self.slope(which)
    }

    /// The bits of 2020h.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn validity(&self) -> u8 {
        let Axes { x, y } = self.pair.difference(self.now);
        let [peer_x, peer_y] = self.peer().map(|angle| angle.is_some());
        let flags = [
            self.own(0).is_ok(),
            self.own(1).is_ok(),
            peer_x,
            peer_y,
            x.is_some(),
            y.is_some(),
            self.values.calibrated,
            self.is_latched(),
        ];
        let bits = flags.iter().rev();
        bits.fold(0, |bits, flag| bits << 1 | u8::from(*flag))
    }

    /// True when something stands that only a reset takes away.
    fn is_latched(&self) -> bool {
        let until_reset = self.values.parameters.latch_s == 0;
        let held = self.fault.is_some() || self.pair.is_latched();
        self.values.pending.fail_safe
            || self.pair.needs_reset()
            || self.fault == Some(Invalid::Corrupt)
            || until_reset && held
    }

    /// What was judged, in numbers: 2021h, and 2027h sub 1 and 2.
    pub fn finding(&self) -> (u8, (u8, u8)) {
        let judgement = self.judgement();
        (judgement.map_or(NOT_JUDGED, state_code), blame(judgement))
    }

    /// The code of 2021h.
    pub fn state(&self) -> u8 {
        self.finding().0
    }

    /// The channel that is held faulty, 2027h sub 1, and the code of why, sub 2.
    pub fn blame(&self) -> (u8, u8) {
        self.finding().1
    }

    /// Reason code of X or Y, 0 when valid.
    pub fn reason(&self, axis: usize) -> u8 {
        self.own(axis).err().map_or(0, exchange::reason_code)
    }

    /// Standard uncertainty of X or Y, 0.001 deg, or [`UNKNOWN_UNCERTAINTY`].
    pub fn uncertainty(&self, axis: usize) -> u16 {
        if !C::UNCERTAINTY {
            return UNKNOWN_UNCERTAINTY;
        }
        let measured = self.own(axis);
        measured.map_or(UNKNOWN_UNCERTAINTY, |m| thousandths(m.uncertainty))
    }

    /// The larger uncertainty of the axes that have one.
    pub fn larger_uncertainty(&self) -> u16 {
        match [self.uncertainty(0), self.uncertainty(1)] {
            [x, UNKNOWN_UNCERTAINTY] => x,
            [UNKNOWN_UNCERTAINTY, y] => y,
            [x, y] => x.max(y),
        }
    }

    /// This channel minus the peer, 0.001 deg, or [`NO_DIFFERENCE`].
    pub fn delta(&self) -> [i16; 2] {
        let Axes { x, y } = self.pair.difference(self.now);
        [x, y].map(|apart| apart.map_or(NO_DIFFERENCE, small_thousandths))
    }

    /// The difference of larger magnitude.
    pub fn larger_delta(&self) -> i16 {
        match self.delta() {
            [x, NO_DIFFERENCE] => x,
            [NO_DIFFERENCE, y] => y,
            [x, y] if x.unsigned_abs() > y.unsigned_abs() => x,
            [_, y] => y,
        }
    }

    /// This channel's acceleration minus the other's, low-passed, 0.1 mg.
    pub fn residual(&self) -> [i16; 3] {
        self.pair.residual().map(tenths_of_mg)
    }
}

/// The channel that is held faulty (0 none, 1 this one, 2 the other, 3 both), and the code of why.
fn blame(judgement: Option<Judgement>) -> (u8, u8) {
    match judgement {
        Some(Judgement::OneChannel { faulty, reason }) => {
            let number = if faulty == Member::Own { 1 } else { 2 };
            (number, exchange::reason_code(reason))
        }
        // Both are; the reason is this channel's.
        Some(Judgement::NoChannel(reason)) => (3, exchange::reason_code(reason)),
        _ => (0, 0),
    }
}

/// 2^-26 g per step to 0.1 mg, stopping at +-3.2767 g.
fn tenths_of_mg(accel: i32) -> i16 {
    let tenths = (i64::from(accel) * 10_000 + (1 << 25)) >> 26;
    tenths.clamp(-i64::from(i16::MAX), i64::from(i16::MAX)) as i16
}

/// 360 000 thousandths of a degree are the full circle, 2^32.
fn scaled(steps: u64) -> u64 {
    (steps * 360_000 + (1 << 31)) >> 32
}

/// An uncertainty in 0.001 deg, rounded up, since a smaller one would be a promise not made.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
pub(super) fn thousandths(uncertainty: Uncertainty) -> u16 {
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
        let within = |limit| thousandths(Uncertainty(steps(limit))) <= limit;
        assert!((0..UNKNOWN_UNCERTAINTY).all(within));
    }
}
