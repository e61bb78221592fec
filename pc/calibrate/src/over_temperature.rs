//! What a chamber run adds to the report's page and to its certificate.
//!
//! In: the [`Thermal`] of each channel. Out: a section of the page, with what the model leaves over
//! the temperature, its coefficients and every dwell; and results of the certificate, lists over
//! the sensor's temperature.
//!
//! Left out: the rest of both (`page`, `dcc`), and the figures themselves (`crate::characterise`).

use super::data::{
    Channel, Coefficient, GyroscopeBias, GyroscopeScale, Report, Thermal, ThermalDwell,
};
use super::quantity::{METRE_PER_SECOND2, SI_PER_MG, list, real, result_of, result_of_lists};
use super::xml::Xml;
use output::chart::{Chart, Ink, Level, Plot, Shape};
use output::html;
use output::table::{Rows, Table};

/// The sensor's axes in their order.
pub const AXES: [&str; 3] = ["x", "y", "z"];

/// The section of the page; empty for a report without a chamber.
pub fn page(report: &Report) -> String {
    let channels = || {
        let channels = report.channels.iter();
        channels.filter_map(|channel| Some((channel, channel.thermal.as_ref()?)))
    };
    let mut out = String::new();
    for (channel, thermal) in channels() {
        out += &format!("<h3>Channel {}</h3>\n", html::escape(&channel.channel));
        out += &html::facts(&facts(channel, thermal));
        out += &html::charts(&[0, 1, 2].map(|axis| chart(channel, thermal, axis)));
        let title = format!("Temperature model of channel {}", channel.channel);
        out += &html::table(&coefficients(&title, &thermal.coefficients));
        out += &html::table(&dwells(channel, thermal));
    }
    out
}

fn facts(channel: &Channel, thermal: &Thermal) -> Vec<(&'static str, String)> {
    let mg = |value: Option<f64>| value.map_or("not known".to_owned(), |mg| format!("{mg:.2} mg"));
    let (low, high) = (thermal.sensor_min_degc, thermal.sensor_max_degc);
    let hysteresis = thermal.hysteresis_mg;
    let hysteresis = hysteresis.map_or("not met on both branches".to_owned(), |[x, y, z]| {
        format!("x {x:.2}, y {y:.2}, z {z:.2} mg (half the difference of both branches, at most)")
    });
    let unchanged = thermal.unchanged_at_degc;
    let unchanged = unchanged.map_or("as with the model before, at 25 degC".to_owned(), |at| {
        format!("as before at {at:.1} degC, where the calibration was made")
    });
    let mut facts = vec![
        ("Model", thermal.model.clone()),
        (
            "Holds by the sensor's thermometer",
            format!("{low:.1} to {high:.1} degC"),
        ),
        ("Angles", unchanged),
        (
            "Readings without the model, rms",
            mg(Some(thermal.without_model_mg)),
        ),
        ("Left by the model, rms", mg(channel.residual_mg)),
        ("Hysteresis seen", hysteresis),
        ("Between runs, rms", mg(thermal.between_runs_mg)),
    ];
    facts.extend(thermal.gyroscope_bias.iter().flat_map(of_gyroscope));
    facts.extend(thermal.gyroscope_scale.iter().flat_map(of_scale));
    facts
}

/// How the bias of the gyroscope was found.
fn of_gyroscope(bias: &GyroscopeBias) -> Vec<(&'static str, String)> {
    const BIAS: &str = "Bias of the gyroscope";
    if let Some(refused) = &bias.refused {
        return vec![(BIAS, format!("as it was: {refused}"))];
    }
    let deg_s = |value: Option<f64>| {
        value.map_or("not known".to_owned(), |value| format!("{value:.4} deg/s"))
    };
    let hysteresis = bias.bias_hysteresis_deg_s;
    let hysteresis = hysteresis.map(|axes| axes.into_iter().fold(0.0, f64::max));
    let (rests, left_out) = (bias.rests, bias.rests_left_out);
    vec![
        (
            BIAS,
            format!("from {rests} rests; {left_out} were left out"),
        ),
        ("Bias left at a rest, rms", deg_s(bias.bias_residual_deg_s)),
        ("Bias hysteresis, largest axis", deg_s(hysteresis)),
        (
            "Bias between runs, rms",
            deg_s(bias.bias_between_runs_deg_s),
        ),
    ]
}

