//! Layer setting services: the master (CiA 305).
//!
//! In: a bus. Out: nodes found without a node-id, node-ids and bit rates given and stored. Every
//! request but a switch is answered; silence is an error of its own. Fastscan takes silence for an
//! answer, so it asks with growing patience until what it has found is confirmed.
//!
//! Left out: identification by ranges, inquiries, and tables of bit timing other than CiA's.

use std::time::{Duration, Instant};

use canopen::Frame;
use canopen::lss::{REQUEST, RESPONSE};

use super::{Bus, BusEnd};

/// Vendor-id, product code, revision number, serial number: 1018h.
pub type Identity = [u32; 4];

/// Bit rates by their index in table 0, kbit/s; 0 is reserved.
pub const BIT_RATES: [u16; 9] = [1000, 800, 500, 250, 125, 0, 50, 20, 10];

/// How long an answer may take; storing takes a node some tenths of a second.
const PATIENCE: Duration = Duration::from_secs(2);

/// How long fastscan waits for anybody, from one try to the next.
const WAITS: [Duration; 3] = [
    Duration::from_millis(25),
    Duration::from_millis(100),
    Duration::from_millis(400),
];

/// How long a node may still be storing when its master was interrupted.
const STORING: Duration = Duration::from_millis(500);

/// How long answers to the question before are let pass by.
const DRAIN: Duration = Duration::from_millis(2);

const SWITCH_GLOBAL: u8 = 0x04;
const CONFIGURE_NODE_ID: u8 = 0x11;
const CONFIGURE_BIT_TIMING: u8 = 0x13;
const ACTIVATE_BIT_TIMING: u8 = 0x15;
const STORE: u8 = 0x17;
const SWITCH_SELECTIVE: u8 = 0x40;
const SWITCHED: u8 = 0x44;
const IDENTIFIED: u8 = 0x4F;
const FASTSCAN: u8 = 0x51;

/// Fastscan: whoever has no node-id answers.
const ANYBODY: u8 = 0x80;

