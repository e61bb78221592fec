//! The page: figures in, Markdown out.
//!
//! In: outcomes of many runs. Out: tables, each with a sentence on how to read it.

use std::fmt::Write as _;

use sim::bench::statistics::median;

use crate::observer::{Outcome, Pairs};
use crate::plan::{Counts, KINDS, Kind, Reference, STEP};

/// Isolated at once means within this, s.
const AT_ONCE_S: f64 = 0.1;
/// The promise for the step: median, s.
const STEP_S: f64 = 0.8;
/// The promise for the step: named wrong, per cent.
const STEP_WRONG: f64 = 2.0;

/// The runs of one fault in one scene; for paper mode, what there is.
pub struct Cell {
    /// The fault; `None` for a healthy instrument.
    pub kind: Option<&'static Kind>,
    /// Product mode.
    pub product: Vec<Outcome>,
    /// Paper mode.
    pub paper: Vec<Outcome>,
}

/// Share in per cent; 0 of nothing.
fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

fn count(outcomes: &[Outcome], what: impl Fn(&Outcome) -> bool) -> usize {
    outcomes.iter().filter(|outcome| what(outcome)).count()
}

fn share(outcomes: &[Outcome], what: impl Fn(&Outcome) -> bool) -> f64 {
    percent(count(outcomes, what), outcomes.len())
}

/// The delays that there are, s, the shortest first.
fn delays(outcomes: &[Outcome], of: impl Fn(&Outcome) -> Option<f64>) -> Vec<f64> {
    let mut delays: Vec<f64> = outcomes.iter().filter_map(of).collect();
    delays.sort_by(f64::total_cmp);
    delays
}

fn seconds(value: Option<f64>) -> String {
    match value {
        Some(s) if s < 0.1 => format!("{s:.3}"),
        Some(s) if s < 10.0 => format!("{s:.2}"),
        Some(s) => format!("{s:.1}"),
        None => String::from("-"),
    }
}

fn middle(delays: &[f64]) -> Option<f64> {
    (!delays.is_empty()).then(|| median(&mut delays.to_vec()))
}

/// The delay that 95 % of the detected runs don't exceed.
fn late(delays: &[f64]) -> Option<f64> {
    let rank = (0.95 * delays.len() as f64).ceil() as usize;
    delays.get(rank.saturating_sub(1)).copied()
}

/// Right, wrong, unknown in per cent of all runs.
fn blame(outcomes: &[Outcome]) -> [f64; 3] {
    let named = |outcome: &Outcome| outcome.named_s.is_some();
    let right = share(outcomes, |o| named(o) && !o.wrong);
    let wrong = share(outcomes, |o| o.wrong);
    [right, wrong, 100.0 - right - wrong]
}

/// The table of one scene.
pub fn scene(page: &mut String, name: &str, cells: &[Cell], with_paper: bool) {
    let _ = writeln!(page, "### {name}\n");
    page.push_str(
        "| fault | detected, % | median, s | 95 %, s | right, % | wrong, % | unknown, % ",
    );
    page.push_str("| plain: detected, % | median, s |");
    if with_paper {
        page.push_str(
            " paper: warnings/s before | after | stopped before, % | stop, % | median, s |",
        );
    }
    page.push_str("\n|---|---|---|---|---|---|---|---|---|");
    page.push_str(if with_paper {
        "---|---|---|---|\n"
    } else {
        "\n"
    });
    for cell in cells {
        row(page, cell, with_paper);
    }
    page.push('\n');
}

fn row(page: &mut String, cell: &Cell, with_paper: bool) {
    let product = &cell.product;
    let told = delays(product, |o| o.told_s);
    let [right, wrong, unknown] = blame(product);
    let plain = delays(product, |o| o.plain_s);
    let mark = if cell.kind.is_some_and(|kind| kind.of_the_bus) {
        " (bus)"
    } else {
        ""
    };
    let name = cell.kind.map_or("none", |kind| kind.name);
    let _ = write!(
        page,
        "| {name}{mark} | {:.0} | {} | {} | {right:.0} | {wrong:.0} | {unknown:.0} | {:.0} | {} |",
        percent(told.len(), product.len()),
        seconds(middle(&told)),
        seconds(late(&told)),
        percent(plain.len(), product.len()),
        seconds(middle(&plain)),
    );
    if with_paper {
        paper_cells(page, &cell.paper);
    }
    page.push('\n');
}

