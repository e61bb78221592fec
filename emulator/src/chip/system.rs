//! The core's own registers but the NVIC's: system control, SysTick, cycle counter, debug.
//!
//! In: loads, stores, cycles. Out: where the vectors are, requests for a reset, SysTick's
//! exceptions, what a fault was. Sources: PM0056 4.4 (SCB), 4.5 (SysTick); ARMv7-M C1.8 (DWT),
//! C1.6.5 (DEMCR); RM0008 31.6.1, 31.16.3 (DBGMCU).
//!
//! Left out: the MPU (the part has none), SysTick's external clock (HCLK/8) as another frequency
//! than HCLK / 8, all of DWT but its cycle counter, and breakpoints.
//!
//! | address | register | section |
//! |---|---|---|
//! | E0001000h | DWT_CTRL | ARMv7-M C1.8 |
//! | E0001004h | DWT_CYCCNT | ARMv7-M C1.8 |
//! | E000E010h | STK_CTRL, on to STK_VAL at E000E018h | PM0056 4.5.1 to 4.5.3 |
//! | E000E014h | STK_LOAD | PM0056 4.5.2 |
//! | E000E018h | STK_VAL | PM0056 4.5.3 |
//! | E000E01Ch | STK_CALIB | PM0056 4.5.4 |
//! | E000E100h | the NVIC, which has its own table | PM0056 4.3 |
//! | E000ED00h | CPUID | PM0056 4.4.2 |
//! | E000ED04h | ICSR | PM0056 4.4.3 |
//! | E000ED08h | VTOR | PM0056 4.4.4 |
//! | E000ED0Ch | AIRCR | PM0056 4.4.5 |
//! | E000ED10h | SCR | PM0056 4.4.6 |
//! | E000ED14h | CCR | PM0056 4.4.7 |
//! | E000ED18h | SHPR1, on to SHPR3 at E000ED20h | PM0056 4.4.8 |
//! | E000ED24h | SHCSR | PM0056 4.4.9 |
//! | E000ED28h | CFSR | PM0056 4.4.10 |
//! | E000ED2Ch | HFSR | PM0056 4.4.11 |
//! | E000ED34h | MMFAR | PM0056 4.4.12 |
//! | E000ED38h | BFAR | PM0056 4.4.13 |
//! | E000EDFCh | DEMCR | ARMv7-M C1.6.5 |
//! | E0042000h | DBGMCU_IDCODE | RM0008 31.6.1 |
//! | E0042004h | DBGMCU_CR | RM0008 31.16.3 |

use flash::layout::{Layout, PAGE};

use super::nvic::{self, Nvic};

/// The part's identity: Cortex-M3 r1p1 (PM0056 4.4.2).
pub const CPUID: u32 = 0x411F_C231;

/// The registers.
#[derive(Clone, Debug)]
pub struct System {
    vtor: u32,
    scr: u32,
    ccr: u32,
    shcsr: u32,
    cfsr: u32,
    hfsr: u32,
    mmfar: u32,
    bfar: u32,
    demcr: u32,
    dbgmcu: u32,
    /// DBGMCU_IDCODE.
    identity: u32,
    systick: SysTick,
    /// CYCCNT counts from here, while it is on.
    counter: Option<u64>,
    counted: u32,
    reset_wanted: bool,
}

#[derive(Clone, Copy, Debug, Default)]
struct SysTick {
    ctrl: u32,
    load: u32,
    /// When the counter was loaded, cycles; `None` while it is off.
    from: Option<u64>,
    counted: bool,
    /// Value while it is off.
    rest: u32,
}

impl System {
    /// As after a reset, of the part with this map.
    pub fn of(layout: &Layout) -> Self {
        Self {
            vtor: 0,
            scr: 0,
            // PM0056 4.4.7: STKALIGN.
            ccr: 0x200,
            shcsr: 0,
            cfsr: 0,
            hfsr: 0,
            mmfar: 0,
            bfar: 0,
            demcr: 0,
            dbgmcu: 0,
            // RM0008 31.6.1: of high density, revision A; of medium density, revision X.
            identity: match layout.chip_page {
                PAGE => 0x1001_6414,
                _ => 0x2003_6410,
            },
            systick: SysTick::default(),
            counter: None,
            counted: 0,
            reset_wanted: false,
        }
    }
}

