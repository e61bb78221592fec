//! The excavator's week (R18) up to the day of the supply fault, for one seed in both modes.
//!
//! In: a commissioned instrument and five days of three hours. Out: the product finds the fault on
//! day 5, on no other day, and its reset cures it; so does paper mode on the paper's machine. Read
//! as printed on the product's machine it warns all day long (E4, E11). The figures over twenty
//! seeds are those of the accuracy document.

use sim::bench::interpretation::Interpretation;
use sim::bench::scene;
use sim::bench::week::{BIN_S, Day, FAULT_DAY, HOURS_PER_DAY, Outcome, Trouble, UNSTABLE_FROM_S};
use sim::bench::{Bench, Mode, World};

fn dig(mode: Mode, world: &World, count: u32) -> Vec<Day> {
    let (mut bench, _) = Bench::commissioned(mode, world, 18, 1).unwrap();
    let mut days = Vec::new();
    bench.week(count, 18, |day| days.push(day));
    days
}

/// Runs the days up to the fault; checks on each what holds in both modes.
fn days(mode: Mode) -> Vec<Day> {
    let days = dig(mode, &World::NOMINAL, FAULT_DAY);
    assert_eq!(days.len(), 5);
    for (day, number) in days.iter().zip(1..) {
        println!(
            "{mode:?} day {}: {} warnings, {} stops, {} faults, {} after the cure, {:?}",
            day.day, day.warnings, day.stops, day.faults, day.after_cure, day.outcome
        );
        // Memory is flat: a day leaves no more bins behind than fit in its hours, and in the 1.6 s
        // that each reset adds to them.
        let length_s = HOURS_PER_DAY * 3600.0 + 1.7 * day.faults as f64;
        let most_bins = (length_s / BIN_S) as usize + 1;
        assert_eq!(day.day, number);
        assert_eq!(day.pairs, 540_000, "3 h at 50 per second");
        assert!(day.trace.len() <= most_bins, "{}", day.trace.len());
        assert!(
            day.trace
                .iter()
                .all(|bin| bin.range_deg[0] <= bin.range_deg[1])
        );
    }
    days
}

#[test]
fn r18_the_product_finds_the_fault_of_day_5_and_no_other() {
    let days = days(Mode::Product);
    let (quiet, fault) = days.split_at(4);
    for day in quiet {
        assert_eq!((day.warnings, day.faults), (0, 0), "day {}", day.day);
        assert_eq!(day.outcome, Outcome::None);
    }
    let fault = &fault[0];
    assert!(fault.faults >= 1);
    assert_eq!(fault.outcome, Outcome::SupplyFault);
    assert_eq!(fault.after_cure, 0, "the reset cured it");
    let detection_s = fault.detection_s.expect("the fault of the supply");
    println!("found {detection_s:.1} s after the supply became unstable");
    assert!(detection_s < 120.0, "{detection_s}");
}

#[test]
fn r18_paper_mode_finds_the_fault_of_day_5_and_no_other() {
    let days = days(Mode::Paper);
    let (quiet, fault) = days.split_at(4);
    for day in quiet {
        assert_eq!((day.stops, day.faults), (0, 0), "day {}", day.day);
        // Fig 21: below 0.20 deg.
        let above = day.above_healthy as f64 / day.pairs as f64;
        assert!(above < 0.01, "day {}: {above}", day.day);
    }
    let fault = &fault[0];
    assert!(fault.faults >= 1);
    assert_eq!(fault.outcome, Outcome::SupplyFault);
    assert_eq!(fault.after_cure, 0, "the reset cured it");
}

#[test]
fn r18_as_printed_a_healthy_day_is_full_of_warnings() {
    let printed = World {
        paper: Interpretation::AS_PRINTED,
        ..World::NOMINAL
    };
    let days = dig(Mode::Paper, &printed, 1);
    assert!(days[0].warnings > 1000 && days[0].stops > 10);
}

/// A day on the bench of parts that come as those on the bus do: calibrated, and not fresh from the
/// chamber, whose hysteresis would tell.
fn day_on_the_bench(mode: Mode, world: &World) -> Day {
    let (mut calibrated, _) = Bench::commissioned(mode, world, 18, 1).unwrap();
    let mut bench = Bench::new(mode, world, 18, 1);
    let sides = bench.instrument.sides.iter_mut();
    for (side, left) in sides.zip(&mut calibrated.instrument.sides) {
        core::mem::swap(&mut side.settings, &mut left.settings);
    }
    bench.instrument.start();
    let mut days = Vec::new();
    bench.week(1, 18, |day| days.push(day));
    days.remove(0)
}

/// The week runs on the bench, without a bus and with a cross-check of the bench's own. Two whole
/// devices on a bus have the same days, a healthy one and that of the fault.
#[test]
fn r18_whole_devices_on_a_bus_have_the_days_of_the_bench() {
    let unstable = Trouble::Supply {
        from_s: UNSTABLE_FROM_S,
    };
    for mode in [Mode::Paper, Mode::Product] {
        let world = &World::NOMINAL;
        let day = |trouble| scene::day(mode, world, (18, 1), trouble).expect("an accepted unit");
        let days = [day_on_the_bench(mode, world), day(Trouble::None)];
        // About its mean, which each power-on draws anew.
        let spread = days.each_ref().map(|day| {
            let (rms, mean) = (day.difference.rms(), day.difference.mean());
            (rms * rms - mean * mean).sqrt()
        });
        println!("{mode:?}: the nodes' difference scatters by {spread:.4?} deg, bench and bus");
        let ratio = spread[1] / spread[0];
        assert!((0.9..1.1).contains(&ratio), "{mode:?}: {ratio}");
        for day in &days {
            assert_eq!(
                (day.pairs, day.stops, day.faults),
                (540_000, 0, 0),
                "{mode:?}"
            );
            let above = day.above_healthy as f64 / day.pairs as f64;
            println!("{mode:?}: {above:.5} of the pairs above 0.20 deg");
        }
        let fault = day(unstable);
        println!("{mode:?}: {:?} {:?}", fault.outcome, fault.detection_s);
        assert_eq!(fault.outcome, Outcome::SupplyFault, "{mode:?}");
        assert_eq!(fault.after_cure, 0, "{mode:?}: the reset cured it");
    }
}
