//! Slots: which image starts, and how a new one is tried, confirmed or rolled back.
//!
//! In: the flash and its map. Out: a [`Decision`] for the bootloader, and the marks that lead from
//! one state to the next. [`decide`] is a pure function of what both slots show.
//!
//! # Marks, bytes 256 to 511 of the image's header
//!
//! | byte | content |
//! |---|---|
//! | 256 to 287 | four places for an activation, of which the first that is free is used |
//! | 288 to 293 | three attempts: FFFFh free, anything else used |
//! | 294, 295 | FFh |
//! | 296 to 303 | confirmed when 16 of the 64 bits are 0 |
//! | 304 to 511 | FFh |
//!
//! An activation is a generation (4 bytes) and the CRC-32 of "PLMG" and these bytes, little-endian.
//! Every half-word of the marks is programmed once at most, and all are erased with the slot. The
//! generation counts activations, so it shows which of two confirmed images is newer, also after a
//! permitted downgrade. One bit that goes bad does not confirm an image, takes at most one attempt
//! away, and makes an activation void.
//!
//! # States of a slot
//!
//! | state | image whole | activated | attempts left | confirmed | starts |
//! |---|---|---|---|---|---|
//! | bad | no | - | - | - | never |
//! | idle | yes | no | - | - | never |
//! | trial | yes | yes | yes | no | before any of a lower generation; takes an attempt |
//! | spent | yes | yes | no | no | never |
//! | confirmed | yes | yes | - | yes | before any of a lower generation |
//!
//! # Transitions, and what a loss of supply in the middle leaves
//!
//! | from | to | by | written | cut |
//! |---|---|---|---|---|
//! | any | bad | [`install`](crate::install), its start | first page erased | bad, or as before |
//! | bad | idle | [`install`](crate::install) | header, then body | bad |
//! | idle | trial | [`put_on_trial`] | generation, then its CRC | idle; the place is used up |
//! | trial | trial, spent | [`boot`] | one attempt | one attempt less, or as before |
//! | trial | confirmed | [`confirm`] after the self-check | four half-words | trial, or confirmed |
//! | any | bad | a bit of header or body goes bad | - | - |
//!
//! An install begins only while the other slot runs and is confirmed.
//!
//! # What starts
//! Both slots count from the higher generation to the lower:
//!
//! | newer | older | starts |
//! |---|---|---|
//! | confirmed | any | newer |
//! | trial | any | newer, one attempt less |
//! | spent, bad or idle | confirmed | older; "rolled back" behind a spent one |
//! | spent, bad or idle | trial | older, one attempt less |
//! | spent, bad or idle | spent, bad, idle or absent | none: [`NoStart`] states why |
//!
//! A part with one slot gets its image and its marks ([`factory_marks`]) over the debug port.
//!
//! Left out: the check of the signature, which belongs between installing and [`put_on_trial`].

use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};

use crate::access::{AccessError, is_blank, program, read};
use crate::check_sum::Crc32;
use crate::image::{Header, ImageError, verify};
use crate::layout::{HEADER, Layout, Region, Slot};

/// Offset in a slot of its marks.
pub const MARKS: u32 = 256;

/// How often an image on trial is started before it counts as failed.
pub const ATTEMPTS: u8 = 3;

/// Places for an activation.
const PLACES: u32 = 4;

/// Bytes of an activation.
const ACTIVATION: u32 = 8;

const ATTEMPTS_AT: u32 = MARKS + PLACES * ACTIVATION;
const CONFIRMED_AT: u32 = ATTEMPTS_AT + 8;

/// Bits that have to be 0 before an image counts as confirmed.
const CONFIRMED_BITS: u32 = 16;

/// What the marks of a slot hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Marks {
    /// The number of its activation; `None`: it was not activated.
    pub generation: Option<u32>,
    /// Attempts to start it that are left, 0 to [`ATTEMPTS`].
    pub left: u8,
    /// Whether it was confirmed.
    pub confirmed: bool,
}

/// What is in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlotState {
    /// The part has no such slot.
    Absent,
    /// No image that is whole and for this slot.
    Bad(ImageError),
    /// An image that was never activated.
    Idle(Header),
    /// An image on trial, with attempts left.
    Trial(Header, Marks),
    /// An image that used up its attempts without being confirmed.
    Spent(Header, Marks),
    /// A confirmed image.
    Confirmed(Header, Marks),
}

/// Why an image is the one to start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// It is confirmed, and nothing newer failed.
    Confirmed,
    /// It is on trial, and this is an attempt.
    Trial,
    /// It is confirmed, and a newer one was not confirmed within its attempts.
    RolledBack,
}

/// Why no image starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoStart {
    /// Nothing was ever written to a slot.
    Empty,
    /// No slot has an image that is whole.
    Bad,
    /// There is a whole image, but none was activated.
    Idle,
    /// An image used up its attempts, and there is no other.
    Spent,
}

