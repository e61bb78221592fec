//! The checks of two angles: the paper's rule at its boundaries, and the window.

use super::*;
use crate::uncertainty::Uncertainty;

fn reading(x: u32) -> Reading {
    let m = |steps: u32| {
        Ok(Measurement {
            angle: Angle(steps as i32),
            uncertainty: Uncertainty::from_degrees(0.03),
            unshared: Uncertainty::from_degrees(0.03),
            at: Instant(0),
            latency_us: 0,
        })
    };
    Axes { x: m(x), y: m(0) }
}

fn absent(reason: Invalid) -> Reading {
    Axes {
        x: Err(reason),
        y: Err(reason),
    }
}

fn seconds(s: f64) -> Instant {
    Instant((s * 1e6) as u64)
}

/// `n` warnings, 20 ms apart from `start` on; the last judgement.
fn warn(state: &mut PaperState, n: usize, start: f64) -> Judgement {
    let mut last = Judgement::Agree;
    for i in 0..n {
        let now = seconds(start + 0.02 * i as f64);
        let pair = (reading(THRESHOLD + 1), reading(0));
        last = PaperCheck::PAPER
            .step(state, pair.0, pair.1, now)
            .judgement();
    }
    last
}

#[test]
fn r12_0_40_itself_is_not_an_excess() {
    let mut state = PaperState::default();
    let mut judge = |x| PaperCheck::PAPER.step(&mut state, reading(x), reading(0), Instant(1));
    assert_eq!(judge(THRESHOLD).judgement(), Judgement::Agree);
    assert_eq!(judge(THRESHOLD + 1).judgement(), Judgement::Warning);
    assert_eq!(
        judge(0u32.wrapping_sub(THRESHOLD)).judgement(),
        Judgement::Agree
    );
    assert_eq!(
        judge(0u32.wrapping_sub(THRESHOLD + 1)).judgement(),
        Judgement::Warning
    );
}

#[test]
fn r13_110_does_not_stop_111_does() {
    let mut state = PaperState::default();
    assert_eq!(warn(&mut state, 110, 0.0), Judgement::Warning);
    assert_eq!(warn(&mut state, 1, 599.0), Judgement::StopMotion);
}

#[test]
fn r13_a_warning_leaves_after_exactly_600_s() {
    // The first of 110 at t = 0; the 111th at 600 s exactly does not count it any more.
    let mut state = PaperState::default();
    warn(&mut state, 110, 0.0);
    assert_eq!(warn(&mut state, 1, 600.0), Judgement::Warning);
    let mut state = PaperState::default();
    warn(&mut state, 110, 0.0);
    assert_eq!(warn(&mut state, 1, 599.999_999), Judgement::StopMotion);
}

#[test]
fn r13_the_window_slides_with_the_warnings() {
    // Pauses of hours, of exactly 6 s, then shorter: 110 of them have to be under 600 s.
    let pauses = [7_200_000_000, 5_000_000_000].into_iter();
    let pauses = pauses.chain([6_000_000; 300]).chain([5_454_545; 300]);
    let (mut state, mut now) = (PaperState::default(), 0);
    let mut times = std::vec::Vec::new();
    for pause in pauses {
        now += pause;
        times.push(now);
        let pair = (reading(THRESHOLD + 1), reading(0));
        let found = PaperCheck::PAPER.step(&mut state, pair.0, pair.1, Instant(now));
        let within = times.iter().filter(|t| now - *t < 600_000_000).count();
        if within > MOST_WARNINGS {
            assert_eq!(found.judgement(), Judgement::StopMotion);
            assert!(times.len() > 400, "{}", times.len());
            return;
        }
        assert_eq!(found.judgement(), Judgement::Warning, "{now}");
    }
    panic!("never stopped");
}

