//! What one node tells the other at each SYNC, in two PDOs of eight bytes, or three.
//!
//! In: an [`Observation`]. Out: an [`Exchange`], and from it the peer's observation again.
//!
//! The first PDO carries two angles of 24 bits and two quality bytes. An angle step is 2^-24 of a
//! circle, 2.15e-5 deg. The angle itself has 20 bits, 3.4e-4 deg, which no channel resolves; in
//! the four bits below it there is a part of how this node shows its angles ([`presentation`]).
//!
//! | quality | meaning |
//! |---|---|
//! | 0 | nothing sent yet |
//! | 1 to 31 | no angle; the reason is [`reason`] |
//! | 32 to 254 | an angle; its standard uncertainty is 0.001 deg times 2^((quality - 32) / 16) |
//! | 255 | an angle with an uncertainty above 15.0 deg: taken as knowing nothing, 103.9 deg |
//!
//! The uncertainty sent is the part that the channels do not share, because the peer feels the
//! machine's motion itself. It is rounded up, by 4.5 % at most, so that the comparison of the two
//! channels never gets tighter by the bus than it is by the signals. The top code stays an angle:
//! a vague one accuses nobody, where a reason would.
//!
//! The second PDO carries what is behind the angles: the calibrated acceleration in steps of
//! 2^-13 g (0.12 mg, +-4 g), the instant of its SYNC in steps of 2 ms of the sender's clock (the
//! low byte), and the energy above 150 Hz ([`Activity`]).
//!
//! An instrument with a gyroscope has a third one: how far it has turned ([`Turned`]) and the
//! energy of its rate from sample to sample, with the low byte of the instant again, since a turn
//! of another SYNC is none.
//!
//! Left out: the PDOs themselves, and what the instant shows of their age (`peer_clock`).
//!
//! [`presentation`]: crate::presentation

use instant::Instant;
use tilt::angle::{Angle, Axes};
use tilt::chain::{Invalid, Measurement, Reading};
use tilt::health::Activity;
use tilt::observation::Observation;
use tilt::turned::Turned;
use tilt::uncertainty::Uncertainty;
use tilt::vector::Corrected;

use crate::peer_clock::low_steps;
use crate::presentation::Presentation;

/// What travels from node to node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exchange {
    /// Angle X and Y in 2^-24 of a circle, -2^23 to 2^23 - 1; 0 where there is none. The lowest
    /// four bits are no part of it ([`Exchange::piece`]).
    pub angle: [i32; 2],
    /// What each is worth; see the table above. The default, 0, is "nothing sent yet".
    pub quality: [u8; 2],
    /// The acceleration along the housing's axes, 2^-13 g; [`NO_VECTOR`] where there is none.
    pub vector: [i16; 3],
    /// The instant of the SYNC, 2 ms of the sender's clock, the low byte.
    pub captured: u8,
    /// Energy above 150 Hz, as [`Activity`] counts it.
    pub activity: u8,
    /// What the gyroscope has turned by; nothing where there is none.
    pub turned: ToldTurn,
}

/// The third PDO, of an instrument with a gyroscope.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ToldTurn {
    /// See [`Turned::angle`]; [`NO_VECTOR`] where there is none.
    pub angle: [i16; 3],
    /// The instant of the SYNC, as [`Exchange::captured`].
    pub captured: u8,
    /// Energy of the rate's second difference, as [`Activity`] counts it.
    pub activity: u8,
}

impl ToldTurn {
    /// Nothing sent yet.
    pub const NOTHING: Self = Self {
        angle: NO_VECTOR,
        captured: 0,
        activity: 0,
    };

    /// Takes the PDO as it is on the bus.
    pub const fn take(&mut self, bytes: &[u8; 8]) {
        let [x0, x1, y0, y1, z0, z1, captured, activity] = *bytes;
        self.angle = [
            i16::from_le_bytes([x0, x1]),
            i16::from_le_bytes([y0, y1]),
            i16::from_le_bytes([z0, z1]),
        ];
        self.captured = captured;
        self.activity = activity;
    }

