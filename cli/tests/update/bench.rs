//! A bus with two nodes for an update, and what a master on it sees of their angles.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::Output;
use std::sync::atomic::{AtomicBool, Ordering};
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
        let served = Served::start(&[&["--bit-rate", "1000"], more].concat());
        // Sensors have to settle before an update is let in.
        std::thread::sleep(Duration::from_millis(400));
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

/// A master on the bus: SYNC every 20 ms. The longest time in which neither channel had a valid
/// slope X in its TPDO 1, from the first one that was valid; and the states of the pair (2021h) in
/// it from then on.
pub fn longest_without_an_angle(bus: &str, done: &AtomicBool) -> (Duration, BTreeSet<String>) {
    let mut stream = TcpStream::connect(bus).unwrap();
    let patience = Some(Duration::from_millis(5));
    stream.set_read_timeout(patience).unwrap();
    write!(stream, "< open plumb >< rawmode >< send 0 2 1 0 >").unwrap();
    let (mut text, mut bytes) = (String::new(), [0; 4096]);
    let (mut valid, mut longest) = (None, Duration::ZERO);
    let mut states = BTreeSet::new();
    let mut next = Instant::now();
    while !done.load(Ordering::Relaxed) {
        if Instant::now() >= next {
            next += Duration::from_millis(20);
            write!(stream, "< send 80 0 >").unwrap();
        }
        if let Ok(count) = stream.read(&mut bytes) {
            text += &String::from_utf8_lossy(&bytes[..count]);
        }
        while let Some((frame, rest)) = text.split_once('>') {
            let words: Vec<_> = frame.split_whitespace().collect();
            if let [.., "frame", "181" | "182", _, data] = words[..] {
                if !data.starts_with("0080") {
                    let before = valid.replace(Instant::now());
                    longest = longest.max(before.map_or(Duration::ZERO, |b: Instant| b.elapsed()));
                }
                if valid.is_some() {
                    states.insert(data[10..].to_owned());
                }
            }
            text = rest.to_owned();
        }
    }
    (longest, states)
}
