//! Layer setting services: the slave (CiA 305).
//!
//! In: frames of the LSS master (7E5h). Out: answers (7E4h), and requests that the node passes on:
//! keep node-id and bit rate, activate a bit rate, begin as a configured node. A new node-id is
//! only pending: it counts from the next reset of communication on, or, for a node that had
//! none, when the master leaves the configuration state.
//!
//! Left out: the LSS master, and the CAN controller's bit timing registers.

use crate::frame::Frame;
use crate::node::UNCONFIGURED;

/// Identifier of the master's requests.
pub const REQUEST: u16 = 0x7E5;
/// Identifier of a slave's answers.
pub const RESPONSE: u16 = 0x7E4;

const SWITCH_GLOBAL: u8 = 0x04;
const SWITCH_FIRST: u8 = 0x40;
const SWITCH_LAST: u8 = 0x43;
const SWITCHED: u8 = 0x44;
const IDENTIFY_FIRST: u8 = 0x46;
const IDENTIFY_LAST: u8 = 0x4B;
const IDENTIFY_UNCONFIGURED: u8 = 0x4C;
const IDENTIFIED: u8 = 0x4F;
const UNCONFIGURED_HERE: u8 = 0x50;
const FASTSCAN: u8 = 0x51;
const CONFIGURE_NODE_ID: u8 = 0x11;
const CONFIGURE_BIT_TIMING: u8 = 0x13;
const ACTIVATE_BIT_TIMING: u8 = 0x15;
const STORE: u8 = 0x17;
const INQUIRE_FIRST: u8 = 0x5A;
const INQUIRE_LAST: u8 = 0x5D;
const INQUIRE_NODE_ID: u8 = 0x5E;

/// Fastscan: "is anybody there", and begin with the vendor-id.
const ANYBODY: u8 = 0x80;

/// Bit rates of CiA 301 by their index in table 0 of CiA 305, kbit/s; 0 is reserved.
const BIT_RATES: [u16; 9] = [1000, 800, 500, 250, 125, 0, 50, 20, 10];
/// Index that asks for automatic detection.
const AUTOMATIC: u8 = 9;

/// The bit rate of an index; `None` for [`AUTOMATIC`].
fn rate(index: u8) -> Option<u16> {
    BIT_RATES.get(usize::from(index)).copied()
}

/// What the node has to do after a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Nothing more.
    Answered,
    /// Keep this over a power cut, then tell [`Lss::respond_store`].
    Store {
        /// The pending node-id.
        node_id: u8,
        /// The bit rate configured in this session, kbit/s, 0 for automatic detection; `None`:
        /// none was.
        kbit_s: Option<u16>,
    },
    /// Be silent for the delay, change the bit rate, be silent again.
    Activate {
        /// The rate, kbit/s; `None`: detect it.
        kbit_s: Option<u16>,
        /// The delay, ms.
        delay_ms: u16,
    },
    /// A node that had no node-id has one now: initialise.
    Initialise,
}

/// The slave's state.
#[derive(Clone, Debug)]
pub struct Lss {
    configuring: bool,
    active: u8,
    pending: u8,
    bit_timing: Option<u8>,
    /// How many parts of a selective switch have fitted in their order.
    selected: u8,
    /// How many parts of an identification by ranges have fitted.
    identified: u8,
    /// The part of the identity that fastscan is at.
    scanned: u8,
    answer: Option<[u8; 8]>,
}

impl Lss {
    /// Waiting, without a node-id.
    pub const fn new() -> Self {
        Self {
            configuring: false,
            active: UNCONFIGURED,
            pending: UNCONFIGURED,
            bit_timing: None,
            selected: 0,
            identified: 0,
            scanned: 0,
            answer: None,
        }
    }

    /// The node-id that a start begins with; one that does not exist counts as none.
    pub const fn start(&mut self, node_id: u8) {
        self.pending = if matches!(node_id, 1..=127) {
            node_id
        } else {
            UNCONFIGURED
        };
        self.active = UNCONFIGURED;
    }

