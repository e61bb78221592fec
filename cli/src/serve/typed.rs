//! Words that are typed while the instrument is served.
//!
//! In: the standard input. Out: its lines, as they come. When the input ends, as that of a service
//! does at once, there is nothing more and the bus goes on.

use std::io::BufRead as _;
use std::sync::mpsc::{Receiver, sync_channel};

use super::error::ServeError;
use super::hub::spawn;

/// Lines that may wait; a program that types more waits itself.
const LIMIT: usize = 64;

/// Reads the standard input from now on.
pub fn listen() -> Result<Receiver<String>, ServeError> {
    let (sender, lines) = sync_channel(LIMIT);
    spawn("typed", move || {
        let read = std::io::stdin().lock().lines();
        // Text that is not UTF-8 ends it like the end of the input.
        for line in read.map_while(Result::ok) {
            if sender.send(line).is_err() {
                return;
            }
        }
    })?;
    Ok(lines)
}
