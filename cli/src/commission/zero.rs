//! `plumb zero`: the slopes read 0, or another angle, from now on.
//!
//! In: a machine that stands still; axes, the angle that they are to read, nodes. Out: a line for
//! each slope with what it read before and reads now, or JSON. Everything is looked at before
//! anything is written: an angle has to be valid, and scaling (bit 1 of 6111h) has to be on, since
//! a preset that is written without it is stored and not shown.
//!
//! The two channels compare their angles without preset and offset, so a zero on one of them
//! alone does not make them disagree; but a machine that reads both would see two angles. So both
//! are zeroed together unless one is named. Safety frames (6210h, 6220h) carry the angle as
//! measured: a zero does not touch them.
//!
//! Left out: 6912h and 6922h, the other channel's slopes as this one shows them.

use std::process::ExitCode;
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::{Args, ValueEnum};
use serde::Serialize;

use super::common::CommonOptions;
use super::error::CommissionError;
use bus_master::Bus;
use bus_master::node::Node;
use codes::name::{self, Named};
use codes::value::{self, decimal};
use output::object;

/// Bit of 6111h: preset and offsets count.
const SCALING: u32 = 2;

/// 2025h of an axis that the instrument does not have.
const NOT_MEASURED: u32 = 6;

/// 2025h of an axis while the two channels are set to show different angles, and how long they may
/// take to be alike again behind the writes: each tells the other in pieces.
const UNLIKE: u32 = 20;
const ALIKE: Duration = Duration::from_secs(3);

/// How long the slope has to be measured anew behind the write.
const SETTLING: Duration = Duration::from_millis(100);

/// Readings behind the write, whose mean is told.
const READINGS: u32 = 16;

/// Between two of them.
const BETWEEN: Duration = Duration::from_millis(20);

/// A preset takes the reading of its moment, with its noise. So it is written again until what it
/// took is this near to the mean, deg, at most so many times; each time it may be this much
/// farther off, so that a machine that shakes is zeroed as well.
const NEAR_DEG: f64 = 0.005;
const TRIES: u32 = 50;
const FARTHER: f64 = 1.1;

/// What is zeroed.
#[derive(Clone, Debug, Args)]
pub struct Arguments {
    /// Which slopes
    #[arg(long, value_enum, default_value_t = Axis::Both)]
    pub axis: Axis,
    /// What they are to read
    #[arg(
        long,
        default_value = "0deg",
        allow_hyphen_values = true,
        value_name = "ANGLE"
    )]
    pub to: String,
    /// Turn scaling on where it is off
    #[arg(long)]
    pub enable_scaling: bool,
    /// Which nodes; both channels of the instrument when not given
    #[command(flatten)]
    pub common: CommonOptions,
}

/// Which slopes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Axis {
    /// Slope long
    X,
    /// Slope lateral
    Y,
    /// Both, or the one that there is
    Both,
}

/// One slope of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum Slope {
    X,
    Y,
}

impl Slope {
    const fn index(self) -> u16 {
        match self {
            Self::X => 0x6110,
            Self::Y => 0x6120,
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::X => "slope-long",
            Self::Y => "slope-lateral",
        }
    }

    /// Sub-index of 2025h, and the bit of 2020h.
    const fn sub(self) -> u8 {
        match self {
            Self::X => 1,
            Self::Y => 2,
        }
    }
}

/// A slope that was zeroed.
#[derive(Clone, Debug, Serialize)]
struct Zeroed {
    node: u8,
    axis: Slope,
    before_deg: Option<f64>,
    after_deg: Option<f64>,
    offset_deg: Option<f64>,
    /// 6111h or 6121h has scaling on now, as a preset needs it.
    scaling_enabled: bool,
    /// It was off before.
    scaling_was_off: bool,
    #[serde(skip)]
    step_deg: f64,
    /// In steps.
    #[serde(skip)]
    preset: i64,
}

/// What is to be done to one slope.
#[derive(Clone, Debug)]
struct Plan {
    node: u8,
    slope: Slope,
    /// 6111h as it has to be first, where it has to change.
    operating: Option<u8>,
    /// The preset in steps.
    preset: i64,
    /// One of these.
    step_deg: f64,
}

/// Zeroes and prints.
///
/// Errors: see [`CommissionError`]; nothing was written unless the bus failed in the middle, and
/// what was is printed.
pub fn run(arguments: &Arguments) -> Result<ExitCode, CommissionError> {
    let mut bus = arguments.common.join()?;
    let nodes = arguments.common.nodes.whole(&mut bus)?;
    if arguments.common.nodes.node.is_none() && nodes.len() > 2 {
        return Err(CommissionError::Instruments(nodes));
    }
    let mut plans = Vec::new();
    for node in &nodes {
        plans.extend(plan(&mut bus, *node, arguments)?);
    }
    let answer = arguments.common.answer("plumb-zero");
    let (mut done, ended) = answer.each(&plans, |plan| write(&mut bus, plan), |_| String::new());
    sleep(SETTLING);
    let ended = done.iter_mut().try_fold(ended, |ended, zeroed| {
        // What ended the writes shows more than what goes wrong now.
        let ended = ended.and(read_back(&mut bus, zeroed));
        answer.say(line(zeroed))?;
        Ok::<_, CommissionError>(ended)
    })?;
    if ended.is_ok() && !arguments.common.json {
        answer.say(to_do(&mut bus, &nodes)?)?;
    }
    let content = object! { slopes: &done, to_be_saved: true };
    answer.end(&bus, ended, done.is_empty(), content)
}

