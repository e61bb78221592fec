//! Store, restore, verify configuration, and what a safety configuration survives.

use super::*;

const CANNOT_STORE: u32 = 0x0800_0020;
const WRONG_STATE: u32 = 0x0800_0022;

#[test]
fn what_is_stored_comes_back_at_a_start() {
    let mut bench = Bench::new();
    bench.write(0x1017, 0, Value::u16(100)).unwrap();
    bench.write(0x2000, 0, Value::u8(9)).unwrap();
    bench.write(0x1010, 2, Value::u32(SAVE)).unwrap();
    bench.start(ID);
    bench.sent();
    assert_eq!(
        (bench.read(0x1017, 0), bench.read(0x2000, 0)),
        (Ok(100), Ok(7))
    );
    bench.write(0x2000, 0, Value::u8(9)).unwrap();
    bench.write(0x1010, 1, Value::u32(SAVE)).unwrap();
    bench.start(ID);
    bench.sent();
    assert_eq!(
        (bench.read(0x1017, 0), bench.read(0x2000, 0)),
        (Ok(100), Ok(9))
    );
}

#[test]
fn defaults_count_from_the_reset_after_a_restore() {
    let mut bench = Bench::new();
    bench.write(0x1017, 0, Value::u16(100)).unwrap();
    bench.write(0x1010, 1, Value::u32(SAVE)).unwrap();
    bench.write(0x1011, 1, Value::u32(LOAD)).unwrap();
    assert_eq!(bench.read(0x1017, 0), Ok(100));
    bench.nmt(130);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
    let dictionary = bench.plant.dictionary();
    for row in storage::rows(&dictionary, Group::Communication) {
        let default = dictionary.default(&row, ID).unwrap().unsigned() as u32;
        for sub in row.sub..=row.last {
            assert_eq!(
                bench.read(row.index, sub),
                Ok(default),
                "{:04X}.{sub}",
                row.index
            );
        }
    }
}

#[test]
fn save_signature_byte_swapped() {
    let mut bench = Bench::new();
    // "save" as its letters stand in a frame.
    let saved = bench.sdo([0x23, 0x10, 0x10, 1, b's', b'a', b'v', b'e']);
    assert_eq!(saved, Some([0x60, 0x10, 0x10, 1, 0, 0, 0, 0]));
    let swapped = Value::u32(SAVE.swap_bytes());
    assert_eq!(bench.write(0x1010, 1, swapped), Err(CANNOT_STORE));
    assert_eq!(bench.write(0x1010, 1, Value::u32(LOAD)), Err(CANNOT_STORE));
    assert_eq!(bench.write(0x1011, 1, Value::u32(SAVE)), Err(CANNOT_STORE));
    assert_eq!(bench.read(0x1010, 1), Ok(1));
}

#[test]
fn nothing_is_stored_while_the_machine_works() {
    let mut bench = Bench::operational();
    assert_eq!(bench.write(0x1010, 1, Value::u32(SAVE)), Err(WRONG_STATE));
    assert_eq!(bench.write(0x1011, 1, Value::u32(LOAD)), Err(WRONG_STATE));
}

#[test]
fn a_memory_that_fails_is_told() {
    let mut bench = Bench::new();
    bench.plant.broken = true;
    assert_eq!(bench.write(0x1010, 1, Value::u32(SAVE)), Err(0x0606_0000));
    assert_eq!(bench.write(0x1011, 1, Value::u32(LOAD)), Err(0x0606_0000));
}

#[test]
fn a_change_unverifies_the_configuration() {
    let mut bench = Bench::new();
    let verify = |bench: &mut Bench| {
        bench.write(0x1020, 1, Value::u32(15_000)).unwrap();
        bench.write(0x1020, 2, Value::u32(1)).unwrap();
    };
    verify(&mut bench);
    assert_eq!(
        (bench.read(0x1020, 1), bench.read(0x1020, 2)),
        (Ok(15_000), Ok(1))
    );
    assert_eq!(bench.write(0x1029, 1, Value::u8(9)), Err(0x0609_0030));
    bench.write(0x2002, 0, Value::u8(0)).unwrap();
    assert_eq!(bench.read(0x1020, 1), Ok(15_000));
    bench.write(0x1010, 1, Value::u32(SAVE)).unwrap();
    bench.start(ID);
    bench.sent();
    assert_eq!(
        (bench.read(0x1020, 1), bench.read(0x1020, 2)),
        (Ok(15_000), Ok(1))
    );
    for (index, value) in [(0x1017, Value::u16(50)), (0x2000, Value::u8(1))] {
        verify(&mut bench);
        bench.write(index, 0, value).unwrap();
        assert_eq!(
            (bench.read(0x1020, 1), bench.read(0x1020, 2)),
            (Ok(0), Ok(0))
        );
    }
}

