//! How accurate units are over temperature that went through the shipped verbs on a bus.
//!
//! Each unit stands on `plumb serve` as it was soldered, goes through `plumb characterise` and
//! `plumb calibrate`, is switched off and on, and is then read at random angles from -10 to 70
//! degC. What moves and warms it are words of the bench, which are exact, so the errors are those
//! of the unit. docs/temperature.md carries the figures of many units; here one is held against
//! them.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use super::stand::{Bench, said};

/// Down to the cold end, up to the hot one and back: every temperature on both branches.
const PATH_C: [f64; 9] = [0.0, -10.0, 10.0, 30.0, 50.0, 70.0, 50.0, 30.0, 10.0];

/// Angles of each slope at each temperature.
const ANGLES: usize = 4;

/// Units of the page; their seeds are 1, 2, 3 and so on.
const UNITS: usize = 12;

/// Units that are on a bus at the same time.
const AT_ONCE: usize = 3;

/// The lines between which the page carries the figures.
const BEGIN: &str = "<!-- figures of units from the bus: begin -->";
const END: &str = "<!-- figures of units from the bus: end -->";

/// The whole bench so many times as fast as a real one: what is read here waits for samples, not
/// for a clock.
const SPEED: &str = "50";

/// A chamber and a housing so many times as fast as real ones, and 40 min in them, min.
const CHAMBER_SPEED: &str = "300";
const DWELL_MIN: &str = "0.13333";

/// A master that reads numbers.
struct Master {
    stream: TcpStream,
    text: String,
}

impl Master {
    fn join(bench: &Bench) -> Self {
        let mut stream = TcpStream::connect(&bench.bus).unwrap();
        write!(stream, "< open plumb >< rawmode >").unwrap();
        let patience = Some(Duration::from_millis(50));
        stream.set_read_timeout(patience).unwrap();
        let text = String::new();
        Self { stream, text }
    }

    /// Node 1 produces SYNC every 20 ms, and both nodes are OPERATIONAL.
    fn start(&mut self) {
        let period = "< send 601 8 23 6 10 0 20 4E 0 0 >";
        let producer = "< send 601 8 23 5 10 0 80 0 0 40 >";
        for frame in [period, producer, "< send 0 2 1 0 >"] {
            self.stream.write_all(frame.as_bytes()).unwrap();
            std::thread::sleep(Duration::from_millis(100));
        }
    }

    /// An object of a node, of four bytes at most.
    fn read(&mut self, node: u8, index: u16, sub: u8) -> u32 {
        let [low, high] = index.to_le_bytes();
        let [to, from] = [0x600, 0x580].map(|id| id + u16::from(node));
        let about = format!("{low:02X}{high:02X}{sub:02X}");
        let until = Instant::now() + Duration::from_secs(60);
        let mut asked = Instant::now() - Duration::from_secs(1);
        while Instant::now() < until {
            if asked.elapsed() > Duration::from_millis(500) {
                asked = Instant::now();
                let send = format!("< send {to:X} 8 40 {low:X} {high:X} {sub:X} 0 0 0 0 >");
                self.stream.write_all(send.as_bytes()).unwrap();
            }
            while let Some((frame, rest)) = self.text.split_once('>') {
                let words: Vec<_> = frame.split_whitespace().map(str::to_owned).collect();
                self.text = rest.to_owned();
                let data = words.last().cloned().unwrap_or_default();
                let id = words.iter().skip_while(|word| *word != "frame").nth(1);
                let answers = id.is_some_and(|id| *id == format!("{from:X}"));
                if answers && data.len() == 16 && data[2..8] == about {
                    let bytes = u32::from_str_radix(&data[8..], 16).unwrap();
                    return bytes.swap_bytes();
                }
            }
            let mut bytes = [0; 4096];
            if let Ok(count) = self.stream.read(&mut bytes) {
                self.text += &String::from_utf8_lossy(&bytes[..count]);
            }
        }
        panic!("node {node} does not answer {index:04X}h sub {sub}");
    }

    /// The node has taken so many samples more.
    fn settle(&mut self, node: u8, samples: u32) {
        let from = self.read(node, 0x2032, 0);
        while self.read(node, 0x2032, 0).wrapping_sub(from) < samples {}
    }

    /// Slope X or Y as measured, deg, and its standard uncertainty.
    fn slope(&mut self, node: u8, sub: u8) -> (f64, f64) {
        let quality = self.read(node, 0x2010, 2 + sub);
        assert!(quality >= 32, "node {node} has no angle: reason {quality}");
        let raw = (self.read(node, 0x2010, sub) << 8).cast_signed() >> 8;
        let u = f64::from(self.read(node, 0x2022, sub) & 0xFFFF) / 1000.0;
        (f64::from(raw) * 360.0 / 16_777_216.0, u)
    }
}

/// One reading: error and standard uncertainty, deg.
type Reading = (f64, f64);

/// Numbers from 0 to 1 that look like chance, the same for each seed.
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> f64 {
        // The constants of Knuth's MMIX.
        let next = self.0.wrapping_mul(6_364_136_223_846_793_005);
        self.0 = next.wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }
}

