//! Documents that make claims about the code name the test that holds each claim.
//!
//! In: ARCHITECTURE.md, docs/paper.md, README.md and docs/accuracy.md. Out: a finding for an
//! invariant without an existing test, for a row of the paper without an existing module and
//! test, for a figure in prose that the generated accuracy document doesn't hold, and for a long
//! name on any page of docs/ that no source contains.

use std::collections::BTreeSet;

use super::Finding;
use super::tree::Tree;
use crate::accuracy::DOCUMENT as ACCURACY;

const ARCHITECTURE: &str = "ARCHITECTURE.md";
const PAPER: &str = "docs/paper.md";
const README: &str = "README.md";

/// A block of lines in README.md or docs/paper.md that are copied from the accuracy document.
const FIGURES: &str = "<!-- figures -->";
const FIGURES_END: &str = "<!-- end of figures -->";

/// Requirements R1 to R18, errata E1 to E16 and assumptions A1 to A8.
const ROWS: [(char, u32); 3] = [('R', 18), ('E', 16), ('A', 8)];

/// Applies the rules; a document that is missing is a finding too.
pub fn check(tree: &Tree) -> Vec<Finding> {
    let documents = [ARCHITECTURE, PAPER, README, ACCURACY];
    let missing = documents.iter().filter(|path| tree.text(path).is_none());
    let mut findings: Vec<Finding> = missing
        .map(|path| Finding::new(path, 0, "this document is missing"))
        .collect();
    let tests = tree.test_names();
    findings.extend(invariants(
        tree.text(ARCHITECTURE).unwrap_or_default(),
        &tests,
    ));
    findings.extend(walk(tree));
    findings.extend(paper(tree, &tests));
    findings.extend(figures(tree, README));
    findings.extend(figures(tree, PAPER));
    findings.extend(names(tree, &tests));
    findings
}

/// So many underscores make a name so long that it is a test's or a field's.
const LONG: usize = 4;

/// Each long name between backquotes in docs/ is that of a test, or stands in a source.
fn names(tree: &Tree, tests: &BTreeSet<String>) -> Vec<Finding> {
    let is_page = |path: &str| path.starts_with("docs/") && path.ends_with(".md");
    let pages = tree.files.iter().filter(|file| is_page(&file.path));
    let mut findings = Vec::new();
    for page in pages {
        let text = page.text.as_deref().unwrap_or_default();
        for (line, number) in text.lines().zip(1..) {
            let named = quoted(line).into_iter().filter(|name| is_long(name));
            let unknown = named.filter(|name| !tests.contains(*name) && !stands(tree, name));
            findings.extend(unknown.map(|name| {
                let what = format!("no test and no source has the name `{name}`");
                Finding::new(&page.path, number, what)
            }));
        }
    }
    findings
}

fn is_long(name: &str) -> bool {
    let of_a_name = |c: char| matches!(c, 'a'..='z' | '0'..='9' | '_');
    name.chars().all(of_a_name) && name.matches('_').count() >= LONG
}

fn stands(tree: &Tree, name: &str) -> bool {
    let sources = tree.files.iter().filter(|file| !file.path.ends_with(".md"));
    let mut texts = sources.filter_map(|file| file.text.as_deref());
    texts.any(|text| text.contains(name))
}

/// The numbered list of functions under this heading.
const WALK: &str = "## From a sample to a frame";

/// Each step of the list under [`WALK`] is numbered in order and names a file and its function.
fn walk(tree: &Tree) -> Vec<Finding> {
    let text = tree.text(ARCHITECTURE).unwrap_or_default();
    let (mut inside, mut steps) = (false, 0);
    let mut findings = Vec::new();
    for (line, number) in text.lines().zip(1..) {
        if line.starts_with("## ") {
            inside = line == WALK;
        }
        let digits = line.chars().take_while(char::is_ascii_digit).count();
        let (count, step) = line.split_at(digits);
        if !inside || digits == 0 || !step.starts_with(". ") {
            continue;
        }
        steps += 1;
        if count.parse() != Ok(steps) {
            let what = format!("step {count} is number {steps}");
            findings.push(Finding::new(ARCHITECTURE, number, what));
        }
        findings
            .extend(no_function(tree, step).map(|what| Finding::new(ARCHITECTURE, number, what)));
    }
    if steps == 0 && !text.is_empty() {
        let what = format!("no list under `{WALK}`");
        findings.push(Finding::new(ARCHITECTURE, 0, what));
    }
    findings
}