    /// Communication is reset: the pending node-id counts from now on, and the slave waits.
    pub const fn take_node_id(&mut self) -> u8 {
        self.wait();
        self.active = self.pending;
        self.active
    }

    /// Leaves the configuration state: no request configures before the next switch.
    ///
    /// Whoever starts LSS anew begins so, since a tool that has gone would otherwise leave behind
    /// a slave that takes the node-id meant for another.
    pub const fn wait(&mut self) {
        self.configuring = false;
        self.selected = 0;
    }

    /// True when an answer waits.
    pub const fn is_pending(&self) -> bool {
        self.answer.is_some()
    }

    /// The answer that waits.
    pub const fn transmit(&mut self) -> Option<[u8; 8]> {
        self.answer.take()
    }

    // As with `Server::close`.
    #[inline(never)]
    fn respond(&mut self, specifier: u8, rest: [u8; 4]) {
        let [a, b, c, d] = rest;
        self.answer = Some([specifier, a, b, c, d, 0, 0, 0]);
    }

    /// Takes a frame; `None` when it is none of LSS's.
    pub fn receive(&mut self, frame: &Frame, identity: &[u32; 4]) -> Option<Request> {
        self.serve(frame, identity, true)
    }

    /// As [`Lss::receive`], with fastscan or without.
    #[inline]
    pub(crate) fn serve(
        &mut self,
        frame: &Frame,
        identity: &[u32; 4],
        fastscan: bool,
    ) -> Option<Request> {
        if frame.cob_id() != Some(REQUEST) || frame.is_remote() {
            return None;
        }
        if frame.length() != 8 {
            return Some(Request::Answered);
        }
        let [specifier, a, b, c, d, e, f, g] = frame.padded();
        let number = u32::from_le_bytes([a, b, c, d]);
        Some(match specifier {
            SWITCH_GLOBAL => self.switch_global(a),
            SWITCH_FIRST..=SWITCH_LAST if !self.configuring => {
                self.select(specifier, number, identity)
            }
            IDENTIFY_FIRST..=IDENTIFY_LAST => self.identify(specifier, number, identity),
            IDENTIFY_UNCONFIGURED => {
                if self.active == UNCONFIGURED && self.pending == UNCONFIGURED {
                    self.respond(UNCONFIGURED_HERE, [0; 4]);
                }
                Request::Answered
            }
            FASTSCAN if fastscan => self.fastscan(number, e, [f, g], identity),
            _ if self.configuring => self.configure(specifier, [a, b], identity),
            _ => Request::Answered,
        })
    }

    fn switch_global(&mut self, mode: u8) -> Request {
        match mode {
            0 => {
                let was = self.configuring;
                self.wait();
                if was && self.active == UNCONFIGURED && self.pending != UNCONFIGURED {
                    return Request::Initialise;
                }
            }
            1 => self.configuring = true,
            _ => {}
        }
        Request::Answered
    }

    /// Notes in `reached` that this of `parts` has come, which count in their order only; true when
    /// that was the last one.
    // Once in the image.
    #[cfg_attr(target_pointer_width = "32", inline(never))]
    fn in_order(reached: &mut u8, part: u8, fits: bool, parts: u8) -> bool {
        let goes_on = fits && (part == 0 || *reached == part);
        let next = if goes_on { part + 1 } else { 0 };
        let is_whole = next == parts;
        *reached = if is_whole { 0 } else { next };
        is_whole
    }

    /// Four frames in their order name one slave by its whole identity.
    fn select(&mut self, specifier: u8, number: u32, identity: &[u32; 4]) -> Request {
        let part = specifier - SWITCH_FIRST;
        let fits = identity.get(usize::from(part)) == Some(&number);
        if Self::in_order(&mut self.selected, part, fits, 4) {
            self.configuring = true;
            self.respond(SWITCHED, [0; 4]);
        }
        Request::Answered
    }

