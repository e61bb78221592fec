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

/// The instant of the last of 111 warnings from 0 on.
const STOPPED_S: f64 = 110.0 * 0.02;

/// 50 pairs a second behind the stop of 111 warnings, `pair` gives which; the first judgement that
/// does not ask for the stop, and how long after it, s. `None` within five minutes.
fn after_stop(pair: impl Fn(f64) -> (u32, u32)) -> Option<(Judgement, f64)> {
    let mut state = PaperState::default();
    assert_eq!(warn(&mut state, 111, 0.0), Judgement::StopMotion);
    (1..=15_000).map(|i| 0.02 * f64::from(i)).find_map(|t| {
        let (own, peer) = pair(t);
        let now = seconds(STOPPED_S + t + 1e-7);
        let verdict = PaperCheck::PAPER.step(&mut state, reading(own), reading(peer), now);
        (verdict.judgement() != Judgement::StopMotion).then_some((verdict.judgement(), t))
    })
}

#[test]
fn r13_stop_lasts_45_s_then_data_delay_resumes() {
    assert_eq!(after_stop(|_| (0, 0)), Some((Judgement::DataDelay, 45.0)));
    assert_eq!(
        after_stop(|_| (THRESHOLD - 1, 0)),
        Some((Judgement::DataDelay, 45.0))
    );
    let mut state = PaperState::default();
    warn(&mut state, 111, 0.0);
    for t in 0..2300 {
        let now = seconds(3.0 + 0.02 * f64::from(t));
        PaperCheck::PAPER.step(&mut state, reading(0), reading(0), now);
    }
    assert!(state.has_agreed() && !state.is_faulted());
    assert_eq!(
        warn(&mut state, 110, 60.0),
        Judgement::Warning,
        "the window starts anew"
    );
}

#[test]
fn r13_still_0_40_after_the_stop_is_a_physical_fault_until_reset() {
    assert_eq!(
        after_stop(|_| (THRESHOLD, 0)),
        Some((Judgement::PhysicalFault, 45.0))
    );
    let mut state = PaperState::default();
    warn(&mut state, 111, 0.0);
    let mut judge = |x, t| PaperCheck::PAPER.step(&mut state, reading(x), reading(0), seconds(t));
    let last = (0..2400).map(|i| judge(THRESHOLD, 3.0 + 0.02 * f64::from(i)).judgement());
    assert_eq!(last.last(), Some(Judgement::PhysicalFault));
    assert_eq!(judge(0, 60.0).judgement(), Judgement::PhysicalFault);
    state = PaperState::default();
    let after = PaperCheck::PAPER.step(&mut state, reading(0), reading(0), seconds(61.0));
    assert_eq!(after.judgement(), Judgement::Agree);
}

/// A channel that failed now and then passed for a late one when the pair at the end of the 45 s
/// agreed by chance. Five differences behind the first 15 s are as rare as those that ask for no
/// stop, six are not; where they stand does not count.
#[test]
fn one_pair_after_45_s_decided_on_data_delay() {
    for (first, pairs) in (1..=2240)
        .step_by(31)
        .chain(735..755)
        .flat_map(|k| [(k, 5), (k, 6)])
    {
        let differs = |t: f64| ((t / 0.02).round() as i32 - first) as u32;
        let found = after_stop(|t| {
            if differs(t) < pairs {
                (THRESHOLD, 0)
            } else {
                (0, 0)
            }
        });
        // 750 pairs are 15 s.
        let expected = match (first + pairs as i32 - 1 - 750).max(0).min(pairs as i32) {
            6 => Judgement::PhysicalFault,
            _ => Judgement::DataDelay,
        };
        assert_eq!(found, Some((expected, 45.0)), "{pairs} pairs from {first}");
    }
}

/// Whatever the machine did, 45 s after the request it was taken to stand.
#[test]
fn a_machine_that_moved_on_was_taken_to_stand() {
    // It turns a degree a second for 20 s more, then it stands; the peer is late by half a second.
    let degree = |t: f64| (t.min(20.0) * f64::from(THRESHOLD) / 0.4) as u32;
    let late = |t: f64| (degree(t), degree((t - 0.5).max(0.0)));
    let (judgement, after_s) = after_stop(late).unwrap();
    assert_eq!(judgement, Judgement::DataDelay);
    assert!((62.9..65.6).contains(&after_s), "{after_s}");
    // While it moves for ever, the stop is asked for.
    assert_eq!(after_stop(|t| (degree(t % 20.0), degree(t % 20.0))), None);
    // A channel that moves alone does not: its part is at fault.
    for alone in [|t| (t, 0), |t| (0, t)] {
        let (judgement, after_s) = after_stop(|t| alone(degree(t % 20.0))).unwrap();
        assert_eq!(judgement, Judgement::PhysicalFault);
        assert!((45.0..46.0).contains(&after_s), "{after_s}");
    }
}

