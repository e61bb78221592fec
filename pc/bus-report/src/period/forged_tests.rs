//! Summaries whose numbers were forged: refused in a sentence, or merged and drawn, never a panic.

use std::sync::LazyLock;

use proptest::prelude::*;

use super::bench::{START_NS, Site};
use super::kept::{Kept, KeptError};
use super::page;
use crate::totals::Collector;
use listen::Plan;

/// What a number is replaced by.
const EXTREMES: [&str; 14] = [
    "0",
    "1",
    "-1",
    "26",
    "127",
    "255",
    "2147483647",
    "-2147483648",
    "4294967295",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551615",
    "170141183460469231731687303715884105727",
    "-170141183460469231731687303715884105728",
];

/// A summary of some seconds with a fault.
fn genuine() -> &'static str {
    static TEXT: LazyLock<String> = LazyLock::new(|| {
        let mut site = Site::working();
        site.tilt(20.0, -10.0);
        site.run_ms(1000);
        site.loosen(1, 0.05);
        site.run_ms(1500);
        let mut collector = Collector::new(&Plan::default());
        for (at_ns, frame) in &site.frames {
            collector.take(START_NS + at_ns, frame);
        }
        let kept = Kept::of_bus("can0", collector.finish());
        String::from_utf8(kept.to_bytes().unwrap()).unwrap()
    });
    &TEXT
}

/// Where the whole numbers of a JSON text stand, but for the version.
fn numbers(text: &str) -> Vec<(usize, usize)> {
    let (mut found, mut in_text, mut begin) = (Vec::new(), false, None);
    for (at, byte) in text.bytes().enumerate() {
        let is_number = !in_text && (byte.is_ascii_digit() || byte == b'-');
        match (begin, is_number) {
            (None, true) => begin = Some(at),
            (Some(from), false) => {
                found.push((from, at));
                begin = None;
            }
            _ => {}
        }
        in_text ^= byte == b'"';
    }
    found.split_off(1)
}

/// The genuine summary with some numbers replaced.
fn forged(changes: &[(prop::sample::Index, usize)]) -> Vec<u8> {
    let text = genuine();
    let all = numbers(text);
    let mut wanted: Vec<_> = changes
        .iter()
        .map(|(place, extreme)| (*place.get(&all), EXTREMES[*extreme]))
        .collect();
    wanted.sort_unstable();
    wanted.dedup_by_key(|one| one.0);
    let (mut forged, mut done) = (String::new(), 0);
    for ((from, to), extreme) in wanted {
        forged += &text[done..from];
        forged += extreme;
        done = to;
    }
    (forged + &text[done..]).into_bytes()
}

/// The bytes of a merge.
fn merged(all: &[&Kept]) -> Vec<u8> {
    let merged = Kept::merged(all.iter().copied().cloned());
    merged.unwrap().to_bytes().unwrap()
}

fn again(bytes: &[u8]) -> Kept {
    Kept::from_bytes(bytes).unwrap()
}

/// Merges in every order and both groupings, which has to give the same bytes, and draws.
fn use_up(parts: [&Kept; 3]) {
    let [a, b, c] = parts;
    let whole = merged(&[a, b, c]);
    for order in [[a, c, b], [b, a, c], [b, c, a], [c, a, b], [c, b, a]] {
        assert_eq!(merged(&order), whole);
    }
    assert_eq!(merged(&[a, &again(&merged(&[b, c]))]), whole);
    assert_eq!(merged(&[&again(&merged(&[a, b])), c]), whole);
    for kept in [a, &again(&whole)] {
        let report = kept.clone().concluded(Some(250e3));
        assert!(page::page(&report).contains("</html>"));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn merging_a_forged_summary_was_a_panic(
        changes in prop::collection::vec(
            prop::collection::vec((any::<prop::sample::Index>(), 0..EXTREMES.len()), 0..3),
            2,
        ),
    ) {
        let read: Result<Vec<_>, KeptError> =
            changes.iter().map(|changes| Kept::from_bytes(&forged(changes))).collect();
        match read {
            Ok(parts) => use_up([&parts[0], &parts[1], &again(genuine().as_bytes())]),
            Err(why) => prop_assert_eq!(why.to_string().lines().count(), 1),
        }
    }
}