    /// Six frames in their order: vendor, product, and ranges of revision and serial number.
    fn identify(&mut self, specifier: u8, number: u32, identity: &[u32; 4]) -> Request {
        let part = specifier - IDENTIFY_FIRST;
        let [vendor, product, revision, serial] = *identity;
        let fits = match part {
            0 => vendor == number,
            1 => product == number,
            2 => revision >= number,
            3 => revision <= number,
            4 => serial >= number,
            _ => serial <= number,
        };
        if Self::in_order(&mut self.identified, part, fits, 6) {
            self.respond(IDENTIFIED, [0; 4]);
        }
        Request::Answered
    }

    /// Finds one unconfigured slave bit by bit; the confirmation of the last part selects it.
    fn fastscan(
        &mut self,
        number: u32,
        bit: u8,
        [part, next]: [u8; 2],
        identity: &[u32; 4],
    ) -> Request {
        let takes_part =
            !self.configuring && self.active == UNCONFIGURED && self.pending == UNCONFIGURED;
        if !takes_part {
            return Request::Answered;
        }
        if bit == ANYBODY {
            self.scanned = 0;
            self.respond(IDENTIFIED, [0; 4]);
            return Request::Answered;
        }
        let Some(own) = identity.get(usize::from(part)) else {
            return Request::Answered;
        };
        let differing = (own ^ number).checked_shr(u32::from(bit));
        if bit > 31 || next > 3 || part != self.scanned || differing != Some(0) {
            return Request::Answered;
        }
        if bit == 0 {
            self.scanned = next;
            // Masters ask for bit 0 first, with `next` where they are, and confirm after that.
            self.configuring = next < part;
        }
        self.respond(IDENTIFIED, [0; 4]);
        Request::Answered
    }

    fn configure(&mut self, specifier: u8, [a, b]: [u8; 2], identity: &[u32; 4]) -> Request {
        match specifier {
            CONFIGURE_NODE_ID => {
                let valid = matches!(a, 1..=127 | UNCONFIGURED);
                if valid {
                    self.pending = a;
                }
                self.respond(specifier, [u8::from(!valid), 0, 0, 0]);
            }
            CONFIGURE_BIT_TIMING => {
                let valid = a == 0 && (b == AUTOMATIC || rate(b).is_some_and(|rate| rate != 0));
                if valid {
                    self.bit_timing = Some(b);
                }
                self.respond(specifier, [u8::from(!valid), 0, 0, 0]);
            }
            ACTIVATE_BIT_TIMING => {
                if let Some(index) = self.bit_timing {
                    let kbit_s = rate(index);
                    let delay_ms = u16::from_le_bytes([a, b]);
                    return Request::Activate { kbit_s, delay_ms };
                }
            }
            STORE => {
                let kbit_s = self.bit_timing.map(|index| rate(index).unwrap_or(0));
                let node_id = self.pending;
                return Request::Store { node_id, kbit_s };
            }
            INQUIRE_FIRST..=INQUIRE_LAST => {
                let part = usize::from(specifier - INQUIRE_FIRST);
                let number = identity.get(part).copied().unwrap_or(0);
                self.respond(specifier, number.to_le_bytes());
            }
            INQUIRE_NODE_ID => self.respond(specifier, [self.active, 0, 0, 0]),
            _ => {}
        }
        Request::Answered
    }

    /// Whether what [`Request::Store`] asked for is kept: error 2 when the memory failed.
    pub fn respond_store(&mut self, kept: bool) {
        self.respond(STORE, [if kept { 0 } else { 2 }, 0, 0, 0]);
    }
}

impl Default for Lss {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;

    const A: [u32; 4] = [0x11, 0x22, 0x33, 0x0444_0001];
    const B: [u32; 4] = [0x11, 0x22, 0x33, 0x0444_0101];

