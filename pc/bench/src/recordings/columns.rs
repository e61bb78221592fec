//! What the header of a recording states: which column holds what, and in which unit.
//!
//! In: the cells of the header. Out: [`Columns`], the place and unit of each quantity, or the
//! [`Problem`] with the header. Columns may stand in any order; those that mean nothing here are
//! named and left alone. Upper and lower case, spaces around a name and quotes don't matter.

use super::error::Problem;
use strsim::levenshtein;

/// The unit of the time column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeUnit {
    /// `time_s`.
    Seconds,
    /// `time_ms`.
    Milliseconds,
    /// `time_us`.
    Microseconds,
}

impl TimeUnit {
    /// Microseconds in one unit.
    pub const fn micros(self) -> f64 {
        match self {
            Self::Seconds => 1e6,
            Self::Milliseconds => 1e3,
            Self::Microseconds => 1.0,
        }
    }
}

/// The unit of the acceleration columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AccelUnit {
    /// `_g`.
    G,
    /// `_mps2`: m/s^2.
    MetrePerSecond2,
    /// `_lsb`: counts.
    Lsb,
}

/// The unit of the columns of a gyroscope.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RateUnit {
    /// `_radps`: rad/s.
    RadianPerSecond,
    /// `_dps`: deg/s.
    DegreePerSecond,
}

impl RateUnit {
    /// What the columns are called behind the axis.
    pub const fn suffix(self) -> &'static str {
        match self {
            Self::RadianPerSecond => "_radps",
            Self::DegreePerSecond => "_dps",
        }
    }

    /// In words.
    pub const fn words(self) -> &'static str {
        match self {
            Self::RadianPerSecond => "rad/s",
            Self::DegreePerSecond => "deg/s",
        }
    }

    /// The other one.
    pub const fn other(self) -> Self {
        match self {
            Self::RadianPerSecond => Self::DegreePerSecond,
            Self::DegreePerSecond => Self::RadianPerSecond,
        }
    }

    /// One unit in rad/s.
    pub fn radians(self) -> f64 {
        match self {
            Self::RadianPerSecond => 1.0,
            Self::DegreePerSecond => 1f64.to_radians(),
        }
    }
}

/// Where the reference stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReferenceColumns {
    /// `ref_qw` to `ref_qz`.
    Quaternion([usize; 4]),
    /// `ref_x_deg`, `ref_y_deg`, either or both.
    Slopes([Option<usize>; 2]),
}

/// Which column holds what.
#[derive(Clone, Debug, PartialEq)]
pub struct Columns {
    /// Cells in a row.
    pub width: usize,
    /// The time.
    pub time: usize,
    /// Unit of the time.
    pub time_unit: TimeUnit,
    /// The three accelerations.
    pub accel: [usize; 3],
    /// Unit of the accelerations.
    pub unit: AccelUnit,
    /// The three rates of a gyroscope and their unit, if given.
    pub rate: Option<([usize; 3], RateUnit)>,
    /// Where 1 marks the rows that count against the reference, if given.
    pub moving: Option<usize>,
    /// The temperature, if given.
    pub temperature: Option<usize>,
    /// The reference, if given.
    pub reference: Option<ReferenceColumns>,
    /// Names of the columns that mean nothing here.
    pub ignored: Vec<String>,
}

/// The names of a time column and their units.
pub const TIMES: [(&str, TimeUnit); 3] = [
    ("time_s", TimeUnit::Seconds),
    ("time_ms", TimeUnit::Milliseconds),
    ("time_us", TimeUnit::Microseconds),
];
const AXES: [&str; 3] = ["ax", "ay", "az"];
const RATE_AXES: [&str; 3] = ["gx", "gy", "gz"];
const RATE_UNITS: [(&str, RateUnit); 2] = [
    (
        RateUnit::RadianPerSecond.suffix(),
        RateUnit::RadianPerSecond,
    ),
    (
        RateUnit::DegreePerSecond.suffix(),
        RateUnit::DegreePerSecond,
    ),
];
const MOVING: &str = "moving";
const UNITS: [(&str, AccelUnit); 3] = [
    ("_g", AccelUnit::G),
    ("_mps2", AccelUnit::MetrePerSecond2),
    ("_lsb", AccelUnit::Lsb),
];
const TEMPERATURE: &str = "temp_c";
const QUATERNION: [&str; 4] = ["ref_qw", "ref_qx", "ref_qy", "ref_qz"];
const SLOPES: [&str; 2] = ["ref_x_deg", "ref_y_deg"];

