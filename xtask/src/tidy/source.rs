//! One Rust file as the rules see it: its code, which lines are tests, its functions.
//!
//! In: path and text. Out: positions are byte offsets into the masked text, lines count from 1.
//! This is a scanner, not a parser: it finds brackets, attributes and items by their keywords,
//! which is enough because the tree is formatted by rustfmt and compiles.

use std::collections::BTreeSet;
use std::ops::Range;

use super::mask::{in_word, mask};

/// A Rust file, masked, with its test parts found.
pub struct Source {
    /// From the root, with `/`.
    pub path: String,
    /// As written.
    pub text: String,
    /// The same lines with comments and literals blanked.
    pub code: String,
    /// The items under `#[cfg(test)]`.
    pub tests: Vec<Range<usize>>,
}

/// A function and its extent.
#[derive(Debug, PartialEq, Eq)]
pub struct Function {
    /// Its name, without the path.
    pub name: String,
    /// The line of `fn`.
    pub line: usize,
    /// Lines from `fn` to the closing brace, both counted.
    pub lines: usize,
}

impl Source {
    /// Masks and indexes a file.
    pub fn new(path: &str, text: &str) -> Self {
        let code = mask(text);
        let tests = attributes(&code, "#[cfg(test)]")
            .map(|at| at..item_end(&code, at))
            .collect();
        Self {
            path: path.to_string(),
            text: text.to_string(),
            code,
            tests,
        }
    }

    /// The line a position is on.
    pub fn line(&self, at: usize) -> usize {
        self.code[..at].matches('\n').count() + 1
    }

    /// Whether a position is inside an item under `#[cfg(test)]`.
    pub fn is_test(&self, at: usize) -> bool {
        self.tests.iter().any(|range| range.contains(&at))
    }

    /// Lines that hold code outside the test items.
    pub fn code_lines(&self) -> usize {
        let mut start = 0;
        let mut count = 0;
        for line in self.code.split_inclusive('\n') {
            let code_at = start + (line.len() - line.trim_start().len());
            if !line.trim().is_empty() && !self.is_test(code_at) {
                count += 1;
            }
            start += line.len();
        }
        count
    }

    /// Every function with a body, tests and nested ones too.
    pub fn functions(&self) -> Vec<Function> {
        self.functions_at(|_| true)
    }

    /// The same without those of tests.
    pub fn functions_outside_tests(&self) -> Vec<Function> {
        self.functions_at(|at| !self.is_test(at))
    }

    /// Those whose position is wanted.
    fn functions_at(&self, wanted: impl Fn(usize) -> bool) -> Vec<Function> {
        words(&self.code, "fn")
            .filter(|at| wanted(*at))
            .filter_map(|at| self.function(at))
            .collect()
    }

    fn function(&self, at: usize) -> Option<Function> {
        let name = name_after(&self.code, at + "fn".len())?;
        let end = item_end(&self.code, at);
        if !self.code[at..end].ends_with('}') {
            return None;
        }
        let lines = self.code[at..end].matches('\n').count() + 1;
        Some(Function {
            name: name.to_string(),
            line: self.line(at),
            lines,
        })
    }

    /// The item that opens with `heading`, such as `pub struct Verdict`, up to its end.
    pub fn item(&self, heading: &str) -> Option<(usize, &str)> {
        let at = words(&self.code, heading).next()?;
        Some((at, &self.code[at..item_end(&self.code, at)]))
    }

    /// The names of the functions marked `#[test]`.
    pub fn test_names(&self) -> BTreeSet<String> {
        let after = |at: usize| {
            let function = at + words(&self.code[at..], "fn").next()?;
            name_after(&self.code, function + "fn".len()).map(str::to_string)
        };
        attributes(&self.code, "#[test]")
            .filter_map(after)
            .collect()
    }

    /// The modules declared under `#[cfg(test)]` that live in files of their own.
    pub fn test_modules(&self) -> Vec<&str> {
        let items = self.tests.iter().map(|range| &self.code[range.clone()]);
        let declared = items.filter_map(|item| item.trim_end().strip_suffix(';'));
        declared
            .filter_map(|item| {
                let at = words(item, "mod").next()?;
                name_after(item, at + "mod".len())
            })
            .collect()
    }

    /// The files, beside this one, that modules under `#[cfg(test)]` are read from by
    /// `#[path = "..."]`.
    pub fn test_files(&self) -> Vec<&str> {
        let items = self.tests.iter().map(|range| &self.text[range.clone()]);
        let named = items.filter_map(|item| item.split_once("#[path = \"")?.1.split_once('"'));
        named.map(|(file, _)| file).collect()
    }

    /// The parts the compiler evaluates: `const NAME: T = ...;` and `const { ... }`.
    pub fn constants(&self) -> Vec<Range<usize>> {
        words(&self.code, "const")
            .filter_map(|at| constant(&self.code, at))
            .collect()
    }
}

fn constant(code: &str, at: usize) -> Option<Range<usize>> {
    if code[..at].trim_end().ends_with(['<', ',', '*']) {
        return None; // a generic parameter or a pointer
    }
    let rest = &code[at + "const".len()..];
    if rest.trim_start().starts_with('{') {
        return Some(at..item_end(code, at));
    }
    let name = name_after(rest, 0)?;
    let after = rest.trim_start().strip_prefix(name)?.trim_start();
    after.starts_with(':').then(|| at..statement_end(code, at))
}

