//! One channel, as the bus tells of it.
//!
//! In: the bytes of its PDOs, EMCY and heartbeats. Out: its [`Side`].
//!
//! Left out: what it says by SDO.

use super::Emergency;

/// Slopes that are none (docs/canopen.md).
const NO_SLOPE: i16 = i16::MIN;

/// Resolution as delivered (6000h), 0.001 deg.
const RESOLUTION: i32 = 10;

/// The NMT state of a node (CiA 301, 7.2.8.3.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Nmt {
    /// It has just started.
    BootUp,
    /// It measures and sends no PDO.
    PreOperational,
    /// It sends its PDOs.
    Operational,
    /// It sends nothing but heartbeats.
    Stopped,
}

/// What TPDO 1 carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Slopes {
    /// When it was seen.
    pub time_ns: u64,
    /// Slope X and Y, 0.001 deg; `None` where the channel says that it must not be used.
    pub mdeg: [Option<i32>; 2],
    /// Validity (2020h).
    pub validity: u8,
    /// State of the pair (2021h).
    pub state: u8,
}

/// What TPDO 2 carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Detail {
    /// When it was seen.
    pub time_ns: u64,
    /// The larger standard uncertainty of X and Y (k = 1), 0.001 deg (2022h).
    pub uncertainty_mdeg: Option<u16>,
    /// Group delay of the filter, ms (2023h).
    pub latency_ms: u8,
    /// The larger difference to the other channel as the node has formed it, 0.001 deg (2024h).
    pub difference_mdeg: Option<i16>,
    /// Temperature of the sensor, degC (6511h).
    pub temperature_degc: i8,
}

/// What one node has told.
#[derive(Clone, Debug)]
pub struct Side {
    /// Its node-id.
    pub node_id: u8,
    /// When anything of it was seen last.
    pub seen_ns: Option<u64>,
    /// The latest slopes.
    pub slopes: Option<Slopes>,
    /// The latest detail.
    pub detail: Option<Detail>,
    /// The state of its latest heartbeat, and when it came.
    pub nmt: Option<(Nmt, u64)>,
    /// The faults that stand by its latest EMCY, bit n for fault n of `device::fault`.
    pub faults: u32,
    /// Boot-up messages seen.
    pub boots: u32,
}

impl Side {
    pub(super) const fn new(node_id: u8) -> Self {
        Self {
            node_id,
            seen_ns: None,
            slopes: None,
            detail: None,
            nmt: None,
            faults: 0,
            boots: 0,
        }
    }

    /// Takes an EMCY; `None` when it is none.
    pub(super) fn emergency(&mut self, bytes: &[u8]) -> Option<Emergency> {
        let [c0, c1, register, rest @ ..] = bytes else {
            return None;
        };
        let bytes: [u8; 5] = rest.try_into().ok()?;
        let [f0, f1, f2, ..] = bytes;
        let code = u16::from_le_bytes([*c0, *c1]);
        // Those of the bus have other bytes there.
        if !matches!(code, 0x8000..=0x8FFF) {
            self.faults = u32::from_le_bytes([f0, f1, f2, 0]);
        }
        Some(Emergency {
            code,
            register: *register,
            bytes,
        })
    }

    /// Takes a heartbeat: the state if it is a new one; `None` when it is no heartbeat.
    pub(super) fn heartbeat(&mut self, time_ns: u64, bytes: &[u8]) -> Option<Option<Nmt>> {
        let [state] = bytes else {
            return None;
        };
        let state = match state & 0x7F {
            0 => Nmt::BootUp,
            4 => Nmt::Stopped,
            5 => Nmt::Operational,
            127 => Nmt::PreOperational,
            _ => return None,
        };
        if state == Nmt::BootUp {
            self.boots += 1;
            self.faults = 0;
        }
        let before = self.nmt.replace((state, time_ns));
        Some(
            (before.map(|(state, _)| state) != Some(state) || state == Nmt::BootUp)
                .then_some(state),
        )
    }
}

fn slope(low: u8, high: u8) -> Option<i32> {
    let raw = i16::from_le_bytes([low, high]);
    (raw != NO_SLOPE).then_some(i32::from(raw) * RESOLUTION)
}

/// TPDO 1 as delivered; `None` when it has another form.
pub(super) fn slopes(time_ns: u64, bytes: &[u8]) -> Option<Slopes> {
    let &[x0, x1, y0, y1, validity, state] = bytes else {
        return None;
    };
    Some(Slopes {
        time_ns,
        mdeg: [slope(x0, x1), slope(y0, y1)],
        validity,
        state,
    })
}

/// TPDO 2 as delivered; `None` when it has another form.
pub(super) fn detail(time_ns: u64, bytes: &[u8]) -> Option<Detail> {
    let &[_, _, u0, u1, latency_ms, d0, d1, temperature] = bytes else {
        return None;
    };
    let uncertainty = u16::from_le_bytes([u0, u1]);
    let difference = i16::from_le_bytes([d0, d1]);
    Some(Detail {
        time_ns,
        uncertainty_mdeg: (uncertainty != u16::MAX).then_some(uncertainty),
        latency_ms,
        difference_mdeg: (difference != i16::MIN).then_some(difference),
        temperature_degc: i8::from_le_bytes([temperature]),
    })
}
