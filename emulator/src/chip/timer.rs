//! A general-purpose timer, TIM2 to TIM4: counts up, compares, captures.
//!
//! In: loads, stores, cycles of HCLK, edges of its inputs. Out: an interrupt line.
//!
//! Source: RM0008 15.3 and 15.4. Left out: counting down and centre-aligned, slave modes and other
//! clocks than the internal one, outputs on pins, DMA, the input's filter and prescaler, and the
//! preload of compare values: they count at once.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 00h | CR1 | RM0008 15.4.1 |
//! | 04h | CR2 | 15.4.2 |
//! | 08h | SMCR | 15.4.3 |
//! | 0Ch | DIER | 15.4.4 |
//! | 10h | SR | 15.4.5 |
//! | 14h | EGR | 15.4.6 |
//! | 18h | CCMR1 | 15.4.7 |
//! | 1Ch | CCMR2 | 15.4.8 |
//! | 20h | CCER | 15.4.9 |
//! | 24h | CNT | 15.4.10 |
//! | 28h | PSC | 15.4.11 |
//! | 2Ch | ARR | 15.4.12 |
//! | 34h | CCR1, on to CCR4 at 40h | 15.4.13 to 15.4.16 |

/// Channels of a timer.
const CHANNELS: usize = 4;

/// The registers.
#[derive(Clone, Debug)]
pub struct Timer {
    cr1: u32,
    cr2: u32,
    smcr: u32,
    dier: u32,
    sr: u32,
    ccmr: [u32; 2],
    ccer: u32,
    psc: u32,
    /// The prescaler that counts now; PSC takes its place at the next update (15.4.11).
    psc_now: u32,
    arr: u32,
    arr_now: u32,
    ccr: [u32; CHANNELS],
    /// Count at `base_cycle`.
    base: u32,
    base_cycle: u64,
    /// Values below this one were compared in this round.
    compared: u32,
    /// What it does by itself; `None` when that was not asked since a register has changed.
    plan: Option<Plan>,
}

/// What a timer does by itself. It is asked for at many more cycles than it changes at.
#[derive(Clone, Copy, Debug)]
struct Plan {
    /// With so many cycles of HCLK in one of the timer's clock.
    per_clock: u32,
    /// Before this cycle no flag goes up and no round ends.
    quiet: u64,
    /// See [`Timer::next_event`].
    event: Option<u64>,
}

impl Default for Timer {
    fn default() -> Self {
        Self {
            cr1: 0,
            cr2: 0,
            smcr: 0,
            dier: 0,
            sr: 0,
            ccmr: [0; 2],
            ccer: 0,
            psc: 0,
            psc_now: 0,
            arr: 0xFFFF,
            arr_now: 0xFFFF,
            ccr: [0; CHANNELS],
            base: 0,
            base_cycle: 0,
            compared: 0,
            plan: None,
        }
    }
}

impl Timer {
    fn runs(&self) -> bool {
        self.cr1 & 1 != 0 && self.arr_now != 0
    }

    /// Cycles of HCLK between two counts.
    fn step(&self, per_clock: u32) -> u64 {
        u64::from(per_clock) * u64::from(self.psc_now + 1)
    }

    /// The count at `cycle`, no update in between.
    fn count(&self, cycle: u64, per_clock: u32) -> u32 {
        if !self.runs() {
            return self.base;
        }
        let steps = cycle.saturating_sub(self.base_cycle) / self.step(per_clock);
        self.base
            .saturating_add(u32::try_from(steps).unwrap_or(u32::MAX))
    }

    /// The count at a cycle that may be before the base, by less than a round.
    fn count_back(&self, cycle: u64, per_clock: u32) -> u32 {
        let before = self.base_cycle.saturating_sub(cycle);
        if before == 0 || !self.runs() {
            return self.count(cycle, per_clock);
        }
        let round = u64::from(self.arr_now) + 1;
        let steps = before.div_ceil(self.step(per_clock)) % round;
        ((u64::from(self.base) + round - steps) % round) as u32
    }

    /// When the counter comes to `count` from its base, cycles.
    fn when(&self, count: u32, per_clock: u32) -> u64 {
        let steps = u64::from(count.saturating_sub(self.base));
        self.base_cycle + steps * self.step(per_clock)
    }

