//! The climatic chamber: a set point in, the air's and the die's temperature out.
//!
//! In: a set point in degC and steps of time in s. Out: air and die temperature, degC. The air
//! ramps at 2 degC/min and the die follows it with a time constant of 300 s, both `[ASSUME]`. The
//! answer to a ramp is in closed form, so a step of a minute is as exact as sixty of a second.
//! [`Profile::paper`] is the run of requirement R4 and [`Program`] takes a chamber through a
//! profile. Left out: the heat that the instrument makes itself, gradients across the housing,
//! and the vibration of the chamber's fan.

/// How fast the air moves towards its set point, degC/s. `[ASSUME]` 2 degC/min
pub const RAMP_C_PER_S: f64 = 2.0 / 60.0;
/// Time constant of the die behind the air, s. `[ASSUME]`
pub const DIE_LAG_S: f64 = 300.0;

/// A chamber with one instrument in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chamber {
    /// Temperature of the air, degC.
    pub air_c: f64,
    /// Temperature of the sensor's die, degC.
    pub die_c: f64,
    set_point_c: f64,
}

impl Chamber {
    /// A chamber where air, die and set point have long been at `temperature_c`.
    pub fn at(temperature_c: f64) -> Chamber {
        Chamber {
            air_c: temperature_c,
            die_c: temperature_c,
            set_point_c: temperature_c,
        }
    }

    /// Asks for another temperature of the air, degC; the ramp starts at once.
    pub fn set_point(&mut self, temperature_c: f64) {
        self.set_point_c = temperature_c;
    }

    /// The temperature of the air that was asked for last, degC.
    pub fn asked_c(&self) -> f64 {
        self.set_point_c
    }

    /// Whether the air has arrived at its set point.
    pub fn arrived(&self) -> bool {
        self.air_c == self.set_point_c
    }

    /// Time until the air arrives, s; 0 once it has.
    pub fn ramp_left_s(&self) -> f64 {
        (self.set_point_c - self.air_c).abs() / RAMP_C_PER_S
    }

    /// Lets `dt_s` pass (any length >= 0, s).
    pub fn step(&mut self, dt_s: f64) {
        let ramp_s = self.ramp_left_s().min(dt_s);
        let slope = RAMP_C_PER_S * (self.set_point_c - self.air_c).signum();
        if ramp_s > 0.0 {
            self.follow(slope, ramp_s);
        }
        if ramp_s < dt_s {
            self.air_c = self.set_point_c;
            self.follow(0.0, dt_s - ramp_s);
        }
    }

    /// The die behind air that moves at `slope` degC/s for `dt_s`: it tends to a lag of
    /// slope times [`DIE_LAG_S`].
    fn follow(&mut self, slope: f64, dt_s: f64) {
        let lag_c = slope * DIE_LAG_S;
        let off_c = self.die_c - (self.air_c - lag_c);
        self.air_c += slope * dt_s;
        self.die_c = self.air_c - lag_c + off_c * (-dt_s / DIE_LAG_S).exp();
    }
}

/// One step of a temperature profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dwell {
    /// Temperature of the air, degC.
    pub set_point_c: f64,
    /// How long it is kept there once the air has arrived, min.
    pub dwell_min: f64,
}

/// A list of temperatures to hold, one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// The steps in the order they are run.
    pub steps: Vec<Dwell>,
}

impl Profile {
    /// The paper's run (section II.B steps 2 to 4, R4): 25 degC for 10 min, 0 and -10 degC for
    /// 30 min each, then -10 to 70 degC in steps of 10 for 40 min each. The paper makes the
    /// whole run twice; that is up to the caller. How long -10 degC is held the first time is
    /// not printed: 30 min like its neighbour `[ASSUME]`. A temperature is "kept stable" from the
    /// moment the air has arrived, so ramps come on top of the dwells.
    pub fn paper() -> Profile {
        let start = [(25.0, 10.0), (0.0, 30.0), (-10.0, 30.0)];
        let stairs = (-1..=7).map(|tens| (f64::from(tens) * 10.0, 40.0));
        let steps = start
            .into_iter()
            .chain(stairs)
            .map(|(set_point_c, dwell_min)| Dwell {
                set_point_c,
                dwell_min,
            })
            .collect();
        Profile { steps }
    }

    /// The way back that the product's run adds: 60 to -10 degC in steps of 10, as long at each
    /// as on the way up, so that the fit comes out between the branches of the hysteresis.
    pub fn down_the_stairs() -> Profile {
        let stairs = (-1..=6).rev().map(|tens| Dwell {
            set_point_c: f64::from(tens) * 10.0,
            dwell_min: 40.0,
        });
        Profile {
            steps: stairs.collect(),
        }
    }
}

/// A profile being run.
#[derive(Clone, Debug)]
pub struct Program {
    profile: Profile,
    index: usize,
    held_s: f64,
}

