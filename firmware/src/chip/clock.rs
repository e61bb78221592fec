//! The time: TIM2 at one microsecond per tick, with capture of data-ready and a compare.
//!
//! In: the edge of data-ready on PA0 (channel 1), and the instant to be woken at (channel 2). Out:
//! the time, the time of each edge, and interrupts for edge, compare and overflow.
//! RM0008 15.3.5 (capture), 15.3.8 (compare) and 15.4 (registers).
//!
//! The capture is the timer's own, so an edge has its time to the microsecond however late the
//! code gets there. Nothing here takes longer than the 40 ms of a page's erase, and `ticks` bears
//! half as much again.

use core::sync::atomic::{AtomicU32, Ordering};

use embedded_hal::delay::DelayNs;
use instant::Instant;
use stm32f1xx_hal::pac::TIM2;
use stm32f1xx_hal::pac::tim2::RegisterBlock;

use super::register::write;
use crate::ticks;

/// The timer's clock is 72 MHz: twice APB1, since APB1 is divided (RM0008 7.2).
const PRESCALER: u32 = 72 - 1;

/// CR1: counter enable.
const CEN: u32 = 1;
/// EGR: update generation.
const UG: u32 = 1;
/// CCMR1: channel 1 captures its own input, after 8 equal samples at 72 MHz against ringing
/// (IC1F = 3); channel 2 compares and moves no pin.
const CHANNELS: u32 = 3 << 4 | 1;
/// CCER: channel 1 captures, on the rising edge.
const CC1E: u32 = 1;
/// DIER and SR: update; capture of channel 1; compare of channel 2.
const UPDATE: u32 = 1;
/// See [`UPDATE`].
const CAPTURE: u32 = 1 << 1;
/// See [`UPDATE`].
const COMPARE: u32 = 1 << 2;
/// SR: a capture has overwritten one that was not read.
const OVERCAPTURE: u32 = 1 << 9;

/// Overflows so far, counted by [`interrupt`].
static OVERFLOWS: AtomicU32 = AtomicU32::new(0);

fn registers() -> &'static RegisterBlock {
    // SAFETY: the block of TIM2 is at this address for ever, and its registers are cells that
    // allow shared access. Who writes which: `start` before interrupts are on, then `interrupt`
    // the flags, and `Alarm` the compare.
    unsafe { &*TIM2::ptr() }
}

/// Starts the timer, whose peripheral clock is on; gives the right to set the alarm.
pub fn start(_: TIM2) -> Alarm {
    let timer = registers();
    write(timer.psc(), PRESCALER);
    write(timer.arr(), 0xFFFF);
    write(timer.ccmr1_input(), CHANNELS);
    write(timer.ccer(), CC1E);
    // The prescaler counts from the next update on: force one, then forget its flag.
    write(timer.egr(), UG);
    write(timer.sr(), 0);
    write(timer.dier(), UPDATE | CAPTURE);
    write(timer.cr1(), CEN);
    Alarm(())
}

/// The time since the start of the timer.
pub fn now() -> Instant {
    cortex_m::interrupt::free(|_| {
        let overflows = OVERFLOWS.load(Ordering::Relaxed);
        // In this order: an overflow between both reads comes with a large count, for which
        // `join` does not look at the flag.
        let count = registers().cnt().read().bits() as u16;
        let pending = registers().sr().read().bits() & UPDATE != 0;
        ticks::join(overflows, pending, count)
    })
}

/// Serves the timer's interrupt: counts overflows, and gives the time of a data-ready edge.
///
/// Of several edges since the last call the latest is given: the sample that can still be read is
/// that one's.
pub fn interrupt() -> Option<Instant> {
    let timer = registers();
    let flags = timer.sr().read().bits();
    let overflows = OVERFLOWS.load(Ordering::Relaxed);
    let late = flags & UPDATE != 0;
    // Reading the capture clears its flag (RM0008 15.4.5). The time comes after it, and before
    // the overflow is counted: so the edge is not later than the time.
    let captured = (flags & CAPTURE != 0).then(|| {
        let count = timer.ccr1().read().bits() as u16;
        ticks::captured(count, now())
    });
    // A flag is cleared by a zero; ones leave the others as they are.
    let seen = flags & (UPDATE | COMPARE | OVERCAPTURE);
    write(timer.sr(), !seen & 0x1E5F);
    OVERFLOWS.store(overflows.wrapping_add(u32::from(late)), Ordering::Relaxed);
    captured
}

/// The right to set when to be woken.
pub struct Alarm(());

impl Alarm {
    /// Asks for an interrupt at `at`; `false` when that is past, so that none will come. `now` is
    /// the time, or was it a moment ago.
    ///
    /// An instant more than a round ahead has to be asked for again after the next overflow,
    /// which interrupts in any case.
    pub fn set(&mut self, at: Instant, now: Instant) -> bool {
        let timer = registers();
        let compare = ticks::compare(at, now);
        write(timer.ccr2(), u32::from(compare.unwrap_or(0)));
        let enabled = if compare.is_some() { COMPARE } else { 0 };
        write(timer.dier(), UPDATE | CAPTURE | enabled);
        at > self::now()
    }
}

/// Waiting by looking at the clock; interrupts are served meanwhile.
pub struct Wait;

impl DelayNs for Wait {
    fn delay_ns(&mut self, ns: u32) {
        // Never too short: what has begun of a microsecond counts, and so does the tick under way.
        let end = now().offset(i64::from(ns.div_ceil(1000)) + 1);
        while now() < end {}
    }
}
