//! One attempt to send a frame, from the start bit on: who hears it and how it will end.
//!
//! In: the senders that won the arbitration, everybody else's settings and at most one [`Fault`].
//! Out: an [`Attempt`] with the times at which it is taken and at which it ends (ISO 11898-1: data
//! and remote frame, error frame, acknowledgement). All is decided when the frame begins; only a
//! cut line or a short changes it later.

use canopen::Frame;

use super::confinement::ErrorState;
use super::controller::{Controller, Waiting};
use super::event::ErrorKind;
use super::faults::Fault;
use super::ports::{Port, Ports};
use super::wire::{INTERMISSION_BITS, TAIL_BITS, Wire};

/// An error flag, active or passive.
pub(super) const FLAG_BITS: u64 = 6;
/// Recessive bits that end an error frame.
pub(super) const DELIMITER_BITS: u64 = 8;
/// When a controller at another bit rate has seen rubbish, in bits of the slower rate. [ASSUME]
const RUBBISH_BITS: u64 = 12;
/// Up to the acknowledge slot, from the end of the CRC.
const TO_SLOT_BITS: u64 = 2;
/// Up to the acknowledge delimiter; a flag for a CRC error begins after it.
const TO_DELIMITER_BITS: u64 = 3;

/// How an attempt goes wrong.
#[derive(Clone, Copy, Debug)]
pub(super) struct Failure {
    pub(super) kind: ErrorKind,
    /// Those whose flags came first.
    pub(super) primary: Ports,
    /// What their receive counters grow by.
    pub(super) primary_count: u16,
    /// Whether the other receivers count an error too.
    pub(super) all_count: bool,
}

/// One attempt.
#[derive(Clone, Debug)]
pub(super) struct Attempt {
    pub(super) frame: Frame,
    pub(super) senders: Ports,
    /// Senders that, error passive, lost a tie in the data and left it to the others.
    pub(super) dropped: Ports,
    pub(super) start_ns: u64,
    pub(super) bit_ns: u64,
    /// Receivers at the senders' bit rate.
    pub(super) receivers: Ports,
    /// Receivers that count an error without disturbing anybody.
    pub(super) bewildered: Ports,
    /// When the frame is taken, and by whom.
    pub(super) take: Option<(u64, Ports)>,
    /// When it ends, and what went wrong.
    pub(super) end: Option<(u64, Option<Failure>)>,
    /// When the next frame may begin.
    pub(super) idle_ns: u64,
}

impl Attempt {
    /// A lone sender's frame that everybody takes.
    pub(super) fn smooth(
        waiting: &Waiting,
        sender: Port,
        receivers: Ports,
        start_ns: u64,
        bit_ns: u64,
    ) -> Self {
        let bits = waiting.stuffed_bits + TAIL_BITS;
        Self {
            frame: waiting.frame,
            senders: Ports::only(sender),
            dropped: Ports::NONE,
            start_ns,
            bit_ns,
            receivers,
            bewildered: Ports::NONE,
            take: Some((start_ns + (bits - 1) * bit_ns, receivers)),
            end: Some((start_ns + bits * bit_ns, None)),
            idle_ns: start_ns + (bits + INTERMISSION_BITS) * bit_ns,
        }
    }
}

/// Everybody but the senders.
struct Audience {
    /// At the senders' rate.
    receivers: Ports,
    /// Those among them that acknowledge.
    acknowledging: Ports,
    /// Those among them whose error flags are dominant.
    flagging: Ports,
    /// At another rate.
    strangers: Ports,
    /// Those among the strangers whose error flags are dominant.
    disturbing: Ports,
    /// The longest bit of all of them, ns.
    slowest_ns: u64,
}

impl Audience {
    fn new(controllers: &[Controller], senders: Ports, bit_ns: u64) -> Self {
        let mut audience = Self {
            receivers: Ports::NONE,
            acknowledging: Ports::NONE,
            flagging: Ports::NONE,
            strangers: Ports::NONE,
            disturbing: Ports::NONE,
            slowest_ns: bit_ns,
        };
        for (controller, port) in controllers.iter().zip(all()) {
            if !senders.contains(port) && controller.hears() {
                audience.add(controller, port, controller.bit_ns == bit_ns);
            }
        }
        audience
    }