#[test]
fn r13_stop_lasts_45_s_then_data_delay_resumes() {
    let mut state = PaperState::default();
    assert_eq!(warn(&mut state, 111, 0.0), Judgement::StopMotion);
    let stopped = 110.0 * 0.02;
    let mut judge = |x, t| PaperCheck::PAPER.step(&mut state, reading(x), reading(0), seconds(t));
    assert_eq!(
        judge(0, stopped + 44.999).judgement(),
        Judgement::StopMotion
    );
    assert_eq!(
        judge(THRESHOLD - 1, stopped + 45.0).judgement(),
        Judgement::DataDelay
    );
    assert_eq!(judge(0, stopped + 45.02).judgement(), Judgement::Agree);
    assert_eq!(
        warn(&mut state, 110, 60.0),
        Judgement::Warning,
        "the window starts anew"
    );
}

#[test]
fn r13_still_0_40_after_the_stop_is_a_physical_fault_until_reset() {
    let mut state = PaperState::default();
    warn(&mut state, 111, 0.0);
    let mut judge = |x, t| PaperCheck::PAPER.step(&mut state, reading(x), reading(0), seconds(t));
    assert_eq!(judge(THRESHOLD, 50.0).judgement(), Judgement::PhysicalFault);
    assert_eq!(judge(0, 60.0).judgement(), Judgement::PhysicalFault);
    state = PaperState::default();
    let after = PaperCheck::PAPER.step(&mut state, reading(0), reading(0), seconds(61.0));
    assert_eq!(after.judgement(), Judgement::Agree);
}

#[test]
fn paper_counts_a_silent_channel_as_an_excess() {
    let mut state = PaperState::default();
    let verdict =
        PaperCheck::PAPER.step(&mut state, reading(0), absent(Invalid::Stale), Instant(5));
    assert_eq!(verdict.judgement(), Judgement::Warning);
    assert_eq!(verdict.delta().x, None);
}

#[test]
fn paper_compares_only_the_axes_it_watches() {
    let only_y = PaperCheck {
        watch: Axes { x: false, y: true },
        ..PaperCheck::PAPER
    };
    let mut state = PaperState::default();
    let pair = (reading(2 * THRESHOLD), reading(0));
    assert_eq!(
        only_y
            .step(&mut state, pair.0, pair.1, Instant(1))
            .judgement(),
        Judgement::Agree
    );
}

#[test]
fn product_excess_must_last() {
    let mut state = WindowState::default();
    let mut judge = |x, ms: u64| {
        let now = Instant(1_000_000 + ms * 1000);
        WindowCheck::PRODUCT
            .step(&mut state, reading(x), reading(0), now)
            .judgement()
    };
    assert_eq!(judge(2 * THRESHOLD, 0), Judgement::Agree);
    assert_eq!(judge(2 * THRESHOLD, 180), Judgement::Agree);
    assert_eq!(judge(0, 190), Judgement::Agree);
    assert_eq!(judge(2 * THRESHOLD, 200), Judgement::Agree);
    assert_eq!(judge(2 * THRESHOLD, 400), Judgement::Agree);
    assert_eq!(judge(2 * THRESHOLD, 401), Judgement::Disagree);
    assert_eq!(judge(0, 500), Judgement::Disagree, "latched until a reset");
}

#[test]
fn an_unlatched_disagreement_ends_with_its_cause() {
    let check = WindowCheck {
        latched: false,
        ..WindowCheck::PRODUCT
    };
    let mut state = WindowState::default();
    let mut judge = |x, ms: u64| {
        let now = Instant(1_000_000 + ms * 1000);
        check
            .step(&mut state, reading(x), reading(0), now)
            .judgement()
    };
    assert_eq!(judge(2 * THRESHOLD, 0), Judgement::Agree);
    assert_eq!(judge(2 * THRESHOLD, 201), Judgement::Disagree);
    assert_eq!(judge(0, 220), Judgement::Agree);
    assert_eq!(
        judge(2 * THRESHOLD, 240),
        Judgement::Agree,
        "it has to last anew"
    );
    assert_eq!(judge(2 * THRESHOLD, 441), Judgement::Disagree);
}

#[test]
fn product_threshold_follows_the_uncertainty() {
    let mut wide = reading(2 * THRESHOLD);
    wide.x = wide.x.map(|m| Measurement {
        unshared: Uncertainty::from_degrees(1.0),
        ..m
    });
    assert!(!WindowCheck::PRODUCT.exceeds(wide.x, reading(0).x));
    assert!(WindowCheck::PRODUCT.exceeds(reading(2 * THRESHOLD).x, reading(0).x));
}

