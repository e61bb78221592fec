//! The instrument's driver against the model: both sides of the wire at once.

use device::sensor::{
    Bandwidth, Config, Fifo, InitError, Lis2dw12, Mismatch, Rate, ReadError, Register,
    SelfTestError, VerifyError,
};
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorKind, Operation, SpiDevice};
use proptest::prelude::*;
use tilt::sample::{Counts, FullScale, Temperature};

use super::*;
use crate::spi_part::bench::{Felt, Sampling};

type Bench = spi_part::bench::Bench<Chip>;

impl Sampling for Chip {
    fn odr_hz(&self) -> Option<f64> {
        Chip::odr_hz(self)
    }

    fn sample(&mut self, felt: &Felt) {
        self.convert(felt.force_g, felt.die_c);
    }

    fn set_fault(&mut self, fault: Option<Fault>) {
        Chip::set_fault(self, fault);
    }
}

impl Bench {
    fn new(traits: Traits) -> Self {
        let mut chip = Chip::new(traits);
        chip.power_on(0);
        Self::around(chip, [0.5, -0.25, 1.0], [0.0; 3])
    }

    /// A bench with a driver that has set the part up.
    fn with(config: &Config) -> (Self, Lis2dw12<SpiPort>) {
        let mut bench = Self::new(Traits::TYPICAL);
        let mut sensor = bench.driver();
        sensor.init(config, &mut bench).unwrap();
        (bench, sensor)
    }

    fn driver(&self) -> Lis2dw12<SpiPort> {
        Lis2dw12::new(self.port())
    }

    /// One sample, at once.
    fn sample(&self, force_g: [f64; 3]) {
        self.chip().convert(force_g, self.felt.die_c);
    }
}

fn mismatch(register: Register, expected: u8, found: u8) -> Mismatch {
    Mismatch {
        register,
        expected,
        found,
    }
}

#[test]
fn a_sample_arrives_in_counts_with_its_temperature() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.felt.die_c = 31.4;
    assert_eq!(sensor.read(), Ok(None));
    bench.delay_us(2_500);
    assert!(bench.chip().data_ready());
    let sample = sensor.read().unwrap().unwrap();
    assert_eq!(sample.counts, Counts([8192, -4096, 16384]));
    assert_eq!(sample.temperature_whole_c, 31);
    assert_eq!(sensor.read(), Ok(None));
    assert!(!bench.chip().data_ready());
    // 31.4 degC is 102.4 steps of 1/16 degC above 25.
    assert_eq!(
        sensor.read_temperature(),
        Ok(Temperature(25 * 256 + 102 * 16))
    );
}

#[test]
fn every_rate_range_and_bandwidth_takes_effect() {
    let rates = [
        (Rate::Hz12_5, 12.5),
        (Rate::Hz25, 25.0),
        (Rate::Hz50, 50.0),
        (Rate::Hz100, 100.0),
        (Rate::Hz200, 200.0),
        (Rate::Hz400, 400.0),
        (Rate::Hz800, 800.0),
        (Rate::Hz1600, 1600.0),
    ];
    let scales = [FullScale::G2, FullScale::G4, FullScale::G8, FullScale::G16];
    let bandwidths = [
        (Bandwidth::Half, 2.0),
        (Bandwidth::Quarter, 4.0),
        (Bandwidth::Tenth, 10.0),
        (Bandwidth::Twentieth, 20.0),
    ];
    for (index, (rate, odr_hz)) in rates.into_iter().enumerate() {
        let (full_scale, (bandwidth, divisor)) = (scales[index % 4], bandwidths[index % 4]);
        let low_noise = index % 2 == 0;
        let config = Config {
            full_scale,
            rate,
            bandwidth,
            low_noise,
            fifo: Fifo::Bypass,
        };
        let (mut bench, mut sensor) = Bench::with(&config);
        assert_eq!(bench.chip().odr_hz(), Some(odr_hz));
        assert_eq!(rate.millihertz(), (odr_hz * 1000.0) as u32);
        assert_eq!(bench.chip().bandwidth_hz(), Some(odr_hz / divisor));
        assert_eq!(bench.chip().full_scale(), full_scale);
        assert_eq!(
            bench.chip().noise_density_ug(),
            if low_noise { 90.0 } else { 110.0 }
        );
        bench.delay_us(rate.period_us());
        let counts = sensor.read().unwrap().unwrap().counts.0;
        assert_eq!(i32::from(counts[2]), full_scale.counts_per_g());
    }
}

