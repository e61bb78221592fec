//! The section of `docs/faults.md`, as Markdown.
//!
//! In: what was measured and judged. Out: the section, with every figure in it taken from there.

use std::fmt::{self, Formatter};

use instant::Instant;
use sim::fault::SensorFault::{self, *};
use tilt::chain::Chain;

use super::super::prepare::Prepared;
use super::board::{self, Board, PAIR_US};
use super::trials::{Healthy, Plan, Tally, healthy, trials};
use super::tuned::{Tuned, product, tuned};

/// Moments of injection in each part of the recording.
const MOMENTS: usize = 60;

/// Pairs in a second.
const PER_S: usize = (1_000_000 / PAIR_US) as usize;

/// How long a trial is watched, s: two or three poses.
const WATCHED_S: usize = 60;

/// How long a trial in vigorous motion is watched, s.
const SHAKEN_S: usize = 6;

/// A fault on this axis, up (1) or down (-1).
type Make = fn(usize, f64) -> Option<SensorFault>;

/// What is injected while the board is laid from pose to pose.
#[rustfmt::skip]
const KINDS: [(&str, Make); 20] = [
    ("none", |_, _| None),
    ("bias step 5 mg", |axis, s| Some(Bias { axis, mg: 5.0 * s })),
    ("bias step 10 mg", |axis, s| Some(Bias { axis, mg: 10.0 * s })),
    ("bias step 20 mg", |axis, s| Some(Bias { axis, mg: 20.0 * s })),
    ("bias step 50 mg", |axis, s| Some(Bias { axis, mg: 50.0 * s })),
    ("drift 0.2 mg/s", |axis, s| Some(Drift { axis, mg_per_s: 0.2 * s })),
    ("drift 2 mg/s", |axis, s| Some(Drift { axis, mg_per_s: 2.0 * s })),
    ("gain -2 %", |axis, _| Some(Gain { axis, ratio: -0.02 })),
    ("stuck, one axis", |axis, _| Some(Stuck { axis: Some(axis) })),
    ("stuck, all", |_, _| Some(Stuck { axis: None })),
    ("noise x3", |_, _| Some(Noise { factor: 3.0 })),
    ("noise x10", |_, _| Some(Noise { factor: 10.0 })),
    ("spikes 200 mg", |_, _| Some(Spikes { g: 0.2, per_s: 1.0 })),
    ("delay 50 ms", |_, _| Some(Late { s: 0.05 })),
    ("delay 200 ms", |_, _| Some(Late { s: 0.2 })),
    ("sample loss 10 %", |_, _| Some(SampleLoss { share: 0.1 })),
    ("sample loss 50 %", |_, _| Some(SampleLoss { share: 0.5 })),
    ("brown-out", |_, _| Some(BrownOut { s: 0.05 })),
    ("sag", |_, _| Some(Sag)),
    ("swapped axes", |_, _| Some(SwappedAxes)),
];

