//! The instrument's driver against the model: both sides of the wire at once.

use device::sensor::ReadError;
use device::sensor::ism330dhcx::{
    ACCELEROMETER_DELAY_MILLISAMPLES, Bandwidth, Config, DataRate, Fifo, FifoData, FifoWord,
    GYROSCOPE_DELAY_MILLISAMPLES, InitError, Ism330dhcx, Mismatch, RateFilter, Register,
    SelfTestError, VerifyError,
};
use embedded_hal::delay::DelayNs;
use embedded_hal::spi::ErrorKind;
use proptest::prelude::*;
use tilt::sample::{Counts, RateCounts, Temperature};

use super::*;
use crate::spi_part::bench::{Felt, Sampling};

type Bench = spi_part::bench::Bench<Chip>;

impl Sampling for Chip {
    fn odr_hz(&self) -> Option<f64> {
        Chip::odr_hz(self)
    }

    fn sample(&mut self, felt: &Felt) {
        self.convert(felt.force_g, felt.rate_dps, felt.die_c);
    }

    fn set_fault(&mut self, fault: Option<Fault>) {
        Chip::set_fault(self, fault);
    }
}

impl Bench {
    fn new(traits: Traits) -> Self {
        let mut chip = Chip::new(traits);
        chip.power_on(0);
        Self::around(chip, [0.5, -0.25, 1.0], [17.5, -35.0, 0.0])
    }

    /// A bench with a driver that has set the part up.
    fn with(config: &Config) -> (Self, Ism330dhcx<SpiPort>) {
        let mut bench = Self::new(Traits::TYPICAL);
        let mut sensor = bench.driver();
        sensor.init(config, &mut bench).unwrap();
        (bench, sensor)
    }

    fn driver(&self) -> Ism330dhcx<SpiPort> {
        Ism330dhcx::new(self.port())
    }

