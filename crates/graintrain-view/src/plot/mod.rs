//! Charts as SVG: lines, markers, error bars and bands over linear or logarithmic axes.
//!
//! ```
//! use graintrain_view::plot::{Axis, Chart, Series};
//! let svg = Chart::new("Time of a solve", Axis::log("contacts (1)"), Axis::log("time (s)"))
//!     .with(Series::line("pdip+ilu", vec![[2e3, 0.4], [2e4, 9.0]]).with_markers())
//!     .with(Series::line("ipm", vec![[2e3, 0.02], [2e4, 0.3]]).dashed())
//!     .to_svg();
//! assert!(svg.starts_with("<svg"));
//! ```
//!
//! Every chart has a title, axis labels (put the unit in brackets) and a legend above the plot, which
//! therefore never hides data. [`figure`] sets several charts side by side. The output is one self-contained
//! SVG element: it can be written to a file or pasted into HTML.
//!
//! | module | holds |
//! |---|---|
//! | [`axis`] | scales, ranges, ticks, numbers as text |
//! | [`mod@svg`] | the SVG writer: escaped text, fixed precision |

pub mod axis;
mod draw;
pub mod svg;

pub use axis::{Axis, Scale};

/// How the points of a series are joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stroke {
    /// Not joined.
    None,
    /// Straight segments.
    Solid,
    /// Dashed straight segments.
    Dashed,
    /// Constant from each point to the next one's abscissa (distribution functions, performance profiles).
    Steps,
}

/// Points with one look and one entry in the legend.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Text in the legend; empty for no entry.
    pub label: String,
    /// (x, y) in data units. Points that are not finite, or not positive on a logarithmic axis, are not drawn
    /// and break the line.
    pub points: Vec<[f64; 2]>,
    /// Lower and upper end of each point's error bar, as ordinates; empty for none.
    pub errors: Vec<[f64; 2]>,
    /// How points are joined.
    pub stroke: Stroke,
    /// Whether points get a marker.
    pub markers: bool,
    /// Whether markers are outlines, e.g. for bounds instead of values.
    pub hollow: bool,
    /// Index into the palette; `None` is the series' position in the chart.
    pub color: Option<usize>,
}

impl Series {
    /// Points joined by straight segments.
    pub fn line(label: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self {
            label: label.into(),
            points,
            errors: Vec::new(),
            stroke: Stroke::Solid,
            markers: false,
            hollow: false,
            color: None,
        }
    }

    /// Markers that are not joined.
    pub fn scatter(label: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self { stroke: Stroke::None, markers: true, ..Self::line(label, points) }
    }

    /// A step function.
    pub fn steps(label: impl Into<String>, points: Vec<[f64; 2]>) -> Self {
        Self { stroke: Stroke::Steps, ..Self::line(label, points) }
    }

    /// The same with a marker on every point.
    pub fn with_markers(mut self) -> Self {
        self.markers = true;
        self
    }

    /// The same with outlines for markers.
    pub fn hollow(mut self) -> Self {
        self.hollow = true;
        self
    }

    /// The same with a dashed line.
    pub fn dashed(mut self) -> Self {
        self.stroke = Stroke::Dashed;
        self
    }

    /// The same with an error bar on every point: lower and upper ordinate.
    pub fn with_errors(mut self, errors: Vec<[f64; 2]>) -> Self {
        self.errors = errors;
        self
    }

    /// The same in the palette's colour of this index: a method keeps its colour from chart to chart.
    pub fn in_color(mut self, index: usize) -> Self {
        self.color = Some(index);
        self
    }
}

/// A range of ordinates shaded across the plot, e.g. a published interval.
#[derive(Clone, Debug, PartialEq)]
pub struct Band {
    /// Text in the legend.
    pub label: String,
    /// Smallest ordinate.
    pub low: f64,
    /// Largest ordinate.
    pub high: f64,
}

/// A chart: series over two axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Heading.
    pub title: String,
    /// Horizontal axis.
    pub x: Axis,
    /// Vertical axis.
    pub y: Axis,
    /// What is drawn, in order.
    pub series: Vec<Series>,
    /// Shaded ranges behind the series.
    pub bands: Vec<Band>,
    /// Width and height in CSS pixels.
    pub size: [f64; 2],
}

impl Chart {
    /// An empty chart of 640 x 440.
    pub fn new(title: impl Into<String>, x: Axis, y: Axis) -> Self {
        Self { title: title.into(), x, y, series: Vec::new(), bands: Vec::new(), size: [640.0, 440.0] }
    }

    /// The chart with one more series.
    pub fn with(mut self, series: Series) -> Self {
        self.series.push(series);
        self
    }

    /// The chart with a shaded range of ordinates.
    pub fn with_band(mut self, label: impl Into<String>, low: f64, high: f64) -> Self {
        self.bands.push(Band { label: label.into(), low, high });
        self
    }

    /// The chart at another size, CSS pixels.
    pub fn sized(mut self, width: f64, height: f64) -> Self {
        self.size = [width, height];
        self
    }

    /// The chart as an SVG element with its own name space. A chart without a drawable point says "no data".
    pub fn to_svg(&self) -> String {
        figure(std::slice::from_ref(self), 1)
    }
}

/// Charts in rows of `columns`, as one SVG element; every cell has the size of the largest chart.
pub fn figure(charts: &[Chart], columns: usize) -> String {
    let columns = columns.clamp(1, charts.len().max(1));
    let rows = charts.len().div_ceil(columns);
    let cell = charts
        .iter()
        .fold([1.0_f64, 1.0], |size, chart| [size[0].max(chart.size[0]), size[1].max(chart.size[1])]);
    let mut canvas = svg::Svg::new(cell[0] * columns as f64, cell[1] * rows as f64);
    for (index, chart) in charts.iter().enumerate() {
        let origin = [(index % columns) as f64 * cell[0], (index / columns) as f64 * cell[1]];
        draw::chart(&mut canvas, chart, origin);
    }
    canvas.finish()
}

#[cfg(test)]
mod tests;
