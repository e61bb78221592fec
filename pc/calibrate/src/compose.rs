//! From what a round has given to the report of it.
//!
//! In: stands or poses with fits, and who, when and where. Out: a [`Report`], judged.
//!
//! Left out: its forms (`page`, `dcc`) and its hash.

use device::calibration::encoding::{identity, kind};
use tilt::chain::{Calibration, Correction};
use tilt::sample::Temperature;
use tilt::temperature::Compensated;
use tilt::uncertainty::Span;

use super::by_hand::Handled;
use super::by_motor::{Swept, mean_uncertainty_deg};
use super::data::{
    Channel, Contribution, Decision, Difference, Environment, FORMAT, Method, Point, Pose,
    Reference, Report, VERSION, now, utc,
};
use super::finish::Common;
use super::fit::Stand;
use super::gyroscope;
use super::hand::{self, POSES};
use super::motor::Axis;
use super::reading::{Reading, wrap};
use super::session::{Node, Session, decode};

/// Standard uncertainty of what the 1/f noise of the sensor does between two stands, deg: 0.04 mg.
const FLOOR_DEG: f64 = 0.0023;

/// Standard uncertainty of the compensation by a temperature that is known to a degree, deg: half a
/// degree either side, uniform, times 0.1 mg/degC of a compensated part. `[ASSUME]`
const TEMPERATURE_DEG: f64 = 0.0017;

/// What is the same in every report.
pub struct Frame<'a> {
    /// What was asked for.
    pub common: &'a Common,
    /// The nodes, as they were found.
    pub session: &'a Session,
    /// Seconds since 1970 at the begin.
    pub begun: u64,
    /// 2061h of each node as it was made.
    pub made: Vec<Vec<u8>>,
    /// Largest error as left that is accepted, deg.
    pub tolerance_deg: f64,
}

