//! Worlds built in code: materials, bodies, loads.

use crate::arrays::{shaped, vector, vectors};
use crate::error::OrRaise;
use crate::model::{Motion, Shape, profile};
use crate::world::World;
use graintrain::handle::{BodyId, GeometryId, MaterialId};
use graintrain::load::{Action, Load, Region};
use graintrain::material::{Elasticity, TurningResistance};
use graintrain::math::{Mat3, Quat, Vec3};
use graintrain::motion::{Axes, Profile};
use graintrain::shape::Geometry;
use graintrain::world::{Body, FREE, MassProperties};
use graintrain_io::scene::turning_resistance;
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyRange};

impl World {
    fn geometry_of(&mut self, shape: &Shape) -> GeometryId {
        if let Some(&known) = self.geometries.get(&shape.number) {
            return known;
        }
        let id = self.state().add_geometry(shape.geometry.clone());
        self.geometries.insert(shape.number, id);
        id
    }

    /// A material by its name; the first one where none is named.
    fn material_of(&mut self, name: Option<&str>) -> PyResult<MaterialId> {
        let materials = &self.state().materials;
        let Some(name) = name else { return Ok(MaterialId::default()) };
        let found = materials.names.iter().position(|known| known == name);
        found.map(MaterialId::from_index).ok_or_else(|| {
            PyKeyError::new_err(format!(
                "there is no material named '{name}'; known: {}",
                materials.names.join(", ")
            ))
        })
    }

    /// Adds bodies that differ in place, form and velocity alone; all or none.
    fn add_all(
        &mut self,
        like: &Body,
        motion: Option<&Motion>,
        bodies: impl ExactSizeIterator<Item = Body>,
    ) -> PyResult<(usize, usize)> {
        let state = self.resize()?;
        let motion = motion.map_or(Ok(FREE), |motion| state.add_motion(motion.motion.clone())).or_raise()?;
        let (before, mut failure) = (state.bodies.len(), None);
        for body in bodies {
            if let Err(error) = state.add_body(Body { motion, material: like.material, ..body }) {
                failure = Some(error);
                break;
            }
        }
        if let Some(error) = failure {
            state.remove_bodies(|body| body >= before);
            return Err(error).or_raise();
        }
        Ok((before, state.bodies.len()))
    }

    /// The bodies of a load: None for all, one, or a list.
    fn loaded(&mut self, bodies: Option<&Bound<'_, PyAny>>) -> PyResult<Option<Vec<BodyId>>> {
        let Some(bodies) = bodies else { return Ok(None) };
        if let Ok(index) = self.index_of(bodies) {
            return Ok(Some(vec![BodyId::from_index(index)]));
        }
        if bodies.extract::<String>().is_ok() || bodies.extract::<i64>().is_ok() {
            // Says what is wrong with it.
            self.index_of(bodies)?;
        }
        let several = bodies.try_iter()?;
        several.map(|body| Ok(BodyId::from_index(self.index_of(&body?)?))).collect::<PyResult<_>>().map(Some)
    }

    fn load(
        &mut self,
        bodies: Option<&Bound<'_, PyAny>>,
        region: Option<&Bound<'_, PyDict>>,
        action: Action,
    ) -> PyResult<()> {
        let load = Load { bodies: self.loaded(bodies)?, region: region.map(region_of).transpose()?, action };
        self.state().add_load(load).or_raise()
    }
}

/// {"min": .., "max": ..} or {"base": .., "radius": .., "height": ..}.
fn region_of(region: &Bound<'_, PyDict>) -> PyResult<Region> {
    let get = |key: &str| region.get_item(key);
    if let (Some(min), Some(max), 2) = (get("min")?, get("max")?, region.len()) {
        return Ok(Region::Box { min: vector("region.min", &min)?, max: vector("region.max", &max)? });
    }
    if let (Some(base), Some(radius), Some(height), 3) =
        (get("base")?, get("radius")?, get("height")?, region.len())
    {
        let base = vector("region.base", &base)?;
        return Ok(Region::Cylinder { base, radius: radius.extract()?, height: height.extract()? });
    }
    Err(PyValueError::new_err(
        "a region is {\"min\": (x, y, z), \"max\": (x, y, z)} or {\"base\": (x, y, z), \"radius\": r, \"height\": h}",
    ))
}

