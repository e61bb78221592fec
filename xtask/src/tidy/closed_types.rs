//! Types whose values come from one module only.
//!
//! In: the sources of the modules listed below. Out: a finding when such a type is gone from its
//! module, or has a field that others can fill in. That is what makes a raw value impossible to
//! pass off as a checked one.

use super::Finding;
use super::source::words;
use super::tree::Tree;

/// Module and type. `Verdict`: only the cross-check of two channels makes one.
const CLOSED: [(&str, &str); 1] = [("tilt/src/cross_check.rs", "Verdict")];

/// Looks at each type of the list.
pub fn check(tree: &Tree) -> Vec<Finding> {
    CLOSED
        .iter()
        .filter_map(|(path, name)| closed(tree, path, name))
        .collect()
}

fn closed(tree: &Tree, path: &str, name: &str) -> Option<Finding> {
    let source = tree.sources.iter().find(|source| source.path == path)?;
    let heading = format!("pub struct {name}");
    let Some((at, item)) = source.item(&heading) else {
        let text = format!("`{name}` isn't here any more: mend the list in closed_types.rs");
        return Some(Finding::new(path, 0, text));
    };
    let open = words(&item["pub".len()..], "pub").next().is_some();
    let text = format!("`{name}` has a public field, so any module could make one");
    open.then(|| Finding::new(path, source.line(at), text))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings(text: &str) -> usize {
        check(&Tree::of(&[("tilt/src/cross_check.rs", text)])).len()
    }

    #[test]
    fn only_cross_check_makes_a_verdict() {
        assert_eq!(
            findings("pub struct Verdict {\n    own: u8,\n}\npub fn f() {}\n"),
            0
        );
        assert_eq!(
            findings("pub struct Verdict {\n    own: u8,\n    pub peer: u8,\n}\n"),
            1
        );
        assert_eq!(findings("pub struct Verdict(pub u8);\n"), 1);
        assert_eq!(findings("pub struct Judgement;\n"), 1);
    }
}
