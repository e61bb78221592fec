//! A million frames, valid, damaged and random, from one seed: the same run every time.
//!
//! A master plays whole conversations of every service; on their way frames lose or gain bits,
//! bytes, identifiers, get lost or come twice, and others come in between. After each frame the
//! NMT state is a legal successor and what the node sends at once is bounded. At the end the run
//! must have been everywhere: a fuzz that never gets past the first byte proves nothing.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::println;

use super::*;
use crate::crc;
use crate::frame::ExtendedId;
use crate::srdo::SrdoState;

const FRAMES: u32 = 1_000_000;
const SEED: u64 = 0x5EED_0410;

/// xorshift64*: enough for choosing frames.
struct Dice(Cell<u64>);

impl Dice {
    fn roll(&self) -> u64 {
        let mut x = self.0.get();
        x ^= x >> 12;
        x ^= x << 25;
        x ^= x >> 27;
        self.0.set(x);
        x.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 16
    }

    fn below(&self, n: u64) -> u64 {
        self.roll() % n
    }

    fn one_in(&self, n: u64) -> bool {
        self.below(n) == 0
    }

    fn of<T: Copy>(&self, all: &[T]) -> T {
        all[self.below(all.len() as u64) as usize]
    }

    fn bytes(&self) -> [u8; 8] {
        (self.roll() << 24 ^ self.roll()).to_le_bytes()
    }
}

/// The master and the node that it torments.
struct Torment {
    bench: Bench,
    dice: Dice,
    planned: VecDeque<Frame>,
    frames: u32,
    answers: BTreeMap<&'static str, u32>,
    aborts: BTreeMap<u32, u32>,
    states: BTreeMap<u8, u32>,
    events: BTreeMap<&'static str, u32>,
    most: usize,
}

impl Torment {
    fn new() -> Self {
        Self {
            bench: Bench::new(),
            dice: Dice(Cell::new(SEED)),
            planned: VecDeque::new(),
            frames: 0,
            answers: BTreeMap::new(),
            aborts: BTreeMap::new(),
            states: BTreeMap::new(),
            events: BTreeMap::new(),
            most: 0,
        }
    }

    fn id(&self) -> u16 {
        u16::from(self.bench.node.node_id())
    }

    fn plan(&mut self, id: u16, bytes: &[u8]) {
        self.planned.push_back(Frame::data_frame(id, bytes));
    }

    fn request(&mut self, bytes: [u8; 8]) {
        self.plan(0x600 + self.id(), &bytes);
    }

    fn write(&mut self, index: u16, sub: u8, size: u8, number: u32) {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = number.to_le_bytes();
        let command = 0x23 | (4 - size) << 2;
        self.request([command, low, high, sub, a, b, c, d]);
    }

    /// A row of the dictionary, or something near it.
    fn place(&self) -> (u16, u8, u8) {
        let dictionary = self.bench.plant.dictionary();
        let n = self.dice.roll() as usize % dictionary.table.rows.len();
        let row = dictionary.entries().nth(n).unwrap();
        let span = u64::from(row.last - row.sub) + 1;
        let stray = u8::from(self.dice.one_in(20));
        let sub = row.sub + self.dice.below(span) as u8 + stray;
        let size = row.data_type.size().unwrap_or(4).min(4) as u8;
        (row.index, sub, size)
    }

    /// A number that some row may like.
    fn number(&self) -> u32 {
        let id = u32::from(self.bench.node.node_id());
        let any = self.dice.roll() as u32;
        let small = any & 0xFF;
        let likely = [0, 1, 8, 0x4000_0080, 1000, 9 << 16 | 20, 0x185, 0x80 + id];
        self.dice
            .of(&[any, small, self.dice.of(&likely), 0x8000_0000 | small])
    }

    fn converse(&mut self) {
        match self.dice.below(24) {
            0..=2 => self.play_nmt(),
            3 => self.play_guarding(),
            4..=6 => self.play_process_data(),
            7 => self.play_lss(),
            8 => self.play_memory(),
            9 => self.play_mapping(),
            10 => self.play_safety(),
            11..=13 => self.play_segments(),
            14 | 15 => self.play_block_upload(),
            16 | 17 => self.play_block_download(),
            18 => self.play_start(),
            _ => self.play_expedited(),
        }
    }

