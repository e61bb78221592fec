//! Two nodes on one bus, as a master sees them.

use super::*;

use canopen::Frame;
use device::channel::Settings;
use device::objects::panel::Identity;
use device::objects::table::Channel;
use tilt::calibration::motor as _;

use crate::bench::Mode;
use crate::error_model::ErrorModel;
use crate::motion::Motion;
use crate::rng::Rng;

/// A housing that stands level, or is held in any pose.
struct Held([f64; 3]);

impl Mover for Held {
    fn step(&mut self, _time_s: f64) -> Motion {
        Motion {
            force_g: self.0,
            ..Motion::default()
        }
    }
}

fn factory(channel: Channel, settings: Settings) -> Factory {
    Factory {
        identity: Identity {
            channel,
            serial: 100 + channel as u32,
        },
        node_id: channel.node_id(),
        kbit_s: 250,
        terms: device::calibration::motor::Terms {
            rule: tilt::table::Rule::Nearest,
            budget: settings.chain.calibration.budget,
        },
        settings,
        calibrated: true,
    }
}

fn pair() -> Network {
    let mut network = Network::new(250_000, 1);
    for channel in [Channel::A, Channel::B] {
        let rng = Rng::stream(1, &format!("network {channel:?}"));
        let electronics = Electronics::new(&ErrorModel::NOMINAL, rng);
        let factory = factory(channel, Mode::Product.settings());
        let check = Mode::Product.check();
        network.add(electronics, check, factory, Memory::new());
    }
    network
}

#[test]
fn a_pair_boots_measures_and_agrees() {
    let mut network = pair();
    let host = network.attach_host();
    network.power_on(0);
    network.power_on(1);
    let mut frames = Vec::new();
    let mut note = |event: &Event| {
        if let Event::Delivered { frame, at_ns, .. } = event {
            frames.push((*at_ns, *frame));
        }
    };
    network.run_until(&mut Held([0.0, 0.0, 1.0]), 200_000_000, &mut note);
    network
        .bus
        .offer(host, Frame::data_frame(0, &[1, 0]))
        .unwrap();
    network.run_until(&mut Held([0.0, 0.0, 1.0]), 2_000_000_000, &mut note);
    for (at, f) in frames.iter().skip(62).take(60) {
        println!(
            "{:9.3} ms {:03X} {:02X?}",
            *at as f64 * 1e-6,
            f.cob_id().unwrap(),
            f.bytes()
        );
    }
    for unit in network.units() {
        println!("{:?}", unit.device.values().process);
        println!("{:?}", unit.device.faults());
    }
    panic!();
}
