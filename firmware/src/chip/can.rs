//! The CAN controller, bxCAN: mailboxes out, two FIFOs in, error state.
//!
//! In: frames for a mailbox, and interrupts. Out: [`Event`]s with their time, in the order in which
//! the controller's flags told of them. RM0008 24.4 (modes), 24.5 (test modes), 24.7 (mailboxes,
//! FIFOs, filters, errors), 24.9 (registers).
//!
//! Frames are never waited for: an interrupt tells what has become of one. A new bit rate has to
//! wait for the end of the frame on the bus. Bus-off ends when the device ends it (ABOM = 0).
//! Frames of any identifier come in; what is not for this node the stack throws away. A FIFO holds
//! three, which is less than a bus brings while the processor stands still for the erase of a page.
//! So what a master has to be heard with, NMT, LSS and the requests of SDOs, has FIFO 1 for itself:
//! of those a few are under way at most, whatever else there is. Within a FIFO the order is that of
//! the bus.

use canopen::Frame;
use canopen::frame::{ExtendedId, Id, StandardId};
use device::mailboxes::{Abort, MAILBOXES, Transmitter};
use instant::Instant;
use stm32f1xx_hal::pac::CAN;
use stm32f1xx_hal::pac::can::RegisterBlock;

use super::clock;
use super::register::write;
use crate::bit_timing;
use crate::driver::{Controller, ErrorState, Event};
use crate::inbox::Inbox;

/// MCR: initialisation request; every other bit is zero, so: no sleep, frames go out by
/// identifier, are repeated until they are acknowledged, and bus-off lasts until it is ended. A
/// full FIFO keeps what it has (RFLM).
const INRQ: u32 = 1;
/// See [`INRQ`].
const RFLM: u32 = 1 << 3;
/// MSR: initialisation acknowledged; an error interrupt is pending.
const INAK: u32 = 1;
/// See [`INAK`].
const ERRI: u32 = 1 << 2;
/// TSR, mailbox 0: request completed; transmission ok; abort request. Each next mailbox has its
/// own eight bits higher.
const RQCP: u32 = 1;
/// See [`RQCP`].
const TXOK: u32 = 1 << 1;
/// See [`RQCP`].
const ABRQ: u32 = 1 << 7;
/// RFR: frames in the FIFO; overrun; release.
const FMP: u32 = 3;
/// See [`FMP`].
const FOVR: u32 = 1 << 4;
/// See [`FMP`].
const RFOM: u32 = 1 << 5;
/// IER: mailbox empty, frame in and overrun of FIFO 0 and of FIFO 1, error warning, error passive,
/// bus-off, error.
const INTERRUPTS: u32 = 1 | 1 << 1 | 1 << 3 | 1 << 4 | 1 << 6 | 1 << 8 | 1 << 9 | 1 << 10 | 1 << 15;
/// ESR: error warning; error passive; bus-off.
const EWGF: u32 = 1;
/// See [`EWGF`].
const EPVF: u32 = 1 << 1;
/// See [`EWGF`].
const BOFF: u32 = 1 << 2;
/// BTR: silent mode.
const SILM: u32 = 1 << 31;
/// TIR and RIR: transmit request; remote frame; extended identifier.
const TXRQ: u32 = 1;
/// See [`TXRQ`].
const RTR: u32 = 1 << 1;
/// See [`TXRQ`].
const IDE: u32 = 1 << 2;
/// FMR: filters are being set up. Its other bits have a reset value that must stay.
const FINIT: u32 = 0x2A1C_0E01;

/// Identifiers of a master's NMT commands (CiA 301 7.3.3), LSS requests (CiA 305), and SDO requests
/// less the node-id.
const NMT: u32 = 0;
/// See [`NMT`].
const LSS: u32 = 0x7E5;
/// See [`NMT`].
const SDO: u32 = 0x600;
/// The filter's banks in use, and that of SDO requests.
const BANKS: u32 = 0b111;
/// See [`BANKS`].
const REQUESTS: u32 = 0b010;

/// How long initialisation is waited for, us. The controller gets there at the end of the frame
/// that is on the bus: after 13.4 ms at 10 kbit/s, 134 bits. On a bus that is shorted it never
/// does; the rate then stays as it was, and nothing could be heard at any other.
const PATIENCE_US: i64 = 15_000;

