//! Contacts of polyhedra (boxes, convex hulls, triangles), exact but for rounding.
//!
//! Two convex polyhedra are farthest apart (least deep inside each other) along the normal of a face of one
//! of them or across an edge of each; edges count only where their arcs on the sphere of normals cross (D.
//! Gregorius, "The separating axis test between convex polyhedra", Game Developers Conference 2013). Along
//! that normal n, the faces that look at each other most are projected onto each other: the corners of the
//! common part of both polygons, with their distances along n, are the contacts, whatever the number of
//! corners; so is the pair of features that gave n. Polyhedra that are nearest with a corner or across other
//! edges have those points from [`super::corners`].

use super::manifold::Solid;
use super::reduce::Touch;
use super::sheets::LEVEL;
use crate::hull::HullEdge;
use crate::math::{Mat3, Quat, Vec3, tangents};
use crate::shape::polyhedron::FaceSet;
use crate::shape::{Cuboid, Shape};
use graintrain_linalg::real;

/// By this fraction of the smaller size edges have to be farther apart than faces to be preferred.
const FACES_FIRST: f64 = 1e-9;

/// Points this fraction of the smaller size beside a polygon lie on it.
const BESIDE: f64 = 1e-9;

/// Sine of the angle below which edges are parallel.
const PARALLEL: f64 = 1e-6;

/// Cosine of the angle, 10 degrees, up to which faces look at each other.
const FACING: f64 = 0.985;

/// Cosine of the angle between the normal and a face from which on the face is seen edge-on.
const STEEP: f64 = 0.1;

/// Directions along which polyhedra are looked at before their faces and edges are.
const LOOKS: usize = 6;

/// A contact within this fraction of the smaller size of a corner bears that corner's number, whatever
/// rounding makes of it where corners and edges lie over one another: it stays the same from step to step.
/// More than what `reduce` takes for one point.
const NAMED: f64 = 3e-3;

/// Features of contacts: a corner of A, a corner of B, two edges, the features that gave the normal. Above
/// those of the corners.
const CORNER_OF_A: u64 = 1 << 40;
const CORNER_OF_B: u64 = 2 << 40;
const EDGES: u64 = 3 << 40;
const NEAREST: u64 = 4 << 40;

struct Face<'a> {
    normal: Vec3,
    offset: f64,
    corners: &'a [u32],
}

/// A polyhedron in the frame of the contact.
pub(crate) struct Polyhedron<'a> {
    corners: Vec<Vec3>,
    faces: Vec<Face<'a>>,
    edges: &'a [HullEdge],
    /// Of a triangle, which is without volume and has two faces that look away from each other: the corners
    /// over which it may be left toward its second face.
    open: Option<[bool; 3]>,
}

