//! Frames of a run as a USD layer (Universal Scene Description, the text format `.usda`), for Blender,
//! Omniverse, Houdini and usdview.
//!
//! Balls are one `PointInstancer` of a unit sphere with their radii as scales; bodies that share a surface
//! are one of that surface. Positions, orientations, speeds and largest contact forces are time samples; a
//! time code is a frame of `timeCodesPerSecond`, so that it plays as it went. Bodies that are not there are
//! in `invisibleIds`. Units are metres; the up axis is the one that gravity lies along (the format knows Y
//! and Z).
//!
//! Source: openusd.org, "UsdGeomPointInstancer", "UsdGeomMesh".

use super::model::{Group, Model};
use super::pack::Frame;
use super::page::absent;
use super::{RunFolder, ViewError};
use graintrain::math::Vec3;
use rayon::prelude::*;
use std::collections::HashMap;
use std::fmt::Write as _;

/// Frames per second where there is one frame only.
const RATE: f64 = 24.0;

/// The layer of these frames (indices of [`RunFolder::times`], ascending). Cost: about 100 bytes per body and
/// frame.
///
/// # Errors
/// [`ViewError`] where there are no frames or a file is missing or damaged.
pub fn usd(run: &RunFolder, frames: &[usize]) -> Result<String, ViewError> {
    let Some(&first) = frames.first() else {
        return Err(ViewError::NoFrames { folder: run.path().to_path_buf() });
    };
    let (world, _) = run.world_of_all(first)?;
    let model = Model::new(&world);
    let made = frames
        .par_iter()
        .map(|&index| {
            let (world, present) = run.world_of_all(index)?;
            Ok((model.frame(&world, run.step, false), present))
        })
        .collect::<Result<Vec<_>, ViewError>>()?;
    let (frames, present): (Vec<Frame>, Vec<Vec<bool>>) = made.into_iter().unzip();
    let mut layer = Layer { codes: codes(&frames), frames: &frames, present: &present, text: String::new() };
    layer.head(&run.scene, world.gravity, &model);
    if !model.balls.body.is_empty() {
        layer.balls(&model);
    }
    for (number, group) in model.groups.iter().enumerate() {
        layer.group(&model, number, group);
    }
    layer.text.push_str("}\n");
    Ok(layer.text)
}

/// Time codes of the frames and how many there are in a second: frames at equal distances have whole codes.
fn codes(frames: &[Frame]) -> (Vec<f64>, f64) {
    let mut gaps: Vec<f64> = frames.windows(2).map(|pair| pair[1].time - pair[0].time).collect();
    gaps.sort_unstable_by(f64::total_cmp);
    let rate = gaps.get(gaps.len() / 2).filter(|gap| **gap > 0.0).map_or(RATE, |gap| 1.0 / gap);
    // Times are multiples of a step: what is left of the division is rounding.
    let code = |time: f64| ((time - frames[0].time) * rate * 1e6).round() / 1e6;
    (frames.iter().map(|frame| code(frame.time)).collect(), (rate * 1e6).round() / 1e6)
}

struct Layer<'a> {
    codes: (Vec<f64>, f64),
    frames: &'a [Frame],
    /// Of all bodies, by frame.
    present: &'a [Vec<bool>],
    text: String,
}

