//! Periodic cells: space that repeats along one, two or three axes, with an imposed rate of deformation or an
//! imposed stress.
//!
//! Edges of the cell are the columns of an upper triangular matrix H,
//!
//! ```text
//! a = (H_xx, 0, 0),   b = (H_xy, H_yy, 0),   c = (H_xz, H_yz, H_zz)
//! ```
//!
//! and a body at x with velocity u has images at x + H n with velocities u + L H n for all whole n, where L =
//! dH/dt H^-1 is the (upper triangular) velocity gradient. Bodies are kept in the box of edges H_xx, H_yy,
//! H_zz along the axes: one that leaves it through a face is replaced by the image that enters, velocity
//! included (A. W. Lees, S. F. Edwards, "The computer study of transport processes under extreme conditions",
//! J. Phys. C 5:1921, 1972). Offsets of more than half an edge are taken back by whole edges, which leaves
//! the lattice as it is.
//!
//! **Imposed rate.** Edges move with constant velocities over a step. Where these change by d(L H), every
//! body gets the velocity d(L H) H^-1 (x - centre): the deformation is that of the whole sample, and no place
//! of the cell is distinguished.
//!
//! **Imposed stress.** A component L_ij is a degree of freedom with the inertia W_ij = M H_jj^2 / 12, that of
//! the mass M of all bodies spread over the cell,
//!
//! ```text
//! W_ij (dL/dt + L L)_ij = V ( s_ij - imposed ),     V s_ij = - sum over contacts across the boundary of f_i (H n)_j
//! ```
//!
//! (f: force on body A, whose neighbour is the image n of body B; compression positive) solved together with
//! the contacts of the step: edges that nothing presses go on with their speeds, d2H/dt2 = 0. Where bodies
//! are in equilibrium this sum over the boundary is the mean stress of the cell (Love and Weber). As with a
//! wall that presses, what the boundary does reaches the inner bodies through contacts. In equilibrium the
//! inertia does not matter. Where the largest imposed stress would change an edge by more than a twentieth
//! within a step from rest, inertias are raised to where it does not (`cell_limits`): else what a solve
//! leaves over, which is a share of what the stress does in a step, would be larger than grains. F. Radjai,
//! C. Voivret, "Periodic boundary conditions", in "Discrete-element Modeling of Granular Materials", Wiley,
//! 2011, have cells with inertia in contact dynamics.

use crate::contact::Contact;
use crate::error::{ModelError, finite, positive};
use crate::load::Region;
use crate::math::{Mat3, Vec3};
use crate::motion::Profile;
use crate::shape::{HalfSpace, Shape};
use crate::world::World;
use graintrain_linalg::real;
use serde::{Deserialize, Serialize};

/// The components of L in the order in which lists have them: row i (direction of the velocity), column j
/// (direction along which it varies).
pub const COMPONENTS: [(usize, usize); 6] = graintrain_ccp::CELL_COMPONENTS;

/// Names of the components, as scenes and tables write them.
pub const NAMES: [&str; 6] = ["xx", "yy", "zz", "xy", "xz", "yz"];

/// What drives a component of the deformation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Drive {
    /// The velocity gradient, 1/s: positive diagonal components stretch.
    Rate(Profile),
    /// The stress, Pa: positive diagonal components compress.
    Stress(Profile),
}

impl Drive {
    /// A component that stays as it is.
    pub const HELD: Self = Self::Rate(Profile::Constant(0.0));
}

/// A cell that repeats.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Lower corner of the box that bodies are kept in, m.
    pub lower: Vec3,
    /// Edges of that box, H_xx, H_yy, H_zz, m; what stands there for an axis that is not periodic has no
    /// meaning.
    pub size: Vec3,
    /// Offsets H_xy, H_xz, H_yz of images, m.
    pub tilt: [f64; 3],
    /// Along which axes space repeats.
    pub periodic: [bool; 3],
    /// L at the end of the last step, 1/s.
    pub rate: [f64; 6],
    /// Sum of L dt of all steps: logarithmic strains on the diagonal (positive: stretched), shear strains.
    pub strain: [f64; 6],
    /// What drives each component.
    pub drive: [Drive; 6],
    /// Largest rate, 1/s, at which an imposed stress deforms the cell, like a press with a largest speed;
    /// infinite: no limit. What contacts do against the stress is not held back.
    pub fastest: f64,
}

