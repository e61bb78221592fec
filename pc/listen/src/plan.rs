//! Which instruments are on a bus, and what their nodes send.
//!
//! In: node-ids, and for nodes that are not as delivered what an EDS or DCF has. Out: a [`Plan`]:
//! per node the COB-IDs of its services, what each PDO carries, and the units.
//!
//! Left out: reading such files (`eds`).

use device::objects::pdo;
use device::objects::row::{self, Row};

/// The instruments on a bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Node-ids of channel A and channel B of each instrument.
    pub pairs: Vec<[u8; 2]>,
    /// Nodes that are not as delivered.
    pub nodes: Vec<NodePlan>,
}

impl Default for Plan {
    /// One instrument with node-ids 1 and 2, its PDOs as delivered.
    fn default() -> Self {
        Self::of(vec![[1, 2]])
    }
}

impl Plan {
    /// Instruments of these node-ids, as delivered.
    pub const fn of(pairs: Vec<[u8; 2]>) -> Self {
        Self {
            pairs,
            nodes: Vec::new(),
        }
    }

    /// What is known of a node.
    pub fn node(&self, node_id: u8) -> NodePlan {
        let told = self.nodes.iter().find(|node| node.node_id == node_id);
        told.cloned()
            .unwrap_or_else(|| NodePlan::as_delivered(node_id))
    }
}

/// What a node sends, and in which units.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodePlan {
    /// Node-id.
    pub node_id: u8,
    /// COB-ID of the SYNC that it obeys (1005h).
    pub sync: u16,
    /// COB-ID of its EMCY (1014h).
    pub emcy: u16,
    /// Its heartbeat counts as lost after this time at the earliest, ms (1016h of the other one);
    /// 0 never.
    pub lost_after_ms: u32,
    /// The unit of slopes, 0.001 deg (6000h).
    pub resolution_mdeg: i32,
    /// Lowest and highest X, then Y, 0.001 deg (2040h).
    pub range_mdeg: [[i32; 2]; 2],
    /// What it sends, at most eight.
    pub pdos: Vec<PdoPlan>,
}

/// A PDO that a node sends.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PdoPlan {
    /// Its COB-ID, 11 bit.
    pub cob_id: u16,
    /// It comes at every n-th SYNC; 0 when SYNC does not tell when it comes.
    pub every: u8,
    /// Its length, bytes.
    pub length: u8,
    /// What it carries.
    pub fields: Vec<Field>,
}

/// A value in a PDO.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its lowest bit, 0 to 63.
    pub shift: u8,
    /// Its length, 1 to 64 bit.
    pub bits: u8,
    /// What it is.
    pub what: What,
}

/// What a value is, X being axis 0 and Y axis 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// A slope in the unit of 6000h; its lowest number stands for none.
    Slope(u8),
    /// 2020h.
    Validity,
    /// 2021h.
    State,
    /// 2022h, any of it.
    Uncertainty,
    /// 2023h sub 2, ms.
    Latency,
    /// 2024h: sub 1 and 2 of an axis, sub 3 (axis 2) the larger of both.
    Difference(u8),
    /// 6511h, degC.
    Temperature,
    /// 2010h sub 1, 2: an angle of the exchange.
    Angle(u8),
    /// 2010h sub 3, 4: its quality.
    Quality(u8),
    /// 2010h sub 5 to 7: the acceleration along an axis.
    Vector(u8),
    /// 2010h sub 8: instant of the SYNC.
    Captured,
    /// 2010h sub 9: energy above 150 Hz.
    Activity,
    /// 2029h sub 1, 2: a slope of the moment, like [`What::Slope`].
    SlopeNow(u8),
    /// 2029h sub 3.
    UncertaintyNow,
    /// 202Ah sub 1 to 3: a rate of turn, Z being axis 2.
    Rate(u8),
    /// 202Bh sub 1 to 3: how far it has turned, for the other channel.
    Turned,
    /// Anything else.
    Other,
}

