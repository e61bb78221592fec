//! The product's ladder as a whole: its order, its memory, and what it must never do.

use std::vec::Vec;

use super::*;
use crate::angle::slopes;
use crate::health::Activity;
use crate::uncertainty::Uncertainty;
use crate::vector::Corrected;

/// 1 g in mg.
pub(super) const G: f64 = 1000.0;

/// 2^-26 g in a thousandth of g.
const STEPS_PER_MG: f64 = 67_108.864;

/// SYNC every 20 ms.
const PERIOD_US: u64 = 20_000;

/// Gravity in mg at slopes x and then y of a housing that is turned about one axis after the other.
pub(super) fn pose(x_deg: f64, y_deg: f64) -> [f64; 3] {
    let (x, y) = (x_deg.to_radians(), y_deg.to_radians());
    [G * x.sin(), G * x.cos() * y.sin(), G * x.cos() * y.cos()]
}

/// The same vector with the housing turned about its y axis.
pub(super) fn turned([x, y, z]: [f64; 3], deg: f64) -> [f64; 3] {
    let (sin, cos) = deg.to_radians().sin_cos();
    [x * cos + z * sin, y, z * cos - x * sin]
}

/// A quiet healthy channel that feels this, mg.
pub(super) fn along(mg: [f64; 3]) -> Observation {
    let vector = Corrected {
        accel: mg.map(|c| (c * STEPS_PER_MG).round() as i32),
    };
    let angles = slopes(vector);
    let axis = |angle| {
        Ok(Measurement {
            angle,
            uncertainty: Uncertainty::from_degrees(0.02),
            unshared: Uncertainty::from_degrees(0.02),
            at: Instant(0),
            latency_us: 25_000,
        })
    };
    Observation {
        reading: Axes {
            x: axis(angles.x),
            y: axis(angles.y),
        },
        vector: Some(vector),
        activity: Activity::OWN,
        turned: None,
    }
}

pub(super) fn level() -> Observation {
    along([0.0, 0.0, G])
}

pub(super) fn loud(activity: u8) -> Observation {
    Observation {
        activity: Activity(activity),
        ..level()
    }
}

pub(super) const fn faulty(node: Member, reason: Invalid) -> Judgement {
    Judgement::OneChannel {
        faulty: node,
        reason,
    }
}

/// A check and its time.
pub(super) struct Bench {
    pub(super) check: CrossCheck,
    pub(super) last: Judgement,
    /// Time between two pairs, us.
    pub(super) period_us: u64,
    now: Instant,
}

impl Bench {
    pub(super) fn new() -> Self {
        Self {
            check: CrossCheck::product(),
            last: Judgement::Agree,
            period_us: PERIOD_US,
            now: Instant(5_000_000),
        }
    }

    /// Findings end after this many seconds.
    pub(super) fn that_forgives(seconds: u32) -> Self {
        let check = ProductCheck {
            latch: Latch::Healthy(seconds * 1_000_000),
            ..ProductCheck::PRODUCT
        };
        Self {
            check: CrossCheck::Product(check, ProductState::default(), None),
            ..Self::new()
        }
    }

    /// The next pair.
    pub(super) fn step(&mut self, own: Observation, peer: Observation) -> Judgement {
        self.now = self.now.offset(self.period_us as i64);
        let verdict = self.check.step(own, peer, self.now);
        assert_eq!((verdict.own(), verdict.peer()), (own.reading, peer.reading));
        self.last = verdict.judgement();
        self.last
    }

    /// The same pair for a while; the judgements that there were, each once in a row.
    fn lasts(&mut self, own: Observation, peer: Observation, seconds: f64) -> Vec<Judgement> {
        let count = (seconds * 1e6 / PERIOD_US as f64).round() as usize;
        let mut all: Vec<_> = (0..count).map(|_| self.step(own, peer)).collect();
        all.dedup();
        all
    }

    /// Both stand still and feel this, mg; the judgements that there were.
    pub(super) fn holds(&mut self, own: [f64; 3], peer: [f64; 3], seconds: f64) -> Vec<Judgement> {
        self.lasts(along(own), along(peer), seconds)
    }

