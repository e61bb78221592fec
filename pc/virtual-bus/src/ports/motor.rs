//! The virtual motor: a table with two axes that turns the housing to known angles.
//!
//! In: lines of the words in docs/motor.md. Out: answers, and the housing turned. Where it stands
//! is what it was told plus its own errors: harmonics, direction and repeatability of
//! [`sim::motor`], one motor for each axis. An axis at 0 rests on its stop, without error, while
//! the other one is turned.
//!
//! Left out: who is connected (`line_port`), and the drive's own speed profile: the housing speeds
//! up and slows down as a hand's does.

use sim::motor::{Motor, MotorModel};
use sim::network::hand::Pose;
use sim::rng::Rng;

use super::line_port::{Answer, CONFLICT, Error, LineDevice, UNDEFINED, number};
use crate::world::stage::Stage;

/// Standard uncertainty that the motor states for an angle, deg: three harmonics of 0.0083 deg
/// amplitude, 0.0083 deg by direction, and 0.0042 deg either side of repeatability.
pub const UNCERTAINTY_DEG: f64 = 0.0134;

/// Speed of its first turn, deg/s.
const SPEED_DEG_S: f64 = 40.0;

/// One axis of the table.
#[derive(Debug)]
struct Axis {
    motor: Motor,
    told_deg: f64,
    true_deg: f64,
}

impl Axis {
    fn draw(rng: &mut Rng) -> Self {
        Self {
            motor: Motor::draw(&MotorModel::NOMINAL, rng),
            told_deg: 0.0,
            true_deg: 0.0,
        }
    }
}

/// The table.
#[derive(Debug)]
pub struct Table {
    /// Pitch, then roll.
    axes: [Axis; 2],
    speed_deg_s: f64,
    /// Time of the motors' own, in which a move is over when the next one begins.
    time_s: f64,
}

impl Table {
    /// Level, with the errors that `seed` draws.
    pub fn new(seed: u64) -> Self {
        let mut rng = Rng::stream(seed, "serve motor");
        Self {
            axes: [Axis::draw(&mut rng), Axis::draw(&mut rng)],
            speed_deg_s: SPEED_DEG_S,
            time_s: 0.0,
        }
    }

    fn turn(&mut self, which: usize, to_deg: f64, stage: &mut Stage) -> Result<Answer, Error> {
        let before = (self.axes[which].told_deg, self.axes[which].true_deg);
        let axis = &mut self.axes[which];
        // The time is the motor's own, so that no move is under way.
        let moved = axis.motor.move_to(to_deg, self.speed_deg_s, self.time_s);
        self.time_s = moved.map_err(|_| CONFLICT)?;
        axis.told_deg = to_deg;
        axis.true_deg = axis.motor.shaft(self.time_s).true_deg;
        if stage.stand(self.pose(), self.speed_deg_s) {
            return Ok(Answer::Nothing);
        }
        (self.axes[which].told_deg, self.axes[which].true_deg) = before;
        Err(CONFLICT)
    }

    /// Where the housing is to stand.
    fn pose(&self) -> Pose {
        let [pitch, roll] = &self.axes;
        let rests = |axis: &Axis, other: &Axis| axis.told_deg == 0.0 && other.told_deg != 0.0;
        let angle = |axis: &Axis, other: &Axis| match rests(axis, other) {
            true => 0.0,
            false => axis.true_deg,
        };
        Pose {
            pitch_deg: angle(pitch, roll),
            roll_deg: angle(roll, pitch),
        }
    }
}

impl LineDevice for Table {
    fn model(&self) -> &'static str {
        "Virtual motor"
    }

    fn obey(&mut self, words: &[&str], stage: &mut Stage) -> Result<Answer, Error> {
        let said = match words {
            ["CONF:AXES?"] => "PITCH,ROLL".to_owned(),
            ["CONF:UNC?"] => format!("{UNCERTAINTY_DEG:.4}"),
            ["*OPC?"] => return Ok(Answer::WhenStill),
            ["VEL?"] => format!("{:.3}", self.speed_deg_s),
            ["VEL", speed] => {
                self.speed_deg_s = number(speed, 0.01, 400.0)?;
                return Ok(Answer::Nothing);
            }
            ["POS:PITCH?"] => format!("{:.4}", self.axes[0].told_deg),
            ["POS:ROLL?"] => format!("{:.4}", self.axes[1].told_deg),
            ["POS:PITCH", to] => return self.turn(0, number(to, -180.0, 180.0)?, stage),
            ["POS:ROLL", to] => return self.turn(1, number(to, -180.0, 180.0)?, stage),
            _ => return Err(UNDEFINED),
        };
        Ok(Answer::Line(said))
    }
}

#[cfg(test)]
mod tests {
    use super::super::line_port::Lines;
    use super::*;
    use sim::network::Network;

    fn table() -> (Lines, Stage) {
        let stage = Stage::new(Network::new(250_000, 1), 1);
        (Lines::new(Box::new(Table::new(1)), 1), stage)
    }

    fn line(text: &str) -> Answer {
        Answer::Line(text.to_owned())
    }

    #[test]
    fn the_housing_stands_where_the_motor_reports_but_for_the_motors_errors() {
        let (mut table, mut stage) = table();
        assert_eq!(table.hear("pos:roll -30.5", &mut stage), Answer::Nothing);
        assert_eq!(table.hear("POS:ROLL?", &mut stage), line("-30.5000"));
        assert_eq!(table.hear("*OPC?", &mut stage), Answer::WhenStill);
        stage.run_until(4_000_000_000);
        assert!(stage.is_still());
        let ([x, y], _) = stage.truth();
        let error = (x + 30.5).abs();
        assert!(y == 0.0 && error > 1e-6 && error < 0.04, "{x} {y}");
    }

    #[test]
    fn errors_wait_until_they_are_asked_for() {
        let (mut table, mut stage) = table();
        for bad in ["TURN 5", "POS:PITCH up", "POS:PITCH 181", "VEL 0"] {
            assert_eq!(table.hear(bad, &mut stage), Answer::Nothing);
        }
        for number in ["-113", "-120", "-222", "-222", "0"] {
            let Answer::Line(said) = table.hear("SYST:ERR?", &mut stage) else {
                panic!("no answer")
            };
            assert!(said.starts_with(&format!("{number},\"")), "{said}");
        }
    }

    #[test]
    fn a_pose_that_no_housing_stands_in_leaves_the_motor_where_it_is() {
        let (mut table, mut stage) = table();
        table.hear("POS:PITCH 80", &mut stage);
        table.hear("POS:ROLL 80", &mut stage);
        assert_eq!(
            table.hear("SYST:ERR?", &mut stage),
            line("-221,\"Settings conflict\"")
        );
        assert_eq!(table.hear("POS:ROLL?", &mut stage), line("0.0000"));
    }
}
