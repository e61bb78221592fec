//! What a run has measured so far, in a file that a later run can go on from.
//!
//! In: dwell after dwell. Out: `measured.json` in the folder of the report, whole or the one
//! before; and whether an instrument, a chamber and a profile are those that it was begun with.
//! docs/chamber.md describes the format.
//!
//! Left out: measuring (`run`), and fitting (`thermal`).

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::model::Model;
use super::profile::Profile;
use super::thermal::MeanReading;
use super::turns::Followed;
use crate::CalibrateError;
use crate::folder::MEASURED;
use crate::kept::put;
use crate::session::Node;
use output::write::Existing;
use output::{hex, json};

/// Name of the format.
const FORMAT: &str = "plumb-measured-temperatures";

/// Its version; 1 had no turns.
const VERSION: u32 = 2;

/// What a run was begun with: another one cannot go on from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Begun {
    /// Which model.
    pub model: Model,
    /// The chamber, as it names itself.
    pub chamber: String,
    /// What turns the housing, as it names itself; `null` where nothing is turned.
    pub turned_by: Option<String>,
    /// The sequence of temperatures.
    pub profile: Profile,
    /// The channels, A first.
    pub channels: Vec<Channel>,
}

/// One node of the run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channel {
    /// Node-id.
    pub node: u8,
    /// 1018h sub 4.
    pub serial_number: u32,
    /// 2062h sub 1, eight hexadecimal digits.
    pub crc32: String,
}

/// What one node felt in one orientation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Felt {
    /// Mean acceleration in the sensor's axes.
    pub accel_g: [f64; 3],
    /// Scatter of single readings around it.
    pub scatter_mg: f64,
    /// What the sensor told of its temperature.
    pub sensor_degc: f64,
    /// Mean rate of the gyroscope in its own axes; left out where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_rad_s: Option<[f64; 3]>,
}

/// One dwell that was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dwelt {
    /// Run, from 1.
    pub run: u32,
    /// Number of the dwell in the profile, from 0.
    pub step: usize,
    /// Temperature of the air as the chamber stated it; `null` where it does not.
    pub air_degc: Option<f64>,
    /// How long all of it took, by the nodes' samples.
    pub minutes: f64,
    /// How often it was begun anew because a node had restarted or was commanded.
    pub repeated: u32,
    /// By orientation what each channel felt, A first.
    pub orientations: Vec<Vec<Felt>>,
    /// By turn between two rests what each channel's gyroscope measured; empty where none is
    /// followed, or nothing is turned.
    #[serde(default)]
    pub turns: Vec<Vec<Followed>>,
}

/// The file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// "plumb-measured-temperatures".
    pub format: String,
    /// 2.
    pub version: u32,
    /// SHA-256 of the file as it is with nothing between these quotes; empty but in the file.
    pub sha256: String,
    /// Begin of the run, UTC, seconds since 1970.
    pub begun_s: u64,
    /// What it was begun with.
    #[serde(flatten)]
    pub begun: Begun,
    /// The dwells that were measured, in the profile's order.
    pub dwells: Vec<Dwelt>,
}

impl Begun {
    /// The channels of these nodes.
    pub fn channels(nodes: &[Node]) -> Vec<Channel> {
        let channel = |node: &Node| Channel {
            node: node.id,
            serial_number: node.serial,
            crc32: format!("{:08X}", node.found_sum()),
        };
        nodes.iter().map(channel).collect()
    }

    /// What is another one here than in `other`, in words.
    fn differs(&self, other: &Self) -> Option<&'static str> {
        let serials =
            |begun: &Self| -> Vec<u32> { begun.channels.iter().map(|c| c.serial_number).collect() };
        let sums = |begun: &Self| -> Vec<String> {
            begun.channels.iter().map(|c| c.crc32.clone()).collect()
        };
        let all = [
            (
                serials(self) != serials(other),
                "instrument (serial numbers)",
            ),
            (sums(self) != sums(other), "calibration in the nodes"),
            (self.chamber != other.chamber, "chamber"),
            (self.profile != other.profile, "profile"),
            (self.model != other.model, "model"),
            (self.turned_by != other.turned_by, "motor, or none"),
        ];
        all.into_iter()
            .find(|(another, _)| *another)
            .map(|(_, what)| what)
    }
}

impl Dwelt {
    /// Whether it has finite numbers of each of so many channels.
    fn is_sound(&self, channels: usize) -> bool {
        let mut orientations = self.orientations.iter();
        let mut turns = self.turns.iter();
        orientations.all(|all| all.len() == channels && all.iter().all(Felt::is_finite))
            && turns.all(|all| all.len() == channels && all.iter().all(Followed::is_finite))
    }
}

