//! Trials of drawn seeds.

use super::*;

#[test]
fn the_same_seed_gives_the_same_bus() {
    let outcome = || {
        let setup = draw(3);
        let pool = pool_for(&setup).unwrap();
        run(setup, &pool, |_| {}).unwrap()
    };
    let (a, b) = (outcome(), outcome());
    assert_eq!(a.report.fingerprint, b.report.fingerprint);
    assert_eq!(a.to_string(), b.to_string());
}

#[test]
fn a_blind_check_is_found_out() {
    let pool = pool(Mode::Product).unwrap();
    let (_, caught) = canary(&pool).unwrap();
    let mut setup = caught.expect("a broken device is found out").setup;
    assert_eq!(setup.sabotage, Sabotage::Blind);
    // It was the sabotage that was found out, not the trial.
    setup.sabotage = Sabotage::None;
    let sound = run(setup, &pool, |_| {}).unwrap();
    let wrong = |rule| matches!(rule, Rule::WrongAngle | Rule::OldAngle | Rule::StaleAngle);
    assert!(
        !sound.report.violations.iter().any(|v| wrong(v.rule)),
        "{sound}"
    );
}

#[test]
fn a_fault_that_was_not_detected_had_a_delay_that_is_no_number() {
    let setup = (1..500).map(draw).find(|setup| {
        setup.within_promise && setup.mode == Mode::Product && !setup.faults.is_empty()
    });
    let setup = setup.expect("a seed with a fault");
    let pool = pool_for(&setup).unwrap();
    let mut outcome = run(setup, &pool, |_| {}).unwrap();
    for detection in &mut outcome.report.detections {
        detection.by = Default::default();
    }
    let mut summary = Summary::default();
    summary.add(&outcome);
    let text = summary.to_string();
    assert!(!text.contains("NaN") && text.contains(" - "), "{text}");
    assert!(text.contains("1 of them of the product within"), "{text}");
}

#[test]
fn paper_mode_was_printed_as_if_the_promise_held_for_it() {
    let excepted = |mode| {
        let setup = Setup {
            mode,
            ..Setup::healthy(1)
        };
        let pool = pool_for(&setup).unwrap();
        let outcome = run(setup, &pool, |_| {}).unwrap();
        outcome.to_string().contains("the promise is not for it")
    };
    assert!(excepted(Mode::Paper) && !excepted(Mode::Product));
}
