//! bxCAN: mailboxes, FIFOs, filters, modes and error state of one CAN controller.
//!
//! In: loads and stores, and what the bus tells (frames, ends of own frames, errors, states). Out:
//! [`Action`]s for the bus, and four interrupt lines. Arbitration, timing and error counters are
//! the bus's ([`sim::can_bus`]).
//!
//! Source: RM0008 24.4 to 24.9. Left out: loop back, time-triggered mode, wake-up by the bus, and
//! the wait for 11 recessive bits before normal mode begins.
//!
//! | offset | register | section |
//! |---|---|---|
//! | 000h | MCR | RM0008 24.9.2 |
//! | 004h | MSR | 24.9.2 |
//! | 008h | TSR | 24.9.2 |
//! | 00Ch | RF0R | 24.9.2 |
//! | 010h | RF1R | 24.9.2 |
//! | 014h | IER | 24.9.2 |
//! | 018h | ESR | 24.9.2 |
//! | 01Ch | BTR | 24.9.2 |
//! | 180h | TI0R, on to TDH2R at 1ACh | 24.9.3 |
//! | 1B0h | RI0R, on to RDH1R at 1CCh | 24.9.3 |
//! | 200h | the filters, which have their own table | 24.9.4 |

mod filter;
mod registers;

#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use canopen::Frame;
use canopen::frame::{ExtendedId, Id, standard};
use sim::can_bus::{ErrorKind, ErrorState};

use filter::Filters;
use registers::{esr, ier, mcr, msr, tsr};

/// Transmit mailboxes.
pub const MAILBOXES: usize = 3;
/// Frames that a FIFO holds.
const DEPTH: usize = 3;

/// What the controller does to the bus, in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// A mailbox asks for transmission (TXRQ).
    Offer {
        /// 0 to 2.
        mailbox: usize,
        /// What is in it.
        frame: Frame,
        /// It is not repeated (NART).
        once: bool,
    },
    /// A mailbox's request is taken back (ABRQ).
    Abort {
        /// 0 to 2.
        mailbox: usize,
    },
    /// Normal mode begins: `brp`, `segments` time quanta a bit.
    Join {
        /// Cycles of PCLK1 in a bit.
        pclk1_per_bit: u32,
        /// SILM.
        silent: bool,
    },
    /// The controller leaves the bus: initialisation or sleep.
    Leave,
    /// It comes back from bus-off.
    Recover,
    /// It was reset.
    Reset,
}

#[derive(Clone, Copy, Debug, Default)]
struct Mailbox {
    tir: u32,
    tdtr: u32,
    data: [u32; 2],
    /// TXRQ was set, and neither end nor abort has come.
    pending: bool,
}

#[derive(Clone, Copy, Debug)]
struct Received {
    frame: Frame,
    filter: u8,
}

#[derive(Clone, Debug, Default)]
struct Fifo {
    frames: VecDeque<Received>,
    full: bool,
    overrun: bool,
}

/// What the bus is given of this controller's errors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Errors {
    /// Transmit error counter.
    pub transmit: u16,
    /// Receive error counter.
    pub receive: u16,
    /// What they mean.
    pub state: ErrorState,
}

/// The controller.
#[derive(Clone, Debug)]
pub struct Can {
    mcr: u32,
    /// INAK and SLAK.
    mode: u32,
    /// MSR's flags that software clears.
    flags: u32,
    tsr: u32,
    ier: u32,
    btr: u32,
    lec: u32,
    errors: Errors,
    mailboxes: [Mailbox; MAILBOXES],
    fifos: [Fifo; 2],
    filters: Filters,
    actions: VecDeque<Action>,
}

impl Default for Can {
    fn default() -> Self {
        Self {
            mcr: 0x0001_0002,
            mode: msr::SLAK,
            flags: 0,
            tsr: 0,
            ier: 0,
            btr: 0x0123_0000,
            lec: 0,
            errors: Errors::default(),
            mailboxes: [Mailbox::default(); MAILBOXES],
            fifos: Default::default(),
            filters: Filters::default(),
            actions: VecDeque::from([Action::Reset]),
        }
    }
}

/// What the bus tells.
impl Can {
    /// What is to be done on the bus next.
    pub fn take_action(&mut self) -> Option<Action> {
        self.actions.pop_front()
    }

    /// Whether there is something to be done on the bus.
    pub fn has_actions(&self) -> bool {
        !self.actions.is_empty()
    }

    /// Whether it takes part.
    pub fn is_joined(&self) -> bool {
        self.mode == 0
    }

