//! The flash map of each part: the only source of it, for boot, update, linker and host.
//!
//! Out: a [`Layout`] for each part, and the linker's `memory.x` made from it
//! ([`Layout::memory_x`]). Offsets count from the start of the flash ([`BASE`]) in bytes. What a
//! map has to obey (whole pages, no gap, no overlap, the part's size) is asserted when this
//! compiles. The product's images are built for [`RC`]: the whole instrument is more than a slot of
//! [`CB`] holds. The paper's image is built for [`C8`].
//!
//! Left out: what is inside a region ([`image`](crate::image), [`records`](crate::records)).
//!
//! Sources: RM0008 3.3.3, table 5 (medium density, pages of 1 kB) and table 6 (high density, pages
//! of 2 kB); table 2 of the data sheets STM32F103x8/xB (64 or 128 kB of flash, 20 kB of RAM) and
//! STM32F103xC/xD/xE (256 kB of flash, 48 kB of RAM in the RC).

use core::fmt;

/// Where the flash begins in the address space.
pub const BASE: u32 = 0x0800_0000;

/// Where the RAM begins in the address space.
pub const RAM: u32 = 0x2000_0000;

/// The smallest part that is erased, bytes: one page of the chip where it is of high density.
///
/// A medium-density part has pages of 1 kB ([`Layout::chip_page`]). Whoever keeps records in a ring
/// there erases two of them for one of these, the lower first. A cut may then come between the two;
/// [`nor`](crate::nor) draws that state too. The paper's part erases its own pages.
pub const PAGE: u32 = 2048;

/// A page of the chip where it is of medium density, bytes.
pub const HALF_PAGE: u32 = PAGE / 2;

/// Bytes before the vector table of an application, which the image's header has.
///
/// The STM32F103 has 16 + 60 vectors. VTOR asks for their number rounded up to a power of two,
/// 128, in words: 512 bytes (PM0056 4.4.4).
pub const HEADER: u32 = 512;

/// Bytes at the end of the bootloader's region that tell where the functions are that it lends to
/// applications ([`seal`](crate::seal)).
pub const SEAL: u32 = 24;

/// Pages that the event log has for itself, where a part has room for one: it needs two.
pub const LOG_PAGES: u32 = 2;

/// A piece of the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// Offset from the start of the flash, bytes.
    pub start: u32,
    /// Bytes.
    pub length: u32,
}

impl Region {
    const fn kilobytes(start: u32, length: u32) -> Self {
        Self {
            start: start * 1024,
            length: length * 1024,
        }
    }

    /// Offset of the first byte behind it.
    pub const fn end(&self) -> u32 {
        self.start.saturating_add(self.length)
    }

    /// Whole pages in it.
    pub const fn pages(&self) -> u32 {
        self.length / PAGE
    }

    /// Where it begins in the address space.
    pub const fn address(&self) -> u32 {
        BASE.saturating_add(self.start)
    }
}

/// Which slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// The slot that every part has.
    A,
    /// The slot that an update goes to while A runs.
    B,
}

impl Slot {
    /// The other one.
    pub const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

/// The map of one part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// The part's name.
    pub part: &'static str,
    /// What an image's header calls the board with this part: "PL", the board's revision, and
    /// the part, since the same program is linked to other addresses for another map.
    pub hardware: u32,
    /// Flash, bytes.
    pub flash: u32,
    /// RAM, bytes.
    pub ram: u32,
    /// What the chip erases in one operation, bytes: [`PAGE`] or [`HALF_PAGE`].
    pub chip_page: u32,
    /// The bootloader, with what it lends to applications and the [`SEAL`] at its end.
    pub boot: Region,
    /// Slot A.
    pub a: Region,
    /// Slot B; a part without one is not updated in the field.
    pub b: Option<Region>,
    /// Calibration and parameters ([`Records`](crate::records::Records), and where there is no slot
    /// B [`Banks`](crate::banks::Banks)).
    pub records: Region,
    /// The event log ([`Log`](crate::records::log::Log)); no bytes where there is no room for one.
    pub log: Region,
}