    fn ask(lss: &mut Lss, identity: &[u32; 4], bytes: &[u8]) -> (Option<Request>, Option<u8>) {
        let mut padded = [0; 8];
        padded[..bytes.len()].copy_from_slice(bytes);
        let request = lss.receive(&Frame::data_frame(REQUEST, &padded), identity);
        (request, lss.transmit().map(|answer| answer[0]))
    }

    fn number(specifier: u8, number: u32, rest: [u8; 3]) -> [u8; 8] {
        let [a, b, c, d] = number.to_le_bytes();
        [specifier, a, b, c, d, rest[0], rest[1], rest[2]]
    }

    /// What a master does: bit by bit, assuming 0 and trying 1 when nobody answers.
    fn scan(slaves: &mut [(Lss, [u32; 4])]) -> Option<[u32; 4]> {
        let mut any = |bytes: &[u8]| {
            let mut heard = false;
            for (lss, identity) in slaves.iter_mut() {
                heard |= ask(lss, identity, bytes).1 == Some(IDENTIFIED);
            }
            heard
        };
        if !any(&number(FASTSCAN, 0, [ANYBODY, 0, 0])) {
            return None;
        }
        let mut found = [0_u32; 4];
        for part in 0..4_u8 {
            for bit in (0..32).rev() {
                if !any(&number(
                    FASTSCAN,
                    found[usize::from(part)],
                    [bit, part, part],
                )) {
                    found[usize::from(part)] |= 1 << bit;
                }
            }
            let next = (part + 1) % 4;
            if !any(&number(FASTSCAN, found[usize::from(part)], [0, part, next])) {
                return None;
            }
        }
        Some(found)
    }

    #[test]
    fn fastscan_finds_two_unconfigured_slaves_that_differ_in_the_serial_number() {
        let mut slaves = [(Lss::new(), A), (Lss::new(), B)];
        assert_eq!(scan(&mut slaves), Some(A));
        let set = ask(&mut slaves[0].0, &A, &[CONFIGURE_NODE_ID, 10]);
        assert_eq!(set, (Some(Request::Answered), Some(CONFIGURE_NODE_ID)));
        let begun = ask(&mut slaves[0].0, &A, &[SWITCH_GLOBAL, 0]);
        assert_eq!(begun, (Some(Request::Initialise), None));
        assert_eq!(slaves[0].0.take_node_id(), 10);
        assert_eq!(scan(&mut slaves), Some(B));
        ask(&mut slaves[1].0, &B, &[CONFIGURE_NODE_ID, 11]);
        ask(&mut slaves[1].0, &B, &[SWITCH_GLOBAL, 0]);
        slaves[1].0.take_node_id();
        assert_eq!(scan(&mut slaves), None);
    }

    /// The question for bit 0 of the last part is not yet the confirmation: a slave that took it
    /// for one fell silent before it was found, but only when its serial number was even.
    #[test]
    fn fastscan_selects_a_slave_before_it_is_confirmed() {
        for serial in [0, 2, 0x0444_0100, 0xFFFF_FFFE, 0xFFFF_FFFF] {
            let identity = [0x11, 0x22, 0x33, serial];
            let mut slaves = [(Lss::new(), identity)];
            assert_eq!(scan(&mut slaves), Some(identity), "{serial:X}");
            let selected = ask(&mut slaves[0].0, &identity, &[INQUIRE_NODE_ID]).1;
            assert_eq!(selected, Some(INQUIRE_NODE_ID), "{serial:X}");
        }
    }

