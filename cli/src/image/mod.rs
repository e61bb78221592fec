//! `plumb image`: the file that `plumb update` sends, built and signed.
//!
//! In: the bodies of a program for both slots as they were linked, a version, a hardware id, a
//! secret key. Out: one file with an image for each slot. Without bodies it is a program for the
//! nodes of `plumb serve`, signed with the key that those know.
//!
//! Left out: linking, and keeping secret keys.

use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use flash::image::{Signature, Version};
use flash::layout::Slot;
use sim::memory::{DEVELOPMENT, SICK, SOUND, sign, unsigned};

/// What is built.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// The file to write
    #[arg(value_name = "FILE")]
    pub out: PathBuf,
    /// The program's version
    #[arg(long, value_parser = version, value_name = "MAJOR.MINOR.PATCH")]
    pub version: Version,
    /// The body linked for slot A; without both a program for the nodes of `plumb serve`
    #[arg(long, requires = "b", value_name = "FILE")]
    pub a: Option<PathBuf>,
    /// The body linked for slot B
    #[arg(long, requires = "a", value_name = "FILE")]
    pub b: Option<PathBuf>,
    /// Id of the hardware, hexadecimal
    #[arg(long, value_parser = number, default_value = "504C012C", value_name = "ID")]
    pub hardware: u32,
    /// File with the secret key, 64 hexadecimal digits; without it the key of `plumb serve`
    #[arg(long, value_name = "FILE")]
    pub key: Option<PathBuf>,
    /// Leave the signature out
    #[arg(long, conflicts_with = "key")]
    pub unsigned: bool,
    /// For the nodes of `plumb serve`: a program that does not pass its self-check
    #[arg(long, conflicts_with = "a")]
    pub sick: bool,
}

/// Why no file was written.
#[derive(Debug)]
pub enum ImageError {
    /// A file can't be read or written.
    File(PathBuf, io::Error),
    /// A file is no secret key.
    Key(PathBuf),
}

impl std::error::Error for ImageError {}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path, error) => write!(f, "cannot use {}: {error}", path.display()),
            Self::Key(path) => write!(
                f,
                "{} is no secret key: write 64 hexadecimal digits",
                path.display()
            ),
        }
    }
}

fn number(text: &str) -> Result<u32, String> {
    u32::from_str_radix(text, 16).map_err(|_| "write 1 to 8 hexadecimal digits".to_owned())
}

fn version(text: &str) -> Result<Version, String> {
    let mut parts = text.split('.');
    let mut next = || parts.next().and_then(|part| part.parse::<u16>().ok());
    let read = [next(), next(), next()];
    let [Some(major), Some(minor), Some(patch)] = read else {
        return Err("write three numbers, as 1.2.3".to_owned());
    };
    match (u8::try_from(major), u8::try_from(minor), parts.next()) {
        (Ok(major), Ok(minor), None) => Ok(Version::new(major, minor, patch)),
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
    let body = |path: &Option<PathBuf>| match path {
        Some(path) => read(path),
        None if arguments.sick => Ok(SICK.to_vec()),
        None => Ok(SOUND.to_vec()),
    };
    let mut file = Vec::new();
    for (slot, path) in [(Slot::A, &arguments.a), (Slot::B, &arguments.b)] {
        let mut body = body(path)?;
        // The check sum is taken of whole words.
        body.resize(body.len().next_multiple_of(4), u8::MAX);
        file.extend(one(arguments, slot, &body, &key));
    }
    let written = fs::write(&arguments.out, file);
    written.map_err(|error| ImageError::File(arguments.out.clone(), error))?;
    Ok(ExitCode::SUCCESS)
}

fn one(arguments: &Arguments, slot: Slot, body: &[u8], key: &[u8; 32]) -> Vec<u8> {
    let kind = match arguments.unsigned {
        true => Signature::None,
        false => Signature::Ed25519,
    };
    let mut image = unsigned(slot, arguments.hardware, arguments.version, kind, body);
    if !arguments.unsigned {
        sign(&mut image, key);
    }
    image
}

fn read(path: &Path) -> Result<Vec<u8>, ImageError> {
    fs::read(path).map_err(|error| ImageError::File(path.to_owned(), error))
}

fn secret(path: &Path) -> Result<[u8; 32], ImageError> {
    let text = read(path)?;
    let digits = text.trim_ascii();
    let pairs = digits.chunks(2).map(|pair| {
        let pair = std::str::from_utf8(pair).ok()?;
        u8::from_str_radix(pair, 16).ok()
    });
    let bytes: Option<Vec<u8>> = pairs.collect();
    let key = bytes.and_then(|bytes| bytes.try_into().ok());
    key.ok_or_else(|| ImageError::Key(path.to_owned()))
}

#[cfg(test)]
mod tests {
    use sim::memory::HARDWARE;

    use super::*;

    #[test]
    fn the_hardware_of_the_virtual_nodes_is_the_default() {
        assert_eq!(number("504C012C"), Ok(HARDWARE));
    }

    #[test]
    fn a_version_is_three_numbers() {
        assert_eq!(version("1.2.3"), Ok(Version::new(1, 2, 3)));
        for wrong in ["1.2", "1.2.3.4", "256.0.0", "1.x.2", "", "1.2.65536"] {
            assert!(version(wrong).is_err(), "{wrong}");
        }
    }
}
