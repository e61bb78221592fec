//! Which part a side has: an LIS2DW12, or an ISM330DHCX with its gyroscope.
//!
//! In: what the part feels behind its analogue side. Out: what its registers hold, and the driver
//! that reads them. The rest of the electronics is the same for both.
//!
//! Left out: the accelerometer's errors, which are those of [`Part`](crate::error_model::Part)
//! whatever the part, and its low-pass.

use std::cell::RefCell;
use std::rc::Rc;

use device::sensor::ism330dhcx::Ism330dhcx;
use device::sensor::{AnyDriver, Lis2dw12, PartConfig};

use crate::error_model::gyroscope::Gyroscope;
use crate::error_model::{self, ErrorModel};
use crate::low_pass::{LowPass, Moment};
use crate::rng::Rng;
use crate::spi_part::{Fault, Slave, SpiPort};
use crate::{ism330dhcx, lis2dw12};

/// What a part feels at one moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Felt {
    /// Specific force, g.
    pub force_g: [f64; 3],
    /// Rate of turn, deg/s.
    pub rate_dps: [f64; 3],
}

/// The part, register by register.
#[derive(Debug)]
pub(super) enum Fitted {
    Lis2dw12(Rc<RefCell<lis2dw12::Chip>>),
    Ism330dhcx(Rc<RefCell<ism330dhcx::Chip>>, Box<Turning>),
}

/// The gyroscope of a part that has one.
#[derive(Debug)]
pub(super) struct Turning {
    gyroscope: Gyroscope,
    analogue: LowPass,
    /// White noise of one sample, deg/s.
    sigma_dps: f64,
}

impl Fitted {
    /// The part that `config` is for, without power, around `accelerometer`.
    pub fn new(
        config: &PartConfig,
        (model, accelerometer): (&ErrorModel, &error_model::Part),
        rng: &mut Rng,
    ) -> Self {
        match config {
            PartConfig::Lis2dw12(_) => {
                let traits = lis2dw12::Traits {
                    full_register: !model.quantisation,
                    ..lis2dw12::Traits::TYPICAL
                };
                Self::Lis2dw12(Rc::new(RefCell::new(lis2dw12::Chip::new(traits))))
            }
            PartConfig::Ism330dhcx(_) => {
                let chip = ism330dhcx::Chip::new(ism330dhcx::Traits::TYPICAL);
                let turning = Turning {
                    gyroscope: Gyroscope::draw(&model.gyroscope, rng)
                        .mounted(accelerometer.mounting()),
                    analogue: LowPass::new(200.0),
                    sigma_dps: 0.0,
                };
                Self::Ism330dhcx(Rc::new(RefCell::new(chip)), Box::new(turning))
            }
        }
    }

    /// The driver of this part.
    pub fn driver(&self) -> Driver {
        match self {
            Self::Lis2dw12(chip) => Driver::Lis2dw12(Lis2dw12::new(SpiPort::new(Rc::clone(chip)))),
            Self::Ism330dhcx(chip, _) => {
                Driver::Ism330dhcx(Ism330dhcx::new(SpiPort::new(Rc::clone(chip))))
            }
        }
    }

    /// The part at the wires, whichever it is.
    pub fn slave(&self) -> Rc<RefCell<dyn Slave>> {
        match self {
            Self::Lis2dw12(chip) => Rc::clone(chip) as Rc<RefCell<dyn Slave>>,
            Self::Ism330dhcx(chip, _) => Rc::clone(chip) as Rc<RefCell<dyn Slave>>,
        }
    }

    pub fn lis2dw12(&self) -> Option<&Rc<RefCell<lis2dw12::Chip>>> {
        match self {
            Self::Lis2dw12(chip) => Some(chip),
            Self::Ism330dhcx(..) => None,
        }
    }

    pub fn power_on(&mut self, now_ns: u64) {
        match self {
            Self::Lis2dw12(chip) => chip.borrow_mut().power_on(now_ns),
            Self::Ism330dhcx(chip, _) => chip.borrow_mut().power_on(now_ns),
        }
    }

    pub fn power_off(&mut self) {
        match self {
            Self::Lis2dw12(chip) => chip.borrow_mut().power_off(),
            Self::Ism330dhcx(chip, _) => chip.borrow_mut().power_off(),
        }
    }

    pub fn brown_out(&mut self, now_ns: u64) {
        match self {
            Self::Lis2dw12(chip) => chip.borrow_mut().brown_out(now_ns),
            Self::Ism330dhcx(chip, _) => chip.borrow_mut().brown_out(now_ns),
        }
    }

    /// Power has come back: what is drawn anew at each power-on.
    pub fn renew(&mut self, rng: &mut Rng) {
        if let Self::Ism330dhcx(_, turning) = self {
            turning.gyroscope.power_on(rng);
        }
    }

    pub fn set_die_temperature(&mut self, die_c: f64) {
        if let Self::Ism330dhcx(_, turning) = self {
            turning.gyroscope.set_die_temperature(die_c);
        }
    }

    pub fn set_sag(&mut self, active: bool) {
        if let Self::Ism330dhcx(_, turning) = self {
            turning.gyroscope.set_sag(active);
        }
    }

