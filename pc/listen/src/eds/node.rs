//! What a node sends, by its data sheet.
//!
//! In: a [`Sheet`] and a node-id. Out: [`Device`]: its PDOs with the signals in them, and what
//! `watch` needs of an instrument.

use serde::Serialize;

use super::sheet::{Oddity, Sheet, Warning};
use crate::{NodePlan, PdoPlan, What};

/// PDOs that a node may send (CiA 301).
const MOST_PDOS: u16 = 512;

/// A node as its data sheet has it; in JSON without what it sends.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Device {
    /// The file.
    pub file: String,
    /// Its name.
    pub product: String,
    /// Its node-id.
    pub node_id: u8,
    /// What it sends.
    #[serde(skip)]
    pub pdos: Vec<Pdo>,
    /// What was odd about the sheet.
    pub warnings: Vec<Warning>,
    /// How much.
    pub warning_count: u64,
    #[serde(skip)]
    plan: NodePlan,
}

/// A PDO that is sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pdo {
    /// Its COB-ID, 11 bit.
    pub cob_id: u16,
    /// How often SYNC brings it; 0 when SYNC doesn't.
    pub every: u8,
    /// Its mapping as 1A00h has it.
    pub mapping: Vec<u32>,
    /// What it carries.
    pub signals: Vec<Signal>,
}

/// A value in a PDO.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signal {
    /// Name of the object.
    pub name: String,
    /// Index and sub-index.
    pub place: (u16, u8),
    /// Its lowest bit.
    pub shift: u8,
    /// Its length in bit.
    pub bits: u8,
    /// Data type (CiA 301, table 44).
    pub data_type: u16,
}

impl Signal {
    /// Its value in these eight bytes.
    pub fn value(&self, bytes: [u8; 8]) -> f64 {
        let upper = 64 - u32::from(self.bits);
        let top = u64::from_le_bytes(bytes) << (upper - u32::from(self.shift));
        match (self.data_type, self.bits) {
            (0x08, 32) => f64::from(f32::from_bits((top >> upper) as u32)),
            (0x11, 64) => f64::from_bits(top),
            // INTEGER8 to INTEGER64 with the odd lengths between them.
            (0x02..=0x04 | 0x10 | 0x12..=0x15, _) => ((top as i64) >> upper) as f64,
            _ => (top >> upper) as f64,
        }
    }
}

impl Device {
    /// What the sheet has of the node with this id.
    pub fn new(file: String, node_id: u8, sheet: &Sheet) -> Self {
        // What is odd about the PDOs is noted behind what was odd about the file.
        let mut notes = sheet.clone();
        let mut pdos = Vec::new();
        for number in 0..MOST_PDOS {
            if let Some(pdo) = pdo(sheet, node_id, number, &mut notes) {
                pdos.push(pdo);
            }
        }
        Self {
            file,
            product: sheet.product.clone(),
            node_id,
            plan: plan(sheet, node_id, &pdos),
            pdos,
            warnings: notes.warnings,
            warning_count: notes.warning_count,
        }
    }

    /// As `watch` has it.
    pub const fn plan(&self) -> &NodePlan {
        &self.plan
    }

    /// Whether it sends slopes, as an inclinometer of this kind does.
    pub fn is_inclinometer(&self) -> bool {
        let slopes = |pdo: &PdoPlan| pdo.has(|what| matches!(what, What::Slope(_)));
        self.plan.pdos.iter().any(slopes)
    }
}

fn pdo(sheet: &Sheet, node_id: u8, number: u16, notes: &mut Sheet) -> Option<Pdo> {
    let (parameter, index) = (0x1800 + number, 0x1A00 + number);
    let line = |index| {
        sheet
            .objects
            .range((index, 0)..)
            .next()
            .map_or(0, |(_, o)| o.line)
    };
    let is_there = |index| {
        sheet
            .objects
            .range((index, 0)..=(index, u8::MAX))
            .next()
            .is_some()
    };
    if !is_there(index) {
        return None;
    }
    let cob_id = match sheet.number(parameter, 1, node_id) {
        Some(cob_id) => cob_id as u32,
        // The identifiers that are set aside for the first four (CiA 301, 7.3.5).
        None if number < 4 => 0x180 + 0x100 * u32::from(number) + u32::from(node_id),
        None => {
            notes.warn(line(index), Oddity::NoCobId(parameter));
            return None;
        }
    };
    // Bit 31: the PDO is off. The two for a gyroscope are delivered so, and are switched on by a
    // master, mostly without a file that states this.
    if cob_id & 1 << 31 != 0 && !is_of_gyroscope(sheet, node_id, index) {
        return None;
    }
    if cob_id & 1 << 29 != 0 || cob_id & 0x1FFF_F800 != 0 {
        notes.warn(line(parameter), Oddity::Extended(parameter));
        return None;
    }
    let mapping = mapping(sheet, node_id, index, notes);
    let every = sheet.number(parameter, 2, node_id).unwrap_or(0);
    let pdo = Pdo {
        cob_id: (cob_id & 0x7FF) as u16,
        every: u8::try_from(every)
            .ok()
            .filter(|every| *every <= 240)
            .unwrap_or(0),
        signals: signals(sheet, index, &mapping, notes),
        mapping,
    };
    (!pdo.mapping.is_empty()).then_some(pdo)
}

