//! Presentation: whether both nodes show the same angle as the same number.
//!
//! In: inversion, preset and offsets of both slopes of each node. Out: whether the two nodes show
//! angles that are further apart than what they have measured. Zeroing one node only makes them
//! so, and each of them would call its angle valid.
//!
//! What a node shows travels in the four lowest bits of the two angles of its exchange, which no
//! channel resolves (0.0003 deg): one byte of four at each SYNC, [`Presentation::piece`]. Which one
//! follows from the capture time in the same exchange. A byte counts when it has come twice alike,
//! so that a node which sends the bits of an angle there is not compared.
//!
//! Left out: the resolution (6000h). It is the unit of a number, which whoever reads it has to
//! have in any case.

use instant::Instant;
use tilt::angle::{Angle, Axes};
use tilt::chain::{Invalid, Measurement};
use tilt::observation::Observation;

use crate::profile::{Resolution, Slope};

/// How much the shifts of both nodes may differ beside the uncertainties of their angles: a pair
/// that is zeroed in one place differs by what the channels measured there, 0.5 deg.
const LIMIT: u32 = Angle::from_degrees(0.5).magnitude();

/// Both have to be set alike within this time, us: a tool sets one after the other. Only time
/// between exchanges counts, and of a longer one no more than [`MOST_US`].
const PATIENCE_US: u32 = 2_000_000;

/// The most that one exchange counts for, us.
const MOST_US: u32 = 250_000;

/// 0.001 deg in one step of a code.
const STEP: i32 = 20;

/// Steps of an angle, 2^-32 of a circle, in a step of an acceleration, 2^-26 g: 10.2.
const ANGLE_STEPS: u32 = 10;

/// Half a circle in steps of a code.
const HALF_TURN: i32 = 180_000 / STEP;

/// What is added to a slope, and whether it is inverted, of X and Y: the shift in steps of 0.02 deg
/// from -180 deg on, times two, plus one where it is inverted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Presentation([u16; 2]);

impl Presentation {
    /// As measured: not inverted, nothing added.
    pub const AS_MEASURED: Self = Self([2 * HALF_TURN as u16; 2]);

    /// Of a node's own slopes X and Y, whose parameters are in units of `resolution`.
    pub fn of(slopes: [&Slope; 2], resolution: Resolution) -> Self {
        Self(slopes.map(|slope| {
            let shift = i32::from(resolution.number()).saturating_mul(slope.shift());
            let steps = (shift / STEP + HALF_TURN).rem_euclid(2 * HALF_TURN);
            (steps * 2 + i32::from(slope.is_inverted())) as u16
        }))
    }

    /// The bytes in which it travels.
    const fn bytes(self) -> [u8; 4] {
        let [x, y] = self.0;
        let ([a, b], [c, d]) = (x.to_le_bytes(), y.to_le_bytes());
        [a, b, c, d]
    }

    const fn from_bytes([a, b, c, d]: [u8; 4]) -> Self {
        Self([u16::from_le_bytes([a, b]), u16::from_le_bytes([c, d])])
    }

    /// The byte that goes with an exchange of this capture time.
    pub fn piece(self, captured: u8) -> u8 {
        let bytes = self.bytes();
        bytes.get(place(captured)).copied().unwrap_or(0)
    }

    /// Shift and inversion of an axis.
    const fn axis(code: u16) -> (i32, bool) {
        ((code >> 1) as i32, code & 1 != 0)
    }

    /// True where the two would show the same angle as different numbers.
    fn differs(self, other: Self, uncertainty: Axes<u32>) -> bool {
        let ([x, y], [other_x, other_y]) = (self.0, other.0);
        let one = |own: u16, other: u16, uncertainty: u32| {
            let ((own, own_sign), (other, other_sign)) = (Self::axis(own), Self::axis(other));
            // A turn is 18 000 steps: 2^32 / 18 000.
            let apart = Angle((own - other).wrapping_mul(238_609));
            own_sign != other_sign || apart.magnitude() > LIMIT.saturating_add(uncertainty)
        };
        one(x, other_x, uncertainty.x) || one(y, other_y, uncertainty.y)
    }
}

/// Which byte goes with a capture time: with any period of SYNC but multiples of 256 ms all have
/// their turn, within 32 of them.
const fn place(captured: u8) -> usize {
    ((captured ^ captured >> 2 ^ captured >> 4 ^ captured >> 6) & 3) as usize
}

/// What is known of the peer's presentation.
#[derive(Clone, Copy, Debug, Default)]
pub struct PeerPresentation {
    bytes: [u8; 4],
    /// Bytes that have come twice alike, a bit each.
    known: u8,
    /// When it was last heard.
    heard: Option<Instant>,
    /// For how long the two have shown different angles, us.
    apart_us: u32,
}

