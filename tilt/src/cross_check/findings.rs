//! Findings: what was found wrong with either channel of a pair, and how long it counts.
//!
//! In: for each pair, what speaks against either channel, how the two compare, and the time since
//! the pair before ([`Evidence`]). Out, whenever it is asked for: which channel is faulty and why,
//! whether the two disagree, and whether one of them may go on without the other.
//!
//! | stored | begins with | ends |
//! |---|---|---|
//! | a faulty channel | evidence against it | by the [`Latch`]; with a reset of that channel |
//! | ... late, silent, starting or by its own report | the same | after [`RECOVERY_US`] without |
//! | a disagreement | an unexplained difference | by the [`Latch`]; when it is explained |
//! | agreement | pairs that agree for [`PROOF_US`] | when this channel is away |
//!
//! No faulty channel explains an unexplained difference; it is explained when it is attributed to
//! one. Agreement counts for nothing while the newest two that were compared differ.
//!
//! A disagreement and a faulty channel are stored apart, since neither ends the other: a channel
//! that falls silent is not thereby the wrong one of two that differ. What is late or silent
//! explains no difference either. A channel that is found to measure wrongly does, if it is found
//! soon enough for both to have one cause. One that is found later is faulty, and the disagreement
//! stays beside it: the other channel does not go on alone.
//!
//! Time counts towards an end only while pairs show that the cause is gone. So nothing ends during
//! a silence, and the state needs no clock.
//!
//! Left out: how a pair is judged (`product`).

use crate::chain::Invalid;

use super::{Judgement, Member};

/// How long something found stays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Latch {
    /// Until the instrument is reset: somebody has to look.
    UntilReset,
    /// Until nothing of it has been seen for this many microseconds.
    Healthy(u32),
}

/// How long a channel that was late or silent has to be in time before it counts again.
pub const RECOVERY_US: u32 = 1_000_000;

/// How long the two have to agree before one may go on without the other, us: a difference of
/// 0.6 deg is found within half of that.
pub const PROOF_US: u32 = 500_000;

/// A disagreement is explained by a fault that is found within this time after it, us. The slowest
/// of those that show in the difference first is a damaged calibration: its check sum is compared
/// four times a second. What weighs the vectors themselves has longer ([`WEIGHED_CAUSE_US`]).
pub const ONE_CAUSE_US: u32 = 1_500_000;

/// The same for what gravity, a movement or a turn has weighed, us: a fault that begins while the
/// machine moves is named when it stands. Nothing shows that what is weighed then has made the
/// difference: a second fault, of the other channel, is named as well, and the wrong angle of the
/// first would be valid. So a disagreement of a minute is explained no more, and only a second
/// fault within the same minute is taken for the first.
pub const WEIGHED_CAUSE_US: u32 = 60_000_000;

/// The most that one pair counts for, us. It counts for the shorter one of the last two times
/// between pairs, so that a pair after a pause shows no more than any other.
const MOST_CREDIT_US: u32 = 250_000;

/// How the two channels compare at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Comparison {
    /// At least one of them gives no angle.
    Absent,
    /// The same; but both measure, and what is behind the angles agrees.
    Alike,
    /// They agree.
    Agree,
    /// They differ by more than they may, not yet for long.
    Excess,
    /// They differ.
    Differ,
}

/// What speaks against a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Against {
    /// Why it is held faulty.
    pub reason: Invalid,
    /// The peer reports it of itself, and holds it by its own latch.
    pub told: bool,
}

/// What one pair shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Evidence {
    /// Against this channel, against the peer.
    pub against: [Option<Against>; 2],
    /// This channel gives an angle; the peer does.
    pub measures: [bool; 2],
    /// How they compare.
    pub comparison: Comparison,
    /// Time since the pair before; 0 after a pause for which nothing counts.
    pub elapsed_us: u32,
}

/// A channel that is held faulty.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Faulty {
    reason: Invalid,
    told: bool,
    /// For how long nothing has spoken against it, us.
    sound_us: u32,
}

impl Faulty {
    /// True for what is over soon after it is no longer seen.
    const fn passes(&self) -> bool {
        self.told || self.reason.passes_with_its_cause()
    }

    /// True for what makes the two differ.
    const fn explains(&self) -> bool {
        !self.told && self.reason.measures_wrongly()
    }