impl Frame<'_> {
    /// A report that is not accepted yet; `figures` gives each channel what was found out about it.
    pub fn report(
        &self,
        method: Method,
        reference: Reference,
        temperatures: &[f64],
        figures: impl Fn(usize, &mut Channel),
    ) -> Report {
        let Common {
            laboratory,
            operator,
            customer,
            ..
        } = self.common;
        let tolerance = self.tolerance_deg;
        let extreme = |pick: fn(f64, f64) -> f64| temperatures.iter().copied().reduce(pick);
        let serial = self.session.nodes.first().map_or(0, |node| node.serial);
        let begun_utc = utc(self.begun);
        let stamp: String = begun_utc.chars().filter(|c| !"-:".contains(*c)).collect();
        Report {
            format: FORMAT.to_owned(),
            version: VERSION,
            plumb_version: env!("CARGO_PKG_VERSION").to_owned(),
            identifier: format!("plumb-{serial}-{stamp}"),
            method,
            begun_utc,
            ended_utc: utc(now()),
            laboratory: laboratory.clone(),
            operator: operator.clone(),
            customer: customer.clone(),
            bus: self.session.bus_name().to_owned(),
            reference,
            environment: Environment {
                sensor_min_degc: extreme(f64::min),
                sensor_max_degc: extreme(f64::max),
                statement: "Temperature as measured by the sensors, to a degree. The air's \
                    temperature, humidity and vibration were not measured. The calibration holds \
                    the temperature compensation that each channel had before."
                    .to_owned(),
            },
            decision: Decision {
                tolerance_deg: tolerance,
                rule: format!(
                    "Accepted when each error as left and its expanded uncertainty (k = 2) \
                     together are within {tolerance} deg (guarded acceptance, JCGM 106, 8.3.2)."
                ),
                accepted: false,
                largest_error_deg: None,
            },
            channels: self.channels(figures),
            difference_as_found: Vec::new(),
            difference_as_left: Vec::new(),
            faces: None,
            dcc_sha256: None,
        }
    }

    fn channels(&self, figures: impl Fn(usize, &mut Channel)) -> Vec<Channel> {
        let nodes = self.session.nodes.iter().enumerate();
        let channels = nodes.map(|(place, node)| {
            let mut channel = self.channel(place, node);
            figures(place, &mut channel);
            let combined = Contribution::combined_deg(&channel.uncertainty);
            channel.combined_uncertainty_deg = combined;
            channel.expanded_uncertainty_deg = 2.0 * combined;
            channel
        });
        channels.collect()
    }

    /// A channel without figures.
    fn channel(&self, place: usize, node: &Node) -> Channel {
        let mut channel = Channel {
            channel: node.letter().to_owned(),
            node: node.id,
            serial_number: node.serial,
            product_code: node.product,
            software: node.software.clone(),
            kind: node.kind,
            calibrated_before: node.calibrated,
            as_found_crc32: format!("{:08X}", node.found_sum()),
            as_left_crc32: format!("{:08X}", 0),
            presented: node.presented.clone(),
            ..Channel::default()
        };
        if let Some(made) = self.made.get(place).and_then(|bytes| decode(bytes)) {
            tell(&mut channel, &made);
        }
        channel
    }

    /// The report of a round by motor.
    pub fn by_motor(&self, swept: &Swept, name: &str, reference_deg: f64) -> Report {
        let method = match swept.fits.is_empty() {
            true => Method::MotorTables,
            false => Method::Motor,
        };
        let reference = Reference {
            name: name.to_owned(),
            standard_uncertainty_deg: Some(reference_deg),
            statement:
                "The angle that the motor states is the reference, with the uncertainty that \
                it or the operator states. Level is where the motor's zero is: how the housing is \
                mounted on it goes into the zero of the slopes."
                    .to_owned(),
        };
        let all = swept.found.iter().chain(&swept.left);
        let temperatures: Vec<f64> = all
            .flat_map(|stand| stand.readings.iter().map(|r| r.temperature_c))
            .collect();
        let mut report = self.report(method, reference, &temperatures, |place, channel| {
            let points = |stands: &[Stand]| stands.iter().map(|s| point(s, place)).collect();
            channel.as_found = points(&swept.found);
            channel.as_left = points(&swept.left);
            if let Some(fit) = swept.fits.get(place) {
                channel.condition = Some(fit.condition);
                channel.residual_deg = Some(fit.residual_deg());
                let left = fit.residuals.iter();
                let left =
                    left.map(|(axis, at, left)| Point::new(axis.letter(), *at, Ok(at + left)));
                channel.residuals = left.collect();
            }
            let noise_deg = mean_uncertainty_deg(&swept.left, place);
            let scatter = "scatter of the readings of the verification round";
            channel.uncertainty = vec![
                Contribution::new("Reference", "B", reference_deg, "as the motor states it"),
                Contribution::new("Noise of a mean", "A", noise_deg, scatter),
                floor(),
            ];
        });
        report.difference_as_found = differences(&swept.found);
        report.difference_as_left = differences(&swept.left);
        judge_angles(&mut report);
        report
    }

    /// The report of a round by hand.
    pub fn by_hand(&self, handled: &Handled) -> Report {
        let faces = &handled.faces;
        let zero_deg = faces.zero_uncertainty_deg();
        let all = handled.poses.iter().flatten();
        let temperatures: Vec<f64> = all.map(|reading| reading.temperature_c).collect();
        let gravity = gravity(faces);
        let mut report = self.report(Method::ByHand, gravity, &temperatures, |place, channel| {
            let fit = &handled.fits[place];
            channel.condition = Some(fit.condition);
            channel.residual_mg = Some(fit.length_rms_mg());
            channel.poses = poses(handled, place);
            channel.as_left = zero(handled, place);
            let residual_deg = (fit.length_rms_mg() / 1000.0).to_degrees();
            let turn = "half the surface's tilt times the turn's error";
            let thermometer = "known to a degree only; 0.1 mg/degC, an assumption";
            channel.uncertainty = vec![
                Contribution::new("Fit", "A", residual_deg, "what the poses miss of 1 g"),
                Contribution::new("Turn by 180 deg", "B", zero_deg, turn),
                floor(),
                Contribution::new("Temperature", "B", TEMPERATURE_DEG, thermometer),
            ];
        });
        report.difference_as_left = zero_differences(&report.channels);
        report.faces = Some(super::data::Faces {
            base_surface_deg: faces.base_surface_deg,
            side_surface_deg: faces.side_surface_deg,
            off_square_deg: faces.off_square_deg,
            between_channels_deg: faces.between_deg,
        });
        judge_angles(&mut report);
        report
    }
}

