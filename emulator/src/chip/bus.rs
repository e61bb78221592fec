//! Loads and stores of the code, by address.
//!
//! In: address, size and value. Out: what the peripheral there answers; 0 where there is none and
//! where it has no clock. Bytes and half-words become words as the bridges make them.
//!
//! Sources: RM0008 3.1 (bridges), 3.3 (memory map), 7.3.6 to 7.3.8 (which clock is whose). Left
//! out: a bus error for an address of the peripherals' region where none is.
//!
//! | address | register | section |
//! |---|---|---|
//! | 1FFFF400h | the electronic signature | RM0008 30 |
//! | 1FFFF7E0h | F_SIZE | RM0008 30.1 |
//! | 1FFFF7E8h | U_ID, on to 1FFFF7F0h | RM0008 30.2 |
//! | 1FFFF7ECh | U_ID | RM0008 30.2 |
//! | 1FFFF7F0h | U_ID | RM0008 30.2 |
//! | 40000000h | TIM2, on to TIM4 | RM0008 3.3, table 3 |
//! | 40003000h | IWDG | RM0008 3.3, table 3 |
//! | 40006400h | CAN | RM0008 3.3, table 3 |
//! | 40007000h | PWR, its CR only | RM0008 3.3, table 3; 5.4.1 |
//! | 40010000h | AFIO | RM0008 3.3, table 3 |
//! | 40010400h | EXTI | RM0008 3.3, table 3 |
//! | 40010800h | GPIOA, on to GPIOE | RM0008 3.3, table 3 |
//! | 40013000h | SPI1 | RM0008 3.3, table 3 |
//! | 40021000h | RCC | RM0008 3.3, table 3 |
//! | 40022000h | FLASH | RM0008 3.3, table 3 |
//! | 40023000h | CRC | RM0008 3.3, table 3 |

use flash::layout::BASE;

use super::can::Can;
use super::flash_controller::Outcome;
use super::spi::Spi;
use super::tap::Deed;
use super::timer::Timer;
use super::{Chip, bit_band};

impl Chip {
    /// A load of `size` bytes, anywhere but in flash and RAM.
    pub fn read(&mut self, address: u32, size: u32) -> u32 {
        if let Some((byte, bit)) = bit_band::in_peripherals(address) {
            return self.read(byte & !3, 4) >> (8 * (byte & 3) + u32::from(bit)) & 1;
        }
        self.read_peripheral(address, size)
    }

    /// The same where there is no bit-band alias.
    pub fn read_peripheral(&mut self, address: u32, size: u32) -> u32 {
        let word = self.read_word(address & !3);
        if self.sensor.tap.wants(address) {
            self.sensor.tap.enter(self.nvic.running());
            self.sensor.tap.note(Deed::Load(address & !3, word));
        }
        let shifted = word >> (8 * (address & 3));
        match size {
            1 => shifted & 0xFF,
            2 => shifted & 0xFFFF,
            _ => shifted,
        }
    }

    /// A store of `size` bytes, anywhere but in flash and RAM.
    pub fn write(&mut self, address: u32, size: u32, value: u32) {
        // What has neither interrupts nor times of its own: it reports itself when it has.
        if !matches!(Place::of(address), Some(Place::Spi | Place::Port(_))) {
            self.attention = 0;
        }
        if let Some((byte, bit)) = bit_band::in_peripherals(address) {
            let shift = 8 * (byte & 3) + u32::from(bit);
            let held = self.read(byte & !3, 4) & !(1 << shift);
            return self.write_word(byte & !3, held | (value & 1) << shift);
        }
        let word = address & !3;
        let value = match (size, address >= 0xE000_0000) {
            (4, _) => value,
            // The private bus has byte lanes (PM0056 4.3.7: byte accesses).
            (_, true) => {
                let mask = if size == 1 { 0xFF } else { 0xFFFF };
                let shift = 8 * (address & 3);
                let held = self.read_word(word) & !(mask << shift);
                held | (value & mask) << shift
            }
            // The bridge to the APB doubles what is smaller than a word (RM0008 3.1).
            (1, _) => (value & 0xFF) * 0x0101_0101,
            _ => (value & 0xFFFF) * 0x0001_0001,
        };
        if self.sensor.tap.wants(address) {
            self.sensor.tap.enter(self.nvic.running());
            self.sensor.tap.note(Deed::Store(word, value));
        }
        self.write_word(word, value);
    }

