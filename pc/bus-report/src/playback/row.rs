//! A row of an exported table: what one frame has told.
//!
//! In: a frame, the news in it and what is known since. Out: [`Row`]. A value that the frame does
//! not carry is not there; angles that must not be used are not there either. The columns are
//! described in `docs/logs.md`.

use listen::{Meaning, Measured, Now, Part, Place, Side, Watch};

/// Names of the numbers in a row, units at the end.
pub const COLUMNS: [&str; 27] = [
    "slope_x_deg",
    "slope_y_deg",
    "validity",
    "state",
    "delta_x_deg",
    "delta_y_deg",
    "uncertainty_deg",
    "latency_ms",
    "difference_deg",
    "temperature_degc",
    "angle_x_deg",
    "angle_y_deg",
    "quality_x",
    "quality_y",
    "accel_x_g",
    "accel_y_g",
    "accel_z_g",
    "emcy_code",
    "error_register",
    "faults",
    "nmt_state",
    "slope_x_now_deg",
    "slope_y_now_deg",
    "uncertainty_now_deg",
    "rate_x_deg_s",
    "rate_y_deg_s",
    "rate_z_deg_s",
];

/// Ends of the names in [`COLUMNS`], and the unit that each stands for.
const UNITS: [(&str, &str); 6] = [
    ("_deg", "deg"),
    ("_deg_s", "deg/s"),
    ("_degc", "degC"),
    ("_g", "g"),
    ("_ms", "ms"),
    ("_s", "s"),
];

/// The unit of a column of [`COLUMNS`] by its name; `None` for a number without one.
pub fn unit(column: &str) -> Option<&'static str> {
    let ends = UNITS.into_iter().filter(|(end, _)| column.ends_with(end));
    let longest = ends.max_by_key(|(end, _)| end.len());
    longest.map(|(_, unit)| unit)
}

/// Numbers of a row.
pub type Values = [Option<f64>; COLUMNS.len()];

/// What one frame has told.
#[derive(Clone, Debug, PartialEq)]
pub struct Row<'a> {
    /// When, ns.
    pub time_ns: u64,
    /// Where.
    pub interface: &'a str,
    /// Who.
    pub node_id: u8,
    /// What kind of frame.
    pub message: &'static str,
    /// Its values.
    pub values: Values,
}

impl Row<'_> {
    /// When, s: to half a microsecond for a date, and what a reader of the CSV gets.
    pub fn time_s(&self) -> f64 {
        const SECOND_NS: u64 = 1_000_000_000;
        // From 104 days on the number of ns would be rounded, and the quotient once more.
        match self.time_ns < 1 << 53 {
            true => self.time_ns as f64 / 1e9,
            false => (self.time_ns / SECOND_NS) as f64 + (self.time_ns % SECOND_NS) as f64 / 1e9,
        }
    }
}

/// Node, kind and values of a frame with news; `None` without.
pub fn of_news(news: Meaning, watch: &Watch) -> Option<(u8, &'static str, Values)> {
    let mut values = [None; COLUMNS.len()];
    let (place, message) = match news {
        Meaning::Slopes(place, _) => (place, "slopes"),
        Meaning::Detail(place) => (place, "detail"),
        Meaning::Exchange(place, _) => (place, "exchange"),
        Meaning::Angle(place) => (place, "angle-now"),
        Meaning::Rates(place) => (place, "rates"),
        Meaning::Turned(place) => (place, "turned"),
        Meaning::Emergency(place, _) => (place, "emcy"),
        Meaning::Heartbeat(place, _) => (place, "heartbeat"),
        Meaning::Sync | Meaning::Malformed(_) | Meaning::Other => return None,
    };
    let side = side_at(watch, place)?;
    match news {
        Meaning::Slopes(_, delta) => {
            slopes(&mut values, side);
            let mdeg = delta.map_or([None; 2], |delta| delta.mdeg);
            set(&mut values, 4, mdeg.map(|mdeg| mdeg.map(degrees)));
        }
        Meaning::Detail(_) => detail(&mut values, side),
        Meaning::Exchange(_, part) => exchange(&mut values, side, part),
        Meaning::Angle(_) => angle_now(&mut values, &side.now),
        // Sums that wrap, for the other channel.
        Meaning::Turned(_) => {}
        Meaning::Rates(_) => {
            let rates = side.now.rates;
            set(
                &mut values,
                24,
                rates.map(|rate| rate.map(|rate| f64::from(rate) / 100.0)),
            );
        }
        Meaning::Emergency(_, emergency) => {
            let numbers = [
                Some(f64::from(emergency.code)),
                Some(f64::from(emergency.register)),
                Some(f64::from(side.faults)),
            ];
            set(&mut values, 17, numbers);
        }
        _ => set(
            &mut values,
            20,
            [side.nmt.map(|(state, _)| f64::from(state as u8))],
        ),
    }
    Some((side.node_id, message, values))
}

