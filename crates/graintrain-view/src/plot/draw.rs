//! The layout and the drawing of one chart.

use super::svg::{Anchor, Svg};
use super::{Axis, Chart, Series, Stroke};

/// Colours that people with colour-blindness tell apart (Okabe and Ito 2008, without yellow), then two greys.
const PALETTE: [&str; 8] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222", "#8a8a8a"];
const INK: &str = "#222222";
const GRID: &str = "#e2e2e2";
const BAND: &str = "#8a8a8a";
const TEXT: f64 = 13.0;

/// The plot rectangle and what maps data to it.
struct Frame<'a> {
    chart: &'a Chart,
    corner: [f64; 2],
    size: [f64; 2],
    x: [f64; 2],
    y: [f64; 2],
}

impl Frame<'_> {
    fn place(&self, point: [f64; 2]) -> Option<[f64; 2]> {
        let along = |axis: &Axis, value: f64, [low, high]: [f64; 2]| {
            let (low, high) = (axis.position(low), axis.position(high));
            axis.shows(value).then(|| (axis.position(value) - low) / (high - low))
        };
        let s = along(&self.chart.x, point[0], self.x)?;
        let t = along(&self.chart.y, point[1], self.y)?;
        // Far outside the frame is cut anyway; a bounded coordinate keeps the file well-formed.
        let [s, t] = [s.clamp(-10.0, 11.0), t.clamp(-10.0, 11.0)];
        Some([self.corner[0] + s * self.size[0], self.corner[1] + (1.0 - t) * self.size[1]])
    }
}

/// Draws a chart with its upper left corner at `origin`.
pub(super) fn chart(svg: &mut Svg, chart: &Chart, origin: [f64; 2]) {
    let [width, height] = chart.size;
    let at = |x: f64, y: f64| [origin[0] + x, origin[1] + y];
    svg.text(at(0.5 * width, 24.0), &chart.title, 16.0, Anchor::Middle, 0.0, INK);
    let legend_bottom = legend(svg, chart, origin);

    let points = || chart.series.iter().flat_map(|series| series.points.iter());
    let drawable = || points().filter(|p| chart.x.shows(p[0]) && chart.y.shows(p[1]));
    let bars = chart.series.iter().flat_map(|series| series.errors.iter().flatten().copied());
    let shades = chart.bands.iter().flat_map(|band| [band.low, band.high]);
    let x = chart.x.limits(drawable().map(|p| p[0]));
    let y = chart.y.limits(drawable().map(|p| p[1]).chain(bars).chain(shades));
    let (Some(x), Some(y)) = (x, y) else {
        svg.text(at(0.5 * width, 0.5 * height), "no data", 16.0, Anchor::Middle, 0.0, BAND);
        svg.text(at(0.5 * width, height - 12.0), &chart.x.label, TEXT, Anchor::Middle, 0.0, INK);
        svg.text(at(18.0, 0.5 * height), &chart.y.label, TEXT, Anchor::Middle, -90.0, INK);
        return;
    };
    let y_ticks = chart.y.ticks(y);
    let widest = y_ticks.iter().map(|tick| text_width(&tick.text)).fold(0.0, f64::max);
    let left = 34.0 + widest + 8.0;
    let corner = at(left, legend_bottom + 10.0);
    let size = [width - left - 22.0, height - (legend_bottom + 10.0) - 50.0];
    let frame = Frame { chart, corner, size, x, y };

    for tick in &y_ticks {
        let Some([_, py]) = frame.place([x[0], tick.value]) else { continue };
        let minor = tick.text.is_empty();
        if minor {
            svg.line([corner[0], py], [corner[0] + 4.0, py], INK, 0.7);
        } else {
            svg.line([corner[0], py], [corner[0] + size[0], py], GRID, 1.0);
            svg.text([corner[0] - 7.0, py + 4.5], &tick.text, TEXT, Anchor::End, 0.0, INK);
        }
    }
    let bottom = corner[1] + size[1];
    for tick in chart.x.ticks(x) {
        let Some([px, _]) = frame.place([tick.value, y[0]]) else { continue };
        if tick.text.is_empty() {
            svg.line([px, bottom - 4.0], [px, bottom], INK, 0.7);
        } else {
            svg.line([px, corner[1]], [px, bottom], GRID, 1.0);
            svg.text([px, bottom + 18.0], &tick.text, TEXT, Anchor::Middle, 0.0, INK);
        }
    }
    svg.clipped(corner, size, |svg| {
        for band in &chart.bands {
            let ends = [frame.place([x[0], band.high]), frame.place([x[0], band.low])];
            if let [Some(top), Some(low)] = ends {
                svg.rectangle(top, [size[0], (low[1] - top[1]).max(1.0)], BAND, 0.22);
            }
        }
        for (index, series) in chart.series.iter().enumerate() {
            draw_series(svg, &frame, series, series.color.unwrap_or(index));
        }
    });
    svg.frame(corner, size, INK);
    svg.text([corner[0] + 0.5 * size[0], bottom + 40.0], &chart.x.label, TEXT, Anchor::Middle, 0.0, INK);
    svg.text(
        at(18.0, corner[1] - origin[1] + 0.5 * size[1]),
        &chart.y.label,
        TEXT,
        Anchor::Middle,
        -90.0,
        INK,
    );
}

