//! The tour in README.md, command by command, as a reader types it.
//!
//! The lines of its `sh` blocks run in one folder, in their order. `plumb serve` gets ports of its
//! own, which the other commands hear of through the variable of the channel, and `plumb twin` by
//! its option, so that the test does not meet what else runs on the machine. A line that ends with
//! `&` goes on in the background until the tour ends.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, ChildStdout, Command, Stdio};

const README: &str = include_str!("../../README.md");

/// The heading of the tour.
const HEADING: &str = "## Five minutes";

/// The commands of the tour.
fn commands() -> Vec<&'static str> {
    let (_, tour) = README.split_once(HEADING).expect("the tour's heading");
    let (tour, _) = tour.split_once("\n## ").expect("a heading behind it");
    let mut inside = false;
    let mut commands = Vec::new();
    for line in tour.lines() {
        match line {
            "```sh" => inside = true,
            "```" => inside = false,
            _ if inside => commands.push(line.split("  #").next().unwrap_or(line).trim()),
            _ => {}
        }
    }
    commands.retain(|command| !command.is_empty());
    commands
}

/// A folder with `plumb` on its path; what was started in it ends with it.
struct Tour {
    folder: PathBuf,
    /// With what they print, which somebody has to hold open.
    background: Vec<(Child, BufReader<ChildStdout>)>,
    bus: String,
    twin: String,
    motor: String,
    chamber: String,
}

/// An address of this machine that nobody has.
fn free() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap().to_string()
}

impl Tour {
    fn new() -> Self {
        let folder = std::env::temp_dir().join(format!("plumb-tour-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(folder.join("bin")).unwrap();
        let program = folder.join("bin").join("plumb");
        fs::hard_link(env!("CARGO_BIN_EXE_plumb"), &program)
            .or_else(|_| fs::copy(env!("CARGO_BIN_EXE_plumb"), &program).map(drop))
            .unwrap();
        Self {
            folder,
            background: Vec::new(),
            bus: format!("{}/plumb", free()),
            twin: free(),
            motor: free(),
            chamber: free(),
        }
    }

    fn shell(&self, line: &str) -> Command {
        let line = line.replace("plumb twin", &format!("plumb twin --to {}", self.twin));
        let line = line.replace("127.0.0.1:5025", &self.motor);
        let line = line.replace("127.0.0.1:5026", &self.chamber);
        let path = std::env::var("PATH").unwrap_or_default();
        let bin = self.folder.join("bin").display().to_string();
        let mut shell = Command::new("sh");
        shell
            .args(["-c", &line])
            .current_dir(&self.folder)
            .env("PATH", format!("{bin}:{path}"))
            .env("CAN_CHANNEL", &self.bus)
            .stdin(Stdio::null());
        shell
    }

    /// Starts the bus, and waits until it prints that it is ready.
    fn start(&mut self, line: &str) {
        let at = self.bus.trim_end_matches("/plumb");
        let served = format!("exec plumb serve --listen {at} --twin {}", self.twin);
        let line = line.replace("plumb serve", &served);
        let mut child = self.shell(&line).stdout(Stdio::piped()).spawn().unwrap();
        let mut ready = String::new();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        out.read_line(&mut ready).unwrap();
        assert!(ready.starts_with("serving 2 nodes"), "{ready}");
        self.background.push((child, out));
    }

    /// Runs a command to its end; what it has printed.
    fn run(&self, line: &str) -> String {
        let ran = self.shell(line).output().unwrap();
        assert!(
            ran.status.success(),
            "{line}\n{}{}",
            String::from_utf8_lossy(&ran.stdout),
            String::from_utf8_lossy(&ran.stderr)
        );
        String::from_utf8_lossy(&ran.stdout).into_owned()
    }
}

impl Drop for Tour {
    fn drop(&mut self) {
        for (child, _) in &mut self.background {
            let _ = child.kill();
            let _ = child.wait();
        }
        let _ = fs::remove_dir_all(&self.folder);
    }
}

#[test]
fn every_command_of_the_tour_does_what_the_tour_states() {
    let commands = commands();
    assert!(commands.len() >= 8, "{commands:?}");
    let mut tour = Tour::new();
    let mut said = String::new();
    for command in commands {
        match command.strip_suffix('&') {
            Some(line) => tour.start(line.trim()),
            None => said += &tour.run(command),
        }
    }
    // What the text states of them.
    for sentence in [
        "Plumb inclinometer, channel A",
        "quadratic model for",
        "accepted: within",
        "the calibration in force and the report are those of the file",
        "both agree",
        "the channels disagree and neither can be blamed",
        "FF13h",
        "FF15h",
        "3 faults still standing at the end",
        "put off to ",
    ] {
        assert!(said.contains(sentence), "{sentence:?} is not in\n{said}");
    }
    for made in [
        "characterisation-report/report.html",
        "calibration-report/report.html",
        "calibration-report/dcc.xml",
        "shift.log",
        "shift.csv",
        "plumb-period/report.html",
    ] {
        let length = fs::metadata(tour.folder.join(made)).map_or(0, |about| about.len());
        assert!(length > 1000, "{made} has {length} bytes");
    }
    // The last word has ended the bus.
    for (child, _) in &mut tour.background {
        assert!(child.wait().unwrap().success());
    }
}
