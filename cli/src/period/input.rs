//! Where frames come from.
//!
//! In: names of logs. Out: their frames with their time, one after the other, and what was
//! skipped.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;

use canopen::Frame;
use canopen::frame::{ExtendedId, StandardId};

use super::data::{LogReport, Skipped};
use super::error::PeriodError;

/// Reads one log; `take` gets each frame with its time in ns.
pub fn read(path: &PathBuf, mut take: impl FnMut(u64, &Frame)) -> Result<LogReport, PeriodError> {
    let name = path.display().to_string();
    let wrong = |why| PeriodError::Read(name.clone(), why);
    let mut lines = BufReader::new(File::open(path).map_err(wrong)?);
    let mut report = LogReport {
        file: name.clone(),
        frames: 0,
        skipped: Vec::new(),
    };
    let (mut line, mut number, mut odd) = (Vec::new(), 0, (0, 0));
    while lines.read_until(b'\n', &mut line).map_err(wrong)? > 0 {
        number += 1;
        match std::str::from_utf8(&line).ok().and_then(candump) {
            Some((time_ns, frame)) => {
                report.frames += 1;
                take(time_ns, &frame);
            }
            None if odd.0 == 0 => odd = (1, number),
            None => odd.0 += 1,
        }
        line.clear();
    }
    if odd.0 > 0 {
        report.skipped.push(Skipped {
            reason: "no frame".to_owned(),
            count: odd.0,
            first_line: odd.1,
        });
    }
    Ok(report)
}

/// `(1700000000.123456) can0 181#0102`.
fn candump(line: &str) -> Option<(u64, Frame)> {
    let mut words = line.split_whitespace();
    let time = words.next()?.strip_prefix('(')?.strip_suffix(')')?;
    let (s, us) = time.split_once('.')?;
    let time_ns = s.parse::<u64>().ok()? * 1_000_000_000 + us.parse::<u64>().ok()? * 1000;
    let (id, data) = words.nth(1)?.split_once('#')?;
    let number = u32::from_str_radix(id, 16).ok()?;
    let byte = |at: usize| u8::from_str_radix(data.get(at..at + 2)?, 16).ok();
    let bytes: Option<Vec<u8>> = (0..data.len()).step_by(2).map(byte).collect();
    let frame = match id.len() {
        8 => Frame::with(ExtendedId::new(number)?, &bytes?),
        _ => Frame::with(StandardId::new(number.try_into().ok()?)?, &bytes?),
    };
    Some((time_ns, frame?))
}