    /// The same; what stands at the end.
    pub(super) fn stands(&mut self, own: [f64; 3], peer: [f64; 3], seconds: f64) -> Judgement {
        self.holds(own, peer, seconds);
        self.last
    }

    /// Both stand still until the judgement is `wanted`; how long that took, s.
    pub(super) fn until(
        &mut self,
        own: [f64; 3],
        peer: [f64; 3],
        seconds: f64,
        wanted: impl Fn(Judgement) -> bool,
    ) -> Option<f64> {
        let count = (seconds * 1e6 / PERIOD_US as f64) as u32;
        let found = (0..count).find(|_| wanted(self.step(along(own), along(peer))))?;
        Some(f64::from(found + 1) * PERIOD_US as f64 * 1e-6)
    }

    /// Level and quiet for so long that everything is known that is learned.
    fn working() -> Self {
        Self::new().at_work()
    }

    fn at_work(mut self) -> Self {
        assert_eq!(self.lasts(level(), level(), 8.0), [Judgement::Agree]);
        self
    }
}

#[test]
fn a_channel_that_reports_its_own_fault_comes_before_every_comparison() {
    let tilted = along(pose(10.0, 0.0));
    for reason in [
        Invalid::PartReset,
        Invalid::Bus,
        Invalid::Stuck,
        Invalid::Corrupt,
    ] {
        let mut bench = Bench::working();
        assert_eq!(
            bench.step(tilted.refused(reason), level()),
            faulty(Member::Own, reason)
        );
        let mut bench = Bench::working();
        assert_eq!(
            bench.step(tilted, loud(200).refused(reason)),
            faulty(Member::Peer, reason)
        );
    }
}

#[test]
fn the_first_finding_about_a_channel_stays_the_finding() {
    let mut bench = Bench::working();
    bench.lasts(loud(120), level(), 0.5);
    assert_eq!(bench.last, faulty(Member::Own, Invalid::Noise));
    let reset = Observation::absent(Invalid::PartReset);
    assert_eq!(
        bench.step(reset, level()),
        faulty(Member::Own, Invalid::Noise)
    );
}

#[test]
fn a_faulty_channel_explains_what_differs_later() {
    let mut bench = Bench::working();
    bench.lasts(loud(120), level(), 0.5);
    assert_eq!(bench.last, faulty(Member::Own, Invalid::Noise));
    let off = bench.lasts(along(pose(5.0, 0.0)), level(), 5.0);
    assert_eq!(off, [faulty(Member::Own, Invalid::Noise)]);
    // And as long as it differs, time does not forgive it.
    let mut bench = Bench::that_forgives(2).at_work();
    bench.lasts(loud(120), level(), 0.5);
    let off = bench.lasts(along(pose(5.0, 0.0)), level(), 10.0);
    assert_eq!(off, [faulty(Member::Own, Invalid::Noise)]);
    bench.lasts(level(), level(), 5.0);
    assert_eq!(bench.last, Judgement::Agree);
}

#[test]
fn both_channels_faulty_is_no_channel() {
    let mut bench = Bench::working();
    let (a, b) = (Invalid::Bus, Invalid::Stuck);
    let pair = (Observation::absent(a), Observation::absent(b));
    assert!(matches!(
        bench.step(pair.0, pair.1),
        Judgement::NoChannel(_)
    ));
    // The peer's is over: the own one is not.
    bench.lasts(pair.0, level(), 2.0);
    assert_eq!(bench.last, faulty(Member::Own, a));
}

#[test]
fn as_delivered_a_finding_stays_until_a_reset() {
    for reason in [Invalid::PartReset, Invalid::Stuck, Invalid::Thermometer] {
        let mut bench = Bench::working();
        bench.step(Observation::absent(reason), level());
        let hour = bench.lasts(level(), level(), 3600.0);
        assert_eq!(hour, [faulty(Member::Own, reason)]);
        bench.check.reset();
        assert_eq!(bench.step(level(), level()), Judgement::Agree);
    }
    let mut bench = Bench::working();
    bench.lasts(along(pose(2.0, 0.0)), level(), 0.5);
    let hour = bench.lasts(level(), level(), 3600.0);
    assert_eq!(hour, [Judgement::Disagree]);
    bench.check.reset();
    assert_eq!(bench.step(level(), level()), Judgement::Agree);
}

