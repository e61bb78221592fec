//! What each word does to the virtual instrument.
//!
//! In: a [`Word`], and the stage. Out: another stage, and what there is to tell; or why nothing
//! has changed.
//!
//! Left out: when a word is carried out (`agenda`, `server`).

use canopen::Frame;
use sim::can_bus::{Rates, TransmitOrder};
use sim::chamber::Chamber;
use sim::fault::{NodeFault, SensorFault};
use sim::network::guest::Switch;
use sim::supply::Supply;

use super::stage::Stage;
use super::status;
use crate::words::line::{BusTrouble, Word, help};
use crate::words::reader::WordError;
use crate::words::trouble::Trouble;

/// What a word came to.
#[derive(Clone, Debug, PartialEq)]
pub enum Done {
    /// Done, with nothing to tell.
    Quietly,
    /// Something to tell.
    Told(String),
    /// The end was asked for.
    Quit,
}

impl Stage {
    /// Carries out a word, now.
    ///
    /// Errors: [`WordError::Impossible`], [`WordError::ScriptOnly`], [`WordError::Beyond`] and
    /// [`WordError::NoGyroscope`]; nothing has changed then.
    pub fn obey(&mut self, word: &Word) -> Result<Done, WordError> {
        match word {
            Word::Pitch(_) | Word::Roll(_) | Word::Level => self.turn(word)?,
            Word::Rate(deg_s) => self.hand.set_rate(*deg_s),
            Word::Vibration(rms_g) => self.hand.set_vibration(*rms_g),
            Word::Temperature(celsius, at_once) => self.temper(*celsius, *at_once),
            Word::Bus(trouble) => self.trouble_bus(*trouble),
            Word::Babble(id) => self.babble(*id),
            Word::BitRate(kbit_s) => {
                let rate = u32::from(*kbit_s) * 1000;
                self.network.bus.set_bit_rate(self.adapter.port, rate);
            }
            Word::Fault(nodes, trouble) if self.is_beyond(&nodes.0, *trouble) => {
                return Err(WordError::Beyond);
            }
            Word::Fault(nodes, Trouble::Sensor(SensorFault::Gyroscope(_)))
                if nodes.0.iter().any(|n| self.is_without_gyroscope(*n)) =>
            {
                return Err(WordError::NoGyroscope);
            }
            Word::Fault(nodes, trouble) => nodes.0.iter().for_each(|n| self.trouble(*n, *trouble)),
            Word::Heal(nodes) => nodes.0.iter().for_each(|n| self.heal(*n)),
            Word::Switch(nodes, switch) => nodes.0.iter().for_each(|n| self.switch(*n, *switch)),
            Word::Status => return Ok(Done::Told(status::text(self))),
            Word::Help => return Ok(Done::Told(help())),
            Word::Quit => return Ok(Done::Quit),
            Word::Wait(_) | Word::Hold | Word::Repeat => return Err(WordError::ScriptOnly),
        }
        Ok(Done::Quietly)
    }

    fn is_without_gyroscope(&mut self, number: usize) -> bool {
        self.network.electronics(number).gyroscope().is_none()
    }

    fn turn(&mut self, word: &Word) -> Result<(), WordError> {
        let target = self.hand.target();
        let pose = word.pose(target).unwrap_or(target);
        match self.hand.go(pose) {
            true => Ok(()),
            false => Err(WordError::Impossible(pose)),
        }
    }

    fn temper(&mut self, celsius: f64, at_once: bool) {
        if at_once {
            self.chamber = Chamber::at(celsius);
            self.set_dies(celsius);
        } else {
            self.chamber.set_point(celsius);
        }
    }

