//! Slopes in the unit that they are taken in and in others, with all that makes a slope differ
//! from the measured angle and is no other unit.

use super::*;
use proptest::prelude::*;

/// A node whose slopes are the angles in a unit, with all that may be set.
#[derive(Clone, Copy, Debug)]
struct Node {
    unit_mdeg: i32,
    offset_mdeg: [i32; 2],
    is_inverted: bool,
    /// Slopes beyond this stay there.
    limit_mdeg: i32,
}

impl Node {
    const fn of(unit_mdeg: i32) -> Self {
        Self {
            unit_mdeg,
            offset_mdeg: [0; 2],
            is_inverted: false,
            limit_mdeg: 400_000,
        }
    }

    /// TPDO 1 and TPDO 3 of these angles.
    fn sends(&self, mdeg: [i32; 2]) -> [Vec<u8>; 2] {
        let count = |axis: usize| {
            let sign = if self.is_inverted { -1 } else { 1 };
            let slope = sign * mdeg[axis] + self.offset_mdeg[axis];
            let slope = slope.clamp(-self.limit_mdeg, self.limit_mdeg);
            let count = (f64::from(slope) / f64::from(self.unit_mdeg)).round() as i32;
            i16::try_from(count).unwrap_or(i16::MIN).to_le_bytes()
        };
        let valid = (0..2).filter(|axis| count(*axis) != i16::MIN.to_le_bytes());
        let validity = valid.fold(0x7C, |bits, axis| bits | 1 << axis);
        let slopes = [&count(0)[..], &count(1), &[validity, 1]].concat();
        let steps = mdeg.map(|mdeg| ((i64::from(mdeg) << 24) / 360_000) as i32);
        let [x, y] = steps.map(|steps| [0, 1, 2].map(|byte| steps.to_le_bytes()[byte]));
        [slopes, [&x[..], &y, &[0x70, 0x70]].concat()]
    }
}

struct Bus {
    watch: Watch,
    now_ns: u64,
    has_sync: bool,
}

impl Bus {
    fn new() -> Self {
        Self {
            watch: Watch::new(&Plan::default()),
            now_ns: 1_000_000_000,
            has_sync: true,
        }
    }

    fn see(&mut self, id: u16, bytes: &[u8]) {
        self.now_ns += 100_000;
        self.watch.take(self.now_ns, &Frame::data_frame(id, bytes));
    }

    /// One SYNC of channel A.
    fn round(&mut self, node: &Node, mdeg: [i32; 2]) {
        self.now_ns += 10_000_000;
        if self.has_sync {
            self.see(0x080, &[]);
        }
        let [slopes, measured] = node.sends(mdeg);
        self.see(0x181, &slopes);
        self.see(0x381, &measured);
    }

    /// From one angle of X to another, 0.1 deg a SYNC.
    fn turn(&mut self, node: &Node, from_mdeg: i32, to_mdeg: i32) {
        let steps = (to_mdeg - from_mdeg).abs() / 100;
        for step in 0..=steps {
            let x = from_mdeg + (to_mdeg - from_mdeg) * step / steps.max(1);
            self.round(node, [x, -1_234]);
        }
    }

    fn side(&self) -> &Side {
        &self.watch.pairs()[0].sides[0]
    }

    fn slope_x(&self) -> Option<i32> {
        self.side().slopes.unwrap().mdeg[0]
    }

    fn found(&self) -> u64 {
        let mut found = self.side().checks.found();
        found
            .find(|(check, _)| *check == Check::Unit)
            .map_or(0, |(_, finding)| finding.count)
    }
}

#[test]
fn slopes_of_0_1_deg_were_shown_as_a_tenth_of_the_angle() {
    for (unit_mdeg, mdeg) in [(100, 30_000), (1, 20_000), (1000, 75_000)] {
        let mut bus = Bus::new();
        for _ in 0..10 {
            bus.round(&Node::of(unit_mdeg), [mdeg, 700]);
        }
        assert_eq!(
            (bus.slope_x(), bus.side().slopes.unwrap().mdeg[1]),
            (None, None)
        );
        assert_eq!(bus.found(), 6, "the fifth one, and each that follows");
        let round = bus.watch.pairs()[0].under_way();
        assert_eq!(round.slopes[0], Some([None; 2]));
    }
}

#[test]
fn slopes_of_0_1_deg_with_a_preset_are_found_when_the_housing_turns() {
    for unit_mdeg in [1, 100, 1000] {
        for is_inverted in [false, true] {
            let node = Node {
                offset_mdeg: [-12_300, 4_560],
                is_inverted,
                ..Node::of(unit_mdeg)
            };
            let mut bus = Bus::new();
            bus.turn(&node, 7_000, 17_000);
            assert_eq!(bus.slope_x(), None, "{node:?}");
            // The node is set to the unit that was taken.
            let node = Node {
                unit_mdeg: 10,
                ..node
            };
            bus.turn(&node, 17_000, 7_000);
            assert!(bus.slope_x().is_some(), "{node:?}");
        }
    }
}