impl SysTick {
    /// Cycles of HCLK in one count (PM0056 4.5.1, CLKSOURCE).
    fn step(&self) -> u64 {
        if self.ctrl >> 2 & 1 != 0 { 1 } else { 8 }
    }

    /// Cycles from one wrap to the next; `None` while it does not count.
    fn round(&self) -> Option<u64> {
        (self.ctrl & 1 != 0 && self.load != 0).then(|| u64::from(self.load + 1) * self.step())
    }

    fn value(&self, cycle: u64) -> u32 {
        let (Some(from), Some(round)) = (self.from, self.round()) else {
            return self.rest;
        };
        let passed = (cycle.saturating_sub(from) % round / self.step()) as u32;
        // It goes to LOAD with the first count after it was cleared.
        if passed == 0 {
            0
        } else {
            self.load + 1 - passed
        }
    }

    /// Comes to `cycle`; true when it has come to 0 on the way and is to tell.
    fn advance(&mut self, cycle: u64) -> bool {
        let (Some(from), Some(round)) = (self.from, self.round()) else {
            return false;
        };
        let rounds = cycle.saturating_sub(from) / round;
        if rounds == 0 {
            return false;
        }
        self.from = Some(from + rounds * round);
        self.counted = true;
        self.ctrl >> 1 & 1 != 0
    }

    fn next_event(&self) -> Option<u64> {
        let told = self.ctrl >> 1 & 1 != 0;
        Some(self.from? + self.round()?).filter(|_| told)
    }
}

/// Why a hard fault came, for CFSR, HFSR and BFAR (PM0056 4.4.10, 4.4.11, 4.4.13).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blame {
    /// A load or store of this address: PRECISERR, BFARVALID.
    Data(u32),
    /// A store that was found wrong later: IMPRECISERR.
    LateStore,
    /// A fetch: IBUSERR.
    Instruction,
    /// An instruction that is none: UNDEFINSTR.
    Undefined,
    /// UNALIGNED.
    Unaligned,
    /// An exception's frame did not go onto the stack: STKERR.
    Stacking,
    /// A BKPT without a debugger: DEBUGEVT of HFSR.
    Breakpoint,
}

impl System {
    /// Where the vector table is.
    pub fn vectors(&self) -> u32 {
        self.vtor
    }

    /// Moves them, as a store into VTOR does (PM0056 4.4.4).
    pub fn set_vectors(&mut self, vectors: u32) {
        self.vtor = vectors & 0x3FFF_FE00;
    }

    /// Whether a reset was asked for.
    pub fn wants_reset(&self) -> bool {
        self.reset_wanted
    }

    /// SCR's SEVONPEND and SLEEPONEXIT (PM0056 4.4.6).
    pub fn sleeps_on_exit(&self) -> bool {
        self.scr >> 1 & 1 != 0
    }

    /// Whether an interrupt that falls pending is an event.
    pub fn pending_is_event(&self) -> bool {
        self.scr >> 4 & 1 != 0
    }

    /// Notes a fault; the exception that it becomes, before anything escalates it.
    pub fn blame(&mut self, blame: Blame) -> u32 {
        let (flags, enabled, number) = match blame {
            Blame::Data(address) => {
                self.bfar = address;
                (1 << 9 | 1 << 15, self.shcsr >> 17 & 1, nvic::BUS_FAULT)
            }
            Blame::LateStore => (1 << 10, self.shcsr >> 17 & 1, nvic::BUS_FAULT),
            Blame::Instruction => (1 << 8, self.shcsr >> 17 & 1, nvic::BUS_FAULT),
            Blame::Stacking => (1 << 12, self.shcsr >> 17 & 1, nvic::BUS_FAULT),
            Blame::Undefined => (1 << 16, self.shcsr >> 18 & 1, nvic::USAGE_FAULT),
            Blame::Unaligned => (1 << 24, self.shcsr >> 18 & 1, nvic::USAGE_FAULT),
            Blame::Breakpoint => {
                self.hfsr |= 1 << 31;
                return nvic::HARD_FAULT;
            }
        };
        self.cfsr |= flags;
        if enabled == 0 {
            self.escalate();
            return nvic::HARD_FAULT;
        }
        number
    }

    /// A fault becomes a hard fault: FORCED.
    pub fn escalate(&mut self) {
        self.hfsr |= 1 << 30;
    }

    /// Comes to `cycle`.
    pub fn advance(&mut self, cycle: u64, nvic: &mut Nvic) {
        if self.systick.advance(cycle) {
            nvic.pend(nvic::SYS_TICK);
        }
    }