/// What is wrong with the file and the function that a step names.
fn no_function(tree: &Tree, step: &str) -> Option<String> {
    let mut names = step.split('`').skip(1).step_by(2);
    let (Some(file), Some(function)) = (names.next(), names.next()) else {
        return Some("a step names a file and a function".to_string());
    };
    let Some(source) = tree.sources.iter().find(|source| source.path == file) else {
        return Some(format!("`{file}` doesn't exist"));
    };
    let named = [format!("fn {function}("), format!("fn {function}<")];
    let is_there = named.iter().any(|name| source.text.contains(name.as_str()));
    (!is_there).then(|| format!("`{file}` has no function `{function}`"))
}

/// Each numbered row under the heading "Invariants" names a test in its last cell.
fn invariants(text: &str, tests: &BTreeSet<String>) -> Vec<Finding> {
    let mut inside = false;
    let mut rows = 0;
    let mut findings = Vec::new();
    for (line, number) in text.lines().zip(1..) {
        if line.starts_with("## ") {
            inside = line.trim() == "## Invariants";
        }
        let cells = cells(line);
        if inside
            && cells
                .first()
                .is_some_and(|first| first.parse::<u32>().is_ok())
        {
            rows += 1;
            let named = cells.last().copied().unwrap_or_default();
            findings.extend(tests_exist(ARCHITECTURE, number, named, tests));
        }
    }
    if rows == 0 && !text.is_empty() {
        findings.push(Finding::new(
            ARCHITECTURE,
            0,
            "no table under the heading `## Invariants`",
        ));
    }
    findings
}

/// Every requirement, erratum and assumption stands in one row, which names modules and tests
/// that exist.
fn paper(tree: &Tree, tests: &BTreeSet<String>) -> Vec<Finding> {
    let text = tree.text(PAPER).unwrap_or_default();
    let mut findings = Vec::new();
    for (letter, count) in ROWS {
        for label in (1..=count).map(|number| format!("{letter}{number}")) {
            let numbered = text.lines().zip(1..);
            let rows: Vec<_> = numbered
                .filter(|(line, _)| cells(line).first() == Some(&label.as_str()))
                .collect();
            match rows.as_slice() {
                [(line, number)] => findings.extend(paper_row(tree, *number, line, tests)),
                [] if text.is_empty() => {}
                rows => {
                    let text = format!("{label} stands in {} rows instead of one", rows.len());
                    findings.push(Finding::new(PAPER, 0, text));
                }
            }
        }
    }
    findings
}

/// Cells: label, what is asked, module, test, figure. A row that waits for something that isn't
/// built yet has "with `path`" in place of the module; once the path exists it is due.
fn paper_row(tree: &Tree, line: usize, row: &str, tests: &BTreeSet<String>) -> Vec<Finding> {
    let cells = cells(row);
    let &[label, _, module, test, figure] = cells.as_slice() else {
        let text = "a row has five cells: label, what is asked, module, test, figure";
        return vec![Finding::new(PAPER, line, text)];
    };
    if let Some(waits) = module.strip_prefix("with ") {
        let due = quoted(waits).into_iter().filter(|folder| tree.has(folder));
        let text = |folder| format!("{label} waits for `{folder}`, which is there: fill the row");
        return due
            .map(|folder| Finding::new(PAPER, line, text(folder)))
            .collect();
    }
    let mut findings = tests_exist(PAPER, line, test, tests);
    let modules = quoted(module);
    if modules.is_empty() {
        findings.push(Finding::new(
            PAPER,
            line,
            format!("{label} names no module"),
        ));
    }
    for path in modules.iter().filter(|path| !tree.has(path)) {
        findings.push(Finding::new(PAPER, line, format!("`{path}` doesn't exist")));
    }
    let printed = tree.text(ACCURACY).unwrap_or_default();
    for figure in quoted(figure)
        .into_iter()
        .filter(|figure| !printed.contains(figure))
    {
        findings.push(Finding::new(
            PAPER,
            line,
            format!("`{figure}` is not in {ACCURACY}"),
        ));
    }
    findings
}