    fn read_word(&mut self, address: u32) -> u32 {
        let now = self.cycles;
        if address >= 0xE000_0000 {
            self.system.advance(now, &mut self.nvic);
            let own = self.system.read(address, now, &self.nvic);
            return own.unwrap_or_else(|| self.nvic.read(address - 0xE000_E100));
        }
        let offset = address & 0x3FF;
        let Some(place) = Place::of(address).filter(|place| self.is_clocked(*place)) else {
            return 0;
        };
        match place {
            Place::Timer(number) => {
                self.take_edges();
                let steps = self.timer_step();
                let timer = &mut self.timers[number];
                timer.follow(now, steps);
                timer.read(offset, now, steps)
            }
            Place::Watchdog => self.watchdog.read(offset),
            Place::Can => self.can.read(offset),
            Place::Pwr => u32::from(offset == 0) * self.pwr,
            Place::Afio => self.exti.read_afio(offset),
            Place::Exti => {
                self.take_edges();
                self.exti.read(offset)
            }
            Place::Port(number) => {
                self.take_edges();
                self.ports[number].read(offset)
            }
            Place::Spi => {
                self.spi.advance(now, self.per_pclk2(), &mut self.sensor);
                self.heed_spi();
                self.spi.read(offset)
            }
            Place::Rcc => self.rcc.read(offset, self.clock.ns(now)),
            Place::Flash => self.flash.read(offset),
            Place::Crc => self.crc.read(offset),
            Place::Signature => self.signature(address),
        }
    }

    /// RM0008 30.1 and 30.2.
    fn signature(&self, address: u32) -> u32 {
        let [first, second, third] = self.individual.identity;
        match address {
            0x1FFF_F7E0 => 0xFFFF_0000 | (self.layout.flash / 1024),
            0x1FFF_F7E8 => first,
            0x1FFF_F7EC => second,
            0x1FFF_F7F0 => third,
            _ => u32::MAX,
        }
    }

    fn write_word(&mut self, address: u32, value: u32) {
        let (now, now_ns) = (self.cycles, self.now_ns());
        if address >= 0xE000_0000 {
            self.system.advance(now, &mut self.nvic);
            if !self.system.write(address, value, now, &mut self.nvic) {
                self.nvic.write(address - 0xE000_E100, value);
            }
            return;
        }
        let offset = address & 0x3FF;
        let Some(place) = Place::of(address).filter(|place| self.is_clocked(*place)) else {
            return;
        };
        let steps = self.timer_step();
        match place {
            Place::Timer(number) => {
                self.take_edges();
                let timer = &mut self.timers[number];
                timer.advance(now, steps);
                timer.write(offset, value, now, steps);
            }
            Place::Watchdog => self.watchdog.write(offset, value, now_ns),
            Place::Can => self.can.write(offset, value),
            Place::Pwr => self.pwr = if offset == 0 { value & 0x1F3 } else { self.pwr },
            Place::Afio => self.exti.write_afio(offset, value),
            Place::Exti => self.exti.write(offset, value),
            Place::Port(number) => {
                self.ports[number].write(offset, value);
                if number == 0 {
                    self.follow_select();
                }
            }
            Place::Spi => {
                let per_pclk = self.per_pclk2();
                self.spi.advance(now, per_pclk, &mut self.sensor);
                self.sensor.chip.borrow_mut().advance_to(now_ns);
                self.heed_spi();
                self.spi
                    .write(offset, value, now, per_pclk, &mut self.sensor);
                self.heed_spi();
            }
            Place::Rcc => self.write_rcc(offset, value, now_ns),
            Place::Flash => {
                if let Some(outcome) = self.flash.write(offset, value) {
                    self.bear(outcome);
                }
            }
            Place::Crc => self.crc.write(offset, value),
            Place::Signature => {}
        }
    }

    /// Who waits for the part by polling is not to be disturbed by it.
    fn heed_spi(&mut self) {
        if self.spi.interrupts() {
            self.attention = 0;
        }
    }