#[test]
fn with_a_time_a_finding_ends_when_it_has_been_over_for_so_long() {
    let mut bench = Bench::that_forgives(3).at_work();
    bench.step(Observation::absent(Invalid::PartReset), level());
    let bad = faulty(Member::Own, Invalid::PartReset);
    assert_eq!(bench.lasts(level(), level(), 2.96), [bad]);
    assert_eq!(bench.lasts(level(), level(), 1.0), [bad, Judgement::Agree]);
    // A disagreement too, and what comes back in between starts the time anew.
    let mut bench = Bench::that_forgives(3).at_work();
    for _ in 0..3 {
        bench.lasts(along(pose(2.0, 0.0)), level(), 0.5);
        assert_eq!(bench.lasts(level(), level(), 2.9), [Judgement::Disagree]);
    }
    bench.lasts(level(), level(), 2.0);
    assert_eq!(bench.last, Judgement::Agree);
}

#[test]
fn late_silent_and_stale_channels_are_taken_back_after_a_second() {
    for reason in [Invalid::Silent, Invalid::Late, Invalid::Stale] {
        for node in [Member::Own, Member::Peer] {
            let mut bench = Bench::working();
            let absent = level().refused(reason);
            let (own, peer) = match node {
                Member::Own => (absent, level()),
                Member::Peer => (level(), absent),
            };
            assert_eq!(bench.lasts(own, peer, 30.0), [faulty(node, reason)]);
            assert_eq!(bench.lasts(level(), level(), 0.96), [faulty(node, reason)]);
            let after = bench.lasts(level(), level(), 0.1);
            assert_eq!(after.last(), Some(&Judgement::Agree), "{reason:?}");
        }
    }
}

#[test]
fn what_the_peer_reports_of_itself_is_held_by_the_peer() {
    for reason in [Invalid::PartReset, Invalid::Noise, Invalid::Biased] {
        let mut bench = Bench::working();
        let told = level().refused(reason);
        assert_eq!(
            bench.lasts(level(), told, 5.0),
            [faulty(Member::Peer, reason)]
        );
        // It speaks again, so its own latch has let it go.
        bench.lasts(level(), level(), 1.1);
        assert_eq!(bench.last, Judgement::Agree, "{reason:?}");
    }
}

#[test]
fn what_was_found_about_the_peer_here_outlasts_what_it_reports() {
    let mut bench = Bench::working();
    bench.lasts(level(), loud(120), 0.5);
    let found = faulty(Member::Peer, Invalid::Noise);
    assert_eq!(bench.last, found);
    bench.lasts(level(), level().refused(Invalid::Silent), 2.0);
    assert_eq!(bench.lasts(level(), level(), 60.0), [found]);
    bench.check.peer_restarted();
    assert_eq!(bench.step(level(), level()), Judgement::Agree);
}

#[test]
fn a_restart_of_the_peer_does_not_forgive_the_own_channel_or_a_difference() {
    let mut bench = Bench::working();
    bench.lasts(loud(120), level(), 0.5);
    bench.check.peer_restarted();
    assert_eq!(
        bench.step(level(), level()),
        faulty(Member::Own, Invalid::Noise)
    );
    let mut bench = Bench::working();
    let off = along(pose(2.0, 0.0));
    bench.lasts(off, level(), 0.5);
    bench.check.peer_restarted();
    bench.lasts(off, level(), 0.5);
    assert_eq!(bench.last, Judgement::Disagree);
}

