//! What the nodes keep over a restart, in a folder.
//!
//! In: a folder, and the records of the nodes as they change. Out: the same records at the next
//! start. One file for each record of each node, named `a-lss`, `b2-profile` and so on: a line
//! with the check sum, then the record. A file is replaced as a whole, before the node's answer to
//! the command goes out.
//!
//! Left out: the downloaded program, and what a script has broken.

use std::fs;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use device::records::{Record, RecordStore};
use flash::check_sum::Crc32;
use output::write::{Existing, Staged};
use sim::memory::{self, Memory};

use super::stage::Stage;
use crate::error::ServeError;
use crate::words::reader::node_name;

/// The longest record, bytes.
const MOST_BYTES: usize = 4096;

/// A folder with the records of all nodes.
#[derive(Debug)]
pub struct Keep {
    folder: PathBuf,
    /// What is on the disk, by node and record.
    kept: Vec<[Vec<u8>; Record::ALL.len()]>,
}

impl Keep {
    /// Opens or makes a folder for so many nodes, and reads what it has.
    pub fn open(folder: &Path, nodes: usize) -> Result<Self, ServeError> {
        fs::create_dir_all(folder).map_err(|e| ServeError::Keep(folder.to_owned(), e))?;
        let mut keep = Self {
            folder: folder.to_owned(),
            kept: Vec::new(),
        };
        for node in 0..nodes {
            let mut records = <[Vec<u8>; Record::ALL.len()]>::default();
            for (record, bytes) in Record::ALL.into_iter().zip(&mut records) {
                *bytes = load(&keep.path(node, record))?;
            }
            keep.kept.push(records);
        }
        Ok(keep)
    }

    /// What a node finds in its memory.
    pub fn memory(&self, node: usize) -> Memory {
        let mut memory = memory::blank();
        for (record, bytes) in Record::ALL.into_iter().zip(&self.kept[node]) {
            if bytes.is_empty() {
                continue;
            }
            // A fresh memory is sound and has room for what another one held.
            let _ = RecordStore::begin(&mut memory, record, bytes.len() as u32);
            let _ = RecordStore::append(&mut memory, bytes);
            let _ = RecordStore::commit(&mut memory);
        }
        memory
    }

    /// Writes what has changed.
    pub fn save(&mut self, stage: &mut Stage) -> Result<(), ServeError> {
        for node in 0..self.kept.len() {
            let memory = stage.network.node(node).device.memory();
            for (place, record) in Record::ALL.into_iter().enumerate() {
                let bytes = committed(memory, record);
                let known = &mut self.kept[node][place];
                if *known != bytes {
                    known.clone_from(&bytes);
                    store(&self.path(node, record), &bytes)?;
                }
            }
        }
        Ok(())
    }

    fn path(&self, node: usize, record: Record) -> PathBuf {
        let record = match record {
            Record::Communication => "communication",
            Record::Profile => "profile",
            Record::Manufacturer => "manufacturer",
            Record::Lss => "lss",
            Record::Calibration => "calibration",
            Record::Delivered => "delivered",
            Record::Box1 => "box-1",
            Record::Box2 => "box-2",
            Record::Report => "report",
        };
        self.folder.join(format!("{}-{record}", node_name(node)))
    }
}

fn committed(memory: &mut Memory, record: Record) -> Vec<u8> {
    let mut bytes = vec![0; MOST_BYTES];
    let length = memory.read(record, 0, &mut bytes);
    bytes.truncate(length);
    bytes
}

/// The line before a record.
fn head(bytes: &[u8]) -> String {
    let mut crc = Crc32::new();
    crc.add(bytes);
    format!("plumb record {:08x}\n", crc.value())
}

/// The record in a file; empty when there is none.
fn load(path: &Path) -> Result<Vec<u8>, ServeError> {
    let all = match fs::read(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        read => read.map_err(|e| ServeError::Keep(path.to_owned(), e))?,
    };
    let split = head(&[]).len();
    let whole = all
        .split_at_checked(split)
        .filter(|(line, bytes)| bytes.len() <= MOST_BYTES && *line == head(bytes).as_bytes());
    let (_, bytes) = whole.ok_or_else(|| ServeError::Damaged(path.to_owned()))?;
    Ok(bytes.to_owned())
}

fn store(path: &Path, bytes: &[u8]) -> Result<(), ServeError> {
    let written = if bytes.is_empty() {
        fs::remove_file(path)
    } else {
        replace(path, &[head(bytes).as_bytes(), bytes].concat())
    };
    written.map_err(|e| ServeError::Keep(path.to_owned(), e))
}

/// Does not wait for the disk, since the nodes would stand still meanwhile.
fn replace(path: &Path, content: &[u8]) -> io::Result<()> {
    let staged = Staged::begin(path, Existing::Replace)?;
    staged.handle()?.write_all(content)?;
    staged.put_in_place()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_comes_back_and_a_damaged_one_is_named() {
        let folder = std::env::temp_dir().join(format!("plumb-keep-{}", std::process::id()));
        let path = folder.join("b-lss");
        let keep = Keep::open(&folder, 2).unwrap();
        assert_eq!(keep.path(1, Record::Lss), path);
        store(&path, &[1, 2, 3]).unwrap();
        let mut memory = Keep::open(&folder, 2).unwrap().memory(1);
        assert_eq!(committed(&mut memory, Record::Lss), [1, 2, 3]);
        assert_eq!(committed(&mut memory, Record::Profile), [0; 0]);
        let mut all = fs::read(&path).unwrap();
        all.pop();
        fs::write(&path, all).unwrap();
        let told = Keep::open(&folder, 2).unwrap_err().to_string();
        assert!(told.contains("b-lss is damaged"), "{told}");
        store(&path, &[]).unwrap();
        assert!(Keep::open(&folder, 2).is_ok());
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn a_record_that_could_not_be_kept_left_a_file() {
        let folder = std::env::temp_dir().join(format!("plumb-kept-not-{}", std::process::id()));
        let path = folder.join("b-lss");
        fs::create_dir_all(&path).unwrap();
        assert!(matches!(store(&path, &[1]), Err(ServeError::Keep(..))));
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
        fs::remove_dir_all(&folder).unwrap();
    }
}
