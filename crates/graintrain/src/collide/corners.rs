//! Corners and edges of boxes, cylinders and triangles against the other shape's signed distance: the points
//! within the envelope that the collision library leaves out.
//!
//! The library reports where the two faces that look at each other most lie over one another. A corner of a
//! tilted box over a smaller one, a pair that lies diagonally apart, or the corner of a face that it did not
//! choose are missing. Each point added here is a point p of one shape with its nearest point on the other,
//! so that with s the (convex) signed distance, `s(p + d) >= s(p) + n . d`: a true lower bound for that
//! point.
//!
//! Not every such point is needed, and of bodies that nearly touch some would hold up motions that are free:
//! a corner that sticks out by a hair beyond the edge of the face it rests on is *beside* that face, at a
//! tiny distance and with a sideways normal. So a point is added only if
//!
//! * it is the nearest of all, and the library found none as near; or
//! * it looks along the contact's own normal (within 18 degrees), over a face of the other shape; or over an
//!   edge of it, if it is not nearly touching; or
//! * it is a corner over the inside of another face of the other shape;
//!
//! and in every case only if its distance is more than [`CLEAR`] of the smaller size. Of what touches, only
//! corners on a face are added, along the library's normal: of faces whose edges coincide but for round-off
//! it loses some.

use super::capsule::{crossings, least_between, minimise};
use super::distance::{
    Distance, FaceSet, TriangleFeature, highest_face, nearest_on_triangle, signed_distance,
};
use super::manifold::Solid;
use super::reduce::{SAME_PATCH, Touch};
use crate::hull::{Hull, HullFace};
use crate::math::Vec3;
use crate::shape::Shape;
use graintrain_linalg::real;

/// Points nearer than this fraction of the smaller size are left to the library.
const CLEAR: f64 = 1e-6;

/// Points beside a face must be this fraction of the smaller size away, points over another face as far
/// inside it.
const MARGIN: f64 = 1e-2;

/// Points of ours within this fraction of the smaller size of a point of the library's are that point.
const SAME_POINT: f64 = 1e-3;

/// By this fraction of the smaller size rounding may make a point too high.
const ROUNDING: f64 = 1e-9;

/// First feature of B's points; A's begin at 1. Corners, edges and their crossings of the largest hulls fit
/// between.
const OF_B: u64 = 1 << 28;

/// Corners and edges of a solid, in the world. Of a cylinder: per end four points of the rim, of which the
/// first looks at the other solid, with the chords between them, and the line of the mantle that looks at the
/// other solid.
struct Corners {
    points: Vec<Vec3>,
    edges: Vec<[usize; 2]>,
}

/// A point of one solid near the other.
struct Candidate {
    point: Vec3,
    distance: Distance,
    /// How far the nearest point lies inside a face of the other solid, m; zero on edges.
    inside: f64,
    is_corner: bool,
    feature: u64,
}

/// A plane in front of a solid: no point is nearer to the solid than it is high above the plane.
struct Front {
    outward: Vec3,
    offset: f64,
}

impl Front {
    /// The plane that touches the solid where it reaches farthest along a direction.
    fn of(solid: Solid<'_>, direction: Vec3) -> Self {
        let outward = direction.normalize_or_zero();
        Self { outward, offset: solid.reach(outward) }
    }

    fn height(&self, p: Vec3) -> f64 {
        self.outward.dot(p) - self.offset
    }
}

/// One of both solids with its corners, and the other in front of which they are.
struct Side<'a> {
    corners: Corners,
    other: Solid<'a>,
    front: Front,
    /// From the other solid to this one.
    outward: Vec3,
    /// Sign of the normals: 1 where this one is A.
    sign: f64,
    /// Its first feature.
    first: u64,
}