/// Longer names are cut: they are no name that is known here, nor a misspelling of one.
const LONGEST_NAME: usize = 64;

/// Takes quotes, spaces and upper case off a header cell.
///
/// What is left goes into messages: no control characters, and no more than 64 letters.
pub fn clean(cell: &str) -> String {
    let cell = cell.trim();
    let bare = cell
        .strip_prefix('"')
        .and_then(|c| c.strip_suffix('"'))
        .unwrap_or(cell);
    let printable = |c: char| {
        if c.is_control() {
            '\u{fffd}'
        } else {
            c.to_ascii_lowercase()
        }
    };
    bare.trim()
        .chars()
        .take(LONGEST_NAME)
        .map(printable)
        .collect()
}

/// True when every cell that isn't empty is a number, as in a file without a header.
pub fn is_numbers(names: &[String]) -> bool {
    let mut filled = names.iter().filter(|name| !name.is_empty()).peekable();
    filled.peek().is_some() && filled.all(|name| name.parse::<f64>().is_ok())
}

impl Columns {
    /// Reads the header's cells, already [`clean`].
    pub fn from_names(names: &[String]) -> Result<Self, Problem> {
        if is_numbers(names) {
            return Err(Problem::NoHeader);
        }
        let header = Header { names };
        let (time, time_unit) = header.time()?;
        let (accel, unit) = header.axes(AXES, &UNITS)?;
        let rate = header.rate()?;
        let moving = header.find(MOVING)?;
        let temperature = header.find(TEMPERATURE)?;
        let reference = header.reference()?;
        let mut columns = Self {
            width: names.len(),
            time,
            time_unit,
            accel,
            unit,
            rate,
            moving,
            temperature,
            reference,
            ignored: Vec::new(),
        };
        columns.ignored = header.others(&columns.used());
        Ok(columns)
    }

    fn used(&self) -> Vec<usize> {
        let mut used = vec![self.time];
        used.extend(self.accel);
        used.extend(self.rate.iter().flat_map(|(places, _)| places));
        used.extend(self.moving);
        used.extend(self.temperature);
        match self.reference {
            Some(ReferenceColumns::Quaternion(places)) => used.extend(places),
            Some(ReferenceColumns::Slopes(places)) => used.extend(places.into_iter().flatten()),
            None => {}
        }
        used
    }
}

struct Header<'a> {
    names: &'a [String],
}

