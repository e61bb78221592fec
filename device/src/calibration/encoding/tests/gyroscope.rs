//! Version 3: a gyroscope's words, there and back, and instruments that have none.

use tilt::rate::RateCorrection;

use super::*;
use crate::instrument::{Dynamic, Paper, Product};

/// Place of the first word of the gyroscope in [`turning`].
const FIRST: usize = 4 + 9 + 12 + 12;

/// A gyroscope with a different number in each place.
const RATES: RateCorrection = RateCorrection {
    matrix: [
        [(1 << 30) + 9_000_001, -5_000_002, 4_000_003],
        [3_000_004, (1 << 30) - 8_000_005, -2_000_006],
        [-1_000_007, 7_000_008, (1 << 30) + 6_000_009],
    ],
    scale1_q38: [27_000_010, -13_000_011, 4_000_012],
    bias_q30: [18_000_013, -9_000_014, 5_000_015],
    bias1_q38: [23_000_016, -24_000_017, 12_000_018],
    bias2_q46: [61_000_019, -30_000_020, 15_000_021],
};

/// The product's calibration with a gyroscope.
pub(super) fn turning() -> Calibration {
    Calibration {
        rates: Some(RATES),
        ..two_axis()
    }
}

pub(super) fn some_rates() -> impl Strategy<Value = RateCorrection> {
    let three = |limit: i32| prop::array::uniform3(-limit..=limit);
    let errors = prop::array::uniform3(three(1 << 28));
    let others = (
        three(274_877_907),
        three(374_806_603),
        three(479_752_452),
        three(1_228_166_276),
    );
    (errors, others).prop_map(|(errors, (scale1_q38, bias_q30, bias1_q38, bias2_q46))| {
        let mut matrix = RateCorrection::IDENTITY.matrix;
        let entries = matrix.as_flattened_mut().iter_mut();
        for (entry, error) in entries.zip(errors.as_flattened()) {
            *entry += error;
        }
        RateCorrection {
            matrix,
            scale1_q38,
            bias_q30,
            bias1_q38,
            bias2_q46,
        }
    })
}

/// The product's calibration in the bytes of an instrument of another composition.
fn of<C: Composition>() -> Calibration<C> {
    let mut calibration = Calibration {
        temperature: TemperatureModel::None,
        correction: C::uncalibrated(),
        budget: Budget::DATA_SHEET,
        rates: None,
    };
    calibration.budget.tco = 77;
    calibration
}

#[test]
fn without_a_gyroscope_bytes_check_sum_and_version_are_those_of_before() {
    let quadratic = Calibration {
        temperature: TemperatureModel::Quadratic(Quadratic {
            offset1_q8: [1, -2, 3],
            offset2_q16: [4, 5, -6],
            gain1_q38: [-7, 8, 9],
            gain2_q46: [10, -11, 12],
        }),
        ..two_axis()
    };
    let told = |calibration: &Calibration| {
        let bytes = encode(calibration);
        (bytes[4], bytes.len(), identity(calibration))
    };
    assert_eq!(told(&tables()), (2, 120, 0x1D1B_4A72));
    assert_eq!(told(&two_axis()), (2, 152, 0x1DFA_BC7F));
    assert_eq!(told(&blank()), (2, 128, 0xA8BD_7312));
    assert_eq!(told(&quadratic), (2, 200, 0xFE3F_C387));
    assert_eq!(told(&Calibration::NOMINAL), (1, 136, 0xB7EC_6D1E));
}

#[test]
fn the_words_stand_behind_the_correction_in_their_order() {
    let bytes = encode(&turning());
    assert_eq!(bytes[4..8], [3, 0, 0, 0]);
    assert_eq!(bytes[12..16], [0, 1, 0, 1]);
    let words: Vec<_> = bytes
        .chunks(4)
        .map(|word| i32::from_le_bytes(word.try_into().unwrap()))
        .collect();
    let [a, b, c] = RATES.matrix;
    let others = [
        RATES.scale1_q38,
        RATES.bias_q30,
        RATES.bias1_q38,
        RATES.bias2_q46,
    ];
    let expected = [[a, b, c].concat(), others.concat()].concat();
    assert_eq!(words[FIRST..FIRST + 21], expected);
    assert_eq!(words.len(), FIRST + 21 + 1);
    assert_eq!(identity(&turning()), 0x09B6_4D03);
}