    /// When SysTick tells next, cycles.
    pub fn next_event(&self) -> Option<u64> {
        self.systick.next_event()
    }

    fn cycles(&self, cycle: u64) -> u32 {
        let since = self
            .counter
            .map_or(0, |from| cycle.saturating_sub(from) as u32);
        self.counted.wrapping_add(since)
    }

    /// A load from the private bus at `cycle`; `None` where the NVIC's registers are.
    pub fn read(&mut self, address: u32, cycle: u64, nvic: &Nvic) -> Option<u32> {
        Some(match address {
            0xE000_1000 => u32::from(self.counter.is_some()) | 0x4000_0000,
            0xE000_1004 => self.cycles(cycle),
            0xE000_E010 => {
                // Reading takes COUNTFLAG away.
                let counted = std::mem::take(&mut self.systick.counted);
                self.systick.ctrl | u32::from(counted) << 16
            }
            0xE000_E014 => self.systick.load,
            0xE000_E018 => self.systick.value(cycle),
            // PM0056 4.5.4: 9000 counts are 1 ms at 72 MHz / 8.
            0xE000_E01C => 0x4000_2328,
            0xE000_E100..=0xE000_E4FF | 0xE000_EF00 => return None,
            0xE000_ED00 => CPUID,
            0xE000_ED04 => icsr(nvic),
            0xE000_ED08 => self.vtor,
            0xE000_ED0C => 0xFA05_0000 | u32::from(nvic.prigroup()) << 8,
            0xE000_ED10 => self.scr,
            0xE000_ED14 => self.ccr,
            0xE000_ED18..=0xE000_ED20 => {
                let first = 4 + (address - 0xE000_ED18);
                u32::from_le_bytes([0, 1, 2, 3].map(|n| nvic.priority(first + n)))
            }
            0xE000_ED24 => self.shcsr,
            0xE000_ED28 => self.cfsr,
            0xE000_ED2C => self.hfsr,
            0xE000_ED34 => self.mmfar,
            0xE000_ED38 => self.bfar,
            0xE000_EDFC => self.demcr,
            // RM0008 31.6.1: high density, revision X.
            0xE004_2000 => self.identity,
            0xE004_2004 => self.dbgmcu,
            _ => 0,
        })
    }

    /// A store of a whole word at `cycle`; false where the NVIC's registers are.
    pub fn write(&mut self, address: u32, value: u32, cycle: u64, nvic: &mut Nvic) -> bool {
        match address {
            0xE000_1000 => self.run_counter(value & 1 != 0, cycle),
            0xE000_1004 => {
                self.counted = value;
                self.counter = self.counter.map(|_| cycle);
            }
            0xE000_E010..=0xE000_E018 => self.write_systick(address, value, cycle),
            0xE000_E100..=0xE000_E4FF | 0xE000_EF00 => return false,
            0xE000_ED04 => write_icsr(value, nvic),
            // PM0056 4.4.4: bits 29 to 7, of which 8 and 7 are not there on this part.
            0xE000_ED08 => self.vtor = value & 0x3FFF_FE00,
            0xE000_ED0C if value >> 16 == 0x05FA => {
                nvic.set_group((value >> 8) as u8);
                self.reset_wanted |= value >> 2 & 1 != 0;
            }
            0xE000_ED10 => self.scr = value & 0x16,
            0xE000_ED14 => self.ccr = value & 0x31B,
            0xE000_ED18..=0xE000_ED20 => {
                let first = 4 + (address - 0xE000_ED18);
                for (number, priority) in (first..).zip(value.to_le_bytes()) {
                    nvic.set_priority(number, priority);
                }
            }
            0xE000_ED24 => self.shcsr = value & 0x7_0000,
            // Flags go by a 1.
            0xE000_ED28 => self.cfsr &= !value,
            0xE000_ED2C => self.hfsr &= !value,
            0xE000_EDFC => self.demcr = value & 0x0100_0000,
            0xE004_2004 => self.dbgmcu = value,
            _ => {}
        }
        true
    }

    /// The counter runs with TRCENA of DEMCR only.
    fn run_counter(&mut self, on: bool, cycle: u64) {
        self.counted = self.cycles(cycle);
        self.counter = (on && self.demcr != 0).then_some(cycle);
    }