    /// Counts from base to wrap: a counter that stands beyond ARR goes on to FFFFh.
    fn top(&self) -> u32 {
        if self.base > self.arr_now {
            0xFFFF
        } else {
            self.arr_now
        }
    }

    /// Comes to `cycle` as far as anybody sees who neither loads nor stores: [`Timer::advance`]
    /// where that would raise a flag. Then finds out what comes next by itself.
    pub fn follow(&mut self, cycle: u64, per_clock: u32) {
        let still = |plan: &Plan| cycle < plan.quiet && per_clock == plan.per_clock;
        if self.plan.as_ref().is_some_and(still) {
            return;
        }
        self.advance(cycle, per_clock);
        self.plan = Some(Plan {
            per_clock,
            quiet: self.next_change(per_clock),
            event: self.find_event(per_clock),
        });
    }

    /// Comes to `cycle`; flags go up on the way.
    pub fn advance(&mut self, cycle: u64, per_clock: u32) {
        self.plan = None;
        if !self.runs() {
            return;
        }
        loop {
            // A value that the counter passes is compared, and one that it was set to too.
            let wrap = self.when(self.top() + 1, per_clock);
            let end = cycle.min(wrap.saturating_sub(1));
            self.compare(self.count(end, per_clock));
            if cycle < wrap {
                return;
            }
            self.base = 0;
            self.base_cycle = wrap;
            self.compared = 0;
            self.update();
            // 15.3.10: one-pulse mode stops at the update.
            if self.cr1 >> 3 & 1 != 0 {
                self.cr1 &= !1;
            }
            if !self.runs() {
                return;
            }
            self.skip_whole_rounds(cycle, per_clock);
        }
    }

    /// Rounds in which nothing new can happen are not walked through one by one.
    fn skip_whole_rounds(&mut self, cycle: u64, per_clock: u32) {
        let round = self.step(per_clock) * u64::from(self.arr_now + 1);
        let rounds = cycle.saturating_sub(self.base_cycle) / round;
        if rounds > 1 {
            self.compare(self.arr_now);
            self.compared = 0;
            self.base_cycle += (rounds - 1) * round;
        }
    }

    /// Compare flags of all values up to `count` that were not passed before in this round.
    fn compare(&mut self, count: u32) {
        if count < self.compared {
            return;
        }
        for channel in 0..CHANNELS {
            let passed = (self.compared..=count).contains(&self.ccr[channel]);
            if self.is_output(channel) && passed {
                self.sr |= 2 << channel;
            }
        }
        self.compared = self.compared.max(count + 1);
    }

    /// An update event: the new prescaler and the new end count from here (15.3.2).
    fn update(&mut self) {
        self.psc_now = self.psc;
        self.arr_now = self.arr;
        // 15.4.1: UDIS.
        if self.cr1 >> 1 & 1 == 0 {
            self.sr |= 1;
        }
    }

    fn is_output(&self, channel: usize) -> bool {
        self.selection(channel) == 0
    }

    /// CCxS (15.4.7): 0 output, 1 the channel's own input.
    fn selection(&self, channel: usize) -> u32 {
        self.ccmr[channel / 2] >> (8 * (channel % 2)) & 3
    }

    /// The input of a channel has changed to `level` at `cycle` (15.3.5), which the timer may have
    /// passed: while the core is held it is ahead of the world.
    pub fn edge(&mut self, channel: usize, level: bool, cycle: u64, per_clock: u32) {
        self.advance(cycle, per_clock);
        let enabled = self.ccer >> (4 * channel) & 1 != 0;
        let falling = self.ccer >> (4 * channel + 1) & 1 != 0;
        if channel >= CHANNELS || self.selection(channel) != 1 || !enabled || level == falling {
            return;
        }
        // A capture over one that was not read: CCxOF.
        if self.sr >> (1 + channel) & 1 != 0 {
            self.sr |= 0x200 << channel;
        }
        self.ccr[channel] = self.count_back(cycle, per_clock);
        self.sr |= 2 << channel;
    }

    /// The interrupt line (15.4.4).
    pub fn line(&self) -> bool {
        self.sr & self.dier & 0x5F != 0
    }

