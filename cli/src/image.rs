//! `plumb image`: the file that `plumb update` sends, built and signed.
//!
//! In: images as `cargo xtask image` builds them, or bodies and what a header states of them, and a
//! secret key. Out: one file with an image for each slot, signed. Without images and bodies it is
//! a program for the nodes of `plumb serve`, signed with the key that those have. With `--public`
//! it prints the public key instead, which a node's image is built with.
//!
//! Left out: linking, and keeping secret keys.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use flash::image::Version;
use flash::layout::{HEADER, RC, Slot};
use serde::Serialize;
use sim::memory::{DEVELOPMENT, HARDWARE, SICK, SOUND, public_key, sign, unsigned};

use crate::update::UpdateError;
use crate::update::file;
use output::write::{self, Existing, not_written};
use output::{hex, object, stdout};

/// What is built.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// The file to write
    #[arg(required_unless_present = "public", value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Replace the file if it is there already
    #[arg(long, requires = "out")]
    pub force: bool,
    /// Images to sign and join
    #[arg(
        long,
        num_args = 1..,
        conflicts_with_all = ["version", "a", "sick"],
        value_name = "IMAGE"
    )]
    pub from: Vec<PathBuf>,
    /// The version of a program that is not an image yet
    #[arg(
        long,
        value_parser = version,
        required_unless_present_any = ["from", "public"],
        value_name = "MAJOR.MINOR.PATCH"
    )]
    pub version: Option<Version>,
    /// The body linked for slot A; without both a program for the nodes of `plumb serve`
    #[arg(long, requires = "b", value_name = "FILE")]
    pub a: Option<PathBuf>,
    /// The body linked for slot B
    #[arg(long, requires = "a", value_name = "FILE")]
    pub b: Option<PathBuf>,
    /// Id of the hardware, hexadecimal, for bodies; without it that of the STM32F103RC
    #[arg(long, value_parser = number, conflicts_with = "from", value_name = "ID")]
    pub hardware: Option<u32>,
    /// File with the secret key, 64 hexadecimal digits; without it the key of `plumb serve`
    #[arg(long, value_name = "FILE")]
    pub key: Option<PathBuf>,
    /// Print the public key of --key, for PLUMB_KEY, and write no file
    #[arg(
        long,
        requires = "key",
        conflicts_with_all = ["out", "from", "version", "a", "b", "hardware", "unsigned", "sick"]
    )]
    pub public: bool,
    /// Leave the signature out
    #[arg(long, conflicts_with = "key")]
    pub unsigned: bool,
    /// For the nodes of `plumb serve`: a program that does not pass its self-check
    #[arg(long, conflicts_with = "a")]
    pub sick: bool,
    /// Print what was written, or the public key, as JSON
    #[arg(long)]
    pub json: bool,
}

/// Warns where a program that may be for a board is signed without a key of its own.
const SIGNED_FOR_ALL: &str = "plumb: warning: signed with the public development key, which only \
    simulated and emulated nodes accept: give --key to sign for a board";

/// Warns where a program that may be for a board is built with another key than it is signed with:
/// a node that runs it accepts no update by this key any more.
const OTHER_KEY: &str = "plumb: warning: the program was not built with the public key of the key \
    that signs it (PLUMB_KEY of `cargo xtask image`): a node that runs it accepts no later update \
    signed with this key";

/// Whether a program accepts updates that are signed by the key with this public one: it has it.
fn accepts(image: &[u8], public: &[u8; 32]) -> bool {
    image.windows(public.len()).any(|bytes| bytes == public)
}

impl Arguments {
    /// The program may be for a board: it is no text for the nodes of `plumb serve`.
    const fn is_for_boards(&self) -> bool {
        self.a.is_some() || !self.from.is_empty()
    }

    /// The signature is by the key that everybody has, and the program may be for a board.
    const fn is_signed_for_all(&self) -> bool {
        self.is_for_boards() && self.key.is_none() && !self.unsigned
    }
}

/// What was done, for `--json`: the file that was written, its images and whether they are signed.
fn done(
    written: Option<(&Path, &[Vec<u8>], bool)>,
    public_key: Option<String>,
) -> impl Serialize + use<> {
    object! {
        format: "plumb-image",
        version: 1,
        file: written.map(|(file, ..)| file.display().to_string()),
        length_bytes: written.map(|(_, images, _)| images.iter().map(Vec::len).sum::<usize>()),
        images: written.map(|(_, images, _)| images.len()),
        is_signed: written.map(|(.., is_signed)| is_signed),
        // Of the key that was given or has signed, hexadecimal.
        public_key: public_key,
    }
}