fn side_at(watch: &Watch, place: Place) -> Option<&Side> {
    let pair = watch.pairs().get(usize::from(place.pair))?;
    pair.sides.get(usize::from(place.side))
}

fn set<const N: usize>(values: &mut Values, first: usize, numbers: [Option<f64>; N]) {
    let places = values.iter_mut().skip(first);
    places
        .zip(numbers)
        .for_each(|(place, number)| *place = number);
}

fn degrees(mdeg: i32) -> f64 {
    f64::from(mdeg) / 1000.0
}

fn slopes(values: &mut Values, side: &Side) {
    let Some(slopes) = side.slopes else { return };
    set(values, 0, slopes.mdeg.map(|mdeg| mdeg.map(degrees)));
    let numbers = [slopes.validity.map(f64::from), slopes.state.map(f64::from)];
    set(values, 2, numbers);
}

fn detail(values: &mut Values, side: &Side) {
    let Some(detail) = side.detail else { return };
    let numbers = [
        detail.uncertainty_mdeg.map(|mdeg| f64::from(mdeg) / 1000.0),
        detail.latency_ms.map(f64::from),
        detail.difference_mdeg.map(|mdeg| f64::from(mdeg) / 1000.0),
        detail.temperature_degc.map(f64::from),
    ];
    set(values, 6, numbers);
}

fn angle_now(values: &mut Values, now: &Now) {
    let [x, y] = now.mdeg.map(|mdeg| mdeg.map(degrees));
    let uncertainty = now.uncertainty_mdeg.map(|mdeg| degrees(i32::from(mdeg)));
    set(values, 21, [x, y, uncertainty]);
}

fn exchange(values: &mut Values, side: &Side, part: Part) {
    let Some(told) = side.told else { return };
    if part.has_angles() {
        angles(values, &Measured::of(&told.exchange));
    }
    if part.has_vector() {
        let vector = side.vector();
        let accel = |axis: usize| vector.map(|vector| f64::from(vector[axis]) / 8192.0);
        set(values, 14, [accel(0), accel(1), accel(2)]);
    }
}

