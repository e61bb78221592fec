//! The file that keeps a calibration: what the chain runs on, how it was obtained, and a CRC.
//!
//! ```json
//! {"format": "plumb-calibration", "version": 1, "channels": [{...}], "crc32": "cbf43926"}
//! ```
//!
//! In and out: [`Channel`]s. The chain's own integers are what counts; the same numbers stand
//! beside them in g for the reader, and a file in which the two disagree is refused. The CRC
//! (CRC-32/ISO-HDLC) is taken over `channels` written without spaces and with sorted keys, with
//! numbers as `serde_json` writes them. Saving writes a temporary file in the same
//! folder and renames it: there is the old file or the new one, never half of one.

use std::fmt;
use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use tilt::angle::{Axes, Harmonics};
use tilt::calibration::least_squares::times;
use tilt::chain::{Calibration, Correction};
use tilt::sample::Temperature;
use tilt::temperature::{Quadratic, TemperatureModel};
use tilt::uncertainty::{Budget, Span, TCO, Uncertainty};
use tilt::vector::Vector;

/// What `format` says.
pub const FORMAT: &str = "plumb-calibration";

/// The version that is written, and the only one that is read.
pub const VERSION: u64 = 1;

/// Larger files are no calibration.
const LARGEST_BYTES: u64 = 1 << 20;

/// Matrix entries are below this, g per g.
const MOST_GAIN: f64 = 2.0;

/// Offsets are at most this, g.
const MOST_OFFSET_G: f64 = 1.0;

/// Sine of how far two axes may be off a right angle: 20 deg.
const MOST_SHEAR: f64 = 0.342;

/// What the matrix may make of any acceleration: between half and twice its length, squared.
const SQUARED_STRETCH: [f64; 2] = [0.25, 4.0];

/// A matrix with a smaller determinant has lost an axis.
const LEAST_DETERMINANT: f64 = 0.1;

/// How a calibration was obtained.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Method {
    /// From standstill poses by gravity's length.
    Poses,
    /// From plateaus by the recording's reference.
    Reference,
    /// From runs of a reference motor.
    Motor,
}

/// The harmonics of one slope, in the chain's angle steps (2^32 are a circle).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct HarmonicSteps {
    /// Cosine amplitudes for k = 1, 2, 3.
    pub cosine_steps: [i32; 3],
    /// Sine amplitudes for k = 1, 2, 3.
    pub sine_steps: [i32; 3],
}

/// The quadratic temperature model, in the chain's units (`tilt::temperature::Quadratic`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TemperatureSteps {
    /// Offset per degC, 1/256 of 2^-26 g.
    pub offset1_q8: [i32; 3],
    /// Offset per degC^2, 1/65536 of 2^-26 g.
    pub offset2_q16: [i32; 3],
    /// Gain per degC, 2^-38.
    pub gain1_q38: [i32; 3],
    /// Gain per degC^2, 2^-46.
    pub gain2_q46: [i32; 3],
}

/// Where the uncertainty comes from, in the chain's units (`tilt::uncertainty::Budget`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BudgetSteps {
    /// White noise of single samples, 2^-26 g.
    pub noise_q26: u32,
    /// Turn-on repeatability and 1/f floor, 2^-26 g.
    pub repeatability_q26: u32,
    /// Thermal hysteresis 5 degC away from `fitted_at_q8`, 2^-26 g.
    pub hysteresis_q26: u32,
    /// The reference's own uncertainty, angle steps.
    pub reference_steps: u32,
    /// What the fit left, angle steps.
    pub residual_steps: u32,
    /// Temperature at which acceleration was related to angles, 1/256 degC; without it, 25 degC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted_at_q8: Option<i32>,
    /// Change per degC beyond `span_q8`, 2^-26 g; without it, that of the data sheet.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tco_q26: Option<u32>,
    /// Lowest and highest temperature at which the calibration holds, 1/256 degC; without it, 25
    /// degC, and -10 to 70 degC with a temperature compensation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub span_q8: Option<[i32; 2]>,
}

impl BudgetSteps {
    /// The chain's budget, of a calibration with this temperature compensation.
    fn budget(&self, temperature: &TemperatureModel) -> Budget {
        let implied = Span::implied_by(temperature);
        Budget {
            noise: self.noise_q26,
            repeatability: self.repeatability_q26,
            hysteresis: self.hysteresis_q26,
            reference: Uncertainty(self.reference_steps),
            residual: Uncertainty(self.residual_steps),
            fitted_at: self
                .fitted_at_q8
                .map_or(Temperature::REFERENCE, Temperature),
            tco: self.tco_q26.unwrap_or(TCO),
            span: self.span_q8.map_or(implied, |[low, high]| Span {
                low: Temperature(low),
                high: Temperature(high),
            }),
        }
    }
}

