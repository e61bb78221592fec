//! Random traffic: what holds for every run.

use super::*;
use proptest::prelude::*;

/// A frame to offer: after a pause in bits, from a port, with an identifier.
type Offer = (u64, usize, u16);

/// One run of offers on a bus with four controllers; who finds no free mailbox waits for one.
struct Run {
    bus: Bus,
    ports: [Port; 4],
    /// Number of the frame, when it came into a mailbox, its frame.
    accepted: Vec<(u64, Frame)>,
    events: Vec<Event>,
}

impl Run {
    fn new(rates: Rates, seed: u64) -> Self {
        let mut bus = Bus::new(RATE, seed);
        let orders = [TransmitOrder::Identifier; 4];
        let ports = orders.map(|order| bus.attach(order));
        bus.faults().set_rates(rates);
        Self {
            bus,
            ports,
            accepted: Vec::new(),
            events: Vec::new(),
        }
    }

    fn offer(&mut self, port: usize, id: u16) {
        let number = self.accepted.len() as u32;
        let frame = Frame::data_frame(id, &number.to_le_bytes());
        while self.bus.offer(self.ports[port], frame).is_err() {
            self.events.extend(self.bus.step(u64::MAX));
        }
        self.accepted.push((self.bus.now_ns(), frame));
    }

    fn play(mut self, offers: &[Offer]) -> Self {
        for (pause, port, id) in offers {
            let until_ns = self.bus.now_ns() + pause * BIT;
            while let Some(event) = self.bus.step(until_ns) {
                self.events.push(event);
            }
            // Identifiers belong to a node, or two would collide.
            self.offer(*port, (id << 2 | *port as u16) & 0x7FF);
        }
        while let Some(event) = self.bus.step(self.bus.now_ns() + 10_000 * BIT) {
            self.events.push(event);
        }
        self
    }

    /// For each frame, how many deliveries there were to each port.
    fn counts(&self) -> Vec<[usize; 4]> {
        let mut counts = vec![[0; 4]; self.accepted.len()];
        for event in &self.events {
            if let Event::Delivered { frame, to, .. } = event {
                let number = u32::from_le_bytes(frame.bytes().try_into().unwrap());
                to.iter()
                    .for_each(|port| counts[number as usize][port.index()] += 1);
            }
        }
        counts
    }

    /// Number of the frame, its begin and its end, in the order sent.
    fn sent(&self) -> Vec<(usize, u64, u64)> {
        let sent = |event: &Event| match event {
            Event::Sent {
                frame,
                start_ns,
                end_ns,
                ..
            } => {
                let number = u32::from_le_bytes(frame.bytes().try_into().unwrap());
                Some((number as usize, *start_ns, *end_ns))
            }
            _ => None,
        };
        self.events.iter().filter_map(sent).collect()
    }
}

fn offers() -> impl Strategy<Value = Vec<Offer>> {
    let pause = prop_oneof![3 => Just(0u64), 1 => 0u64..200];
    prop::collection::vec((pause, 0usize..4, 0u16..0x200), 1..120)
}

proptest! {
    #[test]
    fn without_faults_every_frame_arrives_once_at_all_others(offers in offers()) {
        let run = Run::new(Rates::default(), 1).play(&offers);
        for (count, (_, port, _)) in run.counts().iter().zip(&offers) {
            let mut want = [1; 4];
            want[*port] = 0;
            prop_assert_eq!(*count, want);
        }
        prop_assert_eq!(run.sent().len(), offers.len());
    }

    #[test]
    fn no_frame_begins_while_one_of_higher_priority_waits(offers in offers()) {
        let run = Run::new(Rates::default(), 1).play(&offers);
        let sent = run.sent();
        for (place, (number, start_ns, _)) in sent.iter().enumerate() {
            let own = priority(&run.accepted[*number].1);
            for (later, _, _) in &sent[place + 1..] {
                let (accepted_ns, frame) = &run.accepted[*later];
                prop_assert!(accepted_ns > start_ns || priority(frame) >= own);
            }
        }
    }

    #[test]
    fn frames_never_overlap_and_leave_no_gap_while_one_waits(offers in offers()) {
        let run = Run::new(Rates::default(), 1).play(&offers);
        for (one, next) in run.sent().iter().zip(run.sent().iter().skip(1)) {
            let free_ns = one.2 + 3 * BIT;
            let offered_ns = run.accepted[next.0].0;
            prop_assert_eq!(next.1, free_ns.max(offered_ns));
        }
    }

    /// While all are error active, errors in the wire or at one receiver lose and double nothing.
    #[test]
    fn errors_that_all_see_lose_nothing(offers in offers(), seed in any::<u64>()) {
        let rates = Rates { corrupt: 0.03, local: 0.02, ..Rates::default() };
        let run = Run::new(rates, seed).play(&offers);
        let passive = run.events.iter().any(|event| {
            matches!(event, Event::Changed { state: ErrorState::Passive, .. })
        });
        prop_assume!(!passive);
        for (count, (_, port, _)) in run.counts().iter().zip(&offers) {
            prop_assert_eq!(count.iter().sum::<usize>(), 3);
            prop_assert_eq!(count[*port], 0);
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_run(offers in offers(), seed in any::<u64>()) {
        let rates = Rates { corrupt: 0.05, local: 0.05, last_but_one: 0.05, overrun: 0.05 };
        let [one, two] = [(); 2].map(|()| Run::new(rates, seed).play(&offers));
        prop_assert_eq!(&one.events, &two.events);
        prop_assert_eq!(one.bus.fingerprint(), two.bus.fingerprint());
    }
}

#[test]
fn another_seed_gives_another_fingerprint() {
    let rates = Rates {
        corrupt: 0.3,
        ..Rates::default()
    };
    let offers: Vec<Offer> = (0..50).map(|n| (10, n % 4, n as u16)).collect();
    let prints = [1, 2].map(|seed| Run::new(rates, seed).play(&offers).bus.fingerprint());
    assert_ne!(prints[0], prints[1]);
}

/// 10 000 attempts: 3 % doubled for some, within four standard deviations.
#[test]
fn faults_strike_at_the_rate_asked_for() {
    let (mut bus, [a, b]) = bus();
    bus.faults().set_rates(Rates {
        last_but_one: 0.03,
        ..Rates::default()
    });
    bus.babble(a, Some(sync()));
    let mut got = Vec::new();
    while bus.statistics().attempts < 10_000 {
        got.extend(bus.step(u64::MAX));
    }
    bus.babble(a, None);
    got.extend(std::iter::from_fn(|| bus.step(u64::MAX)));
    let struck = errors(&got).len() as f64;
    assert!((struck - 300.0).abs() < 4.0 * 17.1, "{struck}");
    assert_eq!(deliveries(&got, b), sent(&got).len());
}
