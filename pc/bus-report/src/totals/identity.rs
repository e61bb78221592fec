//! What a node has answered about itself, as far as a log has the answers.
//!
//! In: the node's answers to SDOs (CiA 301, 7.2.4.3) with their times, ns. Out: the last value of
//! each object that identifies the piece: vendor, product code, revision and serial number
//! (1018h), software (100Ah), check sum of the calibration (2062h sub 1) and hash of its report
//! (2063h). Identities of parts of a period, merged in any order, are that of the whole.
//!
//! Left out: block transfers, and requests.

use output::hex;
use serde::{Deserialize, Serialize};

/// Objects of four bytes: index and sub-index.
const NUMBERS: [(u16, u8); 5] = [
    (0x1018, 1),
    (0x1018, 2),
    (0x1018, 3),
    (0x1018, 4),
    (0x2062, 1),
];

/// Objects of more bytes.
const SOFTWARE: (u16, u8) = (0x100A, 0);
const REPORT_HASH: (u16, u8) = (0x2063, 0);

/// Bytes of such an object, at most.
const MOST: usize = 64;

/// Abort code: the object has no data.
const NO_DATA: u32 = 0x0800_0024;

/// What is known of a node.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Of each of [`NUMBERS`] the time at which it was read last, ns, and its value.
    numbers: [Option<(u64, u32)>; NUMBERS.len()],
    /// The same of the software's version.
    software: Option<(u64, String)>,
    /// The same of the hash of the calibration's report, in hexadecimal digits; empty where the
    /// node has none for the calibration in force.
    report_hash: Option<(u64, String)>,
    #[serde(skip)]
    under_way: Option<Upload>,
}

/// An object that comes in segments.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Upload {
    object: (u16, u8),
    bytes: Vec<u8>,
    toggle: bool,
}

impl Identity {
    /// Vendor-ID, product code, revision, serial number, and check sum of the calibration.
    pub fn numbers(&self) -> [Option<u32>; 5] {
        self.numbers.map(|known| Some(known?.1))
    }

    /// Version of the software.
    pub fn software(&self) -> Option<&str> {
        self.software.as_ref().map(|(_, text)| text.as_str())
    }

    /// Hash of the calibration's report, 64 hexadecimal digits, or nothing for none.
    pub fn report_hash(&self) -> Option<&str> {
        self.report_hash.as_ref().map(|(_, text)| text.as_str())
    }

    /// True when nothing is known.
    pub fn is_empty(&self) -> bool {
        self.software.is_none()
            && self.report_hash.is_none()
            && self.numbers.iter().all(Option::is_none)
    }

    /// Takes an answer.
    pub fn take(&mut self, now_ns: u64, bytes: &[u8]) {
        let &[command, low, high, sub, a, b, c, d] = bytes else {
            return;
        };
        let object = (u16::from_le_bytes([low, high]), sub);
        let data = [a, b, c, d];
        match command {
            // Up to four bytes at once.
            0x43 | 0x47 | 0x4B | 0x4F => {
                let unused = usize::from(command >> 2 & 3);
                self.under_way = None;
                self.note(now_ns, object, data.get(..4 - unused).unwrap_or_default());
            }
            0x40 | 0x41 => {
                self.under_way = Some(Upload {
                    object,
                    bytes: Vec::new(),
                    toggle: false,
                });
            }
            0x00..=0x1F => self.segment(now_ns, command, &bytes[1..]),
            0x80 => {
                self.under_way = None;
                if u32::from_le_bytes(data) == NO_DATA {
                    self.note(now_ns, object, &[]);
                }
            }
            _ => self.under_way = None,
        }
    }

    /// The next bytes of an object: toggle bit, bytes that are not used, whether it is the last.
    fn segment(&mut self, now_ns: u64, command: u8, data: &[u8]) {
        let Some(mut upload) = self.under_way.take() else {
            return;
        };
        let unused = usize::from(command >> 1 & 7);
        let used = data.get(..7 - unused).unwrap_or_default();
        if upload.toggle != (command & 0x10 != 0) || upload.bytes.len() + used.len() > MOST {
            return;
        }
        upload.bytes.extend_from_slice(used);
        upload.toggle = !upload.toggle;
        if command & 1 == 0 {
            self.under_way = Some(upload);
        } else {
            self.note(now_ns, upload.object, &upload.bytes);
        }
    }

