//! A new program over the bus: into the slot that does not run, on trial, confirmed or given up.
//!
//! In: a device with a program in slot A, and a master with the file of an image. Out: which
//! program runs after each reset, what the master is told, and that a loss of supply at any flash
//! operation leaves the old program or the new one.

use canopen::object::{Address, Value, at};
use device::objects::table::Channel;
use embedded_storage::nor_flash::NorFlash;
use flash::check_sum::Crc32;
use flash::image::{FIELDS, Header, Signature, Version};
use flash::layout::{BASE, HEADER, PAGE, RC, Slot};
use flash::slots::{MARKS, factory_marks};

use crate::site::{HARDWARE, Memory, Seeded, Site, along, blank};

const CONTROL: Address = at(0x1F51, 1);
const STATUS: Address = at(0x1F57, 1);
const DATA: Address = at(0x1F50, 1);

/// The file of an image.
fn image(slot: Slot, version: Version, hardware: u32) -> Vec<u8> {
    let body: Vec<u8> = (0..120).map(|n: u8| n ^ version.0 as u8).collect();
    let header = Header {
        signature: Signature::None,
        hardware,
        version,
        address: BASE + RC.slot(slot).unwrap().start + HEADER,
        length: body.len() as u32,
        crc: Crc32::of(&body),
    };
    let mut file = vec![0xFF; HEADER as usize];
    file[..FIELDS].copy_from_slice(&header.encode());
    file.extend(body);
    file
}

const OLD: Version = Version::new(1, 0, 7);
const NEW: Version = Version::new(1, 1, 0);

/// As it leaves the factory: one program, confirmed, in slot A.
fn delivered() -> Memory {
    let mut memory = blank();
    let mut file = image(Slot::A, OLD, HARDWARE);
    file[MARKS as usize..HEADER as usize].copy_from_slice(&factory_marks());
    let flash = memory.flash_mut();
    for (offset, half_word) in (RC.a.start..).step_by(2).zip(file.chunks(2)) {
        flash.write(offset, half_word).unwrap();
    }
    memory
}

fn powered(memory: Memory) -> Site {
    Site::with(Channel::A, along(0x2D), memory)
}

fn number(site: &mut Site, address: Address) -> u64 {
    site.read(address).unwrap().unwrap().unsigned()
}

/// Version, slot and standing of what runs.
fn running(site: &mut Site) -> (u64, u64, u64) {
    let [version, slot, standing] = [2, 3, 4].map(|sub| number(site, at(0x2080, sub)));
    (version, slot, standing)
}

/// Stop and clear, until the memory waits for an image.
fn clear(site: &mut Site) {
    for command in [0, 3] {
        assert_eq!(site.write(CONTROL, Value::u8(command)), Some(Ok(())));
    }
    let pages = RC.a.length / PAGE;
    site.pass(20 * (pages - 3));
    assert_eq!(number(site, STATUS), 1);
    site.pass(80);
    assert_eq!(number(site, STATUS), 1 << 1);
}

/// All of an update up to the start, whatever comes of it.
fn update(site: &mut Site, file: &[u8]) {
    for command in [0, 3] {
        let _ = site.write(CONTROL, Value::u8(command));
    }
    site.pass(1200);
    let _ = site.download(DATA, file);
    let _ = site.write(CONTROL, Value::u8(1));
    site.pass(CHECK_MS);
}

/// How long the check of a small image takes, ms: six steps, and one until the first.
const CHECK_MS: u32 = 140;

#[test]
fn a_new_program_runs_on_trial_and_is_confirmed_once_it_measures() {
    let mut site = powered(delivered());
    assert_eq!(running(&mut site), (OLD.0.into(), 0, 0));
    let file = image(Slot::B, NEW, HARDWARE);
    clear(&mut site);
    assert_eq!(site.download(DATA, &file), Some(Ok(())));
    let sum = u64::from(Crc32::of(&file[HEADER as usize..]));
    assert_eq!(number(&mut site, at(0x1F56, 1)), sum);
    assert_eq!(number(&mut site, STATUS), 0);
    // Whole, but not started: a reset forgets it.
    assert_eq!(running(&mut site), (OLD.0.into(), 0, 0));
    assert_eq!(site.write(CONTROL, Value::u8(1)), Some(Ok(())));
    site.pass(CHECK_MS);
    assert_eq!(running(&mut site), (NEW.0.into(), 1, 1));
    assert_eq!(number(&mut site, at(0x1F56, 1)), sum);
    site.measure(400);
    assert_eq!(running(&mut site), (NEW.0.into(), 1, 0));
    for _ in 0..5 {
        site.power_cycle();
        assert_eq!(running(&mut site), (NEW.0.into(), 1, 0));
    }
    assert_eq!(site.device.memory().flash().broken_rules(), 0);
}