    /// Number of samples, at once; X counts up from 0.
    fn samples(&self, number: i32) {
        for step in 0..number {
            let x = f64::from(step);
            self.chip().convert(
                [x / 8192.0, 0.0, 1.0],
                [x * 0.0175, 0.0, 0.0],
                self.felt.die_c,
            );
        }
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
    bench.felt.die_c = 31.5;
    assert_eq!(sensor.read(), Ok(None));
    bench.delay_us(2_400);
    assert!(bench.chip().data_ready());
    let warm = Temperature(31 * 256 + 128);
    assert_eq!(sensor.read_temperature(), Ok(warm));
    let sample = sensor.read().unwrap().unwrap();
    assert_eq!(sample.acceleration, Counts([4096, -2048, 8192]));
    assert_eq!(sample.rate, RateCounts([1000, -2000, 0]));
    assert_eq!(sample.temperature, warm);
    assert!(sample.acceleration_is_new);
    assert_eq!(sensor.read(), Ok(None));
    assert!(!bench.chip().data_ready());
}

#[test]
fn the_declared_delays_are_those_of_the_set_up() {
    let (bench, _) = Bench::with(&Config::PRODUCT);
    let period_s = f64::from(Config::PRODUCT.rate.period_us()) * 1e-6;
    let chip = bench.chip();
    for (delay_s, millisamples) in [
        (chip.gyroscope_delay_s(), GYROSCOPE_DELAY_MILLISAMPLES),
        (
            chip.accelerometer_delay_s(),
            ACCELEROMETER_DELAY_MILLISAMPLES,
        ),
    ] {
        let got = delay_s.unwrap() / period_s * 1000.0;
        assert!((got - f64::from(millisamples)).abs() < 1.0, "{got}");
    }
}

#[test]
fn every_rate_range_and_filter_takes_effect() {
    let rates = [
        (DataRate::Hz13, 13.02),
        (DataRate::Hz26, 26.04),
        (DataRate::Hz52, 52.08),
        (DataRate::Hz104, 104.17),
        (DataRate::Hz208, 208.33),
        (DataRate::Hz417, 416.67),
        (DataRate::Hz833, 833.33),
        (DataRate::Hz1667, 1666.67),
    ];
    let scales = [FullScale::G2, FullScale::G4, FullScale::G8, FullScale::G16];
    let ranges = [
        RateRange::Dps125,
        RateRange::Dps250,
        RateRange::Dps500,
        RateRange::Dps1000,
        RateRange::Dps2000,
    ];
    let bandwidths = [
        (Bandwidth::Half, 2.0),
        (Bandwidth::Quarter, 4.0),
        (Bandwidth::Tenth, 10.0),
        (Bandwidth::Twentieth, 20.0),
        (Bandwidth::FortyFifth, 45.0),
    ];
    for (index, (rate, odr_hz)) in rates.into_iter().enumerate() {
        let (full_scale, range) = (scales[index % 4], ranges[index % 5]);
        let (bandwidth, divisor) = bandwidths[index % 5];
        let config = Config {
            full_scale,
            range,
            rate,
            bandwidth,
            ..Config::PRODUCT
        };
        let (mut bench, mut sensor) = Bench::with(&config);
        let close = |got: Option<f64>, want: f64| (got.unwrap() / want - 1.0).abs() < 1e-3;
        assert!(close(bench.chip().odr_hz(), odr_hz));
        assert!(close(Some(f64::from(rate.millihertz()) * 1e-3), odr_hz));
        assert!(close(
            bench.chip().accelerometer_bandwidth_hz(),
            odr_hz / divisor
        ));
        assert_eq!(bench.chip().full_scale(), full_scale);
        assert_eq!(bench.chip().rate_range(), range);
        bench.delay_us(rate.period_us());
        let sample = sensor.read().unwrap().unwrap();
        let one_g = full_scale.counts_per_g();
        assert_eq!(i32::from(sample.acceleration.0[2]), one_g);
        let x = i32::from(sample.rate.0[0]) * range.micro_dps_per_count();
        assert_eq!(x, 17_500_000);
    }
}

#[test]
fn the_rate_filters_narrow_in_their_order() {
    let filters = [
        (RateFilter::Lpf2, 135.9),
        (RateFilter::Wide, 133.0),
        (RateFilter::Medium, 86.0),
        (RateFilter::Narrow, 48.0),
        (RateFilter::Narrowest, 24.6),
    ];
    for (rate_filter, hz) in filters {
        let config = Config {
            rate_filter,
            ..Config::PRODUCT
        };
        let (bench, _) = Bench::with(&config);
        assert_eq!(bench.chip().gyroscope_bandwidth_hz(), Some(hz));
    }
}

#[test]
fn another_part_and_a_dead_line_are_no_ism330dhcx() {
    for (fault, found) in [
        (None, 0x6C),
        (Some(Fault::MisoHigh), 0xFF),
        (Some(Fault::MisoLow), 0),
    ] {
        let mut bench = Bench::new(Traits::TYPICAL);
        bench.chip().upset(0x0F, 0x6C);
        bench.chip().set_fault(fault);
        let outcome = bench.driver().init(&Config::PRODUCT, &mut bench);
        let wrong = mismatch(Register::WhoAmI, 0x6B, found);
        assert_eq!(outcome, Err(InitError::Mismatch(wrong)));
    }
}

#[test]
fn a_line_that_dies_later_is_seen_at_the_next_read_or_read_back() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.delay_ms(5);
    let wrong = |found| VerifyError::Mismatch(mismatch(Register::WhoAmI, 0x6B, found));
    bench.chip().set_fault(Some(Fault::MisoHigh));
    assert_eq!(sensor.read(), Err(ReadError::StuckHigh));
    assert_eq!(sensor.read_temperature(), Err(ReadError::StuckHigh));
    assert_eq!(sensor.verify(), Err(wrong(0xFF)));
    bench.chip().set_fault(Some(Fault::MisoLow));
    assert_eq!(sensor.read(), Ok(None));
    assert_eq!(sensor.verify(), Err(wrong(0x00)));
    bench.chip().set_fault(Some(Fault::Bus));
    assert_eq!(sensor.read(), Err(ReadError::Bus(ErrorKind::Other)));
    assert_eq!(sensor.verify(), Err(VerifyError::Bus(ErrorKind::Other)));
}

#[test]
fn a_refused_write_is_named_with_what_the_register_holds() {
    let config = Config {
        fifo: Fifo::Continuous { threshold: 16 },
        rate_filter: RateFilter::Narrow,
        bandwidth: Bandwidth::Tenth,
        ..Config::PRODUCT
    };
    let refused = [
        (Register::FifoCtrl1, 0x10, 0x00),
        (Register::FifoCtrl3, 0x66, 0x00),
        (Register::FifoCtrl4, 0x06, 0x00),
        (Register::CounterBdrReg1, 0x80, 0x00),
        (Register::Int1Ctrl, 0x02, 0x00),
        (Register::Ctrl1Xl, 0x6A, 0x00),
        (Register::Ctrl2G, 0x64, 0x00),
        (Register::Ctrl3C, 0x44, 0x04),
        (Register::Ctrl4C, 0x06, 0x00),
        (Register::Ctrl6C, 0x05, 0x00),
        (Register::Ctrl8Xl, 0x20, 0x00),
        (Register::Ctrl9Xl, 0xE2, 0xE0),
    ];
    for (register, expected, found) in refused {
        let mut bench = Bench::new(Traits::TYPICAL);
        let fault = Fault::WriteRefused(register.address());
        bench.chip().set_fault(Some(fault));
        let outcome = bench.driver().init(&config, &mut bench);
        let wrong = mismatch(register, expected, found);
        assert_eq!(outcome, Err(InitError::Mismatch(wrong)));
    }
}

