//! Pictures of a world without a display: a ray caster on the CPU.
//!
//! Balls, boxes, cylinders, capsules and triangles are intersected exactly with four rays per pixel; walls
//! between the camera and the grains become panes of glass. Light: one key light, a fill light, ambient light
//! darkened where surroundings stand in front of a surface, haze with depth. Any number of threads gives the
//! same picture. Cost: about the number of samples times the few primitives that overlap there; 36 000 balls
//! at 1200 x 900 take about a second.
//!
//! | module | holds |
//! |---|---|
//! | [`camera`] | the perspective camera and the automatic view |
//! | [`primitive`] | rays against solids |
//! | [`subject`] | bodies, walls and force chains as primitives with colours |
//! | [`raster`] | tiles, samples, light, occlusion |
//! | [`mod@image`], [`font`], [`color`] | pixels, text without system fonts, colour maps |

pub mod camera;
pub mod color;
pub mod font;
pub mod image;
mod overlay;
pub mod primitive;
pub mod raster;
pub mod subject;

use camera::{Bounds, Camera};
use graintrain::math::Vec3;
use graintrain::world::World;
pub use image::Image;
use raster::Atmosphere;

/// What the colour of a grain stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorBy {
    /// Speed of the centre of mass, m/s.
    Speed,
    /// Largest normal force at its contacts, N.
    Force,
    /// Bounding radius, m.
    Radius,
    /// The body's index: neighbours differ.
    Identity,
}

impl std::str::FromStr for ColorBy {
    type Err = RenderError;

    fn from_str(name: &str) -> Result<Self, RenderError> {
        match name {
            "speed" => Ok(Self::Speed),
            "force" => Ok(Self::Force),
            "radius" => Ok(Self::Radius),
            "id" => Ok(Self::Identity),
            _ => Err(RenderError::UnknownColor { name: name.into() }),
        }
    }
}

/// How a picture is made.
#[derive(Clone, Debug, PartialEq)]
pub struct RenderSettings {
    /// Pixels.
    pub width: usize,
    /// Pixels.
    pub height: usize,
    /// What colours stand for.
    pub color: ColorBy,
    /// Values at the ends of the colour map; `None` takes them from the data.
    pub range: Option<[f64; 2]>,
    /// Draw contact forces as tubes between haze-like grains.
    pub force_chains: bool,
    /// Direction from the scene to the camera: degrees around the vertical from the x axis, degrees above the
    /// horizon.
    pub view: [f64; 2],
    /// Time step that turns impulses into forces, s.
    pub step: f64,
    /// What the picture holds, and where half-spaces end; `None` for the grains and what is beside them.
    pub bounds: Option<Bounds>,
}

impl Default for RenderSettings {
    fn default() -> Self {
        Self {
            width: 1200,
            height: 900,
            color: ColorBy::Speed,
            range: None,
            force_chains: false,
            view: [-60.0, 24.0],
            step: 1.0,
            bounds: None,
        }
    }
}

/// Why no picture is made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// Not a quantity that grains can be coloured by.
    #[error("grains cannot be coloured by '{name}': choose speed, force, radius or id")]
    UnknownColor {
        /// What was asked for.
        name: String,
    },
    /// Too few or too many pixels.
    #[error("a picture of {width} x {height} pixels cannot be made: choose 64 to 16384 in both directions")]
    Size {
        /// Pixels asked for.
        width: usize,
        /// Pixels asked for.
        height: usize,
    },
    /// Colour range or time step that is no number, or an empty range.
    #[error("{what} {value} is not usable: {remedy}")]
    Value {
        /// Which setting.
        what: &'static str,
        /// Its value.
        value: f64,
        /// What to do.
        remedy: &'static str,
    },
}

const BACKGROUND: color::Rgb = [1.0, 1.0, 1.0];

/// Makes a picture of the world: all bodies, seen from `settings.view`, with a colour bar and the time.
///
/// # Errors
/// [`RenderError`] for settings out of range. A world without bodies gives an empty picture.
pub fn render(world: &World, settings: &RenderSettings) -> Result<Image, RenderError> {
    check(settings)?;
    let (width, height) = (settings.width, settings.height);
    let grains = subject::grains(world);
    let bounds = settings.bounds.unwrap_or_else(|| subject::bounds(world, &grains));
    let [left, top, right, bottom] = overlay::margins(settings);
    let region = [left, top, width as f64 - right, height as f64 - bottom];
    let (forward, up) = directions(world, settings.view);
    let points = if bounds.is_empty() { Vec::new() } else { bounds.corners().to_vec() };
    let camera = Camera::fit(&points, forward, up, region);
    let (primitives, legend) = subject::primitives(world, &grains, &bounds, &camera, settings);
    let depths = points.iter().map(|&point| camera.to_camera(point).z);
    let haze = depths.fold([f64::INFINITY, 0.0], |[near, far]: [f64; 2], z| [near.min(z), far.max(z)]);
    let atmosphere = Atmosphere { background: BACKGROUND, haze };
    let mut pixels = raster::cast(&primitives, &camera, width, height, &atmosphere);
    let mut radii: Vec<f64> = primitives.iter().map(|primitive| primitive.form.bounding_ball().1).collect();
    radii.sort_unstable_by(f64::total_cmp);
    if let Some(&typical) = radii.get(radii.len() / 2) {
        raster::occlude(&mut pixels, &camera, width, height, 2.5 * typical);
    }
    let colors = pixels.into_iter().map(|pixel| pixel.color).collect();
    let mut image = Image { width, height, pixels: colors };
    overlay::draw(&mut image, legend.as_ref(), world.time, grains.len());
    Ok(image)
}

/// Viewing direction and vertical: against gravity, or z without gravity.
fn directions(world: &World, [around, above]: [f64; 2]) -> (Vec3, Vec3) {
    let up = (-world.gravity).normalize_or(Vec3::Z);
    // The horizontal axis nearest to x, and the one that completes a right-handed frame.
    let x = (Vec3::X - up.x * up).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let y = up.cross(x);
    let (around, above) = (around.to_radians(), above.clamp(-89.0, 89.0).to_radians());
    let towards_camera = above.cos() * (around.cos() * x + around.sin() * y) + above.sin() * up;
    (-towards_camera, up)
}

fn check(settings: &RenderSettings) -> Result<(), RenderError> {
    let RenderSettings { width, height, .. } = *settings;
    if !(64..=16384).contains(&width) || !(64..=16384).contains(&height) {
        return Err(RenderError::Size { width, height });
    }
    if !(settings.step > 0.0 && settings.step.is_finite()) {
        let remedy = "give the time step of the run in seconds";
        return Err(RenderError::Value { what: "time step", value: settings.step, remedy });
    }
    if let Some([low, high]) = settings.range
        && !(low < high && low.is_finite() && high.is_finite())
    {
        let remedy = "the range needs a smaller and a larger finite number";
        let value = if low.is_finite() { high } else { low };
        return Err(RenderError::Value { what: "end of the colour range", value, remedy });
    }
    if let Some(&value) = settings.view.iter().find(|angle| !angle.is_finite()) {
        return Err(RenderError::Value { what: "viewing angle", value, remedy: "give degrees" });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
