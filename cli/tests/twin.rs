//! `plumb twin` from the outside, beside a `plumb serve` that runs, and what a raw client finds at
//! the port for words.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use serde_json::Value;

mod program;

use program::Served;

const PLUMB: &str = env!("CARGO_BIN_EXE_plumb");

const SOON: Duration = Duration::from_secs(60);

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// A running server.
struct Server {
    served: Served,
    ready: Value,
}

impl Server {
    fn start(arguments: &[&str]) -> Self {
        let json = ["--uncalibrated", "--json", "--no-stdin"];
        let served = Served::start(&[&json, arguments].concat());
        let ready = serde_json::from_str(&served.ready).unwrap();
        Self { served, ready }
    }

    fn at(&self) -> &str {
        self.ready["twin"].as_str().unwrap()
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut command = Command::new(PLUMB);
        command.args(["twin", "--to", self.at()]).args(words);
        command
    }

    fn hears(&self, words: &[&str]) -> Output {
        self.command(words).stdin(Stdio::null()).output().unwrap()
    }

    /// What is printed of words that are all accepted.
    fn obeys(&self, words: &[&str]) -> String {
        let ran = self.hears(words);
        let said = (ran.status.code(), text(&ran.stderr));
        assert_eq!(said, (Some(0), String::new()), "{words:?}");
        text(&ran.stdout)
    }