/// Looks at TSR for an abort to be done: it takes effect within a bit unless the frame is sent.
const ABORT_LOOKS: u8 = 16;

fn registers() -> &'static RegisterBlock {
    // SAFETY: the block of CAN is at this address for ever, and its registers are cells that
    // allow shared access. Flags are cleared by writing ones to them alone, so that task and
    // interrupt do not undo each other's work.
    unsafe { &*CAN::ptr() }
}

/// The controller, seen from the device's task.
pub struct Can(());

impl Can {
    /// Sets the filter up; the peripheral clock is on and the pins are set up.
    ///
    /// The controller takes part once a bit rate is set.
    pub fn start(_: CAN) -> Self {
        let can = registers();
        write(can.mcr(), INRQ | RFLM);
        // Banks 0 and 1, lists of 32 bits, for FIFO 1; bank 2, masks of 16 bits that look at no
        // bit, for FIFO 0 and all that is left: the wider filter goes before (RM0008 24.7.4).
        write(can.fmr(), FINIT);
        write(can.fm1r(), 0b011);
        write(can.fs1r(), 0b011);
        write(can.ffa1r(), 0b011);
        write(can.fb(0).fr1(), NMT << 21);
        write(can.fb(0).fr2(), LSS << 21);
        write(can.fb(2).fr1(), 0);
        write(can.fb(2).fr2(), 0);
        write(can.fa1r(), BANKS & !REQUESTS);
        write(can.fmr(), FINIT & !1);
        write(can.ier(), INTERRUPTS);
        Self(())
    }
}

impl Transmitter for Can {
    fn post(&mut self, place: u8, frame: &Frame) {
        let place = usize::from(place);
        if place >= MAILBOXES {
            return;
        }
        let mailbox = registers().tx(place);
        let (low, high) = words(frame);
        write(mailbox.tdtr(), frame.length() as u32);
        write(mailbox.tdlr(), low);
        write(mailbox.tdhr(), high);
        write(mailbox.tir(), identifier(frame) | TXRQ);
    }

    fn abort(&mut self, place: u8) -> Abort {
        let shift = 8 * u32::from(place);
        let tsr = registers().tsr();
        // No interrupt between the request and the look at what came of it, or the interrupt
        // would report what is reported here.
        cortex_m::interrupt::free(|_| {
            if tsr.read().bits() >> shift & RQCP != 0 {
                return Abort::Later;
            }
            write(tsr, ABRQ << shift);
            for _ in 0..ABORT_LOOKS {
                let flags = tsr.read().bits() >> shift;
                if flags & RQCP != 0 {
                    if flags & TXOK != 0 {
                        return Abort::Later;
                    }
                    write(tsr, RQCP << shift);
                    return Abort::Done;
                }
            }
            Abort::Later
        })
    }

    fn clear(&mut self) {
        cortex_m::interrupt::free(|_| {
            let tsr = registers().tsr();
            write(tsr, ABRQ | ABRQ << 8 | ABRQ << 16);
            for _ in 0..ABORT_LOOKS {
                if tsr.read().bits() & (7 << 26) == 7 << 26 {
                    break;
                }
            }
            write(tsr, RQCP | RQCP << 8 | RQCP << 16);
        });
    }
}

impl Controller for Can {
    fn recover(&mut self) {
        // Entering and leaving initialisation starts the count of 128 times 11 recessive bits
        // (RM0008 24.7.6).
        initialise();
        write(registers().mcr(), RFLM);
    }

    fn set_rate(&mut self, kbit_s: u16, listen_only: bool) {
        initialise();
        // An unknown rate leaves the controller out of the bus.
        let Some(timing) = bit_timing::register(kbit_s) else {
            return;
        };
        let silent = if listen_only { SILM } else { 0 };
        write(registers().btr(), timing | silent);
        write(registers().mcr(), RFLM);
    }

