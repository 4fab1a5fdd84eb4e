//! From a [`Scene`] to the world, the step's settings, and what a run writes.

mod joints;
mod materials;
mod measures;
mod open_boundaries;
mod periodic;
mod relax;
mod room;
mod stages;

use super::Scene;
use super::error::{Location, SceneError, SceneErrorKind};
use super::mesh_file;
use super::model::{
    BodySpec, BoxSpec, CentralSpec, DragSpec, FunctionFile, FunctionSpec, GrainSpec, HalfSpaceSpec, HullSpec,
    LoadSpec, MeshSpec, MotionSpec, PackingSource, PackingSpec, PartSpec, PressureSpec, RadiusSpec,
    ShapeSpec,
};
use super::packing::{self, FileProblem, read_file, table_file};
use super::periodic::{DriveSpec, PeriodicSpec};
use super::quantity::Dimension;
use crate::measure::Measure;
use crate::open_boundaries::OpenBoundaries;
use crate::settings::OutputSettings;
use crate::stage::Stage;
use graintrain::collide::{deepest_overlap, meshes_that_meet};
use graintrain::error::ModelError;
use graintrain::handle::{BodyId, GeometryId, MaterialId, MotionId};
use graintrain::hull::Hull;
use graintrain::load::{Action, Load};
use graintrain::material::Materials;
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::{Axes, Motion, Profile, Rotation};
use graintrain::shape::{Cuboid, Geometry, HalfSpace, Mesh, Part, Shape};
use graintrain::stepper::StepSettings;
use graintrain::world::{Body, FREE, MassProperties, World};
use materials::materials;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Contact envelope as a fraction of the smallest radius: what bodies that rest are pushed by others within a
/// step, and few contacts without force. What closes by the bodies' own velocities is a contact anyway.
const ENVELOPE: f64 = 0.05;

/// Overlap accepted at the start, as a fraction of the smallest radius: what settled packings from other
/// programs have.
const ALLOWED_OVERLAP: f64 = 0.01;

/// Everything that a run needs.
#[derive(Clone, Debug)]
pub struct Simulation {
    /// The state at time 0.
    pub world: World,
    /// How steps are made.
    pub settings: StepSettings,
    /// Number of steps.
    pub steps: u64,
    /// What is written.
    pub output: OutputSettings,
    /// The stages.
    pub stages: Vec<Stage>,
    /// What is measured.
    pub measures: Vec<Measure>,
    /// Ways in and out for bodies.
    pub open_boundaries: OpenBoundaries,
    /// The scene with the defaults that depend on the bodies filled in; `resolved.to_toml()` belongs into the
    /// run's folder.
    pub resolved: Scene,
}