/// One channel's calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Channel {
    /// The recording it was obtained from: the file's name without its folder.
    pub source: String,
    /// How it was obtained.
    pub method: Method,
    /// Standstills or plateaus used.
    pub poses: u32,
    /// Root mean square of length minus 1 g over them, mg.
    pub norm_residual_mg: f64,
    /// Root mean square angle to the reference, deg, where there was one.
    pub angle_residual_deg: Option<f64>,
    /// Nominal samples per second of the recording.
    pub rate_hz: f64,
    /// The recording's numbers per g: a calibration holds for recordings of the same scale only.
    pub numbers_per_g: f64,
    /// Housing axis by sensor axis, 2^-30 per step.
    pub matrix_q30: [[i64; 3]; 3],
    /// Added after the matrix, 2^-26 g per step.
    pub offset_q26: [i64; 3],
    /// `matrix_q30` in g per g, for the reader.
    pub matrix: [[f64; 3]; 3],
    /// `offset_q26` in g, for the reader.
    pub offset_g: [f64; 3],
    /// Harmonics of slope X and slope Y.
    #[serde(default)]
    pub harmonics: [HarmonicSteps; 2],
    /// Temperature compensation, where there is one.
    #[serde(default)]
    pub temperature: Option<TemperatureSteps>,
    /// The uncertainty budget.
    #[serde(default)]
    pub budget: BudgetSteps,
}

/// Why a channel's values can't be those of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Impossible {
    /// A matrix entry of 2 g/g or more.
    Gain,
    /// An offset of over 1 g.
    Offset,
    /// A number that isn't finite, or negative where it can't be.
    Number,
    /// The matrix has lost an axis.
    Singular,
    /// The matrix makes a left hand of a right one.
    Mirrored,
    /// Two axes are over 20 deg off a right angle.
    Shear,
    /// Some acceleration comes out at less than half or more than twice its length.
    Stretch,
    /// The integers and the numbers for the reader disagree.
    Disagree,
}

impl fmt::Display for Impossible {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::Gain => "a matrix entry is 2 g/g or more",
            Self::Offset => "an offset is over 1 g",
            Self::Number => "a residual, rate or scale is negative or not finite",
            Self::Singular => "the matrix is singular",
            Self::Mirrored => "the matrix mirrors, which no sensor does",
            Self::Shear => "two axes are more than 20 deg off a right angle",
            Self::Stretch => "the matrix halves or doubles some acceleration",
            Self::Disagree => "`matrix_q30` or `offset_q26` disagrees with `matrix` or `offset_g`",
        })
    }
}

fn real_matrix(q30: &[[i64; 3]; 3]) -> [[f64; 3]; 3] {
    q30.map(|row| row.map(|v| v as f64 / f64::from(1 << 30)))
}

fn real_offset(q26: &[i64; 3]) -> [f64; 3] {
    q26.map(|v| v as f64 / f64::from(tilt::ONE_G))
}

/// To nine decimals: read back to the same bits, which the CRC needs, and kind to the eye.
fn rounded(value: f64) -> f64 {
    (value * 1e9).round() / 1e9
}

fn determinant(m: &[[f64; 3]; 3]) -> f64 {
    let [[a, b, c], [d, e, f], [g, h, i]] = *m;
    a * (e * i - f * h) + b * (f * g - d * i) + c * (d * h - e * g)
}

/// Checks that the matrix is near a rotation, as that of every sensor is.
fn check_shape(matrix: &[[f64; 3]; 3]) -> Result<(), Impossible> {
    let dot = |a: &[f64; 3], b: &[f64; 3]| a.iter().zip(b).map(|(p, q)| p * q).sum::<f64>();
    let [x, y, z] = matrix;
    let sheared = [(x, y), (y, z), (z, x)]
        .into_iter()
        .any(|(a, b)| dot(a, b).abs() > MOST_SHEAR * (dot(a, a) * dot(b, b)).sqrt());
    // The squared singular values are the eigenvalues of the rows' dot products.
    let gram = [x, y, z].map(|a| [x, y, z].map(|b| dot(a, b)));
    let [least, most] = SQUARED_STRETCH;
    let less = |limit: f64, sign: f64| {
        std::array::from_fn(|i| {
            std::array::from_fn(|j| sign * (gram[i][j] - if i == j { limit } else { 0.0 }))
        })
    };
    let determinant = determinant(matrix);
    if determinant.abs() < LEAST_DETERMINANT {
        Err(Impossible::Singular)
    } else if determinant < 0.0 {
        Err(Impossible::Mirrored)
    } else if sheared {
        Err(Impossible::Shear)
    } else if is_positive(&less(least, 1.0)) && is_positive(&less(most, -1.0)) {
        Ok(())
    } else {
        Err(Impossible::Stretch)
    }
}

