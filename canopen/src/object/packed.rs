//! The table as it stands on the chip: what rows have in common is kept once.
//!
//! In: [`Entry`] rows while compiling. Out: [`Packed`], four bytes per row, with the kinds,
//! forms and defaults that the rows share beside them. A table that does not fit stops the build.
//!
//! Left out: lookups ([`Dictionary`](super::Dictionary)).

use super::{Access, DataType, DefaultKind, Entry};

/// Where a row is, and of which kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Index.
    pub index: u16,
    /// First sub-index of the run.
    pub sub: u8,
    /// Position in the kinds.
    pub kind: u8,
}

/// What a row is, apart from its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// Sub-indices of the run after the first one.
    pub more: u8,
    /// Position in the forms.
    pub form: u8,
    /// Position in the defaults.
    pub default: u8,
}

impl Kind {
    const fn is(&self, other: &Self) -> bool {
        self.more == other.more && self.form == other.form && self.default == other.default
    }
}

/// What a row is like, apart from its place and its default; as in [`Entry`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Form {
    /// Data type.
    pub data_type: DataType,
    /// Access.
    pub access: Access,
    /// Row of the limits; 255 for the whole range of the type.
    pub limits: u8,
    /// Where the default comes from.
    pub default_kind: DefaultKind,
}

impl Form {
    /// The form of an entry.
    pub const fn of(entry: &Entry) -> Self {
        Self {
            data_type: entry.data_type,
            access: entry.access,
            limits: entry.limits,
            default_kind: entry.default_kind,
        }
    }

    const fn is(&self, other: &Self) -> bool {
        self.data_type as u8 == other.data_type as u8
            && self.access.0 == other.access.0
            && self.limits == other.limits
            && self.default_kind as u8 == other.default_kind as u8
    }
}

/// A table with room for as many rows, and for as many kinds, forms and defaults; made while
/// compiling.
#[derive(Clone, Debug)]
pub struct Packed<const ROWS: usize, const SHARED: usize> {
    /// The rows, in the order of the entries; what is left over is empty.
    pub rows: [Row; ROWS],
    /// Kinds that occur, each once, and how many there are.
    pub kinds: ([Kind; SHARED], usize),
    /// Forms that occur, each once, and how many there are.
    pub forms: ([Form; SHARED], usize),
    /// Defaults that occur, each once, and how many there are.
    pub defaults: ([u32; SHARED], usize),
}

impl<const ROWS: usize, const SHARED: usize> Packed<ROWS, SHARED> {
    const EMPTY: Self = Self {
        rows: [Row {
            index: 0,
            sub: 0,
            kind: 0,
        }; ROWS],
        kinds: (
            [Kind {
                more: 0,
                form: 0,
                default: 0,
            }; SHARED],
            0,
        ),
        forms: (
            [Form {
                data_type: DataType::Domain,
                access: Access(0),
                limits: u8::MAX,
                default_kind: DefaultKind::Plain,
            }; SHARED],
            0,
        ),
        defaults: ([0; SHARED], 0),
    };

    /// Packs the entries. For constants: it panics, and so stops the build, when they do not fit
    /// or when a byte cannot count what they share.
    pub const fn of(entries: &[Entry]) -> Self {
        const { assert!(SHARED <= 256, "a byte picks one of 256") };
        let mut packed = Self::EMPTY;
        let mut i = 0;
        while i < entries.len() {
            let entry = &entries[i];
            let kind = Kind {
                more: entry.last - entry.sub,
                form: packed.form(Form::of(entry)),
                default: packed.default(entry.default),
            };
            packed.rows[i] = Row {
                index: entry.index,
                sub: entry.sub,
                kind: packed.kind(kind),
            };
            i += 1;
        }
        packed
    }

    /// Where the form stands; it is added when it does not.
    const fn form(&mut self, form: Form) -> u8 {
        let (forms, used) = (&mut self.forms.0, &mut self.forms.1);
        let mut i = 0;
        while i < *used && !forms[i].is(&form) {
            i += 1;
        }
        if i == *used {
            forms[i] = form;
            *used += 1;
        }
        i as u8
    }

    /// Where the default stands; it is added when it does not.
    const fn default(&mut self, default: u32) -> u8 {
        let (defaults, used) = (&mut self.defaults.0, &mut self.defaults.1);
        let mut i = 0;
        while i < *used && defaults[i] != default {
            i += 1;
        }
        if i == *used {
            defaults[i] = default;
            *used += 1;
        }
        i as u8
    }

    /// Where the kind stands; it is added when it does not.
    const fn kind(&mut self, kind: Kind) -> u8 {
        let (kinds, used) = (&mut self.kinds.0, &mut self.kinds.1);
        let mut i = 0;
        while i < *used && !kinds[i].is(&kind) {
            i += 1;
        }
        if i == *used {
            kinds[i] = kind;
            *used += 1;
        }
        i as u8
    }
}