impl PeerPresentation {
    /// Nothing heard.
    pub const NONE: Self = Self {
        bytes: [0; 4],
        known: 0,
        heard: None,
        apart_us: 0,
    };

    /// A byte that came with an exchange of this capture time, at `now`.
    ///
    /// `pair` is what this node and the peer have observed, for their uncertainties.
    pub fn hear(
        &mut self,
        (captured, piece): (u8, u8),
        own: Presentation,
        pair: [&Observation; 2],
        now: Instant,
    ) {
        let place = place(captured);
        let Some(byte) = self.bytes.get_mut(place) else {
            return;
        };
        let alike = core::mem::replace(byte, piece) == piece;
        self.known = self.known & !(1 << place) | u8::from(alike) << place;
        let before = self.heard.replace(now).unwrap_or(now);
        let passed_us = now.micros_since(before).clamp(0, i64::from(MOST_US)) as u32;
        if self.known != 0xF {
            return;
        }
        let peer = Presentation::from_bytes(self.bytes);
        if own.differs(peer, vagueness(pair)) {
            let apart_us = self.apart_us.saturating_add(passed_us);
            self.apart_us = apart_us.min(PATIENCE_US + MOST_US);
        } else {
            self.apart_us = 0;
        }
    }

    /// The peer was away: what it shows has to be heard again. What was found stands until then.
    pub const fn hear_anew(&mut self) {
        self.known = 0;
    }

    /// True when the two have shown different angles for too long.
    pub const fn is_apart(&self) -> bool {
        self.apart_us > PATIENCE_US
    }
}

/// Four standard uncertainties of each angle: by so much two that were zeroed in one place may be
/// apart in their shifts.
///
/// With a gyroscope it is that of the accelerometers, since an angle is zeroed at a standstill:
/// what motion adds now was not in it.
fn vagueness([own, peer]: [&Observation; 2]) -> Axes<u32> {
    if let Some(turned) = &own.turned {
        // Both channels are calibrated alike.
        let both = turned.accel.saturating_mul(2 * 4 * ANGLE_STEPS);
        return Axes { x: both, y: both };
    }
    let (own, peer) = (&own.reading, &peer.reading);
    Axes {
        x: unshared(&own.x).saturating_add(unshared(&peer.x)),
        y: unshared(&own.y).saturating_add(unshared(&peer.y)),
    }
}