    #[test]
    fn configuration_state_survives_a_reset_of_communication() {
        let mut lss = Lss::new();
        lss.start(5);
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 1]);
        ask(&mut lss, &A, &[CONFIGURE_NODE_ID, 9]);
        assert_eq!(lss.take_node_id(), 9);
        assert_eq!(ask(&mut lss, &A, &[CONFIGURE_NODE_ID, 10]).1, None);
        assert_eq!(lss.take_node_id(), 9);
    }

    #[test]
    fn a_slave_that_configures_is_not_selected_again() {
        let mut lss = Lss::new();
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 1]);
        let answers = (SWITCH_FIRST..)
            .zip(A)
            .map(|(part, value)| ask(&mut lss, &A, &number(part, value, [0; 3])).1);
        assert_eq!(answers.last(), Some(None));
    }

    #[test]
    fn a_node_id_is_not_active_before_the_reset() {
        let mut lss = Lss::new();
        lss.start(5);
        assert_eq!(lss.take_node_id(), 5);
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 1]);
        ask(&mut lss, &A, &[CONFIGURE_NODE_ID, 9]);
        let left = ask(&mut lss, &A, &[SWITCH_GLOBAL, 0]);
        assert_eq!(left, (Some(Request::Answered), None));
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 1]);
        lss.receive(
            &Frame::data_frame(REQUEST, &[INQUIRE_NODE_ID, 0, 0, 0, 0, 0, 0, 0]),
            &A,
        );
        assert_eq!(lss.transmit().unwrap()[1], 5);
        assert_eq!(lss.take_node_id(), 9);
    }

    #[test]
    fn only_the_selected_slave_configures() {
        let mut lss = Lss::new();
        for (part, value) in (0..).zip([A[0], A[1], A[2], B[3]]) {
            assert_eq!(
                ask(&mut lss, &A, &number(SWITCH_FIRST + part, value, [0; 3])).1,
                None
            );
        }
        assert_eq!(ask(&mut lss, &A, &[CONFIGURE_NODE_ID, 9]).1, None);
        let last = (0..)
            .zip(A)
            .map(|(part, value)| ask(&mut lss, &A, &number(SWITCH_FIRST + part, value, [0; 3])).1);
        assert_eq!(last.last(), Some(Some(SWITCHED)));
        assert_eq!(
            ask(&mut lss, &A, &[CONFIGURE_NODE_ID, 9]).1,
            Some(CONFIGURE_NODE_ID)
        );
    }

    #[test]
    fn identification_is_by_ranges_in_their_order() {
        let mut lss = Lss::new();
        let ranges = [A[0], A[1], 0x30, 0x40, 0x0444_0000, 0x0444_0002];
        let mut answers = (IDENTIFY_FIRST..)
            .zip(ranges)
            .map(|(specifier, value)| ask(&mut lss, &A, &number(specifier, value, [0; 3])).1);
        assert!(answers.by_ref().take(5).all(|a| a.is_none()));
        assert_eq!(answers.next(), Some(Some(IDENTIFIED)));
        assert_eq!(
            ask(&mut lss, &A, &number(IDENTIFY_LAST, u32::MAX, [0; 3])).1,
            None
        );
    }

    #[test]
    fn refusals_name_their_error_and_change_nothing() {
        let mut lss = Lss::new();
        lss.start(5);
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 1]);
        for bytes in [[CONFIGURE_NODE_ID, 0, 0], [CONFIGURE_NODE_ID, 128, 0]] {
            lss.receive(
                &Frame::data_frame(REQUEST, &[bytes[0], bytes[1], 0, 0, 0, 0, 0, 0]),
                &A,
            );
            assert_eq!(lss.transmit().unwrap()[..2], [CONFIGURE_NODE_ID, 1]);
        }
        for index in [5, 10, 255] {
            let bytes = [CONFIGURE_BIT_TIMING, 0, index, 0, 0, 0, 0, 0];
            lss.receive(&Frame::data_frame(REQUEST, &bytes), &A);
            assert_eq!(
                lss.transmit().unwrap()[..2],
                [CONFIGURE_BIT_TIMING, 1],
                "{index}"
            );
        }
        let nothing = ask(&mut lss, &A, &[ACTIVATE_BIT_TIMING, 10, 0]);
        assert_eq!(nothing, (Some(Request::Answered), None));
        let store = ask(&mut lss, &A, &[STORE]).0;
        let (node_id, kbit_s) = (5, None);
        assert_eq!(store, Some(Request::Store { node_id, kbit_s }));
        lss.respond_store(false);
        assert_eq!(lss.transmit().unwrap()[..2], [STORE, 2]);
        assert_eq!(lss.take_node_id(), 5);
    }

    #[test]
    fn a_bit_rate_is_activated_with_its_delay() {
        let mut lss = Lss::new();
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 1]);
        ask(&mut lss, &A, &[CONFIGURE_BIT_TIMING, 0, 2]);
        let (kbit_s, delay_ms) = (Some(500), 1000);
        let activated = ask(&mut lss, &A, &[ACTIVATE_BIT_TIMING, 0xE8, 0x03]).0;
        assert_eq!(activated, Some(Request::Activate { kbit_s, delay_ms }));
    }

    /// A master configures, switches to waiting, and resets the node then.
    #[test]
    fn what_was_configured_stays_over_the_state_waiting() {
        let mut lss = Lss::new();
        lss.start(5);
        lss.take_node_id();
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 1]);
        ask(&mut lss, &A, &[CONFIGURE_NODE_ID, 9]);
        ask(&mut lss, &A, &[CONFIGURE_BIT_TIMING, 0, 2]);
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 0]);
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 1]);
        let stored = ask(&mut lss, &A, &[STORE]).0;
        let (node_id, kbit_s) = (9, Some(500));
        assert_eq!(stored, Some(Request::Store { node_id, kbit_s }));
        assert_eq!(lss.take_node_id(), 9);
    }

    #[test]
    fn automatic_detection_is_stored_as_such_and_not_lost() {
        let mut lss = Lss::new();
        ask(&mut lss, &A, &[SWITCH_GLOBAL, 1]);
        ask(&mut lss, &A, &[CONFIGURE_BIT_TIMING, 0, AUTOMATIC]);
        let (node_id, kbit_s) = (UNCONFIGURED, Some(0));
        let stored = ask(&mut lss, &A, &[STORE]).0;
        assert_eq!(stored, Some(Request::Store { node_id, kbit_s }));
    }

    #[test]
    fn short_frames_and_others_frames_are_left_alone() {
        let mut lss = Lss::new();
        let short = Frame::data_frame(REQUEST, &[IDENTIFY_UNCONFIGURED]);
        assert_eq!(lss.receive(&short, &A), Some(Request::Answered));
        assert_eq!(lss.transmit(), None);
        assert_eq!(lss.receive(&Frame::data_frame(RESPONSE, &[0; 8]), &A), None);
    }

    proptest! {
        /// Whatever comes, a slave that waits is not configured, and a node-id is one or none.
        #[test]
        fn any_requests_leave_a_legal_node_id(
            node_id in any::<u8>(),
            requests in prop::collection::vec((0_u8..0x60, 0_u8..3, any::<[u8; 6]>()), 0..40),
        ) {
            let mut lss = Lss::new();
            lss.start(node_id);
            for (specifier, mode, [b, c, d, e, f, g]) in requests {
                let was = lss.configuring;
                let before = (lss.pending, lss.bit_timing);
                let bytes = [specifier, mode, b, c, d, e, f, g];
                let request = lss.receive(&Frame::data_frame(REQUEST, &bytes), &A);
                let changed = (lss.pending, lss.bit_timing) != before;
                prop_assert!(was || !changed, "{bytes:X?}");
                let acts = !matches!(request, Some(Request::Answered | Request::Initialise));
                prop_assert!(was || !acts, "{bytes:X?}");
                prop_assert!(matches!(lss.pending, 1..=127 | UNCONFIGURED));
                lss.transmit();
            }
            prop_assert_eq!(lss.take_node_id(), lss.pending);
            prop_assert!(!lss.configuring);
        }
    }
}
