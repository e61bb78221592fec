//! A linked binary: its sections, its functions, what they need of the stack, whom they call.
//!
//! In: the bytes of an ELF file for the part. Out: an [`Image`].
//!
//! Left out: everything for debuggers.

use std::collections::{BTreeMap, BTreeSet};

use object::elf::FileHeader32;
use object::read::elf::ElfFile;
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SymbolKind};

use super::frames::{self, Frame};

type Elf<'a> = ElfFile<'a, FileHeader32<Endianness>>;

/// A function of the binary.
#[derive(Clone, Debug)]
pub struct Function {
    /// Its name as people read it.
    pub name: String,
    /// Its bytes of code.
    pub size: u64,
    /// What it does with the stack.
    pub frame: Frame,
}

/// A binary as far as it is measured.
#[derive(Debug, Default)]
pub struct Image {
    /// Bytes of each section.
    sections: BTreeMap<String, u64>,
    /// Functions by their address.
    pub functions: BTreeMap<u32, Function>,
    /// Constants: name and bytes.
    pub constants: Vec<(String, u64)>,
    /// State, which takes RAM: name and bytes.
    pub statics: Vec<(String, u64)>,
    /// Addresses of functions from which a panic starts.
    panics: BTreeSet<u32>,
}

/// Section that the linker script gathers panics in.
const PANIC: &str = ".panic";

/// Sections that take RAM; `.state` is that of the binaries that are linked to be measured only.
pub const RAM: [&str; 4] = [".data", ".bss", ".uninit", ".state"];

fn is_in_ram<'a>(elf: &Elf<'a>, symbol: &impl ObjectSymbol<'a>) -> Result<bool, object::Error> {
    let Some(index) = symbol.section_index() else {
        return Ok(false);
    };
    Ok(RAM.contains(&elf.section_by_index(index)?.name()?))
}

/// The names of functions that only a panic needs.
fn is_panic(name: &str) -> bool {
    name.contains("panicking::") || name.contains("rust_begin_unwind")
}

impl Image {
    /// Reads a file.
    ///
    /// Errors: it is no ELF file, or none for a 32-bit part.
    pub fn read(bytes: &[u8]) -> Result<Self, object::Error> {
        let elf = Elf::parse(bytes)?;
        let mut image = Self::default();
        for section in elf.sections() {
            let name = section.name()?.to_string();
            *image.sections.entry(name).or_default() += section.size();
        }
        let tables = tables(&elf)?;
        for symbol in elf.symbols() {
            let name = format!("{:#}", rustc_demangle::demangle(symbol.name()?));
            match symbol.kind() {
                SymbolKind::Text if symbol.size() > 0 => image.add(&elf, &symbol, name, &tables)?,
                SymbolKind::Data if is_in_ram(&elf, &symbol)? => {
                    image.statics.push((name, symbol.size()));
                }
                SymbolKind::Data => image.constants.push((name, symbol.size())),
                _ => {}
            }
        }
        Ok(image)
    }

