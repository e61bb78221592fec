//! The product's ladder under random channels: healthy ones, mirrored ones, impossible ones.

use proptest::prelude::*;

use super::product_tests::{Bench, G, along, level, loud, pose};
use super::*;
use crate::health::Activity;
use crate::turned::Turned;
use crate::uncertainty::Uncertainty;
use crate::vector::Corrected;

/// Numbers as random as a test needs them, the same every time.
pub(super) struct Dice(pub(super) u64);

impl Dice {
    pub(super) fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Mean 0, standard deviation 1.
    pub(super) fn normal(&mut self) -> f64 {
        let length = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        length * (core::f64::consts::TAU * self.uniform()).cos()
    }

    /// A look at noise of a channel's own level, whose energy scatters by half.
    fn look(&mut self) -> Activity {
        self.look_at(1.0, 8)
    }

    /// A look of so many samples at noise of so many times the energy of the channel's own.
    pub(super) fn look_at(&mut self, energy: f64, samples: u32) -> Activity {
        let squares: f64 = (0..samples).map(|_| self.normal().powi(2)).sum();
        let energy = energy * squares / f64::from(samples);
        Activity((64.0 + 8.0 * energy.log2()).round().clamp(1.0, 254.0) as u8)
    }

    /// A healthy channel with its noise behind the filter and an offset of its own, mg.
    pub(super) fn feels(&mut self, gravity: [f64; 3], offset: [f64; 3]) -> Observation {
        let mut felt = [0.0; 3];
        for (felt, (gravity, offset)) in felt.iter_mut().zip(gravity.iter().zip(&offset)) {
            *felt = gravity + offset + 0.35 * self.normal();
        }
        Observation {
            activity: self.look(),
            ..along(felt)
        }
    }
}

#[test]
fn healthy_noise_accuses_nobody_in_an_hour_of_work() {
    let mut dice = Dice(0x2545_F491_4F6C_DD1D);
    // Each channel within what its calibration leaves.
    let offsets = [[0.8, -0.6, 0.5], [-0.5, 0.7, -0.4]];
    let mut bench = Bench::new();
    for n in 0..180_000_u32 {
        let t = f64::from(n) * 0.02;
        // Five minutes of work, five of standing, at another place each time.
        let works = n % 30_000 < 15_000;
        let angle = 25.0 * (t / 600.0).sin() + if works { 20.0 * (0.7 * t).sin() } else { 0.0 };
        let gravity = pose(angle, 5.0).map(|c| c * 1.0015);
        let own = dice.feels(gravity, offsets[0]);
        let peer = dice.feels(gravity, offsets[1]);
        let judgement = bench.step(own, peer);
        assert_eq!(judgement, Judgement::Agree, "{t} s");
    }
}

fn any_reason() -> impl Strategy<Value = Invalid> {
    prop::sample::select(std::vec![
        Invalid::NoSample,
        Invalid::Settling,
        Invalid::Stale,
        Invalid::OverRange,
        Invalid::NoTemperature,
        Invalid::NotMeasured,
        Invalid::PartReset,
        Invalid::Bus,
        Invalid::Stuck,
        Invalid::Noise,
        Invalid::Spikes,
        Invalid::Thermometer,
        Invalid::Biased,
        Invalid::Corrupt,
        Invalid::Silent,
        Invalid::Late,
        Invalid::Refused,
        Invalid::Unconfirmed,
        Invalid::Alone,
        Invalid::Unlike,
        Invalid::Uncertain,
    ])
}

fn any_axis() -> impl Strategy<Value = Result<Measurement, Invalid>> {
    prop_oneof![
        (any::<i32>(), any::<u32>()).prop_map(|(angle, unshared)| Ok(Measurement {
            angle: Angle(angle),
            uncertainty: Uncertainty(unshared),
            unshared: Uncertainty(unshared),
            at: Instant(0),
            latency_us: 0,
        })),
        any_reason().prop_map(Err),
    ]
}

fn any_turned() -> impl Strategy<Value = Turned> {
    let bias = prop::option::of(any::<[i32; 3]>());
    let told = (any::<[i16; 3]>(), any::<u8>(), bias, any::<(u32, u16)>());
    told.prop_map(|(angle, activity, bias, (accel, scale_share))| Turned {
        angle,
        activity: Activity(activity),
        bias,
        accel,
        scale_share,
    })
}

fn any_observation() -> impl Strategy<Value = Observation> {
    let accel = prop_oneof![any::<[i32; 3]>(), Just([i32::MIN; 3]), Just([i32::MAX; 3])];
    let turned = prop::option::of(any_turned());
    let told = (
        any_axis(),
        any_axis(),
        prop::option::of(accel),
        any::<u8>(),
        turned,
    );
    told.prop_map(|(x, y, accel, activity, turned)| Observation {
        reading: Axes { x, y },
        vector: accel.map(|accel| Corrected { accel }),
        activity: Activity(activity),
        turned,
    })
}

