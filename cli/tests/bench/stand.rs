//! A virtual instrument on its bus with a motor and a chamber, for the tests of the bench's verbs.

use std::fs;
use std::process::Command;

pub use crate::program::{plumb, said};

use crate::program::{Folder, Served};

/// A bus with two nodes, a motor, a chamber, and a folder; all gone with it.
pub struct Bench {
    served: Served,
    pub bus: String,
    pub motor: String,
    pub chamber: String,
    folder: Folder,
    /// How fast the bus is.
    speed: f64,
}

impl Bench {
    pub fn new(speed: &str, more: &[&str]) -> Self {
        let free = "127.0.0.1:0";
        let devices = ["--motor", free, "--chamber", free];
        let bus = ["--speed", speed, "--bit-rate", "1000"];
        let mut served = Served::start(&[&devices[..], &bus, more].concat());
        let (motor, chamber) = (served.behind("--motor "), served.behind("--chamber "));
        let times: f64 = speed.parse().unwrap();
        served.pass(0.4 * times);
        Self {
            bus: served.bus(),
            served,
            motor,
            chamber,
            folder: Folder::new(),
            speed: times,
        }
    }

    pub fn path(&self, name: &str) -> String {
        self.folder.path(name)
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = plumb(arguments);
        command.args(["--bus", &self.bus]);
        command
    }

    pub fn verify(&self, file: &str) -> (Option<i32>, String, String) {
        said(&self.command(&["verify", file]).output().unwrap())
    }

    /// What both nodes have in 2061h and 2063h.
    pub fn kept(&self) -> String {
        let file = self.path("kept.json");
        let kept = self
            .command(&["calibrate", "--force", "--keep", &file])
            .output();
        let (status, _, err) = said(&kept.unwrap());
        assert_eq!(status, Some(0), "{err}");
        fs::read_to_string(file).unwrap()
    }

    pub fn word(&mut self, words: &str) {
        self.served.word(words);
    }

    /// Lets pass what is so much time, s, on a machine that keeps up with the bus; what was typed
    /// before has been carried out by then.
    pub fn pass(&mut self, seconds: f64) {
        self.served.pass(seconds * self.speed);
    }
}

/// A number of a report.
pub fn number(report: &serde_json::Value, path: &str) -> f64 {
    report.pointer(path).unwrap().as_f64().unwrap()
}
