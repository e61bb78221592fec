//! Builders that keep the rows short: each starts a row and each method adds one property.
//!
//! In: what a row contains. Out: a [`Row`], all at compile time.
//!
//! Left out: whether the row makes sense, which `table` checks for all of them.

use canopen::object::{Access, DataType};

use super::row::{Default, Row, Shape};

/// A readable object without sub-indices.
pub const fn var(index: u16, name: &'static str, data_type: DataType, doc: &'static str) -> Row {
    Row {
        index,
        sub: 0,
        last: 0,
        shape: Shape::Var,
        name,
        data_type,
        access: Access::READ,
        unit: "",
        limits: None,
        default: Default::None,
        acts: false,
        doc,
    }
}

/// Sub-index 0 of an object whose members differ; `last` is its highest sub-index.
pub const fn record(index: u16, last: u8, name: &'static str, doc: &'static str) -> Row {
    let mut row = var(index, name, DataType::Unsigned8, doc).constant();
    row.shape = Shape::Record;
    row.value(last as i64)
}

/// Sub-index 0 of an object whose members are alike; `last` is its highest sub-index.
pub const fn array(index: u16, last: u8, name: &'static str, doc: &'static str) -> Row {
    let mut row = record(index, last, name, doc);
    row.shape = Shape::Array;
    row
}

/// A readable sub-index.
pub const fn member(
    index: u16,
    sub: u8,
    name: &'static str,
    data_type: DataType,
    doc: &'static str,
) -> Row {
    let mut row = var(index, name, data_type, doc);
    row.sub = sub;
    row.last = sub;
    row.shape = Shape::Member;
    row
}

/// One property each.
impl Row {
    const fn with(mut self, access: Access) -> Self {
        self.access = self.access.and(access);
        self
    }

    /// The row stands for every sub-index up to `last`.
    pub const fn to(mut self, last: u8) -> Self {
        self.last = last;
        self
    }

    /// Never changes; served from the row itself.
    pub const fn constant(self) -> Self {
        self.with(Access::CONST)
    }

    /// Readable and writable, even where sub-index 0 was a constant.
    pub const fn rw(mut self) -> Self {
        self.access = Access(self.access.0 & !Access::CONST.0);
        self.with(Access::WRITE)
    }

    /// Writable only.
    pub const fn wo(mut self) -> Self {
        self.access = Access::WRITE;
        self
    }

    /// Kept by 1010h.
    pub const fn stored(self) -> Self {
        self.with(Access::STORED)
    }

    /// Mappable into a TPDO.
    pub const fn tpdo(self) -> Self {
        self.with(Access::TPDO)
    }

    /// Writable, and mappable into an RPDO.
    pub const fn rpdo(self) -> Self {
        self.rw().with(Access::RPDO)
    }

    /// Mappable into an SRDO.
    pub const fn srdo(self) -> Self {
        self.with(Access::SRDO)
    }

    /// Readable, writable, kept by 1010h, and a write makes the safety configuration invalid.
    pub const fn safety(self) -> Self {
        self.rw().stored().with(Access::SAFETY)
    }

    /// A write acts at once.
    pub const fn acts(mut self) -> Self {
        self.acts = true;
        self
    }

    /// Its unit.
    pub const fn unit(mut self, unit: &'static str) -> Self {
        self.unit = unit;
        self
    }

    /// Lowest and highest value allowed.
    pub const fn limits(mut self, low: i64, high: i64) -> Self {
        self.limits = Some((low, high));
        self
    }

    const fn start(mut self, default: Default) -> Self {
        self.default = default;
        self
    }

    /// Starts with this number.
    pub const fn value(self, number: i64) -> Self {
        self.start(Default::Value(number))
    }

    /// Starts with this number plus the node-id.
    pub const fn node_id(self, number: i64) -> Self {
        self.start(Default::NodeId(number))
    }

    /// Starts with `a` on channel A and `b` on channel B.
    pub const fn channel(self, a: i64, b: i64) -> Self {
        self.start(Default::Channel(a, b))
    }

    /// Reads as this text.
    pub const fn text(self, text: &'static str) -> Self {
        self.constant().start(Default::Text(text))
    }
}
