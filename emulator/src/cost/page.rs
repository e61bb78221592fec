//! The page `docs/cost.md`.
//!
//! In: figures. Out: the page; and of a page that is there, its figures, and where they are not
//! those that were counted. Left out: counting.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::{Figures, Interrupt, shares};

/// The exceptions of the image, with what they do.
const NAMES: [(u32, &str); 6] = [
    (16 + 28, "TIM2: the edge's time"),
    (16 + 29, "TIM3: the device at work"),
    (16 + 19, "CAN: sent"),
    (16 + 20, "CAN: received"),
    (16 + 21, "CAN: asked by a master"),
    (16 + 22, "CAN: state"),
];

/// How far a committed figure may be from what is counted, as a part of it.
const APART: f64 = 0.05;

/// Before the tables.
const HEAD: &str = "# What the image costs

For those who need the time, flash and RAM that the firmware takes. This page is written by
`cargo run -p emulator --example cost -- --write`; the test `cost` of `emulator` counts again and
compares: every figure within 5 %, except those of the interrupts.

The images are exactly those that are flashed, built by `cargo xtask image` for the STM32F103RC and
run on the emulated chip: two calibrated nodes on a bus of 250 kbit/s with a host. Updates are
checked with the key of the simulated nodes, unless `PLUMB_KEY` names another. What is counted is
the node of channel A.

One instruction is one count. **These are no cycles**: on the chip many instructions take more than
one, and wait states of the flash are not counted at all. So the load here is less than that of a
board; [bring-up.md](bring-up.md) explains how to measure it there.
";

/// What the first table's figures are.
const INSTRUCTIONS: &str = "
- **A sample** is everything that interrupts execute while no host sends, divided by the samples:
  driver, chain, health checks, heartbeats and the timers between. The wait for SPI depends on the
  speed of that bus, so it is listed separately.
- **An SDO request** and **a SYNC** are counted in addition to the samples of that time. A SYNC
  includes the PDOs that the node sends and those that it receives from the other one.
- **The check of a new program** begins when an update starts one, here one as long as the
  application: the check sum of its body, that of its signature over 512 bits, and the curve of
  that, which is the same for any. It runs in the background, and everything else goes on.
- **The longest interrupt** is that of a download of this program and of its check. A sample is
  taken every 2.5 ms, which are 180 000 instructions.
- **The load** is that of a node in OPERATIONAL with 100 SYNCs a second.
- **Background** is the check sum of the running program, which takes what is left up to its own
  rate, and the idle loop.
";

/// Before the table of crates.
const CRATES: &str = "
By crate, what was built into its caller counted there; `others` are the library, copying, and code
that the compiler has put together. The count by function includes what the background takes of
functions that interrupts use too, which the last row takes off again.
`cargo xtask size --instructions` lists the functions, of a run of its own, so its sums differ a
little.

| Instructions | a sample | a SYNC |
|---|---:|---:|
";

/// Figures of the commit from which the work on cost began, in the order of [`Figures::now`].
const BEFORE: [(&str, f64); 8] = [
    ("a sample, without the wait for SPI", 2838.0),
    ("a SYNC with its PDOs, both nodes'", 33_364.0),
    ("the check of a new program", 24_009_077.0),
    ("load, % of 72 MHz", 6.3),
    ("flash of the application, bytes", 112_080.0),
    ("RAM of statics, bytes", 1776.0),
    ("deepest stack, bytes", 20_916.0),
    ("speed of the emulation, times real time", 5.6),
];

/// Before the table of then and now.
const THEN: &str = "
## Before and after

The figures of commit bd5be52, and those of this page.

| Figure | before | after |
|---|---:|---:|
";

/// What the chain's figures are.
const ALONE: &str = "
- **A sample** is the check for gaps and the low-pass of three axes, **a reading** all that follows:
  alignment in time, temperature, matrix, two slopes with their harmonics and uncertainties. The
  device makes a reading at each SYNC, and one where the last is 10 ms old: one for about four
  samples.
- **Floating point** is the same in 32 bits, by the library that the compiler brings along and
  `libm`, without checks for saturation or absence: [emulator/golden](../emulator/golden). Both run
  in one image on the same samples, counted by the core's counter, with the product's options.
- **Their angles** are compared at every reading; below 1000 is asserted by a test there.
";

/// What the second table's figures are.
const SIZES: &str = "
- **Flash** is from the first byte that is loaded to the last, of the linked files; the application
  is that for slot A, without its header of 512 bytes. The bootloader's region is filled to its end,
  where its seal stands ([design-decisions.md](design-decisions.md)).
