//! The log of a bus with two calibrated product nodes on an excavator's arm, 100 SYNC/s, as
//! `candump -L` would have written it: for measuring readers of logs by what a bus really carries.
//!
//! In: a number of frames. Out: that many lines on standard output, the same ones each time.

use std::io::{self, BufWriter, Write};

use canopen::Frame;
use canopen::frame::Id;
use sim::bench::{Mode, World};
use sim::can_bus::Event;
use sim::excavator::{Excavator, ExcavatorSetup};
use sim::memory;
use sim::network::Network;
use sim::network::instrument::{Delivered, Fitting};
use sim::rng::Rng;

const KBIT_S: u16 = 250;
const SYNC_NS: u64 = 10_000_000;
/// Until then the parts are set up and the filters settle.
const SETTLED_NS: u64 = 1_000_000_000;
/// The log's first second, s since 1970.
const START_S: u64 = 1_700_000_000;

fn main() -> io::Result<()> {
    let number = std::env::args().nth(1).and_then(|text| text.parse().ok());
    let mut left: u64 = number.unwrap_or(1000);
    let mut network = Network::new(u32::from(KBIT_S) * 1000, 1);
    let host = network.attach_host();
    let fittings = [1, 2].map(|node_id| Fitting {
        node_id,
        kbit_s: KBIT_S,
        memory: memory::blank(),
    });
    let delivered = Delivered::calibrated(Mode::Product, &World::NOMINAL, 1, 0);
    for node in delivered
        .map_err(|e| io::Error::other(format!("{e:?}")))?
        .join(&mut network, fittings)
    {
        network.power_on(node);
    }
    let mut arm = Excavator::new(&ExcavatorSetup::NOMINAL, &mut Rng::stream(1, "arm"));
    let mut out = BufWriter::new(io::stdout().lock());
    let mut until_ns = SETTLED_NS;
    let mut first = true;
    while left > 0 {
        let mut written = Ok(());
        network.run_until(&mut arm, until_ns, |event| {
            let (frame, at_ns) = match *event {
                Event::Delivered {
                    frame, to, at_ns, ..
                } if to.contains(host) => (frame, at_ns),
                Event::Sent {
                    port,
                    frame,
                    end_ns,
                    ..
                } if port == host => (frame, end_ns),
                _ => return,
            };
            if left > 0 && written.is_ok() {
                left -= 1;
                written = line(&mut out, &frame, at_ns);
            }
        });
        written?;
        // NMT: start all nodes; then SYNC.
        let (id, bytes): (u16, &[u8]) = if first { (0, &[1, 0]) } else { (0x080, &[]) };
        first = false;
        let offered = network.bus.offer(host, Frame::data_frame(id, bytes));
        offered.map_err(|_| io::Error::other("the host has no mailbox"))?;
        until_ns += SYNC_NS;
    }
    out.flush()
}

fn line(out: &mut impl Write, frame: &Frame, at_ns: u64) -> io::Result<()> {
    let us = at_ns / 1000;
    let Id::Standard(id) = frame.id() else {
        return Ok(());
    };
    let (seconds, us) = (START_S + us / 1_000_000, us % 1_000_000);
    write!(out, "({seconds}.{us:06}) can0 {:03X}#", id.as_raw())?;
    frame
        .bytes()
        .iter()
        .try_for_each(|byte| write!(out, "{byte:02X}"))?;
    writeln!(out)
}
