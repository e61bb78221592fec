//! A device that is set up from the bus: what it shows to whoever calibrates and zeroes it.
//!
//! In: NMT, a housing that is turned, presets. Out: the angles and their reasons.

use crate::played::Pair;
use canopen::object::{Value, at};
use device::presentation::Presentation;
use device::profile::{Parameter, Resolution, Slope};

#[test]
fn outside_operational_the_angle_of_2010h_stood_at_the_last_sync() {
    let mut pair = Pair::working();
    assert_eq!(pair.read(at(0x2010, 1)), 0);
    pair.hears(0, &[128, 0]);
    // SYNC has stopped, and the housing is turned on its side.
    pair.set_register(0x2D, 0);
    pair.set_register(0x29, 0x40);
    pair.pass(1_000_000);
    let angle =
        f64::from((pair.read(at(0x2010, 1)) << 8).cast_signed() >> 8) * 360.0 / 16_777_216.0;
    assert!((angle - 90.0).abs() < 0.1, "{angle}");
}

#[test]
fn the_second_node_could_not_be_zeroed_once_the_two_showed_different_angles() {
    let mut pair = Pair::working();
    // The other node shows slope X 10 deg less.
    let mut slope = Slope::new();
    slope.load(Parameter::Differential, -1000);
    pair.peer.shows = Presentation::of([&slope, &Slope::new()], Resolution::Hundredth);
    pair.seconds(3.0);
    assert_eq!(pair.read(at(0x2025, 1)), 20);
    // The same angle as preset makes the two alike again.
    pair.write(at(0x6112, 0), Value::i32(-1000));
    pair.seconds(2.0);
    assert_eq!(pair.read(at(0x2025, 1)), 0);
    assert!(pair.told().is_valid());
}