    fn add<'a>(
        &mut self,
        elf: &Elf<'a>,
        symbol: &impl ObjectSymbol<'a>,
        name: String,
        tables: &BTreeMap<u32, bool>,
    ) -> Result<(), object::Error> {
        let Some(index) = symbol.section_index() else {
            return Ok(());
        };
        let section = elf.section_by_index(index)?;
        // The lowest bit of a function's address marks it as Thumb code.
        let start = symbol.address() as u32 & !1;
        let offset = u64::from(start) - section.address();
        let whole = section.data()?;
        let code = whole.get(offset as usize..(offset + symbol.size()) as usize);
        let is_data = |at: u32| {
            tables
                .range(..=at)
                .next_back()
                .is_some_and(|(_, data)| *data)
        };
        if is_panic(&name) || section.name()? == PANIC {
            self.panics.insert(start);
        }
        let function = Function {
            name,
            size: symbol.size(),
            frame: frames::read(start, code.unwrap_or_default(), is_data),
        };
        self.functions.insert(start, function);
        Ok(())
    }

    /// Bytes of a section; 0 when it is not there.
    pub fn section(&self, name: &str) -> u64 {
        self.sections.get(name).copied().unwrap_or(0)
    }

    /// Who calls something that panics, each caller with what it calls; empty when nobody does.
    ///
    /// A binary that holds a panic which nobody calls directly is told as such.
    pub fn panics(&self) -> Vec<String> {
        let mut found = Vec::new();
        let panics = self.all_panics();
        for (address, function) in &self.functions {
            let calls = function.frame.calls.iter();
            for (to, _) in calls.filter(|(to, _)| panics.contains(to)) {
                if !panics.contains(address) {
                    found.push(format!("{} calls {}", function.name, self.name(*to)));
                }
            }
        }
        if found.is_empty() {
            let held = self.panics.iter().map(|panic| self.name(*panic));
            found.extend(held.map(|name| format!("{name} is there; its caller is not known")));
        }
        found.sort();
        found.dedup();
        found
    }

    /// Panics, and the core library's functions on the way to one, of which somebody else is to
    /// blame.
    fn all_panics(&self) -> BTreeSet<u32> {
        let mut all = self.panics.clone();
        let core = |function: &Function| function.name.starts_with("core::");
        loop {
            let more = self.functions.iter().filter(|(address, function)| {
                let calls = || function.frame.calls.iter();
                !all.contains(address) && core(function) && calls().any(|(to, _)| all.contains(to))
            });
            let more: Vec<u32> = more.map(|(address, _)| *address).collect();
            if more.is_empty() {
                return all;
            }
            all.extend(more);
        }
    }

    /// The name of the function at an address.
    pub fn name(&self, address: u32) -> String {
        let function = self.functions.get(&address);
        function.map_or_else(|| format!("{address:#010x}"), |f| f.name.clone())
    }

    /// The most that a call from outside can have on the stack, with its way down; calls through
    /// pointers are not followed.
    pub fn deepest(&self) -> (u32, Vec<String>) {
        let mut known = BTreeMap::new();
        let mut deepest = (0, None);
        for address in self.functions.keys() {
            let depth = self.depth(*address, &mut known, &mut BTreeSet::new());
            if depth > deepest.0 {
                deepest = (depth, Some(*address));
            }
        }
        let mut way = Vec::new();
        let mut next = deepest.1;
        while let Some(address) = next.filter(|_| way.len() < self.functions.len()) {
            way.push(self.name(address));
            next = known.get(&address).and_then(|(_, callee)| *callee);
        }
        (deepest.0, way)
    }

    /// Depth below a function. A function that calls itself, by whatever way, counts once.
    fn depth(
        &self,
        address: u32,
        known: &mut BTreeMap<u32, (u32, Option<u32>)>,
        open: &mut BTreeSet<u32>,
    ) -> u32 {
        if let Some((depth, _)) = known.get(&address) {
            return *depth;
        }
        let Some(function) = self.functions.get(&address) else {
            return 0;
        };
        if !open.insert(address) {
            return 0;
        }
        let mut deepest = (function.frame.bytes, None);
        for (callee, at_call) in &function.frame.calls {
            let depth = at_call + self.depth(*callee, known, open);
            if depth > deepest.0 {
                deepest = (depth, Some(*callee));
            }
        }
        open.remove(&address);
        known.insert(address, deepest);
        deepest.0
    }
}

/// Where instructions begin (false) and where tables do (true): the mapping symbols `$t` and `$d`
/// (ELF for the Arm Architecture, "mapping symbols").
fn tables(elf: &Elf) -> Result<BTreeMap<u32, bool>, object::Error> {
    let mut tables = BTreeMap::new();
    for symbol in elf.symbols() {
        let name = symbol.name()?;
        if name == "$t" || name.starts_with("$t.") {
            tables.insert(symbol.address() as u32, false);
        } else if name == "$d" || name.starts_with("$d.") {
            tables.insert(symbol.address() as u32, true);
        }
    }
    Ok(tables)
}
