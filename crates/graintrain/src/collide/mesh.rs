//! Contacts of all other shapes with a triangle mesh.
//!
//! Every triangle near the body gives contacts of its own; then contacts that exist only because the mesh is
//! cut into triangles are removed. A contact on an edge or corner is real only if it is a local minimum of
//! the distance to the whole surface, that is if every triangle that shares the edge or corner gives the same
//! nearest point. For what has flat faces: if the surface does not rise along the normal beyond the edge over
//! which it tilts.

use super::capsule::{capsule_contacts, triangle_crossings};
use super::manifold::{Solid, manifold_contacts};
use super::reduce::Touch;
use super::sheets::{LEVEL, Sheets};
use super::triangle::{TriangleFeature, nearest_on_triangle};
use crate::math::{Mat3, Quat, Vec3, mix};
use crate::shape::{Capsule, Distance, Mesh, Shape, Sphere};
use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use std::collections::HashMap;

/// A mesh with a tree over its triangles, made once per geometry.
pub(crate) struct TriangleTree {
    corners: Vec<[Vec3; 3]>,
    /// Vertex numbers in which vertices at the same place have one number, so that triangles that share an
    /// edge know.
    shared: Vec<[u32; 3]>,
    /// Triangles around every vertex.
    at_vertex: TrianglesAround,
    tree: Bvh,
    sheets: Sheets,
}

/// The triangles around every vertex number, ascending.
struct TrianglesAround {
    /// Vertex number n has those from `first[n]` to before `first[n + 1]`.
    first: Vec<u32>,
    triangles: Vec<u32>,
}

impl TrianglesAround {
    fn new(shared: &[[u32; 3]], vertices: usize) -> Self {
        let mut first = vec![0; vertices + 1];
        let corners = || {
            shared.iter().enumerate().flat_map(|(t, numbers)| once_each(numbers).map(move |n| (t as u32, n)))
        };
        for (_, number) in corners() {
            first[number as usize + 1] += 1;
        }
        for n in 0..vertices {
            first[n + 1] += first[n];
        }
        let (mut next, mut triangles) = (first.clone(), vec![0; first[vertices] as usize]);
        for (triangle, number) in corners() {
            triangles[next[number as usize] as usize] = triangle;
            next[number as usize] += 1;
        }
        Self { first, triangles }
    }

    fn of(&self, number: u32) -> &[u32] {
        let [from, to] = [number as usize, number as usize + 1].map(|n| self.first[n] as usize);
        &self.triangles[from..to]
    }
}

/// The corners of a triangle, those of one without area not twice.
fn once_each(numbers: &[u32; 3]) -> impl Iterator<Item = u32> {
    let [a, b, c] = *numbers;
    [Some(a), (b != a).then_some(b), (c != a && c != b).then_some(c)].into_iter().flatten()
}

/// A shape near the mesh, in the mesh's frame.
pub(crate) struct Visitor<'a> {
    pub shape: &'a Shape,
    pub position: Vec3,
    pub orientation: Quat,
}

impl Visitor<'_> {
    /// How far it reaches along a direction from its position, m.
    fn reach(&self, direction: Vec3) -> f64 {
        self.shape.form().reach(self.orientation.conjugate() * direction)
    }

    /// Where the round that has this point of its surface comes nearest to a plane with this normal. The
    /// point itself comes down only as the body rolls on: linearised, as far in half the way, and what rolls
    /// would be lifted. Points of other bodies, and of one whose flat end lies on the plane, are kept.
    fn foremost_around(&self, point: Vec3, normal: Vec3) -> Vec3 {
        let inverse = self.orientation.conjugate();
        let own = self.shape.form().foremost_around(inverse * (point - self.position), inverse * normal);
        own.map_or(point, |own| self.position + self.orientation * own)
    }
}

/// Contact with one triangle, with what is needed to tell real from apparent edges.
struct Candidate {
    touch: Touch,
    triangle: u32,
    /// The side of the surface on which the body is, as by [`Sheets::sides`].
    side: Option<f64>,
    /// Normal of the triangle's face toward the body.
    toward: Vec3,
    /// Nearest point of the triangle.
    foot: Vec3,
    feature: TriangleFeature,
}

/// Features of the lowest points of what leaves a triangle to its front, above those of its other contacts.
const LOWEST: u64 = 1 << 62;

