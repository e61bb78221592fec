//! `cargo xtask image`: what is flashed, and what an update sends.
//!
//! In: the package `firmware`, and whose updates it is to believe (`PLUMB_KEY` and
//! `PLUMB_UNSIGNED`, see its build script). Out, in `target/images` or where `PLUMB_IMAGES` points:
//!
//! | file | is |
//! |---|---|
//! | `plumb-VERSION.bin`, `.hex` | bootloader and confirmed application, for a probe |
//! | `plumb-VERSION-slot-a.img`, `-slot-b.img` | an application with its header, for an update |
//! | `boot.elf`, `app-a.elf`, `app-b.elf` | what was linked, for a debugger and for the emulator |
//! | `plumb-dynamic-VERSION.bin` and so on, `app-dynamic-a.elf` | the variant with a gyroscope |
//! | `plumb-paper-VERSION.bin`, `.hex` | the same of the paper's instrument, for its own part |
//! | `boot-paper.elf`, `app-paper.elf` | what was linked of it |
//!
//! The product's are for an STM32F103RC, the paper's for an STM32F103C8. An image runs in one slot
//! only, since its addresses are fixed, so there is one for each; the paper's part has one. What is
//! larger than its budget is an error, but its files are there to be looked at.
//!
//! Left out: signatures.

#[cfg(unix)]
mod elsewhere;
mod hex;
mod keys;
mod linked;
mod set;
mod traces;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

use flash::check_sum::Crc32;
use flash::image::{FIELDS, Header, Signature, Version};
use flash::layout::{BASE, HEADER, Layout, Program, Slot};
use flash::seal;
use flash::slots::{MARKS, factory_marks};

use crate::chip::{self, letter};
use crate::command::CommandError;
use crate::workspace::Workspace;
use linked::Linked;
use set::Set;
pub use set::sets;

/// How the names of our files end.
const OURS: [&str; 10] = [
    "boot.elf",
    "app-a.elf",
    "app-b.elf",
    "app-dynamic-a.elf",
    "app-dynamic-b.elf",
    "boot-paper.elf",
    "app-paper.elf",
    ".img",
    ".bin",
    ".hex",
];

/// A file of ours, by its name.
fn is_ours(name: &str) -> bool {
    OURS.iter().any(|ours| name.ends_with(ours))
}

/// Why there are no images.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// A variable of the environment does not state whose updates are believed.
    #[error("{0}")]
    Keys(String),
    /// A command failed.
    #[error("{0}")]
    Command(#[from] CommandError),
    /// A file could not be read or written.
    #[error("{path}: {1}", path = .0.display())]
    File(PathBuf, io::Error),
    /// The linked file is not what it should be.
    #[error("{path}: {1}", path = .0.display())]
    Elf(PathBuf, object::Error),
    /// A program is linked to another place than its own.
    #[error("{0} is not linked to its place")]
    Place(String),
    /// The package's version is not of the form that an image's header has room for.
    #[error("version {0} does not fit in a header")]
    Version(String),
    /// Budgets are exceeded, or there is what must not be.
    #[error("{}", .0.join("; "))]
    Over(Vec<String>),
    /// These depend on the folder of the checkout.
    #[error("another folder gives other bytes for {}", .0.join(", "))]
    #[cfg(unix)]
    Differ(Vec<String>),
}

/// Where images and files about them go.
struct Outlet {
    folder: PathBuf,
    version: String,
}

impl Outlet {
    /// The folder, without the files of the last build: they would pass for this one's if it
    /// fails.
    fn clear(folder: PathBuf, version: String) -> Result<Self, ImageError> {
        let outlet = Self { folder, version };
        let failed = |error| ImageError::File(outlet.folder.clone(), error);
        fs::create_dir_all(&outlet.folder).map_err(failed)?;
        for entry in fs::read_dir(&outlet.folder).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if is_ours(&name) {
                fs::remove_file(&path).map_err(|error| ImageError::File(path, error))?;
            }
        }
        Ok(outlet)
    }

    fn write(&self, name: &str, bytes: &[u8]) -> Result<(), ImageError> {
        let path = self.folder.join(name);
        fs::write(&path, bytes).map_err(|error| ImageError::File(path, error))
    }
}

/// Builds everything into where it belongs, prints sizes, and fails above a budget.
pub fn build(workspace: &Workspace) -> Result<(), ImageError> {
    build_into(workspace, folder(workspace))
}

/// The same, and the same bytes from another folder, where a home of cargo can be made of links.
pub fn build_reproducibly(workspace: &Workspace) -> Result<(), ImageError> {
    build(workspace)?;
    #[cfg(unix)]
    elsewhere::compare(workspace, &folder(workspace))?;
    Ok(())
}

/// Where images belong.
fn folder(workspace: &Workspace) -> PathBuf {
    let folder = env::var_os("PLUMB_IMAGES");
    folder.map_or_else(|| workspace.target().join("images"), PathBuf::from)
}

