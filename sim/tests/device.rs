//! The device in its world: what goes wrong with a part, its bus and its supply, and what the
//! channel reports of it.
//!
//! In: perfect or nominal parts in a started instrument, and one fault at a time. Out: the reason
//! that the reading gives and how soon. The times are those a machine's controller has to plan
//! with: stale within four periods, a lost set-up within 0.11 s, a brown-out within 0.25 s.

use std::cell::RefCell;
use std::rc::Rc;

use device::channel::{CHECK_INTERVAL_US, Settings};
use device::sensor::Lis2dw12;
use instant::Instant;
use sim::TICK_S;
use sim::bench::{Mode, run};
use sim::bench_node::BenchNode;
use sim::error_model::{ErrorModel, Term};
use sim::instrument::{Instrument, Pair};
use sim::lis2dw12::{BOOT_NS, Chip, Fault, SpiPort, Traits};
use sim::motion::{Motion, Mover};
use sim::rig::{Fixture, Mount, Rig, RigSetup};
use sim::rng::Rng;
use tilt::angle::Angle;
use tilt::chain::{Invalid, Measurement};
use tilt::cross_check::{CrossCheck, Judgement, Member};

const CTRL6: u8 = 0x25;

/// An instrument of `mode` with these parts, uncalibrated: a perfect part needs nothing else.
fn started(mode: Mode, parts: &ErrorModel, seed: u64) -> Instrument {
    let mut instrument = Instrument::new(&mode.settings(), &mode.check(), parts, seed, 1);
    instrument.power_cycle();
    instrument
}

fn level() -> Fixture {
    Fixture::level()
}

/// Runs tick by tick until the pair satisfies `wanted`; how long that took, s.
fn until(
    instrument: &mut Instrument,
    most_s: f64,
    wanted: impl Fn(&Pair) -> bool,
) -> Option<(f64, Pair)> {
    let start_s = instrument.time_s();
    while instrument.time_s() - start_s < most_s {
        run(instrument, &mut level(), TICK_S);
        let pair = instrument.sync();
        if wanted(&pair) {
            return Some((instrument.time_s() - start_s, pair));
        }
    }
    None
}

fn invalid(node: usize, reason: Invalid) -> impl Fn(&Pair) -> bool {
    move |pair| pair.readings[node].x == Err(reason) && pair.readings[node].y == Err(reason)
}

fn brown_out(instrument: &Instrument, node: usize) {
    let now_ns = (instrument.time_s() * 1e9) as u64;
    instrument.sides[node].chip().borrow_mut().brown_out(now_ns);
}

#[test]
fn nothing_is_valid_before_it_has_settled_and_all_is_within_a_second() {
    for mode in [Mode::Paper, Mode::Product] {
        let mut instrument = started(mode, &ErrorModel::PERFECT, 1);
        // 32 samples at 50 Hz, 128 at 400 Hz; the turn-on is over by then.
        let settled_s = if mode == Mode::Paper { 0.62 } else { 0.31 };
        let tilted = Fixture::facing([0.5, 0.0, 0.75f64.sqrt()]);
        let start_s = instrument.time_s();
        let mut first = [None; 2];
        for _ in 0..1000 {
            run(&mut instrument, &mut tilted.clone(), TICK_S);
            let pair = instrument.sync();
            for (first, reading) in first.iter_mut().zip(pair.readings) {
                if let Ok(measured) = reading.x {
                    let error = measured.angle.degrees() - 30.0;
                    assert!(error.abs() < 0.01, "{mode:?}: {error}");
                    first.get_or_insert(instrument.time_s() - start_s);
                }
            }
        }
        for first_s in first {
            let first_s = first_s.expect("a reading within a second");
            assert!((settled_s..1.0).contains(&first_s), "{mode:?}: {first_s}");
        }
    }
}

#[test]
fn a_brown_out_is_seen_within_a_quarter_second_and_cured_by_a_start_only() {
    for mode in [Mode::Paper, Mode::Product] {
        // Each phase of the housekeeping, which runs every 0.1 s.
        for phase in 0..10 {
            let mut instrument = started(mode, &ErrorModel::PERFECT, 3);
            run(
                &mut instrument,
                &mut level(),
                1.0 + 0.013 * f64::from(phase),
            );
            brown_out(&instrument, 1);
            let (after_s, _) = until(&mut instrument, 0.25, invalid(1, Invalid::PartReset))
                .unwrap_or_else(|| panic!("{mode:?}, phase {phase}: {:?}", instrument.sync()));
            assert!(after_s > 0.0199, "it boots for 20 ms: {after_s}");
            assert!(instrument.sync().readings[0].x.is_ok(), "the other goes on");
            run(&mut instrument, &mut level(), 5.0);
            assert!(
                invalid(1, Invalid::PartReset)(&instrument.sync()),
                "latched"
            );
            instrument.start();
            run(&mut instrument, &mut level(), 1.0);
            assert!(instrument.sync().readings[1].x.is_ok(), "cured");
        }
    }
}