/// Adds the points that are missing in `touches`, which hold what the library found for this pair. `unit` is
/// the size of the smaller solid; normals point from B to A.
pub(crate) fn add_corners(a: Solid<'_>, b: Solid<'_>, unit: f64, envelope: f64, touches: &mut Vec<Touch>) {
    if envelope <= CLEAR * unit {
        return;
    }
    let library = touches.iter().min_by(|x, y| x.gap.total_cmp(&y.gap)).copied();
    let toward = library.map_or(b.centre() - a.centre(), |touch| -touch.normal);
    let side = |own: Solid<'_>, other, toward: Vec3, sign, first| Side {
        corners: own.corners(toward),
        other,
        front: Front::of(other, -toward),
        outward: -toward,
        sign,
        first,
    };
    let sides = [side(a, b, toward, 1.0, 1), side(b, a, -toward, -1.0, OF_B)];
    let mut candidates = Vec::new();
    for side in &sides {
        of_one(side, envelope, unit, &mut candidates);
    }
    let nearest = candidates
        .iter()
        .min_by(|x, y| x.distance.value.total_cmp(&y.distance.value).then(x.feature.cmp(&y.feature)));
    let Some(nearest) = nearest else { return };
    let overlooked = library.is_none_or(|touch| nearest.distance.value < touch.gap - SAME_POINT * unit);
    let first = if overlooked { Some(nearest.feature) } else { None };
    let normal = if overlooked { nearest.distance.normal } else { -toward };
    let known = touches.len();
    let same = |known: &[Touch], point: Vec3, normal: Vec3| {
        let near = |touch: &Touch| (touch.point - point).length() <= SAME_POINT * unit;
        known.iter().any(|touch| near(touch) && touch.normal.dot(normal) >= SAME_PATCH)
    };
    if library.is_some() {
        let normal = -toward;
        for Side { corners, other, front, outward, first, .. } in &sides {
            for (feature, &p) in (*first..).zip(&corners.points) {
                // What is higher than this touches nothing.
                if front.height(p) > MARGIN * unit {
                    continue;
                }
                if let Some(gap) = other.height_on_face(p, *outward, unit)
                    && gap <= envelope
                {
                    let point = p - 0.5 * gap * *outward;
                    if !same(&touches[..known], point, normal) {
                        touches.push(Touch { point, normal, gap, feature });
                    }
                }
            }
        }
    }
    for candidate in &candidates {
        let Distance { value, normal: own } = candidate.distance;
        let alike = own.dot(normal);
        let taken = value > CLEAR * unit
            && (first == Some(candidate.feature)
                || (alike >= SAME_PATCH && candidate.inside >= 0.0)
                || (alike >= SAME_PATCH && value >= MARGIN * unit)
                || alike >= 1.0 - 1e-6
                || (candidate.is_corner && candidate.inside >= MARGIN * unit));
        let same = |touch: &Touch| {
            (touch.point - candidate.point).length() <= SAME_POINT * unit
                && touch.normal.dot(own) >= SAME_PATCH
        };
        if taken && !touches[..known].iter().any(same) {
            touches.push(Touch {
                point: candidate.point,
                normal: own,
                gap: value,
                feature: candidate.feature,
            });
        }
    }
}

/// Corners, edge crossings and nearest points of edges of one solid against the other. Features count up from
/// the first of the side, and stay below 2^32: the library's own numbers are larger, or zero. Of most corners
/// and edges it is enough to know that they are high in front of the other solid.
fn of_one(side: &Side<'_>, envelope: f64, unit: f64, candidates: &mut Vec<Candidate>) {
    let Side { corners, other, front, sign, first, .. } = side;
    let mut add = |p: Vec3, is_corner: bool, feature: u64| {
        if let Some((distance, inside)) = other.distance(p)
            && distance.value <= envelope
        {
            let Distance { value, normal } = distance;
            let point = p - 0.5 * value * normal;
            let distance = Distance { value, normal: *sign * normal };
            candidates.push(Candidate { point, distance, inside, is_corner, feature });
        }
    };
    let highest = envelope + ROUNDING * unit;
    let is_near: Vec<bool> = corners.points.iter().map(|&p| front.height(p) <= highest).collect();
    let near = corners.points.iter().enumerate().filter(|(number, _)| is_near[*number]);
    let &Solid::Placed { shape, position, orientation } = other else {
        for (number, &p) in near {
            add(p, true, first + number as u64);
        }
        return;
    };
    let inverse = orientation.conjugate();
    let own = |p: Vec3| inverse * (p - position);
    let mut distances: Vec<Option<Distance>> = vec![None; corners.points.len()];
    for (number, &p) in near {
        let distance = signed_distance(shape, own(p));
        if distance.value <= envelope {
            add(p, true, first + number as u64);
        }
        distances[number] = Some(distance);
    }
    let numbers = (corners.points.len() as u64).max(64);
    let per_edge = match shape {
        Shape::Hull(hull) => 1 + 2 * hull.edges().len() as u64,
        _ => 16,
    };
    for (number, edge) in corners.edges.iter().enumerate() {
        if edge.iter().all(|&end| !is_near[end]) {
            continue;
        }
        let [p, q] = edge.map(|end| own(corners.points[end]));
        let (centre, half) = (0.5 * (p + q), 0.5 * (q - p));
        let [at_p, at_q] = [(edge[0], p), (edge[1], q)]
            .map(|(end, p)| *distances[end].get_or_insert_with(|| signed_distance(shape, p)));
        if least_between(&at_p, &at_q, half) > envelope * (1.0 + 1e-9) {
            continue;
        }
        let feature = first + numbers + per_edge * number as u64;
        let world = |t: f64| position + orientation * (centre + t * half);
        let nearest = match shape {
            Shape::Hull(hull) => nearest_to_edges(hull, centre, half),
            _ => minimise(|t| signed_distance(shape, centre + t * half).normal.dot(half)),
        };
        if nearest.abs() < 1.0 {
            add(world(nearest), false, feature);
        }
        for (k, t) in crossings(shape, centre, half).into_iter().enumerate() {
            if t.abs() < 1.0 {
                add(world(t), false, feature + 1 + k as u64);
            }
        }
    }
}

