//! The rules on traces made by hand.

use super::detection::Blame;
use super::*;
use crate::trial::message::{Emergency, Slopes, State};

/// The housing turns slope X at 40 deg/s.
fn turning(time_s: f64) -> Option<[f64; 2]> {
    Some([40.0 * time_s, 0.0])
}

fn level(_: f64) -> Option<[f64; 2]> {
    Some([0.0; 2])
}

/// A conversation with a SYNC every 20 ms.
struct Trace {
    checks: Checks,
    now_s: f64,
    syncs: u32,
    ideal: fn(f64) -> Option<[f64; 2]>,
}

impl Trace {
    fn new(limits: Limits, ideal: fn(f64) -> Option<[f64; 2]>) -> Self {
        Self {
            checks: Checks::new(limits),
            now_s: 0.0,
            syncs: 0,
            ideal,
        }
    }

    fn send(&mut self, channel: usize, message: Message) {
        (self.checks).see(self.now_s, channel, &message, self.ideal);
    }

    /// One SYNC, heartbeats, and both slopes X off by these, deg; `None`: not valid.
    fn sync(&mut self, off_deg: [Option<f64>; 2], states: [u8; 2]) {
        self.syncs += 1;
        self.now_s = f64::from(self.syncs) * 0.02;
        self.send(0, Message::Sync);
        let truth = (self.ideal)(self.now_s - self.checks.limits.latency_s);
        let [x, y] = truth.expect("always known");
        self.now_s += 0.001;
        for channel in 0..2 {
            self.send(channel, Message::Heartbeat(5));
            let slopes = Slopes {
                deg: [off_deg[channel].map(|off| x + off), Some(y)],
                state: Some(states[channel]),
            };
            self.send(channel, Message::Slopes(slopes));
        }
    }

    fn run(&mut self, duration_s: f64, off_deg: [Option<f64>; 2], states: [u8; 2]) {
        for _ in 0..(duration_s / 0.02).round() as u32 {
            self.sync(off_deg, states);
        }
    }

    fn emergency(&mut self, channel: usize, code: u16, faults: u32) {
        let state = 1;
        let emergency = Emergency {
            code,
            register: 0,
            faults,
            blamed: 0,
            reason: 0,
            state,
        };
        self.send(channel, Message::Emergency(emergency));
    }

    fn state(&mut self, channel: usize, uncertainty_deg: Option<f64>) {
        let state = State {
            state: 1,
            uncertainty_deg,
        };
        self.send(channel, Message::State(state));
    }

    fn fault_of(&mut self, channel: usize) {
        self.checks.fault(Affected {
            channel,
            from_s: self.now_s,
            blame_counts: true,
        });
    }

    fn broken(&self) -> Vec<(Rule, usize)> {
        let of = |v: &Violation| (v.rule, v.channel);
        self.checks.violations.iter().map(of).collect()
    }
}

/// Limits of an instrument whose stated uncertainty counts.
const STATING: Limits = Limits {
    uncertainty_deg: Some(2.0),
    ..Limits::PRODUCT
};

/// A pair in order for a second.
fn working() -> Trace {
    let mut trace = Trace::new(Limits::PRODUCT, level);
    trace.run(1.0, [Some(0.0); 2], [1; 2]);
    assert!(trace.checks.in_order(trace.now_s));
    trace
}

#[test]
fn a_wrong_angle_may_be_valid_for_the_reaction_time_and_no_longer() {
    let mut trace = working();
    trace.fault_of(1);
    trace.run(0.5, [Some(0.0), Some(0.7)], [1; 2]);
    assert_eq!(trace.broken(), []);
    trace.run(0.06, [Some(0.0), Some(0.7)], [1; 2]);
    assert_eq!(trace.broken(), [(Rule::WrongAngle, 1)]);
    trace.run(1.0, [Some(0.0), Some(0.7)], [1; 2]);
    assert_eq!(trace.broken().len(), 1, "one stretch is told once");
}

