//! The verifier of signatures: one beside the bootloader, called by whichever application runs.
//!
//! In: the seal at the end of the bootloader's region ([`flash::seal`]). Out: for the application,
//! [`Verifier`], which is a [`Signatures`] like the one that the host has; for the bootloader, the
//! three functions and [`SEAL`]. The functions have no statics: their state is the caller's, and
//! their stack as well, so that interrupts are served meanwhile as at any other time.
//!
//! A verifier that is missing, damaged or of another version lets nothing in.

use core::mem::MaybeUninit;

use device::memory::ed25519::{Ed25519, Error, KEY, VerifyingState};
use device::memory::update::Signatures;
use flash::image::SIGNATURE;
use flash::seal;

use super::nor::Reader;
use crate::part::{LAYOUT, SIGNATURES};

/// What a check remembers between its calls, as the library gives it.
type Inner = Result<VerifyingState, Error>;

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
    magic: seal::VERIFIER,
    begin,
    add,
    is_good,
    state: size_of::<State>() as u32,
};

/// # Safety
/// The pointers are valid; the state is filled in when this has returned.
unsafe extern "C" fn begin(
    state: *mut State,
    key: *const [u8; KEY],
    signature: *const [u8; SIGNATURE],
) -> bool {
    // SAFETY: the caller's promise; there is room for it, aligned.
    let (state, key, signature) = unsafe {
        let state = &mut *state.cast::<MaybeUninit<Inner>>();
        (state, *key, &*signature)
    };
    let unsigned = false;
    // It is never dropped, as nothing in it is a secret or somebody else's.
    (Ed25519 { key, unsigned }).check(state, signature)
}

/// # Safety
/// `begin` has filled in the state, and there are so many bytes.
unsafe extern "C" fn add(state: *mut State, bytes: *const u8, length: usize) {
    // SAFETY: the caller's promise.
    let (check, bytes) = unsafe {
        let check = &mut *state.cast::<Inner>();
        (check, core::slice::from_raw_parts(bytes, length))
    };
    if let Ok(check) = check {
        Ed25519::take_in(check, bytes);
    }
}

/// # Safety
/// `begin` has filled in the state.
unsafe extern "C" fn is_good(state: *const State) -> bool {
    // SAFETY: the caller's promise.
    let check = unsafe { &*state.cast::<Inner>() };
    check.as_ref().is_ok_and(Ed25519::fits)
}

/// Lets images in that the holder of [`SIGNATURES`]' key has signed, by the bootloader's verifier.
pub struct Verifier;

/// A check under way; its place as long as there are no calls.
pub struct Check {
    calls: Option<(Add, IsGood)>,
    state: State,
}

/// The functions of a seal that was found whole.
fn calls(seal: flash::seal::Seal) -> (Begin, Add, IsGood) {
    let [begin, add, is_good] = seal.calls;
    // SAFETY: the region's check sum is right, so these are the functions that were linked into
    // the seal, of the types that its version stands for.
    unsafe {
        (
            core::mem::transmute::<usize, Begin>(begin as usize),
            core::mem::transmute::<usize, Add>(add as usize),
            core::mem::transmute::<usize, IsGood>(is_good as usize),
        )
    }
}

impl Signatures for Verifier {
    type Check = Check;

    fn unsigned(&self) -> bool {
        SIGNATURES.unsigned
    }

    fn place(&self) -> Check {
        Check {
            calls: None,
            state: State([MaybeUninit::uninit(); _]),
        }
    }

    fn begin(&self, check: &mut Check, signature: &[u8; SIGNATURE]) -> bool {
        let Ok(seal) = flash::seal::Seal::find(&mut Reader(&LAYOUT), LAYOUT.boot, seal::VERIFIER)
        else {
            return false;
        };
        if seal.state as usize > size_of::<State>() {
            return false;
        }
        let (begin, add, is_good) = calls(seal);
        // SAFETY: all three are there, and the state has as much room as it needs.
        let begun = unsafe { begin(&raw mut check.state, &SIGNATURES.key, signature) };
        check.calls = begun.then_some((add, is_good));
        begun
    }

    fn add(&self, check: &mut Check, bytes: &[u8]) {
        if let Some((add, _)) = check.calls {
            // SAFETY: `begin` has filled in the state.
            unsafe { add(&raw mut check.state, bytes.as_ptr(), bytes.len()) };
        }
    }

    fn is_good(&self, check: &Check) -> bool {
        // SAFETY: `begin` has filled in the state.
        let is_good = |(_, is_good): (Add, IsGood)| unsafe { is_good(&raw const check.state) };
        check.calls.is_some_and(is_good)
    }
}
