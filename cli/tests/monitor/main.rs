//! `plumb monitor` from the outside, against `plumb serve` and against a server made here.

#[path = "../program/mod.rs"]
mod program;
#[cfg(target_os = "linux")]
mod screen;
mod server;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;

use program::{Folder, Served, said};
#[cfg(target_os = "linux")]
use screen::{browse, cpu_s, drain, terminal};
use server::{Server, Serving};

fn plumb(arguments: &[&str]) -> Command {
    program::plumb(&[&["monitor"], arguments].concat())
}

/// Two nodes in real time, and a folder; both gone with it.
struct Bench {
    served: Served,
    bus: String,
    folder: Folder,
}

impl Bench {
    fn new() -> Self {
        Self::with(&[])
    }

    fn with(more: &[&str]) -> Self {
        let served = Served::start(more);
        Self {
            bus: served.bus(),
            served,
            folder: Folder::new(),
        }
    }

    fn type_line(&mut self, words: &str) {
        self.served.word(words);
    }

    fn watch(&self, more: &[&str]) -> Command {
        let mut command = plumb(&["--bus", &self.bus]);
        command.args(more);
        command
    }

    fn file(&self, name: &str) -> String {
        self.folder.path(name)
    }
}

/// Lines of a monitor that goes on.
struct Watched {
    child: Child,
    out: BufReader<std::process::ChildStdout>,
}

impl Watched {
    fn new(command: &mut Command) -> Self {
        let mut child = command
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let out = BufReader::new(child.stdout.take().unwrap());
        Self { child, out }
    }

    fn line(&mut self) -> String {
        let mut line = String::new();
        assert_ne!(self.out.read_line(&mut line).unwrap(), 0, "it has ended");
        line
    }

    /// Reads on until a line has this.
    fn until(&mut self, wanted: &str) -> String {
        self.until_line(wanted, |line| line.contains(wanted))
    }

    /// Reads on until frames are counted at this rate, to 2 % or five frames: a second of a busy
    /// machine ends a few frames early or late, and no second may have exactly so many.
    fn until_rate(&mut self, rate: u32) {
        let is_near = |line: &str| {
            let counted = line.split(" frames/s").next().unwrap_or_default();
            let counted = counted.rsplit(' ').next().and_then(|n| n.parse().ok());
            counted.is_some_and(|counted: u32| counted.abs_diff(rate) <= 5.max(rate / 50))
        };
        self.until_line("frames/s at the rate", is_near);
    }

    /// Reads on until so many lines are in its recording.
    fn until_recorded(&mut self, file: &str, lines: usize) {
        self.until_line(file, |_| {
            let text = fs::read_to_string(file).unwrap_or_default();
            text.lines().count() > lines
        });
    }

    /// Reads on until a line is such.
    fn until_line(&mut self, wanted: &str, is: impl Fn(&str) -> bool) -> String {
        let from = Instant::now();
        let mut seen = String::new();
        while from.elapsed() < Duration::from_secs(60) {
            let line = self.line();
            if is(&line) {
                return line;
            }
            seen += &line;
        }
        panic!("no {wanted:?} in\n{seen}");
    }

    fn end(mut self) -> (Option<i32>, String) {
        let status = self.child.wait().unwrap();
        let mut err = String::new();
        let mut stderr = self.child.stderr.take().unwrap();
        stderr.read_to_string(&mut err).unwrap();
        (status.code(), err)
    }
}

#[test]
fn a_bus_is_shown_in_lines_and_a_fault_by_its_name() {
    let mut bench = Bench::new();
    let mut seen = Watched::new(&mut bench.watch(&["--start", "-b", "250000"]));
    let line = seen.until("ok: both agree");
    assert!(line.contains("  A ") && line.contains("A-B "), "{line}");
    seen.until(" frames/s ");
    bench.type_line("fault b bias x 20 mg");
    seen.until("FAULT: B: EMCY FF13h: the channels differ for too long");
    bench.type_line("roll 15");
    seen.until("channel B is faulty (moved alone, or gravity of the wrong length)");
    seen.child.kill().unwrap();
    seen.end();
}

/// Tries until what is counted fits in at least one of some runs: a busy machine makes one second
/// much shorter than another for the program, and a defect does so in each run.
fn in_one_run(wanted: std::ops::RangeInclusive<usize>, run: impl Fn() -> usize) {
    let mut counts = Vec::new();
    while counts.len() < 10 {
        counts.push(run());
        if counts.last().is_some_and(|count| wanted.contains(count)) {
            return;
        }
    }
    panic!("{counts:?}, and never {wanted:?}");
}

