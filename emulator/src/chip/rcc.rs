//! Reset and clock control.
//!
//! In: loads, stores, resets, time. Out: the frequencies of HCLK, PCLK1 and PCLK2, which
//! peripherals have a clock, and which are to be reset.
//!
//! Source: RM0008 7.3; start-up times from the data sheet of the STM32F103xC (5.3.6 and 5.3.8).
//! Left out: the clock security system, RTC and LSE, MCO, clock interrupts.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 00h | CR | RM0008 7.3.1 |
//! | 04h | CFGR | 7.3.2 |
//! | 0Ch | APB2RSTR | 7.3.4 |
//! | 10h | APB1RSTR | 7.3.5 |
//! | 14h | AHBENR | 7.3.6 |
//! | 18h | APB2ENR | 7.3.7 |
//! | 1Ch | APB1ENR | 7.3.8 |
//! | 24h | CSR | 7.3.10 |

/// The crystal on the board, Hz.
const HSE_HZ: u32 = 8_000_000;
/// The internal oscillator, Hz.
const HSI_HZ: u32 = 8_000_000;
/// The crystal's start, ns: 2 ms.
const HSE_START_NS: u64 = 2_000_000;
/// The PLL's lock, ns: at most 200 us.
const PLL_LOCK_NS: u64 = 200_000;

/// Why the part was reset (RM0008 7.3.10).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Power came.
    Power,
    /// The reset pin.
    Pin,
    /// SYSRESETREQ.
    Software,
    /// The independent watchdog.
    Watchdog,
}

impl Cause {
    /// Its flag in CSR; every reset also pulls the pin (RM0008 7.1.1, 7.1.2).
    fn flags(self) -> u32 {
        let own = match self {
            Self::Power => 1 << 27,
            Self::Pin => 0,
            Self::Software => 1 << 28,
            Self::Watchdog => 1 << 29,
        };
        own | 1 << 26
    }
}

/// The frequencies, Hz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frequencies {
    /// The core's and the AHB's.
    pub hclk: u32,
    /// The slow bus's.
    pub pclk1: u32,
    /// The fast bus's.
    pub pclk2: u32,
}

/// Cycles of HCLK in one of the clocks of peripherals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Ratios {
    /// In one of PCLK2.
    pub pclk2: u32,
    /// In one of the timers' clock: twice PCLK1 unless that is HCLK (RM0008 7.2).
    pub timers: u32,
}

impl Ratios {
    fn of(at: Frequencies) -> Self {
        Self {
            pclk2: at.hclk / at.pclk2.max(1),
            timers: (at.hclk / at.pclk1.max(1) / 2).max(1),
        }
    }
}

/// Undivided, as after a reset.
impl Default for Ratios {
    fn default() -> Self {
        let (pclk2, timers) = (1, 1);
        Self { pclk2, timers }
    }
}

/// The registers.
#[derive(Clone, Debug)]
pub struct Rcc {
    cr: u32,
    cfgr: u32,
    ahbenr: u32,
    apb2enr: u32,
    apb1enr: u32,
    csr: u32,
    hse_ready_ns: u64,
    pll_ready_ns: u64,
    /// What CFGR sets, kept since it is used at every access to a peripheral.
    ratios: Ratios,
}

impl Rcc {
    /// After a reset; the flags of earlier ones stay until RMVF (RM0008 7.3.10).
    pub fn reset(cause: Cause, before: u32) -> Self {
        Self {
            cr: 0x0000_0083,
            cfgr: 0,
            ahbenr: 0x14,
            apb2enr: 0,
            apb1enr: 0,
            csr: before & 0xFC00_0000 | cause.flags(),
            hse_ready_ns: 0,
            pll_ready_ns: 0,
            ratios: Ratios::default(),
        }
    }

    /// CSR's flags of resets.
    pub fn flags(&self) -> u32 {
        self.csr & 0xFC00_0000
    }

    /// What the clocks run at.
    pub fn frequencies(&self) -> Frequencies {
        let source = match self.cfgr >> 2 & 3 {
            1 => HSE_HZ,
            2 => self.pll_hz(),
            _ => HSI_HZ,
        };
        // RM0008 7.3.2: HPRE from 1000b on divides by 2 to 512, without 32.
        let hclk = match self.cfgr >> 4 & 0xF {
            few @ 8..=11 => source >> (few - 7),
            many @ 12.. => source >> (many - 6),
            _ => source,
        };
        Frequencies {
            hclk,
            pclk1: hclk / self.divider(8),
            pclk2: hclk / self.divider(11),
        }
    }

    /// How they stand to each other.
    pub fn ratios(&self) -> Ratios {
        self.ratios
    }

    /// PPRE1 at bit 8, PPRE2 at bit 11 (RM0008 7.3.2).
    fn divider(&self, at: u32) -> u32 {
        match self.cfgr >> at & 7 {
            few @ 4.. => 2 << (few - 4),
            _ => 1,
        }
    }

    /// RM0008 7.3.2: PLLMUL 0 is times 2, 14 and 15 are times 16.
    fn pll_hz(&self) -> u32 {
        let multiplier = (self.cfgr >> 18 & 0xF).min(14) + 2;
        let source = match (self.cfgr >> 16 & 1, self.cfgr >> 17 & 1) {
            (0, _) => HSI_HZ / 2,
            (_, 1) => HSE_HZ / 2,
            _ => HSE_HZ,
        };
        source * multiplier
    }

