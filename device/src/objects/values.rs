//! What stands behind the rows above 1FFFh while the device runs.
//!
//! In: what the bus writes, what the channel measures. Out: the same, for the rows to show, and
//! [`News`] for the device to act on.
//!
//! Left out: the rules of each row (`panel`), calibration and settings, which the device owns.

use canopen::nmt::State;
use tilt::chain::Reading;
use tilt::sample::Instant;

use super::parameters::Parameters;
use super::process::Process;
use crate::program::Program;

/// A reading that belongs to one SYNC.
#[derive(Clone, Copy, Debug)]
pub struct Latched {
    /// What this channel says.
    pub reading: Reading,
    /// When SYNC was.
    pub at: Instant,
}

/// What has happened on the bus that the device has to act on.
#[derive(Clone, Copy, Debug, Default)]
pub struct News {
    /// The reading of the last SYNC, until the peer's has come.
    pub own: Option<Latched>,
    /// The reading of a SYNC for which the peer's has not come in time.
    pub unanswered: Option<Latched>,
    /// The peer's exchange was received.
    pub exchange: bool,
    /// A SYNC was obeyed.
    pub sync: bool,
    /// A reset of the node is asked for.
    pub reset: bool,
    /// 1F51h asks for one too, which waits until the client has its answer.
    pub restart: bool,
    /// LSS has activated a bit rate: rate (`None`: find it) and delay in ms.
    pub bit_rate: Option<(Option<u16>, u16)>,
    /// A GFC, or a received SRDO that failed: the safe state until a reset.
    pub fail_safe: bool,
}

/// The values.
#[derive(Clone, Debug)]
pub struct Values {
    /// Kept by 1010h.
    pub parameters: Parameters,
    /// Measured and counted.
    pub process: Process,
    /// The program objects.
    pub program: Program,
    /// The NMT state.
    pub state: State,
    /// For the device.
    pub news: News,
    /// The last command of 2060h sub 1.
    pub command: u8,
    /// The last reference of 2060h sub 2, 0.001 deg.
    pub reference: i32,
    /// 2060h sub 8.
    pub result: u8,
    /// 2053h sub 1.
    pub bit_rate: u16,
    /// A calibration is being received, and has the memory's staging place.
    pub receiving: bool,
    /// A store or restore has failed.
    pub storage_failed: bool,
    /// The calibration in force is the channel's own.
    pub calibrated: bool,
}

impl Values {
    /// Nothing measured and nothing set.
    pub const fn new() -> Self {
        Self {
            parameters: Parameters::NONE,
            process: Process::NOTHING,
            program: Program::new(),
            state: State::Initialising,
            news: News {
                own: None,
                unanswered: None,
                exchange: false,
                sync: false,
                reset: false,
                restart: false,
                bit_rate: None,
                fail_safe: false,
            },
            command: 0,
            reference: 0,
            result: 0,
            bit_rate: 0,
            receiving: false,
            storage_failed: false,
            calibrated: false,
        }
    }

    /// SYNC: shows the reading of this instant and keeps it for the peer's.
    pub fn latch(&mut self, reading: Reading, at: Instant) {
        self.process.show(&reading);
        self.process.syncs = self.process.syncs.wrapping_add(1);
        self.news.unanswered = self.news.own.replace(Latched { reading, at });
        self.news.exchange = false;
        self.news.sync = true;
    }
}

impl Default for Values {
    fn default() -> Self {
        Self::new()
    }
}