#[test]
fn a_program_that_never_measures_is_given_up_after_half_a_minute() {
    let mut site = powered(delivered());
    update(&mut site, &image(Slot::B, NEW, HARDWARE));
    for _ in 0..3 {
        assert_eq!(running(&mut site), (NEW.0.into(), 1, 1));
        site.pass(10_100);
    }
    assert_eq!(running(&mut site), (OLD.0.into(), 0, 2));
    site.pass(20_000);
    assert_eq!(running(&mut site), (OLD.0.into(), 0, 2));
}

#[test]
fn the_running_program_is_not_replaced_while_it_is_on_trial() {
    let mut site = powered(delivered());
    update(&mut site, &image(Slot::B, NEW, HARDWARE));
    assert_eq!(site.write(CONTROL, Value::u8(0)), Some(Ok(())));
    assert_eq!(site.write(CONTROL, Value::u8(3)), Some(Err(0x0800_0021)));
    assert_eq!(number(&mut site, STATUS), 7 << 1);
}

#[test]
fn what_cannot_run_here_is_refused_with_its_reason() {
    let mut damaged = image(Slot::B, NEW, HARDWARE);
    *damaged.last_mut().unwrap() ^= 1;
    let mut torn = image(Slot::B, NEW, HARDWARE);
    torn[9] ^= 1;
    let whole = image(Slot::B, NEW, HARDWARE);
    let longer = [&whole[..], &[0; 4]].concat();
    let cases: [(&str, &[u8], u32, u64); 8] = [
        (
            "hardware",
            &image(Slot::B, NEW, 2),
            0x0604_0043,
            2 << 1 | 1 << 16,
        ),
        (
            "slot",
            &image(Slot::A, NEW, HARDWARE),
            0x0604_0043,
            2 << 1 | 2 << 16,
        ),
        (
            "older",
            &image(Slot::B, Version::new(1, 0, 6), HARDWARE),
            0x0800_0021,
            7 << 1 | 3 << 16,
        ),
        ("body", &damaged, 0x0800_0020, 3 << 1),
        ("header", &torn, 0x0800_0020, 3 << 1),
        ("text", &[b' '; 600], 0x0800_0020, 2 << 1),
        ("longer", &longer, 0x0800_0020, 3 << 1),
        ("shorter", &whole[..600], 0x0800_0020, 3 << 1),
    ];
    let mut site = powered(delivered());
    for (name, file, code, status) in cases {
        clear(&mut site);
        assert_eq!(site.download(DATA, file), Some(Err(code)), "{name}");
        assert_eq!(number(&mut site, STATUS), status, "{name}");
        let started = site.write(CONTROL, Value::u8(1));
        assert_eq!(started, Some(Err(0x0800_0022)), "{name}");
        site.write(CONTROL, Value::u8(0));
    }
    // The same version is let in, and so is the right image after all that.
    clear(&mut site);
    let same = image(Slot::B, OLD, HARDWARE);
    assert_eq!(site.download(DATA, &same), Some(Ok(())));
    clear(&mut site);
    assert_eq!(site.download(DATA, &whole), Some(Ok(())));
}

#[test]
fn a_download_that_was_broken_off_goes_on_where_it_was() {
    let mut site = powered(delivered());
    let file = image(Slot::B, NEW, HARDWARE);
    clear(&mut site);
    assert_eq!(number(&mut site, at(0x2080, 6)), 0);
    // 77 segments, and then the master is gone.
    let sent = 77 * 7;
    let begun = site.request([0x21, 0x50, 0x1F, 1, 0x78, 2, 0, 0]);
    assert!(begun.is_some_and(|answer| answer.is_ok()));
    for (number, piece) in file[..sent].chunks(7).enumerate() {
        let mut segment = [(number as u8 & 1) << 4; 8];
        segment[1..].copy_from_slice(piece);
        assert!(site.request(segment).is_some_and(|answer| answer.is_ok()));
    }
    site.hears(0x601, &[0x80, 0x50, 0x1F, 1, 0, 0, 4, 5]);
    assert_eq!(number(&mut site, STATUS), 3 << 1);
    let identity = identity(&file);
    assert_eq!(number(&mut site, at(0x2080, 5)), identity);
    assert_eq!(number(&mut site, at(0x2080, 6)), sent as u64);
    let wrong = site.write(at(0x2080, 6), Value::u32(1));
    assert_eq!(wrong, Some(Err(0x0609_0030)));
    let on = site.write(at(0x2080, 6), Value::u32(sent as u32));
    assert_eq!(on, Some(Ok(())));
    assert_eq!(site.download(DATA, &file[sent..]), Some(Ok(())));
    assert_eq!(site.write(CONTROL, Value::u8(1)), Some(Ok(())));
    site.pass(CHECK_MS);
    assert_eq!(running(&mut site), (NEW.0.into(), 1, 1));
}

