//! Frames of one log or many, in the order of time.
//!
//! In: files and folders. Out: [`Source`]. Each file is looked at before the first frame is given,
//! for its kind and the time that it begins with, and is opened again at its turn. Files that
//! overlap are merged. Within a file frames keep their order, even where time goes backwards.
//! A file whose times count from its own start does not state when that was: such files follow
//! one another in the order in which they were given, each begun where the one before ended.

use std::collections::VecDeque;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::date::is_dated;
use crate::folder::{Candidate, candidates, cannot_read};
use crate::input::{Input, is_stdin};
use crate::reader::{Interfaces, Reader};
use crate::skipped::Skipped;
use crate::sniff::{self, Kind};
use crate::{LogError, Logged};
use output::progress::{Progress, Task};

/// Logs that may overlap.
const MOST_AT_ONCE: usize = 64;

/// A log whose turn has not come.
struct Waiting {
    file: usize,
    path: PathBuf,
    kind: Kind,
    first_ns: u64,
    /// What can't be opened again.
    input: Option<Input>,
}

/// A log under way, and the frame that it gives next.
struct Open {
    reader: Reader,
    head: Logged,
}

/// Reads logs.
pub struct Source {
    files: Vec<String>,
    waiting: VecDeque<Waiting>,
    open: Vec<Open>,
    interfaces: Interfaces,
    skipped: Skipped,
    task: Option<Arc<Task>>,
    /// The end of the file without a date that was read last.
    undated_end_ns: Option<u64>,
    frames: u64,
}

/// The frames in the order of time; `None` at the end of all.
impl Iterator for Source {
    type Item = Result<Logged, LogError>;

    #[inline]
    fn next(&mut self) -> Option<Result<Logged, LogError>> {
        // One log, and no other begins before its next frame: nearly always so.
        if let [one] = self.open.as_mut_slice()
            && self
                .waiting
                .front()
                .is_none_or(|next| is_dated(one.head.time_ns) && next.first_ns > one.head.time_ns)
        {
            let given = one.head;
            match one.reader.next(&mut self.interfaces, &mut self.skipped) {
                Ok(Some(head)) => one.head = head,
                Ok(None) => self.close(0),
                Err(error) => {
                    self.close(0);
                    return Some(Err(error));
                }
            }
            self.frames += 1;
            return Some(Ok(given));
        }
        self.next_of_many()
    }
}

impl Source {
    /// Opens all logs behind these paths: files, folders, `-` for standard input.
    pub fn open(paths: &[PathBuf], progress: &Progress) -> Result<Self, LogError> {
        Self::of_interface(paths, None, progress)
    }

    /// The same, of one interface only; frames of the others are counted.
    pub fn of_interface(
        paths: &[PathBuf],
        interface: Option<&str>,
        progress: &Progress,
    ) -> Result<Self, LogError> {
        let candidates = candidates(paths)?;
        let bytes = candidates.iter().map(|one| one.length).sum();
        let task = Some(Arc::new(progress.task("Reading", bytes)));
        let mut source = Self::empty(interface, task);
        for candidate in candidates {
            source.look(candidate)?;
        }
        if source.waiting.is_empty() {
            let first = paths.first().map(|path| path.display().to_string());
            return Err(LogError::NoLogs(first.unwrap_or_default()));
        }
        // Those without a date come first, in the order given.
        let rank = |log: &Waiting| {
            if is_dated(log.first_ns) {
                log.first_ns
            } else {
                0
            }
        };
        source.waiting.make_contiguous().sort_by_key(rank);
        Ok(source)
    }

