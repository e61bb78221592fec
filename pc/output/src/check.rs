//! Checks of pages, for the tests of those who make them.
//!
//! In: a page as a browser gets it. Out: a panic that says what is wrong with it. Left out: what is
//! written on it.

/// Elements that have no end tag.
const VOID: [&str; 1] = ["meta"];

/// Panics unless every tag that is opened is closed in order.
pub fn assert_balanced(html: &str) {
    let mut open: Vec<&str> = Vec::new();
    let body = html.strip_prefix("<!doctype html>").expect("a doctype");
    for piece in body.split('<').skip(1) {
        let (tag, _) = piece.split_once('>').expect("a tag that ends");
        let name = tag.split([' ', '/']).find(|part| !part.is_empty()).unwrap();
        if tag.starts_with('/') {
            assert_eq!(open.pop(), Some(name), "<{tag}>");
        } else if !tag.ends_with('/') && !VOID.contains(&name) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?}");
}

/// Panics when the page would fetch or run anything, or when two elements share an id.
pub fn assert_stands_alone(html: &str) {
    for fetch in [
        "http", "src=", "href=", "<script", "<link", "@import", "url(", "onload",
    ] {
        assert!(!html.contains(fetch), "{fetch}");
    }
    let ids = html
        .match_indices(" id=\"")
        .map(|(at, _)| html[at + 5..].split('"').next());
    let mut ids: Vec<_> = ids.collect();
    let count = ids.len();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), count, "an id is used twice");
}
