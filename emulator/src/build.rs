//! Images made from the sources of this checkout, by cargo.
//!
//! In: a package, a binary, and what is set around it. Out: the linked ELF file, as the product's
//! images are built (profile `footprint`).
//!
//! Left out: doing it when nothing has changed. Cargo sees to that, but a program that is linked
//! for slot A has to be linked anew after one for slot B, so the test command builds the images of
//! product and paper once and has every test read those (`READY`).

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fmt, io};

use flash::layout::{BASE, Slot};
use sim::memory::development_key;

use crate::image::{Image, ImageError};

/// The part's target.
const CHIP: &str = "thumbv7m-none-eabi";
/// The profile that images are built with.
const PROFILE: &str = "footprint";

/// The variable that the test command (`built` of `xtask`) sets once everything is built.
const READY: &str = "PLUMB_BUILT";

/// Why there is no image.
#[derive(Debug)]
pub enum BuildError {
    /// Cargo could not be started.
    Cargo(io::Error),
    /// Cargo has said why.
    Failed(String),
    /// What it made cannot be read.
    Read(PathBuf, io::Error),
    /// A file is no image.
    Image(PathBuf, ImageError),
}

/// What helps where files are missing or damaged.
const AGAIN: &str = "`cargo xtask image` builds the images anew";

impl fmt::Display for BuildError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cargo(error) => write!(f, "cargo does not start: {error}"),
            Self::Failed(said) => write!(f, "the image does not build:\n{said}"),
            Self::Read(path, error) => {
                write!(f, "cannot use {}: {error}; {AGAIN}", path.display())
            }
            Self::Image(path, error) => write!(f, "{}: {error}; {AGAIN}", path.display()),
        }
    }
}

impl std::error::Error for BuildError {}

/// What to build.
#[derive(Clone, Copy, Debug)]
pub struct Recipe<'a> {
    /// The package.
    pub package: &'a str,
    /// Its binary.
    pub binary: &'a str,
}

/// The second image, which is not the product's.
pub const FIXTURE: Recipe<'_> = Recipe {
    package: "emulator-fixture",
    binary: "emulator-fixture",
};

/// The signal chain on samples made of integers.
pub const GOLDEN: Recipe<'_> = Recipe {
    package: "emulator-golden",
    binary: "emulator-golden",
};

/// The same chain by integers and in floating point, each counted.
pub const FLOAT: Recipe<'_> = Recipe {
    package: "emulator-golden",
    binary: "emulator-golden-float",
};

/// The product or its variant with a gyroscope: what leaves the factory, and the programs in it
/// with their symbols.
#[derive(Clone, Debug)]
pub struct Product {
    /// Bootloader and confirmed application, from the start of the flash.
    pub factory: Vec<u8>,
    /// The bootloader.
    pub boot: Image,
    /// The application for slot A, with its symbols.
    pub app: Image,
    /// The files of an update for slots A and B.
    ///
    /// Read at once: another process may build into the same folder later, and takes them away
    /// before it does.
    updates: [Vec<u8>; 2],
}

impl Product {
    /// Builds it with `cargo xtask image`, or finds it built, in a folder of its own: what somebody
    /// is about to flash is not to be replaced by it. Where the test command has built it, it is
    /// only read.
    ///
    /// It accepts updates that are signed with the key of the simulated nodes, unless `PLUMB_KEY`
    /// names another.
    ///
    /// Errors: see [`BuildError`].
    pub fn build() -> Result<Self, BuildError> {
        built(Self::read)
    }

    /// What `cargo xtask image` has left in `folder`.
    ///
    /// Errors: [`BuildError::Read`], [`BuildError::Image`].
    pub fn read(folder: &Path) -> Result<Self, BuildError> {
        Self::read_named(folder, "plumb", "app")
    }

    /// The variant with a gyroscope, as [`Product::build`].
    ///
    /// Errors: see [`BuildError`].
    pub fn dynamic() -> Result<Self, BuildError> {
        built(Self::read_dynamic)
    }

    /// The variant with a gyroscope, as [`Product::read`].
    ///
    /// Errors: [`BuildError::Read`], [`BuildError::Image`].
    pub fn read_dynamic(folder: &Path) -> Result<Self, BuildError> {
        Self::read_named(folder, "plumb-dynamic", "app-dynamic")
    }

    fn read_named(folder: &Path, name: &str, app: &str) -> Result<Self, BuildError> {
        const VERSION: &str = env!("CARGO_PKG_VERSION");
        let file = |end: &str| read(&folder.join(format!("{name}-{VERSION}{end}")));
        Ok(Self {
            factory: file(".bin")?,
            boot: program(folder, "boot.elf")?,
            app: program(folder, &format!("{app}-a.elf"))?,
            updates: [file("-slot-a.img")?, file("-slot-b.img")?],
        })
    }

    /// The file of an update for `slot`: header and body.
    pub fn update(&self, slot: Slot) -> &[u8] {
        let [a, b] = &self.updates;
        match slot {
            Slot::A => a,
            Slot::B => b,
        }
    }

