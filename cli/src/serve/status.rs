//! How things stand: truth, nodes and verdicts as text.
//!
//! In: the stage. Out: a line for the housing, one for the bus, and one for each node.
//!
//! Left out: what the nodes tell on the bus in more detail; that is a client's to read.

use std::fmt::Write as _;

use canopen::nmt;
use sim::network::Unit;
use tilt::angle::Angle;

use super::stage::Stage;
use super::words::node_name;

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
    for (number, unit) in network.units().iter().enumerate() {
        let name = node_name(number);
        // Writing to a string does not fail.
        let _ = writeln!(text, "  {name:<4}{}", node(unit));
    }
    text
}

fn node(unit: &Unit) -> String {
    if !unit.is_powered() {
        return "without power".to_owned();
    }
    if !unit.is_running() {
        return "starting".to_owned();
    }
    let device = &unit.device;
    let process = &device.values().process;
    let [x, y, ..] = process.slopes;
    let id = match device.bus().node_id() {
        255 => "no node-id".to_owned(),
        id => format!("node-id {id}"),
    };
    let faults: Vec<_> = device.faults().iter().map(|f| f.report().2).collect();
    let faults = match faults.as_slice() {
        [] => "no fault".to_owned(),
        faults => faults.join("; "),
    };
    format!(
        "{id}, {}, pitch {}, roll {}, {}, {faults}",
        state(device.bus().state()),
        degrees(y),
        degrees(x),
        verdict(process.state)
    )
}

fn state(state: nmt::State) -> &'static str {
    match state {
        nmt::State::Initialising => "initialising",
        nmt::State::Stopped => "stopped",
        nmt::State::Operational => "operational",
        nmt::State::PreOperational => "pre-operational",
    }
}

fn degrees(angle: Option<Angle>) -> String {
    angle.map_or("invalid".to_owned(), |a| format!("{:.3}", a.degrees()))
}

/// Object 2021h in words.
fn verdict(code: u8) -> &'static str {
    match code {
        0 => "not compared",
        1 => "both agree",
        2 => "they differ, not for long",
        3 => "stop the motion",
        4 => "data were late",
        5 => "physical fault",
        6 => "they differ for too long",
        7 => "this channel is ill",
        8 => "the other channel is ill",
        _ => "neither measures",
    }
}
