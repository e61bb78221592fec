//! What `plumb serve` is asked for.
//!
//! In: the command line. Out: [`Arguments`], and what follows from them together.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use sim::bench;

use crate::addresses::SOCKETCAND_AT;
use crate::error::ServeError;
use crate::pace::Speed;
use crate::words::line::{BIT_RATES, help};

/// Node-ids in the order of the nodes, or none for all of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodeIds(Option<Vec<u8>>);

impl FromStr for NodeIds {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "none" {
            return Ok(Self(None));
        }
        let id = |text: &str| text.trim().parse().ok().filter(|id| (1..=127).contains(id));
        let ids: Option<Vec<u8>> = text.split(',').map(id).collect();
        let ids = ids.ok_or("write node-ids from 1 to 127 with commas between, or none")?;
        let twice = (1..ids.len()).any(|n| ids[..n].contains(&ids[n]));
        if twice {
            return Err("each node-id may be given once".to_owned());
        }
        Ok(Self(Some(ids)))
    }
}

/// Which instrument is built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// Two axes, 400 samples/s
    Product,
    /// Two axes by a part with a gyroscope, 417 samples/s: the angle while the machine moves
    Dynamic,
    /// The paper's: 50 samples/s, tables; it has the product's objects in addition to its own
    Paper,
    /// One axis over 360 deg
    OneAxis,
}

impl From<Mode> for bench::Mode {
    fn from(mode: Mode) -> Self {
        match mode {
            Mode::Product => Self::Product,
            Mode::Dynamic => Self::Dynamic,
            Mode::Paper => Self::Paper,
            Mode::OneAxis => Self::OneAxis,
        }
    }
}

fn bit_rate(text: &str) -> Result<u16, String> {
    let rate = text.parse().ok().filter(|rate| BIT_RATES.contains(rate));
    rate.ok_or_else(|| format!("take one of {BIT_RATES:?} kbit/s"))
}

/// Faster than that a die would move as no real one does, which a node takes for a fault.
fn chamber_speed(text: &str) -> Result<f64, String> {
    let factor = text.parse().ok();
    let factor = factor.filter(|factor: &f64| (1.0..=300.0).contains(factor));
    factor.ok_or_else(|| "take a factor from 1 to 300".to_owned())
}

/// What is served, where and how.
#[derive(Clone, Debug, Args)]
#[command(after_help = format!("Words, typed or in a script:\n{}", help()))]
pub struct Arguments {
    /// Where socketcand clients connect; port 0 for any free one
    #[arg(long, default_value_t = SOCKETCAND_AT, value_name = "ADDRESS:PORT")]
    pub listen: SocketAddr,
    /// The channel that socketcand clients open
    #[arg(long, default_value = "plumb", value_name = "NAME")]
    pub bus_name: String,
    /// Where SLCAN clients connect over TCP as well
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub slcan: Option<SocketAddr>,
    /// Make a pseudo-terminal for an SLCAN client as well
    #[arg(long)]
    pub pty: bool,
    /// Join this CAN interface of the kernel as well
    #[arg(long, value_name = "INTERFACE")]
    pub can: Option<String>,
    /// Let programs turn the housing by the commands of a motor (docs/motor.md), over TCP
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub motor: Option<SocketAddr>,
    /// Let programs set the air temperature by commands of a chamber (docs/chamber.md), over TCP
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub chamber: Option<SocketAddr>,
    /// Where `plumb twin` sends its words; else 127.0.0.1 and the port above that of --listen,
    /// or any free one when that is in use
    #[arg(long, value_name = "ADDRESS:PORT")]
    pub twin: Option<SocketAddr>,
    /// How many times as fast as 2 degC/min the chamber ramps and the sensors follow it, 1 to 300
    #[arg(long, default_value_t = 1.0, value_parser = chamber_speed, value_name = "FACTOR")]
    pub chamber_speed: f64,
    /// Bit rate of the bus in kbit/s
    #[arg(long, default_value = "250", value_parser = bit_rate, value_name = "KBIT/S")]
    pub bit_rate: u16,
    /// Which instrument is built
    #[arg(long, value_enum, default_value_t = Mode::Product)]
    pub mode: Mode,
    /// Node-ids in the order a, b, a2, b2, ..., or none; the default is 1, 2, 3, 4, ...
    #[arg(long, value_name = "ID,ID,...|none")]
    pub node_ids: Option<NodeIds>,
    /// Instruments on the bus, two nodes each, all on one housing
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=20))]
    pub instruments: u8,
    /// Seed of every random draw: parts, noise, faults
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Leave out the calibration on the virtual bench, which takes a third of a second each
    #[arg(long)]
    pub uncalibrated: bool,
    /// Pace: real, max, or a factor of real time
    #[arg(long, default_value = "real", value_name = "real|max|FACTOR")]
    pub speed: Speed,
    /// Let virtual time begin when the first client has opened the bus
    #[arg(long)]
    pub await_client: bool,
    /// File with motion and faults, one of the words below per line
    #[arg(long, value_name = "FILE")]
    pub script: Option<PathBuf>,
    /// Folder that keeps the nodes' stored parameters and node-ids across a restart
    #[arg(long, value_name = "DIR")]
    pub state: Option<PathBuf>,
    /// Do not read commands from the standard input
    #[arg(long)]
    pub no_stdin: bool,
    /// Print the output as JSON: the address of the bus, and the answers of `status` and `help`
    #[arg(long)]
    pub json: bool,
}

impl Arguments {
    /// The node-id of each node.
    ///
    /// Errors: [`ServeError::NodeIds`] when there are more or fewer of them than nodes.
    pub fn node_ids(&self) -> Result<Vec<Option<u8>>, ServeError> {
        let nodes = 2 * usize::from(self.instruments);
        match &self.node_ids {
            None => Ok((1..).map(Some).take(nodes).collect()),
            Some(NodeIds(None)) => Ok(vec![None; nodes]),
            Some(NodeIds(Some(ids))) if ids.len() == nodes => {
                Ok(ids.iter().copied().map(Some).collect())
            }
            Some(NodeIds(Some(ids))) => Err(ServeError::NodeIds(ids.len(), nodes)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn parsed(words: &[&str]) -> Result<Arguments, String> {
        let all = ["serve"].iter().chain(words);
        let line = Line::try_parse_from(all).map_err(|e| e.to_string())?;
        Ok(line.arguments)
    }

    #[test]
    fn nodes_are_counted_from_one_unless_told_otherwise() {
        let ids = |words: &[&str]| parsed(words).unwrap().node_ids().unwrap();
        assert_eq!(ids(&[]), [Some(1), Some(2)]);
        assert_eq!(ids(&["--instruments", "2"]), [1, 2, 3, 4].map(Some));
        assert_eq!(ids(&["--node-ids", "7, 9"]), [Some(7), Some(9)]);
        assert_eq!(ids(&["--node-ids", "none"]), [None, None]);
    }

    #[test]
    fn node_ids_that_do_not_fit_are_refused() {
        for ids in ["0,1", "1,128", "1,1", "a,b", ""] {
            assert!(parsed(&["--node-ids", ids]).is_err(), "{ids:?}");
        }
        let told = parsed(&["--node-ids", "1"]).unwrap().node_ids();
        let told = told.unwrap_err().to_string();
        assert!(told.contains("1 node-id for 2 nodes"), "{told}");
    }

    #[test]
    fn the_bit_rate_is_one_of_the_standard_s() {
        assert_eq!(parsed(&["--bit-rate", "1000"]).unwrap().bit_rate, 1000);
        assert!(parsed(&["--bit-rate", "300"]).unwrap_err().contains("250"));
    }
}