/// What the channels do not share of an axis' uncertainty, four standard ones; 0 without an angle.
// Once in the image.
#[cfg_attr(target_pointer_width = "32", inline(never))]
fn unshared(axis: &Result<Measurement, Invalid>) -> u32 {
    match axis {
        Ok(measured) => measured.unshared.0.saturating_mul(4),
        Err(_) => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::Parameter;
    use tilt::chain::Invalid;
    use tilt::health::Activity;
    use tilt::turned::Turned;

    const ABSENT: Observation = Observation::absent(Invalid::NoSample);

    fn shifted(units: i32, resolution: Resolution, operating: i32) -> Presentation {
        let mut slope = Slope::new();
        slope.load(Parameter::Operating, operating);
        slope.load(Parameter::Differential, units);
        Presentation::of([&slope, &Slope::new()], resolution)
    }

    /// Tells a presentation every `steps` of the capture time until it is found to differ, for
    /// twenty seconds; after how many exchanges.
    fn found(own: Presentation, peer: Presentation, steps: u8) -> Option<u32> {
        let mut heard = PeerPresentation::NONE;
        let us = u64::from(steps) * 2000;
        (0..20_000_000 / us as u32).find(|n| {
            let captured = (*n as u8).wrapping_mul(steps);
            let now = Instant(u64::from(*n) * us);
            let piece = (captured, peer.piece(captured));
            heard.hear(piece, own, [&ABSENT; 2], now);
            heard.is_apart()
        })
    }

    #[test]
    fn a_preset_on_one_node_only_is_found_at_every_period() {
        let hundredth = Resolution::Hundredth;
        let (own, peer) = (shifted(0, hundredth, 3), shifted(1000, hundredth, 3));
        for steps in 1..=100 {
            let after = found(own, peer, steps).expect("10 deg");
            let patience = 1000 / u32::from(steps) + 1;
            assert!(after <= patience + 60, "{steps}: {after}");
            assert_eq!(found(own, own, steps), None);
            assert_eq!(found(peer, peer, steps), None);
        }
    }

    #[test]
    fn what_is_shown_alike_is_alike_whatever_its_unit() {
        let own = shifted(-1234, Resolution::Hundredth, 2);
        assert_eq!(
            found(own, shifted(-12_340, Resolution::Thousandth, 2), 10),
            None
        );
        // 0.4 deg is what two channels may differ by where both were zeroed.
        assert_eq!(
            found(own, shifted(-1274, Resolution::Hundredth, 2), 10),
            None
        );
        assert!(found(own, shifted(-1294, Resolution::Hundredth, 2), 10).is_some());
        assert!(found(own, shifted(-1234, Resolution::Hundredth, 3), 10).is_some());
        // Offsets that are not added count for nothing.
        let off = shifted(500, Resolution::Hundredth, 0);
        assert_eq!(found(off, shifted(0, Resolution::Hundredth, 2), 10), None);
        // Half a turn to either side is the same.
        let [half, other] = [180, -180].map(|deg| shifted(deg, Resolution::Degree, 2));
        assert_eq!(found(half, other, 10), None);
    }

    #[test]
    fn a_vague_pair_may_be_further_apart() {
        let tenth = |units| shifted(units, Resolution::Tenth, 2);
        let measured = |deg| {
            let unshared = tilt::uncertainty::Uncertainty::from_degrees(deg);
            Ok(Measurement {
                angle: Angle(0),
                uncertainty: unshared,
                unshared,
                at: Instant(0),
                latency_us: 0,
            })
        };
        let vague = Observation::from(Axes {
            x: measured(1.0),
            y: measured(1.0),
        });
        let room = vagueness([&vague, &vague]);
        assert!(!tenth(0).differs(tenth(80), room));
        assert!(tenth(0).differs(tenth(90), room));
        // Vague by its motion: an accelerometer of 2 mg, 0.11 deg, was zeroed at a standstill.
        let moves = Observation {
            turned: Some(Turned {
                angle: [0; 3],
                activity: Activity(0),
                bias: None,
                accel: 134_218,
                scale_share: 0,
            }),
            ..vague
        };
        let room = vagueness([&moves, &vague]);
        assert!(!tenth(0).differs(tenth(13), room));
        assert!(tenth(0).differs(tenth(15), room));
    }

    #[test]
    fn a_peer_that_was_away_gave_an_unlike_pair_two_more_seconds() {
        let hundredth = Resolution::Hundredth;
        let (own, peer) = (shifted(0, hundredth, 3), shifted(1000, hundredth, 3));
        let mut heard = PeerPresentation::NONE;
        let hear = |heard: &mut PeerPresentation, peer: Presentation, n: u64| {
            let captured = (n * 10) as u8;
            let now = Instant(n * 20_000);
            heard.hear((captured, peer.piece(captured)), own, [&ABSENT; 2], now);
            heard.is_apart()
        };
        // It is away for a moment every second and a half.
        let told = (0..200).find(|n| {
            if n % 75 == 74 {
                heard.hear_anew();
            }
            hear(&mut heard, peer, *n)
        });
        assert!(told.is_some_and(|n| n <= 180), "{told:?}");
        // What was found stands while it is away, and ends when it shows the same.
        heard.hear_anew();
        assert!(heard.is_apart());
        let ended = (250..400).find(|n| !hear(&mut heard, own, *n));
        assert!(ended.is_some_and(|n| n <= 280), "{ended:?}");
    }

    #[test]
    fn a_flood_that_mixed_a_few_exchanges_made_an_unlike_pair_of_a_sound_one() {
        let hundredth = Resolution::Hundredth;
        let (own, other) = (shifted(0, hundredth, 3), shifted(1000, hundredth, 3));
        let mut heard = PeerPresentation::NONE;
        for n in 0..40_u64 {
            let captured = (n * 10) as u8;
            let now = Instant(n * 20_000);
            heard.hear((captured, other.piece(captured)), own, [&ABSENT; 2], now);
        }
        // Then nothing for ten seconds, and then what is right.
        for n in 540..700_u64 {
            let captured = (n * 10) as u8;
            let now = Instant(n * 20_000);
            heard.hear((captured, own.piece(captured)), own, [&ABSENT; 2], now);
            assert!(!heard.is_apart(), "{n}");
        }
    }

    #[test]
    fn bits_that_change_all_the_time_are_no_presentation() {
        let mut heard = PeerPresentation::NONE;
        let mut noise = 1_u32;
        for n in 0..10_000_u64 {
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let piece = ((n * 10) as u8, (noise >> 24) as u8);
            let now = Instant(n * 20_000);
            heard.hear(piece, Presentation::default(), [&ABSENT; 2], now);
            assert!(!heard.is_apart(), "{n}");
        }
    }
}
