//! Lines of code by crate, and how long its functions are: `cargo xtask count`.
//!
//! In: the checkout. Out: a table. Counted are lines that hold code: no comments, no blank lines,
//! no tests, benches or examples. A function has the lines from `fn` to its closing brace. Circles
//! are those of `circles`, which looks at a person's side only.
//!
//! Left out: limits, which are those of `sizes`.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::circles;
use super::source::Function;
use super::tree::Tree;

/// How many of the longest functions are listed.
const LONGEST: usize = 10;

/// What one crate has.
#[derive(Default)]
struct Crate {
    files: usize,
    lines: usize,
    functions: Vec<usize>,
    circles: usize,
}

impl Crate {
    /// The length that so many hundredths of the functions do not exceed; 0 without functions.
    fn quantile(&self, hundredths: usize) -> usize {
        let mut lengths = self.functions.clone();
        lengths.sort_unstable();
        let last = lengths.len().saturating_sub(1);
        lengths.get(last * hundredths / 100).copied().unwrap_or(0)
    }

    fn row(&self, name: &str) -> String {
        let functions = self.functions.len();
        let longest = self.functions.iter().max().copied().unwrap_or(0);
        format!(
            "{name:<24}{:>7}{:>8}{functions:>11}{:>6}{:>6}{longest:>9}{:>9}\n",
            self.files,
            self.lines,
            self.quantile(50),
            self.quantile(90),
            self.circles
        )
    }
}

/// The table.
pub fn table(tree: &Tree) -> String {
    let homes = homes(tree);
    let mut crates: BTreeMap<&str, Crate> = BTreeMap::new();
    let (mut pc_side, mut all) = (Crate::default(), Crate::default());
    let mut longest: Vec<(Function, &str)> = Vec::new();
    for source in &tree.sources {
        let Some(home) = homes.iter().find(|home| is_inside(&source.path, home)) else {
            continue;
        };
        if tree.is_test_file(&source.path) {
            continue;
        }
        let functions = source.functions_outside_tests();
        let mut counted = vec![crates.entry(home).or_default(), &mut all];
        if is_pc_side(home) {
            counted.push(&mut pc_side);
        }
        for of in counted {
            of.files += 1;
            of.lines += source.code_lines();
            of.functions
                .extend(functions.iter().map(|function| function.lines));
        }
        longest.extend(
            functions
                .into_iter()
                .map(|function| (function, source.path.as_str())),
        );
    }
    let mut text = format!(
        "{:<24}{:>7}{:>8}{:>11}{:>6}{:>6}{:>9}{:>9}\n",
        "crate", "files", "lines", "functions", "p50", "p90", "longest", "circles"
    );
    for (home, circles) in circles::count(tree) {
        crates.entry(home).or_default().circles = circles;
        pc_side.circles += circles;
    }
    crates.iter().for_each(|(name, of)| text += &of.row(name));
    text += &pc_side.row("a person's side");
    text += &all.row("all");
    longest.sort_by_key(|(function, _)| std::cmp::Reverse(function.lines));
    text += "\nthe longest functions\n";
    for (function, path) in longest.iter().take(LONGEST) {
        let _ = writeln!(
            text,
            "{:>5}  {}:{} {}",
            function.lines, path, function.line, function.name
        );
    }
    text
}

/// The folders of crates, those inside others first.
pub fn homes(tree: &Tree) -> Vec<&str> {
    let manifests = tree.files.iter().map(|file| file.path.as_str());
    let mut homes: Vec<&str> = manifests
        .filter_map(|path| path.strip_suffix("/Cargo.toml"))
        .collect();
    homes.sort_by_key(|home| std::cmp::Reverse(home.len()));
    homes
}

/// True for the folder of a crate on a person's side of the bus.
pub fn is_pc_side(home: &str) -> bool {
    home == "cli" || home.starts_with("pc/")
}

pub fn is_inside(path: &str, home: &str) -> bool {
    path.strip_prefix(home)
        .is_some_and(|rest| rest.starts_with("/src/"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_is_counted_without_comments_blank_lines_and_tests() {
        let code = concat!(
            "//! x\n\n/// y\nfn a() {\n    b();\n}\n\n",
            "#[cfg(test)]\nmod tests {\n    fn t() {}\n}\n"
        );
        let tree = Tree::of(&[
            ("cli/Cargo.toml", ""),
            ("cli/src/lib.rs", code),
            ("cli/tests/x.rs", code),
            ("sim/Cargo.toml", ""),
            ("sim/inner/Cargo.toml", ""),
            ("sim/inner/src/lib.rs", code),
        ]);
        let table = table(&tree);
        let row = |name: &str| {
            let line = table
                .lines()
                .find(|line| line.starts_with(name))
                .unwrap_or("");
            let numbers = line.trim_start_matches(name).split_whitespace();
            numbers.map(str::to_owned).collect::<Vec<_>>()
        };
        assert_eq!(row("cli"), ["1", "3", "1", "3", "3", "3", "0"]);
        assert_eq!(row("sim/inner"), row("cli"));
        assert_eq!(row("a person's side"), row("cli"));
        assert_eq!(row("all")[..3], ["2", "6", "2"]);
        assert!(table.ends_with("3  sim/inner/src/lib.rs:4 a\n"), "{table}");
    }
}
