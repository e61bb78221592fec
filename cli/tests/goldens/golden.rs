//! Comparison with a golden, and all that is taken out of an output before it.
//!
//! In: the name of the golden, and the text. Out: a failed test with the difference, unless both
//! are the same. Ports, the program's version and sums over the version are always replaced. What
//! a run in real time measures goes by [`decimals`], [`numbers`] or [`members`].

use insta::Settings;

/// What differs from run to run and from machine to machine, and what stands for it. Ports that a
/// system gives are above those that `plumb serve` has by default.
const ALWAYS: [(&str, &str); 3] = [
    (r"127\.0\.0\.1:[3-6]\d{4}", "127.0.0.1:PORT"),
    (r"port=[3-6]\d{4}", "port=PORT"),
    (r"os error \d+", "os error N"),
];

/// Compares a text with the golden of this name.
pub fn check(name: &str, text: &str) {
    check_with(name, text, &[]);
}

/// The same, with regular expressions for what differs from run to run in this text alone.
pub fn check_with(name: &str, text: &str, filters: &[(&str, &str)]) {
    let mut settings = Settings::new();
    settings.set_snapshot_path("snapshots");
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    let version = env!("CARGO_PKG_VERSION").replace('.', r"\.");
    settings.add_filter(&format!(r"\bv?{version}\b"), "VERSION");
    for (pattern, instead) in ALWAYS.iter().chain(filters) {
        settings.add_filter(pattern, *instead);
    }
    settings.bind(|| insta::assert_snapshot!(name, text));
}

/// The text with `N` for each number that has a fraction: what sensors measure. Versions and
/// addresses, with more than one point, and whole numbers stay.
pub fn decimals(text: &str) -> String {
    let n = |number: &str| (number.matches('.').count() == 1).then(|| "N".to_owned());
    aligned(&unsigned(&replaced(text, n)))
}

/// The text with six digits behind the point: sums of many numbers may differ in their last bit
/// where the C library of the machine has another sine.
pub fn rounded(text: &str) -> String {
    replaced(text, |number| {
        let value: f64 = number.parse().ok()?;
        number.contains('.').then(|| format!("{:.6}", value + 0.0))
    })
}

/// The text with `N` for each number: counts and states of a run in real time vary as well.
pub fn numbers(text: &str) -> String {
    aligned(&unsigned(&replaced(&counted(text), |_| {
        Some("N".to_owned())
    })))
}

/// JSON in its long form with `N` for each number; of equal objects in a row one remains, with
/// their count.
pub fn members(text: &str) -> String {
    let text = numbers(text);
    let mut lines: Vec<(&str, usize)> = Vec::new();
    let mut open = Vec::new();
    for line in text.lines() {
        match line.trim() {
            "{" => open.push(lines.len()),
            word if word.ends_with('{') => open.push(usize::MAX),
            _ => {}
        }
        lines.push((line.trim_end_matches(','), 1));
        if line.trim_start().starts_with('}') {
            join(&mut lines, open.pop().unwrap_or(usize::MAX));
        }
    }
    let told = lines.into_iter().map(|(line, times)| match times {
        1 => format!("{line}\n"),
        _ => format!("{line}  (x{times})\n"),
    });
    told.collect()
}

/// Takes the last object away, which begins at `from`, where the one before it is the same.
fn join(lines: &mut Vec<(&str, usize)>, from: usize) {
    let length = lines.len().saturating_sub(from);
    let Some(before) = from.checked_sub(length).filter(|_| length > 0) else {
        return;
    };
    let words = |range: std::ops::Range<usize>| lines[range].iter().map(|(line, _)| *line);
    if words(before..from).eq(words(from..from + length)) {
        lines.truncate(from);
        lines[from - 1].1 += 1;
    }
}

/// Columns are as wide as their widest number, so their width goes with the numbers; and of equal
/// lines in a row one remains, with their count.
fn aligned(text: &str) -> String {
    let mut lines: Vec<(String, usize)> = Vec::new();
    for line in text.lines() {
        let line = narrowed(line);
        match lines.last_mut() {
            Some((last, times)) if *last == line && !line.is_empty() => *times += 1,
            _ => lines.push((line, 1)),
        }
    }
    let told = lines.into_iter().map(|(line, times)| match times {
        1 => line + "\n",
        _ => format!("{line}  (x{times})\n"),
    });
    told.collect()
}

