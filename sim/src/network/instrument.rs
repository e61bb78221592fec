//! An instrument from the bench, put on the bus: two nodes with the calibration it left with.
//!
//! In: a mode, a world, a seed and the unit's number, as [`Bench`] takes them. Out: two nodes of a
//! [`Network`] with power off. The bench's instrument and the one on the bus are drawn from the
//! same numbers, so they are the same parts; on the bus their time starts anew.
//!
//! Left out: what the bench did to the parts besides calibrating them: they come conditioned, in
//! the middle of their thermal hysteresis, as the bench leaves them.

use canopen::object::{Address, Value, at};
use device::calibration::deliver;
use device::calibration::motor::{MOTOR, TableSettings};
use device::channel::Settings;
use device::device::Factory;
use device::objects::communication::PEER_HEARTBEAT_MS;
use device::objects::device_objects::{Identity, store_lss};
use device::objects::table::{Channel, Models, exchange};
use device::records::{Record, RecordStore, StoreError, parameters};
use tilt::chain::Calibration;
use tilt::cross_check::CrossCheck;
use tilt::table::Rule;

use super::Network;
use crate::bench::{Bench, BenchError, Mode, World};
use crate::electronics::Electronics;
use crate::error_model::ErrorModel;
use crate::memory::Memory;
use crate::rng::Rng;

/// The node-id of a node that has none (CiA 305).
pub const UNCONFIGURED: u8 = 255;

/// How one node is put on the bus.
#[derive(Clone, Debug)]
pub struct Fitting {
    /// Node-id until LSS stores another; [`UNCONFIGURED`] for none.
    pub node_id: u8,
    /// Bit rate until LSS stores another, kbit/s.
    pub kbit_s: u16,
    /// What the node finds in its memory.
    pub memory: Memory,
}

/// An instrument as it is delivered.
#[derive(Clone, Debug)]
pub struct Delivered {
    check: CrossCheck,
    parts: ErrorModel,
    rule: Rule,
    seed: u64,
    unit: u32,
    settings: [Settings; 2],
    calibrated: bool,
    models: Models,
}

impl Delivered {
    /// Through the whole bench: chamber, motor, verification.
    ///
    /// Errors: see [`BenchError`].
    pub fn calibrated(mode: Mode, world: &World, seed: u64, unit: u32) -> Result<Self, BenchError> {
        let (bench, _) = Bench::commissioned(mode, world, seed, unit)?;
        let [a, b] = bench.instrument.sides;
        Ok(Self {
            settings: [a.settings, b.settings],
            calibrated: true,
            ..Self::bare(mode, world, seed, unit)
        })
    }

    /// As it was soldered: its nodes report that they are not calibrated, and have nothing of their
    /// parts but whether these have any noise at all.
    pub fn bare(mode: Mode, world: &World, seed: u64, unit: u32) -> Self {
        let mut settings = world.settings(mode);
        let parts = world.parts_of(mode);
        settings.noise = parts.known_noise();
        Self {
            check: mode.check(),
            parts,
            rule: world.rule(mode),
            seed,
            unit,
            settings: [settings.clone(), settings],
            calibrated: false,
            models: match mode {
                Mode::Product | Mode::OneAxis => Models::PRODUCT,
                Mode::Dynamic => Models::DYNAMIC,
                // The simulated one has the product's services beside.
                _ => Models::WHOLE,
            },
        }
    }

    /// Which objects its nodes have.
    pub const fn models(&self) -> Models {
        self.models
    }

    /// The same, judging by `check` instead of the one of its mode.
    pub fn judging_by(self, check: CrossCheck) -> Self {
        Self { check, ..self }
    }

    /// What the node of `channel` is soldered to.
    pub fn electronics(&self, channel: Channel) -> Electronics {
        let (unit, node) = (self.unit, channel as u32 + 1);
        let rng = Rng::stream(self.seed, &format!("unit {unit} node {node}"));
        Electronics::with(&self.settings[channel as usize].part, &self.parts, rng)
    }

    /// The calibration that the node of `channel` leaves the bench with, if it was calibrated.
    pub fn calibration(&self, channel: Channel) -> Option<&Calibration> {
        let settings = &self.settings[channel as usize];
        self.calibrated.then_some(&settings.chain.calibration)
    }

