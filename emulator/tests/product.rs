//! The exact images of bootloader and application, on two boards.

use std::sync::OnceLock;
use std::time::Instant;

use canopen::Frame;
use emulator::build::Product;
use emulator::chip::rcc::Cause;
use emulator::pair::Pair;

fn product() -> &'static Product {
    static PRODUCT: OnceLock<Product> = OnceLock::new();
    PRODUCT.get_or_init(|| Product::build().expect("the images build"))
}

fn pair() -> Pair {
    Pair::new(1, &product().pieces()).expect("the image is for the flash")
}

#[test]
fn both_nodes_boot_and_say_so() {
    let mut pair = pair();
    pair.run(1.5);
    for (number, id) in [(0, 0x701), (1, 0x702)] {
        assert_eq!(pair.of_id(id)[0].frame.bytes(), [0]);
        assert_eq!(pair.board(number).machine().resets(), [Cause::Power]);
    }
    pair.send(Frame::data_frame(0, &[1, 0])).unwrap();
    pair.run_synced(100).unwrap();
    assert!(pair.of_id(0x181).len() > 90);
}

#[test]
fn two_product_nodes_run_much_faster_than_time() {
    let mut pair = pair();
    pair.run(1.0);
    pair.send(Frame::data_frame(0, &[1, 0])).unwrap();
    pair.run_synced(50).unwrap();
    let before = pair.board(0).machine().chip().instructions();
    let begun = Instant::now();
    pair.run_synced(1000).unwrap();
    let times = 10.0 / begun.elapsed().as_secs_f64();
    let run = pair.board(0).machine().chip().instructions() - before;
    eprintln!("two emulated nodes: {times:.0} times real time, {run} instructions in 10 s");
    // Measured beside everything else that a test run does; alone it is several times as much.
    assert!(times > 2.0);
}