/// Whether all eigenvalues of a symmetric matrix are above 0, by its leading minors.
fn is_positive(m: &[[f64; 3]; 3]) -> bool {
    m[0][0] > 0.0 && m[0][0] * m[1][1] - m[0][1] * m[1][0] > 0.0 && determinant(m) > 0.0
}

impl Channel {
    /// The corrected acceleration, g.
    pub fn apply(&self, accel_g: [f64; 3]) -> [f64; 3] {
        let offset = real_offset(&self.offset_q26);
        let turned = times(&real_matrix(&self.matrix_q30), accel_g);
        std::array::from_fn(|i| turned[i] + offset[i])
    }

    /// Takes the chain's vector; the rest of the fields as given in `about`.
    pub fn with_vector(mut about: Self, vector: &Vector) -> Self {
        about.matrix_q30 = vector.matrix.map(|row| row.map(i64::from));
        about.offset_q26 = vector.offset.map(i64::from);
        about.matrix = real_matrix(&about.matrix_q30).map(|row| row.map(rounded));
        about.offset_g = real_offset(&about.offset_q26).map(rounded);
        about
    }

    /// Checks that a sensor could have these values.
    pub fn check(&self) -> Result<(), Impossible> {
        let matrix = real_matrix(&self.matrix_q30);
        let offset = real_offset(&self.offset_q26);
        // Written so that what is not a number fails, too.
        let gain_fits = |v: &f64| v.abs() < MOST_GAIN;
        let offset_fits = |v: &f64| v.abs() <= MOST_OFFSET_G;
        let at_least_zero = |v: f64| v.is_finite() && v >= 0.0;
        let near = |(a, b): (&f64, &f64)| (a - b).abs() < 1e-6;
        if !matrix.iter().chain(&self.matrix).flatten().all(gain_fits) {
            Err(Impossible::Gain)
        } else if !offset.iter().chain(&self.offset_g).all(offset_fits) {
            Err(Impossible::Offset)
        } else if !(at_least_zero(self.norm_residual_mg)
            && self.angle_residual_deg.is_none_or(at_least_zero)
            && at_least_zero(self.rate_hz)
            && self.numbers_per_g.is_finite()
            && self.numbers_per_g > 0.0)
        {
            Err(Impossible::Number)
        } else if !matrix
            .iter()
            .flatten()
            .zip(self.matrix.iter().flatten())
            .all(near)
            || !offset.iter().zip(&self.offset_g).all(near)
        {
            Err(Impossible::Disagree)
        } else {
            check_shape(&matrix)
        }
    }

    /// The chain's correction; entries beyond its integers stop at their ends, which
    /// [`Self::check`] refuses anyway.
    pub fn vector(&self) -> Vector {
        let fit = |v: i64| v.clamp(i64::from(i32::MIN), i64::from(i32::MAX)) as i32;
        Vector {
            matrix: self.matrix_q30.map(|row| row.map(fit)),
            offset: self.offset_q26.map(fit),
        }
    }

    /// The chain's calibration, for two axes.
    pub fn calibration(&self) -> Calibration {
        let [x, y] = self.harmonics.map(|h| Harmonics {
            cosine: h.cosine_steps,
            sine: h.sine_steps,
        });
        let temperature = self.temperature.map_or(TemperatureModel::None, |t| {
            TemperatureModel::Quadratic(Quadratic {
                offset1_q8: t.offset1_q8,
                offset2_q16: t.offset2_q16,
                gain1_q38: t.gain1_q38,
                gain2_q46: t.gain2_q46,
            })
        });
        Calibration {
            temperature,
            correction: Correction::TwoAxis {
                vector: self.vector(),
                harmonics: Axes { x, y },
            },
            budget: self.budget.budget(&temperature),
        }
    }

    /// With every real number to nine decimals, as it will be written.
    fn for_writing(&self) -> Self {
        let mut channel = self.clone();
        channel.norm_residual_mg = rounded(self.norm_residual_mg);
        channel.angle_residual_deg = self.angle_residual_deg.map(rounded);
        channel.rate_hz = rounded(self.rate_hz);
        channel.numbers_per_g = rounded(self.numbers_per_g);
        channel
    }
}

/// A calibration file that can't be used or written.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationFileError {
    /// The file as the caller named it.
    pub file: String,
    /// What is wrong.
    pub problem: Problem,
}

