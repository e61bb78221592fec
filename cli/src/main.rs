//! plumb
#[allow(dead_code)]
mod text_table;
#[allow(dead_code)]
mod report;
#[allow(dead_code)]
mod progress;
fn main() {}