/// L as two matrices: of the components whose rate is imposed, and of those whose stress is.
fn gradients(cell: &Cell) -> [Mat3; 2] {
    let mut both = [Mat3::ZERO; 2];
    for (k, (i, j)) in COMPONENTS.into_iter().enumerate() {
        let of = usize::from(matches!(cell.drive[k], Drive::Stress(_)));
        both[of].col_mut(j)[i] = cell.rate[k];
    }
    both
}

/// Lets bodies go along with changes of the gradient: `imposed` (x - centre) each, and all of them `pressed`
/// (x_m - centre) with their centre of mass x_m, so that a stress which deforms the cell does not set it
/// drifting.
fn take_along(world: &mut World, [imposed, pressed]: [Mat3; 2]) {
    let Some(centre) = world.cell().map(Cell::centre) else { return };
    let uniform = if pressed == Mat3::ZERO { Vec3::ZERO } else { pressed * (mean_motion(world)[0] - centre) };
    if imposed == Mat3::ZERO && uniform == Vec3::ZERO {
        return;
    }
    for body in 0..world.bodies.len() {
        if !world.is_prescribed(body) {
            let velocity = imposed * (world.bodies.position[body] - centre) + uniform;
            let own = along_free_axes(world, body, velocity);
            world.bodies.velocity[body] += own;
        }
    }
}

/// The part of a velocity along the axes along which a body can move.
fn along_free_axes(world: &World, body: usize, velocity: Vec3) -> Vec3 {
    let free = world.free_degrees(body);
    Vec3::from_array(std::array::from_fn(|axis| if free[axis] { velocity[axis] } else { 0.0 }))
}

/// Centre of mass, m, and mean velocity, m/s, of the bodies that can move; zero where there are none.
fn mean_motion(world: &World) -> [Vec3; 2] {
    let bodies = &world.bodies;
    let [mut moment, mut momentum] = [Vec3::ZERO; 2];
    for body in (0..bodies.len()).filter(|&body| !world.is_prescribed(body)) {
        moment += bodies.mass[body] * bodies.position[body];
        momentum += bodies.mass[body] * bodies.velocity[body];
    }
    let mass = moved_mass(world).max(f64::MIN_POSITIVE);
    [moment / mass, momentum / mass]
}

/// What contacts have changed of the gradient in a solve takes all bodies along from where they stood then,
/// with their way of the step: with the place that they have come to, a sample under stress that drifts would
/// be driven on by its own way, more with every step. So a step takes the momentum relative to the
/// deformation, p = sum m (u - L (x - centre)), to (I + dt L)^-1 p, as free flight does. `change` in 1/s,
/// `step` in s.
fn follow_contacts(world: &mut World, change: Mat3, step: f64) {
    let Some(centre) = world.cell().map(Cell::centre).filter(|_| change != Mat3::ZERO) else { return };
    let [place, velocity] = mean_motion(world);
    let uniform = change * (place - step * velocity - centre);
    for body in 0..world.bodies.len() {
        if !world.is_prescribed(body) {
            let own = along_free_axes(world, body, uniform);
            world.bodies.velocity[body] += own;
            world.bodies.position[body] += step * own;
        }
    }
}

/// L times a vector.
fn times(rate: &[f64; 6], v: Vec3) -> Vec3 {
    let [xx, yy, zz, xy, xz, yz] = *rate;
    Vec3::new(xx * v.x + xy * v.y + xz * v.z, yy * v.y + yz * v.z, zz * v.z)
}

impl Cell {
    /// A cell at rest between two corners, periodic along these axes.
    ///
    /// # Errors
    /// As [`Self::validate`].
    pub fn new(lower: Vec3, upper: Vec3, periodic: [bool; 3]) -> Result<Self, ModelError> {
        let cell = Self {
            lower,
            size: upper - lower,
            tilt: [0.0; 3],
            periodic,
            rate: [0.0; 6],
            strain: [0.0; 6],
            drive: [Drive::HELD; 6],
            fastest: f64::INFINITY,
        };
        cell.validate()?;
        Ok(cell)
    }