#[test]
fn json_is_one_object_per_line_and_stale_values_are_null() {
    let mut bench = Bench::new();
    // Each node has told its state then.
    bench.served.pass(1.0);
    in_one_run(2..=3, || states_in_3_s(&bench));
}

/// How many states of a bus without angles are shown in three seconds; none where one has another
/// reason, since a machine that stood still has missed heartbeats.
fn states_in_3_s(bench: &Bench) -> usize {
    let (status, out, err) = said(&bench.watch(&["--json", "--for", "3s"]).output().unwrap());
    assert_eq!((status, err.as_str()), (Some(0), ""));
    let mut states = 0;
    for line in out.lines() {
        assert!(line.starts_with(r#"{"format":"plumb-monitor","version":1,"record":"#));
        let object: Value = serde_json::from_str(line).unwrap();
        if object["record"] == "state" {
            states += 1;
            let channel = &object["instruments"][0]["channels"][0];
            assert!(channel["slope_x_deg"].is_null(), "{line}");
            let reason = channel["slope_x_reason"].as_str().unwrap();
            if reason != "it is pre-operational, start it (NMT)" {
                eprintln!("{line}");
                return 0;
            }
            assert_eq!(channel["nmt"], "pre-operational");
        }
    }
    states
}

#[test]
fn passive_means_that_nothing_is_sent() {
    let server = Server::start(Serving::Silent);
    let output = plumb(&["--bus", &server.at, "--for", "6s"]).output();
    let (status, out, _) = said(&output.unwrap());
    assert_eq!(status, Some(0));
    assert!(out.contains("nothing was received yet"), "{out}");
    assert_eq!(server.end(), "< open plumb >< rawmode >");
}

#[test]
fn start_and_sync_send_what_they_name_and_stop_for_somebody_else() {
    in_one_run(7..=11, syncs_in_a_second);
    let server = Server::start(Serving::Frames(100));
    let options = ["--bus", &server.at, "--for", "4s", "--sync", "100"];
    let (_, out, _) = said(&plumb(&options).output().unwrap());
    assert!(out.contains("another node produces SYNC"), "{out}");
    assert!(!server.end().contains("send 080"));
}

/// How many SYNCs are sent in two seconds, of which the first one passes without.
fn syncs_in_a_second() -> usize {
    let server = Server::start(Serving::Silent);
    let options = [
        "--bus", &server.at, "--for", "2s", "--start", "--sync", "100",
    ];
    let (status, out, _) = said(&plumb(&options).output().unwrap());
    assert_eq!(status, Some(0));
    assert!(
        out.contains("1 frames/s") || out.contains("frames/s"),
        "{out}"
    );
    let heard = server.end();
    let start = "< open plumb >< rawmode >< send 000 2 01 01 >< send 000 2 01 02 >";
    assert!(heard.starts_with(start), "{heard}");
    heard.matches("< send 080 0 >").count()
}

#[cfg(unix)]
#[test]
fn a_recording_is_whole_after_an_interrupt_and_played_back_it_shows_the_same() {
    let bench = Bench::new();
    for name in ["bus.log", "bus.asc"] {
        let file = bench.file(name);
        let options = ["--start", "--record", &file];
        let mut seen = Watched::new(&mut bench.watch(&options));
        seen.until("ok: both agree");
        seen.until("frames/s");
        seen.until_recorded(&file, 300);
        program::interrupt(&seen.child);
        let (status, err) = seen.end();
        assert_eq!((status, err.as_str()), (Some(0), ""));
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.ends_with('\n') && text.lines().count() > 300, "{name}");
        let options = ["--log", &file, "--speed", "max", "--json"];
        let (status, out, err) = said(&plumb(&options).output().unwrap());
        assert_eq!((status, err.as_str()), (Some(0), ""), "{name}");
        let last: Value = serde_json::from_str(out.lines().last().unwrap()).unwrap();
        assert_eq!(last["bus"]["state"], "ended", "{last}");
        assert_eq!(last["bus"]["malformed"], 0);
        assert!(out.contains("both agree"));
        let again = said(&bench.watch(&["--record", &file]).output().unwrap());
        assert_eq!(again.0, Some(2));
        assert!(again.2.contains("is there already"), "{}", again.2);
        assert_eq!(fs::read_to_string(&file).unwrap(), text);
    }
}

#[test]
fn a_bus_that_dies_is_named_and_what_was_recorded_is_whole() {
    let mut bench = Bench::new();
    let file = bench.file("lost.log");
    let options = ["--start", "--record", &file];
    let mut seen = Watched::new(&mut bench.watch(&options));
    seen.until("ok: both agree");
    seen.until("frames/s");
    seen.until_recorded(&file, 50);
    bench.served.child.kill().unwrap();
    let (status, err) = seen.end();
    assert_eq!(status, Some(2));
    assert!(err.starts_with("plumb: socketcand://127.0.0.1:"), "{err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    let text = fs::read_to_string(&file).unwrap();
    assert!(text.ends_with('\n') && text.lines().count() > 50);
}

#[test]
fn a_bus_that_comes_back_is_watched_on() {
    let first = Server::start(Serving::Frames(100));
    let at = first.at.clone();
    let mut seen = Watched::new(&mut plumb(&["--bus", &at, "--reconnect"]));
    seen.until("frames/s");
    first.end();
    seen.until("FAULT: ");
    let second = Server::start_at(&at, Serving::Frames(100));
    seen.until("the bus is there again");
    seen.until_rate(100);
    seen.child.kill().unwrap();
    seen.end();
    second.end();
}

#[cfg(unix)]
#[test]
fn an_interrupt_ends_it_while_the_bus_is_lost() {
    let server = Server::start(Serving::Frames(100));
    let at = server.at.clone();
    let mut seen = Watched::new(&mut plumb(&["--bus", &at, "--reconnect"]));
    seen.until("frames/s");
    server.end();
    seen.until("FAULT: ");
    program::interrupt(&seen.child);
    let (status, err) = seen.end();
    assert_eq!((status, err.as_str()), (Some(0), ""));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_and_the_view_goes_on() {
    let bench = Bench::new();
    let options = [
        "--start",
        "--record",
        "/dev/full",
        "--force",
        "--for",
        "10s",
    ];
    let (status, out, err) = said(&bench.watch(&options).output().unwrap());
    assert_eq!(status, Some(2));
    assert!(out.contains("recording to /dev/full has ended: "), "{out}");
    let after = out.split("has ended: ").nth(1).unwrap();
    assert!(after.contains("frames/s"), "{out}");
    assert!(err.contains("recording to /dev/full has ended: "), "{err}");
}

/// An adapter whose line damages each second frame.
fn damaged_adapter() -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        use std::io::{BufRead as _, BufReader, Write as _};
        let (mut stream, _) = listener.accept().unwrap();
        let lines = BufReader::new(stream.try_clone().unwrap()).split(b'\r');
        for line in lines.map_while(Result::ok).take(3) {
            stream.write_all(b"\r").unwrap();
            if line == b"O" {
                break;
            }
        }
        // Until the monitor has gone.
        while stream.write_all(b"t70117F\rt701\xB17F\r").is_ok() {
            std::thread::sleep(Duration::from_millis(50));
        }
    });
    at
}