/// The line with at most two blanks, or three dashes, in a row behind its indentation.
fn narrowed(line: &str) -> String {
    let indented = line.len() - line.trim_start().len();
    let mut narrow = line[..indented].to_owned();
    for character in line[indented..].chars() {
        let most = match character {
            ' ' => "  ",
            '-' => "---",
            _ => "",
        };
        if most.is_empty() || !narrow[indented..].ends_with(most) {
            narrow.push(character);
        }
    }
    narrow
}

/// The text with something else for some numbers; digits behind letters are names,
/// and an exit status is exact.
fn replaced(text: &str, instead: impl Fn(&str) -> Option<String>) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(|c: char| c.is_ascii_digit()) {
        out.push_str(&rest[..at]);
        let (number, behind) = number(&rest[at..]);
        let name = out.ends_with(|c: char| c.is_alphanumeric() || c == '_');
        let name = name || out.ends_with("[status ");
        let other = if name { None } else { instead(number) };
        out.push_str(other.as_deref().unwrap_or(number));
        rest = behind;
    }
    out + rest
}

/// The text with a number for each word that is a check sum, a hash, a calibration or a time: those
/// may begin with a letter, or look like a number.
fn counted(text: &str) -> String {
    let of = |word: &str, digits: &str| word.chars().all(|c| digits.contains(c));
    let sum = |word: &str| match word.len() {
        8 => of(word, "0123456789ABCDEF"),
        32.. => of(word, "0123456789abcdef"),
        _ => false,
    };
    let time =
        |word: &str| of(word, "0123456789TZ") && word.starts_with(|c: char| c.is_ascii_digit());
    let mut out = String::new();
    let mut word = String::new();
    for character in text.chars().chain(['\n']) {
        if character.is_alphanumeric() || character == '_' {
            word.push(character);
            continue;
        }
        let is_number = !word.is_empty() && (sum(&word) || time(&word));
        out.push_str(if is_number { "0" } else { &word });
        out.push(character);
        word.clear();
    }
    out.pop();
    out
}

/// The text without the sign of an `N`: a reading about zero has either.
fn unsigned(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some((before, behind)) = rest.split_once(['+', '-', '\u{2212}']) {
        out.push_str(before);
        let word = out.ends_with(char::is_alphanumeric);
        if word || !behind.starts_with('N') {
            let sign = &rest[before.len()..rest.len() - behind.len()];
            out.push_str(sign);
        }
        rest = behind;
    }
    out + rest
}

/// The number, with its exponent, that a text begins with, and what is behind it.
fn number(text: &str) -> (&str, &str) {
    let digits = |text: &str| {
        let end = text.find(|c: char| !c.is_ascii_digit() && c != '.');
        let end = end.unwrap_or(text.len());
        text[..end].trim_end_matches('.').len()
    };
    let mut end = digits(text);
    if let Some(exponent) = text[end..].strip_prefix('e') {
        let unsigned = exponent.trim_start_matches(['+', '-']);
        let length = digits(unsigned);
        if length > 0 {
            end += 1 + exponent.len() - unsigned.len() + length;
        }
    }
    text.split_at(end)
}

#[test]
fn what_is_measured_is_taken_out_and_names_stay() {
    let text = "slope_x2 at 127.0.0.1   -1.25 deg,  +3.0e-5 g, node 2, 0.1.0, SHA-256.\n";
    let told = "slope_x2 at 127.0.0.1  N deg,  N g, node 2, 0.1.0, SHA-256.\n";
    assert_eq!(decimals(text), told);
    assert_eq!(
        numbers("A03CD2D7, 2026-11-25T09:30:19Z, 25 TZ\n"),
        "N, N-N-N:N:N, N TZ\n"
    );
    assert_eq!(numbers("A -7 B 8h\nA +9 B 10h\n"), "A N B Nh  (x2)\n");
    assert_eq!(
        rounded("a 0.30000000000000004, -1e-9, 7, 2.5e-7\n"),
        "a 0.300000, -1e-9, 7, 0.000000\n"
    );
    let list = "[\n  {\n    \"a\": 1\n  },\n  {\n    \"a\": 2.5\n  }\n]\n";
    assert_eq!(members(list), "[\n  {\n    \"a\": N\n  }  (x2)\n]\n");
}
