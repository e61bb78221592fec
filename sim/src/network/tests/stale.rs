//! What a busy or broken bus has kept back doesn't go out once it is too old, and no reading is
//! shown that is older than its channel's fault.

use super::*;

use device::device::OLDEST_READING_US;

use crate::fault::SensorFault;
use crate::lis2dw12;

/// Off by so much an angle is that of another time, deg: at 10 deg/s what is 0.1 s old.
const OFF_DEG: f64 = 1.0;

fn turning() -> Turning {
    Turning {
        rate_deg_s: 10.0,
        from_s: 2.5,
    }
}

impl Site {
    /// SYNCs 20 ms apart while the housing turns.
    fn sync_turning(&mut self, count: usize) {
        for _ in 0..count {
            let _ = (self.network.bus).offer(self.host, Frame::data_frame(0x80, &[]));
            self.run(&mut turning(), 20 * MS);
        }
    }

    /// How many valid slopes came, none of them of another time.
    fn timely_slopes(&self) -> usize {
        let mut count = 0;
        for (at_ns, frame) in &self.trace {
            let (Some(0x181 | 0x182), [low, high, ..]) = (frame.cob_id(), frame.bytes()) else {
                continue;
            };
            let slope = i16::from_le_bytes([*low, *high]);
            if slope == i16::MIN {
                continue;
            }
            let truth = turning().slope_deg(*at_ns as f64 * 1e-9);
            let off = f64::from(slope) * 0.01 - truth;
            assert!(
                off.abs() < OFF_DEG,
                "{off} deg off at {at_ns} ns: {frame:?}"
            );
            count += 1;
        }
        count
    }
}

#[test]
fn angles_of_before_a_short_went_out_after_it() {
    for into_us in [100, 300, 700, 1500] {
        let mut site = Site::working(250);
        site.sync_turning(120);
        site.trace.clear();
        site.send(0x80, &[]);
        site.run(&mut turning(), into_us * 1000);
        let until_ns = site.network.now_ns() + 4000 * MS;
        site.network.bus.short_until(until_ns);
        site.run(&mut turning(), 4000 * MS);
        site.sync_turning(20);
        site.timely_slopes();
    }
}

#[test]
fn on_a_noisy_bus_nothing_is_kept_for_long_and_nothing_stays_behind() {
    let mut site = Site::working(250);
    site.sync_turning(100);
    for corrupt in [0.9, 0.6, 0.3] {
        let rates = Rates {
            corrupt,
            ..Rates::default()
        };
        site.network.bus.faults().set_rates(rates);
        site.sync_turning(30);
    }
    site.timely_slopes();
    site.network.bus.faults().set_rates(Rates::default());
    site.sync_turning(100);
    site.trace.clear();
    site.sync_turning(20);
    for id in [0x181, 0x182, 0x381, 0x382, 0x481, 0x482] {
        assert_eq!(site.times_of(id).len(), 20, "{id:X}h");
    }
    assert_eq!(site.timely_slopes(), 40);
}

/// What goes wrong with the sensor of node 0. The codes of a perfect part stand still anyway.
#[derive(Clone, Copy, Debug)]
enum Wrong {
    Sensor(SensorFault),
    Part(lis2dw12::Fault),
}

const WRONG: [Wrong; 6] = [
    Wrong::Sensor(SensorFault::Thermometer { c: -45.0 }),
    Wrong::Sensor(SensorFault::BrownOut { s: 0.01 }),
    Wrong::Sensor(SensorFault::SampleLoss { share: 1.0 }),
    Wrong::Part(lis2dw12::Fault::Bus),
    Wrong::Part(lis2dw12::Fault::MisoHigh),
    Wrong::Part(lis2dw12::Fault::MisoLow),
];

impl Site {
    fn go_wrong(&mut self, wrong: Wrong) {
        let electronics = self.network.electronics(0);
        match wrong {
            Wrong::Sensor(fault) => electronics.inject(fault, Rng::stream(1, "wrong")),
            Wrong::Part(fault) => electronics.set_part_fault(Some(fault)),
        }
    }

    /// In steps of 0.1 ms with a SYNC every `sync_us`: after each of them a channel with a fault of
    /// its sensor shows no angle, and no reading is too old. True once there was a fault.
    fn is_never_stale(&mut self, steps: usize, sync_us: Option<usize>) -> bool {
        let mut found = false;
        for step in 0..steps {
            if sync_us.is_some_and(|us| (step * 100).is_multiple_of(us)) {
                self.send(0x80, &[]);
            }
            self.run(&mut level(), MS / 10);
            let (unit, shown) = (&self.network.nodes()[0], self.network.shown(0));
            let (reason, faults) = (unit.device.channel().reason(), unit.device.faults());
            let faulty = reason.is_some() || faults.has(Fault::SensorSilent);
            let valid = shown.own(0).is_ok() || shown.own(1).is_ok();
            assert!(!faulty || !valid, "{sync_us:?}: {reason:?}, {faults:?}");
            let now = unit.electronics.clock(self.network.now_s());
            let age_us = now.micros_since(unit.device.values().process.measured_at);
            assert!(
                age_us <= OLDEST_READING_US + 100,
                "{sync_us:?}: {age_us} us"
            );
            found |= faulty;
        }
        found
    }
}

/// A reading that was younger than 10 ms was left as it was, also where the fault was younger: for
/// up to 10 ms 6010h had an angle and 2025h a 0 while the EMCY was on the bus.
#[test]
fn a_fault_was_reported_together_with_an_angle_that_still_read_as_valid() {
    for wrong in WRONG {
        for sync_us in [None, Some(5_000), Some(10_000), Some(20_000), Some(100_000)] {
            for state in [State::PreOperational, State::Operational] {
                for phase_us in [0, 2_300, 4_600, 6_900, 9_200] {
                    let mut site = Site::working(250);
                    if state == State::PreOperational {
                        site.send(0, &[128, 0]);
                    }
                    assert!(!site.is_never_stale(500 + phase_us / 100, sync_us));
                    site.go_wrong(wrong);
                    let found = site.is_never_stale(4_000, sync_us);
                    assert!(found, "{wrong:?}, {sync_us:?}, {state:?}");
                }
            }
        }
    }
}
