//! Words that are typed while the instrument is served.
//!
//! In: the standard input. Out: its lines, as they come. When the input ends, as that of a service
//! does at once, there is nothing more and the bus goes on.

use std::io::BufRead as _;
use std::sync::mpsc::{Receiver, sync_channel};

use crate::error::ServeError;
use crate::threads::spawn;

/// Lines that may wait; a program that types more waits itself.
const LIMIT: usize = 64;

/// Reads the standard input from now on.
pub fn listen() -> Result<Receiver<String>, ServeError> {
    let (sender, lines) = sync_channel(LIMIT);
    spawn("typed", move || {
        // What is not UTF-8 becomes an unknown word, and is named as such.
        let read = std::io::stdin().lock().split(b'\n');
        for line in read.map_while(Result::ok) {
            let line = String::from_utf8_lossy(&line).into_owned();
            if sender.send(line).is_err() {
                return;
            }
        }
    })?;
    Ok(lines)
}
