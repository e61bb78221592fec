//! What an instrument with a gyroscope shows beside the aligned angle: angle and rates of turn of
//! the moment of SYNC, 2029h and 202Ah, and what its gyroscope measures before any correction,
//! summed up, 2034h. CiA 410 is not known to have objects for any of it.
//!
//! In: what the channel reports at a SYNC, or at the last look where there is none. Out: the rows,
//! and the numbers behind them; TPDO 5 and 6 (`pdo`) carry them. The angles are shown as 6010h and
//! 6020h are: unit, inversion, preset and offsets are theirs.
//!
//! A master that wants no more than the first instrument has reads none of it: 6010h and 6020h keep
//! the aligned angle, and both TPDOs are off as delivered.
//!
//! Left out: the peer's angle and rates of the moment, which no node is told.

use canopen::object::DataType::{Integer16, Unsigned8, Unsigned16, Unsigned64};
use canopen::object::{Abort, Address, Number, Value};
use tilt::chain::{Invalid, Measurement, Reading};
use tilt::composition::Place;
use tilt::fusion::MeasuredSum;
use tilt::motion::Rate;
use tilt::observation::Observation;

use super::build::{member, record};
use super::device_objects::{DeviceObjects, Memory, Source};
use super::manufacturer::{MILLIDEGREE, UNKNOWN, UNKNOWN_UNCERTAINTY};
use super::row::Row;
use crate::exchange::reason_code;
use crate::instrument::Instrument;

/// 202Ah where there is no rate.
pub const NO_RATE: i16 = i16::MIN;

/// The rows of both objects.
pub const MOMENT: &[Row] = &[
    record(
        0x2029,
        5,
        "Angle now",
        "This channel's angles at the moment of the SYNC itself, by the gyroscope; 6010h and 6020h \
         carry the aligned ones, which belong to an instant before it.",
    ),
    member(0x2029, 1, "Slope X now", Integer16, SLOPE)
        .tpdo()
        .unit("6000h x 0.001 deg"),
    member(0x2029, 2, "Slope Y now", Integer16, SLOPE)
        .tpdo()
        .unit("6000h x 0.001 deg"),
    member(0x2029, 3, "Larger uncertainty now", Unsigned16, UNKNOWN)
        .tpdo()
        .unit(MILLIDEGREE),
    member(0x2029, 4, "Reason X now", Unsigned8, REASON).tpdo(),
    member(0x2029, 5, "Reason Y now", Unsigned8, REASON).tpdo(),
    record(
        0x202A,
        4,
        "Rate of turn",
        "By the gyroscope's last sample before the SYNC, corrected and not filtered.",
    ),
    member(0x202A, 1, "Rate of turn X", Integer16, RATE)
        .to(3)
        .tpdo()
        .unit("0.01 deg/s"),
    member(0x202A, 4, "Reason of the rates", Unsigned8, REASON).tpdo(),
    record(
        0x2034,
        6,
        "Measured turn",
        "Sums of what the gyroscope has measured since the start, in the axes of the sensor and \
         before any correction; everything wraps. Two readings that are less than 100 samples \
         apart differ by the turn between them: the difference of the sums times the sample period \
         (2033h).",
    ),
    member(
        0x2034,
        1,
        "Samples of the sums",
        Unsigned16,
        "Samples in the sums.",
    )
    .tpdo(),
    member(0x2034, 2, "Sum of the rate X", Integer16, SUM)
        .to(4)
        .tpdo()
        .unit(SUM_UNIT),
    member(
        0x2034,
        5,
        "Samples and sums",
        Unsigned64,
        "Sub-index 1 to 4 of one moment, 16 bits each, sub-index 1 in the lowest.",
    ),
    member(
        0x2034,
        6,
        "Gaps",
        Unsigned16,
        "Samples that were missing, and gaps too long to be counted by samples: the turn in them \
         is not in the sums.",
    )
    .tpdo(),
];

/// 2034h sub 5, the one object of eight bytes.
pub(super) const ALL_TURNED: Address = canopen::object::at(0x2034, 5);

/// 2034h sub 2 to 4 have the upper 16 bits of what wraps in 2^27 steps of [`MeasuredSum::sum`].
const SUM_BITS: u32 = 11;

/// 2034h sub 2 to 4 in one step, rad/s times samples.
pub const SUM_STEP: f64 = 1.0 / 32.0;

const SUM: &str = "About the sensor's axes X, Y, Z, right-handed.";
const SUM_UNIT: &str = "1/32 rad/s x samples";

const SLOPE: &str = "With the unit, inversion, preset and offsets of the slope of the same axis. \
     -32768: there is none.";
