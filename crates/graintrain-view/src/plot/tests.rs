use super::axis::number;
use super::*;

fn texts(svg: &str) -> Vec<String> {
    let document = roxmltree::Document::parse(svg).expect("well-formed XML");
    document
        .descendants()
        .filter(|n| n.has_tag_name("text"))
        .filter_map(|n| n.text())
        .map(str::to_string)
        .collect()
}

#[test]
fn a_chart_is_well_formed_and_carries_its_texts() {
    let svg = Chart::new("Solve & <precompute>", Axis::log("contacts (1)"), Axis::log("time (s)"))
        .with(Series::line("a \"b\"", vec![[1e3, 0.1], [1e4, 3.0], [1e5, 90.0]]).with_markers())
        .with(Series::scatter("c", vec![[2e3, 0.2]]).with_errors(vec![[0.1, 0.4]]))
        .with_band("paper", 5.0, 15.0)
        .to_svg();
    let texts = texts(&svg);
    for expected in [
        "Solve & <precompute>",
        "contacts (1)",
        "time (s)",
        "a \"b\"",
        "c",
        "paper",
        "10\u{2074}",
        "10\u{b3}",
    ] {
        assert!(texts.iter().any(|text| text == expected), "{expected} missing in {texts:?}");
    }
}

/// The frame of the plot (the outlined rectangle): corner and size.
fn outline(svg: &str) -> [f64; 4] {
    let document = roxmltree::Document::parse(svg).unwrap();
    let frame = document
        .descendants()
        .find(|n| n.has_tag_name("rect") && n.attribute("fill") == Some("none"))
        .unwrap();
    ["x", "y", "width", "height"].map(|name| frame.attribute(name).unwrap().parse().unwrap())
}

#[test]
fn data_land_where_the_axes_say() {
    let chart = Chart::new("t", Axis::linear("x").between(0.0, 10.0), Axis::log("y").between(1.0, 100.0));
    let svg = chart.with(Series::line("", vec![[0.0, 1.0], [5.0, 10.0], [10.0, 100.0]])).to_svg();
    let [x, y, w, h] = outline(&svg);
    let expected =
        format!("{:.2},{:.2} {:.2},{:.2} {:.2},{:.2}", x, y + h, x + 0.5 * w, y + 0.5 * h, x + w, y);
    assert!(svg.contains(&expected), "{expected} not in {svg}");
}

#[test]
fn undrawable_points_break_the_line_and_never_reach_the_file() {
    let points = vec![
        [1.0, 1.0],
        [2.0, 2.0],
        [3.0, 0.0],
        [4.0, f64::NAN],
        [5.0, 2.0],
        [6.0, f64::INFINITY],
        [7.0, 1.0],
        [8.0, 1.0],
    ];
    let svg = Chart::new("t", Axis::linear("x"), Axis::log("y"))
        .with(Series::line("", points).with_markers())
        .to_svg();
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    assert_eq!(svg.matches("<polyline").count(), 2);
    assert_eq!(svg.matches("<circle").count(), 5);
}

#[test]
fn a_chart_without_data_says_so_and_keeps_its_labels() {
    let texts = texts(&Chart::new("empty", Axis::linear("x (m)"), Axis::log("y (N)")).to_svg());
    assert_eq!(texts, ["empty", "no data", "x (m)", "y (N)"]);
}

#[test]
fn ticks_are_round_and_inside() {
    for (low, high) in [(0.0, 1.0), (-3.7, 12.0), (0.001, 0.0012), (1e6, 9e6), (5.0, 5.0)] {
        let axis = Axis::linear("x");
        let limits = axis.limits([low, high].into_iter()).unwrap();
        let ticks = axis.ticks(limits);
        assert!((3..=12).contains(&ticks.len()), "{limits:?}: {ticks:?}");
        assert!(
            ticks
                .iter()
                .all(|t| t.value >= limits[0] - 1e-9 && t.value <= limits[1] + 1e-9 && !t.text.is_empty())
        );
        assert!(limits[0] <= low && limits[1] >= high);
    }
    let labels = |low, high| {
        let ticks = Axis::log("x").ticks([low, high]);
        ticks.into_iter().map(|t| t.text).filter(|t| !t.is_empty()).collect::<Vec<_>>()
    };
    assert_eq!(labels(1.0, 1000.0), ["1", "10", "100", "1000"]);
    assert_eq!(labels(1.5, 60.0), ["2", "5", "10", "20", "50"]);
    assert!(labels(1e-12, 1e12).len() <= 9);
}

/// A steps.csv may hold any number: axes of the smallest and largest ones have as many ticks as others, and
/// no infinite end.
#[test]
fn axes_of_extreme_values_stay_small() {
    let values = [1e-320, 5e-324, 1e-308, -1e-320, 1e-12, 1.0, 1.0 + 2e-16, 1e249, -1.7e308, 1.7e308, 0.0];
    for axis in [Axis::linear("x"), Axis::log("x")] {
        for low in values {
            for high in values {
                let Some(limits) = axis.limits([low, high].into_iter()) else { continue };
                assert!(limits[0] < limits[1] && limits.iter().all(|end| end.is_finite()), "{limits:?}");
                assert!(axis.scale == Scale::Linear || limits[0] > 0.0);
                let ticks = axis.ticks(limits);
                assert!(ticks.len() < 600, "{low:e} {high:e}: {} ticks", ticks.len());
                assert!(ticks.iter().filter(|tick| !tick.text.is_empty()).count() <= 12);
                let svg = Chart::new("", axis.clone(), axis.clone())
                    .with(Series::line("", vec![[low, high], [high, low]]))
                    .to_svg();
                assert!(!svg.contains("NaN") && !svg.contains("inf"));
            }
        }
    }
}

#[test]
fn numbers_read_well() {
    for (value, text) in [
        (0.0, "0"),
        (1.0, "1"),
        (-2.5, "\u{2212}2.5"),
        (0.012, "0.012"),
        (12345.0, "12345"),
        (2e5, "2\u{b7}10\u{2075}"),
        (1e-4, "10\u{207b}\u{2074}"),
        (99.96, "100"),
    ] {
        assert_eq!(number(value), text);
    }
}

#[test]
fn a_figure_sets_charts_side_by_side() {
    let chart = |title: &str| {
        Chart::new(title, Axis::linear("x"), Axis::linear("y"))
            .with(Series::line("", vec![[0.0, 0.0], [1.0, 1.0]]))
    };
    let svg = figure(&[chart("first"), chart("second"), chart("third")], 2);
    let document = roxmltree::Document::parse(&svg).unwrap();
    assert_eq!(document.root_element().attribute("viewBox"), Some("0 0 1280 880"));
    let title = |name: &str| {
        let node = document.descendants().find(|n| n.text() == Some(name) && n.has_tag_name("text")).unwrap();
        [node.attribute("x").unwrap().to_string(), node.attribute("y").unwrap().to_string()]
    };
    assert_eq!(title("second"), ["960.00", "24.00"]);
    assert_eq!(title("third"), ["320.00", "464.00"]);
}
