//! Errors on demand: who drops the frame, who gets it twice, and what the counters show.

use super::*;

#[test]
fn a_corrupted_frame_is_repeated_and_counted() {
    let (mut bus, [a, b, c]) = bus();
    bus.faults().plan(0, Fault::Corrupt { bit: 20 });
    bus.offer(a, sync()).unwrap();
    let mut got = Vec::new();
    while errors(&got).is_empty() {
        got.extend(bus.step(u64::MAX));
    }
    assert_eq!(errors(&got), [(ErrorKind::Bit, 21)]);
    let counts =
        [a, b, c].map(|port| (bus.counters(port).transmit(), bus.counters(port).receive()));
    assert_eq!(counts, [(8, 0), (0, 1), (0, 1)]);
    got.extend(events(&mut bus, 1000));
    assert_eq!(
        (deliveries(&got, b), deliveries(&got, c), sent(&got).len()),
        (1, 1, 1)
    );
    let counts =
        [a, b, c].map(|port| (bus.counters(port).transmit(), bus.counters(port).receive()));
    assert_eq!(counts, [(7, 0), (0, 0), (0, 0)]);
}

/// SYNC opens with 0 000 1: the start of frame and three zeros, then bit 4. Turned to dominant it
/// makes five in a row, so that the first bit of the sender's flag is a stuff error for the others,
/// whose own flags follow: 1 + 6 bits.
#[test]
fn the_error_frame_lasts_until_the_last_flag_is_out() {
    let (mut bus, [a, _]) = bus();
    bus.faults().plan(0, Fault::Corrupt { bit: 4 });
    bus.offer(a, sync()).unwrap();
    let got = events(&mut bus, 1000);
    assert_eq!(errors(&got), [(ErrorKind::Bit, 5)]);
    assert_eq!(sent(&got), [(0x080, 5 + 7 + 8 + 3)]);
}

#[test]
fn an_error_at_one_receiver_makes_everybody_drop_the_frame() {
    let (mut bus, [a, b, c]) = bus();
    bus.faults().plan(0, Fault::Local(b));
    bus.offer(a, sync()).unwrap();
    let mut got = Vec::new();
    while errors(&got).is_empty() {
        got.extend(bus.step(u64::MAX));
    }
    // 38 bits, CRC delimiter, slot, acknowledge delimiter.
    assert_eq!(errors(&got), [(ErrorKind::Crc, 41)]);
    assert_eq!(bus.counters(b).receive(), 9);
    assert_eq!(bus.counters(c).receive(), 1);
    got.extend(events(&mut bus, 1000));
    assert_eq!((deliveries(&got, b), deliveries(&got, c)), (1, 1));
    assert_eq!(sent(&got), [(0x080, 41 + 7 + 8 + 3)]);
}

/// Local errors until the receiver is passive: then nobody notices, and it misses the frame.
#[test]
fn a_passive_receiver_misses_the_frame_alone() {
    let (mut bus, [a, b, c]) = bus();
    (0..16).for_each(|n| bus.faults().plan(n, Fault::Local(b)));
    bus.offer(a, sync()).unwrap();
    let got = events(&mut bus, 5000);
    // 15 times 9 makes 135; the 16th error disturbs nobody.
    assert_eq!((errors(&got).len(), sent(&got).len()), (15, 1));
    assert_eq!((deliveries(&got, b), deliveries(&got, c)), (0, 1));
    assert_eq!(
        (bus.counters(b).receive(), bus.state(b)),
        (136, ErrorState::Passive)
    );
}