const REASON: &str = "0: valid; otherwise why there is none, as in 2025h.";
const RATE: &str = "About the housing's axes X, Y, Z, right-handed. Larger ones stop at +-32767. \
     -32768: there is none.";

/// What a channel with a gyroscope reports of one moment.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// The angles of that moment.
    pub reading: Reading,
    /// The rate of turn of the last sample, or why there is none.
    pub rate: Result<Rate, Invalid>,
}

impl Moment {
    /// Before the first sample.
    pub const NOTHING: Self = Self {
        reading: Observation::absent(Invalid::NoSample).reading,
        rate: Err(Invalid::NoSample),
    };
}

/// 0.01 deg/s in one step of [`Rate`], 2^-14.
const HUNDREDTHS: i64 = (18_000.0 / core::f64::consts::PI * 16_384.0 + 0.5) as i64;

/// A sum as 2034h has it: rounded down, which the next one has again.
const fn shown_sum(sum: i32) -> i16 {
    (sum >> SUM_BITS) as i16
}

/// A rate in 0.01 deg/s, rounded; it stops at +-327.67 deg/s.
fn hundredths(rate: i32) -> i16 {
    // 2^-24 rad/s per step, and 14 bits of the factor.
    const BITS: u32 = 24 + 14;
    let steps = (i64::from(rate) * HUNDREDTHS + (1 << (BITS - 1))) >> BITS;
    steps.clamp(-i64::from(i16::MAX), i64::from(i16::MAX)) as i16
}

impl<M: Memory, S: Source<I>, I: Instrument> DeviceObjects<'_, M, S, I> {
    /// The angle of the moment, X or Y, as far as it may be used: as with the aligned one.
    fn angle_now(&self, axis: usize) -> Result<Measurement, Invalid> {
        let moment = self.parts.moment.as_ref().ok_or(Invalid::NotMeasured)?;
        self.shown().of(&moment.get().reading, axis).copied()
    }

    /// The rates, as far as they may be used: like the angle, but how the slopes are shown makes no
    /// difference to them.
    fn rate(&self) -> Result<Rate, Invalid> {
        let moment = self.parts.moment.as_ref().ok_or(Invalid::NotMeasured)?;
        let rate = moment.get().rate?;
        self.shown().measured_usable().map(|()| rate)
    }

    /// The larger uncertainty of the axes that have an angle, 0.001 deg.
    fn uncertainty_now(&self) -> u16 {
        let known = [0, 1]
            .into_iter()
            .filter_map(|axis| self.angle_now(axis).ok());
        let larger = known
            .map(|m| super::process::thousandths(m.uncertainty))
            .max();
        larger.unwrap_or(UNKNOWN_UNCERTAINTY)
    }

    /// 2034h, but for sub 5.
    pub(super) fn read_turned(&self, at: Address) -> Result<Number, Abort> {
        let MeasuredSum { sum, samples, gaps } = self.parts.channel.measured_sum();
        Ok(match at.sub {
            1 => Number::u16(samples),
            6 => Number::u16(gaps),
            sub => {
                let axis = usize::from(sub).wrapping_sub(2);
                Number::i16(sum.get(axis).copied().map_or(0, shown_sum))
            }
        })
    }

    /// 2034h sub 5.
    // Out of line: what reads any other object would hold its eight bytes.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub(super) fn read_all_turned(&self) -> Value {
        let MeasuredSum { sum, samples, .. } = self.parts.channel.measured_sum();
        let ([n, m], [x, y, z]) = (samples.to_le_bytes(), sum.map(shown_sum));
        let ([x0, x1], [y0, y1], [z0, z1]) = (x.to_le_bytes(), y.to_le_bytes(), z.to_le_bytes());
        Value::whole([n, m, x0, x1, y0, y1, z0, z1])
    }

    /// 2029h and 202Ah.
    pub(super) fn read_moment(&self, at: Address) -> Result<Number, Abort> {
        let axis = usize::from(at.sub.wrapping_sub(1));
        Ok(match (at.index, at.sub) {
            (0x2029, 1 | 2) => self.as_slope(axis, self.angle_now(axis).ok().map(|m| m.angle)),
            (0x2029, 3) => Number::u16(self.uncertainty_now()),
            (0x2029, _) => Number::u8(code(self.angle_now(axis.wrapping_sub(3)))),
            (_, 4) => Number::u8(code(self.rate())),
            _ => {
                let rate = self.rate().ok();
                let axis = rate.and_then(|rate| rate.rate.get(axis).copied());
                Number::i16(axis.map_or(NO_RATE, hundredths))
            }
        })
    }
}

/// The code of 2025h; 0 where there is something.
fn code<T>(found: Result<T, Invalid>) -> u8 {
    found.err().map_or(0, reason_code)
}