#[test]
fn a_stored_pdo_that_no_longer_holds_is_off_and_told() {
    let mut bench = Bench::new();
    bench.write(0x1010, 2, Value::u32(SAVE)).unwrap();
    // As if another program had stored it: an object that cannot be mapped.
    bench.plant.begin_store(Group::Communication).unwrap();
    bench.plant.put(at(0x1A00, 0), Value::u8(1)).unwrap();
    bench
        .plant
        .put(at(0x1A00, 1), Value::u32(0x6000_0010))
        .unwrap();
    bench.plant.commit_store().unwrap();
    bench.nmt(130);
    let told = spoken(0x85, &[0x00, 0x61, 1, 1, 0, 0, 0, 0]);
    assert_eq!(bench.sent(), [spoken(0x705, &[0]), told]);
    assert_eq!(
        (bench.read(0x1800, 1), bench.read(0x1A00, 0)),
        (Ok(0x8000_0000), Ok(0))
    );
}

/// Signs and validates the safety configuration as a tool does.
fn arm(bench: &mut Bench) {
    for srdo in [0, 1] {
        let signature = bench.node.communication().safety.signature(srdo);
        bench
            .write(0x13FF, srdo as u8 + 1, Value::u16(signature))
            .unwrap();
    }
    bench.write(0x13FE, 0, Value::u8(0xA5)).unwrap();
}

#[test]
fn a_safety_parameter_that_changes_makes_the_configuration_invalid() {
    let mut bench = Bench::new();
    assert_eq!(bench.write(0x13FE, 0, Value::u8(0xA5)), Err(0x0604_0043));
    arm(&mut bench);
    assert_eq!(bench.read(0x13FE, 0), Ok(0xA5));
    bench.write(0x1301, 2, Value::u16(50)).unwrap();
    assert_eq!(bench.read(0x13FE, 0), Ok(0));
    assert_eq!(bench.write(0x13FE, 0, Value::u8(0xA5)), Err(0x0604_0043));
    arm(&mut bench);
    bench.nmt(1);
    assert_eq!(bench.write(0x1301, 2, Value::u16(60)), Err(WRONG_STATE));
    assert_eq!(bench.read(0x13FE, 0), Ok(0xA5));
}

#[test]
fn restore_that_breaks_a_stored_signature() {
    let mut bench = Bench::new();
    bench.write(0x1301, 2, Value::u16(50)).unwrap();
    arm(&mut bench);
    bench.write(0x1010, 1, Value::u32(SAVE)).unwrap();
    bench.nmt(130);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
    assert_eq!(
        (bench.read(0x13FE, 0), bench.read(0x1301, 2)),
        (Ok(0xA5), Ok(50))
    );
    bench.write(0x1011, 2, Value::u32(LOAD)).unwrap();
    bench.nmt(130);
    assert_eq!(bench.sent(), [spoken(0x705, &[0])]);
    assert_eq!(
        (bench.read(0x13FE, 0), bench.read(0x1301, 2)),
        (Ok(0), Ok(25))
    );
}

#[test]
fn pairs_go_out_with_consent_in_operational_only() {
    let mut bench = Bench::new();
    arm(&mut bench);
    bench.node.consent_to_safety(Some(bench.now.after_ms(50)));
    assert_eq!(bench.wait(50), []);
    bench.nmt(1);
    let pair = [spoken(0x101, &[0x0F, 0]), spoken(0x102, &[0xF0, 0xFF])];
    assert!(bench.wait(30).starts_with(&pair));
    bench.node.consent_to_safety(None);
    bench.sent();
    assert_eq!(bench.wait(100), []);
}
