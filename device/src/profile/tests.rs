//! Slopes as a master meets them: write a parameter, read the slope.

use canopen::object::Abort;
use proptest::prelude::*;
use tilt::angle::Angle;
use tilt::chain::Invalid;
use tilt::cross_check::{Judgement, Member};

use super::*;
use crate::profile::state::state_code;

const fn scale(number: u16, bound: i32, form: Form) -> Scale {
    let Ok(resolution) = Resolution::new(number) else {
        panic!("one of four");
    };
    Scale {
        resolution,
        range: Range {
            low: -bound,
            high: bound,
        },
        form,
    }
}

/// As delivered: 0.01 deg, +-90 deg.
const DELIVERED: Scale = scale(10, 90_000, Form::Slope);
const CIRCLE: Scale = scale(100, 90_000, Form::FullTurn);

fn deg(degrees: f64) -> Angle {
    Angle::from_degrees(degrees)
}

fn operated(bits: i32, scale: &Scale) -> Slope {
    let mut slope = Slope::new();
    slope.set(Parameter::Operating, bits, None, scale).unwrap();
    slope
}

#[test]
fn right_after_a_preset_the_slope_reads_it_in_all_four_states() {
    for bits in 0..=3 {
        let mut slope = operated(bits, &DELIVERED);
        slope
            .set(Parameter::Differential, -125, None, &DELIVERED)
            .unwrap();
        let plain = slope.displayed(deg(12.34), &DELIVERED);
        slope
            .set(Parameter::Preset, 500, Some(deg(12.34)), &DELIVERED)
            .unwrap();
        let shown = slope.displayed(deg(12.34), &DELIVERED);
        // Without bit 1 the preset is stored and counts as soon as the bit is set.
        assert_eq!(shown, if bits & 2 != 0 { 500 } else { plain }, "{bits}");
        assert_eq!(slope.get(Parameter::Preset), 500);
        slope
            .set(Parameter::Operating, bits | 2, None, &DELIVERED)
            .unwrap();
        assert_eq!(slope.displayed(deg(12.34), &DELIVERED), 500, "{bits}");
    }
}

#[test]
fn the_preset_formula_does_not_leave_out_the_differential_offset() {
    let mut slope = operated(2, &DELIVERED);
    slope
        .set(Parameter::Differential, 300, None, &DELIVERED)
        .unwrap();
    slope
        .set(Parameter::Preset, 0, Some(deg(10.0)), &DELIVERED)
        .unwrap();
    assert_eq!(slope.get(Parameter::Offset), -1000 - 300);
    assert_eq!(slope.displayed(deg(10.0), &DELIVERED), 0);
    // A later change of it shifts the slope and leaves the offset alone.
    slope
        .set(Parameter::Differential, 100, None, &DELIVERED)
        .unwrap();
    assert_eq!(slope.get(Parameter::Offset), -1300);
    assert_eq!(slope.displayed(deg(10.0), &DELIVERED), -200);
}

#[test]
fn zeroing_works_as_delivered_without_a_second_write() {
    let mut slope = Slope::new();
    slope
        .set(Parameter::Preset, 0, Some(deg(-7.0)), &DELIVERED)
        .unwrap();
    assert_eq!(slope.displayed(deg(-7.0), &DELIVERED), 0);
}

#[test]
fn a_preset_without_a_valid_angle_is_refused() {
    let mut slope = Slope::new();
    let refused = slope
        .set(Parameter::Preset, 0, None, &DELIVERED)
        .unwrap_err();
    assert_eq!(refused, Refused::NoAngle);
    assert_eq!(refused.abort().code(), 0x0800_0022);
    assert_eq!(slope, Slope::new());
}

#[test]
fn inversion_changes_the_sign_and_in_a_full_circle_30_becomes_330() {
    let slope = operated(1, &DELIVERED);
    assert_eq!(slope.displayed(deg(30.0), &DELIVERED), -3000);
    assert_eq!(operated(1, &CIRCLE).displayed(deg(30.0), &CIRCLE), 3300);
    assert_eq!(operated(0, &CIRCLE).displayed(deg(-30.0), &CIRCLE), 3300);
    assert_eq!(operated(1, &CIRCLE).displayed(deg(0.0), &CIRCLE), 0);
    let half = scale(10, 90_000, Form::HalfTurn);
    assert_eq!(operated(1, &half).displayed(deg(-180.0), &half), -18_000);
    assert_eq!(operated(1, &half).displayed(deg(179.0), &half), -17_900);
}

#[test]
fn rounding_up_to_the_full_circle_reads_0() {
    assert_eq!(operated(0, &CIRCLE).displayed(deg(-0.04), &CIRCLE), 0);
    let whole = scale(1000, 90_000, Form::HalfTurn);
    assert_eq!(operated(0, &whole).displayed(deg(179.9), &whole), -180);
}

