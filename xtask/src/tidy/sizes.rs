//! Sizes that keep a file readable: lines, functions, files.
//!
//! In: the Rust sources. Out: a finding for a line over 100 columns, a function over 70 lines
//! (tests too), and a file over 600 lines of code, where blank lines, comments and the test
//! module don't count.

use super::Finding;
use super::source::Source;
use super::tree::Tree;

const COLUMNS: usize = 100;
const FUNCTION_LINES: usize = 70;
const FILE_LINES: usize = 600;

/// Applies the three limits.
pub fn check(tree: &Tree) -> Vec<Finding> {
    let rules = [columns, functions, file];
    tree.sources
        .iter()
        .flat_map(|source| rules.iter().flat_map(|rule| rule(source)))
        .collect()
}

fn columns(source: &Source) -> Vec<Finding> {
    let numbered = source.text.lines().zip(1..);
    numbered
        .map(|(line, number)| (line.chars().count(), number))
        .filter(|&(width, _)| width > COLUMNS)
        .map(|(width, number)| {
            Finding::new(
                &source.path,
                number,
                format!("{width} columns; the limit is {COLUMNS}"),
            )
        })
        .collect()
}

fn functions(source: &Source) -> Vec<Finding> {
    let long = source
        .functions()
        .into_iter()
        .filter(|function| function.lines > FUNCTION_LINES);
    long.map(|function| {
        let (name, lines) = (function.name, function.lines);
        let text = format!("`{name}` has {lines} lines; the limit is {FUNCTION_LINES}");
        Finding::new(&source.path, function.line, text)
    })
    .collect()
}

fn file(source: &Source) -> Vec<Finding> {
    let lines = source.code_lines();
    if lines <= FILE_LINES {
        return Vec::new();
    }
    let text = format!("{lines} lines of code; the limit is {FILE_LINES}: part it by subject");
    vec![Finding::new(&source.path, 0, text)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings(text: &str) -> Vec<Finding> {
        check(&Tree::of(&[("sim/src/x.rs", text)]))
    }

    #[test]
    fn a_line_of_101_columns_is_found() {
        assert_eq!(findings(&format!("// {}", "é".repeat(97))), vec![]);
        let found = findings(&format!("\n// {}", "é".repeat(98)));
        assert_eq!(
            found[0].to_string(),
            "sim/src/x.rs:2: 101 columns; the limit is 100"
        );
    }

    #[test]
    fn a_function_of_71_lines_is_found() {
        let body = |lines: usize| format!("fn long() {{\n{}}}\n", "    a();\n".repeat(lines - 2));
        assert_eq!(findings(&body(70)), vec![]);
        let found = findings(&body(71));
        assert_eq!(
            found[0].to_string(),
            "sim/src/x.rs:1: `long` has 71 lines; the limit is 70"
        );
    }

    #[test]
    fn a_file_of_601_lines_of_code_is_found() {
        let statics = |count: usize| "// why\n\nstatic A: u8 = 1;\n".repeat(count);
        let tests = "#[cfg(test)]\nmod tests {\n    use super::*;\n}\n";
        assert_eq!(findings(&format!("{}{tests}", statics(600))), vec![]);
        assert_eq!(findings(&statics(601)).len(), 1);
    }
}