impl Felt {
    fn is_finite(&self) -> bool {
        let numbers = self.accel_g.iter();
        let mut numbers = numbers.chain([&self.scatter_mg, &self.sensor_degc]);
        numbers.all(|number| number.is_finite())
    }
}

/// What every version of the file begins with.
#[derive(Deserialize)]
struct Tagged {
    format: String,
    version: u32,
}

/// The text of a file in which `sha256` stands now, with the one that belongs there.
fn sealed(text: &str, sha256: &str) -> String {
    let member = |sha256: &str| format!("\"sha256\": \"{sha256}\"");
    let open = text.replacen(&member(sha256), &member(""), 1);
    let hash = hex::digits(&hmac_sha256::Hash::hash(open.as_bytes()));
    open.replacen(&member(""), &member(&hash), 1)
}

impl Measured {
    /// A run that has measured nothing yet.
    pub fn new(begun: Begun, begun_s: u64) -> Self {
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            sha256: String::new(),
            begun_s,
            begun,
            dwells: Vec::new(),
        }
    }

    /// Where it stands in a folder.
    pub fn path(folder: &Path) -> PathBuf {
        folder.join(MEASURED)
    }

    /// Writes the file; it appears whole or not at all. A folder that has gone meanwhile is made
    /// again.
    ///
    /// Errors: [`CalibrateError::File`].
    pub fn save(&self, folder: &Path) -> Result<(), CalibrateError> {
        let path = Self::path(folder);
        let text = json::to_lines(self);
        let text = text.map_err(|error| CalibrateError::File(path.clone(), error.into()))?;
        fs::create_dir_all(folder).map_err(CalibrateError::file(&path))?;
        put(&path, &sealed(&text, ""), Existing::Replace)
    }

    /// The run in a folder, to go on from with what `begun` holds.
    ///
    /// Errors: [`CalibrateError::NoRun`], [`CalibrateError::File`],
    /// [`CalibrateError::Newer`], [`CalibrateError::Damaged`],
    /// [`CalibrateError::Another`].
    pub fn resume(folder: &Path, begun: &Begun) -> Result<Self, CalibrateError> {
        let path = Self::path(folder);
        let text = match fs::read_to_string(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                return Err(CalibrateError::NoRun(path));
            }
            // Bytes that are no text were not written by a run.
            Err(error) if error.kind() == ErrorKind::InvalidData => String::new(),
            read => read.map_err(CalibrateError::file(&path))?,
        };
        let tagged: Option<Tagged> = serde_json::from_str(&text).ok();
        if tagged.is_some_and(|tagged| tagged.format == FORMAT && tagged.version > VERSION) {
            return Err(CalibrateError::Newer(path));
        }
        let measured: Option<Self> = serde_json::from_str(&text).ok();
        let whole = measured.filter(|run| sealed(&text, &run.sha256) == text && run.is_sound());
        let mut measured = whole.ok_or_else(|| CalibrateError::Damaged(path.clone()))?;
        measured.sha256.clear();
        // Dwells of version 1 stay without turns, and those that follow have them.
        measured.version = VERSION;
        match measured.begun.differs(begun) {
            Some(what) => Err(CalibrateError::Another(path, what)),
            None => Ok(measured),
        }
    }

    /// Whether the file holds what a run writes: its dwells are the first of the profile, each with
    /// finite readings of every channel in every orientation, and of every turn.
    fn is_sound(&self) -> bool {
        let places: Vec<_> = self.begun.profile.places().collect();
        let channels = self.begun.channels.len();
        let whole = |(dwelt, place): (&Dwelt, &(u32, usize))| {
            (dwelt.run, dwelt.step) == *place
                && dwelt.orientations.len() == self.begun.model.orientations()
                && dwelt.is_sound(channels)
        };
        self.format == FORMAT
            && (1..=VERSION).contains(&self.version)
            && self.begun.profile.check(self.begun.model).is_ok()
            && self.dwells.len() <= places.len()
            && self.dwells.iter().zip(&places).all(whole)
    }

    /// Run and number of the dwells that are missing, in their order.
    pub fn missing(&self) -> Vec<(u32, usize)> {
        self.begun
            .profile
            .places()
            .skip(self.dwells.len())
            .collect()
    }

    /// The readings of one channel.
    pub fn mean_readings(&self, channel: usize) -> Vec<MeanReading> {
        let mut mean_readings = Vec::new();
        for dwelt in &self.dwells {
            for (orientation, felt) in dwelt.orientations.iter().enumerate() {
                let Some(felt) = felt.get(channel) else {
                    continue;
                };
                mean_readings.push(MeanReading {
                    run: dwelt.run,
                    step: dwelt.step,
                    orientation,
                    temperature_c: felt.sensor_degc,
                    accel_g: felt.accel_g,
                });
            }
        }
        mean_readings
    }
}

