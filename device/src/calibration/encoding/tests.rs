//! Calibrations there and back, and bytes that are none.

extern crate std;

mod gyroscope;

use std::vec::Vec;

use proptest::prelude::*;
use tilt::ONE_G;
use tilt::angle::{Angle, Axes, Harmonics};
use tilt::temperature::DataSheet;

use super::*;
use crate::calibration::{deliver, recall, stage};
use crate::records::tests::Memory;
use crate::records::{Record, RecordStore};

/// What a decoding starts from in these tests.
fn blank() -> Calibration {
    Calibration {
        temperature: TemperatureModel::None,
        correction: Correction::OneAxis {
            vector: Vector::IDENTITY,
            harmonics: Harmonics::default(),
        },
        budget: Budget::calibrated(Uncertainty(0), Uncertainty(0), Span::CHAMBER),
        rates: None,
    }
}

fn encode(calibration: &Calibration) -> Vec<u8> {
    let mut bytes = std::vec![0; length(calibration) as usize + 5];
    let written = read_at(calibration, 0, &mut bytes);
    bytes.truncate(written);
    bytes
}

fn decode_over<C: Composition>(
    result: &mut Calibration<C>,
    bytes: &[u8],
) -> Result<(), DecodeError> {
    let mut source = |offset: u32, into: &mut [u8]| {
        let rest = bytes.get(offset as usize..).unwrap_or(&[]);
        into.iter_mut()
            .zip(rest)
            .map(|(to, from)| *to = *from)
            .count()
    };
    decode_into(result, &mut source)
}

fn decode(bytes: &[u8]) -> Result<Calibration, DecodeError> {
    let mut result = blank();
    decode_over(&mut result, bytes).map(|()| result)
}

/// Replaces one word and mends the check sum: content that was written so on purpose.
fn with_word(bytes: &[u8], place: usize, word: u32) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[4 * place..4 * place + 4].copy_from_slice(&word.to_le_bytes());
    mended(bytes)
}

fn mended(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.truncate(bytes.len() - 4);
    let mut crc = Crc32::new();
    crc.add(&bytes);
    bytes.extend(crc.value().to_le_bytes());
    bytes
}

fn straight_table(points: i32) -> Table {
    let points: Vec<_> = (0..points)
        .map(|i| Point {
            accel: i * (ONE_G / 100),
            angle: Angle(i << 22),
        })
        .collect();
    Table::new(&points).unwrap()
}

fn tables() -> Calibration {
    Calibration {
        correction: Correction::Tables {
            tables: Axes {
                x: straight_table(3),
                y: straight_table(4),
            },
            rule: Rule::Linear,
        },
        ..blank()
    }
}

fn two_axis() -> Calibration {
    Calibration {
        correction: Correction::TwoAxis {
            vector: Vector::IDENTITY,
            harmonics: Axes::default(),
        },
        ..blank()
    }
}

fn numbers() -> impl Strategy<Value = [i32; 3]> {
    any::<[i32; 3]>()
}

fn some_model() -> impl Strategy<Value = TemperatureModel> {
    let knots = prop::collection::btree_set(-20_000..20_000_i32, KNOTS);
    let slopes = prop::collection::vec(numbers(), KNOTS - 1);
    prop_oneof![
        Just(TemperatureModel::None),
        numbers().prop_map(|tco_q8| TemperatureModel::DataSheet(DataSheet { tco_q8 })),
        (knots, slopes).prop_map(|(knots, slopes)| {
            let mut model = Piecewise::default();
            for (to, from) in model.knots.iter_mut().zip(knots) {
                *to = Temperature(from);
            }
            for (to, from) in model.slopes_q8.iter_mut().zip(slopes) {
                *to = from;
            }
            TemperatureModel::Piecewise(model)
        }),
        (numbers(), numbers(), numbers(), numbers()).prop_map(|(a, b, c, d)| {
            TemperatureModel::Quadratic(Quadratic {
                offset1_q8: a,
                offset2_q16: b,
                gain1_q38: c,
                gain2_q46: d,
            })
        }),
    ]
}

fn some_harmonics() -> impl Strategy<Value = Harmonics> {
    let amplitude = -59_000_000..59_000_000_i32;
    let three = prop::array::uniform3(amplitude);
    (three.clone(), three).prop_map(|(cosine, sine)| Harmonics { cosine, sine })
}