/// Why a service was not carried out.
#[derive(Debug, thiserror::Error)]
pub enum LssError {
    /// The bus can be used no longer.
    #[error(transparent)]
    Bus(#[from] BusEnd),
    /// No node answers the service of this name.
    #[error("no node answers LSS \"{0}\": is exactly one in the configuration state?")]
    Silent(&'static str),
    /// A node refuses the service: its error code, and the manufacturer's own.
    #[error("{a}", a = refused(.0, *.1, *.2))]
    Refused(&'static str, u8, u8),
}

fn refused(service: &str, error: u8, specific: u8) -> String {
    match (error, service) {
        (1, _) => format!("the node refuses LSS \"{service}\": it does not support this value"),
        (2, "store") => "the node could not store: its memory failed".to_owned(),
        _ => format!("the node refuses LSS \"{service}\" with error {error} ({specific})"),
    }
}

/// The master.
#[derive(Debug)]
pub struct Master<'a> {
    bus: &'a mut Bus,
}

impl<'a> Master<'a> {
    /// A master on this bus.
    pub fn new(bus: &'a mut Bus) -> Self {
        Self { bus }
    }

    /// A master for a session of its own: all nodes leave the configuration state, in which an
    /// earlier session may have left them, where they do not answer to their identity.
    ///
    /// Errors: the bus is lost.
    pub fn begin(bus: &'a mut Bus) -> Result<Self, LssError> {
        let mut master = Self::new(bus);
        master.switch_all(false)?;
        Ok(master)
    }

    fn send(&mut self, specifier: u8, number: u32, rest: [u8; 3]) -> Result<(), LssError> {
        let [a, b, c, d] = number.to_le_bytes();
        let [e, f, g] = rest;
        let frame = Frame::data_frame(REQUEST, &[specifier, a, b, c, d, e, f, g]);
        Ok(self.bus.send(&frame).map_err(BusEnd::from)?)
    }

    /// The next answer with this specifier.
    fn answer(&mut self, specifier: u8, patience: Duration) -> Result<Option<[u8; 8]>, LssError> {
        let until = Instant::now() + patience;
        while let Some(received) = self.bus.receive(until).map_err(BusEnd::from)? {
            let bytes = <[u8; 8]>::try_from(received.frame.bytes());
            if received.frame.cob_id() == Some(RESPONSE)
                && let Ok(bytes) = bytes
                && bytes[0] == specifier
            {
                return Ok(Some(bytes));
            }
        }
        Ok(None)
    }

    /// A service with a result: error code and the manufacturer's own.
    fn service(&mut self, name: &'static str, specifier: u8, number: u32) -> Result<(), LssError> {
        self.send(specifier, number, [0; 3])?;
        let answer = self.answer(specifier, PATIENCE)?;
        match answer.ok_or(LssError::Silent(name))? {
            [_, 0, ..] => Ok(()),
            [_, error, specific, ..] => Err(LssError::Refused(name, error, specific)),
        }
    }

    /// Brings all nodes into the configuration state, or back from it. Nobody answers.
    ///
    /// Errors: the bus is lost.
    pub fn switch_all(&mut self, configuring: bool) -> Result<(), LssError> {
        self.send(SWITCH_GLOBAL, u32::from(configuring), [0; 3])
    }

    /// Brings the one node with this identity into the configuration state; false when none
    /// answers.
    ///
    /// Errors: the bus is lost.
    pub fn select(&mut self, identity: &Identity) -> Result<bool, LssError> {
        for (specifier, number) in (SWITCH_SELECTIVE..).zip(identity) {
            self.send(specifier, *number, [0; 3])?;
        }
        Ok(self.answer(SWITCHED, PATIENCE)?.is_some())
    }

    /// Finds one node without a node-id and leaves it in the configuration state; `None` when
    /// there is none.
    ///
    /// Errors: the bus is lost; [`LssError::Silent`] when somebody is there and is not found.
    pub fn fastscan(&mut self) -> Result<Option<Identity>, LssError> {
        for wait in WAITS {
            if !self.is_there(0, [ANYBODY, 0, 0], wait.max(WAITS[1]))? {
                return Ok(None);
            }
            if let Some(found) = self.scan_with(wait)? {
                return Ok(Some(found));
            }
        }
        Err(LssError::Silent("fastscan"))
    }

    /// The nodes without a node-id, `most` of them at most. One that was found stays selected and
    /// takes no part in the next search; at the end all of them wait again.
    ///
    /// Errors: see [`Master::fastscan`].
    pub fn fastscan_all(&mut self, most: usize) -> Result<Vec<Identity>, LssError> {
        let mut found = Vec::new();
        let ended = loop {
            match self.fastscan() {
                Ok(Some(identity)) if found.len() < most => found.push(identity),
                Ok(_) => break Ok(found),
                Err(error) => break Err(error),
            }
        };
        self.switch_all(false)?;
        ended
    }

    /// Bit by bit: 0 is asked for, and silence means 1. `None` when the end does not confirm it.
    fn scan_with(&mut self, wait: Duration) -> Result<Option<Identity>, LssError> {
        let mut found = [0_u32; 4];
        for (part, number) in (0_u8..).zip(&mut found) {
            for bit in (0..32).rev() {
                if !self.is_there(*number, [bit, part, part], wait)? {
                    *number |= 1 << bit;
                }
            }
            let next = (part + 1) % 4;
            if !self.is_there(*number, [0, part, next], wait.max(WAITS[1]))? {
                return Ok(None);
            }
        }
        Ok(Some(found))
    }

    /// Whether anybody's number begins so: above this bit it is `number`.
    fn is_there(&mut self, number: u32, rest: [u8; 3], wait: Duration) -> Result<bool, LssError> {
        // An answer to the question before, of a second node, would be taken for one to this.
        let until = Instant::now() + DRAIN;
        let mut late = true;
        while late {
            late = self.bus.receive(until).map_err(BusEnd::from)?.is_some();
        }
        self.send(FASTSCAN, number, rest)?;
        Ok(self.answer(IDENTIFIED, wait)?.is_some())
    }

    /// Gives the node in the configuration state a node-id, which counts after its next reset of
    /// communication.
    ///
    /// Errors: see [`LssError`].
    pub fn configure_node_id(&mut self, id: u8) -> Result<(), LssError> {
        self.service("configure node-id", CONFIGURE_NODE_ID, u32::from(id))
    }

    /// The node in the configuration state takes this node-id in place of the one that it was just
    /// given, and stores it, once it has stored the other one where it was told to.
    ///
    /// Errors: see [`LssError`].
    pub fn store_node_id_instead(&mut self, id: u8) -> Result<usize, LssError> {
        self.await_store()?;
        self.configure_node_id(id)?;
        self.store()
    }

    /// Tells the nodes in the configuration state the bit rate, by its index in [`BIT_RATES`].
    /// Returns how many answers came in a quarter of a second.
    ///
    /// Errors: see [`LssError`].
    pub fn configure_bit_timing(&mut self, index: u8) -> Result<usize, LssError> {
        let name = "configure bit timing";
        self.send(CONFIGURE_BIT_TIMING, u32::from(index) << 8, [0; 3])?;
        self.results(name, CONFIGURE_BIT_TIMING)
    }

    /// The nodes in the configuration state store what they were told. Returns how many answers
    /// came.
    ///
    /// Errors: see [`LssError`].
    pub fn store(&mut self) -> Result<usize, LssError> {
        self.send(STORE, 0, [0; 3])?;
        self.results("store", STORE)
    }

    /// The nodes in the configuration state store this bit rate in place of the one that they were
    /// just told to store, once that is over.
    ///
    /// Errors: see [`LssError`].
    pub fn store_bit_timing_instead(&mut self, index: u8) -> Result<usize, LssError> {
        self.await_store()?;
        self.configure_bit_timing(index)?;
        self.store()
    }

    /// Waits until no node answers any more that it has stored.
    fn await_store(&mut self) -> Result<(), LssError> {
        while self.answer(STORE, STORING)?.is_some() {}
        Ok(())
    }

    /// Answers of all nodes: none may be a refusal, and one has to come.
    fn results(&mut self, name: &'static str, specifier: u8) -> Result<usize, LssError> {
        let (mut count, mut patience) = (0, PATIENCE);
        while let Some([_, error, specific, ..]) = self.answer(specifier, patience)? {
            if error != 0 {
                return Err(LssError::Refused(name, error, specific));
            }
            count += 1;
            patience = Duration::from_millis(250);
        }
        match count {
            0 => Err(LssError::Silent(name)),
            _ => Ok(count),
        }
    }

    /// All nodes in the configuration state change to the bit rate that they were told: silent
    /// for the delay, then changed, then silent once more. Nobody answers.
    ///
    /// Errors: the bus is lost.
    pub fn activate_bit_timing(&mut self, delay_ms: u16) -> Result<(), LssError> {
        self.send(ACTIVATE_BIT_TIMING, u32::from(delay_ms), [0; 3])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::lss::Lss;
    use proptest::prelude::*;
    use std::io::{BufRead, BufReader, Write};
    use std::net::TcpListener;

    use crate::address::{self, BusAddress};

    /// A bus with these slaves, each with an identity and a node-id or none.
    fn bus(slaves: Vec<(Identity, u8)>) -> Bus {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let at = listener.local_addr().unwrap().to_string();
        std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            stream.write_all(b"< hi >").unwrap();
            let mut slaves: Vec<_> = slaves.into_iter().map(started).collect();
            let words = BufReader::new(stream.try_clone().unwrap()).split(b'>');
            for word in words.map_while(Result::ok) {
                let word = String::from_utf8_lossy(&word).into_owned();
                let answer = match word.split_once("send 7E5 8 ") {
                    Some((_, bytes)) => answers(&mut slaves, bytes),
                    None => "< ok >".to_owned(),
                };
                if stream.write_all(answer.as_bytes()).is_err() {
                    return;
                }
            }
        });
        Bus::join(&BusAddress::from(address::parse(&at).unwrap())).unwrap()
    }

    fn started((identity, id): (Identity, u8)) -> (Lss, Identity) {
        let mut lss = Lss::new();
        lss.start(id);
        lss.take_node_id();
        (lss, identity)
    }

    fn answers(slaves: &mut [(Lss, Identity)], bytes: &str) -> String {
        let bytes: Vec<u8> = bytes
            .split_whitespace()
            .map(|byte| u8::from_str_radix(byte, 16).unwrap())
            .collect();
        let frame = Frame::data_frame(REQUEST, &bytes);
        let mut said = String::new();
        for (lss, identity) in slaves {
            match lss.receive(&frame, identity) {
                Some(canopen::lss::Request::Store { .. }) => lss.respond_store(true),
                Some(canopen::lss::Request::Initialise) => {
                    lss.take_node_id();
                }
                _ => {}
            }
            if let Some(answer) = lss.transmit() {
                let hex: String = answer.iter().map(|byte| format!("{byte:02X}")).collect();
                said.push_str(&format!("< frame 7E4 1.0 {hex} >"));
            }
        }
        said
    }

    const A: Identity = [0, 0x504C_0001, 0x1_0000, 0xFFFF_0000];
    const B: Identity = [0, 0x504C_0002, 0x1_0000, 0x0000_0001];

    #[test]
    fn two_fresh_nodes_are_found_one_after_the_other_and_get_their_node_ids() {
        let mut bus = bus(vec![(A, 255), (B, 255)]);
        let mut master = Master::new(&mut bus);
        let mut found = Vec::new();
        for id in [10, 11] {
            found.push(master.fastscan().unwrap().unwrap());
            master.configure_node_id(id).unwrap();
            assert_eq!(master.store().unwrap(), 1);
            master.switch_all(false).unwrap();
        }
        assert_eq!(found, [A, B]);
        assert_eq!(master.fastscan().unwrap(), None);
        assert!(master.select(&A).unwrap());
    }

    #[test]
    fn refusals_and_silence_are_told_apart() {
        let mut bus = bus(vec![(A, 1)]);
        let mut master = Master::new(&mut bus);
        assert!(!master.select(&B).unwrap());
        let silent = master.configure_node_id(5).unwrap_err().to_string();
        assert!(
            silent.contains("no node answers LSS \"configure node-id\""),
            "{silent}"
        );
        assert!(master.select(&A).unwrap());
        let refused = master.configure_node_id(128).unwrap_err().to_string();
        assert!(refused.contains("does not support this value"), "{refused}");
        assert!(master.configure_bit_timing(5).is_err());
        assert_eq!(master.configure_bit_timing(2).unwrap(), 1);
    }

    #[test]
    fn a_node_that_was_left_in_the_configuration_state_was_not_found_by_the_next_session() {
        let mut bus = bus(vec![(A, 1), (B, 2)]);
        assert!(Master::new(&mut bus).select(&A).unwrap());
        assert!(!Master::new(&mut bus).select(&A).unwrap());
        let mut master = Master::begin(&mut bus).unwrap();
        assert!(master.select(&A).unwrap());
        assert!(master.select(&B).unwrap());
    }

    #[test]
    fn bit_rates_are_told_to_all_at_once() {
        let mut bus = bus(vec![(A, 1), (B, 2)]);
        let mut master = Master::new(&mut bus);
        master.switch_all(true).unwrap();
        assert_eq!(master.configure_bit_timing(2).unwrap(), 2);
        assert_eq!(master.store().unwrap(), 2);
        master.activate_bit_timing(100).unwrap();
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(3))]
        #[test]
        fn any_identity_is_found(identity: [u32; 4]) {
            let mut bus = bus(vec![(identity, 255)]);
            prop_assert_eq!(Master::new(&mut bus).fastscan().unwrap(), Some(identity));
        }
    }
}
