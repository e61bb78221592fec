//! What a node keeps over a power cut: the flash of an STM32F103RC, with all that is in it.
//!
//! In: the device's own calls. Out: a [`Memory`] over [`Nor`], the model of a flash that refuses
//! what the chip refuses and can be cut in the middle of any operation. It comes from the factory
//! with a confirmed image in slot A, of which the simulation runs no code: every node runs this
//! host's. The image has the version that is shown. How long each erase takes is drawn, and kept
//! for whoever lets the node stand still for it.
//!
//! Left out: the time that programs take.

use device::memory::ed25519::Ed25519;
use device::memory::{Build, FlashMemory};
use device::records::{EventStore, RecordStore};
use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash,
};
use flash::check_sum::Crc32;
use flash::image::{FIELDS, Header, SIGNATURE, SIGNATURE_AT, Signature, Version};
use flash::layout::{BASE, HEADER, PAGE, RC, Region, Slot};
use flash::nor::{Draw, Nor, NorError, Page};
use flash::slots::{self, Decision, MARKS, factory_marks};

use ed25519_compact::{KeyPair, Seed};

use crate::rng::Rng;

/// The hardware id that images for this board name.
pub const HARDWARE: u32 = RC.hardware;

/// The version that a node leaves the factory with.
pub const FACTORY: Version = Version::new(0, 1, 0);

/// The secret key that images for simulated nodes are signed with. Everybody may know it: nothing
/// but a simulated node accepts it.
pub const DEVELOPMENT: &[u8; 32] = b"not secret: for simulated nodes.";

/// The public key that belongs to [`DEVELOPMENT`].
pub fn development_key() -> [u8; 32] {
    public_key(DEVELOPMENT)
}

/// The public key that belongs to the secret key `seed`.
pub fn public_key(seed: &[u8; 32]) -> [u8; 32] {
    *pair(seed).pk
}

/// A node's memory.
pub type Memory = FlashMemory<Chip, Ed25519>;

/// What a new node finds: the factory's program, room for events, which its first start in the
/// factory has made, and no records.
pub fn blank() -> Memory {
    let mut chip = Chip::default();
    let image = image(Slot::A, FACTORY, SOUND);
    chip.burn(RC.a, &image);
    chip.burn_at(RC.a.start + MARKS, &factory_marks());
    let build = Build {
        layout: &RC,
        running: Slot::A,
        hardware: HARDWARE,
    };
    let signatures = Ed25519 {
        key: *pair(DEVELOPMENT).pk,
        unsigned: false,
    };
    let mut memory = FlashMemory::new(chip, build, signatures);
    // Neither refuses anything in a new flash.
    let _ = RecordStore::start(&mut memory);
    while memory.needs_room() && memory.make_room().is_ok() {}
    memory.flash_mut().take_erase_ns();
    memory
}

/// The file of an image for `slot` with this body, a multiple of 4 bytes long, signed with
/// [`DEVELOPMENT`].
///
/// # Panics
/// When the part has no such slot.
pub fn image(slot: Slot, version: Version, body: &[u8]) -> Vec<u8> {
    let mut file = unsigned(slot, HARDWARE, version, body);
    sign(&mut file, DEVELOPMENT);
    file
}

/// The file of an image without a signature.
///
/// # Panics
/// When the part has no such slot.
pub fn unsigned(slot: Slot, hardware: u32, version: Version, body: &[u8]) -> Vec<u8> {
    let region = RC.slot(slot).expect("the RC has both slots");
    let header = Header {
        signature: Signature::None,
        hardware,
        version,
        address: BASE + region.start + HEADER,
        length: body.len() as u32,
        crc: Crc32::of(body),
    };
    let mut file = vec![u8::MAX; HEADER as usize];
    file[..FIELDS].copy_from_slice(&header.encode());
    file.extend_from_slice(body);
    file
}

fn pair(seed: &[u8; 32]) -> KeyPair {
    KeyPair::from_seed(Seed::new(*seed))
}

/// Signs the file of one image with the secret key `seed`: its header states it from then on.
///
/// # Panics
/// When it does not begin with a header.
pub fn sign(file: &mut [u8], seed: &[u8; 32]) {
    let header = Header::parse(file).expect("a header");
    let signature = Signature::Ed25519;
    let fields = Header {
        signature,
        ..header
    }
    .encode();
    file[..FIELDS].copy_from_slice(&fields);
    let signed = [&file[..SIGNATURE_AT as usize], &file[HEADER as usize..]].concat();
    let signature = pair(seed).sk.sign(signed, None);
    file[SIGNATURE_AT as usize..][..SIGNATURE].copy_from_slice(&*signature);
}

