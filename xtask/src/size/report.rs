//! The figures of `cargo xtask size`: as a table, as a document, against their budgets.
//!
//! In: the two binaries as they were linked. Out: text.
//!
//! Left out: how the figures are found (`image`).

use std::collections::BTreeMap;
use std::fmt::Write;

use super::TOLERANCE_PERCENT;
use super::image::Image;
use crate::difference;

/// Bytes of code and tables that the stack with the whole dictionary may take.
const FLASH: u64 = 24 * 1024;
/// Bytes of state, with the values behind the rows.
const RAM: u64 = 4 * 1024;
/// Bytes of the largest stack frame of one function.
const FRAME: u64 = 1024;

/// Lines of each list of [`details`].
const LISTED: usize = 40;

/// One figure of both binaries.
struct Figure {
    name: &'static str,
    /// Stack, then the whole bus side.
    bytes: [u64; 2],
    /// What is allowed, for each.
    budget: [Option<u64>; 2],
}

/// All figures.
pub struct Figures {
    compiler: String,
    figures: Vec<Figure>,
}

fn state(image: &Image, name: &str) -> u64 {
    let rooms = image.statics.iter();
    let rooms = rooms.filter(|(object, _)| object.contains("RAM_OF_") && object.contains(name));
    rooms.map(|(_, bytes)| bytes).sum()
}

fn code(image: &Image) -> u64 {
    image.section(".text")
}

/// Copying, clearing and long division: a firmware has them anyway.
fn library(image: &Image) -> u64 {
    let functions = image.functions.values();
    let library = functions
        .filter(|f| f.name.starts_with("compiler_builtins::") || f.name.starts_with("__aeabi_"));
    library.map(|f| f.size).sum()
}

/// Constants; `.reached` is the measurement's own.
fn tables(image: &Image) -> u64 {
    image.section(".rodata") + image.section(".data")
}

fn ram(image: &Image) -> u64 {
    state(image, "") + image.section(".data") + image.section(".bss")
}

fn largest_frame(image: &Image) -> u64 {
    let frames = image.functions.values().map(|f| u64::from(f.frame.bytes));
    frames.max().unwrap_or(0)
}

impl Figures {
    /// From what was linked, by the compiler that reports `version` of itself.
    pub fn new(version: &str, stack: &Image, instrument: &Image) -> Self {
        let figure = |name, of: fn(&Image) -> u64, budget| Figure {
            name,
            bytes: [of(stack), of(instrument)],
            budget,
        };
        let figures = vec![
            figure("code", code, [None; 2]),
            figure("of it, the compiler's library", library, [None; 2]),
            figure("tables", tables, [None; 2]),
            figure(
                "code and tables",
                |image| code(image) + tables(image),
                [Some(FLASH), None],
            ),
            figure("state of the node", |i| state(i, "NODE"), [None; 2]),
            figure("values behind the rows", |i| state(i, "VALUES"), [None; 2]),
            figure("RAM", ram, [Some(RAM); 2]),
            figure("largest stack frame", largest_frame, [Some(FRAME), None]),
            figure("deepest call", |i| u64::from(i.deepest().0), [None; 2]),
        ];
        Self {
            compiler: version.split(' ').take(2).collect::<Vec<_>>().join(" "),
            figures,
        }
    }

    /// The figures in columns.
    pub fn table(&self) -> String {
        let mut text = format!(
            "{:<32}{:>12}{:>12}{:>12}\n",
            "bytes", "stack", "bus side", "budget"
        );
        for figure in &self.figures {
            let [stack, whole] = figure.bytes;
            let budget = budget_text(figure);
            let _ = writeln!(
                text,
                "{:<32}{stack:>12}{whole:>12}{budget:>12}",
                figure.name
            );
        }
        text
    }

