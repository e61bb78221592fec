//! What the demo and the replay print, draw and write.
//!
//! In: [`data::DemoReport`] or [`replay_data::ReplayReport`], filled by the command that ran. Out:
//! text for the terminal, and `report.html` with `report.json` in a folder. The JSON formats are
//! described in `docs/report-format.md`. Nothing is measured or judged here beyond comparing a
//! value with its limit.

pub mod data;
pub mod figures;
pub mod page;
pub mod replay_data;
pub mod replay_page;
pub mod replay_tables;
#[cfg(test)]
pub mod sample;
pub mod summary;
pub mod tables;
pub mod terminal;

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use output::check::{documented, keys};

    use super::sample;

    const DOCUMENT: &str = include_str!("../../../../docs/report-format.md");

    fn sample_keys() -> BTreeSet<String> {
        &keys(&sample::demo()) | &keys(&sample::replay())
    }

    #[test]
    fn every_field_is_documented() {
        let missing: Vec<_> = sample_keys()
            .difference(&documented(DOCUMENT))
            .cloned()
            .collect();
        assert!(
            missing.is_empty(),
            "not in docs/report-format.md: {missing:?}"
        );
    }

    #[test]
    fn no_field_is_documented_that_does_not_exist() {
        let stale: Vec<_> = documented(DOCUMENT)
            .difference(&sample_keys())
            .cloned()
            .collect();
        assert!(stale.is_empty(), "only in docs/report-format.md: {stale:?}");
    }

    #[test]
    fn every_word_that_a_field_can_hold_is_documented() {
        use super::data::*;
        use super::replay_data::CalibrationKind;
        let words = [
            word(Outcome::None),
            word(Outcome::DataDelay),
            word(Outcome::Warnings),
            word(Outcome::FaultWithoutCause),
            word(Outcome::PhysicalFault),
            word(Outcome::NotCured),
            word(ErrorType::DataDelay),
            word(ErrorType::PhysicalFault),
            word(Relation::AtMost),
            word(Relation::AtLeast),
            word(Relation::Exactly),
            word(CalibrationKind::Poses),
            word(CalibrationKind::Reference),
            word(CalibrationKind::File),
        ];
        for word in words {
            assert!(DOCUMENT.contains(&format!("\"{word}\"")), "{word}");
        }
    }

    /// Writes the two sample pages into the folder PLUMB_SAMPLE_DIR, to look at them in a browser.
    #[test]
    #[ignore = "writes files for a person to look at"]
    fn sample_pages() {
        use super::{page, replay_page, terminal};
        let folder = std::env::var_os("PLUMB_SAMPLE_DIR").map(std::path::PathBuf::from);
        let folder = folder.unwrap();
        let (demo, replay) = (sample::demo(), sample::replay());
        use output::write::both;
        both(&folder.join("demo"), &page::demo(&demo), &demo).unwrap();
        both(
            &folder.join("replay"),
            &replay_page::replay(&replay),
            &replay,
        )
        .unwrap();
        let shown = terminal::print_demo(&demo, true);
        let replayed = terminal::print_replay(&replay);
        std::fs::write(folder.join("demo.txt"), shown).unwrap();
        std::fs::write(folder.join("replay.txt"), replayed).unwrap();
    }
}
