//! Why a step of the test command failed, in a sentence.
//!
//! In: the errors of the parts. Out: one type for all steps. Left out: what to do about it, which
//! each step has itself.

use std::io;
use std::path::PathBuf;

use crate::accuracy::AccuracyError;
use crate::command::CommandError;
use crate::faults::FaultsError;
use crate::image::ImageError;
use crate::interop::InteropError;
use crate::program::ProgramError;
use crate::python::PythonError;
use crate::size::SizeError;

/// Why a step failed.
#[derive(Debug, thiserror::Error)]
pub enum StepError {
    /// A command failed.
    #[error("{0}")]
    Command(#[from] CommandError),
    /// A part of the toolchain is missing and could not be added; what to type.
    #[error("{0} is missing and could not be added; type `{1}`")]
    Toolchain(&'static str, String),
    /// No test ran at all, which means the run shows nothing.
    #[error("not one test ran")]
    NoTests,
    /// House rules are broken; how many times.
    #[error("{0} breaches of the house rules")]
    Untidy(usize),
    /// The accuracy document.
    #[error("{0}")]
    Accuracy(#[from] AccuracyError),
    /// The page on faults.
    #[error("{0}")]
    Faults(#[from] FaultsError),
    /// The bus side on the part.
    #[error("{0}")]
    Size(#[from] SizeError),
    /// The images of the part.
    #[error("{0}")]
    Image(#[from] ImageError),
    /// The released program.
    #[error("{0}")]
    Program(#[from] ProgramError),
    /// The master written by others.
    #[error("{0}")]
    Interop(#[from] InteropError),
    /// The Python package.
    #[error("{0}")]
    Python(#[from] PythonError),
    /// A file or folder could not be handled.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// The demo left a report out, or left it empty.
    #[error("the demo wrote no {0}")]
    NoReport(&'static str),
}
