//! Every register that the emulated chip has is cited with the section that it follows.
//!
//! In: the sources of the chip. Out: a table in each file's documentation has a row for every
//! offset and every address that code loads from or stores to there, with a section of RM0008,
//! PM0056, PM0075 or the architecture's manual.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// The files that tell registers apart by numbers.
const FILES: [&str; 13] = [
    "bus",
    "can/filter",
    "can/mod",
    "crc",
    "exti",
    "flash_controller",
    "gpio",
    "nvic",
    "rcc",
    "spi",
    "system",
    "timer",
    "watchdog",
];

/// A number as sources have it (0x1FFF_F7E8) or as the tables do (1FFFF7E8h).
fn number(text: &str) -> Option<u32> {
    let digits = text.trim().trim_start_matches("0x").trim_end_matches('h');
    u32::from_str_radix(&digits.replace('_', ""), 16).ok()
}

/// The offsets of a table's rows that cite a section.
fn cited(source: &str) -> BTreeSet<u32> {
    let rows = source
        .lines()
        .filter_map(|line| line.strip_prefix("//! | "));
    let rows = rows.filter_map(|row| {
        let [at, _, section, _] = row.splitn(4, '|').collect::<Vec<_>>()[..] else {
            return None;
        };
        let is_section = section.chars().any(|c| c.is_ascii_digit());
        number(at).filter(|_| is_section)
    });
    rows.collect()
}

/// The offsets that arms of the code are for.
fn used(source: &str) -> BTreeSet<u32> {
    let code = source.split("\nmod tests {").next().unwrap_or_default();
    let arms = code.lines().filter(|line| line.contains("=>"));
    let arms = arms.filter_map(|line| {
        let arm = line
            .trim()
            .trim_start_matches("base @ ")
            .trim_start_matches('(');
        let digits = arm.strip_prefix("0x")?;
        let end = digits.find(|c: char| !c.is_ascii_hexdigit() && c != '_')?;
        number(&digits[..end])
    });
    arms.collect()
}

#[test]
fn every_register_is_cited_with_its_section() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/chip");
    let mut count = 0;
    for file in FILES {
        let source = fs::read_to_string(folder.join(format!("{file}.rs")));
        let source = source.unwrap_or_else(|error| panic!("{file}: {error}"));
        let (cited, used) = (cited(&source), used(&source));
        assert!(!used.is_empty(), "{file}: no register found");
        let missing: Vec<_> = used.difference(&cited).collect();
        assert!(missing.is_empty(), "{file}: no section for {missing:X?}");
        count += used.len();
    }
    assert!(count > 80, "{count}");
}

#[test]
fn a_register_without_a_section_is_found() {
    let source = "//! | 04h | CR | |\n match offset {\n 0x04 => 1,\n 0x08..=0x0C if true => 2,";
    assert_eq!(cited(source), BTreeSet::new());
    assert_eq!(used(source), BTreeSet::from([4, 8]));
}