    fn write_systick(&mut self, address: u32, value: u32, cycle: u64) {
        let systick = &mut self.systick;
        match address {
            0xE000_E010 => {
                let before = *systick;
                systick.ctrl = value & 7;
                let restarts = before.ctrl & 1 == 0 && value & 1 != 0;
                if restarts {
                    systick.from = Some(cycle);
                } else if value & 1 == 0 {
                    systick.rest = before.value(cycle);
                    systick.from = None;
                }
            }
            0xE000_E014 => systick.load = value & 0x00FF_FFFF,
            // Any store clears it, and COUNTFLAG.
            _ => {
                systick.counted = false;
                systick.rest = 0;
                systick.from = systick.from.map(|_| cycle);
            }
        }
    }
}

/// ICSR (PM0056 4.4.3).
fn icsr(nvic: &Nvic) -> u32 {
    let active = (0..nvic::EXCEPTIONS).filter(|number| nvic.is_active(*number));
    let running = active.min_by_key(|number| {
        let fixed = *number == nvic::HARD_FAULT;
        (if fixed { 0 } else { 1 }, nvic.priority(*number), *number)
    });
    running.unwrap_or(0)
        | u32::from(nvic.depth() < 2) << 11
        | nvic.pending_number() << 12
        | u32::from(nvic.is_pending(nvic::SYS_TICK)) << 26
        | u32::from(nvic.is_pending(nvic::PEND_SV)) << 28
}

fn write_icsr(value: u32, nvic: &mut Nvic) {
    let asked = |bit: u32| value >> bit & 1 != 0;
    for (set, clear, number) in [(28, 27, nvic::PEND_SV), (26, 25, nvic::SYS_TICK)] {
        if asked(set) {
            nvic.pend(number);
        } else if asked(clear) {
            nvic.unpend(number);
        }
    }
}

#[cfg(test)]
mod tests {
    use flash::layout::RC;

    use super::*;

    #[test]
    fn the_tick_comes_every_load_plus_one() {
        let (mut system, mut nvic) = (System::of(&RC), Nvic::default());
        system.write(0xE000_E014, 71_999, 0, &mut nvic);
        system.write(0xE000_E010, 7, 1000, &mut nvic);
        assert_eq!(system.next_event(), Some(73_000));
        system.advance(72_999, &mut nvic);
        assert!(!nvic.is_pending(nvic::SYS_TICK));
        system.advance(73_000, &mut nvic);
        assert!(nvic.is_pending(nvic::SYS_TICK));
        assert_eq!(system.next_event(), Some(145_000));
        assert_eq!(system.read(0xE000_E018, 73_001, &nvic), Some(71_999));
        assert_eq!(system.read(0xE000_E010, 73_001, &nvic), Some(7 | 1 << 16));
    }

    #[test]
    fn the_cycle_counter_runs_with_tracing_on() {
        let (mut system, mut nvic) = (System::of(&RC), Nvic::default());
        system.write(0xE000_1000, 1, 5, &mut nvic);
        assert_eq!(system.read(0xE000_1004, 100, &nvic), Some(0));
        system.write(0xE000_EDFC, 1 << 24, 100, &mut nvic);
        system.write(0xE000_1000, 1, 100, &mut nvic);
        assert_eq!(system.read(0xE000_1004, 172, &nvic), Some(72));
        system.write(0xE000_1004, 0, 172, &mut nvic);
        assert_eq!(system.read(0xE000_1004, 180, &nvic), Some(8));
    }

    #[test]
    fn a_reset_needs_its_key() {
        let (mut system, mut nvic) = (System::of(&RC), Nvic::default());
        system.write(0xE000_ED0C, 0x0000_0004, 0, &mut nvic);
        assert!(!system.wants_reset());
        system.write(0xE000_ED0C, 0x05FA_0304, 0, &mut nvic);
        assert!(system.wants_reset());
        assert_eq!(system.read(0xE000_ED0C, 0, &nvic), Some(0xFA05_0300));
    }

    #[test]
    fn a_bus_fault_without_its_handler_is_a_hard_fault() {
        let (mut system, nvic) = (System::of(&RC), Nvic::default());
        assert_eq!(system.blame(Blame::Data(0x6000_0000)), nvic::HARD_FAULT);
        assert_eq!(system.read(0xE000_ED28, 0, &nvic), Some(0x8200));
        assert_eq!(system.read(0xE000_ED2C, 0, &nvic), Some(1 << 30));
        assert_eq!(system.read(0xE000_ED38, 0, &nvic), Some(0x6000_0000));
    }
}