fn tests_exist(path: &str, line: usize, cell: &str, tests: &BTreeSet<String>) -> Vec<Finding> {
    let names = quoted(cell);
    if names.is_empty() {
        return vec![Finding::new(path, line, "names no test")];
    }
    let short = |name: &str| name.rsplit("::").next().unwrap_or(name).to_string();
    let unknown = names
        .into_iter()
        .filter(|name| !tests.contains(&short(name)));
    unknown
        .map(|name| Finding::new(path, line, format!("there is no test `{name}`")))
        .collect()
}

/// Every line between the marks in `document` is a line of the accuracy document.
fn figures(tree: &Tree, document: &'static str) -> Vec<Finding> {
    let printed: BTreeSet<&str> = tree
        .text(ACCURACY)
        .unwrap_or_default()
        .lines()
        .map(str::trim)
        .collect();
    let mut inside = false;
    let mut findings = Vec::new();
    for (line, number) in tree
        .text(document)
        .unwrap_or_default()
        .lines()
        .map(str::trim)
        .zip(1..)
    {
        match line {
            FIGURES => inside = true,
            FIGURES_END => inside = false,
            "" => {}
            _ if inside && !line.starts_with("```") && !printed.contains(line) => {
                let text = format!("this line is not in {ACCURACY}; copy it from there");
                findings.push(Finding::new(document, number, text));
            }
            _ => {}
        }
    }
    if inside {
        findings.push(Finding::new(
            document,
            0,
            format!("`{FIGURES_END}` is missing"),
        ));
    }
    findings
}

/// The cells of a table row; none when the line isn't one.
fn cells(line: &str) -> Vec<&str> {
    let inner = line
        .trim()
        .strip_prefix('|')
        .and_then(|line| line.strip_suffix('|'));
    inner
        .map(|inner| inner.split('|').map(str::trim).collect())
        .unwrap_or_default()
}