    /// Whether a peripheral of bus 0 (AHB), 1 or 2 (APB) has a clock.
    pub fn is_clocked(&self, bus: u8, bit: u8) -> bool {
        let register = match bus {
            0 => self.ahbenr,
            1 => self.apb1enr,
            _ => self.apb2enr,
        };
        register >> bit & 1 != 0
    }

    /// A load; `offset` from 4002 1000h.
    pub fn read(&self, offset: u32, now_ns: u64) -> u32 {
        match offset {
            // 7.3.1: the ready bits follow the oscillators.
            0x00 => self.cr_now(now_ns),
            // 7.3.2: SWS shows what SW has asked for and could get.
            0x04 => self.cfgr,
            // 7.3.6, 7.3.7, 7.3.8.
            0x14 => self.ahbenr,
            0x18 => self.apb2enr,
            0x1C => self.apb1enr,
            // 7.3.10: LSIRDY follows LSION.
            0x24 => self.csr | (self.csr & 1) << 1,
            _ => 0,
        }
    }

    fn cr_now(&self, now_ns: u64) -> u32 {
        let hse = self.cr >> 16 & 1 != 0 && now_ns >= self.hse_ready_ns;
        let pll = self.cr >> 24 & 1 != 0 && now_ns >= self.pll_ready_ns;
        let hsi = (self.cr & 1) << 1;
        self.cr & !0x0202_0002 | hsi | u32::from(hse) << 17 | u32::from(pll) << 25
    }

    /// A store; the peripherals to reset, as (bus, bits).
    pub fn write(&mut self, offset: u32, value: u32, now_ns: u64) -> Option<(u8, u32)> {
        match offset {
            0x00 => self.write_cr(value, now_ns),
            0x04 => self.write_cfgr(value, now_ns),
            // 7.3.4 and 7.3.5.
            0x0C => return Some((2, value)),
            0x10 => return Some((1, value)),
            0x14 => self.ahbenr = value & 0x57,
            0x18 => self.apb2enr = value,
            0x1C => self.apb1enr = value,
            0x24 => {
                // RMVF takes the flags away.
                let kept = if value >> 24 & 1 != 0 {
                    0
                } else {
                    self.flags()
                };
                self.csr = kept | value & 1;
            }
            _ => {}
        }
        None
    }

    fn write_cr(&mut self, value: u32, now_ns: u64) {
        let rising = value & !self.cr;
        if rising >> 16 & 1 != 0 {
            self.hse_ready_ns = now_ns + HSE_START_NS;
        }
        if rising >> 24 & 1 != 0 {
            self.pll_ready_ns = now_ns.max(self.hse_ready_ns) + PLL_LOCK_NS;
        }
        // What drives the core cannot be switched off (7.3.1).
        let driving = match self.cfgr >> 2 & 3 {
            0 => 1,
            1 => 1 << 16,
            _ => 1 << 24 | (self.cfgr & 1 << 16),
        };
        self.cr = value & 0x010D_00F9 | self.cr & driving;
    }

    fn write_cfgr(&mut self, value: u32, now_ns: u64) {
        let ready = self.cr_now(now_ns);
        let wanted = value & 3;
        let possible = match wanted {
            0 => ready >> 1 & 1 != 0,
            1 => ready >> 17 & 1 != 0,
            2 => ready >> 25 & 1 != 0,
            _ => false,
        };
        let switched = if possible { wanted } else { self.cfgr >> 2 & 3 };
        // The PLL's settings cannot be written while it runs (7.3.2).
        let fixed = if self.cr >> 24 & 1 != 0 {
            0x003F_0000
        } else {
            0
        };
        let free = 0x077F_FFF3 & !fixed;
        self.cfgr = value & free | self.cfgr & fixed | switched << 2;
        self.ratios = Ratios::of(self.frequencies());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_board_s_clock_set_up_gives_72_and_36_mhz() {
        let mut rcc = Rcc::reset(Cause::Power, 0);
        assert_eq!(rcc.frequencies().hclk, 8_000_000);
        rcc.write(0x00, 0x0001_0083, 0);
        assert_eq!(rcc.read(0x00, 1_000_000) >> 17 & 1, 0);
        assert_eq!(rcc.read(0x00, 2_000_000) >> 17 & 1, 1);
        let times_9 = 7 << 18 | 1 << 16 | 4 << 8;
        rcc.write(0x04, times_9, 2_000_000);
        rcc.write(0x00, 0x0101_0083, 2_000_000);
        // Not locked yet: the switch does not happen.
        rcc.write(0x04, times_9 | 2, 2_100_000);
        assert_eq!(rcc.frequencies().hclk, 8_000_000);
        rcc.write(0x04, times_9 | 2, 2_200_000);
        let at = rcc.frequencies();
        assert_eq!((rcc.ratios().pclk2, rcc.ratios().timers), (1, 1));
        assert_eq!(
            [at.hclk, at.pclk1, at.pclk2],
            [72_000_000, 36_000_000, 72_000_000]
        );
        assert_eq!(rcc.read(0x04, 2_200_000) >> 2 & 3, 2);
    }

    #[test]
    fn causes_of_resets_add_up_until_they_are_removed() {
        let rcc = Rcc::reset(Cause::Power, 0);
        let mut rcc = Rcc::reset(Cause::Watchdog, rcc.flags());
        assert_eq!(rcc.flags(), 0x2C00_0000);
        rcc.write(0x24, 1 << 24, 0);
        assert_eq!(rcc.flags(), 0);
        assert_eq!(
            Rcc::reset(Cause::Software, rcc.flags()).flags(),
            0x1400_0000
        );
    }
}
