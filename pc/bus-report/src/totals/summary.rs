//! What is kept of an instrument over any length of time.
//!
//! In: what the collector has found out of single frames. Out: a [`Summary`] that has the same
//! size for a minute and for a year, but for one short row per day. Two of them join to what one
//! of both times together would be, to the last bit, so that days, machines' logs and threads can
//! be counted apart.
//!
//! Left out: single events, which are kept in a list with an end (`events`), and what stands
//! between two frames (`instrument`).

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

use super::bins::{Bins, Extremes};
use super::days::Days;
use super::gaps::Gaps;
use super::join::{Join, join_fields};
use super::kind::Kind;
use super::motion::MotionSummary;
use super::tally::Tally;
use listen::Checks;

/// Why a slope could not be used: state of the pair (2021h) and the channel's own reason (2025h),
/// 0 where the channel had an angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Unusable {
    /// State of the pair, as 2021h shows it; `None` where it was not sent.
    pub state: Option<u8>,
    /// Reason of the channel's own, as 2025h numbers it; 0 for none.
    pub reason: u8,
    /// The slopes were in another unit (6000h) than they were taken in. Summaries of before this
    /// was judged are without.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub other_unit: bool,
}

/// States of the pair (2021h), and a place for all that do not exist.
pub const STATES: usize = 11;

/// One channel.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChannelSummary {
    /// TPDO 1 seen.
    pub readings: u64,
    /// How many of them carried each state of the pair; the last place is for states that do not
    /// exist.
    pub states: [u64; STATES],
    /// Slope X and Y while they could be used, 0.001 deg.
    pub slope: [Tally; 2],
    /// The same over time.
    pub slope_bins: [Bins<Extremes>; 2],
    /// Time with a slope that could be used, ns.
    pub usable_ns: u64,
    /// Time without one, by reason, ns.
    #[serde(with = "super::pairs")]
    pub unusable_ns: BTreeMap<Unusable, u64>,
    /// Standard uncertainty over time, 0.001 deg.
    pub uncertainty: Tally,
    /// The same over time.
    pub uncertainty_bins: Bins<Extremes>,
    /// TPDO 2 without a known uncertainty.
    pub uncertainty_unknown: u64,
    /// Temperature of the sensor, degC.
    pub temperature: Tally,
    /// The same over time.
    pub temperature_bins: Bins<Extremes>,
    /// Energy above 150 Hz (2010h sub 9), 8 steps per doubling, 64 for the channel's own noise.
    pub activity: Tally,
    /// The same over time.
    pub activity_bins: Bins<Extremes>,
    /// Its motion, where it has a gyroscope. Summaries of before this was counted are without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motion: Option<Box<MotionSummary>>,
    /// EMCY messages by code; 0 is "gone".
    pub emergencies: BTreeMap<u16, u64>,
    /// Boot-up messages.
    pub boots: u64,
    /// Times that the heartbeat stayed away too long.
    pub heartbeat_losses: u64,
    /// How long it stayed away, ns.
    pub heartbeat_lost_ns: u64,
    /// Frames of another form than the plan has.
    pub malformed: u64,
    /// Every fault that was present after an EMCY, bit n for fault n of `device::fault`.
    pub faults: u32,
    /// What does not fit together in what it sends.
    pub checks: Checks,
}

impl ChannelSummary {
    /// Counts a TPDO 1 that carried this state, or none.
    pub fn read(&mut self, state: Option<u8>) {
        self.readings += 1;
        let Some(state) = state else {
            return;
        };
        let place = usize::from(state).min(STATES - 1);
        if let Some(count) = self.states.get_mut(place) {
            *count += 1;
        }
    }
}

impl Join for ChannelSummary {
    fn join(&mut self, other: &Self) {
        join_fields! { self, other:
            readings, states, slope, slope_bins, usable_ns, unusable_ns, uncertainty,
            uncertainty_bins, uncertainty_unknown, temperature, temperature_bins, activity,
            activity_bins, motion, emergencies, boots, heartbeat_losses, heartbeat_lost_ns,
            malformed, checks
        }
        self.faults |= other.faults;
    }
}

/// The difference of the two channels, by our own calculation and by the nodes'.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DifferenceSummary {
    /// Channel A minus channel B on X and Y at the same SYNC, 0.001 deg.
    pub own: [Tally; 2],
    /// SYNCs compared by TPDO 3, as measured.
    pub by_measured: u64,
    /// SYNCs compared by TPDO 1, presets and offsets included.
    pub by_slopes: u64,
    /// The larger of both by size over time, with its sign.
    pub bins: Bins<Extremes>,
    /// SYNCs at which at least one axis could be compared and the uncertainty of both was known.
    pub judged: u64,
    /// Those of them at which a difference was above its expanded uncertainty (k = 2).
    pub above: u64,
    /// What the nodes have told (2024h sub 3), 0.001 deg.
    pub told: Tally,
    /// Sizes by which 2024h was off the closest of our own of the last SYNCs, 0.001 deg.
    pub told_off: Tally,
}