    fn note(&mut self, now_ns: u64, object: (u16, u8), bytes: &[u8]) {
        let number = NUMBERS.iter().position(|one| *one == object);
        if let (Some(place), Ok(bytes)) = (
            number.and_then(|number| self.numbers.get_mut(number)),
            bytes.try_into(),
        ) {
            *place = Some((now_ns, u32::from_le_bytes(bytes)));
        } else if object == SOFTWARE && !bytes.is_empty() {
            let text = String::from_utf8_lossy(bytes);
            let text = text.trim_end_matches('\0');
            self.software = Some((now_ns, text.to_owned()));
        } else if object == REPORT_HASH && matches!(bytes.len(), 0 | 32) {
            self.report_hash = Some((now_ns, hex::digits(bytes)));
        }
    }

    /// Takes what another log has of the node; the later value counts.
    pub fn merge(&mut self, other: &Self) {
        for (own, other) in self.numbers.iter_mut().zip(other.numbers) {
            *own = (*own).max(other);
        }
        for (own, other) in [
            (&mut self.software, &other.software),
            (&mut self.report_hash, &other.report_hash),
        ] {
            if *own < *other {
                own.clone_from(other);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(answers: &[[u8; 8]]) -> Identity {
        let mut identity = Identity::default();
        for (now_ns, answer) in (1..).zip(answers) {
            identity.take(now_ns, answer);
        }
        identity
    }

    /// "0.1.0" and a hash of zeros and one 7.
    const SOFTWARE: [[u8; 8]; 2] = [
        [0x41, 0x0A, 0x10, 0, 5, 0, 0, 0],
        [0x05, b'0', b'.', b'1', b'.', b'0', 0, 0],
    ];
    const HASH: [[u8; 8]; 6] = [
        [0x41, 0x63, 0x20, 0, 32, 0, 0, 0],
        [0x00, 7, 0, 0, 0, 0, 0, 0],
        [0x10, 0, 0, 0, 0, 0, 0, 0],
        [0x00, 0, 0, 0, 0, 0, 0, 0],
        [0x10, 0, 0, 0, 0, 0, 0, 0],
        [0x07, 0, 0, 0, 0, 0, 0, 0],
    ];

    #[test]
    fn objects_of_four_bytes_and_of_segments_are_taken() {
        let serial = [0x43, 0x18, 0x10, 4, 0x39, 0x30, 0, 0];
        let sum = [0x43, 0x62, 0x20, 1, 1, 2, 3, 4];
        let all: Vec<_> = [serial, sum]
            .into_iter()
            .chain(SOFTWARE)
            .chain(HASH)
            .collect();
        let known = after(&all);
        assert_eq!(
            known.numbers(),
            [None, None, None, Some(12345), Some(0x0403_0201)]
        );
        assert_eq!(known.software(), Some("0.1.0"));
        let hash = known.report_hash().unwrap();
        assert_eq!((hash.len(), &hash[..4]), (64, "0700"));
    }

    #[test]
    fn a_cut_or_repeated_transfer_gives_nothing_and_no_data_is_known_as_such() {
        let mut twice = SOFTWARE.to_vec();
        twice.insert(1, [0x10, b'x', 0, 0, 0, 0, 0, 0]);
        assert_eq!(after(&twice).software(), None);
        assert_eq!(after(&SOFTWARE[1..]).software(), None);
        assert!(after(&HASH[..5]).is_empty());
        let none = [0x80, 0x63, 0x20, 0, 0x24, 0, 0, 8];
        assert_eq!(after(&[none]).report_hash(), Some(""));
        let refused = [0x80, 0x63, 0x20, 0, 0, 0, 2, 6];
        assert!(after(&[refused]).is_empty());
    }

    #[test]
    fn the_later_value_counts_in_either_order() {
        let one = after(&SOFTWARE);
        let mut other = Identity::default();
        other.take(9, &[0x4F, 0x0A, 0x10, 0, b'2', 0, 0, 0]);
        for (mut own, other) in [(one.clone(), &other), (other.clone(), &one)] {
            own.merge(other);
            assert_eq!(own.software(), Some("2"));
        }
    }
}