#[test]
fn an_error_in_the_last_bit_but_one_delivers_twice_to_the_others() {
    let (mut bus, [a, b, c]) = bus();
    bus.faults().plan(0, Fault::LastButOne(b));
    bus.offer(a, sync()).unwrap();
    let mut got = events(&mut bus, 49);
    // The others answer with overload flags, which is no error of theirs.
    assert_eq!(
        (bus.counters(b).receive(), bus.counters(c).receive()),
        (9, 0)
    );
    got.extend(events(&mut bus, 1000));
    assert_eq!(errors(&got), [(ErrorKind::EndOfFrame, 48)]);
    assert_eq!((deliveries(&got, b), deliveries(&got, c)), (1, 2));
    assert_eq!(sent(&got), [(0x080, 48 + 17)]);
    assert_eq!(
        (bus.counters(b).receive(), bus.counters(c).receive()),
        (8, 0)
    );
}

#[test]
fn the_only_receiver_does_not_acknowledge_what_it_found_wrong() {
    let (mut bus, [a, b]) = bus();
    bus.faults().plan(0, Fault::Local(b));
    bus.offer(a, sync()).unwrap();
    let got = events(&mut bus, 42);
    assert_eq!(errors(&got), [(ErrorKind::Acknowledge, 40)]);
    assert_eq!(bus.counters(a).transmit(), 8);
    assert_eq!(bus.counters(b).receive(), 1);
}

#[test]
fn a_sender_that_dies_before_it_repeats_leaves_some_without_the_frame() {
    let (mut bus, [a, b, c]) = bus();
    bus.faults().plan(0, Fault::LastButOne(b));
    bus.offer(a, sync()).unwrap();
    let mut got = events(&mut bus, 50);
    bus.reset(a);
    got.extend(events(&mut bus, 1000));
    assert_eq!(
        (deliveries(&got, b), deliveries(&got, c), sent(&got).len()),
        (0, 1, 0)
    );
}

#[test]
fn a_fault_planned_for_the_sender_strikes_nobody() {
    for fault in [Fault::Local, Fault::LastButOne, Fault::Overrun] {
        let (mut bus, [a, b]) = bus();
        bus.faults().plan(0, fault(a));
        bus.offer(a, sync()).unwrap();
        let got = events(&mut bus, 1000);
        assert_eq!(
            (errors(&got).len(), sent(&got).len(), deliveries(&got, b)),
            (0, 1, 1)
        );
        assert_eq!(bus.counters(a), Counters::default());
    }
}

#[test]
fn an_overrun_is_seen_by_nobody() {
    let (mut bus, [a, b, c]) = bus();
    bus.faults().plan(0, Fault::Overrun(b));
    bus.offer(a, sync()).unwrap();
    let got = events(&mut bus, 1000);
    assert_eq!((errors(&got).len(), sent(&got).len()), (0, 1));
    assert_eq!((deliveries(&got, b), deliveries(&got, c)), (0, 1));
}

#[test]
fn a_frame_cut_off_is_an_error_for_all_and_goes_out_after_reconnection() {
    let (mut bus, [a, b, c]) = bus();
    bus.offer(a, sync()).unwrap();
    bus.step(20 * BIT);
    bus.connect(a, false);
    let got = events(&mut bus, 1000);
    assert_eq!(errors(&got), [(ErrorKind::Cut, 26)]);
    assert_eq!(
        (bus.counters(a).transmit(), bus.counters(b).receive()),
        (0, 1)
    );
    bus.connect(a, true);
    let got = events(&mut bus, 2000);
    assert_eq!(sent(&got), [(0x080, 1000)]);
    assert_eq!(deliveries(&got, c), 1);
}

/// A bus with one node off it, idle, and the time of its last event, ns.
fn off_the_bus() -> (Bus, [Port; 3]) {
    let (mut bus, ports) = bus();
    (0..32).for_each(|n| bus.faults().plan(n, Fault::Corrupt { bit: 20 }));
    bus.offer(ports[0], sync()).unwrap();
    let got = events(&mut bus, 10_000);
    assert_eq!(errors(&got).len(), 32);
    let states: Vec<ErrorState> = (got.iter())
        .filter_map(|event| match event {
            Event::Changed { port, state, .. } if *port == ports[0] => Some(*state),
            _ => None,
        })
        .collect();
    assert_eq!(
        states,
        [ErrorState::Warning, ErrorState::Passive, ErrorState::BusOff]
    );
    (bus, ports)
}