/// Where an attribute, exactly as written, stands in the code.
fn attributes<'a>(code: &'a str, attribute: &'a str) -> impl Iterator<Item = usize> + 'a {
    code.match_indices(attribute).map(|(at, _)| at)
}

/// Where a text stands in the code as a word of its own, not as part of a longer one. A lifetime
/// counts as longer: `'static` is not the word `static`.
pub fn words<'a>(code: &'a str, word: &'a str) -> impl Iterator<Item = usize> + 'a {
    let joins = |edge: Option<char>, beside: Option<char>| {
        edge.is_some_and(in_word) && beside.is_some_and(|c| in_word(c) || c == '\'')
    };
    code.match_indices(word)
        .map(|(at, _)| at)
        .filter(move |&at| {
            let before = code[..at].chars().next_back();
            let after = code[at + word.len()..].chars().next();
            !joins(word.chars().next(), before) && !joins(word.chars().next_back(), after)
        })
}

/// The identifier that comes next, if one does.
fn name_after(code: &str, at: usize) -> Option<&str> {
    let rest = code[at..].trim_start();
    let name = &rest[..rest.find(|c| !in_word(c)).unwrap_or(rest.len())];
    (!name.is_empty()).then_some(name)
}

/// One past the `}` or `;` that ends the item starting at `at`; attributes before it are skipped.
fn item_end(code: &str, at: usize) -> usize {
    end(code, at, true)
}

/// One past the `;` that ends the statement starting at `at`, whatever blocks stand in it.
fn statement_end(code: &str, at: usize) -> usize {
    end(code, at, false)
}

fn end(code: &str, at: usize, block_ends: bool) -> usize {
    let mut depth = 0_i32;
    for (offset, character) in code[at..].char_indices() {
        match character {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            _ => {}
        }
        let closed = character == ';' || (block_ends && character == '}');
        if depth < 0 || (depth == 0 && closed) {
            return at + offset + character.len_utf8();
        }
    }
    code.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(text: &str) -> Source {
        Source::new("tilt/src/x.rs", text)
    }

    #[test]
    fn functions_are_measured_from_fn_to_brace() {
        let text = "fn a(f: fn(u8) -> u8) -> [u8; 3] {\n    { }\n}\ntrait T { fn b(); }\n";
        let expected = Function {
            name: "a".into(),
            line: 1,
            lines: 3,
        };
        assert_eq!(source(text).functions(), vec![expected]);
    }

    #[test]
    fn nested_functions_are_found_too() {
        let found = source("fn a() {\n    fn b() {}\n}\n").functions();
        let names: Vec<_> = found.iter().map(|f| (f.name.as_str(), f.lines)).collect();
        assert_eq!(names, vec![("a", 3), ("b", 1)]);
    }

    #[test]
    fn test_items_are_not_counted_as_code() {
        let text = "//! x\n\nfn a() {\n}\n#[cfg(test)]\nmod tests {\n    fn b() {}\n}\nfn c() {}\n";
        let source = source(text);
        assert_eq!(source.code_lines(), 3);
        assert!(source.is_test(source.code.find("fn b").expect("b")));
        assert!(!source.is_test(source.code.find("fn c").expect("c")));
    }

    #[test]
    fn test_names_need_the_attribute() {
        let text = "#[test]\n#[ignore]\nfn yes() {}\nfn no() {}\n// #[test]\n";
        assert_eq!(
            source(text).test_names().into_iter().collect::<Vec<_>>(),
            vec!["yes"]
        );
    }

    #[test]
    fn test_modules_in_their_own_files_are_named() {
        let text = "#[cfg(test)]\nmod tests;\n#[cfg(test)]\nextern crate std;\nmod real;\n";
        assert_eq!(source(text).test_modules(), vec!["tests"]);
    }

    #[test]
    fn files_of_tests_behind_a_path_were_counted_as_code() {
        let text = "// é\n#[cfg(test)]\n#[path = \"x_tests.rs\"]\nmod tests;\nmod real;\n";
        assert_eq!(source(text).test_files(), vec!["x_tests.rs"]);
    }

    #[test]
    fn constants_are_told_from_const_functions_and_generics() {
        let text = "const A: u8 = { 1; 2 };\nconst fn b() {}\nstruct S<const N: usize>;\n\
                    fn c(p: *const u8) { const { assert!(true) } }\n";
        let source = source(text);
        let found: Vec<_> = source
            .constants()
            .into_iter()
            .map(|range| &source.code[range])
            .collect();
        assert_eq!(
            found,
            vec!["const A: u8 = { 1; 2 };", "const { assert!(true) }"]
        );
    }

    #[test]
    fn words_stand_alone() {
        assert_eq!(
            words("debug_assert!(x); assert!(y)", "assert!(").collect::<Vec<_>>(),
            vec![18]
        );
        assert_eq!(
            words("unsafe_code unsafe", "unsafe").collect::<Vec<_>>(),
            vec![12]
        );
        assert_eq!(
            words("&'static str; static X", "static").collect::<Vec<_>>(),
            vec![14]
        );
        assert_eq!(words("core::std::x", "std::").count(), 1);
        assert_eq!(words("a.unwrap()", ".unwrap()").count(), 1);
    }
}
