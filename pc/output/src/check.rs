//! Checks of pages and of JSON, for the tests of those who make them.
//!
//! In: a page as a browser gets it. Out: a panic that states what is wrong with it. Or in: what is
//! written as JSON, and the document that describes it. Out: the keys that each of them has.
//!
//! Left out: what is written on a page.

use std::collections::BTreeSet;

use serde::Serialize;
use serde_json::Value;

/// Every key of what is written as JSON, at any depth.
pub fn keys(written: &impl Serialize) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    gather(&as_written(written), &mut found);
    found
}

/// What is written as JSON, as a reader finds it.
pub fn as_written(written: &impl Serialize) -> Value {
    serde_json::from_str(&text(written)).expect("JSON")
}

/// The text of what is written as JSON.
pub fn text(written: &impl Serialize) -> String {
    crate::json::to_lines(written).expect("a value that JSON has")
}

fn gather(value: &Value, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(fields) => fields.iter().for_each(|(key, value)| {
            found.insert(key.clone());
            gather(value, found);
        }),
        Value::Array(items) => items.iter().for_each(|item| gather(item, found)),
        _ => {}
    }
}

/// The names in the first column of a document's tables, which stand there as code.
pub fn documented(document: &str) -> BTreeSet<String> {
    let rows = document.lines().filter_map(|line| line.strip_prefix("| `"));
    rows.filter_map(|row| row.split_once('`'))
        .map(|(name, _)| name.to_owned())
        .collect()
}

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