    pub fn advance_to(&self, time_ns: u64) {
        match self {
            Self::Lis2dw12(chip) => chip.borrow_mut().advance_to(time_ns),
            Self::Ism330dhcx(chip, _) => chip.borrow_mut().advance_to(time_ns),
        }
    }

    pub fn set_fault(&self, fault: Option<Fault>) {
        match self {
            Self::Lis2dw12(chip) => chip.borrow_mut().set_fault(fault),
            Self::Ism330dhcx(chip, _) => chip.borrow_mut().set_fault(fault),
        }
    }

    pub fn fault(&self) -> Option<Fault> {
        match self {
            Self::Lis2dw12(chip) => chip.borrow().fault(),
            Self::Ism330dhcx(chip, _) => chip.borrow().fault(),
        }
    }

    /// Nominal rate of samples, Hz; `None` while the part does not convert.
    pub fn odr_hz(&self) -> Option<f64> {
        match self {
            Self::Lis2dw12(chip) => chip.borrow().odr_hz(),
            Self::Ism330dhcx(chip, _) => chip.borrow().odr_hz(),
        }
    }

    /// Sets the analogue side to the bandwidths that the part was set up for.
    pub fn retune(&mut self, analogue: &mut LowPass, odr_hz: f64) {
        match self {
            Self::Lis2dw12(chip) => {
                analogue.retune(chip.borrow().bandwidth_hz().unwrap_or(odr_hz / 2.0));
            }
            Self::Ism330dhcx(chip, turning) => {
                let chip = chip.borrow();
                let half_hz = odr_hz / 2.0;
                analogue.retune(chip.accelerometer_bandwidth_hz().unwrap_or(half_hz));
                let bandwidth_hz = chip.gyroscope_bandwidth_hz().unwrap_or(half_hz);
                turning.analogue.retune(bandwidth_hz);
                turning.sigma_dps = turning.gyroscope.sample_sigma_dps(odr_hz);
            }
        }
    }

    /// White noise of the accelerometer, ug per root of Hz.
    pub fn noise_density_ug(&self) -> f64 {
        match self {
            Self::Lis2dw12(chip) => chip.borrow().noise_density_ug(),
            Self::Ism330dhcx(chip, _) => chip.borrow().noise_density_ug(),
        }
    }

    pub fn data_ready(&self) -> bool {
        match self {
            Self::Lis2dw12(chip) => chip.borrow().data_ready(),
            Self::Ism330dhcx(chip, _) => chip.borrow().data_ready(),
        }
    }

    pub fn reads_temperature(&self) -> bool {
        match self {
            Self::Lis2dw12(chip) => chip.borrow().reads_temperature(),
            Self::Ism330dhcx(chip, _) => chip.borrow().reads_temperature(),
        }
    }

    pub fn gyroscope(&self) -> Option<&Gyroscope> {
        match self {
            Self::Lis2dw12(_) => None,
            Self::Ism330dhcx(_, turning) => Some(&turning.gyroscope),
        }
    }

    /// One tick of the gyroscope's analogue side, with its output before and after.
    #[inline]
    pub fn turn(&mut self, rate_dps: [f64; 3]) -> Option<[Moment; 2]> {
        let Self::Ism330dhcx(_, turning) = self else {
            return None;
        };
        let before = turning.analogue.moment();
        turning.analogue.step(rate_dps);
        Some([before, turning.analogue.moment()])
    }

    /// What the gyroscope measures with `noise` times its white noise, deg/s before rounding.
    pub fn feel_rate(
        &mut self,
        felt: &Felt,
        (noise, period_s): (f64, f64),
        rng: &mut Rng,
    ) -> [f64; 3] {
        let Self::Ism330dhcx(_, turning) = self else {
            return [0.0; 3];
        };
        let sigma_dps = turning.sigma_dps * noise;
        let gyroscope = &mut turning.gyroscope;
        gyroscope.feel(felt.rate_dps, felt.force_g, sigma_dps, period_s, rng)
    }

    /// One conversion.
    pub fn convert(&self, felt: &Felt, die_c: f64) {
        match self {
            Self::Lis2dw12(chip) => chip.borrow_mut().convert(felt.force_g, die_c),
            Self::Ism330dhcx(chip, _) => {
                chip.borrow_mut()
                    .convert(felt.force_g, felt.rate_dps, die_c);
            }
        }
    }

    /// One conversion whose codes, of acceleration and rate, go through `path` before they are
    /// stored; a part without a gyroscope has no codes of a rate.
    pub fn convert_through(
        &self,
        felt: &Felt,
        die_c: f64,
        path: impl FnOnce([[i16; 3]; 2]) -> [[i16; 3]; 2],
    ) {
        match self {
            Self::Lis2dw12(chip) => {
                chip.borrow_mut()
                    .convert_through(felt.force_g, die_c, |force| {
                        let [force, _] = path([force, [0; 3]]);
                        force
                    });
            }
            Self::Ism330dhcx(chip, _) => {
                let mut chip = chip.borrow_mut();
                chip.convert_through(felt.force_g, felt.rate_dps, die_c, path);
            }
        }
    }
}

/// The driver of whichever part there is.
pub type Driver = AnyDriver<lis2dw12::SpiPort, ism330dhcx::SpiPort>;