    /// A frame has come (24.7.3).
    pub fn receive(&mut self, frame: Frame) {
        let Some(found) = self.filters.find(&frame).filter(|_| self.is_joined()) else {
            return;
        };
        self.lec = self.lec.min(7);
        let locked = self.mcr & mcr::RFLM != 0;
        let fifo = &mut self.fifos[found.fifo];
        let received = Received {
            frame,
            filter: found.index,
        };
        if fifo.frames.len() < DEPTH {
            fifo.frames.push_back(received);
            fifo.full |= fifo.frames.len() == DEPTH;
            return;
        }
        fifo.overrun = true;
        // 24.7.3: without the lock the newest takes the place of the last.
        if !locked && let Some(last) = fifo.frames.back_mut() {
            *last = received;
        }
    }

    /// The frame in a mailbox has gone out (24.7.1).
    pub fn sent(&mut self, mailbox: usize) {
        self.finish(mailbox, tsr::TXOK);
    }

    /// The request in a mailbox was taken back, or its only attempt has failed.
    pub fn ended(&mut self, mailbox: usize, why: End) {
        let flags = match why {
            End::Aborted => 0,
            End::Failed => tsr::TERR,
            End::Lost => tsr::ALST,
        };
        self.finish(mailbox, flags);
    }

    /// An attempt has failed and will be repeated.
    pub fn failed(&mut self, mailbox: usize) {
        self.tsr |= tsr::TERR << (8 * mailbox);
    }

    /// Another frame went first; this one waits on.
    pub fn lost(&mut self, mailbox: usize) {
        self.tsr |= tsr::ALST << (8 * mailbox);
    }

    fn finish(&mut self, mailbox: usize, flags: u32) {
        if let Some(place) = self.mailboxes.get_mut(mailbox) {
            place.pending = false;
            place.tir &= !1;
            let all = tsr::RQCP | tsr::TXOK | tsr::ALST | tsr::TERR;
            self.tsr &= !(all << (8 * mailbox));
            self.tsr |= (tsr::RQCP | flags) << (8 * mailbox);
        }
    }

    /// Something went wrong on the bus while this controller took part (24.9.2, LEC).
    pub fn see_error(&mut self, kind: ErrorKind, sending: bool) {
        self.lec = match (kind, sending) {
            (ErrorKind::Acknowledge, true) => 3,
            (ErrorKind::Bit, true) => 5,
            (ErrorKind::Dominant, true) => 4,
            (ErrorKind::Crc, false) => 6,
            (ErrorKind::EndOfFrame, false) => 2,
            _ => 1,
        };
        if self.ier & ier::LECIE != 0 {
            self.flags |= msr::ERRI;
        }
    }

    /// The error counters and the state as they are now.
    pub fn set_errors(&mut self, errors: Errors) {
        let before = std::mem::replace(&mut self.errors, errors).state;
        let after = errors.state;
        let told = |level: ErrorState, enabled: u32| {
            before < level && after >= level && self.ier & enabled != 0
        };
        let interrupt = told(ErrorState::Warning, ier::EWGIE)
            || told(ErrorState::Passive, ier::EPVIE)
            || told(ErrorState::BusOff, ier::BOFIE);
        if interrupt {
            self.flags |= msr::ERRI;
        }
        // 24.7.6: automatic bus-off management.
        if after == ErrorState::BusOff && before != ErrorState::BusOff && self.mcr & mcr::ABOM != 0
        {
            self.actions.push_back(Action::Recover);
        }
    }

    /// The interrupt lines: transmit, FIFO 0, FIFO 1, state (24.8).
    pub fn lines(&self) -> [bool; 4] {
        let on = |bit: u32| self.ier & bit != 0;
        let done = tsr::RQCP | tsr::RQCP << 8 | tsr::RQCP << 16;
        let fifo = |fifo: &Fifo, shift: u32| {
            on(ier::FMPIE0 << shift) && !fifo.frames.is_empty()
                || on(ier::FFIE0 << shift) && fifo.full
                || on(ier::FOVIE0 << shift) && fifo.overrun
        };
        let [first, second] = &self.fifos;
        [
            on(ier::TMEIE) && self.tsr & done != 0,
            fifo(first, 0),
            fifo(second, 3),
            on(ier::ERRIE) && self.flags & msr::ERRI != 0
                || on(ier::SLKIE) && self.flags & msr::SLAKI != 0
                || on(ier::WKUIE) && self.flags & msr::WKUI != 0,
        ]
    }

