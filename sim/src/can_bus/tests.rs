//! Conversations on the bus: each rule of the standard with numbers worked out by hand.
//!
//! 500 kbit/s throughout, so a bit lasts 2 us. SYNC is 48 bits long, the frame 101h without data
//! 46 bits, both without the intermission of 3.

use super::*;
use canopen::frame::standard;

mod faulty;
mod random;

const RATE: u32 = 500_000;
const BIT: u64 = 2_000;
const SYNC_BITS: u64 = 48;

fn sync() -> Frame {
    Frame::data_frame(0x080, &[])
}

fn frame(id: u16) -> Frame {
    Frame::data_frame(id, &[])
}

fn bus<const N: usize>() -> (Bus, [Port; N]) {
    let mut bus = Bus::new(RATE, 1);
    let ports = [(); N].map(|()| bus.attach(TransmitOrder::Identifier));
    (bus, ports)
}

fn events(bus: &mut Bus, until_bits: u64) -> Vec<Event> {
    std::iter::from_fn(|| bus.step(until_bits * BIT)).collect()
}

/// Identifiers in the order in which they were sent, with the bit at which they began.
fn sent(events: &[Event]) -> Vec<(u16, u64)> {
    let sent = |event: &Event| match event {
        Event::Sent {
            frame, start_ns, ..
        } => Some((frame.cob_id()?, start_ns / BIT)),
        _ => None,
    };
    events.iter().filter_map(sent).collect()
}

/// How often one port got a frame.
fn deliveries(events: &[Event], port: Port) -> usize {
    let to_port =
        |event: &&Event| matches!(event, Event::Delivered { to, .. } if to.contains(port));
    events.iter().filter(to_port).count()
}

fn errors(events: &[Event]) -> Vec<(ErrorKind, u64)> {
    let error = |event: &Event| match event {
        Event::Error { kind, at_ns, .. } => Some((*kind, at_ns / BIT)),
        _ => None,
    };
    events.iter().filter_map(error).collect()
}

#[test]
fn a_frame_is_taken_one_bit_before_it_is_sent() {
    let (mut bus, [node, host, other]) = bus();
    bus.step(7);
    let mailbox = bus.offer(node, sync()).unwrap();
    let got = events(&mut bus, 1000);
    let delivered = Event::Delivered {
        frame: sync(),
        senders: Ports::only(node),
        to: [host, other].into_iter().collect(),
        start_ns: 7,
        at_ns: 7 + 47 * BIT,
    };
    let sent = Event::Sent {
        port: node,
        mailbox: Some(mailbox),
        frame: sync(),
        start_ns: 7,
        end_ns: 7 + 48 * BIT,
    };
    assert_eq!(got, [delivered, sent]);
}

#[test]
fn the_lowest_identifier_of_those_who_wait_goes_first() {
    let (mut bus, [a, b, c]) = bus();
    bus.offer(a, frame(0x300)).unwrap();
    bus.step(BIT);
    bus.offer(c, frame(0x102)).unwrap();
    bus.offer(b, frame(0x200)).unwrap();
    bus.offer(a, frame(0x101)).unwrap();
    let order = sent(&events(&mut bus, 1000));
    assert!(
        order
            .iter()
            .map(|(id, _)| id)
            .eq(&[0x300, 0x101, 0x102, 0x200])
    );
    assert_eq!(bus.statistics().arbitrations_lost, 2 + 1);
}

#[test]
fn three_bits_of_intermission_lie_between_two_frames() {
    let (mut bus, [a, _]) = bus();
    bus.offer(a, sync()).unwrap();
    bus.offer(a, frame(0x101)).unwrap();
    assert_eq!(
        sent(&events(&mut bus, 1000)),
        [(0x080, 0), (0x101, SYNC_BITS + 3)]
    );
}

#[test]
fn who_offers_at_the_instant_the_bus_falls_idle_still_competes() {
    let (mut bus, [a, b]) = bus();
    bus.offer(a, sync()).unwrap();
    bus.offer(a, frame(0x200)).unwrap();
    let mut got = events(&mut bus, SYNC_BITS + 3);
    bus.offer(b, frame(0x100)).unwrap();
    got.extend(events(&mut bus, 1000));
    assert_eq!(sent(&got)[1], (0x100, SYNC_BITS + 3));
}

