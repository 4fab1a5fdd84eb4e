//! Ray casting in tiles: every sample of every pixel meets the primitives whose image may cover it, nearest
//! first.

use super::camera::Camera;
use super::color::{Rgb, mix};
use super::primitive::{Look, Primitive};
use graintrain::math::Vec3;
use rayon::prelude::*;

/// Edge of a tile in pixels.
const TILE: usize = 32;
/// Samples per pixel along each axis.
const SAMPLES: usize = 2;
/// Samples along the edge of a tile.
const EDGE: usize = TILE * SAMPLES;

/// What a pixel shows before occlusion.
#[derive(Clone, Copy, Debug)]
pub struct Pixel {
    /// Mean colour of the samples.
    pub color: Rgb,
    /// Depth of the first sample, infinite for the background.
    pub depth: f32,
    /// Normal of the surface at the first sample.
    pub normal: Vec3,
}

/// Light and air of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Atmosphere {
    /// Colour behind everything.
    pub background: Rgb,
    /// Depths where the haze begins and where it is full.
    pub haze: [f64; 2],
}

/// Casts rays through all samples of a picture of `width` x `height` pixels.
pub fn cast(
    primitives: &[Primitive],
    camera: &Camera,
    width: usize,
    height: usize,
    atmosphere: &Atmosphere,
) -> Vec<Pixel> {
    let columns = width.div_ceil(TILE);
    let rows = height.div_ceil(TILE);
    let boxed: Vec<([f64; 4], f64)> = primitives
        .par_iter()
        .map(|primitive| {
            let (center, radius) = primitive.form.bounding_ball();
            (primitive.form.rectangle(camera), camera.to_camera(center).z - radius)
        })
        .collect();
    let mut tiles: Vec<Vec<u32>> = vec![Vec::new(); columns * rows];
    let index =
        |pixel: f64, limit: usize| (pixel / TILE as f64).floor().clamp(0.0, limit as f64 - 1.0) as usize;
    for (i, (rectangle, _)) in boxed.iter().enumerate() {
        let [left, top, right, bottom] = *rectangle;
        if right < 0.0 || bottom < 0.0 || left >= width as f64 || top >= height as f64 {
            continue;
        }
        for row in index(top, rows)..=index(bottom, rows) {
            for column in index(left, columns)..=index(right, columns) {
                tiles[row * columns + column].push(i as u32);
            }
        }
    }
    let cells: Vec<Vec<Pixel>> = tiles
        .into_par_iter()
        .enumerate()
        .map(|(tile, mut members)| {
            members.sort_unstable_by(|&a, &b| {
                boxed[a as usize].1.total_cmp(&boxed[b as usize].1).then(a.cmp(&b))
            });
            let origin = [tile % columns * TILE, tile / columns * TILE];
            Tile { primitives, boxed: &boxed, camera, origin, atmosphere }.pixels(&members)
        })
        .collect();
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let cell = &cells[y / TILE * columns + x / TILE];
            pixels.push(cell[y % TILE * TILE + x % TILE]);
        }
    }
    pixels
}

struct Tile<'a> {
    primitives: &'a [Primitive],
    /// Rectangle and smallest depth of each primitive.
    boxed: &'a [([f64; 4], f64)],
    camera: &'a Camera,
    /// Upper left pixel.
    origin: [usize; 2],
    atmosphere: &'a Atmosphere,
}

/// A translucent surface over a sample.
struct Layer {
    sample: u32,
    depth: f64,
    color: Rgb,
    opacity: f64,
}

