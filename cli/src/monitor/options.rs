//! What `plumb monitor` is asked to do.

use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use crate::bus::BusOptions;
use crate::watch::Plan;

/// Longest time that can be asked for: a year.
const MOST_S: f64 = 366.0 * 86_400.0;

/// Listens to a bus and sends nothing, unless `--start` or `--sync` says so.
#[derive(Debug, Args)]
pub struct Arguments {
    #[command(flatten)]
    pub bus: BusOptions,
    /// Node-ids of channel A and B; once for each instrument [default: 1,2]
    #[arg(long, value_name = "A,B", value_parser = pair)]
    pub nodes: Vec<[u8; 2]>,
    /// Print a line each second and one for each event, as where the output is no terminal
    #[arg(long)]
    pub plain: bool,
    /// Print an object of JSON each second and one for each event
    #[arg(long, conflicts_with = "plain")]
    pub json: bool,
    /// Record every frame to a file: .asc is Vector ASC, any other name candump -L
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Write over a recording that exists
    #[arg(long, requires = "record")]
    pub force: bool,
    /// End after so long: 10s, 500ms, 5min, 2h
    #[arg(long = "for", value_name = "TIME", value_parser = time)]
    pub duration: Option<Duration>,
    /// Start the nodes (NMT) at the beginning
    #[arg(long)]
    pub start: bool,
    /// Send SYNC each so many ms, as long as nobody else does
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    pub sync: Option<Duration>,
    /// Try again each second when the bus is lost, instead of ending
    #[arg(long)]
    pub reconnect: bool,
}

impl Arguments {
    /// The instruments to be watched.
    pub fn plan(&self) -> Plan {
        if self.nodes.is_empty() {
            return Plan::default();
        }
        Plan {
            pairs: self.nodes.clone(),
        }
    }

    /// The nodes to be started.
    pub fn to_start(&self) -> Vec<u8> {
        if !self.start {
            return Vec::new();
        }
        self.plan().pairs.into_iter().flatten().collect()
    }
}

/// Two node-ids, as `1,2`.
fn pair(text: &str) -> Result<[u8; 2], String> {
    let wrong = || "two different node-ids of 1 to 127, as 1,2".to_owned();
    let (a, b) = text.split_once(',').ok_or_else(wrong)?;
    let id = |text: &str| {
        let id = text.trim().parse::<u8>().ok();
        id.filter(|id| (1..=127).contains(id)).ok_or_else(wrong)
    };
    let pair = [id(a)?, id(b)?];
    (pair[0] != pair[1]).then_some(pair).ok_or_else(wrong)
}

/// A time with its unit.
fn time(text: &str) -> Result<Duration, String> {
    let wrong = || "a time as 10s, 500ms, 5min or 2h".to_owned();
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit_s = match text.get(digits.len()..).unwrap_or("") {
        "" | "s" => 1.0,
        "ms" => 0.001,
        "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(wrong()),
    };
    let number: f64 = digits.trim().parse().map_err(|_| wrong())?;
    let seconds = number * unit_s;
    if !(0.0..=MOST_S).contains(&seconds) {
        return Err(wrong());
    }
    Ok(Duration::from_secs_f64(seconds))
}

/// A period of SYNC.
fn milliseconds(text: &str) -> Result<Duration, String> {
    let number = text.trim_end_matches("ms").trim().parse::<u64>().ok();
    let number = number.filter(|ms| (1..=10_000).contains(ms));
    number
        .map(Duration::from_millis)
        .ok_or_else(|| "1 to 10000 ms".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_have_units() {
        for (text, ms) in [
            ("10s", 10_000),
            ("500ms", 500),
            ("1.5", 1500),
            ("5min", 300_000),
            ("2h", 7_200_000),
        ] {
            assert_eq!(time(text), Ok(Duration::from_millis(ms)), "{text}");
        }
        for text in ["", "s", "-1s", "10 days", "1e99", "NaN", "inf"] {
            assert!(time(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_pair_is_two_different_node_ids() {
        assert_eq!(pair("1,2"), Ok([1, 2]));
        assert_eq!(pair("17, 3"), Ok([17, 3]));
        for text in ["1", "1,1", "0,2", "1,128", "a,b", "1,2,3", ""] {
            assert!(pair(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_period_is_whole_milliseconds() {
        assert_eq!(milliseconds("10"), Ok(Duration::from_millis(10)));
        assert_eq!(milliseconds("10ms"), Ok(Duration::from_millis(10)));
        assert!(milliseconds("0").is_err() && milliseconds("1.5").is_err());
    }
}