/// What the image that was started does, which its body sets: the simulation runs none of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// It works.
    Sound,
    /// It does not get to its samples, so it never passes its trial: a body of [`SICK`].
    Sick,
}

/// The body of an image that works.
pub const SOUND: &[u8] = b"plumb host program.\n";

/// How the body of an image begins that fails its trial.
pub const SICK: &[u8] = b"plumb host program, sick";

/// The bootloader: chooses the image to start, and what that one does; `None` where there is none.
pub fn boot(memory: &mut Memory) -> Option<Program> {
    let Decision::Run(slot, header, _) = slots::boot(memory.flash_mut(), &RC, HARDWARE) else {
        return None;
    };
    memory.set_running(slot);
    let mut body = [0; SICK.len()];
    let at = header.address - BASE;
    let read = memory.flash_mut().read(at, &mut body);
    Some(match read {
        Ok(()) if body == SICK => Program::Sick,
        _ => Program::Sound,
    })
}

/// The chip's flash, which can be broken.
#[derive(Clone, Debug)]
pub struct Chip {
    nor: Nor<Vec<Page>, Bits>,
    broken: bool,
    /// What sets how long erases take.
    pace: Rng,
    /// Time of the erases that nobody has asked for yet, ns.
    erase_ns: u64,
}

/// How long the erase of a page takes, at least and at most, ns (data sheet of the STM32F103xC,
/// 5.3.9).
pub const ERASE_NS: [f64; 2] = [20e6, 40e6];

/// The random bits that a cut leaves.
#[derive(Clone, Debug)]
pub struct Bits(Rng);

impl Draw for Bits {
    fn draw(&mut self) -> u32 {
        (self.0.uniform() * 4_294_967_296.0) as u32
    }
}

impl Default for Chip {
    fn default() -> Self {
        let pages = vec![Page::new(); (RC.flash / PAGE) as usize];
        Self {
            nor: Nor::new(pages, Bits(Rng::stream(0, "flash"))),
            broken: false,
            pace: Rng::stream(0, "erases"),
            erase_ns: 0,
        }
    }
}

impl Chip {
    /// How long erases take is drawn from here from now on.
    pub fn set_pace(&mut self, pace: Rng) {
        self.pace = pace;
    }

    /// How long the erases since the last call have taken, ns.
    pub const fn take_erase_ns(&mut self) -> u64 {
        std::mem::replace(&mut self.erase_ns, 0)
    }

    /// From now on every write fails, as a worn-out flash would.
    pub const fn set_broken(&mut self, broken: bool) {
        self.broken = broken;
    }

    /// The model behind it, for cuts and counts.
    pub const fn nor(&mut self) -> &mut Nor<Vec<Page>, Bits> {
        &mut self.nor
    }

    /// Erases a region and writes `bytes` to it, as the debug port does in the factory.
    ///
    /// # Panics
    /// When the flash refuses.
    fn burn(&mut self, region: Region, bytes: &[u8]) {
        let erased = self.nor.erase(region.start, region.end());
        erased.expect("a sound flash");
        self.burn_at(region.start, bytes);
    }

    fn burn_at(&mut self, at: u32, bytes: &[u8]) {
        for (at, half_word) in (at..).step_by(2).zip(bytes.chunks(2)) {
            if half_word != [u8::MAX; 2] {
                self.nor.write(at, half_word).expect("an erased flash");
            }
        }
    }
}

/// Why the chip did not do what was asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChipError {
    /// It is broken.
    Broken,
    /// See [`NorError`].
    Nor(NorError),
}

impl NorFlashError for ChipError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Broken => NorFlashErrorKind::Other,
            Self::Nor(error) => error.kind(),
        }
    }
}

impl ErrorType for Chip {
    type Error = ChipError;
}

impl ReadNorFlash for Chip {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), ChipError> {
        self.nor.read(offset, bytes).map_err(ChipError::Nor)
    }

    fn capacity(&self) -> usize {
        self.nor.capacity()
    }
}

impl NorFlash for Chip {
    const WRITE_SIZE: usize = 2;
    const ERASE_SIZE: usize = PAGE as usize;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), ChipError> {
        if self.broken {
            return Err(ChipError::Broken);
        }
        for _ in from / PAGE..to / PAGE {
            let [least, most] = ERASE_NS;
            self.erase_ns += self.pace.range(least, most) as u64;
        }
        self.nor.erase(from, to).map_err(ChipError::Nor)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), ChipError> {
        if self.broken {
            return Err(ChipError::Broken);
        }
        self.nor.write(offset, bytes).map_err(ChipError::Nor)
    }
}