impl Scene {
    /// Makes the world and the settings of a run. Reads the files that the scene names.
    ///
    /// # Errors
    /// [`SceneError`] for a missing or damaged file, a packing that does not fit, no body that can move, or
    /// bodies that overlap at the start.
    pub fn build(&self) -> Result<Simulation, SceneError> {
        let mut resolved = self.clone();
        resolved.make_paths_absolute()?;
        let mut builder = Builder::new(self)?;
        for (name, body) in &self.bodies {
            builder.add_body(name, body)?;
        }
        for (name, packing) in &self.packings {
            builder.add_packing(name, packing, self)?;
        }
        for (name, load) in &self.loads {
            builder.add_load(name, load, self)?;
        }
        for (name, joint) in &self.joints {
            builder.add_joint(name, joint, &self.joints)?;
        }
        if let Some(periodic) = &self.periodic {
            builder.periodic(periodic, self.time.step)?;
        }
        let open_boundaries = builder.open_boundaries(self)?;
        let measures: Vec<Measure> = self
            .measures
            .iter()
            .map(|(name, spec)| builder.measure(name, spec, self))
            .collect::<Result<_, SceneError>>()?;
        let stages = builder.stages(self, &measures)?;
        let later_free = !builder.freed_by_stages(self).is_empty();
        let Builder { mut world, smallest_radius, origins, .. } = builder;
        if world.bodies.is_empty() && open_boundaries.streams.is_empty() {
            return Err(SceneError::new(SceneErrorKind::NoBodies, None));
        }
        if open_boundaries.streams.is_empty()
            && !later_free
            && !(0..world.bodies.len()).any(|body| !world.is_prescribed(body))
        {
            return Err(SceneError::new(SceneErrorKind::NothingMoves, None));
        }
        // Where nothing has a shape, nothing touches.
        let smallest_radius = if smallest_radius.is_finite() { smallest_radius } else { 1.0 };
        let envelope = *resolved.contact.envelope.get_or_insert(ENVELOPE * smallest_radius);
        let allowed = *resolved.contact.allowed_overlap.get_or_insert(ALLOWED_OVERLAP * smallest_radius);
        let resist = |stage: &Stage| stage.materials.as_ref().is_some_and(Materials::resist_turning);
        let resist = world.materials.resist_turning() || stages.iter().any(resist);
        if resist && self.solver.name.build().is_ok_and(|solver| !solver.capabilities().turning) {
            let problem = format!(
                "solver {} cannot treat the rolling or spinning friction of these materials; solver.name = \"auto\", \"apgd\", \"apgs\", \"pgs\" and \
                 \"pj\" can",
                self.solver.name
            );
            return Err(SceneError::new(SceneErrorKind::Contradiction(problem), None));
        }
        check_meshes(&world, &origins)?;
        if self.contact.relax {
            relax::relax(&mut world, envelope, allowed);
        }
        check_overlap(&world, &origins, allowed)?;
        let settings = StepSettings {
            step: self.time.step,
            envelope,
            solver: self.solver.clone(),
            overlap: self.contact.overlap,
        };
        let whole_steps = |time: f64| ((time / self.time.step).round() as u64).max(1);
        let output = OutputSettings {
            every: whole_steps(self.output.every),
            bodies: self.output.bodies,
            contacts: self.output.contacts,
            precision: self.output.precision,
            checkpoint_every: whole_steps(self.output.checkpoint_every),
        };
        Ok(Simulation {
            world,
            settings,
            steps: self.time.steps,
            output,
            stages,
            measures,
            open_boundaries,
            resolved,
        })
    }

    fn make_paths_absolute(&mut self) -> Result<(), SceneError> {
        let absolute = |path: &mut PathBuf, location: &Location| {
            *path = std::path::absolute(&*path).map_err(|error| {
                let kind = SceneErrorKind::UnreadableFile {
                    path: path.display().to_string(),
                    reason: error.to_string(),
                };
                SceneError::at(kind, location)
            })?;
            Ok(())
        };
        for (path, location) in self.shapes().filter_map(ShapeSpec::file_mut) {
            absolute(path, location)?;
        }
        for file in self.function_files() {
            absolute(&mut file.path, &file.location)?;
        }
        for (_, packing) in &mut self.packings {
            if let PackingSource::File(file) = &mut packing.source {
                absolute(&mut file.path, &file.location)?;
            }
        }
        Ok(())
    }
}

impl Scene {
    /// The shapes of all bodies, packings and streams.
    fn shapes(&mut self) -> impl Iterator<Item = &mut ShapeSpec> {
        let bodies = self.bodies.iter_mut().flat_map(|(_, body)| &mut body.parts);
        let packings = self.packings.iter_mut().map(|(_, packing)| &mut packing.grains);
        let grains = packings.chain(self.streams.iter_mut().map(|(_, stream)| &mut stream.grains));
        let grains = grains.flat_map(|GrainSpec { shape, parts, .. }| {
            shape.iter_mut().chain(parts.iter_mut().map(|part| &mut part.shape))
        });
        bodies.map(|part| &mut part.shape).chain(grains)
    }