/// Whether the first mapped object is one that only an instrument with a gyroscope has.
fn is_of_gyroscope(sheet: &Sheet, node_id: u8, index: u16) -> bool {
    let first = sheet.number(index, 1, node_id).unwrap_or(0);
    What::of((first >> 16) as u16, (first >> 8) as u8).is_of_gyroscope()
}

/// The mapped objects of 1A00h and on; what sub 0 counts is compared and not believed.
fn mapping(sheet: &Sheet, node_id: u8, index: u16, notes: &mut Sheet) -> Vec<u32> {
    let entry = |sub| sheet.number(index, sub, node_id).map(|value| value as u32);
    let named: Vec<u32> = (1..=64)
        .map_while(entry)
        .filter(|value| *value != 0)
        .collect();
    let Some(count) = sheet.number(index, 0, node_id) else {
        return named;
    };
    let wanted = usize::try_from(count).unwrap_or(usize::MAX);
    if wanted > named.len() || wanted == 0 && !named.is_empty() {
        let line = sheet
            .objects
            .get(&(index, 0))
            .map_or(0, |object| object.line);
        notes.warn(line, Oddity::MappingCount(index, count, named.len()));
    }
    // A count of 0 with objects behind it is a sheet that nobody has counted.
    let taken = if wanted == 0 { named.len() } else { wanted };
    named.into_iter().take(taken).collect()
}

fn signals(sheet: &Sheet, index: u16, mapping: &[u32], notes: &mut Sheet) -> Vec<Signal> {
    let line = sheet
        .objects
        .get(&(index, 0))
        .map_or(0, |object| object.line);
    let mut shift = 0_u32;
    let mut signals = Vec::new();
    for object in mapping {
        let (at, sub, bits) = ((object >> 16) as u16, (object >> 8) as u8, *object & 0xFF);
        if bits == 0 || shift + bits > 64 {
            notes.warn(line, Oddity::TooLong(index));
            break;
        }
        let entry = sheet.objects.get(&(at, sub));
        // 0001h to 0007h skip bits (CiA 306, dummy usage).
        if at > 0x0007 {
            if entry.is_none() {
                notes.warn(line, Oddity::NotThere(at, sub));
            }
            signals.push(Signal {
                name: name(sheet, at, sub),
                place: (at, sub),
                shift: shift as u8,
                bits: bits as u8,
                data_type: entry.map_or(0, |entry| entry.data_type),
            });
        }
        shift += bits;
    }
    signals
}

/// The name of an object, with that of its record in front of a member's.
fn name(sheet: &Sheet, index: u16, sub: u8) -> String {
    let of = |sub| {
        sheet
            .objects
            .get(&(index, sub))
            .map(|object| object.name.as_str())
    };
    let own = of(sub).filter(|name| !name.is_empty());
    match (own, of(0).filter(|_| sub > 0)) {
        (Some(own), Some(head)) if !head.is_empty() && head != own => format!("{head} {own}"),
        (Some(own), _) => own.to_owned(),
        (None, _) => format!("{index:04X}h sub {sub}"),
    }
}

fn plan(sheet: &Sheet, node_id: u8, pdos: &[Pdo]) -> NodePlan {
    let number = |index, sub| sheet.number(index, sub, node_id);
    let mut plan = NodePlan::as_delivered(node_id);
    let cob_id =
        |index, before: u16| number(index, 0).map_or(before, |value| (value & 0x7FF) as u16);
    plan.sync = cob_id(0x1005, plan.sync);
    plan.emcy = cob_id(0x1014, plan.emcy);
    if let Some(resolution) = number(0x6000, 0)
        && (1..=1000).contains(&resolution)
    {
        plan.resolution_mdeg = resolution as i32;
    }
    for (axis, range) in (0..).zip(&mut plan.range_mdeg) {
        let bound = |sub| number(0x2040, sub).and_then(|mdeg| i32::try_from(mdeg).ok());
        if let (Some(low), Some(high)) = (bound(2 * axis + 1), bound(2 * axis + 2)) {
            *range = [low, high];
        }
    }
    if number(0x1017, 0) == Some(0) {
        plan.lost_after_ms = 0;
    } else if let Some(every_ms) = number(0x1017, 0).and_then(|ms| u32::try_from(ms).ok()) {
        // Two and a half of them, as the nodes supervise each other as delivered.
        plan.lost_after_ms = every_ms.saturating_mul(5) / 2;
    }
    plan.pdos = pdos
        .iter()
        .take(8)
        .map(|pdo| PdoPlan::of(pdo.cob_id, pdo.every, &pdo.mapping))
        .collect();
    plan
}
