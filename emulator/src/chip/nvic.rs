//! Which exception comes first: the interrupt controller with the core's own exceptions.
//!
//! In: interrupt lines of the peripherals, loads and stores of the code, exceptions that begin and
//! end. Out: the exception that would be taken now. Numbers are those of exceptions: interrupt n
//! is exception 16 + n.
//!
//! Sources: PM0056 4.3 (registers), 2.3.4 and 2.3.5 (priorities); RM0008 10.1.2 (60 interrupts).
//! Left out: NMI's only source, the clock security system; debug monitor.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 000h | ISER | PM0056 4.3.2 |
//! | 080h | ICER | 4.3.3 |
//! | 100h | ISPR | 4.3.4 |
//! | 180h | ICPR | 4.3.5 |
//! | 200h | IABR | 4.3.6 |
//! | 300h | IPR | 4.3.7 |
//! | E00h | STIR | 4.3.8 |

/// Exceptions of the part, thread mode's 0 included.
pub const EXCEPTIONS: u32 = 16 + 60;
/// Exception numbers of the core (PM0056 table 16).
pub const HARD_FAULT: u32 = 3;
/// A bus fault.
pub const BUS_FAULT: u32 = 5;
/// A usage fault.
pub const USAGE_FAULT: u32 = 6;
/// SVC.
pub const SV_CALL: u32 = 11;
/// PendSV.
pub const PEND_SV: u32 = 14;
/// SysTick.
pub const SYS_TICK: u32 = 15;

/// The four upper bits of a priority are there (PM0056 4.3.7).
const PRIORITY_BITS: u8 = 0xF0;
/// The priority of thread mode: below all.
const THREAD: i16 = 256;

/// An exception that waits, with its group priority.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Waiting {
    /// Its number.
    pub number: u32,
    /// Its group priority: -2 NMI, -1 hard fault, then 0 to 240, lower first.
    pub priority: i16,
}

/// The controller.
#[derive(Clone, Debug)]
pub struct Nvic {
    pending: u128,
    enabled: u128,
    active: u128,
    /// Level of the peripherals' lines.
    lines: u128,
    priority: [u8; EXCEPTIONS as usize],
    /// PRIGROUP of AIRCR, 0 to 7.
    prigroup: u8,
}

impl Default for Nvic {
    fn default() -> Self {
        Self {
            pending: 0,
            // The core's own exceptions need no enabling here.
            enabled: 0xFFFF,
            active: 0,
            lines: 0,
            priority: [0; EXCEPTIONS as usize],
            prigroup: 0,
        }
    }
}

impl Nvic {
    /// Takes the peripherals' lines, bit n for interrupt n. A line that is high makes its
    /// interrupt pending, unless that is being served and the line has stayed (PM0056 4.3.9).
    pub fn set_lines(&mut self, interrupts: u64) {
        let lines = u128::from(interrupts) << 16;
        let rising = lines & !self.lines;
        self.pending |= lines & !self.active | rising;
        self.lines = lines;
    }

    /// The exception that would go first if no mask held it: pending, enabled, and of a higher
    /// priority than what is being served.
    pub fn first(&self) -> Option<Waiting> {
        let mut left = self.pending & self.enabled;
        let mut best: Option<(i16, u8, u32)> = None;
        while left != 0 {
            let number = left.trailing_zeros();
            left &= left - 1;
            let order = (self.group_priority(number), self.own(number), number);
            best = Some(best.map_or(order, |best| best.min(order)));
        }
        let (priority, _, number) = best?;
        (priority < self.current()).then_some(Waiting { number, priority })
    }

    /// The group priority that the code runs at now.
    pub fn current(&self) -> i16 {
        let mut left = self.active;
        let mut lowest = THREAD;
        while left != 0 {
            let number = left.trailing_zeros();
            left &= left - 1;
            lowest = lowest.min(self.group_priority(number));
        }
        lowest
    }

    fn own(&self, number: u32) -> u8 {
        self.priority.get(number as usize).copied().unwrap_or(0)
    }

