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

use std::fs;
use std::io::{self, Read};
use std::path::Path;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use tilt::angle::{Axes, Harmonics};
use tilt::calibration::least_squares::times;
use tilt::chain::{Calibration, Correction};
use tilt::sample::Temperature;
use tilt::temperature::{Quadratic, TemperatureModel};
use tilt::uncertainty::{Budget, Span, TCO, Uncertainty};
use tilt::vector::Vector;

use super::error::{FileError, Impossible, Problem};
use output::write::{self, Existing, Staged};

/// The value of `format`.
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
    /// None: the sensor is taken as its data sheet has it.
    Nominal,
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
            rates: None,
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
    let channels = channels(text)?;
    if channels.len() != expected {
        return Err(Problem::ChannelCount {
            found: channels.len(),
            expected,
        });
    }
    Ok(channels)
}

/// The channels in the text of a calibration file.
fn channels(text: &[u8]) -> Result<Vec<Channel>, Problem> {
    let file: Value = serde_json::from_slice(text).map_err(malformed)?;
    if file.get("format").and_then(Value::as_str) != Some(FORMAT) {
        return Err(Problem::Format(FORMAT));
    }
    match file.get("version") {
        Some(version) if version.as_u64() == Some(VERSION) => {}
        Some(other) => return Err(Problem::Version(shortened(other), VERSION)),
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
    for (channel, number) in channels.iter().zip(1..) {
        channel
            .check()
            .map_err(|why| Problem::Channel(number, why))?;
    }
    Ok(channels)
}

/// What the JSON reader reports, without what would upset a terminal: it may quote the file.
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
pub fn load(path: &Path, expected: usize) -> Result<Vec<Channel>, FileError> {
    open(path, |text| from_text(text, expected))
}

/// Reads a calibration file, however many channels it has: what the chain of each runs on.
///
/// Errors: it can't be read, or is no calibration file.
pub fn load_calibrations(path: &Path) -> Result<Vec<Calibration>, FileError> {
    let channels = open(path, channels)?;
    Ok(channels.iter().map(Channel::calibration).collect())
}

fn open(
    path: &Path,
    read: impl FnOnce(&[u8]) -> Result<Vec<Channel>, Problem>,
) -> Result<Vec<Channel>, FileError> {
    let of_file = |problem| FileError::of_file(path.display().to_string(), problem);
    read(&bytes(path).map_err(of_file)?).map_err(of_file)
}

fn bytes(path: &Path) -> Result<Vec<u8>, Problem> {
    let unreadable = |error: io::Error| Problem::not_readable(&error);
    if fs::metadata(path).map_err(unreadable)?.is_dir() {
        return Err(unreadable(io::ErrorKind::IsADirectory.into()));
    }
    // Devices and pipes have no length and may have no end.
    let mut text = Vec::new();
    fs::File::open(path)
        .and_then(|file| file.take(LARGEST_BYTES + 1).read_to_end(&mut text))
        .map_err(unreadable)?;
    if text.len() as u64 > LARGEST_BYTES {
        return Err(Problem::TooLarge);
    }
    Ok(text)
}

/// Refuses a place where no calibration can be saved, see [`NoPlace`](output::write::NoPlace).
pub fn check_place(path: &Path, existing: Existing) -> Result<(), FileError> {
    let place = write::check_place(path, existing).map(drop);
    place.map_err(|why| not_written(path)(Problem::not_writable(&why.into())))
}

/// Writes a calibration file beside its place.
pub fn stage(path: &Path, channels: &[Channel], existing: Existing) -> Result<Staged, FileError> {
    let text = to_text(channels).map_err(not_written(path))?;
    let file = Staged::write(path, &text, existing);
    file.map_err(|error| not_written(path)(Problem::not_writable(&error)))
}

/// Puts a calibration file in its place, where it replaces an older one.
pub fn put_in_place(path: &Path, file: Staged) -> Result<(), FileError> {
    let placed = file.put_in_place();
    placed.map_err(|error| not_written(path)(Problem::not_writable(&error)))
}

fn not_written(path: &Path) -> impl Fn(Problem) -> FileError {
    |problem| FileError::of_file(path.display().to_string(), problem)
}

/// The name of a recording without its folder.
pub fn base_name(file: &str) -> String {
    file.rsplit(['/', '\\']).next().unwrap_or(file).to_owned()
}

#[cfg(test)]
#[path = "calibration_file_tests.rs"]
pub mod tests;