    /// Errors: the figures that are above their budgets.
    pub fn within_budgets(&self) -> Result<(), Vec<String>> {
        let mut over = Vec::new();
        for figure in &self.figures {
            for (bytes, budget) in figure.bytes.iter().zip(figure.budget) {
                if let Some(budget) = budget.filter(|budget| bytes > budget) {
                    over.push(format!("{}: {bytes} of {budget} bytes", figure.name));
                }
            }
        }
        over.dedup();
        if over.is_empty() { Ok(()) } else { Err(over) }
    }

    /// `docs/size.md`.
    pub fn document(&self) -> String {
        let mut text = String::from(OPENING);
        let _ = writeln!(text, "Compiler: {}.\n", self.compiler);
        text.push_str("| Bytes | Stack | Bus side | Budget |\n|---|---:|---:|---:|\n");
        for figure in &self.figures {
            let [stack, whole] = figure.bytes;
            let budget = budget_text(figure);
            let _ = writeln!(text, "| {} | {stack} | {whole} | {budget} |", figure.name);
        }
        text.push_str(CLOSING);
        text
    }
}

const OPENING: &str = "\
# Size on the part

For those who need the flash and RAM of the bus side. Written by `cargo xtask size --write`;
`cargo xtask test` compares it with what the code gives.

Linked for `thumbv7m-none-eabi` (Cortex-M3) with the workspace's profile `footprint`: optimised for
size, across all crates, without debug information. A panic cannot be reached from either binary:
the linker refuses one from which it can.

";

const CLOSING: &str = "
- **Stack**: the whole CANopen stack with the instrument's object dictionary, over a device that is
  reached through pointers.
- **Bus side**: the same with everything behind the rows: slopes, settings, calibration over the
  bus, program download, and the arithmetic of the chain that these need. Memory and sensor are
  reached through pointers.
- **RAM** is what a node keeps from one call to the next. The work space of a calibration run and
  the calibration in force belong to the channel and are not in it.
- **Largest stack frame** is read off the instructions of each function; **deepest call** adds
  frames along direct calls. What lies behind pointers is not in it. The budget is the stack's:
  a calibration run over the bus handles tables of 1.4 kB each, once in an instrument's life.
- **The compiler's library** copies, clears and divides. It counts here, though a firmware has it
  anyway.
";

/// Budgets of both columns where they are the same, and of the first alone otherwise.
fn budget_text(figure: &Figure) -> String {
    let [stack, _] = figure.budget;
    stack.map_or_else(|| "-".to_string(), |bytes| bytes.to_string())
}

/// Whether a committed document still tells the figures.
///
/// Errors: the difference, when a number is off by more than the tolerance or a word by anything.
/// A document of another compiler is not compared, since every compiler gives other figures.
pub fn compare(committed: &str, generated: &str) -> Result<(), String> {
    let compiler = |text: &str| {
        let mut lines = text.lines();
        lines
            .find(|line| line.starts_with("Compiler: "))
            .map(str::to_string)
    };
    if compiler(committed).is_some() && compiler(committed) != compiler(generated) {
        return Ok(());
    }
    let [old, new] = [committed, generated].map(|text| text.split_whitespace().collect::<Vec<_>>());
    if old.len() == new.len() && old.iter().zip(&new).all(|(old, new)| alike(old, new)) {
        return Ok(());
    }
    Err(difference::between(committed, generated))
}

fn alike(old: &str, new: &str) -> bool {
    match (old.parse::<u64>(), new.parse::<u64>()) {
        (Ok(old), Ok(new)) => 100 * old.abs_diff(new) <= TOLERANCE_PERCENT * old,
        _ => old == new,
    }
}