    fn add(&mut self, controller: &Controller, port: Port, same_rate: bool) {
        let (heard, flagging) = match same_rate {
            true => (&mut self.receivers, &mut self.flagging),
            false => (&mut self.strangers, &mut self.disturbing),
        };
        heard.insert(port);
        if controller.flags() {
            flagging.insert(port);
        }
        if same_rate && controller.speaks() {
            self.acknowledging.insert(port);
        }
        self.slowest_ns = self.slowest_ns.max(controller.bit_ns);
    }
}

/// All names of ports, lowest first.
pub(super) fn all() -> impl Iterator<Item = Port> {
    (0..).map_while(Port::new)
}

/// What became of several senders with the same arbitration field.
pub(super) struct Tie {
    pub(super) senders: Ports,
    pub(super) dropped: Ports,
    /// The bit at which a sender that flags errors read another level.
    error: Option<(Wire, usize)>,
}

/// Compares what the senders put on the wire, bit by bit.
///
/// A sender that reads dominant where it sent recessive finds a bit error. If it is error passive
/// its flag is recessive, and the others go on.
pub(super) fn resolve(controllers: &[Controller], senders: Ports) -> Tie {
    let mut tie = Tie {
        senders,
        dropped: Ports::NONE,
        error: None,
    };
    if senders.count() < 2 {
        return tie;
    }
    let next = |port: Port| Some((port, Wire::new(&controllers[port.index()].next()?.1.frame)));
    let mut wires: Vec<(Port, Wire)> = senders.iter().filter_map(next).collect();
    while let Some((wire, bit)) = first_difference(&wires) {
        let recessive = |wire: &Wire| wire.levels().get(bit).is_none_or(|level| *level);
        let losers = wires.iter().filter(|(_, wire)| recessive(wire));
        let losers: Ports = losers.map(|(port, _)| *port).collect();
        if losers.iter().any(|port| controllers[port.index()].flags()) {
            tie.error = Some((wire, bit));
            return tie;
        }
        tie.dropped = tie.dropped.with(losers);
        tie.senders = tie.senders.without(losers);
        wires.retain(|(port, _)| !losers.contains(*port));
    }
    tie
}

/// The first bit that is not the same everywhere, and the wire of a sender that is dominant there.
fn first_difference(wires: &[(Port, Wire)]) -> Option<(Wire, usize)> {
    let (_, first) = wires.first()?;
    let bit = (wires.iter())
        .filter_map(|(_, wire)| first.differs(wire))
        .min()?;
    let dominant = wires
        .iter()
        .find(|(_, wire)| wire.levels().get(bit) == Some(&false))?;
    Some((dominant.1, bit))
}

/// All that decides how an attempt ends.
pub(super) struct Decision<'a> {
    pub(super) controllers: &'a [Controller],
    pub(super) tie: Tie,
    pub(super) waiting: Waiting,
    pub(super) start_ns: u64,
    pub(super) bit_ns: u64,
    /// Senders with several bit rates began together.
    pub(super) rates_differ: bool,
}