    /// Bits of PCLK1 that a bit of the bus takes (24.7.7).
    fn pclk1_per_bit(&self) -> u32 {
        let prescaler = (self.btr & 0x3FF) + 1;
        let quanta = 3 + (self.btr >> 16 & 0xF) + (self.btr >> 20 & 7);
        prescaler * quanta
    }

    /// The mode that MCR asks for (24.4.1 to 24.4.3).
    fn change_mode(&mut self) {
        let wanted = match self.mcr {
            m if m & mcr::INRQ != 0 => msr::INAK,
            m if m & mcr::SLEEP != 0 => msr::SLAK,
            _ => 0,
        };
        if wanted == self.mode {
            return;
        }
        let was_joined = self.is_joined();
        if wanted == msr::SLAK {
            self.flags |= msr::SLAKI;
        }
        self.mode = wanted;
        if was_joined {
            self.actions.push_back(Action::Leave);
        }
        if wanted == 0 {
            self.actions.push_back(Action::Join {
                pclk1_per_bit: self.pclk1_per_bit(),
                silent: self.btr >> 31 != 0,
            });
            // 24.7.6: who was off the bus begins to come back now.
            if self.errors.state == ErrorState::BusOff {
                self.actions.push_back(Action::Recover);
            }
        }
    }
}

/// How a request ended that was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// Taken back.
    Aborted,
    /// Its only attempt failed.
    Failed,
    /// It lost its only arbitration.
    Lost,
}

/// Loads and stores; `offset` from 4000 6400h.
impl Can {
    /// A load.
    pub fn read(&self, offset: u32) -> u32 {
        match offset {
            0x00 => self.mcr,
            0x04 => self.mode | self.flags | msr::RX | msr::SAMP,
            0x08 => self.status(),
            0x0C => self.fifo_status(0),
            0x10 => self.fifo_status(1),
            0x14 => self.ier,
            0x18 => self.error_status(),
            0x1C => self.btr,
            0x180..=0x1AC => self.read_mailbox(offset - 0x180),
            0x1B0..=0x1CC => self.read_fifo(offset - 0x1B0),
            0x200..=0x31C => self.filters.read(offset - 0x200),
            _ => 0,
        }
    }

    /// TSR (24.9.2): TME, LOW and CODE follow the mailboxes.
    fn status(&self) -> u32 {
        let mut bits = self.tsr;
        let mut free = None;
        for number in (0..MAILBOXES).rev() {
            if !self.mailboxes[number].pending {
                bits |= tsr::TME0 << number;
                free = Some(number);
            }
        }
        let last = self.last_in_line();
        let code = free.or(last).unwrap_or(0) as u32;
        // LOW is 0 while one mailbox at most is pending.
        let pending = self
            .mailboxes
            .iter()
            .filter(|mailbox| mailbox.pending)
            .count();
        let low = last
            .filter(|_| pending > 1)
            .map_or(0, |number| tsr::LOW0 << number);
        bits | code << 24 | low
    }

    /// The pending mailbox of lowest priority.
    fn last_in_line(&self) -> Option<usize> {
        let pending = (0..MAILBOXES).filter(|number| self.mailboxes[*number].pending);
        pending.max_by_key(|number| (self.mailboxes[*number].tir >> 1, *number))
    }

    fn fifo_status(&self, number: usize) -> u32 {
        let fifo = &self.fifos[number];
        fifo.frames.len() as u32 | u32::from(fifo.full) << 3 | u32::from(fifo.overrun) << 4
    }

    /// ESR (24.9.2).
    fn error_status(&self) -> u32 {
        let Errors {
            transmit,
            receive,
            state,
        } = self.errors;
        let at_least = |level: ErrorState, bit: u32| if state >= level { bit } else { 0 };
        at_least(ErrorState::Warning, esr::EWGF)
            | at_least(ErrorState::Passive, esr::EPVF)
            | at_least(ErrorState::BusOff, esr::BOFF)
            | self.lec << 4
            | u32::from(transmit.min(255)) << 16
            | u32::from(receive.min(255)) << 24
    }

    fn read_mailbox(&self, offset: u32) -> u32 {
        let mailbox = &self.mailboxes[(offset / 16) as usize];
        match offset % 16 {
            0 => mailbox.tir,
            4 => mailbox.tdtr,
            8 => mailbox.data[0],
            _ => mailbox.data[1],
        }
    }