#[test]
fn a_right_or_an_invalid_angle_ends_a_stretch_of_wrong_ones() {
    for between in [Some(0.55), None] {
        let mut trace = working();
        trace.fault_of(0);
        trace.run(0.5, [Some(-0.7), Some(0.0)], [1; 2]);
        trace.sync([between, Some(0.0)], [1; 2]);
        trace.run(0.5, [Some(-0.7), Some(0.0)], [1; 2]);
        assert_eq!(trace.broken(), [], "{between:?}");
    }
}

#[test]
fn the_angle_of_an_earlier_sync_is_recognised() {
    let mut trace = Trace::new(Limits::PRODUCT, turning);
    trace.run(0.2, [Some(0.0); 2], [1; 2]);
    // Three SYNCs late at 40 deg/s: 2.4 deg.
    trace.run(1.0, [Some(0.0), Some(-2.4)], [1; 2]);
    assert_eq!(trace.broken(), [(Rule::OldAngle, 1)]);
    assert!(trace.checks.old_angles() > 40);
}

#[test]
fn beyond_the_promise_angles_alone_count() {
    let limits = Limits {
        angles_only: true,
        ..Limits::PRODUCT
    };
    let mut trace = Trace::new(limits, level);
    trace.run(1.0, [Some(0.0); 2], [1; 2]);
    trace.run(1.0, [Some(0.0); 2], [8; 2]);
    assert_eq!(trace.broken(), []);
    trace.run(1.0, [Some(1.0), Some(0.0)], [8; 2]);
    assert_eq!(trace.broken(), [(Rule::WrongAngle, 0)]);
}

#[test]
fn the_first_word_and_the_name_of_a_fault_are_timed_from_its_beginning() {
    let mut trace = working();
    trace.fault_of(1);
    trace.run(0.1, [Some(0.0); 2], [1; 2]);
    trace.run(0.1, [Some(0.0); 2], [6; 2]);
    trace.run(0.1, [Some(0.0); 2], [8, 7]);
    let detection = trace.checks.detections.all[0];
    assert!((detection.told_s().unwrap() - 0.12).abs() < 1e-6);
    for found in detection.by {
        let (named_s, blame) = found.named.unwrap();
        assert!((named_s - 0.22).abs() < 1e-6, "{named_s}");
        assert_eq!(blame, Blame::Right);
    }
    assert_eq!(trace.broken(), []);
}

#[test]
fn a_channel_that_blames_the_healthy_one_is_reported() {
    let mut trace = working();
    trace.fault_of(1);
    trace.run(0.1, [Some(0.0); 2], [7, 6]);
    assert_eq!(trace.broken(), [(Rule::WrongBlame, 0)]);
    assert_eq!(trace.checks.detections.all[0].blame(), Blame::Wrong);
}

#[test]
fn what_is_said_long_after_a_fault_is_not_its_detection() {
    let mut trace = working();
    trace.fault_of(0);
    trace.checks.healed(trace.now_s + 0.1);
    trace.run(0.7, [Some(0.0); 2], [1; 2]);
    trace.run(0.1, [Some(0.0); 2], [6; 2]);
    assert_eq!(trace.checks.detections.all[0].told_s(), None);
}

#[test]
fn an_accusation_without_a_fault_is_a_false_alarm_once_for_each_channel() {
    let mut trace = working();
    trace.run(0.1, [Some(0.0); 2], [6, 1]);
    assert_eq!(trace.broken(), [(Rule::FalseAlarm, 0)]);
    trace.emergency(1, 0xFF02, 1 << 5);
    let alarms = [(Rule::FalseAlarm, 0), (Rule::FalseAlarm, 1)];
    assert_eq!(trace.broken(), alarms);
}

#[test]
fn waiting_and_going_beyond_full_scale_are_no_alarm() {
    let mut trace = working();
    trace.run(0.1, [None, Some(0.0)], [0; 2]);
    trace.emergency(0, 0xFF03, 1 << 6);
    trace.emergency(0, 0, 0);
    trace.run(0.1, [Some(0.0); 2], [1; 2]);
    trace.checks.end(trace.now_s);
    assert_eq!(trace.broken(), []);
}