    fn play_nmt(&mut self) {
        let command = self.dice.of(&[1, 1, 1, 1, 1, 1, 2, 128, 128, 129, 130]);
        let node = self.dice.of(&[0, self.id() as u8, self.id() as u8]);
        self.plan(0, &[command, node]);
    }

    /// Everything back as it was, so that no mistuned service stays out of the run.
    fn play_start(&mut self) {
        self.plan(0, &[128, 0]);
        self.write(0x1011, 1, 4, LOAD);
        self.plan(0, &[129, 0]);
        self.plan(0, &[1, 0]);
    }

    fn play_guarding(&mut self) {
        self.write(0x100C, 0, 2, 10);
        self.write(0x100D, 0, 1, 2);
        let request = Frame::remote(standard(0x700 + self.id()), 1).unwrap();
        self.planned.extend([request; 3]);
        self.write(0x1016, 1, 4, 9 << 16 | 20);
        self.plan(0x709, &[5]);
        self.write(0x1017, 0, 2, self.dice.roll() as u32 & 15);
    }

    fn play_process_data(&mut self) {
        let data = self.dice.bytes();
        let length = self.dice.of(&[1, 1, 1, 1, 8, 0]);
        let id = self.id();
        self.plan(0x200 + id, &data[..length]);
        self.plan(0x80, &[]);
        self.plan(0x80, &[]);
        let ask = Frame::remote(standard(0x180 + id), 2).unwrap();
        self.planned.push_back(ask);
        self.plan(0x103, &[1, 2]);
        self.plan(0x104, &[0xFE, 0xFD]);
        self.write(0x1006, 0, 4, self.dice.roll() as u32 & 0xFFF);
        self.write(0x1005, 0, 4, self.dice.of(&[0x80, 0x80, 0x4000_0080]));
        self.plan(1, &[]);
    }

    fn lss(&mut self, specifier: u8, rest: [u8; 7]) {
        let [a, b, c, d, e, f, g] = rest;
        self.plan(0x7E5, &[specifier, a, b, c, d, e, f, g]);
    }

    fn play_lss(&mut self) {
        self.plan(0, &[128, 0]);
        if self.dice.one_in(2) {
            self.lss(4, [1, 0, 0, 0, 0, 0, 0]);
        } else {
            for (part, number) in (0x40..).zip([1, 2, 3, 4]) {
                self.lss(part, [number, 0, 0, 0, 0, 0, 0]);
            }
        }
        let id = self.dice.of(&[ID, ID, 1, 127, UNCONFIGURED, 200]);
        self.lss(0x11, [id, 0, 0, 0, 0, 0, 0]);
        self.lss(0x13, [0, self.dice.below(11) as u8, 0, 0, 0, 0, 0]);
        let specifier = self.dice.of(&[0x15, 0x17, 0x5A, 0x5D, 0x5E, 0x4C]);
        self.lss(specifier, [0; 7]);
        self.lss(0x51, [0, 0, 0, 0, 0x80, 0, 0]);
        for part in 0..4 {
            self.lss(0x51, [part + 1, 0, 0, 0, 0, part, (part + 1) & 3]);
        }
        self.lss(4, [0; 7]);
        self.plan(0, &[self.dice.of(&[130, 1]), 0]);
    }

    fn play_memory(&mut self) {
        self.plan(0, &[128, 0]);
        let sub = self.dice.below(5) as u8;
        self.write(0x1010, sub, 4, SAVE);
        self.plan(0, &[130, 0]);
        self.write(0x1011, sub, 4, LOAD);
        self.plan(0, &[130, 0]);
    }

    fn play_mapping(&mut self) {
        let pdo = self.dice.below(4) as u16;
        let base = self.dice.of(&[0x1400, 0x1800]) + pdo;
        let id = u32::from(self.id());
        self.write(base, 1, 4, 0x8000_0000);
        self.write(base + 0x200, 0, 1, 0);
        for sub in 1..=3 {
            let entry = self
                .dice
                .of(&[0x2000_0008, 0x6010_0010, 0x1001_0008, 0x0005_0008]);
            self.write(base + 0x200, sub, 4, entry);
        }
        self.write(base + 0x200, 0, 1, self.dice.of(&[1, 2, 3, 200]));
        let kind = self.dice.of(&[0, 1, 2, 240, 250, 254, 255]);
        self.write(base, 2, 1, kind);
        self.write(base, 3, 2, self.dice.of(&[0, 5]));
        self.write(base, 5, 2, self.dice.of(&[0, 3]));
        self.write(
            base,
            1,
            4,
            self.dice.of(&[0x180 + id, 0x80, 0x200 + id, 0x301]),
        );
        self.plan(0, &[1, 0]);
    }

