//! How what is kept of two parts becomes what is kept of both.
//!
//! In: counters, lists of them and records with such fields. Out: for each of them the same in
//! whatever order and groups the parts are joined.

use listen::{Checks, Counts};
use std::collections::BTreeMap;

/// What is kept of a part, and can be joined with the same of another part.
pub trait Join {
    /// Takes what another one has.
    fn join(&mut self, other: &Self);
}

/// Joins the fields of one record, one by one, with those of another one.
macro_rules! join_fields {
    ($own:ident, $other:ident: $($field:ident),+) => {
        $($own.$field.join(&$other.$field);)+
    };
}
pub(super) use join_fields;

/// A counter, which stops at its greatest value: that of a forged summary may have any size, and
/// such a sum is the same in every order and grouping, as merging has to be.
impl Join for u64 {
    #[inline]
    fn join(&mut self, other: &Self) {
        *self = self.saturating_add(*other);
    }
}

impl<T: Join, const N: usize> Join for [T; N] {
    fn join(&mut self, other: &Self) {
        for (own, other) in self.iter_mut().zip(other) {
            own.join(other);
        }
    }
}

/// Something that not every part has.
impl<T: Join + Default> Join for Option<Box<T>> {
    fn join(&mut self, other: &Self) {
        if let Some(other) = other {
            self.get_or_insert_default().join(other);
        }
    }
}

impl<K: Ord + Copy> Join for BTreeMap<K, u64> {
    fn join(&mut self, other: &Self) {
        for (key, count) in other {
            self.entry(*key).or_default().join(count);
        }
    }
}

impl Join for Checks {
    fn join(&mut self, other: &Self) {
        self.merge(other);
    }
}

impl Join for Counts {
    fn join(&mut self, other: &Self) {
        join_fields! { self, other:
            frames, syncs, malformed, others, nmt, sdo, services, unplanned, strangers, extended,
            remote, backwards
        }
    }
}