#[test]
fn damaged_lines_of_an_adapter_were_shown_as_missing_frames_alone() {
    let seen = |more: &[&str]| {
        let bus = format!("slcan://{}", damaged_adapter());
        let options = [&["--bus", &bus, "--for", "10s"], more].concat();
        said(&plumb(&options).output().unwrap())
    };
    let (status, out, err) = seen(&["--json"]);
    assert_eq!((status, err.as_str()), (Some(0), ""));
    // What happens to a busy machine may be told behind the last state.
    let is_state = |line: &&str| line.contains(r#""record":"state""#);
    let last = out.lines().rfind(is_state).expect("a state");
    let last: Value = serde_json::from_str(last).unwrap();
    assert!(last["bus"]["unreadable"].as_u64() > Some(10), "{last}");
    assert_eq!(out.matches("lines of the adapter can't be read").count(), 1);
    let out = seen(&[]).1;
    assert!(out.contains("lines unreadable"), "{out}");
}

#[test]
fn a_reader_that_has_enough_ends_it_without_a_word() {
    let bench = Bench::new();
    let mut seen = Watched::new(&mut bench.watch(&["--start"]));
    seen.line();
    let Watched { mut child, out } = seen;
    drop(out);
    // One that does not end goes on for ever.
    let from = Instant::now();
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(from.elapsed() < Duration::from_secs(60));
}

#[test]
fn what_cannot_be_done_is_one_sentence() {
    let folder = Folder::new();
    let no_log = folder.path("no.log");
    fs::write(&no_log, "#!/bin/sh\n").unwrap();
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = taken.local_addr().unwrap().to_string();
    let file = |name: &str| folder.path(name);
    let (empty, packed, nowhere) = (file("empty.log"), file("bus.log.gz"), file("none/bus.log"));
    for (options, sentence) in [
        (vec!["--bus", "127.0.0.1:1"], "127.0.0.1:1"),
        (vec!["--log", "nowhere.log"], "nowhere.log"),
        (vec!["--log", &no_log], "is no log of a CAN bus"),
        (vec!["--nodes", "1,2,3"], "two node-ids for each instrument"),
        (vec!["--bus", &taken, "--record", &empty], &taken),
        (vec!["--record", &packed], "a recording is not compressed"),
        (vec!["--record", &nowhere], "there is no such folder"),
    ] {
        let output = plumb(&options).output().unwrap();
        let (status, out, err) = said(&output);
        assert_eq!((status, out.as_str()), (Some(2), ""), "{options:?}: {err}");
        assert!(err.contains(sentence), "{err}");
        assert_eq!(err.lines().count(), 1, "{err}");
    }
    assert!(!fs::exists(&empty).unwrap(), "an empty recording was left");
}

#[test]
fn a_log_runs_at_its_own_time_and_gaps_are_told() {
    let folder = Folder::new();
    let path = folder.path("gap.log");
    let mut text = String::new();
    for (from, count) in [(1_700_000_000.0, 200), (1_700_003_600.0, 200)] {
        for n in 0..count {
            let time = from + f64::from(n) * 0.01;
            text += &format!("({time:.6}) can0 080#\n");
            text += &format!("({time:.6}) can0 181#E80300007F01\n");
            text += &format!("({time:.6}) can0 182#E60300007F01\n");
        }
    }
    text += "(1700003610.000000) can0 18";
    fs::write(&path, text).unwrap();
    let from = Instant::now();
    let options = ["--log", &path, "--speed", "10", "--skip-gaps"];
    let (status, out, err) = said(&plumb(&options).output().unwrap());
    assert_eq!((status, err.as_str()), (Some(0), ""));
    // Four seconds and a gap of two at ten times their speed; the whole gap takes six minutes.
    let took = from.elapsed();
    assert!(
        took > Duration::from_millis(500) && took < Duration::from_secs(60),
        "{took:?}"
    );
    assert!(out.contains("received again after 3598.0 s"), "{out}");
    assert!(
        out.contains("22:13:21.0  A +10.000 +0.000  B +9.980"),
        "{out}"
    );
    assert!(out.contains("warning: lines cut short: 1"), "{out}");
    assert!(out.contains("the log has ended"), "{out}");
}

#[test]
fn the_page_has_its_address_printed_and_serves_what_it_shows() {
    let bench = Bench::new();
    let options = ["--start", "--json", "--web", "127.0.0.1:0"];
    let mut seen = Watched::new(&mut bench.watch(&options));
    let first: Value = serde_json::from_str(&seen.line()).unwrap();
    assert_eq!(first["record"], "page");
    let url = first["url"].as_str().unwrap();
    let at = url.strip_prefix("http://").unwrap().trim_end_matches('/');
    seen.until("both agree");
    let mut stream = TcpStream::connect(at).unwrap();
    write!(stream, "GET /events HTTP/1.1\r\nHost: {at}\r\n\r\n").unwrap();
    let lines = BufReader::new(stream).lines().map(Result::unwrap);
    let states = lines.filter_map(|line| line.strip_prefix("data: ").map(str::to_owned));
    let levels = states.map(|state| {
        let state: Value = serde_json::from_str(&state).unwrap();
        state["state"]["instruments"][0]["verdict"]["level"].clone()
    });
    // On a busy machine a SYNC may be late just then, and nothing is known until the next one.
    let wait = Instant::now() + Duration::from_secs(60);
    let mut levels = levels.take_while(|_| Instant::now() < wait);
    assert!(levels.any(|level| level == "good"));
    let taken = bench.watch(&["--web", at]).output().unwrap();
    let (status, _, err) = said(&taken);
    assert_eq!(status, Some(2));
    assert!(err.contains("no page can be served at"), "{err}");
    seen.child.kill().unwrap();
    seen.end();
}

#[cfg(target_os = "linux")]
#[test]
fn a_monitor_whose_terminal_was_closed_went_on_for_ever() {
    let bench = Bench::new();
    for (name, hang_up, more) in [
        ("closed.log", false, "--start"),
        ("hung-up.log", true, "--start"),
        ("lines.log", false, "--plain"),
    ] {
        let file = bench.file(name);
        let (mut child, mut screen) = terminal(&mut bench.watch(&[more, "--record", &file]));
        // It is at work, and has recorded some of that.
        let (from, mut piece) = (Instant::now(), [0; 1 << 12]);
        let is_recorded = || fs::metadata(&file).is_ok_and(|about| about.len() > 1000);
        while from.elapsed() < Duration::from_secs(2) || !is_recorded() {
            assert_ne!(screen.read(&mut piece).unwrap(), 0);
            assert!(from.elapsed() < Duration::from_secs(60), "{name}: nothing");
        }
        drop(screen);
        if hang_up {
            let pid = child.id().to_string();
            let sent = Command::new("kill").args(["-HUP", &pid]).status().unwrap();
            assert!(sent.success());
        }
        let from = Instant::now();
        let status = loop {
            if let Some(status) = child.try_wait().unwrap() {
                break status;
            }
            if from.elapsed() > Duration::from_secs(60) {
                child.kill().unwrap();
                child.wait().unwrap();
                panic!("{name}: it goes on");
            }
            thread::sleep(Duration::from_millis(20));
        };
        assert_eq!(status.code(), Some(0), "{name}");
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.ends_with('\n'), "{name}");
        assert!(
            text.lines()
                .all(|line| line.starts_with('(') && line.contains('#'))
        );
    }
}

