//! The golden vectors of `tilt` as a file, for those who are no Rust program.
//!
//! In: the vectors. Out: `golden.json` beside this file: the samples, and of each mode the
//! calibration as a node stores it, the times of capture and the readings. The Python package
//! (`python/tests`) runs its chain on it. Where the vectors have changed on purpose, run this test
//! with `PLUMB_GOLDEN=write`.

use std::path::Path;
use std::{env, fs};

use device::calibration::encoding;
use tilt::chain::Chain;

#[path = "../../tilt/tests/golden.rs"]
mod vectors;

/// Samples, and the readings at every hundredth of them from the second on.
const SAMPLES: u32 = 900;

fn calibration(chain: &Chain) -> String {
    let mut bytes = vec![0; encoding::length(&chain.calibration) as usize];
    encoding::read_at(&chain.calibration, 0, &mut bytes);
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn mode(name: &str, chain: &Chain, readings: &[(i32, u32, i32)]) -> String {
    let times = (0..u64::from(SAMPLES)).map(|number| vectors::captured_us(chain, number));
    let readings = readings
        .iter()
        .map(|(x, of_x, y)| [i64::from(*x), i64::from(*of_x), i64::from(*y)]);
    format!(
        "\"{name}\": {{\n\"calibration\": \"{}\",\n\"times_us\": {:?},\n\"readings\": {:?}\n}}",
        calibration(chain),
        times.collect::<Vec<_>>(),
        readings.collect::<Vec<_>>(),
    )
}

#[test]
fn the_file_of_golden_vectors_has_the_vectors() {
    let samples: Vec<[i16; 3]> = vectors::samples(SAMPLES).map(|counts| counts.0).collect();
    let text = format!(
        "{{\n\"temperature_q8\": {},\n\"samples\": {samples:?},\n{},\n{}\n}}\n",
        vectors::TEMPERATURE_Q8,
        mode("product", &vectors::product(), vectors::GOLDEN_PRODUCT),
        mode("paper", &vectors::paper(), vectors::GOLDEN_PAPER),
    );
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden.json");
    if env::var_os("PLUMB_GOLDEN").is_some() {
        fs::write(&path, &text).expect("a folder that can be written");
    }
    let kept = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        kept == text,
        "golden.json is not of these vectors: see the head of this file"
    );
}