/// The same into `folder`.
pub fn build_into(workspace: &Workspace, folder: PathBuf) -> Result<(), ImageError> {
    let version = env!("CARGO_PKG_VERSION").to_string();
    let believed = keys::believed(|name| env::var(name).ok()).map_err(ImageError::Keys)?;
    let _alone = chip::alone(workspace)?;
    let outlet = Outlet::clear(folder, version)?;
    let mut over = Vec::new();
    for (slot, sets) in by_slot() {
        let programs: BTreeSet<_> = sets.iter().flat_map(|set| set.programs()).collect();
        chip::firmware(workspace, &Vec::from_iter(programs), slot)?;
        for set in sets {
            let [boot, app] = keep(workspace, &outlet, set, slot)?;
            over.extend(judge(set, slot, &boot, &app));
            offer(&outlet, set, slot, &boot, &app)?;
        }
    }
    println!("      {believed}");
    println!("      {}", outlet.folder.display());
    if over.is_empty() {
        Ok(())
    } else {
        Err(ImageError::Over(over))
    }
}

/// The sets of each slot, which are linked at once: for another slot than before, cargo compiles
/// the firmware anew, and of several programs it links as many at a time as there are processors.
fn by_slot() -> [(Slot, Vec<&'static Set>); 2] {
    [Slot::A, Slot::B].map(|slot| {
        let has_slot = |set: &&Set| set.slots().any(|of_set| of_set == slot);
        (slot, sets().iter().filter(has_slot).collect())
    })
}

/// Keeps both linked programs of a set, the application for `slot`.
fn keep(
    workspace: &Workspace,
    outlet: &Outlet,
    set: &Set,
    slot: Slot,
) -> Result<[Linked; 2], ImageError> {
    let kept = [
        (set.boot, format!("{}.elf", set.boot), Program::Boot),
        (
            set.app,
            format!("{}.elf", set.name_of_app(slot)),
            Program::Application(slot),
        ),
    ];
    let folder = chip::folder(workspace);
    let places = places(workspace)?;
    let [boot, app] = kept.map(|(binary, name, program)| {
        let path = folder.join(binary);
        let bytes = read(&path)?;
        outlet.write(&name, &bytes)?;
        let linked = Linked::read(&bytes, &places);
        let linked = linked.map_err(|error| ImageError::Elf(path, error))?;
        let room = set.layout.room(program);
        if room.is_some_and(|room| room.address() == linked.start) {
            Ok(linked)
        } else {
            Err(ImageError::Place(name))
        }
    });
    Ok([boot?, app?])
}

/// Folders of this machine, which no program may name.
fn places(workspace: &Workspace) -> Result<Vec<String>, ImageError> {
    let homes = ["HOME", "USERPROFILE", "CARGO_HOME", "RUSTUP_HOME"].map(env::var_os);
    let homes = homes.into_iter().flatten().map(PathBuf::from);
    let ours = [workspace.root().to_path_buf(), workspace.target()];
    let all = chip::registries(workspace)?.into_iter();
    let all = all.chain(ours).chain(homes);
    Ok(all
        .map(|path| path.to_string_lossy().into_owned())
        .collect())
}

fn read(path: &Path) -> Result<Vec<u8>, ImageError> {
    fs::read(path).map_err(|error| ImageError::File(path.to_path_buf(), error))
}

/// Prints the sizes; what is too much, or must not be there. The application's limit is its slot,
/// and the linker's.
fn judge(set: &Set, slot: Slot, boot: &Linked, app: &Linked) -> Vec<String> {
    let (name, ram, stack) = (set.name_of_app(slot), app.ram, app.stack);
    let strays = boot.strays.iter().chain(&app.strays);
    let strays = strays.map(|stray| format!("{name}: {stray} is in it"));
    let [boot, app] = [boot, app].map(|linked| linked.bytes.len());
    println!("      {name:9}  boot {boot:6}  application {app:6}  static RAM {ram:6}");
    println!("                 deepest stack along direct calls {stack:6}");
    let limits = [
        ("the bootloader", boot, set.layout.boot.length as usize),
        ("RAM", ram as usize + stack as usize, set.ram),
    ];
    let over = limits.iter().filter(|(_, is, budget)| is > budget);
    over.map(|(what, is, budget)| format!("{name}: {what} takes {is} of {budget} bytes"))
        .chain(strays)
        .collect()
}

/// Writes the files that people use.
fn offer(
    outlet: &Outlet,
    set: &Set,
    slot: Slot,
    boot: &Linked,
    app: &Linked,
) -> Result<(), ImageError> {
    let (name, version) = (set.name, &outlet.version);
    let header = header(version, set.layout, app)?;
    if set.layout.b.is_some() {
        let update = [header.as_slice(), &app.bytes].concat();
        let letter = letter(slot);
        outlet.write(&format!("{name}-{version}-slot-{letter}.img"), &update)?;
    }
    if slot == Slot::A {
        let whole = factory(set.layout, boot, &header, app);
        outlet.write(&format!("{name}-{version}.bin"), &whole)?;
        let text = hex::encode(BASE, &whole);
        outlet.write(&format!("{name}-{version}.hex"), text.as_bytes())?;
    }
    Ok(())
}

/// The header of an application, with blank marks.
fn header(version: &str, layout: &Layout, app: &Linked) -> Result<Vec<u8>, ImageError> {
    let header = Header {
        signature: Signature::None,
        hardware: layout.hardware,
        version: parse(version).ok_or_else(|| ImageError::Version(version.to_string()))?,
        address: app.start,
        length: app.bytes.len() as u32,
        crc: Crc32::of(&app.bytes),
    };
    let mut bytes = vec![u8::MAX; HEADER as usize];
    bytes[..FIELDS].copy_from_slice(&header.encode());
    Ok(bytes)
}

/// "1.2.3" as a header has it.
fn parse(version: &str) -> Option<Version> {
    let mut parts = version.split('.');
    let major = parts.next()?.parse().ok()?;
    let minor = parts.next()?.parse().ok()?;
    let patch = parts.next()?.parse().ok()?;
    parts
        .next()
        .is_none()
        .then_some(Version::new(major, minor, patch))
}

/// The flash of a part as it leaves the factory, up to the end of the application.
fn factory(layout: &Layout, boot: &Linked, header: &[u8], app: &Linked) -> Vec<u8> {
    let mut whole = boot.bytes.clone();
    whole.resize(layout.boot.end() as usize, u8::MAX);
    seal::close(&mut whole);
    whole.extend_from_slice(header);
    let marks = (layout.a.start + MARKS) as usize;
    let factory = factory_marks();
    whole[marks..marks + factory.len()].copy_from_slice(&factory);
    whole.extend_from_slice(&app.bytes);
    whole
}

#[cfg(test)]
mod tests {
    use flash::access::program;
    use flash::image::verify;
    use flash::layout::{C8, PAGE, RC};
    use flash::nor::{Draw, Nor, Page};
    use flash::slots::{Decision, Why, boot};

    use super::*;

    struct Zeros;

    impl Draw for Zeros {
        fn draw(&mut self) -> u32 {
            0
        }
    }

    fn linked(start: u32, length: usize) -> Linked {
        Linked {
            start,
            bytes: (0..length).map(|n| n as u8).collect(),
            ram: 0,
            strays: Vec::new(),
            stack: 0,
        }
    }

    #[test]
    fn the_bootloader_starts_what_leaves_the_factory() {
        let app = linked(RC.a.address() + HEADER, 4000);
        let header = header("1.2.3", &RC, &app).unwrap();
        let whole = factory(&RC, &linked(BASE, 3000), &header, &app);
        let pages = vec![Page::new(); (RC.flash / PAGE) as usize];
        let mut nor = Nor::new(pages, Zeros);
        program(&mut nor, 0, &whole).unwrap();
        let Decision::Run(slot, found, why) = boot(&mut nor, &RC, RC.hardware) else {
            panic!("nothing to start");
        };
        assert_eq!((slot, why), (Slot::A, Why::Confirmed));
        assert_eq!(found.version, Version::new(1, 2, 3));
    }

    #[test]
    fn the_paper_s_part_leaves_the_factory_with_an_image_that_is_whole() {
        let app = linked(C8.a.address() + HEADER, 4000);
        let header = header("1.2.3", &C8, &app).unwrap();
        let whole = factory(&C8, &linked(BASE, 1800), &header, &app);
        let pages = vec![Page::new(); (C8.flash / PAGE) as usize];
        let mut nor = Nor::new(pages, Zeros);
        program(&mut nor, 0, &whole).unwrap();
        let found = verify(&mut nor, C8.a, C8.hardware).map(|header| header.version);
        assert_eq!(found, Ok(Version::new(1, 2, 3)));
    }

    #[test]
    fn the_firmware_was_compiled_anew_for_a_slot_that_it_had_been_compiled_for() {
        let [(first, of_a), (second, of_b)] = by_slot();
        assert_eq!((first, of_a.len()), (Slot::A, sets().len()));
        let names: Vec<_> = of_b.iter().map(|set| set.app).collect();
        assert_eq!((second, names), (Slot::B, vec!["app", "app-dynamic"]));
    }

    #[test]
    fn a_version_has_three_numbers_that_fit() {
        assert_eq!(parse("0.1.0"), Some(Version::new(0, 1, 0)));
        assert_eq!(
            parse("255.255.65535").map(|version| version.0),
            Some(u32::MAX)
        );
        for wrong in [
            "",
            "1",
            "1.2",
            "1.2.3.4",
            "1.2.3-rc",
            "256.0.0",
            "1.2.65536",
        ] {
            assert_eq!(parse(wrong), None, "{wrong}");
        }
    }
}