/// What the bootloader does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Start the image in this slot.
    Run(Slot, Header, Why),
    /// Stay in the bootloader.
    Stay(NoStart),
}

/// Why a slot's state was not changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlotError {
    /// The part has no such slot.
    Absent,
    /// The slot holds no whole image.
    Image(ImageError),
    /// The image was not activated.
    Idle,
    /// The image used up its attempts, or all places for its mark: install it anew.
    Spent,
    /// The flash refused, or did not hold what was written to it.
    Access(AccessError),
}

impl From<AccessError> for SlotError {
    fn from(error: AccessError) -> Self {
        Self::Access(error)
    }
}

fn activation(generation: u32) -> [u8; ACTIVATION as usize] {
    let mut crc = Crc32::new();
    crc.add(b"PLMG");
    crc.add(&generation.to_le_bytes());
    let both = u64::from(crc.value()) << 32 | u64::from(generation);
    both.to_le_bytes()
}

/// The marks of an image that leaves the factory confirmed: bytes [`MARKS`] to 511 of its file.
pub fn factory_marks() -> [u8; (HEADER - MARKS) as usize] {
    let mut bytes = [u8::MAX; (HEADER - MARKS) as usize];
    let confirmed = (CONFIRMED_AT - MARKS) as usize;
    for (byte, mark) in bytes.iter_mut().zip(activation(0)) {
        *byte = mark;
    }
    for byte in bytes.iter_mut().skip(confirmed).take(8) {
        *byte = 0;
    }
    bytes
}

/// Reads the marks of `slot`; the image is not looked at.
///
/// Errors: [`AccessError::Refused`].
pub fn marks<F: ReadNorFlash>(flash: &mut F, slot: Region) -> Result<Marks, AccessError> {
    let mut bytes = [0; (CONFIRMED_AT + 8 - MARKS) as usize];
    read(flash, slot.start + MARKS, &mut bytes)?;
    let (words, _) = bytes.as_chunks::<{ ACTIVATION as usize }>();
    let (places, [attempts, confirmed]) = words.split_last_chunk().unwrap_or((&[], &[[0; 8]; 2]));
    let generation_of = |place: &[u8; 8]| {
        let [a, b, c, d, ..] = *place;
        let generation = u32::from_le_bytes([a, b, c, d]);
        (activation(generation) == *place).then_some(generation)
    };
    let (attempts, _) = attempts.as_chunks::<2>();
    let attempts = attempts.iter().take(usize::from(ATTEMPTS));
    let left = attempts.filter(|attempt| **attempt == [u8::MAX; 2]).count();
    Ok(Marks {
        generation: places.iter().filter_map(generation_of).max(),
        left: left as u8,
        confirmed: u64::from_le_bytes(*confirmed).count_zeros() >= CONFIRMED_BITS,
    })
}

/// Finds out what is in `slot`. Reads all of the image.
pub fn standing<F: ReadNorFlash>(flash: &mut F, slot: Option<Region>, hardware: u32) -> SlotState {
    let Some(slot) = slot else {
        return SlotState::Absent;
    };
    let header = match verify(flash, slot, hardware) {
        Ok(header) => header,
        Err(error) => return SlotState::Bad(error),
    };
    match marks(flash, slot) {
        Err(error) => SlotState::Bad(ImageError::Access(error)),
        Ok(marks) if marks.generation.is_none() => SlotState::Idle(header),
        Ok(marks) if marks.confirmed => SlotState::Confirmed(header, marks),
        Ok(marks) if marks.left > 0 => SlotState::Trial(header, marks),
        Ok(marks) => SlotState::Spent(header, marks),
    }
}

impl SlotState {
    fn generation(&self) -> Option<u32> {
        match self {
            Self::Trial(_, marks) | Self::Spent(_, marks) | Self::Confirmed(_, marks) => {
                marks.generation
            }
            Self::Absent | Self::Bad(_) | Self::Idle(_) => None,
        }
    }

    const fn no_start(&self) -> NoStart {
        match self {
            Self::Absent | Self::Bad(ImageError::Magic) => NoStart::Empty,
            Self::Bad(_) => NoStart::Bad,
            Self::Idle(_) => NoStart::Idle,
            // The others start.
            Self::Spent(..) | Self::Trial(..) | Self::Confirmed(..) => NoStart::Spent,
        }
    }
}