fn axes_of(name: &str) -> PyResult<Axes> {
    match name {
        "world" => Ok(Axes::World),
        "body" => Ok(Axes::Body),
        _ => Err(PyValueError::new_err(format!("axes = '{name}': choose world or body"))),
    }
}

/// What is multiplied by a vector: 1 unless a function is given.
fn factor(function: Option<&Bound<'_, PyAny>>) -> PyResult<Profile> {
    function.map_or(Ok(Profile::Constant(1.0)), |function| profile("function", function))
}

/// Resistance to turning as given; as it was where it is not.
fn resistance(
    what: &str,
    given: Option<&Bound<'_, PyAny>>,
    before: TurningResistance,
) -> PyResult<TurningResistance> {
    let Some(given) = given else { return Ok(before) };
    match given.extract::<String>() {
        Ok(text) => turning_resistance(&text)
            .map_err(|problem| PyValueError::new_err(format!("{what} = '{text}': {problem}"))),
        Err(_) => Ok(TurningResistance::Ratio(given.extract()?)),
    }
}

#[pymethods]
impl World {
    /// Adds a material: density (kg/m^3), friction and restitution of its own pairs. With another material
    /// the smaller ones of both hold, until set_pair says otherwise. The material "default" is there from the
    /// beginning.
    #[pyo3(signature = (name, density, friction=0.25, restitution=0.0))]
    fn add_material(&mut self, name: &str, density: f64, friction: f64, restitution: f64) -> PyResult<()> {
        let materials = &mut self.state().materials;
        let mut grown = materials.clone();
        let new = grown.add(name, density).or_raise()?;
        grown.set_pair(new, new, friction, restitution).or_raise()?;
        for other in grown.handles().filter(|&other| other != new) {
            let (own, index) = (other.index(), new.index());
            let least = |of: fn(&_, usize, usize) -> f64| of(&grown, own, own).min(of(&grown, index, index));
            let (friction, restitution) = (
                least(graintrain::material::Materials::pair_friction),
                least(graintrain::material::Materials::pair_restitution),
            );
            grown.set_pair(new, other, friction, restitution).or_raise()?;
        }
        *materials = grown;
        Ok(())
    }

