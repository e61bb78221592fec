//! The program as its tests run it: a call, a virtual bus of its own, a folder.
//!
//! In: arguments. Out: exit status and texts; a bus whose nodes live as long as the value that
//! stands for it.

#![allow(dead_code, reason = "each program with tests uses a part of this")]

pub mod listener;
pub mod relay;

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdout, Command, Output, Stdio};
use std::sync::Mutex;
use std::thread;

use tempfile::TempDir;

/// How many cases run at a time: they wait for a bus in real time.
const ROWS: usize = 8;

/// What a call has come to: exit status, standard output, standard error.
pub type Said = (Option<i32>, String, String);

/// The program with these arguments, without the variables of python-can, and with nothing to read.
pub fn plumb(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plumb"));
    command.args(arguments).stdin(Stdio::null());
    for variable in ["CAN_INTERFACE", "CAN_CHANNEL", "CAN_BITRATE"] {
        command.env_remove(variable);
    }
    command
}

/// Ctrl-C for a program.
#[cfg(unix)]
pub fn interrupt(program: &Child) {
    let id = program.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status().unwrap();
    assert!(sent.success());
}

/// What a program that has ended has come to, without the spaces around its texts.
pub fn said(output: &Output) -> Said {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    let status = output.status.code();
    (status, text(&output.stdout), text(&output.stderr))
}

/// A `plumb serve` that runs; it ends with this.
pub struct Served {
    /// The process.
    pub child: Child,
    /// Its first line, with which it is ready.
    pub ready: String,
    /// What it prints behind that.
    pub out: BufReader<ChildStdout>,
}

impl Served {
    /// Starts one with these arguments at a free port, and waits until it is ready.
    pub fn start(arguments: &[&str]) -> Self {
        let mut child = plumb(&["serve", "--listen", "127.0.0.1:0"])
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        let mut ready = String::new();
        out.read_line(&mut ready).unwrap();
        Self { child, ready, out }
    }

    /// Where its bus is: HOST:PORT of socketcand, if that is the last way in of its first line.
    pub fn bus(&self) -> String {
        let (_, at) = self.ready.trim().rsplit_once(' ').expect("an address");
        at.to_owned()
    }

    /// The next line that has these words in it.
    pub fn prints(&mut self, words: &str) -> String {
        let mut line = String::new();
        while !line.contains(words) {
            line.clear();
            assert!(self.out.read_line(&mut line).unwrap() > 0, "never: {words}");
        }
        line
    }

    /// What stands behind these words in the next line that has them.
    pub fn behind(&mut self, words: &str) -> String {
        let line = self.prints(words);
        let (_, rest) = line.trim().split_once(words).expect("these words");
        rest.to_owned()
    }

    /// Types a line of words.
    pub fn word(&mut self, words: &str) {
        let typed = self.child.stdin.as_mut().unwrap();
        writeln!(typed, "{words}").unwrap();
        typed.flush().unwrap();
    }

    /// Lets so many seconds of the bus pass, however slow the machine is; what was typed before
    /// has been carried out by then.
    pub fn pass(&mut self, seconds: f64) {
        self.word(&format!("+{seconds} status"));
        self.prints("bus load");
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// An empty folder, gone with this.
pub struct Folder(pub TempDir);

impl Folder {
    /// One for a test alone.
    pub fn new() -> Self {
        Self(tempfile::Builder::new().prefix("plumb-").tempdir().unwrap())
    }

    /// The path of a name in it.
    pub fn path(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    /// Writes a file; its path.
    pub fn file(&self, name: &str, contents: impl AsRef<[u8]>) -> String {
        std::fs::write(self.0.path().join(name), contents).unwrap();
        self.path(name)
    }
}

/// True in a long run (`cargo xtask fuzz-long`), which asks for more random cases than any other.
pub fn is_long() -> bool {
    let cases = std::env::var("PROPTEST_CASES").ok();
    cases
        .and_then(|n| n.parse().ok())
        .is_some_and(|n: u32| n >= 10_000)
}

/// Carries all of these cases out, some at a time, and fails with what went wrong in each.
pub fn each_case<C: Send>(cases: Vec<C>, carry_out: impl Fn(C) -> Option<String> + Sync) {
    let cases = Mutex::new(VecDeque::from(cases));
    let row = || -> Vec<String> {
        let next = || cases.lock().unwrap().pop_front();
        std::iter::from_fn(next).filter_map(&carry_out).collect()
    };
    let wrong: Vec<String> = thread::scope(|scope| {
        let rows: Vec<_> = (0..ROWS).map(|_| scope.spawn(row)).collect();
        let rows = rows.into_iter().map(|row| row.join().unwrap());
        rows.flatten().collect()
    });
    let count = wrong.len();
    assert!(wrong.is_empty(), "{count} cases:\n{}", wrong.join("\n"));
}