/// What is left to be done to these nodes and their other channels.
fn to_do(bus: &mut Bus, nodes: &[u8]) -> Result<String, CommissionError> {
    let mut text = String::new();
    for node in nodes {
        text += &left_out(bus, *node, nodes)?;
    }
    let names: Vec<_> = nodes.iter().map(u8::to_string).collect();
    let names = names.join(",");
    Ok(text + &format!("not saved yet: plumb save --only profile --node {names}\n"))
}

/// Looks at a node; nothing is written.
fn plan(bus: &mut Bus, id: u8, arguments: &Arguments) -> Result<Vec<Plan>, CommissionError> {
    let mut node = Node::new(bus, id);
    let slopes: &[Slope] = match arguments.axis {
        Axis::X => &[Slope::X],
        Axis::Y => &[Slope::Y],
        Axis::Both => &[Slope::X, Slope::Y],
    };
    let validity = node
        .number(0x2020, 0)?
        .ok_or(CommissionError::NoSlopes(id))?;
    let mut plans = Vec::new();
    for slope in slopes {
        let reason = node.number(0x2025, slope.sub())?.unwrap_or(0);
        let absent = arguments.axis == Axis::Both && reason == NOT_MEASURED;
        // One angle of 360 deg is slope X alone.
        if absent && *slope == Slope::Y {
            continue;
        }
        // A zero of both is what ends that they show different angles.
        if validity & u32::from(slope.sub()) == 0 && reason != UNLIKE {
            let reason = u8::try_from(reason).unwrap_or(u8::MAX);
            return Err(CommissionError::Invalid(id, slope.name(), reason));
        }
        plans.push(plan_slope(&mut node, *slope, arguments)?);
    }
    Ok(plans)
}

fn plan_slope(
    node: &mut Node,
    slope: Slope,
    arguments: &Arguments,
) -> Result<Plan, CommissionError> {
    let id = node.id;
    let index = slope.index() + 1;
    let operating = node
        .number(index, 0)?
        .ok_or(CommissionError::NoSlopes(id))?;
    let is_on = operating & SCALING != 0;
    if !is_on && !arguments.enable_scaling {
        return Err(CommissionError::Scaling(id, slope.name(), index));
    }
    let preset = object(slope.index() + 2)?;
    let resolution = node.resolution(&preset)?;
    let row = preset.row.ok_or(CommissionError::NoSlopes(id))?;
    let number = value::parse(&preset, row, &arguments.to, false, resolution);
    Ok(Plan {
        node: id,
        slope,
        operating: (!is_on).then_some((operating | SCALING) as u8),
        preset: number?,
        step_deg: value::scale(row, resolution).factor,
    })
}

/// An object of our dictionary.
fn object(index: u16) -> Result<Named, CommissionError> {
    let named = name::one(&name::address(index, 0));
    named.map_err(|_| CommissionError::NoSlopes(0))
}

/// Writes one slope; what it reads then comes when all are written.
fn write(bus: &mut Bus, plan: &Plan) -> Result<Zeroed, CommissionError> {
    let mut node = Node::new(bus, plan.node);
    let index = plan.slope.index();
    let before = angle(&mut node, index)?;
    if let Some(operating) = plan.operating {
        node.write(index + 1, 0, &[operating])?;
    }
    write_preset(&mut node, index + 2, plan.preset)?;
    Ok(Zeroed {
        node: plan.node,
        axis: plan.slope,
        before_deg: before,
        after_deg: None,
        offset_deg: None,
        scaling_enabled: true,
        scaling_was_off: plan.operating.is_some(),
        step_deg: plan.step_deg,
        preset: plan.preset,
    })
}

fn write_preset(node: &mut Node, index: u16, preset: i64) -> Result<(), CommissionError> {
    let row = object(index)?.row;
    let row = row.ok_or(CommissionError::NoSlopes(node.id))?;
    Ok(node.write(index, 0, &value::bytes(row.data_type, preset))?)
}

/// What a slope that was written reads now.
fn read_back(bus: &mut Bus, zeroed: &mut Zeroed) -> Result<(), CommissionError> {
    let mut node = Node::new(bus, zeroed.node);
    let index = zeroed.axis.index();
    zeroed.offset_deg = angle(&mut node, index + 3)?;
    let until = Instant::now() + ALIKE;
    while node.number(0x2025, zeroed.axis.sub())? == Some(UNLIKE) && Instant::now() < until {
        sleep(BETWEEN);
    }
    zeroed.after_deg = mean(&mut node, index)?;
    if take_noise_out(&mut node, zeroed)? {
        sleep(SETTLING);
        zeroed.after_deg = mean(&mut node, index)?;
    }
    Ok(())
}