/// Cosine of an angle up to which a normal may be that of a face, 6 degrees.
const NEARLY: f64 = 0.995;

/// Less than this of what a flat surface rises along a normal makes a ridge: on what is flat but for rounding
/// it is 1, and half as much loses normals of corners.
const RIDGE: f64 = 0.9;

impl TriangleTree {
    pub(crate) fn new(Mesh { vertices, triangles, solid }: &Mesh) -> Self {
        let mut numbers: HashMap<[u64; 3], u32> = HashMap::new();
        let mut shared_number = |v: Vec3| {
            // Adding zero turns -0 into +0.
            let key = (v + Vec3::ZERO).to_array().map(f64::to_bits);
            let next = numbers.len() as u32;
            *numbers.entry(key).or_insert(next)
        };
        let corners: Vec<[Vec3; 3]> = triangles.iter().map(|t| t.map(|v| vertices[v as usize])).collect();
        let shared: Vec<[u32; 3]> = corners.iter().map(|t| t.map(&mut shared_number)).collect();
        let at_vertex = TrianglesAround::new(&shared, numbers.len());
        let boxes: Vec<Aabb> =
            corners.iter().map(|t| Aabb::new(t[0].min(t[1]).min(t[2]), t[0].max(t[1]).max(t[2]))).collect();
        let tree = Bvh::from_leaves(BvhBuildStrategy::default(), &boxes);
        let sheets = Sheets::new(&shared, *solid);
        Self { corners, shared, at_vertex, tree, sheets }
    }

    /// Contacts with gap up to the envelope, in the mesh's frame, normals from the mesh to the visitor.
    pub(crate) fn contacts(&self, visitor: &Visitor<'_>, envelope: f64, touches: &mut Vec<Touch>) {
        let near = self.around(visitor, envelope);
        let mut candidates: Vec<Candidate> = Vec::new();
        let sides = self.sheets.sides(&near, visitor.position, &self.corners, |triangle| self.face(triangle));
        let is_met = self.meets(visitor, envelope);
        for (&triangle, &side) in near.iter().zip(&sides).filter(|(triangle, _)| is_met(**triangle)) {
            let first = candidates.len();
            self.triangle_contacts(triangle, visitor, side, envelope, &mut candidates);
            self.keep_to_side(first, visitor, envelope, &mut candidates);
        }
        if !matches!(visitor.shape, Shape::Sphere(_)) {
            self.leave_surface(&mut candidates, visitor);
        }
        let real = candidates.iter().filter(|c| self.is_real(c, &candidates, visitor));
        touches.extend(real.map(|c| c.touch));
    }

    /// The corners of the triangles that may be as near to a visitor as `envelope`, in the mesh's frame.
    pub(super) fn near(&self, visitor: &Visitor<'_>, envelope: f64) -> Vec<[Vec3; 3]> {
        let meets = self.meets(visitor, envelope);
        let near = self.around(visitor, envelope).into_iter().filter(|&triangle| meets(triangle));
        near.map(|triangle| self.corners[triangle as usize]).collect()
    }

    /// Triangles in the box around the ball around a visitor, ascending.
    fn around(&self, visitor: &Visitor<'_>, envelope: f64) -> Vec<u32> {
        let reach = visitor.shape.bounding_radius() + envelope;
        let around = Aabb::new(visitor.position - reach, visitor.position + reach);
        let mut near: Vec<u32> = self.tree.intersect_aabb(&around).collect();
        near.sort_unstable();
        near
    }

    /// Whether a triangle reaches into the box around a visitor.
    fn meets(&self, visitor: &Visitor<'_>, envelope: f64) -> impl Fn(u32) -> bool {
        let [low, high] = [-1.0, 1.0].map(|sign| {
            let farthest = |axis: Vec3| sign * (visitor.reach(sign * axis) + envelope);
            visitor.position + Vec3::from_array(Vec3::AXES.map(farthest))
        });
        move |triangle| {
            let [a, b, c] = self.corners[triangle as usize];
            a.max(b).max(c).cmpge(low).all() && a.min(b).min(c).cmple(high).all()
        }
    }

