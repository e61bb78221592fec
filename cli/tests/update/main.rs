//! `plumb update` from the outside, against the nodes of `plumb serve`.

mod bench;
mod killed;
#[path = "../program/mod.rs"]
mod program;

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use bench::{Bench, Shared, longest_without_an_angle};
use program::relay::{self, Next};
use program::{plumb, said};

#[test]
fn both_nodes_get_a_new_program_one_after_the_other() {
    let bench = Bench::new();
    let from = Instant::now();
    let image = bench.image("1.2.3", &[]);
    let (status, out, err) = said(&bench.update(&image, &[]));
    assert_eq!(status, Some(0), "{err}");
    assert_eq!(out, "node 1 runs 1.2.3 now\nnode 2 runs 1.2.3 now");
    // Once more changes nothing, and the next one goes into the other slot.
    let (status, out, _) = said(&bench.update(&image, &[]));
    assert_eq!(status, Some(0));
    assert_eq!(out, "node 1 runs 1.2.3 already\nnode 2 runs 1.2.3 already");
    let unsigned = bench.image("1.2.4", &["--unsigned"]);
    let next = format!("{unsigned}-signed");
    let built = plumb(&["image", &next, "--from", &unsigned]).output();
    assert!(built.unwrap().status.success());
    let (status, out, err) = said(&bench.update(&next, &["--nodes", "2,1"]));
    assert_eq!(status, Some(0), "{err}");
    assert_eq!(out, "node 2 runs 1.2.4 now\nnode 1 runs 1.2.4 now");
    let (status, _, err) = said(&bench.update(&image, &[]));
    assert_eq!(status, Some(2));
    assert!(
        err.contains("runs version 1.2.4, and the image is the older 1.2.3"),
        "{err}"
    );
    // A few seconds where the machine has nothing else to do; a wait for a node that never comes
    // back is a minute for each.
    assert!(from.elapsed() < Duration::from_secs(60));
}

/// Updates a pair at work, at real time: how long nobody measured, s of the bus, and the states of
/// the pair.
fn updated_at_work(bench: &Bench) -> (f64, BTreeSet<String>) {
    let image = bench.image("1.2.3", &[]);
    let shared = Shared::default();
    let (outcome, watched) = std::thread::scope(|scope| {
        let watch = scope.spawn(|| longest_without_an_angle(&bench.bus, &shared));
        shared.await_work();
        let outcome = said(&bench.update(&image, &[]));
        shared.end();
        (outcome, watch.join().unwrap())
    });
    let (status, out, err) = outcome;
    assert_eq!(status, Some(0), "{err}");
    assert_eq!(out, "node 1 runs 1.2.3 now\nnode 2 runs 1.2.3 now");
    watched
}

#[test]
fn a_pair_at_work_was_left_without_an_angle_and_half_updated() {
    let bench = Bench::with_speed("1");
    let (longest, _) = updated_at_work(&bench);
    // 0.4 s, and what a loaded machine adds between two commands.
    assert!(longest > 0.0 && longest < 2.0, "{longest}");
}

/// Each peer's absence was 111 warnings, the request of a stop, and a physical fault behind it.
#[test]
fn an_update_of_the_paper_s_pair_at_work_asked_for_a_stop() {
    let bench = Bench::serving(&["--mode", "paper"]);
    let (longest, states) = updated_at_work(&bench);
    assert!(longest > 0.0 && longest < 2.0, "{longest}");
    // Waiting, agreement, and warnings of the few SYNCs before a heartbeat tells of the absence.
    for state in &states {
        assert!(["00", "01", "02"].contains(&state.as_str()), "{states:?}");
    }
    assert!(states.contains("00") && states.contains("01"), "{states:?}");
}

#[test]
fn a_program_that_fails_its_self_check_is_rolled_back_and_the_other_node_left_alone() {
    let bench = Bench::new();
    let image = bench.image("2.0.0", &["--sick"]);
    let (status, out, err) = said(&bench.update(&image, &[]));
    assert_eq!((status, out.as_str()), (Some(1), ""), "{err}");
    assert!(err.contains("node 1 gave the new program up"), "{err}");
    assert!(err.contains("runs version 0.1.0 again"), "{err}");
    // Node 2 was not touched, node 1 can be mended.
    let image = bench.image("2.0.1", &[]);
    let (status, out, err) = said(&bench.update(&image, &[]));
    assert_eq!(status, Some(0), "{err}");
    assert_eq!(out, "node 1 runs 2.0.1 now\nnode 2 runs 2.0.1 now");
}

/// Kills an update of node 1 at a request to it that is such; the bus still gets that.
fn broken_off(bench: &Bench, image: &str, mut is_here: impl FnMut(&[u8]) -> bool) {
    let mut reached = false;
    let words = ["update", image, "--nodes", "1", "--force"];
    relay::run(&bench.bus, &words, |program, id, data| {
        if id != 0x601 || !is_here(data) {
            return Next::Goes;
        }
        program.kill().unwrap();
        program.wait().unwrap();
        reached = true;
        Next::Ends
    });
    assert!(reached, "it has ended by itself");
}