fn some_vector() -> impl Strategy<Value = Vector> {
    let small = prop::array::uniform3(prop::array::uniform3(-1i32 << 27..1 << 27));
    let offset = prop::array::uniform3(-(1i32 << 26)..1 << 26);
    (small, offset).prop_map(|(small, offset)| {
        let mut vector = Vector::IDENTITY;
        let entries = vector.matrix.as_flattened_mut().iter_mut();
        for (entry, small) in entries.zip(small.as_flattened()) {
            *entry += small;
        }
        vector.offset = offset;
        vector
    })
}

fn some_table() -> impl Strategy<Value = Table> {
    let angles = prop::collection::btree_set(any::<i32>(), 2..=MAX_POINTS);
    (angles, 0..1_000_000_i32).prop_map(|(angles, step)| {
        let points: Vec<_> = angles
            .into_iter()
            .enumerate()
            .map(|(i, angle)| Point {
                accel: i as i32 * (step + ONE_G / 90) - ONE_G,
                angle: Angle(angle),
            })
            .collect();
        Table::new(&points).unwrap()
    })
}

fn some_correction() -> impl Strategy<Value = Correction> {
    let rules = [Rule::Nearest, Rule::Linear, Rule::PrintedQuarter];
    prop_oneof![
        (
            some_table(),
            some_table(),
            prop::sample::select(rules.to_vec())
        )
            .prop_map(|(x, y, rule)| {
                Correction::Tables {
                    tables: Axes { x, y },
                    rule,
                }
            }),
        (some_vector(), some_harmonics(), some_harmonics()).prop_map(|(vector, x, y)| {
            Correction::TwoAxis {
                vector,
                harmonics: Axes { x, y },
            }
        }),
        (some_vector(), some_harmonics())
            .prop_map(|(vector, harmonics)| Correction::OneAxis { vector, harmonics }),
    ]
}

fn some_calibration() -> impl Strategy<Value = Calibration> {
    let budget = any::<[u32; 5]>().prop_map(|[noise, repeatability, hysteresis, a, b]| Budget {
        noise,
        repeatability: repeatability.max(1),
        hysteresis,
        ..Budget::calibrated(Uncertainty(a), Uncertainty(b), Span::REFERENCE)
    });
    let growth = proptest::option::of(any::<(i32, u32, i32, i32)>());
    let rates = proptest::option::of(gyroscope::some_rates());
    (some_model(), some_correction(), budget, growth, rates).prop_map(
        |(temperature, correction, mut budget, growth, rates)| {
            budget.span = Span::implied_by(&temperature);
            budget.fitted_at = Temperature::REFERENCE;
            if let Some((fitted_at, tco, low, high)) = growth {
                budget.fitted_at = Temperature(fitted_at);
                budget.tco = tco;
                budget.span.low = Temperature(low);
                budget.span.high = Temperature(high);
            }
            Calibration {
                temperature,
                correction,
                budget,
                rates,
            }
        },
    )
}

#[test]
fn tables_that_a_node_made_with_a_budget_of_zeros_get_the_one_that_their_points_tell() {
    for (calibration, worth) in [(tables(), false), (two_axis(), true)] {
        let mut bytes = encode(&calibration);
        for place in 4..9 {
            bytes = with_word(&bytes, place, 0);
        }
        let read = decode(&bytes).unwrap();
        assert_eq!(
            read.budget == Budget::DATA_SHEET,
            worth,
            "{:?}",
            read.budget
        );
        assert!(read.budget.repeatability > 0 && read.budget.reference.0 > 0);
    }
}

/// The words of version 1 for a part without a temperature model, as releases before wrote them.
fn version_1(calibration: &Calibration) -> Vec<u8> {
    let mut calibration = calibration.clone();
    calibration.budget.tco = 0;
    let mut bytes = encode(&calibration);
    assert_eq!(bytes[4], 2);
    bytes.drain(36..52);
    let length = bytes.len() as u32;
    mended(with_word(&with_word(&bytes, 1, 1), 2, length))
}

