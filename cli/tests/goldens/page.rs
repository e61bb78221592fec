//! What a reader sees of a page of HTML or XML.
//!
//! In: the page. Out: its text, a line for each block and each row of a table, the number of
//! elements of each kind, which shows a lost chart, and a hash, which shows everything else.
//!
//! Left out: the style sheet and scripts, and where in a chart something stands; only the hash has
//! them.

use std::collections::BTreeMap;

/// Elements whose content nobody reads.
const UNSEEN: [&str; 2] = ["style", "script"];

/// Elements that go on in the line that they stand in.
const INLINE: [&str; 10] = [
    "td", "th", "dt", "dd", "span", "a", "b", "sub", "sup", "code",
];

/// The text of a page that is the same in each run, and the hash of its bytes.
pub fn seen(page: &str) -> String {
    let hash = hmac_sha256::Hash::hash(page.as_bytes());
    let hash: String = hash.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("{}SHA-256 of the page: {hash}\n", text(page))
}

/// The text of a page, and how many elements of each kind it has.
pub fn text(page: &str) -> String {
    let (mut lines, mut line, mut unseen) = (String::new(), String::new(), false);
    let mut elements = BTreeMap::<&str, usize>::new();
    for piece in page.split('<').skip(1) {
        let (tag, text) = piece.split_once('>').unwrap_or((piece, ""));
        let name = tag
            .split([' ', '\n', '/'])
            .find(|name| !name.is_empty())
            .unwrap_or("");
        if !tag.starts_with('/') {
            *elements.entry(name).or_default() += 1;
        }
        if UNSEEN.contains(&name) {
            unseen = !tag.starts_with('/');
        }
        if !INLINE.contains(&name) {
            lines += &ended(&mut line);
        } else if !tag.starts_with('/') && ["td", "th", "dd"].contains(&name) {
            line += " | ";
        }
        if !unseen {
            line += &text.split_whitespace().collect::<Vec<_>>().join(" ");
        }
    }
    lines += &ended(&mut line);
    let elements: Vec<_> = elements
        .iter()
        .map(|(name, count)| format!("{name} {count}"))
        .collect();
    format!("{lines}elements: {}\n", elements.join(", "))
}

/// The line with its end, unless nothing is in it; and a new one.
fn ended(line: &mut String) -> String {
    let line = std::mem::take(line);
    match line.trim() {
        "" => String::new(),
        seen => format!("{seen}\n"),
    }
}

#[test]
fn a_row_is_a_line_and_a_style_is_none() {
    let page =
        "<html><style>p {}</style><h1>Title</h1><tr><td>1</td><td>a &amp; b</td></tr></html>";
    let elements = "elements: h1 1, html 1, style 1, td 2, tr 1\n";
    assert_eq!(text(page), format!("Title\n| 1 | a &amp; b\n{elements}"));
}
