//! The largest uncertainty of a valid angle, 2007h, in what a node shows of both channels.
//!
//! In: limits about what the angles state, in and outside OPERATIONAL. Out: validity, reason,
//! TPDO 1, and safety frames.

use canopen::object::{Value, at};
use tilt::angle::Axes;
use tilt::uncertainty::Uncertainty;

use crate::played::Pair;

#[test]
fn an_angle_less_certain_than_2007h_demands_is_not_valid() {
    let mut pair = Pair::working();
    let stated = pair.read(at(0x2022, 3)) as u16;
    for operational in [true, false] {
        pair.hears(0, &[if operational { 1 } else { 0x80 }, 1]);
        pair.syncs(3);
        for limit in [0, 1, stated - 1, stated, u16::MAX - 1] {
            pair.write(at(0x2007, 0), Value::u16(limit));
            let within = !operational || limit == 0 || stated <= limit;
            let valid = pair.read(at(0x2020, 0)) & 3;
            assert_eq!(valid, if within { 3 } else { 0 }, "{limit}");
            for axis in [1, 2] {
                let told = [0x2025, 0x2022].map(|index| pair.read(at(index, axis)));
                let expected = [[21, 0xFFFF], [0, u32::from(stated)]];
                assert_eq!(told, expected[usize::from(within)], "{limit}");
            }
            if operational {
                pair.sync();
                assert_eq!((pair.told().is_valid(), pair.state()), (within, 1));
            }
        }
    }
    assert!(pair.emergencies().is_empty(), "{:X?}", pair.emergencies());
}

#[test]
fn what_is_shown_of_the_other_channel_keeps_2007h_as_well() {
    let mut pair = Pair::working();
    let own = pair.read(at(0x2022, 3)) as u16;
    pair.write(at(0x2007, 0), Value::u16(2 * own));
    pair.syncs(1);
    assert_eq!(pair.read(at(0x2020, 0)) & 0xF, 0xF);
    let vague = Uncertainty::from_degrees(f64::from(own) * 4e-3);
    let Axes { x, y } = &mut pair.peer.sends.reading;
    for axis in [x, y] {
        let measured = axis.as_mut().unwrap();
        (measured.uncertainty, measured.unshared) = (vague, vague);
    }
    pair.syncs(3);
    assert_eq!(pair.read(at(0x2020, 0)) & 0xF, 0b0011);
}

#[test]
fn safety_frames_come_back_when_the_angle_is_certain_again() {
    let mut pair = Pair::new();
    pair.write(at(0x63FE, 0), Value::u8(0xA5));
    pair.write(at(0x13FE, 0), Value::u8(0xA5));
    let mut pair = pair.at_work();
    let healthy = pair.safety_frames();
    pair.write(at(0x2007, 0), Value::u16(1));
    pair.syncs(2);
    assert_eq!(pair.safety_frames(), 0);
    pair.write(at(0x2007, 0), Value::u16(0));
    assert!(pair.safety_frames() + 3 > healthy);
    assert!(pair.emergencies().is_empty(), "{:X?}", pair.emergencies());
}