    /// When the next flag goes up or the round ends, cycles; `u64::MAX` for never.
    fn next_change(&self, per_clock: u32) -> u64 {
        if !self.runs() {
            return u64::MAX;
        }
        let coming = self.compared..=self.top();
        let mut next = self.when(self.top() + 1, per_clock);
        for channel in 0..CHANNELS {
            let value = self.ccr[channel];
            if self.is_output(channel) && coming.contains(&value) {
                next = next.min(self.when(value, per_clock));
            }
        }
        next
    }

    /// When the next thing happens that an interrupt waits for, cycles.
    pub fn next_event(&self, per_clock: u32) -> Option<u64> {
        match self.plan {
            Some(plan) if plan.per_clock == per_clock => plan.event,
            _ => self.find_event(per_clock),
        }
    }

    fn find_event(&self, per_clock: u32) -> Option<u64> {
        if !self.runs() || self.dier & 0x1F == 0 {
            return None;
        }
        let mut next = self.when(self.top() + 1, per_clock);
        for channel in 0..CHANNELS {
            let wanted = self.dier >> (1 + channel) & 1 != 0 && self.sr >> (1 + channel) & 1 == 0;
            let value = self.ccr[channel];
            if wanted && self.is_output(channel) && value >= self.compared && value <= self.top() {
                next = next.min(self.when(value, per_clock));
            }
        }
        Some(next)
    }

    /// A load at a cycle up to which the timer has come; `offset` from its base.
    pub fn read(&mut self, offset: u32, cycle: u64, per_clock: u32) -> u32 {
        match offset {
            0x00 => self.cr1,
            0x04 => self.cr2,
            0x08 => self.smcr,
            0x0C => self.dier,
            0x10 => self.sr,
            0x18 => self.ccmr[0],
            0x1C => self.ccmr[1],
            0x20 => self.ccer,
            // 15.4.10.
            0x24 => self.count(cycle, per_clock),
            0x28 => self.psc,
            0x2C => self.arr,
            0x34..=0x40 => {
                let channel = (offset as usize - 0x34) / 4;
                // 15.4.5: reading a capture takes its flag away.
                if self.selection(channel) != 0 {
                    self.sr &= !(2 << channel);
                }
                self.ccr[channel]
            }
            _ => 0,
        }
    }

    /// A store at a cycle up to which the timer has come.
    pub fn write(&mut self, offset: u32, value: u32, cycle: u64, per_clock: u32) {
        self.plan = None;
        let now = self.count(cycle, per_clock);
        match offset {
            0x00 => {
                self.rebase(now, cycle, per_clock);
                self.cr1 = value & 0x3FF;
            }
            0x04 => self.cr2 = value & 0xF8,
            0x08 => self.smcr = value & 0xFFFF,
            0x0C => self.dier = value & 0x5F5F,
            // 15.4.5: a 0 takes a flag away, a 1 leaves it.
            0x10 => self.sr &= value,
            0x14 => self.generate(value, now, cycle),
            0x18 => self.ccmr[0] = value & 0xFFFF,
            0x1C => self.ccmr[1] = value & 0xFFFF,
            0x20 => self.ccer = value & 0x3333,
            0x24 => {
                self.base = value & 0xFFFF;
                self.base_cycle = cycle;
                self.compared = self.base;
            }
            0x28 => self.psc = value & 0xFFFF,
            0x2C => {
                self.arr = value & 0xFFFF;
                // 15.4.1: without ARPE it counts at once.
                if self.cr1 >> 7 & 1 == 0 {
                    self.rebase(now, cycle, per_clock);
                    self.arr_now = self.arr;
                }
            }
            0x34..=0x40 => {
                let channel = (offset as usize - 0x34) / 4;
                // What has passed is not compared with the new value.
                self.rebase(now, cycle, per_clock);
                if self.is_output(channel) {
                    self.ccr[channel] = value & 0xFFFF;
                }
            }
            _ => {}
        }
    }

    /// Lets the base be `now`, and keeps the part of a step that has passed.
    fn rebase(&mut self, now: u32, cycle: u64, per_clock: u32) {
        let passed = match self.runs() {
            true => cycle.saturating_sub(self.base_cycle) % self.step(per_clock),
            false => 0,
        };
        self.base = now;
        self.base_cycle = cycle - passed;
    }

