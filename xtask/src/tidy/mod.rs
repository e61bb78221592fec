//! The house rules that the compiler does not enforce, as an ordinary test.
//!
//! In: the checkout. Out: a list of breaches, each with its file and line. Every rule lives in
//! the module named after what it looks at, next to a test that shows it failing on a bad piece.

mod circles;
mod closed_types;
mod count;
mod documents;
pub mod hygiene;
mod imports;
mod links;
mod mask;
mod sizes;
mod source;
mod tree;
mod uses;
mod words;

use std::path::Path;
use std::{fmt, io};

use tree::Tree;

/// One breach of a rule.
#[derive(Debug, PartialEq, Eq)]
pub struct Finding {
    /// From the root.
    path: String,
    /// From 1; 0 stands for the whole file.
    line: usize,
    /// What is wrong and, where it isn't plain, what to do.
    text: String,
}

impl Finding {
    fn new(path: &str, line: usize, text: impl Into<String>) -> Self {
        Self {
            path: path.to_string(),
            line,
            text: text.into(),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => write!(out, "{}: {}", self.path, self.text),
            line => write!(out, "{}:{line}: {}", self.path, self.text),
        }
    }
}

/// Every breach in the checkout at `root`, in the order of the rules.
pub fn check(root: &Path) -> io::Result<Vec<Finding>> {
    let tree = Tree::load(root)?;
    let rules = [
        imports::check,
        sizes::check,
        words::check,
        closed_types::check,
        hygiene::check,
        documents::check,
        links::check,
        circles::check,
    ];
    Ok(rules.iter().flat_map(|rule| rule(&tree)).collect())
}

/// Lines of code by crate, as text.
pub fn count(root: &Path) -> io::Result<String> {
    Ok(count::table(&Tree::load(root)?))
}

#[cfg(test)]
mod tests {
    use crate::workspace::Workspace;

    #[test]
    fn the_checkout_keeps_the_house_rules() {
        let findings = super::check(Workspace::locate().root()).expect("a readable checkout");
        let list: Vec<String> = findings.iter().map(ToString::to_string).collect();
        assert!(
            findings.is_empty(),
            "{} breaches:\n{}",
            list.len(),
            list.join("\n")
        );
    }
}
