//! Conversations: what is written by SDO, what comes in, what goes out.

mod producing;

use super::*;
use crate::mapping::shelf::Shelf;
use crate::object::at;
use proptest::prelude::*;

/// Milliseconds.
const fn ms(n: u64) -> Instant {
    Instant(n * 1000)
}

/// The slopes and their inverted twins, 16 bits each.
const SLOPES: [u32; 4] = [0x6210_0010, 0x6211_0010, 0x6220_0010, 0x6221_0010];
/// An object that can be written, and its twin.
const KNOB: [u32; 2] = [0x2070_0010, 0x2071_0010];

struct Bench {
    safety: Safety,
    shelf: Shelf,
    /// The application checks what is there whenever it is asked.
    checks: bool,
}

/// Bytes of a parameter.
fn size(index: u16, sub: u8) -> usize {
    match (index, sub) {
        (0x1301 | 0x1302, 2) | (0x13FF, 1..) => 2,
        (0x1301 | 0x1302, 5 | 6) | (0x1381 | 0x1382, 1..) => 4,
        _ => 1,
    }
}

impl Bench {
    fn new() -> Self {
        Self {
            safety: Safety::new(),
            shelf: Shelf::new(),
            checks: false,
        }
    }

    fn write(&mut self, index: u16, sub: u8, number: u32) -> Result<(), Abort> {
        let dictionary = self.shelf.dictionary();
        let value = Value::cut(u64::from(number), size(index, sub));
        let result = self.safety.write(&dictionary, at(index, sub), value, false);
        result.unwrap()
    }

    fn read(&self, index: u16, sub: u8) -> u64 {
        let value = self.safety.read(at(index, sub)).unwrap();
        value.unwrap().unsigned()
    }

    fn load(&mut self, index: u16, sub: u8, number: u32) {
        let value = Value::cut(u64::from(number), size(index, sub));
        assert!(self.safety.load(at(index, sub), value));
    }

    /// Communication parameters 1 to 6 and a mapping.
    fn set_up(&mut self, n: u16, parameters: [u32; 6], entries: &[u32]) {
        for (sub, number) in (1..).zip(parameters) {
            self.write(0x1301 + n, sub, number).unwrap();
        }
        self.write(0x1381 + n, 0, 0).unwrap();
        for (sub, entry) in (1..).zip(entries) {
            self.write(0x1381 + n, sub, *entry).unwrap();
        }
        self.write(0x1381 + n, 0, entries.len() as u32).unwrap();
    }

    /// Signs SRDO `n` from 0 and declares the configuration valid.
    fn sign(&mut self, n: u16) -> Result<(), Abort> {
        let signature = u32::from(self.safety.signature(usize::from(n)));
        self.write(0x13FF, n as u8 + 1, signature)?;
        self.write(0x13FE, 0, 0xA5)
    }

    /// Produces the slopes as 101h and 102h every 25 ms, OPERATIONAL and with consent.
    fn producing() -> Self {
        let mut bench = Self::new();
        bench.set_up(0, [1, 25, 20, 254, 0x101, 0x102], &SLOPES);
        bench.sign(0).unwrap();
        bench.slope(0x1234);
        bench.safety.start(ms(0));
        bench.checks = true;
        bench
    }

    /// Consumes a knob from 103h and 104h, a pair within 20 ms and the next within 50 ms.
    fn consuming() -> Self {
        let mut bench = Self::new();
        bench.set_up(1, [2, 50, 20, 254, 0x103, 0x104], &KNOB);
        bench.sign(1).unwrap();
        bench.safety.start(ms(0));
        bench
    }

    fn slope(&mut self, slope: u16) {
        for (index, number) in [(0x6210, slope), (0x6211, !slope), (0x6220, 0), (0x6221, !0)] {
            self.shelf.put(index, 0, u64::from(number));
        }
    }

    fn poll(&mut self, now: Instant) -> Option<Instant> {
        if self.checks {
            self.safety.release(Some(now));
        }
        self.safety.poll(&mut self.shelf, now).get()
    }