impl Join for DifferenceSummary {
    fn join(&mut self, other: &Self) {
        join_fields! { self, other:
            own, by_measured, by_slopes, bins, judged, above, told, told_off
        }
    }
}

/// An instrument.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Summary {
    /// Channel A and channel B.
    pub channels: [ChannelSummary; 2],
    /// The difference between them.
    pub difference: DifferenceSummary,
    /// Time without a frame of it.
    pub gaps: Gaps,
    /// The days with data.
    pub days: Days,
}

impl Summary {
    /// Counts an event of this kind.
    pub fn note(&mut self, time_ns: u64, kind: Kind) {
        if let Some(count) = self.days.at(time_ns).events.get_mut(kind as usize) {
            *count += 1;
        }
    }

    /// Time of which there is data, ns.
    pub fn covered_ns(&self) -> u64 {
        let days = self.days.iter().map(|(_, day)| day.covered_ns);
        days.fold(0, u64::saturating_add)
    }
}

impl Join for Summary {
    fn join(&mut self, other: &Self) {
        join_fields! { self, other: channels, difference, gaps, days }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::totals::kind::KINDS;

    /// Puts something into every field.
    fn note(summary: &mut Summary, time_s: u64, value: i32) {
        let time_ns = time_s * 1_000_000_000;
        let number = value.unsigned_abs() as usize;
        let channel = &mut summary.channels[number % 2];
        channel.slope[0].add(value);
        channel.slope_bins[1].add(time_ns, Extremes::of(value));
        channel.usable_ns += time_s;
        let why = Unusable {
            state: Some(number as u8 % 10),
            reason: 15,
            other_unit: number.is_multiple_of(2),
        };
        *channel.unusable_ns.entry(why).or_default() += 5;
        channel.uncertainty.add(value);
        channel.uncertainty_bins.add(time_ns, Extremes::of(value));
        channel.uncertainty_unknown += 1;
        channel.temperature.add(value % 90);
        channel.temperature_bins.add(time_ns, Extremes::of(value));
        channel.activity.add(value % 255);
        channel.activity_bins.add(time_ns, Extremes::of(value));
        *channel.emergencies.entry(number as u16 % 7).or_default() += 1;
        channel.boots += 1;
        channel.heartbeat_losses += 2;
        channel.heartbeat_lost_ns += 3;
        channel.malformed += 4;
        channel.read(Some(number as u8));
        channel.faults |= 1 << (number % 32);
        let difference = &mut summary.difference;
        difference.own[1].add(value);
        difference.by_measured += 1;
        difference.by_slopes += 2;
        difference.bins.add(time_ns, Extremes::of(value));
        difference.judged += 2;
        difference.above += 1;
        difference.told.add(value);
        difference.told_off.add(value);
        summary.gaps.add(super::super::gaps::Gap {
            from_ns: time_ns,
            to_ns: time_ns + number as u64,
            whole_bus: value > 0,
        });
        summary.note(time_ns, Kind::ALL[number % KINDS]);
        let day = summary.days.at(time_ns);
        day.covered_ns += time_s;
        day.syncs += 1;
        day.incidents += 1;
        day.largest_mdeg = day.largest_mdeg.max(Some(value.unsigned_abs()));
    }

    proptest! {
        /// What makes a machine-day the unit: they can be counted apart and joined, in any order.
        #[test]
        fn merged_days_are_the_whole(
            notes in prop::collection::vec(
                (0..3_000_000_u64, -200_000..200_000_i32, 0..3_usize),
                0..60,
            ),
        ) {
            let mut whole = Summary::default();
            let mut parts: [Summary; 3] = Default::default();
            for (time_s, value, part) in notes {
                note(&mut whole, time_s, value);
                note(&mut parts[part], time_s, value);
            }
            let merged = |parts: &[&Summary]| {
                let mut all = Summary::default();
                parts.iter().for_each(|part| all.join(part));
                all
            };
            let [a, b, c] = &parts;
            for order in [[a, b, c], [a, c, b], [b, a, c], [b, c, a], [c, a, b], [c, b, a]] {
                prop_assert_eq!(&merged(&order), &whole);
            }
            // And grouped the other way.
            prop_assert_eq!(&merged(&[a, &merged(&[b, c])]), &whole);
        }
    }
}