fn angles(values: &mut Values, measured: &Measured) {
    // As fine as it was sent.
    let angle = |axis| Some(f64::from(measured.steps(axis)?) * 360.0 / 16_777_216.0);
    set(values, 10, [0, 1].map(angle));
    set(
        values,
        12,
        [0, 1].map(|axis| measured.quality(axis).map(f64::from)),
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use canopen::Frame;
    use listen::{NodePlan, PdoPlan, Plan};

    #[test]
    fn a_unit_is_the_end_of_a_name() {
        let units = COLUMNS.map(|name| unit(name).unwrap_or("-"));
        let degrees = units.iter().filter(|unit| **unit == "deg").count();
        assert_eq!((units[0], degrees), ("deg", 11));
        assert_eq!(
            ["state", "latency_ms", "temperature_degc"].map(unit),
            [None, Some("ms"), Some("degC")]
        );
        assert_eq!(
            ["accel_x_g", "rate_z_deg_s"].map(unit),
            [Some("g"), Some("deg/s")]
        );
    }

    #[test]
    fn the_time_of_a_dated_log_was_another_number_than_in_the_csv() {
        let days = [
            0,
            1,
            1 << 20,
            9_007_199,
            9_007_200,
            1_764_363_600,
            18_446_744_073,
        ];
        // Steps that have no factor in common with a second or with a power of two.
        let parts = (0..1000).map(|n| n * 1_000_003 % 709_551_600);
        for time_ns in parts.flat_map(|ns| days.map(|day_s| day_s * 1_000_000_000 + ns)) {
            let row = Row {
                time_ns,
                interface: "can0",
                node_id: 1,
                message: "slopes",
                values: [None; COLUMNS.len()],
            };
            let (seconds, ns) = (time_ns / 1_000_000_000, time_ns % 1_000_000_000);
            let text: f64 = format!("{seconds}.{ns:09}").parse().unwrap();
            assert_eq!(row.time_s(), text, "{time_ns} ns");
        }
    }

    #[test]
    fn what_a_mapping_does_not_have_stood_in_the_table_as_0() {
        let mut node = NodePlan::as_delivered(1);
        node.pdos[0] = PdoPlan::of(0x181, 1, &[0x6110_0020, 0x6120_0020]);
        node.pdos[1] = PdoPlan::of(0x281, 10, &[0x2022_0310]);
        let plan = Plan {
            nodes: vec![node],
            ..Plan::default()
        };
        let mut watch = Watch::new(&plan);
        let mut row = |id: u16, bytes: &[u8]| {
            let news = watch.take(1, &Frame::data_frame(id, bytes));
            of_news(news, &watch).unwrap().2
        };
        let slopes = row(0x181, &[0xE8, 3, 0, 0, 0, 0, 0, 0]);
        assert_eq!(slopes[..4], [Some(10.0), Some(0.0), None, None]);
        let detail = row(0x281, &[20, 0]);
        assert_eq!(detail[6..10], [Some(0.02), None, None, None]);
    }

    #[test]
    fn each_value_stands_in_the_column_of_its_name() {
        let mut watch = Watch::new(&Plan::default());
        let mut row = |id: u16, bytes: &[u8]| {
            let news = watch.take(1, &Frame::data_frame(id, bytes));
            let (_, _, values) = of_news(news, &watch).unwrap();
            let named = COLUMNS.iter().zip(values);
            let there = named.filter_map(|(name, value)| Some(format!("{name} {}", value?)));
            there.collect::<Vec<_>>().join(", ")
        };
        let slopes = row(0x181, &[0xE8, 3, 1, 0, 0x3D, 1]);
        assert_eq!(slopes, "slope_x_deg 10, validity 61, state 1");
        let detail = row(0x281, &[0x3F, 1, 20, 0, 30, 0xFB, 0xFF, 25]);
        let want =
            "uncertainty_deg 0.02, latency_ms 30, difference_deg -0.005, temperature_degc 25";
        assert_eq!(detail, want);
        let angles = row(0x381, &[0, 0, 0x20, 0, 0, 0, 0x70, 7]);
        assert_eq!(angles, "angle_x_deg 45, quality_x 112, quality_y 7");
        let behind = row(0x481, &[0, 0x20, 0, 0xF0, 0, 0, 1, 2]);
        // The angles of the frame before are not its own.
        assert_eq!(behind, "accel_x_g 1, accel_y_g -0.5, accel_z_g 0");
        let angles = row(0x381, &[0, 0, 0x20, 0, 0, 0, 0x70, 7]);
        assert_eq!(angles, "angle_x_deg 45, quality_x 112, quality_y 7");
        let emcy = row(0x081, &[1, 0xFF, 0x81, 16, 0, 0, 0, 7]);
        assert_eq!(emcy, "emcy_code 65281, error_register 129, faults 16");
        assert_eq!(row(0x701, &[127]), "nmt_state 127");
        let now = row(0x201, &[0xE8, 3, 0, 0x80, 20, 0, 0, 6]);
        assert_eq!(now, "slope_x_now_deg 10, uncertainty_now_deg 0.02");
        let rates = row(0x301, &[0x60, 0xF0, 1, 0, 0, 0x80, 1]);
        assert_eq!(rates, "rate_x_deg_s -40, rate_y_deg_s 0.01");
    }
}
