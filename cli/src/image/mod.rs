//! `plumb image`: the file that `plumb update` sends, built and signed.
//!
//! In: images as `cargo xtask image` builds them, or bodies and what a header says of them, and a
//! secret key. Out: one file with an image for each slot, signed. Without images and bodies it is
//! a program for the nodes of `plumb serve`, signed with the key that those know.
//!
//! Left out: linking, and keeping secret keys.

use std::fmt;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use flash::image::Version;
use flash::layout::Slot;
use sim::memory::{DEVELOPMENT, HARDWARE, SICK, SOUND, sign, unsigned};

use crate::update::UpdateError;
use crate::update::file;

/// What is built.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// The file to write
    #[arg(value_name = "FILE")]
    pub out: PathBuf,
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
        required_unless_present = "from",
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
    /// Images can't be used.
    Images(UpdateError),
}

impl From<UpdateError> for ImageError {
    fn from(error: UpdateError) -> Self {
        Self::Images(error)
    }
}

impl std::error::Error for ImageError {}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Images(error) => error.fmt(f),
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
    let mut images = match arguments.version {
        Some(version) => made(arguments, version)?,
        None => file::read(&arguments.from)?
            .into_iter()
            .map(|image| image.bytes)
            .collect(),
    };
    if !arguments.unsigned {
        images.iter_mut().for_each(|image| sign(image, &key));
    }
    let file = images.concat();
    let written = fs::write(&arguments.out, file);
    written.map_err(|error| ImageError::File(arguments.out.clone(), error))?;
    Ok(ExitCode::SUCCESS)
}

/// Images of bodies, without a signature.
fn made(arguments: &Arguments, version: Version) -> Result<Vec<Vec<u8>>, ImageError> {
    let hardware = arguments.hardware.unwrap_or(HARDWARE);
    let mut images = Vec::new();
    for (slot, path) in [(Slot::A, &arguments.a), (Slot::B, &arguments.b)] {
        let mut body = match path {
            Some(path) => read(path)?,
            None if arguments.sick => SICK.to_vec(),
            None => SOUND.to_vec(),
        };
        // The check sum is taken of whole words.
        body.resize(body.len().next_multiple_of(4), u8::MAX);
        images.push(unsigned(slot, hardware, version, &body));
    }
    Ok(images)
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
    use super::*;

    #[test]
    fn an_id_is_hexadecimal() {
        assert_eq!(number("31424c50"), Ok(0x3142_4C50));
        assert!(number("x").is_err() && number("123456789").is_err());
    }

    #[test]
    fn a_version_is_three_numbers() {
        assert_eq!(version("1.2.3"), Ok(Version::new(1, 2, 3)));
        for wrong in ["1.2", "1.2.3.4", "256.0.0", "1.x.2", "", "1.2.65536"] {
            assert!(version(wrong).is_err(), "{wrong}");
        }
    }
}