#[test]
fn a_difference_that_is_explained_goes_with_what_explains_it() {
    // Found first and named later, or made by a channel that is faulty already.
    let biased = along([0.0, 0.0, G + 30.0]);
    let mut named = Bench::working();
    named.lasts(level(), biased, 4.0);
    assert_eq!(named.last, faulty(Member::Peer, Invalid::Biased));
    let mut noisy = Bench::working();
    noisy.lasts(level(), loud(120), 0.5);
    noisy.lasts(level(), along(pose(5.0, 0.0)), 2.0);
    assert_eq!(noisy.last, faulty(Member::Peer, Invalid::Noise));
    for mut bench in [named, noisy] {
        // It was taken out and put in again, and is sound now.
        bench.lasts(level(), level(), 5.0);
        bench.check.peer_restarted();
        assert_eq!(bench.step(level(), level()), Judgement::Agree);
    }
}

#[test]
fn a_disagreement_becomes_a_name_at_the_next_standstill() {
    let mut bench = Bench::working();
    // Moving: the difference is seen, and nobody is named.
    let mut moving = Vec::new();
    for n in 0..500 {
        let gravity = pose(20.0 * (f64::from(n) * 0.1).sin(), 0.0);
        let [x, y, z] = gravity;
        moving.push(bench.step(along(gravity), along([x, y, z + 30.0])));
    }
    moving.dedup();
    assert_eq!(moving.last(), Some(&Judgement::Disagree), "{moving:?}");
    assert!(
        moving
            .iter()
            .all(|j| matches!(j, Judgement::Agree | Judgement::Disagree))
    );
    let after = bench.lasts(level(), along([0.0, 0.0, G + 30.0]), 2.5);
    assert_eq!(
        after,
        [Judgement::Disagree, faulty(Member::Peer, Invalid::Biased)]
    );
}

#[test]
fn clipping_again_and_again_is_held_against_the_one_that_clips() {
    for node in [Member::Own, Member::Peer] {
        let mut bench = Bench::working();
        let clipped = level().refused(Invalid::OverRange);
        let found = (0..50).find(|_| {
            let (own, peer) = match node {
                Member::Own => (clipped, level()),
                Member::Peer => (level(), clipped),
            };
            bench.lasts(own, peer, 0.16);
            bench.lasts(level(), level(), 0.04);
            bench.last.is_fault()
        });
        assert_eq!(bench.last, faulty(node, Invalid::OverRange));
        assert!(found.is_some_and(|n| (9..=11).contains(&n)), "{found:?}");
    }
}

#[test]
fn two_channels_that_clip_in_turn_are_not_added_up() {
    let mut bench = Bench::working();
    let clipped = level().refused(Invalid::OverRange);
    for _ in 0..10 {
        for (own, peer) in [(clipped, level()), (level(), clipped)] {
            let judged = bench.lasts(own, peer, 1.5);
            assert_eq!(judged, [Judgement::Waiting(Invalid::OverRange)]);
        }
    }
}

#[test]
fn a_shock_after_a_fault_was_added_to_one_before_it() {
    let mut bench = Bench::that_forgives(1);
    bench.lasts(level(), level(), 1.0);
    let clipped = level().refused(Invalid::OverRange);
    bench.lasts(level(), clipped, 0.1);
    bench.lasts(level(), level().refused(Invalid::Thermometer), 12.0);
    bench.lasts(level(), level(), 0.45);
    bench.lasts(level(), clipped, 0.1);
    bench.lasts(level(), level(), 0.7);
    assert_eq!(bench.last, Judgement::Agree);
}

#[test]
fn a_machine_that_shook_both_over_their_range_for_two_seconds_stopped_for_good() {
    let mut bench = Bench::working();
    let clipped = level().refused(Invalid::OverRange);
    // Shock after shock: never half a second without one.
    for _ in 0..12 {
        let judged = bench.lasts(clipped, clipped, 0.3);
        assert_eq!(judged, [Judgement::Waiting(Invalid::OverRange)]);
        bench.lasts(clipped, level(), 0.02);
        bench.lasts(level(), level(), 0.3);
    }
    bench.lasts(level(), level(), 1.0);
    assert_eq!(bench.last, Judgement::Agree);
    bench.lasts(clipped, clipped, 9.9);
    assert_eq!(bench.last, Judgement::Waiting(Invalid::OverRange));
    bench.lasts(clipped, clipped, 0.2);
    assert_eq!(bench.last, Judgement::NoChannel(Invalid::OverRange));
}