    /// The files of all functions of time.
    fn function_files(&mut self) -> impl Iterator<Item = &mut FunctionFile> {
        let motions = self.bodies.iter_mut().flat_map(|(_, body)| {
            let MotionSpec { translation, rotation, .. } = &mut body.motion;
            let speeds = translation.iter_mut().map(|item| &mut item.speed);
            speeds.chain(rotation.iter_mut().map(|spin| &mut spin.speed))
        });
        let loads = self.loads.iter_mut().flat_map(|(_, load)| {
            let LoadSpec { force, torque, acceleration, pressure, .. } = load;
            let vectors = [force, torque, acceleration].into_iter().flatten().flatten();
            vectors.chain(pressure.iter_mut().map(|pressure| &mut pressure.stress))
        });
        let stages = self.stages.iter_mut().flat_map(|stage| {
            let speeds = stage.body.iter_mut().flat_map(|(_, body)| {
                let MotionSpec { translation, rotation, .. } = &mut body.motion;
                let speeds = translation.iter_mut().map(|item| &mut item.speed);
                speeds.chain(rotation.iter_mut().map(|spin| &mut spin.speed))
            });
            let cell = stage.periodic.iter_mut().flat_map(DriveSpec::functions);
            stage.gravity.iter_mut().flatten().chain(speeds).chain(cell)
        });
        let cell = self.periodic.iter_mut().flat_map(PeriodicSpec::functions);
        let joints = self.joints.iter_mut().flat_map(|(_, joint)| joint.functions());
        self.gravity
            .iter_mut()
            .chain(motions)
            .chain(loads)
            .chain(joints)
            .chain(stages)
            .chain(cell)
            .filter_map(|function| match function {
                FunctionSpec::File { file, .. } => Some(file),
                FunctionSpec::Profile(_) => None,
            })
    }
}

/// A world in the making.
struct Builder {
    world: World,
    /// Materials by name.
    materials: HashMap<String, MaterialId>,
    /// Geometries of spheres by the bits of their radius: equal spheres share one.
    spheres: HashMap<u64, GeometryId>,
    /// Motion of bodies with locked rotation, once there is one.
    locked_rotation: Option<MotionId>,
    /// Smallest size of a body that can move, m.
    smallest_radius: f64,
    /// Where bodies come from, in their order.
    origins: Vec<Origin>,
    /// Centres of mass of the single bodies in their frames, by their indices.
    centres: HashMap<usize, Vec3>,
    /// Names of the streams, once they are there.
    streams: Vec<String>,
}

/// A stretch of bodies that a body or packing of the scene made.
#[derive(Clone)]
struct Origin {
    /// Name of the body or packing.
    label: String,
    /// Index of the first of them.
    first: usize,
    is_packing: bool,
    location: Location,
}

/// An error for meshes near each other that would have to touch.
fn check_meshes(world: &World, origins: &[Origin]) -> Result<(), SceneError> {
    let Some([first, second]) = meshes_that_meet(world) else { return Ok(()) };
    let [first, second] = [first, second].map(|body| world.bodies.label(body));
    let problem = format!(
        "the bodies {first} and {second} are meshes near each other, one of which can move, but contacts between two meshes are not \
         computed; make one of them of other shapes"
    );
    let location = origins.last().map(|origin| &origin.location);
    Err(SceneError::new(SceneErrorKind::Contradiction(problem), location.cloned()))
}

/// An error for the deepest pair of bodies that overlap by more than allowed.
fn check_overlap(world: &World, origins: &[Origin], allowed: f64) -> Result<(), SceneError> {
    let Some(overlap) = deepest_overlap(world).filter(|overlap| overlap.depth > allowed) else {
        return Ok(());
    };
    let origin = |body: u32| {
        let after = origins.partition_point(|origin| origin.first <= body as usize);
        &origins[after - 1]
    };
    let label = |body: u32| {
        let origin = origin(body);
        if origin.is_packing {
            format!("number {} of packing `{}`", body as usize - origin.first + 1, origin.label)
        } else {
            format!("`{}`", origin.label)
        }
    };
    let kind = SceneErrorKind::Overlap {
        first: label(overlap.body_a),
        second: label(overlap.body_b),
        depth: overlap.depth,
        allowed,
    };
    Err(SceneError::at(kind, &origin(overlap.body_a).location))
}

fn model_error(error: ModelError, location: &Location) -> SceneError {
    SceneError::at(SceneErrorKind::Contradiction(error.to_string()), location)
}