#[test]
fn product_names_the_channel_that_knows_itself_ill() {
    let mut state = WindowState::default();
    let mut judge = |own, peer| {
        WindowCheck::PRODUCT
            .step(&mut state, own, peer, Instant(9))
            .judgement()
    };
    let reset = Invalid::PartReset;
    assert_eq!(
        judge(reading(0), absent(reset)),
        Judgement::OneChannel {
            ill: Node::Peer,
            reason: reset
        }
    );
    assert_eq!(
        judge(absent(Invalid::Stale), absent(Invalid::Settling)),
        Judgement::OneChannel {
            ill: Node::Own,
            reason: Invalid::Stale
        }
    );
    assert_eq!(
        judge(absent(reset), absent(reset)),
        Judgement::NoChannel(reset)
    );
    let over = Invalid::OverRange;
    assert_eq!(judge(reading(0), absent(over)), Judgement::Waiting(over));
}

#[test]
fn a_channel_that_never_delivers_is_a_fault_after_two_seconds() {
    for why in [Invalid::NoSample, Invalid::Settling, Invalid::OverRange] {
        let mut state = WindowState::default();
        let mut judge = |ms: u64| {
            let now = Instant(ms * 1000);
            WindowCheck::PRODUCT
                .step(&mut state, reading(0), absent(why), now)
                .judgement()
        };
        assert_eq!(judge(0), Judgement::Waiting(why));
        assert_eq!(judge(2000), Judgement::Waiting(why));
        let fault = Judgement::OneChannel {
            ill: Node::Peer,
            reason: why,
        };
        assert_eq!(judge(2001), fault);
    }
    let mut state = PaperState::default();
    let dead = absent(Invalid::NoSample);
    let mut judge = |t| PaperCheck::PAPER.step(&mut state, reading(0), dead, seconds(t));
    assert_eq!(
        judge(0.0).judgement(),
        Judgement::Waiting(Invalid::NoSample)
    );
    assert_eq!(judge(2.1).judgement(), Judgement::Warning);
}

#[test]
fn clipping_again_and_again_is_a_fault_too() {
    let mut state = WindowState::default();
    let mut fault_at = None;
    for ms in (0..10_000).step_by(20) {
        let clipped = ms % 200 < 160;
        let peer = if clipped {
            absent(Invalid::OverRange)
        } else {
            reading(0)
        };
        let verdict = WindowCheck::PRODUCT.step(&mut state, reading(0), peer, Instant(ms * 1000));
        if verdict.judgement().is_fault() {
            fault_at.get_or_insert(ms);
        }
    }
    assert_eq!(fault_at, Some(2020));
}

#[test]
fn an_excess_goes_on_over_a_shock() {
    let mut state = WindowState::default();
    let mut judge = |peer, ms: u64| {
        let now = Instant(ms * 1000);
        WindowCheck::PRODUCT
            .step(&mut state, reading(2 * THRESHOLD), peer, now)
            .judgement()
    };
    assert_eq!(judge(reading(0), 0), Judgement::Agree);
    judge(absent(Invalid::OverRange), 100);
    assert_eq!(judge(reading(0), 220), Judgement::Disagree);
}

#[test]
fn one_axis_instruments_compare_their_one_axis() {
    let one = |x| Axes {
        y: Err(Invalid::NotMeasured),
        ..reading(x)
    };
    let mut state = PaperState::default();
    let mut judge = |a, b| {
        PaperCheck::PAPER
            .step(&mut state, a, b, Instant(3))
            .judgement()
    };
    assert_eq!(judge(one(0), one(0)), Judgement::Agree);
    assert_eq!(judge(one(2 * THRESHOLD), one(0)), Judgement::Warning);
    let mut state = WindowState::default();
    let verdict = WindowCheck::PRODUCT.step(&mut state, one(0), one(0), Instant(3));
    assert_eq!(verdict.judgement(), Judgement::Agree);
}
