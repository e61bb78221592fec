//! All rows in order, and the compact table that the chip holds.
//!
//! In: the rows of this folder. Out: [`rows`] for the host, [`dictionary`] for the stack. The
//! table is computed while compiling, which fails when a row contradicts itself or another one;
//! names, units and texts stay out of the chip because nothing there refers to [`rows`].
//!
//! Left out: values that change.

use canopen::object::packed::Packed;
use canopen::object::{Access, DataType, DefaultKind, Dictionary, Entry, Table, at};

use super::calibration::{CALIBRATION, MOTOR_RUN};
use super::communication::{COMMUNICATION, PROGRAM};
use super::manufacturer::{
    CHECK, CHECK_AS_BUILT, DYNAMIC_UNCERTAINTY_LIMIT, HISTORY, MANUFACTURER, PRESENTATION_CHECK,
    RANGES, SAFE_SLOPES, UNCERTAINTY_LIMIT, VECTORS,
};
use super::moment::MOMENT;
use super::pdo;
use super::profile::{AS_MEASURED, LOGICAL, PROFILE, RESOLUTIONS};
use super::row::{Default, Row, Shape};
use super::safety::{SAFETY, SRDO, SRDO_1_MAPPING, SRDO_2_MAPPING};
use super::turned::TURNED;
use super::update::UPDATE;
use crate::instrument::PAPER_SERVICES;

/// The two channels of an instrument; each is a node of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Channel {
    /// Node-id 1 as delivered.
    A = 0,
    /// Node-id 2 as delivered.
    B = 1,
}

impl Channel {
    /// The node-id as delivered.
    pub const fn node_id(self) -> u8 {
        self as u8 + 1
    }
}

/// Which instruments have a row, as a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Models(u8);

impl Models {
    /// The device that is any instrument, and so has the rows of all.
    pub const WHOLE: Self = Self(1);
    /// The product.
    pub const PRODUCT: Self = Self(2);
    /// The paper's instrument.
    pub const PAPER: Self = Self(4);
    /// The product's variant with a gyroscope.
    pub const DYNAMIC: Self = Self(8);

    const ALL: Self = Self(15);
    const BUT_PAPER: Self = Self(11);
    const BUT_WHOLE: Self = Self(14);
    /// Those with tables.
    const TABLES: Self = Self(5);
    /// The product, and the device that is any instrument and is set up like it as delivered.
    const AS_PRODUCT: Self = Self(3);
    /// Those with a gyroscope.
    const GYROSCOPE: Self = Self(9);

    const fn share(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Whether a row of `of` is one of theirs, as far as their services go.
    const fn have(self, of: Self, row: &Row) -> bool {
        let serves = match self {
            Self::PAPER => PAPER_SERVICES.serve(at(row.index, row.sub)).is_ok(),
            _ => true,
        };
        self.share(of) && serves
    }
}

/// Where the rows come from, in any order, and which instruments have them.
const PARTS: &[(Models, &[Row])] = &[
    (Models::ALL, COMMUNICATION),
    (Models::ALL, pdo::RPDO.split_at(2).0.as_flattened()),
    (Models::AS_PRODUCT, &pdo::RPDO[2]),
    (Models::BUT_PAPER, &pdo::RPDO[3]),
    (Models::ALL, &pdo::RPDO_1_MAPPING),
    (Models::ALL, &pdo::RPDO_2_MAPPING),
    (Models::AS_PRODUCT, &pdo::RPDO_3_MAPPING),
    (Models::BUT_PAPER, &pdo::RPDO_4_MAPPING),
    (Models::ALL, pdo::TPDO.as_flattened()),
    (Models::ALL, &pdo::TPDO_1_MAPPING),
    (Models::ALL, &pdo::TPDO_2_MAPPING),
    (Models::ALL, &pdo::TPDO_3_MAPPING),
    (Models::ALL, &pdo::TPDO_4_MAPPING),
    (Models::ALL, MANUFACTURER),
    (Models::ALL, CALIBRATION),
    (Models::ALL, PROFILE),
    (Models::BUT_PAPER, &RESOLUTIONS),
    (Models::BUT_PAPER, LOGICAL.as_flattened().as_flattened()),
    (Models::PAPER, &AS_MEASURED),
    (Models::BUT_PAPER, PRESENTATION_CHECK),
    (Models::AS_PRODUCT, UNCERTAINTY_LIMIT),
    (Models::DYNAMIC, DYNAMIC_UNCERTAINTY_LIMIT),
    (Models::WHOLE, CHECK),
    (Models::BUT_WHOLE, CHECK_AS_BUILT),
    (Models::BUT_PAPER, RANGES),
    (Models::BUT_PAPER, PROGRAM),
    (Models::BUT_PAPER, SRDO.as_flattened()),
    (Models::BUT_PAPER, &SRDO_1_MAPPING),
    (Models::BUT_PAPER, &SRDO_2_MAPPING),
    (Models::BUT_PAPER, SAFETY),
    (Models::BUT_PAPER, SAFE_SLOPES),
    (Models::BUT_PAPER, VECTORS),
    (Models::BUT_PAPER, HISTORY),
    (Models::BUT_PAPER, &UPDATE),
    (Models::TABLES, MOTOR_RUN),
    (Models::GYROSCOPE, MOMENT),
    (Models::GYROSCOPE, pdo::DYNAMIC_TPDO.as_flattened()),
    (Models::DYNAMIC, &pdo::TPDO_7),
    (Models::WHOLE, &pdo::TPDO_7_OFF),
    (Models::GYROSCOPE, &pdo::TPDO_5_MAPPING),
    (Models::GYROSCOPE, &pdo::TPDO_6_MAPPING),
    (Models::GYROSCOPE, TURNED.as_flattened()),
    (Models::DYNAMIC, &pdo::DYNAMIC_RPDO_3),
    (Models::DYNAMIC, &pdo::DYNAMIC_RPDO_3_MAPPING),
    (Models::GYROSCOPE, &pdo::TPDO_7_MAPPING),
];

/// Every row of any instrument, sorted by index and sub-index, with names and texts.
pub fn rows() -> &'static [Row] {
    rows_of(Models::WHOLE)
}