impl Tile<'_> {
    fn ray(&self, sample: usize) -> Vec3 {
        let at = |index: usize, origin: usize| origin as f64 + (index as f64 + 0.5) / SAMPLES as f64;
        self.camera.ray(at(sample % EDGE, self.origin[0]), at(sample / EDGE, self.origin[1]))
    }

    /// Calls `visit` with every sample of the tile within the image of a primitive.
    fn covered(&self, primitive: u32, mut visit: impl FnMut(usize)) {
        let [left, top, right, bottom] = self.boxed[primitive as usize].0;
        let span = |from: f64, to: f64, origin: usize| {
            let sample = |pixel: f64| (pixel - origin as f64) * SAMPLES as f64 - 0.5;
            let first = sample(from).ceil().clamp(0.0, EDGE as f64) as usize;
            first..(sample(to).floor() + 1.0).clamp(first as f64, EDGE as f64) as usize
        };
        let columns = span(left, right, self.origin[0]);
        for row in span(top, bottom, self.origin[1]) {
            for column in columns.clone() {
                visit(row * EDGE + column);
            }
        }
    }

    /// Nearest primitive with the given look at every sample, and its depth.
    fn nearest(&self, members: &[u32], look: Look) -> Vec<(f64, u32)> {
        let mut nearest = vec![(f64::INFINITY, u32::MAX); EDGE * EDGE];
        let mut farthest = f64::INFINITY;
        let seen = members.iter().filter(|&&i| self.primitives[i as usize].look == look);
        for (count, &i) in seen.enumerate() {
            if count % 16 == 15 {
                farthest = nearest.iter().map(|sample| sample.0).fold(0.0, f64::max);
            }
            // Members come by depth: the rest is hidden everywhere in the tile.
            if self.boxed[i as usize].1 > farthest {
                break;
            }
            let form = &self.primitives[i as usize].form;
            self.covered(i, |sample| {
                if let Some(hit) = form.meet(self.camera.eye, self.ray(sample)) {
                    // Ties go to the lower index, whatever the order.
                    let best = &mut nearest[sample];
                    if hit.depth < best.0 || (hit.depth == best.0 && i < best.1) {
                        *best = (hit.depth, i);
                    }
                }
            });
        }
        nearest
    }

    fn pixels(&self, members: &[u32]) -> Vec<Pixel> {
        let solid = self.nearest(members, Look::Solid);
        let mut normals = vec![Vec3::ZERO; TILE * TILE];
        let mut colors: Vec<Rgb> = solid
            .iter()
            .enumerate()
            .map(|(sample, &(depth, i))| {
                let primitive = self.primitives.get(i as usize);
                let ray = self.ray(sample);
                match primitive.and_then(|p| p.form.meet(self.camera.eye, ray).map(|hit| (p, hit))) {
                    None => self.atmosphere.background,
                    Some((primitive, hit)) => {
                        if sample.is_multiple_of(SAMPLES) && (sample / EDGE).is_multiple_of(SAMPLES) {
                            normals[sample / EDGE / SAMPLES * TILE + sample % EDGE / SAMPLES] = hit.normal;
                        }
                        let color = self.light(primitive.color, hit.normal, ray);
                        mix(color, self.atmosphere.background, 0.3 * self.haze(depth))
                    }
                }
            })
            .collect();
        for layer in self.layers(members, &solid) {
            let color = &mut colors[layer.sample as usize];
            *color = mix(*color, layer.color, layer.opacity);
        }
        (0..TILE * TILE)
            .map(|pixel| {
                let first = pixel / TILE * SAMPLES * EDGE + pixel % TILE * SAMPLES;
                let mut color = [0.0; 3];
                for sample in (0..SAMPLES * SAMPLES).map(|s| first + s / SAMPLES * EDGE + s % SAMPLES) {
                    for c in 0..3 {
                        color[c] += colors[sample][c] / (SAMPLES * SAMPLES) as f64;
                    }
                }
                Pixel { color, depth: solid[first].0 as f32, normal: normals[pixel] }
            })
            .collect()
    }

    /// Panes and the nearest ghosts in front of the solids, farthest first for every sample.
    fn layers(&self, members: &[u32], solid: &[(f64, u32)]) -> Vec<Layer> {
        let mut layers = Vec::new();
        let eye = self.camera.eye;
        for &i in members {
            let primitive = &self.primitives[i as usize];
            if primitive.look != Look::Glass {
                continue;
            }
            self.covered(i, |sample| {
                let ray = self.ray(sample);
                let hit = primitive.form.meet(eye, ray).filter(|hit| hit.depth < solid[sample].0);
                if let Some(hit) = hit {
                    let line = 1.2 * hit.depth / self.camera.focal;
                    let edge = primitive.form.distance_to_edge(eye + hit.depth * ray) < line;
                    let opacity = if edge { 0.55 } else { 0.07 };
                    layers.push(Layer {
                        sample: sample as u32,
                        depth: hit.depth,
                        color: primitive.color,
                        opacity,
                    });
                }
            });
        }
        if members.iter().any(|&i| self.primitives[i as usize].look == Look::Ghost) {
            for (sample, &(depth, i)) in self.nearest(members, Look::Ghost).iter().enumerate() {
                if depth >= solid[sample].0 {
                    continue;
                }
                let primitive = &self.primitives[i as usize];
                let ray = self.ray(sample);
                if let Some(hit) = primitive.form.meet(eye, ray) {
                    // Denser at the rim, so that outlines remain.
                    let facing = -hit.normal.dot(ray) / ray.length();
                    let opacity = 0.10 + 0.30 * (1.0 - facing.clamp(0.0, 1.0)).powi(2);
                    let color = self.light(primitive.color, hit.normal, ray);
                    layers.push(Layer { sample: sample as u32, depth, color, opacity });
                }
            }
        }
        layers.sort_by(|a, b| a.sample.cmp(&b.sample).then(b.depth.total_cmp(&a.depth)));
        layers
    }

    fn haze(&self, depth: f64) -> f64 {
        let [near, far] = self.atmosphere.haze;
        ((depth - near) / (far - near)).clamp(0.0, 1.0)
    }

    /// A key light from the upper left behind the camera, a weak light from the right, ambient light, a small
    /// highlight.
    fn light(&self, color: Rgb, normal: Vec3, ray: Vec3) -> Rgb {
        let Camera { right, up, forward, .. } = *self.camera;
        let key = (-0.5 * right + 0.8 * up - 0.65 * forward).normalize();
        let fill = (0.8 * right + 0.1 * up - 0.5 * forward).normalize();
        let half = (key - ray.normalize()).normalize();
        let diffuse = 0.40 + 0.55 * normal.dot(key).max(0.0) + 0.18 * normal.dot(fill).max(0.0);
        let highlight = 0.22 * normal.dot(half).max(0.0).powi(40);
        color.map(|channel| channel * diffuse + highlight)
    }
}