/// How the scale of the gyroscope over temperature was found.
fn of_scale(scale: &GyroscopeScale) -> Vec<(&'static str, String)> {
    const SCALE: &str = "Scale of the gyroscope";
    let mut facts = match &scale.refused {
        Some(refused) => vec![(SCALE, format!("as it was: {refused}"))],
        None => vec![(SCALE, format!("slopes from {} turns", scale.used))],
    };
    if let Some(deg) = scale.scale_residual_deg {
        facts.push(("Left at a turn's end, rms", format!("{deg:.3} deg")));
    }
    if !scale.open_axes.is_empty() {
        let axes = scale.open_axes.join(", ");
        facts.push(("Axes not turned, slopes as before", axes));
    }
    for left in &scale.left_out {
        facts.push(("Turns left out", format!("{}: {}", left.turns, left.why)));
    }
    facts
}

/// What the model leaves of an axis over the sensor's temperature, each branch by itself.
fn chart(channel: &Channel, thermal: &Thermal, axis: usize) -> Chart {
    let on = |branches: &[&str]| -> Vec<(f64, f64)> {
        let here = |dwell: &&ThermalDwell| branches.contains(&dwell.branch.as_str());
        let dwells = thermal.dwells.iter().filter(here);
        let mut points: Vec<_> = dwells
            .map(|d| (d.sensor_degc, d.residuals_mg[axis]))
            .collect();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    };
    let mut plots = vec![
        Plot::new("rising", Ink::First, Shape::Markers(on(&["start", "up"]))),
        Plot::new("falling", Ink::Second, Shape::Markers(on(&["down"]))),
    ];
    plots.retain(|plot| !matches!(&plot.shape, Shape::Markers(points) if points.is_empty()));
    let (letter, name) = (&channel.channel, AXES[axis]);
    Chart {
        id: format!("temperature-{}-{name}", letter.to_lowercase()),
        title: format!("Left by the model of channel {letter}, axis {name}"),
        description: format!("What the model leaves of axis {name} over the sensor's temperature"),
        x_label: "Sensor, degC".to_owned(),
        y_label: "Left, mg".to_owned(),
        plots,
        levels: vec![Level {
            at: 0.0,
            name: String::new(),
        }],
        ..Chart::default()
    }
}

/// A table of coefficients.
pub fn coefficients(title: &str, all: &[Coefficient]) -> Table {
    let rows = Rows::of(title, all)
        .text("Coefficient", |c| &c.name)
        .text("Axis", |c| &c.axis)
        .number("Value", 5, |c| c.value);
    let rows = match all.iter().any(|c| c.expanded.is_some()) {
        true => rows.number("U (k = 2)", 5, |c| c.expanded),
        false => rows,
    };
    rows.text("Unit", |c| &c.unit).table()
}

fn dwells(channel: &Channel, thermal: &Thermal) -> Table {
    const AT: &str = "Temperature, degC";
    const LEFT: &str = "Left by the model, mg";
    let channel = &channel.channel;
    let title = format!("Dwells of channel {channel}, means of the orientations");
    Rows::of(&title, &thermal.dwells)
        .count("Run", |d| d.run)
        .text("Branch", |d| &d.branch)
        .number("set", 1, |d| d.set_degc)
        .under(AT)
        .number("air", 1, |d| d.air_degc)
        .under(AT)
        .number("sensor", 1, |d| d.sensor_degc)
        .under(AT)
        .number("x", 2, |d| d.residuals_mg[0])
        .under(LEFT)
        .number("y", 2, |d| d.residuals_mg[1])
        .under(LEFT)
        .number("z", 2, |d| d.residuals_mg[2])
        .under(LEFT)
        .number("largest", 2, |d| d.largest_mg)
        .under(LEFT)
        .count("Begun anew", |d| d.repeated)
        .table()
}