#[test]
fn another_part_and_a_dead_line_are_no_lis2dw12() {
    for (fault, found) in [
        (None, 0x43),
        (Some(Fault::MisoHigh), 0xFF),
        (Some(Fault::MisoLow), 0),
    ] {
        let mut bench = Bench::new(Traits::TYPICAL);
        bench.chip().upset(0x0F, 0x43);
        bench.chip().set_fault(fault);
        let wrong = mismatch(Register::WhoAmI, 0x44, found);
        assert_eq!(
            bench.driver().init(&Config::PRODUCT, &mut bench),
            Err(InitError::Mismatch(wrong))
        );
    }
}

#[test]
fn a_line_that_dies_later_is_seen_at_the_next_read_or_read_back() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.delay_ms(5);
    bench.chip().set_fault(Some(Fault::MisoHigh));
    assert_eq!(sensor.read(), Err(ReadError::StuckHigh));
    assert_eq!(
        sensor.verify(),
        Err(VerifyError::Mismatch(mismatch(
            Register::WhoAmI,
            0x44,
            0xFF
        )))
    );
    bench.chip().set_fault(Some(Fault::MisoLow));
    assert_eq!(sensor.read(), Ok(None));
    assert_eq!(
        sensor.verify(),
        Err(VerifyError::Mismatch(mismatch(
            Register::WhoAmI,
            0x44,
            0x00
        )))
    );
    bench.chip().set_fault(Some(Fault::Bus));
    assert_eq!(sensor.read(), Err(ReadError::Bus(ErrorKind::Other)));
    assert_eq!(sensor.verify(), Err(VerifyError::Bus(ErrorKind::Other)));
}

#[test]
fn a_refused_write_is_named_with_what_the_register_holds() {
    let config = Config {
        fifo: Fifo::Continuous { threshold: 16 },
        ..Config::PRODUCT
    };
    let refused = [
        (Register::Ctrl1, 0x74, 0x00),
        (Register::Ctrl2, 0x0E, 0x04),
        (Register::Ctrl4Int1, 0x01, 0x00),
        (Register::Ctrl6, 0x04, 0x00),
        (Register::FifoCtrl, 0xD0, 0x00),
    ];
    for (register, expected, found) in refused {
        let mut bench = Bench::new(Traits::TYPICAL);
        bench
            .chip()
            .set_fault(Some(Fault::WriteRefused(register.address())));
        let outcome = bench.driver().init(&config, &mut bench);
        assert_eq!(
            outcome,
            Err(InitError::Mismatch(mismatch(register, expected, found)))
        );
    }
}

#[test]
fn a_reset_that_does_not_end_stops_the_set_up() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.chip().set_fault(Some(Fault::ResetStuck));
    let outcome = sensor.init(&Config::PRODUCT, &mut bench);
    assert_eq!(outcome, Err(InitError::ResetStuck { ctrl2: 0x44 }));
    bench.chip().set_fault(Some(Fault::Bus));
    let outcome = sensor.init(&Config::PRODUCT, &mut bench);
    assert_eq!(outcome, Err(InitError::Bus(ErrorKind::Other)));
}

#[test]
fn every_flipped_bit_of_the_configuration_is_seen() {
    let (bench, mut sensor) = Bench::with(&Config::PRODUCT);
    let healthy = bench.chip().clone();
    let checked = (0x20..=0x25)
        .chain([0x0F, 0x2E])
        .chain(0x30..=0x36)
        .chain(0x3C..=0x3F);
    for address in checked {
        for bit in 0..8 {
            let mut chip = healthy.clone();
            chip.upset(address, chip.state.register(address) ^ (1 << bit));
            *bench.chip() = chip;
            let outcome = sensor.verify();
            assert!(outcome.is_err(), "bit {bit} of {address:02X}h: {outcome:?}");
        }
    }
    *bench.chip() = healthy;
    assert!(sensor.verify().is_ok());
}

