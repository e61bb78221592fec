//! A housing on a boom that swings without a pause: who is named, and by what.

use super::*;

const SYNC_US: u32 = 20_000;
/// 1 g in 2^-26 g.
const G: f64 = 67_108_864.0;
/// Distance from the pivot along the housing's y, m over 9.81 m/s^2.
const LEVER: f64 = 1.0 / 9.81;

/// Two channels on a boom that turns about x.
struct Boom {
    state: GravityState,
    /// Time from pair to pair, us.
    sync_us: u32,
    at_s: f64,
    /// Of both gyroscopes about x, rad/s.
    bias: f64,
    /// Either accelerometer reads so much more, g.
    errors: [[f64; 3]; 2],
    /// Either gyroscope reads so much more, as a share.
    scale: [f64; 2],
    /// The machine drives and brakes.
    drives: bool,
}

impl Boom {
    fn new() -> Self {
        Self {
            state: GravityState::default(),
            sync_us: SYNC_US,
            at_s: 0.0,
            bias: 0.0,
            errors: [[0.0; 3]; 2],
            scale: [0.0; 2],
            drives: false,
        }
    }

    /// Angle, rate and its change at a time: moves of 2, 3 and 2.4 s that end at rest at once.
    fn pose(at_s: f64) -> [f64; 3] {
        const MOVES: [(f64, f64); 4] = [(2.0, 0.5), (3.0, -0.8), (2.4, 0.7), (2.0, -0.4)];
        let (mut left, mut angle) = (at_s.rem_euclid(9.4), 0.1);
        for (length, way) in MOVES {
            if left < length {
                let phase = core::f64::consts::TAU * left / length;
                let share = left / length - phase.sin() / core::f64::consts::TAU;
                let rate = way / length * (1.0 - phase.cos());
                let change = way / length * phase.sin() * core::f64::consts::TAU / length;
                return [angle + way * share, rate, change];
            }
            left -= length;
            angle += way;
        }
        [angle, 0.0, 0.0]
    }

    /// What both accelerometers read, which is old by what the chain delays more than the turn.
    fn accelerations(&self) -> [[f64; 3]; 2] {
        let at_s = self.at_s - 0.019_54;
        let [angle, rate, change] = Self::pose(at_s);
        // Between two instants without a rate it changes its speed by 0.5 m/s or so.
        let drive = if self.drives {
            0.02 * (at_s * 0.7).sin()
        } else {
            0.0
        };
        let (sin, cos) = angle.sin_cos();
        let read = [
            0.0,
            sin - LEVER * rate * rate + drive * cos,
            cos + LEVER * change - drive * sin,
        ];
        self.errors
            .map(|error| [0, 1, 2].map(|axis| read[axis] + error[axis]))
    }

    fn pair(&mut self, differs: Option<Kind>) -> Option<Member> {
        let [before, ..] = Self::pose(self.at_s);
        let sync_s = f64::from(self.sync_us) * 1e-6;
        self.at_s += sync_s;
        let [now, ..] = Self::pose(self.at_s);
        let _ = self.state.bias(Some([0; 3]));
        let [found, ..] = self.state.bias.unwrap_or_default();
        let less = f64::from(found) / 4_294_967_296.0;
        let turns = self.scale.map(|scale| {
            let turn = (now - before) * (1.0 + scale) + (self.bias - less) * sync_s;
            [(turn * 1_073_741_824.0).round() as i32, 0, 0]
        });
        let [own, peer] = self.accelerations();
        let steps = |a: [f64; 3]| a.map(|a| (a * G).round() as i32);
        let pair = Pair {
            accelerations: Some(halves(&steps(own), &steps(peer))),
            turns,
            shaken: false,
            elapsed_us: self.sync_us,
        };
        Gravity::PRODUCT.step(&mut self.state, &pair, differs)
    }

    /// So many seconds; whoever is named.
    fn run(&mut self, seconds: u32, differs: Option<Kind>) -> Option<Member> {
        let pairs = seconds * 1_000_000 / self.sync_us;
        let pairs = (0..pairs).map(|_| self.pair(differs));
        pairs.fold(None, Option::or)
    }
}

const MEMBERS: [(usize, Member); 2] = [(0, Member::Own), (1, Member::Peer)];

#[test]
fn a_step_of_10_mg_without_a_pause_names_its_channel_on_any_axis() {
    for (node, member) in MEMBERS {
        for (axis, mg) in (0..3).flat_map(|axis| [(axis, 10.0), (axis, -10.0)]) {
            let mut boom = Boom::new();
            assert_eq!(boom.run(31, None), None);
            boom.errors[node][axis] = mg * 1e-3;
            let _ = boom.run(1, None);
            let named = boom.run(30, Some(Kind::Accelerations));
            assert_eq!(named, Some(member), "axis {axis}, {mg} mg");
        }
    }
}

