//! Matching: which observation of the peer belongs to which of this channel's.
//!
//! In: SYNCs, the PDOs of the peer's exchange, the time. Out: pairs of observations of one SYNC for
//! the pair's state machine ([`crate::pair`]) and the black box.
//!
//! A peer that misses a few SYNCs is waited for; then it is silent, or late when what it sends is
//! of the past. An exchange is whole with its second PDO, and, where this channel has turned, with
//! the third one. What has come of one that is not is compared for a few SYNCs; from then on it
//! counts as none, since nobody would find the faults that only the missing PDO shows.
//!
//! While this node's own controller is off the bus nobody else is blamed for the silence, and a
//! node whose own frames go out after later SYNCs takes its angles back: who pairs them with the
//! wrong SYNC would read an old angle as a new one.
//!
//! Left out: what a pair is worth (`pair`) and what the bus is told of it (`report`).

use canopen::Frame;
use canopen::nmt::State;
use instant::Instant;
use tilt::chain::{Invalid, Reading};
use tilt::composition::Place;
use tilt::cross_check::{CrossCheck, Findings};
use tilt::observation::Observation;

use super::sending::Sending;
use super::{Device, Memory};
use crate::black_box::{self, blamed_reason};
use crate::exchange::{self, Pdos};
use crate::instrument::Instrument;
use crate::objects::process::SyncSource;
use crate::objects::values::Latched;
use crate::peer_clock::{Heard, PeerClock};
use crate::sensor::Part;

/// SYNCs in a row that may pass without the peer's exchange before it counts as silent.
const MISSES_ALLOWED: u8 = 2;

/// SYNCs in a row that may pass without a whole exchange before it counts as none: a pair counts
/// for as long, and two turns at SYNCs of 50 ms, the slowest that the reaction time is promised
/// for, may be so far apart (`tilt::cross_check::rates`).
const INCOMPLETE_ALLOWED: u8 = 4;

/// What every exchange has.
const WHOLE: Pdos = Pdos::ANGLES.with(Pdos::BACKING);

/// A fault that does not show for so long is over, us: the slowest that makes the difference of two
/// accelerations too large shows within that.
const SOUND_US: u32 = 250_000;

/// Boot-up and heartbeats have this identifier plus the node-id (CiA 301, 7.2.8.3.2).
const ERROR_CONTROL: u16 = 0x700;

/// The bit of an answer to guarding that is not of the state (CiA 301, 7.2.8.3.1).
const TOGGLE: u8 = 0x80;

/// The controller is off the bus: 2052h sub 1.
const BUS_OFF: u8 = 2;

/// What has come of the peer's exchange, and what has gone of this node's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Matching {
    clock: PeerClock,
    /// PDOs of this SYNC's exchange that have come.
    came: Pdos,
    misses: u8,
    /// SYNCs in a row without a whole exchange.
    incomplete: u8,
    /// What the peer sent last.
    peer: Observation,
    /// What the estimator has found may come from a fault of the sensor.
    follows_fault: bool,
    /// PDOs of this node on their way to the bus.
    pub(super) sending: Sending,
}

impl Matching {
    /// Nothing heard.
    #[inline(never)]
    pub(super) const fn new() -> Self {
        Self {
            clock: PeerClock::new(),
            came: Pdos::NONE,
            misses: 0,
            incomplete: 0,
            peer: Observation::absent(Invalid::Unconfirmed),
            follows_fault: false,
            sending: Sending::new(),
        }
    }

    /// What the peer has not sent so far is not held against it.
    pub(super) const fn excuse(&mut self) {
        (self.misses, self.incomplete) = (0, 0);
    }
}

impl<P: Part, M: Memory, I: Instrument> Device<P, M, I> {
    /// Takes the check that 2003h asks for, with a fresh memory.
    // Out of line: a check is large, and nothing else of a start needs it on the stack.
    #[inline(never)]
    pub(super) fn choose_check(&mut self) {
        if !(I::PaperRule::FITTED && I::Ladder::FITTED) {
            // There is one check, and the device was built with it.
            return;
        }
        let check = match self.parts.values.parameters.check {
            1 => CrossCheck::by_paper(),
            2 => CrossCheck::by_ladder(),
            _ => None,
        };
        if let Some(check) = check {
            self.parts.pair.set_check(check);
        }
    }