#[test]
fn version_1_of_a_unit_in_the_field_is_read_and_keeps_its_bytes_and_its_check_sum() {
    let models = [
        (TemperatureModel::None, Span::REFERENCE),
        (
            TemperatureModel::Quadratic(Quadratic::default()),
            Span::CHAMBER,
        ),
    ];
    for (temperature, span) in models {
        for correction in [tables().correction, two_axis().correction] {
            let calibration = Calibration {
                temperature,
                correction,
                ..blank()
            };
            let before = version_1(&calibration);
            let read = decode(&before).unwrap();
            assert_eq!((read.budget.tco, read.budget.span), (TCO, span));
            assert_eq!(read.budget.fitted_at, Temperature::REFERENCE);
            assert_eq!(read.correction, calibration.correction);
            assert_eq!(encode(&read), before);
            let sum = before.last_chunk().copied().map(u32::from_le_bytes);
            assert_eq!(sum, Some(identity(&read)));
        }
    }
}

#[test]
fn a_damaged_record_gives_way_to_the_delivered_one() {
    let mut memory = Memory::with_room(4096);
    let mut found = tables();
    let nothing = recall(&mut memory, &mut found);
    assert_eq!((nothing.calibrated, nothing.damaged), (false, false));
    assert_eq!(found, Calibration::NOMINAL);
    deliver(&mut memory, &two_axis()).unwrap();
    let delivered = recall(&mut memory, &mut found);
    assert_eq!((delivered.calibrated, delivered.damaged), (true, false));
    assert_eq!(found, two_axis());
    stage(&mut memory, Record::Calibration, &tables()).unwrap();
    memory.commit().unwrap();
    recall(&mut memory, &mut found);
    assert_eq!(found, tables());
    memory.committed[Record::Calibration as usize][60] ^= 4;
    let damaged = recall(&mut memory, &mut found);
    assert_eq!((damaged.calibrated, damaged.damaged), (true, true));
    assert_eq!(found, two_axis());
    memory.committed[Record::Delivered as usize].clear();
    let nothing = recall(&mut memory, &mut found);
    assert_eq!((nothing.calibrated, nothing.damaged), (false, true));
    assert_eq!(found, Calibration::NOMINAL);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_calibration_comes_back(calibration in some_calibration()) {
        let bytes = encode(&calibration);
        prop_assert_eq!(bytes.len() as u32, length(&calibration));
        prop_assert!(bytes.len() as u32 <= MAX_LENGTH);
        prop_assert_eq!(decode(&bytes), Ok(calibration));
    }

    #[test]
    fn any_part_is_the_part_of_the_whole(
        calibration in some_calibration(),
        offset in 0..3200_u32,
        size in 0..40_usize,
    ) {
        let whole = encode(&calibration);
        let mut part = std::vec![0; size];
        let written = read_at(&calibration, offset, &mut part);
        part.truncate(written);
        let rest = whole.get(offset as usize..).unwrap_or(&[]);
        prop_assert_eq!(&part[..], &rest[..size.min(rest.len())]);
    }

    #[test]
    fn any_bytes_are_refused_without_a_trace(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut result = tables();
        prop_assert!(decode_over(&mut result, &bytes).is_err());
        prop_assert_eq!(result, tables());
    }

    /// The check sum is right here, so the content itself is what is looked at.
    #[test]
    fn any_content_decodes_to_a_legal_calibration_or_the_stored_one_comes_back(
        calibration in some_calibration(),
        changes in prop::collection::vec((3..400_usize, any::<u32>()), 1..4),
    ) {
        let mut bytes = encode(&calibration);
        let words = bytes.len() / 4;
        for (place, word) in changes {
            bytes = with_word(&bytes, 3 + place % (words - 4), word);
        }
        let mut result = two_axis();
        match decode_over(&mut result, &bytes) {
            Ok(()) => prop_assert_eq!(decode(&encode(&result)), Ok(result)),
            Err(_) => {
                let mut memory = Memory::with_room(4096);
                stage(&mut memory, Record::Calibration, &two_axis()).unwrap();
                memory.commit().unwrap();
                prop_assert!(recall(&mut memory, &mut result).calibrated);
                prop_assert_eq!(result, two_axis());
            }
        }
    }
}

#[test]
fn every_flipped_byte_is_refused() {
    for calibration in [tables(), two_axis(), blank(), gyroscope::turning()] {
        let bytes = encode(&calibration);
        for place in 0..bytes.len() {
            for mask in [0x01, 0x80, 0xFF] {
                let mut damaged = bytes.clone();
                damaged[place] ^= mask;
                assert!(decode(&damaged).is_err(), "byte {place}");
            }
        }
    }
}

