//! A linked program as it stands in the flash.
//!
//! In: an ELF file for the part. Out: its bytes from the first address that is loaded to the last,
//! gaps filled as erased flash is, and what its statics take of the RAM.

use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{ElfFile, ProgramHeader};
use object::{Endianness, Object, ObjectSection};

/// A program.
#[derive(Clone, Debug)]
pub struct Linked {
    /// Address of its first byte.
    pub start: u32,
    /// Its bytes, a multiple of four.
    pub bytes: Vec<u8>,
    /// RAM of its statics, bytes.
    pub ram: u64,
}

/// Sections that take RAM.
const RAM: [&str; 3] = [".data", ".bss", ".uninit"];

impl Linked {
    /// Reads a file.
    ///
    /// Errors: it is no ELF file, or none for a 32-bit part.
    pub fn read(file: &[u8]) -> Result<Self, object::Error> {
        let elf = ElfFile::<FileHeader32<Endianness>>::parse(file)?;
        let order = elf.endian();
        let mut pieces = Vec::new();
        for header in elf.elf_program_headers() {
            if header.p_type(order) != PT_LOAD || header.p_filesz(order) == 0 {
                continue;
            }
            let bytes = header.data(order, file).unwrap_or_default();
            pieces.push((header.p_paddr(order), bytes));
        }
        pieces.sort_unstable_by_key(|(at, _)| *at);
        let mut sections = elf.sections();
        let ram = sections.try_fold(0, |sum, section| {
            let is_ram = RAM.contains(&section.name()?);
            Ok(sum + if is_ram { section.size() } else { 0 })
        });
        let (start, bytes) = joined(&pieces);
        Ok(Self {
            start,
            bytes,
            ram: ram?,
        })
    }
}

/// Pieces in the order of their addresses as one.
fn joined(pieces: &[(u32, &[u8])]) -> (u32, Vec<u8>) {
    let start = pieces.first().map_or(0, |(at, _)| *at);
    let mut bytes = Vec::new();
    for (at, piece) in pieces {
        bytes.resize((at - start) as usize, u8::MAX);
        bytes.extend_from_slice(piece);
    }
    bytes.resize(bytes.len().next_multiple_of(4), u8::MAX);
    (start, bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_filled_as_erased_flash_is() {
        let pieces: [(u32, &[u8]); 2] = [(0x100, &[1, 2]), (0x104, &[3])];
        let whole = vec![1, 2, 0xFF, 0xFF, 3, 0xFF, 0xFF, 0xFF];
        assert_eq!(joined(&pieces), (0x100, whole));
        assert_eq!(joined(&[]), (0, vec![]));
    }
}
