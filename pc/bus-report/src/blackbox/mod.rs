//! `plumb faults`: what a node remembers of its faults, the fault log (2070h) and the black box
//! (2071h).
//!
//! In: nodes of a bus, or files of what they have given. Out: the events in words, and each box as
//! it came and as CSV. The formats are in docs/canopen.md; the JSON is described in
//! `docs/period-report.md`.
//!
//! Left out: emptying the log (2072h), and pictures (`period`).

mod csv;
pub mod data;
mod decode;
mod error;
mod read;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use serde::Serialize;

use bus_master::nodes::NodeOption;
use bus_master::{Bus, BusOptions};
use output::stdout;
use output::unreadable::Unreadable;
use output::write::{Existing, Staged, check_place};
use output::{plural, printable};

use data::MemoryReport;
use decode::Memory;
pub use error::FaultsError;
use read::Bytes;

/// Which nodes are read, and what becomes of their boxes.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Read files of 2070h or 2071h, as saved by --boxes, instead of nodes
    #[arg(
        value_name = "FILE",
        conflicts_with_all = ["node", "boxes", "bus", "interface", "channel", "bitrate"]
    )]
    pub files: Vec<PathBuf>,
    /// Which nodes are read
    #[command(flatten)]
    pub nodes: NodeOption,
    /// Save fault logs and boxes in this folder, as received, and the boxes as CSV too
    #[arg(long, value_name = "DIR")]
    pub boxes: Option<PathBuf>,
    /// Replace files of --boxes that are there already
    #[arg(long, requires = "boxes")]
    pub force: bool,
    /// Print one JSON object
    #[arg(long)]
    pub json: bool,
    /// The bus
    #[command(flatten)]
    pub bus: BusOptions,
}

/// What `--json` prints.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultsReport {
    /// Always `plumb-faults`.
    format: &'static str,
    /// 1; it rises when a field changes its meaning or goes away.
    version: u32,
    /// Each node or file.
    memories: Vec<MemoryReport>,
    /// The files that were written.
    saved: Vec<String>,
}

/// Lists what the nodes remember; exit status 0 also when these are faults.
///
/// Errors: see [`FaultsError`]. What was read before one is saved and printed all the same.
pub fn run(arguments: &Arguments) -> Result<ExitCode, FaultsError> {
    let mut report = FaultsReport {
        format: "plumb-faults",
        version: 1,
        memories: Vec::new(),
        saved: Vec::new(),
    };
    let ended = if arguments.files.is_empty() {
        ask_all(arguments, &mut report)
    } else {
        read_all(&arguments.files, &mut report)
    };
    if !report.memories.is_empty() {
        stdout::print_as(arguments.json, &report, || shown(&report)).map_err(FaultsError::Print)?;
    }
    ended.map(|()| ExitCode::SUCCESS)
}

fn read_all(files: &[PathBuf], report: &mut FaultsReport) -> Result<(), FaultsError> {
    for path in files {
        report.memories.push(from_file(path)?);
    }
    Ok(())
}

/// What a file holds.
///
/// Errors: it can't be read, or holds something else.
pub fn from_file(path: &Path) -> Result<MemoryReport, FaultsError> {
    let name = path.display().to_string();
    let bytes = fs::read(path).map_err(|why| FaultsError::Read(Unreadable::new(path, why)))?;
    let memory = decode::either(&bytes).map_err(|why| FaultsError::File(name.clone(), why))?;
    let mut report = MemoryReport::of(name, None);
    report.take(&memory, 1);
    Ok(report)
}

fn join(options: &BusOptions) -> Result<Bus, FaultsError> {
    options.join().map_err(|why| FaultsError::Bus(why.into()))
}

fn ask_all(arguments: &Arguments, report: &mut FaultsReport) -> Result<(), FaultsError> {
    let mut bus = join(&arguments.bus)?;
    let mut ended = Ok(());
    let nodes = &arguments.nodes;
    let meant = nodes.readable(&mut bus).map_err(FaultsError::Nodes)?;
    for node in meant.nodes.clone() {
        let asked = ask(&mut bus, node).and_then(|(bytes, memory)| {
            report.memories.push(memory);
            match &arguments.boxes {
                Some(folder) => {
                    let existing = Existing::of(arguments.force);
                    save((folder, existing), node, &bytes, &mut report.saved)
                }
                None => Ok(()),
            }
        });
        // The others are asked all the same; the first trouble is told.
        match asked {
            Err(why) if why.ends_all() => return Err(why),
            Err(why) if ended.is_ok() => ended = Err(why),
            _ => {}
        }
    }
    ended.and_then(|()| meant.complete().map_err(FaultsError::Nodes))
}

