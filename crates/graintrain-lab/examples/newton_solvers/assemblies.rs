//! Ordered assemblies as contact problems, written down without a simulation, and a way to disturb them.
//!
//! Bodies touch (all gaps are zero) and fall for one step from rest, so that r = D^T (-g dt): every problem
//! has a solution at rest. Disorder moves every body by a uniform random vector within `disorder` times its
//! radius (half edge); normals and arms follow, who touches whom stays. Without disorder all contacts of a
//! kind are the same.

use graintrain::ccp::{BodyInverseMass, Ccp, Delassus, FIXED, RigidContact, RigidDelassus};
use rand::Rng;
use rand_pcg::Pcg64;
use std::sync::Arc;

/// Half edge or radius, m; density, kg/m^3; friction; time step, s (the values of the common job).
const RADIUS: f64 = 0.1;
const DENSITY: f64 = 1000.0;
const FRICTION: f64 = 0.25;
const STEP: f64 = 0.025;
const GRAVITY: f64 = 9.81;

/// An ordered assembly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Assembly {
    /// Touching spheres on a simple cubic lattice between a floor and four walls: 3 contacts per body.
    Cubic,
    /// The same in cubic close packing, 6 contacts per body; square layers, on a floor, between four walls.
    ClosePacked,
    /// A wall of bricks (2 x 1 x 1) in running bond, one brick thick, 8 contacts per brick (4 per overlap).
    BrickWall,
    /// Cubes stacked to a cube, 4 contacts per touching face, sides included: 12 per body.
    Blocks,
}

/// Every assembly with its name on the command line.
pub const ASSEMBLIES: [(&str, Assembly); 4] = [
    ("cubic", Assembly::Cubic),
    ("close-packed", Assembly::ClosePacked),
    ("brick-wall", Assembly::BrickWall),
    ("blocks", Assembly::Blocks),
];

/// A touching pair before it is disturbed: bodies (`None` for the surroundings), normal from B to A, contact
/// point.
struct Touch {
    bodies: [Option<usize>; 2],
    normal: [f64; 3],
    point: [f64; 3],
}

/// Centres, contacts and the inverse mass of one body.
struct Plan {
    centres: Vec<[f64; 3]>,
    touches: Vec<Touch>,
    mass: f64,
    inertia: [f64; 3],
    /// Whether contact points lie on the line between the centres (spheres), and so move with them.
    round: bool,
}

impl Assembly {
    /// About `bodies` bodies, disturbed.
    pub fn problem(self, bodies: usize, disorder: f64, seed: u64) -> Ccp {
        let side = (bodies as f64).cbrt().round().max(2.0) as usize;
        let plan = match self {
            Self::Cubic => cubic(side),
            Self::ClosePacked => close_packed(side),
            Self::BrickWall => brick_wall((bodies as f64 / 2.0).sqrt().round().max(2.0) as usize),
            Self::Blocks => blocks(side),
        };
        plan.problem(disorder, seed)
    }
}

fn indices(side: usize) -> impl Iterator<Item = [usize; 3]> {
    (0..side * side * side).map(move |k| [k % side, k / side % side, k / (side * side)])
}

fn add(a: [f64; 3], b: [f64; 3], factor: f64) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + factor * b[k])
}

/// Unit vector along an axis.
fn axis(k: usize) -> [f64; 3] {
    std::array::from_fn(|l| f64::from(u8::from(l == k)))
}

fn sphere_plan(centres: Vec<[f64; 3]>, touches: Vec<Touch>) -> Plan {
    let mass = DENSITY * 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3);
    Plan { centres, touches, mass, inertia: [0.4 * mass * RADIUS * RADIUS; 3], round: true }
}

fn cubic(side: usize) -> Plan {
    let centre = |p: [usize; 3]| p.map(|x| RADIUS * (2.0 * x as f64 + 1.0));
    let index = |p: [usize; 3]| (p[2] * side + p[1]) * side + p[0];
    let mut touches = Vec::new();
    for p in indices(side) {
        for k in 0..3 {
            // The neighbour below along the axis, or the wall.
            let mut q = p;
            let below = p[k].checked_sub(1).map(|x| {
                q[k] = x;
                index(q)
            });
            let point = add(centre(p), axis(k), -RADIUS);
            touches.push(Touch { bodies: [Some(index(p)), below], normal: axis(k), point });
            if k < 2 && p[k] + 1 == side {
                let point = add(centre(p), axis(k), RADIUS);
                touches.push(Touch { bodies: [Some(index(p)), None], normal: axis(k).map(|x| -x), point });
            }
        }
    }
    sphere_plan(indices(side).map(centre).collect(), touches)
}

