//! A run's folder as a sequence of worlds.

use super::vtp_file::VtpFile;
use super::{ViewError, read_text};
use graintrain::contact::{Contact, ContactSet};
use graintrain::handle::{GeometryId, MaterialId};
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::shape::{Geometry, HalfSpace, Shape};
use graintrain::world::{Body, World};
use graintrain_io::body_numbers::BodyNumbers;
use graintrain_io::checkpoint;
use graintrain_io::files::within;
use graintrain_io::output::exchange::{ARRAYS, Array, Snapshot};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// The frames of a run. Geometries, materials and motions come from its last checkpoint, poses, velocities
/// and contacts from its frames.
pub struct RunFolder {
    /// The scene's name.
    pub scene: String,
    /// Time step, s.
    pub step: f64,
    /// The state of the last checkpoint, with all bodies that were there in a frame.
    pub last: World,
    /// Their indices by number; `None` where the number of bodies does not change.
    numbered: Option<HashMap<usize, usize>>,
    folder: PathBuf,
    frames: Vec<Frame>,
}

/// Files of one frame, relative to the folder.
#[derive(Default)]
struct Frame {
    time: f64,
    bodies: String,
    surfaces: Vec<String>,
    contacts: Option<String>,
}

impl RunFolder {
    /// Opens the folder of a run, finished or not.
    ///
    /// # Errors
    /// [`ViewError`] where there is no checkpoint in it or its lists of frames are damaged.
    pub fn open(folder: &Path) -> Result<Self, ViewError> {
        let (checkpoint, _) = checkpoint::latest(&folder.join("checkpoints"))?;
        let mut frames: Vec<Frame> = list(folder, "bodies.pvd")?
            .into_iter()
            .map(|(time, bodies)| Frame { time, bodies, ..Frame::default() })
            .collect();
        for (time, file) in list(folder, "surfaces.pvd")? {
            if let Some(frame) = frames.iter_mut().find(|frame| frame.time == time) {
                frame.surfaces.push(file);
            }
        }
        for (time, file) in list(folder, "contacts.pvd")? {
            if let Some(frame) = frames.iter_mut().find(|frame| frame.time == time) {
                frame.contacts = Some(file);
            }
        }
        let changes_bodies = checkpoint.settings.open_boundaries.changes_bodies();
        let numbers = checkpoint.totals.open_boundaries.numbers;
        let mut run = Self {
            scene: checkpoint.settings.scene,
            step: checkpoint.settings.stepping.step,
            last: checkpoint.world,
            numbered: None,
            folder: folder.to_path_buf(),
            frames,
        };
        if changes_bodies {
            run.collect_bodies(&numbers)?;
        }
        Ok(run)
    }

    /// Adds all bodies that were there in a frame and are not in the last checkpoint.
    fn collect_bodies(&mut self, numbers: &BodyNumbers) -> Result<(), ViewError> {
        let mut numbered: HashMap<usize, usize> =
            (0..self.last.bodies.len()).map(|body| (numbers.number(body) as usize, body)).collect();
        for frame in &self.frames {
            // A damaged frame is reported where it is asked for; the others can be drawn.
            let Ok(file) = VtpFile::read(&self.folder.join(&frame.bodies)) else { continue };
            let numbers = file.indices("body", MOST_NUMBERS)?;
            // Before the first body comes, frames name no forms.
            if numbers.is_empty() {
                continue;
            }
            let geometries = file.indices("geometry", MOST_NUMBERS)?;
            let materials = file.indices("type", self.last.materials.names.len())?;
            let points = file.vectors("Points")?;
            if [geometries.len(), materials.len(), points.len()].iter().any(|&n| n != numbers.len()) {
                return Err(file.malformed("its arrays differ in length".into()));
            }
            for (k, number) in numbers.into_iter().enumerate() {
                // Forms that came after the last checkpoint are unknown: their bodies are left out.
                if numbered.contains_key(&number) || geometries[k] >= self.last.geometries.len() {
                    continue;
                }
                let (geometry, material) =
                    (GeometryId::from_index(geometries[k]), MaterialId::from_index(materials[k]));
                let added = self.last.add_body(Body::new(geometry, material, points[k]));
                let body = added.map_err(|error| file.malformed(error.to_string()))?;
                numbered.insert(number, body.index());
            }
        }
        self.numbered = Some(numbered);
        Ok(())
    }