    fn trouble_bus(&mut self, trouble: BusTrouble) {
        match trouble {
            BusTrouble::Short(seconds) => {
                let until_ns = self.network.now_ns() + (seconds * 1e9) as u64;
                self.network.bus.short_until(until_ns);
            }
            BusTrouble::Noise(share) => self.rates.corrupt = share,
            BusTrouble::Loss(share) => self.rates.overrun = share,
            BusTrouble::Double(share) => self.rates.last_but_one = share,
            BusTrouble::Heal => self.rates = Rates::default(),
        }
        self.network.bus.faults().set_rates(self.rates);
    }

    fn babble(&mut self, id: Option<u16>) {
        let bus = &mut self.network.bus;
        let frame = id.map(|id| Frame::data_frame(id, &[0xBA; 8]));
        if let (None, Some(_)) = (self.stranger, frame) {
            self.stranger = Some(bus.attach(TransmitOrder::Offered));
        }
        if let Some(port) = self.stranger {
            bus.babble(port, frame);
            // One that has stopped is taken off, so that it acknowledges nothing any more.
            bus.connect(port, frame.is_some());
        }
    }

    /// True for trouble with code or memory of a node that brings its own processor.
    fn is_beyond(&self, nodes: &[usize], trouble: Trouble) -> bool {
        let guests = nodes
            .iter()
            .any(|node| self.network.as_guest(*node).is_some());
        guests && matches!(trouble, Trouble::Memory | Trouble::Node(_))
    }

    fn trouble(&mut self, number: usize, trouble: Trouble) {
        let (now_ns, rng) = (self.network.now_ns(), &mut self.rng);
        let electronics = self.network.electronics(number);
        match trouble {
            Trouble::Part(fault) => electronics.set_part_fault(Some(fault)),
            Trouble::BrownOut => electronics.brown_out(now_ns),
            Trouble::Supply => {
                electronics.supply = Supply::unstable(now_ns as f64 * 1e-9, rng);
            }
            Trouble::Offset(g) => electronics.offset_g = [g, g, 0.0],
            Trouble::Memory => self.break_memory(number, true),
            Trouble::Sensor(fault) => electronics.inject(fault, rng.fork()),
            // Code that does not run can't stand still.
            Trouble::Node(NodeFault::Halted) if !self.network.nodes()[number].is_powered() => {}
            Trouble::Node(fault) => {
                let mut rng = rng.fork();
                self.network.inject(number, fault, &mut rng);
            }
        }
    }

    fn break_memory(&mut self, number: usize, broken: bool) {
        let device = &mut self.network.node(number).device;
        device.memory().flash_mut().set_broken(broken);
    }

    fn heal(&mut self, number: usize) {
        let now_s = self.network.now_s();
        let electronics = self.network.electronics(number);
        electronics.set_part_fault(None);
        electronics.supply.repair(now_s);
        electronics.offset_g = [0.0; 3];
        electronics.heal();
        if self.network.as_guest(number).is_none() {
            self.break_memory(number, false);
            self.network.heal(number);
        }
    }

    /// Does something to a node's power, wires or reset pin; a node that has power keeps it.
    pub fn switch(&mut self, number: usize, switch: Switch) {
        if let Some(guest) = self.network.as_guest(number) {
            if switch != Switch::On || !self.network.guest(guest).is_powered() {
                self.network.switch_guest(guest, switch);
            }
            return;
        }
        let node = &self.network.nodes()[number];
        let (port, is_powered) = (node.port, node.is_powered());
        match switch {
            Switch::On if is_powered => {}
            Switch::On => self.network.power_on(number),
            Switch::Off => {
                self.end_halt(number);
                self.network.power_off(number);
            }
            Switch::Reset if self.end_halt(number) => {}
            Switch::Reset => self.network.reset(number),
            Switch::Connect | Switch::Cut => {
                self.network.bus.connect(port, switch == Switch::Connect);
            }
        }
    }

    /// Code that stood still starts anew with a reset, and doesn't wait to be healed; true then.
    fn end_halt(&mut self, number: usize) -> bool {
        let halted = self.network.fault(number) == Some(NodeFault::Halted);
        if halted {
            self.network.heal(number);
        }
        halted
    }
}