    fn group_priority(&self, number: u32) -> i16 {
        match number {
            1 => -3,
            2 => -2,
            HARD_FAULT => -1,
            _ => i16::from(self.group(self.own(number))),
        }
    }

    /// The part of a priority that decides about nesting (PM0056 4.4.5, PRIGROUP).
    pub fn group(&self, priority: u8) -> u8 {
        let dropped = self.prigroup + 1;
        (u16::from(priority) >> dropped << dropped) as u8 & PRIORITY_BITS
    }

    /// Sets PRIGROUP.
    pub fn set_group(&mut self, prigroup: u8) {
        self.prigroup = prigroup & 7;
    }

    /// PRIGROUP.
    pub fn prigroup(&self) -> u8 {
        self.prigroup
    }

    /// Makes an exception pending.
    pub fn pend(&mut self, number: u32) {
        self.pending |= bit(number);
    }

    /// Takes that back.
    pub fn unpend(&mut self, number: u32) {
        self.pending &= !bit(number);
    }

    /// Whether an exception is pending.
    pub fn is_pending(&self, number: u32) -> bool {
        self.pending & bit(number) != 0
    }

    /// Whether an exception is being served.
    pub fn is_active(&self, number: u32) -> bool {
        self.active & bit(number) != 0
    }

    /// The handler of `number` begins.
    pub fn begin(&mut self, number: u32) {
        self.pending &= !bit(number);
        self.active |= bit(number);
    }

    /// The handler of `number` has ended; a line that is still high asks again.
    pub fn end(&mut self, number: u32) {
        self.active &= !bit(number);
        self.pending |= self.lines & bit(number);
    }

    /// The exception whose handler runs now, 0 for none: of those being served the first in
    /// priority, which has interrupted the others.
    pub fn running(&self) -> u32 {
        let served = (0..EXCEPTIONS).filter(|number| self.is_active(*number));
        let first = served.min_by_key(|number| self.group_priority(*number));
        first.unwrap_or(0)
    }

    /// How many exceptions are being served.
    pub fn depth(&self) -> u32 {
        self.active.count_ones()
    }

    /// The number to show as VECTPENDING, 0 for none (PM0056 4.4.3).
    pub fn pending_number(&self) -> u32 {
        self.first().map_or(0, |waiting| waiting.number)
    }

    /// The priority byte of an exception.
    pub fn priority(&self, number: u32) -> u8 {
        self.own(number)
    }

    /// Sets it; only the upper four bits are there.
    pub fn set_priority(&mut self, number: u32, priority: u8) {
        if let Some(place) = self.priority.get_mut(number as usize) {
            *place = priority & PRIORITY_BITS;
        }
    }

    /// A load from the NVIC's registers; `offset` from E000 E100h.
    pub fn read(&self, offset: u32) -> u32 {
        let set = |of: u128, base: u32| (of >> 16 >> (8 * (offset - base))) as u32;
        match offset {
            // PM0056 4.3.2 and 4.3.3, ISER and ICER.
            0x000..=0x008 => set(self.enabled, 0x000),
            0x080..=0x088 => set(self.enabled, 0x080),
            // PM0056 4.3.4 and 4.3.5, ISPR and ICPR.
            0x100..=0x108 => set(self.pending, 0x100),
            0x180..=0x188 => set(self.pending, 0x180),
            // PM0056 4.3.6, IABR.
            0x200..=0x208 => set(self.active, 0x200),
            // PM0056 4.3.7, IPR.
            0x300..=0x33B => {
                let first = 16 + (offset - 0x300);
                u32::from_le_bytes([0, 1, 2, 3].map(|n| self.own(first + n)))
            }
            _ => 0,
        }
    }

