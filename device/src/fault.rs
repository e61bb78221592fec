//! What can be wrong, and how the bus is told: one exhaustive match from a fault to its EMCY
//! code, its bit in the error register and a text (CiA 301, 7.2.7 and 7.5.2.2; CiA 410).
//!
//! In: the reading of this channel, the judgement of the pair, and what the device has found of its
//! memory. Out: a [`Faults`] set. Each member is reported once when it appears and once, by error
//! code 0000h, when it has gone.
//!
//! Left out: communication errors (81xxh, 82xxh), which the stack itself finds and reports.

use tilt::chain::{Invalid, Reading};
use tilt::cross_check::{Judgement, Member};

/// One thing that can be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Fault {
    /// Slope X is outside the measuring range (2040h).
    RangeX = 0,
    /// Slope Y is outside the measuring range (2040h).
    RangeY = 1,
    /// The sensor has lost its set-up, as after a brown-out of its supply.
    SensorSupply = 2,
    /// The sensor's temperature is outside what it is specified for, -40 to 85 degC.
    Temperature = 3,
    /// The sensor does not answer on its bus.
    SensorBus = 4,
    /// The sensor has stopped giving samples.
    SensorSilent = 5,
    /// The sensor was driven beyond its full scale.
    SensorOverRange = 6,
    /// The channel has no calibration of its own.
    NotCalibrated = 7,
    /// The stored calibration is damaged and is not used.
    CalibrationRecord = 8,
    /// Stored parameters could not be read back or written.
    Storage = 9,
    /// Paper mode: the machine has to stop and stand still.
    StopMotion = 10,
    /// Paper mode: after the stop the channels still differ.
    PhysicalFault = 11,
    /// The channels differ, and nothing tells which is wrong.
    Disagree = 12,
    /// This channel is faulty.
    OwnChannel = 13,
    /// The peer's channel is faulty or silent.
    PeerChannel = 14,
    /// Neither channel measures.
    NoChannel = 15,
    /// A safe state was demanded by GFC, or a received SRDO failed; stays until a reset.
    FailSafe = 16,
    /// The codes of the sensor stand still.
    SensorStuck = 17,
    /// The sensor is noisier than it is and than the other channel's.
    SensorNoise = 18,
    /// Single samples are far off, in this channel only.
    SensorSpikes = 19,
    /// The sensor's temperature jumps as no die's can.
    Thermometer = 20,
    /// This channel moved while the other one stood, or at standstill its gravity is of the wrong
    /// length.
    Biased = 21,
    /// The running program is not what was linked.
    Program = 22,
    /// Both channels measure alike and are set to show different angles.
    Unlike = 23,
}

impl Fault {
    /// Every fault, in the order of their numbers.
    pub const ALL: [Self; 24] = [
        Self::RangeX,
        Self::RangeY,
        Self::SensorSupply,
        Self::Temperature,
        Self::SensorBus,
        Self::SensorSilent,
        Self::SensorOverRange,
        Self::NotCalibrated,
        Self::CalibrationRecord,
        Self::Storage,
        Self::StopMotion,
        Self::PhysicalFault,
        Self::Disagree,
        Self::OwnChannel,
        Self::PeerChannel,
        Self::NoChannel,
        Self::FailSafe,
        Self::SensorStuck,
        Self::SensorNoise,
        Self::SensorSpikes,
        Self::Thermometer,
        Self::Biased,
        Self::Program,
        Self::Unlike,
    ];