#[test]
fn a_start_is_waited_for_and_accuses_nobody() {
    let mut bench = Bench::new();
    let waiting = [Invalid::NoSample, Invalid::Settling, Invalid::NoTemperature];
    for reason in waiting {
        let judged = bench.lasts(level().refused(reason), level(), 0.5);
        assert_eq!(judged, [Judgement::Waiting(reason)]);
    }
    assert_eq!(bench.lasts(level(), level(), 5.0), [Judgement::Agree]);
}

/// A shock: both hear it, one a look before the other, both clip, and they differ for a moment.
#[test]
fn one_shock_is_no_verdict() {
    let clipped = |activity| loud(activity).refused(Invalid::OverRange);
    let apart = |mg: f64| Observation {
        activity: Activity(110),
        ..along([mg, -mg, G])
    };
    let tilted = along(pose(1.5, 0.0));
    let shock = [
        (loud(64), loud(170)),
        (loud(190), loud(150)),
        (clipped(150), loud(120)),
        (clipped(90), clipped(90)),
        (loud(80), clipped(80)),
        (apart(15.0), level()),
        (level(), apart(15.0)),
    ];
    let mut bench = Bench::working();
    for n in 0..20 {
        for (own, peer) in shock {
            let judgement = bench.step(own, peer);
            assert!(!judgement.is_fault(), "shock {n}: {judgement:?}");
        }
        let after = bench.lasts(level(), level(), 2.0);
        assert_eq!(after, [Judgement::Agree], "shock {n}");
    }
    // Angles alone, as when the second frame is lost: 0.2 s are allowed.
    let bare = |one: Observation| Observation::from(one.reading);
    assert_eq!(
        bench.lasts(bare(tilted), bare(level()), 0.2),
        [Judgement::Agree]
    );
    assert_eq!(
        bench.lasts(bare(level()), bare(level()), 1.0),
        [Judgement::Agree]
    );
}

#[test]
fn a_spike_and_a_noise_are_held_against_the_channel_that_has_them() {
    for node in [Member::Own, Member::Peer] {
        let mut step = {
            let mut bench = Bench::working();
            move |activity| match node {
                Member::Own => bench.step(loud(activity), level()),
                Member::Peer => bench.step(level(), loud(activity)),
            }
        };
        let judged = [150, 64, 64].map(&mut step);
        assert_eq!(judged.last(), Some(&faulty(node, Invalid::Spikes)));
    }
}

#[test]
fn without_the_second_frame_the_angles_are_compared_alone() {
    let mut bench = Bench::working();
    let bare = |one: Observation| Observation::from(one.reading);
    let off = along(pose(2.0, 0.0));
    assert_eq!(
        bench.lasts(bare(level()), bare(level()), 10.0),
        [Judgement::Agree]
    );
    let judged = bench.lasts(bare(off), bare(level()), 0.5);
    assert_eq!(judged, [Judgement::Agree, Judgement::Disagree]);
}

#[test]
fn the_paper_s_rule_takes_nothing_but_the_angles() {
    let mut check = CrossCheck::paper();
    let own = Observation {
        vector: Some(Corrected {
            accel: [i32::MAX; 3],
        }),
        activity: Activity(255),
        ..level()
    };
    for n in 0..1000 {
        let judgement = check.step(own, level(), Instant(n * PERIOD_US)).judgement();
        assert_eq!(judgement, Judgement::Agree);
    }
    assert_eq!(check.residual(), [0; 3]);
    // 110 and 111 warnings, the first of which is 600 s old and one microsecond less.
    for (last_us, expected) in [
        (600_000_000, Judgement::Warning),
        (599_999_999, Judgement::StopMotion),
    ] {
        let mut check = CrossCheck::paper();
        let mut at = |us| {
            check
                .step(along(pose(1.0, 0.0)), level(), Instant(us))
                .judgement()
        };
        assert!((0..110).all(|n| at(n * PERIOD_US) == Judgement::Warning));
        assert_eq!(at(last_us), expected);
    }
}
