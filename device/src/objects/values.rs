//! What stands behind the rows above 1FFFh while the device runs.
//!
//! In: what the bus writes, what the channel measures. Out: the same, for the rows to show, and
//! [`Pending`] for the device to act on.
//!
//! Left out: the rules of each row (`device_objects`), calibration and settings, which the device
//! owns.

use canopen::nmt::State;
use instant::Instant;
use tilt::chain::Invalid;
use tilt::health::Activity;
use tilt::observation::Observation;

use super::parameters::Parameters;
use super::process::Process;
use crate::exchange::{self, Pdos};
use crate::presentation::Presentation;
use crate::program::Program;

/// What belongs to one SYNC.
#[derive(Clone, Copy, Debug)]
pub struct Latched {
    /// What this channel reports.
    pub observation: Observation,
    /// When SYNC was.
    pub at: Instant,
}

/// What has happened on the bus that the device has to act on.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pending {
    /// The reading of the last SYNC, until the peer's has come.
    pub own: Option<Latched>,
    /// The reading of a SYNC for which the peer's has not come in time.
    pub unanswered: Option<Latched>,
    /// PDOs of the peer's exchange that were received.
    pub exchange: Pdos,
    /// A SYNC was obeyed.
    pub sync: bool,
    /// A reset of the node is asked for.
    pub reset: bool,
    /// 1F51h asks for one too, which waits until the client has its answer.
    pub restart: bool,
    /// The sensor is to be set up anew.
    pub sensor: bool,
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
    pub pending: Pending,
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
    /// The running program is not what was linked.
    pub program_damaged: bool,
    /// The calibration in force is the channel's own.
    pub calibrated: bool,
    /// Check sum of the calibration in force, as it was when it came into force.
    pub calibration_sum: u32,
}

impl Values {
    /// Nothing measured and nothing set.
    #[inline(never)]
    pub const fn new() -> Self {
        Self {
            parameters: Parameters::NONE,
            process: Process::NOTHING,
            program: Program::new(),
            state: State::Initialising,
            pending: Pending {
                own: None,
                unanswered: None,
                exchange: Pdos::NONE,
                sync: false,
                reset: false,
                restart: false,
                sensor: false,
                bit_rate: None,
                fail_safe: false,
            },
            command: 0,
            reference: 0,
            result: 0,
            bit_rate: 0,
            receiving: false,
            storage_failed: false,
            program_damaged: false,
            calibrated: false,
            calibration_sum: 0,
        }
    }

    /// SYNC: shows the reading of this instant, tells it to the peer and keeps it for the peer's.
    ///
    /// Where the SYNC before has no answer the peer may never have been told what this channel
    /// heard until then (a SYNC that comes twice within a millisecond): its activity is not known.
    ///
    /// `own_fault` is what this channel is held faulty for, and `shown` how its angles are shown.
    pub fn latch(
        &mut self,
        mut observation: Observation,
        own_fault: Option<Invalid>,
        shown: Presentation,
        at: Instant,
    ) {
        if self.pending.own.is_some() {
            observation.activity = Activity::GAP;
        }
        self.process.measure(&observation.reading, at);
        self.tell(&observation, own_fault, shown, at);
        self.process.syncs = self.process.syncs.wrapping_add(1);
        let latched = Latched { observation, at };
        self.pending.unanswered = self.pending.own.replace(latched);
        self.pending.sync = true;
    }

    /// Puts into the exchange what the peer is to have: a channel that is held faulty reports
    /// that instead of an angle, also between two samples and while it looks for its vertical. Else
    /// the peer would compare what is behind that with its own, and differ. Any other reason goes
    /// as it is: it may be what the channel is faulty for next.
    pub fn tell(
        &mut self,
        observation: &Observation,
        own_fault: Option<Invalid>,
        shown: Presentation,
        at: Instant,
    ) {
        let measures = matches!(
            observation.reading.x,
            Ok(_) | Err(Invalid::NoSample | Invalid::Settling)
        );
        let told = match own_fault {
            Some(reason) if measures => &observation.refused(reason),
            _ => observation,
        };
        self.process.sent = exchange::encode(told, shown, at);
    }
}

impl Default for Values {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_heard_before_a_doubled_sync_got_lost_and_the_other_was_called_spiky() {
        let mut values = Values::new();
        let heard = Observation {
            activity: Activity(121),
            ..Observation::absent(Invalid::Settling)
        };
        values.latch(heard, None, Presentation::AS_MEASURED, Instant(0));
        assert_eq!(values.process.sent.activity, 121);
        let nothing = Observation::absent(Invalid::Settling);
        values.latch(nothing, None, Presentation::AS_MEASURED, Instant(200));
        assert_eq!(values.process.sent.activity, Activity::GAP.0);
        values.pending.own = None;
        values.latch(nothing, None, Presentation::AS_MEASURED, Instant(20_000));
        assert_eq!(values.process.sent.activity, Activity::NONE.0);
    }

    #[test]
    fn a_channel_that_is_held_faulty_told_that_it_settles() {
        let told = |found: Invalid, held: Option<Invalid>| {
            let mut values = Values::new();
            let observation = Observation::absent(found);
            values.tell(&observation, held, Presentation::AS_MEASURED, Instant(0));
            let quality = values.process.sent.quality;
            assert_eq!(quality[0], quality[1]);
            exchange::reason(quality[0])
        };
        for found in [Invalid::NoSample, Invalid::Settling] {
            assert_eq!(told(found, Some(Invalid::Stuck)), Some(Invalid::Stuck));
            assert_eq!(told(found, None), Some(found));
        }
        // A lost set-up behind samples that stopped is what the channel is faulty for next.
        for found in [Invalid::Stale, Invalid::PartReset, Invalid::OverRange] {
            assert_eq!(told(found, Some(Invalid::Stuck)), Some(found));
        }
    }
}
