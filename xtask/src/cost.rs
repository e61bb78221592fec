//! What steps have cost: time by the clock, and by the processors.
//!
//! In: a name, and what it took. Out: lines for the end of a run, the most costly first. Steps that
//! run side by side with others take longer by the clock; what they take of the processors stays
//! the same.
//!
//! Left out: processor time on systems other than Linux, where only the clock is told.

use std::cmp::Reverse;
use std::fs;
use std::time::Duration;

/// The kernel's units of processor time (proc(5), `sysconf(_SC_CLK_TCK)`) in a second.
const TICKS_PER_S: f64 = 100.0;

/// Fields of `/proc/self/stat` behind the name: processor time of this process and of its
/// children that have ended, each in user and in kernel mode.
const TIMES: std::ops::Range<usize> = 11..15;

/// What one step has cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Cost {
    /// The step's heading.
    pub name: &'static str,
    /// By the clock.
    pub took: Duration,
    /// By the processors, s.
    pub processor_s: Option<f64>,
}

/// Processor time of this process and of all children that have ended, s.
pub fn processor_s() -> Option<f64> {
    spent(&fs::read_to_string("/proc/self/stat").ok()?)
}

fn spent(stat: &str) -> Option<f64> {
    let (_, fields) = stat.rsplit_once(')')?;
    let fields: Vec<&str> = fields.split_whitespace().collect();
    let times = fields.get(TIMES)?.iter().map(|field| field.parse::<f64>());
    let ticks: f64 = times.sum::<Result<f64, _>>().ok()?;
    Some(ticks / TICKS_PER_S)
}

/// A line for each, the most costly first.
pub fn lines(mut costs: Vec<Cost>) -> Vec<String> {
    costs.sort_by_key(|cost| Reverse(cost.took));
    costs.iter().map(line).collect()
}

fn line(cost: &Cost) -> String {
    let took_s = cost.took.as_secs_f64();
    let processor = match cost.processor_s {
        Some(processor_s) => format!("{processor_s:7.1} s"),
        None => format!("{:>9}", "unknown"),
    };
    format!("{took_s:7.1} s {processor}  {}", cost.name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn processor_time_is_read_behind_a_name_with_spaces_and_brackets() {
        let stat = "7 (a ) b) S 1 2 3 4 5 6 7 8 9 10 100 20 3000 4 0 0";
        assert_eq!(spent(stat), Some(31.24));
        assert_eq!(spent("7 (a) S 1"), None);
        assert_eq!(spent(""), None);
    }

    #[test]
    fn the_most_costly_step_comes_first() {
        let cost = |name, took_s, processor_s| Cost {
            name,
            took: Duration::from_secs(took_s),
            processor_s,
        };
        let told = lines(vec![cost("short", 2, None), cost("long", 30, Some(55.5))]);
        let expected = ["   30.0 s    55.5 s  long", "    2.0 s   unknown  short"];
        assert_eq!(told, expected);
    }
}
