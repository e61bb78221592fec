//! What goes wrong on demand: faults of one side's sensor path, and of one node on the bus.
//!
//! In: a [`SensorFault`] for an [`Electronics`](crate::electronics::Electronics) or, through
//! [`OnCounts`], for a recording; a [`NodeFault`] for a node of a
//! [`Network`](crate::network::Network); and a stream of random numbers of the fault's own, so
//! that a world without faults draws what it always drew, and a world with one draws the same
//! noise. Out: samples, edges and frames as they would be, until the fault is healed.
//!
//! Left out: two faults at a time on one side; faults of the wires and of single registers, which
//! [`lis2dw12::Fault`](crate::lis2dw12::Fault) has; frames lost at random, which are
//! [`Rates::overrun`](crate::can_bus::Rates) of the bus; and a SYNC that nobody sends any more,
//! which is up to who sends it.

mod calibration;
mod name;
mod on_counts;
mod sensor;

#[cfg(test)]
mod tests;

pub use calibration::Corruption;
pub use on_counts::OnCounts;
pub(crate) use sensor::Injected;

/// One thing that goes wrong on one side's sensor path.
///
/// An axis is 0, 1 or 2 for x, y and z of the part; one beyond that has no effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SensorFault {
    /// A step of the zero-g offset.
    Bias {
        /// Which axis of the part.
        axis: usize,
        /// How far, mg.
        mg: f64,
    },
    /// The zero-g offset grows from the moment of injection.
    Drift {
        /// Which axis of the part.
        axis: usize,
        /// How fast, mg/s.
        mg_per_s: f64,
    },
    /// The sensitivity changes.
    Gain {
        /// Which axis of the part.
        axis: usize,
        /// By how much; -0.02 is -2 %.
        ratio: f64,
    },
    /// The code of one axis, or of all three, repeats for ever: that of the first sample after
    /// the injection.
    Stuck {
        /// Which axis of the part; `None` for all.
        axis: Option<usize>,
    },
    /// The white noise of the part grows.
    Noise {
        /// How many times, at least 1.
        factor: f64,
    },
    /// Single samples are off on an axis that is drawn: the first one after the injection, then
    /// at random times.
    Spikes {
        /// How far, up or down, g.
        g: f64,
        /// How many there are in a second, in the mean.
        per_s: f64,
    },
    /// Samples and the times of their data-ready edges reach the code late: a backlog.
    ///
    /// Edges go on at the sampling rate. The first sample after the injection is there again at
    /// each of them, with its own old time, until the next one has become old enough.
    Late {
        /// How late, s.
        s: f64,
    },
    /// Data-ready edges get lost, each by a draw of its own.
    SampleLoss {
        /// How many of them, 0 to 1.
        share: f64,
    },
    /// The supply breaks down below what the part needs, and comes back. The part stays reset.
    BrownOut {
        /// How long, s; at least one tick of the world.
        s: f64,
    },
    /// The supply sags: twice the noise and an offset that wanders by 12 mg rms.
    Sag,
    /// The part's thermometer reads something else than the die's temperature.
    Thermometer {
        /// By how much, degC.
        c: f64,
    },
    /// X and y are exchanged.
    SwappedAxes,
    /// The gyroscope is wrong, and the accelerometer beside it is not. Without effect on a part
    /// that has none.
    Gyroscope(RateFault),
}

/// One thing that goes wrong with a gyroscope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RateFault {
    /// A step of the bias.
    Bias {
        /// Which axis of the part.
        axis: usize,
        /// How far, deg/s.
        dps: f64,
    },
    /// The sensitivity of all axes changes.
    Scale {
        /// By how much; 0.05 is 5 %.
        ratio: f64,
    },
    /// The codes of all axes repeat for ever.
    Stuck,
    /// The white noise grows.
    Noise {
        /// How many times, at least 1.
        factor: f64,
    },
    /// X and y are exchanged.
    SwappedAxes,
}

/// One thing that goes wrong with one node on the bus.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum NodeFault {
    /// Its power is gone. Healing gives it back, with new turn-on offsets.
    Silent,
    /// Its code stands still; its controller goes on acknowledging. Healing resets it.
    Halted,
    /// It hands its frames to its controller late, in their order.
    LateFrames {
        /// How late, ms.
        ms: u32,
    },
    /// It floods the bus with frames of one identifier.
    Babbling {
        /// The identifier, 11 bits.
        id: u16,
        /// Share of the time that it does so, above 0 and up to 1, in turns of 10 ms.
        share: f64,
    },
    /// Every frame that it sends is corrupted, so its controller goes bus-off time and again.
    BusOff,
    /// It does not hear SYNC.
    SyncLost,
    /// A high bit of a number of its calibration flips in its RAM; see [`Corruption`].
    CorruptCalibration,
}
