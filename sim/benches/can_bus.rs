//! Speed of the bus: frames sent per second by one core.
//!
//! In: nothing. Out: criterion's figures for a second of virtual time at 1 Mbit/s with four nodes
//! and a bus that is never idle, and for the length of one frame in bits.

use std::hint::black_box;

use canopen::Frame;
use criterion::{Criterion, Throughput};
use sim::can_bus::{Bus, Event, Port, TransmitOrder, frame_bits};

const NODES: u16 = 4;
const SECOND_NS: u64 = 1_000_000_000;

/// Four nodes that always have a frame of 8 bytes in a mailbox.
struct Full {
    bus: Bus,
    value: u64,
}

impl Full {
    fn new() -> Self {
        let mut full = Self {
            bus: Bus::new(1_000_000, 1),
            value: 0,
        };
        for _ in 0..NODES {
            let port = full.bus.attach(TransmitOrder::Identifier);
            full.offer(port);
            full.offer(port);
        }
        full
    }

    fn offer(&mut self, port: Port) {
        self.value = self.value.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let id = 0x181 + port.index() as u16;
        let frame = Frame::data_frame(id, &self.value.to_le_bytes());
        black_box(self.bus.offer(port, frame).is_ok());
    }

    /// Returns the number of frames sent.
    fn second(&mut self) -> u64 {
        let until_ns = self.bus.now_ns() + SECOND_NS;
        let mut frames = 0;
        while let Some(event) = self.bus.step(until_ns) {
            if let Event::Sent { port, .. } = event {
                frames += 1;
                self.offer(port);
            }
        }
        frames
    }
}

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut group = criterion.benchmark_group("can bus");
    let mut full = Full::new();
    group.throughput(Throughput::Elements(full.second()));
    group.bench_function("four nodes at full load for a second", |bencher| {
        bencher.iter(|| full.second());
    });
    let frame = Frame::data_frame(0x181, &[1, 2, 3, 4, 5, 6, 7, 8]);
    group.throughput(Throughput::Elements(1));
    group.bench_function("length of a frame", |bencher| {
        bencher.iter(|| frame_bits(black_box(&frame)));
    });
    group.finish();
    criterion.final_summary();
}