    /// The same of lines on the standard input.
    fn reads(&self, lines: &[u8]) -> Output {
        let mut child = self
            .command(&["-"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(lines).unwrap();
        child.wait_with_output().unwrap()
    }

    /// A client that has read the greeting.
    fn raw(&self) -> BufReader<TcpStream> {
        let stream = TcpStream::connect(self.at()).unwrap();
        stream.set_read_timeout(Some(SOON)).unwrap();
        let mut client = BufReader::new(stream);
        assert_eq!(answer(&mut client)["format"], "plumb-serve-answer");
        client
    }

    /// Waits for its end.
    fn ends(mut self) -> Option<i32> {
        self.served.child.wait().unwrap().code()
    }
}

fn answer(client: &mut BufReader<TcpStream>) -> Value {
    let mut line = String::new();
    client.read_line(&mut line).unwrap();
    serde_json::from_str(&line).unwrap()
}

/// The one sentence on stderr behind this exit status.
fn told(output: &Output, status: i32) -> String {
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    said
}

#[test]
fn words_move_break_and_end_it_and_the_last_is_answered() {
    let server = Server::start(&["--speed", "20"]);
    let said = server.obeys(&["rate 80", "pitch 30", "wait", "fault b frozen", "status"]);
    assert!(said.starts_with("ok\nok\nok\nok\n"), "{said}");
    assert!(said.contains("pitch 30.000 deg, roll 0.000 deg"), "{said}");
    assert!(said.contains("      broken: frozen\n"), "{said}");
    assert_eq!(server.obeys(&["quit"]), "ok\n");
    assert_eq!(server.ends(), Some(0));
}

#[test]
fn the_port_is_printed_and_is_of_this_machine_alone() {
    let server = Server::start(&[]);
    assert!(server.at().starts_with("127.0.0.1:"), "{}", server.at());
    let mut child = Command::new(PLUMB)
        .args(["serve", "--listen", "127.0.0.1:0", "--uncalibrated"])
        .args(["--no-stdin", "--twin", "127.0.0.1:0"])
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let is_it = |line: &String| line.starts_with("plumb twin --to 127.0.0.1:");
    let line = lines.map_while(Result::ok).find(is_it);
    let _ = child.kill();
    let _ = child.wait();
    assert!(line.is_some_and(|line| !line.contains(":0 ")));
}

#[test]
fn a_port_in_use_is_named_with_its_option() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = taken.local_addr().unwrap().to_string();
    let ran = Command::new(PLUMB)
        .args(["serve", "--listen", "127.0.0.1:0", "--twin", &at])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = told(&ran, 2);
    assert!(said.contains("choose another one with --twin"), "{said}");
}

#[test]
fn one_line_may_be_typed_without_quotes() {
    let server = Server::start(&[]);
    let typed = ["fault", "b", "bias", "x", "20", "mg"];
    assert_eq!(server.obeys(&typed), "ok\n");
    assert_eq!(server.obeys(&["temp", "-10"]), "ok\n");
    assert!(
        server
            .obeys(&["status"])
            .contains("broken: bias step 20 mg in x")
    );
}

#[test]
fn a_refused_word_is_status_1_and_those_behind_it_are_carried_out() {
    let server = Server::start(&[]);
    let ran = server.hears(&["fault b wobbly", "pitch 30"]);
    let said = told(&ran, 1);
    assert!(said.contains("there is no fault \"wobbly\""), "{said}");
    assert_eq!(text(&ran.stdout), "ok\n");
    let poses = server.hears(&["pitch 80", "roll 80"]);
    assert!(told(&poses, 1).contains("no housing stands"));
    let said = told(&server.hears(&["hold"]), 1);
    assert!(said.contains("words of scripts"), "{said}");
}

#[test]
fn a_word_that_is_put_off_is_answered_at_once() {
    let server = Server::start(&[]);
    let said = server.obeys(&["+600 s fault b stuck", "+0 s pitch 5"]);
    assert!(said.starts_with("put off to 60"), "{said}");
    assert!(said.ends_with(" s\nok\n"), "{said}");
}

#[test]
fn a_wait_is_over_when_virtual_time_has_come() {
    let server = Server::start(&["--speed", "20"]);
    let seconds = |status: &str| -> f64 {
        let (time, _) = status.split_once(" s: ").unwrap();
        time.parse().unwrap()
    };
    let before = seconds(&server.obeys(&["status"]));
    let said = server.obeys(&["wait 10 s", "status"]);
    let after = seconds(said.strip_prefix("ok\n").unwrap());
    assert!(after - before >= 10.0, "{before} {after}");
}

#[test]
fn lines_of_the_standard_input_are_words() {
    let server = Server::start(&[]);
    let ran = server.reads(b"# a comment\n\npitch 5\nroll 5\r\nlevel");
    assert_eq!(text(&ran.stdout), "ok\nok\nok\n");
    assert_eq!(ran.status.code(), Some(0));
}

#[test]
fn what_is_no_text_and_a_line_without_an_end_are_refused() {
    let server = Server::start(&[]);
    let said = told(&server.reads(b"pitch \xFF\n"), 1);
    assert!(said.contains("pitch DEGREES"), "{said}");
    let mut long = vec![b'x'; 300_000];
    long.extend(b"\nlevel\n");
    let ran = server.reads(&long);
    assert!(told(&ran, 1).contains("at most 4096 bytes"));
    assert_eq!(text(&ran.stdout), "ok\n");
}

#[test]
fn answers_come_as_json_too() {
    let server = Server::start(&[]);
    let ran = server.hears(&["--json", "status", "pitch 300"]);
    assert_eq!(
        (ran.status.code(), text(&ran.stderr)),
        (Some(1), String::new())
    );
    let said = text(&ran.stdout);
    let said: Vec<Value> = said
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let accepted: Vec<_> = said.iter().map(|one| &one["accepted"]).collect();
    assert_eq!(accepted, [true, false]);
    assert_eq!(said[0]["version"], 1);
    assert_eq!(said[0]["lines"].as_array().unwrap().len(), 3);
}

#[test]
fn beside_a_client_that_waits_another_is_answered() {
    let server = Server::start(&[]);
    let mut waiting = server.raw();
    waiting.get_mut().write_all(b"wait 100000\n").unwrap();
    assert_eq!(server.obeys(&["level"]), "ok\n");
    let mut second = server.raw();
    second.get_mut().write_all(b"level\n").unwrap();
    assert_eq!(answer(&mut second)["accepted"], true);
    // The end of the bus is the end of the wait, without an answer.
    assert_eq!(server.obeys(&["quit"]), "ok\n");
    assert_eq!(server.ends(), Some(0));
    assert_eq!(waiting.read_line(&mut String::new()).unwrap_or(0), 0);
}

#[test]
fn a_client_that_goes_in_the_middle_changes_nothing() {
    let server = Server::start(&[]);
    let mut half = server.raw();
    half.get_mut().write_all(b"qui").unwrap();
    drop(half);
    let mut unanswered = server.raw();
    unanswered.get_mut().write_all(b"wait 1\nstatus\n").unwrap();
    drop(unanswered);
    assert_eq!(server.obeys(&["level"]), "ok\n");
}

#[test]
fn a_page_in_a_browser_can_send_no_word() {
    let server = Server::start(&[]);
    let mut page = server.raw();
    let post = b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\nquit\r\n";
    page.get_mut().write_all(post).unwrap();
    // Nothing, or a reset, since not all was read.
    assert_eq!(page.read_to_string(&mut String::new()).unwrap_or(0), 0);
    assert_eq!(server.obeys(&["level"]), "ok\n");
}

#[test]
fn words_are_heard_before_time_begins() {
    let server = Server::start(&["--await-client"]);
    assert!(server.obeys(&["status"]).starts_with("0.000 s: "));
    assert_eq!(server.obeys(&["quit"]), "ok\n");
    assert_eq!(server.ends(), Some(0));
}

#[test]
fn a_server_that_goes_before_its_answer_is_status_1() {
    let server = Server::start(&[]);
    let ran = server.hears(&["quit", "pitch 30"]);
    assert_eq!(text(&ran.stdout), "ok\n");
    let said = told(&ran, 1);
    assert!(said.contains("before \"pitch 30\" was answered"), "{said}");
}

#[test]
fn where_nobody_or_somebody_else_listens_the_address_and_the_way_out_are_told() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap().to_string();
    let twin = || {
        Command::new(PLUMB)
            .args(["twin", "--to", &at, "level"])
            .output()
    };
    let other = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(b"SSH-2.0-other\r\n").unwrap();
        let _ = stream.read(&mut [0; 64]);
    });
    let said = told(&twin().unwrap(), 2);
    assert!(
        said.contains(&at) && said.contains("takes no words"),
        "{said}"
    );
    other.join().unwrap();
    let said = told(&twin().unwrap(), 2);
    assert!(said.contains(&at), "{said}");
    assert!(said.contains("start one with `plumb serve`"), "{said}");
}

#[test]
fn wrong_arguments_are_status_2() {
    for arguments in [&["twin"][..], &["twin", "--to", "nowhere", "level"]] {
        let ran = Command::new(PLUMB).args(arguments).output().unwrap();
        assert_eq!(ran.status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn the_help_of_both_lists_the_same_words() {
    let help = |verb: &str| {
        let ran = Command::new(PLUMB).args([verb, "--help"]).output();
        text(&ran.unwrap().stdout)
    };
    let (serve, twin) = (help("serve"), help("twin"));
    let words = |help: &str| {
        let list = help.find("  pitch DEGREES").expect("a list");
        help[list..].to_owned()
    };
    assert_eq!(words(&twin), words(&serve));
}
