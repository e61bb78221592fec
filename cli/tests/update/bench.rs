//! A bus with two nodes for an update, and what a master on it sees of their angles.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::Output;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::{Duration, Instant};

use crate::program::{Folder, Served, plumb};

/// A bus with two nodes, much faster than real time, and a folder; both gone with it.
pub struct Bench {
    _served: Served,
    pub bus: String,
    pub folder: Folder,
}

impl Bench {
    pub fn new() -> Self {
        Self::with_speed("20")
    }

    pub fn with_speed(speed: &str) -> Self {
        Self::serving(&["--uncalibrated", "--speed", speed])
    }

    pub fn serving(more: &[&str]) -> Self {
        let mut served = Served::start(&[&["--bit-rate", "1000"], more].concat());
        // Sensors have to settle before an update is let in.
        served.pass(1.0);
        Self {
            bus: served.bus(),
            _served: served,
            folder: Folder::new(),
        }
    }

    /// The file of an image.
    pub fn image(&self, version: &str, more: &[&str]) -> String {
        let path = self.folder.path(version);
        let built = plumb(&["image", &path, "--version", version])
            .args(more)
            .output();
        assert!(built.unwrap().status.success());
        path
    }

    pub fn update(&self, image: &str, more: &[&str]) -> Output {
        let command = ["update", image, "--bus", &self.bus];
        plumb(&command).args(more).output().unwrap()
    }
}

/// What a master tells the test that started it, and is told.
#[derive(Default)]
pub struct Shared {
    done: AtomicBool,
    angles: AtomicU32,
}

impl Shared {
    /// Waits until the pair is at work: it has delivered angles for a second or more.
    pub fn await_work(&self) {
        let until = Instant::now() + Duration::from_secs(60);
        while self.angles.load(Ordering::Relaxed) < 100 {
            assert!(Instant::now() < until, "the pair delivers no angle");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Ends the master.
    pub fn end(&self) {
        self.done.store(true, Ordering::Relaxed);
    }
}

/// A master that was not at its work for so long has sent no SYNC: of that time it knows nothing.
const STOPPED: Duration = Duration::from_millis(200);

/// A master on the bus: SYNC every 20 ms. The longest time of the bus in which neither channel had
/// a valid slope X in its TPDO 1, from the first one that was valid; and the states of the pair
/// (2021h) in it from then on.
pub fn longest_without_an_angle(bus: &str, shared: &Shared) -> (f64, BTreeSet<String>) {
    let mut stream = TcpStream::connect(bus).unwrap();
    let patience = Some(Duration::from_millis(5));
    stream.set_read_timeout(patience).unwrap();
    write!(stream, "< open plumb >< rawmode >< send 0 2 1 0 >").unwrap();
    let (mut text, mut bytes) = (String::new(), [0; 4096]);
    let (mut valid, mut longest) = (None, 0.0_f64);
    let (mut states, mut seen) = (BTreeSet::new(), false);
    let mut sent: Option<Instant> = None;
    while !shared.done.load(Ordering::Relaxed) {
        let since = sent.map(|sent| sent.elapsed());
        if since.is_none_or(|since| since >= Duration::from_millis(20)) {
            if since.is_some_and(|since| since > STOPPED) {
                valid = None;
            }
            sent = Some(Instant::now());
            write!(stream, "< send 80 0 >").unwrap();
        }
        if let Ok(count) = stream.read(&mut bytes) {
            text += &String::from_utf8_lossy(&bytes[..count]);
        }
        while let Some((frame, rest)) = text.split_once('>') {
            let words: Vec<_> = frame.split_whitespace().collect();
            if let [.., "frame", "181" | "182", at_s, data] = words[..] {
                if !data.starts_with("0080") {
                    let at_s: f64 = at_s.parse().unwrap();
                    longest = longest.max(at_s - valid.replace(at_s).unwrap_or(at_s));
                    shared.angles.fetch_add(1, Ordering::Relaxed);
                    seen = true;
                }
                if seen {
                    states.insert(data[10..].to_owned());
                }
            }
            text = rest.to_owned();
        }
    }
    (longest, states)
}
