//! A motor that turns one axis only while the other one is at 0, in front of the virtual one.
//!
//! In: where the virtual motor is. Out: where this one is. What it refuses it answers by an error.
//!
//! Left out: everything else, which passes as it is.

use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};

/// Its URL, once it listens.
pub fn careful_motor(url: &str) -> String {
    let behind = url.trim_start_matches("tcp://").to_owned();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming().map_while(Result::ok) {
            // One client after the other, each until it leaves.
            let _ = serve(stream, TcpStream::connect(&behind).unwrap());
        }
    });
    format!("tcp://{at}")
}

fn serve(client: TcpStream, mut motor: TcpStream) -> std::io::Result<()> {
    let mut out = client.try_clone()?;
    let mut answers = BufReader::new(motor.try_clone()?).lines();
    // PITCH and ROLL as they were sent, deg.
    let mut stands = [0.0; 2];
    let mut refused = false;
    for line in BufReader::new(client).lines() {
        let line = line?;
        if let Some((axis, deg)) = line.strip_prefix("POS:").and_then(|l| l.split_once(' ')) {
            let (axis, deg) = (usize::from(axis == "ROLL"), deg.parse().unwrap());
            refused = deg != 0.0 && stands[1 - axis] != 0.0;
            if refused {
                continue;
            }
            stands[axis] = deg;
        }
        if line == "SYST:ERR?" && std::mem::take(&mut refused) {
            writeln!(out, "-221,\"Settings conflict\"")?;
            continue;
        }
        writeln!(motor, "{line}")?;
        if line.ends_with('?') {
            let answer = answers.next().transpose()?.unwrap_or_default();
            writeln!(out, "{answer}")?;
        }
    }
    Ok(())
}