    fn triangle_contacts(
        &self,
        triangle: u32,
        visitor: &Visitor<'_>,
        side: Option<f64>,
        envelope: f64,
        candidates: &mut Vec<Candidate>,
    ) {
        let (corners, face) = (self.corners[triangle as usize], self.face(triangle));
        let height = face.dot(visitor.position - corners[0]);
        let toward = if side.unwrap_or(height) < 0.0 { -face } else { face };
        let above = 1.0_f64.copysign(height) * face;
        if height.abs() - visitor.reach(-above) > envelope {
            return;
        }
        let mut touches: Vec<Touch> = Vec::new();
        match *visitor.shape {
            Shape::Sphere(Sphere { radius }) => {
                let (foot, feature) = nearest_on_triangle(visitor.position, corners);
                let Distance { value, normal } = unsigned_distance(visitor.position, foot, toward);
                let gap = value - radius;
                if gap <= envelope {
                    let point = foot + 0.5 * gap * normal;

                    let touch = Touch { point, normal, gap, feature: triangle_feature(triangle, 0) };
                    candidates.push(Candidate { touch, triangle, side, toward, foot, feature });
                }
                return;
            }
            Shape::Capsule(Capsule { half_length, radius }) => {
                let half_axis = visitor.orientation * Vec3::new(0.0, 0.0, half_length);
                let distance = |p: Vec3| unsigned_distance(p, nearest_on_triangle(p, corners).0, toward);
                let borders = triangle_crossings(corners, face, visitor.position, half_axis);
                let centre = visitor.position;
                capsule_contacts(centre, half_axis, radius, distance, &borders, envelope, &mut touches);
            }
            Shape::Plane(_) | Shape::Mesh(_) => return,
            _ => {
                let Visitor { shape, position, orientation } = *visitor;
                let solid = Solid::Placed { shape, position, orientation };
                let unit = shape.bounding_radius();
                let [a, b, c] = corners;
                // Who is behind it, beyond a ridge say, is not held in front of it.
                let is_free = side.is_none() || toward.dot(position - a) < 0.0;
                let border = self.sheets.border(triangle);
                let is_open = |k: usize| is_free || border[k] || self.falls_beyond(triangle, &[k], toward);
                let [p, q, r] = [0, 1, 2].map(is_open);
                let (facing, open) =
                    if toward == face { ([a, b, c], [p, q, r]) } else { ([a, c, b], [p, r, q]) };
                let facing = Solid::Triangle { corners: facing, open };
                manifold_contacts(solid, facing, unit, position, envelope, &mut touches);
            }
        }
        for mut touch in touches {
            touch.feature = triangle_feature(triangle, touch.feature);
            let (foot, feature) = nearest_on_triangle(touch.point - 0.5 * touch.gap * touch.normal, corners);
            candidates.push(Candidate { touch, triangle, side, toward, foot, feature });
        }
    }

    /// Takes away the candidates from `first` on, of one triangle, that look through the surface: contacts
    /// with the far side of an edge. What overlaps the triangle in front of it leaves it to its front all the
    /// same: its points that are lowest there and over the triangle are added. Contacts over the border of
    /// the surface stay.
    fn keep_to_side(
        &self,
        first: usize,
        visitor: &Visitor<'_>,
        envelope: f64,
        candidates: &mut Vec<Candidate>,
    ) {
        let hair = LEVEL * visitor.shape.bounding_radius();
        let is_through = |c: &Candidate| {
            c.side.is_some() && c.toward.dot(c.touch.normal) < -LEVEL && !self.is_over_border(c, hair)
        };
        let through = candidates.extract_if(first.., |candidate| is_through(candidate));
        let is_held = |candidate: &Candidate| candidate.touch.gap <= 0.0 && !self.is_over_ridge(candidate);
        let Some(overlapping) = through.filter(is_held).last() else { return };
        let Candidate { triangle, side, toward, .. } = overlapping;
        let corners = self.corners[triangle as usize];
        let Visitor { shape, position, orientation } = *visitor;
        if toward.dot(position - corners[0]) < 0.0 {
            return;
        }
        shape.form().lowest_points(orientation.conjugate() * -toward, &mut |own, radius, feature| {
            let point = position + orientation * own - radius * toward;
            let gap = toward.dot(point - corners[0]);
            let (foot, on) = nearest_on_triangle(point - gap * toward, corners);
            if gap <= envelope && (foot - point + gap * toward).length() <= hair {
                let feature = triangle_feature(triangle, LOWEST + feature);
                let touch = Touch { point: point - 0.5 * gap * toward, normal: toward, gap, feature };
                candidates.push(Candidate { touch, triangle, side, toward, foot, feature: on });
            }
        });
    }