/// Pairs that are 100 ms apart miss the instant without a rate, and named the healthy channel.
#[test]
fn at_no_period_of_sync_is_the_healthy_channel_named() {
    for sync_us in [
        4_000, 10_000, 12_500, 20_000, 33_000, 50_000, 60_000, 80_000, 100_000, 200_000, 250_000,
    ] {
        let mut right = 0;
        for (node, member) in MEMBERS {
            for (case, start_s) in (0..24_u32).map(|case| (case, f64::from(case) * 0.39)) {
                let mut boom = Boom::new();
                (boom.sync_us, boom.at_s) = (sync_us, start_s);
                assert_eq!(boom.run(31, None), None);
                boom.errors[node][case as usize % 3] = if case % 2 == 0 { 0.010 } else { -0.010 };
                let _ = boom.run(1, None);
                let named = boom.run(40, Some(Kind::Accelerations));
                assert!(
                    named.is_none_or(|who| who == member),
                    "{sync_us} us, {case}"
                );
                right += u32::from(named.is_some());
            }
        }
        let expected = if sync_us <= 60_000 { 20 } else { 0 };
        assert!(right >= expected, "{sync_us} us: {right} of 48");
    }
}

#[test]
fn a_scale_of_5_percent_without_a_pause_names_its_channel() {
    for (node, member) in MEMBERS {
        for scale in [0.05, -0.05] {
            let mut boom = Boom::new();
            assert_eq!(boom.run(31, None), None);
            boom.scale[node] = scale;
            assert_eq!(boom.run(20, Some(Kind::Rates)), Some(member), "{scale}");
        }
    }
}

#[test]
fn a_step_is_named_beside_a_bias_that_the_estimator_has_not_found() {
    for (node, member) in MEMBERS {
        let mut boom = Boom::new();
        boom.bias = 0.15_f64.to_radians();
        assert_eq!(boom.run(40, None), None);
        let [found, ..] = boom.state.bias.unwrap_or_default();
        let off = f64::from(found) / 4_294_967_296.0 - boom.bias;
        assert!(off.to_degrees().abs() < 0.02, "{} deg/s", off.to_degrees());
        boom.errors[node][1] = 0.010;
        let named = boom.run(30, Some(Kind::Accelerations));
        assert_eq!(named, Some(member));
    }
}

/// It has speed where it does not turn, so its windows show its own acceleration.
#[test]
fn a_machine_that_drives_never_names_the_healthy_channel() {
    for (node, member) in MEMBERS {
        for start_s in 0..20 {
            let mut boom = Boom::new();
            boom.at_s = f64::from(start_s) * 0.9;
            boom.drives = true;
            assert_eq!(boom.run(30, None), None);
            boom.errors[node][start_s as usize % 3] = 0.010;
            let named = boom.run(60, Some(Kind::Accelerations));
            assert!(named.is_none_or(|named| named == member), "{start_s}");
        }
    }
}

/// A dispute lasts for two seconds after the last difference, so a window ended in it and named the
/// channel again after its fault was over.
#[test]
fn a_window_that_ends_after_the_fault_named_its_channel_again() {
    let mut boom = Boom::new();
    let _ = boom.run(31, None);
    boom.errors[0][2] = 0.010;
    assert_eq!(boom.run(15, Some(Kind::Accelerations)), Some(Member::Own));
    boom.errors[0][2] = 0.0;
    assert_eq!(boom.run(10, None), None);
}

#[test]
fn two_kinds_that_differ_in_one_dispute_name_nobody() {
    let mut boom = Boom::new();
    let _ = boom.run(31, None);
    boom.errors[0][2] = 0.010;
    let _ = boom.pair(Some(Kind::Accelerations));
    let _ = boom.pair(Some(Kind::Rates));
    assert_eq!(boom.run(30, Some(Kind::Accelerations)), None);
}

#[test]
fn an_acceleration_that_is_missing_breaks_the_window() {
    let mut boom = Boom::new();
    let _ = boom.run(31, None);
    assert!(boom.state.window.is_some());
    let pair = Pair {
        accelerations: None,
        turns: [[0; 3]; 2],
        shaken: false,
        elapsed_us: SYNC_US,
    };
    assert_eq!(Gravity::PRODUCT.step(&mut boom.state, &pair, None), None);
    assert!(boom.state.window.is_none());
}
