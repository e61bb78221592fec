//! What a chart promises.

use super::*;
use proptest::prelude::*;

fn chart(plots: Vec<Plot>) -> Chart {
    Chart {
        id: "c".to_owned(),
        title: "Error".to_owned(),
        y_label: "deg".to_owned(),
        x_label: "s".to_owned(),
        plots,
        ..Chart::default()
    }
}

fn line(points: &[(f64, f64)]) -> Chart {
    chart(vec![Plot::new(
        "Node 1",
        Ink::First,
        Shape::Line(points.to_vec()),
    )])
}

/// The `d` of the first path of this class.
fn path(html: &str, class: &str) -> String {
    let (_, rest) = html
        .split_once(&format!("<path class=\"{class}\" d=\""))
        .unwrap();
    rest.split_once('"').unwrap().0.to_owned()
}

#[test]
fn a_line_runs_from_corner_to_corner_of_its_frame() {
    let html = line(&[(0.0, 0.0), (10.0, 1.0)]).html();
    // Labels 0.0 to 1.0 are three characters: the frame begins at 14 + 3 x 9.5.
    assert_eq!(path(&html, "line ink1"), "M42.5 256.0L500.0 36.0");
}

#[test]
fn a_gap_breaks_the_line_and_a_lone_point_is_a_dot() {
    let points = [
        (0.0, 0.0),
        (1.0, 1.0),
        (2.0, f64::NAN),
        (3.0, 0.5),
        (4.0, f64::INFINITY),
    ];
    let drawn = path(&line(&points).html(), "line ink1");
    assert_eq!(drawn.matches('M').count(), 2);
    assert_eq!(drawn.matches('L').count(), 1);
    assert!(drawn.ends_with("h0"), "{drawn}");
}

#[test]
fn without_a_value_there_is_a_sentence_and_no_frame() {
    for points in [
        &[][..],
        &[(0.0, f64::NAN)],
        &[(f64::NAN, 1.0)],
        &[(1e13, 1.0)],
    ] {
        let html = line(points).html();
        assert!(html.contains("No data") && !html.contains("<svg"), "{html}");
    }
}

#[test]
fn every_text_is_escaped() {
    let nasty = "<b a=\"1\">&'";
    let mut chart = chart(vec![
        Plot::new(nasty, Ink::First, Shape::Line(vec![(0.0, 0.0), (1.0, 1.0)])),
        Plot::new(nasty, Ink::Second, Shape::Bars(vec![(0.0, 1.0)])),
    ]);
    chart.levels.push(Level {
        at: 0.5,
        name: nasty.to_owned(),
    });
    for text in [
        &mut chart.id,
        &mut chart.title,
        &mut chart.description,
        &mut chart.x_label,
        &mut chart.y_label,
    ] {
        *text = nasty.to_owned();
    }
    let html = chart.html();
    assert!(!html.contains("<b") && !html.contains("a=\""), "{html}");
    assert!(html.contains("&lt;b a=&quot;1&quot;&gt;&amp;&#39;"));
}

#[test]
fn a_drawing_has_a_name_and_a_description_for_those_who_do_not_see_it() {
    let mut chart = line(&[(0.0, 0.0), (1.0, 1.0)]);
    chart.description = "Rises.".to_owned();
    let html = chart.html();
    assert!(html.contains("<svg role=\"img\""));
    assert!(html.contains("aria-labelledby=\"c-t c-d\""));
    assert!(html.contains("<title id=\"c-t\">Error</title><desc id=\"c-d\">Rises.</desc>"));
}

#[test]
fn a_level_is_inside_the_frame_even_when_the_data_are_small() {
    let mut chart = line(&[(0.0, 0.01), (1.0, -0.01)]);
    chart.levels.push(Level {
        at: 0.40,
        name: "limit".to_owned(),
    });
    assert_eq!(
        chart.y_extent(),
        Some(Range {
            from: -0.01,
            to: 0.40
        })
    );
    let y: f64 = path(&chart.html(), "level")
        .split(['H', ' '])
        .nth(1)
        .unwrap()
        .parse()
        .unwrap();
    assert!((30.0..100.0).contains(&y), "{y}");
}

#[test]
fn a_chart_over_angles_can_ask_for_ticks_every_thirty_degrees() {
    let mut chart = line(&[(-90.0, 0.0), (90.0, 1.0)]);
    chart.x_step = Some(30.0);
    for label in ["−90", "−30", "60"] {
        assert!(
            chart.html().contains(&format!(">{label}</text>")),
            "{label}"
        );
    }
    chart.x_step = Some(1e-9);
    assert!(
        chart.html().contains(">−50</text>"),
        "too many ticks are not drawn"
    );
}

