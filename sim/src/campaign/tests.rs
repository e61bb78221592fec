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
    let pool = pool().unwrap();
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
