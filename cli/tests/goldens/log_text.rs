//! Logs of a bus as text, the same on every machine: a pair that works, differs, loses a channel
//! and comes back.
//!
//! In: nothing. Out: lines of candump -L. All values are whole numbers of the wire, so no rounding
//! of a simulation is in them.
//!
//! Left out: what a device would really do in such a case, to the SYNC; the frames only have to be
//! of every kind that a log can have.

use std::fmt::Write as _;

/// The first second of the logs: 2023-11-14 22:13:20 UTC.
const START_S: u64 = 1_700_000_000;

/// From SYNC to SYNC, us.
const ROUND_US: u64 = 50_000;

/// SYNCs in a second.
const PER_SECOND: u64 = 1_000_000 / ROUND_US;

/// What a channel sends in answer to a SYNC.
#[derive(Clone, Copy)]
struct Told {
    /// What it measures, 0.01 deg.
    slopes: [i16; 2],
    /// State of the pair (2021h).
    state: u8,
    /// Its slopes may be used.
    valid: bool,
}

/// A text that grows by frames.
#[derive(Default)]
struct Log {
    text: String,
    us: u64,
}

impl Log {
    fn frame(&mut self, id: u16, bytes: &[u8]) {
        let (second, us) = (START_S + self.us / 1_000_000, self.us % 1_000_000);
        write!(self.text, "({second}.{us:06}) can0 {id:03X}#").unwrap();
        bytes
            .iter()
            .for_each(|byte| write!(self.text, "{byte:02X}").unwrap());
        self.text += "\n";
        self.us += 250;
    }

    fn slopes(&mut self, node: u16, told: Told) {
        let shown = told
            .slopes
            .map(|slope| if told.valid { slope } else { i16::MIN });
        let [x, y] = shown.map(i16::to_le_bytes);
        let bytes = [x[0], x[1], y[0], y[1], validity(told), told.state];
        self.frame(0x180 + node, &bytes);
    }

    fn detail(&mut self, node: u16, told: Told) {
        let bytes = [validity(told), told.state, 0x1E, 0, 25, 20, 0, 21];
        self.frame(0x280 + node, &bytes);
    }

    fn exchange(&mut self, node: u16, told: Told) {
        let angle = |slope: i16| (i32::from(slope) * (1 << 19) / 1125).to_le_bytes();
        let [x, y] = told.slopes.map(angle);
        self.frame(
            0x380 + node,
            &[x[0], x[1], x[2], y[0], y[1], y[2], 0x70, 0x70],
        );
        let [x, y] = told.slopes.map(|slope| (slope * 2).to_le_bytes());
        self.frame(0x480 + node, &[x[0], x[1], y[0], y[1], 0, 0x20, 8, 64]);
    }

    /// An EMCY: code, the faults that are present, who is blamed and why, state of the pair.
    fn emcy(&mut self, node: u16, code: u16, faults: &[u8], verdict: u8, state: u8) {
        let set = faults
            .iter()
            .fold(0_u32, |set, fault| set | 1 << fault)
            .to_le_bytes();
        let [low, high] = code.to_le_bytes();
        let register = if set == [0; 4] { 0 } else { 0x81 };
        let bytes = [low, high, register, set[0], set[1], set[2], verdict, state];
        self.frame(0x080 + node, &bytes);
    }
}

fn validity(told: Told) -> u8 {
    if told.valid { 0x7F } else { 0x7C }
}

/// What both channels send in a round; `None` from a channel that is silent.
fn told(round: u64) -> [Option<Told>; 2] {
    let lean = (round % 40) as i16 * 5;
    let channel = |off: i16, state, valid| {
        let slopes = [1000 + lean + off, -500];
        Some(Told {
            slopes,
            state,
            valid,
        })
    };
    match round / PER_SECOND {
        0..5 => [channel(0, 1, true), channel(2, 1, true)],
        5 => [channel(0, 2, true), channel(150, 2, true)],
        6..8 => [channel(0, 6, false), channel(150, 6, false)],
        8..11 => [channel(0, 8, true), channel(150, 7, false)],
        11..14 => [channel(0, 8, true), None],
        _ => [channel(0, 1, true), channel(2, 1, true)],
    }
}

/// The messages that come in a round, before its SYNC.
fn happens(log: &mut Log, round: u64) {
    match round {
        120 => {
            log.emcy(1, 0xFF13, &[12], 0x11, 6);
            log.emcy(2, 0xFF13, &[12], 0x11, 6);
        }
        160 => {
            log.emcy(1, 0xFF15, &[12, 14], 0x8D, 8);
            log.emcy(1, 0x0000, &[14], 0x8D, 8);
            log.emcy(2, 0xFF08, &[12, 21], 0x4D, 7);
            log.emcy(2, 0xFF14, &[12, 13, 21], 0x4D, 7);
        }
        235 => log.frame(0x081, &[0x30, 0x81, 0x91, 2, 0, 0, 0, 0]),
        280 => {
            log.frame(0x702, &[0]);
            log.frame(0x000, &[1, 2]);
            log.emcy(1, 0x0000, &[], 0, 1);
        }
        _ => {}
    }
}

/// Rounds from one to another one, with all that belongs to them.
fn rounds(log: &mut Log, from: u64, to: u64) {
    for round in from..to {
        log.us = round * ROUND_US;
        happens(log, round);
        log.frame(0x080, &[]);
        for (node, told) in (1..).zip(told(round)) {
            let Some(told) = told else { continue };
            log.slopes(node, told);
            log.exchange(node, told);
            if round % 10 == 0 {
                log.detail(node, told);
            }
            if round % 4 == 0 {
                log.frame(0x700 + node, &[5]);
            }
        }
    }
}

/// Twenty seconds: both agree, differ for two seconds, B is found faulty and falls silent, the log
/// has a gap of two seconds, B is back.
pub fn shift() -> String {
    let mut log = Log::default();
    for node in [1, 2] {
        log.frame(0x700 + node, &[0]);
    }
    log.frame(0x000, &[1, 0]);
    rounds(&mut log, 1, 13 * PER_SECOND);
    rounds(&mut log, 15 * PER_SECOND - 20, 20 * PER_SECOND);
    log.text
}

/// A healthy quarter of a second.
pub fn moment() -> String {
    let mut log = Log::default();
    rounds(&mut log, 0, 5);
    log.text
}

/// Lines of every kind that is no frame of the pair, beside frames that do not fit.
pub fn damaged() -> String {
    let strangers = "(1700000000.00\n\
        (1700000000.251000) can0 181##1E8\n\
        (1700000000.252000) can0 20000004#0000000000000000\n\
        what is this\n\
        (1700000000.253000) can0 18DAF110#01\n\
        (1700000000.254000) can0 705#05\n\
        (1700000000.255000) can0 701#R\n\
        (1699999999.000000) can0 080#\n\
        (1700000000.256000) can0 181#E80300\n\
        (1700000000.257000) can1 080#\n\
        (1700000000.258000) can0 181#E8030000FF63\n\
        (1700000000.259000) can0 181#E803";
    moment() + strangers
}
