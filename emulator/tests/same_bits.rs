//! The signal chain comes to the same bits on the chip as on the host.

use emulator::build::GOLDEN;
use emulator::cpu::Cpu;
use emulator::pair::Pair;
use emulator_golden::{KEPT, Outcome, SAMPLES};

/// Words of [`Outcome`] as it lies in the chip's memory.
const WORDS: usize = 4 * KEPT + 3;

#[test]
fn the_chip_and_the_host_come_to_the_same_angles_bit_for_bit() {
    let mut on_host = Outcome::NOTHING;
    on_host.run();
    assert!(on_host.valid > SAMPLES * 9 / 10, "{}", on_host.valid);

    let image = GOLDEN.image().expect("the image builds");
    let mut pair = Pair::of(1, 1, &image.pieces).expect("it is for the flash");
    pair.run(3.0);
    // The borrow's flag stands before the value.
    let at = image.symbol("GOLDEN").expect("its name is kept") + 4;
    let machine = pair.board(0).machine();
    assert!(machine.sleeps() && machine.faults().is_empty());
    let mut bytes = [0; 4 * WORDS];
    machine.cpu().read(at, &mut bytes).expect("in RAM");
    let on_chip: Vec<_> = (bytes.as_chunks().0.iter())
        .map(|word| i32::from_le_bytes(*word))
        .collect();
    let mut expected = on_host.readings.as_flattened().to_vec();
    expected.extend([
        on_host.hash as i32,
        on_host.valid as i32,
        on_host.done as i32,
    ]);
    assert_eq!(on_chip, expected);
}