#[test]
fn every_flipped_bit_is_refused() {
    let bytes = encode(&turning());
    for bit in 0..8 * bytes.len() {
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(decode(&damaged).is_err(), "bit {bit}");
    }
}

#[test]
fn version_and_kind_of_gyroscope_belong_together() {
    let refused = |bytes: &[u8], place, word| decode(&with_word(bytes, place, word)).unwrap_err();
    let with = encode(&turning());
    assert_eq!(refused(&with, 3, 0x0000_0100), DecodeError::Kind);
    assert_eq!(refused(&with, 3, 0x0200_0100), DecodeError::Kind);
    assert_eq!(refused(&with, 1, 2), DecodeError::Kind);
    let without = encode(&Calibration {
        rates: None,
        ..turning()
    });
    assert_eq!(refused(&without, 1, 3), DecodeError::Kind);
    assert_eq!(refused(&without, 3, 0x0100_0100), DecodeError::Kind);
}

#[test]
fn what_no_gyroscope_in_its_housing_has_is_refused() {
    let bytes = encode(&turning());
    let at = |place: usize, value: i32| decode(&with_word(&bytes, FIRST + place, value as u32));
    let one = 1 << 30;
    // Place, middle, and how far from it is just taken.
    let limits = [
        (0, one, 1 << 28),
        (1, 0, 1 << 28),
        (8, one, 1 << 28),
        (9, 0, 274_877_907),
        (11, 0, 274_877_907),
        (12, 0, 374_806_603),
        (15, 0, 479_752_452),
        (20, 0, 1_228_166_276),
    ];
    for (place, middle, limit) in limits {
        for sign in [1, -1] {
            assert!(at(place, middle + sign * limit).is_ok(), "{place}");
            let beyond = at(place, middle + sign * (limit + 1));
            assert_eq!(beyond, Err(DecodeError::Rates), "{place}");
        }
        let lowest = at(place, i32::MIN);
        assert_eq!(lowest, Err(DecodeError::Rates), "{place}");
    }
}

/// An instrument without a gyroscope is given the bytes of one that has it, and after that what a
/// gyroscope did not take part in.
fn refuses_and_keeps<C: Composition>() {
    let before = of::<C>();
    let mut result = before.clone();
    let refused = decode_over(&mut result, &encode(&turning()));
    assert_eq!(refused, Err(DecodeError::NoGyroscope));
    assert!(result == before);
    let mut memory = Memory::with_room(4096);
    deliver(&mut memory, &turning()).unwrap();
    assert!(!recall(&mut memory, &mut result).calibrated);
    assert!(result.correction == C::uncalibrated());
}

#[test]
fn an_instrument_without_a_gyroscope_takes_nothing_of_a_calibration_with_one() {
    refuses_and_keeps::<Product>();
    refuses_and_keeps::<Paper>();
}

#[test]
fn an_instrument_with_a_gyroscope_takes_both() {
    let mut result = of::<Dynamic>();
    decode_over(&mut result, &encode(&turning())).unwrap();
    assert_eq!(result.rates, Some(RATES));
    assert_eq!(identity(&result), identity(&turning()));
    let without = two_axis();
    decode_over(&mut result, &encode(&without)).unwrap();
    assert_eq!(result.rates, None);
    assert_eq!(identity(&result), identity(&without));
    result.rates = Some(RATES);
    result.reset();
    assert_eq!(result.rates, None);
}

#[test]
fn a_calibration_of_the_user_counts_for_the_gyroscope_too() {
    let mut memory = Memory::with_room(4096);
    deliver(&mut memory, &turning()).unwrap();
    let mut found = blank();
    assert!(recall(&mut memory, &mut found).calibrated);
    assert_eq!(found, turning());
    stage(&mut memory, Record::Calibration, &two_axis()).unwrap();
    memory.commit().unwrap();
    recall(&mut memory, &mut found);
    assert_eq!(found, two_axis());
    memory.committed[Record::Calibration as usize][60] ^= 4;
    assert!(recall(&mut memory, &mut found).damaged);
    assert_eq!(found, turning());
    memory.committed[Record::Delivered as usize].clear();
    recall(&mut memory, &mut found);
    assert_eq!(found, Calibration::NOMINAL);
}