/// Everything in the section.
pub struct Section {
    /// The check and what it was made from.
    pub tuned: Tuned,
    /// The healthy pair by the product's own thresholds.
    pub by_product: Healthy,
    /// The healthy pair by the scaled ones.
    pub healthy: Healthy,
    /// Lying still at the moment of injection.
    pub still: Vec<(&'static str, Tally)>,
    /// Shaken.
    pub shaken: Vec<(&'static str, Tally)>,
    /// Noise of a single sample of one axis, of either part, mg.
    noise_mg: [f64; 2],
    /// Difference of the healthy pair while shaken, root mean square, mg.
    shaken_mg: f64,
}

/// Moments at equal distances among the candidates.
fn spread(among: &[usize]) -> impl Iterator<Item = usize> {
    (0..MOMENTS).filter_map(|k| {
        among
            .get((2 * k + 1) * among.len() / (2 * MOMENTS))
            .copied()
    })
}

/// The pairs before which channels are kept, and the first of the vigorous motion.
fn moments(prepared: &[Prepared; 2]) -> (Vec<usize>, usize) {
    let stills = board::stills(prepared);
    let (from_us, to_us) = board::longest_gap(&stills, board::count(prepared));
    let [begin, end] = [from_us, to_us].map(|us| (us / PAIR_US) as usize);
    let lies = |index: usize| board::lies(&stills, Instant(index as u64 * PAIR_US));
    // Ten seconds to learn the baseline in, a second to see a sudden fault in.
    let still: Vec<usize> = (10 * PER_S..begin)
        .filter(|index| lies(*index) && lies(index + PER_S))
        .collect();
    let last = end.saturating_sub((SHAKEN_S + 1) * PER_S);
    let shaken: Vec<usize> = (begin + PER_S..last).collect();
    (spread(&still).chain(spread(&shaken)).collect(), begin)
}

impl Section {
    /// Plays both channels, healthy and with every fault at every moment.
    pub fn of(prepared: &[Prepared; 2], chains: &[Chain; 2]) -> Self {
        let (keep, begin) = moments(prepared);
        let board = Board::play(prepared, chains, |index| keep.contains(&index));
        let tuned = tuned(&board.pairs[..board.pairs.len() / 3]);
        let healthy = |check| healthy(&board, check);
        let [by_product, healthy] = [healthy(&product()), healthy(&tuned.check)];
        let run = |plan: Plan| {
            let one = |(name, make): &(&'static str, Make)| {
                (*name, trials(&board, &tuned.check, &healthy, plan, make))
            };
            KINDS.iter().map(one).collect()
        };
        let still = run(Plan {
            from: 0,
            to: begin,
            watched: WATCHED_S * PER_S,
            still: true,
        });
        let shaken = run(Plan {
            from: begin,
            to: board.pairs.len(),
            watched: SHAKEN_S * PER_S,
            still: false,
        });
        let noise = |chain: &Chain| f64::from(chain.calibration.budget.noise);
        Self {
            by_product,
            still,
            shaken,
            noise_mg: chains
                .each_ref()
                .map(|chain| super::tuned::mg(noise(chain))),
            shaken_mg: super::tuned::rms_mg(board.shaken()),
            healthy,
            tuned,
        }
    }

    /// The tally of one kind of fault while the board lies still.
    pub fn of_still(&self, name: &str) -> Option<&Tally> {
        let mut rows = self.still.iter();
        rows.find(|row| row.0 == name).map(|row| &row.1)
    }

    fn about(&self, f: &mut Formatter) -> fmt::Result {
        let [one, other] = self.noise_mg;
        writeln!(
            f,
            "\
Two of the parts on one real board (`mimu4444`, see `recordings.md`), turned by hand through 21
poses and then shaken for a minute and a half. Each channel is calibrated from its own poses and
runs through the product's chain at its own 62.5 samples/s, with a pair every 20 ms. Faults are put
onto the counts of one channel: 1 and 2, x, y and z, up and down in turn. The other channel stays
as recorded. Each fault has {MOMENTS} moments at equal distances.

A sample of one axis has {one:.1} mg of noise in channel 1 and {other:.1} mg in channel 2, which is
eight times the noise density of the instrument's part. There is no register to read back and no
data-ready line, so a brown-out shows by its silence alone; and no thermometer.
"
        )
    }

    fn thresholds(&self, f: &mut Formatter) -> fmt::Result {
        let (vague, named) = (self.tuned.uncertainty_mg, 4.0 * self.tuned.uncertainty_mg);
        writeln!(
            f,
            "\
### What was changed for these parts

Thresholds follow the healthy pair lying still in the first third of the recording: four times the
root mean square, or twice the median for the gate of a standstill, and never below the product's.
The other two thirds were not used. A finding is reset after one second in order, because a
recording has no reset. Everything else is as delivered.

| number | product | healthy pair | here |
|---|---|---|---|"
        )?;
        for changed in &self.tuned.changed {
            let unit = changed.unit;
            writeln!(
                f,
                "| {} | {:.2} {unit} | {:.2} {unit} | {:.2} {unit} |",
                changed.what, changed.product, changed.healthy, changed.here
            )?;
        }
        writeln!(
            f,
            "
The combined uncertainty of the pair is {vague:.1} mg, nearly all of it noise. A channel is named by
its gravity only when the lengths differ by four of them, {named:.0} mg; less is detected without a
name.
"
        )
    }

    fn pair(&self, f: &mut Formatter) -> fmt::Result {
        writeln!(
            f,
            "\
### The healthy pair

| thresholds | lying still | alarms | per hour | turns by hand | of them with an alarm | shaken: \
time under an alarm | a channel named |
|---|---|---|---|---|---|---|---|"
        )?;
        for (name, seen) in [("product", &self.by_product), ("here", &self.healthy)] {
            writeln!(
                f,
                "| {name} | {:.0} s | {} | {:.1} | {} | {} | {:.0} % | {} times |",
                seen.still_s,
                seen.still_alarms,
                f64::from(seen.still_alarms) * 3600.0 / seen.still_s,
                seen.turns,
                seen.turns_told,
                100.0 * seen.shaken_told,
                seen.named
            )?;
        }
        let seen = &self.healthy;
        let after_s = seen.shaken_after_s.unwrap_or(f64::NAN);
        // Without an event in a time T the rate is below 3 / T with 95 % confidence.
        let most = 3.0 * 3600.0 / seen.still_s;
        writeln!(
            f,
            "
Lying still counts from 4 s after the board was laid down. So short a recording without an alarm
only shows that there are fewer than {most:.0} per hour (95 %).

In motion the two differ for real. They are some centimetres apart, and a board that turns at
10 rad/s pulls at one of them by 0.1 g more per centimetre. So every turn by hand raises an alarm,
which is over when the board lies. Shaken, the pair differs by {:.1} g rms, and the first alarm
comes {after_s:.2} s after the beginning. A threshold above this would miss every
fault below but the coarsest. Motion as hard as this ends the comparison of two parts so far apart;
what remains is each channel's own health.
",
            self.shaken_mg / 1000.0
        )
    }

    fn tables(&self, f: &mut Formatter) -> fmt::Result {
        writeln!(
            f,
            "\
### Faults that begin while the board lies still

Observed for {WATCHED_S} s, which takes in two or three poses. A detection in a turn counts only if
it names the channel with the fault. Delays are over all trials, undetected faults counted as the
longest. Wrong: the healthy channel was named, if only for a moment. None: detected, but no channel
was named.

| fault | detected | median | 95 % | right | wrong | none |
|---|---|---|---|---|---|---|"
        )?;
        rows(f, &self.still, |_| true)?;
        let wrong: usize = self.still.iter().map(|row| row.1.wrong).sum();
        let lying: usize = self.still.iter().map(|row| row.1.wrong_lying).sum();
        writeln!(
            f,
            "
Of {} trials {wrong} named the wrong channel at some time, {lying} of them first while the board
lay still. An offset of 5 or 10 mg is detected and not named, because {:.0} mg of length are needed
here. Which pose the board is in decides whether gravity shows the error at all. One sample in ten
lost is filled in by the chain and is no fault by itself.

### Faults that begin while the board is shaken

Observed for {SHAKEN_S} s. The pair is under an alarm already, so detected here means that the
channel with the fault is named. Faults without a row are never named.

| fault | detected | median | 95 % | right | wrong | none |
|---|---|---|---|---|---|---|",
            self.still.iter().map(|row| row.1.trials).sum::<usize>(),
            4.0 * self.tuned.uncertainty_mg
        )?;
        rows(f, &self.shaken, |tally| {
            tally.wrong > 0 || !tally.told_s.is_empty()
        })
    }
}

fn rows(f: &mut Formatter, kinds: &[(&str, Tally)], worth: impl Fn(&Tally) -> bool) -> fmt::Result {
    for (name, tally) in kinds.iter().filter(|(_, tally)| worth(tally)) {
        let percent = |count: usize| 100.0 * count as f64 / tally.trials.max(1) as f64;
        let delay = |share| match tally.within_s(share) {
            Some(s) => format!("{s:.2} s"),
            None => "-".to_owned(),
        };
        let nobody = tally.told_s.len().saturating_sub(tally.right + tally.wrong);
        writeln!(
            f,
            "| {name} | {:.0} % | {} | {} | {:.0} % | {:.0} % | {:.0} % |",
            percent(tally.told_s.len()),
            delay(0.5),
            delay(0.95),
            percent(tally.right),
            percent(tally.wrong),
            percent(nobody)
        )?;
    }
    Ok(())
}

impl fmt::Display for Section {
    fn fmt(&self, f: &mut Formatter) -> fmt::Result {
        writeln!(f, "## On real recordings\n")?;
        self.about(f)?;
        self.thresholds(f)?;
        self.pair(f)?;
        self.tables(f)
    }
}