#[test]
fn a_brown_out_of_any_length_is_never_blamed_on_the_bus() {
    // The part is off for up to 50 ms and boots for 20 ms more: WHO_AM_I reads zero meanwhile.
    for length_ms in (1..=50).step_by(7) {
        for phase in 0..10 {
            let mut instrument = started(Mode::Product, &ErrorModel::PERFECT, 3);
            run(
                &mut instrument,
                &mut level(),
                1.0 + 0.011 * f64::from(phase),
            );
            for _ in 0..length_ms {
                brown_out(&instrument, 1);
                run(&mut instrument, &mut level(), TICK_S);
            }
            let seen = until(&mut instrument, 0.3, |pair| {
                pair.readings[1].x == Err(Invalid::PartReset)
                    || pair.readings[1].x == Err(Invalid::Bus)
            });
            let (_, pair) = seen.expect("the loss of the set-up");
            let reason = pair.readings[1].x.unwrap_err();
            assert_eq!(reason, Invalid::PartReset, "{length_ms} ms, phase {phase}");
        }
    }
}

#[test]
fn a_dead_bus_is_named_at_the_next_sample_and_a_dead_wire_within_a_quarter_second() {
    let faults = [
        (Fault::Bus, 0.004),
        (Fault::MisoHigh, 0.004),
        (Fault::MisoLow, 0.25),
    ];
    for (fault, within_s) in faults {
        let mut instrument = started(Mode::Product, &ErrorModel::PERFECT, 4);
        run(&mut instrument, &mut level(), 1.0);
        instrument.sides[0]
            .chip()
            .borrow_mut()
            .set_fault(Some(fault));
        let seen = until(&mut instrument, within_s, invalid(0, Invalid::Bus));
        let (_, pair) = seen.unwrap_or_else(|| panic!("{fault:?}"));
        let blamed = Judgement::OneChannel {
            faulty: Member::Own,
            reason: Invalid::Bus,
        };
        assert_eq!(pair.verdict.judgement(), blamed);
        instrument.sides[0].chip().borrow_mut().set_fault(None);
        run(&mut instrument, &mut level(), 2.0);
        assert!(invalid(0, Invalid::Bus)(&instrument.sync()), "latched");
        instrument.start();
        run(&mut instrument, &mut level(), 1.0);
        assert!(instrument.sync().readings[0].x.is_ok());
    }
}

#[test]
fn a_wire_that_dies_never_leaves_a_wrong_angle_valid() {
    let faults = [Fault::Bus, Fault::MisoHigh, Fault::MisoLow];
    for fault in faults {
        let mut instrument = started(Mode::Product, &ErrorModel::PERFECT, 5);
        run(&mut instrument, &mut level(), 1.0);
        instrument.sides[0]
            .chip()
            .borrow_mut()
            .set_fault(Some(fault));
        for _ in 0..500 {
            run(&mut instrument, &mut level(), TICK_S);
            if let Ok(measured) = instrument.sync().readings[0].x {
                assert!(
                    measured.angle.degrees().abs() < 0.01,
                    "{fault:?}: {measured:?}"
                );
            }
        }
    }
}

#[test]
fn an_upset_register_is_seen_within_0_11_s() {
    for value in [0x00, 0x14, 0x24] {
        for phase in 0..10 {
            let mut instrument = started(Mode::Product, &ErrorModel::PERFECT, 6);
            run(
                &mut instrument,
                &mut level(),
                1.0 + 0.009 * f64::from(phase),
            );
            let chip = Rc::clone(instrument.sides[0].chip());
            chip.borrow_mut().upset(CTRL6, value);
            let seen = until(&mut instrument, 0.11, invalid(0, Invalid::PartReset));
            assert!(seen.is_some(), "{value:#04x}, phase {phase}");
        }
    }
}

/// One node on one part, fed by hand at 400 Hz, so that the data-ready wire can be cut.
struct Alone {
    settings: Settings,
    chip: Rc<RefCell<Chip>>,
    node: BenchNode<Lis2dw12<SpiPort>>,
    now_us: u64,
}