    /// Writes what the node of `channel` leaves the bench with into its memory: its calibration,
    /// if it was calibrated.
    ///
    /// Errors: those of the store.
    pub fn write_to(&self, channel: Channel, memory: &mut Memory) -> Result<(), StoreError> {
        match self.calibration(channel) {
            Some(calibration) => deliver(memory, calibration),
            None => Ok(()),
        }
    }

    /// Puts both nodes on the bus, without power; their numbers. The serial numbers are those of
    /// the unit: 2 u + 1 and 2 u + 2.
    ///
    /// # Panics
    /// When the bus is full ([`crate::can_bus::MOST_PORTS`]).
    pub fn join(self, network: &mut Network, fittings: [Fitting; 2]) -> [usize; 2] {
        let unit = self.unit;
        let [a, b] = fittings;
        let (ids, rates) = ([a.node_id, b.node_id], [a.kbit_s, b.kbit_s]);
        let mut memories = [a.memory, b.memory];
        acquaint(&mut memories, ids, self.models);
        let [for_a, for_b] = memories;
        [(Channel::A, for_a), (Channel::B, for_b)].map(|(channel, mut memory)| {
            let place = channel as usize;
            let electronics = self.electronics(channel);
            // As with what is introduced above: a broken memory is a fault for later.
            let _ = self.write_to(channel, &mut memory);
            let factory = Factory {
                identity: Identity {
                    channel,
                    serial: 2 * unit + channel as u32 + 1,
                    models: self.models,
                },
                node_id: ids[place],
                kbit_s: rates[place],
                table_settings: TableSettings {
                    rule: self.rule,
                    reference: MOTOR,
                },
                setup: self.settings[place].setup(),
            };
            network.add(electronics, self.check.clone(), factory, memory)
        })
    }
}

/// Tells the nodes of channels A and B who they are, as LSS and a commissioning tool do, before
/// their first start: node-ids ([`UNCONFIGURED`] for none) and the bit rate, kbit/s. `models` sets
/// which instrument they are of.
///
/// Errors: those of the store.
pub fn commission<M: RecordStore>(
    memories: &mut [M; 2],
    ids: [u8; 2],
    kbit_s: u16,
    models: Models,
) -> Result<(), StoreError> {
    acquaint(memories, ids, models);
    for (memory, id) in memories.iter_mut().zip(ids) {
        store_lss(memory, id, Some(kbit_s))?;
    }
    Ok(())
}

/// Nodes with other node-ids than they are delivered with are told those of their peers.
fn acquaint<M: RecordStore>([for_a, for_b]: &mut [M; 2], [a, b]: [u8; 2], models: Models) {
    if [a, b] != [Channel::A.node_id(), Channel::B.node_id()] {
        introduce(for_a, b, models);
        introduce(for_b, a, models);
    }
}

/// Writes a peer's node-id where a commissioning tool would, unless something is stored there or
/// the peer has none yet: peer, its heartbeat, its exchange.
fn introduce<M: RecordStore>(memory: &mut M, peer: u8, models: Models) {
    let mut nothing = |record| memory.read(record, 0, &mut [0]) == 0;
    let free = nothing(Record::Manufacturer) && nothing(Record::Communication);
    if peer == UNCONFIGURED || !free {
        return;
    }
    let id = u32::from(peer);
    let heartbeat = id << 16 | u32::from(PEER_HEARTBEAT_MS);
    let mut told = vec![
        (Record::Manufacturer, at(0x2001, 0), Value::u8(peer)),
        (Record::Communication, at(0x1016, 1), Value::u32(heartbeat)),
    ];
    told.extend(exchange(models).map(|(index, base)| {
        let identifier = Value::u32(base + id);
        (Record::Communication, at(index, 1), identifier)
    }));
    for record in [Record::Manufacturer, Record::Communication] {
        // The host's memory holds these few bytes; a broken one is a fault for later.
        let _ = store(memory, record, &told);
    }
}

fn store<M: RecordStore>(
    memory: &mut M,
    record: Record,
    told: &[(Record, Address, Value)],
) -> Result<(), StoreError> {
    RecordStore::begin(memory, record, record.longest())?;
    for (_, address, value) in told.iter().filter(|(of, ..)| *of == record) {
        parameters::put(memory, *address, value)?;
    }
    RecordStore::commit(memory)
}