#[test]
fn own_frames_were_recorded_with_the_time_of_another_clock() {
    let mut bench = Bench::with(&["--speed", "10"]);
    // Ten seconds of the bus: its clock and this computer's are apart by then.
    bench.served.pass(11.0);
    let file = bench.file("own.log");
    let options = ["--start", "--for", "2s", "--record", &file];
    let (status, out, err) = said(&bench.watch(&options).output().unwrap());
    assert_eq!((status, err.as_str()), (Some(0), ""), "{out}");
    assert!(!out.contains("nothing has come"), "{out}");
    assert!(!out.contains("received again"), "{out}");
    let text = fs::read_to_string(&file).unwrap();
    assert_eq!(text.matches(" 000#01").count(), 2, "{text}");
    let time = |line: &str| line[1..18].parse::<f64>().unwrap();
    let times: Vec<f64> = text.lines().map(time).collect();
    for pair in times.windows(2) {
        let [before, after] = pair else {
            unreachable!()
        };
        assert!((0.0..2.0).contains(&(after - before)), "{before} {after}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn at_2000_frames_a_second_each_view_takes_less_than_a_twentieth_of_a_core() {
    const RATE: u32 = 2000;
    const RUN_S: f64 = 20.0;
    let servers: Vec<_> = (0..3)
        .map(|_| Server::start(Serving::Frames(RATE)))
        .collect();
    let at = |place: usize| ["--bus", &servers[place].at, "-b", "1000000"];
    let folder = Folder::new();
    let file = folder.path("load.log");
    let mut lines = Watched::new(plumb(&at(0)).args(["--record", &file]));
    let mut page = Watched::new(plumb(&at(1)).args(["--web", "127.0.0.1:0"]));
    let address = page.line();
    browse(address.trim().rsplit_once(' ').unwrap().1);
    let (mut drawn, screen) = terminal(&mut plumb(&at(2)));
    drain(screen);
    lines.until_rate(RATE);
    let children = [&lines.child, &page.child, &drawn];
    let before = children.map(cpu_s);
    let from = Instant::now();
    thread::sleep(Duration::from_secs_f64(RUN_S));
    let (after, wall_s) = (children.map(cpu_s), from.elapsed().as_secs_f64());
    let percent = |place: usize| (after[place] - before[place]) * 100.0 / wall_s;
    let [plain, browser, screen] = [0, 1, 2].map(percent);
    println!(
        "monitor at {RATE} frames/s, per cent of a core: lines with a recording {plain:.1}, \
         a page with a browser {browser:.1}, a terminal {screen:.1}"
    );
    // It has kept up, or else the figures would show nothing.
    lines.until_rate(RATE);
    for child in [&mut lines.child, &mut page.child, &mut drawn] {
        child.kill().unwrap();
        child.wait().unwrap();
    }
    servers.into_iter().for_each(|server| drop(server.end()));
    for taken in [plain, browser, screen] {
        assert!(taken > 0.0 && taken < 5.0, "{taken} %");
    }
}