#[test]
fn a_bit_later_it_is_too_late() {
    let (mut bus, [a, b]) = bus();
    bus.offer(a, sync()).unwrap();
    bus.offer(a, frame(0x200)).unwrap();
    let mut got = events(&mut bus, SYNC_BITS + 4);
    bus.offer(b, frame(0x100)).unwrap();
    got.extend(events(&mut bus, 1000));
    assert_eq!(sent(&got)[1], (0x200, SYNC_BITS + 3));
}

#[test]
fn a_data_frame_goes_before_a_remote_frame_of_the_same_identifier() {
    let (mut bus, [a, b, c]) = bus();
    let remote = Frame::remote(standard(0x701), 1).unwrap();
    bus.offer(a, remote).unwrap();
    bus.offer(b, Frame::data_frame(0x701, &[5])).unwrap();
    let got = events(&mut bus, 1000);
    let remotes = got.iter().filter_map(|event| match event {
        Event::Delivered { frame, to, .. } => to.contains(c).then_some(frame.is_remote()),
        _ => None,
    });
    assert!(remotes.eq([false, true]));
}

#[test]
fn three_mailboxes_and_no_more() {
    let (mut bus, [a, _]) = bus();
    let mailboxes = [1, 2, 3].map(|id| bus.offer(a, frame(id)).map(Mailbox::number));
    assert_eq!(mailboxes, [Ok(0), Ok(1), Ok(2)]);
    assert_eq!(bus.offer(a, frame(4)), Err(Busy));
    while !matches!(bus.step(u64::MAX), Some(Event::Sent { .. })) {}
    assert_eq!(bus.offer(a, frame(4)).map(Mailbox::number), Ok(0));
}

#[test]
fn a_frame_goes_into_the_mailbox_that_its_driver_has_chosen() {
    let (mut bus, [a, _]) = bus();
    let [first, second, _] = Mailbox::ALL;
    assert_eq!(bus.put(a, second, frame(1)), Ok(()));
    assert_eq!(bus.put(a, second, frame(2)), Err(Busy));
    let waiting = [first, second].map(|mailbox| bus.waiting(a, mailbox));
    assert_eq!(waiting, [None, Some(frame(1))]);
}

/// Three frames of one identifier; the fourth takes the mailbox of the first, and overtakes.
fn four_of_one_identifier(order: TransmitOrder) -> Vec<u8> {
    let mut bus = Bus::new(RATE, 1);
    let (a, _) = (bus.attach(order), bus.attach(order));
    let numbered = |n: u8| Frame::data_frame(0x181, &[n]);
    (0..3).for_each(|n| assert!(bus.offer(a, numbered(n)).is_ok()));
    let mut numbers = Vec::new();
    while let Some(event) = bus.step(1000 * BIT) {
        if let Event::Sent { frame, .. } = event {
            numbers.extend(frame.bytes());
            if numbers.len() == 1 {
                bus.offer(a, numbered(3)).unwrap();
            }
        }
    }
    numbers
}

#[test]
fn mailboxes_by_identifier_may_swap_two_frames_of_one_identifier() {
    assert_eq!(
        four_of_one_identifier(TransmitOrder::Identifier),
        [0, 3, 1, 2]
    );
    assert_eq!(four_of_one_identifier(TransmitOrder::Offered), [0, 1, 2, 3]);
}

#[test]
fn an_aborted_frame_on_the_wire_is_sent_but_not_repeated() {
    let (mut bus, [a, _]) = bus();
    bus.faults().plan(0, Fault::Corrupt { bit: 30 });
    let first = bus.offer(a, frame(0x100)).unwrap();
    let second = bus.offer(a, frame(0x200)).unwrap();
    bus.step(10 * BIT);
    assert_eq!((bus.abort(a, first), bus.abort(a, second)), (false, true));
    let got = events(&mut bus, 1000);
    assert_eq!((sent(&got).len(), errors(&got).len()), (0, 1));
    assert_eq!(bus.waiting(a, first), None);
}