impl Decision<'_> {
    /// Decides; `strike` is asked for a fault once it is known who receives.
    pub(super) fn attempt(self, strike: impl FnOnce(Ports) -> Option<Fault>) -> Attempt {
        let senders = self.tie.senders.with(self.tie.dropped);
        let audience = Audience::new(self.controllers, senders, self.bit_ns);
        let bits = self.waiting.stuffed_bits + TAIL_BITS;
        let mut attempt = Attempt {
            frame: self.waiting.frame,
            senders: self.tie.senders,
            dropped: self.tie.dropped,
            start_ns: self.start_ns,
            bit_ns: self.bit_ns,
            receivers: audience.receivers,
            bewildered: audience.strangers.without(audience.disturbing),
            take: Some((self.at(bits - 1), audience.receivers)),
            end: Some((self.at(bits), None)),
            idle_ns: self.at(bits + INTERMISSION_BITS),
        };
        let fault = strike(audience.receivers);
        if self.rates_differ || !audience.disturbing.is_empty() {
            self.rubbish(&mut attempt, &audience);
        } else if let Some((wire, bit)) = self.tie.error {
            self.bit_error(&mut attempt, &audience, &wire, bit);
        } else {
            self.apply(&mut attempt, &audience, fault);
        }
        attempt
    }

    /// The time so many bits after the start, ns.
    fn at(&self, bits: u64) -> u64 {
        self.start_ns + bits * self.bit_ns
    }

    /// True when one of the senders sends dominant error flags.
    fn senders_flag(&self) -> bool {
        let mut senders = self.tie.senders.iter();
        senders.any(|port| self.controllers[port.index()].told < ErrorState::Passive)
    }

    fn apply(&self, attempt: &mut Attempt, audience: &Audience, fault: Option<Fault>) {
        // A fault at a port that doesn't receive this frame strikes nobody.
        let fault = fault.filter(|fault| match fault {
            Fault::Corrupt { .. } => true,
            Fault::Local(port) | Fault::LastButOne(port) | Fault::Overrun(port) => {
                audience.receivers.contains(*port)
            }
        });
        let hit = match fault {
            Some(Fault::Local(port)) => Ports::only(port),
            _ => Ports::NONE,
        };
        if let Some(Fault::Corrupt { bit }) = fault {
            let mut wire = Wire::new(&self.waiting.frame);
            let bit = wire.flip(usize::from(bit));
            return self.bit_error(attempt, audience, &wire, bit);
        }
        if audience.acknowledging.without(hit).is_empty() {
            return self.unacknowledged(attempt, audience);
        }
        match fault {
            Some(Fault::Local(port)) => self.local(attempt, audience, port),
            Some(Fault::LastButOne(port)) => self.last_but_one(attempt, audience, port),
            Some(Fault::Overrun(port)) => attempt.miss(Ports::only(port)),
            Some(Fault::Corrupt { .. }) | None => {}
        }
    }

    /// The attempt fails after so many bits; the flags last `flag_bits`.
    fn fail(&self, attempt: &mut Attempt, at_bits: u64, flag_bits: u64, failure: Failure) {
        let rest = flag_bits + DELIMITER_BITS + INTERMISSION_BITS;
        attempt.end = Some((self.at(at_bits), Some(failure)));
        attempt.idle_ns = self.at(at_bits + rest);
        let end_ns = self.at(at_bits);
        attempt.take = attempt.take.filter(|(at_ns, _)| *at_ns < end_ns);
    }

    /// Stuff errors of controllers at another rate, long before the CRC.
    fn rubbish(&self, attempt: &mut Attempt, audience: &Audience) {
        let bits = (RUBBISH_BITS * audience.slowest_ns).div_ceil(self.bit_ns);
        // Their flags have their own bit time, and the others' come on top.
        let flags = (2 * FLAG_BITS * audience.slowest_ns).div_ceil(self.bit_ns);
        let failure = Failure {
            primary: audience.disturbing,
            primary_count: 9,
            ..Failure::of(ErrorKind::BitRate)
        };
        self.fail(attempt, bits, flags, failure);
    }

    /// A sender reads at `bit` what it didn't send; `wire` is what everybody reads.
    ///
    /// The receivers find a stuff error at the sixth bit of one level, which the sender's flag
    /// brings about, and answer with flags of their own.
    fn bit_error(&self, attempt: &mut Attempt, audience: &Audience, wire: &Wire, bit: usize) {
        let seen = wire.run(bit, !self.senders_flag());
        let answer = match audience.flagging.is_empty() {
            true => FLAG_BITS,
            false => FLAG_BITS.saturating_sub(seen) + FLAG_BITS,
        };
        let failure = Failure::of(ErrorKind::Bit);
        self.fail(attempt, bit as u64 + 1, answer, failure);
    }

    /// Nobody pulls the acknowledge slot dominant, so the senders flag at the delimiter.
    ///
    /// Passive flags look like the rest of a good frame: who only listens takes it.
    fn unacknowledged(&self, attempt: &mut Attempt, audience: &Audience) {
        let taken = attempt.take;
        // Receivers see a form error one bit after the sender's flag began.
        let answered = self.senders_flag() && !audience.flagging.is_empty();
        let failure = Failure {
            all_count: self.senders_flag(),
            ..Failure::of(ErrorKind::Acknowledge)
        };
        let at_bits = self.waiting.stuffed_bits + TO_SLOT_BITS;
        self.fail(attempt, at_bits, FLAG_BITS + u64::from(answered), failure);
        if !self.senders_flag() {
            attempt.take = taken.map(|(at, to)| (at, to.without(audience.acknowledging)));
        }
    }

    fn local(&self, attempt: &mut Attempt, audience: &Audience, port: Port) {
        if !audience.flagging.contains(port) {
            return attempt.overlook(port);
        }
        // The others' form error comes one bit after the flag of the first.
        let others = audience.flagging.without(Ports::only(port));
        let answered = self.senders_flag() || !others.is_empty();
        let failure = Failure {
            primary: Ports::only(port),
            primary_count: if answered { 9 } else { 1 },
            ..Failure::of(ErrorKind::Crc)
        };
        let at_bits = self.waiting.stuffed_bits + TO_DELIMITER_BITS;
        self.fail(attempt, at_bits, FLAG_BITS + u64::from(answered), failure);
    }

    /// The flag of `port` begins with the last bit; the others answer it with overload flags,
    /// dominant even from a passive receiver, which count no error.
    fn last_but_one(&self, attempt: &mut Attempt, audience: &Audience, port: Port) {
        if !audience.flagging.contains(port) {
            return attempt.overlook(port);
        }
        attempt.miss(Ports::only(port));
        let failure = Failure {
            primary: Ports::only(port),
            primary_count: 9,
            all_count: false,
            ..Failure::of(ErrorKind::EndOfFrame)
        };
        let end_bits = self.waiting.stuffed_bits + TAIL_BITS;
        self.fail(attempt, end_bits, FLAG_BITS, failure);
    }
}

