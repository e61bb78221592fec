//! All rows in order, and the compact table that the chip holds.
//!
//! In: the rows of this folder. Out: [`rows`] for the host, [`dictionary`] for the stack. The
//! table is computed while compiling, which fails when a row contradicts itself or another one;
//! names, units and texts stay out of the chip because nothing there refers to [`ROWS`].
//!
//! Left out: values that change.

use canopen::object::packed::Packed;
use canopen::object::{Access, DataType, DefaultKind, Dictionary, Entry, Table};

use super::calibration::CALIBRATION;
use super::communication::COMMUNICATION;
use super::manufacturer::MANUFACTURER;
use super::pdo;
use super::profile::{LOGICAL, PROFILE, RESOLUTIONS};
use super::row::{Default, Row, Shape};
use super::safety::{SAFETY, SRDO, SRDO_1_MAPPING, SRDO_2_MAPPING};
use super::update::UPDATE;

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

/// Where the rows come from, in any order.
const PARTS: &[&[Row]] = &[
    COMMUNICATION,
    pdo::RPDO.as_flattened(),
    &pdo::RPDO_1_MAPPING,
    &pdo::RPDO_2_MAPPING,
    &pdo::RPDO_3_MAPPING,
    &pdo::RPDO_4_MAPPING,
    pdo::TPDO.as_flattened(),
    &pdo::TPDO_1_MAPPING,
    &pdo::TPDO_2_MAPPING,
    &pdo::TPDO_3_MAPPING,
    &pdo::TPDO_4_MAPPING,
    SRDO.as_flattened(),
    &SRDO_1_MAPPING,
    &SRDO_2_MAPPING,
    SAFETY,
    MANUFACTURER,
    CALIBRATION,
    &UPDATE,
    PROFILE,
    &RESOLUTIONS,
    LOGICAL.as_flattened().as_flattened(),
];

/// Number of rows.
pub const COUNT: usize = count();

/// Every row, sorted by index and sub-index.
pub const ROWS: &[Row] = &sorted();

/// Every row, sorted by index and sub-index, with names and texts.
pub fn rows() -> &'static [Row] {
    ROWS
}

/// The table as the stack uses it, for one channel.
pub fn dictionary(channel: Channel) -> Dictionary {
    Dictionary {
        table: &TABLE,
        variant: channel as u8,
    }
}

/// A reference to it is one place in memory, since nothing in it can change.
const TABLE: Table = Table {
    rows: &first::<_, COUNT>(&PACKED.rows),
    kinds: &first::<_, { PACKED.kinds.1 }>(&PACKED.kinds.0),
    forms: &first::<_, { PACKED.forms.1 }>(&PACKED.forms.0),
    defaults: &first::<_, { PACKED.defaults.1 }>(&PACKED.defaults.0),
    limits: &NARROW,
    variants: &VARIANTS,
};
const PACKED: Packed<COUNT, 256> = Packed::of(&ENTRIES);
const NARROW: [(i32, u32); DISTINCT_LIMITS] = narrow();

const fn count() -> usize {
    let mut sum = 0;
    let mut part = 0;
    while part < PARTS.len() {
        sum += PARTS[part].len();
        part += 1;
    }
    sum
}

/// Position of a row in the order of the table.
const fn key(row: &Row) -> u32 {
    (row.index as u32) << 8 | row.sub as u32
}

const fn sorted() -> [Row; COUNT] {
    let mut rows = [PARTS[0][0]; COUNT];
    let (mut part, mut filled) = (0, 0);
    while part < PARTS.len() {
        let mut i = 0;
        while i < PARTS[part].len() {
            insert(&mut rows, filled, PARTS[part][i]);
            filled += 1;
            i += 1;
        }
        part += 1;
    }
    rows
}

/// Puts `row` in its place among the first `filled` rows.
const fn insert(rows: &mut [Row; COUNT], filled: usize, row: Row) {
    let mut place = filled;
    while place > 0 && key(&rows[place - 1]) > key(&row) {
        rows[place] = rows[place - 1];
        place -= 1;
    }
    rows[place] = row;
}

/// Stands in [`Entry::limits`] for the whole range of the type.
const WHOLE: u8 = u8::MAX;

const DISTINCT_LIMITS: usize = distinct().1;
const LIMITS: [(i64, i64); DISTINCT_LIMITS] = first(&distinct().0);
const CHANNEL_DEFAULTS: usize = variants().1;
const VARIANTS: [[u32; 2]; CHANNEL_DEFAULTS] = first(&variants().0);
const ENTRIES: [Entry; COUNT] = entries();

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
const fn distinct() -> ([(i64, i64); COUNT], usize) {
    let (mut found, mut used, mut i) = ([(0, 0); COUNT], 0, 0);
    while i < COUNT {
        if let Some(limits) = ROWS[i].limits
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
const fn variants() -> ([[u32; 2]; COUNT], usize) {
    let (mut found, mut used, mut i) = ([[0; 2]; COUNT], 0, 0);
    while i < COUNT {
        if let Default::Channel(a, b) = ROWS[i].default {
            found[used] = [a as u32, b as u32];
            used += 1;
        }
        i += 1;
    }
    (found, used)
}

/// The limits as the chip holds them; [`sound_limits`] sees to it that nothing is cut.
const fn narrow() -> [(i32, u32); DISTINCT_LIMITS] {
    let (mut narrow, mut i) = ([(0, 0); DISTINCT_LIMITS], 0);
    while i < DISTINCT_LIMITS {
        narrow[i] = (LIMITS[i].0 as i32, LIMITS[i].1 as u32);
        i += 1;
    }
    narrow
}

const fn entries() -> [Entry; COUNT] {
    let mut entries = [entry(&ROWS[0], 0); COUNT];
    let (mut i, mut variant) = (0, 0);
    while i < COUNT {
        entries[i] = entry(&ROWS[i], variant);
        if matches!(ROWS[i].default, Default::Channel(..)) {
            variant += 1;
        }
        i += 1;
    }
    entries
}

/// `variant` is the place of the row's default in [`VARIANTS`], if it has one there.
const fn entry(row: &Row, variant: u32) -> Entry {
    let (default_kind, default) = match row.default {
        Default::None | Default::Text(_) => (DefaultKind::Plain, 0),
        Default::Value(number) => (DefaultKind::Plain, number as u32),
        Default::NodeId(number) => (DefaultKind::PlusNodeId, number as u32),
        Default::Channel(..) => (DefaultKind::Variant, variant),
    };
    let limits = match row.limits {
        None => WHOLE,
        Some(limits) => position(&LIMITS, DISTINCT_LIMITS, limits) as u8,
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

/// Every rule that a table has to keep. A broken one stops the build here, and the size that the
/// compiler finds in place of 0 is the row: its index times 256, plus its sub-index.
const _: [(); 0] = [(); first_unsound()];

/// The key of the first row that breaks a rule; 0 when there is none.
const fn first_unsound() -> usize {
    let mut i = 0;
    while i < COUNT {
        let row = &ROWS[i];
        let alone = sound_shape(row) && sound_access(row) && sound_values(row);
        if !alone || i + 1 < COUNT && !sound_order(row, &ROWS[i + 1]) {
            return key(row) as usize;
        }
        i += 1;
    }
    // One number has to be left over for "the whole range".
    if DISTINCT_LIMITS < WHOLE as usize {
        0
    } else {
        1
    }
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