#[test]
fn after_32_errors_in_a_row_a_sender_is_off_the_bus() {
    let (mut bus, [a, b, c]) = off_the_bus();
    assert_eq!(
        (bus.counters(a).transmit(), bus.state(a)),
        (256, ErrorState::BusOff)
    );
    assert_eq!(bus.counters(b).receive(), 32);
    // It neither sends, nor receives, nor acknowledges.
    bus.offer(b, frame(0x101)).unwrap();
    let got = events(&mut bus, 10_060);
    assert_eq!(
        (deliveries(&got, a), deliveries(&got, c), sent(&got).len()),
        (0, 1, 1)
    );
}

#[test]
fn recovery_takes_128_times_11_recessive_bits() {
    let (mut bus, [a, b, _]) = off_the_bus();
    bus.recover(b);
    assert_eq!(bus.next_event(), None);
    bus.recover(a);
    let at_ns = (10_000 + 128 * 11) * BIT;
    assert_eq!(bus.next_event(), Some(at_ns));
    let changed = Event::Changed {
        port: a,
        state: ErrorState::Active,
        at_ns,
    };
    assert_eq!(bus.step(at_ns), Some(changed));
    assert_eq!(bus.counters(a), Counters::default());
    // The frame that was waiting goes out at once.
    assert_eq!(
        sent(&events(&mut bus, 20_000)),
        [(0x080, 10_000 + 128 * 11)]
    );
}

/// 58 idle bits hold 5 sequences, the frame of 46 bits ends with one; 122 are left after it.
#[test]
fn a_frame_in_between_delays_recovery_by_its_length() {
    let (mut bus, [a, b, _]) = off_the_bus();
    bus.recover(a);
    bus.step(10_058 * BIT);
    bus.offer(b, frame(0x101)).unwrap();
    let got = events(&mut bus, 20_000);
    let changed = got
        .iter()
        .find(|event| matches!(event, Event::Changed { port, .. } if *port == a));
    let at_bits = changed.map(|event| event.at_ns() / BIT);
    assert_eq!(at_bits, Some(10_058 + 46 + 3 + 122 * 11));
}

#[test]
fn on_a_full_bus_each_frame_counts_once_for_recovery() {
    let (mut bus, [a, b, _]) = off_the_bus();
    bus.babble(b, Some(frame(0x000)));
    bus.recover(a);
    let changed = events(&mut bus, 20_000)
        .into_iter()
        .find_map(|event| match event {
            Event::Changed { port, at_ns, .. } if port == a => Some(at_ns / BIT),
            _ => None,
        });
    assert_eq!(changed, Some(10_000 + 128 * 53));
}

/// Its flags destroy a frame 15 times (9 each, 135), then it is passive and the frame goes out.
#[test]
fn a_node_at_another_bit_rate_disturbs_until_it_is_passive() {
    let (mut bus, [a, b, wrong]) = bus();
    bus.set_bit_rate(wrong, 250_000);
    bus.offer(a, sync()).unwrap();
    let got = events(&mut bus, 10_000);
    assert_eq!(errors(&got).len(), 15);
    assert!(
        errors(&got)
            .iter()
            .all(|(kind, _)| *kind == ErrorKind::BitRate)
    );
    assert_eq!((deliveries(&got, b), deliveries(&got, wrong)), (1, 0));
    assert_eq!(bus.counters(a).transmit(), 15 * 8 - 1);
    assert_eq!(bus.state(wrong), ErrorState::Passive);
}

/// Its frames are destroyed 15 times, until the two receivers are passive (9 each, 135). Then
/// nobody disturbs it and nobody acknowledges: 15 * 8 + 8 makes it passive, and there it stays.
#[test]
fn a_node_that_sends_at_another_bit_rate_is_never_heard() {
    let (mut bus, [_, b, wrong]) = bus();
    bus.set_bit_rate(wrong, 250_000);
    bus.offer(wrong, sync()).unwrap();
    let got = events(&mut bus, 100_000);
    assert_eq!((deliveries(&got, b), sent(&got).len()), (0, 0));
    assert!(bus.counters(b).receive() >= 128);
    assert_eq!(
        (bus.counters(wrong).transmit(), bus.state(wrong)),
        (128, ErrorState::Passive)
    );
}

