//! What a view is shown on, with nobody who looks: a terminal, a browser; and what a view takes.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::thread;

/// User and system time that a process has taken, s.
pub fn cpu_s(child: &Child) -> f64 {
    let stat = fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap();
    // Behind the name, which may hold anything: fields 14 and 15, in ticks of 10 ms.
    let (_, fields) = stat.rsplit_once(')').unwrap();
    let fields: Vec<&str> = fields.split_whitespace().collect();
    let ticks = |field: usize| fields[field - 3].parse::<f64>().unwrap();
    (ticks(14) + ticks(15)) / 100.0
}

/// A terminal of 120 columns and 40 lines whose screen nobody keeps.
pub fn terminal(command: &mut Command) -> (Child, fs::File) {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap();
    let path = path.into_string().unwrap();
    let end = || {
        fs::OpenOptions::new()
            .read(true)
            .write(true)
            .open(&path)
            .unwrap()
    };
    let mut size = rustix::termios::tcgetwinsize(&master).unwrap();
    (size.ws_col, size.ws_row) = (120, 40);
    rustix::termios::tcsetwinsize(&master, size).unwrap();
    let child = command.stdin(end()).stdout(end()).stderr(end()).spawn();
    // Its ends of the terminal are kept by the command.
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    (child.unwrap(), fs::File::from(master))
}

/// Takes what a terminal gets, which nobody looks at.
pub fn drain(mut screen: fs::File) {
    thread::spawn(move || {
        let mut piece = [0; 1 << 16];
        while screen.read(&mut piece).is_ok_and(|length| length > 0) {}
    });
}

/// Reads the page's stream as a browser does.
pub fn browse(url: &str) {
    let at = url.strip_prefix("http://").unwrap().trim_end_matches('/');
    let mut stream = TcpStream::connect(at).unwrap();
    write!(stream, "GET /events HTTP/1.1\r\nHost: {at}\r\n\r\n").unwrap();
    thread::spawn(move || {
        let mut piece = [0; 1 << 16];
        while stream.read(&mut piece).is_ok_and(|length| length > 0) {}
    });
}
