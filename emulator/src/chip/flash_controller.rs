//! The flash controller: keys, erase, program, and the time that the core stands still for them.
//!
//! In: loads and stores of its registers, stores into the flash. Out: what the cells hold, an
//! interrupt line, cycles for which the core is held. The cells are [`flash::nor`]'s, stricter than
//! the chip, where the supply can fail in the middle of an operation.
//!
//! Sources: PM0075 2.3 and 3; times from the data sheet of the STM32F103xC (5.3.9: a half-word
//! 52.5 us, a page 20 to 40 ms, drawn for each erase). Code in flash stands still as long as an
//! operation lasts (PM0075 2.3); code in RAM would not, and does here. BSY and EOP are as before
//! at the first access after STRT (ST's errata, "BSY bit delay versus STRT bit setting"): on the
//! chip a cycle is enough, here it has to be an access.
//! Left out: option bytes but for reading, mass erase, read protection.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 00h | ACR | PM0075 3.1 |
//! | 04h | KEYR | 3.2 |
//! | 0Ch | SR | 3.4 |
//! | 10h | CR | 3.5 |
//! | 14h | AR | 3.6 |
//! | 1Ch | OBR | 3.7 |
//! | 20h | WRPR | 3.8 |

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};
use flash::layout::{Layout, PAGE};
use flash::nor::{Draw, Nor, NorError, Page};

/// Programming a half-word, ns.
pub const PROGRAM_NS: u64 = 52_500;
/// Erasing a page, ns: the shortest and the longest time.
pub const ERASE_NS: [u64; 2] = [20_000_000, 40_000_000];

/// CR's bits (PM0075 3.5).
mod cr {
    pub const PG: u32 = 1;
    pub const PER: u32 = 1 << 1;
    pub const MER: u32 = 1 << 2;
    pub const STRT: u32 = 1 << 6;
    pub const LOCK: u32 = 1 << 7;
    pub const ERRIE: u32 = 1 << 10;
    pub const EOPIE: u32 = 1 << 12;
}

/// SR's bits (PM0075 3.4).
mod sr {
    pub const PGERR: u32 = 1 << 2;
    pub const WRPRTERR: u32 = 1 << 4;
    pub const EOP: u32 = 1 << 5;
}

/// Where the keys stand (PM0075 2.3.1 and 2.3.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lock {
    Locked,
    FirstKey,
    Open,
    /// A wrong key: locked until the next reset.
    Jammed,
}

/// Random words for cells that were cut, one stream for each part.
#[derive(Clone, Debug)]
pub struct Dice(u64);

impl Dice {
    /// The stream of this seed.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }
}

impl Draw for Dice {
    fn draw(&mut self) -> u32 {
        // SplitMix64.
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        (mixed >> 32) as u32
    }
}

/// What the flash holds.
pub type Cells = Nor<Vec<Page>, Dice>;

/// One operation of the flash: what a loss of supply can come in the middle of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// The half-word at this offset is programmed with these bytes.
    Program(u32, [u8; 2]),
    /// The page of 2 kB that begins at this offset is erased.
    Erase(u32),
    /// The page of 1 kB that begins at this offset is erased, of a part of medium density.
    EraseHalf(u32),
}

impl Operation {
    /// Does it. Errors: see [`NorError`].
    pub fn run(self, cells: &mut Cells) -> Result<(), NorError> {
        match self {
            Self::Program(offset, bytes) => cells.write(offset, &bytes),
            Self::Erase(offset) => cells.erase(offset, offset.saturating_add(PAGE)),
            Self::EraseHalf(offset) => cells.erase_half(offset),
        }
    }

    /// The first byte that it changes, from the start of the flash.
    pub const fn offset(self) -> u32 {
        match self {
            Self::Program(offset, _) | Self::Erase(offset) | Self::EraseHalf(offset) => offset,
        }
    }
}

/// What an operation came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The core is held for so long, ns.
    Held(u64),
    /// Refused at once.
    Refused,
    /// The supply failed in it.
    Cut,
}

/// The registers and the cells.
#[derive(Clone, Debug)]
pub struct FlashController {
    cells: Cells,
    /// Bytes of a page.
    page: u32,
    /// What the code has done since the journal was begun, if it was.
    journal: Option<Vec<Operation>>,
    acr: u32,
    sr: u32,
    cr: u32,
    ar: u32,
    lock: Lock,
    /// An erase has begun since the last access.
    starting: bool,
    /// What sets how long erases take, and for how long if that was set.
    pace: Dice,
    erase_ns: Option<u64>,
    /// Offsets of what the core's copy has to be put right at.
    changed: Vec<(u32, u32)>,
}

