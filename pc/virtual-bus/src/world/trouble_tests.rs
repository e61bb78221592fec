//! Each word that breaks something, and what the bus and the pair make of it.

use std::sync::LazyLock;

use canopen::Frame;
use device::exchange::reason_code;
use device::objects::process::Shown;
use sim::bench::{Mode, World};
use sim::memory;
use sim::network::Network;
use sim::network::guest::Switch;
use sim::network::instrument::{Delivered, Fitting};
use tilt::chain::Invalid;

use super::adapter::Passed;
use super::effects::Done;
use super::stage::Stage;
use crate::clients::round_robin::{ClientId, Incoming};
use crate::words::line::read;

const MS: u64 = 1_000_000;

/// A calibrated pair that stands level at 500 kbit/s, OPERATIONAL, with a SYNC every 20 ms.
struct Site {
    stage: Stage,
    master: ClientId,
}

impl Site {
    fn new() -> Self {
        static DELIVERED: LazyLock<Delivered> = LazyLock::new(|| {
            Delivered::calibrated(Mode::Product, &World::NOMINAL, 1, 0).expect("a good unit")
        });
        let fitting = |node_id| Fitting {
            node_id,
            kbit_s: 500,
            memory: memory::blank(),
        };
        let mut network = Network::new(500_000, 1);
        DELIVERED
            .clone()
            .join(&mut network, [fitting(1), fitting(2)]);
        let mut stage = Stage::new(network, 1);
        stage.switch(0, Switch::On);
        stage.switch(1, Switch::On);
        let [master, ..] = [0, 1, 2].map(ClientId);
        let mut site = Self { stage, master };
        site.go(1000);
        site.start();
        site.go(3000);
        assert_eq!(site.states(), [1, 1], "{}", site.status());
        site
    }

    fn send(&mut self, id: u16, bytes: &[u8]) {
        let frame = Frame::data_frame(id, bytes);
        let client = self.master;
        if self.stage.has_room(client) {
            self.stage.offer(Incoming { client, frame });
        }
    }

    /// NMT: start all nodes.
    fn start(&mut self) {
        self.send(0, &[1, 0]);
    }

    fn go(&mut self, ms: u64) -> Vec<Passed> {
        let mut passed = Vec::new();
        for _ in 0..ms / 20 {
            self.send(0x80, &[]);
            let until_ns = self.stage.network.now_ns() + 20 * MS;
            passed.extend(self.stage.run_until(until_ns));
        }
        passed
    }

    fn enter(&mut self, text: &str) -> Done {
        let line = read(text, 2).unwrap().expect("a word");
        self.stage.obey(&line.word).expect("carried out")
    }

    fn status(&mut self) -> String {
        match self.enter("status") {
            Done::Told(text) => text,
            other => panic!("{other:?}"),
        }
    }

    fn shown(&self, number: usize) -> Shown<'_> {
        self.stage.network.shown(number)
    }

    /// 2021h of both nodes.
    fn states(&self) -> [u8; 2] {
        [0, 1].map(|number| self.shown(number).state())
    }
}

/// The error codes of a node's EMCYs.
fn emcies(passed: &[Passed], node: u16) -> impl Iterator<Item = u16> {
    let frames = passed.iter().map(|p| p.frame);
    frames.filter_map(move |frame| match frame.bytes() {
        [low, high, ..] if frame.cob_id() == Some(0x80 + node) => {
            Some(u16::from_le_bytes([*low, *high]))
        }
        _ => None,
    })
}

/// One word, and what must have come of it within a time.
struct Case {
    word: &'static str,
    /// 2021h of node a: 6 disagree, 8 b is faulty.
    state: u8,
    /// One of these is 2027h sub 2 of node a; any when there are none.
    why: &'static [Invalid],
    /// An EMCY of node b.
    emcy: Option<u16>,
    within_ms: u64,
}

const fn faulty(word: &'static str, why: &'static [Invalid], emcy: u16, within_ms: u64) -> Case {
    Case {
        word,
        state: 8,
        why,
        emcy: Some(emcy),
        within_ms,
    }
}

/// Node b sends no EMCY of it.
const fn mute(word: &'static str, why: &'static [Invalid], within_ms: u64) -> Case {
    Case {
        emcy: None,
        ..faulty(word, why, 0, within_ms)
    }
}

/// Level, gravity's length does not tell a shift of x, so neither is blamed.
const fn unknown(word: &'static str, within_ms: u64) -> Case {
    Case {
        state: 6,
        ..faulty(word, &[], 0xFF13, within_ms)
    }
}

