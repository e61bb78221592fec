//! What `plumb monitor` is asked to do.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use bus_logs::{LONGEST_GAP_S, PartOptions, gap, speed};
use bus_master::BusOptions;
use listen::{Plan, PlanOptions};

/// Longest time that can be asked for: a year.
const MOST_S: f64 = 366.0 * 86_400.0;

/// Listens to a bus and sends nothing, unless `--start` or `--sync` is given.
#[derive(Debug, Args)]
pub struct Arguments {
    /// Logs instead of a bus: files or folders, candump -L or ASC, plain or gzip; -c is then the
    /// only interface that counts
    #[arg(long, value_name = "PATH", num_args = 1.., conflicts_with_all =
          ["bus", "record", "start", "sync", "reconnect"])]
    pub log: Vec<PathBuf>,
    /// Speed of a log: 10 is ten times as fast as recorded, max as fast as possible
    #[arg(long, value_name = "TIMES", default_value = "1", value_parser = speed)]
    pub speed: f64,
    /// Shorten gaps between two frames of a log to this many seconds, 2 when none are given
    #[arg(long, value_name = "S", num_args = 0..=1, default_missing_value = LONGEST_GAP_S,
          value_parser = gap, requires = "log")]
    pub skip_gaps: Option<Duration>,
    /// Which part of the logs.
    #[command(flatten)]
    pub part: PartOptions,
    /// Which instruments; one with nodes 1 and 2 by default.
    #[command(flatten)]
    pub plan: PlanOptions,
    /// Print a line each second and one for each event, as where the output is no terminal
    #[arg(long)]
    pub plain: bool,
    /// Print an object of JSON each second and one for each event
    #[arg(long, conflicts_with = "plain")]
    pub json: bool,
    /// Serve the same as a web page; an address other than the loopback shows it to the network
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1,
          default_missing_value = "127.0.0.1:8410", require_equals = false)]
    pub web: Option<SocketAddr>,
    /// Record every frame to a file: .asc is Vector ASC, any other name candump -L
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Replace the file of --record if it is there already
    #[arg(long, requires = "record")]
    pub force: bool,
    /// End after this time: 10s, 500ms, 5min, 2h
    #[arg(long = "for", value_name = "TIME", value_parser = time)]
    pub duration: Option<Duration>,
    /// Start the nodes (NMT) at the beginning
    #[arg(long)]
    pub start: bool,
    /// Send SYNC with this period in ms, as long as no other node does
    #[arg(long, value_name = "MS", value_parser = milliseconds)]
    pub sync: Option<Duration>,
    /// Try again each second when the bus is lost, instead of ending
    #[arg(long)]
    pub reconnect: bool,
    /// The bus
    #[command(flatten)]
    pub bus: BusOptions,
}

impl Arguments {
    /// The nodes of a plan that are to be started.
    pub fn to_start(&self, plan: &Plan) -> Vec<u8> {
        if !self.start {
            return Vec::new();
        }
        plan.pairs.iter().flatten().copied().collect()
    }
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
    if seconds == 0.0 || !(0.0..=MOST_S).contains(&seconds) {
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
        for text in ["", "s", "0s", "0", "-1s", "10 days", "1e99", "NaN", "inf"] {
            assert!(time(text).is_err(), "{text}");
        }
    }

    #[test]
    fn a_period_is_whole_milliseconds() {
        assert_eq!(milliseconds("10"), Ok(Duration::from_millis(10)));
        assert_eq!(milliseconds("10ms"), Ok(Duration::from_millis(10)));
        assert!(milliseconds("0").is_err() && milliseconds("1.5").is_err());
    }
}
