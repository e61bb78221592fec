//! Angle and rates of the moment and the measured turn behind their rows: 2029h, 202Ah, 2034h.
//!
//! In: a channel that reports at each instant what a test sets. Out: what the rows read as, at a
//! SYNC and between two of them.

#[path = "both/nothing.rs"]
mod nothing;

use canopen::nmt::State;
use canopen::node::{Application, Event};
use canopen::object::{Objects, at};
use device::calibration::motor::{MOTOR, TableSettings};
use device::channel::Settings;
use device::exchange::reason_code;
use device::factory::{self, RULE};
use device::instrument::Dynamic;
use device::objects::device_objects::{DeviceObjects, Identity, Parts, Source};
use device::objects::moment::{Moment, NO_RATE, SUM_STEP};
use device::objects::table::{Channel, Models};
use instant::Instant;
use nothing::Nothing;
use tilt::angle::{Angle, Axes};
use tilt::chain::{Invalid, Measurement, Reading};
use tilt::composition::Composition;
use tilt::filter::Filtered;
use tilt::fusion::MeasuredSum;
use tilt::motion::{RATE_STEPS, Rate};
use tilt::observation::Observation;
use tilt::sample::Temperature;
use tilt::uncertainty::Uncertainty;

/// Reports of each instant: slope X is as many hundredths of a degree as milliseconds have passed.
struct Clockwork {
    moment: Result<[f64; 3], Invalid>,
    /// Of X and Y, 0.001 deg.
    uncertainty: [f64; 2],
    turned: MeasuredSum,
}

impl Clockwork {
    fn of(&self, now: Instant) -> Moment {
        let angle = |deg: f64, uncertainty: f64| {
            self.moment.map(|_| Measurement {
                angle: Angle::from_degrees(deg),
                uncertainty: Uncertainty::from_degrees(uncertainty * 1e-3),
                unshared: Uncertainty(0),
                at: now,
                latency_us: 0,
            })
        };
        let [of_x, of_y] = self.uncertainty;
        let steps = |dps: f64| (dps.to_radians() * RATE_STEPS).round() as i32;
        Moment {
            reading: Axes {
                x: angle(now.0 as f64 * 1e-5, of_x),
                y: angle(-1.5, of_y),
            },
            rate: self.moment.map(|dps| Rate {
                rate: dps.map(steps),
            }),
        }
    }
}

impl Source<Dynamic> for Clockwork {
    fn reading(&self, _: &Settings<Dynamic>, _: Instant) -> Reading {
        Observation::absent(Invalid::Stale).reading
    }

    fn observe(&mut self, _: &Settings<Dynamic>, _: Instant) -> Observation {
        Observation::absent(Invalid::Stale)
    }

    fn moment(&self, _: &Settings<Dynamic>, now: Instant) -> Moment {
        self.of(now)
    }

    fn measured_sum(&self) -> MeasuredSum {
        self.turned
    }

    fn filtered(&self) -> Option<Filtered> {
        None
    }

    fn temperature(&self) -> Option<Temperature> {
        None
    }

    fn fault(&self) -> Option<Invalid> {
        None
    }
}

/// Rates in deg/s.
fn parts(moment: Result<[f64; 3], Invalid>) -> Parts<Nothing, Clockwork, Dynamic> {
    let identity = Identity {
        channel: Channel::A,
        serial: 1,
        models: Models::DYNAMIC,
    };
    let table_settings = TableSettings {
        rule: RULE,
        reference: MOTOR,
    };
    Parts::new(
        identity,
        Clockwork {
            moment,
            uncertainty: [19.9; 2],
            turned: MeasuredSum::default(),
        },
        Nothing::NEW,
        &factory::dynamic(),
        table_settings,
        Dynamic::check(),
    )
}

fn at_ms(ms: u64) -> Instant {
    Instant(ms * 1000)
}

fn sync(parts: &mut Parts<Nothing, Clockwork, Dynamic>, ms: u64) {
    let now = at_ms(ms);
    DeviceObjects { parts, now }.event(Event::Sync, now);
}

fn read(parts: &mut Parts<Nothing, Clockwork, Dynamic>, ms: u64, index: u16, sub: u8) -> i32 {
    let now = at_ms(ms);
    let mut objects = DeviceObjects { parts, now };
    let dictionary = objects.dictionary();
    let signed = dictionary
        .entry(at(index, sub))
        .unwrap()
        .data_type
        .is_signed();
    let value = objects.read(at(index, sub)).unwrap();
    if signed {
        value.signed_32()
    } else {
        value.unsigned() as i32
    }
}

#[test]
fn the_rows_show_the_moment_of_the_last_sync_until_the_next() {
    let mut parts = parts(Ok([40.0, -0.004, 123.456]));
    parts.values.parameters.resolution = [10; 2];
    sync(&mut parts, 100);
    for ms in [100, 105, 119] {
        assert_eq!(read(&mut parts, ms, 0x2029, 1), 100);
        assert_eq!(read(&mut parts, ms, 0x2029, 2), -150);
        assert_eq!(read(&mut parts, ms, 0x2029, 3), 20);
        assert_eq!(read(&mut parts, ms, 0x2029, 4), 0);
    }
    sync(&mut parts, 120);
    assert_eq!(read(&mut parts, 125, 0x2029, 1), 120);
    let rates = [1, 2, 3, 4].map(|sub| read(&mut parts, 125, 0x202A, sub));
    assert_eq!(rates, [4000, 0, 12346, 0]);
    // As 6010h shows it: in another unit.
    parts.values.parameters.resolution = [100; 2];
    assert_eq!(read(&mut parts, 125, 0x2029, 1), 12);
}

