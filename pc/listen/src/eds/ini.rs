//! The sections and keys of an EDS.
//!
//! In: bytes: ASCII, UTF-8 with or without its mark, UTF-16 with its mark, else Latin-1; lines
//! ended by CR, LF or both. Out: one [`Line`] after the other. Blank lines and comments (`;`, and
//! `#` and `//`, which some tools write) are passed over.

/// A line that is neither blank nor a comment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Line {
    /// `[1018sub1]`, without the brackets and in small letters.
    Section(String),
    /// `Key=value`, the key in small letters, both without blanks around.
    Key(String, String),
    /// Neither.
    Neither,
}

/// The text in these bytes, and whether it had to be taken as Latin-1.
pub fn text(bytes: &[u8]) -> (String, bool) {
    let wide = |pair: &[u8; 2], little: bool| {
        if little {
            u16::from_le_bytes(*pair)
        } else {
            u16::from_be_bytes(*pair)
        }
    };
    if let [0xFF, 0xFE, rest @ ..] | [0xFE, 0xFF, rest @ ..] = bytes {
        let little = bytes.first() == Some(&0xFF);
        let units = rest.as_chunks().0.iter().map(|pair| wide(pair, little));
        let text = char::decode_utf16(units).map(|c| c.unwrap_or('\u{fffd}'));
        return (text.collect(), false);
    }
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    match str::from_utf8(bytes) {
        Ok(text) => (text.to_owned(), false),
        // Each byte of Latin-1 is the character of the same number.
        Err(_) => (bytes.iter().map(|byte| char::from(*byte)).collect(), true),
    }
}

/// Its lines with their numbers, counted from 1.
pub fn lines(text: &str) -> impl Iterator<Item = (u32, Line)> + '_ {
    let numbered = (1..).zip(split(text));
    numbered.filter_map(|(number, line)| Some((number, meaning(line.trim())?)))
}

/// Splits at CR, LF and CR LF.
fn split(text: &str) -> impl Iterator<Item = &str> {
    let mut rest = Some(text);
    std::iter::from_fn(move || {
        let text = rest?;
        let Some(end) = text.find(['\r', '\n']) else {
            rest = None;
            return Some(text);
        };
        let (line, ending) = text.split_at(end);
        rest = Some(ending.strip_prefix("\r\n").unwrap_or_else(|| &ending[1..]));
        Some(line)
    })
}

fn meaning(line: &str) -> Option<Line> {
    if line.is_empty() || line.starts_with([';', '#']) || line.starts_with("//") {
        return None;
    }
    if let Some(name) = line.strip_prefix('[') {
        // A comment may follow; a bracket that is not closed is still one.
        let name = name.split(']').next().unwrap_or(name);
        return Some(Line::Section(name.trim().to_ascii_lowercase()));
    }
    Some(match line.split_once('=') {
        Some((key, value)) => Line::Key(key.trim().to_ascii_lowercase(), value.trim().to_owned()),
        None => Line::Neither,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_ends_of_every_kind_in_one_file() {
        let all: Vec<_> = lines("[A]\r\nb=1\rc = 2 \n\n;x\nd\n[e ;f").collect();
        let key = |key: &str, value: &str| Line::Key(key.into(), value.into());
        let want = [
            (1, Line::Section("a".into())),
            (2, key("b", "1")),
            (3, key("c", "2")),
            (6, Line::Neither),
            (7, Line::Section("e ;f".into())),
        ];
        assert_eq!(all, want);
    }

    #[test]
    fn bytes_of_every_kind_are_text() {
        assert_eq!(text(b"a"), ("a".into(), false));
        assert_eq!(text(b"\xEF\xBB\xBFa"), ("a".into(), false));
        assert_eq!(text("Gerät".as_bytes()), ("Gerät".into(), false));
        assert_eq!(text(b"Ger\xE4t"), ("Gerät".into(), true));
        assert_eq!(text(b"\xFF\xFEa\0=\0"), ("a=".into(), false));
        assert_eq!(text(b"\xFE\xFF\0a"), ("a".into(), false));
    }
}