    /// The PDO as it is on the bus.
    pub const fn bytes(&self) -> [u8; 8] {
        let [x, y, z] = self.angle;
        let ([x0, x1], [y0, y1], [z0, z1]) = (x.to_le_bytes(), y.to_le_bytes(), z.to_le_bytes());
        [x0, x1, y0, y1, z0, z1, self.captured, self.activity]
    }

    fn encode(turned: Option<&Turned>, captured: u8) -> Self {
        let Some(turned) = turned else {
            return Self {
                captured,
                ..Self::NOTHING
            };
        };
        let mut angle = turned.angle;
        if angle == NO_VECTOR {
            // All three at the end of their range at once: 1.4 mdeg beside it.
            angle = [i16::MIN + 1; 3];
        }
        Self {
            angle,
            captured,
            activity: turned.activity.0,
        }
    }

    /// What the peer has told; `None` where it has told that there is nothing.
    fn decode(&self) -> Option<Turned> {
        (self.angle != NO_VECTOR).then_some(Turned {
            angle: self.angle,
            activity: Activity(self.activity),
            bias: None,
            accel: 0,
            scale_share: 0,
        })
    }
}

/// PDOs of an exchange, as a set: those that have come since a SYNC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pdos(u8);

impl Pdos {
    /// None of them.
    pub const NONE: Self = Self(0);
    /// The first one: both angles.
    pub const ANGLES: Self = Self(1);
    /// The second one: what is behind them.
    pub const BACKING: Self = Self(1 << 1);
    /// The third one: how far the channel has turned.
    pub const TURN: Self = Self(1 << 2);

    /// All of either set.
    pub const fn with(self, others: Self) -> Self {
        Self(self.0 | others.0)
    }

    /// True when all of the others are among these.
    pub const fn have(self, others: Self) -> bool {
        self.0 & others.0 == others.0
    }
}

/// The bits below an angle.
const BELOW: i32 = 0xF;

/// In place of an acceleration that there is not.
pub const NO_VECTOR: [i16; 3] = [i16::MIN; 3];

impl Exchange {
    /// Nothing sent yet.
    pub const NOTHING: Self = Self {
        angle: [0; 2],
        quality: [0; 2],
        vector: NO_VECTOR,
        captured: 0,
        activity: 0,
        turned: ToldTurn::NOTHING,
    };

    /// The byte that travels below the angles: four bits below each, those of Y higher.
    pub const fn piece(&self) -> u8 {
        let [x, y] = self.angle;
        (x & BELOW | (y & BELOW) << 4) as u8
    }

    /// Those of the PDOs that have come that belong together: a turn of another SYNC than what is
    /// behind the angles has not come.
    pub const fn of_one_sync(&self, came: Pdos) -> Pdos {
        if came.have(Pdos::TURN) && self.turned.captured != self.captured {
            return Pdos(came.0 & !Pdos::TURN.0);
        }
        came
    }

    /// Takes the first PDO as it is on the bus: both angles with their qualities.
    pub const fn take_angles(&mut self, bytes: &[u8; 8]) {
        let [x0, x1, x2, y0, y1, y2, quality_x, quality_y] = *bytes;
        // From the top byte, so that the sign of 24 bits is that of 32.
        let x = i32::from_le_bytes([0, x0, x1, x2]) >> 8;
        let y = i32::from_le_bytes([0, y0, y1, y2]) >> 8;
        self.angle = [x, y];
        self.quality = [quality_x, quality_y];
    }

    /// Takes the second PDO as it is on the bus: what is behind the angles.
    pub const fn take_backing(&mut self, bytes: &[u8; 8]) {
        let [a0, a1, b0, b1, c0, c1, captured, activity] = *bytes;
        self.vector = [
            i16::from_le_bytes([a0, a1]),
            i16::from_le_bytes([b0, b1]),
            i16::from_le_bytes([c0, c1]),
        ];
        self.captured = captured;
        self.activity = activity;
    }

