//! Table I by whole devices on a simulated bus, in both modes.

use sim::bench::interpretation::Interpretation;
use sim::bench::scene::scene;
use sim::bench::week::{Day, Outcome, Trouble};
use sim::bench::{Mode, World};

const FROM_S: f64 = 60.0;

fn told(mode: Mode, world: &World, unit: u32, trouble: Trouble) -> Day {
    scene(mode, world, (31, unit), 1200.0, trouble).expect("a unit that is accepted")
}

/// The product's check reported late data as a fault like any other.
#[test]
fn table_one_tells_late_data_from_a_physical_fault_in_both_modes() {
    let late = Trouble::Delay {
        from_s: FROM_S,
        ms: 210,
    };
    let supply = Trouble::Supply { from_s: FROM_S };
    for mode in [Mode::Paper, Mode::Product] {
        for unit in 0..3 {
            for (trouble, expected) in [(late, Outcome::DataDelay), (supply, Outcome::SupplyFault)]
            {
                let day = told(mode, &World::NOMINAL, unit, trouble);
                println!(
                    "{mode:?} {unit} {trouble:?}: {:?} {:?}",
                    day.outcome, day.detection_s
                );
                assert_eq!(day.outcome, expected, "{mode:?}, unit {unit}, {trouble:?}");
                assert_eq!(day.after_cure, 0, "{mode:?}, unit {unit}, {trouble:?}");
                assert_eq!(day.stops > 0, mode == Mode::Paper);
            }
        }
    }
}

#[test]
fn late_data_are_detected_however_late_they_are() {
    for mode in [Mode::Paper, Mode::Product] {
        for ms in [25, 50, 75, 130, 410, 1000, 3000] {
            let trouble = Trouble::Delay { from_s: FROM_S, ms };
            let day = told(mode, &World::NOMINAL, 0, trouble);
            println!(
                "{mode:?}, {ms} ms: {:?} after {:?} s",
                day.outcome, day.detection_s
            );
            assert_eq!(day.outcome, Outcome::DataDelay, "{mode:?}, {ms} ms");
        }
    }
}

#[test]
fn a_healthy_scene_has_no_fault_in_either_mode() {
    for mode in [Mode::Paper, Mode::Product] {
        let day = told(mode, &World::NOMINAL, 0, Trouble::None);
        assert_eq!((day.faults, day.stops), (0, 0), "{mode:?}");
        assert_eq!(day.outcome, Outcome::None, "{mode:?}");
    }
}

/// To the letter a node's newest sample is compared, on a machine that shakes: nothing is told
/// apart there, but whole devices run so as well.
#[test]
fn as_printed_whole_devices_warn_on_a_healthy_machine() {
    let printed = World {
        paper: Interpretation::AS_PRINTED,
        ..World::NOMINAL
    };
    let day = told(Mode::Paper, &printed, 0, Trouble::None);
    assert!(day.warnings > 100, "{}", day.warnings);
}
