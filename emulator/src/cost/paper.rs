//! What the paper's image costs on the paper's part.
//!
//! In: the paper's instrument. Out: [`PaperFigures`] of node A of a calibrated pair, and their
//! section of `docs/cost.md`.
//!
//! Left out: what a function takes; the product's figures tell of that.

use flash::layout::C8;
use sim::bench::{Mode, World};
use sim::network::hand::Pose;
use sim::network::instrument::Delivered;

use super::page::{Row, table};
use super::{CostError, SYNCS, command, hclk_hz, per_cent, span, stack, still, store, synced};
use crate::build::Paper;
use crate::pair::{Outfit, Pair};

/// The motor's run (2060h).
const MOTOR: u16 = 0x2060;

/// What was counted of the paper's image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperFigures {
    /// Flash of the bootloader, bytes.
    pub boot: u32,
    /// Flash of the application, bytes, its header left out.
    pub app: u32,
    /// RAM of the application's statics, bytes.
    pub statics: u32,
    /// The deepest stack of the two nodes, bytes.
    pub stack: u32,
    /// Instructions of a SYNC with what it brings: the PDOs of both nodes.
    pub sync: f64,
    /// Instructions of the longest interrupt, with and without SYNC.
    pub longest: u64,
    /// Load without and with 100 SYNCs a second, without the wait for SPI and the background, %.
    pub load: [f64; 2],
}

impl PaperFigures {
    /// Runs the paper's pair and counts.
    ///
    /// Errors: see [`CostError`].
    pub fn count(paper: &Paper) -> Result<Self, CostError> {
        let delivered = Delivered::calibrated(Mode::Paper, &World::NOMINAL, 1, 0);
        let delivered = delivered.map_err(CostError::Bench)?;
        let pieces = paper.pieces();
        let pair = Pair::delivered(&delivered, 1, Outfit::paper(&pieces));
        let mut pair = pair.map_err(CostError::Flash)?;
        pair.run(2.0);
        let app = &paper.app;
        let still = still(&mut pair, app)?;
        command(&mut pair, 0x01)?;
        synced(&mut pair, 10)?;
        let synced = span(&mut pair, app, |pair| synced(pair, SYNCS))?;
        store(&mut pair)?;
        memorise(&mut pair)?;
        let sample = still.own() / still.samples as f64;
        let hclk_hz = hclk_hz(&mut pair);
        Ok(Self {
            boot: paper.boot.flash(),
            app: app.flash(),
            statics: app.statics,
            stack: stack(&mut pair, app)?,
            sync: synced.each(sample, SYNCS),
            longest: still.longest().max(synced.longest()),
            load: [&still, &synced].map(|span| per_cent(span.own(), hclk_hz)),
        })
    }

    fn rows(&self) -> [Row; 6] {
        let ram = f64::from(self.statics + self.stack);
        let (boot, app) = (C8.boot.length, C8.a.length - flash::layout::HEADER);
        [
            Row::new(
                "flash of the paper's bootloader",
                self.boot.into(),
                Some(boot.into()),
            ),
            Row::new(
                "flash of the paper's application",
                self.app.into(),
                Some(app.into()),
            ),
            Row::new("RAM of its statics", self.statics.into(), None),
            Row::new("its deepest stack", self.stack.into(), None),
            Row::new("its statics and deepest stack", ram, Some(C8.ram.into())),
            Row::new(
                "instructions of a SYNC with its PDOs of it",
                self.sync,
                None,
            ),
        ]
    }

    /// The section of the page.
    pub fn section(&self) -> String {
        let [still, synced] = self.load;
        let load = [
            Row::new("longest interrupt of it", self.longest as f64, None),
            Row::per_cent("load of it without SYNC, % of 72 MHz", still, None),
            Row::per_cent("load of it with 100 SYNCs a second, %", synced, None),
        ];
        let rows: Vec<Row> = self.rows().into_iter().chain(load).collect();
        [TITLE, &table("Bytes or instructions", &rows), WHAT].concat()
    }
}

/// Before the table.
const TITLE: &str = "
## The paper's image

The paper's instrument on the paper's part, an STM32F103C8 with 64 kB of flash and 20 kB of RAM: two
calibrated nodes, as above.

";

/// What the figures are.
const WHAT: &str = "
- **Flash** of the application is its slot's without the header of 512 bytes. Two banks of records
  of 4 kB each, for calibration, temperature data and parameters, fill the part.
- **The deepest stack** is that after start, SYNC, a store of the parameters, and a calibration
  made by a run of the motor over the bus (2060h) and stored.
- **The longest interrupt** holds the check sum of the calibration in force, four times a second,
  which goes over both tables at once. Edges and frames are caught with their time meanwhile.
";

/// Where the motor stops, deg.
const STOPS_DEG: [i32; 5] = [-60, -30, 0, 30, 60];
/// How long the hand takes from a stop to the next, and stands there, s.
const STOP_S: f64 = 5.5;

/// Node A memorises a run of the motor about both axes and stores it, which is deeper in the stack
/// than measuring is.
fn memorise(pair: &mut Pair) -> Result<(), CostError> {
    for (axis, x, y) in [(1, 1.0, 0.0), (2, 0.0, 1.0)] {
        pair.write(1, (MOTOR, 1), 1, axis)?;
        for deg in STOPS_DEG {
            let at = f64::from(deg);
            put(pair, x * at, y * at);
            pair.write(1, (MOTOR, 2), 4, (deg * 1000) as u32)?;
        }
    }
    put(pair, 0.0, 0.0);
    pair.write(1, (MOTOR, 1), 1, 3)?;
    Ok(())
}

/// Puts the housing there and waits until it stands.
fn put(pair: &mut Pair, roll_deg: f64, pitch_deg: f64) {
    // A pose within the hand's reach is never refused.
    let _ = pair.hand.go(Pose {
        pitch_deg,
        roll_deg,
    });
    pair.run(STOP_S);
}
