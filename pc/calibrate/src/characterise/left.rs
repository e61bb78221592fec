//! How much of a run is left.
//!
//! In: the profile, which dwells are over, and how fast the chamber has ramped so far. Out: the
//! time left, in the time of the bench, as words and on the progress bar.
//!
//! Left out: the clock: times are those of the nodes' samples.

use std::cell::Cell;

use super::profile::{Profile, REFERENCE_C};
use output::progress::Task;

/// What a chamber takes for a degree until its own ramps tell, min: 2 degC/min. `[ASSUME]`
const MIN_PER_C: f64 = 0.5;

/// A ramp that tells how fast the chamber is, degC.
const LONG_C: f64 = 5.0;

/// Four orientations, min. `[ASSUME]`
const TURNS_MIN: f64 = 1.0;

/// The time that a run still takes.
pub struct Left<'a> {
    profile: &'a Profile,
    task: &'a Task,
    /// Dwells that are over.
    over: Cell<usize>,
    /// Minutes of the one under way.
    dwelt_min: Cell<f64>,
    min_per_c: Cell<f64>,
    /// Seconds that the bar was told of, and all of them.
    shown_s: Cell<f64>,
    all_s: f64,
}

/// The time that a whole run takes as far as is known before it, s.
pub fn whole_s(profile: &Profile) -> f64 {
    60.0 * minutes(profile, 0, MIN_PER_C)
}

/// Minutes from dwell number `over` on to the end, conditioning included.
fn minutes(profile: &Profile, over: usize, min_per_c: f64) -> f64 {
    let places: Vec<_> = profile.places().collect();
    let mut sum = 0.0;
    for (run, step) in places.iter().skip(over) {
        let this = profile.steps[*step];
        let before = profile.before(*run, *step);
        let from = before.map_or(REFERENCE_C, |before| before.temperature_degc);
        sum += (this.temperature_degc - from).abs() * min_per_c + this.dwell_min + TURNS_MIN;
    }
    let longest = profile.steps.iter().map(|step| step.dwell_min);
    let longest = longest.fold(0.0, f64::max);
    let mut from = profile
        .steps
        .last()
        .map_or(REFERENCE_C, |s| s.temperature_degc);
    for to in profile.conditioning() {
        sum += (to - from).abs() * min_per_c + longest;
        from = to;
    }
    sum
}

impl<'a> Left<'a> {
    /// Of a run whose first `over` dwells were measured earlier. `task` has [`whole_s`] steps.
    pub fn new(profile: &'a Profile, task: &'a Task, over: usize) -> Self {
        let left = Self {
            profile,
            task,
            over: Cell::new(over),
            dwelt_min: Cell::new(0.0),
            min_per_c: Cell::new(MIN_PER_C),
            shown_s: Cell::new(0.0),
            all_s: whole_s(profile),
        };
        left.show();
        left
    }

    fn minutes(&self) -> f64 {
        let all = minutes(self.profile, self.over.get(), self.min_per_c.get());
        (all - self.dwelt_min.get()).max(0.0)
    }

    /// The time left in words.
    pub fn words(&self) -> String {
        let minutes = self.minutes().round() as u64;
        match (minutes / 60, minutes % 60) {
            (0, minutes) => format!("about {minutes} min left"),
            (hours, minutes) => format!("about {hours} h {minutes:02} min left"),
        }
    }

    /// The dwell under way has lasted so long.
    pub fn dwelt(&self, minutes: f64) {
        self.dwelt_min.set(minutes);
        self.show();
    }

    /// The air has come this far, degC, in this time, min.
    pub fn ramped(&self, way: Option<f64>, minutes: Option<f64>) {
        if let (Some(way), Some(minutes)) = (way.filter(|way| *way >= LONG_C), minutes) {
            self.min_per_c.set(minutes / way);
        }
    }

    /// A dwell is over.
    pub fn over(&self, run: u32, step: usize) {
        let mut places = self.profile.places();
        let place = places.position(|place| place == (run, step));
        self.over.set(place.map_or(0, |place| place + 1));
        self.dwelt_min.set(0.0);
        self.show();
    }

    fn show(&self) {
        let done_s = (self.all_s - 60.0 * self.minutes())
            .max(self.shown_s.get())
            .floor();
        self.task.advance((done_s - self.shown_s.get()) as u64);
        self.shown_s.set(done_s);
    }
}

#[cfg(test)]
mod tests {
    use super::super::model::Model;
    use super::*;
    use output::progress::Progress;

    #[test]
    fn the_paper_s_two_runs_take_a_day_and_the_time_left_follows_the_chamber() {
        let profile = Profile::paper(Model::Piecewise);
        let progress = Progress::hidden();
        let task = progress.task("x", 1);
        let left = Left::new(&profile, &task, 0);
        // Twice 430 min of dwells, ramps of 115 and of 95 + 115 degC, 24 min of readings, and 45 +
        // 5 min and twice 40 min at the end.
        let want: f64 = 860.0 + 57.5 + 80.0 + 24.0 + 32.5 + 80.0;
        assert!((left.minutes() - want).abs() < 1.0, "{}", left.minutes());
        assert_eq!(left.words(), "about 18 h 54 min left");
        left.dwelt(10.0);
        assert!((left.minutes() - want + 10.0).abs() < 1.0);
        left.over(1, 0);
        assert!((left.minutes() - want + 11.0).abs() < 1.0);
        left.ramped(Some(25.0), Some(25.0));
        assert!(left.minutes() > want + 100.0);
        let product = Profile::paper(Model::Quadratic);
        let product = Left::new(&product, &task, 0).words();
        assert_eq!(product, "about 31 h 00 min left");
        let at_the_end = Left::new(&profile, &task, 24);
        assert_eq!(at_the_end.words(), "about 1 h 53 min left");
    }
}
