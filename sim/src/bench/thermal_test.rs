//! Static accuracy over temperature: random angles from -10 to 70 degC, on both branches.
//!
//! In: a calibrated instrument. Out: points as in the static test. The paper gives no such figure;
//! the chamber and the motor are used together here, which a laboratory does with a shaft through
//! the chamber's wall.

use super::Bench;
use super::static_test::StaticPoint;
use crate::rig::Mount;

/// Down to the cold end, up to the hot end and back: every temperature is met on both branches.
const PATH_C: [f64; 9] = [0.0, -10.0, 10.0, 30.0, 50.0, 70.0, 50.0, 30.0, 10.0];

impl Bench {
    /// Reads both nodes at `angles` random angles at each temperature of the path.
    pub fn thermal_test(&mut self, mount: Mount, angles: usize) -> Vec<StaticPoint> {
        let mut points = Vec::new();
        self.mount(mount, 0.0, 0.0);
        for celsius in PATH_C {
            self.bring_to(celsius);
            self.run(2.0);
            let angles_deg = self.random_angles(angles, 90.0);
            points.extend(self.static_test(mount, &angles_deg));
        }
        points
    }
}
