//! Summaries of logs as bytes, merged and reported.
//!
//! In: names of logs, or bytes of summaries. Out: bytes, which merge to the same in any order and
//! in any groups (`bus_report::period::Kept`), and the report of `plumb report` in a folder.

use std::path::PathBuf;

use bus_report::fleet;
use bus_report::period::{Kept, KeptError};
use listen::PlanOptions;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyBytes;

use crate::error::said;
use crate::signals::{self, Watch};

/// Summarises logs, of the instruments with these node-ids or of all pairs; the bytes, and the
/// sentence on what could not be read.
///
/// Errors: `plumb.Error`.
#[pyfunction]
pub fn summarise(
    py: Python<'_>,
    logs: Vec<PathBuf>,
    eds: Vec<String>,
    nodes: Vec<u8>,
) -> PyResult<(Bound<'_, PyBytes>, Option<String>)> {
    let plan = plan(&eds, nodes)?;
    let done = signals::wait_for(py, move || {
        let (kept, incomplete) = Kept::of(&logs, &plan)?;
        Ok((kept.to_bytes()?, incomplete.map(|why| why.to_string())))
    })?;
    let (bytes, incomplete) = done.map_err(|why: bus_report::period::PeriodError| said(why))?;
    Ok((PyBytes::new(py, &bytes), incomplete))
}

/// Which instruments are read, and by which data sheets.
///
/// Errors: `plumb.Error` where a data sheet is none.
pub fn plan(eds: &[String], nodes: Vec<u8>) -> PyResult<PlanOptions> {
    let eds = eds.iter().map(|sheet| sheet.parse());
    Ok(PlanOptions {
        nodes,
        eds: eds.collect::<Result<_, _>>().map_err(said)?,
    })
}

/// Merges summaries.
///
/// Errors: `plumb.Error` where one is none, is of another version, or there is none at all.
#[pyfunction]
pub fn merge(py: Python<'_>, summaries: Vec<PyBackedBytes>) -> PyResult<Bound<'_, PyBytes>> {
    let merged = py.detach(|| bytes_of(summaries.iter().map(|bytes| Kept::from_bytes(bytes))))?;
    Ok(PyBytes::new(py, &merged))
}

/// Merges the summaries of single logs, each under the name that its log has now.
///
/// Errors: as [`merge`].
#[pyfunction]
pub fn merge_named(
    py: Python<'_>,
    summaries: Vec<(PyBackedBytes, String)>,
) -> PyResult<Bound<'_, PyBytes>> {
    let merged = py.detach(|| {
        let all = summaries.iter().map(|(bytes, name)| {
            let kept = Kept::from_bytes(bytes);
            kept.map(|kept| kept.renamed(name))
        });
        bytes_of(all)
    })?;
    Ok(PyBytes::new(py, &merged))
}

/// All of them as one.
///
/// Errors: as [`merge`], or the exception of a signal's handler.
fn bytes_of(all: impl Iterator<Item = Result<Kept, KeptError>>) -> PyResult<Vec<u8>> {
    let mut watch = Watch::new();
    let mut merged = None;
    for one in all {
        watch.look()?;
        let both = merged.into_iter().chain([one.map_err(said)?]);
        merged = Some(Kept::merged(both).map_err(said)?);
    }
    let merged = Kept::merged(merged).map_err(said)?;
    merged.to_bytes().map_err(said)
}

/// The figures of a summary: the JSON of `plumb report`.
///
/// Errors: `plumb.Error`.
#[pyfunction]
pub fn figures(py: Python<'_>, summary: PyBackedBytes) -> PyResult<Bound<'_, PyBytes>> {
    let json = py.detach(|| {
        let kept = Kept::from_bytes(&summary).map_err(|why| why.to_string())?;
        kept.figures(None).map_err(|why| why.to_string())
    });
    Ok(PyBytes::new(py, &json.map_err(said)?))
}

/// Writes the page of a fleet and its data into a folder.
///
/// Errors: `plumb.Error`; the old page is untouched then.
#[pyfunction]
pub fn fleet_page(
    py: Python<'_>,
    json: PyBackedBytes,
    folder: PathBuf,
) -> PyResult<(PathBuf, PathBuf)> {
    let written = py.detach(|| fleet::write(&json, &folder).map_err(|why| why.to_string()));
    let written = written.map_err(said)?;
    Ok((written.html, written.json))
}

/// Writes the report of a summary into a folder; the page and its data.
///
/// Errors: `plumb.Error`; the old report is untouched then.
#[pyfunction]
#[pyo3(signature = (summary, folder, bit_rate))]
pub fn report(
    py: Python<'_>,
    summary: PyBackedBytes,
    folder: PathBuf,
    bit_rate: Option<f64>,
) -> PyResult<(PathBuf, PathBuf)> {
    let written = py.detach(|| {
        let kept = Kept::from_bytes(&summary).map_err(|why| why.to_string())?;
        kept.report(&folder, bit_rate)
            .map_err(|why| why.to_string())
    });
    let written = written.map_err(said)?;
    Ok((written.html, written.json))
}
