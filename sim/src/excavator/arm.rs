//! The arm's path: which angle next, how fast, when the bucket strikes, and how it stops.
//!
//! In: the scene and orders with their time, s. Out: pitch with its rate and acceleration,
//! sway, slew, whether the machine works, and the instants at which the bucket meets the ground.
//! Every move is a polynomial of the fifth degree whose rate and acceleration end at zero and
//! start as the arm moves, so nothing jumps, not even when an order cuts a move short.

use super::ExcavatorSetup;
use crate::rng::Rng;
use std::collections::VecDeque;

/// What the machine does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scene {
    /// Dig, lift, swing, dump and return in 15-20 s, again and again.
    #[default]
    Digging,
    /// The same moves for 5-20 s, then 5-20 s of rest with the engine idling.
    StopAndGo,
    /// The arm stands at one angle, the engine idles.
    Standstill,
}

/// Where the arm is at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Pose {
    pub(super) pitch_deg: f64,
    pub(super) rate_deg_s: f64,
    pub(super) acceleration_deg_s2: f64,
    pub(super) sway_deg: f64,
    pub(super) slew_deg: f64,
    pub(super) slew_rate_deg_s: f64,
    pub(super) slew_acceleration_deg_s2: f64,
}

/// Pitch at the end of each move of a cycle, degrees, lowest and highest: dig, lift, swing,
/// dump, return. `[ASSUME]`
const STATIONS_DEG: [(f64, f64); 5] = [
    (-60.0, -40.0),
    (20.0, 50.0),
    (10.0, 40.0),
    (-15.0, 10.0),
    (15.0, 45.0),
];
/// The station whose move ends in the ground.
const DIG: usize = 0;
/// The stations whose moves slew the cab, out and back.
const SLEWS: [usize; 2] = [2, 4];
/// Range of the arm, degrees. `[ASSUME]`
const PITCH_DEG: (f64, f64) = (-60.0, 50.0);
/// Fastest the arm goes, and the cab slews, deg/s. `[ASSUME]`
const PEAK_DEG_S: f64 = 60.0;
/// Length of a cycle of five moves, s. `[ASSUME]`
const CYCLE_S: (f64, f64) = (15.0, 20.0);
/// Length of a stretch of work, and of a rest, when the machine stops and goes, s. `[ASSUME]`
const STRETCH_S: (f64, f64) = (5.0, 20.0);
/// Pause after each move, s. `[ASSUME]`
const PAUSE_S: (f64, f64) = (0.2, 0.8);
/// Time from the order to stop to rest, s. `[ASSUME]`
const STOPPING_S: f64 = 0.8;
/// Highest rate of a move from rest over its mean rate: 15/8 for a fifth-degree polynomial.
const PEAK_OVER_MEAN: f64 = 1.875;
/// Angle that a short move is charged with beside its way when the time is shared out, degrees,
/// so that short moves are slower than long ones.
const START_COST_DEG: f64 = 15.0;

/// A fifth-degree polynomial in u = (t - start) / length that ends at rest.
#[derive(Clone, Copy, Debug, Default)]
struct Course([f64; 6]);

impl Course {
    /// From a value with its rate and acceleration per unit of u to a value at rest.
    fn new(from: f64, rate: f64, acceleration: f64, to: f64) -> Course {
        let way = to - from;
        Course([
            from,
            rate,
            0.5 * acceleration,
            10.0 * way - 6.0 * rate - 1.5 * acceleration,
            -15.0 * way + 8.0 * rate + 1.5 * acceleration,
            6.0 * way - 3.0 * rate - 0.5 * acceleration,
        ])
    }

    #[inline]
    fn value(&self, u: f64) -> f64 {
        let [a, b, c, d, e, f] = self.0;
        a + u * (b + u * (c + u * (d + u * (e + u * f))))
    }

    #[inline]
    fn rate(&self, u: f64) -> f64 {
        let [_, b, c, d, e, f] = self.0;
        b + u * (2.0 * c + u * (3.0 * d + u * (4.0 * e + u * 5.0 * f)))
    }

    #[inline]
    fn acceleration(&self, u: f64) -> f64 {
        let [_, _, c, d, e, f] = self.0;
        2.0 * c + u * (6.0 * d + u * (12.0 * e + u * 20.0 * f))
    }
}

/// A stretch of time with one course.
#[derive(Clone, Copy, Debug)]
struct Segment {
    start_s: f64,
    end_s: f64,
    per_s: f64,
    pitch: Course,
    sway: Course,
    slew: Course,
    works: bool,
}