/// Darkens pixels whose surroundings stand in front of their tangent plane (screen-space ambient obscurance,
/// McGuire et al. 2011), within `reach` metres.
pub fn occlude(pixels: &mut [Pixel], camera: &Camera, width: usize, height: usize, reach: f64) {
    const TAPS: usize = 12;
    const PATTERN: usize = 4;
    let point = |x: usize, y: usize, depth: f32| {
        camera.eye + f64::from(depth) * camera.ray(x as f64 + 0.25, y as f64 + 0.25)
    };
    let occlusion: Vec<f32> = (0..width * height)
        .into_par_iter()
        .map(|index| {
            let (x, y) = (index % width, index / width);
            let Pixel { depth, normal, .. } = pixels[index];
            if !depth.is_finite() {
                return 0.0;
            }
            let here = point(x, y, depth);
            let radius = (camera.focal * reach / f64::from(depth)).min(0.2 * height as f64);
            let turn = (x % PATTERN * PATTERN + y % PATTERN) as f64 / (PATTERN * PATTERN) as f64;
            let mut sum = 0.0;
            for tap in 0..TAPS {
                // A sunflower spiral, turned from pixel to pixel; the blur below averages the turns.
                let distance = radius * ((tap as f64 + turn) / TAPS as f64).sqrt();
                let angle = 2.399_963 * tap as f64 + std::f64::consts::TAU * turn;
                let (u, v) = (x as f64 + distance * angle.cos(), y as f64 + distance * angle.sin());
                if u < 0.0 || v < 0.0 || u >= width as f64 || v >= height as f64 {
                    continue;
                }
                let (u, v) = (u as usize, v as usize);
                let other = pixels[v * width + u].depth;
                if !other.is_finite() {
                    continue;
                }
                let to = point(u, v, other) - here;
                let far = to.length();
                if far > 0.0 {
                    sum += (normal.dot(to) / far - 0.05).max(0.0) * (1.0 - far / reach).max(0.0);
                }
            }
            (sum / TAPS as f64) as f32
        })
        .collect();
    let depths: Vec<f32> = pixels.iter().map(|pixel| pixel.depth).collect();
    let tolerance = 0.5 * reach as f32;
    pixels.par_iter_mut().enumerate().filter(|(_, pixel)| pixel.depth.is_finite()).for_each(
        |(index, pixel)| {
            let (x, y) = (index % width, index / width);
            let (mut sum, mut weight) = (0.0, 0.0);
            for v in y.saturating_sub(1)..(y + PATTERN - 1).min(height) {
                for u in x.saturating_sub(1)..(x + PATTERN - 1).min(width) {
                    // Only over the same surface: edges stay sharp.
                    if (depths[v * width + u] - pixel.depth).abs() <= tolerance {
                        sum += f64::from(occlusion[v * width + u]);
                        weight += 1.0;
                    }
                }
            }
            let light = (1.0 - 2.6 * sum / weight).clamp(0.25, 1.0);
            pixel.color = pixel.color.map(|channel| channel * light);
        },
    );
}