    /// The peer's boot-up tells that what was held against it belongs to its life before, and its
    /// heartbeat that it is not OPERATIONAL.
    pub(super) fn watch_peer(&mut self, frame: &Frame) {
        let peer = ERROR_CONTROL + u16::from(self.parts.values.parameters.peer);
        match frame.bytes() {
            _ if frame.cob_id() != Some(peer) => {}
            [0] => {
                self.parts.pair.peer_restarted();
                self.matching.clock = PeerClock::new();
            }
            &[state] if state & !TOGGLE != State::Operational as u8 => self.parts.pair.peer_away(),
            _ => {}
        }
    }

    /// A SYNC was obeyed, from `source`.
    pub(super) fn synchronised(&mut self, source: SyncSource, now: Instant) {
        self.parts.values.pending.sync = false;
        self.parts.values.process.source = source;
        self.parts.pair.synchronised(now);
        self.matching.sending.sync();
        if source == SyncSource::Bus {
            self.end_standing_in(now);
        }
        if self.parts.values.state != State::Operational {
            // No PDOs here, so nobody is silent who sends nothing.
            self.parts.values.pending.unanswered = None;
            self.matching.came = Pdos::NONE;
            self.matching.excuse();
            return;
        }
        let came = core::mem::take(&mut self.matching.came);
        let Some(before) = self.parts.values.pending.unanswered.take() else {
            return;
        };
        // What this channel has heard since the SYNC before has nothing to be held against.
        self.parts.pair.lost();
        self.matching.incomplete = self.matching.incomplete.saturating_add(1);
        let too_many = self.matching.incomplete > INCOMPLETE_ALLOWED;
        if came.have(Pdos::ANGLES) && !too_many {
            // It is as old as its SYNC, so no safety frame stands on it for longer.
            return self.answered(&before, came, before.at);
        }
        let process = &mut self.parts.values.process;
        process.missed = process.missed.saturating_add(1);
        self.matching.misses = self.matching.misses.saturating_add(1);
        if too_many || self.matching.misses > MISSES_ALLOWED {
            let silence = self.parts.pair.silence();
            self.judge_sync(&before.observation, &silence, (before.at, now));
        }
    }

    pub(super) fn end_standing_in(&mut self, now: Instant) {
        if core::mem::take(&mut self.sync_substituted) {
            self.bus.stand_in_for_sync(None, now);
        }
    }

    /// Looks whether the peer's exchange is whole; true when it is, and was compared if there was
    /// anything to compare it with.
    pub(super) fn pair_up(&mut self, now: Instant) -> bool {
        let pending = &mut self.parts.values.pending;
        let came = core::mem::take(&mut pending.exchange).with(self.matching.came);
        self.matching.came = came;
        let turns = |own: &Latched| I::Moment::FITTED && own.observation.turned.is_some();
        let needed = match &pending.own {
            Some(own) if turns(own) => WHOLE.with(Pdos::TURN),
            _ => WHOLE,
        };
        let received = &self.parts.values.process.received;
        if !received.of_one_sync(came).have(needed) {
            return false;
        }
        self.matching.came = Pdos::NONE;
        self.matching.incomplete = 0;
        match pending.own.take() {
            Some(own) => self.answered(&own, came, now),
            // Without SYNC the peer speaks when it likes; then this channel's reading is of now.
            None if self.parts.values.process.source == SyncSource::None => {
                let observation = self.parts.channel.observe(&self.parts.settings, now);
                let at = now;
                self.answered(&Latched { observation, at }, came, now);
            }
            // The peer has heard a SYNC that this node has missed: there is nothing to compare.
            None => self.parts.pair.lost(),
        }
        true
    }

