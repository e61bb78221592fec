//! What `plumb replay` is told about bus logs.
//!
//! In: the words of the command line, through `clap`. Out: [`Options`] and the plan in them.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use bus_logs::{Moment, PaceOptions, PlayOptions};
use listen::Plan;
use listen::eds::{Device, Request};

/// Options that only bus logs have.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Options for bus logs")]
pub struct Options {
    /// Only frames of this interface, as named in the log: can0, or 1 in an ASC
    #[arg(long, value_name = "NAME")]
    pub interface: Option<String>,
    /// Node-ids of channel A and B; of several instruments A,B,A,B
    #[arg(long, value_name = "A,B", value_delimiter = ',',
          value_parser = clap::value_parser!(u8).range(1..=127))]
    pub nodes: Vec<u8>,
    /// EDS or DCF of a node, for one that is not as delivered or is no inclinometer; repeatable
    #[arg(long, value_name = "FILE[@NODE]")]
    pub eds: Vec<Request>,
    /// End with the last frame at or before this time; as --from
    #[arg(long, value_name = "TIME")]
    pub to: Option<Moment>,
    /// Write every value into a table (.csv, .parquet), or the frames into a log (.log, .asc)
    #[arg(long, value_name = "FILE")]
    pub export: Option<PathBuf>,
    /// Send the frames onto this bus, as --bus names it elsewhere, when they are due
    #[arg(long, value_name = "URL", conflicts_with = "export")]
    pub onto: Option<String>,
    /// Speed, as a multiple of the recorded one
    #[arg(long, value_name = "X", value_parser = speed, requires = "onto")]
    pub speed: Option<f64>,
    /// Shorten gaps between two frames to this many seconds
    #[arg(long, value_name = "S", value_parser = seconds, requires = "onto")]
    pub skip_gaps: Option<Duration>,
    /// Send a frame each time that Enter is pressed; q ends
    #[arg(long, requires = "onto", conflicts_with_all = ["speed", "skip_gaps"])]
    pub step: bool,
    /// Start again at the end
    #[arg(long = "loop", requires = "onto")]
    pub again: bool,
}

fn speed(text: &str) -> Result<f64, String> {
    let speed: f64 = text.parse().unwrap_or(f64::NAN);
    let fits = speed.is_finite() && speed > 0.0;
    fits.then_some(speed)
        .ok_or_else(|| "give a number above 0, such as 10".to_owned())
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds: f64 = text.parse().unwrap_or(f64::NAN);
    Duration::try_from_secs_f64(seconds)
        .map_err(|_| "give a number of seconds, such as 0.5".to_owned())
}

impl Options {
    /// The first option that was given, for a sentence.
    pub fn given(&self) -> Option<&'static str> {
        let options = [
            (self.interface.is_some(), "--interface"),
            (!self.nodes.is_empty(), "--nodes"),
            (!self.eds.is_empty(), "--eds"),
            (self.to.is_some(), "--to"),
            (self.export.is_some(), "--export"),
            // What needs it is refused without it.
            (self.onto.is_some(), "--onto"),
        ];
        let given = options.into_iter().find(|(given, _)| *given);
        given.map(|(_, name)| name)
    }

    /// The instruments: those that were named, else those that a data sheet describes, else the
    /// one as delivered. `None` when node-ids don't make pairs of two different ones.
    pub fn plan(&self, devices: &[Device]) -> Option<Plan> {
        let ours = devices.iter().filter(|device| device.is_inclinometer());
        let mut ids = self.nodes.clone();
        if ids.is_empty() {
            ids.extend(ours.clone().map(|device| device.node_id));
            // A sheet of one channel alone: the other one has the next node-id.
            if let [one] = ids[..] {
                ids = if one % 2 == 1 {
                    vec![one, one + 1]
                } else {
                    vec![one - 1, one]
                };
            }
        }
        let (pairs, rest) = ids.as_chunks();
        let mut sorted = ids.clone();
        sorted.sort_unstable();
        sorted.dedup();
        if !rest.is_empty() || sorted.len() != ids.len() {
            return None;
        }
        let mut plan = if pairs.is_empty() {
            Plan::default()
        } else {
            Plan::of(pairs.to_vec())
        };
        plan.nodes = ours.map(|device| device.plan().clone()).collect();
        Some(plan)
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
            from,
            to: self.to,
            again: self.again,
            interface: self.interface.clone(),
        }
    }
}