    /// EGR (15.4.6).
    fn generate(&mut self, value: u32, now: u32, cycle: u64) {
        if value & 1 != 0 {
            self.base = 0;
            self.base_cycle = cycle;
            self.compared = 0;
            self.psc_now = self.psc;
            self.arr_now = self.arr;
            // 15.4.1: with URS only the counter itself raises the flag.
            if self.cr1 & 0b110 == 0 {
                self.sr |= 1;
            }
        }
        for channel in 0..CHANNELS {
            if value >> (1 + channel) & 1 != 0 {
                if !self.is_output(channel) {
                    self.ccr[channel] = now;
                }
                self.sr |= 2 << channel;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Counts us at 72 MHz, free running.
    fn running() -> Timer {
        let mut timer = Timer::default();
        timer.write(0x28, 71, 0, 1);
        timer.write(0x14, 1, 0, 1);
        timer.write(0x10, 0, 0, 1);
        timer.write(0x00, 1, 0, 1);
        timer
    }

    #[test]
    fn it_counts_microseconds_and_wraps() {
        let mut timer = running();
        timer.advance(72 * 500 + 71, 1);
        assert_eq!(timer.read(0x24, 72 * 500 + 71, 1), 500);
        assert_eq!(timer.read(0x10, 0, 1) & 1, 0);
        timer.advance(72 * 65_536, 1);
        assert_eq!(timer.read(0x24, 72 * 65_536, 1), 0);
        assert_eq!(timer.read(0x10, 0, 1) & 1, 1);
        timer.advance(72 * 65_536 * 1000 + 72, 1);
        assert_eq!(timer.read(0x24, 72 * 65_536 * 1000 + 72, 1), 1);
    }

    #[test]
    fn a_capture_keeps_the_count_of_the_edge_and_tells_of_one_that_was_missed() {
        let mut timer = running();
        timer.write(0x18, 1, 0, 1);
        timer.write(0x20, 1, 0, 1);
        timer.write(0x0C, 2, 0, 1);
        timer.edge(0, true, 72 * 100, 1);
        timer.edge(0, false, 72 * 150, 1);
        assert!(timer.line());
        timer.edge(0, true, 72 * 200, 1);
        assert_eq!(timer.read(0x10, 0, 1) & 0x202, 0x202);
        assert_eq!(timer.read(0x34, 0, 1), 200);
        assert!(!timer.line());
    }

    #[test]
    fn an_edge_that_was_told_of_behind_a_wrap_was_captured_at_the_wrap() {
        let mut timer = running();
        timer.write(0x18, 1, 0, 1);
        timer.write(0x20, 1, 0, 1);
        // The core was held from 60 ms to 90 ms, and looks when the world is still at 60 ms.
        timer.write(0x34 + 4, 1_000, 72 * 60_000, 1);
        timer.advance(72 * 90_000, 1);
        for (us, count) in [
            (65_000, 65_000),
            (65_535, 65_535),
            (65_536, 0),
            (70_000, 4464),
        ] {
            timer.edge(0, true, 72 * us, 1);
            assert_eq!(timer.read(0x34, 72 * 90_000, 1), count, "{us}");
        }
        assert_eq!(timer.read(0x24, 72 * 90_000, 1), 90_000 - 65_536);
    }

    #[test]
    fn a_compare_asks_once_per_round() {
        let mut timer = running();
        timer.write(0x38, 1_000, 0, 1);
        timer.write(0x0C, 1 << 2, 0, 1);
        assert_eq!(timer.next_event(1), Some(72_000));
        timer.advance(71_999, 1);
        assert!(!timer.line());
        timer.advance(72_000, 1);
        assert!(timer.line());
        timer.write(0x10, !(1 << 2), 72_001, 1);
        timer.advance(72 * 60_000, 1);
        assert!(!timer.line());
        timer.advance(72 * (65_536 + 1_000), 1);
        assert!(timer.line());
    }

    #[test]
    fn a_compare_value_that_has_passed_waits_for_the_next_round() {
        let mut timer = running();
        timer.advance(72 * 5_000, 1);
        timer.write(0x10, 0, 72 * 5_000, 1);
        timer.write(0x38, 4_999, 72 * 5_000, 1);
        timer.advance(72 * 60_000, 1);
        assert_eq!(timer.read(0x10, 0, 1) & 4, 0);
        timer.write(0x38, 60_500, 72 * 60_000, 1);
        timer.advance(72 * 60_500, 1);
        assert_eq!(timer.read(0x10, 0, 1) & 4, 4);
    }
}