/// STM32F103RC: 256 kB, two slots. The product's images are built for it.
///
/// Its records take a calibration of up to 5793 bytes beside parameters of 1.5 kB; the longest that
/// there is has 3176.
pub const RC: Layout = Layout {
    part: "STM32F103RC",
    // The 4 is of this map: an image that was linked for another one is refused.
    hardware: u32::from_le_bytes([0x2C, 4, b'L', b'P']),
    flash: 256 * 1024,
    ram: 48 * 1024,
    chip_page: PAGE,
    boot: Region::kilobytes(0, 20),
    a: Region::kilobytes(20, 104),
    b: Some(Region::kilobytes(124, 104)),
    records: Region::kilobytes(228, 24),
    log: Region::kilobytes(252, LOG_PAGES * PAGE / 1024),
};

/// STM32F103CB: 128 kB, two slots; the range that the paper shows. A map only: the instrument is
/// too long for it.
///
/// Its records take a calibration of up to 1761 bytes beside parameters of 1.5 kB: one by
/// harmonics, but not two full tables. Storing those answers
/// [`RecordError::Full`](crate::records::RecordError::Full).
pub const CB: Layout = Layout {
    part: "STM32F103CB",
    hardware: u32::from_le_bytes([0xCB, 1, b'L', b'P']),
    flash: 128 * 1024,
    ram: 20 * 1024,
    chip_page: HALF_PAGE,
    boot: Region::kilobytes(0, 8),
    a: Region::kilobytes(8, 52),
    b: Some(Region::kilobytes(60, 52)),
    records: Region::kilobytes(112, 12),
    log: Region::kilobytes(124, LOG_PAGES * PAGE / 1024),
};

/// STM32F103C8: 64 kB, one slot, no update in the field. The part that the paper names; its image
/// is built for it.
///
/// The records are two banks of 4 kB ([`Banks`](crate::banks::Banks)), each with 4048 bytes for all
/// of them: a calibration of two tables of 181 points with a piecewise temperature model, 3092
/// bytes, and 0.9 kB beside it. There is no room for a second calibration, as delivered, and none
/// for an event log.
pub const C8: Layout = Layout {
    part: "STM32F103C8",
    // The 4 is of this map.
    hardware: u32::from_le_bytes([0xC8, 4, b'L', b'P']),
    flash: 64 * 1024,
    ram: 20 * 1024,
    chip_page: HALF_PAGE,
    boot: Region::kilobytes(0, 2),
    a: Region::kilobytes(2, 54),
    b: None,
    records: Region::kilobytes(56, 8),
    log: Region::kilobytes(64, 0),
};

/// Every layout.
pub const ALL: [Layout; 3] = [RC, CB, C8];

const _: () = {
    let mut at = 0;
    while at < ALL.len() {
        assert!(ALL[at].is_sound() && ALL[at].boot.length <= 20 * 1024);
        assert!(ALL[at].log.pages() == LOG_PAGES || ALL[at].log.length == 0);
        at += 1;
    }
};
const _: () = assert!(RC.records.length + RC.log.length == 28 * 1024);
const _: () = assert!(CB.records.length + CB.log.length == 16 * 1024);
const _: () = assert!(C8.records.length.is_multiple_of(2 * C8.chip_page));

/// Which program a linker script is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// The bootloader.
    Boot,
    /// An application in a slot. It runs only there, since its addresses are fixed.
    Application(Slot),
}

impl Layout {
    /// The region of `slot`; `None` where the part has none.
    pub const fn slot(&self, slot: Slot) -> Option<Region> {
        match slot {
            Slot::A => Some(self.a),
            Slot::B => self.b,
        }
    }

    /// Whether the regions are whole pages that follow one another from first byte to last.
    pub const fn is_sound(&self) -> bool {
        let b = match self.b {
            Some(b) => b,
            None => Region {
                start: self.a.end(),
                length: 0,
            },
        };
        let order = [self.boot, self.a, b, self.records, self.log];
        let mut end = 0;
        let mut at = 0;
        while at < order.len() {
            if order[at].start != end || !order[at].length.is_multiple_of(PAGE) {
                return false;
            }
            end = order[at].end();
            at += 1;
        }
        let pages = self.chip_page == PAGE || self.chip_page == HALF_PAGE;
        end == self.flash && self.a.length > HEADER && pages
    }

    /// Where `program` is linked to and how much room it has, header and seal left out.
    ///
    /// `None` for an application in a slot that the part has not got.
    pub const fn room(&self, program: Program) -> Option<Region> {
        let slot = match program {
            Program::Boot => {
                let length = self.boot.length - SEAL;
                return Some(Region {
                    start: self.boot.start,
                    length,
                });
            }
            Program::Application(slot) => self.slot(slot),
        };
        match slot {
            Some(slot) => Some(Region {
                start: slot.start + HEADER,
                length: slot.length - HEADER,
            }),
            None => None,
        }
    }

