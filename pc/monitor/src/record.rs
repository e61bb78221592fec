//! Recording: everything that comes, in a file whose lines are whole at any time.
//!
//! In: frames with their time. Out: a log in the format of its name, `.asc` or else `candump -L`.
//! Lines are gathered and handed to the system at least once a second; of a write that fails the
//! piece of a line is cut off again, so what is in the file is whole.
//!
//! Left out: the format (`log`).

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use canopen::Frame;

use super::MonitorError;
use bus_logs::{Format, Writer};

/// Lines wait no longer than this.
const HELD_BACK: Duration = Duration::from_millis(500);

/// Nor are there more of them than these bytes.
const MOST_BYTES: usize = 1 << 16;

/// A file to which whole pieces are added, or nothing.
#[derive(Debug)]
struct Whole<F> {
    file: F,
    pending: Vec<u8>,
    /// Bytes in the file that are whole.
    length: u64,
}

/// What can be cut to a length.
trait Cut {
    /// Cuts to this length.
    fn cut(&mut self, length: u64) -> io::Result<()>;
}

impl Cut for File {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        use io::Seek;
        self.set_len(length)?;
        self.seek(io::SeekFrom::End(0)).map(drop)
    }
}

impl<F: Write + Cut> Write for Whole<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.pending.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.pending.is_empty() {
            return Ok(());
        }
        let written = self.file.write_all(&self.pending);
        if let Err(error) = written {
            // What can't be cut either stays as it is; the first error is the one to tell.
            let _ = self.file.cut(self.length);
            self.pending.clear();
            return Err(error);
        }
        self.length += self.pending.len() as u64;
        self.pending.clear();
        Ok(())
    }
}

/// Whether a recording by this name can be begun, as far as can be told without making the file.
///
/// Errors: the file exists and `force` is not given, its folder does not, or its name promises a
/// compressed file.
pub fn may_be(path: &Path, force: bool) -> Result<(), MonitorError> {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    let packed = ["gz", "bz2", "xz", "zst", "zip"];
    if ending.is_some_and(|ending| packed.iter().any(|packed| ending == *packed)) {
        return Err(MonitorError::Compressed(path.to_owned()));
    }
    if path.is_file() && !force {
        return Err(MonitorError::Exists(path.to_owned()));
    }
    match path.parent().filter(|folder| *folder != Path::new("")) {
        Some(folder) if !folder.is_dir() => {
            let error = io::Error::new(io::ErrorKind::NotFound, "there is no such folder");
            Err(MonitorError::Create(path.to_owned(), error))
        }
        _ => Ok(()),
    }
}

/// A recording under way.
#[derive(Debug)]
pub struct Recorder {
    writer: Writer<Whole<File>>,
    path: PathBuf,
    frames: u64,
    /// Of these frames nothing has been handed to the system yet.
    held: u64,
    bytes_held: usize,
    flushed: Instant,
}

/// The most that a frame's line takes.
const LINE_BYTES: usize = 80;