#[test]
fn without_auto_increment_the_read_back_finds_ctrl1_in_the_place_of_ctrl2() {
    let (bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.chip().upset(0x21, 0x0A);
    let wrong = mismatch(Register::Ctrl2, 0x0E, 0x74);
    assert_eq!(sensor.verify(), Err(VerifyError::Mismatch(wrong)));
}

#[test]
fn a_brown_out_stops_the_samples_and_the_read_back_names_it() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.delay_ms(10);
    let now_ns = bench.chip().now_ns();
    bench.chip().brown_out(now_ns);
    bench.delay_ms(10);
    assert_eq!(sensor.read(), Ok(None));
    assert_eq!(
        sensor.verify(),
        Err(VerifyError::Mismatch(mismatch(
            Register::WhoAmI,
            0x44,
            0x00
        )))
    );
    bench.delay_ms(20);
    assert_eq!(sensor.read(), Ok(None));
    assert_eq!(
        sensor.verify(),
        Err(VerifyError::Mismatch(mismatch(Register::Ctrl1, 0x74, 0x00)))
    );
    sensor.init(&Config::PRODUCT, &mut bench).unwrap();
    bench.delay_ms(3);
    assert!(matches!(sensor.read(), Ok(Some(_))));
}

#[test]
fn the_read_back_costs_no_sample() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.delay_us(2_500);
    let health = sensor.verify().unwrap();
    assert_eq!((health.fifo_level, health.fifo_overrun), (0, false));
    assert!(matches!(sensor.read(), Ok(Some(_))));
}

#[test]
fn the_fifo_gives_the_newest_32_of_40_and_tells_that_it_lost_some() {
    let config = Config {
        fifo: Fifo::Continuous { threshold: 16 },
        ..Config::PRODUCT
    };
    let (bench, mut sensor) = Bench::with(&config);
    (0..40).for_each(|step| bench.sample([f64::from(step) / 1024.0, 0.0, 1.0]));
    let health = sensor.verify().unwrap();
    assert_eq!((health.fifo_level, health.fifo_overrun), (32, true));
    let mut out = [Counts::default(); 20];
    let first = sensor.read_fifo(&mut out).unwrap();
    assert_eq!((first.count, first.left, first.overrun), (20, 12, true));
    assert_eq!([out[0].0[0], out[19].0[0]], [8 * 16, 27 * 16]);
    let second = sensor.read_fifo(&mut out).unwrap();
    assert_eq!((second.count, second.left, second.overrun), (12, 0, false));
    assert_eq!(
        [out[0].0, out[11].0],
        [[28 * 16, 0, 16384], [39 * 16, 0, 16384]]
    );
    let third = sensor.read_fifo(&mut out).unwrap();
    assert_eq!((third.count, third.left, third.overrun), (0, 0, false));
}

#[test]
fn a_fifo_that_stops_when_full_keeps_the_oldest() {
    let config = Config {
        fifo: Fifo::StopWhenFull { threshold: 31 },
        ..Config::PAPER
    };
    let (bench, mut sensor) = Bench::with(&config);
    (0..40).for_each(|step| bench.sample([f64::from(step) / 1024.0, 0.0, 1.0]));
    let mut out = [Counts::default(); FIFO_DEPTH];
    let read = sensor.read_fifo(&mut out).unwrap();
    assert_eq!((read.count, read.left, read.overrun), (32, 0, true));
    assert_eq!([out[0].0[0], out[31].0[0]], [0, 31 * 16]);
}

#[test]
fn the_self_test_measures_both_signs_and_restores_the_configuration() {
    let config = Config {
        fifo: Fifo::Continuous { threshold: 8 },
        ..Config::PRODUCT
    };
    let (mut bench, mut sensor) = Bench::with(&config);
    let start_ns = bench.chip().now_ns();
    let result = sensor.self_test(&mut bench).unwrap();
    for (found_mg, set_g) in [
        (result.positive_mg, Traits::TYPICAL.self_test_positive_g),
        (result.negative_mg, Traits::TYPICAL.self_test_negative_g),
    ] {
        for (found_mg, set_g) in found_mg.into_iter().zip(set_g) {
            // One step of the part at +-4 g is 0.488 mg.
            assert!(
                (f64::from(found_mg) - set_g * 1000.0).abs() < 1.0,
                "{result:?}"
            );
        }
    }
    assert!(result.within_data_sheet());
    let took_ms = (bench.chip().now_ns() - start_ns) / 1_000_000;
    assert!((600..720).contains(&took_ms), "{took_ms} ms");
    let health = sensor.verify().unwrap();
    assert_eq!(
        health.fifo_level, 0,
        "no sample of the self-test is left behind"
    );
}

