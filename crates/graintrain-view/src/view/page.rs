//! The replay's page: the frames of a run in HTML.

use super::model::{FIELDS, Model};
use super::pack::{Frame, Ranges, pack, pack_model};
use super::{RunFolder, ViewError};
use crate::figures::{Figure, Moments, charts};
use crate::plot::Scale;
use crate::plot::svg::escape;
use crate::render::camera::Bounds;
use graintrain::math::Vec3;
use graintrain::world::World;
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

const TEMPLATE: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/style.css");
/// In the order in which they use each other.
const SCRIPTS: [&str; 7] = [
    include_str!("page/data.js"),
    include_str!("page/camera.js"),
    include_str!("page/shaders.js"),
    include_str!("page/draw.js"),
    include_str!("page/charts.js"),
    include_str!("page/film.js"),
    include_str!("page/controls.js"),
];

/// Contacts below this part of the largest usual force are not embedded: their tubes would be thinner than a
/// line.
const WEAKEST_CHAIN: f64 = 0.027;

/// Most places of bodies in a page, over all frames: 14 bytes each before they are compressed.
const MOST_PLACES: usize = 6_000_000;
/// So many frames there are however many bodies.
const FEWEST_FRAMES: usize = 24;
/// Most points of a curve in a page.
const POINTS: usize = 800;

/// How a replay is made.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewSettings {
    /// Most frames in the page; more are thinned evenly.
    pub max_frames: usize,
    /// Whether contact forces are embedded.
    pub force_chains: bool,
}

impl Default for ViewSettings {
    fn default() -> Self {
        Self { max_frames: 240, force_chains: true }
    }
}

/// What the page's script knows besides the frames.
#[derive(Serialize)]
pub(super) struct Header<'a> {
    /// Where frames come from a run under way: how often bodies have come or gone.
    #[serde(skip_serializing_if = "Option::is_none")]
    live: Option<u64>,
    title: &'a str,
    facts: String,
    bodies: usize,
    balls: usize,
    oriented: usize,
    groups: Vec<GroupHeader>,
    /// Names of the bodies that have one.
    names: BTreeMap<usize, &'a str>,
    materials: &'a [String],
    fields: [(&'static str, &'static str); 4],
    grain_radius: f64,
    /// Between two frames nobody moves farther: who does has left a periodic cell on one side and come back
    /// on the other.
    jump: f64,
    up: [f64; 3],
    center: [f64; 3],
    half: [f64; 3],
    chunk: Chunk,
    charts: Vec<ChartData>,
}

impl Header<'_> {
    /// The same for a run under way whose bodies have come or gone so often.
    pub(super) fn of_generation(self, generation: u64) -> Self {
        Self { live: Some(generation), ..self }
    }
}

/// A group of bodies that share a surface: how many numbers of it are packed.
#[derive(Serialize)]
struct GroupHeader {
    kind: &'static str,
    bodies: usize,
    triangles: usize,
}

/// Frames that are packed together.
#[derive(Default, Serialize)]
pub(super) struct Chunk {
    ranges: Option<Ranges>,
    /// The force of the thickest tube, N.
    chain_shown: f32,
    frames: Vec<FrameHeader>,
}

#[derive(Serialize)]
struct FrameHeader {
    time: f64,
    contacts: usize,
    /// Bodies that are not there: ranges of indices.
    absent: Vec<[usize; 2]>,
}

/// A chart of the page.
#[derive(Serialize)]
pub(super) struct ChartData {
    /// Whether it tells of the computation rather than of what is computed.
    inner: bool,
    title: String,
    x: String,
    y: String,
    log: bool,
    /// Times of the points, or of the series.
    points: Option<Vec<f64>>,
    profiles: Option<Vec<f64>>,
    series: Vec<Curve>,
}

#[derive(Serialize)]
struct Curve {
    label: String,
    x: Vec<f32>,
    y: Vec<f32>,
}

/// The charts of a run's folder: first what was measured, last what tells of the computation.
///
/// # Errors
/// As [`charts`].
pub(super) fn chart_data(folder: &Path) -> Result<Vec<ChartData>, ViewError> {
    let mut figures = charts(folder, POINTS)?;
    let rank = |figure: &Figure| match figure.name.as_str() {
        name if name.starts_with("measure_") => 0,
        "forces" => 1,
        "energies" => 2,
        _ => 3,
    };
    figures.sort_by_key(rank);
    let data = |figure: Figure| {
        let inner = rank(&figure) == 3;
        figure.charts.into_iter().map(move |run_chart| {
            let (points, profiles) = match run_chart.moments {
                Moments::OfPoints(times) => (Some(times), None),
                Moments::OfSeries(times) => (None, Some(times)),
            };
            let chart = run_chart.chart;
            let axis = |points: &[[f64; 2]], k: usize| points.iter().map(|point| point[k] as f32).collect();
            let curve = |series: crate::plot::Series| Curve {
                x: axis(&series.points, 0),
                y: axis(&series.points, 1),
                label: series.label,
            };
            ChartData {
                inner,
                title: chart.title,
                x: chart.x.label,
                log: chart.y.scale == Scale::Log,
                y: chart.y.label,
                points,
                profiles,
                series: chart.series.into_iter().map(curve).collect(),
            }
        })
    };
    Ok(figures.into_iter().flat_map(data).collect())
}

/// The bodies that are not there as ranges of indices.
pub(crate) fn absent(present: &[bool]) -> Vec<[usize; 2]> {
    let mut first = 0;
    let mut ranges = Vec::new();
    for run in present.chunk_by(|a, b| a == b) {
        if !run[0] {
            ranges.push([first, first + run.len()]);
        }
        first += run.len();
    }
    ranges
}