impl Recorder {
    /// Creates the file; one that exists is taken only with `force`. A device or a pipe is written
    /// into.
    ///
    /// Errors: what the system reports, [`io::ErrorKind::AlreadyExists`] above all.
    pub fn create(path: &Path, force: bool) -> io::Result<Self> {
        let mut options = OpenOptions::new();
        options.write(true);
        let is_special = fs::metadata(path).is_ok_and(|about| !about.is_file());
        if force || is_special {
            options.create(true).truncate(true);
        } else {
            options.create_new(true);
        }
        let file = options.open(path)?;
        let whole = Whole {
            file,
            pending: Vec::new(),
            length: 0,
        };
        Ok(Self {
            writer: Writer::new(whole, Format::of(path)),
            path: path.to_owned(),
            frames: 0,
            held: 0,
            bytes_held: 0,
            flushed: Instant::now(),
        })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Frames that are in the file.
    pub const fn frames(&self) -> u64 {
        self.frames
    }

    /// Takes a frame.
    ///
    /// Errors: what the system reports; the recording is over then and whole as far as it goes.
    pub fn take(&mut self, time_ns: u64, interface: &str, frame: &Frame) -> io::Result<()> {
        self.writer.write(time_ns, interface, frame)?;
        self.held += 1;
        self.bytes_held += LINE_BYTES;
        if self.bytes_held >= MOST_BYTES {
            self.flush()?;
        }
        Ok(())
    }

    /// Hands over what has waited long enough.
    ///
    /// Errors: as [`Recorder::take`].
    pub fn pass(&mut self, now: Instant) -> io::Result<()> {
        if now.saturating_duration_since(self.flushed) < HELD_BACK {
            return Ok(());
        }
        self.flushed = now;
        self.flush()
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()?;
        self.frames += std::mem::take(&mut self.held);
        self.bytes_held = 0;
        Ok(())
    }

    /// Writes what belongs to the end; the number of frames.
    ///
    /// Errors: as [`Recorder::take`].
    pub fn finish(mut self) -> io::Result<u64> {
        self.flush()?;
        let frames = self.frames;
        self.writer.finish().map(|_| frames)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk with room for so many bytes.
    struct Disk {
        bytes: Vec<u8>,
        room: usize,
    }

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let left = self.room - self.bytes.len();
            if left == 0 {
                return Err(io::ErrorKind::StorageFull.into());
            }
            let taken = left.min(bytes.len());
            self.bytes.extend_from_slice(&bytes[..taken]);
            Ok(taken)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Cut for Disk {
        fn cut(&mut self, length: u64) -> io::Result<()> {
            self.bytes.truncate(length as usize);
            Ok(())
        }
    }

    #[test]
    fn a_full_disk_leaves_whole_lines() {
        let disk = Disk {
            bytes: Vec::new(),
            room: 100,
        };
        let mut whole = Whole {
            file: disk,
            pending: Vec::new(),
            length: 0,
        };
        let line = b"a line of thirty bytes, whole\n";
        for count in 1..=3 {
            whole.write_all(line).unwrap();
            whole.flush().unwrap();
            assert_eq!(whole.length, 30 * count);
        }
        whole.write_all(line).unwrap();
        let error = whole.flush().unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
        assert_eq!(whole.file.bytes.len(), 90);
        assert!(whole.file.bytes.ends_with(b"whole\n"));
    }

    fn folder(name: &str) -> PathBuf {
        let name = format!("plumb-record-{}-{name}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn a_file_that_exists_is_left_alone_without_force() {
        let folder = folder("exists");
        let path = folder.join("bus.log");
        std::fs::write(&path, "precious").unwrap();
        let error = Recorder::create(&path, false).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
        let mut recorder = Recorder::create(&path, true).unwrap();
        let frame = Frame::data_frame(0x80, &[]);
        recorder.take(1_500_000_000, "can0", &frame).unwrap();
        assert_eq!(recorder.frames(), 0);
        recorder.pass(Instant::now() + HELD_BACK * 2).unwrap();
        assert_eq!(recorder.frames(), 1);
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text, "(0000000001.500000) can0 080#\n");
        assert_eq!(recorder.finish().unwrap(), 1);
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_recording_named_gz_was_plain_text() {
        for name in ["bus.log.gz", "bus.asc.GZ", "bus.zst"] {
            let refused = may_be(Path::new(name), true).unwrap_err();
            assert!(matches!(refused, MonitorError::Compressed(_)), "{name}");
        }
        may_be(Path::new("no such file.log"), false).unwrap();
    }

    #[test]
    fn a_recording_into_no_folder_was_said_to_be_whole() {
        let folder = folder("nowhere");
        let path = folder.join("none").join("bus.log");
        let sentence = may_be(&path, false).unwrap_err().to_string();
        assert!(
            sentence.starts_with("nothing can be recorded to "),
            "{sentence}"
        );
        assert!(sentence.contains("there is no such folder"), "{sentence}");
        assert!(!sentence.contains("whole"), "{sentence}");
        may_be(&folder.join("bus.log"), false).unwrap();
        std::fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn the_name_chooses_the_format() {
        let folder = folder("asc");
        let path = folder.join("bus.ASC");
        let mut recorder = Recorder::create(&path, false).unwrap();
        let frame = Frame::data_frame(0x181, &[1, 2]);
        recorder.take(1_500_000_000, "can0", &frame).unwrap();
        assert_eq!(recorder.finish().unwrap(), 1);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.contains("181"), "{text}");
        assert!(text.ends_with("End TriggerBlock\r\n"), "{text}");
        std::fs::remove_dir_all(folder).unwrap();
    }
}