    fn play_safety(&mut self) {
        self.plan(0, &[128, 0]);
        self.write(0x1300, 0, 1, 1);
        self.write(0x1301, 2, 2, self.dice.of(&[1, 25]));
        for srdo in [0, 1] {
            // The signature of what stands now: wrong if a frame before has changed it.
            let signature = self.bench.node.communication().safety.signature(srdo);
            self.write(0x13FF, srdo as u8 + 1, 2, u32::from(signature));
        }
        self.write(0x13FE, 0, 1, 0xA5);
        self.plan(0, &[1, 0]);
        for _ in 0..3 {
            self.plan(0x103, &[1, 2]);
            self.plan(0x104, &[0xFE, 0xFD]);
        }
        self.plan(1, &[]);
    }

    fn play_expedited(&mut self) {
        let (index, sub, size) = self.place();
        let [low, high] = index.to_le_bytes();
        if self.dice.one_in(2) {
            self.request([0x40, low, high, sub, 0, 0, 0, 0]);
        } else {
            let number = self.number();
            self.write(index, sub, size.max(1), number);
        }
    }

    fn play_segments(&mut self) {
        if self.dice.one_in(2) {
            self.request([0x40, 0x08, 0x10, 0, 0, 0, 0, 0]);
            for toggle in [0, 0x10, 0, 0x10, 0] {
                self.request([0x60 | toggle, 0, 0, 0, 0, 0, 0, 0]);
            }
        } else {
            self.request([0x21, 1, 0x20, 0, 10, 0, 0, 0]);
            self.request([0x00, 1, 2, 3, 4, 5, 6, 7]);
            self.request([0x19, 8, 9, 10, 0, 0, 0, 0]);
        }
    }

    fn play_block_upload(&mut self) {
        let whole = self.dice.one_in(2);
        let block = if whole { 127 } else { 2 };
        self.request([0xA4, 0x08, 0x10, 0, block, 0, 0, 0]);
        self.request([0xA3, 0, 0, 0, 0, 0, 0, 0]);
        // 30 bytes are five segments.
        let acknowledged: &[u8] = if whole { &[5] } else { &[2, 1, 2] };
        for count in acknowledged {
            self.request([0xA2, *count, block, 0, 0, 0, 0, 0]);
        }
        self.request([0xA1, 0, 0, 0, 0, 0, 0, 0]);
    }

    fn play_block_download(&mut self) {
        let length = self.dice.below(self.dice.of(&[40, 40, 40, 300])) as usize;
        let seed = self.dice.roll() as u8;
        let content: Vec<u8> = (0..length).map(|n| seed.wrapping_add(n as u8)).collect();
        let [low, high] = (length as u16).to_le_bytes();
        self.request([0xC6, 1, 0x20, 0, low, high, 0, 0]);
        let segments = length.div_ceil(7).max(1);
        for (n, sequence) in (0..segments).zip(1..) {
            let mut frame = [0; 8];
            frame[0] = sequence | if n + 1 == segments { 0x80 } else { 0 };
            let part = content.iter().skip(7 * n).take(7);
            frame[1..]
                .iter_mut()
                .zip(part)
                .for_each(|(to, from)| *to = *from);
            self.request(frame);
        }
        let unused = (7 * segments - length) as u8;
        let [low, high] = crc::update(0, &content).to_le_bytes();
        self.request([0xC1 | unused << 2, low, high, 0, 0, 0, 0, 0]);
        // Now and then the content is asked for again, all in one block.
        if self.dice.one_in(4) {
            self.request([0xA4, 1, 0x20, 0, 127, 0, 0, 0]);
            self.request([0xA3, 0, 0, 0, 0, 0, 0, 0]);
        }
    }

    /// The next frame, as it arrives; `None` when it got lost.
    fn next(&mut self) -> Option<Frame> {
        if self.dice.one_in(25) {
            return Some(self.random());
        }
        while self.planned.is_empty() {
            self.converse();
        }
        let frame = self.planned.pop_front()?;
        match self.dice.below(80) {
            0 => None,
            1 => {
                self.planned.push_front(frame);
                Some(frame)
            }
            2 | 3 => Some(self.damaged(&frame)),
            _ => Some(frame),
        }
    }

