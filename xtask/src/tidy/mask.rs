//! Rust source with its comments and the contents of its literals blanked, line for line.
//!
//! In: the text of a file. Out: as many characters on as many lines, in which a word or a brace
//! is surely code. Comments become spaces; what stands inside a string or a character becomes
//! underscores, so that a line inside a long string still counts as a line. Handles nested block
//! comments, raw and byte strings, and the difference between `'a'` and `'a`. Tokens inside a
//! macro call are taken as code.

/// Blanks `text`.
pub fn mask(text: &str) -> String {
    let characters: Vec<char> = text.chars().collect();
    let mut masker = Masker {
        rest: &characters,
        out: String::with_capacity(text.len()),
    };
    while !masker.rest.is_empty() {
        masker.step();
    }
    masker.out
}

/// Whether a character may stand inside an identifier or a number.
pub fn in_word(character: char) -> bool {
    character.is_alphanumeric() || character == '_'
}

struct Masker<'a> {
    rest: &'a [char],
    out: String,
}

impl Masker<'_> {
    fn step(&mut self) {
        match *self.rest {
            ['/', '/', ..] => self.blank(self.until(|rest| rest[0] == '\n'), ' '),
            ['/', '*', ..] => self.blank(self.block_comment(), ' '),
            ['"', ..] => self.string(),
            ['\'', ..] => self.character_or_lifetime(),
            [first, ..] if in_word(first) => self.word(),
            _ => self.keep(1),
        }
    }

    /// How many characters stand before the first place where `ends` holds.
    fn until(&self, ends: impl Fn(&[char]) -> bool) -> usize {
        (0..self.rest.len())
            .find(|&at| ends(&self.rest[at..]))
            .unwrap_or(self.rest.len())
    }

    /// Length of the block comment that starts here, with those nested in it.
    fn block_comment(&self) -> usize {
        let mut depth = 0;
        let mut at = 0;
        while at < self.rest.len() {
            match self.rest[at..] {
                ['/', '*', ..] => (depth, at) = (depth + 1, at + 2),
                ['*', '/', ..] => (depth, at) = (depth - 1, at + 2),
                _ => at += 1,
            }
            if depth == 0 {
                break;
            }
        }
        at
    }

    fn string(&mut self) {
        self.keep(1);
        self.contents('"');
    }

    /// Blanks up to the closing quote and keeps that.
    fn contents(&mut self, quote: char) {
        loop {
            match *self.rest {
                [] => return,
                ['\\', _, ..] => self.blank(2, '_'),
                [first, ..] if first == quote => return self.keep(1),
                _ => self.blank(1, '_'),
            }
        }
    }

    fn character_or_lifetime(&mut self) {
        let is_character = matches!(self.rest, ['\'', '\\', ..] | ['\'', _, '\'', ..]);
        self.keep(1);
        if is_character {
            self.contents('\'');
        }
    }

    /// A word; when it opens a raw string, that string too.
    fn word(&mut self) {
        let length = self.until(|rest| !in_word(rest[0]));
        let opens_raw = matches!(self.rest[..length], ['r'] | ['b' | 'c', 'r']);
        self.keep(length);
        if !opens_raw {
            return;
        }
        let hashes = self.until(|rest| rest[0] != '#');
        if self.rest.get(hashes) == Some(&'"') {
            self.keep(hashes + 1);
            let closes = |rest: &[char]| {
                rest[0] == '"' && rest[1..].iter().take_while(|&&c| c == '#').count() >= hashes
            };
            self.blank(self.until(closes), '_');
            self.keep(hashes + 1);
        }
    }

    fn keep(&mut self, count: usize) {
        let count = count.min(self.rest.len());
        self.out.extend(&self.rest[..count]);
        self.rest = &self.rest[count..];
    }

    fn blank(&mut self, count: usize, with: char) {
        let count = count.min(self.rest.len());
        let blanked = |&c: &char| if c.is_whitespace() { c } else { with };
        self.out.extend(self.rest[..count].iter().map(blanked));
        self.rest = &self.rest[count..];
    }
}

#[cfg(test)]
mod tests {
    use super::mask;

    #[test]
    fn comments_become_spaces() {
        assert_eq!(mask("a // b {\nc"), "a       \nc");
        assert_eq!(mask("a /* { /* } */ { */ b"), "a                   b");
    }

    #[test]
    fn strings_keep_their_quotes_and_lines() {
        assert_eq!(mask("\"a{\\\"b\" c"), "\"_____\" c");
        assert_eq!(mask("\"one\ntwo\" x"), "\"___\n___\" x");
        assert_eq!(mask("b\"//\" y"), "b\"__\" y");
    }

    #[test]
    fn raw_strings_end_at_their_own_hashes() {
        assert_eq!(mask("r#\"a\"{\"# z"), "r#\"___\"# z");
        assert_eq!(mask("br\"\\\" z"), "br\"_\" z");
        assert_eq!(mask("r#fn z"), "r#fn z");
    }

    #[test]
    fn lifetimes_are_code_and_characters_are_not() {
        assert_eq!(mask("&'a str"), "&'a str");
        assert_eq!(
            mask("'{' '\\'' '\\u{7b}' b'\"' 'x'"),
            "'_' '__' '______' b'_' '_'"
        );
        assert_eq!(mask("'outer: loop {"), "'outer: loop {");
    }

    #[test]
    fn an_unclosed_literal_ends_with_the_file() {
        assert_eq!(mask("\"abc"), "\"___");
        assert_eq!(mask("/* abc").trim(), "");
        assert_eq!(mask("r##\"abc\"#"), "r##\"_____");
    }

    #[test]
    fn the_text_keeps_its_shape() {
        let text = include_str!("mask.rs");
        let masked = mask(text);
        assert_eq!(masked.lines().count(), text.lines().count());
        assert_eq!(masked.chars().count(), text.chars().count());
    }
}