    /// Whether the surface falls behind the face of a triangle, as seen from where it looks `toward`, beyond
    /// an edge or corner of it: a ridge, over which what overlaps may leave it.
    fn falls_beyond(&self, triangle: u32, ends: &[usize], toward: Vec3) -> bool {
        let at = self.corners[triangle as usize][ends[0]];
        let numbers: Vec<u32> = ends.iter().map(|&end| self.shared[triangle as usize][end]).collect();
        let falls = |p: &Vec3| toward.dot((*p - at).normalize_or_zero()) < -LEVEL;
        self.sharing(triangle, &numbers).any(|other| self.corners[other as usize].iter().any(falls))
    }

    /// Whether the normal leads over a ridge of the surface.
    fn is_over_ridge(&self, candidate: &Candidate) -> bool {
        let Candidate { triangle, toward, .. } = *candidate;
        match self.exit(candidate) {
            TriangleFeature::Face => false,
            TriangleFeature::Edge(k) => self.falls_beyond(triangle, &[k, (k + 1) % 3], toward),
            TriangleFeature::Vertex(k) => self.falls_beyond(triangle, &[k], toward),
        }
    }

    /// Whether the normal leads over the border of the sheet: a hair along it lies on the border.
    fn is_over_border(&self, candidate: &Candidate, hair: f64) -> bool {
        let way = candidate.touch.normal.reject_from(candidate.toward).normalize_or_zero();
        let corners = self.corners[candidate.triangle as usize];
        let (_, feature) = nearest_on_triangle(candidate.foot + hair * way, corners);
        self.sheets.is_border(candidate.triangle, feature)
    }

    /// The normal of the face of a triangle.
    fn face(&self, triangle: u32) -> Vec3 {
        let [a, b, c] = self.corners[triangle as usize];
        (b - a).cross(c - a).normalize()
    }

    /// The other triangles that have these corners of a triangle.
    fn sharing<'a>(&'a self, triangle: u32, corners: &'a [u32]) -> impl Iterator<Item = u32> + 'a {
        let (first, rest) = corners.split_first().expect("an edge or a corner");
        let has_all = |other: u32| rest.iter().all(|v| self.shared[other as usize].contains(v));
        self.at_vertex.of(*first).iter().copied().filter(move |&other| other != triangle && has_all(other))
    }

    /// The edge or corner over which the way along the normal, from the nearest point, leaves the triangle;
    /// `Face` where it does not.
    fn exit(&self, candidate: &Candidate) -> TriangleFeature {
        let Candidate { triangle, foot, touch: Touch { normal, .. }, .. } = *candidate;
        let corners = self.corners[triangle as usize];
        let far = corners.iter().map(|corner| (*corner - foot).length()).fold(0.0, f64::max);
        let face = self.face(triangle);
        let way = normal.reject_from(face).normalize_or_zero();
        // Along the way to the first border; a hair beyond it the nearest feature is where it left.
        let borders = (0..3).filter_map(|k| {
            let out = (corners[(k + 1) % 3] - corners[k]).cross(face).normalize();
            let speed = out.dot(way);
            (speed > LEVEL).then(|| (out.dot(corners[k] - foot) / speed).max(0.0))
        });
        let leaves = borders.fold(far, f64::min);
        // As far as it overlaps the triangle its place is uncertain.
        let near = (-candidate.touch.gap).max(0.0) + LEVEL * far;
        let from = |k: usize| (corners[k] - foot - leaves * way).length();
        let corner = (0..3).min_by(|&k, &l| from(k).total_cmp(&from(l))).filter(|&k| from(k) <= near);
        let feature = || nearest_on_triangle(foot + (leaves + LEVEL * far) * way, corners).1;
        corner.map_or_else(feature, TriangleFeature::Vertex)
    }

