//! Why the program ended, in words that outlast the reset.
//!
//! In: the place of a panic or of a fault. Out: five words for a corner of the RAM that no program
//! clears, and at the next start the same again, as an EMCY.
//!
//! Left out: the corner itself, which is `chip::trap`'s.

/// Words of a record.
pub const WORDS: usize = 5;

/// "CRSH": whether there is a record at all.
const MAGIC: u32 = u32::from_le_bytes(*b"CRSH");

/// How a program has ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Crash {
    /// A panic, by the hash of its file's name ([`hash`]) and its line.
    Panic {
        /// See [`hash`].
        file: u32,
        /// Line.
        line: u32,
    },
    /// A hard fault at `pc`, with the Configurable Fault Status Register (PM0056 4.4.10).
    Fault {
        /// Address of the instruction.
        pc: u32,
        /// CFSR.
        status: u32,
    },
    /// An interrupt that nobody serves, by its number; exceptions are negative.
    Interrupt(i16),
    /// The independent watchdog.
    Watchdog,
    /// The bootloader has nothing to start; the number is its reason.
    Stay(u8),
}

/// FNV-1a, 32 bits: a file's name in four bytes.
///
/// Who wants the file back hashes the names of all of them.
pub fn hash(name: &str) -> u32 {
    name.bytes().fold(0x811C_9DC5, |hash: u32, byte| {
        (hash ^ u32::from(byte)).wrapping_mul(0x0100_0193)
    })
}

const fn sum(kind: u32, a: u32, b: u32) -> u32 {
    // Each word at a rotation of its own, so that two that are swapped do not pass.
    !(kind ^ a.rotate_left(8) ^ b.rotate_left(16))
}

impl Crash {
    /// The words to keep.
    pub const fn encode(self) -> [u32; WORDS] {
        let (kind, a, b) = match self {
            Self::Panic { file, line } => (1, file, line),
            Self::Fault { pc, status } => (2, pc, status),
            Self::Interrupt(number) => (3, number as u32, 0),
            Self::Watchdog => (4, 0, 0),
            Self::Stay(reason) => (5, reason as u32, 0),
        };
        [MAGIC, kind, a, b, sum(kind, a, b)]
    }

    /// What was kept; `None` after a loss of supply, or when nothing was.
    pub const fn decode(words: [u32; WORDS]) -> Option<Self> {
        let [magic, kind, a, b, check] = words;
        if magic != MAGIC || check != sum(kind, a, b) {
            return None;
        }
        match kind {
            1 => Some(Self::Panic { file: a, line: b }),
            2 => Some(Self::Fault { pc: a, status: b }),
            3 => Some(Self::Interrupt(a as i16)),
            4 => Some(Self::Watchdog),
            5 => Some(Self::Stay(a as u8)),
            _ => None,
        }
    }

    /// The EMCY that tells of it: error code (61xxh: internal software, CiA 301 table 26), and
    /// bytes 3 to 7.
    ///
    /// | code | what | bytes 3 to 7 |
    /// |---|---|---|
    /// | 6101h | panic | line (2 bytes), lower three bytes of the file's hash |
    /// | 6102h | hard fault | address (4 bytes), which bytes of CFSR are not zero |
    /// | 6103h | interrupt without a handler | number (2 bytes) |
    /// | 6104h | watchdog | |
    /// | 6105h | the bootloader had nothing to start for a while | reason |
    pub const fn emergency(self) -> (u16, [u8; 5]) {
        match self {
            Self::Panic { file, line } => {
                let [f0, f1, f2, _] = file.to_le_bytes();
                let [l0, l1, ..] = line.to_le_bytes();
                (0x6101, [l0, l1, f0, f1, f2])
            }
            Self::Fault { pc, status } => {
                let [a, b, c, d] = pc.to_le_bytes();
                let [mem, bus, u0, u1] = status.to_le_bytes();
                let usage = (u0 | u1 != 0) as u8;
                let kinds = (mem != 0) as u8 | ((bus != 0) as u8) << 1 | usage << 2;
                (0x6102, [a, b, c, d, kinds])
            }
            Self::Interrupt(number) => {
                let [low, high] = number.to_le_bytes();
                (0x6103, [low, high, 0, 0, 0])
            }
            Self::Watchdog => (0x6104, [0; 5]),
            Self::Stay(reason) => (0x6105, [reason, 0, 0, 0, 0]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Crash; 5] = [
        Crash::Panic {
            file: 0xDEAD_BEEF,
            line: 1234,
        },
        Crash::Fault {
            pc: 0x0800_4321,
            status: 0x0200_8200,
        },
        Crash::Interrupt(-5),
        Crash::Watchdog,
        Crash::Stay(3),
    ];

    #[test]
    fn what_was_kept_comes_back_and_one_bit_less_is_nothing() {
        for crash in ALL {
            let words = crash.encode();
            assert_eq!(Crash::decode(words), Some(crash));
            for bit in 0..WORDS * 32 {
                let mut words = words;
                words[bit / 32] ^= 1 << (bit % 32);
                assert_eq!(Crash::decode(words), None, "{crash:?} {bit}");
            }
        }
        assert_eq!(Crash::decode([0; WORDS]), None);
        assert_eq!(Crash::decode([0xCCCC_CCCC; WORDS]), None);
    }

    #[test]
    fn the_bus_hears_where() {
        assert_eq!(ALL[0].emergency(), (0x6101, [0xD2, 4, 0xEF, 0xBE, 0xAD]));
        assert_eq!(ALL[1].emergency(), (0x6102, [0x21, 0x43, 0, 8, 0b110]));
        assert_eq!(ALL[2].emergency(), (0x6103, [0xFB, 0xFF, 0, 0, 0]));
        assert_eq!(hash("a"), 0xE40C_292C);
    }
}