fn chamber(bench: &mut Bench, master: &mut Master, degc: f64) {
    bench.word(&format!("temp {degc}"));
    // The ramp, and ten of the housing's time constants.
    master.settle(1, 400 * (8 + 10));
}

/// Both nodes are switched off and on.
fn restart(bench: &mut Bench) {
    for word in ["power all off", "power all on", "rate 400"] {
        bench.word(word);
    }
    bench.pass(0.3);
}

/// Errors of both nodes along the path.
fn errors(bench: &mut Bench, seed: u64) -> Vec<Reading> {
    restart(bench);
    let mut master = Master::join(bench);
    let mut chance = Chance(seed);
    let mut all = Vec::new();
    for degc in PATH_C {
        chamber(bench, &mut master, degc);
        for (word, sub) in [("roll", 1), ("pitch", 2)] {
            for _ in 0..ANGLES {
                let deg = ((chance.next() * 180.0 - 90.0) * 1000.0).round() / 1000.0;
                bench.word(&format!("{word} {deg}"));
                // Three seconds for the way, and one for the filter.
                master.settle(1, 400 * 4);
                for node in [1, 2] {
                    let (read, u) = master.slope(node, sub);
                    all.push((read - deg, u));
                }
            }
            bench.word("level");
        }
    }
    all
}

fn rmse(errors: &[Reading]) -> f64 {
    let squares: f64 = errors.iter().map(|(error, _)| error * error).sum();
    (squares / errors.len() as f64).sqrt()
}

fn largest(errors: &[Reading]) -> f64 {
    errors
        .iter()
        .map(|(error, _)| error.abs())
        .fold(0.0, f64::max)
}

/// A bare unit on its bench.
fn unit(seed: u64) -> Bench {
    let seed = seed.to_string();
    let speed = [
        "--uncalibrated",
        "--chamber-speed",
        CHAMBER_SPEED,
        "--seed",
        &seed,
    ];
    Bench::new(SPEED, &speed)
}

/// Through a verb of the bench.
fn through(bench: &Bench, verb: &[&str]) {
    let out = bench.path(verb[0]);
    let run = bench
        .command(verb)
        .args(["--motor", &bench.motor, "--out", &out])
        .output();
    let (status, out, err) = said(&run.unwrap());
    assert_eq!(status, Some(0), "{out} {err}");
}

/// Through the chamber by the paper's profile, as many time constants long as there.
fn characterise(bench: &Bench, step: &str, runs: &str) {
    let chamber = ["characterise", "--chamber", &bench.chamber];
    let stairs = ["--step", step, "--dwell", DWELL_MIN, "--runs", runs];
    through(bench, &[&chamber[..], &stairs].concat());
}

#[test]
fn a_unit_that_was_characterised_and_calibrated_on_the_bus_keeps_its_angles_when_it_is_warm() {
    let mut bench = unit(3);
    through(&bench, &["calibrate", "--step", "15"]);
    let bare = errors(&mut bench, 1);
    // Calibrated at 25 degC and never in a chamber: what a unit without a model does when it is
    // warm.
    assert!(largest(&bare) > 0.3, "{}", largest(&bare));
    bench.word("level");
    // In any order: the calibration stays what it was at its own temperature.
    characterise(&bench, "20", "1");
    let with_model = errors(&mut bench, 1);
    assert!(largest(&with_model) < 0.25, "{}", largest(&with_model));
    // Half as many stairs and one run: not as good as the page's units, and not far from them.
    let (here, page) = (rmse(&with_model), of_the_page("RMSE of the median unit"));
    assert!((page / 2.0..page * 2.0).contains(&here), "{here} {page}");
}

#[test]
fn heat_alone_accused_a_channel_that_was_calibrated_far_from_it() {
    for (calibrated_at, away) in [(25.0, [60.0, -20.0]), (60.0, [-20.0, 25.0])] {
        let mut bench = unit(4);
        let mut master = Master::join(&bench);
        chamber(&mut bench, &mut master, calibrated_at);
        through(&bench, &["calibrate", "--step", "15"]);
        for degc in away {
            chamber(&mut bench, &mut master, degc);
            // Such a chamber is too fast for a thermometer to be believed.
            restart(&mut bench);
            master.start();
            for deg in [0, 60, -40] {
                bench.word(&format!("pitch {deg}"));
                master.settle(1, 400 * 4);
                for node in [1, 2] {
                    let (state, register) =
                        (master.read(node, 0x2021, 0), master.read(node, 0x1001, 0));
                    let about = format!("{calibrated_at} {degc} {deg} node {node}");
                    assert_eq!((state & 0xFF, register & 0xFF), (1, 0), "{about}");
                    let (read, u) = master.slope(node, 2);
                    assert!(
                        (read - f64::from(deg)).abs() < 3.0 * u,
                        "{about}: {read} {u}"
                    );
                }
            }
            bench.word("level");
        }
    }
}

/// A figure that the page carries, in its unit.
fn of_the_page(row: &str) -> f64 {
    let (_, _, section, _) = page();
    let (_, behind) = section.split_once(&format!("| {row} | ")).unwrap();
    behind.split_whitespace().next().unwrap().parse().unwrap()
}