/// Faces of a box whose corner k lies on the upper side of axis i where bit i of k is set, counter-clockwise
/// from outside.
static BOX_FACES: [[u32; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Its edges along x, y and z, each with the faces of the other two axes on whose sides it lies.
static BOX_EDGES: [HullEdge; 12] = {
    let mut edges = [HullEdge { corners: [0, 0], faces: [0, 0] }; 12];
    let mut number = 0;
    while number < 12 {
        let (axis, turn) = (number as u32 / 4, number as u32 % 4);
        let (second, third) = ((axis + 1) % 3, (axis + 2) % 3);
        let (side, other) = (turn % 2, turn / 2);
        let corner = side << second | other << third;
        let faces = [2 * second + side, 2 * third + other];
        edges[number] = HullEdge { corners: [corner, corner | 1 << axis], faces };
        number += 1;
    }
    edges
};

/// Both sides of a triangle.
static TRIANGLE_FACES: [[u32; 3]; 2] = [[0, 1, 2], [0, 2, 1]];

/// Its sides.
static TRIANGLE_EDGES: [HullEdge; 3] = [
    HullEdge { corners: [0, 1], faces: [0, 1] },
    HullEdge { corners: [1, 2], faces: [0, 1] },
    HullEdge { corners: [2, 0], faces: [0, 1] },
];

impl<'a> Polyhedron<'a> {
    /// The polyhedron that a solid is; `None` for solids with curved faces.
    pub(crate) fn new(solid: Solid<'a>) -> Option<Self> {
        match solid {
            Solid::Placed { shape: Shape::Hull(hull), position, orientation } => {
                let rotation = Mat3::from_quat(orientation);
                let faces = hull.faces().iter().map(|face| {
                    let normal = rotation * face.normal;
                    Face { normal, offset: face.offset + normal.dot(position), corners: &face.corners }
                });
                Some(Self {
                    corners: hull.corners().iter().map(|p| position + rotation * *p).collect(),
                    faces: faces.collect(),
                    edges: hull.edges(),
                    open: None,
                })
            }
            Solid::Placed { shape: &Shape::Box(Cuboid { half }), position, orientation } => {
                Some(Self::of_box(half, position, orientation))
            }
            Solid::Triangle { corners, open } => {
                let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
                let sides = TRIANGLE_FACES.iter().zip([normal, -normal]);
                let faces =
                    sides.map(|(own, normal)| Face { normal, offset: normal.dot(corners[0]), corners: own });
                let corners = corners.to_vec();
                Some(Self { faces: faces.collect(), edges: &TRIANGLE_EDGES, corners, open: Some(open) })
            }
            Solid::Placed { .. } => None,
        }
    }

    fn of_box(half: Vec3, position: Vec3, orientation: Quat) -> Self {
        let axes = Mat3::from_quat(orientation);
        let corner = |k: u32| {
            let side = |axis: u32| if k >> axis & 1 == 1 { 1.0 } else { -1.0 };
            position + axes * (half * Vec3::new(side(0), side(1), side(2)))
        };
        let face = |(k, own): (usize, &'static [u32; 4])| {
            let axis = axes.col(k / 2);
            let normal = if k % 2 == 1 { axis } else { -axis };
            Face { normal, offset: half[k / 2] + normal.dot(position), corners: own.as_slice() }
        };
        Self {
            corners: (0..8).map(corner).collect(),
            faces: BOX_FACES.iter().enumerate().map(face).collect(),
            edges: &BOX_EDGES,
            open: None,
        }
    }

    /// Whether it is a triangle.
    pub(super) fn is_flat(&self) -> bool {
        self.open.is_some()
    }

    /// Whether what overlaps it may leave it along a direction: a triangle not through it to its back, but
    /// over its open corners.
    fn is_left_along(&self, way: Vec3) -> bool {
        let farthest = || self.lowest(-way).0;
        self.open.is_none_or(|open| self.faces[0].normal.dot(way) >= -LEVEL || open[farthest()])
    }

    pub(super) fn corners(&self) -> &[Vec3] {
        &self.corners
    }

    pub(super) fn edges(&self) -> &'a [HullEdge] {
        self.edges
    }

    /// Outward normal n and offset d of the plane of a face, n . x = d.
    pub(super) fn plane(&self, face: u32) -> (Vec3, f64) {
        let Face { normal, offset, .. } = self.faces[face as usize];
        (normal, offset)
    }

    pub(super) fn ends(&self, edge: &HullEdge) -> [Vec3; 2] {
        edge.corners.map(|k| self.corners[k as usize])
    }

    /// The corner least far along a direction, and how far, m.
    fn lowest(&self, direction: Vec3) -> (usize, f64) {
        let heights = self.corners.iter().map(|corner| direction.dot(*corner));
        heights.enumerate().fold((0, f64::INFINITY), |best, next| if next.1 < best.1 { next } else { best })
    }

    /// The corner farthest along a direction.
    fn farthest(&self, direction: Vec3) -> Vec3 {
        let heights = self.corners.iter().map(|corner| (direction.dot(*corner), *corner));
        heights
            .fold((f64::NEG_INFINITY, Vec3::ZERO), |best, next| if next.0 > best.0 { next } else { best })
            .1
    }

    /// The edges that may come within `reach` of another polyhedron: those with no end, or one, higher than
    /// that above the plane of every face of it. Along `normal`, unit and outward, the other reaches
    /// `farthest` from the origin.
    fn edges_near<'b>(
        &'b self,
        other: &Polyhedron<'_>,
        (normal, farthest): (Vec3, f64),
        reach: f64,
    ) -> Vec<&'b HullEdge> {
        let is_high: Vec<bool> = self.corners.iter().map(|p| normal.dot(*p) - farthest > reach).collect();
        let mut above: Vec<Option<FaceSet>> = Vec::new();
        above.resize_with(self.corners.len(), || None);
        let is_near = |edge: &&HullEdge| {
            let ends = edge.corners.map(|k| k as usize);
            if ends.iter().all(|&end| is_high[end]) {
                return false;
            }
            for end in ends {
                above[end].get_or_insert_with(|| {
                    let corner = self.corners[end];
                    FaceSet::of(other.faces.iter().map(|face| face.normal.dot(corner) - face.offset > reach))
                });
            }
            let [from, to] = ends.map(|end| above[end].as_ref());
            from.zip(to).is_none_or(|(from, to)| !from.has_common(to))
        };
        self.edges.iter().filter(is_near).collect()
    }

    /// The edges across which it may be farther than `gap` from a solid that has the point `q`: across an
    /// edge with a corner p it is at most n . (q - p) away, and n lies on the arc between the normals of both
    /// faces, so that n = a n_1 + b n_2 with a + b up to sqrt(2 / (1 + n_1 . n_2)).
    fn edges_toward(&self, q: Vec3, gap: f64) -> Vec<&HullEdge> {
        let is_toward = |edge: &&HullEdge| {
            let way = q - self.corners[edge.corners[0] as usize];
            let normals = edge.faces.map(|k| self.faces[k as usize].normal);
            let most = way.dot(normals[0]).max(way.dot(normals[1]));
            let cosine = normals[0].dot(normals[1]);
            gap <= 0.0 || (most > 0.0 && 2.0 * most * most > gap * gap * (1.0 + cosine))
        };
        self.edges.iter().filter(is_toward).collect()
    }

    fn middle(&self) -> Vec3 {
        self.corners.iter().sum::<Vec3>() / self.corners.len() as f64
    }

    /// The face that looks most along a direction.
    fn facing(&self, direction: Vec3) -> &Face<'a> {
        let better =
            |best: &'_ Face<'a>, next: &'_ Face<'a>| next.normal.dot(direction) > best.normal.dot(direction);
        self.faces[1..].iter().fold(&self.faces[0], |best, next| if better(best, next) { next } else { best })
    }
}