/// Units of the certificate (SIunitx).
const DEGREE_CELSIUS: &str = "\\degreecelsius";
const ONE: &str = "\\one";

/// Coefficients as quantities of the certificate.
pub fn put_coefficients(xml: &mut Xml, all: &[Coefficient]) {
    for coefficient in all {
        // The format has no unit of a mg per degC, so the name tells it.
        let (axis, unit) = (&coefficient.axis, &coefficient.unit);
        let called = format!("{}, axis {axis}, in {unit}", coefficient.name);
        match coefficient.expanded {
            None => real(xml, &called, coefficient.value, ONE),
            expanded => list(xml, &called, &[coefficient.value], ONE, expanded),
        }
    }
}

/// The result about the bias of the gyroscope.
fn bias_result(xml: &mut Xml, bias: &GyroscopeBias) {
    // As of the coefficients, the name tells the unit.
    let axes = bias.bias_hysteresis_deg_s.map(|axes| axes.to_vec());
    let one = |value: Option<f64>| value.map(|value| vec![value]);
    let what = bias.refused.as_ref().map_or(
        "Bias of the gyroscope over temperature".to_owned(),
        |refused| format!("Bias of the gyroscope, which is as it was found: {refused}"),
    );
    let residual = one(bias.bias_residual_deg_s);
    let between = one(bias.bias_between_runs_deg_s);
    result_of(xml, &what, |xml| {
        real(xml, "Rests", f64::from(bias.rests), ONE);
        real(xml, "Rests left out", f64::from(bias.rests_left_out), ONE);
        for (called, values) in [
            ("Left at a rest, rms, in deg/s", residual),
            ("Hysteresis of x, y and z, in deg/s", axes),
            ("Between runs, rms, in deg/s", between),
        ] {
            if let Some(values) = values {
                list(xml, called, &values, ONE, None);
            }
        }
    });
}

/// The result about the scale of the gyroscope.
fn scale_result(xml: &mut Xml, scale: &GyroscopeScale) {
    let what = scale.refused.as_ref().map_or(
        "Scale of the gyroscope over temperature".to_owned(),
        |refused| format!("Scale of the gyroscope, whose slopes are as they were found: {refused}"),
    );
    let left_out: u32 = scale.left_out.iter().map(|left| left.turns).sum();
    result_of(xml, &what, |xml| {
        real(xml, "Turns", f64::from(scale.used), ONE);
        real(xml, "Turns left out", f64::from(left_out), ONE);
        if let Some(deg) = scale.scale_residual_deg {
            real(xml, "Left at the end of a turn, rms", deg, "\\degree");
        }
    });
}

/// The results of the certificate: range, coefficients, and what is left at each dwell.
pub fn results(xml: &mut Xml, thermal: &Thermal) {
    let what = format!("Temperature model, {}", thermal.model);
    result_of(xml, &what, |xml| {
        let lowest = "Lowest temperature at which the model holds";
        real(xml, lowest, thermal.sensor_min_degc, DEGREE_CELSIUS);
        let highest = "Highest temperature at which the model holds";
        real(xml, highest, thermal.sensor_max_degc, DEGREE_CELSIUS);
        put_coefficients(xml, &thermal.coefficients);
    });
    result_of_lists(xml, "Left by the temperature model", |xml| {
        let of =
            |of: fn(&ThermalDwell) -> f64| -> Vec<f64> { thermal.dwells.iter().map(of).collect() };
        list(xml, "Run", &of(|d| f64::from(d.run)), ONE, None);
        list(xml, "Sensor", &of(|d| d.sensor_degc), DEGREE_CELSIUS, None);
        for (axis, called) in AXES.iter().enumerate() {
            let dwells = thermal.dwells.iter();
            let left: Vec<f64> = dwells.map(|d| d.residuals_mg[axis] * SI_PER_MG).collect();
            let called = format!("Left by the model, axis {called}");
            list(xml, &called, &left, METRE_PER_SECOND2, None);
        }
    });
    if let Some(bias) = &thermal.gyroscope_bias {
        bias_result(xml, bias);
    }
    if let Some(scale) = &thermal.gyroscope_scale {
        scale_result(xml, scale);
    }
}
