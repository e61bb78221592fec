//! A log to its content hash and its summary, the file read once for both.
//!
//! In: the name of a file. Out: a [`Counted`]: the BLAKE3 of the bytes of the file, compressed or
//! not, and the summary of `summarise` or the sentence on why there is none.
//!
//! Left out: folders and lists of logs, and whether the file changed meanwhile.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use blake3::Hasher;
use bus_report::period::{Kept, PeriodError};
use listen::PlanOptions;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::said;
use crate::summary;

/// What a log came to.
#[pyclass(frozen, get_all)]
pub struct Counted {
    /// BLAKE3 of the file as hexadecimal digits; `None` where it can't be read to its end.
    blake3: Option<String>,
    frames: u64,
    /// First and last frame, ns since 1970; `None` without a date.
    first_ns: Option<u64>,
    last_ns: Option<u64>,
    summary: Option<Py<PyBytes>>,
    /// The sentence on what could not be read; the rest is in the summary.
    incomplete: Option<String>,
    /// The sentence on why there is no summary.
    error: Option<String>,
}

/// Counts one log, of the instruments with these node-ids or of all pairs.
///
/// Errors: `plumb.Error` where the node-ids or data sheets are none.
#[pyfunction]
pub fn count(py: Python<'_>, log: PathBuf, eds: Vec<String>, nodes: Vec<u8>) -> PyResult<Counted> {
    let plan = summary::plan(&eds, nodes)?;
    let (blake3, found) = py.detach(|| hash_and_count(&log, &plan));
    let mut counted = Counted {
        blake3,
        frames: 0,
        first_ns: None,
        last_ns: None,
        summary: None,
        incomplete: None,
        error: None,
    };
    match found {
        Ok((kept, bytes, incomplete)) => {
            counted.frames = kept.frames();
            (counted.first_ns, counted.last_ns) = kept.dated_ns().unzip();
            counted.summary = Some(PyBytes::new(py, &bytes).unbind());
            counted.incomplete = incomplete;
        }
        Err(PeriodError::Plan(why)) => return Err(said(why)),
        Err(why) => counted.error = Some(why.to_string()),
    }
    Ok(counted)
}

/// A summary, its bytes, and the sentence on what could not be read.
type Found = Result<(Kept, Vec<u8>, Option<String>), PeriodError>;

fn hash_and_count(path: &Path, plan: &PlanOptions) -> (Option<String>, Found) {
    let mut opened = None;
    let through = |file| {
        let file = Hashed(Arc::new(Mutex::new((file, Hasher::new()))));
        opened = Some(file.clone());
        file
    };
    let found = Kept::of_file(path, plan, through).and_then(|(kept, incomplete)| {
        let bytes = kept.to_bytes()?;
        Ok((kept, bytes, incomplete.map(|why| why.to_string())))
    });
    (opened.and_then(|file| file.hash().ok()), found)
}

/// A file whose bytes are hashed as they are read.
#[derive(Clone)]
struct Hashed(Arc<Mutex<(File, Hasher)>>);

impl Hashed {
    /// The hash of the whole file; what nobody has read is read now.
    ///
    /// Errors: it can't be read to its end.
    fn hash(mut self) -> io::Result<String> {
        io::copy(&mut self, &mut io::sink())?;
        let both = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(both.1.finalize().to_hex().to_string())
    }
}

impl Read for Hashed {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut both = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (file, hasher) = &mut *both;
        let count = file.read(buffer)?;
        hasher.update(&buffer[..count]);
        Ok(count)
    }
}