    /// Checks the numbers.
    ///
    /// # Errors
    /// [`ModelError::Value`] for an edge that is not positive or a number that is not finite,
    /// [`ModelError::Cell`] for a cell that repeats nowhere, an axis driven that does not repeat, a stress
    /// imposed on a cell that does not repeat along all axes.
    pub fn validate(&self) -> Result<(), ModelError> {
        let cell = |what: &str| Err(ModelError::Cell { what: what.to_string() });
        if self.periodic == [false; 3] {
            return cell("it repeats along no axis");
        }
        finite("a corner of the periodic cell", &self.lower.to_array())?;
        finite("an offset of the periodic cell", &self.tilt)?;
        finite("a rate of the periodic cell", &self.rate)?;
        finite("a strain of the periodic cell", &self.strain)?;
        for axis in (0..3).filter(|&axis| self.periodic[axis]) {
            positive(
                format!("the edge of the periodic cell along {}", ["x", "y", "z"][axis]),
                self.size[axis],
            )?;
        }
        if self.fastest.is_nan() || self.fastest <= 0.0 {
            let what = "the largest rate of the periodic cell".to_string();
            return Err(ModelError::Value { what, value: self.fastest, expected: "positive" });
        }
        for (k, (i, j)) in COMPONENTS.into_iter().enumerate() {
            let (Drive::Rate(profile) | Drive::Stress(profile)) = &self.drive[k];
            profile.validate()?;
            if self.drive[k] == Drive::HELD {
                continue;
            }
            if !(self.periodic[i] && self.periodic[j]) {
                return Err(ModelError::Cell {
                    what: format!("its component {} is driven along an axis that does not repeat", NAMES[k]),
                });
            }
            if matches!(self.drive[k], Drive::Stress(_)) && self.periodic != [true; 3] {
                return cell(
                    "a stress can be imposed only where it repeats along x, y and z; use walls with loads",
                );
            }
        }
        Ok(())
    }

    /// Whether some stress is imposed.
    pub fn has_stress(&self) -> bool {
        self.drive.iter().any(|drive| matches!(drive, Drive::Stress(_)))
    }

    /// Whether something drives it: it deforms, or may. A cell that is held may have a rate still, that of
    /// the last step: the next one ends it.
    pub fn is_driven(&self) -> bool {
        self.drive.iter().any(|drive| *drive != Drive::HELD)
    }

    /// Whether it changes in the step, or is driven and may.
    pub(crate) fn deforms(&self) -> bool {
        self.is_driven() || self.rate != [0.0; 6]
    }

    /// The centre, m, which stays where it is.
    pub fn centre(&self) -> Vec3 {
        self.lower + 0.5 * self.size
    }

    /// Volume, m^3, of a cell that repeats along all axes.
    pub fn volume(&self) -> f64 {
        self.size.x * self.size.y * self.size.z
    }

    /// The smallest edge along which it repeats, m.
    pub fn smallest_edge(&self) -> f64 {
        (0..3).filter(|&axis| self.periodic[axis]).map(|axis| self.size[axis]).fold(f64::INFINITY, f64::min)
    }

    /// H n: the way to an image, m.
    pub fn shift(&self, n: [i32; 3]) -> Vec3 {
        let [x, y, z] = n.map(f64::from);
        let [xy, xz, yz] = self.tilt;
        let along = |n: f64, edge: f64| if n == 0.0 { 0.0 } else { n * edge };
        Vec3::new(
            along(x, self.size.x) + along(y, xy) + along(z, xz),
            along(y, self.size.y) + along(z, yz),
            along(z, self.size.z),
        )
    }

    /// L H n: what an image is faster by, m/s.
    pub fn image_velocity(&self, n: [i32; 3]) -> Vec3 {
        if n == [0; 3] { Vec3::ZERO } else { times(&self.rate, self.shift(n)) }
    }

    /// L v.
    pub fn gradient_times(&self, v: Vec3) -> Vec3 {
        times(&self.rate, v)
    }

    /// Whole numbers of edges by which a way (m) has to be shortened to be the least, taken axis by axis, and
    /// the way that is left. Exact for ways of which each component is less than half an edge but for whole
    /// edges.
    pub fn nearest(&self, way: Vec3) -> ([i32; 3], Vec3) {
        self.split(way, f64::round)
    }

    /// Edges by which a place lies outside the box, and its image inside.
    pub fn wrapped(&self, place: Vec3) -> ([i32; 3], Vec3) {
        let (n, inside) = self.split(place - self.lower, f64::floor);
        if n == [0; 3] { (n, place) } else { (n, self.lower + inside) }
    }