    /// These PDOs of the peer's exchange for the SYNC of `own` have come, and count as of `now`.
    fn answered(&mut self, own: &Latched, came: Pdos, now: Instant) {
        let backed = came.have(Pdos::BACKING);
        self.matching.misses = 0;
        self.parts.pair.hear();
        let process = &self.parts.values.process;
        let (received, latency_us) = (process.received, process.latency_us);
        let at = own.at.offset(-i64::from(latency_us));
        let mut peer = exchange::decode(&received, at, latency_us, came);
        if backed {
            let sound = peer.reading.x.is_ok() || peer.reading.y.is_ok();
            match self.matching.clock.hear(received.captured, own.at, sound) {
                Heard::InTime => {}
                // It belongs to another SYNC, so there is nothing to compare it with.
                Heard::Other => return self.parts.pair.lost(),
                Heard::Late => peer = peer.refused(Invalid::Late),
            }
        }
        if backed && I::PRESETS {
            let own_shown = self.parts.presentation();
            let pair = [&own.observation, &peer];
            let piece = (received.captured, received.piece());
            self.parts.pair.compare_shown(piece, own_shown, pair, now);
        }
        self.judge_sync(&own.observation, &peer, (own.at, now));
    }

    /// A channel that reports a fault itself doesn't wait for a SYNC to report it. The black box
    /// does: its frames are those of SYNCs.
    pub(super) fn watch_own(&mut self, now: Instant) {
        let fault = self
            .parts
            .channel
            .reason()
            .filter(|reason| !reason.is_transient());
        if let (Some(reason), None) = (fault, self.parts.pair.own_fault()) {
            self.parts.pair.own_faulty(reason);
            self.next_refresh = now;
        }
    }

    fn judge(&mut self, own: &Observation, peer: &Observation, times: (Instant, Instant)) {
        let off = self.parts.values.process.bus.state == BUS_OFF;
        let refused = match (off, self.matching.sending.is_late()) {
            (true, _) => Some(own.refused(Invalid::Silent)),
            (false, true) => Some(own.refused(Invalid::Late)),
            (false, false) => None,
        };
        if !off {
            self.matching.peer = *peer;
        }
        let policy = self.parts.values.parameters.policy();
        let own = refused.as_ref().unwrap_or(own);
        self.parts
            .pair
            .judge(own, &self.matching.peer, times, policy);
    }

    /// Restarts the estimator of a sensor that measures wrongly: what it has found is wrong, too.
    ///
    /// It begins anew when the fault shows, and once more when it has not shown for [`SOUND_US`]:
    /// what it began with may still have been of the fault. Of two that disagree either may be the
    /// one, once nothing has explained it.
    fn restart_estimator(&mut self, own: &Reading) {
        if !I::Moment::FITTED {
            return;
        }
        let findings = self.parts.pair.check().findings();
        let sound_us = findings.and_then(Findings::own_sound_us);
        let (Some(findings), Some(sound_us)) = (findings, sound_us) else {
            self.matching.follows_fault = false;
            return;
        };
        let follows_fault = sound_us < SOUND_US;
        let followed = core::mem::replace(&mut self.matching.follows_fault, follows_fault);
        // While it starts it shows nothing.
        let starts = own.x.is_err_and(Invalid::is_transient);
        let shows = sound_us == 0 && !starts && !findings.may_be_explained();
        let has_ended = followed && !follows_fault;
        if shows || has_ended {
            self.parts.channel.forget_motion();
        }
    }

    /// Judges at `now` what was observed at the SYNC of `at`, and keeps it.
    fn judge_sync(&mut self, own: &Observation, peer: &Observation, (at, now): (Instant, Instant)) {
        self.judge(own, peer, (at, now));
        self.restart_estimator(&own.reading);
        if !I::HISTORY {
            return;
        }
        let (state, (blamed, why)) = self.shown(now).finding();
        let process = &self.parts.values.process;
        let frame = black_box::Frame {
            own: process.sent.bytes(),
            peer: process.received.bytes(),
            state,
            blamed_reason: blamed_reason(blamed, why),
        };
        self.parts.black_box.record(&frame, at);
    }

    /// Time since the code was started, ms.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    pub(super) fn uptime_ms(&self, now: Instant) -> u32 {
        (now.micros_since(self.started).max(0) / 1000) as u32
    }
}