impl Segment {
    fn new(start_s: f64, from: Pose, to: &Task) -> Segment {
        let length_s = to.length_s;
        Segment {
            start_s,
            end_s: start_s + length_s,
            per_s: 1.0 / length_s,
            pitch: Course::new(
                from.pitch_deg,
                from.rate_deg_s * length_s,
                from.acceleration_deg_s2 * length_s * length_s,
                to.pitch_deg.unwrap_or(from.pitch_deg),
            ),
            slew: Course::new(
                from.slew_deg,
                from.slew_rate_deg_s * length_s,
                from.slew_acceleration_deg_s2 * length_s * length_s,
                to.slew_deg.unwrap_or(from.slew_deg),
            ),
            sway: Course::new(
                from.sway_deg,
                0.0,
                0.0,
                to.sway_deg.unwrap_or(from.sway_deg),
            ),
            works: to.works,
        }
    }

    #[inline]
    fn pose(&self, time_s: f64) -> Pose {
        let u = ((time_s - self.start_s) * self.per_s).clamp(0.0, 1.0);
        Pose {
            pitch_deg: self.pitch.value(u),
            rate_deg_s: self.pitch.rate(u) * self.per_s,
            acceleration_deg_s2: self.pitch.acceleration(u) * self.per_s * self.per_s,
            sway_deg: self.sway.value(u),
            slew_deg: self.slew.value(u),
            slew_rate_deg_s: self.slew.rate(u) * self.per_s,
            slew_acceleration_deg_s2: self.slew.acceleration(u) * self.per_s * self.per_s,
        }
    }
}

/// Something planned: where to be after how long; no angle means to stay.
#[derive(Clone, Copy, Debug)]
struct Task {
    length_s: f64,
    pitch_deg: Option<f64>,
    sway_deg: Option<f64>,
    slew_deg: Option<f64>,
    works: bool,
    strikes: bool,
}

impl Task {
    fn stay(length_s: f64, works: bool) -> Task {
        Task {
            length_s,
            pitch_deg: None,
            sway_deg: None,
            slew_deg: None,
            works,
            strikes: false,
        }
    }
}

/// The arm with its plan.
#[derive(Clone, Debug)]
pub(super) struct Arm {
    scene: Scene,
    sway_deg: f64,
    slew_deg: (f64, f64),
    rng: Rng,
    segment: Segment,
    tasks: VecDeque<Task>,
    station: usize,
    /// Instants at which the bucket strikes during this segment, latest first, s.
    strikes_s: Vec<f64>,
    stopped: bool,
}

impl Arm {
    pub(super) fn new(setup: &ExcavatorSetup, mut rng: Rng) -> Arm {
        let (low, high) = STATIONS_DEG[STATIONS_DEG.len() - 1];
        let pitch_deg = rng.range(low, high);
        let from = Pose {
            pitch_deg,
            ..Pose::default()
        };
        let mut arm = Arm {
            scene: setup.scene,
            sway_deg: setup.sway_deg,
            slew_deg: setup.slew_deg,
            rng,
            segment: Segment::new(0.0, from, &Task::stay(1.0, false)),
            tasks: VecDeque::new(),
            station: DIG,
            strikes_s: Vec::new(),
            stopped: false,
        };
        arm.begin(0.0, from);
        arm
    }

    pub(super) fn stop(&mut self, now_s: f64) {
        if self.stopped {
            return;
        }
        self.stopped = true;
        self.tasks.clear();
        self.strikes_s.clear();
        let from = self.segment.pose(now_s);
        // The way of an even deceleration, as far as the arm's range goes.
        let rest_deg = from.pitch_deg + 0.5 * from.rate_deg_s * STOPPING_S;
        let task = Task {
            pitch_deg: Some(rest_deg.clamp(PITCH_DEG.0, PITCH_DEG.1)),
            slew_deg: Some(from.slew_deg + 0.5 * from.slew_rate_deg_s * STOPPING_S),
            ..Task::stay(STOPPING_S, false)
        };
        self.segment = Segment::new(now_s, from, &task);
    }

    pub(super) fn resume(&mut self, now_s: f64) {
        if !self.stopped {
            return;
        }
        self.stopped = false;
        self.station = DIG;
        // An order within the stopping time lets the arm come to rest first.
        let start_s = now_s.max(self.segment.end_s);
        if now_s >= self.segment.end_s {
            self.begin(start_s, self.segment.pose(start_s));
        }
    }

