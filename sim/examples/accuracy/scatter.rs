//! The stated uncertainty beside the scatter that is seen.

use std::fmt::Write as _;

use sim::bench::Bench;
use sim::bench::statistics::{Tally, median};
use sim::rig::Mount;

use crate::Passage;

/// Reported uncertainty beside observed scatter at the angles of the specification.
pub fn section(page: &mut String, compared: &[(&str, &[Passage])]) {
    page.push_str(
        "## Standard uncertainty compared with observed scatter\n\nSingle readings within half a \
         degree of the angle, both signs, both nodes, of units that were switched off and on. \
         Scatter is the rms error against the truth; the uncertainty is what the readings report \
         (k = 1). The ratio of the medians must lie within 0.8 and 1.2. Pooled is the ratio over \
         all units together; as printed at 89 deg it is governed by the few units whose mounting \
         folds the sine before 90 deg.\n\n\
         | mode | angle, deg | scatter, median unit | uncertainty, median unit | ratio | kept | \
         pooled |\n\
         |---|---|---|---|---|---|---|\n",
    );
    for (name, units) in compared {
        for (i, angle) in ANGLES.iter().enumerate() {
            let of = |pick: fn(&[Tally; 2]) -> &Tally| -> Vec<f64> {
                units.iter().map(|u| pick(&u.scatter[i]).rms()).collect()
            };
            let (mut seen, mut said) = (of(|t| &t[0]), of(|t| &t[1]));
            let pooled = pool(&said) / pool(&seen);
            let (seen, said) = (median(&mut seen), median(&mut said));
            let kept = if (said / seen - 1.0).abs() <= 0.2 {
                "yes"
            } else {
                "NO"
            };
            let _ = writeln!(
                page,
                "| {name} | {angle:.0} | {seen:.3} | {said:.3} | {:.2} | {kept} | {pooled:.2} |",
                said / seen
            );
        }
    }
    page.push('\n');
}

/// Where the scatter is taken, deg.
pub const ANGLES: [f64; 4] = [0.0, 45.0, 80.0, 89.0];

fn pool(rms: &[f64]) -> f64 {
    (rms.iter().map(|v| v * v).sum::<f64>() / rms.len() as f64).sqrt()
}

/// Per angle: errors and reported uncertainties of one unit, single readings, switched off and on.
pub fn of_unit(bench: &mut Bench) -> [[Tally; 2]; 4] {
    bench.power_cycle();
    bench.mount(Mount::X, 0.0, 0.0);
    ANGLES.map(|angle| {
        let mut tallies = [Tally::default(); 2];
        for _ in 0..8 {
            let sign = bench.rng.sign();
            let off = bench.rng.range(-0.5, 0.5);
            let point = bench.single_reading(Mount::X, sign * (angle + off));
            for node in point.nodes.iter().filter(|n| n.angle_deg.is_some()) {
                tallies[0].add(node.error_deg);
                tallies[1].add(node.uncertainty_deg);
            }
        }
        tallies
    })
}