/// What a node of the bus remembers: as it came, and in words.
///
/// Errors: it does not answer, or gives something else.
fn ask(bus: &mut Bus, node: u8) -> Result<(Bytes, MemoryReport), FaultsError> {
    let bytes = read::ask(bus, node).map_err(FaultsError::Bus)?;
    let source = format!("node {node}");
    let wrong = |why| FaultsError::Node(node, why);
    let mut report = MemoryReport::of(source, Some(node));
    let log = decode::fault_log(&bytes.log).map_err(wrong)?;
    report.take(&Memory::Log(log), 0);
    for (number, content) in (1..).zip(&bytes.boxes) {
        if let Some(content) = content {
            let samples = decode::samples(content).map_err(wrong)?;
            report.take(&Memory::Box(samples), number);
        }
    }
    Ok((bytes, report))
}

/// What the nodes of a bus remember, and a sentence for each that could not be asked.
///
/// Errors: the bus can't be joined, or was lost.
pub fn from_bus(
    options: &BusOptions,
    nodes: &NodeOption,
) -> Result<(Vec<MemoryReport>, Vec<String>), FaultsError> {
    let mut bus = join(options)?;
    let (mut memories, mut silent) = (Vec::new(), Vec::new());
    let meant = nodes.readable(&mut bus).map_err(FaultsError::Nodes)?;
    silent.extend(meant.complete().err().map(|why| why.to_string()));
    for node in meant.nodes {
        match ask(&mut bus, node) {
            Ok((_, memory)) => memories.push(memory),
            Err(why) if why.ends_all() => return Err(why),
            Err(why) => silent.push(why.to_string()),
        }
    }
    Ok((memories, silent))
}

/// Writes what a node has given into the folder: nothing where a file of it may not be replaced.
fn save(
    (folder, existing): (&Path, Existing),
    node: u8,
    bytes: &Bytes,
    saved: &mut Vec<String>,
) -> Result<(), FaultsError> {
    let wrong = |path: &Path, why| FaultsError::Write(path.to_owned(), why);
    fs::create_dir_all(folder).map_err(|why| wrong(folder, why))?;
    let files: Vec<_> = files(node, bytes)
        .into_iter()
        .map(|(name, content)| (folder.join(name), content))
        .collect();
    for (path, _) in &files {
        check_place(path, existing).map_err(|why| wrong(path, why.into()))?;
    }
    for (path, content) in files {
        let written = Staged::write(&path, content, existing).and_then(Staged::put_in_place);
        written.map_err(|why| wrong(&path, why))?;
        saved.push(path.display().to_string());
    }
    Ok(())
}

/// The files of what a node has given: their names and contents.
fn files(node: u8, bytes: &Bytes) -> Vec<(String, Vec<u8>)> {
    let mut files = vec![(format!("node-{node}-fault-log.bin"), bytes.log.clone())];
    for (number, content) in (1..).zip(&bytes.boxes) {
        let Some(content) = content else {
            continue;
        };
        files.push((format!("node-{node}-box-{number}.bin"), content.clone()));
        if let Ok(samples) = decode::samples(content) {
            let text = csv::samples(&samples);
            files.push((format!("node-{node}-box-{number}.csv"), text.into_bytes()));
        }
    }
    files
}

/// What the terminal shows.
fn shown(report: &FaultsReport) -> String {
    let mut text = String::new();
    for memory in &report.memories {
        let name = printable(&memory.source);
        let title = format!("Fault log of {name}, newest first");
        if !text.is_empty() {
            text.push('\n');
        }
        if !memory.entries.is_empty() {
            text.push_str(&data::table(memory, &title).to_text());
        } else if memory.entries_made.is_some() {
            text.push_str(&format!("Fault log of {name}: no entry.\n"));
        }
        for one in &memory.boxes {
            let syncs = plural(one.rows.len() as u64, "SYNC", "SYNCs");
            text.push_str(&format!("{}, {syncs}\n", one.title));
        }
    }
    for path in &report.saved {
        text.push_str(&format!("saved {}\n", printable(path)));
    }
    text
}