fn paper_cells(page: &mut String, paper: &[Outcome]) {
    for pairs in [
        warnings(paper, |o| o.healthy),
        warnings(paper, |o| o.faulty),
    ] {
        let _ = write!(
            page,
            " {} |",
            pairs.map_or(String::from("-"), |n| format!("{n:.1}"))
        );
    }
    let fit: Vec<Outcome> = (paper.iter().filter(|o| !o.stopped_before).cloned()).collect();
    if paper.is_empty() {
        page.push_str(" - | - | - |");
        return;
    }
    let _ = write!(
        page,
        " {:.0} |",
        percent(paper.len() - fit.len(), paper.len())
    );
    let stops = delays(&fit, |o| o.stop_s);
    if fit.is_empty() {
        page.push_str(" - | - |");
    } else {
        let stopped = percent(stops.len(), fit.len());
        let _ = write!(page, " {stopped:.0} | {} |", seconds(middle(&stops)));
    }
}

/// Warnings in a second of 50 SYNCs.
fn warnings(outcomes: &[Outcome], of: impl Fn(&Outcome) -> Pairs) -> Option<f64> {
    let syncs: u32 = outcomes.iter().map(|o| of(o).syncs).sum();
    let warned: u32 = outcomes.iter().map(|o| of(o).warned).sum();
    (syncs > 0).then(|| 50.0 * f64::from(warned) / f64::from(syncs))
}

/// In how many runs a channel was named too early, in a sentence.
pub fn named_before(page: &mut String, scenes: &[Vec<Cell>]) {
    let all = || scenes.iter().flatten();
    let named: usize = all().map(|c| count(&c.product, |o| o.before)).sum();
    let runs: usize = all().map(|c| c.product.len()).sum();
    let _ = writeln!(
        page,
        "Named before the fault began: {named} of {runs} runs of product mode.\n"
    );
}

/// The study's faults with the study's figures and ours; `cells` are those of stop-and-go.
pub fn beside_the_study(page: &mut String, cells: &[Cell]) {
    page.push_str(
        "| fault | study: detected, % | median, s | isolated, % | this instrument: detected, % | \
         median, s | isolated, % | at least as good |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for cell in cells {
        let Some((kind, study)) = cell.kind.and_then(|k| Some((k, k.reference?))) else {
            continue;
        };
        let told = delays(&cell.product, |o| o.told_s);
        let detected = percent(told.len(), cell.product.len());
        let [right, ..] = blame(&cell.product);
        let delay = middle(&told);
        let as_good = is_as_good(&study, detected, delay, right);
        let isolated = study.isolated.map_or(String::new(), |i| i.to_string());
        let published = study
            .delay_s
            .map_or(String::from("at once"), |s| s.to_string());
        let _ = writeln!(
            page,
            "| {} | {} | {published} | {isolated} | {detected:.0} | {} | {right:.0} | {} |",
            kind.name,
            study.detected,
            seconds(delay),
            if as_good { "yes" } else { "NO" },
        );
    }
    page.push('\n');
}

fn is_as_good(study: &Reference, detected: f64, delay: Option<f64>, right: f64) -> bool {
    // "At the first" spike: no second one has come before the word of it has got through.
    let limit_s = study.delay_s.unwrap_or(AT_ONCE_S);
    detected >= f64::from(study.detected)
        && delay.is_some_and(|s| s <= limit_s)
        && study.isolated.is_none_or(|i| right >= f64::from(i))
}

