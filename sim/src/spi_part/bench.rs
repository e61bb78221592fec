//! What the tests of the models share: a host's hand on the wires, and a part that is fed.

use std::cell::{RefCell, RefMut};
use std::rc::Rc;

use embedded_hal::delay::DelayNs;

use super::{Fault, Slave, SpiPort};

/// Writes one register.
pub fn write(chip: &mut impl Slave, address: u8, value: u8) {
    chip.select();
    chip.exchange(address);
    chip.exchange(value);
    chip.deselect();
}

/// Reads registers in one transaction.
pub fn burst<const N: usize>(chip: &mut impl Slave, address: u8) -> [u8; N] {
    chip.select();
    chip.exchange(address | 0x80);
    let bytes = std::array::from_fn(|_| chip.exchange(0));
    chip.deselect();
    bytes
}

/// Reads one register.
pub fn read(chip: &mut impl Slave, address: u8) -> u8 {
    burst::<1>(chip, address)[0]
}

/// What a part feels.
#[derive(Clone, Copy, Debug)]
pub struct Felt {
    /// Specific force, g.
    pub force_g: [f64; 3],
    /// Rate of turn, deg/s.
    pub rate_dps: [f64; 3],
    /// Temperature of the die, degC.
    pub die_c: f64,
}

/// A part that samples what it feels.
pub trait Sampling: Slave {
    /// Nominal rate of its sampling clock, Hz.
    fn odr_hz(&self) -> Option<f64>;

    /// One tick of its sampling clock.
    fn sample(&mut self, felt: &Felt);

    /// Injects a fault.
    fn set_fault(&mut self, fault: Option<Fault>);
}

/// A part that feels the same all the time and samples while the driver waits.
pub struct Bench<C> {
    /// The part.
    pub chip: Rc<RefCell<C>>,
    /// What it feels.
    pub felt: Felt,
    /// Injected when the part's clock reaches the time.
    pub fault_at: Option<(u64, Fault)>,
    sampled_ns: u64,
}

impl<C: Sampling> Bench<C> {
    /// A bench around a part.
    pub fn around(chip: C, force_g: [f64; 3], rate_dps: [f64; 3]) -> Self {
        Self {
            chip: Rc::new(RefCell::new(chip)),
            felt: Felt {
                force_g,
                rate_dps,
                die_c: 25.0,
            },
            fault_at: None,
            sampled_ns: 0,
        }
    }

    /// The wires to the part.
    pub fn port(&self) -> SpiPort<C> {
        SpiPort::new(Rc::clone(&self.chip))
    }

    /// The part.
    pub fn chip(&self) -> RefMut<'_, C> {
        self.chip.borrow_mut()
    }
}

impl<C: Sampling> DelayNs for Bench<C> {
    fn delay_ns(&mut self, ns: u32) {
        let mut chip = self.chip.borrow_mut();
        let end_ns = chip.now_ns() + u64::from(ns);
        if let Some((at_ns, fault)) = self.fault_at
            && end_ns >= at_ns
        {
            chip.set_fault(Some(fault));
        }
        while let Some(odr_hz) = chip.odr_hz() {
            let due_ns = self.sampled_ns + (1e9 / odr_hz) as u64;
            if due_ns > end_ns {
                break;
            }
            chip.advance_to(due_ns);
            chip.sample(&self.felt);
            self.sampled_ns = due_ns;
        }
        if chip.odr_hz().is_none() {
            self.sampled_ns = end_ns;
        }
        chip.advance_to(end_ns);
    }
}
