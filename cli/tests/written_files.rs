//! Verbs that write files, on a disk that takes nothing more and where no file can be replaced:
//! what was there stays, and nothing is left beside it.
//!
//! In: a limit of the length of files, which a write meets as it meets a full disk; a pipe, a link.
#![cfg(unix)]

use std::fs;
use std::process::Command;

mod program;

use program::{Folder, Served, plumb, said};

/// The same call with files of no more than so many blocks of 512 or 1024 bytes.
fn limited(blocks: u32, call: &Command) -> Command {
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &script]);
    command.arg(call.get_program()).args(call.get_args());
    command
}

/// All names in a folder, with what the files hold.
fn content(folder: &Folder) -> Vec<(String, Vec<u8>)> {
    let mut all: Vec<_> = fs::read_dir(folder.0.path())
        .unwrap()
        .map(|entry| entry.unwrap())
        .map(|entry| (entry.file_name().into_string().unwrap(), entry.path()))
        .map(|(name, path)| (name, fs::read(path).unwrap()))
        .collect();
    all.sort();
    all
}

/// Expects that a call fails at `name`, in one sentence, and changes nothing.
fn fails(folder: &Folder, blocks: u32, name: &str, arguments: &[&str]) {
    folder.file(name, "old");
    let before = content(folder);
    let output = limited(blocks, &plumb(arguments)).output().unwrap();
    let (status, _, err) = said(&output);
    assert_eq!(status, Some(2), "{arguments:?}: {err}");
    assert_eq!(err.lines().count(), 1, "{err}");
    assert!(err.contains(name), "{err}");
    assert_eq!(content(folder), before, "{arguments:?}");
}

#[test]
fn a_full_disk_cost_the_old_document_image_or_manual() {
    let folder = Folder::new();
    let file = folder.path("file");
    fails(
        &folder,
        1,
        "file",
        &["describe", "eds", "--force", "--output", &file],
    );
    fails(
        &folder,
        0,
        "file",
        &["image", &file, "--force", "--version", "1.2.3"],
    );
    let pages = folder.0.path().display().to_string();
    fails(&folder, 1, "plumb.1", &["man", "--output", &pages]);
}

#[test]
fn a_full_disk_left_the_part_of_a_table() {
    let folder = Folder::new();
    let frames = (0..400).map(|n| format!("({n}.5) can0 181#E80300003F01\n"));
    let log = folder.file("a.log", frames.collect::<String>());
    for name in ["a.csv", "a.parquet", "a.asc", "b.log"] {
        let place = folder.path(name);
        fails(
            &folder,
            1,
            name,
            &["replay", &log, "--force", "--export", &place],
        );
    }
}

#[test]
fn a_full_disk_cost_the_old_object_or_box() {
    let served = Served::start(&[]);
    let bus = served.bus();
    let folder = Folder::new();
    let on_bus = |verb, option, place: &str| {
        let words = [verb, "--node", "1", "--bus", &bus, "--force", option, place];
        words.map(str::to_owned).to_vec()
    };
    let file = folder.path("file");
    let mut get = on_bus("get", "--output", &file);
    get.push("1008h".to_owned());
    let get: Vec<_> = get.iter().map(String::as_str).collect();
    fails(&folder, 0, "file", &get);
    let boxes = on_bus("faults", "--boxes", &folder.0.path().display().to_string());
    let boxes: Vec<_> = boxes.iter().map(String::as_str).collect();
    fails(&folder, 0, "node-1-fault-log.bin", &boxes);
}