#[test]
fn rates_stop_where_16_bit_end_and_never_read_as_none() {
    let mut parts = parts(Ok([327.67, 327.8, -480.0]));
    sync(&mut parts, 20);
    let rates = [1, 2, 3, 4].map(|sub| read(&mut parts, 20, 0x202A, sub));
    assert_eq!(rates, [32767, 32767, -32767, 0]);
}

#[test]
fn what_is_not_there_reads_as_none_with_its_reason() {
    let mut parts = parts(Err(Invalid::OverRange));
    let reason = |of| i32::from(reason_code(of));
    for (expected, is_after_sync) in [(Invalid::NoSample, false), (Invalid::OverRange, true)] {
        if is_after_sync {
            sync(&mut parts, 20);
        }
        let angle = [1, 2, 3, 4, 5].map(|sub| read(&mut parts, 20, 0x2029, sub));
        let none = i32::from(i16::MIN);
        assert_eq!(
            angle,
            [none, none, 65535, reason(expected), reason(expected)]
        );
        let rates = [1, 2, 3, 4].map(|sub| read(&mut parts, 20, 0x202A, sub));
        let none = i32::from(NO_RATE);
        assert_eq!(rates, [none, none, none, reason(expected)]);
    }
}

#[test]
fn in_operational_they_count_when_the_slopes_do() {
    let mut parts = parts(Ok([1.0; 3]));
    sync(&mut parts, 20);
    parts.values.state = State::Operational;
    // Never compared.
    let reason = i32::from(reason_code(Invalid::Unconfirmed));
    assert_eq!(read(&mut parts, 20, 0x2029, 4), reason);
    assert_eq!(read(&mut parts, 20, 0x202A, 4), reason);
    assert_eq!(read(&mut parts, 20, 0x202A, 1), i32::from(NO_RATE));
}

#[test]
fn each_axis_keeps_2007h_by_itself_at_the_sync_and_of_the_moment() {
    let mut parts = parts(Ok([1.0; 3]));
    parts.channel.uncertainty = [19.9, 499.9];
    let now = at_ms(20);
    let reading = parts.channel.of(now).reading;
    let observation = Observation::from(reading);
    sync(&mut parts, 20);
    parts.values.process.measure(&reading, now);
    parts.values.state = State::Operational;
    let policy = parts.values.parameters.policy();
    parts
        .pair
        .judge(&observation, &observation, (now, now), policy);
    let stated = [1, 2].map(|sub| read(&mut parts, 20, 0x2022, sub));
    for limit in 0..=600_u16 {
        parts.values.parameters.uncertainty_limit = limit;
        for axis in [0, 1] {
            let within = limit == 0 || stated[axis] <= i32::from(limit);
            let (sub, expected) = (axis as u8 + 1, if within { 0 } else { 21 });
            assert_eq!(
                read(&mut parts, 20, 0x2025, sub),
                expected,
                "{limit}, {axis}"
            );
            let of_moment = read(&mut parts, 20, 0x2029, sub + 3);
            assert_eq!(of_moment, expected, "{limit}, {axis}");
            let valid = read(&mut parts, 20, 0x2020, 0) >> axis & 1 == 1;
            assert_eq!(valid, within, "{limit}, {axis}");
        }
    }
}

#[test]
fn the_measured_turn_is_one_value_and_four_and_goes_on_through_a_wrap() {
    let mut parts = parts(Err(Invalid::NoSample));
    assert_eq!(
        [1, 2, 3, 4, 6].map(|sub| read(&mut parts, 20, 0x2034, sub)),
        [0; 5]
    );
    let all = |parts: &mut Parts<_, _, _>| {
        let mut objects = DeviceObjects {
            parts,
            now: at_ms(20),
        };
        let whole = objects.read(at(0x2034, 5)).unwrap();
        assert_eq!(whole.bytes().len(), 8);
        whole.unsigned().to_le_bytes()
    };
    // 100 samples of 4 rad/s either side of where the sums wrap.
    let (before, after) = (i32::MAX - 5, i32::MAX.wrapping_add(400 << 16) - 5);
    parts.channel.turned = MeasuredSum {
        sum: [before, -1, 1 << 27],
        samples: 0xFFF0,
        gaps: 7,
    };
    let [n, m, x, y, rest @ ..] = all(&mut parts);
    assert_eq!(
        (u16::from_le_bytes([n, m]), rest),
        (0xFFF0, [0xFF, 0xFF, 0, 0])
    );
    assert_eq!(
        i32::from(i16::from_le_bytes([x, y])),
        read(&mut parts, 20, 0x2034, 2)
    );
    assert_eq!(read(&mut parts, 20, 0x2034, 6), 7);
    let from = read(&mut parts, 20, 0x2034, 2) as i16;
    parts.channel.turned.sum[0] = after;
    let to = read(&mut parts, 20, 0x2034, 2) as i16;
    let turned = f64::from(to.wrapping_sub(from)) * SUM_STEP;
    assert!((turned - 400.0).abs() <= SUM_STEP, "{turned}");
}