#[test]
fn the_name_of_a_level_stays_above_the_axis() {
    let mut chart = line(&[(0.0, 0.0), (1.0, 0.0)]);
    for at in [0.2, -0.2] {
        chart.levels.push(Level {
            at,
            name: "limit".to_owned(),
        });
    }
    let html = chart.html();
    for (at, _) in html.match_indices("halo\"") {
        let y: f64 = html[at..]
            .split(" y=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap()
            .parse()
            .unwrap();
        assert!(y < 256.0, "{y}");
    }
}

#[test]
fn charts_to_be_compared_get_the_same_range() {
    let mut charts = [
        line(&[(0.0, 0.0), (1.0, 0.1)]),
        line(&[(0.0, -3.0), (1.0, 7.0)]),
    ];
    share_y(&mut charts);
    assert_eq!(
        charts[0].y_range,
        Some(Range {
            from: -3.0,
            to: 7.0
        })
    );
    assert_eq!(charts[0].y_range, charts[1].y_range);
}

#[test]
fn grouped_bars_stand_side_by_side_with_their_counts() {
    let bars = |values: [f64; 3]| Shape::Bars((1..=3).map(f64::from).zip(values).collect());
    let html = chart(vec![
        Plot::new("Paper", Ink::First, bars([0.0, 0.0, 120.0])),
        Plot::new("Product", Ink::Second, bars([0.0, 7.0, 0.0])),
    ])
    .html();
    assert_eq!(
        html.matches("<rect class=\"bar ink1\" x=").count(),
        4,
        "three and the legend"
    );
    assert!(html.contains(">120</text>") && html.contains(">7</text>"));
    let lefts: Vec<f64> = html
        .match_indices("<rect class=\"bar ink")
        .map(|(at, _)| &html[at..])
        .filter(|rest| rest.contains("y=\""))
        .map(|rest| {
            rest.split("x=\"")
                .nth(1)
                .unwrap()
                .split('"')
                .next()
                .unwrap()
        })
        .map(|number| number.parse().unwrap())
        .collect();
    // The legend's two keys come first, then three bars of each series.
    let (first, second) = (&lefts[2..5], &lefts[5..8]);
    assert!(first.iter().zip(second).all(|(a, b)| a < b));
    assert!(second[0] < first[1]);
    for day in ["1", "2", "3"] {
        assert!(html.contains(&format!("\">{day}</text>")));
    }
}

#[test]
fn a_band_closes_at_gaps() {
    let bins = vec![
        (0.0, 0.0, 1.0),
        (1.0, 0.0, 2.0),
        (2.0, f64::NAN, 1.0),
        (3.0, 1.0, 1.0),
    ];
    let html = chart(vec![Plot::new("Delta", Ink::First, Shape::Band(bins))]).html();
    let drawn = path(&html, "band ink1");
    assert_eq!(drawn.matches('M').count(), 2);
    assert_eq!(drawn.matches('Z').count(), 2);
}

#[test]
fn a_long_line_is_drawn_from_few_points() {
    let points: Vec<_> = (0..500_000)
        .map(|i| (f64::from(i), f64::from(i % 100)))
        .collect();
    assert!(line(&points).html().len() < 30_000);
}

/// Numbers that charts meet, also those they should not.
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![4 => -100.0..100.0, 1 => any::<f64>(), 1 => Just(0.0), 1 => Just(f64::NAN)]
}

proptest! {
    #[test]
    fn any_numbers_give_a_drawing_without_a_number_that_is_not_finite(
        points in proptest::collection::vec((number(), number()), 0..60),
        bins in proptest::collection::vec((number(), number(), number()), 0..60),
        level in number(),
        shaded in proptest::collection::vec((number(), number()), 0..3),
    ) {
        let mut chart = chart(vec![
            Plot::new("a", Ink::First, Shape::Line(points.clone())),
            Plot::new("b", Ink::Second, Shape::Markers(points.clone())),
            Plot::new("c", Ink::Other, Shape::Bars(points)),
            Plot::new("d", Ink::Reference, Shape::Band(bins)),
        ]);
        chart.levels.push(Level { at: level, name: "limit".to_owned() });
        chart.shaded = shaded;
        let html = chart.html();
        prop_assert!(!html.contains("NaN") && !html.contains("inf"), "{html}");
    }

    #[test]
    fn any_text_leaves_the_markup_whole(text in ".*") {
        let mut chart = line(&[(0.0, 0.0), (1.0, 1.0)]);
        let plain = chart.html().matches('<').count();
        chart.title = text.clone();
        chart.x_label = text;
        prop_assert_eq!(chart.html().matches('<').count(), plain);
    }
}
