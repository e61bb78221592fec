//! No circle between the files of a crate on a person's side of the bus.
//!
//! In: the tree. Out: a finding for each set of files that name each other's items in a circle,
//! with a shortest circle and the line of each step, so that a reader sees where it can be cut.
//!
//! Left out: the crates for the part and the world; their circles are a module and its parts.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use super::Finding;
use super::count::{homes, is_inside, is_pc_side};
use super::source::Source;
use super::tree::Tree;
use super::uses::{Edge, Modules};

/// Finds the circles.
pub fn check(tree: &Tree) -> Vec<Finding> {
    findings(&circles(tree))
}

/// How many circles each crate of a person's side has; those without any are left out.
pub fn count(tree: &Tree) -> BTreeMap<&str, usize> {
    let homes = homes(tree);
    let mut counts = BTreeMap::new();
    for circle in circles(tree) {
        let home = homes.iter().find(|home| is_inside(&circle.files[0], home));
        *counts.entry(home.copied().unwrap_or_default()).or_default() += 1;
    }
    counts
}

/// Files that reach each other, and a shortest way round.
struct Circle {
    files: Vec<String>,
    way: Vec<Edge>,
}

fn findings(circles: &[Circle]) -> Vec<Finding> {
    let finding = |circle: &Circle| {
        let step = |edge: &Edge| format!("{} (line {})", edge.from, edge.line);
        let steps: Vec<_> = circle.way.iter().map(step).collect();
        let text = format!(
            "{} files name each other's items in a circle: {}, and back",
            circle.files.len(),
            steps.join(", then ")
        );
        Finding::new(&circle.files[0], 0, text)
    };
    circles.iter().map(finding).collect()
}

fn circles(tree: &Tree) -> Vec<Circle> {
    let mut found = Vec::new();
    for home in homes(tree).into_iter().filter(|home| is_pc_side(home)) {
        let sources: Vec<&Source> = tree
            .sources
            .iter()
            .filter(|source| is_inside(&source.path, home) && !tree.is_test_file(&source.path))
            .collect();
        let edges = Modules::of(&format!("{home}/src"), &sources).edges();
        found.extend(of_edges(&edges));
    }
    found
}

/// The circles among these edges.
fn of_edges(edges: &[Edge]) -> Vec<Circle> {
    let mut ways: BTreeMap<&str, Vec<&Edge>> = BTreeMap::new();
    for edge in edges {
        ways.entry(&edge.from).or_default().push(edge);
    }
    let reach: BTreeMap<&str, BTreeSet<&str>> = ways
        .keys()
        .map(|from| (*from, reached(&ways, from)))
        .collect();
    let mut known = BTreeSet::new();
    let mut circles = Vec::new();
    for (file, there) in &reach {
        if !there.contains(file) || known.contains(file) {
            continue;
        }
        let back = |other: &&&str| reach.get(**other).is_some_and(|set| set.contains(file));
        let files: Vec<&str> = there.iter().filter(back).copied().collect();
        known.extend(files.iter().copied());
        circles.push(Circle {
            way: shortest(&ways, &files),
            files: files.into_iter().map(str::to_owned).collect(),
        });
    }
    circles
}

/// Every file that a file leads to, over others too.
fn reached<'a>(ways: &BTreeMap<&'a str, Vec<&'a Edge>>, from: &str) -> BTreeSet<&'a str> {
    let mut found = BTreeSet::new();
    let mut open: Vec<&Edge> = ways.get(from).cloned().unwrap_or_default();
    while let Some(edge) = open.pop() {
        if found.insert(edge.to.as_str()) {
            open.extend(ways.get(edge.to.as_str()).into_iter().flatten());
        }
    }
    found
}

/// A shortest way from one of the files back to itself.
fn shortest(ways: &BTreeMap<&str, Vec<&Edge>>, files: &[&str]) -> Vec<Edge> {
    let from_each = files.iter().filter_map(|file| way_back(ways, file));
    from_each.min_by_key(Vec::len).unwrap_or_default()
}

