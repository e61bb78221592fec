//! The bytes of the fault log and of the black box (docs/canopen.md).
//!
//! In: what a node gives for 2070h and 2071h, or a file of it. Out: [`FaultLog`] and [`Samples`].
//! Longer entries and frames than today's are taken, and what they have more is passed over;
//! another version is not.

use device::fault_log::{ENTRY, Entry};

use listen::{Activity, Measured};

/// The version that is known.
const VERSION: u8 = 1;

/// Bytes of a frame, at least.
const FRAME: usize = 34;

/// Bytes of a box before its event.
const BOX_HEAD: usize = 8;

/// Bytes of a fault log before its first entry.
const LOG_HEAD: usize = 4;

/// Why bytes are neither fault log nor box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// There are none, or not even the head: so many.
    #[error("{0} bytes are neither a fault log (2070h) nor a black box (2071h)")]
    Short(usize),
    /// Another version of the format.
    #[error("it is of version {0} of the format, and this program reads version 1")]
    Version(u8),
    /// The length of an entry or frame is none that there can be.
    #[error(
        "entries of {0} bytes are neither those of a fault log (20) nor those of a black box (34)"
    )]
    Length(u8),
    /// Fewer entries or frames are there than the head states.
    #[error("it ends before the last entry that its header announces")]
    Cut,
}

/// The fault log (2070h).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FaultLog {
    /// Entries made since it was emptied; 255 for more.
    pub made: u8,
    /// Those that are left, newest first.
    pub entries: Vec<Entry>,
}

/// One SYNC of a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// TPDO 3 of this channel and of the other one.
    pub measured: [Measured; 2],
    /// TPDO 4 of both.
    pub activity: [Activity; 2],
    /// State of the pair (2021h).
    pub state: u8,
    /// Channel that is blamed: 0 none, 1 this one, 2 the other, 3 both.
    pub blamed: u8,
    /// Why (2025h).
    pub reason: u8,
}

/// A box (2071h): the samples around an event.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// The event.
    pub entry: Entry,
    /// Time from frame to frame, us; `None` for a single frame.
    pub period_us: Option<u32>,
    /// Frames up to the event.
    pub before: usize,
    /// All frames, oldest first.
    pub frames: Vec<Frame>,
}

/// What a file holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Memory {
    /// A fault log.
    Log(FaultLog),
    /// A box.
    Box(Samples),
}

/// Reads either.
///
/// Errors: see [`DecodeError`].
pub fn either(bytes: &[u8]) -> Result<Memory, DecodeError> {
    match bytes {
        [_, length, ..] if usize::from(*length) >= FRAME => samples(bytes).map(Memory::Box),
        _ => fault_log(bytes).map(Memory::Log),
    }
}

/// Version and length, and then the rest.
fn head(bytes: &[u8], least: usize, most: usize) -> Result<usize, DecodeError> {
    let [version, length, ..] = bytes else {
        return Err(DecodeError::Short(bytes.len()));
    };
    if *version != VERSION {
        return Err(DecodeError::Version(*version));
    }
    let known = (least..most).contains(&usize::from(*length));
    known
        .then_some(usize::from(*length))
        .ok_or(DecodeError::Length(*length))
}

/// Reads a fault log.
///
/// Errors: see [`DecodeError`].
pub fn fault_log(bytes: &[u8]) -> Result<FaultLog, DecodeError> {
    let length = head(bytes, ENTRY, FRAME)?;
    let Some((&[_, _, count, made], rest)) = bytes.split_first_chunk::<LOG_HEAD>() else {
        return Err(DecodeError::Short(bytes.len()));
    };
    let entries: Option<Vec<Entry>> = rest
        .chunks(length)
        .take(usize::from(count))
        .map(entry)
        .collect();
    let entries = entries.filter(|entries| entries.len() == usize::from(count));
    Ok(FaultLog {
        made,
        entries: entries.ok_or(DecodeError::Cut)?,
    })
}

/// The first bytes of these as an entry.
fn entry(bytes: &[u8]) -> Option<Entry> {
    bytes.first_chunk().map(Entry::decode)
}

/// Reads a box.
///
/// Errors: see [`DecodeError`].
pub fn samples(bytes: &[u8]) -> Result<Samples, DecodeError> {
    let length = head(bytes, FRAME, usize::from(u8::MAX) + 1)?;
    let short = DecodeError::Short(bytes.len());
    let (&[_, _, before, after, p0, p1, p2, p3], rest) =
        bytes.split_first_chunk::<BOX_HEAD>().ok_or(short)?;
    let entry = entry(rest).ok_or(short)?;
    let rest = rest.get(ENTRY..).ok_or(short)?;
    let count = usize::from(before) + usize::from(after);
    let frames: Option<Vec<Frame>> = rest.chunks(length).take(count).map(frame).collect();
    let frames = frames.filter(|frames| frames.len() == count);
    let period_us = u32::from_le_bytes([p0, p1, p2, p3]);
    Ok(Samples {
        entry,
        period_us: (period_us > 0).then_some(period_us),
        before: before.into(),
        frames: frames.ok_or(DecodeError::Cut)?,
    })
}

