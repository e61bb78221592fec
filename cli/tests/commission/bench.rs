//! A bus with nodes, the program on it, and what it says.

use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

pub fn plumb(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plumb"));
    command.args(arguments).stdin(Stdio::null());
    for variable in ["CAN_INTERFACE", "CAN_CHANNEL", "CAN_BITRATE"] {
        command.env_remove(variable);
    }
    command
}

/// A bus with an instrument; gone with it.
pub struct Bench {
    pub server: Child,
    pub bus: String,
}

/// What a verb has come to: exit status, standard output, standard error.
pub type Said = (Option<i32>, String, String);

impl Bench {
    /// With these options of `plumb serve`.
    pub fn new(more: &[&str]) -> Self {
        let mut server = plumb(&["serve", "--listen", "127.0.0.1:0", "--bit-rate", "250"])
            .args(more)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut ready = String::new();
        let mut out = BufReader::new(server.stdout.take().unwrap());
        out.read_line(&mut ready).unwrap();
        let (_, bus) = ready.trim().rsplit_once(' ').unwrap();
        // Sensors have to settle before an angle is valid.
        std::thread::sleep(Duration::from_millis(1200));
        Self {
            bus: bus.to_owned(),
            server,
        }
    }

    /// One whose nodes are not calibrated, which is ready sooner.
    pub fn quick(more: &[&str]) -> Self {
        Self::new(&[&["--uncalibrated"], more].concat())
    }

    pub fn say(&self, words: &[&str]) -> Said {
        said(&plumb(words).args(["--bus", &self.bus]).output().unwrap())
    }

    /// A verb that has to succeed; what it has printed.
    pub fn done(&self, words: &[&str]) -> String {
        let (status, out, err) = self.say(words);
        assert_eq!(status, Some(0), "{words:?}: {err}");
        assert_eq!(err, "", "{words:?}");
        out
    }

    /// A verb that has to be refused; its sentence.
    pub fn refused(&self, words: &[&str]) -> String {
        let (status, out, err) = self.say(words);
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
        let typed = self.server.stdin.as_mut().unwrap();
        writeln!(typed, "{word}").unwrap();
    }

    /// An NMT command, by hand over socketcand.
    pub fn nmt(&self, command: u8, node: u8) {
        use std::net::TcpStream;
        let mut stream = TcpStream::connect(&self.bus).unwrap();
        write!(
            stream,
            "< open plumb >< rawmode >< send 0 2 {command:X} {node:X} >"
        )
        .unwrap();
        std::thread::sleep(Duration::from_millis(700));
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

pub fn said(output: &Output) -> Said {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    let (out, err) = (text(&output.stdout), text(&output.stderr));
    (output.status.code(), out, err)
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
