//! Calibrated instruments, kept: the bench takes longer than many trials.
//!
//! In: which modes and units. Out: the instruments, as often as asked for. They go through the
//! whole bench once, in the nominal world.

use crate::bench::{BenchError, Mode, World};
use crate::network::instrument::Delivered;

/// Seed of the bench that the units come from.
const BENCH_SEED: u64 = 1;

/// Instruments by mode and unit.
#[derive(Clone, Debug, Default)]
pub struct Pool(Vec<(Mode, u32, Delivered)>);

impl Pool {
    /// Commissions every unit of the list once.
    ///
    /// Errors: see [`BenchError`].
    pub fn of(units: &[(Mode, u32)]) -> Result<Self, BenchError> {
        let mut pool = Self::default();
        for &(mode, unit) in units {
            if pool.get(mode, unit).is_none() {
                let world = World::NOMINAL;
                let delivered = Delivered::calibrated(mode, &world, BENCH_SEED, unit)?;
                pool.0.push((mode, unit, delivered));
            }
        }
        Ok(pool)
    }

    /// One instrument; `None` when it isn't kept.
    pub fn get(&self, mode: Mode, unit: u32) -> Option<&Delivered> {
        let wanted = |kept: &&(Mode, u32, Delivered)| kept.0 == mode && kept.1 == unit;
        self.0.iter().find(wanted).map(|kept| &kept.2)
    }
}