    /// Identifier and first two bytes of the frame that goes out now.
    fn sent(&mut self, now: Instant) -> Option<(u16, u16)> {
        let id = self.safety.next_cob_id(now);
        let frame = self.safety.transmit(now)?;
        assert_eq!((frame.cob_id(), frame.length()), (id, 4));
        let [low, high, ..] = frame.padded();
        Some((id?, u16::from_le_bytes([low, high])))
    }

    /// The application no longer consents.
    fn withdraw(&mut self) {
        self.checks = false;
        self.safety.release(None);
    }

    fn hear(&mut self, id: u16, bytes: &[u8], now: Instant) -> Option<SafetyReceived> {
        let frame = Frame::data_frame(id, bytes);
        self.safety.receive(&mut self.shelf, &frame, now)
    }

    fn hear_pair(&mut self, number: u16, now: Instant) -> Option<SafetyReceived> {
        self.hear(0x103, &number.to_le_bytes(), now)?;
        self.hear(0x104, &(!number).to_le_bytes(), now)
    }

    fn knob(&self) -> (u64, u64) {
        (self.shelf.get(0x2070, 0), self.shelf.get(0x2071, 0))
    }
}

// Configuration.

fn signature(direction: u32, sct: u32, cob_ids: [u32; 2], entries: &[u32]) -> u16 {
    let mut bench = Bench::new();
    let [plain, inverted] = cob_ids;
    let parameters = [direction, sct, 20, 254, plain, inverted];
    for (sub, number) in (1..).zip(parameters) {
        bench.load(0x1301, sub, number);
    }
    bench.load(0x1381, 0, entries.len() as u32);
    for (sub, entry) in (1..).zip(entries) {
        bench.load(0x1381, sub, *entry);
    }
    bench.safety.signature(0)
}

#[test]
fn the_signature_of_slopes_in_bytes_is_f2b5() {
    let entries = [0x6210_0108, 0x6211_0108, 0x6210_0208, 0x6211_0208];
    assert_eq!(signature(1, 25, [0x101, 0x102], &entries), 0xF2B5);
}

#[test]
fn the_signature_of_whole_slopes_is_93a3() {
    assert_eq!(signature(1, 25, [0x101, 0x102], &SLOPES), 0x93A3);
}

/// An example that a vendor of laser scanners prints in a manual.
#[test]
fn the_signature_of_a_consumer_is_4370() {
    let entries = [0x6010_0108, 0x6011_0108, 0x6010_0208, 0x6011_0208];
    assert_eq!(signature(2, 50, [0x111, 0x112], &entries), 0x4370);
}

#[test]
fn an_index_of_somebody_else_is_left_alone() {
    let mut bench = Bench::new();
    let dictionary = bench.shelf.dictionary();
    for index in [0x12FF, 0x1303, 0x1380, 0x1383, 0x13FD, 0x1400] {
        let address = at(index, 1);
        assert_eq!(bench.safety.read(address), None);
        let write = bench
            .safety
            .write(&dictionary, address, Value::u8(0), false);
        assert_eq!(write, None);
        assert!(!bench.safety.load(address, Value::u8(0)));
    }
}

#[test]
fn sub_indices_are_those_of_the_standard() {
    let bench = Bench::new();
    assert_eq!((bench.read(0x1301, 0), bench.read(0x13FF, 0)), (6, 2));
    for (index, sub) in [
        (0x1300, 1),
        (0x1301, 7),
        (0x1381, 17),
        (0x13FE, 1),
        (0x13FF, 3),
    ] {
        let read = bench.safety.read(at(index, sub));
        assert_eq!(read, Some(Err(Abort::NoSuchSubIndex)));
    }
}

#[test]
fn a_configuration_reads_back() {
    let bench = Bench::producing();
    let parameters = [6, 1, 25, 20, 254, 0x101, 0x102];
    for (sub, number) in (0..).zip(parameters) {
        assert_eq!(bench.read(0x1301, sub), number);
    }
    assert_eq!(
        (bench.read(0x1381, 0), bench.read(0x1381, 4)),
        (4, 0x6221_0010)
    );
    assert_eq!(
        (bench.read(0x13FE, 0), bench.read(0x13FF, 1)),
        (0xA5, 0x93A3)
    );
}

