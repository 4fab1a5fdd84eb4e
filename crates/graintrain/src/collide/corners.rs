//! Corners and edges of solids against the other solid's signed distance: the points within the envelope
//! that faces laid over one another (`polyhedra`, and for what is round the collision library) leave out.
//!
//! Those are where the two faces that look at each other most lie over one another. A corner of a tilted box
//! over a smaller one, a pair that lies diagonally apart, or the corner of a face that was not chosen are
//! missing. Each point added here is a point p of one shape with its nearest point on the other, so that with
//! s the (convex) signed distance, `s(p + d) >= s(p) + n . d`: a true lower bound for that point.
//!
//! Not every such point is needed, and of bodies that nearly touch some would hold up motions that are free:
//! a corner that sticks out by a hair beyond the edge of the face it rests on is *beside* that face, at a
//! tiny distance and with a sideways normal. So a point is added only if
//!
//! * it is the nearest of all, and none as near was found; or
//! * it looks along the contact's own normal (within 18 degrees), over a face of the other shape; or over an
//!   edge of it, if it is not nearly touching; or
//! * it is a corner over the inside of another face of the other shape;
//!
//! and in every case only if its distance is more than [`CLEAR`] of the smaller size. Of what touches, only
//! corners on a face are added, along the normal that was found: of faces whose edges coincide but for
//! round-off the library loses some.

use super::capsule::{least_between, minimise};
use super::edges::{EdgePoint, Rims};
use super::manifold::Solid;
use super::polyhedra::Polyhedron;
use super::reduce::{SAME_PATCH, Touch};
use super::triangle::{TriangleFeature, nearest_on_triangle};
use crate::math::Vec3;
use crate::shape::{Corners, Distance};
use std::borrow::Cow;

/// Points nearer than this fraction of the smaller size touch: they are left to what found the faces.
const CLEAR: f64 = 1e-6;

/// Points beside a face must be this fraction of the smaller size away, points over another face as far
/// inside it.
const MARGIN: f64 = 1e-2;

/// Points within this fraction of the smaller size of a point that is known are that point.
const SAME_POINT: f64 = 1e-3;

/// By this fraction of the smaller size rounding may make a point too high.
const ROUNDING: f64 = 1e-9;

/// How often the point of a mantle that looks at the other solid most is looked for.
const LOOKS: usize = 10;

/// By how much of its radius the foremost point of a mantle may be nearer than one that is 45 degrees beside.
const NEARER: f64 = 0.3;

/// Points of a mantle nearer than this fraction of its radius are one.
const LEVEL: f64 = 1e-6;

/// First feature of B's points; A's begin at 1. Corners, edges and their crossings of the largest hulls fit
/// between.
const OF_B: u64 = 1 << 28;

/// A point of one solid near the other.
struct Candidate {
    point: Vec3,
    distance: Distance,
    /// How far the nearest point lies inside a face of the other solid, m; negative on edges.
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
    own: Solid<'a>,
    corners: Cow<'a, [Vec3]>,
    /// Of what is round, the corners between which the line of the mantle lies that looks at the other one.
    mantle: Option<[usize; 2]>,
    /// The corners that are not high in front of the other: all others touch nothing.
    is_near: Vec<bool>,
    /// Edges with an end that is near, and their numbers.
    near_edges: Vec<(u64, [usize; 2])>,
    other: Solid<'a>,
    front: Front,
    /// From the other solid to this one.
    outward: Vec3,
    /// Sign of the normals: 1 where this one is A.
    sign: f64,
    /// Its first feature.
    first: u64,
}

/// What is known of two solids beside their touches.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Known {
    /// Nothing.
    Nothing,
    /// Of polyhedra: no two points are nearer to each other, or deeper, than the nearest touch.
    Distance,
    /// The normal from A to B of solids of which one is round.
    Normal(Vec3),
}