impl FlashController {
    /// The erased flash of a part with this map; `seed` for what a cut leaves.
    pub fn new(layout: &Layout, seed: u64) -> Self {
        let pages = vec![Page::new(); (layout.flash / PAGE) as usize];
        Self {
            cells: Nor::new(pages, Dice(seed)),
            page: layout.chip_page,
            journal: None,
            acr: 0x30,
            sr: 0,
            cr: cr::LOCK,
            ar: 0,
            lock: Lock::Locked,
            starting: false,
            pace: Dice::new(seed ^ 0x6572_6173_6573),
            erase_ns: None,
            changed: Vec::new(),
        }
    }

    /// The registers as after a reset, and the core's copy is made anew: a page whose erase was
    /// cut may read differently each time.
    pub fn reset(&mut self) {
        (self.acr, self.sr, self.cr, self.ar) = (0x30, 0, cr::LOCK, 0);
        (self.lock, self.starting) = (Lock::Locked, false);
        self.changed = vec![(0, self.size())];
    }

    /// The supply is back.
    pub fn power_up(&mut self) {
        self.cells.power_up();
        self.reset();
    }

    /// Bytes.
    pub fn size(&self) -> u32 {
        self.cells.capacity() as u32
    }

    /// The cells, for cuts and for looking at.
    pub fn cells(&mut self) -> &mut Cells {
        &mut self.cells
    }

    /// Each erase takes so long from now on, ns; `None`: as drawn.
    pub fn set_erase_ns(&mut self, erase_ns: Option<u64>) {
        self.erase_ns = erase_ns;
    }

    /// From now on every operation is written down, also across resets.
    pub fn begin_journal(&mut self) {
        self.journal = Some(Vec::new());
    }

    /// What was written down, and the end of it.
    pub fn take_journal(&mut self) -> Vec<Operation> {
        self.journal.take().unwrap_or_default()
    }

    fn perform(&mut self, operation: Operation) -> Result<(), NorError> {
        if let Some(journal) = &mut self.journal {
            journal.push(operation);
        }
        operation.run(&mut self.cells)
    }

    /// Flips the bits of `mask` in the byte at `offset`, as a bad cell does.
    pub fn flip(&mut self, offset: u32, mask: u8) {
        self.cells.flip(offset, mask);
        self.changed.push((offset & !3, 4));
    }