fn frame(bytes: &[u8]) -> Option<Frame> {
    let (bytes, _) = bytes.split_first_chunk::<FRAME>()?;
    let measured = |from: usize| Measured::read(bytes.get(from..from + 8)?);
    let activity = |from: usize| Activity::read(bytes.get(from..from + 8)?);
    let [.., state, verdict] = *bytes;
    Some(Frame {
        measured: [measured(0)?, measured(16)?],
        activity: [activity(8)?, activity(24)?],
        state,
        blamed: verdict >> 6,
        reason: verdict & 0x3F,
    })
}

impl Samples {
    /// Time of a frame since the frame of the event, s.
    pub fn since_s(&self, number: usize) -> f64 {
        let frames = number as f64 - self.before.saturating_sub(1) as f64;
        frames * f64::from(self.period_us.unwrap_or(0)) * 1e-6
    }
}

#[cfg(test)]
mod tests {
    use device::black_box::{self, BlackBox};
    use device::fault_log;
    use instant::Instant;
    use proptest::prelude::*;

    use super::*;

    fn upload(length: u32, read: impl Fn(u32, &mut [u8]) -> usize) -> Vec<u8> {
        let mut bytes = vec![0; length as usize];
        assert_eq!(read(0, &mut bytes), bytes.len());
        bytes
    }

    fn event(at_ms: u32) -> Entry {
        Entry {
            at_ms,
            sync: 77,
            code: 0xFF13,
            faults: 1 << 12,
            state: 6,
            blamed: 2,
            reason: 13,
            ..Entry::default()
        }
    }

    #[test]
    fn a_log_reads_as_the_device_has_written_it() {
        let mut log = fault_log::FaultLog::new();
        for n in 0..20 {
            log.add(event(n * 5000));
            log.in_box(2);
        }
        let length = log.open();
        let bytes = upload(length, |offset, into| log.read_at(offset, into));
        let Ok(Memory::Log(read)) = either(&bytes) else {
            panic!("a log");
        };
        assert_eq!(read.made, 20);
        assert_eq!(read.entries, log.iter().copied().collect::<Vec<_>>());
        assert_eq!(read.entries[0].box_number, 2);
    }

    #[test]
    fn a_box_reads_as_the_device_has_written_it() {
        let mut recorder = BlackBox::new();
        let mut own = [0; 16];
        // 45 deg, known to 0.002 deg; 1 g along Z, twice its noise.
        own[..8].copy_from_slice(&[0, 0, 0x20, 0, 0, 0xE0, 48, 15]);
        own[8..].copy_from_slice(&[0, 0, 0, 0x80, 0, 0x20, 7, 72]);
        let frame = black_box::Frame {
            own,
            peer: [0; 16],
            state: 8,
            blamed_reason: black_box::blamed_reason(2, 15),
        };
        for n in 0..50 {
            recorder.record(&frame, Instant(n * 10_000));
            if n == 40 {
                recorder.trigger(event(400), Instant(n * 10_000));
            }
        }
        let at = Instant(500_000);
        let length = recorder.open(1, at).unwrap();
        let mut bytes = vec![0; length as usize];
        let read = recorder.read_at(1, 0, &mut bytes, at, &mut |_, _| 0);
        assert_eq!(read, bytes.len());
        let Ok(Memory::Box(read)) = either(&bytes) else {
            panic!("a box");
        };
        assert_eq!((read.before, read.frames.len()), (32, 41));
        assert_eq!((read.entry.at_ms, read.period_us), (400, Some(10_000)));
        assert_eq!((read.since_s(31), read.since_s(0)), (0.0, -0.31));
        let frame = read.frames[0];
        assert_eq!((frame.state, frame.blamed, frame.reason), (8, 2, 15));
        assert_eq!(frame.measured[0].mdeg(0), Some(45_000));
        assert_eq!(frame.measured[0].mdeg(1), None);
        assert_eq!(frame.activity[0].force_g, [Some(0.0), None, Some(1.0)]);
        assert_eq!(frame.activity[0].noise(), Some(2.0));
    }

    #[test]
    fn what_is_neither_is_refused_with_the_reason() {
        assert_eq!(either(&[]), Err(DecodeError::Short(0)));
        assert_eq!(either(&[1, 20]), Err(DecodeError::Short(2)));
        assert_eq!(either(&[2, 20, 0, 0]), Err(DecodeError::Version(2)));
        assert_eq!(either(&[1, 3, 0, 0]), Err(DecodeError::Length(3)));
        assert_eq!(either(&[1, 20, 1, 1, 0]), Err(DecodeError::Cut));
        assert_eq!(
            either(&[1, 34, 1, 1, 0, 0, 0, 0, 9]),
            Err(DecodeError::Short(9))
        );
    }

    #[test]
    fn a_later_device_may_send_more() {
        let mut bytes = vec![1, 22, 1, 1];
        bytes.extend([0; 22]);
        assert_eq!(fault_log(&bytes).unwrap().entries.len(), 1);
    }

    proptest! {
        #[test]
        fn whatever_comes_is_read_or_refused(
            kind in prop_oneof![Just(20_u8), Just(34), any::<u8>()],
            rest in prop::collection::vec(any::<u8>(), 0..2000),
        ) {
            let mut bytes = vec![1, kind];
            bytes.extend(&rest);
            let _ = either(&bytes);
            let _ = either(&rest);
        }
    }
}