- **Statics** are the sections of the linked file that are in RAM.
- **The deepest stack** is read off the paint that is left, on the worse of the two nodes, after
  start, SDO, SYNC, a store of the parameters, a calibration's download, a program's
  download and the check of its signature.
";

/// Why a sample takes more than its target.
const SAMPLE_MISSED: &str = "
The target for a sample is missed. A little more than half of what is counted is the sample's own
way: its edge, the driver, the checks of its health, the low-pass, and finding out what is due
before and after it. The rest happens every 10 ms, once in about four samples: a reading with its
uncertainties, the look for faults, the memory, and the bus. The image is optimised for
size. Optimising the chain's crate for speed instead takes a twentieth off and makes the image 4 kB
longer; with all our crates optimised for speed it does not fit into its slot.
`cargo xtask size --instructions` shows it function by function: it is spread over many, with no
one loop that is to blame.
";

/// Why a SYNC takes more than its target, and with it the load.
const SYNC_MISSED: &str = "
The targets for a SYNC and for the load are missed. A SYNC brings seven events: itself, three
frames that go out and three that the other node sends. Each of them takes its way from the
interrupt to the device and back; with the SYNC come a reading, and what TPDO 1 and the exchange
carry, and with the last frame of the other node the judgement of the pair.
";

/// Why the application takes more than its target.
const APP_MISSED: &str = "
The target for the application is missed: there are the whole object dictionary, the safety
functions, the update, the calibration over the bus, and the ladder that names the faulty channel.
The bus side alone takes most of 48 kB ([size.md](size.md)). So the images are for the part with
256 kB of flash.
";

/// What it means that RAM takes more than its target.
const RAM_MISSED: &str = "
The target for RAM is missed. The check of a signature is deepest, on top of the device itself,
which stands at the bottom of the stack. The part has 48 kB of RAM, so there is room, but a smaller
one of the family, with 20 kB, would be too small for it.
";

/// The row of the stack without what takes the most of it.
const UNCHECKED: &str = "the same before the check of a signature";

/// How fast all that is emulated.
fn speed(times: f64) -> String {
    format!(
        "\n## Speed of the emulation\n\n\
         Two emulated nodes with a SYNC every 10 ms ran at {times:.1} times real time on the \
         machine that wrote\nthis page, by the processor time that they took; 20 is the target. \
         This figure is not compared:\nit is another one on each machine.\n"
    )
}

/// A figure with its target.
pub struct Row {
    what: &'static str,
    value: f64,
    /// Digits behind the point.
    digits: usize,
    /// The most that it should be.
    target: Option<f64>,
}

impl Row {
    /// A figure without digits behind the point.
    pub const fn new(what: &'static str, value: f64, target: Option<f64>) -> Self {
        Self {
            what,
            value,
            digits: 0,
            target,
        }
    }

    /// A figure with one digit behind the point.
    pub const fn per_cent(what: &'static str, value: f64, target: Option<f64>) -> Self {
        Self {
            digits: 1,
            ..Self::new(what, value, target)
        }
    }

    /// Whether it is more than it should be.
    pub fn is_missed(&self) -> bool {
        self.target.is_some_and(|target| self.value > target)
    }

    /// What stands in the page.
    fn line(&self) -> String {
        let (what, digits) = (self.what, self.digits);
        let (target, met) = self.target.map_or(("-".into(), "-"), |target| {
            let met = if self.value <= target {
                "met"
            } else {
                "missed"
            };
            (format!("{target}"), met)
        });
        format!("| {what} | {:.digits$} | {target} | {met} |\n", self.value)
    }
}

impl Figures {
    fn instructions(&self) -> [Row; 9] {
        [
            Row::new(
                "a sample, without the wait for SPI",
                self.sample,
                Some(1500.0),
            ),
            Row::new("the wait for SPI in it", self.wait, None),
            Row::new("an SDO request of 4 bytes, with its answer", self.sdo, None),
            Row::new(
                "a SYNC with its PDOs, both nodes'",
                self.sync,
                Some(14_000.0),
            ),
            Row::new("the check of a new program", self.check, None),
            Row::new(
                "the longest interrupt meanwhile",
                self.longest,
                Some(180_000.0),
            ),
            Row::new("samples a second", self.rate, None),
            Row::per_cent("load, % of 72 MHz", self.load, Some(4.0)),
            Row::per_cent("load with the wait and the background, %", self.whole, None),
        ]
    }