    /// EMCY error code, and bit of the error register.
    ///
    /// 5010h and 5020h are CiA 410's; 31xxh to 42xxh follow CiA 301, table 26; FFxxh are ours.
    pub const fn report(self) -> (u16, u8) {
        match self {
            Self::RangeX => (0x5010, DEVICE),
            Self::RangeY => (0x5020, DEVICE),
            Self::SensorSupply => (0x3200, VOLTAGE),
            Self::Temperature => (0x4200, HEAT),
            Self::SensorBus => (0xFF01, MANUFACTURER),
            Self::SensorSilent => (0xFF02, MANUFACTURER),
            Self::SensorOverRange => (0xFF03, MANUFACTURER),
            Self::NotCalibrated => (0xFF20, MANUFACTURER),
            Self::CalibrationRecord => (0xFF21, MANUFACTURER),
            Self::Storage => (0xFF22, MANUFACTURER),
            Self::StopMotion => (0xFF11, MANUFACTURER),
            Self::PhysicalFault => (0xFF12, MANUFACTURER),
            Self::Disagree => (0xFF13, MANUFACTURER),
            Self::OwnChannel => (0xFF14, MANUFACTURER),
            Self::PeerChannel => (0xFF15, MANUFACTURER),
            Self::NoChannel => (0xFF16, MANUFACTURER),
            Self::FailSafe => (0xFF17, MANUFACTURER),
            Self::SensorStuck => (0xFF04, MANUFACTURER),
            Self::SensorNoise => (0xFF05, MANUFACTURER),
            Self::SensorSpikes => (0xFF06, MANUFACTURER),
            Self::Thermometer => (0xFF07, MANUFACTURER),
            Self::Biased => (0xFF08, MANUFACTURER),
            Self::Program => (0x6110, MANUFACTURER),
            Self::Unlike => (0xFF18, MANUFACTURER),
        }
    }

    /// What to tell a person. It stands apart because the part has no use for it, and no room.
    pub const fn text(self) -> &'static str {
        match self {
            Self::RangeX => "slope X is outside the measuring range",
            Self::RangeY => "slope Y is outside the measuring range",
            Self::SensorSupply => "the sensor has lost its supply or set-up",
            Self::Temperature => "the sensor is too cold or too hot",
            Self::SensorBus => "the sensor does not answer",
            Self::SensorSilent => "the sensor gives no samples",
            Self::SensorOverRange => "the sensor is beyond full scale",
            Self::NotCalibrated => "the channel is not calibrated",
            Self::CalibrationRecord => "the calibration is damaged",
            Self::Storage => "parameters could not be stored or read",
            Self::StopMotion => "stop the machine, let it stand still",
            Self::PhysicalFault => "check the supply, then reset",
            Self::Disagree => "the channels differ for too long",
            Self::OwnChannel => "this channel is faulty",
            Self::PeerChannel => "the other channel is faulty or silent",
            Self::NoChannel => "neither channel measures",
            Self::FailSafe => "the safe state was demanded",
            Self::SensorStuck => "the sensor's codes stand still",
            Self::SensorNoise => "the sensor is too noisy",
            Self::SensorSpikes => "single samples are far off",
            Self::Thermometer => "the sensor's temperature jumps",
            Self::Biased => "this channel moved alone, or its gravity is of the wrong length",
            Self::Program => "the program in flash is damaged",
            Self::Unlike => "the channels are set to show different angles",
        }
    }

    /// True for what must keep a safety frame from being sent.
    pub const fn forbids_safety(self) -> bool {
        !matches!(self, Self::NotCalibrated | Self::Storage | Self::Unlike)
    }
}

impl Fault {
    /// True for what the black box keeps the samples of: not for what is part of the work.
    pub const fn keeps_samples(self) -> bool {
        !matches!(
            self,
            Self::RangeX
                | Self::RangeY
                | Self::SensorOverRange
                | Self::Temperature
                | Self::NotCalibrated
                | Self::Storage
                | Self::Program
                | Self::Unlike
        )
    }
}

/// Error register bit 2.
const VOLTAGE: u8 = 0x04;
/// Error register bit 3.
const HEAT: u8 = 0x08;
/// Error register bit 5: device profile.
const DEVICE: u8 = 0x20;
/// Error register bit 7.
const MANUFACTURER: u8 = 0x80;

/// The faults that [`Fault::forbids_safety`], as a set.
const FORBIDDING: u32 = {
    let (mut bits, mut at) = (0, 0);
    while at < Fault::ALL.len() {
        let fault = Fault::ALL[at];
        bits |= (fault.forbids_safety() as u32) << fault as u8;
        at += 1;
    }
    bits
};

/// A set of faults.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults(u32);

impl Faults {
    /// Adds one.
    pub const fn insert(&mut self, fault: Fault) {
        self.0 |= 1 << fault as u8;
    }

    /// Adds one when `present`, takes it out otherwise.
    pub const fn set(&mut self, fault: Fault, present: bool) {
        self.0 &= !(1 << fault as u8);
        self.0 |= (present as u32) << fault as u8;
    }

    /// True when it is a member.
    pub const fn has(self, fault: Fault) -> bool {
        self.0 >> fault as u8 & 1 != 0
    }

