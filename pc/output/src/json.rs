//! JSON with one row per line.
//!
//! In: anything that serde writes. Out: text in which the fields, and the rows of the lists in
//! them, stand on lines of their own, but what is inside a row does not. So a person can read the
//! rows and compare two files, and a series of 600 points is one line instead of 2400. And
//! [`object`](crate::object), for what is JSON and nothing else.

use std::io::{self, Write};

use serde::Serialize;
use serde_json::ser::{Formatter, Serializer};

/// A JSON object whose fields are named where their values are formed, in this order: for what is
/// written as JSON and read by nothing else, so that it needs no struct.
#[macro_export]
macro_rules! object {
    ($($name:ident: $value:expr),+ $(,)?) => {{
        // Each field has a type of its own, by the field's name.
        #[allow(non_camel_case_types)]
        mod object {
            #[derive(serde::Serialize)]
            pub struct Object<$($name),+> { $(pub $name: $name),+ }
        }
        object::Object { $($name: $value),+ }
    }};
}

/// Values nested deeper than this stay on the line of their parent.
const BROKEN: usize = 2;

/// The value as JSON text, ended by a line feed.
pub fn to_lines(value: &impl Serialize) -> serde_json::Result<String> {
    let mut bytes = Vec::new();
    value.serialize(&mut Serializer::with_formatter(
        &mut bytes,
        Lines::default(),
    ))?;
    bytes.push(b'\n');
    // serde_json writes UTF-8 only.
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// How deep the writer is, and whether anything stands in the innermost bracket.
#[derive(Default)]
struct Lines {
    depth: usize,
    filled: bool,
}

impl Lines {
    fn open<W: ?Sized + Write>(&mut self, out: &mut W, bracket: &[u8]) -> io::Result<()> {
        self.depth += 1;
        self.filled = false;
        out.write_all(bracket)
    }

    fn close<W: ?Sized + Write>(&mut self, out: &mut W, bracket: &[u8]) -> io::Result<()> {
        self.depth = self.depth.saturating_sub(1);
        if self.filled && self.depth < BROKEN {
            self.new_line(out)?;
        }
        self.filled = true;
        out.write_all(bracket)
    }

    fn item<W: ?Sized + Write>(&mut self, out: &mut W, first: bool) -> io::Result<()> {
        if !first {
            out.write_all(b",")?;
        }
        if self.depth <= BROKEN {
            self.new_line(out)?;
        } else if !first {
            out.write_all(b" ")?;
        }
        self.filled = true;
        Ok(())
    }

    fn new_line<W: ?Sized + Write>(&self, out: &mut W) -> io::Result<()> {
        out.write_all(b"\n")?;
        (0..self.depth).try_for_each(|_| out.write_all(b"  "))
    }
}

impl Formatter for Lines {
    fn begin_array<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.open(out, b"[")
    }

    fn end_array<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.close(out, b"]")
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, out: &mut W, first: bool) -> io::Result<()> {
        self.item(out, first)
    }

    fn begin_object<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.open(out, b"{")
    }

    fn end_object<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        self.close(out, b"}")
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, out: &mut W, first: bool) -> io::Result<()> {
        self.item(out, first)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, out: &mut W) -> io::Result<()> {
        out.write_all(b": ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_stand_on_lines_of_their_own() {
        let value = serde_json::json!({"a": [{"b": [1, 2], "c": null}, {}], "d": [], "e": 1.5});
        let expected = r#"{
  "a": [
    {"b": [1, 2], "c": null},
    {}
  ],
  "d": [],
  "e": 1.5
}
"#;
        assert_eq!(to_lines(&value).unwrap(), expected);
    }

    #[test]
    fn an_object_has_its_fields_in_the_order_in_which_they_stand() {
        let node = |id: u8| object! { node_id: id, seen: id > 1 };
        let all = object! { format: "f", nodes: [node(1), node(2)], export: None::<u8> };
        let expected = concat!(
            r#"{"format":"f","nodes":[{"node_id":1,"seen":false},"#,
            r#"{"node_id":2,"seen":true}],"export":null}"#
        );
        assert_eq!(serde_json::to_string(&all).unwrap(), expected);
    }

    #[test]
    fn the_text_means_the_same_as_compact_json() {
        let report = serde_json::json!({"a": [{"b": [1, {"c": [[]]}]}, 2], "d": {"e": {"f": "g"}}});
        let value: serde_json::Value = serde_json::from_str(&to_lines(&report).unwrap()).unwrap();
        let compact = serde_json::to_string(&report).unwrap();
        assert_eq!(
            value,
            serde_json::from_str::<serde_json::Value>(&compact).unwrap()
        );
    }
}