impl What {
    /// What this object is.
    pub const fn of(index: u16, sub: u8) -> Self {
        match (index, sub) {
            (0x6010 | 0x6110, 0) => Self::Slope(0),
            (0x6020 | 0x6120, 0) => Self::Slope(1),
            (0x2020, 0) => Self::Validity,
            (0x2021, 0) => Self::State,
            (0x2022, 1..=3) => Self::Uncertainty,
            (0x2023, 2) => Self::Latency,
            (0x2024, 1..=3) => Self::Difference(sub - 1),
            (0x6511, 0) => Self::Temperature,
            (0x2010, 1 | 2) => Self::Angle(sub - 1),
            (0x2010, 3 | 4) => Self::Quality(sub - 3),
            (0x2010, 5..=7) => Self::Vector(sub - 5),
            (0x2010, 8) => Self::Captured,
            (0x2010, 9) => Self::Activity,
            (0x2029, 1 | 2) => Self::SlopeNow(sub - 1),
            (0x2029, 3) => Self::UncertaintyNow,
            (0x202A, 1..=3) => Self::Rate(sub - 1),
            (0x202B, 1..=3) => Self::Turned,
            _ => Self::Other,
        }
    }

    /// What only an instrument with a gyroscope has.
    pub const fn is_of_gyroscope(self) -> bool {
        matches!(
            self,
            Self::SlopeNow(_) | Self::UncertaintyNow | Self::Rate(_) | Self::Turned
        )
    }
}

impl PdoPlan {
    /// A PDO of mapped objects as 1A00h has them: index, sub-index and length in bit.
    pub fn of(cob_id: u16, every: u8, mapping: &[u32]) -> Self {
        let mut shift = 0_u32;
        let mut fields = Vec::with_capacity(mapping.len());
        for object in mapping {
            let (index, sub, bits) = ((object >> 16) as u16, (object >> 8) as u8, *object as u8);
            if bits == 0 || shift + u32::from(bits) > 64 {
                break;
            }
            fields.push(Field {
                shift: shift as u8,
                bits,
                what: What::of(index, sub),
            });
            shift += u32::from(bits);
        }
        Self {
            cob_id,
            every,
            length: shift.div_ceil(8) as u8,
            fields,
        }
    }

    /// True when it carries one of these.
    pub fn has(&self, is: impl Fn(What) -> bool) -> bool {
        self.fields.iter().any(|field| is(field.what))
    }
}

/// The PDOs as delivered: COB-ID less the node-id, SYNCs from one to the next, and the rows of the
/// mapping. The last three are of instruments with a gyroscope: the first two of them come only
/// where a master has switched them on.
const AS_DELIVERED: [(u16, u8, &[Row]); 7] = [
    (0x180, 1, &pdo::TPDO_1_MAPPING),
    (0x280, 10, &pdo::TPDO_2_MAPPING),
    (0x380, 1, &pdo::TPDO_3_MAPPING),
    (0x480, 1, &pdo::TPDO_4_MAPPING),
    (0x200, 1, &pdo::TPDO_5_MAPPING),
    (0x300, 1, &pdo::TPDO_6_MAPPING),
    (0x400, 1, &pdo::TPDO_7_MAPPING),
];

impl NodePlan {
    /// A node that nobody has configured but for its node-id.
    pub fn as_delivered(node_id: u8) -> Self {
        let id = u16::from(node_id);
        let pdos = AS_DELIVERED
            .iter()
            .map(|(base, every, rows)| PdoPlan::of(base + id, *every, &mapped(rows)));
        Self {
            node_id,
            sync: 0x080,
            emcy: 0x080 + id,
            lost_after_ms: 500,
            resolution_mdeg: 10,
            range_mdeg: [[-90_000, 90_000]; 2],
            pdos: pdos.collect(),
        }
    }
}

/// What a mapping has in it as delivered, behind the row with the number of its objects.
fn mapped(rows: &[Row]) -> Vec<u32> {
    let objects = rows.iter().skip(1).filter_map(|row| match row.default {
        row::Default::Value(object) => u32::try_from(object).ok(),
        _ => None,
    });
    objects.filter(|object| *object != 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mapping_of_more_than_eight_bytes_stops_there() {
        let pdo = PdoPlan::of(0x181, 1, &[0x2010_0540; 3]);
        assert_eq!((pdo.length, pdo.fields.len()), (8, 1));
        let pdo = PdoPlan::of(0x181, 1, &[0x2020_0001, 0x2021_0002]);
        assert_eq!((pdo.length, pdo.fields[1].shift), (1, 1));
        assert_eq!(PdoPlan::of(0x181, 1, &[0]).length, 0);
    }

    #[test]
    fn as_delivered_is_what_the_node_has() {
        let lengths = NodePlan::as_delivered(1)
            .pdos
            .iter()
            .map(|p| p.length)
            .collect::<Vec<_>>();
        assert_eq!(lengths, [6, 8, 8, 8, 8, 7, 8]);
    }
}