    fn random(&self) -> Frame {
        let bytes = self.dice.bytes();
        let length = self.dice.below(9) as usize;
        let id = (self.dice.roll() & 0x7FF) as u16;
        let own = self
            .dice
            .of(&[0x600 + self.id(), 0x7E5, 0, 0x80, 0x200 + self.id()]);
        match self.dice.below(8) {
            0 => Frame::remote(standard(id), length).unwrap(),
            1 => {
                let id = ExtendedId::new(u32::from(id)).unwrap();
                Frame::with(id, &bytes[..length]).unwrap()
            }
            2 | 3 => Frame::data_frame(id, &bytes[..length]),
            4 => Frame::data_frame(own, &bytes[..length]),
            _ => Frame::data_frame(own, &bytes),
        }
    }

    fn damaged(&self, frame: &Frame) -> Frame {
        let id = frame.cob_id().unwrap();
        let mut bytes = frame.padded();
        let length = frame.length();
        match self.dice.below(4) {
            0 => Frame::data_frame(id ^ 1 << self.dice.below(11), &bytes[..length]),
            1 => Frame::data_frame(id, &bytes[..self.dice.below(9) as usize]),
            2 => Frame::remote(standard(id), length).unwrap(),
            _ => {
                bytes[self.dice.below(8) as usize] ^= 1 << self.dice.below(8);
                Frame::data_frame(id, &bytes[..length])
            }
        }
    }

    fn pass_time(&mut self) {
        let micros = match self.dice.below(64) {
            0..=31 => 130,
            32..=59 => self.dice.below(3000),
            60..=62 => self.dice.below(100_000),
            _ => self.dice.below(10_000_000),
        };
        self.bench.now = self.bench.now.after(micros);
        let Bench { node, plant, now } = &mut self.bench;
        match self.dice.below(400) {
            0 => node.bus_state(plant, BusState::Passive, *now),
            1 => node.bus_state(plant, BusState::Off, *now),
            2 | 3 => node.bus_state(plant, BusState::Active, *now),
            4 => node.overrun(1),
            5 => node.report(plant, 0xFF00, 0x80, [1; 5], *now),
            6 => node.cleared(0, [0; 5]),
            7 => node.stand_in_for_sync(Some(1000), *now),
            8 => node.stand_in_for_sync(None, *now),
            9..=20 => _ = node.consent_to_safety(Some(*now)),
            21 => _ = node.consent_to_safety(None),
            22..=60 => node.data_changed(plant, *now),
            61 => plant.broken = !plant.broken,
            _ => {}
        }
    }

    /// One frame and what comes of it.
    fn step(&mut self) {
        self.pass_time();
        self.bench.node.poll(&mut self.bench.plant, self.bench.now);
        let before = (self.bench.node.state(), self.bench.node.node_id());
        if let Some(frame) = self.next() {
            self.frames += 1;
            self.bench.hear(&frame);
            self.check_state(&frame, before);
        }
        *self
            .states
            .entry(self.bench.node.state() as u8)
            .or_default() += 1;
        if self.bench.plant.events.contains(&Event::ResetNode) {
            let id = self.bench.node.node_id();
            let id = if id == UNCONFIGURED { ID } else { id };
            self.bench.start(id);
        }
        if !self.dice.one_in(6) {
            self.listen();
        }
        self.tally_events();
    }

    /// OPERATIONAL is entered by command only, and a reset ends in INITIALISING.
    fn check_state(&self, frame: &Frame, (before, id): (State, u8)) {
        let after = self.bench.node.state();
        let named = matches!(frame.bytes(), [_, n] if *n == 0 || *n == id);
        let commanded = frame.cob_id() == Some(0) && !frame.is_remote() && named;
        let specifier = frame.bytes().first().copied().filter(|_| commanded);
        let expected = match (specifier, before) {
            (Some(1), State::PreOperational | State::Stopped) => State::Operational,
            (Some(2), State::PreOperational | State::Operational) => State::Stopped,
            (Some(128), State::Stopped | State::Operational) => State::PreOperational,
            (Some(130), _) => State::Initialising,
            _ => before,
        };
        assert_eq!(after, expected, "{frame:?} in {before:?}");
    }