    /// The `memory.x` that links `program`: write its `Display` into a file.
    ///
    /// `None` for an application in a slot that the part has not got.
    pub fn memory_x(&self, program: Program) -> Option<MemoryX> {
        let room = self.room(program)?;
        Some(MemoryX {
            part: self.part,
            ram: self.ram,
            program,
            room,
        })
    }
}

/// A linker script's memory regions, as text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryX {
    part: &'static str,
    ram: u32,
    program: Program,
    room: Region,
}

impl fmt::Display for MemoryX {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let program = match self.program {
            Program::Boot => "the bootloader",
            Program::Application(Slot::A) => "an application in slot A",
            Program::Application(Slot::B) => "an application in slot B",
        };
        writeln!(
            f,
            "/* {}, {program}. Made from flash::layout. */",
            self.part
        )?;
        writeln!(f, "MEMORY")?;
        writeln!(f, "{{")?;
        let (origin, length) = (self.room.address(), self.room.length);
        writeln!(f, "  FLASH : ORIGIN = {origin:#010X}, LENGTH = {length}")?;
        writeln!(f, "  RAM : ORIGIN = {RAM:#010X}, LENGTH = {}", self.ram)?;
        if self.program == Program::Boot {
            let seal = origin + length;
            writeln!(f, "  SEAL : ORIGIN = {seal:#010X}, LENGTH = {SEAL}")?;
        }
        writeln!(f, "}}")
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn regions_that_overlap_leave_gaps_or_split_pages_are_found() {
        assert!(ALL.iter().all(Layout::is_sound));
        let mut bad = CB;
        bad.a.length += PAGE;
        assert!(!bad.is_sound());
        let mut bad = CB;
        bad.log.length -= PAGE;
        assert!(!bad.is_sound());
        let mut bad = C8;
        bad.boot.length += 512;
        bad.a.start += 512;
        bad.a.length -= 512;
        assert!(!bad.is_sound());
    }

    #[test]
    fn e13_each_map_ends_where_the_flash_of_its_part_ends() {
        let end = |layout: Layout| layout.log.address() + layout.log.length - 1;
        // The paper's range, which is that of 128 kB, half of it, and twice as much.
        assert_eq!(end(CB), 0x0801_FFFF);
        assert_eq!(end(C8), 0x0800_FFFF);
        assert_eq!(end(RC), 0x0803_FFFF);
    }

    #[test]
    fn the_vector_table_is_aligned_and_the_budget_fits() {
        for layout in ALL {
            for slot in [Slot::A, Slot::B] {
                let Some(room) = layout.room(Program::Application(slot)) else {
                    assert_eq!(layout.part, "STM32F103C8");
                    continue;
                };
                assert_eq!(room.address() % 512, 0);
                // With its header an application has 52 kB at least.
                assert!(room.length + HEADER >= 52 * 1024);
                // Where the images are built for, it has more than twice as much.
                assert!(layout.part != RC.part || room.length >= 103 * 1024);
            }
        }
    }

    #[test]
    fn the_linker_script_is_the_map() {
        let text = CB
            .memory_x(Program::Application(Slot::B))
            .unwrap()
            .to_string();
        let expected = "/* STM32F103CB, an application in slot B. Made from flash::layout. */\n\
            MEMORY\n{\n  FLASH : ORIGIN = 0x0800F200, LENGTH = 52736\n  \
            RAM : ORIGIN = 0x20000000, LENGTH = 20480\n}\n";
        assert_eq!(text, expected);
        let text = RC
            .memory_x(Program::Application(Slot::B))
            .unwrap()
            .to_string();
        assert!(text.contains("FLASH : ORIGIN = 0x0801F200, LENGTH = 105984"));
        assert!(text.contains("RAM : ORIGIN = 0x20000000, LENGTH = 49152"));
        let text = C8.memory_x(Program::Boot).unwrap().to_string();
        assert!(text.contains("FLASH : ORIGIN = 0x08000000, LENGTH = 2024"));
        assert!(text.contains("SEAL : ORIGIN = 0x080007E8, LENGTH = 24"));
        assert_eq!(C8.memory_x(Program::Application(Slot::B)), None);
    }
}
