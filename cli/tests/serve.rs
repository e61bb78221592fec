//! `plumb serve` from the outside: the program runs, and a raw socketcand client talks to it.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

mod program;

use program::{Folder, Served, plumb};

/// Long enough for a machine that is busy with others; what is waited for ends the wait.
const SOON: Duration = Duration::from_secs(60);

fn command(arguments: &[&str]) -> Command {
    plumb(&[&["serve"], arguments].concat())
}

/// Runs to the end.
fn served(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

/// The one sentence on stderr, behind exit status 2.
fn refused(output: &Output) -> String {
    let said = String::from_utf8(output.stderr.clone()).unwrap();
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    said
}

/// A server whose nodes are not calibrated, which is ready sooner.
fn start(arguments: &[&str]) -> Served {
    Served::start(&[&["--uncalibrated"], arguments].concat())
}

fn at(served: &Served) -> SocketAddr {
    let bus = served.bus();
    bus.parse().unwrap_or_else(|e| panic!("{e}: {bus}"))
}

/// Waits for its end.
fn ends(mut served: Served) -> Option<i32> {
    let from = Instant::now();
    while from.elapsed() < SOON {
        if let Some(status) = served.child.try_wait().unwrap() {
            return status.code();
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("it goes on");
}

/// A socketcand client in raw mode.
struct Client {
    stream: TcpStream,
    unread: String,
}

impl Client {
    fn connect(at: SocketAddr) -> Self {
        let stream = TcpStream::connect(at).unwrap();
        stream.set_read_timeout(Some(SOON)).unwrap();
        let unread = String::new();
        let mut client = Self { stream, unread };
        assert_eq!(client.message(), "hi");
        for command in ["< open plumb >", "< rawmode >"] {
            client.stream.write_all(command.as_bytes()).unwrap();
            assert_eq!(client.message(), "ok");
        }
        client
    }

    /// What stands between the next `<` and `>`.
    fn message(&mut self) -> String {
        let mut bytes = [0; 4096];
        loop {
            if let Some((message, rest)) = self.unread.split_once('>') {
                let message = message.trim_start_matches(['<', ' ']).trim().to_owned();
                self.unread = rest.trim_start().to_owned();
                return message;
            }
            let length = match self.stream.read(&mut bytes) {
                // A machine that was stopped and goes on.
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                length => length.unwrap(),
            };
            assert!(length > 0, "the server is gone");
            self.unread += std::str::from_utf8(&bytes[..length]).unwrap();
        }
    }

    fn send(&mut self, id: u16, bytes: &[u8]) {
        let data: Vec<_> = bytes.iter().map(|b| format!("{b:x}")).collect();
        let text = format!("< send {id:x} {} {} >", bytes.len(), data.join(" "));
        self.stream.write_all(text.as_bytes()).unwrap();
    }

    /// The next frame with this identifier.
    fn frame(&mut self, id: u16) -> Vec<u8> {
        let from = Instant::now();
        while from.elapsed() < SOON {
            let message = self.message();
            let words: Vec<&str> = message.split(' ').collect();
            let ["frame", found, _, data] = words.as_slice() else {
                continue;
            };
            if u16::from_str_radix(found, 16) == Ok(id) {
                let byte = |at| u8::from_str_radix(&data[at..at + 2], 16).unwrap();
                return (0..data.len()).step_by(2).map(byte).collect();
            }
        }
        panic!("no frame {id:x}");
    }

    /// Expedited upload, as a number.
    fn upload(&mut self, node: u16, index: u16, sub: u8) -> i32 {
        let [low, high] = index.to_le_bytes();
        self.send(0x600 + node, &[0x40, low, high, sub, 0, 0, 0, 0]);
        let answer = self.frame(0x580 + node);
        assert_eq!(answer[0] & 0xE3, 0x43, "{answer:02x?}");
        assert_eq!(answer[1..4], [low, high, sub]);
        let number = i32::from_le_bytes(answer[4..8].try_into().unwrap());
        let unused = 8 * u32::from(answer[0] >> 2 & 3);
        number << unused >> unused
    }

    /// Expedited download of four bytes.
    fn download(&mut self, node: u16, index: u16, sub: u8, bytes: [u8; 4]) {
        let [low, high] = index.to_le_bytes();
        let [a, b, c, d] = bytes;
        self.send(0x600 + node, &[0x23, low, high, sub, a, b, c, d]);
        let answer = self.frame(0x580 + node);
        assert_eq!(answer[..4], [0x60, low, high, sub], "{answer:02x?}");
    }
}

#[test]
fn two_nodes_boot_and_report_who_they_are() {
    let server = start(&[]);
    let line = "serving 2 nodes (1, 2) at 250 kbit/s on socketcand 127.0.0.1:";
    assert!(server.ready.starts_with(line), "{}", server.ready);
    let mut client = Client::connect(at(&server));
    for node in [1, 2] {
        // With its first heartbeat the boot-up message of its start has gone by.
        let error_control = 0x700 + u16::from(node);
        while client.frame(error_control) == [0] {}
        // NMT "reset node"; a heartbeat may come before it is obeyed.
        client.send(0, &[0x81, node]);
        while client.frame(error_control) != [0] {}
    }
    assert_eq!([1, 2].map(|node| client.upload(node, 0x1018, 4)), [1, 2]);
    assert_ne!(client.upload(1, 0x1018, 2), client.upload(2, 0x1018, 2));
}

#[test]
fn time_begins_with_the_first_client_who_sees_both_boot_ups() {
    let server = start(&["--await-client"]);
    let mut client = Client::connect(at(&server));
    assert_eq!(client.frame(0x701), [0]);
}

#[test]
fn a_script_turns_the_instrument() {
    let folder = Folder::new();
    let script = folder.file("script", "rate 80\npitch 30\nroll -10\nhold\n");
    let server = start(&["--script", &script, "--speed", "20"]);
    let mut client = Client::connect(at(&server));
    // The resolution is 0.001 deg unless 6000h holds 10, 100 or 1000.
    let resolution = f64::from(client.upload(1, 0x6000, 0)) / 1000.0;
    let from = Instant::now();
    loop {
        // Words, so the sign is the sixteenth bit's; uncalibrated, so within three degrees.
        let [x, y] = [0x6010, 0x6020].map(|index| client.upload(1, index, 0) as i16);
        let [x, y] = [x, y].map(|n| f64::from(n) * resolution);
        if (x + 10.0).abs() < 3.0 && (y - 30.0).abs() < 3.0 {
            break;
        }
        assert!(from.elapsed() < SOON, "{x} {y}");
    }
}

#[test]
fn typed_words_move_break_and_end_it() {
    let mut server = start(&["--speed", "10"]);
    server.word("pitch 30");
    server.word("power b off");
    server.word("nonsense");
    server.word("+3 status");
    let line = server.prints("pitch 30.000 deg, roll 0.000 deg");
    assert!(line.contains("air 25.0 degC"), "{line}");
    server.prints("b   without power");
    server.word("quit");
    assert_eq!(ends_quietly(server), Some(0));
}

/// The same of one whose words have ended it.
fn ends_quietly(mut served: Served) -> Option<i32> {
    drop(served.child.stdin.take());
    ends(served)
}

#[cfg(unix)]
#[test]
fn an_interrupt_is_an_end_as_any_other() {
    let server = start(&[]);
    program::interrupt(&server.child);
    assert_eq!(ends(server), Some(0));
}

#[test]
fn a_closed_input_is_no_end() {
    let mut server = start(&[]);
    drop(server.child.stdin.take());
    let mut client = Client::connect(at(&server));
    assert_eq!(client.upload(1, 0x1018, 4), 1);
}

#[test]
fn what_was_stored_is_there_after_a_restart() {
    let folder = Folder::new();
    let state = folder.path("state");
    {
        let server = start(&["--state", &state, "--node-ids", "5,6"]);
        let mut client = Client::connect(at(&server));
        // LSS: switch node 6 (all four numbers of 1018h) to configuration, set 9, store.
        let identity = [1, 2, 3, 4].map(|sub| client.upload(6, 0x1018, sub));
        for (service, number) in (0x40..).zip(identity) {
            let [a, b, c, d] = number.to_le_bytes();
            client.send(0x7E5, &[service, a, b, c, d, 0, 0, 0]);
        }
        assert_eq!(client.frame(0x7E4)[0], 0x44);
        for command in [0x11, 0x17] {
            client.send(0x7E5, &[command, 9, 0, 0, 0, 0, 0, 0]);
            assert_eq!(client.frame(0x7E4)[..2], [command, 0]);
        }
        // A heartbeat time that is not the one as delivered for node 5, stored with "save".
        client.send(0x605, &[0x2B, 0x17, 0x10, 0, 50, 0, 0, 0]);
        assert_eq!(client.frame(0x585)[0], 0x60);
        client.download(5, 0x1010, 1, *b"save");
    }
    let server = start(&["--state", &state, "--node-ids", "5,6"]);
    assert!(server.ready.contains("2 nodes (5, 9)"), "{}", server.ready);
    let mut client = Client::connect(at(&server));
    assert_eq!(client.upload(9, 0x1018, 4), 2);
    assert_eq!(client.upload(5, 0x1017, 0), 50);
}

#[test]
fn a_damaged_record_is_named() {
    let folder = Folder::new();
    folder.file("a-lss", "nothing");
    let state = folder.path("");
    let said = refused(&served(&["--listen", "127.0.0.1:0", "--state", &state]));
    assert!(said.contains("a-lss is damaged: delete it"), "{said}");
}

#[test]
fn a_port_in_use_is_named_with_another_one() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = taken.local_addr().unwrap().to_string();
    let said = refused(&served(&["--listen", &at]));
    let port = at.rsplit_once(':').unwrap().1;
    assert!(
        said.contains(&format!("port {port} of 127.0.0.1 is in use")),
        "{said}"
    );
}

#[test]
fn an_unknown_word_is_found_before_anything_is_served() {
    let folder = Folder::new();
    let script = folder.file("script", "pitch 30\n\npich 20 # a slip\nhold\n");
    let output = served(&["--listen", "127.0.0.1:0", "--script", &script]);
    let said = refused(&output);
    assert!(
        said.contains("script line 3: there is no word \"pich\""),
        "{said}"
    );
    assert!(output.stdout.is_empty());
}

#[test]
fn a_script_without_a_word_was_served_before_the_complaint() {
    let folder = Folder::new();
    for text in ["", "\n\n", "# nothing yet\n"] {
        let script = folder.file("script", text);
        let output = served(&["--listen", "127.0.0.1:0", "--script", &script]);
        let said = refused(&output);
        assert!(said.contains("there is no word in the script"), "{said}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn a_script_that_ends_prints_so() {
    let folder = Folder::new();
    let script = folder.file("script", "pitch 10\nwait\nwait 1\n");
    let arguments = [
        "--listen",
        "127.0.0.1:0",
        "--uncalibrated",
        "--speed",
        "max",
    ];
    let output = command(&arguments)
        .args(["--script", &script])
        .output()
        .unwrap();
    let said = refused(&output);
    assert!(said.contains("has ended after 1.6 s"), "{said}");
    assert!(
        said.contains("`hold`") && said.contains("`repeat`"),
        "{said}"
    );
    assert!(output.stdout.starts_with(b"serving 2 nodes"));
}

#[test]
fn a_script_that_is_not_there_is_named() {
    let said = refused(&served(&["--script", "no-such-script"]));
    assert!(
        said.contains("cannot read the script no-such-script"),
        "{said}"
    );
}

#[test]
fn more_node_ids_than_nodes_are_refused() {
    let said = refused(&served(&["--node-ids", "1,2,3"]));
    assert!(said.contains("3 node-ids for 2 nodes"), "{said}");
}

#[test]
fn a_typed_fault_is_blamed_by_the_status_and_a_wrong_one_is_named() {
    let mut server = start(&["--speed", "10"]);
    let mut client = Client::connect(at(&server));
    client.send(0, &[1, 0]);
    server.word("fault b wobbly");
    server.word("fault b frozen");
    server.word("+5 s status");
    server.prints("the other channel is faulty (the sensor's codes stand still)");
    server.prints("this channel is faulty (the sensor's codes stand still)");
    server.prints("      broken: frozen");
}

#[test]
fn a_wrong_fault_in_a_script_is_named_with_what_is_possible() {
    let folder = Folder::new();
    for (line, told) in [
        (
            "fault b wobbly",
            "there is no fault \"wobbly\"; the faults are stuck, ",
        ),
        (
            "at 5 s fault a bias 10 mg",
            "write fault NODE bias AXIS MG (-2000 to 2000)",
        ),
    ] {
        let script = folder.file("script", line);
        let said = refused(&served(&["--listen", "127.0.0.1:0", "--script", &script]));
        assert!(
            said.contains("script line 1: ") && said.contains(told),
            "{said}"
        );
    }
}

#[test]
fn the_manual_of_the_command_line_and_the_page_list_every_word() {
    let output = served(&["--help"]);
    assert!(output.status.success());
    let told = String::from_utf8(output.stdout).unwrap();
    let (_, words) = told
        .split_once("Words, typed or in a script:\n")
        .expect("a list");
    assert!(words.contains("fault NODE sync-lost: "), "{words}");
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/serve.md");
    let page = std::fs::read_to_string(page).unwrap();
    for line in words.lines().map(str::trim_end) {
        assert!(page.contains(line), "docs/serve.md lacks: {line}");
    }
}

#[test]
fn where_the_bus_is_and_what_is_told_come_as_json() {
    let mut server = Command::new(env!("CARGO_BIN_EXE_plumb"))
        .args([
            "serve",
            "--listen",
            "127.0.0.1:0",
            "--uncalibrated",
            "--json",
        ])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut typed = server.stdin.take().unwrap();
    let lines = BufReader::new(server.stdout.take().unwrap()).lines();
    typed.write_all(b"status\nquit\n").unwrap();
    let said: Vec<serde_json::Value> = lines
        .map(|line| serde_json::from_str(&line.unwrap()).unwrap())
        .collect();
    assert!(server.wait().unwrap().success());
    assert_eq!(said[0]["format"], "plumb-serve");
    assert_eq!(said[0]["node_ids"], serde_json::json!([1, 2]));
    let at = said[0]["socketcand"].as_str().unwrap();
    assert!(at.starts_with("127.0.0.1:") && !at.ends_with(":0"), "{at}");
    assert_eq!(said[1]["format"], "plumb-serve-told");
    assert_eq!(said[1]["lines"].as_array().unwrap().len(), 3);
}