/// The rows that any of these instruments has.
pub fn rows_of(models: Models) -> &'static [Row] {
    match models {
        Models::PRODUCT => product::ROWS,
        Models::PAPER => paper::ROWS,
        Models::DYNAMIC => dynamic::ROWS,
        _ => whole::ROWS,
    }
}

/// Where these instruments hold an identifier of the other channel's exchange: the RPDO's
/// communication parameter, whose sub-index 1 it is, and the identifier for node-id 0. Whoever
/// gives a channel another node-id writes them on the other one.
pub fn exchange(models: Models) -> impl Iterator<Item = (u16, u32)> {
    rows_of(models).iter().filter_map(|row| match row.default {
        Default::Channel(of_b, _) if row.sub == 1 && RPDOS.contains(&row.index) => {
            Some((row.index, (of_b - i64::from(Channel::B.node_id())) as u32))
        }
        _ => None,
    })
}

/// Communication parameters of RPDOs (CiA 301, 7.5.2.35).
const RPDOS: core::ops::Range<u16> = 0x1400..0x1600;

/// The table as the stack uses it, for one channel of any of these instruments.
pub fn dictionary(models: Models, channel: Channel) -> Dictionary {
    match models {
        Models::PRODUCT => product(channel),
        Models::PAPER => paper(channel),
        Models::DYNAMIC => dynamic(channel),
        _ => of(whole::TABLE, channel),
    }
}

/// The same of the product.
pub fn product(channel: Channel) -> Dictionary {
    of(product::TABLE, channel)
}

/// The same of the paper's instrument.
pub fn paper(channel: Channel) -> Dictionary {
    of(paper::TABLE, channel)
}

/// The same of the variant with a gyroscope.
pub fn dynamic(channel: Channel) -> Dictionary {
    of(dynamic::TABLE, channel)
}

fn of(table: &'static Table, channel: Channel) -> Dictionary {
    Dictionary {
        table,
        variant: channel as u8,
    }
}

/// The table of some models, made while compiling: each constant has the size that the one before
/// it tells.
macro_rules! table {
    ($module:ident, $models:expr) => {
        mod $module {
            use super::*;

            const COUNT: usize = count($models);
            /// The rows in their order.
            pub const ROWS: &[Row] = &SORTED;
            const SORTED: [Row; COUNT] = sorted($models);
            const LIMITS: [(i64, i64); distinct(&SORTED).1] = first(&distinct(&SORTED).0);
            const NARROW: [(i32, u32); LIMITS.len()] = narrow(&LIMITS);
            const VARIANTS: [[u32; 2]; variants(&SORTED).1] = first(&variants(&SORTED).0);
            const PACKED: Packed<COUNT, 256> = Packed::of(&entries(&SORTED, &LIMITS));
            /// A reference to it is one place in memory, since nothing in it can change.
            pub const TABLE: &Table = &Table {
                rows: &first::<_, COUNT>(&PACKED.rows),
                kinds: &first::<_, { PACKED.kinds.1 }>(&PACKED.kinds.0),
                forms: &first::<_, { PACKED.forms.1 }>(&PACKED.forms.0),
                defaults: &first::<_, { PACKED.defaults.1 }>(&PACKED.defaults.0),
                limits: &NARROW,
                variants: &VARIANTS,
            };
            /// Every rule that a table has to keep. A broken one stops the build here, and the
            /// size that the compiler finds in place of 0 is the row: its index times 256, plus
            /// its sub-index.
            const _: [(); 0] = [(); first_unsound(&SORTED, LIMITS.len())];
        }
    };
}

