//! The values of a PDO.
//!
//! In: its eight bytes and what the plan has for them. Out: a [`Values`], in which only those are
//! set that the PDO carries.

use super::plan::{PdoPlan, What};
use device::exchange::{Exchange, NO_VECTOR};

/// What one PDO has told.
#[derive(Clone, Copy, Debug)]
pub struct Values {
    /// Slope X and Y, 0.001 deg; `None` where the number means that there is none.
    pub slopes_mdeg: [Option<i32>; 2],
    /// Validity (2020h).
    pub validity: Option<u8>,
    /// State of the pair (2021h).
    pub state: Option<u8>,
    /// Standard uncertainty, 0.001 deg.
    pub uncertainty_mdeg: Option<u16>,
    /// Group delay, ms.
    pub latency_ms: Option<u8>,
    /// The larger difference, 0.001 deg.
    pub difference_mdeg: Option<i16>,
    /// Where it is that of one axis: which, X being 0.
    pub difference_axis: Option<u8>,
    /// Temperature, degC.
    pub temperature_degc: Option<i8>,
    /// Slope X and Y of the moment, 0.001 deg; `None` where there is none.
    pub now_mdeg: [Option<i32>; 2],
    /// Their standard uncertainty, 0.001 deg.
    pub now_uncertainty_mdeg: Option<u16>,
    /// Rate of turn about X, Y and Z, 0.01 deg/s; `None` where there is none.
    pub rates: [Option<i16>; 3],
    /// Angle, quality and what else of the exchange the PDO has.
    pub exchange: Exchange,
}

const NOTHING: Values = Values {
    slopes_mdeg: [None; 2],
    validity: None,
    state: None,
    uncertainty_mdeg: None,
    latency_ms: None,
    difference_mdeg: None,
    difference_axis: None,
    temperature_degc: None,
    now_mdeg: [None; 2],
    now_uncertainty_mdeg: None,
    rates: [None; 3],
    exchange: Exchange {
        vector: NO_VECTOR,
        ..Exchange::NOTHING
    },
};

/// Takes the bytes apart.
#[inline]
pub fn decode(plan: &PdoPlan, bytes: [u8; 8], resolution_mdeg: i32) -> Values {
    let all = u64::from_le_bytes(bytes);
    let mut values = NOTHING;
    for field in &plan.fields {
        // Shifted up to the top and down again, which keeps the sign where that is wanted; both by
        // less than 64, as a plan has them, so that nothing wraps.
        let upper = 64_u32.wrapping_sub(u32::from(field.bits));
        let top = all.wrapping_shl(upper.wrapping_sub(u32::from(field.shift)));
        let (plain, signed) = (top.wrapping_shr(upper), (top as i64).wrapping_shr(upper));
        match field.what {
            What::Slope(axis) => {
                let mdeg = slope_mdeg(signed, upper, resolution_mdeg);
                put(&mut values.slopes_mdeg, axis, mdeg);
            }
            What::SlopeNow(axis) => {
                let mdeg = slope_mdeg(signed, upper, resolution_mdeg);
                put(&mut values.now_mdeg, axis, mdeg);
            }
            What::UncertaintyNow => {
                let known = plain as u16;
                values.now_uncertainty_mdeg = (known != u16::MAX).then_some(known);
            }
            What::Rate(axis) => {
                let rate = signed as i16;
                put(&mut values.rates, axis, (rate != i16::MIN).then_some(rate));
            }
            What::Validity => values.validity = Some(plain as u8),
            What::State => values.state = Some(plain as u8),
            What::Uncertainty => {
                // The larger of both; unknown is the largest number, and stays unknown.
                values.uncertainty_mdeg = values.uncertainty_mdeg.max(Some(plain as u16));
            }
            What::Latency => values.latency_ms = Some(plain as u8),
            What::Difference(axis) => {
                values.difference_axis = Some(axis).filter(|axis| *axis < 2);
                let known = signed as i16;
                values.difference_mdeg = (known != i16::MIN).then_some(known);
            }
            What::Temperature => values.temperature_degc = Some(signed as i8),
            What::Angle(axis) => put(&mut values.exchange.angle, axis, signed as i32),
            What::Quality(axis) => put(&mut values.exchange.quality, axis, plain as u8),
            What::Vector(axis) => put(&mut values.exchange.vector, axis, signed as i16),
            What::Captured => values.exchange.captured = plain as u8,
            What::Activity => values.exchange.activity = plain as u8,
            What::Turned | What::Other => {}
        }
    }
    let is_known = |mdeg: &u16| *mdeg != u16::MAX;
    values.uncertainty_mdeg = values.uncertainty_mdeg.filter(is_known);
    values
}

