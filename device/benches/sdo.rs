//! Time of an SDO upload of a four-byte object on the device's side, from request to response.
//!
//! In: nothing. Out: criterion's figures. On the host these compare one version with another.

mod instrument;

use std::hint::black_box;

use criterion::Criterion;

fn main() {
    let mut criterion = Criterion::default().configure_from_args();
    let mut instrument = instrument::Instrument::new();
    criterion.bench_function("SDO upload of 4 bytes", |bencher| {
        bencher.iter(|| black_box(&mut instrument).upload());
    });
    criterion.final_summary();
}