#[test]
fn a_reset_that_does_not_end_stops_the_set_up() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.chip().set_fault(Some(Fault::ResetStuck));
    let outcome = sensor.init(&Config::PRODUCT, &mut bench);
    assert_eq!(outcome, Err(InitError::ResetStuck { ctrl3_c: 0x05 }));
}

#[test]
fn every_flipped_bit_of_the_configuration_is_seen() {
    let (bench, mut sensor) = Bench::with(&Config::PRODUCT);
    let healthy = bench.chip().clone();
    let checked = [0x01]
        .into_iter()
        .chain(0x07..=0x19)
        .chain(0x56..=0x5F)
        .chain(0x73..=0x75);
    let pins = [6, 7].map(|bit| (0x02, bit));
    for (address, bit) in checked
        .flat_map(|address| (0..8).map(move |bit| (address, bit)))
        .chain(pins)
    {
        let mut chip = healthy.clone();
        chip.upset(address, chip.state.register(address) ^ (1 << bit));
        *bench.chip() = chip;
        let outcome = sensor.verify();
        assert!(outcome.is_err(), "bit {bit} of {address:02X}h: {outcome:?}");
    }
    *bench.chip() = healthy;
    assert!(sensor.verify().is_ok());
}

#[test]
fn the_set_up_leads_back_from_another_bank() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.chip().upset(0x01, 0x80);
    assert!(sensor.verify().is_err());
    assert_eq!(sensor.init(&Config::PRODUCT, &mut bench), Ok(()));
}

#[test]
fn a_brown_out_stops_the_samples_and_the_read_back_names_it() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.delay_ms(10);
    let now_ns = bench.chip().now_ns();
    bench.chip().brown_out(now_ns);
    bench.delay_ms(5);
    assert_eq!(sensor.read(), Ok(None));
    let silent = mismatch(Register::WhoAmI, 0x6B, 0x00);
    assert_eq!(sensor.verify(), Err(VerifyError::Mismatch(silent)));
    bench.delay_ms(20);
    assert_eq!(sensor.read(), Ok(None));
    let reset = mismatch(Register::CounterBdrReg1, 0x80, 0x00);
    assert_eq!(sensor.verify(), Err(VerifyError::Mismatch(reset)));
    sensor.init(&Config::PRODUCT, &mut bench).unwrap();
    bench.delay_ms(3);
    assert!(matches!(sensor.read(), Ok(Some(_))));
}

#[test]
fn the_read_back_and_the_temperature_cost_no_sample() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    bench.delay_us(2_400);
    let health = sensor.verify().unwrap();
    assert_eq!((health.fifo_level, health.fifo_overrun), (0, false));
    assert!(sensor.read_temperature().is_ok());
    assert!(matches!(sensor.read(), Ok(Some(_))));
}

/// X of the words of one sensor.
fn x_of(words: &[FifoWord]) -> (Vec<i16>, Vec<i16>) {
    let (mut rates, mut accelerations) = (Vec::new(), Vec::new());
    for word in words {
        match word.data {
            FifoData::Rate(counts) => rates.push(counts.0[0]),
            FifoData::Acceleration(counts) => accelerations.push(counts.0[0]),
            FifoData::Other { tag } => panic!("tag {tag}"),
        }
    }
    (rates, accelerations)
}

#[test]
fn the_fifo_gives_the_newest_512_words_and_tells_that_it_lost_some() {
    let config = Config {
        fifo: Fifo::Continuous { threshold: 300 },
        ..Config::PRODUCT
    };
    let (bench, mut sensor) = Bench::with(&config);
    bench.samples(266);
    let mut out = [FifoWord::default(); FIFO_WORDS];
    let first = sensor.read_fifo(&mut out[..20]).unwrap();
    assert_eq!((first.count, first.left, first.overrun), (20, 492, true));
    let (rates, accelerations) = x_of(&out[..20]);
    assert_eq!(rates, (10..20).collect::<Vec<i16>>());
    assert_eq!(rates, accelerations);
    assert!(out[..20].chunks(2).all(|pair| pair[0].slot == pair[1].slot));
    assert_eq!((out[0].slot + 1) & 3, out[2].slot);
    let second = sensor.read_fifo(&mut out).unwrap();
    assert_eq!((second.count, second.left, second.overrun), (492, 0, false));
    assert_eq!(x_of(&out[..492]).0.last(), Some(&265));
    let third = sensor.read_fifo(&mut out).unwrap();
    assert_eq!((third.count, third.left, third.overrun), (0, 0, false));
}