    /// Where the normal tilts from the face of the triangle over an edge or corner beyond which the surface
    /// rises along it, so that the points beyond are nearer to the body and the edge bears nothing: the sines
    /// by which what is beyond rises in front of the face, negative at a ridge, and along the normal. `None`
    /// elsewhere.
    fn rise_beyond(&self, candidate: &Candidate) -> Option<[f64; 2]> {
        let (normal, triangle) = (candidate.touch.normal, candidate.triangle);
        let (corners, shared) = (self.corners[triangle as usize], self.shared[triangle as usize]);
        let rise = |way: Vec3| {
            let way = way.normalize_or_zero();
            let rate = normal.dot(way);
            (rate > LEVEL).then(|| [candidate.toward.dot(way), rate])
        };
        let largest = |one: [f64; 2], other: [f64; 2]| [0, 1].map(|k| one[k].max(other[k]));
        let level = normal.reject_from(candidate.toward);
        match self.exit(candidate) {
            TriangleFeature::Face => None,
            TriangleFeature::Edge(k) => {
                let ends = [k, (k + 1) % 3];
                let along = (corners[ends[1]] - corners[ends[0]]).normalize_or_zero();
                let beside = level.dot(along) * along;
                let numbers = ends.map(|end| shared[end]);
                let beyond = self.sharing(triangle, &numbers).filter_map(|other| {
                    let numbers = self.shared[other as usize];
                    let apex =
                        (0..3).find(|&i| numbers[i] != shared[ends[0]] && numbers[i] != shared[ends[1]])?;
                    // On over the edge, as the normal leads.
                    let over = (self.corners[other as usize][apex] - corners[k]).reject_from(along);
                    rise(beside + (level - beside).length() * over.normalize_or_zero())
                });
                beyond.reduce(largest)
            }
            TriangleFeature::Vertex(k) => {
                let number = [shared[k]];
                let others = self.sharing(triangle, &number);
                let ways = others.flat_map(|other| {
                    let face = self.face(other);
                    let [a, b, c] = self.corners[other as usize].map(|p| p - corners[k]);
                    // Along its edges, and as the normal leads where that is between them.
                    let lead = level.reject_from(face);
                    let ends = if a == Vec3::ZERO {
                        [b, c]
                    } else if b == Vec3::ZERO {
                        [c, a]
                    } else {
                        [a, b]
                    };
                    // Across the face what is left of it is rounding.
                    let is_between = lead.length() > LEVEL * level.length()
                        && face.dot(ends[0].cross(lead)) > 0.0
                        && face.dot(lead.cross(ends[1])) > 0.0;
                    [ends[0], ends[1], if is_between { lead } else { Vec3::ZERO }]
                });
                ways.filter_map(rise).reduce(largest)
            }
        }
    }

    /// Takes away the contacts of flat bodies and capsules with edges that bear nothing, where there is a
    /// gap. Where the normal is nearly that of the triangle's face (the library's is one of the body's own
    /// faces, or rough where bodies barely touch), it becomes that; so in the corner of a valley, whose other
    /// slope is in front of the face; and so where the body overlaps the triangle and lies over it: the least
    /// way out of one triangle may lead along the surface, out of the surface it does not. What touches a
    /// ridge keeps its normal.
    fn leave_surface(&self, candidates: &mut Vec<Candidate>, visitor: &Visitor<'_>) {
        candidates.retain_mut(|candidate| {
            let corners = self.corners[candidate.triangle as usize];
            let cosine = candidate.toward.dot(candidate.touch.normal);
            if cosine.abs() > 1.0 - 0.5 * LEVEL * LEVEL {
                return true;
            }
            let Some([rise, rate]) = self.rise_beyond(candidate) else { return true };
            let touch = &mut candidate.touch;
            let (overlap, apart) = ((-touch.gap).max(0.0), touch.gap.abs());
            let on_body = touch.point + 0.5 * touch.gap * touch.normal;
            let is_face = cosine.abs() > NEARLY;
            // A flat surface rises by the sine of the normal; on a ridge the normal is its own.
            if touch.gap <= 0.0 && rate < RIDGE * (1.0 - cosine * cosine).sqrt() {
                return true;
            }
            let is_back = candidate.side.is_none() && is_face && cosine < 0.0;
            touch.normal = if is_back { -candidate.toward } else { candidate.toward };
            let found_at = on_body;
            let on_body = visitor.foremost_around(found_at, touch.normal);
            let gap = touch.normal.dot(on_body - corners[0]);
            let hair = LEVEL * visitor.shape.bounding_radius();
            if touch.gap > 0.0 && gap < -hair {
                // Behind the plane of a triangle that it is apart from, it is beside it.
                return false;
            }
            touch.gap = gap;
            touch.point = on_body - 0.5 * touch.gap * touch.normal;
            let foot = on_body - touch.gap * touch.normal;
            let beside = (nearest_on_triangle(foot, corners).0 - foot).length();
            let way = if rise > LEVEL { apart } else { overlap };
            let is_over = way > 0.0 && beside <= way + hair;
            // The lowest place of what is round is held where it lies over the triangle.
            let is_elsewhere = (on_body - found_at).length() > hair && beside > hair;
            is_over || is_face && !is_elsewhere
        });
    }