#[test]
fn a_restart_and_a_configuration_end_the_doubt() {
    let mut bus = Bus::new();
    bus.turn(&Node::of(100), 0, 10_000);
    assert_eq!(bus.slope_x(), None);
    bus.see(0x701, &[0]);
    bus.round(&Node::of(10), [10_000, 0]);
    assert_eq!(bus.slope_x(), Some(10_000));
    let mut told = NodePlan::as_delivered(1);
    told.resolution_mdeg = 100;
    let plan = Plan {
        nodes: vec![told],
        ..Plan::default()
    };
    let mut bus = Bus {
        watch: Watch::new(&plan),
        ..Bus::new()
    };
    bus.turn(&Node::of(100), 0, 30_000);
    assert_eq!((bus.slope_x(), bus.found()), (Some(30_000), 0));
}

#[test]
fn without_tpdo_3_nothing_is_judged() {
    let mut bus = Bus::new();
    for x in 0..100 {
        let [slopes, _] = Node::of(100).sends([x * 500, 0]);
        bus.see(0x080, &[]);
        bus.see(0x181, &slopes);
    }
    assert_eq!((bus.slope_x(), bus.found()), (Some(4_950), 0));
}

#[test]
fn a_preset_while_it_turns_and_one_to_0_again_and_again_are_no_other_unit() {
    let mut bus = Bus::new();
    let mut node = Node::of(10);
    for step in 0..4_000 {
        let x = step * 30;
        if step % 67 == 0 {
            node.offset_mdeg[0] = -x;
        }
        bus.round(&node, [x % 180_000, 10]);
    }
    assert_eq!(bus.found(), 0);
}

#[test]
fn a_slope_at_its_limit_is_no_other_unit() {
    let node = Node {
        limit_mdeg: 45_000,
        ..Node::of(10)
    };
    let mut bus = Bus::new();
    for _ in 0..20 {
        bus.turn(&node, 30_000, 80_000);
        bus.turn(&node, 80_000, 30_000);
    }
    assert_eq!((bus.found(), bus.slope_x()), (0, Some(30_000)));
}

#[test]
fn turns_that_ended_at_a_limit_in_their_first_tenth_were_in_another_unit() {
    let node = Node {
        limit_mdeg: 45_000,
        ..Node::of(10)
    };
    let mut bus = Bus::new();
    for x in [44_800, 46_850, 44_800, 46_850] {
        bus.round(&node, [x, 0]);
    }
    assert_eq!(bus.found(), 0);
}

#[test]
fn half_a_turn_the_other_way_round_is_no_other_unit() {
    let node = Node::of(10);
    let mut bus = Bus::new();
    // 16 bit hold up to 327 deg of 0.01 deg.
    for step in 0..4_000 {
        let x = (step * 370 + 180_000) % 360_000 - 180_000;
        bus.round(&node, [x, 0]);
    }
    assert_eq!(bus.found(), 0);
}

proptest! {
    #[test]
    fn a_node_in_the_unit_taken_is_never_doubted(
        offsets in [-90_000..90_000_i32, -90_000..90_000_i32],
        is_inverted: bool,
        has_sync: bool,
        limit_mdeg in 1_000..180_000_i32,
        walk in prop::collection::vec((-3_000..3_000_i32, -3_000..3_000_i32), 1..200),
    ) {
        let node = Node { unit_mdeg: 10, offset_mdeg: offsets, is_inverted, limit_mdeg };
        let mut bus = Bus { has_sync, ..Bus::new() };
        let mut at = [0_i32; 2];
        for (x, y) in walk {
            at = [(at[0] + x).clamp(-89_000, 89_000), (at[1] + y).clamp(-89_000, 89_000)];
            bus.round(&node, at);
        }
        prop_assert_eq!(bus.found(), 0);
    }

    #[test]
    fn another_unit_is_found_within_10_deg(
        offsets in [-20_000..20_000_i32, -20_000..20_000_i32],
        is_inverted: bool,
        unit in prop::sample::select(vec![100, 1000]),
        begin in -80_000..60_000_i32,
    ) {
        let node = Node { unit_mdeg: unit, offset_mdeg: offsets, is_inverted, limit_mdeg: 400_000 };
        let mut bus = Bus::new();
        bus.turn(&node, begin, begin + 10_000);
        prop_assert_eq!(bus.slope_x(), None);
    }
}
