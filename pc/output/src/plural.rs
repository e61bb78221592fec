//! Numbers with their nouns, in the singular and the plural.
//!
//! In: a count and both forms. Out: the text. Left out: other languages than English.

/// A number with its noun.
pub fn plural(count: impl Into<u64>, one: &str, many: &str) -> String {
    let count = count.into();
    format!("{count} {}", if count == 1 { one } else { many })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_has_the_singular_and_none_the_plural() {
        let frames = [0u32, 1, 2].map(|count| plural(count, "frame", "frames"));
        assert_eq!(frames, ["0 frames", "1 frame", "2 frames"]);
    }
}