fn close_packed(side: usize) -> Plan {
    // Layers of a square lattice; every other one shifted into the hollows of the one below.
    let height = RADIUS * f64::sqrt(2.0);
    let centre = |p: [usize; 3]| {
        let shift = RADIUS * (p[2] % 2) as f64;
        let xy = |x: usize| RADIUS * (2.0 * x as f64 + 1.0) + shift;
        [xy(p[0]), xy(p[1]), RADIUS + height * p[2] as f64]
    };
    let index = |p: [usize; 3]| (p[2] * side + p[1]) * side + p[0];
    let mut touches = Vec::new();
    for p in indices(side) {
        let (here, c) = (index(p), centre(p));
        let mut touch = |other: Option<usize>, normal: [f64; 3]| {
            let point = add(c, normal, -RADIUS);
            touches.push(Touch { bodies: [Some(here), other], normal, point });
        };
        for k in 0..2 {
            let mut q = p;
            if p[k] > 0 {
                q[k] -= 1;
                touch(Some(index(q)), axis(k));
            } else {
                touch(None, axis(k));
            }
            if p[k] + 1 == side {
                touch(None, axis(k).map(|x| -x));
            }
        }
        if p[2] == 0 {
            touch(None, axis(2));
            continue;
        }
        for dx in 0..2 {
            for dy in 0..2 {
                // A shifted layer rests on x, x + 1 of the one below, the others on x - 1, x.
                let lower = |x: usize, d: usize| (x + p[2] % 2 + d).checked_sub(1).filter(|&x| x < side);
                if let (Some(x), Some(y)) = (lower(p[0], dx), lower(p[1], dy)) {
                    let q = [x, y, p[2] - 1];
                    let other = centre(q);
                    touch(Some(index(q)), std::array::from_fn(|k| (c[k] - other[k]) / (2.0 * RADIUS)));
                }
            }
        }
    }
    sphere_plan(indices(side).map(centre).collect(), touches)
}

/// Moment of inertia of a box with these edges, about its axes.
fn box_inertia(mass: f64, edges: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| {
        let (a, b) = (edges[(k + 1) % 3], edges[(k + 2) % 3]);
        mass / 12.0 * (a * a + b * b)
    })
}

/// Four corners of a rectangle of half edges `half` around a point, normal to an axis.
fn corners(middle: [f64; 3], normal: usize, half: [f64; 3]) -> [[f64; 3]; 4] {
    let (u, v) = ((normal + 1) % 3, (normal + 2) % 3);
    [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]]
        .map(|[a, b]| add(add(middle, axis(u), a * half[u]), axis(v), b * half[v]))
}

fn brick_wall(courses: usize) -> Plan {
    let (edge, bricks) = (2.0 * RADIUS, 2 * courses);
    let centre = |course: usize, k: usize| {
        let shift = 0.5 * (course % 2) as f64;
        [2.0 * edge * (k as f64 + shift), 0.0, edge * (course as f64 + 0.5)]
    };
    let mut touches = Vec::new();
    for course in 0..courses {
        for k in 0..bricks {
            let here = course * bricks + k;
            let c = centre(course, k);
            // The two halves of the underside, each on a brick of the course below or on the floor; at the
            // ends a half may hang free.
            for half in [0, 1] {
                let other = (k + course % 2 + half).checked_sub(1).filter(|&k| k < bricks);
                if course > 0 && other.is_none() {
                    continue;
                }
                let below = other.filter(|_| course > 0).map(|k| (course - 1) * bricks + k);
                let middle = [c[0] + edge * (half as f64 - 0.5), 0.0, c[2] - 0.5 * edge];
                for point in corners(middle, 2, [0.5 * edge; 3]) {
                    touches.push(Touch { bodies: [Some(here), below], normal: axis(2), point });
                }
            }
        }
    }
    let mass = DENSITY * 2.0 * edge.powi(3);
    let centres = (0..courses * bricks).map(|k| centre(k / bricks, k % bricks)).collect();
    Plan { centres, touches, mass, inertia: box_inertia(mass, [2.0 * edge, edge, edge]), round: false }
}

