//! A new program for both nodes over the bus, by `plumb update`, with the exact image on boards.
//!
//! In: the product's image once more, with a higher version, signed. Out: both nodes run it, one
//! after the other, and have confirmed it themselves; what it may not be is refused.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use emulator::build::Product;
use flash::layout::{HEADER, Slot};

/// Two emulated nodes on a bus; ended when dropped.
struct Served {
    child: Child,
    address: String,
}

impl Served {
    fn start() -> Self {
        let mut child = Command::new(env!("CARGO_BIN_EXE_emulate"))
            .args(["serve", "--listen", "127.0.0.1:0"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("the emulator starts");
        let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
        let ready = lines
            .map_while(Result::ok)
            .find(|line| line.starts_with("serving "));
        let ready = ready.expect("it prints where it serves");
        let address = ready.rsplit(' ').next().expect("an address").to_string();
        Self { child, address }
    }

    /// The time of the newest frame on the bus, s, of which there is none in the beginning. A
    /// machine that is slow makes no second of the bus longer.
    fn clock(&self) -> Arc<Mutex<Option<f64>>> {
        let mut bus = TcpStream::connect(&self.address).expect("it serves");
        bus.write_all(b"< open plumb >< rawmode >")
            .expect("it reads");
        let now = Arc::new(Mutex::new(None));
        let newest = Arc::clone(&now);
        std::thread::spawn(move || {
            let (mut text, mut bytes) = (String::new(), [0; 4096]);
            while let Ok(count @ 1..) = bus.read(&mut bytes) {
                text += &String::from_utf8_lossy(&bytes[..count]);
                while let Some((frame, rest)) = text.split_once('>') {
                    let words: Vec<_> = frame.split_whitespace().collect();
                    if let ["<", "frame", _, at_s, ..] = words[..] {
                        *newest.lock().expect("whole") = at_s.parse().ok();
                    }
                    text = rest.to_owned();
                }
            }
        });
        now
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The program `plumb` beside the emulator's, built if it isn't there yet.
fn plumb(arguments: &[&str]) -> Output {
    let emulate = Path::new(env!("CARGO_BIN_EXE_emulate"));
    let name = format!("plumb{}", std::env::consts::EXE_SUFFIX);
    let program = emulate.with_file_name(name);
    if !program.exists() {
        let mut cargo = Command::new(env!("CARGO"));
        let folder = emulate.ancestors().nth(2).expect("the target folder");
        cargo.args(["build", "--quiet", "--package", "plumb", "--target-dir"]);
        assert!(cargo.arg(folder).status().expect("cargo").success());
    }
    Command::new(program)
        .args(arguments)
        .output()
        .expect("plumb starts")
}

/// The file of an update: the product's own bodies with another version.
fn file(folder: &Path, version: &str, more: &[&str]) -> PathBuf {
    let product = Product::build().expect("the image builds");
    let bodies = [("a", Slot::A), ("b", Slot::B)].map(|(name, slot)| {
        let path = folder.join(format!("body-{name}"));
        fs::write(&path, &product.update(slot)[HEADER as usize..]).expect("written");
        path
    });
    let file = folder.join(format!("{version}.img"));
    let [a, b] = bodies.map(|path| path.display().to_string());
    let name = file.display().to_string();
    let mut words = vec![
        "image",
        &name,
        "--force",
        "--version",
        version,
        "--a",
        &a,
        "--b",
        &b,
    ];
    words.extend(more);
    let made = plumb(&words);
    assert!(made.status.success(), "{made:?}");
    file
}

#[test]
fn both_nodes_take_a_signed_program_and_refuse_an_unsigned_one() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let [new, unsigned] = [
        file(&folder, "0.1.1", &[]),
        file(&folder, "0.1.2", &["--unsigned"]),
    ];
    let served = Served::start();
    let update = |file: &Path| {
        let file = file.display().to_string();
        plumb(&["update", &file, "--bus", &served.address])
    };
    // The first angle takes half a second, and nothing is begun without one.
    let clock = served.clock();
    let now_s = || *clock.lock().expect("whole");
    while now_s().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let started = Instant::now();
    let (begun, done) = loop {
        let begun = now_s();
        let done = update(&new);
        let early = String::from_utf8_lossy(&done.stderr).contains("no valid angle");
        if !early || started.elapsed().as_secs() > 120 {
            break (begun, done);
        }
    };
    let said = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(done.status.success(), "{done:?}");
    for node in [1, 2] {
        assert!(
            said.contains(&format!("node {node} runs 0.1.1 now")),
            "{said}"
        );
    }
    // A block of SDO carries 7 bytes in a frame of 131 bits at most, at 250 kbit/s.
    let length = fs::metadata(&new).expect("there").len() as f64;
    let on_the_bus = length / 7.0 * 131.0 / 250_000.0;
    let begun_s = begun.expect("a frame before the update");
    let times = (now_s().expect("a frame") - begun_s) / on_the_bus;
    eprintln!("both nodes updated in {times:.2} times the time on the bus");
    assert!(times < 3.0, "{times}");
    let refused = update(&unsigned);
    assert!(!refused.status.success(), "{refused:?}");
    let again = update(&new);
    let said = String::from_utf8_lossy(&again.stdout).into_owned();
    assert!(said.contains("node 1 runs 0.1.1 already"), "{again:?}");
}
