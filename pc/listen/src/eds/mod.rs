//! Reading electronic data sheets and device configurations (EDS and DCF, CiA 306) as they are
//! found in the world, which is seldom as the standard asks.
//!
//! In: the bytes of a file. Out: a [`Sheet`]: the objects with names, types and values, and a
//! a warning with its line for everything that is not as it should be and could be understood
//! all the same. From a sheet and a node-id comes a [`Device`]: what the node sends, and what each
//! PDO carries.
//!
//! Left out: limits, access rights and modules, which decoding does not need; writing
//! (`describe`).

mod error;
mod ini;
mod node;
mod number;
mod sheet;
#[cfg(test)]
mod tests;

pub use error::EdsError;
pub use node::{Device, Pdo, Signal};
pub use sheet::Sheet;

use std::path::{Path, PathBuf};

use output::unreadable::Unreadable;

/// A file, and the node that it describes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// The file.
    pub path: PathBuf,
    /// The node-id; that of the file when not given.
    pub node_id: Option<u8>,
}

impl std::str::FromStr for Request {
    type Err = String;

    /// `FILE`, or `FILE@NODE`.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let split = text.rsplit_once('@');
        let id = |text: &str| text.parse().ok().filter(|id| (1..=127).contains(id));
        match split.map(|(path, node)| (path, id(node), node)) {
            Some((path, Some(node_id), _)) if !path.is_empty() => Ok(Self {
                path: path.into(),
                node_id: Some(node_id),
            }),
            Some((_, None, node)) if node.bytes().all(|b| b.is_ascii_digit()) => Err(format!(
                "{node} is no node-id: write FILE@NODE with 1 to 127"
            )),
            _ => Ok(Self {
                path: text.into(),
                node_id: None,
            }),
        }
    }
}

impl Request {
    /// Reads the file.
    ///
    /// Errors: it can't be read, is no sheet, or nothing states which node it is.
    pub fn read(&self) -> Result<Device, EdsError> {
        let name = self.path.display().to_string();
        let sheet = read(&self.path)?;
        match self.node_id.or(sheet.node_id) {
            Some(node_id) => Ok(Device::new(name, node_id, &sheet)),
            None => Err(EdsError::NoNode(name)),
        }
    }
}

/// Files above this are no data sheets.
const LARGEST: u64 = 16 << 20;

/// Reads a sheet.
///
/// Errors: the file can't be read, is too large, or has no object.
pub fn read(path: &Path) -> Result<Sheet, EdsError> {
    use std::io::Read as _;

    let name = || path.display().to_string();
    let open = |why| EdsError::Read(Unreadable::new(path, why));
    let file = std::fs::File::open(path).map_err(open)?;
    let mut bytes = Vec::new();
    file.take(LARGEST + 1)
        .read_to_end(&mut bytes)
        .map_err(open)?;
    if bytes.len() as u64 > LARGEST {
        return Err(EdsError::TooLarge(name()));
    }
    let sheet = Sheet::parse(&bytes);
    if sheet.objects.is_empty() {
        return Err(EdsError::NoObject(name()));
    }
    Ok(sheet)
}
