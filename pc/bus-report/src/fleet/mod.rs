//! The page of a fleet: `report.html` and `report.json` of many machines.
//!
//! In: the figures of a fleet as JSON ([`data::FleetReport`]), made by the Python package from the
//! summaries of the machines. Out: the page, in the manner of the other reports, and the JSON in
//! the form that `docs/fleet.md` describes.
//!
//! Left out: which machine needs a visit, and every figure (`python/plumb/fleet`).

pub mod data;
mod page;

use std::path::Path;

use data::FleetReport;
use output::write::{self, WriteError, Written};

/// Why the page of a fleet was not written.
#[derive(Debug, thiserror::Error)]
pub enum FleetError {
    /// The figures have another form.
    #[error("these are no figures of a fleet: {0}")]
    Figures(serde_json::Error),
    /// A file could not be written.
    #[error("{0}")]
    Write(#[from] WriteError),
}

/// Writes the page and its data into a folder.
///
/// Errors: see [`FleetError`]; the old page is untouched then.
pub fn write(json: &[u8], folder: &Path) -> Result<Written, FleetError> {
    let mut report: FleetReport = serde_json::from_slice(json).map_err(FleetError::Figures)?;
    env!("CARGO_PKG_VERSION").clone_into(&mut report.plumb_version);
    Ok(write::both(folder, &page::page(&report), &report)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    const REPORT: &str = r#"{
        "format": "plumb-fleet", "version": 1, "plumb_version": "1", "verdict": "One <machine>.",
        "clean": false, "from": "2026-11-20", "to": null, "facts": [["Machines", "1"]],
        "visits": [{"machine": "a&b", "model": null, "firmware": "1.0", "urgency": 3,
                    "page": "machines/a%26b/report.html",
                    "reasons": [{"kind": "fault", "text": "a fault stands"}]}],
        "sections": [{"title": "Drift", "text": ["By day."], "tables": [
            {"title": "T", "columns": [{"name": "N", "number": true}, {"name": "W"}],
             "rows": [["1", {"text": "bad", "tone": "fail"}],
                      ["2", {"text": "a&b", "link": "m/x.html"}]], "notes": []}],
          "charts": [{"title": "C", "description": "D", "x_label": "day", "y_label": "deg",
             "series": [{"name": "S", "kind": "line", "points": [[0, 1], [1, null], [2, 3]]},
                        {"name": "R", "kind": "band", "points": [[0, 1, 2], [2, 1, 4]]}],
             "levels": [{"at": 2.5, "name": "band"}], "x_names": [[0, "11-20"]]}]}]}"#;

    #[test]
    fn a_page_has_visits_tables_and_charts_and_no_markup_out_of_text() {
        let report: FleetReport = serde_json::from_slice(REPORT.as_bytes()).unwrap();
        let page = page::page(&report);
        output::check::assert_balanced(&page);
        for wanted in [
            "One &lt;machine&gt;.",
            "<a href=\"machines/a%26b/report.html\">a&amp;b</a>",
            "a fault stands",
            "<td class=\"fail\">bad</td>",
            "<svg",
        ] {
            assert!(page.contains(wanted), "{wanted}");
        }
        assert!(!page.contains("<machine>"));
    }

    #[test]
    fn figures_of_another_form_are_refused_and_nothing_is_written() {
        let folder = std::env::temp_dir().join("plumb-no-fleet");
        let why = write(b"{\"format\": \"plumb-fleet\"}", &folder).unwrap_err();
        assert!(
            why.to_string()
                .starts_with("these are no figures of a fleet: ")
        );
        assert!(!folder.exists());
    }
}
