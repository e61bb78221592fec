//! Which file of a crate names items of which other one.
//!
//! In: the sources of one crate. Out: an [`Edge`] for each pair of files of which the first names
//! something that the second defines: by a `use`, or by a path in the code. A name that a module
//! only passes on (`pub use child::Item`) leads to the file that defines it. Declarations of
//! modules are no use, nor is anything in tests.
//!
//! Left out: names that come by a glob, which lead to the module, and what macros make.

use std::collections::{BTreeMap, BTreeSet};

use super::mask::in_word;
use super::source::{Source, words};

/// How often a name is followed from a module that passes it on to the next.
const HOPS: usize = 6;

/// One file names something of another one.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Edge {
    /// The file that names it.
    pub from: String,
    /// The file that defines it.
    pub to: String,
    /// The first line in `from` that does.
    pub line: usize,
}

/// A path from the root of the crate, and the name under which it is known; `*` for all names.
struct Import {
    name: String,
    path: Vec<String>,
}

/// One module with its file.
struct Module<'a> {
    source: &'a Source,
    imports: Vec<Import>,
}

/// The modules of a crate, by their paths from its root.
pub struct Modules<'a>(BTreeMap<Vec<String>, Module<'a>>);

impl<'a> Modules<'a> {
    /// Of these sources below the folder `src` of a crate, tests left out.
    pub fn of(src: &str, sources: &[&'a Source]) -> Self {
        let mut modules = BTreeMap::new();
        for source in sources {
            let path = module_path(src, &source.path);
            let module = Module {
                source,
                imports: Vec::new(),
            };
            modules.insert(path, module);
        }
        let mut modules = Self(modules);
        let imports: Vec<_> = modules
            .0
            .iter()
            .map(|(at, m)| modules.imports(at, m))
            .collect();
        for (module, imports) in modules.0.values_mut().zip(imports) {
            module.imports = imports;
        }
        modules
    }

    /// Every use of one file by another, each pair once.
    pub fn edges(&self) -> Vec<Edge> {
        let mut edges: BTreeMap<(String, String), usize> = BTreeMap::new();
        for (at, module) in &self.0 {
            for (position, path) in self.paths(at, module.source) {
                let Some(to) = self.file(&path, HOPS) else {
                    continue;
                };
                let from = &module.source.path;
                if to != from {
                    let line = module.source.line(position);
                    let known = edges.entry((from.clone(), to.to_owned())).or_insert(line);
                    *known = line.min(*known);
                }
            }
        }
        let edge = |((from, to), line)| Edge { from, to, line };
        edges.into_iter().map(edge).collect()
    }

    /// The file that defines what stands at a path of the crate.
    fn file(&self, path: &[String], hops: usize) -> Option<&str> {
        let known = (0..=path.len())
            .rev()
            .find(|n| self.0.contains_key(&path[..*n]))?;
        let module = &self.0[&path[..known]];
        let passed_on = path.get(known).and_then(|name| {
            let import = module.imports.iter().find(|import| import.name == *name)?;
            let rest = path[known + 1..].iter().cloned();
            let whole: Vec<_> = import.path.iter().cloned().chain(rest).collect();
            self.file(&whole, hops.checked_sub(1)?)
        });
        Some(passed_on.unwrap_or(&module.source.path))
    }

    fn imports(&self, at: &[String], module: &Module) -> Vec<Import> {
        let mut imports = Vec::new();
        for (position, text) in used(module.source) {
            for (words, name) in branches(text) {
                if let Some(path) = self.absolute(&inside(at, module.source, position), &words) {
                    imports.push(Import { name, path });
                }
            }
        }
        imports
    }

    /// All paths into the crate that a file names, outside tests.
    fn paths(&self, at: &[String], source: &Source) -> Vec<(usize, Vec<String>)> {
        let uses = used(source).into_iter().flat_map(|(position, text)| {
            branches(text)
                .into_iter()
                .map(move |(words, _)| (position, words))
        });
        let all = uses.chain(spelled(source));
        all.filter_map(|(position, words)| {
            let path = self.absolute(&inside(at, source, position), &words)?;
            Some((position, path))
        })
        .collect()
    }

    /// A path as it is written in the module `at`, from the root of the crate; `None` for one that
    /// leads out of the crate.
    fn absolute(&self, at: &[String], words: &[String]) -> Option<Vec<String>> {
        let (first, rest) = words.split_first()?;
        let mut base = match first.as_str() {
            "crate" => Vec::new(),
            "self" => at.to_vec(),
            "super" => at.split_last()?.1.to_vec(),
            name => {
                let child: Vec<_> = at.iter().cloned().chain([name.to_owned()]).collect();
                return self.0.contains_key(&child).then(|| [&child, rest].concat());
            }
        };
        let supers = rest.iter().take_while(|word| *word == "super").count();
        base.truncate(base.len().checked_sub(supers)?);
        base.extend(rest[supers..].iter().cloned());
        Some(base)
    }
}

/// The module that a file is, from the root of its crate.
fn module_path(src: &str, path: &str) -> Vec<String> {
    let inner = path
        .strip_prefix(src)
        .unwrap_or(path)
        .trim_start_matches('/');
    let mut words: Vec<_> = inner
        .trim_end_matches(".rs")
        .split('/')
        .map(str::to_owned)
        .collect();
    let last = words.last().map(String::as_str);
    if matches!(last, Some("mod")) || words.len() == 1 && matches!(last, Some("lib" | "main")) {
        words.pop();
    }
    words
}

/// The module at a position of the file `at`: that of the file, or one that is written inside it.
fn inside(at: &[String], source: &Source, position: usize) -> Vec<String> {
    let modules = words(&source.code, "mod").filter(|start| *start < position);
    let names = modules.filter_map(|start| {
        let rest = &source.code[start + "mod".len()..];
        let name: String = rest
            .trim_start()
            .chars()
            .take_while(|c| in_word(*c))
            .collect();
        let open = rest
            .find(['{', ';'])
            .filter(|at| rest[*at..].starts_with('{'))?;
        let end = closing(rest, open)?;
        (position < start + "mod".len() + end).then_some(name)
    });
    at.iter().cloned().chain(names).collect()
}

/// Where the bracket that opens at `open` closes.
fn closing(code: &str, open: usize) -> Option<usize> {
    let mut depth = 0_usize;
    for (at, sign) in code[open..].char_indices() {
        match sign {
            '{' => depth += 1,
            '}' => depth -= 1,
            _ => {}
        }
        if depth == 0 {
            return Some(open + at);
        }
    }
    None
}

/// The `use` declarations outside tests: where, and what stands between the word and the `;`.
fn used(source: &Source) -> Vec<(usize, &str)> {
    let code = &source.code;
    let starts = words(code, "use").filter(|at| !source.is_test(*at));
    let declarations = starts.filter_map(|at| {
        let rest = &code[at + "use".len()..];
        Some((at, rest[..rest.find(';')?].trim()))
    });
    declarations.collect()
}

/// The paths of a tree of uses, each with the name that it brings.
fn branches(tree: &str) -> Vec<(Vec<String>, String)> {
    let mut found = Vec::new();
    branch(tree, &[], &mut found);
    found
}

fn branch(tree: &str, before: &[String], found: &mut Vec<(Vec<String>, String)>) {
    let Some((stem, list)) = tree.split_once('{') else {
        let (path, alias) = tree.split_once(" as ").unwrap_or((tree, ""));
        let mut words: Vec<_> = before.iter().cloned().chain(segments(path)).collect();
        if words.last().is_some_and(|word| word == "self") && words.len() > 1 {
            words.pop();
        }
        let own = words.last().cloned().unwrap_or_default();
        let name = if alias.is_empty() {
            own
        } else {
            alias.trim().to_owned()
        };
        if words.last().is_some_and(|word| word == "*") {
            words.pop();
        }
        found.push((words, name));
        return;
    };
    let before: Vec<_> = before.iter().cloned().chain(segments(stem)).collect();
    let list = list.trim_end().strip_suffix('}').unwrap_or(list);
    for part in split_list(list) {
        branch(part, &before, found);
    }
}

/// The parts of a list with commas, brackets kept whole.
fn split_list(list: &str) -> Vec<&str> {
    let (mut depth, mut start, mut parts) = (0, 0, Vec::new());
    for (at, sign) in list.char_indices() {
        match sign {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&list[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&list[start..]);
    parts
        .into_iter()
        .map(str::trim)
        .filter(|part| !part.is_empty())
        .collect()
}

fn segments(path: &str) -> impl Iterator<Item = String> + '_ {
    let words = path
        .split("::")
        .map(str::trim)
        .filter(|word| !word.is_empty());
    words.map(str::to_owned)
}

/// The paths that stand in the code itself, outside tests and uses: `a::b::c`.
fn spelled(source: &Source) -> Vec<(usize, Vec<String>)> {
    let code = &source.code;
    let uses: BTreeSet<_> = used(source)
        .into_iter()
        .map(|(at, text)| (at, text.len()))
        .collect();
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(start) = code[at..].find("::").map(|next| at + next) {
        let first = code[..start]
            .rfind(|c: char| !in_word(c))
            .map_or(0, |before| before + 1);
        let rest = code[first..].find(|c: char| !in_word(c) && c != ':');
        let end = rest
            .map_or(code.len(), |length| first + length)
            .max(start + 2);
        let is_use = uses
            .iter()
            .any(|(use_at, length)| (*use_at..use_at + length + 8).contains(&first));
        let goes_on = code[..first].ends_with("::");
        if !is_use && !goes_on && !source.is_test(first) {
            found.push((first, segments(&code[first..end]).collect()));
        }
        at = end;
    }
    found
}