/// What two polyhedra are farthest apart along.
struct Separation {
    /// Unit normal from A to B.
    normal: Vec3,
    /// Distance along it, m; negative where they overlap.
    gap: f64,
    /// The point of each that gives the gap, and whether they lie over one another.
    points: [Vec3; 2],
    are_nearest: bool,
}

/// Adds the contacts of two polyhedra with gap up to the envelope, normals from B to A. Returned is whether
/// the least gap is that of all points, or `None` if they are farther apart than the envelope. `unit` is the
/// size of the smaller one.
pub(crate) fn polyhedron_contacts(
    a: &Polyhedron<'_>,
    b: &Polyhedron<'_>,
    unit: f64,
    envelope: f64,
    touches: &mut Vec<Touch>,
) -> Option<bool> {
    let best = separation(a, b, unit, envelope)?;
    let Separation { normal, gap, points: [p, q], are_nearest } = between_faces(a, b, unit, best);
    let is_near = |p: Vec3, q: Vec3| {
        let away = p - q;
        (away - away.dot(normal) * normal).length_squared() <= (NAMED * unit).powi(2)
    };
    let faces = [a.facing(normal), b.facing(-normal)];
    let name = |point: Vec3, feature| {
        let of = |own: &Polyhedron<'_>, face: &Face<'_>, first: u64| {
            let near = |corner: &&u32| is_near(own.corners[**corner as usize], point);
            face.corners.iter().find(near).map(|&corner| first + u64::from(corner))
        };
        of(a, faces[0], CORNER_OF_A).or_else(|| of(b, faces[1], CORNER_OF_B)).unwrap_or(feature)
    };
    clipped([a, b], faces, normal, unit, &mut |point, gap, feature| {
        if gap <= envelope {
            touches.push(Touch { point, normal: -normal, gap, feature: name(point, feature) });
        }
    });
    // Overlapping polyhedra always have a contact, even where rounding puts it beside both polygons.
    if are_nearest || (touches.is_empty() && gap <= 0.0) {
        let point = 0.5 * (p + q);
        // Where it is one of the others, by its name.
        let known = touches.iter().find(|touch| is_near(touch.point, point)).map(|touch| touch.feature);
        let feature = known.unwrap_or_else(|| name(point, NEAREST));
        touches.push(Touch { point, normal: -normal, gap, feature });
    }
    // No point is deeper inside the other than they overlap, and the face of least depth has the point of
    // that depth over it.
    Some(are_nearest || gap <= 0.0)
}

