//! The division of 64 bits in the product's image against that of the host.
//!
//! In: the linked application, numbers at the edges of each of its ways and numbers drawn by seed.
//! Out: quotient and remainder, the same as the host's.

use std::cell::RefCell;
use std::rc::Rc;

use emulator::build::Product;
use emulator::chip::{Chip, Individual};
use emulator::cortex_m3::CortexM3;
use emulator::cpu::{Cpu, Register, Stop};
use flash::layout::{BASE, RAM, RC};
use sim::lis2dw12::{self, Traits};

/// Where a WFI stands to which the functions return: the last page of the flash has no program.
const RETURN: u32 = BASE + RC.flash - 16;
/// WFI (ARMv7-M Architecture Reference Manual, A7.7.261).
const WFI: [u8; 2] = 0xBF30_u16.to_le_bytes();

/// A core with the product's image in its flash.
fn core(product: &Product) -> CortexM3 {
    let sensor = Rc::new(RefCell::new(lis2dw12::Chip::new(Traits::TYPICAL)));
    let individual = Individual {
        identity: [1, 2, 3],
        crystal: 1.0,
        lsi_hz: 40_000,
        seed: 1,
    };
    let mut cpu = CortexM3::new(Chip::new(RC, individual, sensor, 0));
    while cpu.chip_mut().can.take_action().is_some() {}
    let flash = &mut cpu.chip_mut().flash;
    flash.flash(0, &product.factory).expect("in flash");
    flash.flash(RETURN - BASE, &WFI).expect("in flash");
    cpu.put_flash_right();
    cpu.chip_mut().set_limit_ns(u64::MAX / 2);
    cpu
}

/// Calls the function at `address` by the procedure call standard (AAPCS): quotient and remainder.
fn call(cpu: &mut CortexM3, address: u32, n: u64, d: u64) -> (u64, u64) {
    let words = [n as u32, (n >> 32) as u32, d as u32, (d >> 32) as u32];
    for (register, word) in (0..).zip(words) {
        cpu.set_register(Register::R(register), word);
    }
    // What a call must leave as it was.
    for register in 4..12 {
        cpu.set_register(Register::R(register), u32::from(register));
    }
    cpu.set_register(Register::Sp, RAM + 0x1000);
    cpu.set_register(Register::Lr, RETURN | 1);
    cpu.set_register(Register::Pc, address | 1);
    assert_eq!(cpu.run(), Stop::WaitForInterrupt);
    assert_eq!(cpu.register(Register::Sp), RAM + 0x1000);
    for register in 4..12 {
        assert_eq!(cpu.register(Register::R(register)), u32::from(register));
    }
    let pair = |low| {
        let [low, high] = [low, low + 1].map(|register| cpu.register(Register::R(register)));
        u64::from(high) << 32 | u64::from(low)
    };
    (pair(0), pair(2))
}

/// Numbers at both sides of every power of two.
fn edges() -> Vec<u64> {
    let around = |bit: u32| [-1, 0, 1].map(|by| (1_u64 << bit).wrapping_add_signed(by));
    let mut edges: Vec<_> = (0..64).step_by(3).flat_map(around).collect();
    edges.extend(around(16).into_iter().chain(around(32)));
    edges.extend([0, 1000, 1_000_000, u64::MAX - 1, u64::MAX]);
    edges
}

#[test]
fn the_image_divides_64_bits_as_the_host_does() {
    let product = Product::build().expect("the images build");
    let find = |name| match product.app.symbols_with(&[name])[..] {
        [(_, address)] => address,
        ref found => panic!("{name}: {found:?}"),
    };
    let [unsigned, signed] = ["__aeabi_uldivmod", "__aeabi_ldivmod"].map(find);
    let mut cpu = core(&product);
    let mut state = 1_u64;
    let mut draw = || {
        // The generator SplitMix64: any 64 bits, the same on every run.
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (state ^ state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ mixed >> 31
    };
    let drawn = std::iter::from_fn(|| {
        let shifts = draw();
        Some((draw() >> (shifts & 63), draw() >> (shifts >> 8 & 63)))
    });
    let edges = edges();
    let pairs = edges.iter().flat_map(|n| edges.iter().map(|d| (*n, *d)));
    for (n, d) in pairs.chain(drawn.take(20_000)).filter(|(_, d)| *d != 0) {
        assert_eq!(call(&mut cpu, unsigned, n, d), (n / d, n % d), "{n} / {d}");
        let (n, d) = (n.cast_signed(), d.cast_signed());
        let host = (n.wrapping_div(d), n.wrapping_rem(d));
        let host = (host.0.cast_unsigned(), host.1.cast_unsigned());
        let found = call(&mut cpu, signed, n.cast_unsigned(), d.cast_unsigned());
        assert_eq!(found, host, "{n} / {d}");
    }
}