/// Enters the calibration as left into its channel.
fn tell(channel: &mut Channel, made: &Calibration) {
    channel.kind = kind(&made.correction);
    channel.as_left_crc32 = format!("{:08X}", identity(made));
    channel.gyroscope = made.rates.as_ref().map(gyroscope::of);
    let Span { low, high } = made.budget.span;
    // Two runs over the tables may have no temperature in common.
    if low <= high {
        let degc = |t: Temperature| f64::from(t.0) / 256.0;
        channel.span_min_degc = Some(degc(low));
        channel.span_max_degc = Some(degc(high));
    }
}

/// What a calibration by hand is referred to.
fn gravity(faces: &hand::Faces) -> Reference {
    Reference {
        name: "Gravity at the place of the calibration".to_owned(),
        standard_uncertainty_deg: Some(faces.zero_uncertainty_deg()),
        statement: format!(
            "Gravity's length is the same in every pose. The zero of both slopes is the base of \
             the housing, by two poses turned by 180 deg on a surface {:.2} deg off level; the \
             direction of X is the side that it stood on, {:+.2} deg off square. A turn by hand is \
             taken as good to {} deg (k = 1). Not known without another reference: whether base \
             and side are flat, and what of the sensors' nonlinearity all poses share.",
            faces.base_surface_deg,
            faces.off_square_deg,
            hand::TURN_DEG
        ),
    }
}

fn floor() -> Contribution {
    Contribution::new("1/f noise", "B", FLOOR_DEG, "0.04 mg, an assumption")
}

/// Accepted when `largest` of each channel is there and, with the channel's U, within.
pub fn judge(report: &mut Report, largest: impl Fn(&Channel) -> Option<f64>) {
    let tolerance = report.decision.tolerance_deg;
    let within = |channel: &Channel| {
        let u = channel.expanded_uncertainty_deg;
        largest(channel).is_some_and(|largest| largest + u <= tolerance)
    };
    report.decision.accepted = report.channels.iter().all(within);
}

/// The same of the angles as left; a channel has to have read each of them.
fn judge_angles(report: &mut Report) {
    let is_read = |p: &Point| p.error_deg.is_some_and(f64::is_finite);
    judge(report, |channel| {
        let whole = channel.as_left.iter().all(is_read);
        channel.largest_error_deg().filter(|_| whole)
    });
    if let Some([low, high]) = judged_deg(report) {
        report.decision.rule += &format!(" Judged from {low:.1} to {high:.1} deg only.");
    }
    let largest = report
        .channels
        .iter()
        .filter_map(Channel::largest_error_deg);
    report.decision.largest_error_deg = largest.reduce(f64::max);
}

/// The smallest and the largest angle at which the calibration was judged, deg.
fn judged_deg(report: &Report) -> Option<[f64; 2]> {
    let points = report.channels.iter().flat_map(|channel| &channel.as_left);
    let angles = points.map(|point| point.reference_deg);
    let ends = angles.map(|deg| [deg, deg]);
    ends.reduce(|[low, high], [deg, _]| [low.min(deg), high.max(deg)])
}

fn point(stand: &Stand, place: usize) -> Point {
    let reading = stand
        .error_deg(place)
        .map(|error| stand.reference_deg + error);
    Point::new(stand.axis.letter(), stand.reference_deg, reading)
}

/// A less B at each stand of two channels.
fn differences(stands: &[Stand]) -> Vec<Difference> {
    let two = stands.iter().filter(|stand| stand.readings.len() == 2);
    two.map(|stand| {
        let errors = [stand.error_deg(0), stand.error_deg(1)];
        let difference_deg = match errors {
            // Before the calibration a sensor may stand anywhere in its housing.
            [Ok(a), Ok(b)] => Some(wrap(a - b)),
            _ => None,
        };
        Difference {
            axis: stand.axis.letter().to_owned(),
            reference_deg: stand.reference_deg,
            difference_deg,
        }
    })
    .collect()
}

