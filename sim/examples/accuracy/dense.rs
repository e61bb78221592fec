//! The other reading of table and rule: the nearest point of a denser table (assumption A1).
//!
//! The paper states that the motor moves and the node memorises at the same time, and gives the
//! motor's speed, 1 deg in 1500 ms: at 50 samples a second that is up to 75 points a degree. Here
//! the motor turns without a stop and each point is the one sample nearest to its angle. Readings
//! are those of paper mode, carried back through its straight lines to the acceleration that they
//! came from, so that both tables see the very same samples.

use std::fmt::Write as _;

use sim::bench::dynamic_test::DynamicPoint;
use sim::bench::statistics::{Tally, median};
use sim::bench::{Bench, BenchError, Mode, World};
use sim::rig::Mount;
use tilt::chain::Correction;
use tilt::table::{Point, Table};

use crate::{SEED, Scale, shared};

/// Degrees between two points; the last is one sample of the motor's turn.
const STEPS_DEG: [f64; 5] = [1.0, 0.5, 0.2, 0.1, 1.0 / 75.0];
/// Speed of the motor, deg/s, and time between two samples, s.
const SPEED_DEG_S: f64 = 1.0 / 1.5;
const SAMPLE_S: f64 = 0.02;
/// Flash of a point whose angle follows from its place: the acceleration in 16 bits.
const POINT_BYTES: f64 = 2.0;
/// Random angles of the static reading, and how far they go, deg.
const ANGLES: usize = 40;
const RANGE_DEG: f64 = 80.0;

/// Accelerations memorised in motion with the motor's angle, deg, in rising order.
type Memorised = Vec<(i32, f64)>;

fn memorise(bench: &mut Bench) -> Result<[Memorised; 2], BenchError> {
    bench.mount(Mount::X, 0.0, 0.0);
    bench.turn_to(-91.0, 40.0, 2.0);
    let arrival_s = bench.rig.command(91.0, SPEED_DEG_S).unwrap_or(0.0);
    let mut memorised = [Memorised::new(), Memorised::new()];
    while bench.instrument.time_s() + SAMPLE_S < arrival_s {
        bench.run(SAMPLE_S);
        let reference_deg = bench.rig.reference_deg();
        for (node, list) in memorised.iter_mut().enumerate() {
            let side = &bench.instrument.sides[node];
            let channel = &side.node.channel;
            let (Some((filtered, _)), Some(temperature)) =
                (channel.filtered(), channel.temperature())
            else {
                let step = "memorising in motion";
                return Err(BenchError::Silent {
                    step,
                    node: node + 1,
                });
            };
            let model = &side.settings.chain.calibration.temperature;
            list.push((model.apply(filtered, temperature).accel[0], reference_deg));
        }
    }
    // The motor has to stand before it takes its next order.
    bench.run(1.0);
    Ok(memorised)
}

/// The points of `memorised` nearest to each multiple of `step_deg` from -90 to 90 deg.
fn every(memorised: &Memorised, step_deg: f64) -> Memorised {
    let count = (180.0 / step_deg).round() as u32;
    let of = |i: u32| {
        let wanted_deg = -90.0 + f64::from(i) * step_deg;
        let above = memorised.partition_point(|(_, deg)| *deg < wanted_deg);
        let near = memorised[above.saturating_sub(1)..].iter().take(2);
        let off = |point: &&(i32, f64)| (point.1 - wanted_deg).abs();
        near.min_by(|a, b| off(a).total_cmp(&off(b))).copied()
    };
    (0..=count).filter_map(of).collect()
}

/// The angle of the point whose acceleration is nearest, deg.
fn nearest_deg(points: &Memorised, accel: i32) -> f64 {
    let nearest = points.iter().min_by_key(|(a, _)| a.abs_diff(accel));
    nearest.map_or(f64::NAN, |(_, deg)| *deg)
}

/// The acceleration at which the straight lines of `table` give `deg`.
fn accel_at(table: &Table, deg: f64) -> i32 {
    let points = table.points();
    let above = points.partition_point(|p| p.angle.degrees() <= deg);
    let above = above.clamp(1, points.len() - 1);
    let (low, high): (Point, Point) = (points[above - 1], points[above]);
    let share = (deg - low.angle.degrees()) / high.angle.minus(low.angle).degrees();
    low.accel + (share * f64::from(high.accel - low.accel)).round() as i32
}

/// Errors of the straight line and of each dense table, deg: at standstill and in the swing.
type Errors = [[Tally; 2]; STEPS_DEG.len() + 1];

fn unit(unit: u32) -> Result<Errors, BenchError> {
    let (mut bench, _) = Bench::commissioned(Mode::Paper, &World::NOMINAL, SEED, unit)?;
    let memorised = memorise(&mut bench)?;
    let dense = memorised.map(|list| STEPS_DEG.map(|step_deg| every(&list, step_deg)));
    let line = [0, 1].map(|node| {
        match &bench.instrument.sides[node]
            .settings
            .chain
            .calibration
            .correction
        {
            Correction::Tables { tables, .. } => tables.x.clone(),
            _ => Table::default(),
        }
    });
    let mut errors = Errors::default();
    let mut add = |kind: usize, node: usize, read_deg: f64, truth_deg: f64| {
        errors[0][kind].add(read_deg - truth_deg);
        let accel = accel_at(&line[node], read_deg);
        for (tallies, points) in errors[1..].iter_mut().zip(&dense[node]) {
            tallies[kind].add(nearest_deg(points, accel) - truth_deg);
        }
    };
    let angles = bench.random_angles(ANGLES, RANGE_DEG);
    for point in bench.static_test(Mount::X, &angles) {
        for (node, read) in point.nodes.iter().enumerate() {
            add(0, node, read.angle_deg.unwrap_or(f64::NAN), point.truth_deg);
        }
    }
    for DynamicPoint {
        nodes_deg,
        truth_then_deg,
        ..
    } in bench.dynamic_test(Mount::X, 0.0).points
    {
        for node in 0..2 {
            let read_deg = nodes_deg[node].unwrap_or(f64::NAN);
            add(1, node, read_deg, truth_then_deg[node]);
        }
    }
    Ok(errors)
}

/// Both readings of table and rule, side by side.
pub fn section(page: &mut String, scale: &Scale) -> Result<(), BenchError> {
    let units = shared(scale.assumed, unit)?;
    let _ = writeln!(
        page,
        "### Table and rule (A1): straight lines, or a denser table\n\nSlope X, {} units. The \
         dense tables are memorised while the motor turns, one sample a point, and read by the \
         nearest point; flash is that of both axes with 16 bits a point. Standstill is random \
         angles up to +-{RANGE_DEG:.0} deg.\n\n\
         | table | flash, kB | standstill, RMSE, deg | Table III, aligned, deg |\n\
         |---|---|---|---|",
        units.len()
    );
    let rms = |row: usize, kind: usize| {
        let mut rms: Vec<_> = units.iter().map(|u| u[row][kind].rms()).collect();
        median(&mut rms)
    };
    let names = std::iter::once((String::from("1 deg, straight lines"), 1.0));
    let dense = STEPS_DEG.map(|step| (format!("{step:.3} deg, nearest point"), step));
    for (row, (name, step_deg)) in names.chain(dense).enumerate() {
        let flash_kb = 2.0 * POINT_BYTES * (180.0 / step_deg + 1.0) / 1024.0;
        let _ = writeln!(
            page,
            "| {name} | {flash_kb:.1} | {:.3} | {:.3} |",
            rms(row, 0),
            rms(row, 1)
        );
    }
    Ok(())
}
