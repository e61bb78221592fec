//! How things stand: truth, nodes and verdicts as text.
//!
//! In: the stage. Out: a line for the housing and the bus, one for each node as it sees itself and
//! its peer, and one more for each node in which something is broken.
//!
//! Left out: what the nodes tell on the bus in more detail, which is a client's to read; supplies
//! and memories that are broken, which don't show it.

use std::fmt::Write as _;

use codes::words::{self, because};
use device::objects::process::Shown;
use sim::fault::{NodeFault, RateFault, SensorFault};
use sim::lis2dw12::Fault;
use sim::network::{Network, NetworkNode};
use tilt::angle::Angle;

use super::stage::Stage;
use crate::words::reader::node_name;
use crate::words::trouble::{FAULTS, Trouble};

/// The lines.
pub fn text(stage: &Stage) -> String {
    let ([x, y], [air_c, die_c]) = stage.truth();
    let network = &stage.network;
    let mut text = format!(
        "{:.3} s: pitch {y:.3} deg, roll {x:.3} deg, air {air_c:.1} degC, sensors {die_c:.1} \
         degC, bus load {} %\n",
        network.now_s(),
        network.load_percent()
    );
    for (number, unit) in network.nodes().iter().enumerate() {
        let name = node_name(number);
        // Writing to a string does not fail.
        let halted = network.fault(number) == Some(NodeFault::Halted);
        let node = if halted {
            "halted".to_owned()
        } else {
            node(unit, network.now_ns())
        };
        let _ = writeln!(text, "  {name:<4}{node}");
        let broken = broken(network, number);
        if !broken.is_empty() {
            let _ = writeln!(text, "      broken: {}", broken.join("; "));
        }
    }
    for number in 0..network.node_count() {
        if let Some(powered) = network.guest_power(number) {
            let name = node_name(number);
            let state = if powered {
                "emulated"
            } else {
                "emulated, without power"
            };
            let _ = writeln!(text, "  {name:<4}{state}");
        }
    }
    text
}

/// What is broken in a node, whether it has noticed or not.
fn broken(network: &Network, number: usize) -> Vec<String> {
    let Some(unit) = network.nodes().get(number) else {
        return Vec::new();
    };
    let electronics = &unit.electronics;
    let part = electronics.part_fault();
    let loose_g = Some(electronics.offset_g[0]).filter(|g| *g != 0.0);
    let all = [
        part.map(|fault| part_name(fault).to_owned()),
        loose_g.map(|g| format!("offset {} mg", (g * 1e6).round() / 1e3)),
        electronics.fault().map(sensor_name),
        network.fault(number).map(|fault| fault.to_string()),
    ];
    all.into_iter().flatten().collect()
}

/// A fault of the sensor with its axis; `stuck` is a word for another one.
fn sensor_name(fault: SensorFault) -> String {
    let name = |axis: usize| ["x", "y", "z"].get(axis).copied().unwrap_or("no axis");
    match fault {
        SensorFault::Stuck { axis: None } => "frozen".to_owned(),
        SensorFault::Stuck { axis: Some(axis) } => format!("frozen {}", name(axis)),
        SensorFault::Bias { axis, .. }
        | SensorFault::Drift { axis, .. }
        | SensorFault::Gain { axis, .. }
        | SensorFault::Gyroscope(RateFault::Bias { axis, .. }) => {
            format!("{fault} in {}", name(axis))
        }
        _ => fault.to_string(),
    }
}

/// The word that has broken the part.
fn part_name(fault: Fault) -> &'static str {
    let word = FAULTS.name_of(&Trouble::Part(fault));
    word.unwrap_or("write refused")
}

fn node(unit: &NetworkNode, now_ns: u64) -> String {
    if !unit.is_powered() {
        return "without power".to_owned();
    }
    if !unit.is_running() {
        return "starting".to_owned();
    }
    let device = &unit.device;
    let shown = unit.shown(now_ns);
    let [x, y] = [0, 1].map(|axis| shown.slope(axis));
    let [no_x, no_y] = [0, 1].map(|axis| shown.reason(axis));
    let id = match device.bus().node_id() {
        255 => "no node-id".to_owned(),
        id => format!("node-id {id}"),
    };
    let faults: Vec<_> = device.faults().iter().map(|f| f.text()).collect();
    let faults = match faults.as_slice() {
        [] => "no fault".to_owned(),
        faults => faults.join("; "),
    };
    format!(
        "{id}, {}, pitch {}, roll {}, {}, {faults}",
        words::nmt(device.bus().state()),
        degrees(y, no_y),
        degrees(x, no_x),
        verdict(&shown)
    )
}

fn degrees(angle: Option<Angle>, reason: u8) -> String {
    match angle {
        Some(angle) => format!("{:.3}", angle.degrees()),
        None => format!("invalid ({})", because(reason)),
    }
}

/// Objects 2021h and 2027h in words: the state of the pair, which channel is blamed, and why.
fn verdict(shown: &Shown<'_>) -> String {
    let state = words::state(shown.state(), words::CHANNELS);
    match shown.blame().1 {
        0 => state.into_owned(),
        why => format!("{state} ({})", because(why)),
    }
}