/// The zero of each slope as left: the mean of both poses on the base, in which the surface's tilt
/// falls out.
fn zero(handled: &Handled, place: usize) -> Vec<Point> {
    let [first, second] = &handled.left;
    let both = [&first[place], &second[place]];
    let mean = |number: usize| match both.map(|r: &Reading| r.angle_deg[number]) {
        [Ok(one), Ok(other)] => Ok((one + other) / 2.0),
        [Err(reason), _] | [_, Err(reason)] => Err(reason),
    };
    let axes = [Axis::X, Axis::Y].into_iter().enumerate();
    axes.map(|(number, axis)| Point::new(axis.letter(), 0.0, mean(number)))
        .collect()
}

fn zero_differences(channels: &[Channel]) -> Vec<Difference> {
    let [a, b] = channels else {
        return Vec::new();
    };
    let pairs = a.as_left.iter().zip(&b.as_left);
    pairs
        .map(|(a, b)| Difference {
            axis: a.axis.clone(),
            reference_deg: a.reference_deg,
            difference_deg: a.reading_deg.zip(b.reading_deg).map(|(a, b)| a - b),
        })
        .collect()
}

fn poses(handled: &Handled, place: usize) -> Vec<Pose> {
    let fit = &handled.fits[place];
    let taken = handled.taken[place].iter().zip(&handled.poses);
    taken
        .zip(&fit.length_mg)
        .map(|((taken, readings), mg)| Pose {
            words: POSES[taken.pose].words.to_owned(),
            length_error_mg: *mg,
            as_found_deg: readings[place].angle_deg.map(Result::ok),
            as_left_deg: slopes(handled, place, taken.mean_g),
        })
        .collect()
}

/// The slopes of a vector in g with the new correction, deg.
fn slopes(handled: &Handled, place: usize, mean_g: [f64; 3]) -> [f64; 2] {
    let Correction::TwoAxis { vector, .. } = &handled.calibrations[place].correction else {
        return [0.0; 2];
    };
    let accel = mean_g.map(|g| (g * f64::from(tilt::ONE_G)).round() as i32);
    let found = tilt::angle::slopes(vector.apply(Compensated { accel }));
    [found.x.degrees(), found.y.degrees()]
}

#[cfg(test)]
mod tests {
    use super::super::session::encode;
    use super::*;
    use crate::sample;

    #[test]
    fn the_gyroscope_as_left_is_read_from_the_bytes_of_the_node() {
        let told = |rates| {
            let made = Calibration {
                rates,
                ..Calibration::NOMINAL
            };
            let mut channel = Channel::default();
            tell(&mut channel, &decode(&encode(&made)).unwrap());
            channel
        };
        let (with, without) = (told(Some(sample::rates())), told(None));
        assert_eq!(with.gyroscope, Some(gyroscope::of(&sample::rates())));
        assert_eq!(without.gyroscope, None);
        // Another calibration to `plumb verify`, which compares the check sum.
        assert_ne!(with.as_left_crc32, without.as_left_crc32);
        assert_eq!(with.span_min_degc, without.span_min_degc);
    }

    #[test]
    fn two_sensors_as_found_on_both_sides_of_180_deg_differed_by_a_whole_turn() {
        let reading = |deg| Reading {
            accel: [0.0; 3],
            scatter_mg: 0.0,
            temperature_c: 25.0,
            angle_deg: [Ok(deg), Err(6)],
            rate_rad_s: None,
        };
        let stand = Stand {
            axis: Axis::X,
            reference_deg: 0.0,
            readings: vec![reading(179.5), reading(-179.7)],
        };
        let found = differences(&[stand])[0].difference_deg.unwrap();
        assert!((found + 0.8).abs() < 1e-9, "{found}");
    }
}