/// The promises: runs of each fault.
pub fn promises(page: &mut String, runs: &[(&'static Kind, Vec<Outcome>)]) {
    page.push_str(
        "| fault | runs | detected | isolated right | within 0.1 s | median, s | slowest, s | \
         wrong | kept |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for (kind, outcomes) in runs.iter().filter(|(kind, _)| kind.name != STEP) {
        let named = delays(outcomes, |o| o.named_s.filter(|_| !o.wrong));
        let at_once = named.iter().filter(|s| **s <= AT_ONCE_S).count();
        let wrong = count(outcomes, |o| o.wrong);
        let kept = at_once == outcomes.len() && wrong == 0;
        let _ = writeln!(
            page,
            "| {} | {} | {} | {} | {at_once} | {} | {} | {wrong} | {} |",
            kind.name,
            outcomes.len(),
            count(outcomes, |o| o.told_s.is_some()),
            named.len(),
            seconds(middle(&named)),
            seconds(named.last().copied()),
            if kept { "yes" } else { "NO" },
        );
    }
    page.push('\n');
    for (kind, outcomes) in runs.iter().filter(|(kind, _)| kind.name == STEP) {
        step(page, kind, outcomes);
    }
}

fn step(page: &mut String, kind: &Kind, outcomes: &[Outcome]) {
    let told = delays(outcomes, |o| o.told_s);
    let [right, wrong, unknown] = blame(outcomes);
    let delay = middle(&told);
    let kept = |yes: bool| if yes { "kept" } else { "NOT KEPT" };
    let _ = writeln!(
        page,
        "A {} in stop-and-go, {} runs: detected in {:.1} %, after {} s in the median (promised: at \
         most {STEP_S} s, {}) and {} s in 95 % of them; the right channel named in {right:.1} %, \
         the wrong one in {wrong:.1} % (promised: at most {STEP_WRONG} %, {}), none named in \
         {unknown:.1} %.\n",
        kind.name,
        outcomes.len(),
        percent(told.len(), outcomes.len()),
        seconds(delay),
        kept(delay.is_some_and(|s| s <= STEP_S)),
        seconds(late(&told)),
        kept(wrong <= STEP_WRONG),
    );
}

/// Healthy worlds of one scene.
pub struct Healthy {
    /// The scene.
    pub scene: &'static str,
    /// Product mode.
    pub product: Vec<Outcome>,
    /// Paper mode.
    pub paper: Vec<Outcome>,
}

fn hours(outcomes: &[Outcome]) -> f64 {
    outcomes.iter().map(|o| o.duration_s).sum::<f64>() / 3600.0
}

/// False alarms of healthy instruments.
pub fn false_alarms(page: &mut String, scenes: &[Healthy]) {
    page.push_str(
        "| scene | product: hours | false alarms | plain difference: excesses | paper: hours \
         | warnings | stops of 45 s | physical faults | stops per 1000 h |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for healthy in scenes {
        let sum = |outcomes: &[Outcome], of: fn(&Outcome) -> u32| -> u32 {
            outcomes.iter().map(of).sum()
        };
        let (product, paper) = (&healthy.product, &healthy.paper);
        let stops = sum(paper, |o| o.stops);
        let paper_hours = hours(paper);
        let _ = writeln!(
            page,
            "| {} | {:.1} | {} | {} | {paper_hours:.1} | {} | {stops} | {} | {:.0} |",
            healthy.scene,
            hours(product),
            sum(product, |o| o.alarms),
            sum(product, |o| o.excesses),
            sum(paper, |o| o.warnings),
            sum(paper, |o| o.physical),
            1000.0 * f64::from(stops) / paper_hours.max(1e-9),
        );
    }
    page.push('\n');
}

/// Every fault in all scenes together: what the tests repeat.
pub fn repeated(page: &mut String, scenes: &[Vec<Cell>], counts: &Counts) {
    let _ = writeln!(
        page,
        "| fault, {} runs | detected, % | median, s | 95 %, s | right, % | wrong, % \
         | plain: detected, % |\n\
         |---|---|---|---|---|---|---|",
        counts.cell * scenes.len(),
    );
    for kind in [None].into_iter().chain(KINDS.iter().map(|k| Some(k.name))) {
        let of = |cell: &&Cell| cell.kind.map(|k| k.name) == kind;
        let cells = scenes.iter().flatten().filter(of);
        let outcomes: Vec<Outcome> = cells.flat_map(|cell| cell.product.clone()).collect();
        let told = delays(&outcomes, |o| o.told_s);
        let [right, wrong, _] = blame(&outcomes);
        let _ = writeln!(
            page,
            "| {} | {:.0} | {} | {} | {right:.0} | {wrong:.0} | {:.0} |",
            kind.unwrap_or("none"),
            percent(told.len(), outcomes.len()),
            seconds(middle(&told)),
            seconds(late(&told)),
            share(&outcomes, |o| o.plain_s.is_some()),
        );
    }
    page.push('\n');
}