#[test]
fn no_sample_of_the_self_test_is_taken_for_one_of_the_instrument() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    sensor.self_test(&mut bench).unwrap();
    assert_eq!(sensor.read(), Ok(None));
    bench.delay_ms(3);
    let sample = sensor.read().unwrap().unwrap();
    assert_eq!(sample.counts, Counts([8192, -4096, 16384]));
}

#[test]
fn a_dead_axis_fails_the_self_test() {
    let mut traits = Traits::TYPICAL;
    traits.self_test_negative_g[1] = -0.03;
    let mut bench = Bench::new(traits);
    let mut sensor = bench.driver();
    sensor.init(&Config::PRODUCT, &mut bench).unwrap();
    let result = sensor.self_test(&mut bench).unwrap();
    assert_eq!(result.negative_mg[1], -30);
    assert!(!result.within_data_sheet());
}

#[test]
fn without_samples_the_self_test_gives_up_and_still_restores() {
    let (bench, mut sensor) = Bench::with(&Config::PRODUCT);
    // The port's own delay moves the clock but takes no samples.
    let mut idle = bench.port();
    assert_eq!(sensor.self_test(&mut idle), Err(SelfTestError::NoData));
    assert!(sensor.verify().is_ok());
}

#[test]
fn a_self_test_that_cannot_be_undone_is_an_error() {
    for (fault, error) in [
        (Fault::Bus, VerifyError::Bus(ErrorKind::Other)),
        (
            Fault::WriteRefused(0x22),
            VerifyError::Mismatch(mismatch(Register::Ctrl3, 0x00, 0x80)),
        ),
    ] {
        let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
        let at_ns = bench.chip().now_ns() + 450_000_000;
        bench.fault_at = Some((at_ns, fault));
        assert_eq!(
            sensor.self_test(&mut bench),
            Err(SelfTestError::Restore(error))
        );
        bench.fault_at = None;
        bench.chip().set_fault(None);
        sensor.init(&Config::PRODUCT, &mut bench).unwrap();
    }
}

#[test]
fn all_kinds_of_operations_reach_the_part() {
    let (bench, _) = Bench::with(&Config::PRODUCT);
    let mut port = bench.port();
    let mut in_place = [0x8F, 0];
    port.transfer_in_place(&mut in_place).unwrap();
    assert_eq!(in_place, [0x00, 0x44]);
    let mut longer = [0; 3];
    port.transfer(&mut longer, &[0xA0]).unwrap();
    assert_eq!(longer, [0x00, 0x74, 0x0E]);
    let mut shorter = [0; 1];
    port.transfer(&mut shorter, &[0x22, 0x40]).unwrap();
    let before_ns = bench.chip().now_ns();
    let mut byte = [0];
    port.transaction(&mut [
        Operation::Write(&[0xA2]),
        Operation::DelayNs(300),
        Operation::Read(&mut byte),
    ])
    .unwrap();
    assert_eq!((byte, bench.chip().now_ns() - before_ns), ([0x40], 300));
}

proptest! {
    /// Whatever the registers hold, the driver comes back, and a fresh set-up cures it.
    #[test]
    fn any_register_contents_are_survived_and_cured(
        contents in prop::collection::vec(any::<(u8, u8)>(), 0..40),
    ) {
        let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
        for (address, value) in contents {
            bench.chip().upset(address, value);
        }
        let mut out = [Counts::default(); 40];
        let _ = sensor.verify();
        let _ = sensor.read();
        let _ = sensor.read_temperature();
        let _ = sensor.read_fifo(&mut out);
        let _ = sensor.self_test(&mut bench);
        let now_ns = bench.chip().now_ns();
        bench.chip().power_on(now_ns);
        prop_assert_eq!(sensor.init(&Config::PRODUCT, &mut bench), Ok(()));
        prop_assert!(sensor.verify().is_ok());
    }
}

#[test]
fn samples_that_nobody_read_raised_no_edge_and_the_next_one_was_taken_for_the_first() {
    let (bench, mut sensor) = Bench::with(&Config::PRODUCT);
    for _ in 0..3 {
        bench.sample([0.0, 0.0, 1.0]);
        assert!(bench.chip().int1());
        let later_ns = bench.chip().now_ns() + 100_000;
        bench.chip().advance_to(later_ns);
        assert!(!bench.chip().int1(), "the line is low before each sample");
    }
    // The sample itself is there all the same.
    assert!(matches!(sensor.read(), Ok(Some(_))));
}
