//! One port of sixteen pins.
//!
//! In: loads and stores, levels that the board drives. Out: levels of the pins.
//!
//! Source: RM0008 9.2. Left out: the lock (LCKR), analogue input, slew rates, and two drivers that
//! work against each other: an output pin has the level of its output.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 00h | CRL | RM0008 9.2.1 |
//! | 04h | CRH | 9.2.2 |
//! | 08h | IDR | 9.2.3 |
//! | 0Ch | ODR | 9.2.4 |
//! | 10h | BSRR | 9.2.5 |
//! | 14h | BRR | 9.2.6 |

/// The registers and what the board does to the pins.
#[derive(Clone, Debug)]
pub struct Gpio {
    /// CRL and CRH, the lower pin in the lower bits.
    configuration: u64,
    odr: u16,
    driven: u16,
    high: u16,
}

impl Default for Gpio {
    fn default() -> Self {
        Self {
            // 9.2.1: floating inputs.
            configuration: 0x4444_4444_4444_4444,
            odr: 0,
            driven: 0,
            high: 0,
        }
    }
}

impl Gpio {
    /// The registers as after a reset; what the board drives stays.
    pub fn reset(&mut self) {
        let Self { driven, high, .. } = *self;
        *self = Self {
            driven,
            high,
            ..Self::default()
        };
    }

    /// The board drives a pin to a level, or lets it go.
    pub fn drive(&mut self, pin: u8, level: Option<bool>) {
        let bit = 1u16 << (pin & 15);
        self.driven &= !bit;
        self.high &= !bit;
        if let Some(level) = level {
            self.driven |= bit;
            self.high |= if level { bit } else { 0 };
        }
    }

    /// The level of every pin.
    pub fn levels(&self) -> u16 {
        let mut levels = 0;
        for pin in 0..16 {
            levels |= u16::from(self.level(pin)) << pin;
        }
        levels
    }

    /// The level of a pin: of its output, of the board, of its pull, or low (9.1.7 to 9.1.9).
    pub fn level(&self, pin: u8) -> bool {
        let bit = 1u16 << (pin & 15);
        let configured = self.configuration >> (4 * (pin & 15)) & 0xF;
        let is_output = configured & 3 != 0 && configured & 8 == 0;
        let pulled = configured == 8;
        if !is_output && self.driven & bit != 0 {
            return self.high & bit != 0;
        }
        (is_output || pulled) && self.odr & bit != 0
    }

    /// Whether a pin is an output of the port itself, not of a peripheral.
    pub fn is_output(&self, pin: u8) -> bool {
        let configured = self.configuration >> (4 * (pin & 15)) & 0xF;
        configured & 3 != 0 && configured & 8 == 0
    }

    /// Whether a pin is the output of a peripheral.
    pub fn is_alternate(&self, pin: u8) -> bool {
        let configured = self.configuration >> (4 * (pin & 15)) & 0xF;
        configured & 3 != 0 && configured & 8 != 0
    }

    /// A load; `offset` from the port's base.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            // 9.2.1, 9.2.2.
            0x00 => self.configuration as u32,
            0x04 => (self.configuration >> 32) as u32,
            // 9.2.3.
            0x08 => u32::from(self.levels()),
            // 9.2.4.
            0x0C => u32::from(self.odr),
            _ => 0,
        }
    }

    /// A store.
    pub fn write(&mut self, offset: u32, value: u32) {
        let low = value as u16;
        match offset {
            0x00 => self.configuration = self.configuration >> 32 << 32 | u64::from(value),
            0x04 => {
                self.configuration = u64::from(self.configuration as u32) | u64::from(value) << 32;
            }
            0x0C => self.odr = low,
            // 9.2.5: setting wins over resetting.
            0x10 => self.odr = self.odr & !((value >> 16) as u16) | low,
            // 9.2.6.
            0x14 => self.odr &= !low,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pull_up_gives_way_to_the_board() {
        let mut port = Gpio::default();
        assert!(!port.level(0));
        port.write(0x00, 0x4444_4448);
        port.write(0x10, 1);
        assert!(port.level(0));
        port.drive(0, Some(false));
        assert_eq!(port.read(0x08), 0);
        port.drive(0, None);
        assert_eq!(port.read(0x08), 1);
    }

    #[test]
    fn an_output_follows_set_and_reset() {
        let mut port = Gpio::default();
        port.write(0x00, 0x4443_4444);
        port.write(0x10, 1 << 4 | 1 << 20);
        assert!(port.level(4) && port.is_output(4));
        port.write(0x14, 1 << 4);
        assert!(!port.level(4));
        port.write(0x04, 0xB);
        assert!(port.is_alternate(8));
    }
}