/// 0.001 deg of a number in the unit of slopes; the lowest of its length stands for none.
#[inline]
fn slope_mdeg(number: i64, upper: u32, resolution_mdeg: i32) -> Option<i32> {
    let mdeg = (number != i64::MIN >> upper).then(|| number * i64::from(resolution_mdeg));
    mdeg.and_then(|mdeg| i32::try_from(mdeg).ok())
}

#[inline]
fn put<T>(places: &mut [T], axis: u8, value: T) {
    if let Some(place) = places.get_mut(usize::from(axis)) {
        *place = value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn slopes_of_32_bit_and_another_resolution() {
        let plan = PdoPlan::of(0x181, 1, &[0x6110_0020, 0x6120_0020]);
        let values = decode(&plan, [0xFF, 0xFF, 0xFF, 0xFF, 0, 0, 0, 0x80], 100);
        assert_eq!(values.slopes_mdeg, [Some(-100), None]);
    }

    #[test]
    fn angle_and_rates_of_the_moment() {
        let node = super::super::NodePlan::as_delivered(1);
        let angle = decode(&node.pdos[4], [0xE8, 3, 0, 0x80, 20, 0, 0, 6], 10);
        assert_eq!(angle.now_mdeg, [Some(10_000), None]);
        assert_eq!(angle.now_uncertainty_mdeg, Some(20));
        assert_eq!(angle.slopes_mdeg, [None; 2]);
        let rates = decode(&node.pdos[5], [0x60, 0xF0, 0xFF, 0x7F, 0, 0x80, 0, 0], 10);
        assert_eq!(rates.rates, [Some(-4000), Some(i16::MAX), None]);
    }

    #[test]
    fn an_unknown_uncertainty_before_a_known_one_was_shown_as_known() {
        let plan = PdoPlan::of(0x281, 10, &[0x2022_0110, 0x2022_0210]);
        let of = |x: u16, y: u16| {
            let [[a, b], [c, d]] = [x, y].map(u16::to_le_bytes);
            decode(&plan, [a, b, c, d, 0, 0, 0, 0], 10).uncertainty_mdeg
        };
        assert_eq!((of(0xFFFF, 100), of(100, 0xFFFF)), (None, None));
        assert_eq!((of(200, 100), of(100, 200)), (Some(200), Some(200)));
    }

    #[test]
    fn what_a_mapping_does_not_have_was_0() {
        let plan = PdoPlan::of(0x281, 10, &[0x2022_0310]);
        let values = decode(&plan, [20, 0, 0, 0, 0, 0, 0, 0], 10);
        assert_eq!(values.uncertainty_mdeg, Some(20));
        assert_eq!((values.latency_ms, values.temperature_degc), (None, None));
    }

    proptest! {
        #[test]
        fn the_exchange_comes_out_as_it_went_in(
            angle in [-(1 << 23)..(1 << 23), -(1 << 23)..(1 << 23)],
            quality: [u8; 2],
            vector: [i16; 3],
            captured: u8,
            activity: u8,
        ) {
            let told = Exchange { angle, quality, vector, captured, activity, ..Exchange::NOTHING };
            let [one, two] = [0, 8].map(|at| told.bytes()[at..at + 8].try_into().unwrap());
            let node = super::super::NodePlan::as_delivered(1);
            let (first, second) = (decode(&node.pdos[2], one, 10), decode(&node.pdos[3], two, 10));
            prop_assert_eq!((first.exchange.angle, first.exchange.quality), (angle, quality));
            prop_assert_eq!(second.exchange.vector, vector);
            prop_assert_eq!(
                (second.exchange.captured, second.exchange.activity),
                (captured, activity)
            );
        }

        #[test]
        fn any_mapping_of_any_bytes_has_values(
            mapping in proptest::collection::vec(any::<u32>(), 0..12),
            bytes: [u8; 8],
            resolution in 1..1000,
        ) {
            let plan = PdoPlan::of(0x181, 1, &mapping);
            prop_assert!(plan.length <= 8);
            let _ = decode(&plan, bytes, resolution);
        }
    }
}