/// What stands between backquotes.
fn quoted(cell: &str) -> Vec<&str> {
    cell.split('`').skip(1).step_by(2).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CODE: (&str, &str) = (
        "tilt/src/filter.rs",
        "//! x\n#[test]\nfn holds() {}\nfn helper() {}\n",
    );

    fn texts(found: Vec<Finding>) -> Vec<String> {
        found.iter().map(ToString::to_string).collect()
    }

    fn architecture(rows: &str) -> Vec<String> {
        let tests = Tree::of(&[CODE]).test_names();
        texts(invariants(
            &format!("## Invariants\n| # | rule | test |\n|---|---|---|\n{rows}"),
            &tests,
        ))
    }

    #[test]
    fn an_invariant_names_a_test_that_exists() {
        assert!(architecture("| 1 | no I/O | `filter::tests::holds` |\n").is_empty());
        let expected = "ARCHITECTURE.md:4: there is no test `gone`";
        assert_eq!(architecture("| 1 | no I/O | `gone` |\n"), vec![expected]);
        assert_eq!(architecture("| 1 | no I/O | `helper` |\n").len(), 1);
        assert_eq!(
            architecture("| 1 | no I/O | none |\n"),
            vec!["ARCHITECTURE.md:4: names no test"]
        );
        assert_eq!(architecture("").len(), 1);
    }

    #[test]
    fn the_walk_of_a_sample_names_functions_that_exist() {
        let walked = |steps: &str| {
            let text = format!("{WALK}\n\n{steps}\n## Next\n1. `no.rs` `nothing`\n");
            texts(walk(&Tree::of(&[CODE, (ARCHITECTURE, text.as_str())])))
        };
        let good =
            "1. `tilt/src/filter.rs` `helper`: first.\n2. `tilt/src/filter.rs` `holds`: second.";
        assert_eq!(walked(good), [""; 0]);
        assert!(walked(&good.replace("helper", "gone"))[0].contains("has no function `gone`"));
        assert!(walked(&good.replace("filter.rs", "gone.rs"))[0].contains("doesn't exist"));
        assert!(walked(&good.replace("2. ", "3. "))[0].contains("step 3 is number 2"));
        assert!(walked("1. nothing")[0].contains("names a file and a function"));
        assert!(walked("")[0].contains("no list"));
    }

    fn row(row: &str) -> Vec<String> {
        let tree = Tree::of(&[CODE, (ACCURACY, "| rmse | 0.031 |\n")]);
        texts(paper_row(&tree, 7, row, &tree.test_names()))
    }

    #[test]
    fn a_row_of_the_paper_names_module_and_test() {
        let good = "| R2 | low-pass | `tilt/src/filter.rs` | `holds` | `0.031` |";
        assert!(row(good).is_empty());
        assert_eq!(row(&good.replace("filter.rs", "gone.rs")).len(), 1);
        assert_eq!(row(&good.replace("holds", "gone")).len(), 1);
        assert_eq!(row(&good.replace("0.031", "0.030")).len(), 1);
        assert_eq!(
            row("| R2 | low-pass | `tilt/src/filter.rs` | `holds` |").len(),
            1
        );
        assert_eq!(row("| R2 | low-pass | none | `holds` | - |").len(), 1);
    }

    #[test]
    fn a_row_may_wait_for_a_folder_until_it_is_there() {
        assert!(row("| R14 | CANopen | with `canopen/` | - | - |").is_empty());
        let found = row("| R14 | CANopen | with `tilt/` | - | - |");
        assert!(
            found[0].contains("waits for `tilt/`, which is there"),
            "{found:?}"
        );
    }

    #[test]
    fn every_row_of_the_paper_stands_once() {
        let found = paper(
            &Tree::of(&[(PAPER, "| R1 | a | with `b/` | - | - |\n")]),
            &BTreeSet::new(),
        );
        assert_eq!(found.len(), 17 + 16 + 8);
    }

    #[test]
    fn figures_in_the_readme_are_printed_by_the_generator() {
        let readme =
            |line: &str| format!("{FIGURES}\n\n```text\n{line}\n```\n{FIGURES_END}\nfree\n");
        let found = |text: &str| {
            let tree = Tree::of(&[(README, text), (ACCURACY, "a 0.031\n")]);
            figures(&tree, README).len()
        };
        assert_eq!(found(&readme("a 0.031")), 0);
        assert_eq!(found(&readme("a 0.030")), 1);
        assert_eq!(found(FIGURES), 1);
    }

    #[test]
    fn a_page_named_a_test_that_had_another_name_since() {
        let found = |line: &str| {
            let field = ("pc/a/src/data.rs", "pub bias_between_runs_deg_s: f64,");
            let test = (
                "tilt/src/a.rs",
                "#[test]\nfn a_baseline_is_taken_off() {}\n",
            );
            let tree = Tree::of(&[field, test, ("docs/safety.md", line)]);
            texts(names(&tree, &tree.test_names()))
        };
        let good = "| `a_baseline_is_taken_off` | `bias_between_runs_deg_s` | `plumb_log` |";
        assert_eq!(found(good), [""; 0]);
        let gone = found(&good.replace("baseline", "habit"));
        assert_eq!(gone.len(), 1);
        assert!(gone[0].starts_with("docs/safety.md:1: no test and no source"));
        assert!(gone[0].ends_with("`a_habit_is_taken_off`"));
    }

    #[test]
    fn missing_documents_are_findings() {
        assert_eq!(check(&Tree::of(&[])).len(), 4);
    }
}
