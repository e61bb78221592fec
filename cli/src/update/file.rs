//! Files of images: one or more images, one behind the other.
//!
//! In: the bytes of a file. Out: its images, each found whole. An image runs in one slot only, so
//! a file that is to suit every node holds one for each slot. Each is its header and its body
//! ([`flash::image`]), and the header states where the next one begins.
//!
//! A file for a debug probe is none of them, and is named as what it is.
//!
//! Left out: signatures, which the node judges.

use std::fs;
use std::path::Path;

use flash::check_sum::Crc32;
use flash::image::{FIELDS, Header, ImageError, SIGNATURE_AT};
use flash::layout::{BASE, C8, HEADER, Layout, RAM, RC, Slot};

use super::error::{FileError, UpdateError};

/// One image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// What it states of itself.
    pub header: Header,
    /// The slot that it is for.
    pub slot: Slot,
    /// Header and body.
    pub bytes: Vec<u8>,
}

impl Image {
    /// What tells it from every other: the CRC-32 of header and signature, without
    /// the check sum that the header itself ends with. 2080h sub 5 is the same
    /// of the image that a node has begun to take.
    pub fn identity(&self) -> u32 {
        let mut crc = Crc32::new();
        for part in [0..SIGNATURE_AT as usize - 4, SIGNATURE_AT as usize..FIELDS] {
            crc.add(self.bytes.get(part).unwrap_or(&[]));
        }
        crc.value()
    }
}

/// The part that images are built for.
const LAYOUT: Layout = RC;

/// Reads the images of these files; all are of one version.
///
/// Errors: [`UpdateError::File`], [`UpdateError::Images`], [`UpdateError::Versions`].
pub fn read(paths: &[impl AsRef<Path>]) -> Result<Vec<Image>, UpdateError> {
    let mut images: Vec<Image> = Vec::new();
    for path in paths {
        let path = path.as_ref();
        let bytes = fs::read(path).map_err(|e| UpdateError::File(path.to_owned(), e))?;
        let found = parse(&bytes).map_err(|e| UpdateError::Images(path.to_owned(), e))?;
        images.extend(found);
    }
    let versions = |image: &Image| image.header.version.0;
    if let Some(first) = images.first().map(versions)
        && let Some(other) = images.iter().map(versions).find(|other| *other != first)
    {
        return Err(UpdateError::Versions(first, other));
    }
    Ok(images)
}

/// The images in these bytes; one at least.
fn parse(bytes: &[u8]) -> Result<Vec<Image>, FileError> {
    let mut images = Vec::new();
    let mut rest = bytes;
    while images.is_empty() || !rest.is_empty() {
        let header = Header::parse(rest).map_err(|error| refused(rest, error))?;
        if header.hardware == C8.hardware {
            return Err(FileError::Paper);
        }
        let slot = slot_of(&header).ok_or(FileError::Image(ImageError::Address))?;
        let length = HEADER as usize + header.length as usize;
        let (image, behind) = rest.split_at_checked(length).ok_or(FileError::Damaged)?;
        if Crc32::of(&image[HEADER as usize..]) != header.crc {
            return Err(FileError::Damaged);
        }
        images.push(Image {
            header,
            slot,
            bytes: image.to_vec(),
        });
        rest = behind;
    }
    Ok(images)
}

/// What bytes are that do not begin with a header.
fn refused(bytes: &[u8], error: ImageError) -> FileError {
    let app = bytes.get(C8.a.start as usize..).unwrap_or(&[]);
    let is_paper = Header::parse(app).is_ok_and(|header| header.hardware == C8.hardware);
    let is_hex = bytes.first() == Some(&b':') && bytes.is_ascii();
    match error {
        ImageError::Magic if is_paper => FileError::Paper,
        ImageError::Magic if is_hex || bytes.starts_with(ELF) => FileError::Probe,
        ImageError::Magic if reset_vector(bytes).is_some() => FileError::Probe,
        error => FileError::Image(error),
    }
}

/// How a linked program begins.
const ELF: &[u8] = b"\x7fELF";

