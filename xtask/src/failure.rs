//! Why a step of the test command failed, in a sentence.
//!
//! In: the errors of the parts. Out: one type for all steps. Left out: what to do about it, which
//! each step has itself.

use std::path::PathBuf;
use std::{fmt, io};

use crate::accuracy::AccuracyError;
use crate::command::CommandError;
use crate::faults::FaultsError;
use crate::image::ImageError;
use crate::interop::InteropError;
use crate::program::ProgramError;
use crate::python::PythonError;
use crate::size::SizeError;

/// Why a step failed.
#[derive(Debug)]
pub enum StepError {
    /// A command failed.
    Command(CommandError),
    /// A part of the toolchain is missing and could not be added; what to type.
    Toolchain(&'static str, String),
    /// No test ran at all, which means the run shows nothing.
    NoTests,
    /// House rules are broken; how many times.
    Untidy(usize),
    /// The accuracy document.
    Accuracy(AccuracyError),
    /// The page on faults.
    Faults(FaultsError),
    /// The bus side on the part.
    Size(SizeError),
    /// The images of the part.
    Image(ImageError),
    /// The released program.
    Program(ProgramError),
    /// The master written by others.
    Interop(InteropError),
    /// The Python package.
    Python(PythonError),
    /// A file or folder could not be handled.
    File(PathBuf, io::Error),
    /// The demo left a report out, or left it empty.
    NoReport(&'static str),
}

impl fmt::Display for StepError {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Command(error) => write!(out, "{error}"),
            Self::Toolchain(part, typed) => {
                write!(
                    out,
                    "{part} is missing and could not be added; type `{typed}`"
                )
            }
            Self::NoTests => write!(out, "not one test ran"),
            Self::Untidy(count) => write!(out, "{count} breaches of the house rules"),
            Self::Accuracy(error) => write!(out, "{error}"),
            Self::Faults(error) => write!(out, "{error}"),
            Self::Size(error) => write!(out, "{error}"),
            Self::Image(error) => write!(out, "{error}"),
            Self::Program(error) => write!(out, "{error}"),
            Self::Interop(error) => write!(out, "{error}"),
            Self::Python(error) => write!(out, "{error}"),
            Self::File(path, error) => write!(out, "{}: {error}", path.display()),
            Self::NoReport(name) => write!(out, "the demo wrote no {name}"),
        }
    }
}

impl From<CommandError> for StepError {
    fn from(error: CommandError) -> Self {
        Self::Command(error)
    }
}

impl From<AccuracyError> for StepError {
    fn from(error: AccuracyError) -> Self {
        Self::Accuracy(error)
    }
}

impl From<FaultsError> for StepError {
    fn from(error: FaultsError) -> Self {
        Self::Faults(error)
    }
}

impl From<PythonError> for StepError {
    fn from(error: PythonError) -> Self {
        Self::Python(error)
    }
}

impl From<InteropError> for StepError {
    fn from(error: InteropError) -> Self {
        Self::Interop(error)
    }
}

impl From<ImageError> for StepError {
    fn from(error: ImageError) -> Self {
        Self::Image(error)
    }
}

impl From<ProgramError> for StepError {
    fn from(error: ProgramError) -> Self {
        Self::Program(error)
    }
}

impl From<SizeError> for StepError {
    fn from(error: SizeError) -> Self {
        Self::Size(error)
    }
}