impl Alone {
    fn started() -> Self {
        let chip = Rc::new(RefCell::new(Chip::new(Traits::TYPICAL)));
        chip.borrow_mut().power_on(0);
        chip.borrow_mut().advance_to(BOOT_NS);
        let mut port = SpiPort::new(Rc::clone(&chip));
        // This part has no noise.
        let settings = Settings {
            noise: 1,
            ..Mode::Product.settings()
        };
        let mut node = BenchNode::new(Lis2dw12::new(port.clone()), CrossCheck::product());
        node.start(&settings, &mut port, Instant(50_000)).unwrap();
        Self {
            settings,
            chip,
            node,
            now_us: 50_000,
        }
    }

    /// Samples for `count` periods; the edge reaches the node if the wire is whole.
    fn feed(&mut self, count: u32, wire_is_whole: bool) {
        for _ in 0..count {
            self.now_us += 2500;
            let now = Instant(self.now_us);
            let mut chip = self.chip.borrow_mut();
            chip.advance_to(self.now_us * 1000);
            chip.convert([0.0, 0.0, 1.0], 25.0);
            drop(chip);
            if wire_is_whole {
                self.node.channel.data_ready(&self.settings, now);
            }
            self.node.channel.poll(&self.settings, now);
        }
    }

    fn reason(&self) -> Option<Invalid> {
        let reading = self.node.reading(&self.settings, Instant(self.now_us));
        reading.x.err()
    }
}

#[test]
fn a_stuck_data_ready_makes_the_channel_stale_and_is_not_latched() {
    let mut alone = Alone::started();
    assert_eq!(alone.reason(), Some(Invalid::NoSample));
    alone.feed(400, true);
    assert_eq!(alone.reason(), None);
    alone.feed(3, false);
    assert_eq!(alone.reason(), None, "three missing samples are forgiven");
    alone.feed(2, false);
    assert_eq!(alone.reason(), Some(Invalid::Stale));
    alone.feed(4000, false);
    assert_eq!(
        alone.reason(),
        Some(Invalid::Stale),
        "for as long as it lasts"
    );
    alone.feed(1, true);
    assert_eq!(
        alone.reason(),
        Some(Invalid::Settling),
        "the filter begins anew"
    );
    alone.feed(200, true);
    assert_eq!(alone.reason(), None);
}

#[test]
fn a_data_ready_that_was_never_connected_was_no_fault() {
    let mut alone = Alone::started();
    alone.feed(39, false);
    assert_eq!(alone.reason(), Some(Invalid::NoSample), "it may still come");
    for _ in 0..100 {
        alone.feed(40, false);
        assert_eq!(alone.reason(), Some(Invalid::Stale));
    }
    // The wire is connected: it measures without a reset, as after a break.
    alone.feed(200, true);
    assert_eq!(alone.reason(), None);
    // A new start waits for its first sample anew.
    let now = Instant(alone.now_us);
    let mut delay = SpiPort::new(Rc::clone(&alone.chip));
    alone.node.start(&alone.settings, &mut delay, now).unwrap();
    assert_eq!(alone.reason(), Some(Invalid::NoSample));
    alone.feed(41, false);
    assert_eq!(alone.reason(), Some(Invalid::Stale));
}

#[test]
fn a_channel_that_was_never_started_is_invalid() {
    let chip = Rc::new(RefCell::new(Chip::new(Traits::TYPICAL)));
    let settings = Mode::Product.settings();
    let mut node = BenchNode::new(Lis2dw12::new(SpiPort::new(chip)), CrossCheck::product());
    let now = Instant(CHECK_INTERVAL_US as u64);
    assert_eq!(node.reading(&settings, now).x, Err(Invalid::NoSample));
    node.channel.poll(&settings, now);
    assert_eq!(node.reading(&settings, now).y, Err(Invalid::NoSample));
    let mut port = SpiPort::new(Rc::new(RefCell::new(Chip::new(Traits::TYPICAL))));
    assert!(node.start(&settings, &mut port, now).is_err(), "no supply");
    assert_eq!(node.reading(&settings, now).x, Err(Invalid::Bus));
}

#[test]
fn a_start_forgets_a_disagreement_and_nothing_else_does() {
    let mut alone = Alone::started();
    alone.feed(400, true);
    let mut delay = SpiPort::new(Rc::clone(&alone.chip));
    let own = alone.node.reading(&alone.settings, Instant(alone.now_us));
    let mut peer = own;
    // More than two parts without a calibration may differ by.
    peer.x = peer.x.map(|m| Measurement {
        angle: m.angle.plus(Angle::from_degrees(20.0)),
        ..m
    });
    let judge = |node: &mut BenchNode<Lis2dw12<SpiPort>>, peer, ms: u64| {
        node.judge(own, peer, Instant(2_000_000 + 1000 * ms))
            .judgement()
    };
    assert_eq!(
        judge(&mut alone.node, peer, 0),
        Judgement::Agree,
        "it has to last"
    );
    assert_eq!(judge(&mut alone.node, peer, 100), Judgement::Agree);
    assert_eq!(judge(&mut alone.node, peer, 201), Judgement::Disagree);
    assert_eq!(
        judge(&mut alone.node, own, 9000),
        Judgement::Disagree,
        "latched"
    );
    let now = Instant(alone.now_us);
    alone.node.start(&alone.settings, &mut delay, now).unwrap();
    assert_eq!(judge(&mut alone.node, own, 9100), Judgement::Agree);
}