    pub(super) fn stopped(&self) -> bool {
        self.stopped
    }

    /// Whether the engine works rather than idles.
    #[inline]
    pub(super) fn works(&self) -> bool {
        self.segment.works
    }

    #[inline]
    pub(super) fn pose(&self, time_s: f64) -> Pose {
        self.segment.pose(time_s)
    }

    /// Moves on to the segment of this time; true when the bucket strikes now.
    #[inline]
    pub(super) fn advance(&mut self, time_s: f64) -> bool {
        while time_s >= self.segment.end_s && !self.stopped {
            let end_s = self.segment.end_s;
            self.begin(end_s, self.segment.pose(end_s));
        }
        let strikes = self
            .strikes_s
            .last()
            .is_some_and(|strike_s| time_s >= *strike_s);
        if strikes {
            self.strikes_s.pop();
        }
        strikes
    }

    /// Starts the next task of the plan from where the last one ended.
    fn begin(&mut self, start_s: f64, end: Pose) {
        // Every course ends at rest but for rounding, which must not turn a pause into a move.
        let from = Pose {
            rate_deg_s: 0.0,
            acceleration_deg_s2: 0.0,
            slew_rate_deg_s: 0.0,
            slew_acceleration_deg_s2: 0.0,
            ..end
        };
        if self.tasks.is_empty() {
            self.plan(from.pitch_deg);
        }
        let mut task = self.tasks.pop_front().unwrap_or(Task::stay(1.0, false));
        // A way too long for its time is cut, so that the arm never exceeds its peak rate.
        let reach_deg = PEAK_DEG_S * task.length_s / PEAK_OVER_MEAN;
        let within = |to: f64, from: f64| to.clamp(from - reach_deg, from + reach_deg);
        task.pitch_deg = task.pitch_deg.map(|to| within(to, from.pitch_deg));
        task.slew_deg = task.slew_deg.map(|to| within(to, from.slew_deg));
        self.segment = Segment::new(start_s, from, &task);
        self.strikes_s.clear();
        if task.strikes {
            self.plan_strikes(start_s, task.length_s);
        }
    }

    /// One to three strikes in the later half of a dig, apart from each other.
    fn plan_strikes(&mut self, start_s: f64, length_s: f64) {
        let count = 1.0 + self.rng.range(0.0, 3.0).floor();
        let slot_s = 0.5 * length_s / count;
        for slot in (0..count as u32).rev() {
            let at = f64::from(slot) + self.rng.range(0.0, 0.6);
            self.strikes_s.push(start_s + 0.45 * length_s + at * slot_s);
        }
    }

    /// Plans until the machine next has a choice: one cycle, one stretch with its rest, or a
    /// minute of standing.
    fn plan(&mut self, from_deg: f64) {
        match self.scene {
            Scene::Digging => {
                let cycle_s = self.rng.range(CYCLE_S.0, CYCLE_S.1);
                self.plan_work(from_deg, cycle_s, STATIONS_DEG.len());
            }
            Scene::StopAndGo => {
                let stretch_s = self.rng.range(STRETCH_S.0, STRETCH_S.1);
                let moves = (stretch_s / 3.5).round().max(1.0);
                self.plan_work(from_deg, stretch_s, moves as usize);
                let rest_s = self.rng.range(STRETCH_S.0, STRETCH_S.1);
                self.tasks.push_back(Task::stay(rest_s, false));
            }
            Scene::Standstill => self.tasks.push_back(Task::stay(60.0, false)),
        }
    }

    /// Where the cab slews to in the move to this station: out to empty the bucket, and back.
    fn plan_slew(&mut self) -> Option<f64> {
        let (least, most) = self.slew_deg;
        if most == 0.0 || !SLEWS.contains(&self.station) {
            return None;
        }
        let out = self.station == SLEWS[0];
        Some(match out {
            true => self.rng.range(least, most),
            false => 0.0,
        })
    }