#[test]
fn an_emergency_is_taken_back_once() {
    let unpaired = [(Rule::UnpairedEmergency, 0)];
    let mut never = working();
    never.fault_of(0);
    never.emergency(0, 0xFF14, 1 << 13);
    assert_eq!(never.broken(), []);
    never.checks.end(never.now_s);
    assert_eq!(never.broken(), unpaired);

    let mut twice = working();
    twice.fault_of(0);
    twice.emergency(0, 0xFF14, 1 << 13);
    twice.emergency(0, 0xFF14, 1 << 13);
    assert_eq!(twice.broken(), unpaired);

    let mut nothing = working();
    nothing.emergency(0, 0, 0);
    assert_eq!(nothing.broken(), unpaired);
}

#[test]
fn one_message_may_take_back_several_and_a_boot_up_takes_back_all() {
    let mut trace = working();
    trace.fault_of(0);
    trace.emergency(0, 0xFF14, 1 << 13 | 1 << 5);
    trace.emergency(0, 0xFF02, 1 << 13 | 1 << 5);
    trace.emergency(0, 0, 0);
    trace.emergency(1, 0xFF15, 1 << 14);
    trace.send(1, Message::BootUp);
    trace.checks.end(trace.now_s);
    assert_eq!(trace.broken(), []);
}

#[test]
fn a_communication_error_excuses_one_message_that_takes_back() {
    let mut trace = working();
    trace.emergency(0, 0x8130, 0);
    trace.emergency(0, 0, 0);
    assert_eq!(trace.broken(), []);
    trace.emergency(0, 0, 0);
    assert_eq!(trace.broken(), [(Rule::UnpairedEmergency, 0)]);
}

#[test]
fn a_channel_that_does_not_come_back_is_reported_after_5_s() {
    let mut trace = working();
    trace.fault_of(1);
    trace.run(1.0, [Some(0.0), None], [8, 7]);
    trace.checks.well(trace.now_s);
    trace.run(4.9, [Some(0.0), None], [1; 2]);
    assert_eq!(trace.broken(), []);
    trace.run(0.2, [Some(0.0), None], [1; 2]);
    assert_eq!(trace.broken(), [(Rule::NotInOrder, 1)]);
}

#[test]
fn silence_is_not_order() {
    let mut trace = working();
    trace.now_s += 1.5;
    assert!(!trace.checks.in_order(trace.now_s));
    trace.checks.well(trace.now_s);
    trace.checks.pass(trace.now_s + 5.1);
    let both = [(Rule::NotInOrder, 0), (Rule::NotInOrder, 1)];
    assert_eq!(trace.broken(), both);
}

#[test]
fn a_pair_that_came_back_may_accuse_nobody() {
    let mut trace = working();
    trace.fault_of(1);
    trace.run(1.0, [Some(0.0), None], [8, 7]);
    trace.checks.well(trace.now_s);
    trace.run(1.0, [Some(0.0); 2], [1; 2]);
    trace.run(0.1, [Some(0.0); 2], [8, 1]);
    assert_eq!(trace.broken(), [(Rule::FalseAlarm, 0)]);
}

#[test]
fn a_safety_frame_may_not_go_out_once_the_channel_accuses_somebody() {
    let mut trace = working();
    trace.fault_of(0);
    trace.run(0.04, [Some(0.0); 2], [6; 2]);
    trace.send(0, Message::Safety([0.0; 2]));
    assert_eq!(trace.broken(), []);
    trace.run(0.04, [Some(0.0); 2], [6; 2]);
    trace.send(0, Message::Safety([0.0; 2]));
    assert_eq!(trace.broken(), [(Rule::SafetyFrame, 0)]);
}

#[test]
fn a_safety_frame_is_held_to_the_truth_of_its_possible_instants() {
    // At 40 deg/s an angle of 24 to 60 ms ago is between 0.96 and 2.4 deg behind.
    for (behind_deg, broken) in [(0.5, 0), (2.9, 0), (3.1, 1)] {
        let mut trace = Trace::new(Limits::PRODUCT, turning);
        for _ in 0..30 {
            trace.now_s += 0.025;
            let now = turning(trace.now_s).expect("always known");
            trace.send(1, Message::Safety([now[0] - behind_deg, 0.0]));
        }
        assert_eq!(trace.broken().len(), broken, "{behind_deg}");
    }
}

