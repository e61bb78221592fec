//! Any frames at all, and clients on a bus that loses segments.

use super::*;
use proptest::prelude::*;

/// Frames that lead somewhere, more often than chance would have it.
fn any_frame() -> impl Strategy<Value = Vec<u8>> {
    let object = prop::sample::select(ENTRIES.as_slice());
    let request = (any::<u8>(), object, any::<[u8; 4]>()).prop_map(|(command, entry, rest)| {
        let [low, high] = entry.index.to_le_bytes();
        let [a, b, c, d] = rest;
        std::vec![command, low, high, entry.sub, a % 8, b & c, c & 1, d & 1]
    });
    let next = prop::sample::select(std::vec![
        0x00u8, 0x10, 0x01, 0x11, 0x60, 0x70, 0xA1, 0xA2, 0xA3, 0xC1, 0x02, 0x82
    ]);
    let short = (next, any::<[u8; 7]>()).prop_map(|(command, [a, b, c, d, e, f, g])| {
        std::vec![command, a % 4, b & 0x7F, c, d, e, f, g]
    });
    prop_oneof![request, short, prop::collection::vec(any::<u8>(), 0..9)]
}

/// Draws losses from bits, the first ones of which are random; at the end nothing gets lost.
struct Bus {
    losses: std::collections::VecDeque<bool>,
}

impl Bus {
    fn delivers(&mut self) -> bool {
        !self.losses.pop_front().unwrap_or(false)
    }
}

/// A client that sends `content` by block download and repeats what the server has not got.
fn download(bench: &mut Bench, content: &[u8], bus: &mut Bus) {
    bench.send(&frame("C4 08 20 01"));
    assert_eq!(bench.receive(), Some(frame("A4 08 20 01 7F")));
    let mut chunks: Vec<&[u8]> = content.chunks(7).collect();
    if chunks.is_empty() {
        chunks.push(&[]);
    }
    let mut done = 0;
    while done < chunks.len() {
        let block: Vec<[u8; 8]> = (1..=127)
            .zip(done..chunks.len())
            .map(|(number, n)| {
                let mut data = [number, 0, 0, 0, 0, 0, 0, 0];
                data[0] |= u8::from(n + 1 == chunks.len()) << 7;
                data[1..=chunks[n].len()].copy_from_slice(chunks[n]);
                data
            })
            .collect();
        for data in block.iter().filter(|_| bus.delivers()) {
            bench.send(data);
        }
        let answer = bench.receive().or_else(|| {
            // The last one of the block was lost; after a while the client sends it again.
            bench.send(block.last().unwrap());
            bench.receive()
        });
        let [0xA2, acknowledged, 127, ..] = answer.unwrap() else {
            panic!("{answer:?} is no acknowledgement");
        };
        done += usize::from(acknowledged);
    }
    let unused = 7 - chunks.last().unwrap().len() as u8;
    let [low, high] = crate::crc::update(0, content).to_le_bytes();
    bench.send(&[0xC1 | unused << 2, low, high, 0, 0, 0, 0, 0]);
    assert_eq!(bench.receive(), Some(frame("A1")));
}

/// A client that reads by block upload with a block size of its own for each block.
fn upload(bench: &mut Bench, blocks: &[u8], bus: &mut Bus) -> Vec<u8> {
    let mut blocks = blocks.iter().copied().cycle();
    let mut block = blocks.next().unwrap();
    bench.send(&[0xA4, 0x08, 0x20, 1, block, 0, 0, 0]);
    let [0xC6, .., a, b, c, d] = bench.receive().unwrap() else {
        panic!("is answered");
    };
    bench.send(&frame("A3"));
    let mut got = Vec::new();
    let mut complete = false;
    while !complete {
        let mut good = 0;
        let mut count = 0;
        while let Some([command, data @ ..]) = bench.receive() {
            count += 1;
            assert_eq!(command & 0x7F, count, "numbers ascend from 1");
            if bus.delivers() && count == good + 1 {
                good = count;
                got.extend(data);
                complete = command & 0x80 != 0;
            }
        }
        assert!(count <= block);
        block = blocks.next().unwrap();
        bench.send(&[0xA2, good, block, 0, 0, 0, 0, 0]);
    }
    let [command, low, high, ..] = bench.receive().unwrap();
    assert_eq!(command & 0xE3, 0xC1);
    got.truncate(got.len() - usize::from(command >> 2 & 7));
    bench.send(&frame("A1"));
    assert_eq!(got.len() as u32, u32::from_le_bytes([a, b, c, d]));
    assert_eq!(crate::crc::update(0, &got), u16::from_le_bytes([low, high]));
    got
}

proptest! {
    #[test]
    fn any_frames_leave_a_usable_server(
        frames in prop::collection::vec((any_frame(), 0u32..4000, 0usize..5), 0..60),
    ) {
        let mut bench = Bench::with(IMAGE, &pattern(1000));
        for (data, pause, room) in frames {
            bench.send(&data);
            for _ in 0..room {
                bench.receive();
            }
            bench.wait_ms(if pause > 3500 { pause } else { pause / 100 });
        }
        let rest = (0..200).take_while(|_| bench.receive().is_some()).count();
        prop_assert!(rest <= 127, "{} frames for one request", rest);
        bench.send(&frame("80"));
        prop_assert_eq!(&bench.objects.sink, &None);
        bench.assert_usable();
        prop_assert!(bench.objects.values[&BYTE].unsigned() <= 100);
        prop_assert!(bench.objects.values[&FLAG].unsigned() <= 1);
    }

    #[test]
    fn what_a_client_downloads_over_a_bad_bus_it_uploads_again(
        length in 0usize..3000,
        blocks in prop::collection::vec(1u8..=127, 1..6),
        losses in prop::collection::vec(prop::bool::weighted(0.1), 0..900),
    ) {
        let content = pattern(length);
        let mut bus = Bus { losses: losses.into() };
        let mut bench = Bench::new();
        download(&mut bench, &content, &mut bus);
        prop_assert_eq!(bench.objects.stream(IMAGE), &content[..]);
        let got = upload(&mut bench, &blocks, &mut bus);
        prop_assert_eq!(got, content);
        bench.assert_usable();
    }
}
