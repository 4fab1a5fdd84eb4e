//! Solids that rays are cast at.

use super::camera::{Bounds, Camera};
use super::color::Rgb;
use graintrain::math::{Quat, Vec3};

/// How a primitive hides what is behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// Opaque.
    Solid,
    /// A pane: a tint and clear edges, every pane counts.
    Glass,
    /// A haze of which only the nearest counts (grains around force chains).
    Ghost,
}

/// The form of a primitive in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// Ball.
    Ball {
        /// m.
        center: Vec3,
        /// m.
        radius: f64,
    },
    /// Box.
    Box {
        /// m.
        center: Vec3,
        /// From the box's axes to the world.
        rotation: Quat,
        /// Half edge lengths, m.
        half: Vec3,
    },
    /// Cylinder about a segment, with flat ends.
    Cylinder {
        /// One end of the axis, m.
        from: Vec3,
        /// The other end, m.
        to: Vec3,
        /// m.
        radius: f64,
    },
    /// Points within a distance of a segment.
    Capsule {
        /// One end, m.
        from: Vec3,
        /// The other end, m.
        to: Vec3,
        /// m.
        radius: f64,
    },
    /// Triangle.
    Triangle {
        /// m.
        corners: [Vec3; 3],
    },
}

/// Something that can be seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Primitive {
    /// Where it is.
    pub form: Form,
    /// Its colour in full light.
    pub color: Rgb,
    /// Whether it is opaque.
    pub look: Look,
}

/// A point where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Parameter of the ray; the depth, for rays of [`Camera::ray`].
    pub depth: f64,
    /// Outward unit normal.
    pub normal: Vec3,
}

impl Form {
    /// A ball that holds the form.
    pub fn bounding_ball(&self) -> (Vec3, f64) {
        match *self {
            Form::Ball { center, radius } => (center, radius),
            Form::Box { center, half, .. } => (center, half.length()),
            Form::Cylinder { from, to, radius } => {
                (0.5 * (from + to), (0.25 * (to - from).length_squared() + radius * radius).sqrt())
            }
            Form::Capsule { from, to, radius } => (0.5 * (from + to), 0.5 * (to - from).length() + radius),
            Form::Triangle { corners } => {
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                (middle, corners.iter().map(|c| c.distance(middle)).fold(0.0, f64::max))
            }
        }
    }

    /// Rectangle of the picture that holds its image, `[left, top, right, bottom]`; everything where it
    /// reaches behind the eye.
    pub fn rectangle(&self, camera: &Camera) -> [f64; 4] {
        const EVERYTHING: [f64; 4] = [f64::NEG_INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::INFINITY];
        let around = |points: &mut dyn Iterator<Item = Vec3>| {
            let mut rectangle = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
            for point in points {
                let Some([x, y]) = camera.project(point) else { return EVERYTHING };
                rectangle =
                    [rectangle[0].min(x), rectangle[1].min(y), rectangle[2].max(x), rectangle[3].max(y)];
            }
            rectangle
        };
        match *self {
            Form::Ball { center, radius } => camera.ball_rectangle(center, radius).unwrap_or(EVERYTHING),
            Form::Box { center, rotation, half } => {
                let corners = Bounds { low: -half, high: half }.corners();
                around(&mut corners.into_iter().map(|corner| center + rotation * corner))
            }
            Form::Capsule { from, to, radius } | Form::Cylinder { from, to, radius } => {
                // A cylinder lies within the hull of two balls of radius sqrt(2) r about its ends.
                let reach =
                    if matches!(self, Form::Capsule { .. }) { radius } else { radius * 2.0_f64.sqrt() };
                match (camera.ball_rectangle(from, reach), camera.ball_rectangle(to, reach)) {
                    (Some(a), Some(b)) => [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])],
                    _ => EVERYTHING,
                }
            }
            Form::Triangle { corners } => around(&mut corners.into_iter()),
        }
    }

    /// First point at a positive parameter t where `origin + t direction` meets the surface from outside
    /// (triangles: from either side, the normal turned towards the origin).
    pub fn meet(&self, origin: Vec3, direction: Vec3) -> Option<Hit> {
        match *self {
            Form::Ball { center, radius } => meet_ball(origin - center, direction, radius),
            Form::Box { center, rotation, half } => {
                let back = rotation.conjugate();
                meet_box(back * (origin - center), back * direction, half)
                    .map(|hit| Hit { normal: rotation * hit.normal, ..hit })
            }
            Form::Cylinder { from, to, radius } => meet_cylinder(origin, direction, from, to, radius),
            Form::Capsule { from, to, radius } => {
                // The side without its flat ends, or one of the end balls: the nearest.
                let side = meet_cylinder(origin, direction, from, to, radius).filter(|hit| {
                    hit.normal.cross(to - from).length_squared() > 0.5 * (to - from).length_squared()
                });
                let ends = [from, to].map(|end| meet_ball(origin - end, direction, radius));
                ends.into_iter().chain([side]).flatten().min_by(|a, b| a.depth.total_cmp(&b.depth))
            }
            Form::Triangle { corners } => meet_triangle(origin, direction, corners),
        }
    }

    /// How near a surface point is to an edge of the form, m; only boxes have edges that are drawn.
    pub fn distance_to_edge(&self, point: Vec3) -> f64 {
        let Form::Box { center, rotation, half } = *self else { return f64::INFINITY };
        let inside = half - (rotation.conjugate() * (point - center)).abs();
        // On a face one of the three distances is zero; the next smallest is that to the nearest edge.
        let mut distances = inside.to_array();
        distances.sort_unstable_by(f64::total_cmp);
        distances[1]
    }
}