/// What is wrong with a calibration file.
#[derive(Clone, Debug, PartialEq)]
pub enum Problem {
    /// Not found, a folder, no permission: what the system says.
    NotReadable(String),
    /// It could not be written: what the system says.
    NotWritable(String),
    /// Over 1 MiB.
    TooLarge,
    /// No JSON, or a field of the wrong kind.
    Malformed(String),
    /// `format` is something else.
    Format,
    /// A version that isn't read here.
    Version(String),
    /// `channels` was changed after it was written: the CRC it should have, and the one stated.
    Crc {
        /// Of the channels as they stand.
        computed: u32,
        /// As the file says.
        stated: String,
    },
    /// Another number of channels than recordings.
    ChannelCount {
        /// In the file.
        found: usize,
        /// Recordings given.
        expected: usize,
    },
    /// A channel, counted from 1, with values that no sensor has.
    Channel(usize, Impossible),
}

impl std::error::Error for CalibrationFileError {}

impl fmt::Display for CalibrationFileError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: {}", self.file, self.problem)
    }
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        const ANEW: &str = "make it again with --save-calibration";
        match self {
            Self::NotReadable(why) => write!(f, "can't be read ({why}); check the path"),
            Self::NotWritable(why) => write!(f, "can't be written ({why}); give another path"),
            Self::TooLarge => write!(f, "too large for a calibration file; {ANEW}"),
            Self::Malformed(why) => write!(f, "is no calibration file ({why}); {ANEW}"),
            Self::Format => write!(f, "`format` is not \"{FORMAT}\"; {ANEW}"),
            Self::Version(found) => {
                write!(
                    f,
                    "version {found} can't be read here, only version {VERSION}; {ANEW}"
                )
            }
            Self::Crc { computed, stated } => write!(
                f,
                "the CRC-32 of its channels is {computed:08x} and not {stated}: it was changed or \
                 damaged; {ANEW}"
            ),
            Self::ChannelCount { found, expected } => write!(
                f,
                "holds {found} channels for {expected} recordings; give as many recordings, in \
                 the same order"
            ),
            Self::Channel(number, why) => write!(f, "channel {number}: {why}; {ANEW}"),
        }
    }
}

/// CRC-32/ISO-HDLC of the channels as they stand in the file, in their one compact form.
fn checksum(channels: &Value) -> u32 {
    let mut crc = flate2::Crc::new();
    // A `Value` keeps its keys sorted and prints without spaces.
    crc.update(channels.to_string().as_bytes());
    crc.sum()
}

/// The text of a calibration file.
pub fn to_text(channels: &[Channel]) -> Result<String, Problem> {
    for (channel, number) in channels.iter().zip(1..) {
        channel
            .check()
            .map_err(|why| Problem::Channel(number, why))?;
    }
    let written: Vec<Channel> = channels.iter().map(Channel::for_writing).collect();
    let channels = serde_json::to_value(written).map_err(malformed)?;
    let crc32 = format!("{:08x}", checksum(&channels));
    let file = json!({"format": FORMAT, "version": VERSION, "channels": channels, "crc32": crc32});
    let text = serde_json::to_string_pretty(&file).map_err(malformed)?;
    Ok(text + "\n")
}

/// The channels in the text of a calibration file that must hold `expected` of them.
pub fn from_text(text: &[u8], expected: usize) -> Result<Vec<Channel>, Problem> {
    let file: Value = serde_json::from_slice(text).map_err(malformed)?;
    if file.get("format").and_then(Value::as_str) != Some(FORMAT) {
        return Err(Problem::Format);
    }
    match file.get("version") {
        Some(version) if version.as_u64() == Some(VERSION) => {}
        Some(other) => return Err(Problem::Version(shortened(other))),
        None => return Err(Problem::Malformed("no `version`".to_owned())),
    }
    let value = file
        .get("channels")
        .ok_or(Problem::Malformed("no `channels`".to_owned()))?;
    let computed = checksum(value);
    let stated = file.get("crc32").unwrap_or(&Value::Null);
    let agrees = |text: &str| u32::from_str_radix(text, 16) == Ok(computed);
    if !stated.as_str().is_some_and(agrees) {
        return Err(Problem::Crc {
            computed,
            stated: shortened(stated),
        });
    }
    let channels = Vec::<Channel>::deserialize(value).map_err(malformed)?;
    if channels.len() != expected {
        return Err(Problem::ChannelCount {
            found: channels.len(),
            expected,
        });
    }
    for (channel, number) in channels.iter().zip(1..) {
        channel
            .check()
            .map_err(|why| Problem::Channel(number, why))?;
    }
    Ok(channels)
}

