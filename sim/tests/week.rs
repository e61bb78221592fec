//! The excavator's week (R18) up to the day of the supply fault, for one seed in both modes.
//!
//! In: a commissioned instrument and five days of three hours. Out: the product finds the fault on
//! day 5, on no other day, and its reset cures it; so does paper mode on the paper's machine. Read
//! as printed on the product's machine it warns all day long (E4, E11). The figures over twenty
//! seeds are those of the accuracy document.

use sim::bench::interpretation::Interpretation;
use sim::bench::week::{BIN_S, Day, FAULT_DAY, HOURS_PER_DAY, Outcome};
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