impl Builder {
    fn new(scene: &Scene) -> Result<Self, SceneError> {
        let unplaced =
            |error: ModelError| SceneError::new(SceneErrorKind::Contradiction(error.to_string()), None);
        let (materials, index) = materials(scene, &scene.materials, None)?;
        let [x, y, z] = &scene.gravity;
        let gravity = [function(x)?, function(y)?, function(z)?];
        let initial = Vec3::from_array(gravity.each_ref().map(|profile| profile.mean(0.0, scene.time.step)));
        let mut world = World::new(initial, materials).map_err(unplaced)?;
        if gravity.iter().any(|profile| !matches!(profile, Profile::Constant(_))) {
            world.set_gravity_of_time(gravity).map_err(unplaced)?;
        }
        Ok(Self {
            world,
            materials: index,
            spheres: HashMap::new(),
            locked_rotation: None,
            smallest_radius: f64::INFINITY,
            origins: Vec::new(),
            centres: HashMap::new(),
            streams: Vec::new(),
        })
    }

    fn material(&self, name: &str) -> MaterialId {
        self.materials[name]
    }

    fn note_origin(&mut self, label: &str, is_packing: bool, location: &Location) {
        let first = self.world.bodies.len();
        self.origins.push(Origin { label: label.to_string(), first, is_packing, location: location.clone() });
    }

    fn add_body(&mut self, name: &str, spec: &BodySpec) -> Result<(), SceneError> {
        self.note_origin(name, false, &spec.location);
        let at = |error: ModelError| model_error(error, &spec.location);
        let (geometry, centre) = form_of(spec)?;
        let material = self.material(&spec.material);
        let volume = geometry.volume;
        let motion = self.motion(&spec.motion, centre, &spec.location)?;
        let rotation = spec.rotation.0;
        let (touches, size) = (!geometry.parts.is_empty(), half_thickness(&geometry));
        let mass = spec.inertia.zip(spec.mass).map(|(moments, mass)| {
            let [xy, xz, yz] = spec.products.unwrap_or_default().to_array();
            let columns = [[moments.x, xy, xz], [xy, moments.y, yz], [xz, yz, moments.z]];
            MassProperties { mass, inertia: Mat3::from_cols_array_2d(&columns) }
        });
        // Surfaces of a given mass have no thickness.
        let size = if size.is_finite() { size } else { geometry.bounding_radius() };
        let geometry = self.world.add_geometry(geometry);
        let body = self
            .world
            .add_body(Body {
                name: name.to_string(),
                motion,
                position: spec.position + rotation * centre,
                orientation: rotation,
                velocity: spec.velocity,
                angular_velocity: spec.angular_velocity,
                mass,
                ..Body::new(geometry, material, Vec3::ZERO)
            })
            .map_err(at)?
            .index();
        for other in &spec.ignores {
            let other = self.origins.iter().find(|origin| !origin.is_packing && origin.label == *other);
            let other = other.map_or(body, |origin| origin.first);
            let [a, b] = [other, body].map(BodyId::from_index);
            self.world.ignore_collisions(a, b).map_err(at)?;
        }
        self.centres.insert(body, centre);
        let default_mass = self.world.bodies.mass[body];
        let mass = spec.mass.or(spec.density.map(|density| density * volume));
        if let Some(mass) = mass.filter(|_| default_mass > 0.0 && spec.inertia.is_none()) {
            self.world.bodies.mass[body] = mass;
            self.world.bodies.inertia[body] *= mass / default_mass;
        }
        if touches && !self.world.is_prescribed(body) {
            self.smallest_radius = self.smallest_radius.min(size);
        }
        Ok(())
    }

    /// The motion of a body whose centre of mass is at `centre` in its frame, added to the world.
    fn motion(
        &mut self,
        spec: &MotionSpec,
        centre: Vec3,
        location: &Location,
    ) -> Result<MotionId, SceneError> {
        match motion_of(spec, centre)? {
            None => Ok(FREE),
            Some(motion) => self.world.add_motion(motion).map_err(|error| model_error(error, location)),
        }
    }