/// Where on the segment `centre + t * half`, t in [-1, 1], it is nearest to an edge of the hull. A segment
/// outside is nearest to the hull there, or over a face: then at an end or where it crosses from one face to
/// the next.
fn nearest_to_edges(hull: &Hull, centre: Vec3, half: Vec3) -> f64 {
    let square = half.length_squared();
    let along_segment = |p: Vec3| (half.dot(p - centre) / square).clamp(-1.0, 1.0);
    let mut best = (f64::INFINITY, 0.0);
    let above = FaceSet::above(hull, [centre - half, centre + half]);
    for edge in hull.edges().iter().filter(|edge| above.holds_one_of(edge.faces)) {
        let [a, b] = edge.corners.map(|k| hull.corners()[k as usize]);
        let along = b - a;
        let on_edge = |p: Vec3| a + (along.dot(p - a) / along.length_squared()).clamp(0.0, 1.0) * along;
        // Of two lines that cross askew; clamped to the segment, then to the edge, then to the segment again.
        let (mixed, edge_square) = (half.dot(along), along.length_squared());
        let determinant = square * edge_square - mixed * mixed;
        let start = a - centre;
        let askew = (half.dot(start) * edge_square - along.dot(start) * mixed) / determinant;
        let t = if askew.is_finite() { askew.clamp(-1.0, 1.0) } else { 0.0 };
        let q = on_edge(centre + t * half);
        let t = along_segment(q);
        let distance = (centre + t * half - q).length_squared();
        if distance < best.0 {
            best = (distance, t);
        }
    }
    best.1
}

