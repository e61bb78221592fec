//! What `plumb monitor` is asked to do.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;

use super::MonitorError;
use bus_master::BusOptions;
use listen::Plan;

/// Longest time that can be asked for: a year.
const MOST_S: f64 = 366.0 * 86_400.0;

/// Listens to a bus and sends nothing, unless `--start` or `--sync` says so.
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
    /// Skip gaps of a log that are longer than two seconds
    #[arg(long, requires = "log")]
    pub skip_gaps: bool,
    /// Node-ids of channel A and B; of several instruments A,B,A,B [default: 1,2]
    #[arg(long, value_name = "A,B", value_delimiter = ',',
          value_parser = clap::value_parser!(u8).range(1..=127))]
    pub nodes: Vec<u8>,
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
    /// Overwrite an existing recording
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
    /// The instruments to be watched.
    ///
    /// Errors: the node-ids make no pairs, or one of them is there twice.
    pub fn plan(&self) -> Result<Plan, MonitorError> {
        plan(&self.nodes)
    }

    /// The nodes of a plan that are to be started.
    pub fn to_start(&self, plan: &Plan) -> Vec<u8> {
        if !self.start {
            return Vec::new();
        }
        plan.pairs.iter().flatten().copied().collect()
    }
}

fn plan(nodes: &[u8]) -> Result<Plan, MonitorError> {
    let (pairs, rest) = nodes.as_chunks();
    let twice = (1..nodes.len()).any(|at| nodes[..at].contains(&nodes[at]));
    if twice || !rest.is_empty() {
        return Err(MonitorError::Nodes);
    }
    if pairs.is_empty() {
        return Ok(Plan::default());
    }
    Ok(Plan::of(pairs.to_vec()))
}

/// How fast.
fn speed(text: &str) -> Result<f64, String> {
    if text == "max" {
        return Ok(f64::INFINITY);
    }
    let number = text.trim_end_matches('x').parse::<f64>().ok();
    let number = number.filter(|times| (0.001..=1e6).contains(times));
    number.ok_or_else(|| "0.001 to 1000000 times, or max".to_owned())
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
    fn nodes_come_in_pairs_and_once_each() {
        let pairs = |nodes: &[u8]| plan(nodes).ok().map(|plan| plan.pairs);
        assert_eq!(pairs(&[]), Some(vec![[1, 2]]));
        assert_eq!(pairs(&[17, 3, 1, 2]), Some(vec![[17, 3], [1, 2]]));
        for wrong in [&[1][..], &[1, 1], &[1, 2, 3], &[1, 2, 2, 3]] {
            assert_eq!(pairs(wrong), None);
        }
    }

    #[test]
    fn a_speed_is_a_number_or_max() {
        assert_eq!(speed("10"), Ok(10.0));
        assert_eq!(speed("0.5x"), Ok(0.5));
        assert_eq!(speed("max"), Ok(f64::INFINITY));
        for wrong in ["0", "-1", "fast", "NaN", "inf", ""] {
            assert!(speed(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_period_is_whole_milliseconds() {
        assert_eq!(milliseconds("10"), Ok(Duration::from_millis(10)));
        assert_eq!(milliseconds("10ms"), Ok(Duration::from_millis(10)));
        assert!(milliseconds("0").is_err() && milliseconds("1.5").is_err());
    }
}