impl Layer<'_> {
    fn line(&mut self, indent: usize, words: &str) {
        let _ = writeln!(self.text, "{:1$}{words}", "", 4 * indent);
    }

    fn head(&mut self, scene: &str, gravity: Vec3, model: &Model) {
        let up = if gravity.y.abs() > gravity.z.abs().max(gravity.x.abs()) { "Y" } else { "Z" };
        let title = scene.replace(['"', '\\', '\n'], " ");
        let (last, rate) = (self.codes.0.last().copied().unwrap_or(0.0), self.codes.1);
        self.text = format!(
            "#usda 1.0\n(\n    defaultPrim = \"run\"\n    doc = \"{title}, by graintrain\"\n    metersPerUnit = 1\n    upAxis = \"{up}\"\n    \
             startTimeCode = 0\n    endTimeCode = {last}\n    timeCodesPerSecond = {rate}\n    framesPerSecond = {rate}\n)\n\ndef Xform \"run\"\n{{\n"
        );
        let _ = writeln!(self.text, "    custom int bodies = {}", model.count);
    }

    /// Opens an instancer of bodies whose one prototype is to be written next.
    fn open(&mut self, name: &str, bodies: &[usize]) {
        self.line(1, &format!("def PointInstancer \"{name}\"\n    {{"));
        self.line(2, &format!("rel prototypes = </run/{name}/prototype>"));
        self.line(2, &format!("int[] protoIndices = [{}]", list(bodies.iter().map(|_| "0".to_string()))));
        self.line(2, &format!("int64[] ids = [{}]", list(bodies.iter().map(ToString::to_string))));
        let place = |frame: &Frame, body: usize| tuple(&frame.position[body]);
        self.samples("point3f[] positions", |frame| list(bodies.iter().map(|&body| place(frame, body))));
        let missing = |k: usize| -> Vec<String> {
            let gone = absent(&self.present[k]);
            let is_gone = |body: &&usize| gone.iter().any(|[first, end]| (*first..*end).contains(*body));
            bodies.iter().filter(is_gone).map(ToString::to_string).collect()
        };
        let missing: Vec<Vec<String>> = (0..self.frames.len()).map(missing).collect();
        if missing.iter().any(|gone| !gone.is_empty()) {
            self.each("int64[] invisibleIds", |k| missing[k].join(", "));
        }
        // Speed and largest contact force: the first and third field of a frame.
        for (field, name) in [(0, "speed"), (2, "force")] {
            let name = format!("float[] primvars:{name}");
            self.samples(&name, |frame| {
                list(bodies.iter().map(|&body| frame.fields[field][body].to_string()))
            });
        }
    }

    /// Time samples of an array, as what stands between its brackets.
    fn samples(&mut self, attribute: &str, values: impl Fn(&Frame) -> String + Sync + Send) {
        let frames = self.frames;
        let texts: Vec<String> = frames.par_iter().map(values).collect();
        self.each(attribute, |k| texts[k].clone());
    }

    fn each(&mut self, attribute: &str, value: impl Fn(usize) -> String) {
        self.line(2, &format!("{attribute}.timeSamples = {{"));
        for k in 0..self.frames.len() {
            let code = self.codes.0[k];
            self.line(3, &format!("{code}: [{}],", value(k)));
        }
        self.line(2, "}");
    }

    /// Sizes of the bodies: once, or in every frame where some grow.
    fn sizes(&mut self, bodies: &[usize], size: impl Fn(&Frame, usize) -> f32 + Sync + Send) {
        let all = |frame: &Frame| list(bodies.iter().enumerate().map(|(k, _)| tuple(&[size(frame, k); 3])));
        let grows =
            self.frames.iter().any(|frame| bodies.iter().any(|&b| (frame.size[b] - 1.0).abs() > 1e-5));
        if grows {
            self.samples("float3[] scales", all);
        } else {
            let once = all(&self.frames[0]);
            self.line(2, &format!("float3[] scales = [{once}]"));
        }
    }

    fn balls(&mut self, model: &Model) {
        let (bodies, radius) = (&model.balls.body, &model.balls.radius);
        self.open("balls", bodies);
        self.sizes(bodies, |frame, k| radius[k] as f32 * frame.size[bodies[k]]);
        self.line(2, "def Sphere \"prototype\"\n        {");
        self.line(3, "double radius = 1");
        self.line(3, "color3f[] primvars:displayColor = [(0.27, 0.45, 0.62)]");
        self.text.push_str("        }\n    }\n");
    }

    fn group(&mut self, model: &Model, number: usize, group: &Group) {
        let bodies = &group.bodies;
        self.open(&format!("{}s_{number}", group.kind), bodies);
        let slot = |body: usize| model.oriented.binary_search(&body).expect("bodies of groups are oriented");
        let slots: Vec<usize> = bodies.iter().map(|&body| slot(body)).collect();
        // Real part first, as the format wants it.
        let turn = |frame: &Frame, slot: usize| {
            let [x, y, z, w] = frame.orientation[slot];
            tuple(&[w, x, y, z])
        };
        self.samples("quath[] orientations", |frame| list(slots.iter().map(|&slot| turn(frame, slot))));
        self.sizes(bodies, |frame, k| frame.size[bodies[k]]);
        let (points, indices) = indexed(&group.triangles);
        self.line(2, "def Mesh \"prototype\"\n        {");
        self.line(3, "uniform token subdivisionScheme = \"none\"");
        self.line(3, "bool doubleSided = 1");
        self.line(
            3,
            &format!("int[] faceVertexCounts = [{}]", list(indices.chunks(3).map(|_| "3".to_string()))),
        );
        self.line(
            3,
            &format!("int[] faceVertexIndices = [{}]", list(indices.iter().map(ToString::to_string))),
        );
        self.line(3, &format!("point3f[] points = [{}]", list(points.iter().map(|point| tuple(point)))));
        let (color, opacity) = match group.kind {
            "grain" => ("(0.27, 0.45, 0.62)", "1"),
            "tool" => ("(0.45, 0.51, 0.59)", "1"),
            _ => ("(0.8, 0.81, 0.83)", "0.25"),
        };
        self.line(3, &format!("color3f[] primvars:displayColor = [{color}]"));
        self.line(3, &format!("float[] primvars:displayOpacity = [{opacity}]"));
        self.text.push_str("        }\n    }\n");
    }
}

fn list(words: impl Iterator<Item = String>) -> String {
    words.collect::<Vec<_>>().join(", ")
}

fn tuple(numbers: &[f32]) -> String {
    format!("({})", list(numbers.iter().map(ToString::to_string)))
}

/// Corners of triangles as points that are there once, and indices of them.
fn indexed(triangles: &[f32]) -> (Vec<[f32; 3]>, Vec<usize>) {
    let mut points = Vec::new();
    let mut known: HashMap<[u32; 3], usize> = HashMap::new();
    let corners = triangles.as_chunks::<3>().0.iter();
    let indices = corners
        .map(|corner| {
            *known.entry(corner.map(f32::to_bits)).or_insert_with(|| {
                points.push(*corner);
                points.len() - 1
            })
        })
        .collect();
    (points, indices)
}
