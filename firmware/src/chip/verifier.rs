//! The verifier of signatures: one beside the bootloader, called by whichever application runs.
//!
//! In: the seal at the end of the bootloader's region ([`flash::seal`]). Out: for the application,
//! [`Verifier`], which is a [`Signatures`] like the one that the host has; for the bootloader, the
//! three functions and [`SEAL`]. The functions have no statics: their state is the caller's, and
//! their stack as well, so that interrupts are served meanwhile as at any other time.
//!
//! A verifier that is missing, damaged or of another version lets nothing in.

use core::mem::MaybeUninit;

use device::memory::ed25519::{Ed25519, KEY};
use device::memory::update::Signatures;
use flash::image::SIGNATURE;
use flash::seal::{self, SealError};

use super::nor::Reader;
use crate::part::{LAYOUT, SIGNATURES};

/// What a check remembers between its calls, as the library has it.
type Inner = <Ed25519 as Signatures>::Check;

/// Room for [`Inner`], which the application does not look into.
#[repr(C, align(8))]
pub struct State([MaybeUninit<u8>; size_of::<Inner>()]);

const _: () = assert!(align_of::<State>() >= align_of::<Inner>());

/// Begins the check of a signature by the holder of a key; false when no bytes can fit it.
type Begin = unsafe extern "C" fn(*mut State, *const [u8; KEY], *const [u8; SIGNATURE]) -> bool;
/// Takes in so many bytes.
type Add = unsafe extern "C" fn(*mut State, *const u8, usize);
/// Whether the signature was made of the bytes taken in.
type IsGood = unsafe extern "C" fn(*const State) -> bool;

/// What stands at the end of the bootloader's region; the check sum comes behind it.
#[repr(C)]
pub struct Seal {
    magic: u32,
    begin: Begin,
    add: Add,
    is_good: IsGood,
    state: u32,
}

/// The bootloader's seal.
pub const SEAL: Seal = Seal {
    magic: seal::MAGIC,
    begin,
    add,
    is_good,
    state: size_of::<State>() as u32,
};

/// # Safety
/// The pointers are valid; the state is filled in when this returns true.
unsafe extern "C" fn begin(
    state: *mut State,
    key: *const [u8; KEY],
    signature: *const [u8; SIGNATURE],
) -> bool {
    // SAFETY: the caller's promise.
    let (key, signature) = unsafe { (*key, &*signature) };
    let unsigned = false;
    match (Ed25519 { key, unsigned }).begin(signature) {
        Ok(check) => {
            // SAFETY: there is room for it, aligned; it is never dropped, as nothing in it is a
            // secret or somebody else's.
            unsafe { state.cast::<Inner>().write(check) };
            true
        }
        Err(_) => false,
    }
}

/// # Safety
/// `begin` has filled in the state, and there are so many bytes.
unsafe extern "C" fn add(state: *mut State, bytes: *const u8, length: usize) {
    // SAFETY: the caller's promise.
    let (check, bytes) = unsafe {
        let check = &mut *state.cast::<Inner>();
        (check, core::slice::from_raw_parts(bytes, length))
    };
    SIGNATURES.add(check, bytes);
}

/// # Safety
/// `begin` has filled in the state.
unsafe extern "C" fn is_good(state: *const State) -> bool {
    // SAFETY: the caller's promise.
    SIGNATURES.is_good(unsafe { &*state.cast::<Inner>() })
}

/// Lets images in that the holder of [`SIGNATURES`]' key has signed, by the bootloader's verifier.
pub struct Verifier;

/// A check under way.
pub struct Check {
    add: Add,
    is_good: IsGood,
    state: State,
}

/// Why a signature is not looked at.
pub enum Refusal {
    /// There is no verifier to ask.
    Verifier,
    /// The verifier refuses the signature, whatever it is of.
    Signature,
}

impl From<SealError> for Refusal {
    fn from(_: SealError) -> Self {
        Self::Verifier
    }
}

/// The functions of a seal that was found whole.
fn calls(seal: flash::seal::Seal) -> (Begin, Add, IsGood) {
    // SAFETY: the region's check sum is right, so these are the functions that were linked into
    // the seal, of the types that its version stands for.
    unsafe {
        (
            core::mem::transmute::<usize, Begin>(seal.begin as usize),
            core::mem::transmute::<usize, Add>(seal.add as usize),
            core::mem::transmute::<usize, IsGood>(seal.is_good as usize),
        )
    }
}

impl Signatures for Verifier {
    type Check = Check;
    type Refusal = Refusal;

    fn unsigned(&self) -> bool {
        SIGNATURES.unsigned
    }

    fn begin(&self, signature: &[u8; SIGNATURE]) -> Result<Check, Refusal> {
        let seal = flash::seal::Seal::find(&mut Reader, LAYOUT.boot)?;
        if seal.state as usize > size_of::<State>() {
            return Err(Refusal::Verifier);
        }
        let (begin, add, is_good) = calls(seal);
        let state = State([MaybeUninit::uninit(); _]);
        let mut check = Check {
            add,
            is_good,
            state,
        };
        // SAFETY: all three are there, and the state has as much room as it needs.
        let begun = unsafe { begin(&raw mut check.state, &SIGNATURES.key, signature) };
        // The state has nothing in it that points to itself: it may move.
        if begun {
            Ok(check)
        } else {
            Err(Refusal::Signature)
        }
    }

    fn add(&self, check: &mut Check, bytes: &[u8]) {
        // SAFETY: `begin` has made the check.
        unsafe { (check.add)(&raw mut check.state, bytes.as_ptr(), bytes.len()) };
    }

    fn is_good(&self, check: &Check) -> bool {
        // SAFETY: `begin` has made the check.
        unsafe { (check.is_good)(&raw const check.state) }
    }
}