/// Where the code begins by the vector table that bytes begin with: a stack in the RAM, and an
/// address in the flash. `None` where they begin otherwise.
pub fn reset_vector(bytes: &[u8]) -> Option<u32> {
    let ([stack, reset, ..], _) = bytes.as_chunks::<4>() else {
        return None;
    };
    let (stack, reset) = (u32::from_le_bytes(*stack), u32::from_le_bytes(*reset));
    let is_table =
        (RAM..=RAM + LAYOUT.ram).contains(&stack) && (BASE..BASE + LAYOUT.flash).contains(&reset);
    is_table.then_some(reset)
}

/// The slot that an image is linked for.
fn slot_of(header: &Header) -> Option<Slot> {
    let mut slots = [Slot::A, Slot::B].into_iter();
    slots.find(|slot| {
        let region = LAYOUT.slot(*slot);
        region.is_some_and(|region| region.address() + HEADER == header.address)
    })
}

#[cfg(test)]
mod tests {
    use flash::image::Version;
    use sim::memory::{SOUND, image, unsigned};

    use super::*;

    fn both() -> Vec<u8> {
        let version = Version::new(1, 2, 3);
        [Slot::A, Slot::B]
            .map(|slot| image(slot, version, SOUND))
            .concat()
    }

    #[test]
    fn a_file_holds_an_image_for_each_slot() {
        let images = parse(&both()).unwrap();
        let slots: Vec<_> = images.iter().map(|image| image.slot).collect();
        assert_eq!(slots, [Slot::A, Slot::B]);
        assert_eq!(
            images[1].bytes,
            image(Slot::B, Version::new(1, 2, 3), SOUND)
        );
    }

    #[test]
    fn a_file_for_a_debug_probe_was_no_image_without_a_remedy() {
        let table = [RAM + 0x4FE0, BASE + 0x131].map(u32::to_le_bytes).concat();
        for bytes in [&table[..], b":020000040800F2\n", b"\x7fELF\x01"] {
            assert_eq!(parse(bytes), Err(FileError::Probe));
        }
        let version = Version::new(1, 2, 3);
        let mut app = unsigned(Slot::A, C8.hardware, version, SOUND);
        assert_eq!(parse(&app), Err(FileError::Paper));
        let mut whole = table;
        whole.resize(C8.a.start as usize, u8::MAX);
        whole.append(&mut app);
        assert_eq!(parse(&whole), Err(FileError::Paper));
        assert_eq!(parse(b"text"), Err(FileError::Image(ImageError::Magic)));
    }

    #[test]
    fn an_image_of_another_version_with_the_same_body_went_on_as_this_one() {
        let of = |patch| parse(&image(Slot::B, Version::new(1, 0, patch), SOUND)).unwrap();
        let (one, other) = (of(1).remove(0), of(2).remove(0));
        assert_eq!(one.header.crc, other.header.crc);
        assert_ne!(one.identity(), other.identity());
        let mut forged = one.clone();
        forged.bytes[FIELDS - 1] ^= 1;
        assert_ne!(one.identity(), forged.identity());
        assert_eq!(one.identity(), of(1).remove(0).identity());
    }

    #[test]
    fn headers_without_a_signature_all_had_one_identity() {
        let of = |patch| {
            let version = Version::new(1, 0, patch);
            let file = unsigned(Slot::B, RC.hardware, version, SOUND);
            parse(&file).unwrap().remove(0).identity()
        };
        assert_ne!(of(1), of(2));
    }

    #[test]
    fn what_is_cut_off_or_changed_is_found() {
        let whole = both();
        for end in [0, 31, 200, 511, 531, 532 + 40, whole.len() - 1] {
            assert!(parse(&whole[..end]).is_err(), "{end}");
        }
        let mut changed = whole.clone();
        *changed.last_mut().unwrap() ^= 1;
        assert_eq!(parse(&changed), Err(FileError::Damaged));
        assert_eq!(
            parse(b"#!/bin/sh"),
            Err(FileError::Image(ImageError::Magic))
        );
    }
}