#[test]
fn every_truncation_and_every_surplus_is_refused() {
    for calibration in [tables(), gyroscope::turning()] {
        let bytes = encode(&calibration);
        for end in 0..bytes.len() {
            assert_eq!(decode(&bytes[..end]), Err(DecodeError::Truncated), "{end}");
        }
        let longer = [&bytes[..], &[0]].concat();
        assert_eq!(decode(&longer), Err(DecodeError::Length));
    }
}

#[test]
fn each_refusal_has_its_name() {
    let bytes = encode(&tables());
    let refused = |place, word| decode(&with_word(&bytes, place, word)).unwrap_err();
    assert_eq!(refused(0, 0), DecodeError::Magic);
    assert_eq!(refused(1, 0), DecodeError::Version);
    assert_eq!(refused(1, 4), DecodeError::Version);
    assert_eq!(refused(2, 5), DecodeError::Length);
    assert_eq!(refused(3, 0x0001_0004), DecodeError::Kind);
    assert_eq!(refused(3, 0x0001_0300), DecodeError::Kind);
    assert_eq!(refused(3, 0x0003_0000), DecodeError::Kind);
    assert_eq!(refused(3, 0x0101_0000), DecodeError::Kind);
    assert_eq!(
        refused(13, 1),
        DecodeError::Table(Axis::X, TableError::TooFew)
    );
    assert_eq!(refused(13, 2), DecodeError::Truncated);
    assert_eq!(refused(13, 200), DecodeError::Truncated);
    let not_rising = DecodeError::Table(Axis::Y, TableError::NotRising);
    assert_eq!(refused(24, 0x8000_0000), not_rising);
    let last = bytes.len() / 4 - 2;
    assert_eq!(
        refused(last - 8, 0),
        DecodeError::Table(Axis::Y, TableError::TooFew)
    );
    let mut wrong = bytes.clone();
    *wrong.last_mut().unwrap() ^= 1;
    assert_eq!(decode(&wrong), Err(DecodeError::CheckSum));
}

#[test]
fn what_would_make_the_device_lie_is_refused() {
    let bytes = encode(&two_axis());
    let refused = |place, word| decode(&with_word(&bytes, place, word)).unwrap_err();
    assert_eq!(refused(13, 0), DecodeError::Matrix);
    assert_eq!(refused(22, 1 << 27), DecodeError::Offset);
    assert_eq!(refused(25, 1 << 28), DecodeError::Harmonics);
    assert_eq!(refused(3, 0x0001_0100), DecodeError::Kind);
    let one_axis = encode(&blank());
    // Nothing is calibrated about y in one-axis mode, so its row may be anything.
    assert!(decode(&with_word(&one_axis, 17, 0)).is_ok());
    assert_eq!(
        decode(&with_word(&one_axis, 21, 0)),
        Err(DecodeError::Matrix)
    );
}

#[test]
fn the_identity_is_the_last_word() {
    for calibration in [tables(), two_axis(), blank(), gyroscope::turning()] {
        let bytes = encode(&calibration);
        let last = bytes.last_chunk().copied().map(u32::from_le_bytes);
        assert_eq!(last, Some(identity(&calibration)));
        assert_eq!(bytes[13], kind(&calibration.correction));
    }
}

#[test]
fn knots_that_do_not_rise_are_refused() {
    let calibration = Calibration {
        temperature: TemperatureModel::Piecewise(Piecewise::default()),
        ..blank()
    };
    assert_eq!(decode(&encode(&calibration)), Err(DecodeError::Knots));
}

#[test]
fn the_longest_is_3176_bytes() {
    assert_eq!(MAX_LENGTH, 3176);
    let mut piecewise = Piecewise::default();
    for (knot, value) in piecewise.knots.iter_mut().zip(0..) {
        *knot = Temperature(value);
    }
    let calibration = Calibration {
        temperature: TemperatureModel::Piecewise(piecewise),
        correction: Correction::Tables {
            tables: Axes {
                x: straight_table(181),
                y: straight_table(181),
            },
            rule: Rule::Nearest,
        },
        budget: Budget {
            tco: 1,
            ..blank().budget
        },
        rates: gyroscope::turning().rates,
    };
    assert_eq!(length(&calibration), MAX_LENGTH);
    let bytes = encode(&calibration);
    let too_many = with_word(&bytes, (HEAD as usize + BUDGET) + PIECEWISE, 182);
    let refused = DecodeError::Table(Axis::X, TableError::TooMany);
    assert_eq!(decode(&too_many), Err(refused));
    assert_eq!(decode(&bytes), Ok(calibration));
}
