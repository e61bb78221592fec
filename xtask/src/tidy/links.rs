//! Relative links of the documents lead somewhere.
//!
//! In: every Markdown file. Out: a finding for a link whose file doesn't exist, or whose heading
//! doesn't. Links to other hosts are not followed, and code blocks are not read.

use super::Finding;
use super::tree::{File, Tree};

/// Checks the links of every document.
pub fn check(tree: &Tree) -> Vec<Finding> {
    let documents = tree.files.iter().filter(|file| file.path.ends_with(".md"));
    documents.flat_map(|file| document(tree, file)).collect()
}

fn document(tree: &Tree, file: &File) -> Vec<Finding> {
    let text = file.text.as_deref().unwrap_or_default();
    let mut findings = Vec::new();
    for (number, line) in prose(text) {
        for target in targets(line)
            .into_iter()
            .filter(|target| !leads(tree, &file.path, target))
        {
            let text = format!("the link `{target}` leads nowhere");
            findings.push(Finding::new(&file.path, number, text));
        }
    }
    findings
}

/// The numbered lines outside fenced code.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut fenced = false;
    (1..).zip(text.lines()).filter(move |(_, line)| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        !fenced && !fence
    })
}

/// What stands in `](...)`.
fn targets(line: &str) -> Vec<&str> {
    let parts = line.split("](").skip(1);
    parts
        .filter_map(|part| part.split_once(')'))
        .map(|(target, _)| target)
        .collect()
}

fn leads(tree: &Tree, from: &str, target: &str) -> bool {
    if target.contains("://") || target.starts_with("mailto:") {
        return true;
    }
    let (path, heading) = target.split_once('#').unwrap_or((target, ""));
    let path = if path.is_empty() {
        Some(from.to_string())
    } else {
        resolve(from, path)
    };
    let Some(path) = path.filter(|path| tree.has(path)) else {
        return false;
    };
    heading.is_empty() || anchors(tree.text(&path).unwrap_or_default()).any(|one| one == heading)
}

/// The path from the root; `None` when it leaves the checkout.
fn resolve(from: &str, path: &str) -> Option<String> {
    let mut folders: Vec<&str> = from.split('/').collect();
    folders.pop();
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." => {
                folders.pop()?;
            }
            name => folders.push(name),
        }
    }
    Some(folders.join("/"))
}

/// The name under which each heading can be linked: lower case, blanks as hyphens, the rest of
/// the punctuation dropped.
fn anchors(text: &str) -> impl Iterator<Item = String> {
    let headings = prose(text).filter(|(_, line)| line.starts_with('#'));
    headings.map(|(_, line)| {
        let title = line.trim_start_matches('#').trim().to_lowercase();
        let kept = title
            .chars()
            .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
        kept.map(|c| if c == ' ' { '-' } else { c }).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings(text: &str) -> Vec<String> {
        let files = [
            ("docs/x.md", text),
            ("docs/accuracy.md", "# Accuracy\n## Static, 25 degC\n"),
            ("README.md", ""),
        ];
        check(&Tree::of(&files))
            .iter()
            .map(ToString::to_string)
            .collect()
    }

    #[test]
    fn links_to_files_and_folders_of_the_tree_lead() {
        assert!(findings("[a](accuracy.md) [b](../README.md) [c](../docs/)\n").is_empty());
        assert!(findings("[a](https://example.org/x) `code`\n").is_empty());
    }

    #[test]
    fn a_dead_link_is_found_with_its_line() {
        let expected = "docs/x.md:2: the link `gone.md` leads nowhere";
        assert_eq!(findings("\n[a](gone.md)\n"), vec![expected]);
        assert_eq!(findings("[a](../../outside.md)\n").len(), 1);
    }

    #[test]
    fn headings_are_checked() {
        assert!(findings("[a](accuracy.md#static-25-degc)\n").is_empty());
        assert!(findings("# Here\n[a](#here)\n").is_empty());
        assert_eq!(findings("[a](accuracy.md#dynamic)\n").len(), 1);
    }

    #[test]
    fn code_blocks_are_not_read() {
        assert!(findings("```text\n[a](gone.md)\n```\n").is_empty());
    }
}
