//! The pair: which reading of the peer belongs to which of this channel's, and what both are worth.
//!
//! In: SYNCs, the two PDOs of the peer's exchange, the time. Out: a judgement on each pair, and
//! from it this channel's standing: whether its angles may be used.
//!
//! A peer that misses a few SYNCs is waited for; one that stays silent, or speaks of the past, is
//! ill. While this node's own controller is off the bus nobody else is blamed for the silence, and
//! a node whose own frames go out after later SYNCs takes its angles back: who pairs them with the
//! wrong SYNC would read an old angle as a new one.
//!
//! Left out: what the bus is told of it (`report`).

use canopen::Frame;
use canopen::nmt::State;
use embedded_hal::spi::SpiDevice;
use tilt::chain::Invalid;
use tilt::cross_check::{
    CrossCheck, Judgement, Latch, Node as Which, PaperCheck, PaperState, ProductCheck, ProductState,
};
use tilt::observation::Observation;
use tilt::sample::Instant;

use super::sending::Sending;
use super::{Device, Memory, bus_time};
use crate::black_box::{self, blamed_reason};
use crate::exchange;
use crate::objects::process::{SyncSource, validity};
use crate::objects::values::Latched;
use crate::peer_clock::{Heard, PeerClock};

/// SYNCs in a row that may pass without the peer's exchange before it counts as silent.
const MISSES_ALLOWED: u8 = 2;

/// How long a judgement counts once no new one comes: three SYNCs, but at least and at most this
/// long, us.
const JUDGED_FOR_US: (i64, i64) = (1_000_000, 10_000_000);

/// Boot-up and heartbeats have this identifier plus the node-id (CiA 301, 7.2.8.3.2).
const ERROR_CONTROL: u16 = 0x700;

/// The controller is off the bus: 2052h sub 1.
const BUS_OFF: u8 = 2;

/// What is known of the pair.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    clock: PeerClock,
    /// The first PDO of this SYNC's exchange has come; the second one has.
    came: [bool; 2],
    /// The peer has been heard since this node became OPERATIONAL.
    heard: bool,
    pub(super) misses: u8,
    /// What the peer said last.
    peer: Observation,
    pub(super) judgement: Option<Judgement>,
    judged_at: Instant,
    /// Whether this channel may go on alone, for all that the last comparison has shown.
    pub(super) alone: Result<(), Invalid>,
    /// Time between the last two SYNCs, us.
    period_us: i64,
    /// PDOs of this node on their way to the bus.
    pub(super) sending: Sending,
}

impl Pair {
    /// Nothing heard.
    pub(super) const fn new() -> Self {
        Self {
            clock: PeerClock::new(),
            came: [false; 2],
            heard: false,
            misses: 0,
            peer: Observation::absent(Invalid::Unconfirmed),
            judgement: None,
            judged_at: Instant(0),
            alone: Err(Invalid::Unconfirmed),
            period_us: 0,
            sending: Sending::new(),
        }
    }

    /// A peer that has said nothing: until it has been heard once, it may still be starting.
    const fn silence(&self) -> Observation {
        Observation::absent(if self.heard {
            Invalid::Silent
        } else {
            Invalid::Unconfirmed
        })
    }

    /// How long a judgement counts.
    fn judged_for_us(&self) -> i64 {
        let (least, most) = JUDGED_FOR_US;
        self.period_us.saturating_mul(3).clamp(least, most)
    }
}

/// Whether a channel that is ill for this reason measures wrongly, and so explains a difference;
/// one that doesn't measure, or isn't heard, explains nothing of what was before.
const fn explains(reason: Invalid) -> bool {
    use Invalid::{Biased, Corrupt, Noise, Spikes, Stuck, Thermometer};
    matches!(
        reason,
        Biased | Corrupt | Noise | Spikes | Stuck | Thermometer
    )
}

impl<SPI: SpiDevice, M: Memory> Device<SPI, M> {
    /// Takes the check that 2003h asks for, with a fresh memory.
    pub(super) fn choose_check(&mut self) {
        match self.values.parameters.check {
            1 => self
                .node
                .set_check(CrossCheck::Paper(PaperCheck::PAPER, PaperState::default())),
            2 => self.node.set_check(CrossCheck::Product(
                ProductCheck::PRODUCT,
                ProductState::default(),
            )),
            _ => {}
        }
    }

