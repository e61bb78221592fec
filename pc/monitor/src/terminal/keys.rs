//! Keys, read in a thread of their own.
//!
//! In: the terminal. Out: its events, one after another. Of a terminal that is closed the reading
//! below may never come back; whoever waits here has nothing to fear from it, and the thread ends
//! with the program.
//!
//! Left out: what a key does.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread;
use std::time::Duration;

use ratatui::crossterm::event::{self, Event};

/// How often it is looked whether anybody waits for keys.
const GLANCE: Duration = Duration::from_millis(100);

/// Keys that are pressed faster than this many are drawn wait in the terminal.
const WAITING: usize = 64;

/// The keys of the terminal.
pub struct Keys {
    events: Receiver<io::Result<Event>>,
    stop: Arc<AtomicBool>,
}

impl Keys {
    /// Begins to read them.
    pub fn read() -> Self {
        let (sender, events) = sync_channel(WAITING);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        thread::spawn(move || read(&sender, &stopped));
        Self { events, stop }
    }

    /// The next event, or none in this time.
    ///
    /// Errors: what the terminal reports.
    pub fn next(&self, wait: Duration) -> io::Result<Option<Event>> {
        match self.events.recv_timeout(wait) {
            Ok(event) => event.map(Some),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

fn read(events: &SyncSender<io::Result<Event>>, stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        let event = match event::poll(GLANCE) {
            Ok(false) => continue,
            Ok(true) => event::read(),
            Err(error) => Err(error),
        };
        let is_last = event.is_err();
        if events.send(event).is_err() || is_last {
            return;
        }
    }
}