fn blocks(side: usize) -> Plan {
    let edge = 2.0 * RADIUS;
    let centre = |p: [usize; 3]| p.map(|x| edge * (x as f64 + 0.5));
    let index = |p: [usize; 3]| (p[2] * side + p[1]) * side + p[0];
    let mut touches = Vec::new();
    for p in indices(side) {
        for k in 0..3 {
            let mut q = p;
            let below = p[k].checked_sub(1).map(|x| {
                q[k] = x;
                index(q)
            });
            if below.is_none() && k < 2 {
                continue;
            }
            for point in corners(add(centre(p), axis(k), -0.5 * edge), k, [0.5 * edge; 3]) {
                touches.push(Touch { bodies: [Some(index(p)), below], normal: axis(k), point });
            }
        }
    }
    let mass = DENSITY * edge.powi(3);
    Plan {
        centres: indices(side).map(centre).collect(),
        touches,
        mass,
        inertia: box_inertia(mass, [edge; 3]),
        round: false,
    }
}

fn normalized(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl Plan {
    fn problem(&self, disorder: f64, seed: u64) -> Ccp {
        let mut random = Pcg64::new(u128::from(seed), 0);
        // 53 random bits to [0, 1).
        let mut unit = || (random.next_u64() >> 11) as f64 / f64::powi(2.0, 53);
        let shift: Vec<[f64; 3]> = (0..self.centres.len())
            .map(|_| std::array::from_fn(|_| disorder * RADIUS * (2.0 * unit() - 1.0)))
            .collect();
        let moved = |body: usize| add(self.centres[body], shift[body], 1.0);
        let (mut contacts, mut points) = (Vec::new(), Vec::new());
        for touch in &self.touches {
            let shift_of = |side: usize| touch.bodies[side].map_or([0.0; 3], |body| shift[body]);
            let difference = add(shift_of(0), shift_of(1), -1.0);
            // The normal turns with the line between the bodies, whose distance it keeps.
            let normal = normalized(add(touch.normal, difference, 0.5 / RADIUS));
            let point = if self.round {
                touch.bodies[0].map_or(touch.point, |body| add(moved(body), normal, -RADIUS))
            } else {
                add(touch.point, add(shift_of(0), shift_of(1), 1.0), 0.5)
            };
            let arm = |side: usize| match touch.bodies[side] {
                Some(_) if self.round && side == 1 => normal.map(|x| RADIUS * x),
                Some(body) => add(point, moved(body), -1.0),
                None => [0.0; 3],
            };
            let helper = if normal[0].abs() < 0.6 { axis(0) } else { axis(1) };
            let tangent = normalized(cross(normal, helper));
            let number = |side: usize| touch.bodies[side].map_or(FIXED, |body| body as u32);
            contacts.push(RigidContact {
                body_a: number(0),
                body_b: number(1),
                frame: [normal, tangent, cross(normal, tangent)],
                arm_a: arm(0),
                arm_b: arm(1),
            });
            points.push(point);
        }
        let inverse = self.inertia.map(|x| 1.0 / x);
        let body = BodyInverseMass {
            linear: [1.0 / self.mass; 3],
            angular: [inverse[0], 0.0, 0.0, 0.0, inverse[1], 0.0, 0.0, 0.0, inverse[2]],
        };
        let rigid = RigidDelassus::new(contacts, vec![body; self.centres.len()]);
        let fall: Vec<f64> =
            (0..6 * self.centres.len()).map(|k| if k % 6 == 2 { -GRAVITY * STEP } else { 0.0 }).collect();
        let mut r = vec![0.0; 3 * self.touches.len()];
        rigid.relative_velocity(&fall, &mut r);
        Ccp {
            delassus: Arc::new(Delassus::Rigid(rigid)),
            friction: vec![FRICTION; self.touches.len()],
            turning: Vec::new(),
            r,
            velocity_scale: Some(GRAVITY * STEP),
            identity: (0..self.touches.len() as u64).collect(),
            points,
        }
    }
}