    /// True for what only a comparison shows: that it is gone has to show in one as well.
    const fn was_compared(&self) -> bool {
        use Invalid::{Biased, Noise, Spikes};
        matches!(self.reason, Noise | Spikes | Biased) && !self.told
    }

    const fn is_over(&self, latch: Latch) -> bool {
        match latch {
            _ if self.passes() => self.sound_us >= RECOVERY_US,
            Latch::UntilReset => false,
            Latch::Healthy(us) => self.sound_us >= us,
        }
    }
}

/// Two that differ, and nobody is known to be the wrong one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Disagreement {
    /// For how long they have agreed since, us.
    agreed_us: u32,
    /// How long ago it was found, us; stops at [`WEIGHED_CAUSE_US`], where a pause takes it.
    age_us: u32,
}

/// Everything that was found and still counts. A reset is a new value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Findings {
    /// This channel, then the peer.
    faulty: [Option<Faulty>; 2],
    disagreement: Option<Disagreement>,
    /// For how long the two have agreed, us; stops at [`PROOF_US`].
    agreed_us: u32,
    /// The newest two that were compared differ, be it for the first time.
    contested: bool,
    /// Time between the two pairs before, us.
    before_us: u32,
}

const fn index(node: Member) -> usize {
    match node {
        Member::Own => 0,
        Member::Peer => 1,
    }
}

