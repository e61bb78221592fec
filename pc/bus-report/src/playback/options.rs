//! What `plumb replay` is told about bus logs.
//!
//! In: the words of the command line, through `clap`. Out: [`Options`].

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use bus_logs::{LONGEST_GAP_S, Moment, PaceOptions, PartOptions, PlayOptions, gap, speed};
use listen::PlanOptions;

/// Options that only bus logs have.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Options for bus logs")]
pub struct Options {
    /// Only frames of this interface, as named in the log: can0, or 1 in an ASC
    #[arg(short, long, alias = "interface", value_name = "NAME")]
    pub channel: Option<String>,
    /// Which instruments there are.
    #[command(flatten)]
    pub plan: PlanOptions,
    /// End with the last frame at or before this time; as --from
    #[arg(long, value_name = "TIME")]
    pub to: Option<Moment>,
    /// Write every value into a table (.csv, .parquet), or the frames into a log (.log, .asc)
    #[arg(long, value_name = "FILE")]
    pub export: Option<PathBuf>,
    /// Send the frames onto this bus, as --bus names it elsewhere, when they are due
    #[arg(long, value_name = "URL", conflicts_with = "export")]
    pub onto: Option<String>,
    /// Speed: 10 is ten times as fast as recorded, max as fast as possible
    #[arg(long, value_name = "TIMES", value_parser = speed, requires = "onto")]
    pub speed: Option<f64>,
    /// Shorten gaps between two frames to this many seconds, 2 when none are given
    #[arg(long, value_name = "S", num_args = 0..=1, default_missing_value = LONGEST_GAP_S,
          value_parser = gap, requires = "onto")]
    pub skip_gaps: Option<Duration>,
    /// Send a frame each time that Enter is pressed; q ends
    #[arg(long, requires = "onto", conflicts_with_all = ["speed", "skip_gaps"])]
    pub step: bool,
    /// Start again at the end
    #[arg(long = "loop", requires = "onto")]
    pub again: bool,
}

impl Options {
    /// The first option that was given, for a sentence.
    pub fn given(&self) -> Option<&'static str> {
        let options = [
            (self.channel.is_some(), "--channel"),
            (!self.plan.nodes.is_empty(), "--nodes"),
            (!self.plan.eds.is_empty(), "--eds"),
            (self.to.is_some(), "--to"),
            (self.export.is_some(), "--export"),
            // What needs it is refused without it.
            (self.onto.is_some(), "--onto"),
        ];
        let given = options.into_iter().find(|(given, _)| *given);
        given.map(|(_, name)| name)
    }

    /// Which part of the logs is read, with where it begins.
    pub const fn part(&self, from: Option<Moment>) -> PartOptions {
        PartOptions { from, to: self.to }
    }

    /// How the logs are played.
    pub fn play(&self, from: Option<Moment>) -> PlayOptions {
        PlayOptions {
            pace: PaceOptions {
                speed: if self.step {
                    f64::INFINITY
                } else {
                    self.speed.unwrap_or(1.0)
                },
                longest_gap: self.skip_gaps,
            },
            part: self.part(from),
            again: self.again,
            interface: self.channel.clone(),
        }
    }
}