impl Solid<'_> {
    fn centre(self) -> Vec3 {
        match self {
            Self::Placed { position, .. } => position,
            Self::Triangle([a, b, c]) => (a + b + c) / 3.0,
        }
    }

    /// How far it reaches along a direction, from the origin of the world, m.
    pub(super) fn reach(self, direction: Vec3) -> f64 {
        let farthest = |points: &[Vec3], along: Vec3| {
            points.iter().map(|p| along.dot(*p)).fold(f64::NEG_INFINITY, f64::max)
        };
        match self {
            Self::Triangle(corners) => farthest(&corners, direction),
            Self::Placed { shape, position, orientation } => {
                let own = orientation.conjugate() * direction;
                let beyond = match *shape {
                    Shape::Box { half } => half.dot(own.abs()),
                    Shape::Cylinder { half_length, radius } => {
                        radius * real::hypot(own.x, own.y) + half_length * own.z.abs()
                    }
                    Shape::Capsule { half_length, radius } => {
                        radius * own.length() + half_length * own.z.abs()
                    }
                    Shape::Hull(ref hull) => farthest(hull.corners(), own),
                    ref other => other.bounding_radius() * direction.length(),
                };
                direction.dot(position) + beyond
            }
        }
    }

    /// Distance of a point of the world and how far its nearest point lies inside a face, m (negative on an
    /// edge); `None` behind a triangle, and beside it.
    fn distance(self, p: Vec3) -> Option<(Distance, f64)> {
        match self {
            Self::Placed { shape, position, orientation } => {
                let own = orientation.conjugate() * (p - position);
                let Distance { value, normal } = signed_distance(shape, own);
                Some((Distance { value, normal: orientation * normal }, inside_face(shape, own)))
            }
            Self::Triangle(corners) => {
                let [a, b, c] = corners;
                let face = (b - a).cross(c - a).normalize();
                let (foot, feature) = nearest_on_triangle(p, corners);
                let value = face.dot(p - foot);
                let edge = |k: usize| {
                    let along = (corners[(k + 1) % 3] - corners[k]).normalize();
                    face.cross(along).dot(foot - corners[k])
                };
                let over = feature == TriangleFeature::Face && value > 0.0;
                over.then(|| (Distance { value, normal: face }, edge(0).min(edge(1)).min(edge(2))))
            }
        }
    }

    /// Height of a touching point over the face of a box whose normal is `outward`, m; `None` for points that
    /// do not touch or lie beside the face.
    fn height_on_face(self, p: Vec3, outward: Vec3, unit: f64) -> Option<f64> {
        let Self::Placed { shape, position, orientation } = self else { return None };
        let inverse = orientation.conjugate();
        if let Shape::Hull(hull) = shape {
            return height_on_hull(hull, inverse * (p - position), inverse * outward, unit);
        }
        let &Shape::Box { half } = shape else { return None };
        let (own, normal) = (inverse * (p - position), inverse * outward);
        let axis = (0..3).find(|&k| normal[k].abs() >= 1.0 - 1e-9)?;
        let height = own[axis].copysign(own[axis] * normal[axis]) - half[axis];
        let over = (0..3).all(|k| k == axis || own[k].abs() <= half[k] + CLEAR * unit);
        (over && height >= -MARGIN * unit && height <= CLEAR * unit).then_some(height)
    }

    fn corners(self, toward: Vec3) -> Corners {
        match self {
            Self::Triangle(corners) => Corners { points: corners.to_vec(), edges: Vec::new() },
            Self::Placed { shape: &Shape::Box { half }, position, orientation } => {
                let sign = |corner: usize, axis: usize| if corner >> axis & 1 == 1 { -1.0 } else { 1.0 };
                let points = (0..8)
                    .map(|k| position + orientation * (half * Vec3::new(sign(k, 0), sign(k, 1), sign(k, 2))))
                    .collect();
                let along =
                    |axis: usize| (0..8).filter(move |k| k >> axis & 1 == 0).map(move |k| [k, k | 1 << axis]);
                Corners { points, edges: (0..3).flat_map(along).collect() }
            }
            Self::Placed { shape: &Shape::Cylinder { half_length, radius }, position, orientation } => {
                let axis = orientation * Vec3::Z;
                let across = toward - toward.dot(axis) * axis;
                let level = across.length() <= 1e-9 * toward.length();
                let down = if level { orientation * Vec3::X } else { across.normalize() };
                let side = axis.cross(down);
                let end = |z: f64| [down, side, -down, -side].map(|way| position + z * axis + radius * way);
                let points = [end(-half_length), end(half_length)].concat();
                let chord = |first: usize| (0..4).map(move |k| [first + k, first + (k + 1) % 4]);
                Corners { points, edges: [[0, 4]].into_iter().chain(chord(0)).chain(chord(4)).collect() }
            }
            Self::Placed { shape: Shape::Hull(hull), position, orientation } => Corners {
                points: hull.corners().iter().map(|p| position + orientation * *p).collect(),
                edges: hull.edges().iter().map(|edge| edge.corners.map(|k| k as usize)).collect(),
            },
            Self::Placed { .. } => Corners { points: Vec::new(), edges: Vec::new() },
        }
    }
}

/// How far a point of the plane of a face lies inside it, m.
fn inside_polygon(hull: &Hull, face: &HullFace, p: Vec3) -> f64 {
    let sides = face.corners.iter().zip(face.corners.iter().cycle().skip(1));
    let inside = sides.map(|(&a, &b)| {
        let [a, b] = [a, b].map(|k| hull.corners()[k as usize]);
        face.normal.cross((b - a).normalize_or_zero()).dot(p - a)
    });
    inside.fold(f64::INFINITY, f64::min)
}

/// [`Solid::height_on_face`] of a hull, in its own frame.
fn height_on_hull(hull: &Hull, p: Vec3, outward: Vec3, unit: f64) -> Option<f64> {
    let face = hull.faces().iter().find(|face| face.normal.dot(outward) >= 1.0 - 1e-9)?;
    let height = face.normal.dot(p) - face.offset;
    let over = inside_polygon(hull, face, p - height * face.normal) >= -CLEAR * unit;
    (over && height >= -MARGIN * unit && height <= CLEAR * unit).then_some(height)
}

/// How far the nearest point of the surface lies inside a face of the box, cylinder or hull; negative on
/// edges and corners.
fn inside_face(shape: &Shape, p: Vec3) -> f64 {
    match *shape {
        Shape::Box { half } => {
            let beyond = (p.abs() - half).to_array();
            let largest = (0..3).fold(0, |best, k| if beyond[k] > beyond[best] { k } else { best });
            (0..3).filter(|&k| k != largest).map(|k| -beyond[k]).fold(f64::INFINITY, f64::min)
        }
        Shape::Cylinder { half_length, radius } => {
            let (across, along) = (real::hypot(p.x, p.y) - radius, p.z.abs() - half_length);
            -across.min(along)
        }
        Shape::Hull(ref hull) => {
            let (highest, height) = highest_face(p, hull);
            let face = &hull.faces()[highest];
            inside_polygon(hull, face, p - height * face.normal)
        }
        _ => 0.0,
    }
}
