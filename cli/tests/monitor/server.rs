//! A socketcand server without an instrument.

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// What a server made here does on its bus.
#[derive(Clone, Copy)]
pub enum Serving {
    /// Nothing ever comes.
    Silent,
    /// A SYNC and a pair's answers, so many frames a second.
    Frames(u32),
}

/// A socketcand server with nobody behind it.
pub struct Server {
    pub at: String,
    pub stop: Arc<AtomicBool>,
    pub thread: JoinHandle<String>,
}

impl Server {
    pub fn start(serving: Serving) -> Self {
        Self::start_at("127.0.0.1:0", serving)
    }

    pub fn start_at(at: &str, serving: Serving) -> Self {
        let listener = TcpListener::bind(at).unwrap();
        let at = listener.local_addr().unwrap().to_string();
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let (stream, _) = listener.accept().unwrap();
            drop(listener);
            serve(stream, serving, &stopped)
        });
        Self { at, stop, thread }
    }

    /// Ends it; what it has heard.
    pub fn end(self) -> String {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}

pub fn serve(mut stream: TcpStream, serving: Serving, stop: &AtomicBool) -> String {
    stream.set_nodelay(true).unwrap();
    stream.write_all(b"< hi >").unwrap();
    let mut heard = String::new();
    let mut piece = [0; 256];
    for count in 1..=2 {
        while heard.matches('>').count() < count {
            let length = stream.read(&mut piece).unwrap();
            heard += str::from_utf8(&piece[..length]).unwrap();
        }
        stream.write_all(b"< ok >").unwrap();
    }
    stream
        .set_read_timeout(Some(Duration::from_millis(1)))
        .unwrap();
    let from = Instant::now();
    let mut sent = 0_u32;
    while !stop.load(Ordering::Relaxed) {
        if let Serving::Frames(per_second) = serving {
            while f64::from(sent) < from.elapsed().as_secs_f64() * f64::from(per_second) {
                if stream.write_all(frame(sent).as_bytes()).is_err() {
                    return heard;
                }
                sent += 1;
            }
        }
        match stream.read(&mut piece) {
            Ok(0) => break,
            Ok(length) => heard += str::from_utf8(&piece[..length]).unwrap(),
            Err(_) => {}
        }
    }
    heard
}

/// Of a pair at its highest rate: SYNC, and TPDO 1, 3 and 4 of both, now and then the others.
pub fn frame(number: u32) -> String {
    let turn = number / 8;
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let time = format!("{:.6}", since.unwrap().as_secs_f64());
    let (id, data) = match (number % 8, turn % 10) {
        (0, _) => ("080", String::new()),
        (1, _) => ("181", format!("{:02X}0300007F01", turn % 256)),
        (2, _) => ("182", format!("{:02X}0300007F01", turn % 256)),
        (3, _) => ("381", "AAFFFF91FBFF6F6F".to_owned()),
        (4, _) => ("382", "AAFFFF91FBFF6F6F".to_owned()),
        (5, _) => ("481", "0100020003000405".to_owned()),
        (6, _) => ("482", "0100020003000405".to_owned()),
        (_, 0) => ("281", "7F011E0019140019".to_owned()),
        (_, 1) => ("282", "7F011E0019140019".to_owned()),
        (_, 2) => ("701", "05".to_owned()),
        (_, 3) => ("702", "05".to_owned()),
        (..) => ("18FF0001", "00".to_owned()),
    };
    format!("< frame {id} {time} {data} >")
}