#[test]
fn a_channel_with_safety_frames_is_in_order_only_while_it_sends_them() {
    let limits = Limits {
        safety: true,
        ..Limits::PRODUCT
    };
    let mut trace = Trace::new(limits, level);
    trace.run(1.0, [Some(0.0); 2], [1; 2]);
    assert!(!trace.checks.in_order(trace.now_s));
    for channel in 0..2 {
        trace.send(channel, Message::Safety([0.0; 2]));
    }
    assert!(trace.checks.in_order(trace.now_s));
}

#[test]
fn a_right_name_followed_by_a_wrong_one_is_wrong() {
    let mut trace = working();
    trace.fault_of(1);
    trace.run(0.1, [Some(0.0); 2], [8, 7]);
    trace.run(0.1, [Some(0.0); 2], [8, 8]);
    assert_eq!(trace.broken(), [(Rule::WrongBlame, 1)]);
}

/// The frames that carry angles.
const CARRIERS: [fn([f64; 2]) -> Message; 2] = [Message::Safety, |deg| {
    Message::Slopes(Slopes {
        deg: deg.map(Some),
        state: None,
    })
}];

#[test]
fn a_single_frame_of_before_a_silence_was_not_seen() {
    for carrier in CARRIERS {
        for (silence_s, broken) in [(0.5, 0), (0.6, 1), (4.0, 1)] {
            let mut trace = Trace::new(Limits::PRODUCT, turning);
            trace.run(0.2, [Some(0.0); 2], [1; 2]);
            let then = turning(trace.now_s).expect("always known");
            trace.send(1, carrier(then));
            trace.now_s += silence_s;
            trace.send(1, carrier(then));
            let told = [(Rule::StaleAngle, 1)];
            assert_eq!(trace.broken(), told[..broken], "{silence_s} s");
        }
    }
}

#[test]
fn the_first_angle_after_a_silence_was_held_to_a_limit_before_its_uncertainty_was_stated() {
    // Before the silence nothing was stated; the angle is 1 deg off.
    for (stated_deg, is_broken) in [(None, true), (Some(0.3), true), (Some(0.4), false)] {
        let mut trace = Trace::new(STATING, level);
        trace.run(0.2, [Some(0.0); 2], [1; 2]);
        trace.now_s += 1.0;
        trace.send(1, CARRIERS[0]([1.0, 0.0]));
        assert_eq!(trace.broken(), []);
        trace.state(1, stated_deg);
        let told = [(Rule::StaleAngle, 1)];
        assert_eq!(
            trace.broken(),
            told[..usize::from(is_broken)],
            "{stated_deg:?}"
        );
    }
}

#[test]
fn after_a_silence_a_channel_that_is_faulty_itself_has_its_reaction_time() {
    for (is_faulty, broken) in [(true, 0), (false, 1)] {
        let mut trace = working();
        trace.fault_of(usize::from(is_faulty));
        trace.now_s += 1.0;
        trace.send(1, CARRIERS[0]([3.0, 0.0]));
        let told = [(Rule::StaleAngle, 1)];
        assert_eq!(trace.broken(), told[..broken], "{is_faulty}");
    }
}

#[test]
fn a_valid_angle_that_states_more_than_its_limit_is_told() {
    for (stated_deg, is_broken) in [(None, false), (Some(2.0), false), (Some(2.001), true)] {
        let mut trace = Trace::new(STATING, level);
        trace.run(1.0, [Some(0.0); 2], [1; 2]);
        trace.state(1, stated_deg);
        let told = [(Rule::UncertainAngle, 1)];
        let expected = if is_broken { told.as_slice() } else { &[] };
        assert_eq!(trace.broken(), expected, "{stated_deg:?}");
    }
}
