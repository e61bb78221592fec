//! What a producer sends, and when it is silent.

use super::*;

#[test]
fn a_pair_goes_out_plain_first_every_safeguard_cycle() {
    let mut bench = Bench::producing();
    assert_eq!(bench.poll(ms(0)), Some(ms(25)));
    assert_eq!(bench.sent(ms(0)), Some((0x101, 0x1234)));
    // Both halves are of one sample.
    bench.slope(0x7777);
    bench.poll(ms(1));
    assert_eq!(bench.sent(ms(1)), Some((0x102, !0x1234)));
    assert_eq!(
        (bench.poll(ms(24)), bench.sent(ms(24))),
        (Some(ms(25)), None)
    );
    assert_eq!(bench.poll(Instant(25_400)), Some(ms(50)));
    assert_eq!(bench.sent(ms(26)), Some((0x101, 0x7777)));
    assert_eq!(bench.sent(ms(26)), Some((0x102, !0x7777)));
    assert_eq!(bench.safety.state(0), SrdoState::Running);
}

#[test]
fn a_producer_runs_only_with_a_valid_configuration() {
    let mut bench = Bench::producing();
    bench.safety.stop();
    bench.write(0x13FE, 0, 0).unwrap();
    bench.safety.start(ms(0));
    assert_eq!((bench.poll(ms(0)), bench.sent(ms(0))), (None, None));
    assert_eq!(bench.safety.state(0), SrdoState::Off);
}

#[test]
fn nothing_goes_out_outside_operational() {
    let mut bench = Bench::producing();
    bench.poll(ms(0));
    bench.safety.stop();
    assert_eq!((bench.poll(ms(25)), bench.sent(ms(25))), (None, None));
    assert_eq!(bench.safety.state(0), SrdoState::Off);
}

#[test]
fn halves_that_are_not_each_others_inverse_are_not_sent() {
    let mut bench = Bench::producing();
    bench.shelf.put(0x6211, 0, 0x1234);
    bench.poll(ms(0));
    assert_eq!(bench.sent(ms(0)), None);
    assert_eq!(bench.safety.state(0), SrdoState::Inconsistent);
    bench.slope(1);
    bench.poll(ms(25));
    assert_eq!(bench.sent(ms(25)), Some((0x101, 1)));
    assert_eq!(bench.safety.state(0), SrdoState::Running);
}

#[test]
fn without_consent_nothing_is_sent() {
    let mut bench = Bench::producing();
    bench.poll(ms(0));
    bench.withdraw();
    assert_eq!(bench.sent(ms(0)), None);
    assert_eq!((bench.poll(ms(30)), bench.sent(ms(30))), (None, None));
    assert_eq!(bench.safety.state(0), SrdoState::Withheld);
    bench.checks = true;
    assert_eq!(bench.poll(ms(40)), Some(ms(50)));
    assert_eq!(bench.sent(ms(40)), Some((0x101, 0x1234)));
}

#[test]
fn consent_has_to_be_given() {
    assert_eq!(Safety::new().checked, None);
}

#[test]
fn what_was_checked_went_out_for_seconds_after_the_last_check() {
    let mut bench = Bench::producing();
    bench.poll(ms(0));
    assert_eq!(bench.sent(ms(0)), Some((0x101, 0x1234)));
    assert_eq!(bench.sent(ms(0)), Some((0x102, !0x1234)));
    // The application is still content, but has looked at nothing since.
    bench.checks = false;
    bench.poll(ms(25));
    assert_eq!(bench.sent(ms(25)), Some((0x101, 0x1234)));
    assert_eq!(bench.sent(ms(26)), None);
    for after in (50..2000).step_by(25) {
        bench.poll(ms(after));
        assert_eq!(bench.sent(ms(after)), None, "{after}");
    }
    bench.checks = true;
    bench.poll(ms(2000));
    assert_eq!(bench.sent(ms(2000)), Some((0x101, 0x1234)));
}

#[test]
fn the_other_half_of_a_pair_went_out_after_consent_had_ended() {
    let mut bench = Bench::producing();
    bench.poll(ms(0));
    assert_eq!(bench.sent(ms(0)), Some((0x101, 0x1234)));
    bench.withdraw();
    assert_eq!(bench.sent(ms(1)), None);
    bench.poll(ms(25));
    assert_eq!(bench.sent(ms(25)), None);
    bench.checks = true;
    bench.poll(ms(25));
    assert_eq!(bench.sent(ms(25)), Some((0x101, 0x1234)));
}

#[test]
fn a_pair_that_the_bus_did_not_take_went_out_seconds_later() {
    for (waits, frames) in [(9, 2), (10, 0), (24, 0)] {
        let mut bench = Bench::producing();
        bench.poll(ms(0));
        assert_eq!(bench.safety.expires(0x102), Some(ms(10)));
        let sent = (0..2).filter_map(|_| bench.sent(ms(waits)));
        assert_eq!(sent.count(), frames, "{waits}");
    }
    let mut bench = Bench::producing();
    bench.poll(ms(0));
    assert_eq!(bench.sent(ms(9)), Some((0x101, 0x1234)));
    assert_eq!(bench.sent(ms(10)), None);
    assert_eq!(bench.safety.expires(0x103), None);
}

#[test]
fn a_pair_that_has_begun_is_not_mixed_with_the_next_sample() {
    let mut bench = Bench::producing();
    bench.poll(ms(0));
    bench.sent(ms(0));
    bench.slope(9);
    bench.poll(ms(25));
    assert_eq!(bench.sent(ms(25)), Some((0x101, 9)));
    assert_eq!(bench.sent(ms(25)), Some((0x102, !9)));
    assert_eq!(bench.sent(ms(25)), None);
}

#[test]
fn a_pair_that_has_not_begun_gives_way_to_the_newest() {
    let mut bench = Bench::producing();
    bench.poll(ms(0));
    bench.slope(9);
    bench.poll(ms(25));
    assert_eq!(bench.sent(ms(25)), Some((0x101, 9)));
    assert_eq!(bench.sent(ms(25)), Some((0x102, !9)));
}