impl Failure {
    fn of(kind: ErrorKind) -> Self {
        Self {
            kind,
            primary: Ports::NONE,
            primary_count: 0,
            all_count: true,
        }
    }
}

impl Attempt {
    /// When it needs attention next, ns; `None` once nothing is left but the wait for idle.
    #[inline]
    pub(super) fn next_ns(&self) -> Option<u64> {
        let end = self.end.map(|(at_ns, _)| at_ns);
        match self.take {
            Some((at_ns, _)) => Some(end.map_or(at_ns, |end_ns| end_ns.min(at_ns))),
            None => end,
        }
    }

    /// They don't get the frame.
    fn miss(&mut self, ports: Ports) {
        self.receivers = self.receivers.without(ports);
        self.take = self.take.map(|(at_ns, to)| (at_ns, to.without(ports)));
    }

    /// This one finds an error that nobody else learns of.
    fn overlook(&mut self, port: Port) {
        self.miss(Ports::only(port));
        self.bewildered.insert(port);
    }

    /// A sender goes silent now. A frame nobody has taken breaks off.
    pub(super) fn cut(&mut self, port: Port, now_ns: u64) {
        let others = self.senders.without(Ports::only(port));
        let was_sending = self.senders.contains(port);
        self.senders = others;
        self.dropped.remove(port);
        if was_sending && others.is_empty() && matches!(self.end, Some((_, None))) {
            let Some((take_ns, _)) = self.take.take() else {
                return;
            };
            let at_ns = (now_ns + FLAG_BITS * self.bit_ns).min(take_ns);
            let rest = FLAG_BITS + DELIMITER_BITS + INTERMISSION_BITS;
            self.end = Some((at_ns, Some(Failure::of(ErrorKind::Cut))));
            self.idle_ns = at_ns + rest * self.bit_ns;
        }
    }
}