#[cfg(test)]
mod tests {
    use super::super::profile::Step;
    use super::super::turns::Turned;
    use super::*;
    use crate::sample::assert_documented;

    fn begun() -> Begun {
        let step = |temperature_degc| Step {
            temperature_degc,
            dwell_min: 1.0,
        };
        Begun {
            model: Model::Piecewise,
            chamber: "Maker,Model".to_owned(),
            turned_by: None,
            profile: Profile {
                runs: 2,
                steps: [0.0, 20.0, 40.0].map(step).to_vec(),
            },
            channels: vec![Channel {
                node: 1,
                serial_number: 7,
                crc32: "0123ABCD".to_owned(),
            }],
        }
    }

    fn dwelt(run: u32, step: usize) -> Dwelt {
        let felt = Felt {
            accel_g: [0.01, 0.02, 1.0],
            scatter_mg: 0.3,
            sensor_degc: 20.0,
            rate_rad_s: None,
        };
        Dwelt {
            run,
            step,
            air_degc: Some(20.0),
            minutes: 41.5,
            repeated: 0,
            orientations: vec![vec![felt]],
            turns: Vec::new(),
        }
    }

    /// A dwell with a turn that was followed and one that was not.
    fn turned(run: u32, step: usize) -> Dwelt {
        let turned = Turned {
            before_g: [0.0, 0.0, 1.0],
            after_g: [0.0, 1.0, 0.1],
            turn_degc: 20.5,
            duration_s: 3.5,
            way_rad: 1.5,
            frame: [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]],
            by_gain_rad: [[[0.25, 0.0, -0.5]; 3]; 3],
        };
        let left_out = "the gyroscope gives no samples".to_owned();
        Dwelt {
            turns: vec![
                vec![Followed::Turned(Box::new(turned))],
                vec![Followed::LeftOut { left_out }],
            ],
            ..dwelt(run, step)
        }
    }

    #[test]
    fn a_run_goes_on_with_the_dwell_behind_the_last_one_that_was_kept() {
        let scratch = tempfile::tempdir().unwrap();
        let mut run = Measured::new(begun(), 5);
        assert_eq!(run.missing().len(), 6);
        run.dwells = vec![dwelt(1, 0), turned(1, 1), dwelt(1, 2), dwelt(2, 0)];
        run.save(scratch.path()).unwrap();
        let again = Measured::resume(scratch.path(), &begun()).unwrap();
        assert_eq!(again, run);
        assert_eq!(again.missing(), [(2, 1), (2, 2)]);
        assert_eq!(again.mean_readings(0).len(), 4);
        assert!(again.mean_readings(1).is_empty());
    }

    #[test]
    fn another_instrument_chamber_or_profile_is_named_and_refused() {
        let scratch = tempfile::tempdir().unwrap();
        let told = |begun: &Begun| {
            Measured::resume(scratch.path(), begun)
                .unwrap_err()
                .to_string()
        };
        assert!(told(&begun()).contains("no run"), "{}", told(&begun()));
        Measured::new(begun(), 5).save(scratch.path()).unwrap();
        let changed = |change: &dyn Fn(&mut Begun)| {
            let mut begun = begun();
            change(&mut begun);
            told(&begun)
        };
        let text = changed(&|b| b.channels[0].serial_number = 8);
        assert!(
            text.contains("another instrument (serial numbers)"),
            "{text}"
        );
        let text = changed(&|b| b.channels[0].crc32 = "0".repeat(8));
        assert!(text.contains("another calibration"), "{text}");
        assert!(changed(&|b| b.chamber = "x".to_owned()).contains("another chamber"));
        assert!(changed(&|b| b.profile.runs = 1).contains("another profile"));
        assert!(changed(&|b| b.model = Model::Quadratic).contains("another model"));
        assert!(changed(&|b| b.turned_by = Some(String::new())).contains("another motor"));
        // The node-id may have changed: the serial number tells who it is.
        let mut moved = begun();
        moved.channels[0].node = 9;
        assert!(Measured::resume(scratch.path(), &moved).is_ok());
    }

    #[test]
    fn every_key_of_the_file_is_documented() {
        let mut run = Measured::new(begun(), 5);
        run.dwells.push(turned(1, 0));
        let page = include_str!("../../../../docs/chamber.md");
        assert_documented(&run, page, "## measured.json");
    }

    #[test]
    fn a_file_that_no_run_has_written_is_refused() {
        let scratch = tempfile::tempdir().unwrap();
        let refused = |run: &Measured| {
            run.save(scratch.path()).unwrap();
            let told = Measured::resume(scratch.path(), &begun());
            matches!(told, Err(CalibrateError::Damaged(_)))
        };
        let whole = Measured::new(begun(), 5);
        assert!(!refused(&whole));
        let with = |change: &dyn Fn(&mut Measured)| {
            let mut run = whole.clone();
            run.dwells = vec![dwelt(1, 0)];
            change(&mut run);
            run
        };
        assert!(!refused(&with(&|_| ())));
        let newer = with(&|run| run.version = VERSION + 1);
        newer.save(scratch.path()).unwrap();
        let told = Measured::resume(scratch.path(), &begun());
        assert!(matches!(told, Err(CalibrateError::Newer(_))));
        assert!(refused(&with(&|run| run.dwells[0].step = 1)));
        assert!(refused(&with(&|run| run.version = 0)));
        assert!(refused(&with(&|run| run.dwells[0].orientations.clear())));
        assert!(!refused(&with(&|run| run.dwells = vec![turned(1, 0)])));
        assert!(refused(&with(&|run| {
            run.dwells = vec![turned(1, 0)];
            run.dwells[0].turns[1].clear();
        })));
        assert!(refused(&with(&|run| run.dwells[0].orientations[0].clear())));
        assert!(refused(&with(&|run| run.dwells = vec![dwelt(1, 0); 7])));
        let path = Measured::path(scratch.path());
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, &text[..text.len() / 2]).unwrap();
        let told = Measured::resume(scratch.path(), &begun());
        assert!(matches!(told, Err(CalibrateError::Damaged(_))));
    }

    #[test]
    fn a_run_went_on_with_numbers_that_somebody_had_changed() {
        let scratch = tempfile::tempdir().unwrap();
        let mut run = Measured::new(begun(), 5);
        run.dwells.push(dwelt(1, 0));
        run.save(scratch.path()).unwrap();
        let path = Measured::path(scratch.path());
        let text = fs::read_to_string(&path).unwrap();
        let digits = text.char_indices().filter(|(_, c)| c.is_ascii_digit());
        for (at, digit) in digits {
            let other = if digit == '1' { "2" } else { "1" };
            let changed = format!("{}{other}{}", &text[..at], &text[at + 1..]);
            fs::write(&path, changed).unwrap();
            assert!(
                Measured::resume(scratch.path(), &begun()).is_err(),
                "at {at}"
            );
        }
        fs::write(&path, text).unwrap();
        assert_eq!(Measured::resume(scratch.path(), &begun()).unwrap(), run);
    }

    #[test]
    fn a_run_of_version_1_goes_on_without_turns_for_what_it_has() {
        let scratch = tempfile::tempdir().unwrap();
        let mut old = Measured::new(begun(), 5);
        (old.version, old.dwells) = (1, vec![dwelt(1, 0)]);
        let text = json::to_lines(&old).unwrap();
        let text = text.replace(", \"turns\": []", "");
        assert!(!text.contains("turns"), "{text}");
        fs::write(Measured::path(scratch.path()), sealed(&text, "")).unwrap();
        let mut run = Measured::resume(scratch.path(), &begun()).unwrap();
        assert_eq!(
            (run.version, run.dwells.as_slice()),
            (VERSION, &[dwelt(1, 0)][..])
        );
        run.dwells.push(turned(1, 1));
        run.save(scratch.path()).unwrap();
        assert_eq!(Measured::resume(scratch.path(), &begun()).unwrap(), run);
    }

    #[test]
    fn what_was_measured_was_lost_with_the_folder_that_it_stood_in() {
        let scratch = tempfile::tempdir().unwrap();
        let folder = scratch.path().join("report");
        let run = Measured::new(begun(), 5);
        run.save(&folder).unwrap();
        fs::remove_dir_all(&folder).unwrap();
        run.save(&folder).unwrap();
        assert_eq!(Measured::resume(&folder, &begun()).unwrap(), run);
    }
}