/// Solves a t^2 + 2 b t + c = 0 for the smaller root if it is positive.
fn nearest_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let discriminant = b * b - a * c;
    if discriminant < 0.0 || a <= 0.0 {
        return None;
    }
    let t = (-b - discriminant.sqrt()) / a;
    (t > 0.0).then_some(t)
}

fn meet_ball(origin: Vec3, direction: Vec3, radius: f64) -> Option<Hit> {
    let c = origin.length_squared() - radius * radius;
    let depth = nearest_root(direction.length_squared(), origin.dot(direction), c)?;
    Some(Hit { depth, normal: (origin + depth * direction) / radius })
}

fn meet_box(origin: Vec3, direction: Vec3, half: Vec3) -> Option<Hit> {
    let (mut entry, mut exit, mut axis) = (f64::NEG_INFINITY, f64::INFINITY, 0);
    for k in 0..3 {
        if direction[k] == 0.0 {
            if origin[k].abs() > half[k] {
                return None;
            }
            continue;
        }
        let far = half[k] * direction[k].signum();
        let (enter, leave) = ((-far - origin[k]) / direction[k], (far - origin[k]) / direction[k]);
        if enter > entry {
            (entry, axis) = (enter, k);
        }
        exit = exit.min(leave);
    }
    if entry > exit || entry <= 0.0 {
        return None;
    }
    let mut normal = Vec3::ZERO;
    normal[axis] = -direction[axis].signum();
    Some(Hit { depth: entry, normal })
}

fn meet_cylinder(origin: Vec3, direction: Vec3, from: Vec3, to: Vec3, radius: f64) -> Option<Hit> {
    let length = from.distance(to);
    let axis = (to - from) / length;
    if !axis.is_finite() {
        return None;
    }
    let relative = origin - from;
    let (height, climb) = (relative.dot(axis), direction.dot(axis));
    let (across, drift) = (relative - height * axis, direction - climb * axis);
    let side =
        nearest_root(drift.length_squared(), across.dot(drift), across.length_squared() - radius * radius)
            .filter(|t| (0.0..=length).contains(&(height + t * climb)))
            .map(|depth| Hit { depth, normal: (across + depth * drift) / radius });
    // The end that faces the ray.
    let (level, normal) = if climb > 0.0 { (0.0, -axis) } else { (length, axis) };
    let end = Some((level - height) / climb)
        .filter(|&t| t.is_finite() && t > 0.0 && (across + t * drift).length_squared() <= radius * radius)
        .map(|depth| Hit { depth, normal });
    match (side, end) {
        (Some(a), Some(b)) => Some(if a.depth <= b.depth { a } else { b }),
        (hit, None) | (None, hit) => hit,
    }
}

/// Moeller and Trumbore, Journal of Graphics Tools 2 (1997).
fn meet_triangle(origin: Vec3, direction: Vec3, [a, b, c]: [Vec3; 3]) -> Option<Hit> {
    let (u_edge, v_edge) = (b - a, c - a);
    let p = direction.cross(v_edge);
    let determinant = u_edge.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let from = origin - a;
    let u = from.dot(p) / determinant;
    let q = from.cross(u_edge);
    let v = direction.dot(q) / determinant;
    let depth = v_edge.dot(q) / determinant;
    if u < 0.0 || v < 0.0 || u + v > 1.0 || depth <= 0.0 {
        return None;
    }
    let normal = u_edge.cross(v_edge).normalize_or_zero();
    Some(Hit { depth, normal: if normal.dot(direction) > 0.0 { -normal } else { normal } })
}