#[cfg(test)]
mod tests {
    use super::*;
    use device::calibration::stage;

    use crate::memory;
    use crate::network::hand::{Hand, Pose};

    fn fitting(node_id: u8) -> Fitting {
        Fitting {
            node_id,
            kbit_s: 250,
            memory: memory::blank(),
        }
    }

    fn errors_deg(delivered: Delivered) -> Vec<f64> {
        let mut network = Network::new(250_000, 1);
        let _host = network.attach_host();
        let nodes = delivered.join(&mut network, [fitting(1), fitting(2)]);
        nodes.iter().for_each(|n| network.power_on(*n));
        let mut hand = Hand::new(Rng::stream(1, "hand"));
        assert!(hand.go(Pose {
            pitch_deg: 30.0,
            roll_deg: -10.0
        }));
        network.run_until(&mut hand, 3_000_000_000, |_| {});
        let slopes = |n: &usize| [0, 1].map(|axis| network.shown(*n).slope(axis));
        let read = nodes.iter().flat_map(slopes);
        read.zip([-10.0, 30.0, -10.0, 30.0])
            .map(|(read, truth)| read.expect("an angle").degrees() - truth)
            .collect()
    }

    #[test]
    fn on_the_bus_it_measures_as_well_as_on_the_bench() {
        let world = &World::NOMINAL;
        let delivered = Delivered::calibrated(Mode::Product, world, 1, 0).unwrap();
        let errors = errors_deg(delivered);
        assert!(errors.iter().all(|e| e.abs() < 0.15), "{errors:?}");
        let bare = errors_deg(Delivered::bare(Mode::Product, world, 1, 0));
        assert!(bare.iter().any(|e| e.abs() > 0.3), "{bare:?}");
    }

    /// Over a power cut the correction of the gyroscope is that of the calibration that counts, and
    /// of no other.
    #[test]
    fn a_node_has_the_gyroscope_of_the_calibration_that_counts() {
        let world = &World::NOMINAL;
        let delivered = Delivered::calibrated(Mode::Dynamic, world, 1, 0).unwrap();
        let of = |channel| delivered.calibration(channel).and_then(|c| c.rates);
        let rates = [Channel::A, Channel::B].map(of);
        assert!(rates[0].is_some() && rates[1].is_some() && rates[0] != rates[1]);
        let own = delivered.calibration(Channel::A).cloned().unwrap();
        let mut network = Network::new(250_000, 1);
        let _host = network.attach_host();
        let nodes = delivered.join(&mut network, [fitting(1), fitting(2)]);
        let mut hand = Hand::new(Rng::stream(1, "hand"));
        let mut start = |network: &mut Network| {
            nodes.iter().for_each(|n| network.power_off(*n));
            nodes.iter().for_each(|n| network.power_on(*n));
            let until_ns = network.now_ns() + 300_000_000;
            network.run_until(&mut hand, until_ns, |_| {});
            nodes.map(|n| network.nodes()[n].device.settings().chain.calibration.rates)
        };
        assert_eq!(start(&mut network), rates);
        let without = Calibration { rates: None, ..own };
        let memory = network.node(nodes[0]).device.memory();
        stage(memory, Record::Calibration, &without).unwrap();
        memory.commit().unwrap();
        assert_eq!(start(&mut network), [None, rates[1]]);
        let memory = network.node(nodes[0]).device.memory();
        memory.erase(Record::Calibration).unwrap();
        assert_eq!(start(&mut network), rates);
    }

    #[test]
    fn nodes_with_other_ids_have_each_other_as_peers() {
        let world = &World::NOMINAL;
        let mut network = Network::new(250_000, 1);
        let _host = network.attach_host();
        let delivered = Delivered::bare(Mode::Product, world, 1, 1);
        let nodes = delivered.join(&mut network, [fitting(3), fitting(4)]);
        nodes.iter().for_each(|n| network.power_on(*n));
        let mut hand = Hand::new(Rng::stream(1, "hand"));
        network.run_until(&mut hand, 300_000_000, |_| {});
        let parameters = |n: usize| &network.nodes()[n].device.values().parameters;
        let peers = nodes.map(|n| parameters(n).peer);
        assert_eq!(peers, [4, 3]);
    }
}
