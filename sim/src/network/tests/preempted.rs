//! What waits in a node's three mailboxes makes room for what outranks it, however busy the bus.

use super::*;

/// Outranks what node B has to send but for its EMCY.
const FLOOD: u16 = 0x100;

impl Site {
    fn flood(&mut self, stranger: Port, id: Option<u16>) {
        let frame = id.map(|id| Frame::data_frame(id, &[0xAA; 8]));
        self.network.bus.babble(stranger, frame);
    }

    fn emergencies(&self) -> usize {
        self.times_of(0x82).len()
    }
}

/// Node B has LSS answer, heartbeat and SDO answer in its mailboxes, and a stranger sends without
/// a pause.
fn flooded() -> (Site, Port) {
    let mut site = Site::new(250);
    site.run(&mut level(), 600 * MS);
    let stranger = site.network.attach_host();
    for request in [[4, 1, 0, 0, 0, 0, 0, 0], [0x5E, 0, 0, 0, 0, 0, 0, 0]] {
        site.send(0x7E5, &request);
    }
    // From within the second request on.
    site.run(&mut level(), 900_000);
    site.flood(stranger, Some(0x650));
    site.run(&mut level(), 210 * MS);
    site.send(0x602, &[0x40, 0x18, 0x10, 1, 0, 0, 0, 0]);
    // The request goes before the flood, and nothing comes between its end and the greater one.
    while site.network.bus.on_wire(site.host).is_none() {
        site.run(&mut level(), 10_000);
    }
    site.flood(stranger, Some(FLOOD));
    site.run(&mut level(), MS);
    assert_eq!(site.times_of(0x602).len(), 1);
    site.trace.clear();
    site.run(&mut level(), 100 * MS);
    assert!(site.times_of(FLOOD).len() > 150);
    for id in [0x582, 0x702, 0x7E4] {
        assert_eq!(site.times_of(id), [], "{id:X}h");
    }
    (site, stranger)
}

#[test]
fn an_emcy_waited_behind_three_frames_for_as_long_as_a_flood_lasted() {
    let (mut site, stranger) = flooded();
    assert_eq!(site.emergencies(), 0);
    for told in 1..=3 {
        let now = site.network.nodes()[1]
            .electronics
            .clock(site.network.now_s());
        site.network.node(1).device.frames_lost(told, now);
        site.run(&mut level(), 2 * MS);
        assert_eq!(site.emergencies(), usize::from(told));
    }
    site.flood(stranger, None);
    site.trace.clear();
    site.run(&mut level(), 50 * MS);
    // Nothing is lost and nothing comes twice; more heartbeats were due meanwhile.
    let ids = site.trace.iter().filter_map(|(_, frame)| frame.cob_id());
    let low = [0x582, 0x702, 0x7E4];
    let mut ids: Vec<_> = ids.filter(|id| low.contains(id)).collect();
    ids.dedup();
    assert_eq!(ids, low);
    // Node A has an LSS answer, too.
    assert_eq!(
        (site.times_of(0x582).len(), site.times_of(0x7E4).len()),
        (1, 2)
    );
}