#[test]
fn the_page_has_the_rows_that_its_generator_writes() {
    let names = |section: &str| -> Vec<String> {
        let name = |line: &str| Some(line.split('|').nth(1)?.trim().to_owned());
        section.lines().filter_map(name).collect()
    };
    let (_, _, carried, _) = page();
    let made = section(&[vec![(0.1, 0.1)]]);
    assert_eq!(names(&carried), names(&made));
    let readings = UNITS * PATH_C.len() * 2 * 2 * ANGLES;
    assert_eq!(of_the_page("units, two channels each"), UNITS as f64);
    assert_eq!(of_the_page("readings"), readings as f64);
}

/// The median of some numbers.
fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

/// Readings whose error is within 1.96 standard uncertainties.
fn covered(readings: &[Reading]) -> usize {
    let within = |(error, u): &&Reading| error.abs() <= 1.96 * u;
    readings.iter().filter(within).count()
}

/// That of the mean over all units of the share that is covered: readings of one unit share their
/// turn-on offsets and their model.
fn standard_error(units: &[Vec<Reading>]) -> f64 {
    let share = |unit: &Vec<Reading>| covered(unit) as f64 / unit.len() as f64;
    let shares: Vec<f64> = units.iter().map(share).collect();
    let count = shares.len() as f64;
    let mean = shares.iter().sum::<f64>() / count;
    let squares: f64 = shares.iter().map(|share| (share - mean).powi(2)).sum();
    (squares / count / (count - 1.0).max(1.0)).sqrt()
}

/// The figures of many units, as the page has them.
fn section(units: &[Vec<Reading>]) -> String {
    let all: Vec<Reading> = units.concat();
    let covered = covered(&all);
    let u_rms = (all.iter().map(|(_, u)| u * u).sum::<f64>() / all.len() as f64).sqrt();
    let worst = units.iter().map(|unit| largest(unit));
    let within = worst.clone().filter(|worst| *worst <= 0.2).count();
    let row = |what: &str, figure: String| format!("| {what} | {figure} |\n");
    let mut text = "\n| figure | obtained |\n|---|---|\n".to_owned();
    text += &row("units, two channels each", units.len().to_string());
    text += &row("readings", all.len().to_string());
    text += &row(
        "RMSE of the median unit",
        format!(
            "{:.4} deg",
            median(units.iter().map(|unit| rmse(unit)).collect())
        ),
    );
    text += &row(
        "RMSE of the worst unit",
        format!(
            "{:.4} deg",
            units.iter().map(|unit| rmse(unit)).fold(0.0, f64::max)
        ),
    );
    text += &row(
        "largest error of any unit",
        format!("{:.3} deg", worst.fold(0.0, f64::max)),
    );
    text += &row(
        "units always within 0.2 deg",
        format!("{within} of {}", units.len()),
    );
    let share = 100.0 * covered as f64 / all.len() as f64;
    text += &row("errors within 1.96 u (2022h)", format!("{share:.1} %"));
    text += &row(
        "standard error of this share, from unit to unit",
        format!("{:.1} %", 100.0 * standard_error(units)),
    );
    text += &row(
        "u over RMSE, all readings",
        format!("{:.2}", u_rms / rmse(&all)),
    );
    text + "\n"
}

/// The page, and where its section begins and ends.
fn page() -> (PathBuf, String, String, String) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/temperature.md");
    let text = fs::read_to_string(&path).unwrap();
    let (before, rest) = text.split_once(BEGIN).unwrap();
    let (section, behind) = rest.split_once(END).unwrap();
    let [before, section, behind] = [before, section, behind].map(str::to_owned);
    (path, before, section, behind)
}

/// One unit of the page, from bare to its errors.
fn of_page(seed: u64) -> Vec<Reading> {
    let mut bench = unit(seed);
    characterise(&bench, "10", "2");
    through(&bench, &["calibrate"]);
    let readings = errors(&mut bench, seed);
    let (all, most) = (rmse(&readings), largest(&readings));
    eprintln!("seed {seed}: {all:.4} {most:.3}");
    readings
}

fn write_page(units: &[Vec<Reading>]) {
    if units.is_empty() {
        return;
    }
    let (path, before, _, behind) = page();
    let section = section(units);
    fs::write(&path, format!("{before}{BEGIN}\n{section}{END}{behind}")).unwrap();
}

#[test]
#[ignore = "takes ten minutes; renews docs/temperature.md"]
fn the_figures_of_units_from_the_bus_are_written() {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(vec![None; UNITS]);
    let work = || {
        loop {
            let place = next.fetch_add(1, Ordering::Relaxed);
            if place >= UNITS {
                break;
            }
            let readings = of_page(place as u64 + 1);
            let mut done = done.lock().unwrap();
            done[place] = Some(readings);
            // The first ones without a gap; what takes so long is not lost when it is stopped.
            write_page(&done.iter().map_while(Clone::clone).collect::<Vec<_>>());
        }
    };
    std::thread::scope(|scope| {
        (0..AT_ONCE).for_each(|_| drop(scope.spawn(work)));
    });
}