/// Table I, first row, where a channel tells by itself that its data are late: there is no angle to
/// compare then, and a missing one counted as a difference.
#[test]
fn data_told_to_be_late_were_a_physical_fault() {
    let ended = |why| {
        let mut state = PaperState::default();
        warn(&mut state, 111, 0.0);
        let mut judge = |t| {
            PaperCheck::PAPER
                .step(&mut state, reading(0), absent(why), seconds(t))
                .judgement()
        };
        (0..2400)
            .map(|i| judge(3.0 + 0.02 * f64::from(i)))
            .find(|found| *found != Judgement::StopMotion)
    };
    assert_eq!(ended(Invalid::Late), Some(Judgement::DataDelay));
    assert_eq!(ended(Invalid::Stale), Some(Judgement::PhysicalFault));
}

/// Late data at a standstill are no difference: they were 111 warnings, a stop and "data delay"
/// every 47 s for as long as they were late.
#[test]
fn a_late_channel_stopped_a_standing_machine_again_and_again() {
    let own = |angle| (reading(angle), absent(Invalid::Late));
    let peer = |angle| (absent(Invalid::Late), reading(angle));
    for late in [own, peer] {
        let mut state = PaperState::default();
        let mut at = |angle: u32, t: f64| {
            let (own, peer) = late(angle);
            let verdict = PaperCheck::PAPER.step(&mut state, own, peer, seconds(t));
            verdict.judgement()
        };
        // The first 15 s of a standstill may be those of an arm that rings out.
        assert_eq!(at(0, 0.0), Judgement::Warning);
        assert_eq!(at(0, 15.0), Judgement::Warning);
        for i in 1..5000 {
            let waiting = Judgement::Waiting(Invalid::Late);
            assert_eq!(at(0, 15.0 + 0.02 * f64::from(i)), waiting);
        }
        // Motion: what is late is a difference again, until it stands.
        let moving = |i: u32| (6 * i * THRESHOLD, 200.0 + 0.02 * f64::from(i));
        let found: std::vec::Vec<_> = (1..=111).map(moving).map(|(x, t)| at(x, t)).collect();
        assert_eq!(found[..108], [Judgement::Warning; 108]);
        assert_eq!(found[108..], [Judgement::StopMotion; 3]);
        // It moves on for another minute: the 45 s are of standstill.
        for i in 0..3000_u32 {
            let (x, t) = ((6 * i).wrapping_mul(THRESHOLD), 203.0 + 0.02 * f64::from(i));
            assert_eq!(at(x, t), Judgement::StopMotion);
        }
        let stands = |i: u32| 17_994_u32.wrapping_mul(THRESHOLD) + (i & 1);
        let mut told = (0..).map(|i| (at(stands(i), 263.0 + 0.02 * f64::from(i)), i));
        let told = told.find(|(found, _)| *found != Judgement::StopMotion);
        assert_eq!(told, Some((Judgement::DataDelay, 45 * 50 - 1)));
        // Work goes on, and the late data are of the place where it stands.
        for i in 0..5000 {
            let waiting = Judgement::Waiting(Invalid::Late);
            assert_eq!(at(stands(i), 309.0 + 0.02 * f64::from(i)), waiting);
        }
    }
}

#[test]
fn work_goes_on_after_more_pairs_than_stopped_it() {
    // A SYNC a second: 31 pairs count within the 45 s, and 111 have to.
    let mut state = PaperState::default();
    warn(&mut state, 111, 0.0);
    let mut judge = |t: u32| {
        let now = seconds(STOPPED_S + f64::from(t));
        let verdict = PaperCheck::PAPER.step(&mut state, reading(0), reading(0), now);
        verdict.judgement()
    };
    let ended = (1..200).find(|t| judge(*t) == Judgement::DataDelay);
    assert_eq!(ended, Some(15 + 111));
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
    assert!(!WindowCheck::PRODUCT.exceeds(&wide.x, &reading(0).x));
    assert!(WindowCheck::PRODUCT.exceeds(&reading(2 * THRESHOLD).x, &reading(0).x));
}

#[test]
fn product_names_the_channel_that_reports_its_own_fault() {
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
            faulty: Member::Peer,
            reason: reset
        }
    );
    assert_eq!(
        judge(absent(Invalid::Stale), absent(Invalid::Settling)),
        Judgement::OneChannel {
            faulty: Member::Own,
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
            faulty: Member::Peer,
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
