//! Made-up recordings with a known attitude, folders for them, and the binary to feed.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A folder of its own, empty at the start.
pub struct Folder(pub PathBuf);

impl Folder {
    /// An empty folder for one test.
    pub fn new(name: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("replay-{name}"));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    /// Writes a file; its path.
    pub fn file(&self, name: &str, contents: impl AsRef<[u8]>) -> String {
        fs::write(self.0.join(name), contents).unwrap();
        self.path(name)
    }

    /// The path of a name in it.
    pub fn path(&self, name: &str) -> String {
        self.0.join(name).to_str().unwrap().to_owned()
    }

    /// The names in it, sorted.
    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.0).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

/// Runs `plumb replay` with `--out` in the folder.
pub fn replay(folder: &Folder, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_plumb"))
        .arg("replay")
        .args(arguments)
        .args(["--out", &folder.path("out")])
        .output()
        .unwrap()
}

/// A run that must go well: what it printed.
pub fn replay_well(folder: &Folder, arguments: &[&str]) -> String {
    let output = replay(folder, arguments);
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert_eq!(stderr, "");
    String::from_utf8(output.stdout).unwrap()
}

/// A run that must go well, with `--json`: the report.
pub fn report(folder: &Folder, arguments: &[&str]) -> serde_json::Value {
    let text = replay_well(folder, &[arguments, &["--json"]].concat());
    serde_json::from_str(&text).unwrap()
}

/// Samples per second of the made-up recordings.
pub const RATE_HZ: u64 = 100;

/// Seconds in each pose, and on the way to the next.
pub const POSE_S: u64 = 4;
/// Seconds on the way from one pose to the next.
pub const WAY_S: u64 = 1;

/// Up vectors of the poses, not yet one long: six faces, edges and corners, level twice.
pub const POSES: [[f64; 3]; 14] = [
    [0.0, 0.0, 1.0],
    [1.0, 0.0, 1.0],
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 1.0, 1.0],
    [-1.0, 0.0, 1.0],
    [-1.0, 0.0, 0.0],
    [-1.0, -1.0, -1.0],
    [0.0, 0.0, -1.0],
    [0.0, -1.0, 0.0],
    [1.0, -1.0, 1.0],
    [0.3, 0.2, 1.0],
    [1.0, 1.0, 1.0],
    [0.0, 0.0, 1.0],
];

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|c| c * c).sum::<f64>().sqrt();
    v.map(|c| c / length)
}

/// The up vector `i` samples after the start.
pub fn up(i: u64) -> [f64; 3] {
    up_at(i, RATE_HZ)
}

/// The up vector `i` samples after the start, at another rate.
pub fn up_at(i: u64, rate_hz: u64) -> [f64; 3] {
    let cycle = (POSE_S + WAY_S) * rate_hz;
    let pose = |n: u64| unit(POSES[(n as usize).min(POSES.len() - 1)]);
    let (now, next, into) = (pose(i / cycle), pose(i / cycle + 1), i % cycle);
    let way = into.saturating_sub(POSE_S * rate_hz) as f64 / (WAY_S * rate_hz) as f64;
    // An arc from one to the other; opposite poses do not follow each other.
    unit(std::array::from_fn(|k| now[k] + way * (next[k] - now[k])))
}

/// Slope X and slope Y of an up vector, deg.
pub fn slopes_deg(up: [f64; 3]) -> [f64; 2] {
    let [x, y, z] = up;
    [x.atan2(y.hypot(z)), y.atan2(x.hypot(z))].map(f64::to_degrees)
}

/// Samples of a whole recording.
pub const SAMPLES: u64 = POSES.len() as u64 * (POSE_S + WAY_S) * RATE_HZ;

/// A sensor: what it makes of the up vector.
#[derive(Clone, Copy)]
pub struct Sensor {
    /// Sensor axis by housing axis, g per g.
    pub matrix: [[f64; 3]; 3],
    /// Zero-g offset.
    pub offset_g: [f64; 3],
    /// Standard deviation of single samples.
    pub noise_g: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// A sensor on the housing's axes, with skew, scale errors and offsets.
pub const SQUARE: Sensor = Sensor {
    matrix: [
        [1.02, 0.005, -0.003],
        [0.005, 0.985, 0.004],
        [-0.003, 0.004, 1.01],
    ],
    offset_g: [0.02, -0.015, 0.03],
    noise_g: 0.001,
    seed: 1,
};

/// A sensor turned by a quarter about z on the board, with other errors.
pub const TURNED: Sensor = Sensor {
    matrix: [
        [0.01, 0.99, 0.0],
        [-1.015, 0.005, 0.002],
        [0.0, -0.004, 0.98],
    ],
    offset_g: [-0.01, 0.02, -0.025],
    noise_g: 0.001,
    seed: 2,
};

impl Sensor {
    /// What it reads, without noise.
    fn reads(&self, up: [f64; 3]) -> [f64; 3] {
        let row = |k: usize| (0..3).map(|j| self.matrix[k][j] * up[j]).sum::<f64>();
        std::array::from_fn(|k| row(k) + self.offset_g[k])
    }

    /// A recording in g; `motion` gives the up vector of each sample.
    pub fn record(&self, motion: impl Fn(u64) -> [f64; 3]) -> String {
        self.record_at(RATE_HZ, motion)
    }

    /// A recording of the same length at another rate.
    pub fn record_at(&self, rate_hz: u64, motion: impl Fn(u64) -> [f64; 3]) -> String {
        let mut text = "time_s,ax_g,ay_g,az_g\n".to_owned();
        let mut state = self.seed;
        for i in 0..SAMPLES * rate_hz / RATE_HZ {
            let read = self
                .reads(motion(i))
                .map(|a| a + self.noise_g * normal(&mut state));
            let [x, y, z] = read;
            let time = i as f64 / rate_hz as f64;
            writeln!(text, "{time:.3},{x:.6},{y:.6},{z:.6}").unwrap();
        }
        text
    }
}

/// About normal: the sum of twelve even numbers of one generator.
fn normal(state: &mut u64) -> f64 {
    let mut even = || {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*state >> 33) as f64 / f64::from(1u32 << 31)
    };
    (0..12).map(|_| even()).sum::<f64>() - 6.0
}

/// Replaces whole lines (from 1) of a text.
pub fn with_lines(text: &str, change: impl Fn(usize, &str) -> Option<String>) -> String {
    let mut changed = String::new();
    for (line, number) in text.lines().zip(1..) {
        let new = change(number, line).unwrap_or_else(|| line.to_owned());
        changed.push_str(&new);
        changed.push('\n');
    }
    changed
}