/// Something that happens to a channel, to judge alike whichever it is.
#[derive(Clone, Copy, Debug)]
enum Happens {
    Nothing,
    /// Slope X in hundredths of a degree.
    Tilt(i32),
    /// An axis and its offset, 0.1 mg.
    Offset(usize, i32),
    Loud(u8),
    Absent(Invalid),
}

impl Happens {
    fn observed(self) -> Observation {
        match self {
            Self::Nothing => level(),
            Self::Tilt(hundredths) => along(pose(f64::from(hundredths) * 0.01, 0.0)),
            Self::Offset(axis, tenths) => {
                let mut felt = [0.0, 0.0, G];
                felt[axis] += f64::from(tenths) * 0.1;
                along(felt)
            }
            Self::Loud(activity) => loud(activity),
            Self::Absent(reason) => Observation::absent(reason),
        }
    }
}

fn happens() -> impl Strategy<Value = Happens> {
    let passing = [Invalid::Stale, Invalid::Silent, Invalid::Late];
    prop_oneof![
        4 => Just(Happens::Nothing),
        2 => (-200..=200_i32).prop_map(Happens::Tilt),
        2 => (0..3_usize, -400..=400_i32).prop_map(|(axis, mg)| Happens::Offset(axis, mg)),
        2 => (1..=255_u8).prop_map(Happens::Loud),
        1 => prop::sample::select(passing.to_vec()).prop_map(Happens::Absent),
    ]
}

/// The judgement of who sits on the other side, without the reasons that only one is shown of two.
fn mirrored(judgement: Judgement) -> Judgement {
    match judgement {
        Judgement::OneChannel { faulty, reason } => Judgement::OneChannel {
            faulty: match faulty {
                Member::Own => Member::Peer,
                Member::Peer => Member::Own,
            },
            reason,
        },
        Judgement::NoChannel(_) => Judgement::NoChannel(Invalid::NoSample),
        other => other,
    }
}

/// Both channels' phases, judged by both nodes: the pair that they judge differently.
fn judged_differently(
    phases: &[(Happens, Happens, u32)],
    bench: impl Fn() -> Bench,
) -> Option<(usize, [Judgement; 2])> {
    let (mut here, mut there) = (bench(), bench());
    let pairs = phases.iter().flat_map(|(own, peer, pairs)| {
        let pair = (own.observed(), peer.observed());
        core::iter::repeat_n(pair, *pairs as usize)
    });
    pairs.enumerate().find_map(|(n, (own, peer))| {
        let judged = here.step(own, peer);
        let seen = there.step(peer, own);
        (mirrored(judged) != mirrored(mirrored(seen))).then_some((n, [judged, seen]))
    })
}

#[test]
fn one_node_named_a_channel_and_the_other_none_where_the_own_vector_alone_set_the_direction() {
    use Happens::{Nothing, Offset, Tilt};
    let phases = [
        (Tilt(184), Nothing, 14),
        (Nothing, Nothing, 1),
        (Tilt(97), Offset(2, -15), 57),
    ];
    assert_eq!(
        judged_differently(&phases, || Bench::that_forgives(2)),
        None
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None,
        ..ProptestConfig::default() })]

    #[test]
    fn whatever_comes_there_is_a_judgement(
        pairs in prop::collection::vec(
            (any_observation(), any_observation(), any::<u32>(), any::<bool>()), 1..60),
        seconds in prop::option::of(0..=u32::MAX),
        back: bool,
    ) {
        let check = ProductCheck {
            latch: seconds.map_or(Latch::UntilReset, Latch::Healthy),
            ..ProductCheck::PRODUCT
        };
        let (state, rates) = (ProductState::default(), Some(RateState::default()));
        let mut check: CrossCheck = CrossCheck::Product(check, state, rates);
        let mut now = Instant(if back { u64::MAX / 2 } else { 0 });
        for (own, peer, pause, restarted) in pairs {
            let pause = i64::from(pause);
            now = now.offset(if back { -pause } else { pause });
            let verdict = check.step(own, peer, now);
            prop_assert_eq!((verdict.own(), verdict.peer()), (own.reading, peer.reading));
            let judgement = verdict.judgement();
            let of_the_paper = matches!(
                judgement,
                Judgement::StopMotion | Judgement::DataDelay | Judgement::PhysicalFault
            );
            prop_assert!(!of_the_paper, "{:?}", judgement);
            if restarted {
                check.peer_restarted();
            }
        }
        check.reset();
        prop_assert_eq!(check.step(level(), level(), now).judgement(), Judgement::Agree);
    }

    #[test]
    fn who_sits_on_the_other_side_judges_alike(
        phases in prop::collection::vec((happens(), happens(), 1..120_u32), 1..15),
    ) {
        // What a channel reports of itself is forgiven by itself, so that is judged without a time.
        let speaks = |happens| !matches!(happens, Happens::Absent(_));
        let forgives = phases.iter().all(|(own, peer, _)| speaks(*own) && speaks(*peer));
        let bench = || if forgives { Bench::that_forgives(2) } else { Bench::new() };
        prop_assert_eq!(judged_differently(&phases, bench), None);
    }
}
