//! Program download: objects 1F50h, 1F51h, 1F56h and 1F57h, sub-index 1 (CiA 302-3), and 2080h.
//!
//! In: commands and the bytes of an image, through the dictionary. Out: calls of a
//! [`ProgramMemory`], and an [`Effect`] that the node carries out.
//!
//! The order is stop, clear, download, start; each download needs a clear of its own, because one
//! that was broken off has already written. The running program is not the one that is cleared:
//! "stopped" only means that an update may begin, and the instrument goes on measuring. A clear is
//! answered at once and takes its time, a page for each [`Program::step`]; bit 0 of 1F57h shows
//! when it is over. A download that was broken off goes on behind what has come when the client
//! asks for that ([`Program::resume`]).
//!
//! A start is answered at once too. The image is then checked, whole and by its signature, while
//! everything else goes on, and bit 0 of 1F57h stands as long as that lasts. A good one ends in
//! the reset that starts it, any other in the error that 1F57h shows. Started, an image is on
//! trial until [`ProgramMemory::confirm`]; the device decides that (`device::trial`).
//!
//! Left out: the memory, what an image looks like, and the NMT state. The caller admits commands
//! in PRE-OPERATIONAL only and answers [`Abort::WrongState`] otherwise.

use canopen::object::Abort;
use flash::Progress;

/// What went wrong with a program: the code in bits 1 to 7 of 1F57h, and in the byte above it what
/// bits 16 to 23 add.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
pub enum ProgramError {
    /// There is no valid program.
    NoProgram = 1,
    /// The image is of an unknown format.
    UnknownFormat = 2,
    /// The image is incomplete, or its check sum is wrong.
    Damaged = 3,
    /// The memory was not cleared before the download.
    NotCleared = 4,
    /// The memory did not erase, or does not hold what was written to it.
    Write = 5,
    /// The image does not fit.
    Address = 6,
    /// The memory is protected: there is one slot only, or the running program is on trial.
    Secured = 7,
    /// The image was made for other hardware.
    Hardware = 0x102,
    /// The image was made for the slot that runs.
    Slot = 0x202,
    /// The image is older than the program that runs.
    Older = 0x307,
    /// The image is not signed.
    Unsigned = 0x407,
    /// The image's signature is wrong.
    Signature = 0x507,
}

impl ProgramError {
    /// The abort code that answers the transfer in which it happened.
    const fn abort(self) -> Abort {
        match self {
            Self::NoProgram | Self::NotCleared => Abort::WrongState,
            Self::UnknownFormat | Self::Damaged => Abort::CannotStore,
            Self::Hardware | Self::Slot => Abort::ParameterIncompatible,
            Self::Write => Abort::Hardware,
            Self::Address => Abort::OutOfMemory,
            Self::Secured | Self::Older | Self::Unsigned | Self::Signature => Abort::LocalControl,
        }
    }

    /// As 1F57h shows it.
    const fn status(self) -> u32 {
        let [code, detail] = (self as u16).to_le_bytes();
        (code as u32) << 1 | (detail as u32) << 16
    }
}

/// How the running program came to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Confirmation {
    /// It is confirmed.
    Confirmed = 0,
    /// It is on trial: unconfirmed, it is given up after some starts.
    Trial = 1,
    /// It is confirmed, and runs because a newer one was not.
    RolledBack = 2,
}

/// The running program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Running {
    /// The hardware that it is for.
    pub hardware: u32,
    /// Its version: patch in the lower half, then minor and major number.
    pub version: u32,
    /// CRC-32 of its body.
    pub crc: u32,
    /// The slot that it runs in: 0 A, 1 B.
    pub slot: u8,
    /// How it came to run.
    pub confirmation: Confirmation,
}

/// What has come of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Held {
    /// CRC-32 of the body, as its header has it.
    pub crc: u32,
    /// CRC-32 over header and signature, which tells images with the same body apart.
    pub identity: u32,
    /// Bytes of its file that are here.
    pub bytes: u32,
}

/// Where a downloaded image lives until it is started, beside the one that runs.
pub trait ProgramMemory {
    /// Prepares the place for a new image; nothing is erased yet. What was there is given up, and
    /// stays where this is refused.
    ///
    /// Errors: [`ProgramError::Secured`], [`ProgramError::Write`].
    fn clear(&mut self) -> Result<(), ProgramError>;

    /// Erases the next page of that place: the processor stands still for 40 ms at most.
    ///
    /// Errors: [`ProgramError::Write`], [`ProgramError::NotCleared`].
    fn erase(&mut self) -> Result<Progress, ProgramError>;

    /// Starts an image, or what is left of one, of `size` bytes if its size was announced.
    fn begin(&mut self, size: Option<u32>) -> Result<(), ProgramError>;

    /// Writes the next bytes, in order, each once. After an error nothing of the image is held.
    fn append(&mut self, bytes: &[u8]) -> Result<(), ProgramError>;

    /// All bytes are here: checks that they are a program for this device.
    ///
    /// Errors: [`ProgramError::Damaged`], [`ProgramError::Write`].
    fn commit(&mut self) -> Result<(), ProgramError>;

    /// What has come is worth nothing.
    fn discard(&mut self);

    /// What has come of an image, as soon as its header and signature have.
    fn held(&self) -> Option<Held>;

    /// The next step of checking the committed image and its signature; with the last one it is
    /// marked as the one to run after the next reset. None takes long.
    ///
    /// Errors, after which the next call begins anew: [`ProgramError::Signature`],
    /// [`ProgramError::Damaged`], [`ProgramError::Write`], [`ProgramError::NoProgram`].
    fn activate(&mut self) -> Result<Progress, ProgramError>;

