//! A linked program as it stands in the flash.
//!
//! In: an ELF file for the part. Out: its bytes from the first address that is loaded to the last,
//! gaps filled as erased flash is, what its statics take of the RAM, and what must not be in it.

use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{ElfFile, ProgramHeader};
use object::{Endianness, Object, ObjectSection, ObjectSymbol};

use super::traces;
use crate::size::image::{Image, RAM};

/// A program.
#[derive(Clone, Debug)]
pub struct Linked {
    /// Address of its first byte.
    pub start: u32,
    /// Its bytes, a multiple of four.
    pub bytes: Vec<u8>,
    /// RAM of its statics, bytes.
    pub ram: u64,
    /// What no program of ours has: functions for floating point, calls of panics, and the names of
    /// folders of the machine that built it.
    pub strays: Vec<String>,
    /// The deepest stack along direct calls, bytes: interrupts and calls by pointer come on top.
    pub stack: u32,
}

/// Whose panics are let be. The crate for signatures indexes arrays of fixed length in loops of
/// fixed length, so that none of its checks can fail, and the compiler doesn't see it.
const NEVER_REACHED: &str = "ed25519";

/// Whether a function is there for floating point only.
fn is_stray(name: &str) -> bool {
    let words = ["compiler_builtins::float::"];
    let starts = ["__aeabi_f", "__aeabi_d", "__aeabi_cf", "__aeabi_cd"];
    words.iter().any(|word| name.contains(word))
        || starts.iter().any(|start| name.starts_with(start))
}

/// Whether a call, "caller calls panic", is one that is never reached.
fn is_let_be(call: &str) -> bool {
    let caller = call.split(" calls ").next();
    call.contains(" calls ") && caller.is_some_and(|caller| caller.contains(NEVER_REACHED))
}

impl Linked {
    /// Reads a file; none of `places` may be named in it.
    ///
    /// Errors: it is no ELF file, or none for a 32-bit part.
    pub fn read(file: &[u8], places: &[String]) -> Result<Self, object::Error> {
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
        let names = elf.symbols().filter_map(|symbol| symbol.name().ok());
        let names = names.map(|name| format!("{:#}", rustc_demangle::demangle(name)));
        let floats = names.filter(|name| is_stray(name));
        let image = Image::read(file)?;
        let panics = image.panics();
        let panics = panics.into_iter().filter(|call| !is_let_be(call));
        let (stack, _) = image.deepest();
        let (start, bytes) = joined(&pieces);
        let traces = traces::found(&bytes, places);
        let strays = floats.chain(panics).chain(traces).collect();
        Ok(Self {
            start,
            bytes,
            ram: ram?,
            strays,
            stack,
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
    fn panics_of_the_signature_are_let_be_and_no_others() {
        let panic = "core::panicking::panic_bounds_check";
        assert!(is_let_be(&format!(
            "ed25519_compact::sha512::index calls {panic}"
        )));
        assert!(!is_let_be(&format!("device::device::poll calls {panic}")));
        assert!(!is_let_be(
            "ed25519_compact::panicking:: is there; its caller is not known"
        ));
    }

    #[test]
    fn floating_point_is_a_stray_and_integers_are_not() {
        for stray in ["__aeabi_fadd", "__aeabi_dcmplt"] {
            assert!(is_stray(stray), "{stray}");
        }
        for ours in [
            "__aeabi_uldivmod",
            "__aeabi_memcpy",
            "device::fault::Fault::report",
        ] {
            assert!(!is_stray(ours), "{ours}");
        }
    }

    #[test]
    fn gaps_are_filled_as_erased_flash_is() {
        let pieces: [(u32, &[u8]); 2] = [(0x100, &[1, 2]), (0x104, &[3])];
        let whole = vec![1, 2, 0xFF, 0xFF, 3, 0xFF, 0xFF, 0xFF];
        assert_eq!(joined(&pieces), (0x100, whole));
        assert_eq!(joined(&[]), (0, vec![]));
    }
}