#[test]
fn nothing_is_written_in_operational() {
    let mut bench = Bench::producing();
    let dictionary = bench.shelf.dictionary();
    for (index, sub) in [
        (0x1300, 0),
        (0x1301, 2),
        (0x1381, 0),
        (0x13FE, 0),
        (0x13FF, 1),
    ] {
        let write = bench
            .safety
            .write(&dictionary, at(index, sub), Value::u8(1), true);
        assert_eq!(write, Some(Err(Abort::WrongState)));
    }
    assert_eq!(bench.read(0x13FE, 0), 0xA5);
}

#[test]
fn any_write_makes_the_configuration_invalid_even_of_the_same_value() {
    for (index, sub, same, new) in [
        (0x1300, 0, 0, 1),
        (0x1301, 1, 1, 0),
        (0x1301, 2, 25, 26),
        (0x1301, 3, 20, 21),
        (0x1301, 5, 0x101, 0x105),
        (0x1302, 2, 25, 26),
        (0x1381, 0, 4, 2),
        (0x1382, 1, 0, 0x6210_0010),
    ] {
        for number in [same, new] {
            let mut bench = Bench::producing();
            assert_eq!(bench.read(0x13FE, 0), 0xA5);
            bench.write(index, sub, number).unwrap();
            assert_eq!(bench.read(0x13FE, 0), 0, "{index:X}.{sub}");
        }
    }
}

#[test]
fn a_refused_write_changes_nothing() {
    let mut bench = Bench::producing();
    for (sub, bad) in [(1, 3), (2, 0), (3, 0), (4, 255), (5, 0x102), (6, 0x101)] {
        assert_eq!(
            bench.write(0x1301, sub, bad),
            Err(Abort::InvalidValue),
            "{sub}"
        );
    }
    for bad in [0, 0xFF, 0x181, 0x4000_0101, 0x8000_0103] {
        assert_eq!(
            bench.write(0x1301, 5, bad),
            Err(Abort::InvalidValue),
            "{bad:X}"
        );
    }
    assert_eq!(bench.write(0x1300, 0, 2), Err(Abort::InvalidValue));
    assert_eq!(bench.write(0x1381, 0, 17), Err(Abort::PdoTooLong));
    assert_eq!(bench.write(0x1381, 0, 3), Err(Abort::InvalidValue));
    assert_eq!(bench.write(0x1381, 1, 0), Err(Abort::UnsupportedAccess));
    assert_eq!(bench.read(0x13FE, 0), 0xA5);
}

#[test]
fn only_safety_objects_can_be_mapped_and_only_in_pairs() {
    let mut bench = Bench::new();
    assert_eq!(bench.write(0x1381, 1, 0x6010_0010), Err(Abort::NotMappable));
    assert_eq!(
        bench.write(0x1381, 1, 0x0005_0008),
        Err(Abort::NoSuchObject)
    );
    bench.write(0x1381, 1, 0x6210_0010).unwrap();
    bench.write(0x1381, 2, 0x6210_0108).unwrap();
    assert_eq!(bench.write(0x1381, 0, 2), Err(Abort::ParameterIncompatible));
    assert_eq!(bench.write(0x1381, 0, 4), Err(Abort::NoSuchObject));
    bench.write(0x1381, 2, 0x6211_0010).unwrap();
    assert_eq!(bench.write(0x1381, 0, 2), Ok(()));
}

#[test]
fn a_wrong_signature_is_refused_where_it_is_written() {
    let mut bench = Bench::producing();
    assert_eq!(bench.write(0x13FF, 1, 0x93A4), Err(Abort::InvalidValue));
    assert_eq!(bench.write(0x13FF, 0, 2), Err(Abort::ReadOnly));
    assert_eq!(bench.read(0x13FF, 1), 0x93A3);
}

