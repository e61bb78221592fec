//! Program download: objects 1F50h, 1F51h, 1F56h and 1F57h, sub-index 1 (CiA 302-3).
//!
//! In: commands and the bytes of an image, through the dictionary. Out: calls of a
//! [`ProgramMemory`], and an [`Effect`] that the node carries out.
//!
//! The order is stop, clear, download, start; each download needs a clear of its own, because one
//! that was broken off has already written. The running program is not the one that is cleared:
//! "stopped" only means that an update may begin, and the instrument goes on measuring. An image
//! is never started before all of it has come and the memory has found it whole.
//!
//! Left out: the memory, what an image looks like, and the NMT state. The caller admits commands
//! in PRE-OPERATIONAL only and answers [`Abort::WrongState`] otherwise.

use canopen::object::Abort;

/// What went wrong with a program, by its code in bits 1 to 7 of 1F57h.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum ProgramError {
    /// There is no valid program.
    NoProgram = 1,
    /// The image is of an unknown format, or made for another device.
    UnknownFormat = 2,
    /// The image is incomplete, or its check sum is wrong.
    Damaged = 3,
    /// The memory was not cleared before the download.
    NotCleared = 4,
    /// The memory did not erase, or does not hold what was written to it.
    Write = 5,
    /// The image does not fit.
    Address = 6,
    /// The memory is protected.
    Secured = 7,
}

impl ProgramError {
    /// The abort code that answers the transfer in which it happened.
    const fn abort(self) -> Abort {
        match self {
            Self::NoProgram | Self::NotCleared => Abort::WrongState,
            Self::UnknownFormat | Self::Damaged => Abort::CannotStore,
            Self::Write => Abort::Hardware,
            Self::Address => Abort::OutOfMemory,
            Self::Secured => Abort::LocalControl,
        }
    }
}

/// Where a downloaded image lives until it is started.
pub trait ProgramMemory {
    /// Erases the place for a new image.
    fn erase(&mut self) -> Result<(), ProgramError>;

    /// Starts an image of `size` bytes, if its size was announced.
    fn begin(&mut self, size: Option<u32>) -> Result<(), ProgramError>;

    /// Writes the next bytes, in order, each once.
    fn append(&mut self, bytes: &[u8]) -> Result<(), ProgramError>;

    /// All bytes are here: checks that they are a program for this device.
    ///
    /// Errors: [`ProgramError::UnknownFormat`], [`ProgramError::Damaged`],
    /// [`ProgramError::Write`].
    fn commit(&mut self) -> Result<(), ProgramError>;

    /// The download was broken off.
    fn discard(&mut self);

    /// Marks the committed image as the one to run after the next reset.
    fn activate(&mut self) -> Result<(), ProgramError>;

    /// The CRC-32 of the committed image if there is one, of the running program otherwise.
    fn crc(&mut self) -> u32;
}

/// What the node does once a command of 1F51h has been answered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// Nothing more.
    None,
    /// Reset the node: the program, or the new one, starts from its beginning.
    Reset,
}

/// Where an update stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// The program runs and no update is under way.
    Started,
    /// An update may begin.
    Stopped,
    /// The memory is empty and waits for an image.
    Cleared,
    /// An image is coming in; so much has come, and so much was announced.
    Loading { received: u32, size: Option<u32> },
    /// A download failed or was broken off: only a clear leads on.
    Broken,
    /// An image is here, whole.
    Loaded,
}

/// State of the program objects; 16 bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    state: State,
    error: Option<ProgramError>,
}

impl Default for Program {
    fn default() -> Self {
        Self::new()
    }
}

impl Program {
    /// The program runs; nothing has been downloaded.
    pub const fn new() -> Self {
        Self {
            state: State::Started,
            error: None,
        }
    }

    /// 1F51h as it is read: 0 stopped, 1 started, 3 no program there.
    pub const fn control(&self) -> u8 {
        match self.state {
            State::Started => 1,
            State::Stopped | State::Loaded => 0,
            State::Cleared | State::Loading { .. } | State::Broken => 3,
        }
    }

    /// A write to 1F51h: 0 stop, 1 start, 2 reset, 3 clear.
    ///
    /// Errors: [`Abort::InvalidValue`] for other numbers, [`Abort::WrongState`] for what cannot be
    /// done now (a clear while started, a start of an image that is not whole, anything while a
    /// download runs), and what the memory refuses. A refused command changes nothing but 1F57h.
    pub fn set_control<M: ProgramMemory + ?Sized>(
        &mut self,
        command: u8,
        memory: &mut M,
    ) -> Result<Effect, Abort> {
        if matches!(self.state, State::Loading { .. }) {
            return Err(Abort::WrongState);
        }
        match command {
            0 => {
                if self.state == State::Started {
                    self.state = State::Stopped;
                }
                Ok(Effect::None)
            }
            1 => self.start(memory),
            // A reset forgets an image that was not started; the program runs on as it was.
            2 => Ok(Effect::Reset),
            3 => self.clear(memory),
            _ => Err(Abort::InvalidValue),
        }
    }