/// What the JSON reader says, without what would upset a terminal: it may quote the file.
fn malformed(error: serde_json::Error) -> Problem {
    let text = error.to_string();
    let printable = text.chars().filter(|c| !c.is_control());
    Problem::Malformed(printable.take(200).collect())
}

fn shortened(value: &Value) -> String {
    let text = value.to_string();
    if text.len() <= 40 {
        text
    } else {
        text.chars().take(40).chain("...".chars()).collect()
    }
}

/// Reads a calibration file that must hold `expected` channels.
pub fn load(path: &Path, expected: usize) -> Result<Vec<Channel>, CalibrationFileError> {
    let fail = |problem| CalibrationFileError {
        file: path.display().to_string(),
        problem,
    };
    let unreadable = |error: io::Error| fail(Problem::NotReadable(plain(&error)));
    let about = fs::metadata(path).map_err(unreadable)?;
    if about.is_dir() {
        return Err(fail(Problem::NotReadable("it is a folder".to_owned())));
    }
    // Devices and pipes have no length and may have no end.
    let mut text = Vec::new();
    fs::File::open(path)
        .and_then(|file| file.take(LARGEST_BYTES + 1).read_to_end(&mut text))
        .map_err(unreadable)?;
    if text.len() as u64 > LARGEST_BYTES {
        return Err(fail(Problem::TooLarge));
    }
    from_text(&text, expected).map_err(fail)
}

/// A complete calibration file under a name of its own in the folder where it shall be; removed
/// again unless it is put in its place.
#[derive(Debug)]
pub struct Staged {
    path: PathBuf,
    temporary: PathBuf,
    placed: bool,
}

/// Refuses a place that holds anything but a regular file: a rename would replace a device.
///
/// Out: where the file itself is, which is elsewhere for a link. A link that leads nowhere is
/// refused as well.
pub fn check_place(path: &Path) -> Result<PathBuf, CalibrationFileError> {
    let fail = |why: String| CalibrationFileError {
        file: path.display().to_string(),
        problem: Problem::NotWritable(why),
    };
    if fs::symlink_metadata(path).is_err() {
        return Ok(path.to_owned());
    }
    let about = fs::metadata(path).map_err(|_| fail("the link leads nowhere".to_owned()))?;
    if about.is_dir() {
        return Err(fail("it is a folder".to_owned()));
    }
    if !about.is_file() {
        return Err(fail("it is no regular file".to_owned()));
    }
    path.canonicalize().map_err(|error| fail(plain(&error)))
}

/// Writes a calibration file beside its place.
pub fn stage(path: &Path, channels: &[Channel]) -> Result<Staged, CalibrationFileError> {
    let fail = |problem| CalibrationFileError {
        file: path.display().to_string(),
        problem,
    };
    let refuse = |error: io::Error| fail(Problem::NotWritable(plain(&error)));
    let text = to_text(channels).map_err(fail)?;
    let path = check_place(path)?;
    let name = path
        .file_name()
        .ok_or_else(|| refuse(io::Error::from(io::ErrorKind::InvalidFilename)))?;
    let temporary = path.with_file_name(format!(
        ".{}.{}.tmp",
        name.to_string_lossy(),
        std::process::id()
    ));
    // Made before the first byte, so that a half-written file is removed as well.
    let staged = Staged {
        path,
        temporary,
        placed: false,
    };
    fs::File::create(&staged.temporary)
        .and_then(|mut file| {
            file.write_all(text.as_bytes())
                .and_then(|()| file.sync_all())
        })
        .map_err(refuse)?;
    Ok(staged)
}

impl Staged {
    /// Puts the file in its place, where it replaces an older one.
    pub fn put_in_place(mut self) -> Result<(), CalibrationFileError> {
        fs::rename(&self.temporary, &self.path).map_err(|error| CalibrationFileError {
            file: self.path.display().to_string(),
            problem: Problem::NotWritable(plain(&error)),
        })?;
        self.placed = true;
        Ok(())
    }
}

impl Drop for Staged {
    fn drop(&mut self) {
        if !self.placed {
            // Whatever went wrong first is what the caller should hear of.
            let _ = fs::remove_file(&self.temporary);
        }
    }
}

fn plain(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "there is no such file or folder".to_owned(),
        _ => error.to_string(),
    }
}

/// The name of a recording without its folder.
pub fn base_name(file: &str) -> String {
    file.rsplit(['/', '\\']).next().unwrap_or(file).to_owned()
}

#[cfg(test)]
#[path = "calibration_file_tests.rs"]
pub mod tests;
