//! SPI1, as a master of eight or sixteen bits.
//!
//! In: loads, stores, cycles; the bytes of the part at the other end. Out: bytes to the part, and
//! an interrupt line. A byte is exchanged when its first bit would go out, and is there to read
//! when its last bit has come.
//!
//! Source: RM0008 25.3 and 25.5. Left out: slave mode, hardware CRC, I2S, one-wire modes, DMA
//! requests, and NSS as an output: chip select is a pin of the port.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 00h | CR1 | RM0008 25.5.1 |
//! | 04h | CR2 | 25.5.2 |
//! | 08h | SR | 25.5.3 |
//! | 0Ch | DR | 25.5.4 |
//! | 10h | CRCPR | 25.5.5 |

/// What is at the other end of the wires.
pub trait Wire {
    /// Exchanges a byte, at once.
    fn exchange(&mut self, byte: u8) -> u8;
}

/// The registers.
#[derive(Clone, Debug, Default)]
pub struct Spi {
    cr1: u32,
    cr2: u32,
    received: u16,
    /// RXNE.
    full: bool,
    /// OVR; goes by a load of DR and then one of SR (25.3.10).
    overrun: bool,
    overrun_read: bool,
    modf: bool,
    /// What is being shifted, and when it is through, in cycles.
    shifting: Option<(u16, u64)>,
    /// What waits in the transmit buffer.
    next: Option<u16>,
}

impl Spi {
    /// Cycles of HCLK that a frame takes; `pclk2` cycles of HCLK make one of PCLK2.
    fn frame_cycles(&self, per_pclk: u32) -> u64 {
        let bits = if self.cr1 >> 11 & 1 != 0 { 16 } else { 8 };
        u64::from(per_pclk) * (2 << (self.cr1 >> 3 & 7)) * bits
    }

    fn is_on(&self) -> bool {
        // Enabled as master.
        self.cr1 >> 6 & 1 != 0 && self.cr1 >> 2 & 1 != 0
    }

    /// Comes to `cycle`.
    pub fn advance(&mut self, cycle: u64, per_pclk: u32, wire: &mut impl Wire) {
        while let Some((received, through)) = self.shifting.filter(|(_, at)| *at <= cycle) {
            self.shifting = None;
            // 25.3.10: what came is lost where the last was not read.
            if self.full {
                self.overrun = true;
            } else {
                (self.full, self.received) = (true, received);
            }
            if let Some(next) = self.next.take() {
                self.shift(next, through, per_pclk, wire);
            }
        }
    }

    fn shift(&mut self, word: u16, from: u64, per_pclk: u32, wire: &mut impl Wire) {
        let received = match self.cr1 >> 11 & 1 {
            0 => u16::from(wire.exchange(word as u8)),
            _ => {
                let bytes = word.to_be_bytes().map(|byte| wire.exchange(byte));
                u16::from_be_bytes(bytes)
            }
        };
        self.shifting = Some((received, from + self.frame_cycles(per_pclk)));
    }

    /// When something happens that an interrupt waits for, cycles.
    pub fn next_event(&self) -> Option<u64> {
        let (_, through) = self.shifting?;
        self.interrupts().then_some(through)
    }

    /// Whether any of its interrupts is enabled.
    pub fn interrupts(&self) -> bool {
        self.cr2 & 0xE0 != 0
    }

    /// The interrupt line (25.5.2: TXEIE, RXNEIE, ERRIE).
    pub fn line(&self) -> bool {
        let txe = self.cr2 >> 7 & 1 != 0 && self.next.is_none();
        let rxne = self.cr2 >> 6 & 1 != 0 && self.full;
        let error = self.cr2 >> 5 & 1 != 0 && (self.overrun || self.modf);
        self.cr1 >> 6 & 1 != 0 && (txe || rxne || error)
    }

    /// A load; `offset` from 4001 3000h.
    pub fn read(&mut self, offset: u32) -> u32 {
        match offset {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x08 => self.status(),
            0x0C => {
                self.full = false;
                self.overrun_read |= self.overrun;
                u32::from(self.received)
            }
            // 25.5.5: CRCPR.
            0x10 => 7,
            _ => 0,
        }
    }

    /// SR (25.5.3).
    fn status(&mut self) -> u32 {
        let bits = u32::from(self.full)
            | u32::from(self.next.is_none()) << 1
            | u32::from(self.modf) << 5
            | u32::from(self.overrun) << 6
            | u32::from(self.shifting.is_some()) << 7;
        if std::mem::take(&mut self.overrun_read) {
            self.overrun = false;
        }
        bits
    }

    /// A store at `cycle`.
    pub fn write(
        &mut self,
        offset: u32,
        value: u32,
        cycle: u64,
        per_pclk: u32,
        wire: &mut impl Wire,
    ) {
        match offset {
            0x00 => {
                self.cr1 = value & 0xFFFF;
                // 25.3.1: a master with software NSS low, or NSS as an input, loses mastership;
                // that input is the pin PA4, which the port drives here.
                if value >> 9 & 1 != 0 && value >> 8 & 1 == 0 && value >> 2 & 1 != 0 {
                    self.modf = true;
                    self.cr1 &= !(1 << 6 | 1 << 2);
                }
            }
            0x04 => self.cr2 = value & 0xE7,
            0x08 => {}
            0x0C if self.is_on() && self.shifting.is_none() => {
                self.shift(value as u16, cycle, per_pclk, wire);
            }
            0x0C => self.next = Some(value as u16),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Echo(Vec<u8>);

    impl Wire for Echo {
        fn exchange(&mut self, byte: u8) -> u8 {
            self.0.push(byte);
            !byte
        }
    }

    /// Master on, divided by 8, software NSS high.
    const ON: u32 = 1 << 9 | 1 << 8 | 1 << 6 | 2 << 3 | 1 << 2;

    #[test]
    fn a_byte_takes_its_time() {
        let (mut spi, mut wire) = (Spi::default(), Echo(Vec::new()));
        spi.write(0x00, ON, 0, 1, &mut wire);
        spi.write(0x0C, 0x8F8F_8F8F, 100, 1, &mut wire);
        spi.advance(163, 1, &mut wire);
        assert_eq!(spi.read(0x08), 1 << 7 | 1 << 1);
        spi.advance(164, 1, &mut wire);
        assert_eq!(spi.read(0x08), 1 << 1 | 1);
        assert_eq!((spi.read(0x0C), &wire.0), (0x70, &vec![0x8F]));
    }

    #[test]
    fn two_bytes_without_a_load_between_are_an_overrun() {
        let (mut spi, mut wire) = (Spi::default(), Echo(Vec::new()));
        spi.write(0x00, ON, 0, 1, &mut wire);
        spi.write(0x0C, 1, 0, 1, &mut wire);
        spi.write(0x0C, 2, 0, 1, &mut wire);
        assert_eq!(spi.read(0x08), 1 << 7);
        spi.advance(1000, 1, &mut wire);
        assert_eq!(spi.read(0x08), 1 << 6 | 1 << 1 | 1);
        assert_eq!(spi.read(0x0C), 0xFE);
        assert_eq!(spi.read(0x08), 1 << 6 | 1 << 1);
        assert_eq!(spi.read(0x08), 1 << 1);
    }
}