    /// True when nothing is wrong.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The members that `before` had not.
    pub const fn new_since(self, before: Self) -> Self {
        Self(self.0 & !before.0)
    }

    /// True when one of them must keep a safety frame from being sent.
    pub const fn forbid_safety(self) -> bool {
        self.0 & FORBIDDING != 0
    }

    /// Members, by number.
    pub fn iter(self) -> impl Iterator<Item = Fault> {
        Fault::ALL.iter().copied().filter(move |f| self.has(*f))
    }

    /// The error register that this set asks for, without the generic bit.
    pub fn register(self) -> u8 {
        self.iter().fold(0, |bits, fault| bits | fault.report().1)
    }

    /// The set as a number, bit n for fault n: what stands in EMCY bytes 3 to 5.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// Sets what a reading shows of its sensor. Transient reasons accuse nobody.
    pub fn of_reading(&mut self, reading: &Reading) {
        for axis in [&reading.x, &reading.y] {
            if let Err(reason) = axis {
                self.of_reason(*reason);
            }
        }
    }

    /// Sets what a reason means for this channel's sensor.
    fn of_reason(&mut self, reason: Invalid) {
        match reason {
            Invalid::PartReset => self.insert(Fault::SensorSupply),
            Invalid::Bus => self.insert(Fault::SensorBus),
            Invalid::Stale => self.insert(Fault::SensorSilent),
            Invalid::OverRange => self.insert(Fault::SensorOverRange),
            Invalid::Stuck => self.insert(Fault::SensorStuck),
            Invalid::Noise => self.insert(Fault::SensorNoise),
            Invalid::Spikes => self.insert(Fault::SensorSpikes),
            Invalid::Thermometer => self.insert(Fault::Thermometer),
            Invalid::Biased => self.insert(Fault::Biased),
            Invalid::Corrupt => self.insert(Fault::CalibrationRecord),
            // Passing, or the pair's business, which the judgement tells.
            Invalid::NoSample
            | Invalid::Settling
            | Invalid::NoTemperature
            | Invalid::NotMeasured
            | Invalid::Silent
            | Invalid::Late
            | Invalid::Refused
            | Invalid::Unconfirmed
            | Invalid::Alone
            | Invalid::Unlike
            | Invalid::Uncertain => {}
        }
    }

    /// Sets what the comparison of the channels has found.
    pub fn of_judgement(&mut self, judgement: Judgement) {
        match judgement {
            // A warning is part of the work: 2021h shows it, and no message is sent for each.
            Judgement::Agree
            | Judgement::DataDelay
            | Judgement::Waiting(_)
            | Judgement::Warning => {}
            Judgement::StopMotion => self.insert(Fault::StopMotion),
            Judgement::PhysicalFault => self.insert(Fault::PhysicalFault),
            Judgement::Disagree => self.insert(Fault::Disagree),
            Judgement::OneChannel {
                faulty: Member::Own,
                reason,
            } => {
                self.insert(Fault::OwnChannel);
                self.of_reason(reason);
            }
            Judgement::OneChannel {
                faulty: Member::Peer,
                ..
            } => self.insert(Fault::PeerChannel),
            Judgement::NoChannel(_) => self.insert(Fault::NoChannel),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_codes_are_each_used_once() {
        for (n, fault) in Fault::ALL.into_iter().enumerate() {
            assert_eq!(fault as usize, n);
            let (code, bit) = fault.report();
            assert!(bit.is_power_of_two() && !fault.text().is_empty());
            let same = Fault::ALL.into_iter().filter(|f| f.report().0 == code);
            assert_eq!(same.count(), 1, "{code:04X}");
        }
    }

    #[test]
    fn a_set_keeps_what_is_put_in_and_asks_for_every_bit() {
        let mut faults = Faults::default();
        faults.insert(Fault::RangeX);
        faults.set(Fault::SensorSupply, true);
        faults.set(Fault::RangeX, false);
        faults.set(Fault::Disagree, true);
        assert_eq!(faults.register(), VOLTAGE | MANUFACTURER);
        let members: [Option<Fault>; 3] = {
            let mut all = faults.iter();
            [all.next(), all.next(), all.next()]
        };
        let expected = [Some(Fault::SensorSupply), Some(Fault::Disagree), None];
        assert_eq!(members, expected);
    }
}