#[test]
fn an_update_that_was_broken_off_goes_on_with_the_same_command() {
    let bench = Bench::with_speed("1");
    let body = bench.folder.0.path().join("body");
    std::fs::write(&body, vec![0x5A; 100_000]).unwrap();
    let body = body.display().to_string();
    let image = bench.image("1.0.0", &["--a", &body, "--b", &body]);
    // In the clear: behind 1F51h, which begins it.
    broken_off(&bench, &image, |data| {
        data.starts_with(&[0x2F, 0x51, 0x1F, 1, 3])
    });
    // In the download, which takes 14 000 requests.
    let mut requests = 0;
    broken_off(&bench, &image, |data| {
        let begins = data.starts_with(&[0xC6, 0x50, 0x1F, 1]);
        requests += usize::from(requests > 0 || begins);
        requests == 7000
    });
    let (status, out, err) = said(&bench.update(&image, &["--nodes", "1", "--force"]));
    assert_eq!(status, Some(0), "{err}");
    assert!(out.starts_with("node 1 continues after "), "{out}");
    assert!(out.ends_with("node 1 runs 1.0.0 now"), "{out}");
}

#[test]
fn what_cannot_be_let_in_is_refused_with_a_sentence() {
    let bench = Bench::new();
    let refused = |image: &str, status: i32, sentence: &str| {
        let (code, out, err) = said(&bench.update(image, &[]));
        assert_eq!((code, out.as_str()), (Some(status), ""), "{err}");
        assert!(err.contains(sentence), "{err}");
        assert_eq!(err.lines().count(), 1, "{err}");
    };
    let other = bench.image("3.0.0", &["--hardware", "1"]);
    refused(
        &other,
        2,
        "no image is for node 1: its hardware is 504C042Ch",
    );
    let bare = bench.image("3.0.1", &["--unsigned"]);
    refused(&bare, 1, "node 1 refuses the image: it is not signed");
    let key = bench.folder.0.path().join("key");
    std::fs::write(&key, "5a".repeat(32)).unwrap();
    let forged = bench.image("3.0.2", &["--key", &key.display().to_string()]);
    refused(
        &forged,
        1,
        "node 1 refuses the image: its signature is wrong",
    );
    let mut bytes = std::fs::read(&forged).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&forged, bytes).unwrap();
    refused(&forged, 2, "is damaged: fetch it again");
    refused("no such file", 2, "cannot read no such file");
    std::fs::write(&key, "#!/bin/sh").unwrap();
    let key = key.display().to_string();
    refused(
        &key,
        2,
        "is no image: it does not begin as one, or ends early",
    );
    std::fs::write(&key, "").unwrap();
    let empty = [
        "image",
        &other,
        "--version",
        "1.0.0",
        "--a",
        &key,
        "--b",
        &key,
    ];
    let (status, _, err) = said(&plumb(&empty).output().unwrap());
    assert_eq!(status, Some(2), "{err}");
    assert!(err.contains("is empty"), "{err}");
    let (_, _, absent) = said(&bench.update(&bare, &["--nodes", "1,9"]));
    assert!(
        absent.contains("there is no node 9; nodes 1 and 2 are there"),
        "{absent}"
    );
    let twice = said(&bench.update(&forged, &["--nodes", "1,1"]));
    assert!(twice.2.contains("node 1 is named twice"), "{}", twice.2);
}

#[test]
fn an_image_that_no_node_could_use_was_built() {
    let bench = Bench::new();
    let both = bench.image("1.0.0", &[]);
    let long = bench.folder.path("long");
    std::fs::write(&long, vec![0x5A; 200_000]).unwrap();
    let twice = ["image", "out", "--from", &both, &both];
    let body = [
        "image",
        "out",
        "--version",
        "1.0.0",
        "--a",
        &long,
        "--b",
        &long,
    ];
    for (words, sentence) in [
        (&twice[..], "two of the images are for slot A"),
        (&body, "is longer than the 105984 bytes that a slot has"),
    ] {
        let refused = plumb(words).current_dir(bench.folder.0.path()).output();
        let (status, out, err) = said(&refused.unwrap());
        assert_eq!((status, out.as_str()), (Some(2), ""), "{err}");
        assert!(err.contains(sentence), "{err}");
        assert!(!bench.folder.0.path().join("out").exists());
    }
}

#[test]
fn the_public_key_of_a_key_file_is_what_a_node_is_built_with() {
    use device::memory::ed25519::Ed25519;
    use device::memory::update::Signatures;

    let name = format!("plumb-update-key-{}", std::process::id());
    let folder = std::env::temp_dir().join(name);
    std::fs::create_dir_all(&folder).unwrap();
    let (key, file) = (folder.join("key"), folder.join("image"));
    let (key, file) = (key.display().to_string(), file.display().to_string());
    std::fs::write(&key, "3c".repeat(32)).unwrap();
    let printed = plumb(&["image", "--public", "--key", &key]).output();
    let (status, text, err) = said(&printed.unwrap());
    assert_eq!((status, text.len()), (Some(0), 64), "{err}");
    let built = plumb(&["image", &file, "--version", "1.0.0", "--key", &key]).output();
    assert!(built.unwrap().status.success());
    let both = std::fs::read(&file).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    let image = &both[..both.len() / 2];
    // Read as the firmware reads PLUMB_KEY.
    let key = std::array::from_fn(|at| u8::from_str_radix(&text[2 * at..][..2], 16).unwrap());
    let known = Ed25519 {
        key,
        unsigned: false,
    };
    let mut check = known.place();
    assert!(known.begin(&mut check, image[32..96].try_into().unwrap()));
    known.add(&mut check, &image[..32]);
    known.add(&mut check, &image[512..]);
    assert!(known.is_good(&check));
}
