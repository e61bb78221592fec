//! An ELF file as it goes into the flash.
//!
//! In: the bytes of the file. Out: pieces with their addresses in flash, and symbols. Left out:
//! everything that a debugger would want besides.

use std::collections::BTreeMap;
use std::fmt;

use object::elf::PT_LOAD;
use object::read::elf::{FileHeader, ProgramHeader};
use object::{Endianness, Object, ObjectSection, ObjectSymbol};

use flash::layout::RAM;

/// Where what is called SRAM ends and registers begin (PM0056 2.2).
const PERIPHERALS: u32 = 0x4000_0000;

/// What is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ImageError {
    /// Not an ELF file of a 32-bit ARM, or cut off.
    NotElf(String),
    /// Nothing in it is for the flash.
    Empty,
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotElf(why) => write!(f, "not an ELF file that can be read: {why}"),
            Self::Empty => f.write_str("nothing in it is for the flash"),
        }
    }
}

impl std::error::Error for ImageError {}

/// The name of a symbol as people read it, without the compiler's hash.
pub fn readable(symbol: &str) -> String {
    format!("{:#}", rustc_demangle::demangle(symbol))
}

/// A program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Address in flash and bytes of each piece.
    pub pieces: Vec<(u32, Vec<u8>)>,
    /// What its statics take of the RAM, bytes: sections with an address there.
    pub statics: u32,
    /// Sorted by address.
    symbols: Vec<(String, u32)>,
}

impl Image {
    /// Reads the file's loadable segments at their load addresses.
    ///
    /// Errors: see [`ImageError`].
    pub fn read(file: &[u8]) -> Result<Self, ImageError> {
        let wrong = |why: object::Error| ImageError::NotElf(why.to_string());
        let header = object::elf::FileHeader32::<Endianness>::parse(file).map_err(wrong)?;
        let endian = header.endian().map_err(wrong)?;
        let mut pieces = Vec::new();
        for segment in header.program_headers(endian, file).map_err(wrong)? {
            let bytes = segment.data(endian, file).unwrap_or_default();
            if segment.p_type(endian) == PT_LOAD && !bytes.is_empty() {
                pieces.push((segment.p_paddr(endian), bytes.to_vec()));
            }
        }
        if pieces.is_empty() {
            return Err(ImageError::Empty);
        }
        let elf = object::File::parse(file).map_err(wrong)?;
        let symbols = elf.symbols().filter_map(|symbol| {
            // `$t` and its like only mark what is code.
            let name = symbol.name().ok()?;
            if name.is_empty() || name.starts_with('$') {
                return None;
            }
            Some((name.to_owned(), symbol.address() as u32))
        });
        let mut symbols: Vec<_> = symbols.collect();
        symbols.sort_by_key(|(_, address)| *address & !1);
        let in_ram = elf.sections().filter(|section| {
            let address = section.address();
            (u64::from(RAM)..u64::from(PERIPHERALS)).contains(&address)
        });
        let statics = in_ram.map(|section| section.size() as u32).sum();
        Ok(Self {
            pieces,
            statics,
            symbols,
        })
    }

    /// How much of the flash it takes, bytes: from its first piece to the end of its last.
    pub fn flash(&self) -> u32 {
        let begin = self.pieces.iter().map(|(at, _)| *at).min();
        let ends = self
            .pieces
            .iter()
            .map(|(at, piece)| at + piece.len() as u32);
        ends.max().unwrap_or_default() - begin.unwrap_or_default()
    }

    /// The address of the symbol with this very name, Thumb bit left out.
    pub fn symbol(&self, name: &str) -> Option<u32> {
        let found = self.symbols.iter().find(|(symbol, _)| symbol == name);
        found.map(|(_, address)| address & !1)
    }

    /// The symbol that an address belongs to: the last one that begins at it or before.
    pub fn symbol_at(&self, address: u32) -> Option<&str> {
        let behind = self
            .symbols
            .partition_point(|(_, begin)| begin & !1 <= address);
        let (name, _) = self.symbols.get(behind.checked_sub(1)?)?;
        Some(name)
    }

    /// What was counted per address, put together by symbol, the most first.
    pub fn by_symbol(&self, counts: impl Iterator<Item = (u32, u64)>) -> Vec<(String, u64)> {
        let mut sums = BTreeMap::new();
        for (address, count) in counts {
            let name = self.symbol_at(address).unwrap_or("?").to_owned();
            *sums.entry(name).or_insert(0) += count;
        }
        let mut sums: Vec<_> = sums.into_iter().collect();
        sums.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
        sums
    }

    /// Symbols whose mangled name contains all of these words, with their addresses.
    pub fn symbols_with(&self, words: &[&str]) -> Vec<(&str, u32)> {
        let with = |name: &str| words.iter().all(|word| name.contains(word));
        let found = self.symbols.iter().filter(|(name, _)| with(name));
        found
            .map(|(name, address)| (name.as_str(), address & !1))
            .collect()
    }
}