    fn add_packing(&mut self, name: &str, spec: &PackingSpec, scene: &Scene) -> Result<(), SceneError> {
        self.note_origin(name, true, &spec.location);
        let at = |error: ModelError| model_error(error, &spec.location);
        let material = self.material(&spec.grains.material);
        let geometry = form(spec.grains.shape.as_ref(), &spec.grains.parts, &spec.location)?;
        let size = geometry.as_ref().map(half_thickness);
        if let Some(least) = size.or(spec.grains.radius.as_ref().map(RadiusSpec::least)) {
            let allowed = scene.contact.allowed_overlap.unwrap_or(ALLOWED_OVERLAP * least);
            let own = material.index();
            // Elastic bodies may overlap, and nobody asks by how much.
            if self.world.materials.pair_elasticity(own, own).is_rigid() {
                room::check(name, spec, (least - 0.5 * allowed).max(0.0), scene.periodic.as_ref())?;
            }
        }
        let placed = packing::place(name, spec, geometry.as_ref().map(Geometry::bounding_radius))?;
        let shared = geometry.map(|geometry| self.world.add_geometry(geometry));
        let motion = if spec.grains.lock_rotation { self.locked_rotation().map_err(at)? } else { FREE };
        let mut orientations = packing::orientations(spec);
        for ((position, radius), velocity) in placed.position.iter().zip(&placed.radius).zip(&placed.velocity)
        {
            let geometry = match shared {
                Some(geometry) => geometry,
                None => self.sphere(*radius).map_err(at)?,
            };
            let orientation = orientations.next().unwrap_or(Quat::IDENTITY);
            let velocity = *velocity;
            let body = Body { motion, velocity, orientation, ..Body::new(geometry, material, *position) };
            self.world.add_body(body).map_err(at)?;
        }
        let sizes = placed.radius.iter().copied();
        self.smallest_radius = match size {
            Some(size) => self.smallest_radius.min(size),
            None => sizes.fold(self.smallest_radius, f64::min),
        };
        Ok(())
    }

    fn add_load(&mut self, name: &str, spec: &LoadSpec, scene: &Scene) -> Result<(), SceneError> {
        let bodies = self.bodies_named(&spec.bodies, &spec.packings);
        let freed = self.freed_by_stages(scene);
        let moves = |body: &BodyId| !self.world.is_prescribed(body.index()) || freed.contains(body);
        if bodies.as_ref().is_some_and(|bodies| !bodies.iter().any(moves)) {
            let problem =
                format!("`load.{name}` acts on nothing that can move: `free` its degrees of freedom");
            return Err(SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location));
        }
        let (axes, count) = (spec.axes, self.world.bodies.len());
        let along_axes = |functions: &[FunctionSpec; 3]| {
            let terms = [Vec3::X, Vec3::Y, Vec3::Z].into_iter().zip(functions);
            terms.map(|(axis, part)| Ok((axis, function(part)?))).collect::<Result<Vec<_>, SceneError>>()
        };
        let mut add = |bodies: Option<Vec<BodyId>>, action: Action| {
            let load = Load { bodies, region: spec.region.clone(), action };
            self.world.add_load(load).map_err(|error| model_error(error, &spec.location))
        };
        if let Some(force) = &spec.force {
            let terms = along_axes(force)?;
            match spec.point {
                None => add(bodies.clone(), Action::Force { terms, axes, point: Vec3::ZERO })?,
                // Bodies differ in where their frames are.
                Some(point) => {
                    let all = || (0..count).map(BodyId::from_index).collect();
                    for body in bodies.clone().unwrap_or_else(all) {
                        let centre = self.centres.get(&body.index()).copied().unwrap_or_default();
                        let action = Action::Force { terms: terms.clone(), axes, point: point - centre };
                        add(Some(vec![body]), action)?;
                    }
                }
            }
        }
        if let Some(torque) = &spec.torque {
            add(bodies.clone(), Action::Torque { terms: along_axes(torque)?, axes })?;
        }
        if let Some(PressureSpec { stress, area, direction }) = &spec.pressure {
            let terms = vec![(*area * *direction, function(stress)?)];
            add(bodies.clone(), Action::Force { terms, axes: Axes::World, point: Vec3::ZERO })?;
        }
        if let Some([x, y, z]) = &spec.acceleration {
            let acceleration = [function(x)?, function(y)?, function(z)?];
            add(bodies.clone(), Action::Uniform { acceleration })?;
        }
        if let Some(CentralSpec { point, strength, distance, power }) = spec.central {
            add(bodies.clone(), Action::Central { centre: point, strength, distance, power })?;
        }
        if let Some(DragSpec { linear, quadratic, angular, medium }) = spec.drag {
            add(bodies, Action::Drag { linear, quadratic, angular, medium })?;
        }
        Ok(())
    }

    /// The bodies of these names and of the packings of these, ascending; `None` where there are no names:
    /// all.
    fn bodies_named(&self, bodies: &[String], packings: &[String]) -> Option<Vec<BodyId>> {
        if bodies.is_empty() && packings.is_empty() {
            return None;
        }
        let ends = self.origins.iter().skip(1).map(|origin| origin.first).chain([self.world.bodies.len()]);
        let named = self.origins.iter().zip(ends).filter(|(origin, _)| {
            let names = if origin.is_packing { packings } else { bodies };
            names.contains(&origin.label)
        });
        Some(named.flat_map(|(origin, end)| origin.first..end).map(BodyId::from_index).collect())
    }

    fn sphere(&mut self, radius: f64) -> Result<GeometryId, ModelError> {
        if let Some(&geometry) = self.spheres.get(&radius.to_bits()) {
            return Ok(geometry);
        }
        let geometry = self.world.add_geometry(Geometry::sphere(radius)?);
        self.spheres.insert(radius.to_bits(), geometry);
        Ok(geometry)
    }

    fn locked_rotation(&mut self) -> Result<MotionId, ModelError> {
        if let Some(motion) = self.locked_rotation {
            return Ok(motion);
        }
        let motion = Motion::fixed().with_free([true, true, true, false, false, false]);
        let motion = self.world.add_motion(motion)?;
        self.locked_rotation = Some(motion);
        Ok(motion)
    }
}