    /// Times of the frames, s, ascending.
    pub fn times(&self) -> Vec<f64> {
        self.frames.iter().map(|frame| frame.time).collect()
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// The world of a frame (its index in [`Self::times`]), to the precision of the files, with the bodies
    /// that were there.
    ///
    /// # Errors
    /// [`ViewError`] where a file is missing or damaged.
    pub fn world(&self, index: usize) -> Result<World, ViewError> {
        let (mut world, present) = self.world_of_all(index)?;
        if present.contains(&false) {
            world.remove_bodies(|body| !present[body]);
        }
        Ok(world)
    }

    /// The world of a frame with all bodies that are there in some frame, and whether they are in this one.
    ///
    /// # Errors
    /// As [`Self::world`].
    pub fn world_of_all(&self, index: usize) -> Result<(World, Vec<bool>), ViewError> {
        let frame = &self.frames[index];
        let mut world = self.last.clone();
        world.time = frame.time;
        world.contacts = ContactSet::default();
        let mut placed =
            self.place_particles(&mut world, &VtpFile::read(&self.folder.join(&frame.bodies))?)?;
        for file in &frame.surfaces {
            self.place_surfaces(&mut world, &VtpFile::read(&self.folder.join(file))?, &mut placed)?;
        }
        if let Some(file) = &frame.contacts {
            world.contacts = self.contacts(&world, &VtpFile::read(&self.folder.join(file))?)?;
        }
        let stays = |body: usize| self.numbered.is_none() || world.is_prescribed(body);
        let present = placed.into_iter().enumerate().map(|(body, placed)| placed || stays(body)).collect();
        Ok((world, present))
    }

    /// The points of a frame (its index in [`Self::times`]) with their arrays, for other programs.
    ///
    /// # Errors
    /// As [`Self::world`].
    pub fn snapshot(&self, index: usize) -> Result<Snapshot, ViewError> {
        let frame = &self.frames[index];
        let file = VtpFile::read(&self.folder.join(&frame.bodies))?;
        let position = file.vectors("Points")?;
        let arrays = ARRAYS.into_iter().map(|(name, components, is_whole)| {
            let values = file.numbers(name)?.to_vec();
            if values.len() != components * position.len() {
                return Err(file.malformed(format!("array {name} has {} numbers", values.len())));
            }
            Ok(Array { name, components, is_whole, values })
        });
        let digits: String = frame.bodies.chars().filter(char::is_ascii_digit).collect();
        Ok(Snapshot {
            time: frame.time,
            step: digits.parse().unwrap_or(0),
            arrays: arrays.collect::<Result<_, ViewError>>()?,
            position,
            cell: file.cell()?,
        })
    }

    /// Bodies that a file names by their numbers, as indices; `None` for those that are unknown.
    fn bodies(&self, world: &World, file: &VtpFile, array: &str) -> Result<Vec<Option<usize>>, ViewError> {
        Ok(match &self.numbered {
            None => file.indices(array, world.bodies.len())?.into_iter().map(Some).collect(),
            Some(numbered) => {
                let numbers = file.indices(array, MOST_NUMBERS)?;
                numbers.iter().map(|number| numbered.get(number).copied()).collect()
            }
        })
    }

    /// Places the bodies of a frame; returned is which these are.
    fn place_particles(&self, world: &mut World, file: &VtpFile) -> Result<Vec<bool>, ViewError> {
        let count = world.bodies.len();
        let bodies = self.bodies(world, file, "body")?;
        let (points, velocity, omega) = (file.vectors("Points")?, file.vectors("v")?, file.vectors("omega")?);
        let (turns, radii) = (file.numbers("quat")?, file.numbers("radius")?);
        let lengths = [points.len(), velocity.len(), omega.len(), turns.len() / 4, radii.len()];
        if lengths.iter().any(|&n| n != bodies.len()) {
            return Err(file.malformed("its arrays differ in length".into()));
        }
        let mut placed = vec![false; count];
        let mut sized: HashMap<(usize, u64), GeometryId> = HashMap::new();
        for (k, body) in bodies.iter().enumerate() {
            let Some(body) = *body else { continue };
            // Only the first point of a body: the others are further parts.
            if std::mem::replace(&mut placed[body], true) {
                continue;
            }
            let form = world.bodies.geometry[body];
            let factor = radii[k] / radius_of_body(&world.geometries[form.index()]);
            if (factor - 1.0).abs() > SAME_SIZE && factor.is_finite() && factor > 0.0 {
                // It has grown since.
                let key = (form.index(), radii[k].to_bits());
                let resized = match sized.get(&key) {
                    Some(resized) => *resized,
                    None => {
                        let smaller = world.geometries[form.index()].scaled(factor);
                        let smaller = smaller.map_err(|error| file.malformed(error.to_string()))?;
                        *sized.entry(key).or_insert(world.add_geometry(smaller))
                    }
                };
                world.bodies.geometry[body] = resized;
                world.bodies.mass[body] *= factor.powi(3);
                world.bodies.inertia[body] *= factor.powi(5);
            }
            let geometry = &world.geometries[world.bodies.geometry[body].index()];
            let turn = Quat::from_slice(&turns[4 * k..4 * k + 4]).normalize();
            let arm = turn * point_of_body(geometry);
            world.bodies.orientation[body] = turn;
            world.bodies.position[body] = points[k] - arm;
            world.bodies.velocity[body] = velocity[k] - omega[k].cross(arm);
            world.bodies.angular_velocity[body] = omega[k];
        }
        Ok(placed)
    }

    fn contacts(&self, world: &World, file: &VtpFile) -> Result<ContactSet, ViewError> {
        let (a, b) = (self.bodies(world, file, "id1")?, self.bodies(world, file, "id2")?);
        let (force, normal) = (file.vectors("force")?, file.vectors("n")?);
        let (gap, friction) = (file.numbers("gap")?, file.numbers("mu")?);
        let points = file.vectors("Points")?;
        let corners = file.indices("connectivity", points.len())?;
        let ends = file.indices("offsets", corners.len() + 1)?;
        let lengths = [b.len(), force.len(), normal.len(), gap.len(), friction.len(), ends.len()];
        if lengths.iter().any(|&n| n != a.len()) {
            return Err(file.malformed("its arrays differ in length".into()));
        }
        let mut set = ContactSet::default();
        let mut first = 0;
        for k in 0..a.len() {
            let (Some(body_a), Some(body_b)) = (a[k], b[k]) else {
                first = ends[k];
                continue;
            };
            // A line leads from body A over the contact point to body B.
            let corner = first + 1;
            if corner >= ends[k] {
                return Err(file.malformed(format!("line {k} has too few points")));
            }
            set.contacts.push(Contact {
                body_a: body_a as u32,
                body_b: body_b as u32,
                identity: 0,
                point: points[corners[corner]],
                normal: normal[k],
                gap: gap[k],
                lead: Vec3::ZERO,
                image: [0; 3],
            });
            set.impulse.push(force[k] * self.step);
            set.friction.push(friction[k]);
            first = ends[k];
        }
        Ok(set)
    }

    /// Poses of the bodies that have no point of their own in this frame, from the first triangle of each.
    fn place_surfaces(
        &self,
        world: &mut World,
        file: &VtpFile,
        placed: &mut [bool],
    ) -> Result<(), ViewError> {
        let owners = self.bodies(world, file, "body_id")?;
        let points = file.vectors("Points")?;
        let corners = file.indices("connectivity", points.len())?;
        if corners.len() != 3 * owners.len() {
            return Err(file.malformed("its cells are not triangles".into()));
        }
        for (triangle, body) in corners.chunks_exact(3).zip(&owners) {
            let Some(body) = *body else { continue };
            if std::mem::replace(&mut placed[body], true) {
                continue;
            }
            let geometry = &world.geometries[world.bodies.geometry[body].index()];
            // A plane's patch follows the scene: it says nothing about the body's pose.
            if geometry.parts.iter().any(|part| part.shape == Shape::Plane(HalfSpace)) {
                continue;
            }
            let Some((part, template)) =
                geometry.parts.iter().find_map(|part| part.shape.surface().map(|template| (part, template)))
            else {
                continue;
            };
            let own = template.triangles[0]
                .map(|corner| part.position + part.orientation * template.vertices[corner as usize]);
            let seen = [0, 1, 2].map(|k| points[triangle[k]]);
            if let (Some(from), Some(to)) = (frame(own), frame(seen)) {
                let turn = Quat::from_mat3(&(to * from.transpose())).normalize();
                world.bodies.orientation[body] = turn;
                world.bodies.position[body] = seen[0] - turn * own[0];
            }
        }
        Ok(())
    }
}

/// Handles of bodies have 32 bits.
const MOST_NUMBERS: usize = u32::MAX as usize;

/// Where the first point of a body lies in its frame: at its first sphere, else at its centre.
fn point_of_body(geometry: &Geometry) -> Vec3 {
    let sphere = geometry.parts.iter().find(|part| matches!(part.shape, Shape::Sphere(_)));
    sphere.map_or(Vec3::ZERO, |part| part.position)
}

/// Relative difference of sizes that the single precision of frames makes.
const SAME_SIZE: f64 = 1e-6;

/// The radius that frames give the first point of a body: of its first sphere, else of the largest ball
/// inside all parts.
fn radius_of_body(geometry: &Geometry) -> f64 {
    let spheres = geometry.parts.iter().filter(|part| matches!(part.shape, Shape::Sphere(_)));
    let first = spheres.map(|part| part.shape.inscribed_radius()).next();
    let smallest =
        || geometry.parts.iter().map(|part| part.shape.inscribed_radius()).fold(f64::INFINITY, f64::min);
    first.unwrap_or_else(smallest)
}

/// Orthonormal axes along a triangle's first edge, in its plane, and normal to it.
fn frame([a, b, c]: [Vec3; 3]) -> Option<Mat3> {
    let x = (b - a).try_normalize()?;
    let z = x.cross(c - a).try_normalize()?;
    Some(Mat3::from_cols(x, z.cross(x), z))
}

/// Times and files of a `.pvd` list; empty where there is none.
fn list(folder: &Path, name: &str) -> Result<Vec<(f64, String)>, ViewError> {
    let path = folder.join(name);
    if !path.exists() {
        return Ok(Vec::new());
    }
    let text = read_text(&path)?;
    let document = roxmltree::Document::parse(&text)
        .map_err(|error| ViewError::Malformed { path: path.clone(), what: error.to_string() })?;
    let entries = document.descendants().filter(|node| node.has_tag_name("DataSet"));
    let entries = entries.filter_map(|node| {
        Some((node.attribute("timestep")?.parse().ok()?, node.attribute("file")?.to_string()))
    });
    let entries: Vec<(f64, String)> = entries.collect();
    match entries.iter().find(|(_, file)| within(folder, file).is_none()) {
        Some((_, file)) => {
            let what = format!("it names {file:?}, which is no file of the run");
            Err(ViewError::Malformed { path, what })
        }
        None => Ok(entries),
    }
}