#[test]
fn a_signature_of_former_parameters_does_not_make_them_valid() {
    let mut bench = Bench::producing();
    bench.write(0x1301, 2, 30).unwrap();
    assert_eq!(
        bench.write(0x13FE, 0, 0xA5),
        Err(Abort::ParameterIncompatible)
    );
    assert_eq!(bench.read(0x13FE, 0), 0);
    assert_eq!(bench.sign(0), Ok(()));
    assert_eq!(bench.read(0x13FE, 0), 0xA5);
}

#[test]
fn any_other_value_than_a5_reads_0() {
    let mut bench = Bench::producing();
    assert_eq!(bench.write(0x13FE, 0, 0x5A), Ok(()));
    assert_eq!(bench.read(0x13FE, 0), 0);
}

#[test]
fn parameters_that_do_not_go_together_cannot_be_declared_valid() {
    let refused = |parameters: [u32; 6], entries: &[u32]| {
        let mut bench = Bench::new();
        bench.set_up(0, parameters, entries);
        bench.sign(0)
    };
    let incompatible = Err(Abort::ParameterIncompatible);
    assert_eq!(
        refused([1, 25, 20, 254, 0x101, 0x104], &SLOPES),
        incompatible
    );
    assert_eq!(refused([1, 25, 20, 254, 0x101, 0x102], &[]), incompatible);
    // A measured slope cannot be consumed.
    assert_eq!(
        refused([2, 25, 20, 254, 0x101, 0x102], &SLOPES),
        Err(Abort::NotMappable)
    );
    assert_eq!(refused([2, 25, 20, 254, 0x101, 0x102], &KNOB), Ok(()));
}

#[test]
fn two_srdos_do_not_share_identifiers() {
    let mut bench = Bench::producing();
    bench.set_up(1, [2, 50, 20, 254, 0x101, 0x102], &KNOB);
    assert_eq!(bench.sign(1), Err(Abort::ParameterIncompatible));
}

#[test]
fn what_was_loaded_with_a_wrong_signature_is_not_valid() {
    let mut bench = Bench::producing();
    let dictionary = bench.shelf.dictionary();
    assert_eq!(bench.safety.check(&dictionary), Ok(()));
    bench.load(0x13FF, 1, 0x1111);
    assert_eq!(
        bench.safety.check(&dictionary),
        Err(Abort::ParameterIncompatible)
    );
    assert_eq!(bench.read(0x13FE, 0), 0);
    assert_eq!(bench.safety.check(&dictionary), Ok(()));
}

// Consumer.

#[test]
fn a_good_pair_is_written() {
    let mut bench = Bench::consuming();
    assert_eq!(bench.safety.state(1), SrdoState::Waiting);
    bench.hear(0x103, &[0x34, 0x12], ms(1));
    assert_eq!(
        (bench.knob(), bench.safety.state(1)),
        ((0, 0), SrdoState::Waiting)
    );
    let taken = bench.hear(0x104, &[0xCB, 0xED], ms(2));
    assert_eq!(taken, Some(SafetyReceived::Taken));
    assert_eq!(
        (bench.knob(), bench.safety.state(1)),
        ((0x1234, 0xEDCB), SrdoState::Running)
    );
}

#[test]
fn halves_that_disagree_are_lost_and_told_once() {
    let mut bench = Bench::consuming();
    bench.hear_pair(1, ms(1));
    bench.hear(0x103, &[2, 0], ms(2));
    let lost = bench.hear(0x104, &[0xFC, 0xFF], ms(2));
    assert_eq!(lost, Some(SafetyReceived::Lost(1)));
    assert_eq!(
        (bench.knob().0, bench.safety.state(1)),
        (1, SrdoState::Inconsistent)
    );
    bench.hear(0x103, &[2, 0], ms(3));
    let again = bench.hear(0x104, &[0xFC, 0xFF], ms(3));
    assert_eq!(again, Some(SafetyReceived::Taken));
    bench.hear_pair(3, ms(4));
    assert_eq!(
        (bench.knob().0, bench.safety.state(1)),
        (3, SrdoState::Running)
    );
}

