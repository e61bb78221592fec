//! Faults injected into real recordings: the section "On real recordings" of `docs/faults-real.md`.
//!
//! In: the two channels of one board that lie beside the checkout. Out: the section, which the
//! page must hold as it is. Where the recordings are missing, the tests print this and pass.

mod board;
mod channel;
mod section;
mod trials;
mod tuned;

use std::fs;
use std::path::{Path, PathBuf};

use instant::Instant;
use sim::fault::SensorFault;
use sim::rng::Rng;
use tilt::chain::Chain;

use super::arguments::{Arguments, Mode};
use super::prepare::{Prepared, prepare};
use super::tuning;
use channel::Channel;
use output::progress::Progress;
use section::Section;

const FILES: [&str; 2] = ["mimu4444/exp1_imu1.csv.gz", "mimu4444/exp1_imu3.csv.gz"];

/// Both channels with the instrument's chains at the range of their parts; `None` with a word on
/// it when a recording is missing.
fn channels() -> Option<([Prepared; 2], [Chain; 2])> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let files: Vec<PathBuf> = FILES.iter().map(|name| folder.join(name)).collect();
    if let Some(missing) = files.iter().find(|file| !file.exists()) {
        println!("skipped: recording not present ({})", missing.display());
        return None;
    }
    let arguments = Arguments {
        files,
        ..Arguments::default()
    };
    let (prepared, _) = prepare(&arguments, &Progress::hidden()).unwrap();
    let mut chains = tuning::chains(&prepared, Mode::Product);
    for chain in &mut chains {
        chain.full_scale = channel::RANGE;
    }
    let prepared: Result<[Prepared; 2], _> = prepared.try_into();
    let chains: Result<[Chain; 2], _> = chains.try_into();
    prepared.ok().zip(chains.ok())
}

#[test]
fn ten_times_the_noise_is_ten_times_that_of_these_parts() {
    let Some(([one, _], [chain, _])) = channels() else {
        return;
    };
    let healthy = Channel::new(&one, &chain);
    let fault = SensorFault::Noise { factor: 10.0 };
    let noisy = healthy.with(fault, Instant(0), Rng::stream(1, "noise"));
    // In eighths of an octave of energy: 8 log2(10^2) = 53 above the part's own, which is 64.
    for (mut channel, around) in [(healthy, 59..=69), (noisy, 112..=122)] {
        let looks = (0..1000).map(|n| channel.observe(Instant(n * board::PAIR_US)).activity.0);
        let mut looks: Vec<u8> = looks.filter(|look| *look > 0).collect();
        looks.sort_unstable();
        let median = looks[looks.len() / 2];
        assert!(around.contains(&median), "{median}");
    }
}

const BEGIN: &str = "<!-- real recordings: begin -->\n";
const END: &str = "<!-- real recordings: end -->\n";

fn page_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/faults-real.md")
}

/// What stands before, between and after the marks of a page.
fn parts(page: &str) -> Option<[&str; 3]> {
    let (before, rest) = page.split_once(BEGIN)?;
    let (between, after) = rest.split_once(END)?;
    Some([before, between, after])
}

/// What must hold whatever the figures are.
fn claims(section: &Section) {
    let seen = &section.healthy;
    assert_eq!((seen.still_alarms, seen.named), (0, 0), "the healthy pair");
    assert!(section.by_product.named == 0, "by the product's thresholds");
    let of = |name| section.of_still(name).unwrap();
    let none = of("none");
    assert!(none.trials == 60 && none.told_s.is_empty() && none.wrong == 0);
    for (name, within_s) in [
        ("bias step 10 mg", 1.0),
        ("bias step 50 mg", 0.1),
        ("drift 2 mg/s", 10.0),
    ] {
        assert!(of(name).within_s(0.95).unwrap() <= within_s, "{name}");
    }
    for (name, within_s) in [
        ("stuck, one axis", 0.5),
        ("stuck, all", 0.2),
        ("noise x3", 1.0),
        ("spikes 200 mg", 0.1),
        ("delay 50 ms", 0.1),
        ("delay 200 ms", 0.1),
        ("brown-out", 0.1),
    ] {
        let tally = of(name);
        assert!(tally.within_s(0.95).unwrap() <= within_s, "{name}");
        assert_eq!((tally.right, tally.wrong), (60, 0), "{name}");
    }
    // A channel that loses samples has few looks at its noise; the other is judged by those.
    let whole = |row: &&(&str, _)| !row.0.starts_with("sample loss");
    for (name, tally) in section.still.iter().filter(whole) {
        assert_eq!(tally.wrong_lying, 0, "lying still: {name}");
    }
    for (name, tally) in &section.shaken {
        assert_eq!(tally.wrong, 0, "shaken: {name}");
    }
}

#[test]
fn faults_in_real_channels_are_told_as_on_the_page() {
    let Some((prepared, chains)) = channels() else {
        return;
    };
    let section = Section::of(&prepared, &chains);
    println!("{section}");
    claims(&section);
    let page = fs::read_to_string(page_path()).unwrap();
    let [_, between, _] = parts(&page).expect("the marks of the section");
    assert!(
        between.trim() == section.to_string().trim(),
        "docs/faults-real.md is not what the code gives now: {AGAIN}"
    );
}

/// How the section is written anew.
const AGAIN: &str = "cargo test -p bench the_section_is_written -- --ignored";

#[test]
#[ignore = "writes the section into docs/faults-real.md"]
fn the_section_is_written() {
    let Some((prepared, chains)) = channels() else {
        return;
    };
    let section = Section::of(&prepared, &chains);
    let page = fs::read_to_string(page_path()).unwrap();
    let [before, _, after] = parts(&page).expect("the marks of the section");
    let page = format!("{before}{BEGIN}\n{section}\n{END}{after}");
    let new = page_path().with_extension("md.new");
    fs::write(&new, page).unwrap();
    fs::rename(new, page_path()).unwrap();
}
