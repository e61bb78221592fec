//! What 1010h keeps of the device's own objects, as the device uses it.
//!
//! In: values as they come from the bus or from memory. Out: the numbers behind them. Every row
//! that is simply a number is found by [`Parameters::place`]; slopes have rules of their own
//! (`profile`).
//!
//! Left out: defaults, which stand in the rows, and what a write is allowed to do
//! (`device_objects`).

use canopen::object::{Address, Place};

use crate::pair::Policy;
use crate::presentation::Presentation;
use crate::profile::{Resolution, Slope};

/// The parameters.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// 6000h and 6800h.
    pub resolution: [u16; 2],
    /// Slopes X and Y of this channel, then of the peer.
    pub slopes: [Slope; 4],
    /// 2001h.
    pub peer: u8,
    /// 2003h: 0 the check that the instrument was built with, 1 the paper's, 2 the product's.
    pub check: u8,
    /// 2004h: seconds for which a channel must be sound before it counts again; 0: a reset.
    pub latch_s: u16,
    /// 2005h: 1 when this channel may work while the other is faulty.
    pub degraded: u8,
    /// 2006h: 1 when both channels have to show the same angle as the same number.
    pub alike: u8,
    /// 2007h: largest standard uncertainty of a valid angle, 0.001 deg; 0: no limit.
    pub uncertainty_limit: u16,
    /// 2040h: lowest and highest X, lowest and highest Y, 0.001 deg.
    pub range: [i32; 4],
    /// 2050h sub 1.
    pub fallback_ms: u16,
    /// 2050h sub 2.
    pub fallback_period_us: u32,
    /// 2051h.
    pub recovery_ms: u16,
    /// 2053h sub 2.
    pub automatic_bit_rate: u8,
    /// 2012h: what a received SRDO carries.
    pub safe_received: [i16; 4],
    /// 6200h.
    pub safety_resolution: u16,
    /// 63FEh.
    pub safety_valid: u8,
    /// 63FFh sub 1.
    pub safety_signature: u16,
}

impl Parameters {
    /// How the pair is to be judged.
    pub const fn policy(&self) -> Policy {
        Policy {
            latch_s: self.latch_s,
            may_go_on_alone: self.degraded != 0,
        }
    }

    /// How this channel's angles are shown.
    pub fn presentation(&self) -> Presentation {
        let [x, y, ..] = &self.slopes;
        let [own, _] = self.resolution;
        let resolution = Resolution::new(own).unwrap_or(Resolution::Hundredth);
        Presentation::of([x, y], resolution)
    }

    /// Nothing set: the rows' defaults are loaded over it at every start.
    pub const NONE: Self = Self {
        resolution: [10; 2],
        slopes: [Slope::new(); 4],
        peer: 0,
        check: 0,
        latch_s: 0,
        degraded: 0,
        alike: 0,
        uncertainty_limit: 0,
        range: [0; 4],
        fallback_ms: 0,
        fallback_period_us: 0,
        recovery_ms: 0,
        automatic_bit_rate: 0,
        safe_received: [0; 4],
        safety_resolution: 10,
        safety_valid: 0,
        safety_signature: 0,
    };

    /// The number behind a row; `None` when the row is no plain parameter.
    ///
    /// The dictionary has been asked before, so an index without members is asked for at
    /// sub-index 0 only.
    pub fn place(&mut self, at: Address) -> Option<Place<'_>> {
        let member = usize::from(at.sub).wrapping_sub(1);
        Some(match at.index {
            0x2001 => Place::U8(&mut self.peer),
            0x2003 => Place::U8(&mut self.check),
            0x2004 => Place::U16(&mut self.latch_s),
            0x2005 => Place::U8(&mut self.degraded),
            0x2006 => Place::U8(&mut self.alike),
            0x2007 => Place::U16(&mut self.uncertainty_limit),
            0x2012 => Place::I16(self.safe_received.get_mut(member)?),
            0x2040 => Place::I32(self.range.get_mut(member)?),
            0x2050 if at.sub == 1 => Place::U16(&mut self.fallback_ms),
            0x2050 => Place::U32(&mut self.fallback_period_us),
            0x2051 => Place::U16(&mut self.recovery_ms),
            0x2053 => Place::U8(&mut self.automatic_bit_rate),
            0x6200 => Place::U16(&mut self.safety_resolution),
            0x63FE => Place::U8(&mut self.safety_valid),
            0x63FF => Place::U16(&mut self.safety_signature),
            _ => return None,
        })
    }
}