    fn alone(&self) -> [Row; 5] {
        let [sample, float_sample] = self.chain.sample;
        let [reading, float_reading] = self.chain.reading;
        [
            Row::new("the chain's sample, by integers", sample, None),
            Row::new("the chain's sample, in floating point", float_sample, None),
            Row::new("the chain's reading, by integers", reading, None),
            Row::new(
                "the chain's reading, in floating point",
                float_reading,
                None,
            ),
            Row::new(
                "their angles are apart, 0.000001 deg",
                self.chain.apart,
                None,
            ),
        ]
    }

    fn sizes(&self) -> [Row; 6] {
        let ram = f64::from(self.statics + self.stack);
        [
            Row::new(
                "flash of the bootloader and the verifier",
                self.boot.into(),
                Some(20480.0),
            ),
            Row::new("flash of the application", self.app.into(), Some(65536.0)),
            Row::new("RAM of statics", self.statics.into(), None),
            Row::new("deepest stack", self.stack.into(), None),
            Row::new(UNCHECKED, self.unchecked_stack.into(), None),
            Row::new("statics and deepest stack", ram, Some(16384.0)),
        ]
    }

    /// What is now of [`BEFORE`].
    fn now(&self) -> [f64; 8] {
        [
            self.sample,
            self.sync,
            self.check,
            self.load,
            self.app.into(),
            self.statics.into(),
            self.stack.into(),
            self.speed,
        ]
    }

    /// The table of then and now.
    fn then(&self) -> String {
        let rows = BEFORE.iter().zip(self.now());
        let digits = |value: f64| usize::from(value < 100.0);
        let row = |((what, then), now): (&(&str, f64), f64)| {
            let digits = digits(*then);
            format!("| {what} | {then:.digits$} | {now:.digits$} |\n")
        };
        [THEN, &rows.map(row).collect::<String>()].concat()
    }

    /// Rows of the table of crates: a sample's and a SYNC's.
    fn crates(&self) -> Vec<(&'static str, [f64; 2])> {
        let [sample, sync] = self.shares.each_ref().map(shares::Share::crates);
        let rows = sample.into_iter().zip(sync);
        rows.map(|((name, sample), (_, sync))| (name, [sample, sync]))
            .collect()
    }

    /// The whole page.
    pub fn page(&self) -> String {
        let (work, sizes) = (self.instructions(), self.sizes());
        let why = |row: &Row, why: &'static str| if row.is_missed() { why } else { "" };
        let [sample, _, _, sync, ..] = &work;
        let [_, app, .., ram] = &sizes;
        [
            HEAD,
            "\n## Instructions\n\n",
            &table("Instructions", &work),
            INSTRUCTIONS,
            why(sample, SAMPLE_MISSED),
            why(sync, SYNC_MISSED),
            CRATES,
            &crates(&self.crates()),
            "\n",
            &interrupts(&self.interrupts),
            "\n## The chain alone\n\n",
            &table("Instructions", &self.alone()),
            ALONE,
            "\n## Flash and RAM\n\n",
            &table("Bytes", &sizes),
            SIZES,
            why(app, APP_MISSED),
            why(ram, RAM_MISSED),
            &self.dynamic.section(self),
            &self.paper.section(),
            &speed(self.speed),
            &self.then(),
        ]
        .concat()
    }
}

/// A table of figures.
pub fn table(unit: &str, rows: &[Row]) -> String {
    let rows: String = rows.iter().map(Row::line).collect();
    format!("| {unit} | counted | at most | target |\n|---|---:|---:|---|\n{rows}")
}

/// The table of interrupts.
fn interrupts(interrupts: &[Interrupt]) -> String {
    let mut text = String::from(
        "Interrupts with 100 SYNCs a second, the wait for SPI with them; their figures are \
         not compared:\n\n\
         | Interrupt | times a second | instructions each | the longest |\n|---|---:|---:|---:|\n",
    );
    for row in interrupts {
        let name = NAMES.iter().find(|(number, _)| *number == row.number);
        let name = name.map_or("another", |(_, name)| name);
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "| {name} | {:.0} | {} | {} |",
            row.rate, row.mean, row.most
        );
    }
    text
}

/// The rows of the table of crates.
fn crates(rows: &[(&str, [f64; 2])]) -> String {
    let row = |(name, [sample, sync]): &(&str, [f64; 2])| {
        // Rounded, so that there is no zero with a minus.
        let [sample, sync] = [sample, sync].map(|count| count.round() + 0.0);
        format!("| {name} | {sample} | {sync} |\n")
    };
    rows.iter().map(row).collect()
}