/// Expects that a call leaves the file `name` alone and prints that in one sentence, and replaces
/// it with --force.
fn asks(folder: &Folder, name: &str, arguments: &[&str]) {
    folder.file(name, "old");
    let before = content(folder);
    let (status, _, err) = said(&plumb(arguments).output().unwrap());
    assert_eq!(
        (status, err.lines().count()),
        (Some(2), 1),
        "{arguments:?}: {err}"
    );
    let sentence = format!("{} is there already", folder.path(name));
    let is_told = err.contains(&sentence) && err.ends_with(", or replace it with --force");
    assert!(is_told, "{err}");
    assert_eq!(content(folder), before, "{arguments:?}");
    let forced = plumb(&[arguments, &["--force"]].concat()).output().unwrap();
    let (status, _, err) = said(&forced);
    assert_eq!(status, Some(0), "{arguments:?}: {err}");
    assert_ne!(content(folder), before, "{arguments:?}");
}

#[test]
fn verbs_replaced_a_file_of_the_user_s_without_a_word() {
    let served = Served::start(&[]);
    let bus = served.bus();
    let (folder, log) = (Folder::new(), Folder::new());
    let log = log.file("a.log", "(1.5) can0 181#E80300003F01\n");
    let file = folder.path("file");
    asks(&folder, "file", &["describe", "eds", "--output", &file]);
    asks(&folder, "file", &["image", &file, "--version", "1.2.3"]);
    for name in ["a.csv", "a.parquet", "a.asc", "b.log"] {
        let place = folder.path(name);
        asks(&folder, name, &["replay", &log, "--export", &place]);
    }
    let on_bus = ["--node", "1", "--bus", &bus];
    let get = ["get", "1008h", "--output", &file];
    asks(&folder, "file", &[&get[..], &on_bus].concat());
    let place = folder.0.path().display().to_string();
    let boxes = ["faults", "--boxes", &place];
    asks(
        &folder,
        "node-1-fault-log.bin",
        &[&boxes[..], &on_bus].concat(),
    );
    let record = ["monitor", "--for", "1s", "--bus", &bus, "--record", &file];
    asks(&folder, "file", &record);
}

#[test]
fn a_killed_export_left_a_hidden_file() {
    let folder = Folder::new();
    let frames = (0..200_000).map(|n| format!("({n}.5) can0 181#E80300003F01\n"));
    let log = folder.file("a.log", frames.collect::<String>());
    let table = folder.path("a.csv");
    let export = ["replay", &log, "--export", &table];
    let mut killed = plumb(&export).spawn().unwrap();
    while content(&folder).len() < 2 {
        assert!(
            killed.try_wait().unwrap().is_none(),
            "it has ended by itself"
        );
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    assert_eq!(content(&folder).len(), 2);
    let (status, _, err) = said(&plumb(&export).output().unwrap());
    assert_eq!(status, Some(0), "{err}");
    let names: Vec<_> = content(&folder).into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["a.csv", "a.log"]);
}

#[test]
fn a_pipe_or_link_was_replaced_by_a_calibration_or_table() {
    use std::os::unix::fs::{FileTypeExt as _, symlink};
    let folder = Folder::new();
    let log = folder.file("a.log", "(1.5) can0 181#E80300003F01\n");
    let pipe = folder.path("pipe.csv");
    let made = Command::new("mkfifo").arg(&pipe).status();
    assert!(made.is_ok_and(|status| status.success()), "no mkfifo here");
    let keep = [
        "calibrate",
        "--force",
        "--bus",
        "127.0.0.1:1",
        "--keep",
        &pipe,
    ];
    let export = ["replay", &log, "--export", &pipe];
    for arguments in [&keep[..], &export] {
        let (status, _, err) = said(&plumb(arguments).output().unwrap());
        assert_eq!((status, err.lines().count()), (Some(2), 1), "{err}");
        assert!(err.contains("it is no regular file"), "{err}");
        assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
    }
    let file = folder.file("there.csv", "old");
    let link = folder.path("link.csv");
    symlink("there.csv", &link).unwrap();
    let run = plumb(&["replay", &log, "--export", &link, "--force"])
        .output()
        .unwrap();
    assert_eq!(said(&run).0, Some(0));
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert!(fs::read_to_string(&file).unwrap().starts_with("time_s,"));
}
