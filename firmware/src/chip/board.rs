//! The board: clocks, pins, the strap that sets which channel this is, and why the chip came up.
//!
//! In: the peripherals at reset. Out: each of them set up for what hangs on it.
//!
//! | pin | is |
//! |---|---|
//! | PA0 | data-ready of the sensor (INT1), TIM2 channel 1 |
//! | PA4 to PA7 | select, clock, data from and to the sensor, SPI1 |
//! | PA11, PA12 | CAN: RX, TX to the transceiver |
//! | PB0 | channel: open A, to ground B |
//!
//! Crystal 8 MHz, PLL x9: 72 MHz core and APB2, 36 MHz APB1 (RM0008 7.2, 7.3.2).

use device::objects::table::Channel;
use flash::check_sum::Crc32;
use flash::layout::Region;
use stm32f1xx_hal::flash::ACR;
use stm32f1xx_hal::gpio::{Output, Pin, PinState, PushPull};
use stm32f1xx_hal::pac::{CAN, Peripherals, RCC, SPI1, TIM2};
use stm32f1xx_hal::prelude::*;
use stm32f1xx_hal::rcc::{Config, Enable, Rcc};

use super::can::Can;
use super::clock::{self, Alarm};
use super::nor::{Erase, Nor};
use super::spi::Sensor;
use super::{trap, watchdog};
use crate::crash::Crash;

/// CSR: the watchdog has reset the chip; forget all causes (RM0008 7.3.10).
const IWDGRSTF: u32 = 1 << 29;
/// See [`IWDGRSTF`].
const RMVF: u32 = 1 << 24;

/// 96 bits that no other chip has (RM0008 30.2).
const UNIQUE_ID: *const [u8; 12] = 0x1FFF_F7E8 as *const [u8; 12];

/// The pin that selects the sensor.
pub type Select = Pin<'A', 4, Output<PushPull>>;

/// What the application has of the board.
pub struct Board<E> {
    /// The sensor.
    pub sensor: Sensor<Select>,
    /// The CAN controller.
    pub can: Can,
    /// The alarm clock.
    pub alarm: Alarm,
    /// The flash.
    pub nor: Nor<E>,
    /// Which channel the strap sets.
    pub channel: Channel,
    /// A number that tells this chip from any other.
    pub serial: u32,
    /// Why the program before has ended, if it was by itself.
    pub crash: Option<Crash>,
}

/// Starts crystal and PLL. Doing it twice changes nothing.
///
/// A crystal that does not swing holds the code here: without it there is no time and no bus. The
/// watchdog then tries again.
pub fn start_clocks(rcc: RCC, acr: &mut ACR) -> Rcc {
    let config = Config::hse(8.MHz()).sysclk(72.MHz()).pclk1(36.MHz());
    rcc.freeze(config, acr)
}

/// What a bootloader needs: the clocks, the watchdog, which nothing stops again, and the flash.
pub fn start_boot(peripherals: Peripherals) -> Nor {
    let mut acr = peripherals.FLASH.constrain().acr;
    watchdog::start(peripherals.IWDG);
    start_clocks(peripherals.RCC, &mut acr);
    Nor::new(None)
}

/// Sets everything up for the application, which runs in the slot `running`; interrupts are off.
pub fn start<E: Erase>(peripherals: Peripherals, running: Option<Region>) -> Board<E> {
    let mut acr = peripherals.FLASH.constrain().acr;
    let mut rcc = start_clocks(peripherals.RCC, &mut acr);
    watchdog::feed();
    TIM2::enable(&mut rcc);
    SPI1::enable(&mut rcc);
    CAN::enable(&mut rcc);
    let mut a = peripherals.GPIOA.split(&mut rcc);
    let mut b = peripherals.GPIOB.split(&mut rcc);
    // An output pin that is high before it is one gives no edge.
    let select = a
        .pa4
        .into_push_pull_output_with_state(&mut a.crl, PinState::High);
    a.pa5.into_alternate_push_pull(&mut a.crl);
    a.pa6.into_pull_up_input(&mut a.crl);
    a.pa7.into_alternate_push_pull(&mut a.crl);
    // Without a sensor the line must not catch noise for edges.
    a.pa0.into_pull_down_input(&mut a.crl);
    // A transceiver that is missing looks like a recessive bus.
    a.pa11.into_pull_up_input(&mut a.crh);
    a.pa12.into_alternate_push_pull(&mut a.crh);
    let strap = b.pb0.into_pull_up_input(&mut b.crl);
    Board {
        sensor: Sensor::start(peripherals.SPI1, select),
        can: Can::start(peripherals.CAN),
        alarm: clock::start(peripherals.TIM2),
        nor: Nor::new(running),
        channel: if strap.is_high() {
            Channel::A
        } else {
            Channel::B
        },
        serial: serial(),
        crash: crash(),
    }
}

fn serial() -> u32 {
    // SAFETY: the unique id is read-only memory of every part at this address.
    Crc32::of(&unsafe { UNIQUE_ID.read_volatile() })
}

/// What the last program left, or the watchdog shows for one that could not.
fn crash() -> Option<Crash> {
    // SAFETY: the block of RCC is at this address for ever; no other code uses CSR.
    let csr = unsafe { &*RCC::ptr() }.csr();
    let causes = csr.read().bits();
    super::register::write(csr, RMVF);
    let watchdog = (causes & IWDGRSTF != 0).then_some(Crash::Watchdog);
    trap::take().or(watchdog)
}