impl Findings {
    /// Takes in what one pair shows.
    // Out of line: the image is smaller.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub fn take(&mut self, evidence: &Evidence, latch: Latch) {
        let before_us = core::mem::replace(&mut self.before_us, evidence.elapsed_us);
        let credit_us = evidence.elapsed_us.min(before_us).min(MOST_CREDIT_US);
        self.count(evidence, credit_us);
        // What is over goes first, so that what this pair shows finds its place.
        self.release(latch);
        for (node, against) in [Member::Own, Member::Peer]
            .into_iter()
            .zip(evidence.against)
        {
            if let Some(against) = against {
                self.hold(node, against);
            }
        }
        if evidence.comparison == Comparison::Differ {
            self.differ();
        }
    }

    fn release(&mut self, latch: Latch) {
        for place in &mut self.faulty {
            *place = place.filter(|faulty| !faulty.is_over(latch));
        }
        self.disagreement = self.disagreement.filter(|held| match latch {
            Latch::UntilReset => true,
            Latch::Healthy(us) => held.agreed_us < us,
        });
    }

    /// Time goes by without evidence, or with evidence that the cause is gone.
    fn count(&mut self, evidence: &Evidence, credit_us: u32) {
        let agrees = evidence.comparison == Comparison::Agree;
        let alike = agrees || evidence.comparison == Comparison::Alike;
        let differs = evidence.comparison == Comparison::Differ;
        let channels = evidence.against.iter().zip(evidence.measures);
        for (place, (against, measures)) in self.faulty.iter_mut().zip(channels) {
            let Some(faulty) = place else { continue };
            // A fault that the peer reports of itself is held by the peer; this node's own finding
            // runs out meanwhile. A silence is no report.
            let reported = against
                .is_some_and(|against| against.told && !against.reason.passes_with_its_cause());
            let sound = if faulty.was_compared() {
                alike || reported
            } else {
                measures
            };
            // A channel that measures and has no angle yet starts, be it for long: what is held
            // here makes it start again and again.
            let found = against.is_some_and(|against| {
                let starts = measures && against.reason.is_transient();
                !against.told && !starts
            });
            if found || differs && faulty.explains() {
                faulty.sound_us = 0;
            } else if sound {
                faulty.sound_us = faulty.sound_us.saturating_add(credit_us);
            }
        }
        if let Some(held) = &mut self.disagreement {
            held.agreed_us = match evidence.comparison {
                Comparison::Alike if evidence.against != [None, None] => held.agreed_us,
                Comparison::Agree | Comparison::Alike => held.agreed_us.saturating_add(credit_us),
                // A silence shows neither that the cause is gone nor that it is there.
                Comparison::Absent => held.agreed_us,
                Comparison::Excess | Comparison::Differ => 0,
            };
            // Without pairs a channel may have got a fault of its own.
            held.age_us = match evidence.elapsed_us {
                0 => WEIGHED_CAUSE_US,
                _ => held.age_us.saturating_add(credit_us).min(WEIGHED_CAUSE_US),
            };
        }
        if agrees {
            self.agreed_us = self.agreed_us.saturating_add(credit_us).min(PROOF_US);
        }
        if !matches!(evidence.comparison, Comparison::Absent | Comparison::Alike) {
            self.contested = !agrees;
        }
    }

    /// A channel is faulty.
    pub fn hold(&mut self, node: Member, against: Against) {
        let new = Faulty {
            reason: against.reason,
            told: against.told,
            sound_us: 0,
        };
        let place = self.faulty.get_mut(index(node));
        match place {
            // A channel that falls silent after it was found wrong is still the wrong one.
            Some(Some(held)) if !held.passes() => {}
            Some(place) => *place = Some(new),
            None => {}
        }
        let weighed = against.reason == Invalid::Biased;
        let explains_us = if weighed {
            WEIGHED_CAUSE_US
        } else {
            ONE_CAUSE_US
        };
        let age_us = self.disagreement.map_or(0, |held| held.age_us);
        if against.reason.measures_wrongly() && age_us < explains_us {
            self.disagreement = None;
            self.contested = false;
        }
    }

    fn differ(&mut self) {
        let mut faulty = self.faulty.iter().flatten();
        if !faulty.any(Faulty::explains) {
            let held = self.disagreement.get_or_insert(Disagreement {
                agreed_us: 0,
                age_us: 0,
            });
            held.agreed_us = 0;
        }
    }

    /// This channel was away, or has been set up anew: it has to agree with the peer again, and
    /// who was late or silent meanwhile is not known.
    pub fn own_away(&mut self) {
        self.agreed_us = 0;
        self.before_us = 0;
        for place in &mut self.faulty {
            *place = place.filter(|faulty| !faulty.passes());
        }
    }

    /// The peer has been started anew: what was found against it belongs to its life before.
    pub fn peer_restarted(&mut self) {
        let [_, peer] = &mut self.faulty;
        *peer = None;
    }

    /// Why a channel is held faulty.
    pub fn faulty(&self, node: Member) -> Option<Invalid> {
        let place = self.faulty.get(index(node)).copied().flatten();
        place.map(|faulty| faulty.reason)
    }

    /// True while the two differ and nobody is known to be the wrong one.
    pub const fn disagree(&self) -> bool {
        self.disagreement.is_some()
    }

    /// True when the two have agreed for long enough that one may go on without the other.
    pub const fn have_agreed(&self) -> bool {
        self.agreed_us >= PROOF_US && !self.contested && self.disagreement.is_none()
    }

    /// For how long nothing has shown that this channel measures wrongly, us; `None` where it is
    /// not held to do so, and no disagreement shows that it may.
    pub fn own_sound_us(&self) -> Option<u32> {
        let [own, _] = &self.faulty;
        let wrong = own.as_ref().filter(|faulty| faulty.explains());
        let wrong = wrong.map(|faulty| faulty.sound_us);
        wrong.or(self.disagreement.map(|held| held.agreed_us))
    }

    /// True for a disagreement that the peer's fault may still explain.
    pub fn may_be_explained(&self) -> bool {
        self.disagreement
            .is_some_and(|held| held.age_us < ONE_CAUSE_US)
    }

    /// True for what lasts as long as the latch sets, the peer's included.
    pub fn is_latched(&self) -> bool {
        let latched = |faulty: &Faulty| !faulty.reason.passes_with_its_cause();
        self.disagree() || self.faulty.iter().flatten().any(latched)
    }

    /// What was found, as a judgement.
    pub fn judgement(&self) -> Option<Judgement> {
        let one = |faulty, reason| Some(Judgement::OneChannel { faulty, reason });
        match [self.faulty(Member::Own), self.faulty(Member::Peer)] {
            [Some(reason), Some(_)] => Some(Judgement::NoChannel(reason)),
            [Some(reason), None] => one(Member::Own, reason),
            [None, Some(reason)] => one(Member::Peer, reason),
            [None, None] => self.disagree().then_some(Judgement::Disagree),
        }
    }
}

#[cfg(test)]
mod tests;