#[test]
fn a_listener_looks_for_the_bit_rate_without_disturbing() {
    let (mut bus, [a, b, seeker]) = bus();
    bus.set_bit_rate(seeker, 125_000);
    bus.listen_only(seeker, true);
    for id in [0x101, 0x102, 0x103] {
        bus.offer(a, frame(id)).unwrap();
    }
    let got = events(&mut bus, 1000);
    assert_eq!(
        (
            errors(&got).len(),
            deliveries(&got, b),
            deliveries(&got, seeker)
        ),
        (0, 3, 0)
    );
    assert_eq!(bus.counters(seeker).receive(), 3);
    bus.set_bit_rate(seeker, RATE);
    bus.offer(a, sync()).unwrap();
    assert_eq!(deliveries(&events(&mut bus, 2000), seeker), 1);
    bus.connect(b, false);
    bus.offer(a, sync()).unwrap();
    // It doesn't acknowledge either.
    assert_eq!(
        errors(&events(&mut bus, 2050)),
        [(ErrorKind::Acknowledge, 2040)]
    );
}

/// TEC 8 one bit after the short, 16 after 14 more, then 8 every 8 bits: the 32nd, which makes
/// 256, after 1 + 14 + 30 * 8 bits.
#[test]
fn a_short_puts_the_sender_off_the_bus_and_receivers_to_passive() {
    let (mut bus, [a, b, _]) = bus();
    bus.offer(a, sync()).unwrap();
    bus.step(20 * BIT);
    bus.short_until(5_020 * BIT);
    let got = events(&mut bus, 5_019);
    assert_eq!(errors(&got), [(ErrorKind::Dominant, 21)]);
    let off = got.iter().find_map(|event| match event {
        Event::Changed {
            port,
            state: ErrorState::BusOff,
            at_ns,
        } => Some((*port, at_ns / BIT)),
        _ => None,
    });
    assert_eq!(off, Some((a, 20 + 1 + 14 + 30 * 8)));
    assert_eq!(
        (bus.counters(b).receive(), bus.state(b)),
        (255, ErrorState::Passive)
    );
    bus.offer(b, frame(0x101)).unwrap();
    // 8 bits of delimiter and the intermission after the short.
    assert_eq!(sent(&events(&mut bus, 6_000)), [(0x101, 5_031)]);
}

#[test]
fn a_short_of_an_idle_bus_is_survived_by_all() {
    let (mut bus, [a, b, c]) = bus();
    bus.short_until(10 * BIT);
    bus.offer(a, sync()).unwrap();
    let got = events(&mut bus, 1000);
    // Stuff error after 6 bits, 6 bits of flag, then 8 + 3.
    assert_eq!(errors(&got), [(ErrorKind::Dominant, 6)]);
    assert_eq!(sent(&got), [(0x080, 12 + 11)]);
    assert_eq!(
        [a, b, c].map(|port| bus.counters(port).receive()),
        [1, 0, 0]
    );
    assert_eq!(bus.statistics().busy_ns, (12 + 11 + SYNC_BITS + 3) * BIT);
}

/// 1 for the stuff error, 8 for the dominant bit after the own flag, 8 at bit 6 + 6 + 8.
#[test]
fn a_receiver_counts_while_the_short_outlasts_its_flag() {
    let (mut bus, [a, _]) = bus();
    bus.short_until(25 * BIT);
    let counts = [6, 19, 20, 24].map(|bits| {
        events(&mut bus, bits);
        bus.counters(a).receive()
    });
    assert_eq!(counts, [9, 9, 17, 17]);
}
