//! What changed between two texts, line by line, in the manner of `diff -u`.
//!
//! In: the old and the new text. Out: the changed lines with a few unchanged ones around them;
//! empty when the texts are equal. Meant for documents of some hundred lines: the table of
//! common lengths grows with the product of both.

/// Unchanged lines shown on either side of a change.
const CONTEXT: usize = 2;

#[derive(Clone, Copy, PartialEq, Eq)]
enum Edit<'a> {
    Keep(&'a str),
    Remove(&'a str),
    Add(&'a str),
}

/// The lines to take out of `old` (`-`) and to put in (`+`) to get `new`.
pub fn between(old: &str, new: &str) -> String {
    let edits = edits(
        &old.lines().collect::<Vec<_>>(),
        &new.lines().collect::<Vec<_>>(),
    );
    let changed = |edit: &Edit| !matches!(edit, Edit::Keep(_));
    let mut text = String::new();
    let mut gap = false;
    for (at, edit) in edits.iter().enumerate() {
        let around = &edits[at.saturating_sub(CONTEXT)..edits.len().min(at + CONTEXT + 1)];
        if !around.iter().any(changed) {
            gap = !text.is_empty();
            continue;
        }
        if std::mem::take(&mut gap) {
            text.push_str("  ...\n");
        }
        let (mark, line) = match edit {
            Edit::Keep(line) => (' ', line),
            Edit::Remove(line) => ('-', line),
            Edit::Add(line) => ('+', line),
        };
        text.push_str(&format!("{mark} {line}\n"));
    }
    if text.is_empty() && old != new {
        text.push_str("  (only the line ends differ)\n");
    }
    text
}

/// The longest common subsequence decides what is kept.
fn edits<'a>(old: &[&'a str], new: &[&'a str]) -> Vec<Edit<'a>> {
    let lengths = common_lengths(old, new);
    let (mut i, mut j) = (0, 0);
    let mut edits = Vec::new();
    while i < old.len() || j < new.len() {
        if i < old.len() && j < new.len() && old[i] == new[j] {
            edits.push(Edit::Keep(old[i]));
            (i, j) = (i + 1, j + 1);
        } else if j == new.len() || (i < old.len() && lengths[i + 1][j] >= lengths[i][j + 1]) {
            edits.push(Edit::Remove(old[i]));
            i += 1;
        } else {
            edits.push(Edit::Add(new[j]));
            j += 1;
        }
    }
    edits
}

/// `[i][j]` is the longest common subsequence of the lines from `i` and from `j` on.
fn common_lengths(old: &[&str], new: &[&str]) -> Vec<Vec<u32>> {
    let mut lengths = vec![vec![0; new.len() + 1]; old.len() + 1];
    for i in (0..old.len()).rev() {
        for j in (0..new.len()).rev() {
            lengths[i][j] = if old[i] == new[j] {
                lengths[i + 1][j + 1] + 1
            } else {
                lengths[i + 1][j].max(lengths[i][j + 1])
            };
        }
    }
    lengths
}

#[cfg(test)]
mod tests {
    use super::between;

    #[test]
    fn equal_texts_differ_in_nothing() {
        assert_eq!(between("a\nb\n", "a\nb\n"), "");
    }

    #[test]
    fn a_changed_line_stands_between_its_neighbours() {
        let old = "1\n2\n3\n4\n5\n6\n7\n";
        let new = "1\n2\n3\nx\n5\n6\n7\n";
        assert_eq!(between(old, new), "  2\n  3\n- 4\n+ x\n  5\n  6\n");
    }

    #[test]
    fn distant_changes_are_parted_by_dots() {
        let old = "a\n1\n2\n3\n4\n5\n6\nb\n";
        let new = "A\n1\n2\n3\n4\n5\n6\nB\n";
        assert_eq!(
            between(old, new),
            "- a\n+ A\n  1\n  2\n  ...\n  5\n  6\n- b\n+ B\n"
        );
    }

    #[test]
    fn a_missing_last_line_end_is_reported() {
        assert!(between("a\nb", "a\nb\n").contains("line ends differ"));
    }

    #[test]
    fn nothing_against_something() {
        assert_eq!(between("", "new\n"), "+ new\n");
        assert_eq!(between("old\n", ""), "- old\n");
    }
}
