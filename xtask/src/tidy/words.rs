//! Words that must not stand in the code of a crate.
//!
//! In: the Rust sources. Out: a finding for each forbidden word outside comments and literals.
//! `tilt`, `canopen`, `flash` and `device` run on the part, so their code may neither name `std`
//! nor hold a path that panics; those and `sim` may not read the clock of the machine, start a
//! thread or keep anything in a static.
//! Tests are free of these, but not of the words that no finished code holds.

use std::path::Path;

use super::Finding;
use super::imports::UNSAFE;
use super::source::{Source, words};
use super::tree::Tree;

/// Words that are wrong in some folders.
struct Rule {
    words: &'static [&'static str],
    applies: fn(&str) -> bool,
    /// Whether tests, benches and examples are held to it.
    in_tests: bool,
    /// Whether it holds in what the compiler evaluates.
    in_constants: bool,
    why: &'static str,
}

const RULES: [Rule; 6] = [
    Rule {
        words: &["unsafe"],
        applies: |path| {
            !UNSAFE
                .into_iter()
                .any(|folder| Path::new(path).starts_with(folder))
        },
        in_tests: true,
        in_constants: true,
        why: "only crates with lints of their own for it touch what the compiler can't check",
    },
    Rule {
        words: &["todo!", "unimplemented!", "dbg!"],
        applies: |_| true,
        in_tests: true,
        in_constants: true,
        why: "not in finished code",
    },
    Rule {
        words: &["std::", "extern crate std"],
        applies: on_the_part,
        in_tests: false,
        in_constants: true,
        why: "tilt, canopen, flash and device run without std",
    },
    Rule {
        words: &[
            ".unwrap()",
            ".expect(",
            "panic!",
            "unreachable!",
            "assert!",
            "assert_eq!",
            "assert_ne!",
        ],
        applies: on_the_part,
        in_tests: false,
        in_constants: false,
        why: "tilt, canopen, flash and device have no path that panics",
    },
    Rule {
        words: &["SystemTime", "Instant::now", "thread::"],
        applies: reproducible,
        in_tests: false,
        in_constants: true,
        why: "time is an argument, and a world runs in one thread",
    },
    Rule {
        words: &["static", "thread_local!"],
        applies: reproducible,
        in_tests: false,
        in_constants: true,
        why: "state is handed in; a constant is `const`",
    },
];

/// Where the same input has to give the same output, run after run.
fn reproducible(path: &str) -> bool {
    // The binary of `sim` spreads worlds over threads and prints how long they took.
    let world = path.starts_with("sim/src/") && !path.starts_with("sim/src/bin/");
    on_the_part(path) || world
}

fn on_the_part(path: &str) -> bool {
    let folders = [
        "instant/src/",
        "tilt/src/",
        "canopen/src/",
        "flash/src/",
        "device/src/",
    ];
    folders.iter().any(|folder| path.starts_with(folder))
}

/// Applies every rule to every source it is meant for.
pub fn check(tree: &Tree) -> Vec<Finding> {
    let mut findings = Vec::new();
    for source in &tree.sources {
        let test_file = tree.is_test_file(&source.path);
        for rule in RULES.iter().filter(|rule| (rule.applies)(&source.path)) {
            if rule.in_tests || !test_file {
                findings.extend(found(rule, source));
            }
        }
    }
    findings
}

fn found(rule: &Rule, source: &Source) -> Vec<Finding> {
    let constants = source.constants();
    let excused = |at: usize| {
        (!rule.in_tests && source.is_test(at))
            || (!rule.in_constants && constants.iter().any(|range| range.contains(&at)))
    };
    let mut findings = Vec::new();
    for word in rule.words {
        for at in words(&source.code, word).filter(|&at| !excused(at)) {
            let text = format!("`{word}`: {}", rule.why);
            findings.push(Finding::new(&source.path, source.line(at), text));
        }
    }
    findings
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(path: &str, text: &str) -> usize {
        check(&Tree::of(&[(path, text)])).len()
    }

    #[test]
    fn unsafe_code_stays_in_the_firmware() {
        assert_eq!(count("cli/src/x.rs", "fn a() { unsafe { b() } }"), 1);
        assert_eq!(count("emulator/src/x.rs", "fn a() { unsafe { b() } }"), 1);
        assert_eq!(count("firmware/src/x.rs", "fn a() { unsafe { b() } }"), 0);
        assert_eq!(
            count("emulator/golden/src/x.rs", "fn a() { unsafe { b() } }"),
            0
        );
        assert_eq!(
            count("cli/src/x.rs", "#![forbid(unsafe_code)] // unsafe"),
            0
        );
    }

    #[test]
    fn unfinished_code_is_found_in_tests_too() {
        assert_eq!(
            count(
                "cli/src/x.rs",
                "#[cfg(test)]\nmod tests { fn a() { todo!() } }"
            ),
            1
        );
        assert_eq!(
            count("sim/tests/x.rs", "fn a() { dbg!(1); unimplemented!() }"),
            2
        );
        assert_eq!(count("sim/src/x.rs", "const A: &str = \"todo!\";"), 0);
    }

    #[test]
    fn std_stays_out_of_what_runs_on_the_part() {
        assert_eq!(count("tilt/src/x.rs", "use std::vec::Vec;"), 1);
        assert_eq!(
            count("device/src/x.rs", "#[cfg(test)]\nextern crate std;"),
            0
        );
        assert_eq!(count("device/src/lib.rs", "extern crate std;"), 1);
        assert_eq!(count("tilt/src/x.rs", "/// std::vec\nfn a() {}"), 0);
        assert_eq!(count("sim/src/x.rs", "use std::vec::Vec;"), 0);
    }

    #[test]
    fn the_part_has_no_panicking_path() {
        for bad in [
            "a.unwrap()",
            "a.expect(\"b\")",
            "panic!()",
            "unreachable!()",
            "assert!(a)",
        ] {
            let text = format!("fn f() {{ {bad}; }}");
            assert_eq!(count("device/src/x.rs", &text), 1, "{bad}");
            assert_eq!(count("cli/src/x.rs", &text), 0, "{bad}");
            let test = format!("#[cfg(test)]\nmod tests {{ {text} }}");
            assert_eq!(count("device/src/x.rs", &test), 0, "{bad}");
        }
        assert_eq!(count("tilt/src/x.rs", "const _: () = assert!(A < B);"), 0);
        assert_eq!(count("tilt/src/x.rs", "fn f() { a.unwrap_or(1) }"), 0);
    }

    #[test]
    fn the_world_reads_no_clock_and_starts_no_thread() {
        let text = "fn f() { Instant::now(); std::thread::spawn(g); SystemTime::now(); }";
        assert_eq!(count("sim/src/x.rs", text), 3);
        assert_eq!(count("cli/src/x.rs", text), 0);
        assert_eq!(count("sim/examples/x.rs", text), 0);
    }

    #[test]
    fn nothing_is_kept_in_a_static() {
        assert_eq!(count("sim/src/x.rs", "static mut COUNT: u32 = 0;"), 1);
        assert_eq!(
            count("tilt/src/x.rs", "const NAME: &'static str = \"static\";"),
            0
        );
        assert_eq!(count("xtask/src/x.rs", "static COUNT: u32 = 0;"), 0);
    }

    #[test]
    fn a_finding_names_word_and_line() {
        let found = check(&Tree::of(&[(
            "tilt/src/x.rs",
            "//! x\nfn f() { panic!() }",
        )]));
        let expected =
            "tilt/src/x.rs:2: `panic!`: tilt, canopen, flash and device have no path that panics";
        assert_eq!(found[0].to_string(), expected);
    }
}