    /// The first two PDOs as they are on the bus, the first one first.
    pub const fn bytes(&self) -> [u8; 16] {
        let [x, y] = self.angle;
        let [x0, x1, x2, _] = x.to_le_bytes();
        let [y0, y1, y2, _] = y.to_le_bytes();
        let [qx, qy] = self.quality;
        let [a, b, c] = self.vector;
        let ([a0, a1], [b0, b1], [c0, c1]) = (a.to_le_bytes(), b.to_le_bytes(), c.to_le_bytes());
        [
            x0,
            x1,
            x2,
            y0,
            y1,
            y2,
            qx,
            qy,
            a0,
            a1,
            b0,
            b1,
            c0,
            c1,
            self.captured,
            self.activity,
        ]
    }
}

impl Default for Exchange {
    fn default() -> Self {
        Self::NOTHING
    }
}

/// The code of a reason, 1 to 31: in a quality byte, and in the objects that tell it.
pub const fn reason_code(reason: Invalid) -> u8 {
    match reason {
        Invalid::NoSample => 1,
        Invalid::Settling => 2,
        Invalid::Stale => 3,
        Invalid::OverRange => 4,
        Invalid::NoTemperature => 5,
        Invalid::NotMeasured => 6,
        Invalid::PartReset => 7,
        Invalid::Bus => 8,
        Invalid::Stuck => 9,
        Invalid::Noise => 10,
        Invalid::Spikes => 11,
        Invalid::Thermometer => 12,
        Invalid::Biased => 13,
        Invalid::Corrupt => 14,
        Invalid::Silent => 15,
        Invalid::Late => 16,
        Invalid::Refused => 17,
        Invalid::Unconfirmed => 18,
        Invalid::Alone => 19,
        Invalid::Unlike => 20,
        Invalid::Uncertain => 21,
    }
}

/// The reason of a code; `None` for 0, for codes above 31, and for those not given out.
pub const fn reason(code: u8) -> Option<Invalid> {
    Some(match code {
        1 => Invalid::NoSample,
        2 => Invalid::Settling,
        3 => Invalid::Stale,
        4 => Invalid::OverRange,
        5 => Invalid::NoTemperature,
        6 => Invalid::NotMeasured,
        7 => Invalid::PartReset,
        8 => Invalid::Bus,
        9 => Invalid::Stuck,
        10 => Invalid::Noise,
        11 => Invalid::Spikes,
        12 => Invalid::Thermometer,
        13 => Invalid::Biased,
        14 => Invalid::Corrupt,
        15 => Invalid::Silent,
        16 => Invalid::Late,
        17 => Invalid::Refused,
        18 => Invalid::Unconfirmed,
        19 => Invalid::Alone,
        20 => Invalid::Unlike,
        21 => Invalid::Uncertain,
        _ => return None,
    })
}

/// The lowest quality that stands for an angle.
const FIRST_ANGLE: u8 = 32;

/// Sixteen steps from 0.001 deg to just below its double, in steps of [`Angle`].
///
/// Rounded to the step; neighbours differ by the sixteenth root of 2, 4.43 %.
const OCTAVE: [u32; 16] = [
    11_930, 12_458, 13_010, 13_586, 14_187, 14_815, 15_471, 16_156, 16_872, 17_619, 18_399, 19_213,
    20_064, 20_952, 21_880, 22_848,
];

/// Octaves that a quality tells apart.
const OCTAVES: u32 = 14;

/// The last of [`OCTAVE`].
const OCTAVE_TOP: u32 = 22_848;

/// The uncertainty that a quality of 32 or more stands for.
fn uncertainty(quality: u8) -> Uncertainty {
    let code = quality.saturating_sub(FIRST_ANGLE);
    match OCTAVE.get(usize::from(code % 16)) {
        Some(step) if quality < u8::MAX => Uncertainty(step << (code / 16)),
        _ => Uncertainty::UNKNOWN,
    }
}