    /// The program that runs.
    fn running(&mut self) -> Running;

    /// Confirms the program that runs.
    ///
    /// Errors: [`ProgramError::Write`].
    fn confirm(&mut self) -> Result<(), ProgramError>;
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
    /// The memory is being erased.
    Clearing,
    /// The memory waits for an image, or for the rest of one.
    Cleared,
    /// An image is coming in; so much has come, and so much was announced.
    Loading { received: u32, size: Option<u32> },
    /// A download failed or was broken off: only a clear leads on.
    Broken,
    /// An image is here, whole.
    Loaded,
    /// It is to be started, and is being checked.
    Checking,
}

/// State of the program objects.
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
            State::Stopped | State::Loaded | State::Checking => 0,
            State::Clearing | State::Cleared | State::Loading { .. } | State::Broken => 3,
        }
    }

    /// A write to 1F51h: 0 stop, 1 start, 2 reset, 3 clear.
    ///
    /// Errors: [`Abort::InvalidValue`] for other numbers, [`Abort::WrongState`] for what cannot be
    /// done now (a clear while started, a start of an image that is not whole, anything while a
    /// clear, a download or a check runs), and what the memory refuses. A refused command changes
    /// nothing but 1F57h.
    pub fn set_control<M: ProgramMemory + ?Sized>(
        &mut self,
        command: u8,
        memory: &mut M,
    ) -> Result<Effect, Abort> {
        if self.is_busy() {
            return Err(Abort::WrongState);
        }
        match command {
            0 => {
                if self.state == State::Started {
                    self.state = State::Stopped;
                }
                Ok(Effect::None)
            }
            1 => self.start(),
            // A reset forgets an image that was not started; the program runs on as it was.
            2 => Ok(Effect::Reset),
            3 => self.clear(memory),
            _ => Err(Abort::InvalidValue),
        }
    }

    fn start(&mut self) -> Result<Effect, Abort> {
        match self.state {
            State::Started => Ok(Effect::None),
            State::Stopped => {
                self.state = State::Started;
                Ok(Effect::None)
            }
            State::Loaded => {
                self.state = State::Checking;
                self.error = None;
                Ok(Effect::None)
            }
            // The error that broke the download shows more than its consequence.
            State::Broken => Err(Abort::WrongState),
            // Busy, these are not asked.
            State::Clearing | State::Loading { .. } | State::Checking | State::Cleared => {
                Err(self.note(ProgramError::NoProgram))
            }
        }
    }

    fn clear<M: ProgramMemory + ?Sized>(&mut self, memory: &mut M) -> Result<Effect, Abort> {
        if self.state == State::Started {
            return Err(Abort::WrongState);
        }
        memory.clear().map_err(|error| self.note(error))?;
        self.state = State::Clearing;
        self.error = None;
        Ok(Effect::None)
    }

    /// The next page of a clear, or the next step of a check, if one runs; for the caller to call
    /// while nobody is in a hurry.
    pub fn step<M: ProgramMemory + ?Sized>(&mut self, memory: &mut M) -> Effect {
        match self.state {
            State::Clearing => match memory.erase() {
                Ok(Progress::More) => {}
                Ok(Progress::Done) => self.state = State::Cleared,
                Err(error) => {
                    self.fail(error, memory);
                }
            },
            State::Checking => match memory.activate() {
                Ok(Progress::More) => {}
                // It stays busy until the reset.
                Ok(Progress::Done) => return Effect::Reset,
                Err(error) => {
                    self.state = State::Loaded;
                    self.note(error);
                }
            },
            _ => {}
        }
        Effect::None
    }

    /// Whether a clear, a download or a check runs.
    const fn is_busy(&self) -> bool {
        matches!(
            self.state,
            State::Clearing | State::Loading { .. } | State::Checking
        )
    }

    /// The next download goes on behind the `bytes` of an image that are here.
    ///
    /// Errors: [`Abort::WrongState`] unless a download was broken off, [`Abort::InvalidValue`] for
    /// another number of bytes than are here.
    pub fn resume<M: ProgramMemory + ?Sized>(
        &mut self,
        bytes: u32,
        memory: &M,
    ) -> Result<(), Abort> {
        let held = memory.held().filter(|_| self.state == State::Broken);
        let held = held.ok_or(Abort::WrongState)?;
        if held.bytes != bytes {
            return Err(Abort::InvalidValue);
        }
        self.state = State::Cleared;
        Ok(())
    }

    /// 1F56h: the check sum of the image that waits for its start, else of the running program.
    pub fn identification<M: ProgramMemory + ?Sized>(&self, memory: &mut M) -> u32 {
        let is_whole = matches!(self.state, State::Loaded | State::Checking);
        let loaded = memory.held().filter(|_| is_whole);
        loaded.map_or_else(|| memory.running().crc, |held| held.crc)
    }

    /// 1F57h: bit 0 while a clear, a download or a check runs, else bits 1 to 7 the last error and
    /// bits 16 to 23 what it is about.
    pub const fn status(&self) -> u32 {
        match (self.state, self.error) {
            _ if self.is_busy() => 1,
            (_, Some(error)) => error.status(),
            (State::Cleared, None) => ProgramError::NoProgram.status(),
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
        match self.state {
            State::Cleared => {}
            // A client that can't wait changes nothing.
            State::Clearing | State::Checking => return Err(Abort::WrongState),
            _ => return Err(self.note(ProgramError::NotCleared)),
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

    /// The client or the bus has broken the download off: what has come stays, for a resume.
    pub fn discard(&mut self) {
        if matches!(self.state, State::Loading { .. }) {
            self.state = State::Broken;
            self.note(ProgramError::Damaged);
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
