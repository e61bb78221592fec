//! From what was read at the stands to a calibration.

use tilt::ONE_G;
use tilt::filter::Filtered;
use tilt::sample::Temperature;
use tilt::temperature::TemperatureModel;

/// A mean reading, in steps of 2^-26 g, compensated by `model` at this temperature, in g.
pub fn compensated_g(
    model: &TemperatureModel,
    accel: [f64; 3],
    temperature: Temperature,
) -> [f64; 3] {
    let filtered = Filtered {
        accel: accel.map(|a| a.round() as i32),
    };
    let compensated = model.apply(filtered, temperature);
    compensated.accel.map(|a| f64::from(a) / f64::from(ONE_G))
}