/// The motion of a body whose centre of mass is at `centre` in its frame; `None` where it is free.
fn motion_of(spec: &MotionSpec, centre: Vec3) -> Result<Option<Motion>, SceneError> {
    if spec.free == [true; 6] {
        return Ok(None);
    }
    let delayed = |speed: &FunctionSpec| {
        let profile = function(speed)?;
        Ok(match spec.start {
            0.0 => profile,
            start => Profile::Delayed { start, profile: Box::new(profile) },
        })
    };
    let translation = spec
        .translation
        .iter()
        .map(|item| Ok((item.direction, delayed(&item.speed)?)))
        .collect::<Result<_, SceneError>>()?;
    let rotation = match &spec.rotation {
        None => None,
        Some(spin) => {
            let (point, of) = match spin.point {
                Some(point) => (point, Axes::World),
                None => (-centre, Axes::Body),
            };
            Some(Rotation { point, of, axis: spin.axis, profile: delayed(&spin.speed)? })
        }
    };
    Ok(Some(Motion { free: spec.free, translation, rotation }))
}

/// A function of time; reads its file where it has one.
fn function(spec: &FunctionSpec) -> Result<Profile, SceneError> {
    let (FunctionFile { path, time, value, location }, dimension) = match spec {
        FunctionSpec::Profile(profile) => return Ok(profile.clone()),
        FunctionSpec::File { file, dimension } => (file, dimension),
    };
    let bytes = read_file(path, location)?;
    let is_csv = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
    let read = || {
        let table = table_file::read(&bytes, is_csv.then_some(','), 0)?;
        let column = |name: &str, dimension: Dimension| {
            let found = table.column(&[name.to_lowercase().as_str()], dimension)?;
            found.ok_or_else(|| {
                FileProblem::at(table.header_line, format!("the header lacks the column `{name}`"))
            })
        };
        let profile =
            Profile::Table { times: column(time, Dimension::TIME)?, values: column(value, *dimension)? };
        profile.validate().map_err(|error| FileProblem::new(error.to_string()))?;
        Ok(profile)
    };
    read().map_err(|problem: FileProblem| problem.located(path, location))
}