    /// Plans moves that fill `work_s` exactly, each with a short pause after it. The time goes
    /// to the moves by their way and by a pace drawn for each.
    fn plan_work(&mut self, from_deg: f64, work_s: f64, moves: usize) {
        let mut free_s = work_s;
        let mut total_cost = 0.0;
        let (mut at_deg, mut out_deg) = (from_deg, 0.0f64);
        let first = self.tasks.len();
        for _ in 0..moves {
            let (low, high) = STATIONS_DEG[self.station];
            let pitch_deg = self.rng.range(low, high);
            let pace = self.rng.range(0.7, 1.4);
            let pause_s = self.rng.range(PAUSE_S.0, PAUSE_S.1);
            let slew_deg = self.plan_slew();
            // Out or back, the cab goes as far as it went or will go.
            let slews_deg = slew_deg.map_or(0.0, |to| to.max(out_deg));
            out_deg = slew_deg.unwrap_or(out_deg);
            let way_deg = (pitch_deg - at_deg).abs().max(slews_deg);
            let cost = (way_deg + START_COST_DEG) / pace;
            self.tasks.push_back(Task {
                length_s: cost,
                pitch_deg: Some(pitch_deg),
                sway_deg: Some(self.rng.range(-self.sway_deg, self.sway_deg)),
                slew_deg,
                works: true,
                strikes: self.station == DIG,
            });
            self.tasks.push_back(Task::stay(pause_s, true));
            self.station = (self.station + 1) % STATIONS_DEG.len();
            (at_deg, total_cost, free_s) = (pitch_deg, total_cost + cost, free_s - pause_s);
        }
        for task in self.tasks.iter_mut().skip(first).step_by(2) {
            task.length_s *= free_s / total_cost;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arm(scene: Scene, seed: u64) -> Arm {
        let setup = ExcavatorSetup {
            scene,
            ..ExcavatorSetup::NOMINAL
        };
        Arm::new(&setup, Rng::stream(seed, "arm"))
    }

    /// Lengths of the runs of ticks in which `holds` is false, and of those in which it is true.
    fn runs(arm: &mut Arm, seconds: u32, holds: impl Fn(&Arm) -> bool) -> [Vec<f64>; 2] {
        let mut lengths: [Vec<f64>; 2] = Default::default();
        let (mut last, mut since_s) = (None, 0.0);
        for tick in 0..seconds * 1000 {
            let time_s = f64::from(tick) * 0.001;
            arm.advance(time_s);
            let now = holds(arm);
            if last.is_some_and(|last| last != now) {
                lengths[usize::from(!now)].push(time_s - since_s);
                since_s = time_s;
            }
            last = Some(now);
        }
        lengths
    }

    #[test]
    fn a_course_meets_both_ends_and_its_rate_is_its_slope() {
        let course = Course::new(3.0, -7.0, 11.0, -2.0);
        assert_eq!(
            (
                course.value(0.0),
                course.rate(0.0),
                course.acceleration(0.0)
            ),
            (3., -7., 11.)
        );
        let end = [
            course.value(1.0) + 2.0,
            course.rate(1.0),
            course.acceleration(1.0),
        ];
        assert!(end.iter().all(|e| e.abs() < 1e-12), "{end:?}");
        let h = 1e-5;
        for u in [0.2, 0.5, 0.9] {
            let slope = (course.value(u + h) - course.value(u - h)) / (2.0 * h);
            let bend = (course.rate(u + h) - course.rate(u - h)) / (2.0 * h);
            assert!((slope - course.rate(u)).abs() < 1e-6);
            assert!((bend - course.acceleration(u)).abs() < 1e-6);
        }
    }

    #[test]
    fn digging_keeps_to_its_range_its_speeds_and_its_cycle() {
        let mut arm = arm(Scene::Digging, 1);
        let (mut peaks, mut peak, mut was_rising) = (Vec::new(), 0.0f64, false);
        let (mut low, mut high, mut strikes) = (0.0f64, 0.0f64, 0);
        for tick in 0..3_600_000 {
            strikes += u32::from(arm.advance(f64::from(tick) * 0.001));
            let pose = arm.pose(f64::from(tick) * 0.001);
            (low, high) = (low.min(pose.pitch_deg), high.max(pose.pitch_deg));
            assert!(pose.sway_deg.abs() <= 3.0);
            let moves = pose.rate_deg_s != 0.0;
            if was_rising && !moves {
                peaks.push(peak);
                peak = 0.0;
            }
            peak = peak.max(pose.rate_deg_s.abs());
            was_rising = moves;
        }
        let fastest = peaks.iter().fold(0.0f64, |m, p| m.max(*p));
        let usual = peaks.iter().filter(|p| (20.0..=45.0).contains(*p)).count() as f64;
        assert!(
            (-60.0..-55.0).contains(&low) && (45.0..=50.0).contains(&high),
            "{low} {high}"
        );
        assert!((50.0..=60.001).contains(&fastest), "{fastest}");
        assert!(
            usual / peaks.len() as f64 > 0.5,
            "{usual} of {}",
            peaks.len()
        );
        // Five moves a cycle of 17.5 s on average; two strikes a cycle on average.
        let cycles = peaks.len() as f64 / 5.0;
        assert!((3600.0 / cycles - 17.5).abs() < 0.5, "{}", 3600.0 / cycles);
        assert!(
            (f64::from(strikes) / cycles - 2.0).abs() < 0.25,
            "{strikes} in {cycles}"
        );
    }

    #[test]
    fn each_cycle_takes_15_to_20_s() {
        let mut arm = arm(Scene::Digging, 2);
        // The first of a cycle's ten tasks leaves nine in the plan.
        let [others, digs] = runs(&mut arm, 3600, |arm| arm.tasks.len() == 9);
        let cycles: Vec<f64> = digs.iter().zip(&others).map(|(d, o)| d + o).collect();
        assert!(cycles.len() > 180);
        assert!(
            cycles.iter().all(|c| (14.99..=20.01).contains(c)),
            "{cycles:?}"
        );
    }

    #[test]
    fn stop_and_go_works_and_rests_for_5_to_20_s() {
        let [rests, works] = runs(&mut arm(Scene::StopAndGo, 3), 7200, |arm| arm.works());
        assert!(works.len() > 200 && rests.len() > 200);
        assert!(
            works
                .iter()
                .chain(&rests)
                .all(|s| (4.99..=20.01).contains(s))
        );
        let mut arm = arm(Scene::StopAndGo, 3);
        let mut moving = 0;
        for tick in 0..600_000 {
            let time_s = f64::from(tick) * 0.001;
            arm.advance(time_s);
            let pose = arm.pose(time_s);
            assert!(pose.rate_deg_s.abs() <= 60.001);
            moving += u32::from(pose.rate_deg_s != 0.0);
            assert!(arm.works() || pose.rate_deg_s.abs() < 1e-9);
        }
        assert!((200_000..400_000).contains(&moving), "{moving}");
    }

    #[test]
    fn a_stop_is_smooth_and_over_within_a_second() {
        for at_tick in (0..40_000).step_by(137) {
            let mut arm = arm(Scene::Digging, 4);
            let at_s = f64::from(at_tick) * 0.001;
            arm.advance(at_s);
            let before = arm.pose(at_s);
            arm.stop(at_s);
            let after = arm.pose(at_s);
            assert!((before.pitch_deg - after.pitch_deg).abs() < 1e-9);
            assert!((before.rate_deg_s - after.rate_deg_s).abs() < 1e-9);
            assert!((before.acceleration_deg_s2 - after.acceleration_deg_s2).abs() < 1e-6);
            let rest = arm.pose(at_s + 1.0);
            for later in [1.0, 10.0, 45.0] {
                assert!(!arm.advance(at_s + later));
                assert_eq!(arm.pose(at_s + later), rest);
            }
            assert!(rest.rate_deg_s.abs() < 1e-9 && !arm.works());
            assert!((-60.0..=50.0).contains(&rest.pitch_deg));
        }
    }

    #[test]
    fn it_goes_on_from_where_it_stopped() {
        let mut arm = arm(Scene::Digging, 5);
        arm.advance(3.0);
        arm.stop(3.0);
        arm.advance(48.0);
        let rest = arm.pose(48.0);
        arm.resume(48.0);
        arm.advance(48.0);
        assert!((arm.pose(48.0).pitch_deg - rest.pitch_deg).abs() < 1e-9 && arm.works());
        arm.advance(50.0);
        assert!(arm.pose(50.0).pitch_deg != rest.pitch_deg);
        // An order to go on before the arm has come to rest.
        arm.stop(60.0);
        arm.resume(60.2);
        arm.advance(60.7);
        assert!(!arm.works());
        arm.advance(60.9);
        assert!(arm.works());
    }

    #[test]
    fn standing_still_means_one_angle() {
        let mut arm = arm(Scene::Standstill, 6);
        let first = arm.pose(0.0);
        for second in 0..600 {
            assert!(!arm.advance(f64::from(second)) && !arm.works());
            assert!((arm.pose(f64::from(second)).pitch_deg - first.pitch_deg).abs() < 1e-9);
        }
    }
}