/// Where the bytes are: crates, modules, the largest functions, constants, statics and frames, and
/// the deepest call.
pub fn details(image: &Image) -> String {
    let functions = image.functions.values();
    let sizes = functions.clone().map(|f| (f.name.clone(), f.size));
    let frames = functions.map(|f| (f.name.clone(), u64::from(f.frame.bytes)));
    let [constants, statics] = [&image.constants, &image.statics].map(|all| all.iter().cloned());
    let mut text = String::new();
    list(&mut text, "flash", flash(image).into_iter());
    list(&mut text, "code by crate", by_path(image, 1).into_iter());
    list(&mut text, "code by module", by_path(image, 2).into_iter());
    list(&mut text, "largest functions", sizes);
    list(&mut text, "largest constants", constants);
    list(&mut text, "largest statics", statics);
    list(&mut text, "largest stack frames", frames);
    let (bytes, way) = image.deepest();
    let _ = writeln!(text, "  deepest call, {bytes} bytes");
    for name in way {
        let _ = writeln!(text, "            {name}");
    }
    let indirect: u32 = image.functions.values().map(|f| f.frame.indirect).sum();
    let _ = writeln!(text, "  calls through pointers, not followed: {indirect}");
    text
}

/// What is flashed, and what it consists of. Padding, literals between functions and functions
/// without a size are in the section of code and in no function.
fn flash(image: &Image) -> Vec<(String, u64)> {
    let functions: u64 = image.functions.values().map(|f| f.size).sum();
    let parts = [
        ("vectors", image.section(".vector_table")),
        ("code by functions", functions),
        ("code between them", code(image).saturating_sub(functions)),
        ("constants", image.section(".rodata")),
        ("values that statics begin with", image.section(".data")),
    ];
    let sum = parts.iter().map(|(_, bytes)| bytes).sum();
    let parts = parts.map(|(name, bytes)| (name.to_owned(), bytes));
    core::iter::once(("in all".to_owned(), sum))
        .chain(parts)
        .collect()
}

fn list(text: &mut String, title: &str, entries: impl Iterator<Item = (String, u64)>) {
    let mut entries: Vec<_> = entries.collect();
    entries.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    let _ = writeln!(text, "  {title}");
    for (name, bytes) in entries.iter().take(LISTED) {
        let _ = writeln!(text, "  {bytes:>8}  {name}");
    }
}

/// Bytes of code by the first `parts` of the path. What was built into its caller counts there.
fn by_path(image: &Image, parts: usize) -> BTreeMap<String, u64> {
    let mut sums = BTreeMap::new();
    for function in image.functions.values() {
        // A function of the linker, of assembly or of C has no path.
        let path = match function.name.trim_start_matches('<') {
            path if path.contains("::") => path,
            _ => "without a path",
        };
        let first: Vec<&str> = path.split("::").take(parts).collect();
        *sums.entry(first.join("::")).or_default() += function.size;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(bytes: u64) -> Figures {
        Figures {
            compiler: "rustc 1.0.0".to_string(),
            figures: vec![Figure {
                name: "code and tables",
                bytes: [bytes, 2 * FLASH],
                budget: [Some(FLASH), None],
            }],
        }
    }

    #[test]
    fn the_budget_itself_is_within_it() {
        assert_eq!(figures(FLASH).within_budgets(), Ok(()));
        let over = figures(FLASH + 1).within_budgets();
        assert_eq!(
            over,
            Err(vec!["code and tables: 24577 of 24576 bytes".to_string()])
        );
    }

    #[test]
    fn a_document_may_be_off_by_two_per_cent() {
        let document = figures(10_000).document();
        assert_eq!(compare(&document, &figures(10_200).document()), Ok(()));
        let difference = compare(&document, &figures(10_201).document());
        assert!(difference.is_err_and(|text| text.contains("10201")));
    }

    #[test]
    fn a_document_with_other_words_is_out_of_date() {
        let document = figures(10_000).document();
        let other = document.replace("Budget", "Limit");
        assert!(compare(&other, &document).is_err());
        assert!(compare("", &document).is_err());
    }

    #[test]
    fn a_document_of_another_compiler_is_not_compared() {
        let document = figures(10_000).document();
        let other = figures(9_000)
            .document()
            .replace("rustc 1.0.0", "rustc 1.1.0");
        assert_eq!(compare(&other, &document), Ok(()));
    }
}
