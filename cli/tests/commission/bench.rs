//! A bus with nodes, the program on it, and what it prints.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::Stdio;
use std::sync::atomic::{AtomicU32, Ordering};

use serde_json::Value;

pub use crate::program::{Said, plumb, said};

use crate::program::Served;
use crate::program::listener::Listener;

/// A bus with an instrument; gone with it.
pub struct Bench {
    pub served: Served,
    pub bus: String,
}

impl Bench {
    /// With these options of `plumb serve`.
    pub fn new(more: &[&str]) -> Self {
        let mut served = Served::start(&[&["--bit-rate", "250"], more].concat());
        // Sensors have to settle before an angle is valid.
        served.pass(1.2);
        let bus = served.bus();
        Self { served, bus }
    }

    /// One whose nodes are not calibrated, which is ready sooner.
    pub fn quick(more: &[&str]) -> Self {
        Self::new(&[&["--uncalibrated"], more].concat())
    }

    pub fn run(&self, words: &[&str]) -> Said {
        said(&plumb(words).args(["--bus", &self.bus]).output().unwrap())
    }

    /// A verb that has to succeed; what it has printed.
    pub fn done(&self, words: &[&str]) -> String {
        let (status, out, err) = self.run(words);
        assert_eq!(status, Some(0), "{words:?}: {err}");
        assert_eq!(err, "", "{words:?}");
        out
    }

    /// A verb that has to be refused; its sentence.
    pub fn refused(&self, words: &[&str]) -> String {
        let (status, out, err) = self.run(words);
        assert_eq!((status, out.as_str()), (Some(2), ""), "{words:?}: {err}");
        assert_eq!(err.lines().count(), 1, "{err}");
        err
    }

    pub fn json(&self, words: &[&str]) -> Value {
        let text = self.done(&[words, &["--json"]].concat());
        assert_eq!(text.lines().count(), 1);
        let value: Value = serde_json::from_str(&text).unwrap();
        let verb = format!("plumb-{}", words[0]);
        assert_eq!(value["format"], verb.as_str());
        assert_eq!(value["version"], 1);
        assert!(text.starts_with(&format!("{{\"format\":\"{verb}\",\"version\":1,")));
        value
    }

    /// Types a word of `plumb serve`.
    pub fn word(&mut self, word: &str) {
        self.served.word(word);
    }

    /// Lets so many seconds of the bus pass, behind what was typed.
    pub fn pass(&mut self, seconds: f64) {
        self.served.pass(seconds);
    }

    /// Changes the bit rate of all nodes to 500 kbit/s, and that of the adapter so much later than
    /// the command to change, s: the one of `plumb serve` is told by hand, as any other. What the
    /// verb has printed.
    pub fn at_500_kbit(&mut self, more: &[&str], adapter_s: f64) -> String {
        let words = [&["bitrate", "500", "--bus", &self.bus], more].concat();
        let mut listener = Listener::join(&self.bus);
        let change = plumb(&words).stdout(Stdio::piped()).spawn().unwrap();
        // LSS "activate bit timing": a machine that is busy may be long on its way to it.
        listener.hears(0x7E5, &[0x15]);
        self.word(&format!("+{adapter_s} bit-rate 500"));
        let (status, out, err) = said(&change.wait_with_output().unwrap());
        assert_eq!(status, Some(0), "{err}");
        out
    }

    /// An NMT command, by hand.
    pub fn nmt(&mut self, command: u8, node: u8) {
        self.send(0, &[command, node]);
    }

    /// A frame, by hand over socketcand; the nodes have taken it then.
    pub fn send(&mut self, id: u16, data: &[u8]) {
        use std::net::TcpStream;
        let mut listener = Listener::join(&self.bus);
        let mut stream = TcpStream::connect(&self.bus).unwrap();
        let bytes: String = data.iter().map(|byte| format!(" {byte:X}")).collect();
        let length = data.len();
        let command = format!("< open plumb >< rawmode >< send {id:X} {length}{bytes} >");
        stream.write_all(command.as_bytes()).unwrap();
        listener.hears(id.into(), data);
        self.pass(0.7);
    }
}

/// A file in the folder for temporary ones, gone with it.
pub struct Scratch(pub PathBuf);

impl Scratch {
    pub fn new() -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("plumb-commission-{}-{number}", std::process::id());
        Self(std::env::temp_dir().join(name))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}
