//! The parts of the virtual instrument once more, beside the bus: what its gyroscopes really do.
//!
//! In: the seed of `plumb serve` and a temperature. Out: of each node what its gyroscope makes of a
//! turn about each axis of the housing.
//!
//! Left out: bias and noise, which both ways of a turn and its length take out.

use calibrate::session::{decode, encode};
use sim::bench::{Mode, World};
use sim::instrument::Instrument;
use sim::motion::Motion;

/// What a gyroscope does at one temperature.
#[derive(Clone, Copy)]
pub struct Response {
    /// Measured rate, sensor axis by housing axis.
    pub measured: [[f64; 3]; 3],
    /// The temperature that the node believes, degC.
    pub celsius: f64,
}

/// The rate of a turn, deg/s, and the samples of the bench that it takes.
const RATE_DPS: f64 = 100.0;
const TICKS: usize = 10_000;

/// Of both nodes of unit 0, A first, at this temperature, degC.
pub fn responses(seed: u64, degc: f64) -> [Response; 2] {
    let (mode, world) = (Mode::Dynamic, World::NOMINAL);
    let (settings, parts) = (world.settings(mode), world.parts_of(mode));
    let mut instrument = Instrument::new(&settings, &mode.check(), &parts, seed, 0);
    instrument.start();
    heat(&mut instrument, degc);
    let mut measured = [[[0.0; 3]; 3]; 2];
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let sums = turned(&mut instrument, axis, sign * RATE_DPS);
            for (measured, sum) in measured.iter_mut().zip(sums) {
                for (row, mean) in measured.iter_mut().zip(sum) {
                    row[axis] += sign * mean / 2.0 / RATE_DPS.to_radians();
                }
            }
        }
    }
    [0, 1].map(|node| {
        let believed = instrument.sides[node].node.channel.temperature().unwrap();
        Response {
            measured: measured[node],
            celsius: f64::from(believed.0) / 256.0,
        }
    })
}

/// By 2 degC/s: a node does not believe a jump.
fn heat(instrument: &mut Instrument, degc: f64) {
    let mut now = 25.0_f64;
    while now != degc {
        now += (degc - now).clamp(-0.002, 0.002);
        instrument.set_die_temperature(now);
        instrument.tick(&motion([0.0; 3]));
    }
    (0..3000).for_each(|_| instrument.tick(&motion([0.0; 3])));
}

fn motion(rate_dps: [f64; 3]) -> Motion {
    Motion {
        force_g: [0.0, 0.0, 1.0],
        rate_dps,
        ..Motion::default()
    }
}

/// The mean rate of both nodes while the housing turns about an axis, rad/s.
fn turned(instrument: &mut Instrument, axis: usize, rate_dps: f64) -> [[f64; 3]; 2] {
    let mut rate = [0.0; 3];
    rate[axis] = rate_dps;
    // What is in the part's filter is out first.
    (0..200).for_each(|_| instrument.tick(&motion(rate)));
    let sums = |instrument: &Instrument| {
        [0, 1].map(|node| instrument.sides[node].node.channel.measured_sum())
    };
    let before = sums(instrument);
    (0..TICKS).for_each(|_| instrument.tick(&motion(rate)));
    let after = sums(instrument);
    [0, 1].map(|node| {
        let (before, after) = (before[node], after[node]);
        let count = f64::from(after.samples.wrapping_sub(before.samples));
        [0, 1, 2].map(|axis| {
            let sum = after.sum[axis].wrapping_sub(before.sum[axis]);
            f64::from(sum) / 65_536.0 / count
        })
    })
}

/// How far the scale of each node's axes is off at its temperature, with the corrections that a
/// file of `--keep` has.
pub fn scale_errors(kept: &str, responses: &[Response; 2]) -> [[f64; 3]; 2] {
    let kept: serde_json::Value = serde_json::from_str(kept).unwrap();
    [0, 1].map(|node| {
        let hex = kept["nodes"][node]["calibration_hex"].as_str().unwrap();
        let bytes = output::hex::bytes(hex).unwrap();
        let rates = decode(&bytes).unwrap().rates.unwrap();
        let (real, response) = (rates.real(), responses[node]);
        [0, 1, 2].map(|axis| {
            let felt = response.measured.map(|row| row[axis]);
            let scaled = [0, 1, 2].map(|n| {
                let scale = 1.0 + real.scale1[n] * (response.celsius - 25.0);
                real.matrix[axis][n] * scale * felt[n]
            });
            scaled.iter().sum::<f64>() - 1.0
        })
    })
}

/// The same file without slopes of the gyroscopes' scale, as if none had been turned in a chamber.
pub fn without_slopes(kept: &str) -> String {
    let mut kept: serde_json::Value = serde_json::from_str(kept).unwrap();
    for node in kept["nodes"].as_array_mut().unwrap() {
        let bytes = output::hex::bytes(node["calibration_hex"].as_str().unwrap()).unwrap();
        let mut calibration = decode(&bytes).unwrap();
        let rates = calibration.rates.as_mut().unwrap();
        rates.scale1_q38 = [0; 3];
        let bytes = encode(&calibration);
        let sum = bytes.last_chunk::<4>().unwrap();
        node["crc32"] = format!("{:08X}", u32::from_le_bytes(*sum)).into();
        node["calibration_hex"] = output::hex::digits(&bytes).into();
        node["report_sha256"] = serde_json::Value::Null;
    }
    kept.to_string()
}