fn way_back(ways: &BTreeMap<&str, Vec<&Edge>>, file: &str) -> Option<Vec<Edge>> {
    let mut seen = BTreeSet::new();
    let mut open = VecDeque::from([(file, Vec::new())]);
    while let Some((at, way)) = open.pop_front() {
        for edge in ways.get(at).into_iter().flatten() {
            let way = [&way[..], &[(*edge).clone()]].concat();
            if edge.to == file {
                return Some(way);
            }
            if seen.insert(edge.to.as_str()) {
                open.push_back((edge.to.as_str(), way));
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(files: &[(&str, &str)]) -> Vec<String> {
        let manifest = [("pc/x/Cargo.toml", "")];
        let tree = Tree::of(&[&manifest, files].concat());
        let found = findings(&circles(&tree));
        found.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn two_files_that_name_each_other_are_a_circle() {
        let found = of(&[
            ("pc/x/src/lib.rs", "mod a;\nmod b;\n"),
            ("pc/x/src/a.rs", "use super::b::B;\npub struct A;\n"),
            ("pc/x/src/b.rs", "pub struct B(crate::a::A);\n"),
        ]);
        let expected = "pc/x/src/a.rs: 2 files name each other's items in a circle: \
                        pc/x/src/a.rs (line 1), then pc/x/src/b.rs (line 1), and back";
        assert_eq!(found, [expected]);
    }

    #[test]
    fn three_files_in_a_row_are_found_once() {
        let found = of(&[
            ("pc/x/src/lib.rs", "mod a;\nmod b;\nmod c;\n"),
            (
                "pc/x/src/a.rs",
                "use crate::{b::{self, B}};\npub struct A;\n",
            ),
            ("pc/x/src/b.rs", "use super::c as other;\npub struct B;\n"),
            ("pc/x/src/c.rs", "fn f() -> super::a::A { todo() }\n"),
        ]);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].contains("3 files"), "{found:?}");
    }

    #[test]
    fn a_name_that_is_passed_on_leads_to_its_own_file() {
        let found = of(&[
            (
                "pc/x/src/lib.rs",
                "mod a;\nmod b;\npub use b::B;\nuse a::A;\n",
            ),
            ("pc/x/src/a.rs", "use super::B;\npub struct A;\n"),
            ("pc/x/src/b.rs", "pub struct B;\n"),
        ]);
        assert_eq!(found, [""; 0]);
    }

    #[test]
    fn a_part_that_names_what_its_parent_defines_is_a_circle() {
        let found = of(&[
            ("pc/x/src/lib.rs", "mod a;\npub struct Bus(a::A);\n"),
            ("pc/x/src/a.rs", "use super::Bus;\npub struct A;\n"),
        ]);
        assert_eq!(found.len(), 1);
    }

    #[test]
    fn tests_declarations_comments_and_other_crates_are_no_uses() {
        let found = of(&[
            (
                "pc/x/src/lib.rs",
                "mod a;\npub struct Bus;\n// a::A\n#[cfg(test)]\nmod tests;\n",
            ),
            (
                "pc/x/src/a.rs",
                "use super::Bus;\nuse std::a::B;\n#[cfg(test)]\nmod tests { use super::*; }\n",
            ),
            ("pc/x/src/tests.rs", "use super::a;\n"),
        ]);
        assert_eq!(found, [""; 0]);
    }

    #[test]
    fn modules_inside_a_file_are_in_that_file() {
        let found = of(&[
            ("pc/x/src/lib.rs", "mod a;\nmod b;\n"),
            (
                "pc/x/src/a.rs",
                "mod inner {\n    use super::super::b::B;\n    use super::A;\n}\nstruct A;\n",
            ),
            ("pc/x/src/b.rs", "pub struct B;\n"),
        ]);
        assert_eq!(found, [""; 0]);
    }

    #[test]
    fn other_crates_are_left_out() {
        let tree = Tree::of(&[
            ("sim/Cargo.toml", ""),
            ("sim/src/lib.rs", "mod a;\npub struct Bus(a::A);\n"),
            ("sim/src/a.rs", "use super::Bus;\npub struct A;\n"),
        ]);
        assert!(circles(&tree).is_empty());
    }
}