const CASES: [Case; 20] = [
    faulty("brown-out", &[Invalid::PartReset], 0x3200, 200),
    faulty("brown-out 50 ms", &[Invalid::PartReset], 0x3200, 400),
    unknown("offset 50 mg", 500),
    unknown("bias x 10 mg", 1000),
    unknown("drift x 20 mg/s", 2000),
    faulty("bias z 50 mg", &[Invalid::Biased], 0xFF08, 3000),
    faulty("gain z -5 %", &[Invalid::Biased], 0xFF08, 3000),
    faulty("frozen", &[Invalid::Stuck], 0xFF04, 100),
    faulty("frozen y", &[Invalid::Stuck], 0xFF04, 200),
    faulty("noise 3", &[Invalid::Noise], 0xFF05, 400),
    faulty("spikes 500 mg 5 /s", &[Invalid::Spikes], 0xFF06, 2000),
    faulty("delay 50 ms", &[Invalid::Stale], 0xFF02, 400),
    faulty("loss 0.95", &[Invalid::Stale], 0xFF02, 400),
    mute("sag", &[], 3000),
    faulty("thermometer 5 degC", &[Invalid::Thermometer], 0xFF07, 1000),
    faulty("calibration", &[Invalid::Corrupt], 0xFF21, 400),
    mute("halted", &[Invalid::Silent], 400),
    mute("frames-late 200 ms", &[Invalid::Late], 1000),
    mute("bus-off", &[Invalid::Silent], 400),
    mute("sync-lost", &[Invalid::Silent], 400),
];

#[test]
fn each_fault_is_found_in_its_time_told_on_the_bus_and_gone_once_healed_and_reset() {
    for Case {
        word,
        state,
        why,
        emcy,
        within_ms,
    } in CASES
    {
        let mut site = Site::new();
        site.enter(&format!("fault b {word}"));
        let (mut judged, mut told) = (false, emcy.is_none());
        for _ in 0..within_ms / 20 {
            let passed = site.go(20);
            told |= emcies(&passed, 2).any(|code| Some(code) == emcy);
            let shown = site.shown(0);
            let reason =
                why.is_empty() || why.iter().any(|why| reason_code(*why) == shown.blame().1);
            judged |= shown.state() == state && reason;
        }
        assert!(judged && told, "{word}: {}", site.status());
        // A supply that was gone for a moment is back.
        let broken = site.status().contains("\n      broken: ");
        assert!(broken || word == "brown-out", "{word}");
        site.enter("heal b");
        assert!(!site.status().contains("broken"), "{word}");
        site.go(200);
        site.enter("reset all");
        site.go(1000);
        site.start();
        site.go(3000);
        assert_eq!(site.states(), [1, 1], "{word}: {}", site.status());
    }
}

#[test]
fn swapped_axes_are_found_where_they_differ() {
    let mut site = Site::new();
    site.enter("roll 20");
    site.go(3000);
    assert_eq!(site.states(), [1, 1], "{}", site.status());
    site.enter("fault b swapped");
    site.go(500);
    assert!([6, 8].contains(&site.shown(0).state()), "{}", site.status());
}

#[test]
fn a_node_that_babbles_takes_the_share_of_the_bus_it_was_told() {
    let mut site = Site::new();
    let of = |passed: &[Passed], id| {
        let ids = passed.iter().map(|p| p.frame.cob_id());
        ids.filter(|found| *found == Some(id)).count()
    };
    site.enter("fault b babble 1 0.3");
    let passed = site.go(2000);
    let load = site.stage.network.load_percent();
    assert!((30..=50).contains(&load), "{load}");
    assert!(of(&passed, 1) > 1000);
    assert_eq!(site.states(), [1, 1], "{}", site.status());
    site.enter("fault b babble 001");
    let passed = site.go(200);
    assert!(passed.len() > 500 && of(&passed[10..], 1) == passed.len() - 10);
    site.enter("heal b");
    site.go(20);
    assert_eq!(of(&site.go(200), 1), 0);
}

#[test]
fn a_reset_starts_code_that_stood_still_and_heal_does_not_do_so_again() {
    for word in ["reset b", "power b off"] {
        let mut site = Site::new();
        site.enter("fault b halted");
        site.go(500);
        assert!(site.status().contains("  b   halted"), "{}", site.status());
        site.enter(word);
        site.enter("power b on");
        site.go(1000);
        let up_to = site.stage.network.nodes()[1].is_running();
        assert!(up_to && !site.status().contains("halted"), "{word}");
        site.enter("heal b");
        assert!(site.stage.network.nodes()[1].is_running(), "{word}");
    }
}

#[test]
fn code_without_power_cannot_stand_still() {
    let mut site = Site::new();
    site.enter("power b off");
    site.enter("fault b halted");
    site.enter("power b on");
    site.go(1000);
    assert!(!site.status().contains("halted"), "{}", site.status());
}

#[test]
fn the_status_tells_what_is_broken_whom_each_node_blames_and_why() {
    let mut site = Site::new();
    site.enter("fault b frozen y");
    site.go(500);
    let text = site.status();
    for line in [
        "the other channel is faulty (the sensor's codes stand still), ",
        "pitch invalid (the sensor's codes stand still), roll invalid (the sensor's codes stand \
         still), this channel is faulty",
        "      broken: frozen y\n",
    ] {
        assert!(text.contains(line), "{line}: {text}");
    }
    site.enter("fault b bias x 10 mg");
    site.enter("fault b sync-lost");
    let text = site.status();
    assert!(
        text.contains("broken: bias step 10 mg in x; SYNC lost\n"),
        "{text}"
    );
}