impl Program {
    /// A run that begins with the profile's first step.
    pub fn new(profile: Profile) -> Program {
        Program {
            profile,
            index: 0,
            held_s: 0.0,
        }
    }

    /// The step being run and how long the air has been held at its temperature, s; none when
    /// the run is over.
    pub fn now(&self) -> Option<(usize, Dwell, f64)> {
        self.profile
            .steps
            .get(self.index)
            .map(|dwell| (self.index, *dwell, self.held_s))
    }

    /// Lets up to `dt_s` pass in the chamber, but not beyond the end of the present dwell, so
    /// that a caller sees every dwell to its end. Returns the time that has passed, s; 0 when
    /// the run is over.
    pub fn step(&mut self, chamber: &mut Chamber, dt_s: f64) -> f64 {
        let Some((_, dwell, held_s)) = self.now() else {
            return 0.0;
        };
        chamber.set_point(dwell.set_point_c);
        let left_s = chamber.ramp_left_s() + dwell.dwell_min * 60.0 - held_s;
        let passed_s = dt_s.min(left_s).max(0.0);
        self.held_s += (passed_s - chamber.ramp_left_s()).max(0.0);
        chamber.step(passed_s);
        // Rounding may leave a sliver of the dwell: a microsecond is taken as nothing.
        if left_s - passed_s < 1e-6 {
            self.index += 1;
            self.held_s = 0.0;
        }
        passed_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_air_ramps_at_two_degrees_a_minute_and_stays() {
        let mut chamber = Chamber::at(25.0);
        chamber.set_point(-10.0);
        assert!((chamber.ramp_left_s() - 17.5 * 60.0).abs() < 1e-9);
        chamber.step(600.0);
        assert!((chamber.air_c - 5.0).abs() < 1e-9 && !chamber.arrived());
        chamber.step(451.0);
        assert!(chamber.air_c == -10.0 && chamber.arrived());
        chamber.step(1e6);
        assert!(chamber.air_c == -10.0 && (chamber.die_c + 10.0).abs() < 1e-9);
    }

    #[test]
    fn the_die_lags_a_ramp_by_ten_degrees_and_settles_with_its_time_constant() {
        let mut chamber = Chamber::at(-100.0);
        chamber.set_point(100.0);
        chamber.step(5000.0);
        assert!(
            (chamber.air_c - chamber.die_c - 10.0).abs() < 1e-3,
            "{chamber:?}"
        );
        let mut chamber = Chamber {
            air_c: 0.0,
            die_c: 20.0,
            set_point_c: 0.0,
        };
        chamber.step(DIE_LAG_S);
        assert!((chamber.die_c - 20.0 / 1f64.exp()).abs() < 1e-9);
    }

    #[test]
    fn the_answer_does_not_depend_on_the_size_of_the_step() {
        let run = |dt_s: f64| {
            let mut chamber = Chamber::at(25.0);
            chamber.set_point(0.0);
            (0..(1800.0 / dt_s) as u32).for_each(|_| chamber.step(dt_s));
            chamber
        };
        for dt_s in [1.0, 7.5, 60.0, 1800.0] {
            assert!((run(dt_s).die_c - run(0.1).die_c).abs() < 1e-9, "{dt_s}");
            assert_eq!(run(dt_s).air_c, 0.0);
        }
    }

    #[test]
    fn the_paper_s_run_takes_487_and_a_half_minutes() {
        // Dwells 10 + 2 x 30 + 9 x 40 = 430 min, ramps 25 + 10 + 80 = 115 degC at 2 degC/min.
        for dt_s in [0.1, 1.0, 60.0] {
            let (mut chamber, mut program) = (Chamber::at(25.0), Program::new(Profile::paper()));
            let (mut time_s, mut seen) = (0.0, Vec::new());
            while let Some((index, dwell, _)) = program.now() {
                time_s += program.step(&mut chamber, dt_s);
                if program.now().is_none_or(|(next, ..)| next != index) {
                    seen.push(dwell.set_point_c);
                    assert!(
                        (chamber.die_c - dwell.set_point_c).abs() < 0.06,
                        "{chamber:?}"
                    );
                }
            }
            assert!(
                (time_s / 60.0 - 487.5).abs() < 1e-6,
                "{dt_s}: {}",
                time_s / 60.0
            );
            let want = [25, 0, -10, -10, 0, 10, 20, 30, 40, 50, 60, 70].map(f64::from);
            assert_eq!(seen, want);
        }
    }

    #[test]
    fn a_dwell_counts_from_the_arrival_of_the_air() {
        let (mut chamber, mut program) = (Chamber::at(25.0), Program::new(Profile::paper()));
        let mut time_s = 0.0;
        while program.now().is_some_and(|(index, ..)| index < 2) {
            time_s += program.step(&mut chamber, 1.0);
        }
        assert!(
            (time_s / 60.0 - (10.0 + 12.5 + 30.0)).abs() < 1e-6,
            "{}",
            time_s / 60.0
        );
    }
}