#[test]
fn a_preset_in_a_circle_wraps_and_one_outside_is_refused() {
    let mut slope = operated(2, &CIRCLE);
    slope
        .set(Parameter::Preset, 100, Some(deg(-10.0)), &CIRCLE)
        .unwrap();
    assert_eq!(slope.displayed(deg(-10.0), &CIRCLE), 100);
    assert_eq!(slope.displayed(deg(-30.0), &CIRCLE), 3500);
    let refused = |preset, slope: &mut Slope| {
        let result = slope.set(Parameter::Preset, preset, Some(deg(0.0)), &CIRCLE);
        result.unwrap_err().abort()
    };
    assert_eq!(refused(3600, &mut slope), Abort::ValueTooHigh);
    assert_eq!(refused(-1, &mut slope), Abort::ValueTooLow);
}

#[test]
fn a_resolution_that_cannot_hold_the_range_is_refused() {
    for number in [0, 2, 9, 11, 999, 1001, u16::MAX] {
        let refused = Resolution::new(number).unwrap_err();
        assert_eq!(refused.abort().code(), 0x0609_0030, "{number}");
    }
    let check = |number, bound, form| scale(number, bound, form).check();
    assert_eq!(check(1, 90_000, Form::Slope), Err(Refused::Resolution));
    assert_eq!(check(1, 32_768, Form::Slope), Err(Refused::Resolution));
    assert_eq!(check(1, 32_767, Form::Slope), Ok(()));
    assert_eq!(check(10, 180_000, Form::Slope), Ok(()));
    assert_eq!(check(10, 90_000, Form::HalfTurn), Ok(()));
    assert_eq!(check(10, 90_000, Form::FullTurn), Err(Refused::Resolution));
    assert_eq!(check(100, 90_000, Form::FullTurn), Ok(()));
    assert_eq!(check(10, 0, Form::Slope), Err(Refused::EmptyRange));
}

#[test]
fn what_would_leave_16_bit_is_refused_and_changes_nothing() {
    let mut slope = Slope::new();
    let before = slope;
    let set =
        |slope: &mut Slope, number| slope.set(Parameter::Differential, number, None, &DELIVERED);
    // 32767 - 9000: at the upper end of the range the slope would just fit.
    assert_eq!(set(&mut slope, 23_768), Err(Refused::TooHigh));
    assert_eq!(set(&mut slope, -23_769), Err(Refused::TooLow));
    assert_eq!(set(&mut slope, i32::MIN), Err(Refused::TooLow));
    assert_eq!(slope, before);
    assert_eq!(set(&mut slope, 23_767), Ok(()));
    assert_eq!(narrow(slope.displayed(deg(90.0), &DELIVERED)), i16::MAX);
    // Where the offsets do not count they may stand, but they cannot be made to count.
    let mut slope = operated(0, &DELIVERED);
    assert_eq!(set(&mut slope, 30_000), Ok(()));
    let refused = slope.set(Parameter::Operating, 2, None, &DELIVERED);
    assert_eq!(refused, Err(Refused::TooHigh));
    assert_eq!(slope.get(Parameter::Operating), 0);
}

#[test]
fn reserved_bits_and_the_offset_cannot_be_written() {
    let mut slope = Slope::new();
    for bits in [4, 32, 255, -1] {
        let refused = slope.set(Parameter::Operating, bits, None, &DELIVERED);
        assert_eq!(refused, Err(Refused::Operating));
    }
    let refused = slope.set(Parameter::Offset, 1, None, &DELIVERED);
    assert_eq!(refused.unwrap_err().abort(), Abort::ReadOnly);
}

#[test]
fn a_new_resolution_keeps_the_angle_of_an_offset() {
    let mut slope = Slope::new();
    slope
        .set(Parameter::Differential, 500, None, &DELIVERED)
        .unwrap();
    let tenth = scale(100, 90_000, Form::Slope);
    let coarse = slope.rescaled(Resolution::Hundredth, &tenth).unwrap();
    assert_eq!(coarse.displayed(deg(10.0), &tenth), 150);
    let fine = scale(1, 30_000, Form::Slope);
    let refused = slope.rescaled(Resolution::Hundredth, &fine);
    assert_eq!(refused, Err(Refused::Resolution));
}