#[test]
fn a_wrong_length_is_inconsistent() {
    let mut bench = Bench::consuming();
    let lost = bench.hear(0x103, &[1, 0, 0], ms(1));
    assert_eq!(lost, Some(SafetyReceived::Lost(1)));
    assert_eq!(bench.safety.state(1), SrdoState::Inconsistent);
}

#[test]
fn the_inverted_frame_alone_or_first_is_unpaired() {
    let mut bench = Bench::consuming();
    let lost = bench.hear(0x104, &[0xFE, 0xFF], ms(1));
    assert_eq!(lost, Some(SafetyReceived::Lost(1)));
    bench.hear(0x103, &[1, 0], ms(2));
    assert_eq!(
        (bench.knob(), bench.safety.state(1)),
        ((0, 0), SrdoState::Unpaired)
    );
}

#[test]
fn two_plain_frames_in_a_row_are_unpaired() {
    let mut bench = Bench::consuming();
    bench.hear(0x103, &[1, 0], ms(1));
    let lost = bench.hear(0x103, &[2, 0], ms(2));
    assert_eq!(lost, Some(SafetyReceived::Lost(1)));
    let taken = bench.hear(0x104, &[0xFD, 0xFF], ms(3));
    assert_eq!((taken, bench.knob().0), (Some(SafetyReceived::Taken), 2));
}

#[test]
fn a_twin_has_to_come_within_the_validation_time() {
    let mut bench = Bench::consuming();
    bench.hear(0x103, &[1, 0], ms(1));
    assert_eq!(bench.poll(ms(2)), Some(Instant(21_001)));
    assert_eq!(
        bench.hear(0x104, &[0xFE, 0xFF], ms(21)),
        Some(SafetyReceived::Taken)
    );
    assert_eq!(bench.knob().0, 1);
    bench.hear(0x103, &[2, 0], ms(30));
    let late = bench.hear(0x104, &[0xFD, 0xFF], Instant(50_001));
    assert_eq!((late, bench.knob().0), (Some(SafetyReceived::Lost(1)), 1));
    bench.hear(0x103, &[3, 0], ms(60));
    bench.poll(Instant(80_001));
    assert_eq!(bench.safety.state(1), SrdoState::Unpaired);
}

#[test]
fn a_pair_has_to_come_within_the_safeguard_cycle_time() {
    let mut bench = Bench::consuming();
    bench.hear_pair(1, ms(30));
    assert_eq!(bench.poll(ms(80)), Some(Instant(80_001)));
    assert_eq!(bench.safety.take_lost(), None);
    assert_eq!(bench.poll(Instant(80_001)), None);
    assert_eq!(bench.safety.state(1), SrdoState::TimedOut);
    assert_eq!(
        (bench.safety.take_lost(), bench.safety.take_lost()),
        (Some(1), None)
    );
}

#[test]
fn an_object_that_refuses_makes_the_pair_inconsistent() {
    let mut bench = Bench::consuming();
    bench.shelf.unwritable = Some(at(0x2070, 0));
    assert_eq!(bench.hear_pair(1, ms(1)), Some(SafetyReceived::Lost(1)));
    assert_eq!(bench.safety.state(1), SrdoState::Inconsistent);
}

#[test]
fn a_twin_out_of_its_range_leaves_both_objects_as_they_are() {
    let mut bench = Bench::new();
    bench.set_up(
        1,
        [2, 50, 20, 254, 0x103, 0x104],
        &[0x2072_0010, 0x2073_0010],
    );
    bench.sign(1).unwrap();
    bench.safety.start(ms(0));
    assert_eq!(bench.hear_pair(!200, ms(1)), Some(SafetyReceived::Lost(1)));
    assert_eq!(bench.shelf.get(0x2072, 0), 0);
    assert_eq!(bench.hear_pair(!100, ms(2)), Some(SafetyReceived::Taken));
    assert_eq!(bench.shelf.get(0x2073, 0), 100);
}