    /// A store of a whole word; `offset` from E000 E100h.
    pub fn write(&mut self, offset: u32, value: u32) {
        let bits = |base: u32| u128::from(value) << (8 * (offset - base)) << 16;
        match offset {
            0x000..=0x008 => self.enabled |= bits(0x000) & interrupts(),
            0x080..=0x088 => self.enabled &= !bits(0x080) | 0xFFFF,
            0x100..=0x108 => self.pending |= bits(0x100) & interrupts(),
            0x180..=0x188 => {
                // A line that is high makes its interrupt pending again (PM0056 4.3.9).
                self.pending &= !bits(0x180) | 0xFFFF | self.lines & !self.active;
            }
            0x300..=0x33B => {
                let first = 16 + (offset - 0x300);
                for (number, priority) in (first..).zip(value.to_le_bytes()) {
                    self.set_priority(number, priority);
                }
            }
            // PM0056 4.3.8, STIR.
            0xE00 => self.pend(16 + (value & 0x1FF)),
            _ => {}
        }
    }
}

const fn bit(number: u32) -> u128 {
    if number < EXCEPTIONS { 1 << number } else { 0 }
}

/// The bits of the interrupts that there are.
const fn interrupts() -> u128 {
    ((1 << EXCEPTIONS) - 1) & !0xFFFF
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exceptions::Masks;

    fn enabled() -> Nvic {
        let mut nvic = Nvic::default();
        nvic.write(0x000, u32::MAX);
        nvic.write(0x004, u32::MAX);
        nvic
    }

    #[test]
    fn the_higher_priority_goes_first_and_then_the_lower_number() {
        let mut nvic = enabled();
        nvic.write(0x300, 0x4040_2060);
        nvic.set_lines(0b1110);
        let first = |nvic: &Nvic| nvic.first().map(|waiting| waiting.number);
        assert_eq!(first(&nvic), Some(17));
        nvic.begin(17);
        // Of lower priority: both wait.
        assert_eq!(first(&nvic), None);
        nvic.set_lines(0b1100);
        nvic.end(17);
        assert_eq!(first(&nvic), Some(18));
        nvic.pend(SYS_TICK);
        assert_eq!(first(&nvic), Some(SYS_TICK));
    }

    #[test]
    fn sub_priorities_order_but_do_not_nest() {
        let mut nvic = enabled();
        // Two bits of group, two of sub-priority.
        nvic.set_group(5);
        nvic.write(0x300, 0x0000_4050);
        nvic.set_lines(0b01);
        nvic.begin(16);
        nvic.set_lines(0b11);
        assert_eq!(nvic.first(), None);
        nvic.set_group(3);
        assert_eq!(nvic.first().map(|waiting| waiting.number), Some(17));
    }

    #[test]
    fn a_line_that_stays_high_asks_again_after_its_handler() {
        let mut nvic = enabled();
        nvic.set_lines(1);
        nvic.begin(16);
        nvic.set_lines(1);
        assert!(!nvic.is_pending(16));
        nvic.end(16);
        assert!(nvic.is_pending(16));
    }

    #[test]
    fn masks_keep_away_what_they_should() {
        let mut nvic = enabled();
        nvic.write(0x300, 0x40);
        nvic.set_lines(1);
        let waiting = nvic.first().unwrap();
        let masks = |basepri, primask| Masks {
            primask,
            faultmask: false,
            basepri,
        };
        assert!(masks(0, false).let_through(waiting, &nvic));
        assert!(masks(0x50, false).let_through(waiting, &nvic));
        assert!(!masks(0x40, false).let_through(waiting, &nvic));
        assert!(!masks(0, true).let_through(waiting, &nvic));
        assert!(masks(0, true).wakes(waiting, &nvic));
        nvic.pend(HARD_FAULT);
        let hard = nvic.first().unwrap();
        assert!(masks(0x10, true).let_through(hard, &nvic));
    }

    #[test]
    fn enable_pend_and_clear_reach_the_last_interrupt() {
        let mut nvic = Nvic::default();
        nvic.write(0x004, 1 << 27);
        nvic.write(0x104, 1 << 27);
        assert_eq!(nvic.first().map(|waiting| waiting.number), Some(75));
        nvic.write(0x184, 1 << 27);
        assert_eq!(nvic.first(), None);
        assert_eq!(nvic.read(0x004), 1 << 27);
        nvic.write(0x084, 1 << 27);
        assert_eq!(nvic.read(0x084), 0);
    }
}