table!(whole, Models::WHOLE);
table!(product, Models::PRODUCT);
table!(paper, Models::PAPER);
table!(dynamic, Models::DYNAMIC);

const fn count(models: Models) -> usize {
    let mut sum = 0;
    let mut part = 0;
    while part < PARTS.len() {
        let (of, rows) = PARTS[part];
        let mut i = 0;
        while i < rows.len() {
            sum += models.have(of, &rows[i]) as usize;
            i += 1;
        }
        part += 1;
    }
    sum
}

/// Position of a row in the order of the table.
const fn key(row: &Row) -> u32 {
    (row.index as u32) << 8 | row.sub as u32
}

const fn sorted<const COUNT: usize>(models: Models) -> [Row; COUNT] {
    let mut rows = [COMMUNICATION[0]; COUNT];
    let (mut part, mut filled) = (0, 0);
    while part < PARTS.len() {
        let (of, more) = PARTS[part];
        let mut i = 0;
        while i < more.len() {
            if models.have(of, &more[i]) {
                insert(&mut rows, filled, more[i]);
                filled += 1;
            }
            i += 1;
        }
        part += 1;
    }
    rows
}

/// Puts `row` in its place among the first `filled` rows.
const fn insert(rows: &mut [Row], filled: usize, row: Row) {
    let mut place = filled;
    while place > 0 && key(&rows[place - 1]) > key(&row) {
        rows[place] = rows[place - 1];
        place -= 1;
    }
    rows[place] = row;
}

/// Stands in [`Entry::limits`] for the whole range of the type.
const WHOLE: u8 = u8::MAX;

/// The first `N` of many.
const fn first<T: Copy, const N: usize>(many: &[T]) -> [T; N] {
    let mut few = [many[0]; N];
    let mut i = 0;
    while i < N {
        few[i] = many[i];
        i += 1;
    }
    few
}

/// Limits that occur, each once, and how many there are.
const fn distinct<const COUNT: usize>(rows: &[Row; COUNT]) -> ([(i64, i64); COUNT], usize) {
    let (mut found, mut used, mut i) = ([(0, 0); COUNT], 0, 0);
    while i < COUNT {
        if let Some(limits) = rows[i].limits
            && position(&found, used, limits) == used
        {
            found[used] = limits;
            used += 1;
        }
        i += 1;
    }
    (found, used)
}

/// Where `wanted` stands among the first `used`; `used` when it does not.
const fn position(found: &[(i64, i64)], used: usize, wanted: (i64, i64)) -> usize {
    let mut i = 0;
    while i < used && !(found[i].0 == wanted.0 && found[i].1 == wanted.1) {
        i += 1;
    }
    i
}

/// Defaults that depend on the channel, one per row that has one, and how many there are.
const fn variants<const COUNT: usize>(rows: &[Row; COUNT]) -> ([[u32; 2]; COUNT], usize) {
    let (mut found, mut used, mut i) = ([[0; 2]; COUNT], 0, 0);
    while i < COUNT {
        if let Default::Channel(a, b) = rows[i].default {
            found[used] = [a as u32, b as u32];
            used += 1;
        }
        i += 1;
    }
    (found, used)
}

/// The limits as the chip holds them; [`sound_limits`] sees to it that nothing is cut.
const fn narrow<const COUNT: usize>(limits: &[(i64, i64); COUNT]) -> [(i32, u32); COUNT] {
    let (mut narrow, mut i) = ([(0, 0); COUNT], 0);
    while i < COUNT {
        narrow[i] = (limits[i].0 as i32, limits[i].1 as u32);
        i += 1;
    }
    narrow
}

const fn entries<const COUNT: usize>(rows: &[Row; COUNT], limits: &[(i64, i64)]) -> [Entry; COUNT] {
    let mut entries = [entry(&rows[0], limits, 0); COUNT];
    let (mut i, mut variant) = (0, 0);
    while i < COUNT {
        entries[i] = entry(&rows[i], limits, variant);
        if matches!(rows[i].default, Default::Channel(..)) {
            variant += 1;
        }
        i += 1;
    }
    entries
}

