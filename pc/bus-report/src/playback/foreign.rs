//! Nodes that are no inclinometers of this kind, by their data sheets.
//!
//! In: devices and frames. Out: for each signal how often it was seen, its extremes and its latest
//! value; which signals a frame carries.

use canopen::Frame;

use listen::eds::{Device, Pdo, Signal};

/// A signal over time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Range {
    /// How often it was seen.
    pub count: u64,
    /// The smallest value.
    pub min: f64,
    /// The largest value.
    pub max: f64,
}

impl Range {
    fn add(&mut self, value: f64) {
        if self.count == 0 {
            (self.min, self.max) = (value, value);
        }
        (self.min, self.max) = (self.min.min(value), self.max.max(value));
        self.count += 1;
    }
}

/// All devices with a data sheet.
#[derive(Clone, Debug)]
pub struct Foreign {
    devices: Vec<Device>,
    /// Identifier, device and PDO, of those that are no inclinometers.
    pdos: Vec<(u16, usize, usize)>,
    /// By device, PDO and signal.
    ranges: Vec<Vec<Vec<Range>>>,
    /// Frames of a length that their PDO hasn't.
    wrong_length: Vec<u64>,
}

impl Foreign {
    /// Nothing seen yet.
    pub fn new(devices: Vec<Device>) -> Self {
        let mut pdos = Vec::new();
        for (number, device) in devices.iter().enumerate() {
            if device.is_inclinometer() {
                continue;
            }
            let own = device.pdos.iter().enumerate();
            pdos.extend(own.map(|(place, pdo)| (pdo.cob_id, number, place)));
        }
        let of_pdo = |pdo: &Pdo| vec![Range::default(); pdo.signals.len()];
        let of_device = |device: &Device| device.pdos.iter().map(of_pdo).collect();
        Self {
            ranges: devices.iter().map(of_device).collect(),
            wrong_length: vec![0; devices.len()],
            devices,
            pdos,
        }
    }

    /// The devices.
    pub fn devices(&self) -> &[Device] {
        &self.devices
    }

    /// True when there is none, as nearly always.
    pub const fn is_empty(&self) -> bool {
        self.pdos.is_empty()
    }

    /// Device and PDO of a frame; `None` when it is of none of them, or of another length.
    pub fn find(&self, frame: &Frame) -> Option<(usize, usize)> {
        let (device, pdo) = self.at(frame)?;
        let signals = &self.devices.get(device)?.pdos.get(pdo)?.signals;
        fits(signals, frame).then_some((device, pdo))
    }

    fn at(&self, frame: &Frame) -> Option<(usize, usize)> {
        let cob_id = frame.cob_id().filter(|_| !frame.is_remote())?;
        let found = self.pdos.iter().find(|(id, ..)| *id == cob_id)?;
        Some((found.1, found.2))
    }

    /// Takes a frame.
    pub fn take(&mut self, frame: &Frame) {
        let Some((device, pdo)) = self.at(frame) else {
            return;
        };
        let signals = self.devices.get(device).and_then(|d| d.pdos.get(pdo));
        let Some(signals) = signals.map(|pdo| &pdo.signals) else {
            return;
        };
        if !fits(signals, frame) {
            if let Some(count) = self.wrong_length.get_mut(device) {
                *count += 1;
            }
            return;
        }
        let ranges = self.ranges.get_mut(device).and_then(|d| d.get_mut(pdo));
        let both = ranges.into_iter().flatten().zip(signals);
        both.for_each(|(range, signal)| range.add(signal.value(frame.padded())));
    }

    /// Signals of a device with what was seen of them.
    pub fn seen(&self, device: usize) -> impl Iterator<Item = (&Pdo, &Signal, &Range)> {
        let pdos = self
            .devices
            .get(device)
            .map(|device| device.pdos.as_slice());
        let ranges = self.ranges.get(device).map(Vec::as_slice);
        let both = pdos.unwrap_or(&[]).iter().zip(ranges.unwrap_or(&[]));
        both.flat_map(|(pdo, ranges)| {
            let signals = pdo.signals.iter().zip(ranges);
            signals.map(move |(signal, range)| (pdo, signal, range))
        })
    }

    /// Frames of a device whose length is not that of their PDO.
    pub fn wrong_length(&self, device: usize) -> u64 {
        self.wrong_length.get(device).copied().unwrap_or(0)
    }
}

/// Whether the frame has every signal.
fn fits(signals: &[Signal], frame: &Frame) -> bool {
    let bits = signals.iter().map(|s| usize::from(s.shift + s.bits)).max();
    bits.unwrap_or(0) <= 8 * frame.length()
}