/// Why no file was written.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// A file can't be read.
    #[error("cannot use {path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// The file can't be written.
    #[error("{a}", a = not_written(.0, .1, "another file"))]
    Write(PathBuf, io::Error),
    /// A file is no secret key.
    #[error("{path} is no secret key: write 64 hexadecimal digits", path = .0.display())]
    Key(PathBuf),
    /// A key that is no secret, and signs nothing.
    #[error(
        "{path} is all zeros, which is no secret key: write 64 random hexadecimal digits",
        path = .0.display()
    )]
    Zeros(PathBuf),
    /// A file holds no body.
    #[error("{path} is empty", path = .0.display())]
    Empty(PathBuf),
    /// A body is not linked for its slot: its first two words are no stack and no code there.
    #[error(
        "{path} is linked for another slot than {1:?}: its reset vector is not there",
        path = .0.display()
    )]
    Body(PathBuf, Slot),
    /// A body is longer than its slot has room for, bytes.
    #[error("{path} is longer than the {1} bytes that a slot has", path = .0.display())]
    Long(PathBuf, u32),
    /// Two images are for the same slot, of which a file has one each.
    #[error("two of the images are for slot {0:?}: give one for each slot")]
    Twice(Slot),
    /// Images can't be used.
    #[error("{0}")]
    Images(#[from] UpdateError),
    /// What was done can't be printed; it is done.
    #[error("cannot print what was done: {0}")]
    Print(io::Error),
}

fn number(text: &str) -> Result<u32, String> {
    u32::from_str_radix(text, 16).map_err(|_| "write 1 to 8 hexadecimal digits".to_owned())
}

fn version(text: &str) -> Result<Version, String> {
    let parts: Vec<_> = text.split('.').map(str::parse::<u64>).collect();
    let [Ok(major), Ok(minor), Ok(patch)] = parts[..] else {
        return Err("write three numbers, as 1.2.3".to_owned());
    };
    match (major.try_into(), minor.try_into(), patch.try_into()) {
        (Ok(major), Ok(minor), Ok(patch)) => Ok(Version::new(major, minor, patch)),
        _ => Err("write three numbers, 0 to 255, 0 to 255 and 0 to 65535".to_owned()),
    }
}

