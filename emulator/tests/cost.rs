//! The committed page on costs is what is counted.

use std::fs;

use emulator::build::{Paper, Product};
use emulator::cost::{Figures, differences, document};

#[test]
fn the_page_on_costs_is_what_the_image_costs() {
    let product = Product::build().expect("the images build");
    let variant = Product::dynamic().expect("the images build");
    let paper = Paper::build().expect("the images build");
    let counted = Figures::count(&product, &variant, &paper).expect("it runs");
    let committed = fs::read_to_string(document()).unwrap_or_default();
    let found = differences(&committed, &counted);
    assert!(
        found.is_empty(),
        "docs/cost.md is not what was counted:\n  {}\nIf that is as it should be, renew it with\n  \
         cargo run -p emulator --example cost -- --write",
        found.join("\n  ")
    );
}
