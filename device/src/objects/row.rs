//! One row of the object dictionary as people read it, and how it becomes the table on the chip.
//!
//! In: the rows of this folder, the only source of what the device offers on the bus. Out: the
//! compact table that the stack looks things up in ([`canopen::object::Dictionary`]). Names,
//! units and texts stay on the host: EDS, DBC, `docs/objects.md` and the tools read the rows.
//!
//! Left out: the values behind the rows.

use canopen::object::{Access, DataType};

/// What an object is in the dictionary (CiA 301, table 42).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// A single value, string or DOMAIN at sub-index 0.
    Var,
    /// Sub-index 0 of an object whose members are alike; its value is the highest sub-index.
    Array,
    /// Sub-index 0 of an object whose members differ; its value is the highest sub-index.
    Record,
    /// A sub-index of an array or record.
    Member,
}

/// What an object holds when the device leaves the factory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Default {
    /// Nothing fixed: measured, counted, or a DOMAIN.
    None,
    /// This number.
    Value(i64),
    /// This number plus the node-id.
    NodeId(i64),
    /// The first number on channel A, the second on channel B.
    Channel(i64, i64),
    /// This text.
    Text(&'static str),
}

/// One object, or a run of sub-indices that differ in nothing but their number.
#[derive(Clone, Copy, Debug)]
pub struct Row {
    /// Index.
    pub index: u16,
    /// First sub-index.
    pub sub: u8,
    /// Last sub-index; the same as `sub` for a single one.
    pub last: u8,
    /// What it is.
    pub shape: Shape,
    /// Name: of the whole object at sub-index 0, of the member otherwise.
    pub name: &'static str,
    /// Type.
    pub data_type: DataType,
    /// Access.
    pub access: Access,
    /// Unit with its scale ("0.001 deg"), empty when there is none.
    pub unit: &'static str,
    /// Lowest and highest value allowed; `None` for the whole range of the type.
    pub limits: Option<(i64, i64)>,
    /// Value from the factory.
    pub default: Default,
    /// A write acts at once, whatever was there before: data sheets name no default, or a tool that
    /// writes defaults back would act.
    pub acts: bool,
    /// What it means, in a sentence or two, with its source.
    pub doc: &'static str,
}
