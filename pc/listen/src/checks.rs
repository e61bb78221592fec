//! What does not fit together in what a channel sends.
//!
//! In: each thing found, with its time. Out: how often, and when first.

use serde::{Deserialize, Serialize};

/// A thing that can be wrong with what was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Check {
    /// A frame of the node of a length that its plan does not have.
    Length,
    /// A slope that may be used and is outside the measuring range (2040h).
    Range,
    /// A slope whose validity bit contradicts the number.
    Validity,
    /// A code that has no meaning: state, quality, fault or NMT state.
    Reserved,
    /// A PDO came twice after one SYNC.
    Twice,
    /// A PDO that came after the SYNC before did not come after this one.
    Missed,
    /// 2024h is not the difference of the angles that both channels have told.
    Difference,
    /// The states of both channels contradict each other, or a channel sees agreement where the
    /// angles that were told differ by more than they may.
    State,
    /// A slope in another unit (6000h) than it was taken in; it is not used.
    Unit,
}

impl Check {
    /// Every one of them.
    pub const ALL: [Self; 9] = [
        Self::Length,
        Self::Range,
        Self::Validity,
        Self::Reserved,
        Self::Twice,
        Self::Missed,
        Self::Difference,
        Self::State,
        Self::Unit,
    ];

    /// In words, of several.
    pub const fn words(self) -> &'static str {
        match self {
            Self::Length => "frames of a wrong length",
            Self::Range => "slopes outside the measuring range",
            Self::Validity => "slopes that contradict their validity bit",
            Self::Reserved => "codes without a meaning",
            Self::Twice => "PDOs twice after one SYNC",
            Self::Missed => "PDOs missing after a SYNC",
            Self::Difference => "differences (2024h) that are not those of the angles sent",
            Self::State => "states of the pair that contradict each other or the angles",
            Self::Unit => "slopes in another unit (6000h) than taken, not used: state it by --eds",
        }
    }

    /// The name in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Length => "length",
            Self::Range => "range",
            Self::Validity => "validity",
            Self::Reserved => "reserved",
            Self::Twice => "twice",
            Self::Missed => "missed",
            Self::Difference => "difference",
            Self::State => "state",
            Self::Unit => "unit",
        }
    }
}

/// How often something was found, and when first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// How often.
    pub count: u64,
    /// The time of the first.
    pub first_ns: u64,
}

/// All that was found in what a channel sends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Vec<Finding>")]
pub struct Checks([Finding; Check::ALL.len()]);

impl From<Vec<Finding>> for Checks {
    /// What was kept before a check existed has fewer of them.
    fn from(kept: Vec<Finding>) -> Self {
        let mut checks = Self::default();
        for (own, kept) in checks.0.iter_mut().zip(kept) {
            *own = kept;
        }
        checks
    }
}

impl Checks {
    pub(super) const fn add(&mut self, check: Check, time_ns: u64) {
        let finding = &mut self.0[check as usize];
        if finding.count == 0 {
            finding.first_ns = time_ns;
        }
        finding.count += 1;
    }

    /// Takes what another one has found.
    pub fn merge(&mut self, other: &Self) {
        for (own, other) in self.0.iter_mut().zip(&other.0) {
            own.first_ns = match (own.count, other.count) {
                (1.., 0) => own.first_ns,
                (0, 1..) => other.first_ns,
                _ => own.first_ns.min(other.first_ns),
            };
            own.count = own.count.saturating_add(other.count);
        }
    }

    /// The kinds that were found.
    pub fn found(&self) -> impl Iterator<Item = (Check, Finding)> + '_ {
        let all = Check::ALL.iter().zip(&self.0);
        all.filter(|(_, finding)| finding.count > 0)
            .map(|(check, finding)| (*check, *finding))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn checks_that_were_kept_before_there_was_another_one_are_read() {
        let of = |text: &str| serde_json::from_str::<Checks>(text);
        let one = of(r#"[{"count":2,"first_ns":7}]"#).unwrap();
        assert_eq!(one.found().count(), 1);
        let written = serde_json::to_string(&one).unwrap();
        assert_eq!(of(&written).unwrap(), one);
    }

    proptest! {
        #[test]
        fn merged_parts_are_the_whole(
            found in prop::collection::vec((0..Check::ALL.len(), any::<bool>()), 0..40),
        ) {
            let of = |wanted: &dyn Fn(bool) -> bool| {
                let mut checks = Checks::default();
                for (time_ns, (check, part)) in (0..).zip(&found) {
                    if wanted(*part) {
                        checks.add(Check::ALL[*check], time_ns);
                    }
                }
                checks
            };
            let (one, other, whole) = (of(&|part| part), of(&|part| !part), of(&|_| true));
            for (mut own, other) in [(one, other), (other, one)] {
                own.merge(&other);
                prop_assert_eq!(own, whole);
            }
        }
    }
}
