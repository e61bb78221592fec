//! What `plumb demo` is asked for on the command line.

use std::path::PathBuf;

use clap::Args;

/// What to build and test.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Seed of every random draw; the same seed gives the same report
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Instruments to build in each mode; figures are medians over them
    #[arg(long, default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub units: u32,
    /// Days on the excavator, three hours each; the supply fails on day 5; 0 for none
    #[arg(long, default_value_t = 7, value_parser = clap::value_parser!(u32).range(0..=3650))]
    pub days: u32,
    /// Folder for report.html and report.json
    #[arg(long, default_value = "plumb-report", value_name = "DIR")]
    pub out: PathBuf,
    /// Add the paper to the letter: a column in addition to the reading that reproduces it
    #[arg(long)]
    pub as_printed: bool,
    /// Print every table, not only the summary
    #[arg(long, conflicts_with = "json")]
    pub details: bool,
    /// Print report.json on stdout instead of the tables
    #[arg(long)]
    pub json: bool,
}