/// What a page has in its rows of two numbers, such as the table of crates, by name.
fn crates_of(page: &str) -> BTreeMap<String, [f64; 2]> {
    let row = |line: &str| {
        let line = line.strip_prefix("| ")?.strip_suffix(" |")?;
        let mut cells = line.split(" | ");
        let name = cells.next()?.to_owned();
        let mut number = || cells.next()?.parse().ok();
        Some((name, [number()?, number()?]))
    };
    page.lines().filter_map(row).collect()
}

/// Where the table of crates is not as it would be written now. A row may be 5 % apart, or 1 % of
/// all where that is more: of a few instructions, one is not worth another page.
fn crate_differences(committed: &str, counted: &Figures) -> Vec<String> {
    let old = crates_of(committed);
    let wholes = counted.shares.each_ref().map(|share| share.whole);
    let mut found = Vec::new();
    for (name, now) in counted.crates() {
        let was = old.get(name).copied().unwrap_or([f64::NAN; 2]);
        let are_apart = (was.iter().zip(now).zip(wholes)).any(|((was, now), whole)| {
            let let_be = (APART * now.abs()).max(whole / 100.0);
            was.is_nan() || (was - now).abs() > let_be
        });
        if are_apart {
            found.push(format!("{name}: {was:.0?} in the page, {now:.0?} counted"));
        }
    }
    found
}

/// The figures of a page: of rows whose third cell is a target or a dash.
fn rows(page: &str) -> BTreeMap<String, f64> {
    let row = |line: &str| {
        let line = line.strip_prefix("| ")?.strip_suffix(" |")?;
        let cells: Vec<_> = line.split(" | ").collect();
        let [what, value, _, "met" | "missed" | "-"] = cells.as_slice() else {
            return None;
        };
        Some(((*what).to_owned(), value.parse().ok()?))
    };
    page.lines().filter_map(row).collect()
}

/// Where a committed page is not as it would be written now, a sentence for each figure. Figures
/// may be 5 % apart, whether a target is met may not.
pub fn differences(committed: &str, counted: &Figures) -> Vec<String> {
    let page = counted.page();
    let (old, new) = (rows(committed), rows(&page));
    let mut found = Vec::new();
    for (what, now) in &new {
        match old.get(what) {
            None => found.push(format!("{what}: not in the page, {now} counted")),
            Some(was) if (was - now).abs() > APART * now.abs() => {
                found.push(format!("{what}: {was} in the page, {now} counted"));
            }
            Some(_) => {}
        }
    }
    let gone = old.keys().filter(|what| !new.contains_key(*what));
    found.extend(gone.map(|what| format!("{what}: in the page, but not counted")));
    found.extend(crate_differences(committed, counted));
    if found.is_empty() && words(committed) != words(&page) {
        found.push("the words of the page are not those that would be written".into());
    }
    found
}