    /// Whether a candidate would be there if the surface were whole. `all` are in the order of their
    /// triangles.
    fn is_real(&self, candidate: &Candidate, all: &[Candidate], visitor: &Visitor<'_>) -> bool {
        let small = 1e-9 * visitor.shape.bounding_radius();
        let corners = self.shared[candidate.triangle as usize];
        let (touching, count) = match candidate.feature {
            TriangleFeature::Face => return true,
            TriangleFeature::Edge(k) => ([corners[k], corners[(k + 1) % 3]], 2),
            TriangleFeature::Vertex(k) => ([corners[k]; 2], 1),
        };
        let mut sharing = self.sharing(candidate.triangle, &touching[..count]);
        if let Shape::Capsule(Capsule { radius, .. }) = *visitor.shape {
            // As for a sphere, with the ball of the capsule that touches.
            let touch = &candidate.touch;
            let centre = touch.point + (radius + 0.5 * touch.gap) * touch.normal;
            let distance = (centre - candidate.foot).length();
            return sharing.all(|other| {
                let (foot, _) = nearest_on_triangle(centre, self.corners[other as usize]);
                (centre - foot).length() >= distance - small
            });
        }
        let of_triangle = |triangle: u32| {
            let from = all.partition_point(|c| c.triangle < triangle);
            all[from..].iter().take_while(move |c| c.triangle == triangle)
        };
        sharing.flat_map(of_triangle).all(|other| {
            let apart = (other.foot - candidate.foot).length();
            match visitor.shape {
                Shape::Sphere(_) => {
                    // The same point seen from two triangles counts once, from the first.
                    let same = apart <= small;
                    if same {
                        candidate.triangle < other.triangle
                    } else {
                        other.touch.gap >= candidate.touch.gap
                    }
                }
                // A face contact nearby already holds the body off along the true normal.
                _ => {
                    other.feature != TriangleFeature::Face
                        || other.toward.dot(other.touch.normal).abs() < NEARLY
                        || apart > 1e-2 * visitor.shape.bounding_radius()
                        || other.touch.normal.dot(candidate.touch.normal) > 1.0 - 1e-12
                }
            }
        })
    }
}

/// Distance from `p` to its nearest point `foot` on a triangle; on the triangle itself the normal is the
/// face's.
fn unsigned_distance(p: Vec3, foot: Vec3, toward: Vec3) -> Distance {
    let d = p - foot;
    let value = d.length();
    let normal = if value > 0.0 { d / value } else { toward };
    Distance { value, normal }
}

/// Box in the outer frame that holds a box given in a frame at `position`, turned by `rotation`.
pub(crate) fn turned_bounds(bounds: &Aabb, position: Vec3, rotation: Mat3) -> Aabb {
    let half = bounds.half_extents();
    let reach =
        rotation.x_axis.abs() * half.x + rotation.y_axis.abs() * half.y + rotation.z_axis.abs() * half.z;
    let centre = position + rotation * bounds.center();
    Aabb::new(centre - reach, centre + reach)
}

