//! What the paper publishes of its instrument: the figures that ours stand beside.
//!
//! In: nothing. Out: Tables II and III, and the days of Fig 20. The day of its fault and the bound
//! of Fig 21 are those of the week itself ([`super::week`]).
//!
//! Left out: what the paper draws and does not tabulate.

use crate::rig::Mount;

/// Root mean square error of node 1 and node 2, and mean difference of the nodes, deg, of an axis.
pub type Published = (Mount, [f64; 3]);

/// Table II: the static test.
pub const TABLE_TWO: [Published; 2] = [
    (Mount::X, [0.106, 0.111, 0.018]),
    (Mount::Y, [0.107, 0.112, 0.015]),
];

/// Table III: the dynamic test.
pub const TABLE_THREE: [Published; 2] = [
    (Mount::X, [0.091, 0.100, 0.2]),
    (Mount::Y, [0.088, 0.085, 0.1]),
];

/// Section VII and Fig 20: days on the excavator.
pub const DAYS: u32 = 7;
