//! The tour in README.md, command by command, as a reader types it.
//!
//! The lines of its `sh` blocks run in one folder, in their order. `plumb serve` gets a port of its
//! own, which the other commands hear of through the variables of the bus, so that the test does
//! not meet what else runs on the machine. A line that ends with `&` goes on in the background
//! until the tour ends.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

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
    background: Vec<Child>,
    bus: String,
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
            bus: String::new(),
        }
    }

    fn shell(&self, line: &str) -> Command {
        let path = std::env::var("PATH").unwrap_or_default();
        let bin = self.folder.join("bin").display().to_string();
        let mut shell = Command::new("sh");
        shell
            .args(["-c", &format!("exec {line}")])
            .current_dir(&self.folder)
            .env("PATH", format!("{bin}:{path}"))
            .env("CAN_CHANNEL", &self.bus)
            .stdin(Stdio::null());
        shell
    }

    /// Starts what goes on, and waits until it says that it is ready.
    fn start(&mut self, line: &str) {
        let line = line.replace("plumb serve", "plumb serve --listen 127.0.0.1:0");
        // Its words may be typed: the end of its input is no end of it.
        let mut child = self
            .shell(&line)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut ready = String::new();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        out.read_line(&mut ready).unwrap();
        let places = ready.split("socketcand ").nth(1).expect(&ready);
        let at = places.split([',', '\n']).next().unwrap();
        self.bus = format!("{at}/plumb");
        self.background.push(child);
    }

    fn run(&self, line: &str) {
        let ran = self.shell(line).output().unwrap();
        assert!(
            ran.status.success(),
            "{line}\n{}{}",
            String::from_utf8_lossy(&ran.stdout),
            String::from_utf8_lossy(&ran.stderr)
        );
    }

    /// What the tour has made.
    fn made(&self, name: &str) -> u64 {
        let path: &Path = &self.folder.join(name);
        fs::metadata(path).map_or(0, |about| about.len())
    }
}

impl Drop for Tour {
    fn drop(&mut self) {
        for child in &mut self.background {
            let _ = child.kill();
            let _ = child.wait();
        }
        let _ = fs::remove_dir_all(&self.folder);
    }
}

#[test]
fn every_command_of_the_tour_does_what_it_says() {
    let commands = commands();
    assert!(commands.len() >= 8, "{commands:?}");
    let mut tour = Tour::new();
    for command in commands {
        match command.strip_suffix('&') {
            Some(line) => tour.start(line.trim()),
            None => tour.run(command),
        }
    }
}
