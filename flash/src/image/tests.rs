//! Headers and bodies, whole and with a flipped bit.

use std::vec;
use std::vec::Vec;

use embedded_storage::nor_flash::NorFlash;
use proptest::prelude::*;

use super::*;
use crate::layout::{Layout, RC, Slot};
use crate::nor::tests::bench;

/// The hardware that the tests run on.
pub(crate) const HARDWARE: u32 = 0x0103_00CB;

/// The file of an image for `slot`: header and a body of `length` bytes made from `version`.
pub(crate) fn file(slot: Slot, version: Version, length: u32) -> Vec<u8> {
    file_for(&RC, slot, version, length)
}

/// The same for another part.
pub(crate) fn file_for(part: &Layout, slot: Slot, version: Version, length: u32) -> Vec<u8> {
    let body: Vec<u8> = (0..length)
        .map(|n| (n * 7 + n / 251 + version.0 * 13) as u8)
        .collect();
    let header = Header {
        signature: Signature::None,
        hardware: HARDWARE,
        version,
        address: part.slot(slot).unwrap().address() + HEADER,
        length,
        crc: Crc32::of(&body),
    };
    let mut file = vec![0xFF; HEADER as usize];
    file[..FIELDS].copy_from_slice(&header.encode());
    file.extend(body);
    file
}

#[test]
fn the_bytes_of_a_header_are_as_documented() {
    let header = Header {
        signature: Signature::Ed25519,
        hardware: 0x0102_0304,
        version: Version::new(1, 2, 0x0304),
        address: 0x0800_2200,
        length: 0xC000,
        crc: 0xA1B2_C3D4,
    };
    let bytes = header.encode();
    assert_eq!(
        &bytes[..16],
        b"PLMI\x01\0\x01\0\x04\x03\x02\x01\x04\x03\x02\x01"
    );
    assert_eq!(&bytes[16..24], b"\0\x22\0\x08\0\xC0\0\0");
    assert_eq!(&bytes[24..28], b"\xD4\xC3\xB2\xA1");
    assert_eq!(&bytes[28..32], Crc32::of(&bytes[..28]).to_le_bytes());
    assert!(bytes[32..].iter().all(|byte| *byte == 0xFF));
    assert_eq!(Header::parse(&bytes), Ok(header));
    assert!(Version::new(1, 2, 9) < Version::new(1, 10, 0));
}

#[test]
fn any_flipped_bit_of_header_or_body_is_found() {
    let file = file(Slot::A, Version::new(1, 0, 0), 96);
    let mut clean = bench(60, 1);
    clean.write(RC.a.start, &file).unwrap();
    assert!(verify(&mut clean, RC.a, HARDWARE).is_ok());
    for at in (0..SIGNATURE_AT).chain(HEADER..HEADER + 96) {
        for bit in 0..8 {
            let mut nor = clean.clone();
            nor.flip(RC.a.start + at, 1 << bit);
            assert!(
                verify(&mut nor, RC.a, HARDWARE).is_err(),
                "byte {at}, bit {bit}"
            );
        }
    }
}

#[test]
fn an_image_for_another_part_or_slot_or_too_long_is_refused() {
    let whole = Header::parse(&file(Slot::B, Version::new(1, 0, 0), 1000)).unwrap();
    let b = RC.b.unwrap();
    assert_eq!(whole.suits(b, HARDWARE), Ok(()));
    assert_eq!(whole.suits(b, 1), Err(ImageError::Hardware));
    assert_eq!(whole.suits(RC.a, HARDWARE), Err(ImageError::Address));
    for length in [0, 1002, b.length - HEADER + 4, u32::MAX - 3] {
        let bad = Header { length, ..whole };
        assert_eq!(bad.suits(b, HARDWARE), Err(ImageError::Length));
    }
    let longest = b.length - HEADER;
    let longest = Header {
        length: longest,
        ..whole
    };
    assert_eq!(longest.suits(b, HARDWARE), Ok(()));
}

#[test]
fn an_empty_slot_and_an_unknown_format_are_told_apart() {
    assert_eq!(
        verify(&mut bench(60, 1), RC.a, HARDWARE),
        Err(ImageError::Magic)
    );
    let mut file = file(Slot::A, Version::new(1, 0, 0), 8);
    file[4] = 2;
    assert_eq!(Header::parse(&file), Err(ImageError::Header));
    let crc = Crc32::of(&file[..28]);
    file[28..32].copy_from_slice(&crc.to_le_bytes());
    assert_eq!(Header::parse(&file), Err(ImageError::Format));
    assert_eq!(Header::parse(&file[..31]), Err(ImageError::Magic));
}

#[test]
fn a_running_application_finds_a_flipped_bit_in_the_round_after() {
    let file = file(Slot::A, Version::new(1, 0, 0), 1000);
    let mut nor = bench(60, 1);
    nor.write(RC.a.start, &file).unwrap();
    let header = header(&mut nor, RC.a, HARDWARE).unwrap();
    let mut check = Check::new(&header);
    let mut round = |nor: &mut _| {
        for step in 0..100 {
            let verdict = check.step(nor, RC.a, 16).unwrap();
            if verdict != Verdict::Running {
                return (step, verdict);
            }
        }
        panic!("without end");
    };
    // 1000 bytes in steps of 16 are 63 steps.
    assert_eq!(round(&mut nor), (62, Verdict::Good));
    nor.flip(RC.a.start + HEADER + 999, 1);
    assert_eq!(round(&mut nor), (62, Verdict::Bad));
    nor.flip(RC.a.start + HEADER + 999, 1);
    assert_eq!(round(&mut nor), (62, Verdict::Good));
}

proptest! {
    #[test]
    fn pieces_of_any_size_give_the_same_verdict(
        body in prop::collection::vec(any::<u8>(), 1..300),
        cuts in prop::collection::vec(1..40usize, 1..20),
        flip: bool,
    ) {
        let crc = Crc32::of(&body) ^ u32::from(flip);
        let length = body.len() as u32;
        let mut header = Header::parse(&file(Slot::A, Version(0), 4)).unwrap();
        (header.length, header.crc) = (length, crc);
        let mut check = Check::new(&header);
        let mut rest = &body[..];
        for size in cuts.iter().cycle() {
            let (piece, behind) = rest.split_at((*size).min(rest.len()));
            let verdict = check.add(piece);
            rest = behind;
            if rest.is_empty() {
                let expected = if flip { Verdict::Bad } else { Verdict::Good };
                prop_assert_eq!(verdict, expected);
                break;
            }
            prop_assert_eq!(verdict, Verdict::Running);
        }
    }

    #[test]
    fn any_bytes_are_a_header_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
        prop_assert!(Header::parse(&bytes).is_err());
    }
}