/// The replay of a run's folder as one HTML page.
///
/// # Errors
/// [`ViewError`] for a folder without checkpoint or frames, or with damaged ones.
pub fn page(run: &RunFolder, settings: &ViewSettings) -> Result<String, ViewError> {
    let times = run.times();
    if times.is_empty() {
        return Err(ViewError::NoFrames { folder: run.path().to_path_buf() });
    }
    let few_enough = (MOST_PLACES / run.last.bodies.len().max(1)).max(FEWEST_FRAMES);
    let stride = times.len().div_ceil(settings.max_frames.clamp(1, few_enough));
    // The last frame is always shown.
    let mut shown: Vec<usize> = (0..times.len()).rev().step_by(stride).collect();
    shown.reverse();
    let (first, _) = run.world_of_all(shown[0])?;
    let model = Model::new(&first);
    let made = shown
        .par_iter()
        .map(|&index| {
            let (world, present) = run.world_of_all(index)?;
            Ok((model.frame(&world, run.step, settings.force_chains), absent(&present)))
        })
        .collect::<Result<Vec<_>, ViewError>>()?;
    let (frames, absent): (Vec<Frame>, Vec<Vec<[usize; 2]>>) = made.into_iter().unzip();
    let scene = model.fitted(&frames, &absent);
    let (chunk, data) = packed(frames, absent)?;
    let count = match stride {
        1 => format!("{} frames", shown.len()),
        _ => format!("{} of {} frames", shown.len(), times.len()),
    };
    let facts = format!("{} bodies, {count}, {:.3} s", model.count, times[times.len() - 1]);
    let header = header(&first, &model, &run.scene, scene, facts);
    html(&Header { chunk, charts: chart_data(run.path())?, ..header }, &pack_model(&model)?, &data)
}

/// Frames of the same bodies as text, with what is needed to read it.
///
/// # Errors
/// As [`pack`].
pub(super) fn packed(
    mut frames: Vec<Frame>,
    absent: Vec<Vec<[usize; 2]>>,
) -> Result<(Chunk, String), ViewError> {
    let chain_shown = usual_largest(frames.iter().flat_map(|frame| frame.contacts.iter().map(|c| c.3)));
    for frame in &mut frames {
        frame.contacts.retain(|contact| f64::from(contact.3) >= WEAKEST_CHAIN * f64::from(chain_shown));
    }
    if frames.iter().all(|frame| frame.size.iter().all(|size| (size - 1.0).abs() < 1e-5)) {
        frames.iter_mut().for_each(|frame| frame.size.clear());
    }
    let ranges = Ranges::of(&frames);
    let data = pack(&frames, &ranges)?;
    let headers = frames
        .iter()
        .zip(absent)
        .map(|(frame, absent)| FrameHeader { time: frame.time, contacts: frame.contacts.len(), absent })
        .collect();
    Ok((Chunk { ranges: Some(ranges), chain_shown, frames: headers }, data))
}

/// The header of a page that looks at the box `scene` of a world, without frames and charts.
pub(super) fn header<'a>(
    world: &'a World,
    model: &Model,
    title: &'a str,
    scene: Bounds,
    facts: String,
) -> Header<'a> {
    let named = world.bodies.name.iter().enumerate().filter(|(_, name)| !name.is_empty());
    let group = |group: &super::model::Group| GroupHeader {
        kind: group.kind,
        bodies: group.bodies.len(),
        triangles: group.triangles.len() / 9,
    };
    let edges = world.cell().map(|cell| {
        let edges = (0..3).filter(|&axis| cell.periodic[axis]).map(|axis| cell.size[axis]);
        edges.fold(f64::INFINITY, f64::min)
    });
    Header {
        live: None,
        title,
        facts,
        bodies: model.count,
        balls: model.balls.body.len(),
        oriented: model.oriented.len(),
        groups: model.groups.iter().map(group).collect(),
        names: named.map(|(body, name)| (body, name.as_str())).collect(),
        materials: &world.materials.names,
        fields: FIELDS,
        grain_radius: model.grain_radius,
        jump: edges.filter(|edge| edge.is_finite()).map_or(1e30, |edge| 0.5 * edge),
        up: (-world.gravity).normalize_or(Vec3::Z).to_array(),
        center: scene.center().to_array(),
        half: (0.5 * (scene.high - scene.low)).to_array(),
        chunk: Chunk::default(),
        charts: Vec::new(),
    }
}

/// The page itself.
///
/// # Errors
/// None in practice: writing to memory.
pub(super) fn html(header: &Header<'_>, model: &str, data: &str) -> Result<String, ViewError> {
    // A closing tag inside the data would end the element.
    let text = serde_json::to_string(header).map_err(std::io::Error::from)?.replace('<', "\\u003c");
    Ok(TEMPLATE
        .replace("{{title}}", &escape(header.title))
        .replace("{{style}}", STYLE)
        .replace("{{script}}", &SCRIPTS.concat())
        .replace("{{header}}", &text)
        .replace("{{model}}", model)
        .replace("{{data}}", data))
}

/// The largest of some values, or their 99.5th percentile where few values are far larger; at least a tiny
/// positive number.
fn usual_largest(values: impl Iterator<Item = f32>) -> f32 {
    let mut sorted: Vec<f32> = values.filter(|value| *value > 0.0 && value.is_finite()).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let largest = sorted.last().copied().unwrap_or(1.0);
    let usual = sorted.get(sorted.len() * 995 / 1000).copied().unwrap_or(largest);
    if largest > 1.5 * usual { usual } else { largest }
}
