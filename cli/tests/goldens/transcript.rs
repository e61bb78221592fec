//! Runs of the program as text: the line typed, what it printed, and its exit status.
//!
//! In: commands, and files that they wrote. Out: one text that reads like a session in a terminal.
//! JSON is broken into lines, in its order and with its numbers as they are printed.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::process::{Command, Output};

/// Several runs, one behind the other.
#[derive(Default)]
pub struct Transcript {
    /// What there is so far.
    pub text: String,
}

impl Transcript {
    /// Runs a command to its end and adds what it printed.
    pub fn run(&mut self, command: &mut Command) -> &mut Self {
        let output = command.output().unwrap();
        self.ended(command, &output)
    }

    /// Adds what a command printed that has ended.
    pub fn ended(&mut self, command: &Command, output: &Output) -> &mut Self {
        let typed: Vec<_> = command.get_args().map(quoted).collect();
        let (out, err) = (text(&output.stdout), text(&output.stderr));
        writeln!(self.text, "$ plumb {}", typed.join(" ")).unwrap();
        self.text += &printed(&out);
        if !err.is_empty() {
            self.text += &format!("[standard error]\n{err}");
        }
        let status = output.status.code();
        let status = status.map_or("a signal".to_owned(), |status| status.to_string());
        writeln!(self.text, "[status {status}]\n").unwrap();
        self
    }

    /// Adds a part of its own, such as a file that a run wrote.
    pub fn part(&mut self, title: &str, text: &str) -> &mut Self {
        write!(self.text, "[{title}]\n{}\n", printed(text)).unwrap();
        self
    }
}

/// What a program printed, which is UTF-8.
pub fn text(bytes: &[u8]) -> String {
    let text = String::from_utf8(bytes.to_vec()).unwrap();
    match text.is_empty() || text.ends_with('\n') {
        true => text,
        false => text + "\n[no line end]\n",
    }
}

fn quoted(word: &OsStr) -> String {
    let word = word.to_str().unwrap();
    match word.is_empty() || word.contains([' ', '\n']) {
        true => format!("'{word}'"),
        false => word.to_owned(),
    }
}

/// Lines of JSON in their long form, all others as they are.
fn printed(text: &str) -> String {
    let whole: Result<serde_json::Value, _> = serde_json::from_str(text);
    if text.starts_with('{') && whole.is_ok() && text.lines().count() > 1 {
        return text.to_owned();
    }
    let lines = text.lines().map(|line| match line.starts_with('{') {
        true => long(line) + "\n",
        false => format!("{line}\n"),
    });
    lines.collect()
}

/// A line of JSON with a line for each member; lists of plain values stay in one line.
fn long(json: &str) -> String {
    let (mut out, mut depth, mut quoted, mut escaped, mut flat) =
        (String::new(), 0, false, false, 0);
    for (at, character) in json.char_indices() {
        let line = |depth: usize| format!("\n{}", "  ".repeat(depth));
        match character {
            _ if quoted => {
                out.push(character);
                quoted = escaped || character != '"';
                escaped = character == '\\' && !escaped;
            }
            '[' if flat > 0 || is_plain(&json[at + 1..]) => (out, flat) = (out + "[", flat + 1),
            ']' if flat > 0 => (out, flat) = (out + "]", flat - 1),
            '{' | '[' => {
                depth += 1;
                out = out + &character.to_string() + &line(depth);
            }
            '}' | ']' => {
                depth -= 1;
                out = out + &line(depth) + &character.to_string();
            }
            ',' if flat == 0 => out = out + "," + &line(depth),
            ',' | ':' => out = out + &character.to_string() + " ",
            _ => {
                quoted = character == '"';
                out.push(character);
            }
        }
    }
    out
}

/// True when a list has no list and no object in it; `rest` is what is behind its bracket.
fn is_plain(rest: &str) -> bool {
    rest.find(['[', '{', ']'])
        .is_none_or(|at| rest[at..].starts_with(']'))
}

#[test]
fn json_is_broken_into_lines_and_nothing_else() {
    let told = long(r#"{"a":[1,2.0],"b":[{"c":"x,\"{"}],"d":{}}"#);
    let lines = "{\n  \"a\": [1, 2.0],\n  \"b\": [\n    {\n      \"c\": \"x,\\\"{\"\n    }\n  ],\n\
                 \u{20} \"d\": {\n    \n  }\n}";
    assert_eq!(told, lines);
    let nothing_lost = told.replace(['\n', ' '], "");
    assert_eq!(nothing_lost, r#"{"a":[1,2.0],"b":[{"c":"x,\"{"}],"d":{}}"#);
}