    /// Writes an image as a programmer would: erases the pages it touches first.
    ///
    /// Errors: see [`NorError`].
    pub fn flash(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorError> {
        let first = offset / PAGE * PAGE;
        let end = (offset + bytes.len() as u32).next_multiple_of(PAGE);
        let mut image = vec![0; (end - first) as usize];
        self.cells.read(first, &mut image)?;
        let place = (offset - first) as usize;
        if let Some(part) = image.get_mut(place..place + bytes.len()) {
            part.copy_from_slice(bytes);
        }
        self.cells.erase(first, end)?;
        for (half_word, at) in image.chunks(2).zip((first..).step_by(2)) {
            if half_word != [0xFF; 2] {
                self.cells.write(at, half_word)?;
            }
        }
        self.changed.push((first, end - first));
        Ok(())
    }

    /// A piece of the flash that the core's copy has to be put right at: offset and bytes.
    pub fn take_changed(&mut self) -> Option<(u32, Vec<u8>)> {
        let (offset, length) = self.changed.pop()?;
        let mut bytes = vec![0; length as usize];
        // Within the flash, so this cannot fail while there is power.
        let _ = self.cells.read(offset, &mut bytes);
        Some((offset, bytes))
    }

    /// Whether the core's copy differs.
    pub fn is_changed(&self) -> bool {
        !self.changed.is_empty()
    }

    /// Wait states that ACR asks for (PM0075 3.1).
    pub fn latency(&self) -> u32 {
        self.acr & 7
    }

    /// The interrupt line.
    pub fn line(&self) -> bool {
        let error = self.sr & (sr::PGERR | sr::WRPRTERR) != 0 && self.cr & cr::ERRIE != 0;
        error || self.sr & sr::EOP != 0 && self.cr & cr::EOPIE != 0
    }

    /// A load; `offset` from 4002 2000h. BSY is never seen: the core has stood still meanwhile.
    pub fn read(&mut self, offset: u32) -> u32 {
        let starting = std::mem::take(&mut self.starting);
        match offset {
            // 3.1: PRFTBS follows PRFTBE.
            0x00 => self.acr & !0x20 | (self.acr & 0x10) << 1,
            0x0C if starting => self.sr & !sr::EOP,
            0x0C => self.sr,
            0x10 => self.cr,
            // 3.7 and 3.8: nothing protected.
            0x1C => 0x03FF_FFFC,
            0x20 => u32::MAX,
            _ => 0,
        }
    }

    /// A store; what an erase that it starts comes to.
    pub fn write(&mut self, offset: u32, value: u32) -> Option<Outcome> {
        self.starting = false;
        match offset {
            0x00 => self.acr = value & 0x1F | self.acr & 0x20,
            0x04 => self.key(value),
            // 3.4: a 1 takes a flag away.
            0x0C => self.sr &= !(value & (sr::PGERR | sr::WRPRTERR | sr::EOP)),
            0x10 if value & cr::LOCK != 0 && self.lock == Lock::Open => {
                self.lock = Lock::Locked;
                self.cr = value & !cr::STRT | cr::LOCK;
            }
            0x10 if self.lock == Lock::Open => {
                self.cr = value & 0x1637 & !cr::STRT;
                if value & cr::STRT != 0 {
                    return Some(self.erase());
                }
            }
            // 3.6.
            0x14 => self.ar = value,
            _ => {}
        }
        None
    }

    fn key(&mut self, value: u32) {
        self.lock = match (self.lock, value) {
            (Lock::Locked, 0x4567_0123) => Lock::FirstKey,
            (Lock::FirstKey, 0xCDEF_89AB) => Lock::Open,
            _ => Lock::Jammed,
        };
        if self.lock == Lock::Open {
            self.cr &= !cr::LOCK;
        }
    }

    fn erase(&mut self) -> Outcome {
        // Mass erase is left out, and taken for a mistake.
        if self.cr & cr::PER == 0 || self.cr & cr::MER != 0 {
            return Outcome::Refused;
        }
        let page = self.page;
        let first = self.ar.wrapping_sub(flash::layout::BASE) / page * page;
        self.changed.push((first.min(self.size() - page), page));
        let erase = match page {
            PAGE => Operation::Erase(first),
            _ => Operation::EraseHalf(first),
        };
        match self.perform(erase) {
            Ok(()) => {
                self.sr |= sr::EOP;
                self.starting = true;
                Outcome::Held(self.erase_ns.unwrap_or_else(|| self.drawn_ns()))
            }
            Err(NorError::NoPower) => Outcome::Cut,
            Err(_) => Outcome::Refused,
        }
    }

    fn drawn_ns(&mut self) -> u64 {
        let [least, most] = ERASE_NS;
        least + u64::from(self.pace.draw()) * (most - least) / u64::from(u32::MAX)
    }

    /// A store into the flash at `offset`; `None` for one that no program is: the bus answers
    /// with an error (PM0075 2.3.3: half-words only, PG set).
    pub fn program(&mut self, offset: u32, size: u32, value: u32) -> Option<Outcome> {
        let word = offset & !3;
        self.changed.push((word.min(self.size() - 4), 4));
        if size != 2 || self.cr & cr::PG == 0 || self.lock != Lock::Open {
            return None;
        }
        let program = Operation::Program(offset, (value as u16).to_le_bytes());
        Some(match self.perform(program) {
            Ok(()) => {
                self.sr |= sr::EOP;
                Outcome::Held(PROGRAM_NS)
            }
            Err(NorError::NoPower) => Outcome::Cut,
            Err(_) => {
                // 2.3.3: a half-word that is not erased takes 0000h only.
                self.sr |= sr::PGERR;
                Outcome::Refused
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use flash::layout::{C8, HALF_PAGE, RC};

    use super::*;

    fn of(layout: Layout) -> FlashController {
        FlashController::new(&layout, 1)
    }

    fn open() -> FlashController {
        opened(of(RC))
    }

    fn opened(mut flash: FlashController) -> FlashController {
        flash.write(0x04, 0x4567_0123);
        flash.write(0x04, 0xCDEF_89AB);
        flash
    }

    fn erase(flash: &mut FlashController, page: u32) -> Option<Outcome> {
        flash.write(0x10, cr::PER);
        flash.write(0x14, flash::layout::BASE + page * PAGE);
        flash.write(0x10, cr::PER | cr::STRT)
    }

    #[test]
    fn a_wrong_key_locks_until_the_next_reset() {
        let mut flash = of(RC);
        flash.write(0x04, 1);
        flash.write(0x04, 0x4567_0123);
        flash.write(0x04, 0xCDEF_89AB);
        assert_eq!(flash.read(0x10), cr::LOCK);
        flash.reset();
        flash.write(0x04, 0x4567_0123);
        flash.write(0x04, 0xCDEF_89AB);
        assert_eq!(flash.read(0x10), 0);
    }

    #[test]
    fn a_half_word_is_programmed_once_and_erased_with_its_page() {
        let mut flash = open();
        flash.write(0x10, cr::PG);
        assert_eq!(
            flash.program(PAGE, 2, 0x1234),
            Some(Outcome::Held(PROGRAM_NS))
        );
        assert_eq!(flash.read(0x0C), sr::EOP);
        assert_eq!(flash.program(PAGE, 2, 0x1200), Some(Outcome::Refused));
        assert_eq!(flash.read(0x0C), sr::EOP | sr::PGERR);
        assert_eq!(flash.program(PAGE + 4, 4, 0), None);
        assert!(matches!(erase(&mut flash, 1), Some(Outcome::Held(_))));
        assert_eq!(
            flash.take_changed(),
            Some((PAGE, vec![0xFF; PAGE as usize]))
        );
    }

    #[test]
    fn a_part_of_medium_density_erases_a_page_of_1_kb() {
        let mut flash = opened(of(C8));
        flash.write(0x10, cr::PG);
        for at in [PAGE, PAGE + HALF_PAGE] {
            assert_eq!(flash.program(at, 2, 0), Some(Outcome::Held(PROGRAM_NS)));
        }
        while flash.take_changed().is_some() {}
        flash.write(0x10, cr::PER);
        flash.write(0x14, flash::layout::BASE + PAGE + HALF_PAGE + 5);
        let erased = flash.write(0x10, cr::PER | cr::STRT);
        assert!(matches!(erased, Some(Outcome::Held(_))));
        let blank = vec![0xFF; HALF_PAGE as usize];
        assert_eq!(flash.take_changed(), Some((PAGE + HALF_PAGE, blank)));
        let [low, high] = [0, HALF_PAGE as usize];
        let page = flash.cells().pages()[1].bytes();
        assert_eq!((page[low], page[high]), (0, 0xFF));
    }

    #[test]
    fn the_first_look_after_the_start_of_an_erase_finds_nothing_done() {
        let mut flash = open();
        for _ in 0..2 {
            erase(&mut flash, 1);
            assert_eq!(flash.read(0x0C), 0);
            assert_eq!(flash.read(0x0C), sr::EOP);
            flash.write(0x0C, sr::EOP);
        }
        // Any access in between is enough.
        erase(&mut flash, 1);
        flash.read(0x10);
        assert_eq!(flash.read(0x0C), sr::EOP);
    }

    #[test]
    fn erases_take_from_20_to_40_ms_as_drawn_from_the_seed() {
        let times = |seed| {
            let mut flash = FlashController::new(&RC, seed);
            flash.write(0x04, 0x4567_0123);
            flash.write(0x04, 0xCDEF_89AB);
            let erases = (0..200).map(|_| match erase(&mut flash, 1) {
                Some(Outcome::Held(ns)) => ns,
                other => panic!("{other:?}"),
            });
            erases.collect::<Vec<_>>()
        };
        let drawn = times(1);
        assert_eq!(drawn, times(1));
        assert_ne!(drawn, times(2));
        let [least, most] = ERASE_NS;
        assert!(drawn.iter().all(|ns| (least..=most).contains(ns)));
        let near = |end: u64| drawn.iter().any(|ns| ns.abs_diff(end) < 1_000_000);
        assert!(near(least) && near(most));
    }

    #[test]
    fn locked_nothing_is_programmed() {
        let mut flash = of(RC);
        flash.write(0x10, cr::PG);
        assert_eq!(flash.program(0, 2, 0), None);
        assert_eq!(flash.take_changed(), Some((0, vec![0xFF; 4])));
    }

    #[test]
    fn a_cut_stops_the_part_in_the_operation() {
        let mut flash = open();
        flash.cells().cut_after(1);
        flash.write(0x10, cr::PG);
        assert_eq!(flash.program(0, 2, 0x5555), Some(Outcome::Held(PROGRAM_NS)));
        assert_eq!(erase(&mut flash, 0), Some(Outcome::Cut));
        flash.power_up();
        assert!(!flash.cells().is_cut());
    }
}
