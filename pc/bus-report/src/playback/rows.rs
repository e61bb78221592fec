//! From frames to the rows of a table.
//!
//! In: frames that the summary has taken, with their news. Out: a [`Row`] for each frame that tells
//! something, and the signals of other nodes with a data sheet, in columns behind [`COLUMNS`].
//!
//! Left out: where rows go (`export`, and whoever reads a [`Table`](super::Table)).

use super::foreign::Foreign;
use super::row::{self, COLUMNS, Row};
use super::summary::Summary;
use bus_logs::Logged;
use listen::Meaning;
use listen::eds::Device;

/// The columns of other nodes' signals, and the values of the row under way.
#[derive(Debug)]
pub struct Rows {
    signals: Vec<String>,
    /// By device and PDO the first of its columns behind [`COLUMNS`].
    places: Vec<Vec<usize>>,
    extra: Vec<Option<f64>>,
}

impl Rows {
    /// The columns of these devices.
    pub fn new(devices: &[Device]) -> Self {
        let (signals, places) = columns(devices);
        Self {
            extra: vec![None; signals.len()],
            signals,
            places,
        }
    }

    /// The columns behind [`COLUMNS`]: `nodeN_` and the name of the data sheet in small letters.
    pub fn signals(&self) -> &[String] {
        &self.signals
    }

    /// The row of a frame that the summary has taken, and the values of [`Rows::signals`]; `None`
    /// for one that tells nothing.
    pub fn of<'a>(
        &'a mut self,
        logged: &Logged,
        interfaces: &'a [String],
        news: Meaning,
        summary: &Summary,
    ) -> Option<(Row<'a>, &'a [Option<f64>])> {
        let known = row::of_news(news, summary.watch(logged.interface)?);
        let foreign = summary.foreign();
        let other = match foreign.is_empty() {
            true => None,
            false => foreign.find(&logged.frame),
        };
        let (node_id, message, values) = match (known, other) {
            (Some(known), _) => known,
            (None, Some((device, _))) => {
                let node_id = foreign.device(device).map(|device| device.node_id);
                (node_id.unwrap_or(0), "pdo", [None; COLUMNS.len()])
            }
            (None, None) => return None,
        };
        self.extra.fill(None);
        if let Some((device, pdo)) = other {
            self.fill(logged, foreign, device, pdo);
        }
        let interface = interfaces.get(usize::from(logged.interface));
        let row = Row {
            time_ns: logged.time_ns,
            interface: interface.map_or("", String::as_str),
            node_id,
            message,
            values,
        };
        Some((row, &self.extra))
    }

    fn fill(&mut self, logged: &Logged, foreign: &Foreign, device: usize, pdo: usize) {
        let first = self.places.get(device).and_then(|pdos| pdos.get(pdo));
        let pdo = foreign.device(device).and_then(|one| one.pdos.get(pdo));
        if let (Some(first), Some(pdo)) = (first, pdo) {
            let places = self.extra.iter_mut().skip(*first);
            let both = places.zip(&pdo.signals);
            both.for_each(|(place, signal)| *place = Some(signal.value(logged.frame.padded())));
        }
    }
}

/// Names of the columns of other nodes' signals, and where those of each PDO begin.
fn columns(devices: &[Device]) -> (Vec<String>, Vec<Vec<usize>>) {
    let mut names: Vec<String> = Vec::new();
    let mut places = Vec::new();
    for device in devices {
        let mut of_device = Vec::new();
        for pdo in &device.pdos {
            of_device.push(names.len());
            // Ours have columns of their own.
            if device.is_inclinometer() {
                continue;
            }
            for signal in &pdo.signals {
                let plain = format!("node{}_{}", device.node_id, plain(&signal.name));
                let (index, sub) = signal.place;
                let taken = names.contains(&plain) || COLUMNS.contains(&plain.as_str());
                let name = if taken {
                    format!("{plain}_{index:04x}_{sub}_{:03x}", pdo.cob_id)
                } else {
                    plain
                };
                names.push(name);
            }
        }
        places.push(of_device);
    }
    (names, places)
}

/// Small letters, digits and underscores.
fn plain(name: &str) -> String {
    let letters = name.chars().map(|c| {
        if c.is_ascii_alphanumeric() {
            c.to_ascii_lowercase()
        } else {
            '_'
        }
    });
    let name: String = letters.collect();
    name.trim_matches('_').to_owned()
}
