//! Installing with cuts at every operation, and what is refused.

use super::*;
use crate::image::tests::{HARDWARE, file};
use crate::layout::{C8, RC};
use crate::nor::tests::{Bench, bench};
use crate::slots::{Decision, SlotState, Why, activate, boot, confirm, factory_marks, standing};

const OLD: Version = Version::new(1, 0, 0);
const NEW: Version = Version::new(1, 1, 0);

const RULES: Rules = Rules {
    hardware: HARDWARE,
    running: OLD,
    downgrade: false,
    unsigned: true,
};

/// Slot A as it leaves the factory, and rubbish in B.
fn delivered() -> Bench {
    let mut nor = bench(128, 7);
    let mut factory = file(Slot::A, OLD, 300);
    factory[MARKS as usize..HEADER as usize].copy_from_slice(&factory_marks());
    program(&mut nor, RC.a.start, &factory).unwrap();
    program(&mut nor, RC.b.unwrap().start + 512, &[0x55; 4096]).unwrap();
    nor
}

fn install(nor: &mut Bench, file: &[u8], rules: Rules) -> Result<Header, InstallError> {
    let mut install = Install::new(nor, &RC, Slot::A, rules)?;
    while install.erase(nor)? == Progress::More {}
    for piece in file.chunks(7) {
        install.append(nor, piece)?;
    }
    install.finish()?;
    Ok(*install.header().unwrap())
}

fn update(nor: &mut Bench, file: &[u8]) -> bool {
    install(nor, file, RULES).is_ok() && activate(nor, &RC, Slot::B, HARDWARE).is_ok()
}

#[test]
fn an_image_is_installed_whole_and_marks_in_the_file_are_left_out() {
    let mut nor = delivered();
    let mut file = file(Slot::B, NEW, 4000);
    file[MARKS as usize..HEADER as usize].copy_from_slice(&factory_marks());
    let header = install(&mut nor, &file, RULES).unwrap();
    assert_eq!((header.version, header.length), (NEW, 4000));
    let b = RC.b;
    assert_eq!(standing(&mut nor, b, HARDWARE), SlotState::Idle(header));
    assert!(matches!(
        boot(&mut nor, &RC, HARDWARE),
        Decision::Run(Slot::A, ..)
    ));
    assert_eq!(nor.broken_rules(), 0);
}

#[test]
fn a_cut_at_any_operation_of_an_update_leaves_the_old_or_the_new() {
    let file = file(Slot::B, NEW, 600);
    let mut before = delivered();
    // Slot B holds an older image that is confirmed too.
    let older = crate::image::tests::file(Slot::B, OLD, 600);
    install(&mut before, &older, RULES).unwrap();
    program(&mut before, RC.b.unwrap().start + MARKS, &factory_marks()).unwrap();
    for cut in 0.. {
        let mut nor = before.clone();
        nor.reseed(cut);
        nor.cut_after(cut);
        let done = update(&mut nor, &file);
        nor.power_up();
        match boot(&mut nor, &RC, HARDWARE) {
            Decision::Run(Slot::A, header, Why::Confirmed) => {
                assert_eq!(header.version, OLD);
                assert!(!done, "cut {cut}");
                // The update can be made again from the beginning.
                assert!(update(&mut nor, &file));
                let again = boot(&mut nor, &RC, HARDWARE);
                assert!(matches!(again, Decision::Run(Slot::B, _, Why::Trial)));
            }
            Decision::Run(Slot::B, header, Why::Trial) => assert_eq!(header.version, NEW),
            other => panic!("cut {cut}: {other:?}"),
        }
        assert_eq!(nor.broken_rules(), 0);
        if done {
            // 54 erases, 300 half-words of the body, some of the header and its mark.
            assert!(cut > 54 + 300, "{cut}");
            return;
        }
    }
}

#[test]
fn what_may_not_run_here_is_refused_with_its_header() {
    let cases = [
        (file(Slot::A, NEW, 64), RULES, "Image(Address)"),
        (file(Slot::B, Version::new(0, 9, 9), 64), RULES, "Downgrade"),
        (
            file(Slot::B, NEW, 64),
            Rules {
                hardware: 1,
                ..RULES
            },
            "Image(Hardware)",
        ),
        (
            file(Slot::B, NEW, 64),
            Rules {
                unsigned: false,
                ..RULES
            },
            "Unsigned",
        ),
    ];
    for (file, rules, expected) in cases {
        let mut nor = delivered();
        let mut install = Install::new(&mut nor, &RC, Slot::A, rules).unwrap();
        assert_eq!(
            install.append(&mut nor, &file),
            Err(InstallError::NotErased)
        );
        while install.erase(&mut nor).unwrap() == Progress::More {}
        assert_eq!(install.append(&mut nor, &file[..31]), Ok(()));
        let error = install.append(&mut nor, &file[31..32]).unwrap_err();
        assert!(std::format!("{error:?}").starts_with(expected), "{error:?}");
        assert_eq!(install.finish(), Err(InstallError::Incomplete));
    }
    let older = file(Slot::B, Version::new(0, 9, 9), 64);
    let permitted = Rules {
        downgrade: true,
        ..RULES
    };
    assert!(install(&mut delivered(), &older, permitted).is_ok());
    let same = file(Slot::B, OLD, 64);
    assert!(install(&mut delivered(), &same, RULES).is_ok());
}

#[test]
fn too_few_too_many_and_wrong_bytes_are_no_image() {
    let whole = file(Slot::B, NEW, 64);
    for length in [0, 31, 32, 512, 574, 575] {
        let cut = install(&mut delivered(), &whole[..length], RULES);
        assert_eq!(cut, Err(InstallError::Incomplete), "{length}");
    }
    let mut long = whole.clone();
    long.push(0);
    let refused = install(&mut delivered(), &long, RULES);
    assert_eq!(refused, Err(InstallError::TooLong));
    let mut wrong = whole.clone();
    wrong[570] ^= 1;
    let refused = install(&mut delivered(), &wrong, RULES);
    assert_eq!(refused, Err(InstallError::Image(ImageError::Body)));
    wrong[3] ^= 1;
    let refused = install(&mut delivered(), &wrong, RULES);
    assert_eq!(refused, Err(InstallError::Image(ImageError::Magic)));
}

#[test]
fn while_the_running_image_is_on_trial_the_other_stays() {
    let mut nor = delivered();
    assert!(update(&mut nor, &file(Slot::B, NEW, 64)));
    let trial = Install::new(&mut nor, &RC, Slot::B, RULES).err();
    assert_eq!(trial, Some(InstallError::Unconfirmed));
    confirm(&mut nor, &RC, Slot::B).unwrap();
    assert!(Install::new(&mut nor, &RC, Slot::B, RULES).is_ok());
    let single = Install::new(&mut nor, &C8, Slot::A, RULES).err();
    assert_eq!(single, Some(InstallError::NoSlot));
}