    fn split(&self, mut way: Vec3, whole: impl Fn(f64) -> f64) -> ([i32; 3], Vec3) {
        let mut n = [0; 3];
        for axis in (0..3).rev().filter(|&axis| self.periodic[axis]) {
            let count = whole(way[axis] / self.size[axis]);
            if count != 0.0 {
                n[axis] = count as i32;
                let mut one = [0; 3];
                one[axis] = n[axis];
                way -= self.shift(one);
            }
        }
        (n, way)
    }

    /// All images of a ball (centre, reach; m) that come nearer to the box than `margin`, itself left out.
    pub fn images(&self, centre: Vec3, margin: f64) -> impl Iterator<Item = ([i32; 3], Vec3)> {
        let range = |axis: usize, most: i32| if self.periodic[axis] { -most..=most } else { 0..=0 };
        // Offsets along x of two axes may add up to an edge.
        let (x, y, z) = (range(0, 2), range(1, 2), range(2, 1));
        let upper = self.lower + self.size;
        let near = move |place: Vec3| {
            (0..3).all(|k| {
                !self.periodic[k] || (place[k] >= self.lower[k] - margin && place[k] <= upper[k] + margin)
            })
        };
        let inner = near_inside(self, centre, margin);
        let all = z.flat_map(move |k| {
            let x = x.clone();
            y.clone().flat_map(move |j| x.clone().map(move |i| [i, j, k]))
        });
        all.filter(move |n| !inner && *n != [0; 3])
            .map(move |n| (n, centre + self.shift(n)))
            .filter(move |(_, place)| near(*place))
    }

    /// The box as a region, where it repeats along all axes.
    pub fn region(&self) -> Region {
        Region::Box { min: self.lower, max: self.lower + self.size }
    }

    /// Rates (as the step takes them, so that H is exact after it) that are imposed on the step from `time`,
    /// `None` for stresses.
    pub(crate) fn imposed_rates(&self, time: f64, step: f64) -> [Option<f64>; 6] {
        std::array::from_fn(|k| match &self.drive[k] {
            Drive::Rate(Profile::Constant(0.0)) => Some(0.0),
            Drive::Rate(profile) if k < 3 => Some(real::exp_m1(profile.mean(time, step) * step) / step),
            Drive::Rate(profile) => Some(profile.mean(time, step)),
            Drive::Stress(_) => None,
        })
    }

    /// What imposed stresses alone change of L in the step from `time`, 1/s; `mass` of all bodies, kg.
    pub(crate) fn pushes(&self, mass: f64, time: f64, step: f64) -> [f64; 6] {
        std::array::from_fn(|k| match &self.drive[k] {
            Drive::Stress(profile) if mass > 0.0 => {
                -step * self.volume() * profile.mean(time, step) / self.inertia(k, mass, time, step)
            }
            _ => 0.0,
        })
    }

    /// Deforms by a step (s) with the rates that it has.
    fn deform(&mut self, step: f64) {
        let centre = self.centre();
        let [xx, yy, zz, xy, xz, yz] = self.rate.map(|rate| step * rate);
        let [b_x, c_x, c_y] = self.tilt;
        let size = self.size;
        self.tilt = [
            b_x + xx * b_x + xy * size.y,
            c_x + xx * c_x + xy * c_y + xz * size.z,
            c_y + yy * c_y + yz * size.z,
        ];
        for (axis, stretch) in [xx, yy, zz].into_iter().enumerate().filter(|(axis, _)| self.periodic[*axis]) {
            self.size[axis] += stretch * size[axis];
        }
        self.lower = centre - 0.5 * self.size;
        for (k, rate) in self.rate.iter().enumerate() {
            self.strain[k] += if k < 3 { real::ln_1p(step * rate) } else { step * rate };
        }
        // Offsets by whole edges are the same lattice: c less b, then b and c less a.
        let turns = (self.tilt[2] / self.size.y).round();
        if turns != 0.0 {
            self.tilt[2] -= turns * self.size.y;
            self.tilt[1] -= turns * self.tilt[0];
        }
        for offset in &mut self.tilt[..2] {
            let turns = (*offset / self.size.x).round();
            if turns != 0.0 {
                *offset -= turns * self.size.x;
            }
        }
    }
}