fn draw_series(svg: &mut Svg, frame: &Frame, series: &Series, color: usize) {
    let ink = PALETTE[color % PALETTE.len()];
    let placed: Vec<Option<[f64; 2]>> = series.points.iter().map(|&p| frame.place(p)).collect();
    for (point, ends) in series.points.iter().zip(&series.errors) {
        if let (Some(low), Some(high)) = (frame.place([point[0], ends[0]]), frame.place([point[0], ends[1]]))
        {
            svg.line(low, high, ink, 1.2);
            for end in [low, high] {
                svg.line([end[0] - 4.0, end[1]], [end[0] + 4.0, end[1]], ink, 1.2);
            }
        }
    }
    if series.stroke != Stroke::None {
        for run in placed.split(Option::is_none) {
            let mut path: Vec<[f64; 2]> = Vec::with_capacity(run.len());
            for &point in run.iter().flatten() {
                if let (Stroke::Steps, Some(last)) = (series.stroke, path.last().copied()) {
                    path.push([point[0], last[1]]);
                }
                path.push(point);
            }
            if path.len() > 1 {
                svg.polyline(&path, ink, 2.0, series.stroke == Stroke::Dashed);
            }
        }
    }
    if series.markers {
        for &point in placed.iter().flatten() {
            marker(svg, point, series, color);
        }
    }
}

/// The marker of a series.
fn marker(svg: &mut Svg, at: [f64; 2], series: &Series, color: usize) {
    symbol(svg, at, 3.6, color, PALETTE[color % PALETTE.len()]);
    if series.hollow {
        symbol(svg, at, 2.0, color, "#ffffff");
    }
}

/// A symbol of radius r whose form depends on the colour's index, so that series are distinguished without
/// colour too.
fn symbol(svg: &mut Svg, [x, y]: [f64; 2], r: f64, index: usize, ink: &str) {
    match index % 4 {
        0 => svg.circle([x, y], r, ink),
        1 => svg.polygon(&[[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]], ink),
        2 => svg.polygon(&[[x, y - 1.3 * r], [x + 1.2 * r, y + r], [x - 1.2 * r, y + r]], ink),
        _ => svg.polygon(&[[x, y - 1.4 * r], [x + 1.4 * r, y], [x, y + 1.4 * r], [x - 1.4 * r, y]], ink),
    }
}

/// Width of a text of size [`TEXT`], from the mean width of a sans-serif letter.
fn text_width(text: &str) -> f64 {
    0.56 * TEXT * text.chars().count() as f64
}

/// Draws the legend in centred rows under the title and returns its lower end.
fn legend(svg: &mut Svg, chart: &Chart, origin: [f64; 2]) -> f64 {
    enum Key<'a> {
        Series(usize, &'a Series),
        Band(&'a str),
    }
    let series = chart.series.iter().enumerate().filter(|(_, series)| !series.label.is_empty());
    let mut keys: Vec<Key> =
        series.map(|(i, series)| Key::Series(series.color.unwrap_or(i), series)).collect();
    keys.extend(chart.bands.iter().filter(|band| !band.label.is_empty()).map(|band| Key::Band(&band.label)));
    let text = |key: &Key| match key {
        Key::Series(_, series) => series.label.clone(),
        Key::Band(label) => (*label).to_string(),
    };
    let width_of = |key: &Key| 34.0 + text_width(&text(key)) + 16.0;

    let mut rows: Vec<Vec<Key>> = Vec::new();
    let mut used = f64::INFINITY;
    for key in keys {
        let width = width_of(&key);
        if used + width > chart.size[0] - 24.0 {
            rows.push(Vec::new());
            used = 0.0;
        }
        used += width;
        if let Some(row) = rows.last_mut() {
            row.push(key);
        }
    }
    let mut y = 34.0;
    for row in &rows {
        y += 17.0;
        let total: f64 = row.iter().map(width_of).sum();
        let mut left = origin[0] + 0.5 * (chart.size[0] - total + 16.0);
        let middle = origin[1] + y - 4.5;
        for key in row {
            match key {
                Key::Series(color, series) => {
                    let ink = PALETTE[color % PALETTE.len()];
                    if series.stroke != Stroke::None {
                        let ends = [[left, middle], [left + 26.0, middle]];
                        svg.polyline(&ends, ink, 2.0, series.stroke == Stroke::Dashed);
                    }
                    if series.markers {
                        marker(svg, [left + 13.0, middle], series, *color);
                    }
                }
                Key::Band(_) => svg.rectangle([left, middle - 5.0], [26.0, 10.0], BAND, 0.22),
            }
            svg.text([left + 32.0, origin[1] + y], &text(key), TEXT, Anchor::Start, 0.0, INK);
            left += width_of(key);
        }
    }
    y
}