    /// The peer's boot-up tells that what was held against it belongs to its life before.
    pub(super) fn watch_peer(&mut self, frame: &Frame) {
        let boot_up = ERROR_CONTROL + u16::from(self.values.parameters.peer);
        if frame.cob_id() == Some(boot_up) && frame.bytes() == [0] {
            self.node.peer_restarted();
            self.pair.clock = PeerClock::new();
            self.pair.heard = false;
            self.pair.misses = 0;
        }
    }

    /// A SYNC was obeyed, from `source`.
    pub(super) fn synchronised(&mut self, source: SyncSource, now: Instant) {
        self.values.news.sync = false;
        self.values.process.source = source;
        self.pair.period_us = now.micros_since(self.last_sync);
        self.pair.sending.sync();
        self.last_sync = now;
        if source == SyncSource::Bus {
            self.end_standing_in(now);
        }
        if self.values.state != State::Operational {
            // No PDOs here, so nobody is silent who says nothing.
            self.values.news.unanswered = None;
            self.pair.came = [false; 2];
            self.pair.misses = 0;
            return;
        }
        let [first, second] = core::mem::take(&mut self.pair.came);
        let Some(before) = self.values.news.unanswered.take() else {
            return;
        };
        // What this channel has heard since the SYNC before has nothing to be held against.
        self.node.pair_lost();
        if first && !second {
            // The angles have come and what is behind them has not: they are compared alone.
            return self.answered(before, false);
        }
        let process = &mut self.values.process;
        process.missed = process.missed.saturating_add(1);
        self.pair.misses = self.pair.misses.saturating_add(1);
        if self.pair.misses > MISSES_ALLOWED {
            let silence = self.pair.silence();
            self.judge_sync(before.observation, silence, before.at);
        }
    }

    pub(super) fn end_standing_in(&mut self, now: Instant) {
        if core::mem::take(&mut self.standing_in) {
            self.bus.stand_in_for_sync(None, bus_time(now));
        }
    }

    /// Looks whether the peer's exchange is whole.
    pub(super) fn pair_up(&mut self, now: Instant) {
        let news = &mut self.values.news;
        let [first, second] = &mut self.pair.came;
        *first |= core::mem::take(&mut news.exchange);
        *second |= core::mem::take(&mut news.backing);
        if !(*first && *second) {
            return;
        }
        self.pair.came = [false; 2];
        match news.own.take() {
            Some(own) => self.answered(own, true),
            // Without SYNC the peer speaks when it likes; then this channel's reading is of now.
            None if self.values.process.source == SyncSource::None => {
                let observation = self.node.observe(&self.settings, now);
                let at = now;
                self.answered(Latched { observation, at }, true);
            }
            // The peer has heard a SYNC that this node has missed: there is nothing to compare.
            None => self.node.pair_lost(),
        }
    }

    /// The peer's exchange for the SYNC of `own` has come; `backed` with its second PDO.
    fn answered(&mut self, own: Latched, backed: bool) {
        self.pair.misses = 0;
        self.pair.heard = true;
        let process = &self.values.process;
        let (received, latency_us) = (process.received, process.latency_us);
        let at = own.at.offset(-i64::from(latency_us));
        let mut peer = exchange::decode(&received, at, latency_us, backed);
        if backed {
            let sound = peer.reading.x.is_ok() || peer.reading.y.is_ok();
            match self.pair.clock.hear(received.captured, own.at, sound) {
                Heard::InTime => {}
                // It belongs to another SYNC, so there is nothing to compare it with.
                Heard::Other => return self.node.pair_lost(),
                Heard::Late => peer = peer.refused(Invalid::Late),
            }
        }
        self.judge_sync(own.observation, peer, own.at);
    }

    /// A channel that knows itself to be ill doesn't wait for a SYNC to say so. The black box does:
    /// its frames are those of SYNCs.
    pub(super) fn watch_own(&mut self, now: Instant) {
        let fault = self.node.channel.reason();
        let known = |judgement| {
            matches!(
                judgement,
                Judgement::OneChannel {
                    ill: Which::Own,
                    ..
                } | Judgement::NoChannel(_)
            )
        };
        let news = fault.is_some_and(|reason| !reason.is_transient());
        if news
            && self
                .pair
                .judgement
                .is_some_and(|judgement| !known(judgement))
        {
            let own = Observation::absent(fault.unwrap_or(Invalid::Stale));
            self.judge(own, self.pair.peer, now);
            self.next_refresh = now;
        }
    }