    fn write_rcc(&mut self, offset: u32, value: u32, now_ns: u64) {
        let before = self.rcc.frequencies();
        let resets = self.rcc.write(offset, value, now_ns);
        let after = self.rcc.frequencies();
        if before.hclk != after.hclk {
            let limit_ns = self.clock.ns(self.limit);
            self.clock.set_hz(self.cycles, after.hclk);
            self.limit = self.clock.cycle(limit_ns);
        }
        if let Some((bus, bits)) = resets {
            for bit in (0..32).filter(|bit| bits >> bit & 1 != 0) {
                self.reset_peripheral(bus, bit);
            }
        }
    }

    /// A bit of APB2RSTR or APB1RSTR (RM0008 7.3.4, 7.3.5).
    fn reset_peripheral(&mut self, bus: u8, bit: u8) {
        match (bus, bit) {
            (2, 0) => (2..6).for_each(|offset| self.exti.write_afio(4 * offset, 0)),
            (2, 2..=6) => self.ports[bit as usize - 2].reset(),
            (2, 12) => self.spi = Spi::default(),
            (1, 0..=2) => self.timers[bit as usize] = Timer::default(),
            (1, 25) => self.can = Can::default(),
            (1, 28) => self.pwr = 0,
            _ => {}
        }
        if (bus, bit) == (2, 2) {
            self.follow_select();
        }
    }

    fn is_clocked(&self, place: Place) -> bool {
        match place.clock() {
            Some((bus, bit)) => self.rcc.is_clocked(bus, bit),
            None => true,
        }
    }

    /// A store into the flash; always true, since the core's copy is put right afterwards.
    pub fn store_in_flash(&mut self, address: u32, size: u32, value: u32) -> bool {
        self.attention = 0;
        let offset = match address.checked_sub(BASE) {
            Some(offset) => offset,
            None => address,
        };
        match self.flash.program(offset, size, value) {
            Some(outcome) => self.bear(outcome),
            None => self.bad_store = true,
        }
        true
    }

    /// What an operation of the flash costs.
    fn bear(&mut self, outcome: Outcome) {
        match outcome {
            Outcome::Held(ns) => {
                let until_ns = self.now_ns() + ns;
                self.pass(self.clock.cycle(until_ns));
            }
            Outcome::Refused => {}
            Outcome::Cut => self.cut = true,
        }
    }

    /// A piece of the flash that the core's copy has to be put right at: offset and bytes.
    pub fn take_changed_flash(&mut self) -> Option<(u32, Vec<u8>)> {
        self.flash.take_changed()
    }
}

/// Who is at an address (RM0008 3.3, table 3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Timer(usize),
    Watchdog,
    Can,
    Pwr,
    Afio,
    Exti,
    Port(usize),
    Spi,
    Rcc,
    Flash,
    Crc,
    Signature,
}

impl Place {
    fn of(address: u32) -> Option<Self> {
        Some(match address & !0x3FF {
            base @ 0x4000_0000..=0x4000_0800 => Self::Timer((base as usize & 0xC00) / 0x400),
            0x4000_3000 => Self::Watchdog,
            0x4000_6400 => Self::Can,
            0x4000_7000 => Self::Pwr,
            0x4001_0000 => Self::Afio,
            0x4001_0400 => Self::Exti,
            base @ 0x4001_0800..=0x4001_1800 => Self::Port(((base - 0x4001_0800) / 0x400) as usize),
            0x4001_3000 => Self::Spi,
            0x4002_1000 => Self::Rcc,
            0x4002_2000 => Self::Flash,
            0x4002_3000 => Self::Crc,
            0x1FFF_F400 => Self::Signature,
            _ => return None,
        })
    }

    /// The bus and the bit that give it a clock; `None` for what always has one.
    fn clock(self) -> Option<(u8, u8)> {
        Some(match self {
            Self::Timer(number) => (1, number as u8),
            Self::Can => (1, 25),
            Self::Pwr => (1, 28),
            Self::Afio => (2, 0),
            Self::Port(number) => (2, 2 + number as u8),
            Self::Spi => (2, 12),
            Self::Crc => (0, 6),
            Self::Watchdog | Self::Exti | Self::Rcc | Self::Flash | Self::Signature => return None,
        })
    }
}