#[test]
fn the_self_test_finds_the_part_s_own_deflection_and_measuring_goes_on() {
    let mut instrument = started(Mode::Product, &ErrorModel::NOMINAL, 7);
    run(&mut instrument, &mut level(), 1.0);
    let traits = Traits::TYPICAL;
    for node in 0..2 {
        let found = instrument.self_test(node).unwrap();
        assert!(found.within_data_sheet());
        let signs = [
            (found.positive_mg, traits.self_test_positive_g),
            (found.negative_mg, traits.self_test_negative_g),
        ];
        for (found_mg, true_g) in signs {
            for (found_mg, true_g) in found_mg.into_iter().zip(true_g) {
                let ratio = f64::from(found_mg) / (1000.0 * true_g);
                assert!((0.9..1.1).contains(&ratio), "{found_mg} of {true_g} g");
            }
        }
        let after = instrument.sync().readings[node].x;
        assert!(
            after.is_err(),
            "no angle from before the self-test: {after:?}"
        );
        run(&mut instrument, &mut level(), 1.0);
        let pair = instrument.sync();
        assert!(pair.readings.iter().all(|r| r.x.is_ok() && r.y.is_ok()));
        assert_eq!(pair.verdict.judgement(), Judgement::Agree, "node {node}");
    }
}

/// Level, with a push of `force_g` along x while `on`.
struct Push {
    force_g: f64,
    on: bool,
}

impl Mover for Push {
    fn step(&mut self, time_s: f64) -> Motion {
        let mut motion = Fixture::level().step(time_s);
        motion.force_g[0] = if self.on { self.force_g } else { 0.0 };
        motion
    }
}

#[test]
fn a_shock_beyond_the_range_takes_the_reading_away_and_gives_it_back() {
    let mut instrument = started(Mode::Product, &ErrorModel::PERFECT, 8);
    let mut push = Push {
        force_g: 3.0,
        on: false,
    };
    run(&mut instrument, &mut push, 1.0);
    assert!(instrument.sync().readings[0].x.is_ok());
    push.on = true;
    run(&mut instrument, &mut push, 0.02);
    let pair = instrument.sync();
    assert!(invalid(0, Invalid::OverRange)(&pair) && invalid(1, Invalid::OverRange)(&pair));
    let waits = Judgement::Waiting(Invalid::OverRange);
    assert_eq!(pair.verdict.judgement(), waits, "it accuses nobody");
    push.on = false;
    run(&mut instrument, &mut push, 0.5);
    let x = instrument.sync().readings[0].x.unwrap();
    assert!(x.angle.degrees().abs() < 0.01, "{x:?}");
}

#[test]
fn parts_six_per_cent_apart_agree_on_a_ramp_of_80_deg_per_s() {
    let parts = ErrorModel::PERFECT.with(Term::Clock, &ErrorModel::NOMINAL);
    // Looks for a pair at opposite ends of the +-3 %.
    let apart = |seed: &u64| {
        let mut instrument = started(Mode::Product, &parts, *seed);
        run(&mut instrument, &mut level(), 1.0);
        let samples = instrument
            .sides
            .each_ref()
            .map(|s| s.node.channel.samples());
        samples[0].abs_diff(samples[1]) >= 20
    };
    let seed = (0..300).find(apart).expect("a pair 5 % apart");
    let mut instrument = started(Mode::Product, &parts, seed);
    let mut rig = Rig::new(&RigSetup::PERFECT, &mut Rng::stream(seed, "rig"));
    rig.remount(Mount::X, 0.0, 0.0);
    run(&mut instrument, &mut rig, 1.0);
    let (mut largest, mut fastest) = (0.0f64, 0.0f64);
    for target_deg in [-40.0, 40.0, -40.0] {
        let arrival_s = rig.command(target_deg, 80.0).unwrap();
        while instrument.time_s() < arrival_s + 0.2 {
            run(&mut instrument, &mut rig, 0.02);
            fastest = fastest.max(rig.shaft().velocity_deg_s.abs());
            let delta = instrument.sync().verdict.delta().x.expect("both measure");
            largest = largest.max(delta.degrees().abs());
        }
    }
    println!("largest difference {largest:.4} deg");
    assert!(fastest > 79.9 && largest < 0.1, "{largest}");
}