/// A bound of the distance of two polyhedra from above, m; `None` if they are seen to be farther apart than
/// the envelope. Of the differences v = q - p of their points one is as long as they are apart, and with w
/// the farthest of them against v they are apart by at least v . w / |v|: from the middles on, v goes toward
/// w as far as that makes it shorter (M. Frank, P. Wolfe, "An algorithm for quadratic programming", Naval
/// Research Logistics Quarterly 3:95-110, 1956).
fn distance_bound(a: &Polyhedron<'_>, b: &Polyhedron<'_>, envelope: f64) -> Option<f64> {
    let mut v = b.middle() - a.middle();
    for _ in 0..LOOKS {
        let length = v.length();
        if length <= envelope {
            break;
        }
        let w = b.corners[b.lowest(v).0] - a.farthest(v);
        if v.dot(w) > envelope * length {
            return None;
        }
        let way = w - v;
        let fraction = -v.dot(way) / way.length_squared();
        // Along v itself nothing is nearer.
        if fraction.is_nan() || fraction <= 0.0 {
            break;
        }
        v += fraction.min(1.0) * way;
    }
    Some(v.length())
}

/// Whether what overlaps can be parted along a normal, from A to B.
fn part(a: &Polyhedron<'_>, b: &Polyhedron<'_>, normal: Vec3) -> bool {
    a.is_left_along(normal) && b.is_left_along(-normal)
}

/// The normal along which the polyhedra are farthest apart; `None` if that is more than the envelope. Of
/// edges those come first that may be nearest to each other: polyhedra are apart by no more than the bound,
/// and where they overlap, the edges across which they do so least cross each other at a distance of that
/// depth.
fn separation(a: &Polyhedron<'_>, b: &Polyhedron<'_>, unit: f64, envelope: f64) -> Option<Separation> {
    let bound = distance_bound(a, b, envelope)?;
    let mut best: Option<Separation> = None;
    // Faces of A look along the normal, those of B against it.
    for (one, other, sign) in [(a, b, 1.0), (b, a, -1.0)] {
        // A face has the other solid at most as high above it as this corner: most look away.
        let toward = other.middle() - one.middle();
        let nearest = other.corners[other.lowest(toward).0];
        for face in &one.faces {
            let is_less =
                |best: &Separation, height: f64| height - face.offset <= best.gap + FACES_FIRST * unit;
            if best.as_ref().is_some_and(|best| is_less(best, face.normal.dot(nearest))) {
                continue;
            }
            let (corner, height) = other.lowest(face.normal);
            let gap = height - face.offset;
            if gap > envelope {
                return None;
            }
            let normal = sign * face.normal;
            if !best.as_ref().is_some_and(|best| is_less(best, height)) && (gap > 0.0 || part(a, b, normal)) {
                let point = other.corners[corner];
                let foot = point - gap * face.normal;
                let points = if sign > 0.0 { [foot, point] } else { [point, foot] };
                let are_nearest = is_over(one, face, foot, BESIDE * unit);
                best = Some(Separation { normal, gap, points, are_nearest });
            }
        }
    }
    let best = best?;
    if best.gap > 0.0 && best.are_nearest {
        return Some(best);
    }
    let reach = if best.gap > 0.0 { bound } else { -best.gap } + BESIDE * unit;
    // The best normal leads from A to B.
    let [of_a, of_b] = [(best.normal, a), (-best.normal, b)].map(|(n, own)| (n, n.dot(own.farthest(n))));
    let near = [a.edges_near(b, of_b, reach), b.edges_near(a, of_a, reach)];
    let best = across_edges([a, b], &near, unit, envelope, best)?;
    if best.are_nearest {
        return Some(best);
    }
    // Nearest with a corner: the normal that all edges give is nearer to the way from it.
    let [p, q] = [a.farthest(best.normal), b.farthest(-best.normal)];
    // Those of a triangle have no arcs.
    let any = a.is_flat() || b.is_flat();
    let facing = [(a, q), (b, p)]
        .map(|(own, other)| if any { own.edges.iter().collect() } else { own.edges_toward(other, best.gap) });
    across_edges([a, b], &facing, unit, envelope, best)
}