    fn listen_to(&mut self, node_id: u8) {
        let can = registers();
        let id = (SDO + u32::from(node_id)) << 21;
        // A bank is changed while it is not active (RM0008 24.9.4); FIFO 0 has its frames then.
        write(can.fa1r(), BANKS & !REQUESTS);
        write(can.fb(1).fr1(), id);
        write(can.fb(1).fr2(), id);
        write(can.fa1r(), BANKS);
    }
}

/// Goes into initialisation mode, which ends what is under way on the bus.
fn initialise() {
    let can = registers();
    write(can.mcr(), INRQ | RFLM);
    let end = clock::now().offset(PATIENCE_US);
    while can.msr().read().bits() & INAK == 0 && clock::now() < end {}
}

/// Serves each of the controller's four interrupts alike: moves what has happened into the inbox.
pub fn interrupt(inbox: &mut Inbox, now: Instant) {
    let can = registers();
    let tsr = can.tsr().read().bits();
    for place in 0..MAILBOXES as u8 {
        let flags = tsr >> (8 * u32::from(place));
        if flags & RQCP != 0 {
            write(can.tsr(), RQCP << (8 * u32::from(place)));
            let sent = flags & TXOK != 0;
            let event = if sent { Event::Sent } else { Event::GivenUp };
            inbox.put(event(place), now);
        }
    }
    receive(can, 1, inbox, now);
    receive(can, 0, inbox, now);
    write(can.msr(), ERRI);
    look(inbox, || now);
}

/// Tells of another error state; for one that becomes better there is no interrupt.
pub fn look(inbox: &mut Inbox, now: impl FnOnce() -> Instant) {
    let esr = registers().esr().read().bits();
    let state = match esr {
        esr if esr & BOFF != 0 => ErrorState::Off,
        esr if esr & EPVF != 0 => ErrorState::Passive,
        esr if esr & EWGF != 0 => ErrorState::Warning,
        _ => ErrorState::Active,
    };
    if inbox.is_another(state) {
        inbox.state(state, (esr >> 16) as u8, (esr >> 24) as u8, now());
    }
}

/// Empties FIFO `number`, 0 or 1. RF0R and RF1R have the same bits.
fn receive(can: &RegisterBlock, number: usize, inbox: &mut Inbox, now: Instant) {
    // The FIFO holds three; one more may come in meanwhile.
    for _ in 0..4 {
        let fifo = can.rfr(number).read().bits();
        if fifo & FOVR != 0 {
            inbox.lost();
            write(can.rfr(number), FOVR);
        }
        if fifo & FMP == 0 {
            return;
        }
        let mailbox = can.rx(number);
        let [rir, rdtr] = [mailbox.rir().read().bits(), mailbox.rdtr().read().bits()];
        let [low, high] = [mailbox.rdlr().read().bits(), mailbox.rdhr().read().bits()];
        if let Some(frame) = frame(rir, rdtr, low, high) {
            inbox.put(Event::Received(frame), now);
        }
        write(can.rfr(number), RFOM);
    }
}

/// TDLR and TDHR: the first byte is the lowest.
fn words(frame: &Frame) -> (u32, u32) {
    let bytes = u64::from_le_bytes(frame.padded());
    (bytes as u32, (bytes >> 32) as u32)
}

/// TIR of a frame: an 11-bit identifier stands ten bits higher than a 29-bit one's end.
fn identifier(frame: &Frame) -> u32 {
    let remote = if frame.is_remote() { RTR } else { 0 };
    remote
        | match frame.id() {
            Id::Standard(id) => u32::from(id.as_raw()) << 21,
            Id::Extended(id) => id.as_raw() << 3 | IDE,
        }
}

/// The frame of RIR, RDTR, RDLR and RDHR. A length code above 8 means 8 (ISO 11898-1).
fn frame(rir: u32, rdtr: u32, low: u32, high: u32) -> Option<Frame> {
    let id: Id = if rir & IDE != 0 {
        ExtendedId::new(rir >> 3)?.into()
    } else {
        StandardId::new((rir >> 21) as u16)?.into()
    };
    let length = (rdtr as u8 & 0xF).min(8);
    if rir & RTR != 0 {
        return Frame::remote(id, length.into());
    }
    let data = u64::from(high) << 32 | u64::from(low);
    Some(Frame::of_number(id, data, length))
}