/// Whether a place is further from all faces than the margin.
fn near_inside(cell: &Cell, place: Vec3, margin: f64) -> bool {
    let upper = cell.lower + cell.size;
    (0..3).all(|k| !cell.periodic[k] || (place[k] >= cell.lower[k] + margin && place[k] <= upper[k] - margin))
}

/// L H n of the image of a contact's body B, m/s.
pub(crate) fn image_velocity(cell: Option<&Cell>, contact: &Contact) -> Vec3 {
    cell.map_or(Vec3::ZERO, |cell| cell.image_velocity(contact.image))
}

/// Both bodies of a contact with the points (m) where the impulse acts, each beside its own body.
pub(crate) fn ends(cell: Option<&Cell>, contact: &Contact) -> [(usize, Vec3); 2] {
    let [on_a, on_b] = contact.surface_points();
    let on_b = match cell {
        Some(cell) if contact.image != [0; 3] => on_b - cell.shift(contact.image),
        _ => on_b,
    };
    [(contact.body_a as usize, on_a), (contact.body_b as usize, on_b)]
}

/// Gives the cell the rates of the step that begins now, and bodies the velocities that go with the change.
pub(crate) fn drive(world: &mut World, step: f64) {
    let time = world.time;
    let mass = moved_mass(world);
    let Some(cell) = world.cell.as_mut() else { return };
    let (last, pushes) = (gradients(cell), cell.pushes(mass, time, step));
    for (k, imposed) in cell.imposed_rates(time, step).into_iter().enumerate() {
        match imposed {
            Some(rate) => cell.rate[k] = rate,
            None => cell.rate[k] += pushes[k],
        }
    }
    let now = gradients(cell);
    take_along(world, [now[0] - last[0], now[1] - last[1]]);
}

/// Mass of the bodies that can move, kg.
pub(crate) fn moved_mass(world: &World) -> f64 {
    (0..world.bodies.len())
        .filter(|&body| !world.is_prescribed(body))
        .map(|body| world.bodies.mass[body])
        .sum()
}

/// Deforms the cell by a step with the rates that the step found, and takes bodies that left it back in.
pub(crate) fn advance(world: &mut World, rate: [f64; 6], step: f64) {
    let Some(cell) = &mut world.cell else { return };
    let [_, before] = gradients(cell);
    cell.rate = rate;
    let change = gradients(cell)[1] - before;
    follow_contacts(world, change, step);
    let Some(cell) = &mut world.cell else { return };
    cell.deform(step);
    // Edges go on with the velocities of this step, as walls do: with L (I + dt L)^-1. Where a rate is
    // imposed it is L, and bodies follow what that makes faster.
    let [imposed, pressed] = gradients(cell);
    let rate = imposed + pressed;
    let kept = rate * (Mat3::IDENTITY + step * rate).inverse();
    for (k, (i, j)) in COMPONENTS.into_iter().enumerate() {
        if matches!(cell.drive[k], Drive::Stress(_)) {
            cell.rate[k] = kept.col(j)[i];
        }
    }
    let [imposed, pressed] = gradients(cell);
    take_along(world, [imposed + pressed - kept, Mat3::ZERO]);
    wrap(world);
}

/// Replaces bodies outside the box by their images inside.
fn wrap(world: &mut World) {
    let Some(cell) = world.cell.clone() else { return };
    for body in 0..world.bodies.len() {
        if world.is_unbounded(body) {
            continue;
        }
        let (n, place) = cell.wrapped(world.bodies.position[body]);
        if n != [0; 3] {
            world.bodies.position[body] = place;
            if !world.is_prescribed(body) {
                world.bodies.velocity[body] -= cell.image_velocity(n);
            }
        }
    }
}

impl World {
    /// Makes space repeat; `None`: nowhere. Bodies outside the cell are replaced by their images inside.
    ///
    /// # Errors
    /// As [`Cell::validate`], and [`ModelError::Cell`] for bodies that do not fit into it: of half an edge or
    /// more, planes across an axis along which it repeats, driven bodies in a cell that deforms, joints.
    pub fn set_cell(&mut self, cell: Option<Cell>) -> Result<(), ModelError> {
        let before = std::mem::replace(&mut self.cell, cell);
        let checked = self.validate_cell();
        match checked {
            Ok(()) => wrap(self),
            Err(_) => self.cell = before,
        }
        checked
    }

