//! Signatures by Ed25519 (RFC 8032).
//!
//! In: a signature of 64 bytes, header and body of an image in pieces, the public key that the
//! program was built with. Out: whether the holder of the secret key has signed them.
//!
//! `docs/design-decisions.md` has what else was measured; `docs/cost.md` counts the check of an
//! update. On the chip it stands beside the bootloader, once for both slots.
//!
//! Left out: keys, and making signatures, which is the host's.

use core::mem::MaybeUninit;

pub use ed25519_compact::{Error, VerifyingState};
use ed25519_compact::{PublicKey, Signature};
use flash::image::SIGNATURE;

use super::update::Signatures;

/// Bytes of a public key.
pub const KEY: usize = 32;

/// A key that was never given. As a point of the curve it has the order 4, for which signatures are
/// made without any secret.
const BLANK: [u8; KEY] = [0; KEY];

/// Lets images in that the holder of one key has signed, and, if `unsigned`, those without any
/// signature. A key of zeros, or one that is no point of the curve, lets nothing in that is signed.
#[derive(Clone, Copy, Debug)]
pub struct Ed25519 {
    /// The public key.
    pub key: [u8; KEY],
    /// Whether an image without a signature is let in.
    pub unsigned: bool,
}

/// Out of line, so that the library's arithmetic doesn't spread into its callers: they keep small
/// frames, and whoever looks for panics knows where these come from.
impl Ed25519 {
    /// Makes the check of a signature in its place, before the first byte; false when the key or
    /// the signature can't be good for any.
    ///
    /// What is made is the library's result: to take the check out of it would copy 0.6 kB.
    #[inline(never)]
    pub fn check(
        &self,
        place: &mut MaybeUninit<Result<VerifyingState, Error>>,
        signature: &[u8; SIGNATURE],
    ) -> bool {
        place.write(self.made(signature)).is_ok()
    }

    /// Inlined where it is made, which spares a copy.
    #[inline(always)]
    fn made(&self, signature: &[u8; SIGNATURE]) -> Result<VerifyingState, Error> {
        if self.key == BLANK {
            return Err(Error::InvalidPublicKey);
        }
        let key = PublicKey::new(self.key);
        key.verify_incremental(&Signature::new(*signature))
    }

    /// Takes in the next bytes of what is signed.
    #[inline(never)]
    pub fn take_in(check: &mut VerifyingState, bytes: &[u8]) {
        check.absorb(bytes);
    }

    /// Whether the signature is of the bytes taken in.
    #[inline(never)]
    pub fn fits(check: &VerifyingState) -> bool {
        check.verify().is_ok()
    }
}

impl Signatures for Ed25519 {
    type Check = Option<VerifyingState>;

    fn unsigned(&self) -> bool {
        self.unsigned
    }

    fn place(&self) -> Self::Check {
        None
    }

    fn begin(&self, check: &mut Self::Check, signature: &[u8; SIGNATURE]) -> bool {
        *check = self.made(signature).ok();
        check.is_some()
    }

    fn add(&self, check: &mut Self::Check, bytes: &[u8]) {
        if let Some(check) = check {
            Self::take_in(check, bytes);
        }
    }

    fn is_good(&self, check: &Self::Check) -> bool {
        check.as_ref().is_some_and(Self::fits)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use ed25519_compact::{KeyPair, Seed};

    use super::*;

    fn signed(message: &[u8]) -> ([u8; SIGNATURE], Ed25519) {
        let pair = KeyPair::from_seed(Seed::new([7; 32]));
        let known = Ed25519 {
            key: *pair.pk,
            unsigned: false,
        };
        (*pair.sk.sign(message, None), known)
    }

    fn is_good(known: &Ed25519, message: &[u8], signature: &[u8; 64], piece: usize) -> bool {
        let mut check = known.place();
        if !known.begin(&mut check, signature) {
            return false;
        }
        for bytes in message.chunks(piece) {
            known.add(&mut check, bytes);
        }
        known.is_good(&check)
    }

    #[test]
    fn pieces_of_any_size_make_the_same_message() {
        let message: Vec<u8> = (0..1000_u32).map(|n| n as u8).collect();
        let (signature, known) = signed(&message);
        for piece in [1, 32, 127, 128, 129, 1000] {
            assert!(is_good(&known, &message, &signature, piece), "{piece}");
        }
    }

    #[test]
    fn one_bit_of_message_signature_or_key_makes_it_wrong() {
        let (signature, known) = signed(b"plumb");
        assert!(is_good(&known, b"plumb", &signature, 32));
        assert!(!is_good(&known, b"plump", &signature, 32));
        for bit in 0..512 {
            let mut other = signature;
            other[bit / 8] ^= 1 << (bit % 8);
            assert!(!is_good(&known, b"plumb", &other, 32), "{bit}");
        }
        for bit in 0..256 {
            let mut other = known;
            other.key[bit / 8] ^= 1 << (bit % 8);
            assert!(!is_good(&other, b"plumb", &signature, 32), "{bit}");
        }
    }

    /// 32 bytes of 0 are a point of order 4: a quarter of all messages fit R = 1, s = 0.
    #[test]
    fn a_key_that_was_left_blank_took_every_fourth_forgery() {
        let known = Ed25519 {
            key: [0; KEY],
            unsigned: false,
        };
        let mut forged = [0; SIGNATURE];
        forged[0] = 1;
        for message in 0..64_u8 {
            assert!(!is_good(&known, &[message], &forged, 32), "{message}");
        }
    }

    /// RFC 8032 7.1, test 3, as the crate itself has to pass it.
    #[test]
    fn the_library_agrees_with_the_standard() {
        let hex = |text: &str| -> Vec<u8> {
            let digits = text.as_bytes().chunks(2);
            let pairs = digits.map(|pair| std::str::from_utf8(pair).unwrap());
            pairs
                .map(|pair| u8::from_str_radix(pair, 16).unwrap())
                .collect()
        };
        let key = "fc51cd8e6218a1a38da47ed00230f0580816ed13ba3303ac5deb911548908025";
        let signature = "6291d657deec24024827e69c3abe01a30ce548a284743a445e3680d7db5ac3ac\
                         18ff9b538d16f290ae67f760984dc6594a7c15e9716ed28dc027beceea1ec40a";
        let key: [u8; 32] = hex(key).try_into().unwrap();
        let signature: [u8; 64] = hex(signature).try_into().unwrap();
        let known = Ed25519 {
            key,
            unsigned: false,
        };
        assert!(is_good(&known, &[0xAF, 0x82], &signature, 1));
    }
}
