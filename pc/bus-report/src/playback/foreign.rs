//! Nodes that are no inclinometers of this kind, by their data sheets.
//!
//! In: devices and frames. Out: for each device its signals, how often each was seen and its
//! extremes, as text and JSON of the logs have them; which signals a frame carries.

use canopen::Frame;
use serde::Serialize;

use listen::eds::{Device, Signal};

/// A signal over time.
#[derive(Clone, Debug, Serialize)]
pub struct SignalTotal {
    /// Its name.
    pub name: String,
    /// Identifier of its PDO.
    pub cob_id: u16,
    /// How often it was seen.
    pub count: u64,
    /// The smallest value, in the device's own unit.
    pub min: Option<f64>,
    /// The largest value.
    pub max: Option<f64>,
}

impl SignalTotal {
    fn add(&mut self, value: f64) {
        self.min = Some(self.min.map_or(value, |min| min.min(value)));
        self.max = Some(self.max.map_or(value, |max| max.max(value)));
        self.count += 1;
    }
}

/// A node with a data sheet, and what was seen of it.
#[derive(Clone, Debug, Serialize)]
pub struct Seen {
    /// The node.
    #[serde(flatten)]
    pub device: Device,
    /// Frames whose length is not that of their PDO.
    pub wrong_length: u64,
    /// Its signals in the order of the PDOs; none of an instrument, which has its own place.
    pub signals: Vec<SignalTotal>,
}

/// All devices with a data sheet.
#[derive(Clone, Debug)]
pub struct Foreign {
    seen: Vec<Seen>,
    /// Identifier, device, PDO and the first of its signals, of those that are no inclinometers.
    pdos: Vec<(u16, usize, usize, usize)>,
}

impl Foreign {
    /// Nothing seen yet.
    pub fn new(devices: Vec<Device>) -> Self {
        let mut pdos = Vec::new();
        let seen = (0..).zip(devices).map(|(number, device)| {
            let mut signals = Vec::new();
            let own = device.pdos.iter().filter(|_| !device.is_inclinometer());
            for (place, pdo) in own.enumerate() {
                pdos.push((pdo.cob_id, number, place, signals.len()));
                signals.extend(pdo.signals.iter().map(|signal| SignalTotal {
                    name: signal.name.clone(),
                    cob_id: pdo.cob_id,
                    count: 0,
                    min: None,
                    max: None,
                }));
            }
            Seen {
                device,
                wrong_length: 0,
                signals,
            }
        });
        Self {
            seen: seen.collect(),
            pdos,
        }
    }

    /// What was seen of each device.
    pub fn into_seen(self) -> Vec<Seen> {
        self.seen
    }

    /// The device of this place.
    pub fn device(&self, place: usize) -> Option<&Device> {
        self.seen.get(place).map(|seen| &seen.device)
    }

    /// True when there is none, as nearly always.
    pub const fn is_empty(&self) -> bool {
        self.pdos.is_empty()
    }

    /// Device and PDO of a frame; `None` when it is of none of them, or of another length.
    pub fn find(&self, frame: &Frame) -> Option<(usize, usize)> {
        let (device, pdo, _) = self.at(frame)?;
        let signals = &self.device(device)?.pdos.get(pdo)?.signals;
        fits(signals, frame).then_some((device, pdo))
    }

    fn at(&self, frame: &Frame) -> Option<(usize, usize, usize)> {
        let cob_id = frame.cob_id().filter(|_| !frame.is_remote())?;
        let found = self.pdos.iter().find(|(id, ..)| *id == cob_id)?;
        Some((found.1, found.2, found.3))
    }

    /// Takes a frame.
    pub fn take(&mut self, frame: &Frame) {
        let Some((device, pdo, first)) = self.at(frame) else {
            return;
        };
        let Some(seen) = self.seen.get_mut(device) else {
            return;
        };
        let Some(pdo) = seen.device.pdos.get(pdo) else {
            return;
        };
        if !fits(&pdo.signals, frame) {
            seen.wrong_length += 1;
            return;
        }
        let both = seen.signals.iter_mut().skip(first).zip(&pdo.signals);
        both.for_each(|(total, signal)| total.add(signal.value(frame.padded())));
    }
}

/// Whether the frame has every signal.
fn fits(signals: &[Signal], frame: &Frame) -> bool {
    let bits = signals.iter().map(|s| usize::from(s.shift + s.bits)).max();
    bits.unwrap_or(0) <= 8 * frame.length()
}