/// 101h: 36 bits, CRC delimiter and slot, then the flag at bit 38; 6 + 8 + 3 bits to the next.
#[test]
fn a_lone_node_repeats_for_ever_and_stays_on_the_bus() {
    let (mut bus, [a, b]) = bus();
    bus.connect(b, false);
    bus.offer(a, frame(0x101)).unwrap();
    let got = errors(&events(&mut bus, 16 * 55 + 63 + 38));
    assert!(got.iter().all(|(kind, _)| *kind == ErrorKind::Acknowledge));
    assert!((0..16).all(|n| got[n].1 == n as u64 * 55 + 38), "{got:?}");
    // Passive after 16 of them: 8 bits of suspend transmission lie before each.
    assert_eq!(got[16].1, 15 * 55 + 38 + 17 + 8 + 38);
    assert_eq!(bus.counters(a).transmit(), 128);
    let later = events(&mut bus, 100_000);
    assert_eq!(
        (bus.counters(a).transmit(), bus.state(a)),
        (128, ErrorState::Passive)
    );
    assert_eq!(sent(&later).len(), 0);
    bus.connect(b, true);
    let heard = events(&mut bus, 101_000);
    assert_eq!((sent(&heard).len(), deliveries(&heard, b)), (1, 1));
    assert_eq!(
        (bus.counters(a).transmit(), bus.state(a)),
        (127, ErrorState::Warning)
    );
}

#[test]
fn a_listener_hears_a_lone_passive_node_but_not_an_active_one() {
    let (mut bus, [a, analyser]) = bus();
    bus.listen_only(analyser, true);
    bus.offer(a, frame(0x101)).unwrap();
    let active = events(&mut bus, 15 * 55 + 40);
    assert_eq!(errors(&active).len(), 16);
    assert_eq!(deliveries(&active, analyser), 0);
    // Each attempt takes 63 bits now; 101h is taken after 36 + 9.
    let passive = events(&mut bus, 15 * 55 + 3 * 63 + 45);
    assert_eq!(
        (deliveries(&passive, analyser), sent(&passive).len()),
        (3, 0)
    );
}

#[test]
fn two_nodes_that_send_the_same_bits_have_both_sent() {
    let (mut bus, [a, b, host]) = bus();
    bus.offer(a, sync()).unwrap();
    bus.offer(b, sync()).unwrap();
    let got = events(&mut bus, 1000);
    assert_eq!(sent(&got), [(0x080, 0), (0x080, 0)]);
    assert_eq!(deliveries(&got, host), 1);
    assert_eq!(bus.statistics().sent, 1);
    // Neither acknowledges itself.
    bus.connect(host, false);
    bus.offer(a, sync()).unwrap();
    bus.offer(b, sync()).unwrap();
    let alone = events(&mut bus, 1060);
    assert_eq!(
        (sent(&alone).len(), errors(&alone)[0].0),
        (0, ErrorKind::Acknowledge)
    );
}

/// 100h with one byte, 01h and 02h: they differ from the seventh data bit on, where the node that
/// sends 02h reads the other's dominant bit. 8 for both, each time, until both are passive.
#[test]
fn two_nodes_with_one_identifier_and_other_data_collide_until_one_is_passive() {
    let (mut bus, [a, b, host]) = bus();
    bus.offer(a, Frame::data_frame(0x100, &[1])).unwrap();
    bus.offer(b, Frame::data_frame(0x100, &[2])).unwrap();
    let mut got = Vec::new();
    while errors(&got).len() < 16 {
        got.extend(bus.step(u64::MAX));
    }
    assert!(errors(&got).iter().all(|(kind, _)| *kind == ErrorKind::Bit));
    assert_eq!(sent(&got).len(), 0);
    got.extend(events(&mut bus, 5000));
    // Both passive: the one that reads dominant gives way in silence, the other one passes.
    let values = got.iter().filter_map(|event| match event {
        Event::Delivered { frame, to, .. } => to.contains(host).then(|| frame.bytes()[0]),
        _ => None,
    });
    assert_eq!(values.collect::<Vec<_>>(), [1, 2]);
    assert_eq!(errors(&got).len(), 16);
    assert_eq!(bus.counters(a).transmit(), 128 - 1);
    assert_eq!(bus.counters(b).transmit(), 128 + 8 - 1);
}

