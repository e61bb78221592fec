//! Signatures by Ed25519 (RFC 8032) over the SHA-512 of what is signed.
//!
//! In: header and body of an image in pieces, a signature of 64 bytes, the public key that the
//! program was built with. Out: whether the holder of the secret key has signed them. The SHA-512
//! comes first so that an image is read once, in pieces; what is signed is its 64 bytes.
//!
//! Left out: keys, and making signatures, which is the host's.

use flash::image::SIGNATURE;
use salty::{PublicKey, Sha512, Signature};

use super::update::Signatures;

/// Bytes of a public key.
pub const KEY: usize = 32;

/// Lets images in that the holder of one key has signed, and, if `unsigned`, those without any
/// signature. A key that is no point of the curve lets nothing in.
#[derive(Clone, Copy, Debug)]
pub struct Ed25519 {
    /// The public key.
    pub key: [u8; KEY],
    /// Whether an image without a signature is let in.
    pub unsigned: bool,
}

impl Signatures for Ed25519 {
    type Digest = Sha512;

    fn unsigned(&self) -> bool {
        self.unsigned
    }

    fn begin(&self) -> Sha512 {
        Sha512::new()
    }

    fn add(&self, digest: &mut Sha512, bytes: &[u8]) {
        digest.update(bytes);
    }

    fn is_good(&self, digest: Sha512, signature: &[u8; SIGNATURE]) -> bool {
        let Ok(key) = PublicKey::try_from(&self.key) else {
            return false;
        };
        let signature = Signature::from(signature);
        key.verify(&digest.finalize(), &signature).is_ok()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use salty::Keypair;

    use super::*;

    fn signed(message: &[u8]) -> ([u8; SIGNATURE], Ed25519) {
        let pair = Keypair::from(&[7; 32]);
        let mut digest = Sha512::new();
        digest.update(message);
        let signature = pair.sign(&digest.finalize()).to_bytes();
        let known = Ed25519 {
            key: pair.public.to_bytes(),
            unsigned: false,
        };
        (signature, known)
    }

    fn is_good(known: &Ed25519, message: &[u8], signature: &[u8; 64], piece: usize) -> bool {
        let mut digest = known.begin();
        for bytes in message.chunks(piece) {
            known.add(&mut digest, bytes);
        }
        known.is_good(digest, signature)
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
        let key = PublicKey::try_from(&key).unwrap();
        let verified = key.verify(&[0xAF, 0x82], &Signature::from(&signature));
        assert!(verified.is_ok());
    }
}