/// The lowest quality whose uncertainty is not below `uncertainty`.
fn quality(uncertainty: Uncertainty) -> u8 {
    // The octave whose top has as many bits, or the next one.
    let bits = u32::BITS - uncertainty.0.leading_zeros();
    let even = bits.saturating_sub(u32::BITS - OCTAVE_TOP.leading_zeros());
    let octave = even + u32::from(OCTAVE_TOP << even.min(OCTAVES) < uncertainty.0);
    if octave >= OCTAVES {
        return u8::MAX;
    }
    let below = OCTAVE.partition_point(|step| step << octave < uncertainty.0);
    FIRST_ANGLE
        .saturating_add(16 * octave as u8)
        .saturating_add(below as u8)
}

/// One axis: angle, with what goes below it, and quality.
fn encode_axis(axis: &Result<Measurement, Invalid>, below: u8) -> (i32, u8) {
    let (angle, quality) = match axis {
        // Half a step is added before the cut; half a turn wraps, as angles do.
        Ok(m) => (m.angle.0.wrapping_add(1 << 11) >> 8, quality(m.unshared)),
        Err(reason) => (0, reason_code(*reason)),
    };
    (angle & !BELOW | i32::from(below) & BELOW, quality)
}

/// An acceleration of 2^-26 g per step in steps of 2^-13 g, rounded, stopping at +-4 g.
fn coarse(accel: i32) -> i16 {
    let steps = accel.saturating_add(1 << 12) >> 13;
    steps.clamp(-i32::from(i16::MAX), i32::from(i16::MAX)) as i16
}

/// What to tell the peer about `observation`, made for the SYNC of `at`, and about how angles are
/// shown.
pub fn encode(observation: &Observation, shown: Presentation, at: Instant) -> Exchange {
    let piece = shown.piece(low_steps(at));
    let (x, quality_x) = encode_axis(&observation.reading.x, piece);
    let (y, quality_y) = encode_axis(&observation.reading.y, piece >> 4);
    Exchange {
        angle: [x, y],
        quality: [quality_x, quality_y],
        vector: observation
            .vector
            .map_or(NO_VECTOR, |v| v.accel.map(coarse)),
        captured: low_steps(at),
        activity: observation.activity.0,
        turned: ToldTurn::encode(observation.turned.as_ref(), low_steps(at)),
    }
}

/// The angles that the peer has told, as its reading for the instant `at`, `latency_us` before it
/// was asked.
///
/// Both uncertainties are the unshared one. Nothing sent yet is [`Invalid::NoSample`]; a reason
/// unknown to this program is [`Invalid::Stale`], which does not pass for a start.
pub fn decode_reading(exchange: &Exchange, at: Instant, latency_us: u32) -> Reading {
    let axis = |angle: i32, quality: u8| match quality {
        0 => Err(Invalid::NoSample),
        1..FIRST_ANGLE => Err(reason(quality).unwrap_or(Invalid::Stale)),
        FIRST_ANGLE.. => Ok(Measurement {
            angle: Angle((angle & !BELOW) << 8),
            uncertainty: uncertainty(quality),
            unshared: uncertainty(quality),
            at,
            latency_us,
        }),
    };
    let ([x, y], [quality_x, quality_y]) = (exchange.angle, exchange.quality);
    Axes {
        x: axis(x, quality_x),
        y: axis(y, quality_y),
    }
}