/// Where borders of two faces that do not look at each other lie together (an edge along an edge: two cards
/// that lean on each other), both part the polyhedra, and everything between their normals: the normal
/// halfway, which prefers neither. Not where faces that look at each other part them as well.
fn between_faces(a: &Polyhedron<'_>, b: &Polyhedron<'_>, unit: f64, best: Separation) -> Separation {
    let near = NAMED * unit;
    if best.gap.abs() > near || a.is_flat() || b.is_flat() {
        return best;
    }
    let parts = |other: &Polyhedron<'_>, face: &Face<'_>| {
        let gap = other.lowest(face.normal).1 - face.offset;
        (gap >= best.gap - near).then_some((gap, face.normal))
    };
    let halfway = |one: &Polyhedron<'_>, other: &Polyhedron<'_>, face: &Face<'_>, foot: Vec3| {
        if is_over(one, face, foot, -near) {
            return None;
        }
        let all: Vec<(f64, Vec3)> = other.faces.iter().filter_map(|face| parts(one, face)).collect();
        let is_faced = |&(_, normal): &(f64, Vec3)| {
            let mut facing = one.faces.iter().filter(|own| -own.normal.dot(normal) > FACING);
            facing.any(|own| parts(other, own).is_some())
        };
        if all.iter().any(is_faced) {
            return None;
        }
        let (_, normal) = all.into_iter().max_by(|x, y| x.0.total_cmp(&y.0))?;
        Some((face.normal - normal).normalize_or_zero())
    };
    let [face_a, face_b] = [a.facing(best.normal), b.facing(-best.normal)];
    if -face_a.normal.dot(face_b.normal) > FACING {
        return best;
    }
    let normal = if face_a.normal == best.normal {
        halfway(a, b, face_a, best.points[0])
    } else if face_b.normal == -best.normal {
        halfway(b, a, face_b, best.points[1]).map(|normal| -normal)
    } else {
        None
    };
    let Some(normal) = normal else { return best };
    let points = [a.farthest(normal), b.farthest(-normal)];
    let gap = normal.dot(points[1] - points[0]);
    if gap < best.gap - near { best } else { Separation { normal, gap, points, are_nearest: false } }
}