/// Adds the points that are missing in `touches`, which hold what was found for this pair. `unit` is the size
/// of the smaller solid; normals point from B to A. `polyhedra` are those of the solids that are such.
pub(crate) fn add_corners(
    [a, b]: [Solid<'_>; 2],
    known: Known,
    polyhedra: [Option<&Polyhedron<'_>>; 2],
    (unit, envelope): (f64, f64),
    touches: &mut Vec<Touch>,
) {
    let is_round = matches!(known, Known::Normal(_));
    if envelope <= CLEAR * unit && !is_round {
        return;
    }
    let found = touches.iter().min_by(|x, y| x.gap.total_cmp(&y.gap)).copied();
    let toward = match (known, found) {
        (Known::Normal(normal), _) => normal,
        (_, Some(touch)) => -touch.normal,
        (_, None) => b.centre() - a.centre(),
    };
    let highest = envelope + ROUNDING * unit;
    let [of_a, of_b] = polyhedra;
    let sides = [
        Side::of((a, of_a), b, toward, (1.0, 1), highest),
        Side::of((b, of_b), a, -toward, (-1.0, OF_B), highest),
    ];
    // Nothing was overlooked: then points of edges count that look along the normal.
    let along = (known == Known::Distance).then_some(toward);
    let candidates = candidates(&sides, polyhedra, (envelope, highest), along);
    let nearest = candidates
        .iter()
        .min_by(|x, y| x.distance.value.total_cmp(&y.distance.value).then(x.feature.cmp(&y.feature)));
    let Some(nearest) = nearest else { return };
    // Where mantles cross, what was found lies at their ends.
    let nearer = if is_round { CLEAR } else { SAME_POINT };
    let overlooked = found.is_none_or(|touch| nearest.distance.value < touch.gap - nearer * unit);
    let first = if overlooked { Some(nearest.feature) } else { None };
    let normal = if overlooked { nearest.distance.normal } else { -toward };
    let first_new = touches.len();
    if found.is_some() {
        add_touching(&sides, unit, envelope, touches);
    }
    for candidate in &candidates {
        let Distance { value, normal: own } = candidate.distance;
        let alike = own.dot(normal);
        let is_first = first == Some(candidate.feature);
        let taken = is_first && is_round
            || value > CLEAR * unit
                && (is_first
                    || (alike >= SAME_PATCH && candidate.inside >= 0.0)
                    || (alike >= SAME_PATCH && value >= MARGIN * unit)
                    || alike >= 1.0 - 1e-6
                    || (candidate.is_corner && candidate.inside >= MARGIN * unit));
        let touch = Touch { point: candidate.point, normal: own, gap: value, feature: candidate.feature };
        if taken && !is_among(&touches[..first_new], &touch, unit) {
            touches.push(touch);
        }
    }
}

/// Whether a touch is one of those that are known.
fn is_among(known: &[Touch], touch: &Touch, unit: f64) -> bool {
    let near = |other: &Touch| (other.point - touch.point).length() <= SAME_POINT * unit;
    known.iter().any(|other| near(other) && other.normal.dot(touch.normal) >= SAME_PATCH)
}

/// Points of both near the other; of edges those alone that look along a direction, if there is one.
fn candidates(
    sides: &[Side<'_>; 2],
    polyhedra: [Option<&Polyhedron<'_>>; 2],
    (envelope, highest): (f64, f64),
    along: Option<Vec3>,
) -> Vec<Candidate> {
    let mut candidates = Vec::new();
    for (own, side) in sides.iter().enumerate() {
        of_corners(side, envelope, &mut candidates);
        match polyhedra[1 - own] {
            // What borders of triangles are to a mesh is its own affair.
            Some(other) if other.is_flat() => {}
            Some(other) => {
                let rims = Rims::of(other, &sides[1 - own].is_near, highest, along);
                at_rims(side, other, &rims, envelope, &mut candidates);
            }
            None => of_edges(side, envelope, &mut candidates),
        }
    }
    candidates
}

/// Adds the corners that touch a face with the normal that was found.
fn add_touching(sides: &[Side<'_>; 2], unit: f64, envelope: f64, touches: &mut Vec<Touch>) {
    let known = touches.len();
    for Side { corners, other, front, outward, sign, first, .. } in sides {
        for (feature, &p) in (*first..).zip(corners.iter()) {
            // What is higher than this touches nothing.
            if front.height(p) > MARGIN * unit {
                continue;
            }
            if let Some(gap) = other.height_on_face(p, *outward, unit)
                && gap <= envelope
            {
                let point = p - 0.5 * gap * *outward;
                let touch = Touch { point, normal: *sign * *outward, gap, feature };
                if !is_among(&touches[..known], &touch, unit) {
                    touches.push(touch);
                }
            }
        }
    }
}

impl<'a> Side<'a> {
    /// A solid, as a polyhedron if it is one, in front of the `other`, `toward` which it looks; corners up to
    /// `highest` above the front of that one are near, m.
    fn of(
        (own, polyhedron): (Solid<'a>, Option<&'a Polyhedron<'_>>),
        other: Solid<'a>,
        toward: Vec3,
        (sign, first): (f64, u64),
        highest: f64,
    ) -> Self {
        let front = Front::of(other, -toward);
        let round = if polyhedron.is_none() { own.corners(toward) } else { Corners::default() };
        let corners = polyhedron.map_or(Cow::Owned(round.points), |own| Cow::Borrowed(own.corners()));
        let is_near: Vec<bool> = corners.iter().map(|&p| front.height(p) <= highest).collect();
        let mantle = round.edges.first().copied();
        let straight = polyhedron.filter(|own| !own.is_flat()).map_or(&[][..], |own| own.edges());
        let edges = straight.iter().map(|edge| edge.corners.map(|end| end as usize)).chain(round.edges);
        let ends_near = |(_, edge): &(u64, [usize; 2])| edge.iter().any(|&end| is_near[end]);
        let near_edges = (0..).zip(edges).filter(ends_near).collect();
        Self { own, corners, mantle, is_near, near_edges, other, front, outward: -toward, sign, first }
    }

    /// The foremost point of its mantle beside one of it, where that may be as near as the envelope.
    fn foremost(&self, p: Vec3, envelope: f64) -> Vec3 {
        let Solid::Placed { shape, position, orientation } = self.own else { return p };
        let radius = (orientation.conjugate() * (p - position)).truncate().length();
        let is_near =
            shape.form().is_of_revolution() && self.other.distance(p, envelope + NEARER * radius).is_some();
        if is_near { foremost(self.own, self.other, p).unwrap_or(p) } else { p }
    }

    /// A point of this solid, or none where it is not as near as the envelope to the other, or lies beside
    /// the line along which a mantle touches another round solid.
    fn candidate(&self, p: Vec3, is_corner: bool, feature: u64, envelope: f64) -> Option<Candidate> {
        let (distance, inside) = self.other.distance(p, envelope)?;
        let is_kept = !self.is_beside(p, distance.normal);
        is_kept.then(|| self.at(p, distance, inside, is_corner, feature))
    }

    /// Whether the normal of the other round solid at a point of a mantle leads past its axis.
    fn is_beside(&self, p: Vec3, normal: Vec3) -> bool {
        let (Solid::Placed { shape, position, orientation }, Solid::Placed { shape: other, .. }) =
            (self.own, self.other)
        else {
            return false;
        };
        let inverse = orientation.conjugate();
        let (own, normal) = (inverse * (p - position), inverse * normal);
        let touches_mantle =
            || other.form().is_of_revolution() && shape.form().foremost_around(own, normal).is_some();
        own.cross(normal).z.abs() > SAME_POINT * own.truncate().length() && touches_mantle()
    }

    fn at(&self, p: Vec3, distance: Distance, inside: f64, is_corner: bool, feature: u64) -> Candidate {
        let Distance { value, normal } = distance;
        let point = p - 0.5 * value * normal;
        let distance = Distance { value, normal: self.sign * normal };
        Candidate { point, distance, inside, is_corner, feature }
    }

    /// Numbers of the points of edges begin here.
    fn first_of_edges(&self) -> u64 {
        self.first + (self.corners.len() as u64).max(64)
    }
}

/// Corners of one solid near the other. Features count up from the first of the side, and stay below 2^32:
/// the library's own numbers are larger, or zero.
fn of_corners(side: &Side<'_>, envelope: f64, candidates: &mut Vec<Candidate>) {
    for (number, &p) in side.corners.iter().enumerate() {
        if side.is_near[number] {
            let p = if side.mantle.is_some_and(|ends| ends.contains(&number)) {
                side.foremost(p, envelope)
            } else {
                p
            };
            candidates.extend(side.candidate(p, true, side.first + number as u64, envelope));
        }
    }
}

/// Points of the edges of one solid near the edges of the other, a polyhedron.
fn at_rims(
    side: &Side<'_>,
    other: &Polyhedron<'_>,
    rims: &Rims,
    envelope: f64,
    candidates: &mut Vec<Candidate>,
) {
    for &(number, edge) in &side.near_edges {
        let feature = side.first_of_edges() + Rims::numbers(other) * number;
        rims.points(edge.map(|end| side.corners[end]), &mut |found| {
            let EdgePoint { point, distance, is_crossing, number } = found;
            if distance.value <= envelope {
                let inside = if is_crossing { 0.0 } else { f64::NEG_INFINITY };
                candidates.push(side.at(point, distance, inside, false, feature + number));
            }
        });
    }
}

/// Edge crossings and nearest points of edges of one solid against the other, which is round.
fn of_edges(side: &Side<'_>, envelope: f64, candidates: &mut Vec<Candidate>) {
    let &Solid::Placed { shape, position, orientation } = &side.other else { return };
    let form = shape.form();
    let inverse = orientation.conjugate();
    let mut distances: Vec<Option<Distance>> = vec![None; side.corners.len()];
    for &(number, edge) in &side.near_edges {
        let [p, q] = edge.map(|end| inverse * (side.corners[end] - position));
        let (centre, half) = (0.5 * (p + q), 0.5 * (q - p));
        let [at_p, at_q] = [(edge[0], p), (edge[1], q)]
            .map(|(end, p)| *distances[end].get_or_insert_with(|| form.signed_distance(p)));
        if least_between(&at_p, &at_q, half) > envelope * (1.0 + 1e-9) {
            continue;
        }
        let crossings = form.crossings(centre, half);
        let feature = side.first_of_edges() + (1 + crossings.len() as u64) * number;
        let nearest = minimise(|t| form.signed_distance(centre + t * half).normal.dot(half));
        for (t, feature) in std::iter::once(nearest).chain(crossings).zip(feature..) {
            if t.abs() < 1.0 {
                let p = position + orientation * (centre + t * half);
                let p = if side.mantle == Some(edge) { side.foremost(p, envelope) } else { p };
                candidates.extend(side.candidate(p, false, feature, envelope));
            }
        }
    }
}

/// For a point of a mantle: the point at the same height of it that looks at the other solid most, so that
/// the normal there leads through the axis; `None` for what has no mantle there. Anywhere else a contact
/// without friction would spin it.
pub(super) fn foremost(own: Solid<'_>, other: Solid<'_>, p: Vec3) -> Option<Vec3> {
    let (
        Solid::Placed { shape, position, orientation },
        Solid::Placed { shape: other, position: centre, orientation: turn },
    ) = (own, other)
    else {
        return None;
    };
    let inverse = orientation.conjugate();
    let around = |own: Vec3| {
        let at = turn.conjugate() * (position + orientation * own - centre);
        let normal = inverse * (turn * other.form().signed_distance(at).normal);
        shape.form().foremost_around(own, normal)
    };
    let mut own = inverse * (p - position);
    let mut found = around(own)?;
    // From the axis, where it looks at what is across it, it is there at once.
    let height = own * Vec3::Z;
    for look in 0..LOOKS {
        let is_there = (found - own).length() <= LEVEL * (found - height).length();
        own = found;
        if is_there {
            break;
        }
        found = around(if look == 0 { height } else { own })?;
    }
    Some(position + orientation * own)
}

impl Solid<'_> {
    pub(super) fn centre(self) -> Vec3 {
        match self {
            Self::Placed { position, .. } => position,
            Self::Triangle { corners: [a, b, c], .. } => (a + b + c) / 3.0,
        }
    }

    /// How far it reaches along a direction, from the origin of the world, m.
    pub(super) fn reach(self, direction: Vec3) -> f64 {
        let farthest = |points: &[Vec3], along: Vec3| {
            points.iter().map(|p| along.dot(*p)).fold(f64::NEG_INFINITY, f64::max)
        };
        match self {
            Self::Triangle { corners, .. } => farthest(&corners, direction),
            Self::Placed { shape, position, orientation } => {
                direction.dot(position) + shape.form().reach(orientation.conjugate() * direction)
            }
        }
    }

    /// Distance of a point of the world, up to the envelope, and how far its nearest point lies inside a
    /// face, m (negative on an edge); `None` beyond, and behind a triangle.
    fn distance(self, p: Vec3, envelope: f64) -> Option<(Distance, f64)> {
        match self {
            Self::Placed { shape, position, orientation } => {
                let own = orientation.conjugate() * (p - position);
                let Distance { value, normal } = shape.form().signed_distance(own);
                let distance = Distance { value, normal: orientation * normal };
                (value <= envelope).then(|| (distance, shape.form().inside_face(own)))
            }
            Self::Triangle { corners, .. } => {
                let [a, b, c] = corners;
                let face = (b - a).cross(c - a).normalize();
                let (foot, feature) = nearest_on_triangle(p, corners);
                let height = face.dot(p - foot);
                let edge = |k: usize| {
                    let along = (corners[(k + 1) % 3] - corners[k]).normalize();
                    face.cross(along).dot(foot - corners[k])
                };
                let found = if feature == TriangleFeature::Face {
                    (Distance { value: height, normal: face }, edge(0).min(edge(1)).min(edge(2)))
                } else {
                    let value = (p - foot).length();
                    (Distance { value, normal: (p - foot) / value }, f64::NEG_INFINITY)
                };
                (height > 0.0 && found.0.value <= envelope).then_some(found)
            }
        }
    }

    /// Height of a touching point over the flat face whose normal is `outward`, m; `None` for points that do
    /// not touch or lie beside the face.
    fn height_on_face(self, p: Vec3, outward: Vec3, unit: f64) -> Option<f64> {
        let Self::Placed { shape, position, orientation } = self else { return None };
        let inverse = orientation.conjugate();
        let (own, normal) = (inverse * (p - position), inverse * outward);
        let height = shape.form().height_over_face(own, normal, CLEAR * unit)?;
        (height >= -MARGIN * unit && height <= CLEAR * unit).then_some(height)
    }

    /// Corners and edges of what is round, where it is.
    fn corners(self, toward: Vec3) -> Corners {
        let Self::Placed { shape, position, orientation } = self else { return Corners::default() };
        let mut corners = shape.form().corners(orientation.conjugate() * toward);
        corners.points.iter_mut().for_each(|p| *p = position + orientation * *p);
        corners
    }
}