/// The form of bodies that are not spheres.
fn form(
    single: Option<&ShapeSpec>,
    parts: &[PartSpec],
    location: &Location,
) -> Result<Option<Geometry>, SceneError> {
    let at = |error: ModelError| model_error(error, location);
    match single {
        Some(spec) => Ok(Some(Geometry::single(shape(spec)?.shape).map_err(at)?)),
        None if parts.is_empty() => Ok(None),
        None => {
            let parts = parts.iter().map(part).collect::<Result<Vec<_>, SceneError>>()?;
            Ok(Some(Geometry::compound(parts).map_err(at)?.0))
        }
    }
}

/// Half the smallest extent of the parts of a geometry, m.
fn half_thickness(geometry: &Geometry) -> f64 {
    geometry.parts.iter().map(|part| part.shape.half_thickness()).fold(f64::INFINITY, f64::min)
}

/// A part with its shape in the form of the geometry, which has planes only with the normal z.
/// The form of a body, and its centre of mass in the frame in which the scene describes it.
fn form_of(spec: &BodySpec) -> Result<(Geometry, Vec3), SceneError> {
    let parts = spec.parts.iter().map(part).collect::<Result<Vec<_>, SceneError>>()?;
    let (geometry, centre) = if parts.is_empty() {
        (Geometry::formless(), Vec3::ZERO)
    } else {
        Geometry::compound(parts).map_err(|error| model_error(error, &spec.location))?
    };
    Ok(match spec.centre {
        Some(given) => (geometry.about(given - centre), given),
        None => (geometry, centre),
    })
}

fn part(spec: &PartSpec) -> Result<Part, SceneError> {
    let Part { shape, position, orientation } = shape(&spec.shape)?;
    Ok(Part {
        shape,
        position: spec.position + spec.rotation.0 * position,
        orientation: spec.rotation.0 * orientation,
    })
}

/// The shape in the frame in which the scene describes it.
fn shape(spec: &ShapeSpec) -> Result<Part, SceneError> {
    let at = |shape, position, orientation| Part { shape, position, orientation };
    let shape = match *spec {
        ShapeSpec::Lengths(ref spec) => {
            let made = spec.form.shape(&spec.lengths);
            made.map_err(|error| SceneError::new(SceneErrorKind::Contradiction(error.to_string()), None))?
        }
        ShapeSpec::Box(BoxSpec { size }) => Shape::Box(Cuboid { half: 0.5 * size }),
        ShapeSpec::Plane(HalfSpaceSpec { normal }) => {
            return Ok(at(Shape::Plane(HalfSpace), Vec3::ZERO, Quat::from_rotation_arc(Vec3::Z, normal)));
        }
        ShapeSpec::Hull(ref spec) => {
            let (hull, centre) = hull(spec)?;
            return Ok(at(Shape::Hull(hull), centre, Quat::IDENTITY));
        }
        ShapeSpec::Mesh(ref mesh) => mesh_shape(mesh)?,
    };
    Ok(at(shape, Vec3::ZERO, Quat::IDENTITY))
}

/// The hull and its centre of volume in the frame of the points.
fn hull(spec: &HullSpec) -> Result<(Hull, Vec3), SceneError> {
    let read;
    let points = match &spec.file {
        None => &spec.points,
        Some(path) => {
            read = read_mesh(path, &spec.location)?.vertices;
            &read
        }
    };
    let mut points: Vec<Vec3> = points.iter().map(|point| spec.scale * point).collect();
    if let Some(corners) = spec.corners {
        points = Hull::outermost(&points, corners as usize);
    }
    Hull::new(&points).map_err(|error| model_error(error, &spec.location))
}

fn read_mesh(path: &Path, location: &Location) -> Result<mesh_file::Triangles, SceneError> {
    let bytes = read_file(path, location)?;
    mesh_file::read(path, &bytes).map_err(|problem| problem.located(path, location))
}

fn mesh_shape(mesh: &MeshSpec) -> Result<Shape, SceneError> {
    let (vertices, triangles) = match &mesh.file {
        None => (mesh.vertices.clone(), mesh.triangles.clone()),
        Some(path) => {
            let read = read_mesh(path, &mesh.location)?;
            (read.vertices, read.triangles)
        }
    };
    Ok(Shape::Mesh(Mesh {
        vertices: vertices.into_iter().map(|vertex| vertex * mesh.scale).collect(),
        triangles,
        solid: mesh.solid,
    }))
}