/// The best separation known, or that across an edge of each polyhedron, of those given; `None` if they are
/// farther apart than the envelope.
fn across_edges(
    [a, b]: [&Polyhedron<'_>; 2],
    [edges_a, edges_b]: &[Vec<&HullEdge>; 2],
    unit: f64,
    envelope: f64,
    mut best: Separation,
) -> Option<Separation> {
    let toward = b.middle() - a.middle();
    let any = a.is_flat() || b.is_flat();
    let arcs_b: Vec<Arc> = edges_b.iter().map(|edge| Arc::of(b, edge, -1.0)).collect();
    for edge_a in edges_a {
        let [p0, p1] = a.ends(edge_a);
        let along_a = p1 - p0;
        let arc_a = Arc::of(a, edge_a, 1.0);
        for (edge_b, arc_b) in edges_b.iter().zip(&arcs_b) {
            if !any && !arc_a.crosses(arc_b) {
                continue;
            }
            let [q0, q1] = b.ends(edge_b);
            let along_b = q1 - q0;
            let across = along_a.cross(along_b);
            let length = across.length();
            if length <= PARALLEL * along_a.length() * along_b.length() {
                continue;
            }
            let mut normal = across / length;
            // Away from A: for polyhedra without volume the side is the one on which B is.
            let outward = if any { normal.dot(toward) } else { normal.dot(arc_a.ends[0] + arc_a.ends[1]) };
            if outward < 0.0 {
                normal = -normal;
            }
            let gap = if any { b.lowest(normal).1 + a.lowest(-normal).1 } else { normal.dot(q0 - p0) };
            if gap > envelope {
                return None;
            }
            let is_more = gap > best.gap + FACES_FIRST * unit;
            let of_edges = !any || normal.dot(q0 - p0) <= gap + BESIDE * unit;
            if is_more && of_edges && (gap > 0.0 || part(a, b, normal)) {
                let (s, t) = nearest_parameters(p0, along_a, q0, along_b);
                let are_nearest = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
                let [s, t] = [s, t].map(|x| x.clamp(0.0, 1.0));
                best = Separation { normal, gap, points: [p0 + s * along_a, q0 + t * along_b], are_nearest };
            }
        }
    }
    Some(best)
}

/// The arc between the normals of both faces of an edge, on the unit sphere.
struct Arc {
    ends: [Vec3; 2],
    /// Normal of its plane.
    across: Vec3,
}

impl Arc {
    fn of(polyhedron: &Polyhedron<'_>, edge: &HullEdge, sign: f64) -> Self {
        let ends = edge.faces.map(|k| sign * polyhedron.faces[k as usize].normal);
        Self { ends, across: ends[1].cross(ends[0]) }
    }

    fn crosses(&self, other: &Self) -> bool {
        let [c, d] = other.ends.map(|end| end.dot(self.across));
        if c * d >= 0.0 {
            return false;
        }
        let [a, b] = self.ends.map(|end| end.dot(other.across));
        a * b < 0.0 && c * b > 0.0
    }
}

/// Where two lines that are not parallel are nearest to each other, as fractions of their directions.
fn nearest_parameters(p: Vec3, along_a: Vec3, q: Vec3, along_b: Vec3) -> (f64, f64) {
    let (aa, ab, bb) = (along_a.length_squared(), along_a.dot(along_b), along_b.length_squared());
    let (apart_a, apart_b) = (along_a.dot(q - p), along_b.dot(q - p));
    let determinant = aa * bb - ab * ab;
    ((apart_a * bb - apart_b * ab) / determinant, (apart_a * ab - apart_b * aa) / determinant)
}

/// Whether a point of the plane of a face lies on the face, or beside it by no more than so much, m.
fn is_over(polyhedron: &Polyhedron<'_>, face: &Face<'_>, point: Vec3, beside: f64) -> bool {
    sides(face.corners).all(|(a, b)| {
        let [a, b] = [a, b].map(|k| polyhedron.corners[k as usize]);
        let inward = face.normal.cross(b - a);
        inward.dot(point - a) >= -beside * inward.length()
    })
}

/// The sides of a polygon as pairs of corners.
fn sides(corners: &[u32]) -> impl Iterator<Item = (u32, u32)> + '_ {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

/// Calls `add` with middle, distance along the normal and feature of every corner of what the two faces that
/// look at each other most have in common, seen along the normal (from A to B).
fn clipped(
    [a, b]: [&Polyhedron<'_>; 2],
    [face_a, face_b]: [&Face<'_>; 2],
    normal: Vec3,
    unit: f64,
    add: &mut dyn FnMut(Vec3, f64, u64),
) {
    let (t1, t2) = tangents(normal);
    let flat = |p: Vec3| [t1.dot(p), t2.dot(p)];
    let cross =
        |a: [f64; 2], b: [f64; 2], p: [f64; 2]| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
    // Corners of one face over the other; seen along the normal, A's face runs counter-clockwise and B's
    // clockwise.
    let corners = [(a, face_a, b, face_b, -1.0, CORNER_OF_A), (b, face_b, a, face_a, 1.0, CORNER_OF_B)];
    for (own, own_face, other, other_face, turn, first) in corners {
        let steep = other_face.normal.dot(normal);
        if steep.abs() < STEEP {
            continue;
        }
        for &corner in own_face.corners {
            let p = own.corners[corner as usize];
            let over = sides(other_face.corners).all(|(c, d)| {
                let [c, d] = [c, d].map(|k| flat(other.corners[k as usize]));
                turn * cross(c, d, flat(p)) >= -BESIDE * unit * real::hypot(d[0] - c[0], d[1] - c[1])
            });
            if over {
                // From the corner along the normal to the other face's plane.
                let way = (other_face.offset - other_face.normal.dot(p)) / steep;
                add(p + 0.5 * way * normal, -turn * way, first + u64::from(corner));
            }
        }
    }
    for (p0, p1) in sides(face_a.corners) {
        let [from_a, to_a] = [p0, p1].map(|k| a.corners[k as usize]);
        let [p, r] = [from_a, to_a].map(flat);
        for (q0, q1) in sides(face_b.corners) {
            let [from_b, to_b] = [q0, q1].map(|k| b.corners[k as usize]);
            let [q, s] = [from_b, to_b].map(flat);
            let (left, right) = (cross(p, r, q), cross(p, r, s));
            let (before, beyond) = (cross(q, s, p), cross(q, s, r));
            // Sides that lie along each other have corners of one on the other, and cross nowhere.
            let apart = |one: f64, two: f64, [a, b]: [[f64; 2]; 2]| {
                one * two < 0.0 && (one - two).abs() > BESIDE * unit * real::hypot(b[0] - a[0], b[1] - a[1])
            };
            if apart(left, right, [p, r]) && apart(before, beyond, [q, s]) {
                let on_a = from_a + before / (before - beyond) * (to_a - from_a);
                let on_b = from_b + left / (left - right) * (to_b - from_b);
                let feature = EDGES + (u64::from(p0) << 20) + u64::from(q0);
                add(0.5 * (on_a + on_b), normal.dot(on_b - on_a), feature);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::Hull;
    use crate::math::rotation_exponential;
    use proptest::prelude::*;

    fn stone() -> Shape {
        let point = |k: u32| {
            let (a, b) = (1.7 * f64::from(k), 2.9 * f64::from(k));
            Vec3::new(0.5 * a.sin(), 0.4 * b.cos(), 0.3 * (a + b).sin())
        };
        Shape::Hull(Hull::new(&(0..20).map(point).collect::<Vec<_>>()).unwrap().0)
    }

    /// The largest gap along the normals of all faces and of all pairs of edges, each measured by the corners
    /// of both: no pair is left out for its place or its arcs.
    fn largest_gap(a: &Polyhedron<'_>, b: &Polyhedron<'_>) -> f64 {
        let gap = |normal: Vec3| b.lowest(normal).1 - normal.dot(a.farthest(normal));
        let faces = a.faces.iter().map(|face| face.normal).chain(b.faces.iter().map(|face| -face.normal));
        let across = |edge_a: &HullEdge| {
            let [p0, p1] = a.ends(edge_a);
            let normals = b.edges.iter().flat_map(move |edge_b| {
                let [q0, q1] = b.ends(edge_b);
                let normal = (p1 - p0).cross(q1 - q0).normalize_or_zero();
                [normal, -normal]
            });
            normals.filter(|normal| *normal != Vec3::ZERO).map(gap).fold(f64::NEG_INFINITY, f64::max)
        };
        let edges = a.edges.iter().map(across).fold(f64::NEG_INFINITY, f64::max);
        faces.map(gap).fold(edges, f64::max)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// The separation is the largest of all that faces and edges give, and pairs are given up only where
        /// it is beyond the envelope.
        #[test]
        fn no_axis_separates_farther(
            place in prop::array::uniform3(-1.0..1.0_f64),
            turns in prop::array::uniform2(prop::array::uniform3(-3.0..3.0_f64)),
            distance in 0.3..1.6_f64,
            is_box in any::<bool>(),
        ) {
            let (stone, block) = (stone(), Shape::Box(Cuboid { half: Vec3::new(0.5, 0.3, 0.05) }));
            let position = distance * Vec3::from_array(place).normalize_or(Vec3::X);
            let turns = turns.map(|turn| rotation_exponential(Vec3::from_array(turn)));
            let other = if is_box { &block } else { &stone };
            let one = Solid::Placed { shape: &stone, position: -0.5 * position, orientation: turns[0] };
            let other = Solid::Placed { shape: other, position: 0.5 * position, orientation: turns[1] };
            let [a, b] = [one, other].map(|solid| Polyhedron::new(solid).unwrap());
            let exact = largest_gap(&a, &b);
            let found = separation(&a, &b, 0.5, f64::INFINITY).unwrap();
            // Apart and nearest with a corner, they are farther apart along other normals than those of faces
            // and crossing edges.
            prop_assert!(found.gap <= exact + 1e-8, "{} {exact}", found.gap);
            if exact < 0.0 || found.are_nearest {
                prop_assert!((found.gap - exact).abs() < 1e-8, "{} {exact}", found.gap);
                prop_assert!(separation(&a, &b, 0.5, exact + 1e-8).is_some());
            }
            if exact > 0.0 && found.are_nearest {
                prop_assert!(separation(&a, &b, 0.5, exact - 1e-8).is_none());
                let [p, q] = found.points;
                prop_assert!(((q - p).length() - exact).abs() < 1e-9);
            }
        }
    }
}