    /// Sets friction and restitution between two materials (or of one with itself), and, where given, how
    /// they resist rolling on each other and spinning about the contact normal: a number of effective radii,
    /// or a length as a text ("1 mm"); their normal stiffness (N/m, 0: rigid) and damping (N s/m) per
    /// contact; and the force (N) with which they pull each other while they touch.
    #[pyo3(signature = (first, second, friction, restitution=0.0, *, rolling_friction=None, spinning_friction=None, stiffness=None,
        damping=None, cohesion=None))]
    fn set_pair(
        &mut self,
        first: &str,
        second: &str,
        friction: f64,
        restitution: f64,
        rolling_friction: Option<&Bound<'_, PyAny>>,
        spinning_friction: Option<&Bound<'_, PyAny>>,
        stiffness: Option<f64>,
        damping: Option<f64>,
        cohesion: Option<f64>,
    ) -> PyResult<()> {
        let (first, second) = (self.material_of(Some(first))?, self.material_of(Some(second))?);
        let materials = &mut self.state().materials;
        let (i, j) = (first.index(), second.index());
        let rolling = resistance("rolling_friction", rolling_friction, materials.pair_rolling(i, j))?;
        let spinning = resistance("spinning_friction", spinning_friction, materials.pair_spinning(i, j))?;
        let known = materials.pair_elasticity(i, j);
        let stiffness = stiffness.unwrap_or(known.stiffness);
        let kept = if stiffness == 0.0 { 0.0 } else { known.damping };
        let elasticity = Elasticity { stiffness, damping: damping.unwrap_or(kept) };
        let cohesion = cohesion.unwrap_or(materials.pair_cohesion(i, j));
        // All or nothing. What was elastic may become rigid with restitution, and the other way round.
        let mut changed = materials.clone();
        changed.set_pair_elasticity(first, second, Elasticity::RIGID).or_raise()?;
        changed.set_pair(first, second, friction, restitution).or_raise()?;
        changed.set_pair_elasticity(first, second, elasticity).or_raise()?;
        changed.set_pair_cohesion(first, second, cohesion).or_raise()?;
        changed.set_pair_turning(first, second, rolling, spinning).or_raise()?;
        *materials = changed;
        Ok(())
    }

    /// Names of the materials.
    #[getter]
    fn materials(&mut self) -> Vec<String> {
        self.state().materials.names.clone()
    }

    /// Friction of a material with another, or with itself.
    #[pyo3(signature = (first, second=None))]
    fn friction(&mut self, first: &str, second: Option<&str>) -> PyResult<f64> {
        let (a, b) = (self.material_of(Some(first))?, self.material_of(Some(second.unwrap_or(first)))?);
        Ok(self.state().materials.pair_friction(a.index(), b.index()))
    }

    /// Adds a body and returns its index. Mass and inertia (3 x 3, about the centre of mass, body axes)
    /// follow from shape and density unless both are given. Raises BufferError while arrays look into the
    /// world's memory.
    #[pyo3(signature = (shape, position=None, *, quaternion=None, velocity=None, angular_velocity=None, material=None, motion=None,
                        name="", mass=None, inertia=None))]
    fn add_body(
        &mut self,
        shape: &Bound<'_, Shape>,
        position: Option<&Bound<'_, PyAny>>,
        quaternion: Option<&Bound<'_, PyAny>>,
        velocity: Option<&Bound<'_, PyAny>>,
        angular_velocity: Option<&Bound<'_, PyAny>>,
        material: Option<&str>,
        motion: Option<&Bound<'_, Motion>>,
        name: &str,
        mass: Option<f64>,
        inertia: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<usize> {
        let or_zero = |what: &str, given: Option<&Bound<'_, PyAny>>| {
            given.map_or(Ok(Vec3::ZERO), |given| vector(what, given))
        };
        let mass = match (mass, inertia) {
            (None, None) => None,
            (Some(mass), Some(inertia)) => {
                let rows = shaped("inertia", inertia, &[Some(3), Some(3)])?;
                Some(MassProperties { mass, inertia: Mat3::from_cols_slice(&rows).transpose() })
            }
            _ => return Err(PyValueError::new_err("give both mass and inertia, or neither")),
        };
        let body = Body {
            name: name.to_string(),
            velocity: or_zero("velocity", velocity)?,
            angular_velocity: or_zero("angular_velocity", angular_velocity)?,
            orientation: quaternion
                .map_or(Ok(Quat::IDENTITY), |q| crate::arrays::quaternion("quaternion", q))?,
            mass,
            ..Body::new(
                GeometryId::from_index(0),
                self.material_of(material)?,
                or_zero("position", position)?,
            )
        };
        self.leases.refuse_resize()?;
        let geometry = self.geometry_of(shape.get());
        let motion = motion.map(|motion| motion.get());
        let one = std::iter::once(Body { geometry, ..body.clone() });
        Ok(self.add_all(&body, motion, one)?.0)
    }

    /// Adds a body of this shape at every position, (n, 3), and returns the range of their indices.
    /// velocities (n, 3) and quaternions (n, 4) where they are not zero and not turned.
    #[pyo3(signature = (shape, positions, *, quaternions=None, velocities=None, material=None, motion=None))]
    fn add_bodies<'py>(
        &mut self,
        py: Python<'py>,
        shape: &Bound<'_, Shape>,
        positions: &Bound<'_, PyAny>,
        quaternions: Option<&Bound<'_, PyAny>>,
        velocities: Option<&Bound<'_, PyAny>>,
        material: Option<&str>,
        motion: Option<&Bound<'_, Motion>>,
    ) -> PyResult<Bound<'py, PyRange>> {
        let positions = vectors("positions", positions)?;
        let count = Some(positions.len());
        let turns = quaternions.map(|q| shaped("quaternions", q, &[count, Some(4)])).transpose()?;
        let speeds = velocities.map(|v| shaped("velocities", v, &[count, Some(3)])).transpose()?;
        let material = self.material_of(material)?;
        self.leases.refuse_resize()?;
        let geometry = self.geometry_of(shape.get());
        let bodies = positions.iter().enumerate().map(|(k, &place)| Body {
            orientation: turns.as_ref().map_or(Quat::IDENTITY, |q| Quat::from_slice(&q[4 * k..])),
            velocity: speeds.as_ref().map_or(Vec3::ZERO, |v| Vec3::from_slice(&v[3 * k..])),
            ..Body::new(geometry, material, place)
        });
        let like = Body::new(geometry, material, Vec3::ZERO);
        let (start, end) = self.add_all(&like, motion.map(|motion| motion.get()), bodies)?;
        PyRange::new(py, start as isize, end as isize)
    }

    /// Adds balls at these positions, (n, 3), with these radii, (n,) or one number, and returns the range of
    /// their indices.
    #[pyo3(signature = (positions, radii, *, velocities=None, material=None))]
    fn add_spheres<'py>(
        &mut self,
        py: Python<'py>,
        positions: &Bound<'_, PyAny>,
        radii: &Bound<'_, PyAny>,
        velocities: Option<&Bound<'_, PyAny>>,
        material: Option<&str>,
    ) -> PyResult<Bound<'py, PyRange>> {
        let positions = vectors("positions", positions)?;
        let count = Some(positions.len());
        let radii = match radii.extract::<f64>() {
            Ok(radius) => vec![radius; positions.len()],
            Err(_) => shaped("radii", radii, &[count])?,
        };
        let speeds = velocities.map(|v| shaped("velocities", v, &[count, Some(3)])).transpose()?;
        let material = self.material_of(material)?;
        self.leases.refuse_resize()?;
        let balls: Vec<Geometry> =
            radii.iter().map(|&r| Geometry::sphere(r)).collect::<Result<_, _>>().or_raise()?;
        // Balls of the same size share a geometry.
        let mut of_radius = std::collections::HashMap::new();
        let mut geometries = Vec::with_capacity(balls.len());
        for (radius, ball) in radii.iter().zip(balls) {
            let id = *of_radius.entry(radius.to_bits()).or_insert_with(|| self.state().add_geometry(ball));
            geometries.push(id);
        }
        let bodies = positions.iter().zip(&geometries).enumerate().map(|(k, (&place, &geometry))| Body {
            velocity: speeds.as_ref().map_or(Vec3::ZERO, |v| Vec3::from_slice(&v[3 * k..])),
            ..Body::new(geometry, material, place)
        });
        let like = Body::new(GeometryId::from_index(0), material, Vec3::ZERO);
        let (start, end) = self.add_all(&like, None, bodies)?;
        PyRange::new(py, start as isize, end as isize)
    }

    /// Adds a fixed plane through a point; bodies stay on the side that the normal (any length) points to.
    /// Returns its index.
    #[pyo3(signature = (point=None, normal=None, *, material=None, motion=None, name=""))]
    fn add_plane(
        slf: &Bound<'_, Self>,
        point: Option<&Bound<'_, PyAny>>,
        normal: Option<&Bound<'_, PyAny>>,
        material: Option<&str>,
        motion: Option<&Bound<'_, Motion>>,
        name: &str,
    ) -> PyResult<usize> {
        let normal = normal.map_or(Ok(Vec3::Z), |normal| vector("normal", normal))?;
        let unit = normal
            .try_normalize()
            .ok_or_else(|| PyValueError::new_err("normal has no direction: it is zero or not finite"))?;
        let orientation = Quat::from_rotation_arc(Vec3::Z, unit);
        let place = point.map_or(Ok(Vec3::ZERO), |point| vector("point", point))?;
        let mut world = slf.try_borrow_mut()?;
        let fixed = graintrain::motion::Motion::fixed();
        let motion = Motion { motion: motion.map_or(fixed, |motion| motion.get().motion.clone()) };
        let material = world.material_of(material)?;
        world.leases.refuse_resize()?;
        let geometry = world.state().add_geometry(Geometry::plane());
        let body = Body { name: name.to_string(), orientation, ..Body::new(geometry, material, place) };
        Ok(world.add_all(&body.clone(), Some(&motion), std::iter::once(body))?.0)
    }

    /// A load: the force (N) times a function of time, on some bodies or (None) all, at a point from the
    /// centre of mass in body axes. axes: whether the force is given in those of the "world" or of the
    /// "body". region: acts only on bodies in there, {"min", "max"} or {"base", "radius", "height"}.
    #[pyo3(signature = (force, bodies=None, *, function=None, axes="world", point=None, region=None))]
    fn add_force(
        &mut self,
        force: &Bound<'_, PyAny>,
        bodies: Option<&Bound<'_, PyAny>>,
        function: Option<&Bound<'_, PyAny>>,
        axes: &str,
        point: Option<&Bound<'_, PyAny>>,
        region: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let terms = vec![(vector("force", force)?, factor(function)?)];
        let point = point.map_or(Ok(Vec3::ZERO), |point| vector("point", point))?;
        self.load(bodies, region, Action::Force { terms, axes: axes_of(axes)?, point })
    }

    /// A load: the torque (N m) times a function of time; see add_force.
    #[pyo3(signature = (torque, bodies=None, *, function=None, axes="world", region=None))]
    fn add_torque(
        &mut self,
        torque: &Bound<'_, PyAny>,
        bodies: Option<&Bound<'_, PyAny>>,
        function: Option<&Bound<'_, PyAny>>,
        axes: &str,
        region: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let terms = vec![(vector("torque", torque)?, factor(function)?)];
        self.load(bodies, region, Action::Torque { terms, axes: axes_of(axes)? })
    }

    /// A uniform field: three components of an acceleration (m/s^2), numbers or functions of time.
    #[pyo3(signature = (acceleration, bodies=None, *, region=None))]
    fn add_field(
        &mut self,
        acceleration: [Bound<'_, PyAny>; 3],
        bodies: Option<&Bound<'_, PyAny>>,
        region: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let [x, y, z] = acceleration.each_ref().map(|component| profile("acceleration", component));
        self.load(bodies, region, Action::Uniform { acceleration: [x?, y?, z?] })
    }

    /// A central field: the acceleration strength (r / distance)^power toward the centre.
    #[pyo3(signature = (center, strength, distance, power, bodies=None, *, region=None))]
    fn add_central_field(
        &mut self,
        center: &Bound<'_, PyAny>,
        strength: f64,
        distance: f64,
        power: f64,
        bodies: Option<&Bound<'_, PyAny>>,
        region: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let centre = vector("center", center)?;
        self.load(bodies, region, Action::Central { centre, strength, distance, power })
    }

    /// Drag of a medium: -(linear + quadratic |u|) u against the velocity u relative to it, and -angular w
    /// against turning.
    #[pyo3(signature = (linear=0.0, quadratic=0.0, angular=0.0, bodies=None, *, medium=None, region=None))]
    fn add_drag(
        &mut self,
        linear: f64,
        quadratic: f64,
        angular: f64,
        bodies: Option<&Bound<'_, PyAny>>,
        medium: Option<&Bound<'_, PyAny>>,
        region: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let medium = medium.map_or(Ok(Vec3::ZERO), |medium| vector("medium", medium))?;
        self.load(bodies, region, Action::Drag { linear, quadratic, angular, medium })
    }

    /// Makes gravity a function of time: three numbers or functions, m/s^2.
    fn set_gravity_of_time(&mut self, gravity: [Bound<'_, PyAny>; 3]) -> PyResult<()> {
        let [x, y, z] = gravity.each_ref().map(|component| profile("gravity", component));
        self.state().set_gravity_of_time([x?, y?, z?]).or_raise()
    }
}