    /// What goes into an erased flash.
    pub fn pieces(&self) -> Vec<(u32, Vec<u8>)> {
        vec![(BASE, self.factory.clone())]
    }
}

/// The paper's instrument: what leaves the factory, and the programs in it with their symbols.
#[derive(Clone, Debug)]
pub struct Paper {
    /// Bootloader and application, from the start of the flash.
    pub factory: Vec<u8>,
    /// The bootloader.
    pub boot: Image,
    /// The application, with its symbols.
    pub app: Image,
}

impl Paper {
    /// Builds it with `cargo xtask image`, or finds it built, as [`Product::build`] does.
    ///
    /// Errors: see [`BuildError`].
    pub fn build() -> Result<Self, BuildError> {
        built(Self::read)
    }

    /// What `cargo xtask image` has left in `folder`.
    ///
    /// Errors: [`BuildError::Read`], [`BuildError::Image`].
    pub fn read(folder: &Path) -> Result<Self, BuildError> {
        const FACTORY: &str = concat!("plumb-paper-", env!("CARGO_PKG_VERSION"), ".bin");
        Ok(Self {
            factory: read(&folder.join(FACTORY))?,
            boot: program(folder, "boot-paper.elf")?,
            app: program(folder, "app-paper.elf")?,
        })
    }

    /// What goes into an erased flash.
    pub fn pieces(&self) -> Vec<(u32, Vec<u8>)> {
        vec![(BASE, self.factory.clone())]
    }
}

/// Lets `cargo xtask image` build unless that is done, and reads what it has left.
fn built<T>(found: impl FnOnce(&Path) -> Result<T, BuildError>) -> Result<T, BuildError> {
    let target = target_folder();
    // Tests and servers that build at the same time would read each other's half of it. The lock
    // ends with its file.
    let lock = target.join("images.lock");
    let lock = fs::create_dir_all(&target)
        .and_then(|()| File::create(&lock))
        .and_then(|file| file.lock().map(|()| file))
        .map_err(|error| BuildError::Read(lock, error))?;
    if env::var_os(READY).is_none() {
        build_images(&target)?;
    }
    let built = found(&images_folder())?;
    drop(lock);
    Ok(built)
}

/// Calls `cargo xtask image`.
fn build_images(target: &Path) -> Result<(), BuildError> {
    let mut cargo = cargo();
    cargo
        .args(["run", "--quiet", "--locked", "--package", "xtask"])
        .args(["--", "image"])
        .env("CARGO_TARGET_DIR", target)
        .env("PLUMB_IMAGES", images_folder());
    if env::var_os("PLUMB_KEY").is_none() {
        let digits = development_key().map(|byte| format!("{byte:02x}"));
        cargo.env("PLUMB_KEY", digits.concat());
    }
    let output = cargo.output().map_err(BuildError::Cargo)?;
    if output.status.success() {
        return Ok(());
    }
    let said = [output.stdout, output.stderr].concat();
    let said = String::from_utf8_lossy(&said).into_owned();
    Err(BuildError::Failed(said))
}

/// Where images for emulation are.
fn images_folder() -> PathBuf {
    target_folder().join("emulated").join("images")
}

fn program(folder: &Path, name: &str) -> Result<Image, BuildError> {
    let path = folder.join(name);
    let bytes = read(&path)?;
    Image::read(&bytes).map_err(|error| BuildError::Image(path, error))
}

fn read(path: &Path) -> Result<Vec<u8>, BuildError> {
    fs::read(path).map_err(|error| BuildError::Read(path.to_path_buf(), error))
}

/// Cargo, in the checkout.
fn cargo() -> Command {
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(".."));
    cargo
}

impl Recipe<'_> {
    /// Builds it, or finds it built.
    ///
    /// Errors: see [`BuildError`].
    pub fn image(&self) -> Result<Image, BuildError> {
        let path = self.build()?;
        let bytes = read(&path)?;
        Image::read(&bytes).map_err(|error| BuildError::Image(path, error))
    }

    fn build(&self) -> Result<PathBuf, BuildError> {
        // Where the firmware is built too: what both need of the compiler's helpers is built once.
        let folder = target_folder();
        let mut cargo = cargo();
        cargo
            .args([
                "build",
                "--quiet",
                "--locked",
                "--target",
                CHIP,
                "--profile",
                PROFILE,
            ])
            .args(["--package", self.package, "--bin", self.binary])
            .arg("--target-dir")
            .arg(&folder);
        let output = cargo.output().map_err(BuildError::Cargo)?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr).into_owned();
            return Err(BuildError::Failed(said));
        }
        Ok(folder.join(CHIP).join(PROFILE).join(self.binary))
    }
}

/// The folder that this program was built into: that of the profile, of its tests, or above.
fn target_folder() -> PathBuf {
    let here = env::current_exe().unwrap_or_default();
    let mut folders = here.ancestors().skip(1);
    let profile = folders.find(|folder| folder.join(".fingerprint").is_dir());
    let target = profile.and_then(Path::parent);
    target.map_or_else(|| PathBuf::from("target"), Path::to_path_buf)
}
