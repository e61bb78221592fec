//! What a busy or broken bus has kept back doesn't go out once it is too old.

use super::*;

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