/// `variant` is the place of the row's default in [`Table::variants`], if it has one there.
const fn entry(row: &Row, different: &[(i64, i64)], variant: u32) -> Entry {
    let (default_kind, default) = match row.default {
        Default::None | Default::Text(_) => (DefaultKind::Plain, 0),
        Default::Value(number) => (DefaultKind::Plain, number as u32),
        Default::NodeId(number) => (DefaultKind::PlusNodeId, number as u32),
        Default::Channel(..) => (DefaultKind::Variant, variant),
    };
    let limits = match row.limits {
        None => WHOLE,
        Some(limits) => position(different, different.len(), limits) as u8,
    };
    Entry {
        index: row.index,
        sub: row.sub,
        last: row.last,
        data_type: row.data_type,
        access: row.access,
        limits,
        default_kind,
        default,
    }
}

/// The key of the first row that breaks a rule; 0 when there is none.
const fn first_unsound(rows: &[Row], limits: usize) -> usize {
    let mut i = 0;
    while i < rows.len() {
        let row = &rows[i];
        let alone = sound_shape(row) && sound_access(row) && sound_values(row);
        if !alone || i + 1 < rows.len() && !sound_order(row, &rows[i + 1]) {
            return key(row) as usize;
        }
        i += 1;
    }
    // One number has to be left over for "the whole range".
    if limits < WHOLE as usize { 0 } else { 1 }
}

/// Rows do not overlap, an object begins at sub-index 0, and a VAR has no members.
const fn sound_order(row: &Row, next: &Row) -> bool {
    let last = (row.index as u32) << 8 | row.last as u32;
    let same = next.index == row.index;
    let begins = same || next.sub == 0;
    key(next) > last && begins && !(same && matches!(row.shape, Shape::Var))
}

/// Names are there, and shape and sub-index belong together.
const fn sound_shape(row: &Row) -> bool {
    let named = !row.name.is_empty() && !row.doc.is_empty();
    let count = matches!(row.data_type, DataType::Unsigned8);
    named
        && match row.shape {
            Shape::Member => row.sub > 0 && row.last >= row.sub,
            Shape::Var => row.last == 0,
            Shape::Array | Shape::Record => row.last == 0 && count,
        }
}

/// Somebody can use it; TPDOs and SRDOs read, RPDOs write, all of them carry whole bytes;
/// constants are only read; only numbers are stored; only a write changes a configuration.
const fn sound_access(row: &Row) -> bool {
    let access = row.access;
    let read = access.has(Access::READ);
    let write = access.has(Access::WRITE);
    let constant = access.has(Access::CONST);
    let number = row.data_type.size().is_some();
    let whole_bytes = number && !matches!(row.data_type, DataType::Boolean);
    let sent = access.has(Access::TPDO) || access.has(Access::SRDO);
    let taken = access.has(Access::RPDO);
    (read || write)
        && (!sent || read && whole_bytes)
        && (!taken || write && whole_bytes)
        && (!constant || read && !write)
        && (!access.has(Access::STORED) || read && number && !constant)
        && (!access.has(Access::SAFETY) || write)
}

/// Lowest and highest number of a type.
const fn span(data_type: DataType) -> (i64, i64) {
    let bits = match data_type.size() {
        None => return (0, 0),
        Some(8) => return (0, i64::MAX),
        Some(bytes) => 8 * bytes,
    };
    match data_type {
        DataType::Boolean => (0, 1),
        _ if data_type.is_signed() => (-(1 << (bits - 1)), (1 << (bits - 1)) - 1),
        _ => (0, (1 << bits) - 1),
    }
}

const fn within(number: i64, span: (i64, i64)) -> bool {
    span.0 <= number && number <= span.1
}

/// The lowest value fits an `i32` and the highest a `u32`, as the chip holds them.
const fn sound_limits(limits: (i64, i64)) -> bool {
    within(limits.0, (i32::MIN as i64, i32::MAX as i64)) && within(limits.1, (0, u32::MAX as i64))
}

/// Limits lie within the type and defaults within the limits, for every node-id; a parameter that
/// is stored has a default to go back to.
const fn sound_values(row: &Row) -> bool {
    let whole = span(row.data_type);
    let (limits, narrow) = match row.limits {
        None => (whole, true),
        Some(limits) => (limits, sound_limits(limits)),
    };
    let text = matches!(row.data_type, DataType::VisibleString);
    let default = match row.default {
        Default::None => !row.access.has(Access::STORED),
        Default::Text(_) => text,
        Default::Value(number) => !text && within(number, limits),
        Default::NodeId(number) => within(number, limits) && within(number + 127, limits),
        Default::Channel(a, b) => within(a, limits) && within(b, limits),
    };
    let ordered = limits.0 <= limits.1;
    ordered && narrow && within(limits.0, whole) && within(limits.1, whole) && default
}

#[cfg(test)]
mod tests;