/// Builds the file.
///
/// Errors: see [`ImageError`].
pub fn run(arguments: &Arguments) -> Result<ExitCode, ImageError> {
    let key = match &arguments.key {
        Some(path) => secret(path)?,
        None => *DEVELOPMENT,
    };
    let Some(out) = arguments.out.as_ref().filter(|_| !arguments.public) else {
        let public = hex::digits(&public_key(&key));
        let done = done(None, Some(public.clone()));
        stdout::print_as(arguments.json, &done, || public + "\n").map_err(ImageError::Print)?;
        return Ok(ExitCode::SUCCESS);
    };
    let mut images = match arguments.version {
        Some(version) => made(arguments, version)?,
        None => joined(&arguments.from)?,
    };
    if !arguments.unsigned {
        images.iter_mut().for_each(|image| sign(image, &key));
    }
    let public = public_key(&key);
    let is_other = arguments.is_for_boards() && !arguments.unsigned;
    let is_other = is_other && !images.iter().all(|image| accepts(image, &public));
    let written = write::save(out, images.concat(), Existing::of(arguments.force));
    written.map_err(|error| ImageError::Write(out.clone(), error))?;
    if arguments.is_signed_for_all() {
        eprintln!("{SIGNED_FOR_ALL}");
    } else if is_other {
        eprintln!("{OTHER_KEY}");
    }
    if arguments.json {
        let is_signed = !arguments.unsigned;
        let public = is_signed.then(|| hex::digits(&public));
        let done = done(Some((out, &images, is_signed)), public);
        stdout::print_json(&done).map_err(ImageError::Print)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Images of files, one for a slot at most.
fn joined(paths: &[PathBuf]) -> Result<Vec<Vec<u8>>, ImageError> {
    let images = file::read(paths)?;
    for (number, image) in images.iter().enumerate() {
        if images[..number]
            .iter()
            .any(|before| before.slot == image.slot)
        {
            return Err(ImageError::Twice(image.slot));
        }
    }
    Ok(images.into_iter().map(|image| image.bytes).collect())
}

/// Images of bodies, without a signature.
fn made(arguments: &Arguments, version: Version) -> Result<Vec<Vec<u8>>, ImageError> {
    let hardware = arguments.hardware.unwrap_or(HARDWARE);
    let mut images = Vec::new();
    for (slot, path) in [(Slot::A, &arguments.a), (Slot::B, &arguments.b)] {
        let mut body = match path {
            Some(path) => body(path, slot)?,
            None if arguments.sick => SICK.to_vec(),
            None => SOUND.to_vec(),
        };
        // The check sum is taken of whole words.
        body.resize(body.len().next_multiple_of(4), u8::MAX);
        images.push(unsigned(slot, hardware, version, &body));
    }
    Ok(images)
}

/// The body in a file.
fn body(path: &Path, slot: Slot) -> Result<Vec<u8>, ImageError> {
    let body = read(path)?;
    let room = RC.slot(slot).map_or(0, |region| region.length - HEADER);
    match body.is_empty() {
        true => Err(ImageError::Empty(path.to_owned())),
        false if body.len() > room as usize => Err(ImageError::Long(path.to_owned(), room)),
        false if is_for_other(&body, slot) => Err(ImageError::Body(path.to_owned(), slot)),
        false => Ok(body),
    }
}

/// Whether a body begins as a vector table does, and the code is not in this slot. Of one that
/// begins otherwise it is not known: the programs for the nodes of `plumb serve` are text.
fn is_for_other(body: &[u8], slot: Slot) -> bool {
    let in_slot = |reset: &u32| {
        RC.slot(slot).is_some_and(|region| {
            let first = region.address() + HEADER;
            (first..region.address() + region.length).contains(reset)
        })
    };
    file::reset_vector(body).is_some_and(|reset| !in_slot(&reset))
}

fn read(path: &Path) -> Result<Vec<u8>, ImageError> {
    fs::read(path).map_err(|error| ImageError::File(path.to_owned(), error))
}

fn secret(path: &Path) -> Result<[u8; 32], ImageError> {
    let text = read(path)?;
    let bytes = hex::bytes(text.trim_ascii());
    let key = bytes.and_then(|bytes| bytes.try_into().ok());
    match key {
        Some(key) if key == [0; 32] => Err(ImageError::Zeros(path.to_owned())),
        Some(key) => Ok(key),
        None => Err(ImageError::Key(path.to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_is_hexadecimal() {
        assert_eq!(number("31424c50"), Ok(0x3142_4C50));
        assert!(number("x").is_err() && number("123456789").is_err());
    }

    #[test]
    fn a_program_that_would_refuse_the_next_update_was_signed_without_a_word() {
        let key = [7; 32];
        let with = [&[0; 99][..], &public_key(&key), &[1; 5]].concat();
        assert!(accepts(&with, &public_key(&key)));
        assert!(!accepts(&with, &public_key(&[8; 32])));
        assert!(!accepts(&[0; 200], &public_key(&key)) && !accepts(&[], &public_key(&key)));
    }

    #[test]
    fn a_version_is_three_numbers() {
        assert_eq!(version("1.2.3"), Ok(Version::new(1, 2, 3)));
        for wrong in ["1.2", "1.2.3.4", "256.0.0", "1.x.2", "", "1.2.65536"] {
            assert!(version(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_number_out_of_range_was_told_to_be_none() {
        for wrong in ["1.0.65536", "256.0.0", "1.256.0"] {
            assert!(version(wrong).unwrap_err().contains("65535"), "{wrong}");
        }
    }

    #[test]
    fn a_secret_key_has_the_public_key_of_the_standard() {
        // RFC 8032, 7.1, test 1.
        let file = std::env::temp_dir().join(format!("plumb-key-{}", std::process::id()));
        let text = "9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60\n";
        fs::write(&file, text).unwrap();
        let key = secret(&file);
        fs::remove_file(&file).unwrap();
        assert_eq!(
            hex::digits(&public_key(&key.unwrap())),
            "d75a980182b10ab7d54bfed3c964073a0ee172f3daa62325af021a68f707511a"
        );
    }

    #[test]
    fn a_key_of_zeros_ended_in_a_panic() {
        let file = std::env::temp_dir().join(format!("plumb-zeros-{}", std::process::id()));
        fs::write(&file, "0".repeat(64)).unwrap();
        let told = secret(&file).unwrap_err();
        fs::remove_file(&file).unwrap();
        assert!(matches!(told, ImageError::Zeros(_)));
        assert_eq!(told.to_string().lines().count(), 1);
    }

    #[test]
    fn bodies_for_each_others_slots_were_taken() {
        let region = |slot| RC.slot(slot).unwrap();
        let table = |reset: u32| {
            [flash::layout::RAM + RC.ram - 32, reset | 1]
                .map(u32::to_le_bytes)
                .concat()
        };
        for slot in [Slot::A, Slot::B] {
            let first = region(slot).address() + HEADER;
            assert!(!is_for_other(&table(first + 0x130), slot), "{slot:?}");
            assert!(is_for_other(&table(first + 0x130), slot.other()));
            assert!(is_for_other(&table(region(slot).address()), slot));
        }
        assert!(!is_for_other(SOUND, Slot::A) && !is_for_other(b"abc", Slot::A));
    }
}