    /// RIxR, RDTxR, RDLxR, RDHxR (24.9.3).
    fn read_fifo(&self, offset: u32) -> u32 {
        let Some(received) = self.fifos[(offset / 16) as usize].frames.front() else {
            return 0;
        };
        let frame = &received.frame;
        let bytes = frame.padded();
        let [low, high] = [0, 4].map(|from| {
            let word = bytes
                .get(from..from + 4)
                .and_then(|word| word.try_into().ok());
            u32::from_le_bytes(word.unwrap_or_default())
        });
        match offset % 16 {
            0 => {
                let remote = u32::from(frame.is_remote()) << 1;
                remote
                    | match frame.id() {
                        Id::Standard(id) => u32::from(id.as_raw()) << 21,
                        Id::Extended(id) => id.as_raw() << 3 | 4,
                    }
            }
            4 => frame.length() as u32 | u32::from(received.filter) << 8,
            8 => low,
            _ => high,
        }
    }

    /// A store.
    pub fn write(&mut self, offset: u32, value: u32) {
        match offset {
            0x00 => self.write_mcr(value),
            // 24.9.2: a 1 takes a flag away.
            0x04 => self.flags &= !(value & (msr::ERRI | msr::WKUI | msr::SLAKI)),
            0x08 => self.write_tsr(value),
            0x0C => self.write_rfr(0, value),
            0x10 => self.write_rfr(1, value),
            0x14 => self.ier = value & 0x3_8F7F,
            0x18 => self.lec = value >> 4 & 7,
            // 24.9.2: in initialisation only.
            0x1C if self.mode == msr::INAK => self.btr = value & 0xC37F_03FF,
            0x180..=0x1AC => self.write_mailbox(offset - 0x180, value),
            0x200..=0x31C => self.filters.write(offset - 0x200, value),
            _ => {}
        }
    }

    fn write_mcr(&mut self, value: u32) {
        // 24.9.2: RESET, a master reset to sleep mode.
        if value & mcr::RESET != 0 {
            *self = Self::default();
            return;
        }
        self.mcr = value & 0x0001_00FF;
        self.change_mode();
    }

    fn write_tsr(&mut self, value: u32) {
        for number in 0..MAILBOXES {
            let shift = 8 * number;
            // RQCP takes the others with it (24.9.2).
            if value >> shift & tsr::RQCP != 0 {
                let all = tsr::RQCP | tsr::TXOK | tsr::ALST | tsr::TERR;
                self.tsr &= !(all << shift);
            }
            self.tsr &= !(value & (tsr::TXOK | tsr::ALST | tsr::TERR) << shift);
            if value >> shift & tsr::ABRQ != 0 && self.mailboxes[number].pending {
                self.actions.push_back(Action::Abort { mailbox: number });
            }
        }
    }

    fn write_rfr(&mut self, number: usize, value: u32) {
        let fifo = &mut self.fifos[number];
        if value >> 3 & 1 != 0 {
            fifo.full = false;
        }
        if value >> 4 & 1 != 0 {
            fifo.overrun = false;
        }
        // RFOM.
        if value >> 5 & 1 != 0 {
            fifo.frames.pop_front();
            fifo.full = false;
        }
    }

    fn write_mailbox(&mut self, offset: u32, value: u32) {
        let number = (offset / 16) as usize;
        let once = self.mcr & mcr::NART != 0;
        let mailbox = &mut self.mailboxes[number];
        // 24.9.3: protected while it is pending.
        if mailbox.pending {
            return;
        }
        match offset % 16 {
            0 => {
                mailbox.tir = value;
                if value & 1 != 0
                    && let Some(frame) = mailbox.frame()
                {
                    mailbox.pending = true;
                    let all = tsr::RQCP | tsr::TXOK | tsr::ALST | tsr::TERR;
                    self.tsr &= !(all << (8 * number));
                    self.actions.push_back(Action::Offer {
                        mailbox: number,
                        frame,
                        once,
                    });
                }
            }
            4 => mailbox.tdtr = value,
            8 => mailbox.data[0] = value,
            _ => mailbox.data[1] = value,
        }
    }
}

impl Mailbox {
    /// The frame that its registers hold (24.9.3); a DLC beyond 8 has 8 bytes.
    fn frame(&self) -> Option<Frame> {
        let length = (self.tdtr & 0xF).min(8) as usize;
        let [low, high] = self.data.map(u32::to_le_bytes);
        let bytes = [low, high];
        let bytes = bytes.as_flattened().get(..length)?;
        let id = match self.tir >> 2 & 1 {
            0 => Id::Standard(standard((self.tir >> 21) as u16)),
            _ => Id::Extended(ExtendedId::new(self.tir >> 3)?),
        };
        match self.tir >> 1 & 1 {
            0 => Frame::with(id, bytes),
            _ => Frame::remote(id, length),
        }
    }
}