impl Header<'_> {
    /// The place of a name; an error when it stands there twice.
    fn find(&self, name: &str) -> Result<Option<usize>, Problem> {
        let mut places = self.names.iter().enumerate().filter(|(_, n)| *n == name);
        let first = places.next().map(|(place, _)| place);
        match places.next() {
            Some((_, again)) => Err(Problem::DuplicateColumn(name.to_owned(), again.clone())),
            None => Ok(first),
        }
    }

    /// The one column of `base` and its unit, out of the names that would do.
    fn quantity<U: Copy>(&self, base: &str, known: &[(String, U)]) -> Result<(usize, U), Problem> {
        let mut found: Option<(usize, U, &str)> = None;
        for (name, unit) in known {
            let Some(place) = self.find(name)? else {
                continue;
            };
            if let Some((_, _, before)) = found {
                return Err(Problem::DuplicateColumn(before.to_owned(), name.clone()));
            }
            found = Some((place, *unit, name));
        }
        let names = || known.iter().map(|(name, _)| name.clone()).collect();
        match found {
            Some((place, unit, _)) => Ok((place, unit)),
            None => Err(self.missing(base, names())),
        }
    }

    fn missing(&self, base: &str, known: Vec<String>) -> Problem {
        let unitless = |name: &&String| {
            name.strip_prefix(base)
                .is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_alphanumeric()))
        };
        match self.names.iter().find(unitless) {
            Some(column) => Problem::UnknownUnit {
                column: column.clone(),
                known,
            },
            None => self.missing_column(&known),
        }
    }

    fn missing_column(&self, known: &[String]) -> Problem {
        let strangers = self.names.iter().filter(|name| !is_known(name));
        let near = strangers.filter_map(|name| {
            let distance = known.iter().map(|wanted| levenshtein(name, wanted)).min()?;
            (distance <= 2 && !name.is_empty()).then_some((distance, name))
        });
        Problem::MissingColumn {
            wanted: known
                .iter()
                .map(|name| format!("`{name}`"))
                .collect::<Vec<_>>()
                .join(" or "),
            there: self.names.to_vec(),
            nearest: near
                .min_by_key(|(distance, _)| *distance)
                .map(|(_, name)| name.clone()),
        }
    }

    fn time(&self) -> Result<(usize, TimeUnit), Problem> {
        self.quantity("time", &TIMES.map(|(name, unit)| (name.to_owned(), unit)))
    }

    /// The columns of a gyroscope; none where no column has one of their names.
    fn rate(&self) -> Result<Option<([usize; 3], RateUnit)>, Problem> {
        let known = |name: &String| is_axis(name, RATE_AXES, &RATE_UNITS);
        match self.names.iter().any(known) {
            true => self.axes(RATE_AXES, &RATE_UNITS).map(Some),
            false => Ok(None),
        }
    }

    /// The columns of three axes, all in one of these units.
    fn axes<U: Copy + PartialEq>(
        &self,
        axes: [&str; 3],
        units_known: &[(&str, U)],
    ) -> Result<([usize; 3], U), Problem> {
        let mut places = [0; 3];
        let mut units = Vec::new();
        for (place, axis) in places.iter_mut().zip(axes) {
            let known = units_known
                .iter()
                .map(|(suffix, unit)| (format!("{axis}{suffix}"), *unit));
            let mut wanted: Vec<_> = known.collect();
            // The other axes tell which unit the missing one should have.
            if let Some(first) = units.first()
                && !wanted.iter().any(|(name, _)| self.names.contains(name))
            {
                wanted.retain(|(_, unit)| unit == first);
            }
            let (found, unit) = self.quantity(axis, &wanted)?;
            *place = found;
            units.push(unit);
        }
        match units.first() {
            Some(&first) if units.iter().all(|unit| *unit == first) => Ok((places, first)),
            _ => Err(Problem::MixedUnits(
                places
                    .iter()
                    .filter_map(|&place| self.names.get(place).cloned())
                    .collect(),
            )),
        }
    }

    fn reference(&self) -> Result<Option<ReferenceColumns>, Problem> {
        let mut parts = [None; 4];
        for (part, name) in parts.iter_mut().zip(QUATERNION) {
            *part = self.find(name)?;
        }
        if let [Some(w), Some(x), Some(y), Some(z)] = parts {
            return Ok(Some(ReferenceColumns::Quaternion([w, x, y, z])));
        }
        if parts.iter().any(Option::is_some) {
            let lost = parts
                .iter()
                .zip(QUATERNION)
                .find(|(part, _)| part.is_none());
            let name = lost.map_or(QUATERNION[0], |(_, name)| name);
            return Err(self.missing_column(&[name.to_owned()]));
        }
        let slopes = [self.find(SLOPES[0])?, self.find(SLOPES[1])?];
        Ok(slopes
            .iter()
            .any(Option::is_some)
            .then_some(ReferenceColumns::Slopes(slopes)))
    }

    fn others(&self, used: &[usize]) -> Vec<String> {
        let others = self
            .names
            .iter()
            .enumerate()
            .filter(|(place, _)| !used.contains(place));
        others.map(|(_, name)| name.clone()).collect()
    }
}