#[test]
fn a_fifo_that_stops_when_full_keeps_the_oldest() {
    let config = Config {
        fifo: Fifo::StopWhenFull { threshold: 511 },
        ..Config::PRODUCT
    };
    let (bench, mut sensor) = Bench::with(&config);
    bench.samples(266);
    let health = sensor.verify().unwrap();
    assert_eq!((health.fifo_level, health.fifo_overrun), (512, true));
    let mut out = [FifoWord::default(); FIFO_WORDS];
    let read = sensor.read_fifo(&mut out).unwrap();
    assert_eq!((read.count, read.left), (512, 0));
    let (rates, accelerations) = x_of(&out);
    assert_eq!((rates[0], rates[255]), (0, 255));
    assert_eq!(rates, accelerations);
}

#[test]
fn the_self_test_measures_both_sensors_and_signs_and_restores_the_configuration() {
    let config = Config {
        fifo: Fifo::Continuous { threshold: 8 },
        ..Config::PRODUCT
    };
    let (mut bench, mut sensor) = Bench::with(&config);
    let start_ns = bench.chip().now_ns();
    let result = sensor.self_test(&mut bench).unwrap();
    let traits = Traits::TYPICAL;
    for (found, set) in [
        (result.positive_mg, traits.self_test_positive_g),
        (result.negative_mg, traits.self_test_negative_g),
        (result.positive_mdps, traits.self_test_positive_dps),
        (result.negative_mdps, traits.self_test_negative_dps),
    ] {
        for (found, set) in found.into_iter().zip(set) {
            // One step of the part at +-2000 deg/s is 70 mdps, at +-4 g 0.122 mg.
            let within = if set.abs() > 10.0 { 70.0 } else { 1.0 };
            let wrong = f64::from(found) - set * 1000.0;
            assert!(wrong.abs() <= within, "{result:?}");
        }
    }
    assert!(result.within_data_sheet());
    let took_ms = (bench.chip().now_ns() - start_ns) / 1_000_000;
    assert!((900..1000).contains(&took_ms), "{took_ms} ms");
    let health = sensor.verify().unwrap();
    assert_eq!(health.fifo_level, 0, "a word of the self-test is left");
}

#[test]
fn no_sample_of_the_self_test_is_taken_for_one_of_the_instrument() {
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    sensor.self_test(&mut bench).unwrap();
    assert_eq!(sensor.read(), Ok(None));
    bench.delay_ms(3);
    let sample = sensor.read().unwrap().unwrap();
    assert_eq!(sample.rate, RateCounts([1000, -2000, 0]));
}

#[test]
fn a_dead_axis_of_either_sensor_fails_the_self_test() {
    let mut weak_force = Traits::TYPICAL;
    weak_force.self_test_negative_g[1] = -0.03;
    let mut weak_rate = Traits::TYPICAL;
    weak_rate.self_test_positive_dps[2] = 20.0;
    for traits in [weak_force, weak_rate] {
        let mut bench = Bench::new(traits);
        let mut sensor = bench.driver();
        sensor.init(&Config::PRODUCT, &mut bench).unwrap();
        let result = sensor.self_test(&mut bench).unwrap();
        assert!(!result.within_data_sheet(), "{result:?}");
    }
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
    let (mut bench, mut sensor) = Bench::with(&Config::PRODUCT);
    let at_ns = bench.chip().now_ns() + 850_000_000;
    let stuck = Fault::WriteRefused(Register::Ctrl5C.address());
    bench.fault_at = Some((at_ns, stuck));
    let left = mismatch(Register::Ctrl5C, 0x00, 0x0C);
    let want = SelfTestError::Restore(VerifyError::Mismatch(left));
    assert_eq!(sensor.self_test(&mut bench), Err(want));
    bench.fault_at = None;
    bench.chip().set_fault(None);
    sensor.init(&Config::PRODUCT, &mut bench).unwrap();
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
        let mut out = [FifoWord::default(); 40];
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