/// Feature of a contact with a triangle, from the triangle and the feature within it.
pub(crate) fn triangle_feature(triangle: u32, feature: u64) -> u64 {
    mix(u64::from(triangle) << 32).wrapping_add(feature)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hull::Hull;
    use crate::math::rotation_exponential;
    use crate::shape::{Cuboid, Cylinder};

    #[test]
    fn triangles_that_share_an_edge_or_corner_are_those_that_a_search_of_all_finds() {
        // Few places for many corners: edges of many triangles, triangles without area, the same triangle
        // twice.
        let vertices: Vec<Vec3> =
            (0..14).map(|k| Vec3::new(f64::from(k % 7), f64::from(k % 3), 0.0)).collect();
        let pick = |k: u32| (f64::from(k * k) * 0.618_034).fract();
        let triangles: Vec<[u32; 3]> =
            (0..60).map(|k| [0, 1, 2].map(|i| (14.0 * pick(3 * k + i)) as u32)).collect();
        let mesh = TriangleTree::new(&Mesh { vertices, triangles: triangles.clone(), solid: false });
        for triangle in 0..triangles.len() as u32 {
            let [a, b, c] = mesh.shared[triangle as usize];
            for corners in [&[a][..], &[b], &[c], &[a, b], &[b, c], &[c, a]] {
                let shares = |&other: &u32| {
                    other != triangle && corners.iter().all(|v| mesh.shared[other as usize].contains(v))
                };
                let expected: Vec<u32> = (0..triangles.len() as u32).filter(shares).collect();
                assert_eq!(mesh.sharing(triangle, corners).collect::<Vec<_>>(), expected);
            }
        }
    }

    /// Bodies near a block are as far from it, along the same normal, where it is a mesh of triangles.
    #[test]
    fn a_mesh_of_a_block_is_as_near_as_the_block() {
        let half = Vec3::new(0.15, 0.141, 0.1305);
        let sign = |k: u32, bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let vertices = (0..8).map(|k| half * Vec3::new(sign(k, 2), sign(k, 1), sign(k, 0))).collect();
        let sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
        let triangles = sides.into_iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let tree = TriangleTree::new(&Mesh { vertices, triangles, solid: true });
        let block = Shape::Box(Cuboid { half });
        let corners = [
            Vec3::new(0.2, 0.0, 0.0),
            Vec3::new(-0.2, 0.0, 0.02),
            Vec3::new(0.0, 0.17, 0.0),
            Vec3::new(0.0, -0.15, 0.03),
            Vec3::new(0.02, 0.0, 0.2),
            Vec3::new(0.0, 0.03, -0.2),
        ];
        let shapes = [
            Shape::Hull(Hull::new(&corners).unwrap().0),
            Shape::Box(Cuboid { half: Vec3::new(0.2, 0.1, 0.07) }),
            Shape::Cylinder(Cylinder { half_length: 0.1, radius: 0.1 }),
        ];
        let mut state = 7_u64;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        let nearest = |touches: &[Touch]| touches.iter().min_by(|a, b| a.gap.total_cmp(&b.gap)).copied();
        for (shape, k) in shapes.iter().flat_map(|shape| (0..700).map(move |k| (shape, k))) {
            let gap = [1e-3, 1e-4, -1e-6][k % 3];
            let orientation = rotation_exponential(3.0 * Vec3::new(next(), next(), next()));
            let way = Vec3::new(next(), next(), next()).normalize();
            let from_block = |distance: f64| {
                let solid = Solid::Placed { shape, position: distance * way, orientation };
                let other =
                    Solid::Placed { shape: &block, position: Vec3::ZERO, orientation: Quat::IDENTITY };
                let mut touches = Vec::new();
                manifold_contacts(solid, other, 0.2, distance * way, 1.0, &mut touches);
                nearest(&touches)
            };
            let (mut inside, mut outside) = (0.0, 1.0);
            for _ in 0..40 {
                let middle = 0.5 * (inside + outside);
                let is_apart = from_block(middle).is_none_or(|touch| touch.gap > gap);
                *(if is_apart { &mut outside } else { &mut inside }) = middle;
            }
            let exact = from_block(outside).unwrap();
            // Where it jumps there is no such place.
            if (exact.gap - gap).abs() > 1e-7 {
                continue;
            }
            let mut touches = Vec::new();
            tree.contacts(&Visitor { shape, position: outside * way, orientation }, 5e-3, &mut touches);
            let found = nearest(&touches).unwrap();
            // Along the normal that parts it from one triangle it may be nearer.
            let allowed = if gap > 5e-4 { 2e-4 } else { 1e-5 };
            assert!((found.gap - gap).abs() < allowed, "{k}: {found:?} instead of {exact:?}");
            assert!(gap > 5e-4 || found.normal.dot(exact.normal) > 0.999, "{k}: {found:?} {exact:?}");
        }
    }
}