    /// Checks the cell against the bodies.
    pub(crate) fn validate_cell(&self) -> Result<(), ModelError> {
        let Some(cell) = &self.cell else { return Ok(()) };
        cell.validate()?;
        let fail = |what: String| Err(ModelError::Cell { what });
        if !self.joints().is_empty() {
            return fail(
                "joints in a periodic cell are not there: leave out `joint` or the cell".to_string(),
            );
        }
        self.fits_cell()?;
        for body in 0..self.bodies.len() {
            let geometry = &self.geometries[self.bodies.geometry[body].index()];
            let label = self.bodies.label(body);
            if geometry.bounding_radius().is_finite() {
                if self.is_prescribed(body) && cell.is_driven() {
                    return fail(format!(
                        "body {label} is fixed or driven, but a cell that deforms has no fixed places: free it, or hold the cell"
                    ));
                }
                continue;
            }
            for part in &geometry.parts {
                let normal = self.bodies.orientation[body] * (part.orientation * Vec3::Z);
                let crossed = (0..3).find(|&axis| cell.periodic[axis] && normal[axis].abs() > 1e-9);
                if let Some(axis) = crossed {
                    return fail(format!(
                        "the plane of body {label} stands across {}, along which the cell repeats: turn it, or take that axis out",
                        ["x", "y", "z"][axis]
                    ));
                }
            }
        }
        Ok(())
    }

    /// Velocity of a body relative to that of the deforming cell at its place, u - L (x - centre), m/s;
    /// without a cell its velocity.
    pub fn fluctuation(&self, body: usize) -> Vec3 {
        let (position, velocity) = (self.bodies.position[body], self.bodies.velocity[body]);
        match &self.cell {
            Some(cell) => velocity - cell.gradient_times(position - cell.centre()),
            None => velocity,
        }
    }

    /// Whether a body reaches everywhere: planes have no images.
    pub(crate) fn is_unbounded(&self, body: usize) -> bool {
        let parts = &self.geometries[self.bodies.geometry[body].index()].parts;
        parts.iter().any(|part| part.shape == Shape::Plane(HalfSpace))
    }

    /// The way from a body's centre to a point, to the nearest of the images of the point, m.
    pub fn way_to(&self, body: usize, point: Vec3) -> Vec3 {
        let way = point - self.bodies.position[body];
        match &self.cell {
            Some(cell) if !self.is_unbounded(body) => cell.nearest(way).1,
            _ => way,
        }
    }

    /// The arm of a force at a contact of the last step, of `step` s: the way to the point from where the
    /// body's centre was when contacts were found, x - dt u (of the image that is nearest), m.
    pub fn arm_to(&self, body: usize, point: Vec3, step: f64) -> Vec3 {
        let way = self.way_to(body, point);
        let image = point - self.bodies.position[body] - way;
        let deforming = self.cell.as_ref().map_or(Vec3::ZERO, |cell| cell.gradient_times(image));
        way + step * (self.bodies.velocity[body] + deforming)
    }

    /// The image of body `b` that is nearest to body `a`: whole edges from `b`. None of planes.
    pub(crate) fn image_beside(&self, [a, b]: [u32; 2]) -> [i32; 3] {
        let [a, b] = [a as usize, b as usize];
        match &self.cell {
            Some(cell) if !self.is_unbounded(a) && !self.is_unbounded(b) => {
                cell.nearest(self.bodies.position[a] - self.bodies.position[b]).0
            }
            _ => [0; 3],
        }
    }

    /// Velocities (u, w) of two bodies near each other, the second as its image beside the first: in a
    /// periodic cell relative to its deformation at the place of the second.
    pub(crate) fn pair_velocities(&self, pair: [u32; 2]) -> [[Vec3; 2]; 2] {
        let bodies = &self.bodies;
        let [a, b] = pair.map(|body| body as usize);
        let spins = [bodies.angular_velocity[a], bodies.angular_velocity[b]];
        let Some(cell) = &self.cell else {
            return [[bodies.velocity[a], spins[0]], [bodies.velocity[b], spins[1]]];
        };
        if self.is_unbounded(a) || self.is_unbounded(b) {
            return [[bodies.velocity[a], spins[0]], [bodies.velocity[b], spins[1]]];
        }
        let branch = cell.nearest(bodies.position[a] - bodies.position[b]).1;
        let along = cell.gradient_times(branch);
        [[self.fluctuation(a) + along, spins[0]], [self.fluctuation(b), spins[1]]]
    }
}