/// The sum over header and signature of a file, without the one that the header ends with.
fn identity(file: &[u8]) -> u64 {
    let fields = [&file[..28], &file[32..FIELDS]].concat();
    u64::from(Crc32::of(&fields))
}

#[test]
fn an_image_with_another_signature_of_the_same_body_passed_for_the_one_under_way() {
    let file = image(Slot::B, NEW, HARDWARE);
    // What 2080h shows of the image under way when so many segments of it have come.
    let under_way = |file: &[u8], segments: usize| {
        let mut site = powered(delivered());
        clear(&mut site);
        let begun = site.request([0x21, 0x50, 0x1F, 1, 0x78, 2, 0, 0]);
        assert!(begun.is_some_and(|answer| answer.is_ok()));
        for (number, piece) in file.chunks(7).take(segments).enumerate() {
            let mut segment = [(number as u8 & 1) << 4; 8];
            segment[1..].copy_from_slice(piece);
            assert!(site.request(segment).is_some_and(|answer| answer.is_ok()));
        }
        site.hears(0x601, &[0x80, 0x50, 0x1F, 1, 0, 0, 4, 5]);
        [5, 6].map(|sub| number(&mut site, at(0x2080, sub)))
    };
    // A signature is over the version, too.
    let mut signed = file.clone();
    signed[FIELDS - 1] = 0;
    let shown = [&file, &signed].map(|file| under_way(file, 20));
    assert_eq!(
        shown,
        [identity(&file), identity(&signed)].map(|sum| [sum, 140])
    );
    assert!(shown[0] != shown[1]);
    // Before all of the signature is here nothing can go on.
    assert_eq!(under_way(&file, 13), [0, 0]);
    assert_eq!(under_way(&file, 14), [identity(&file), 98]);
}

#[test]
fn the_next_page_of_a_clear_did_not_wait_until_what_had_come_up_was_done() {
    let mut site = powered(delivered());
    // The start makes room for events.
    site.pass(200);
    for command in [0, 3] {
        assert_eq!(site.write(CONTROL, Value::u8(command)), Some(Ok(())));
    }
    site.pass(100);
    let erased = |site: &mut Site| site.device.memory().flash().operations();
    let before = erased(&mut site);
    // Each page takes 40 ms, which the device is told when they are over.
    let mut last = before;
    for _ in 0..100 {
        site.pass(0);
        let now = erased(&mut site);
        assert!(now - last <= 1);
        if now > last {
            site.stand_still(40_000);
            site.pass(0);
            assert_eq!(erased(&mut site), now, "within 20 ms");
        }
        last = now;
    }
    let pages = last - before;
    assert!((30..=50).contains(&pages), "{pages}");
}

#[test]
fn a_start_is_answered_at_once_and_a_check_waits_while_others_work() {
    let mut site = powered(delivered());
    clear(&mut site);
    let file = image(Slot::B, NEW, HARDWARE);
    assert_eq!(site.download(DATA, &file), Some(Ok(())));
    let operations = site.device.memory().flash().operations();
    assert_eq!(site.write(CONTROL, Value::u8(1)), Some(Ok(())));
    // A client that does not wait is told so, and changes nothing.
    for command in 0..4 {
        let refused = site.write(CONTROL, Value::u8(command));
        assert_eq!(refused, Some(Err(0x0800_0022)), "{command}");
    }
    assert_eq!(site.download(DATA, &file), Some(Err(0x0800_0022)));
    site.pass(50);
    assert_eq!(number(&mut site, STATUS), 1);
    site.nmt(1);
    site.pass(2 * CHECK_MS);
    assert_eq!(number(&mut site, STATUS), 1);
    assert_eq!(running(&mut site), (OLD.0.into(), 0, 0));
    assert_eq!(site.device.memory().flash().operations(), operations);
    site.nmt(128);
    site.pass(CHECK_MS);
    assert_eq!(running(&mut site), (NEW.0.into(), 1, 1));
}

