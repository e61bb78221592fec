//! A virtual instrument on its bus with a motor and a chamber, for the tests of the bench's verbs.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::{Child, ChildStdin, Command, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

pub fn plumb(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_plumb"));
    command.args(arguments).stdin(Stdio::null());
    command
}

/// A bus with two nodes, a motor, a chamber, and a folder; all gone with it.
pub struct Bench {
    server: Child,
    words: ChildStdin,
    pub bus: String,
    pub motor: String,
    pub chamber: String,
    folder: PathBuf,
}

impl Bench {
    pub fn new(speed: &str, more: &[&str]) -> Self {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("plumb-bench-{}-{number}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        fs::create_dir_all(&folder).unwrap();
        let free = "127.0.0.1:0";
        let mut server = plumb(&[
            "serve",
            "--listen",
            free,
            "--motor",
            free,
            "--chamber",
            free,
        ])
        .args(["--speed", speed, "--bit-rate", "1000"])
        .args(more)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
        let mut lines = BufReader::new(server.stdout.take().unwrap()).lines();
        let mut next = || lines.next().unwrap().unwrap();
        let ready = next();
        let (_, bus) = ready.trim().rsplit_once(' ').unwrap();
        let mut behind = |flag: &str| loop {
            if let Some((_, at)) = next().split_once(flag) {
                break at.to_owned();
            }
        };
        let (motor, chamber) = (behind("--motor "), behind("--chamber "));
        // The rest is read so that the server never waits for it.
        std::thread::spawn(move || lines.for_each(drop));
        let words = server.stdin.take().unwrap();
        std::thread::sleep(Duration::from_millis(400));
        Self {
            bus: bus.to_owned(),
            server,
            words,
            motor,
            chamber,
            folder,
        }
    }

    pub fn path(&self, name: &str) -> String {
        self.folder.join(name).display().to_string()
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

    pub fn say(&mut self, words: &str) {
        writeln!(self.words, "{words}").unwrap();
    }
}

impl Drop for Bench {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
        let _ = fs::remove_dir_all(&self.folder);
    }
}

/// Exit status, standard output and standard error.
pub fn said(output: &Output) -> (Option<i32>, String, String) {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    (
        output.status.code(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

/// A number of a report.
pub fn number(report: &serde_json::Value, path: &str) -> f64 {
    report.pointer(path).unwrap().as_f64().unwrap()
}

/// Ctrl-C.
#[cfg(unix)]
pub fn interrupt(child: &Child) {
    let pid = child.id().to_string();
    let kill = Command::new("kill").args(["-INT", &pid]).status();
    assert!(kill.unwrap().success());
}