#[test]
fn a_passive_node_lets_others_go_first() {
    let (mut bus, [a, b, c]) = bus();
    bus.connect(b, false);
    bus.connect(c, false);
    bus.offer(a, frame(0x100)).unwrap();
    events(&mut bus, 5000);
    assert_eq!(bus.state(a), ErrorState::Passive);
    bus.connect(b, true);
    let next = bus.statistics().attempts;
    bus.faults().plan(next, Fault::Corrupt { bit: 20 });
    let mut got = Vec::new();
    while !errors(&got).iter().any(|(kind, _)| *kind == ErrorKind::Bit) {
        got.extend(bus.step(u64::MAX));
    }
    assert_eq!(bus.counters(a).transmit(), 128 + 8);
    bus.offer(b, frame(0x7FF)).unwrap();
    let order = sent(&events(&mut bus, 9000));
    assert!(order.iter().map(|(id, _)| id).eq(&[0x7FF, 0x100]));
}

#[test]
fn the_load_of_a_window_counts_frames_with_their_intermission() {
    let (mut bus, [a, _]) = bus();
    bus.offer(a, sync()).unwrap();
    bus.step(24 * BIT);
    assert_eq!(bus.statistics().busy_ns, 24 * BIT);
    events(&mut bus, 2 * (SYNC_BITS + 3));
    let first = bus.statistics();
    assert_eq!(first.load_since(&Statistics::default()), 0.5);
    assert_eq!(first.load_since(&first), 0.0);
    events(&mut bus, 1000);
    assert_eq!(bus.statistics().load_since(&first), 0.0);
}

#[test]
fn a_babbling_node_starves_all_others() {
    let (mut bus, [a, b]) = bus();
    bus.babble(a, Some(frame(0x000)));
    bus.offer(b, frame(0x001)).unwrap();
    let got = events(&mut bus, 53 * 1000);
    assert!(sent(&got).iter().all(|(id, _)| *id == 0));
    let load = bus.statistics().load_since(&Statistics::default());
    assert_eq!((sent(&got).len(), load), (1000, 1.0));
    bus.babble(a, None);
    assert_eq!(sent(&events(&mut bus, 54 * 1000)), [(0x001, 53 * 1000)]);
}

#[test]
fn the_next_event_is_never_late_and_always_ahead() {
    let (mut bus, [a, b]) = bus();
    assert_eq!(bus.next_event(), None);
    bus.offer(a, sync()).unwrap();
    bus.offer(b, frame(0x101)).unwrap();
    let mut got = Vec::new();
    while let Some(at_ns) = bus.next_event() {
        assert!(at_ns > bus.now_ns());
        if let Some(event) = bus.step(at_ns) {
            assert_eq!(event.at_ns(), at_ns);
            got.push(event);
        }
    }
    assert_eq!(sent(&got), [(0x080, 0), (0x101, SYNC_BITS + 3)]);
}

#[test]
fn a_reset_controller_has_forgotten_its_frames_and_errors() {
    let (mut bus, [a, b]) = bus();
    bus.connect(b, false);
    bus.offer(a, sync()).unwrap();
    events(&mut bus, 5000);
    bus.reset(a);
    assert_eq!(
        (bus.counters(a), bus.state(a)),
        (Counters::default(), ErrorState::Active)
    );
    bus.connect(b, true);
    assert_eq!(sent(&events(&mut bus, 9000)), []);
}

/// Frames of three nodes on one bus: now one alone, now several, now one that only listens.
fn traffic(bus: &mut Bus, ports: [Port; 3]) -> u64 {
    for round in 0..200u64 {
        for (port, id) in ports.iter().zip(0x181..) {
            if (round * 7 + u64::from(id)) % 3 == 0 {
                let _ = bus.offer(*port, Frame::data_frame(id, &round.to_le_bytes()));
            }
        }
        if round == 100 {
            bus.listen_only(ports[2], true);
        } else if round == 150 {
            bus.connect(ports[1], false);
        }
        events(bus, 300 * (round + 1));
    }
    bus.fingerprint()
}

#[test]
fn a_lone_frame_goes_as_when_all_that_may_happen_is_worked_out() {
    let ((mut short, ports), (mut long, _)) = (bus::<3>(), bus::<3>());
    // A fault for an attempt that never comes keeps everything possible.
    long.faults().plan(u64::MAX, Fault::Corrupt { bit: 1 });
    assert_eq!(traffic(&mut short, ports), traffic(&mut long, ports));
    assert_eq!(short.statistics(), long.statistics());
}