#[test]
fn stored_rubbish_is_found_at_the_start() {
    let mut slope = Slope::new();
    slope.load(Parameter::Operating, 0x82);
    assert_eq!(slope.check(&DELIVERED), Err(Refused::Operating));
    slope.load(Parameter::Operating, 2);
    slope.load(Parameter::Offset, i32::MAX);
    slope.load(Parameter::Differential, i32::MAX);
    assert_eq!(slope.check(&DELIVERED), Err(Refused::TooHigh));
    assert_eq!(slope.displayed(deg(90.0), &DELIVERED), i32::MAX);
}

#[test]
fn every_judgement_has_a_code_of_its_own() {
    let faulty = |faulty| Judgement::OneChannel {
        faulty,
        reason: Invalid::Bus,
    };
    let all = [
        Judgement::Waiting(Invalid::Settling),
        Judgement::Agree,
        Judgement::Warning,
        Judgement::StopMotion,
        Judgement::DataDelay,
        Judgement::PhysicalFault,
        Judgement::Disagree,
        faulty(Member::Own),
        faulty(Member::Peer),
        Judgement::NoChannel(Invalid::Bus),
    ];
    assert!(all.into_iter().map(state_code).eq(0..=9));
}

fn numbers() -> impl Strategy<Value = u16> {
    prop::sample::select(&[1_u16, 10, 100, 1000][..])
}

fn scales() -> impl Strategy<Value = Scale> {
    let form = prop::sample::select(&[Form::Slope, Form::HalfTurn, Form::FullTurn][..]);
    (numbers(), 1..=180_000, form)
        .prop_map(|(number, bound, form)| scale(number, bound, form))
        .prop_filter("fits", |scale| scale.check().is_ok())
}

#[test]
fn both_ways_to_a_unit_lead_to_the_same_number() {
    for resolution in [1, 10, 100, 1000].map(|n| Resolution::new(n).unwrap()) {
        for bits in (0..=u32::MAX).step_by(9_999_991) {
            let angle = Angle(bits.cast_signed());
            assert_eq!(resolution.units_by_sums(angle), resolution.units(angle));
        }
        for angle in [i32::MIN, -1, 0, 1, i32::MAX].map(Angle) {
            assert_eq!(resolution.units_by_sums(angle), resolution.units(angle));
        }
    }
}

proptest! {
    #[test]
    fn units_are_the_nearest(steps: i32, number in numbers()) {
        let units = Resolution::new(number).unwrap().units(Angle(steps));
        let exact = Angle(steps).degrees() * 1000.0 / f64::from(number);
        prop_assert!((f64::from(units) - exact).abs() <= 0.5 + 1e-9);
    }

    #[test]
    fn an_accepted_preset_is_read_back(
        scale in scales(), bits in 0..=3, share in -1.0..1.0, differential: i16, preset: i16,
    ) {
        let measured = deg(share * f64::from(scale.range.high) / 1000.0);
        let mut slope = operated(bits, &scale);
        let _ = slope.set(Parameter::Differential, differential.into(), None, &scale);
        let accepted = slope.set(Parameter::Preset, preset.into(), Some(measured), &scale);
        if accepted.is_ok() && bits & 2 != 0 {
            let shown = slope.displayed(measured, &scale);
            prop_assert_eq!(shown, i32::from(preset));
            prop_assert_eq!(narrow(shown), preset);
        }
    }

    #[test]
    fn within_the_range_the_twins_agree(
        scale in scales(),
        share in -1.0..1.0,
        writes in prop::collection::vec((1_u16..5, any::<i32>()), 0..6),
    ) {
        let measured = deg(share * f64::from(scale.range.high) / 1000.0);
        let mut slope = Slope::new();
        for (distance, number) in writes {
            let parameter = Parameter::new(distance).unwrap();
            let number = if distance == 1 { number & 3 } else { number >> 16 };
            let before = slope;
            if slope.set(parameter, number, Some(measured), &scale).is_err() {
                prop_assert_eq!(slope, before);
            }
        }
        let shown = slope.displayed(measured, &scale);
        prop_assert_eq!(i32::from(narrow(shown)), shown);
        for distance in 1..5 {
            let number = slope.get(Parameter::new(distance).unwrap());
            prop_assert_eq!(i32::from(narrow(number)), number);
        }
    }

    #[test]
    fn no_stored_value_breaks_the_arithmetic(scale in scales(), steps: i32, numbers: [i32; 4]) {
        let mut slope = Slope::new();
        for (number, distance) in numbers.into_iter().zip(1..) {
            slope.load(Parameter::new(distance).unwrap(), number);
        }
        let _ = slope.displayed(Angle(steps), &scale);
        let _ = slope.set(Parameter::Preset, numbers[0], Some(Angle(steps)), &scale);
        if let Ok(next) = slope.rescaled(Resolution::Degree, &scale) {
            prop_assert_eq!(next.check(&scale), Ok(()));
        }
    }
}