    /// Opens one file, whose bytes go through what `through` makes of it.
    ///
    /// Errors: it is no log, or can't be read.
    pub fn of_file<R: Read + Send + 'static>(
        path: &Path,
        through: impl FnOnce(File) -> R,
    ) -> Result<Self, LogError> {
        let opened = File::open(path).and_then(|file| Input::new(through(file), None));
        let input = opened.map_err(|why| cannot_read(path, why))?;
        let candidate = Candidate {
            path: path.to_owned(),
            is_named: true,
            is_file: false,
            length: 0,
        };
        let mut source = Self::empty(None, None);
        source.look_into(candidate, path.display().to_string(), input)?;
        Ok(source)
    }

    fn empty(interface: Option<&str>, task: Option<Arc<Task>>) -> Self {
        Self {
            files: Vec::new(),
            waiting: VecDeque::new(),
            open: Vec::new(),
            interfaces: Interfaces::new(interface.map(str::to_owned)),
            skipped: Skipped::default(),
            task,
            undated_end_ns: None,
            frames: 0,
        }
    }

    /// Finds out what a file is.
    fn look(&mut self, candidate: Candidate) -> Result<(), LogError> {
        let path = &candidate.path;
        let name = if is_stdin(path) {
            "standard input".to_owned()
        } else {
            path.display().to_string()
        };
        // The bar counts what is read at its turn, or else bytes would be counted twice.
        let task = self.task.clone().filter(|_| !candidate.is_file);
        match Input::open(path, task) {
            Ok(input) => self.look_into(candidate, name, input),
            Err(_) if !candidate.is_named => {
                self.skipped.not_logs.push(name);
                Ok(())
            }
            Err(why) => Err(cannot_read(path, why)),
        }
    }

    /// The same of a file that is open.
    fn look_into(
        &mut self,
        candidate: Candidate,
        name: String,
        mut input: Input,
    ) -> Result<(), LogError> {
        let path = candidate.path;
        let is_gzip = input.is_gzip();
        let head = match input.head() {
            Ok(head) => sniff::look(head),
            Err(_) if !candidate.is_named || is_gzip => sniff::Head::default(),
            Err(why) => return Err(cannot_read(&path, why)),
        };
        let Some(kind) = head.kind else {
            if candidate.is_named {
                let refusal = head.refusal(&name);
                return Err(refusal.unwrap_or(LogError::NotALog(name)));
            }
            self.skipped.not_logs.push(name);
            return Ok(());
        };
        self.waiting.push_back(Waiting {
            file: self.files.len(),
            path,
            kind,
            first_ns: head.first_ns.unwrap_or(0),
            input: (!candidate.is_file).then_some(input),
        });
        self.files.push(name);
        Ok(())
    }

    fn next_of_many(&mut self) -> Option<Result<Logged, LogError>> {
        if let Err(error) = self.open_what_is_due() {
            return Some(Err(error));
        }
        let times = self.open.iter().map(|one| one.head.time_ns).enumerate();
        let (place, _) = times.min_by_key(|(_, time_ns)| *time_ns)?;
        let one = self.open.get_mut(place)?;
        let given = one.head;
        match one.reader.next(&mut self.interfaces, &mut self.skipped) {
            Ok(Some(head)) => one.head = head,
            Ok(None) => self.close(place),
            Err(error) => {
                self.close(place);
                return Some(Err(error));
            }
        }
        self.frames += 1;
        Some(Ok(given))
    }

    /// Opens each log that begins before the next frame, or the next one when none is open.
    fn open_what_is_due(&mut self) -> Result<(), LogError> {
        while let Some(next) = self.waiting.front() {
            let earliest_ns = self.open.iter().map(|one| one.head.time_ns).min();
            let is_due = earliest_ns.is_none_or(|ns| is_dated(ns) && next.first_ns <= ns);
            if !is_due {
                break;
            }
            if self.open.len() >= MOST_AT_ONCE {
                return Err(LogError::TooManyAtOnce(self.open.len() + 1));
            }
            if let Some(next) = self.waiting.pop_front() {
                self.start(next)?;
            }
        }
        Ok(())
    }

    fn start(&mut self, log: Waiting) -> Result<(), LogError> {
        let shift_ns = self.shift(&log);
        let input = match log.input {
            Some(input) => input,
            None => Input::open(&log.path, self.task.clone())
                .map_err(|why| cannot_read(&log.path, why))?,
        };
        let name = self.name(log.file);
        let mut reader = Reader::new(name, log.file, input, log.kind, shift_ns);
        let overlaps = !self.open.is_empty();
        if let Some(head) = reader.next(&mut self.interfaces, &mut self.skipped)? {
            self.skipped.overlapping += u64::from(overlaps);
            self.open.push(Open { reader, head });
        }
        Ok(())
    }

    /// How late a log without a date is, so that it follows the one before.
    fn shift(&mut self, log: &Waiting) -> u64 {
        if is_dated(log.first_ns) {
            return 0;
        }
        match self.undated_end_ns {
            Some(end_ns) if log.first_ns <= end_ns => {
                self.skipped.undated.push(log.file);
                end_ns - log.first_ns
            }
            _ => 0,
        }
    }

    fn close(&mut self, place: usize) {
        let closed = self.open.remove(place);
        let end_ns = closed.reader.end_ns();
        if !is_dated(end_ns) {
            self.undated_end_ns = Some(end_ns);
        }
    }

    /// What was no frame, so far.
    pub const fn skipped(&self) -> &Skipped {
        &self.skipped
    }

    /// What is missing of the logs, to be told when all that is there has been used; `None` when
    /// nothing is.
    pub fn incomplete(&self) -> Option<LogError> {
        let unread = self.skipped.unread();
        let damaged = self
            .skipped
            .damaged
            .first()
            .map(|(file, _)| self.name(*file));
        let is_whole = unread.count == 0 && damaged.is_none();
        (!is_whole).then(|| LogError::Incomplete {
            lines: unread.count,
            first: (self.name(unread.file), unread.line),
            damaged,
        })
    }

    /// Interfaces in the order in which they appeared.
    pub fn interfaces(&self) -> &[String] {
        self.interfaces.names()
    }

    /// The logs, by the places that [`Skipped`] tells.
    pub fn files(&self) -> &[String] {
        &self.files
    }

    /// The name of the log at this place.
    pub fn name(&self, place: usize) -> String {
        self.files.get(place).cloned().unwrap_or_default()
    }

    /// Frames given so far.
    pub const fn frames(&self) -> u64 {
        self.frames
    }
}