    fn start<M: ProgramMemory + ?Sized>(&mut self, memory: &mut M) -> Result<Effect, Abort> {
        match self.state {
            State::Started => Ok(Effect::None),
            State::Stopped => {
                self.state = State::Started;
                Ok(Effect::None)
            }
            State::Loaded => {
                memory.activate().map_err(|error| self.note(error))?;
                Ok(Effect::Reset)
            }
            // The error that broke the download says more than its consequence.
            State::Broken => Err(Abort::WrongState),
            State::Cleared | State::Loading { .. } => Err(self.note(ProgramError::NoProgram)),
        }
    }

    fn clear<M: ProgramMemory + ?Sized>(&mut self, memory: &mut M) -> Result<Effect, Abort> {
        if self.state == State::Started {
            return Err(Abort::WrongState);
        }
        // An erase that fails leaves a memory that is neither one thing nor the other.
        self.state = State::Broken;
        memory.erase().map_err(|error| self.note(error))?;
        self.state = State::Cleared;
        self.error = None;
        Ok(Effect::None)
    }

    /// 1F57h: bit 0 while a download runs, bits 1 to 7 the last error.
    pub const fn status(&self) -> u32 {
        match (self.state, self.error) {
            (State::Loading { .. }, _) => 1,
            (_, Some(error)) => (error as u32) << 1,
            (State::Cleared, None) => (ProgramError::NoProgram as u32) << 1,
            (_, None) => 0,
        }
    }

    /// A download to 1F50h begins; `size` is what the client announced.
    ///
    /// Errors: [`Abort::WrongState`] unless the memory was just cleared, and what it refuses.
    pub fn create<M: ProgramMemory + ?Sized>(
        &mut self,
        size: Option<u32>,
        memory: &mut M,
    ) -> Result<(), Abort> {
        if self.state != State::Cleared {
            return Err(self.note(ProgramError::NotCleared));
        }
        memory.begin(size).map_err(|error| self.note(error))?;
        self.state = State::Loading { received: 0, size };
        self.error = None;
        Ok(())
    }

    /// The next bytes of the image.
    ///
    /// Errors: [`Abort::WrongState`] outside a download; what the memory refuses, and more bytes
    /// than announced ([`Abort::LengthTooHigh`]), end it.
    pub fn append<M: ProgramMemory + ?Sized>(
        &mut self,
        bytes: &[u8],
        memory: &mut M,
    ) -> Result<(), Abort> {
        let State::Loading { received, size } = self.state else {
            return Err(Abort::WrongState);
        };
        let more = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        let received = received.saturating_add(more);
        if size.is_some_and(|size| received > size) {
            self.fail(ProgramError::Damaged, memory);
            return Err(Abort::LengthTooHigh);
        }
        if let Err(error) = memory.append(bytes) {
            return Err(self.fail(error, memory));
        }
        self.state = State::Loading { received, size };
        Ok(())
    }

    /// The last byte has come.
    ///
    /// Errors: [`Abort::LengthTooLow`] with fewer bytes than announced, or none at all; what the
    /// memory finds wrong. The image is then worth nothing.
    pub fn commit<M: ProgramMemory + ?Sized>(&mut self, memory: &mut M) -> Result<(), Abort> {
        let State::Loading { received, size } = self.state else {
            return Err(Abort::WrongState);
        };
        if received == 0 || size.is_some_and(|size| received < size) {
            self.fail(ProgramError::Damaged, memory);
            return Err(Abort::LengthTooLow);
        }
        if let Err(error) = memory.commit() {
            return Err(self.fail(error, memory));
        }
        self.state = State::Loaded;
        Ok(())
    }

    /// The client or the bus has broken the download off.
    pub fn discard<M: ProgramMemory + ?Sized>(&mut self, memory: &mut M) {
        if matches!(self.state, State::Loading { .. }) {
            self.fail(ProgramError::Damaged, memory);
        }
    }

    fn fail<M: ProgramMemory + ?Sized>(&mut self, error: ProgramError, memory: &mut M) -> Abort {
        memory.discard();
        self.state = State::Broken;
        self.note(error)
    }

    fn note(&mut self, error: ProgramError) -> Abort {
        self.error = Some(error);
        error.abort()
    }
}

#[cfg(test)]
mod tests;