/// Which image starts; the table is in the module's documentation.
pub fn decide(a: &SlotState, b: &SlotState) -> Decision {
    let mut order = [(Slot::A, a), (Slot::B, b)];
    if b.generation() > a.generation() {
        order.reverse();
    }
    let mut rolled_back = false;
    for (slot, standing) in order {
        match standing {
            SlotState::Trial(header, _) => return Decision::Run(slot, *header, Why::Trial),
            SlotState::Confirmed(header, _) if rolled_back => {
                return Decision::Run(slot, *header, Why::RolledBack);
            }
            SlotState::Confirmed(header, _) => {
                return Decision::Run(slot, *header, Why::Confirmed);
            }
            SlotState::Spent(..) => rolled_back = true,
            SlotState::Absent | SlotState::Bad(_) | SlotState::Idle(_) => {}
        }
    }
    let (a, b) = (a.no_start(), b.no_start());
    Decision::Stay(if (a as u8) < b as u8 { b } else { a })
}

/// What the bootloader does at a start: looks at both slots, decides, and takes an attempt of an
/// image on trial before it is started.
///
/// Where the attempt can't be written, the image is passed over: it could go on failing for ever.
pub fn boot<F: NorFlash>(flash: &mut F, layout: &Layout, hardware: u32) -> Decision {
    let mut a = standing(flash, Some(layout.a), hardware);
    let mut b = standing(flash, layout.b, hardware);
    let mut decision = decide(&a, &b);
    // A slot each, so two rounds at most.
    while let Decision::Run(slot, header, Why::Trial) = decision {
        let (region, place) = match slot {
            Slot::A => (Some(layout.a), &mut a),
            Slot::B => (layout.b, &mut b),
        };
        if region.is_some_and(|region| take_attempt(flash, region).is_ok()) {
            return decision;
        }
        let generation = place.generation();
        *place = SlotState::Spent(
            header,
            Marks {
                generation,
                left: 0,
                confirmed: false,
            },
        );
        decision = decide(&a, &b);
    }
    decision
}

/// Uses up one attempt of the image in `slot`.
fn take_attempt<F: NorFlash>(flash: &mut F, slot: Region) -> Result<(), SlotError> {
    for attempt in 0..u32::from(ATTEMPTS) {
        let at = slot.start + ATTEMPTS_AT + 2 * attempt;
        if is_blank(flash, at, 2)? {
            return Ok(program(flash, at, &[0; 2])?);
        }
    }
    Err(SlotError::Spent)
}

/// [`put_on_trial`] of an image that is checked first, which takes its time.
///
/// Errors: any of [`SlotError`] but [`SlotError::Idle`].
pub fn activate<F: NorFlash>(
    flash: &mut F,
    layout: &Layout,
    slot: Slot,
    hardware: u32,
) -> Result<u32, SlotError> {
    let region = layout.slot(slot).ok_or(SlotError::Absent)?;
    verify(flash, region, hardware).map_err(SlotError::Image)?;
    put_on_trial(flash, layout, slot)
}

/// Puts the image in `slot`, which was found whole, on trial: from the next start on it runs
/// before the other.
///
/// Once is enough; a second time changes nothing. Returns the generation. Errors:
/// [`SlotError::Absent`], [`SlotError::Access`], and [`SlotError::Spent`] after four activations
/// that were cut.
pub fn put_on_trial<F: NorFlash>(
    flash: &mut F,
    layout: &Layout,
    slot: Slot,
) -> Result<u32, SlotError> {
    let region = layout.slot(slot).ok_or(SlotError::Absent)?;
    if let Some(generation) = marks(flash, region)?.generation {
        return Ok(generation);
    }
    let other = match layout.slot(slot.other()) {
        Some(other) => marks(flash, other)?.generation,
        None => None,
    };
    let generation = other.map_or(0, |other| other.saturating_add(1));
    for place in 0..PLACES {
        let at = region.start + MARKS + ACTIVATION * place;
        if is_blank(flash, at, ACTIVATION)? {
            program(flash, at, &activation(generation))?;
            return Ok(generation);
        }
    }
    Err(SlotError::Spent)
}

/// Confirms the image in `slot`: for the running application, after its self-check.
///
/// Once is enough; a second time changes nothing. Errors: [`SlotError::Absent`],
/// [`SlotError::Idle`], [`SlotError::Spent`] (the mark's place is used up by cuts), and
/// [`SlotError::Access`].
pub fn confirm<F: NorFlash>(flash: &mut F, layout: &Layout, slot: Slot) -> Result<(), SlotError> {
    let region = layout.slot(slot).ok_or(SlotError::Absent)?;
    let before = marks(flash, region)?;
    if before.generation.is_none() {
        return Err(SlotError::Idle);
    }
    if before.confirmed {
        return Ok(());
    }
    for half_word in 0..4 {
        let at = region.start + CONFIRMED_AT + 2 * half_word;
        // What a cut has left half done stays as it is; the rest is enough.
        if is_blank(flash, at, 2)? {
            program(flash, at, &[0; 2])?;
        }
    }
    if marks(flash, region)?.confirmed {
        Ok(())
    } else {
        Err(SlotError::Spent)
    }
}

#[cfg(test)]
mod tests;