/// A page without its numbers.
fn words(page: &str) -> String {
    page.chars()
        .filter(|c| !c.is_ascii_digit() && *c != '.')
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cost::{Chain, DynamicFigures, PaperFigures, Share};

    fn figures() -> Figures {
        Figures {
            sample: 1480.0,
            wait: 1500.0,
            sdo: 8000.0,
            sync: 30_000.0,
            check: 20_000_000.0,
            longest: 30_000.0,
            rate: 400.0,
            load: 7.5,
            whole: 9.7,
            boot: 3500,
            app: 100_000,
            statics: 18_000,
            stack: 17_000,
            unchecked_stack: 15_000,
            interrupts: vec![Interrupt {
                number: 16 + 29,
                rate: 1000.0,
                mean: 4000,
                most: 40_000,
            }],
            chain: Chain {
                sample: [300.0, 3000.0],
                reading: [2000.0, 9000.0],
                apart: 200.0,
            },
            speed: 9.5,
            dynamic: DynamicFigures {
                sample: 2400.0,
                estimator: 1100.0,
                joint: 400.0,
                wait: 2500.0,
                sync: 31_000.0,
                rate: 417.0,
                load: 8.0,
                app: 95_000,
                statics: 1300,
                stack: 14_000,
            },
            paper: PaperFigures {
                boot: 2000,
                app: 54_000,
                statics: 1200,
                stack: 15_000,
                sync: 16_000.0,
                longest: 100_000,
                load: [1.3, 3.5],
            },
            shares: [1480.0, 30_000.0].map(|whole| Share {
                whole,
                functions: vec![("tilt::step".into(), 0.75 * whole)],
            }),
        }
    }

    #[test]
    fn the_table_of_crates_is_compared() {
        let page = figures().page();
        assert!(page.contains("| tilt | 1110 | 22500 |"), "{page}");
        let with = |part: f64| {
            let mut figures = figures();
            figures.shares[1].functions[0].1 *= part;
            differences(&page, &figures)
        };
        assert_eq!(with(1.01), [""; 0]);
        let told = with(1.06);
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(
            told[0].starts_with("tilt: [1110, 22500] in the page"),
            "{told:?}"
        );
    }

    #[test]
    fn then_and_now_stand_side_by_side() {
        let page = figures().page();
        for row in [
            "| a sample, without the wait for SPI | 2838 | 1480 |",
            "| load, % of 72 MHz | 6.3 | 7.5 |",
            "| deepest stack, bytes | 20916 | 17000 |",
        ] {
            assert!(page.contains(row), "{row}");
        }
    }

    #[test]
    fn a_page_is_what_its_own_figures_write() {
        let page = figures().page();
        assert_eq!(differences(&page, &figures()), [""; 0]);
        let rows = rows(&page);
        assert_eq!(rows.len(), 39);
        assert_eq!(
            rows.get("a sample, without the wait for SPI"),
            Some(&1480.0)
        );
        assert_eq!(rows.get("load, % of 72 MHz"), Some(&7.5));
        assert_eq!(rows.get("statics and deepest stack"), Some(&35_000.0));
    }

    #[test]
    fn four_per_cent_are_accepted_and_six_are_reported() {
        let page = figures().page();
        let with = |sdo| Figures { sdo, ..figures() };
        assert_eq!(differences(&page, &with(8320.0)), [""; 0]);
        for apart in [8480.0, 7520.0] {
            let told = differences(&page, &with(apart));
            let sdo = "an SDO request of 4 bytes, with its answer";
            assert_eq!(told, [format!("{sdo}: 8000 in the page, {apart} counted")]);
        }
    }

    #[test]
    fn every_figure_that_grows_is_reported() {
        let page = figures().page();
        let grown = Figures {
            sample: 2000.0,
            wait: 2000.0,
            sdo: 9000.0,
            sync: 40_000.0,
            check: 25_000_000.0,
            longest: 40_000.0,
            rate: 500.0,
            load: 9.0,
            whole: 12.0,
            boot: 4000,
            app: 120_000,
            statics: 20_000,
            stack: 20_000,
            unchecked_stack: 18_000,
            chain: Chain {
                sample: [400.0, 4000.0],
                reading: [3000.0, 10_000.0],
                apart: 300.0,
            },
            dynamic: DynamicFigures {
                sample: 3000.0,
                estimator: 1300.0,
                joint: 500.0,
                wait: 3000.0,
                sync: 34_000.0,
                rate: 500.0,
                load: 9.0,
                app: 105_000,
                statics: 1500,
                stack: 18_000,
            },
            paper: PaperFigures {
                boot: 2200,
                app: 58_000,
                statics: 1300,
                stack: 16_000,
                sync: 17_000.0,
                longest: 110_000,
                load: [1.5, 3.8],
            },
            ..figures()
        };
        assert_eq!(differences(&page, &grown).len(), 39);
    }

    #[test]
    fn a_target_missed_by_little_is_reported() {
        let page = figures().page();
        let missed = Figures {
            sample: 1510.0,
            ..figures()
        };
        assert_eq!(differences(&page, &missed).len(), 1);
    }

    #[test]
    fn what_is_missed_has_its_reason_and_what_is_met_has_none() {
        let page = figures().page();
        assert!(!page.contains(SAMPLE_MISSED));
        assert!(page.contains(APP_MISSED) && page.contains(RAM_MISSED));
        let small = Figures {
            sample: 1501.0,
            app: 49_152,
            stack: 0,
            statics: 16_384,
            ..figures()
        };
        let page = small.page();
        assert!(page.contains(SAMPLE_MISSED));
        assert!(!page.contains(APP_MISSED) && !page.contains(RAM_MISSED));
    }

    #[test]
    fn rows_that_only_one_has_are_reported() {
        let page = figures().page();
        let other = page.replace("| deepest stack |", "| highest heap |");
        let told = differences(&other, &figures());
        assert_eq!(
            told,
            [
                "deepest stack: not in the page, 17000 counted",
                "highest heap: in the page, but not counted"
            ]
        );
        assert_eq!(differences("", &figures()).len(), 39 + 7);
    }
}