#[test]
fn an_image_that_went_bad_after_its_download_is_not_started() {
    let mut site = powered(delivered());
    clear(&mut site);
    let file = image(Slot::B, NEW, HARDWARE);
    assert_eq!(site.download(DATA, &file), Some(Ok(())));
    let body = RC.b.unwrap().start + HEADER;
    site.device.memory().flash_mut().flip(body + 60, 4);
    assert_eq!(site.write(CONTROL, Value::u8(1)), Some(Ok(())));
    site.pass(CHECK_MS);
    assert_eq!(number(&mut site, STATUS), 3 << 1);
    assert_eq!(running(&mut site), (OLD.0.into(), 0, 0));
}

#[test]
fn a_reset_during_a_check_forgets_the_image() {
    let mut site = powered(delivered());
    clear(&mut site);
    let file = image(Slot::B, NEW, HARDWARE);
    assert_eq!(site.download(DATA, &file), Some(Ok(())));
    assert_eq!(site.write(CONTROL, Value::u8(1)), Some(Ok(())));
    site.pass(50);
    site.power_cycle();
    site.pass(2 * CHECK_MS);
    assert_eq!(running(&mut site), (OLD.0.into(), 0, 0));
    assert_eq!(number(&mut site, STATUS), 0);
}

#[test]
fn room_was_made_by_several_erases_in_a_row() {
    let mut site = powered(delivered());
    let erases = |site: &mut Site| -> u32 {
        let pages = site.device.memory().flash().pages();
        pages.iter().map(flash::nor::Page::erases).sum()
    };
    let (first, mut last, mut pause) = (erases(&mut site), erases(&mut site), 10);
    for _ in 0..50 {
        site.pass(0);
        let now = erases(&mut site);
        let least = if now == last { 0 } else { 20 };
        assert!(now - last <= 1 && pause >= least, "{pause} ms");
        pause = if now == last { pause + 10 } else { 10 };
        last = now;
    }
    assert!(last - first >= 2, "{first} to {last}");
}

#[test]
fn nothing_is_erased_in_operational() {
    let mut site = powered(delivered());
    for command in [0, 3] {
        assert_eq!(site.write(CONTROL, Value::u8(command)), Some(Ok(())));
    }
    // Without samples the sensor's fault would be stored.
    site.measure(20);
    site.nmt(1);
    let operations = site.device.memory().flash().operations();
    site.measure(400);
    assert_eq!(site.device.memory().flash().operations(), operations);
    site.nmt(128);
    site.pass(1200);
    assert_eq!(number(&mut site, STATUS), 1 << 1);
}

#[test]
fn a_cut_at_any_operation_of_an_update_over_the_bus_leaves_the_old_program_or_the_new() {
    let memory = delivered();
    let file = image(Slot::B, NEW, HARDWARE);
    // The start counts too: it makes room for events.
    let before = memory.flash().operations();
    let mut whole = powered(memory.clone());
    update(&mut whole, &file);
    whole.measure(400);
    let operations = whole.device.memory().flash().operations() - before;
    assert_eq!(running(&mut whole), (NEW.0.into(), 1, 0));
    assert!(operations > 130, "{operations}");
    let mut renewed = 0;
    for cut in 0..operations {
        let mut memory = memory.clone();
        let flash = memory.flash_mut();
        flash.set_draw(Seeded(cut.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1));
        flash.cut_after(cut);
        let mut site = powered(memory);
        update(&mut site, &file);
        site.measure(400);
        assert!(site.device.memory().flash().is_cut(), "operation {cut}");
        site.power_cycle();
        let old = (OLD.0.into(), 0, 0);
        let shown = running(&mut site);
        if shown != old {
            let (version, slot, standing) = shown;
            assert_eq!((version, slot), (NEW.0.into(), 1), "operation {cut}");
            assert!(standing < 2, "operation {cut}");
            renewed += 1;
        }
        // Either can be updated, or confirmed, to the new one.
        if shown == old {
            update(&mut site, &file);
        }
        site.measure(400);
        assert_eq!(
            running(&mut site),
            (NEW.0.into(), 1, 0),
            "after a cut at {cut}"
        );
        assert_eq!(site.device.memory().flash().broken_rules(), 0, "{cut}");
    }
    // Attempt and confirmation come behind the activation.
    assert!((3..10).contains(&renewed), "{renewed} of {operations}");
}