/// Whether a name is that of one of these axes in one of these units.
fn is_axis<U>(name: &str, axes: [&str; 3], units: &[(&str, U)]) -> bool {
    axes.into_iter().any(|axis| {
        name.strip_prefix(axis)
            .is_some_and(|rest| units.iter().any(|(suffix, _)| rest == *suffix))
    })
}

fn is_known(name: &str) -> bool {
    TIMES.iter().any(|(time, _)| name == *time)
        || is_axis(name, AXES, &UNITS)
        || is_axis(name, RATE_AXES, &RATE_UNITS)
        || name == MOVING
        || QUATERNION.contains(&name)
        || SLOPES.contains(&name)
        || name == TEMPERATURE
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(header: &str) -> Result<Columns, Problem> {
        let names: Vec<String> = header.split(',').map(clean).collect();
        Columns::from_names(&names)
    }

    #[test]
    fn any_order_and_strangers_named() {
        let columns = read(" AZ_G ,\"ax_g\",note,ay_g,time_ms,temp_c").unwrap();
        assert_eq!(columns.accel, [1, 3, 0]);
        assert_eq!(
            (columns.time, columns.time_unit),
            (4, TimeUnit::Milliseconds)
        );
        assert_eq!(columns.temperature, Some(5));
        assert_eq!(columns.ignored, ["note"]);
    }

    #[test]
    fn references_of_both_kinds() {
        let base = "time_s,ax_g,ay_g,az_g";
        let all = read(&format!("{base},ref_qw,ref_qx,ref_qy,ref_qz,ref_x_deg")).unwrap();
        assert_eq!(
            all.reference,
            Some(ReferenceColumns::Quaternion([4, 5, 6, 7]))
        );
        assert_eq!(all.ignored, ["ref_x_deg"]);
        let one = read(&format!("{base},ref_y_deg")).unwrap();
        assert_eq!(
            one.reference,
            Some(ReferenceColumns::Slopes([None, Some(4)]))
        );
        let torn = read(&format!("{base},ref_qw,ref_qx,ref_qy")).unwrap_err();
        assert!(torn.to_string().contains("no column `ref_qz`"), "{torn}");
    }

    #[test]
    fn each_fault_of_a_header_has_its_sentence() {
        let cases = [
            ("1,2,3,4", "put a first line such as"),
            ("0.5,-1e3,nan,4", "put a first line such as"),
            (
                "time_s,ax_g,ay_g",
                "no column `az_g`; there is `time_s`, `ax_g`, `ay_g`",
            ),
            ("time_s,ax_g,ay_g,za_g", "rename `za_g` if it is meant"),
            ("tine_s,ax_g,ay_g,az_g", "rename `tine_s` if it is meant"),
            (
                "time_s,ax_g,ay_mps2,az_g",
                "differ in unit (`ax_g`, `ay_mps2`, `az_g`)",
            ),
            (
                "time_s,ax_ft,ay_g,az_g",
                "`ax_ft` has no unit; name it ax_g or ax_mps2",
            ),
            (
                "time,ax_g,ay_g,az_g",
                "`time` has no unit; name it time_s or time_ms",
            ),
            ("time_s,ax,ay,az", "`ax` has no unit"),
            (
                "time_s,ax_g,ay_g,az_g,ay_g",
                "`ay_g` and `ay_g` give the same quantity",
            ),
            (
                "time_s,time_ms,ax_g,ay_g,az_g",
                "`time_s` and `time_ms` give the same",
            ),
            (
                "time_s,ax_g,ax_lsb,ay_g,az_g",
                "`ax_g` and `ax_lsb` give the same",
            ),
            ("", "no column `time_s` or `time_ms` or `time_us`"),
        ];
        for (header, sentence) in cases {
            let text = read(header).unwrap_err().to_string();
            assert!(text.contains(sentence), "{header}: {text}");
        }
    }

    #[test]
    fn a_name_can_not_upset_the_terminal() {
        let text = read("t\rime_s,\u{1b}[2J,ax_g").unwrap_err().to_string();
        assert!(!text.contains(char::is_control), "{text:?}");
        assert_eq!(clean(&"x".repeat(70_000)).len(), 64);
    }
}