/// All that the peer has told; see [`decode_reading`].
///
/// `came` are the PDOs of this SYNC that have come. What is behind the angles shows of which SYNC a
/// turn is, so without that there is none.
pub fn decode(exchange: &Exchange, at: Instant, latency_us: u32, came: Pdos) -> Observation {
    let backed = came.have(Pdos::BACKING);
    let turn = backed && exchange.of_one_sync(came).have(Pdos::TURN);
    let there = backed && exchange.vector != NO_VECTOR;
    Observation {
        reading: decode_reading(exchange, at, latency_us),
        vector: there.then(|| Corrected {
            accel: exchange.vector.map(|step| i32::from(step) << 13),
        }),
        activity: Activity(if backed { exchange.activity } else { 0 }),
        turned: if turn { exchange.turned.decode() } else { None },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const AT: Instant = Instant(7_000_000);
    const ALIKE: Presentation = Presentation::AS_MEASURED;
    const BACKED: Pdos = Pdos::ANGLES.with(Pdos::BACKING);

    fn measured(angle: i32, unshared: u32) -> Result<Measurement, Invalid> {
        Ok(Measurement {
            angle: Angle(angle),
            uncertainty: Uncertainty(u32::MAX),
            unshared: Uncertainty(unshared),
            at: Instant(0),
            latency_us: 0,
        })
    }

    fn told(axis: Result<Measurement, Invalid>) -> Result<Measurement, Invalid> {
        let reading = Axes {
            x: Err(Invalid::Bus),
            y: axis,
        };
        let decoded = decode_reading(&encode(&reading.into(), ALIKE, AT), AT, 30_000);
        assert_eq!(decoded.x, Err(Invalid::Bus));
        decoded.y
    }

    #[test]
    fn every_reason_survives() {
        let codes = (0..=u8::MAX).filter_map(|code| Some((code, reason(code)?)));
        let mut count = 0;
        for (code, why) in codes {
            assert_eq!(reason_code(why), code);
            assert!(code < FIRST_ANGLE);
            assert_eq!(told(Err(why)), Err(why));
            count += 1;
        }
        assert_eq!(count, 21);
    }

    #[test]
    fn silence_is_no_sample_and_an_unknown_reason_is_no_angle() {
        let silent = decode_reading(&Exchange::default(), AT, 0);
        assert_eq!(silent.x, Err(Invalid::NoSample));
        let unknown = Exchange {
            angle: [1, 1],
            quality: [30, 31],
            ..Exchange::NOTHING
        };
        let decoded = decode_reading(&unknown, AT, 0);
        assert_eq!(decoded.x, Err(Invalid::Stale));
        assert_eq!(decoded.y, Err(Invalid::Stale));
    }

    #[test]
    fn each_quality_is_its_own_uncertainty_and_they_rise_by_4_5_percent() {
        for code in FIRST_ANGLE..=u8::MAX {
            assert_eq!(quality(uncertainty(code)), code);
        }
        for code in FIRST_ANGLE..254 {
            let (low, high) = (uncertainty(code).0, uncertainty(code + 1).0);
            assert!(
                low < high && u64::from(high) * 1000 <= u64::from(low) * 1045,
                "{code}"
            );
        }
    }

    #[test]
    fn the_range_is_a_thousandth_to_fifteen_degrees() {
        assert!((uncertainty(32).degrees() - 0.001).abs() < 1e-7);
        assert!((uncertainty(254).degrees() - 15.02).abs() < 0.01);
        assert_eq!(uncertainty(255), Uncertainty::UNKNOWN);
        assert_eq!(Uncertainty::UNKNOWN, Uncertainty(1_239_850_262));
        assert_eq!(quality(Uncertainty(0)), 32);
        assert_eq!(quality(Uncertainty::from_degrees(15.1)), 255);
        assert_eq!(quality(Uncertainty(u32::MAX)), 255);
    }

    #[test]
    fn what_is_behind_the_angles_survives_to_half_a_step() {
        let accel = [tilt::ONE_G, -5_000_000, i32::MAX];
        let observation = Observation {
            vector: Some(Corrected { accel }),
            activity: Activity(77),
            ..Observation::absent(Invalid::Noise)
        };
        let told = encode(&observation, ALIKE, Instant(1_234_999));
        assert_eq!(told.captured, (617 % 256) as u8);
        let back = decode(&told, AT, 0, BACKED);
        assert_eq!(
            (back.reading.x, back.activity),
            (Err(Invalid::Noise), Activity(77))
        );
        let vector = back.vector.unwrap().accel;
        assert_eq!(vector[0], tilt::ONE_G);
        assert!((vector[1] + 5_000_000).abs() <= 1 << 12);
        assert_eq!(vector[2], 32_767 << 13, "the end of what can be told");
        let bare = decode(&told, AT, 0, Pdos::ANGLES);
        assert_eq!((bare.vector, bare.activity), (None, Activity::NONE));
        let none = encode(&Observation::absent(Invalid::Bus), ALIKE, AT);
        assert_eq!(decode(&none, AT, 0, BACKED).vector, None);
    }

    /// Each set of PDOs that may have come, with a turn of this SYNC and of another one.
    #[test]
    fn a_turn_that_has_not_come_at_this_sync_is_none() {
        let turned = Turned {
            angle: [1, -2, 3],
            activity: Activity(9),
            bias: None,
            accel: 0,
            scale_share: 0,
        };
        let observation = Observation {
            turned: Some(turned),
            ..Observation::absent(Invalid::Noise)
        };
        let fresh = encode(&observation, ALIKE, AT);
        let mut stale = fresh;
        stale.turned.captured = stale.turned.captured.wrapping_sub(10);
        let without = encode(&Observation::absent(Invalid::Noise), ALIKE, AT);
        for came in (0..8).map(Pdos) {
            let all = came.have(BACKED.with(Pdos::TURN));
            let backed = came.have(Pdos::BACKING);
            let told = |exchange: &Exchange| decode(exchange, AT, 0, came).turned;
            let turn = (backed && came.have(Pdos::TURN)).then_some(turned);
            assert_eq!(told(&fresh), turn, "{came:?}");
            assert_eq!((told(&stale), told(&without)), (None, None), "{came:?}");
            let whole = |exchange: &Exchange| {
                let needed = BACKED.with(Pdos::TURN);
                exchange.of_one_sync(came).have(needed)
            };
            assert_eq!([&fresh, &without].map(whole), [all; 2], "{came:?}");
            assert!(!whole(&stale), "{came:?}");
            assert_eq!(stale.of_one_sync(came).have(BACKED), came.have(BACKED));
        }
    }

    #[test]
    fn bytes_are_those_of_the_two_pdos() {
        let exchange = Exchange {
            angle: [0x0003_0201, -1],
            quality: [0x40, 0x41],
            vector: [0x0706, -1, 0x0908],
            captured: 0xAA,
            activity: 0xBB,
            ..Exchange::NOTHING
        };
        let want = [
            1, 2, 3, 255, 255, 255, 0x40, 0x41, 6, 7, 255, 255, 8, 9, 0xAA, 0xBB,
        ];
        assert_eq!(exchange.bytes(), want);
    }

    #[test]
    fn half_a_turn_wraps() {
        let near = told(measured(i32::MAX, 0)).unwrap();
        assert_eq!(near.angle, Angle(i32::MIN));
    }

    proptest! {
        #[test]
        fn an_angle_survives_to_half_a_step(angle: i32, unshared in 0..1_239_850_262_u32) {
            let back = told(measured(angle, unshared)).unwrap();
            prop_assert!(back.angle.minus(Angle(angle)).magnitude() <= 1 << 11);
            prop_assert_eq!((back.at, back.latency_us), (AT, 30_000));
        }

        #[test]
        fn an_uncertainty_is_never_told_smaller(unshared in 0..1_239_850_262_u32) {
            let back = told(measured(0, unshared)).unwrap().unshared.0;
            prop_assert!(back >= unshared);
            if (11_930..uncertainty(254).0).contains(&unshared) {
                prop_assert!(u64::from(back) * 1000 <= u64::from(unshared) * 1045 + 1000);
            }
        }

        #[test]
        fn a_larger_uncertainty_has_no_lower_quality(a: u32, b: u32) {
            let (low, high) = (a.min(b), a.max(b));
            prop_assert!(quality(Uncertainty(low)) <= quality(Uncertainty(high)));
        }
    }
}
