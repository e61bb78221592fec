//! Names of the controllers on a bus, and sets of them.
//!
//! In: nothing. Out: [`Port`], given by the bus, and [`Ports`], a set of up to 128.

/// The most controllers on one bus: the nodes of a CANopen network and one host.
pub const MOST_PORTS: usize = 128;

/// One controller on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Port(u8);

impl Port {
    /// `None` at [`MOST_PORTS`] and above.
    pub(super) fn new(index: usize) -> Option<Self> {
        (index < MOST_PORTS).then_some(Self(index as u8))
    }

    /// Its number, from 0 in the order in which they were attached.
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

/// A set of controllers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Ports(u128);

impl Ports {
    /// Nobody.
    pub const NONE: Self = Self(0);

    /// This one alone.
    pub const fn only(port: Port) -> Self {
        Self(1 << port.0)
    }

    /// True when the port is among them.
    pub const fn contains(self, port: Port) -> bool {
        self.0 >> port.0 & 1 == 1
    }

    /// How many.
    pub const fn count(self) -> usize {
        self.0.count_ones() as usize
    }

    /// The only member; `None` when there is nobody or there are several.
    pub const fn lone(self) -> Option<Port> {
        // Not by counting bits: for that this width has no instruction, and it takes fifty.
        if self.0 == 0 || self.0 & (self.0 - 1) != 0 {
            return None;
        }
        Some(Port(self.0.trailing_zeros() as u8))
    }

    /// True when nobody is in it.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The members, lowest number first.
    #[inline]
    pub fn iter(self) -> impl Iterator<Item = Port> {
        // Two halves, because for the whole width counting zeros and taking one away are long.
        let (mut low, mut high) = (self.0 as u64, (self.0 >> 64) as u64);
        std::iter::from_fn(move || {
            if low != 0 {
                let port = Port(low.trailing_zeros() as u8);
                low &= low - 1;
                return Some(port);
            }
            if high != 0 {
                let port = Port(64 + high.trailing_zeros() as u8);
                high &= high - 1;
                return Some(port);
            }
            None
        })
    }

    /// Those who are in one set or in the other.
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Those of this set who are not in the other.
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Those who are in both.
    pub const fn among(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    pub(super) fn insert(&mut self, port: Port) {
        *self = self.with(Self::only(port));
    }

    pub(super) fn remove(&mut self, port: Port) {
        *self = self.without(Self::only(port));
    }

    /// The members as bits, port 0 lowest.
    pub const fn bits(self) -> u128 {
        self.0
    }
}

impl FromIterator<Port> for Ports {
    fn from_iter<I: IntoIterator<Item = Port>>(ports: I) -> Self {
        (ports.into_iter()).fold(Self::NONE, |all, port| all.with(Self::only(port)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_gives_back_its_members_in_order() {
        let members = [0, 3, 64, 127].map(|index| Port::new(index).unwrap());
        let set: Ports = members.iter().rev().copied().collect();
        assert!(set.iter().eq(members));
        assert_eq!(set.count(), 4);
        assert_eq!([set.lone(), Ports::NONE.lone()], [None; 2]);
        assert!(
            members
                .iter()
                .all(|port| Ports::only(*port).lone() == Some(*port))
        );
        assert!(!set.contains(Port::new(1).unwrap()));
        assert_eq!(Port::new(128), None);
    }
}