    fn judge(&mut self, own: Observation, peer: Observation, at: Instant) {
        let off = self.values.process.bus.state == BUS_OFF;
        let own = match (off, self.pair.sending.is_late()) {
            (true, _) => own.refused(Invalid::Silent),
            (false, true) => own.refused(Invalid::Late),
            (false, false) => own,
        };
        let peer = if off { self.pair.peer } else { peer };
        self.node.set_latch(match self.values.parameters.latch_s {
            0 => Latch::UntilReset,
            seconds => Latch::Healthy(u32::from(seconds).saturating_mul(1_000_000)),
        });
        let verdict = self.node.judge(own, peer, at);
        let judgement = verdict.judgement();
        self.values.process.judge(&verdict, self.node.residual());
        if self.pair.judgement != Some(judgement) {
            self.values.process.since_ms = self.uptime_ms(at);
        }
        self.pair.peer = peer;
        self.pair.judgement = Some(judgement);
        self.pair.judged_at = at;
        self.compare(judgement);
        self.values.own_ill = match judgement {
            Judgement::OneChannel {
                ill: Which::Own,
                reason,
            } => Some(reason),
            Judgement::NoChannel(reason) => Some(reason),
            _ => None,
        };
        self.values.standing = self.standing();
    }

    /// A channel goes on alone only after a comparison that left no doubt of it: an error that was
    /// there at the start shows in nothing else, and one of two that differ falling silent does
    /// not make the other right.
    fn compare(&mut self, judgement: Judgement) {
        let both = validity::COMPARED | validity::COMPARED << 1;
        let compared = self.values.process.validity & both != 0;
        let named = match judgement {
            Judgement::OneChannel { ill, reason } => ill == Which::Peer && explains(reason),
            _ => false,
        };
        let alone = &mut self.pair.alone;
        if matches!(judgement, Judgement::Disagree | Judgement::PhysicalFault) {
            *alone = Err(Invalid::Refused);
        } else if compared || named && *alone == Err(Invalid::Refused) {
            *alone = Ok(());
        }
    }

    /// Judges what was said at the SYNC of `at`, and keeps it.
    fn judge_sync(&mut self, own: Observation, peer: Observation, at: Instant) {
        self.judge(own, peer, at);
        let process = &self.values.process;
        let frame = black_box::Frame {
            own: process.sent.bytes(),
            peer: process.received.bytes(),
            state: process.state,
            blamed_reason: blamed_reason(process.blamed, process.why),
        };
        self.black_box.record(&frame, at);
    }

    /// Time since the code was started, ms.
    pub(super) fn uptime_ms(&self, now: Instant) -> u32 {
        (now.micros_since(self.started).max(0) / 1000) as u32
    }

    /// A judgement that no new one follows does not count for ever.
    pub(super) fn age_judgement(&mut self, now: Instant) {
        if now.micros_since(self.pair.judged_at) > self.pair.judged_for_us() {
            self.values.process.not_judged();
            // What was found stays found until a judgement takes it back or a reset does.
            self.pair.judgement = self.pair.judgement.filter(|judgement| judgement.is_fault());
        }
        if self.values.state != State::Operational {
            self.pair.heard = false;
        }
        self.values.standing = self.standing();
    }

    /// Whether this channel's angles may be used, and why not.
    ///
    /// Outside OPERATIONAL nobody works by them, and whoever sets the instrument up has to see
    /// them, so there they are shown as measured.
    fn standing(&self) -> Result<(), Invalid> {
        if self.values.state != State::Operational {
            return Ok(());
        }
        let alone = || match self.values.parameters.degraded {
            0 => self.pair.alone.and(Err(Invalid::Alone)),
            _ => self.pair.alone,
        };
        match self.pair.judgement {
            None => Err(Invalid::Unconfirmed),
            Some(Judgement::Agree | Judgement::Warning) => Ok(()),
            Some(Judgement::StopMotion | Judgement::DataDelay) => Ok(()),
            Some(Judgement::Waiting(_)) if !self.pair.heard => Err(Invalid::Unconfirmed),
            Some(Judgement::Waiting(_)) => alone(),
            Some(Judgement::OneChannel {
                ill: Which::Peer, ..
            }) => alone(),
            Some(Judgement::OneChannel {
                ill: Which::Own,
                reason,
            }) => Err(reason),
            Some(Judgement::Disagree | Judgement::PhysicalFault | Judgement::NoChannel(_)) => {
                Err(Invalid::Refused)
            }
        }
    }
}