    /// What the node sends now, as [`Bench::sent`], into the books.
    fn listen(&mut self) {
        let frames = self.bench.sent();
        let configured = self.id() != u16::from(UNCONFIGURED);
        assert_eq!(self.bench.node.state() == State::Initialising, !configured);
        self.most = self.most.max(frames.len());
        for (id, bytes) in frames {
            let service = self.service(id, &bytes);
            *self.answers.entry(service).or_default() += 1;
        }
    }

    fn service(&mut self, id: u16, bytes: &[u8]) -> &'static str {
        let node = self.id();
        match (id, bytes) {
            (0x7E4, _) => "LSS",
            (0x80, []) => "SYNC",
            (0x101 | 0x102, [_, _]) => "SRDO",
            (id, [state]) if id == 0x700 + node => match state & 0x7F {
                0 => "boot-up",
                _ => "heartbeat, guarding",
            },
            (id, &[command, _, _, _, a, b, c, d]) if id == 0x580 + node => {
                if command == 0x80 {
                    let code = u32::from_le_bytes([a, b, c, d]);
                    *self.aborts.entry(code).or_default() += 1;
                }
                answer(command)
            }
            (id, [_, _, _, _, _, _, _, _]) if id == 0x80 + node => "EMCY",
            _ => "TPDO",
        }
    }

    fn tally_events(&mut self) {
        for event in self.bench.events() {
            let name = match event {
                Event::State(_) => "state",
                Event::ResetNode => "reset node",
                Event::ResetCommunication => "reset communication",
                Event::Sync => "SYNC obeyed",
                Event::Heartbeat { alive: true, .. } => "heartbeat heard",
                Event::Heartbeat { alive: false, .. } => "heartbeat lost",
                Event::LifeGuarding { .. } => "life guarding",
                Event::Received(_) => "RPDO applied",
                Event::BitRate { .. } => "bit rate",
                Event::SafetyLost(_) => "SRDO lost",
                Event::FailSafe => "GFC",
            };
            *self.events.entry(name).or_default() += 1;
        }
        let relied_on = self.bench.node.communication().safety.state(1);
        if relied_on == SrdoState::Running {
            *self.events.entry("SRDO consumed").or_default() += 1;
        }
    }
}

/// What an SDO server's answer is; a block's segments look like anything.
fn answer(command: u8) -> &'static str {
    match command {
        0x80 => "SDO abort",
        0x60 => "SDO download begun or done",
        0x43 | 0x47 | 0x4B | 0x4F => "SDO expedited upload",
        0x41 => "SDO segmented upload",
        0x20 | 0x30 => "SDO download segment",
        0xA4 => "SDO block download begun",
        0xA2 => "SDO block download acknowledged",
        0xA1 => "SDO block download done",
        0xC6 => "SDO block upload begun",
        0xD5 => "SDO block upload at its end",
        _ => "SDO upload segment",
    }
}

#[test]
fn a_million_frames_leave_a_legal_node_with_bounded_output() {
    let mut torment = Torment::new();
    while torment.frames < FRAMES {
        torment.step();
    }
    let Torment {
        states,
        answers,
        events,
        aborts,
        most,
        ..
    } = &torment;
    println!("{FRAMES} frames; at most {most} frames at once, {MOST} allowed");
    println!("states after a frame: {states:?}\nsaid: {answers:#?}");
    println!("events: {events:#?}\naborts: {aborts:#010X?}");
    let enough = |count: Option<&u32>| count.is_some_and(|n| *n >= 20);
    for state in [
        State::Initialising,
        State::Stopped,
        State::Operational,
        State::PreOperational,
    ] {
        assert!(enough(states.get(&(state as u8))), "{state:?}");
    }
    for service in [
        "LSS",
        "SYNC",
        "SRDO",
        "boot-up",
        "heartbeat, guarding",
        "EMCY",
        "TPDO",
        "SDO abort",
    ] {
        assert!(enough(answers.get(service)), "{service}");
    }
    for command in [0x60, 0x43, 0x41, 0x20, 0xA4, 0xA2, 0xA1, 0xC6, 0xD5, 0] {
        assert!(enough(answers.get(answer(command))), "{}", answer(command));
    }
    for event in [
        "reset node",
        "SYNC obeyed",
        "heartbeat heard",
        "heartbeat lost",
        "life guarding",
        "RPDO applied",
        "bit rate",
        "SRDO lost",
        "SRDO consumed",
        "GFC",
    ] {
        assert!(enough(events.get(event)), "{event}");
    }
    assert!(aborts.len() >= 15, "{aborts:X?}");
}