#[test]
fn frames_of_others_and_outside_operational_are_left_alone() {
    let mut bench = Bench::consuming();
    assert_eq!(bench.hear(0x105, &[1, 0], ms(1)), None);
    let remote = Frame::remote(crate::frame::standard(0x103), 2).unwrap();
    assert_eq!(bench.safety.receive(&mut bench.shelf, &remote, ms(1)), None);
    bench.safety.stop();
    assert_eq!(bench.hear(0x103, &[1, 0], ms(1)), None);
}

// Global fail-safe command.

#[test]
fn the_fail_safe_command_is_obeyed_when_1300_allows_it() {
    let mut bench = Bench::new();
    bench.safety.start(ms(0));
    assert_eq!(bench.hear(0x001, &[], ms(1)), None);
    bench.safety.stop();
    bench.write(0x1300, 0, 1).unwrap();
    assert_eq!(bench.hear(0x001, &[], ms(2)), None);
    bench.safety.start(ms(3));
    assert_eq!(
        bench.hear(0x001, &[], ms(4)),
        Some(SafetyReceived::FailSafe)
    );
    assert_eq!(bench.hear(0x001, &[0], ms(5)), None);
}

// Anything goes.

fn number() -> impl Strategy<Value = u32> {
    prop_oneof![
        prop::sample::select(&SLOPES[..]),
        prop::sample::select(&[KNOB[0], KNOB[1], 0x101, 0x102][..]),
        prop::sample::select(&[0, 1, 2, 3, 4, 16, 25, 254, 0xA5, 0x103, 0x104][..]),
        any::<u32>(),
    ]
}

proptest! {
    #[test]
    fn a_valid_configuration_is_always_sound_and_pairs_are_never_halved(
        writes in prop::collection::vec((0_usize..7, 0_u8..18, number()), 0..120),
    ) {
        let indices = [0x1300, 0x1301, 0x1302, 0x1381, 0x1382, 0x13FE, 0x13FF];
        let mut bench = Bench::producing();
        for (now, (n, sub, number)) in (1..).zip(writes) {
            let before = bench.read(0x13FE, 0);
            // Sign now and then, so that valid configurations other than the first come up.
            if number & 3 == 3 {
                let _ = bench.sign(0).and(bench.sign(1));
            }
            let result = bench.write(indices[n], sub, number);
            if bench.read(0x13FE, 0) == 0xA5 {
                prop_assert!(bench.safety.sound(&bench.shelf.dictionary()).is_ok());
            } else if before == 0xA5 {
                prop_assert!(result.is_ok());
            }
            bench.safety.start(ms(now * 30));
            let mut open = None;
            bench.poll(ms(now * 30));
            while let Some(frame) = bench.safety.transmit(ms(now * 30)) {
                let plain = u64::from_le_bytes(frame.padded());
                match open.take() {
                    None => open = Some((frame.cob_id(), plain)),
                    Some((id, twin)) => {
                        prop_assert_eq!(frame.cob_id(), id.map(|id: u16| id + 1));
                        let length = frame.length();
                        prop_assert_eq!(Value::cut(!twin, length), Value::cut(plain, length));
                    }
                }
            }
            prop_assert_eq!(open, None);
        }
    }
}

#[test]
fn a_pair_that_never_came_was_never_missed() {
    let mut bench = Bench::consuming();
    assert_eq!(bench.safety.state(1), SrdoState::Waiting);
    let due = bench.poll(ms(0));
    assert_eq!(due, Some(ms(50).after(1)));
    assert_eq!(bench.poll(ms(50)), due);
    assert_eq!(bench.safety.take_lost(), None);
    bench.poll(ms(51));
    assert_eq!(bench.safety.take_lost(), Some(1));
    assert_eq!(bench.safety.take_lost(), None);
    assert_eq!(bench.safety.state(1), SrdoState::TimedOut);
    // Each stay in OPERATIONAL has its own first pair.
    bench.safety.stop();
    bench.safety.start(ms(1000));
    bench.hear_pair(7, ms(1050));
    assert_eq!(bench.safety.state(1), SrdoState::Running);
    bench.poll(ms(1100));
    assert_eq!(bench.safety.take_lost(), None);
    bench.poll(ms(1101));
    assert_eq!(bench.safety.take_lost(), Some(1));
}