/// Writes a preset again until it has taken what the mean of the readings was; true where that was
/// necessary.
fn take_noise_out(node: &mut Node, zeroed: &mut Zeroed) -> Result<bool, CommissionError> {
    let index = zeroed.axis.index();
    let (Some(first), Some(mean)) = (zeroed.offset_deg, zeroed.after_deg) else {
        return Ok(false);
    };
    let off_deg = calibrate::wrap(mean - zeroed.preset as f64 * zeroed.step_deg);
    let mut near = NEAR_DEG.max(zeroed.step_deg / 2.0);
    for repeated in 0..TRIES {
        let off_deg = zeroed.offset_deg.map(|offset| off_deg + offset - first);
        if off_deg.is_none_or(|off_deg| calibrate::wrap(off_deg).abs() <= near) {
            return Ok(repeated > 0);
        }
        sleep(BETWEEN);
        write_preset(node, index + 2, zeroed.preset)?;
        zeroed.offset_deg = angle(node, index + 3)?;
        near *= FARTHER;
    }
    Ok(true)
}

/// What becomes of the other channel of a node, when that is not among `nodes`.
fn left_out(bus: &mut Bus, id: u8, nodes: &[u8]) -> Result<String, CommissionError> {
    let mut node = Node::new(bus, id);
    let peer = node.number(0x2001, 0)?.unwrap_or(0);
    let compares = node.number(0x2006, 0)?.unwrap_or(0) != 0;
    let is_among = nodes.iter().any(|node| u32::from(*node) == peer);
    if is_among || peer == 0 || !compares {
        return Ok(String::new());
    }
    Ok(format!(
        "node {peer}, the other channel of node {id}, was not zeroed: two seconds of different \
         angles make both invalid (2006h)\n"
    ))
}

/// A slope or one of its parameters, in degrees.
fn angle(node: &mut Node, index: u16) -> Result<Option<f64>, CommissionError> {
    let shown = node.shown(&object(index)?)?;
    Ok(shown.ok().and_then(|(_, shown)| shown.value))
}

/// The mean of some readings, since single ones scatter by the noise of the sensor; `None` where
/// one of them is none.
fn mean(node: &mut Node, index: u16) -> Result<Option<f64>, CommissionError> {
    let mut readings = Vec::new();
    for _ in 0..READINGS {
        sleep(BETWEEN);
        match angle(node, index)? {
            Some(reading) => readings.push(reading),
            None => return Ok(None),
        }
    }
    Ok(mean_angle(&readings))
}

/// The mean of readings, as they are written: an angle of the full circle has its seam at
/// +-180 deg, or at 0 deg and 360 deg.
fn mean_angle(readings: &[f64]) -> Option<f64> {
    let mean = calibrate::mean_near(readings)?;
    let low = readings.iter().copied().fold(f64::INFINITY, f64::min);
    let high = readings.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    Some(match (high - low > 180.0, low < 0.0) {
        // No seam: a slope of two axes may even have an offset beyond 180 deg.
        (false, _) => mean,
        (true, true) => calibrate::wrap(mean),
        (true, false) => mean.rem_euclid(360.0),
    })
}

fn line(done: &Zeroed) -> String {
    let angle = |angle: Option<f64>| match angle {
        Some(angle) => format!("{} deg", decimal(angle, done.step_deg)),
        None => "no angle".to_owned(),
    };
    let scaling = if done.scaling_was_off {
        ", scaling is on now"
    } else {
        ""
    };
    format!(
        "node {}: {} read {}, reads {} now in the mean of {READINGS} (offset {}){scaling}\n",
        done.node,
        done.axis.name(),
        angle(done.before_deg),
        angle(done.after_deg),
        angle(done.offset_deg)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_readings_on_both_sides_of_180_deg_was_an_angle_far_away() {
        let near = |readings: &[f64], expected: f64| {
            let mean = mean_angle(readings).unwrap();
            assert!((mean - expected).abs() < 1e-9, "{readings:?}: {mean}");
        };
        near(&[179.97, -179.97, -179.97, -179.97], -179.985);
        near(&[-179.97, 179.97, 179.97, 179.97], 179.985);
        near(&[-179.99, 179.98, 179.98], 179.99);
        near(&[0.01, 359.98, 359.98], 359.99);
        near(&[359.99, 0.02, 0.02], 0.01);
        near(&[-0.01, 0.02, 0.02], 0.01);
        // Neither of these has a seam.
        near(&[194.99, 195.01], 195.0);
        near(&[-90.0, -89.0], -89.5);
        assert_eq!(mean_angle(&[]), None);
    }
}
