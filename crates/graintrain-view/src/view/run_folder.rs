//! A run's folder as a sequence of worlds.

use super::vtp_file::VtpFile;
use super::{ViewError, read_text};
use graintrain::contact::{Contact, ContactSet};
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::shape::{Geometry, Shape};
use graintrain::world::World;
use graintrain_io::checkpoint;
use graintrain_io::output::surfaces::surface;
use std::path::{Path, PathBuf};

/// The frames of a run. Geometries, materials and motions come from its last checkpoint, poses, velocities and contacts
/// from its frames.
pub struct RunFolder {
    /// The scene's name.
    pub scene: String,
    /// Time step, s.
    pub step: f64,
    /// The state of the last checkpoint.
    pub last: World,
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
        Ok(Self {
            scene: checkpoint.settings.scene,
            step: checkpoint.settings.stepping.step,
            last: checkpoint.world,
            folder: folder.to_path_buf(),
            frames,
        })
    }

    /// Times of the frames, s, ascending.
    pub fn times(&self) -> Vec<f64> {
        self.frames.iter().map(|frame| frame.time).collect()
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// The world of a frame (its index in [`Self::times`]), to the precision of the files.
    ///
    /// # Errors
    /// [`ViewError`] where a file is missing or damaged.
    pub fn world(&self, index: usize) -> Result<World, ViewError> {
        let frame = &self.frames[index];
        let mut world = self.last.clone();
        world.time = frame.time;
        world.contacts = ContactSet::default();
        self.place_particles(&mut world, &VtpFile::read(&self.folder.join(&frame.bodies))?)?;
        for file in &frame.surfaces {
            place_surfaces(&mut world, &VtpFile::read(&self.folder.join(file))?)?;
        }
        if let Some(file) = &frame.contacts {
            world.contacts = self.contacts(&world, &VtpFile::read(&self.folder.join(file))?)?;
        }
        Ok(world)
    }

    fn place_particles(&self, world: &mut World, file: &VtpFile) -> Result<(), ViewError> {
        let count = world.bodies.len();
        let bodies = file.indices("body", count)?;
        let (points, velocity, omega) = (file.vectors("Points")?, file.vectors("v")?, file.vectors("omega")?);
        let turns = file.numbers("quat")?;
        if [points.len(), velocity.len(), omega.len(), turns.len() / 4].iter().any(|&n| n != bodies.len()) {
            return Err(file.malformed("its arrays differ in length".into()));
        }
        let mut placed = vec![false; count];
        for (k, &body) in bodies.iter().enumerate() {
            // Only the first point of a body: the others are further parts.
            if std::mem::replace(&mut placed[body], true) {
                continue;
            }
            let geometry = &world.geometries[world.bodies.geometry[body].index()];
            let turn = Quat::from_slice(&turns[4 * k..4 * k + 4]).normalize();
            let arm = turn * point_of_body(geometry);
            world.bodies.orientation[body] = turn;
            world.bodies.position[body] = points[k] - arm;
            world.bodies.velocity[body] = velocity[k] - omega[k].cross(arm);
            world.bodies.angular_velocity[body] = omega[k];
        }
        Ok(())
    }

    fn contacts(&self, world: &World, file: &VtpFile) -> Result<ContactSet, ViewError> {
        let count = world.bodies.len();
        let (a, b) = (file.indices("id1", count)?, file.indices("id2", count)?);
        let (force, normal) = (file.vectors("force")?, file.vectors("n")?);
        let (gap, friction) = (file.numbers("gap")?, file.numbers("mu")?);
        let points = file.vectors("Points")?;
        let corners = file.indices("connectivity", points.len())?;
        let ends = file.indices("offsets", corners.len() + 1)?;
        let lengths = [b.len(), force.len(), normal.len(), gap.len(), friction.len(), ends.len()];
        if lengths.iter().any(|&n| n != a.len()) {
            return Err(file.malformed("its arrays differ in length".into()));
        }
        let mut set = ContactSet { friction: friction.to_vec(), ..ContactSet::default() };
        let mut first = 0;
        for k in 0..a.len() {
            // The contact point follows the centre of body A, which is left out where it cannot move.
            let corner = first + usize::from(world.free_degrees(a[k]).contains(&true));
            if corner >= ends[k] {
                return Err(file.malformed(format!("line {k} has too few points")));
            }
            set.contacts.push(Contact {
                body_a: a[k] as u32,
                body_b: b[k] as u32,
                identity: 0,
                point: points[corners[corner]],
                normal: normal[k],
                gap: gap[k],
                lead: Vec3::ZERO,
            });
            set.impulse.push(force[k] * self.step);
            first = ends[k];
        }
        Ok(set)
    }
}

/// Where the first point of a body lies in its frame: at its first sphere, else at its centre.
fn point_of_body(geometry: &Geometry) -> Vec3 {
    let sphere = geometry.parts.iter().find(|part| matches!(part.shape, Shape::Sphere { .. }));
    sphere.map_or(Vec3::ZERO, |part| part.position)
}

/// Poses of the bodies that have no point of their own, from the first triangle of each.
fn place_surfaces(world: &mut World, file: &VtpFile) -> Result<(), ViewError> {
    let owners = file.indices("body_id", world.bodies.len())?;
    let points = file.vectors("Points")?;
    let corners = file.indices("connectivity", points.len())?;
    if corners.len() != 3 * owners.len() {
        return Err(file.malformed("its cells are not triangles".into()));
    }
    let mut placed = vec![false; world.bodies.len()];
    for (triangle, &body) in corners.chunks_exact(3).zip(&owners) {
        if std::mem::replace(&mut placed[body], true) || world.free_degrees(body).contains(&true) {
            continue;
        }
        let geometry = &world.geometries[world.bodies.geometry[body].index()];
        // A plane's patch follows the scene: it says nothing about the body's pose.
        if geometry.parts.iter().any(|part| part.shape == Shape::Plane) {
            continue;
        }
        let Some((part, template)) =
            geometry.parts.iter().find_map(|part| surface(&part.shape).map(|template| (part, template)))
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
    Ok(entries
        .filter_map(|node| {
            Some((node.attribute("timestep")?.parse().ok()?, node.attribute("file")?.to_string()))
        })
        .collect())
}
