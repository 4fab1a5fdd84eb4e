//! The hull of points as triangles, by incremental insertion of the farthest point. Whether a point lies
//! outside of a triangle is decided exactly (J. R. Shewchuk, "Adaptive precision floating-point arithmetic
//! and fast robust geometric predicates", Discrete & Computational Geometry 18(3):305-363, 1997), so that
//! what a point sees is always one region with one loop around it, however close to a plane points lie.

use crate::math::Vec3;
use robust::{Coord3D, orient3d};
use std::collections::HashMap;

/// A triangle while the hull is made, with the points that lie outside of it.
struct Triangle {
    corners: [usize; 3],
    normal: Vec3,
    outside: Vec<usize>,
    alive: bool,
}

impl Triangle {
    fn new(points: &[Vec3], corners: [usize; 3]) -> Self {
        let [a, b, c] = corners.map(|k| points[k]);
        let normal = (b - a).cross(c - a).normalize_or_zero();
        Self { corners, normal, outside: Vec::new(), alive: true }
    }

    /// Height of a point above its plane, rounded.
    fn height(&self, points: &[Vec3], p: usize) -> f64 {
        self.normal.dot(points[p] - points[self.corners[0]])
    }

    /// Whether a point lies above its plane, exactly.
    fn is_below(&self, points: &[Vec3], p: usize) -> bool {
        let place = |k: usize| Coord3D { x: points[k].x, y: points[k].y, z: points[k].z };
        let [a, b, c] = self.corners.map(place);
        orient3d(a, b, c, place(p)) < 0.0
    }
}

/// The directed edges of a triangle.
pub(super) fn edges([a, b, c]: [usize; 3]) -> [[usize; 2]; 3] {
    [[a, b], [b, c], [c, a]]
}

/// The triangles of the hull, counter-clockwise seen from outside; `None` if the points lie in a plane within
/// the tolerance. With a bound of its corners the point farthest outside of all is always the next, until
/// there are so many.
pub(super) fn triangulate(
    points: &[Vec3],
    tolerance: f64,
    most_corners: Option<usize>,
) -> Option<Vec<[usize; 3]>> {
    let mut triangles = first_tetrahedron(points, tolerance)?;
    let mut owner: HashMap<[usize; 2], usize> = HashMap::new();
    for (k, triangle) in triangles.iter().enumerate() {
        owner.extend(edges(triangle.corners).map(|edge| (edge, k)));
    }
    share(points, &mut triangles, (0..points.len()).collect());
    let (mut begin, mut corners) = (0, 4);
    while let Some((at, far)) = next_point(points, &triangles, &mut begin, most_corners.is_some()) {
        if most_corners.is_some_and(|most| corners >= most) {
            break;
        }
        corners += 1;
        // What the point sees, and the loop around it.
        let mut seen = vec![at];
        triangles[at].alive = false;
        let mut loop_around = Vec::new();
        let mut next = 0;
        while let Some(&k) = seen.get(next) {
            next += 1;
            for [a, b] in edges(triangles[k].corners) {
                let other = *owner.get(&[b, a])?;
                if !triangles[other].alive {
                    continue;
                }
                if triangles[other].is_below(points, far) {
                    triangles[other].alive = false;
                    seen.push(other);
                } else {
                    loop_around.push([a, b]);
                }
            }
        }
        let mut left = Vec::new();
        for &k in &seen {
            left.append(&mut triangles[k].outside);
            for edge in edges(triangles[k].corners) {
                owner.remove(&edge);
            }
        }
        left.retain(|&p| p != far);
        left.sort_unstable();
        let first = triangles.len();
        for [a, b] in loop_around {
            let corners = [a, b, far];
            owner.extend(edges(corners).map(|edge| (edge, triangles.len())));
            triangles.push(Triangle::new(points, corners));
        }
        share(points, &mut triangles[first..], left);
    }
    Some(triangles.into_iter().filter(|t| t.alive).map(|t| t.corners).collect())
}

/// The triangle to be replaced, and the point farthest outside of it: the first triangle at or behind
/// `begin`, which moves on to it, that has points outside, or the one whose point lies `farthest` outside.
fn next_point(
    points: &[Vec3],
    triangles: &[Triangle],
    begin: &mut usize,
    farthest: bool,
) -> Option<(usize, usize)> {
    let is_open = |triangle: &Triangle| triangle.alive && !triangle.outside.is_empty();
    *begin += triangles[*begin..].iter().position(is_open)?;
    // Of equals the first.
    let higher = |a: (usize, f64), b: (usize, f64)| if b.1 > a.1 { b } else { a };
    let highest = |triangle: &Triangle| {
        triangle.outside.iter().map(|&p| (p, triangle.height(points, p))).reduce(higher)
    };
    let mut best = (*begin, highest(&triangles[*begin])?);
    if farthest {
        for (k, triangle) in triangles.iter().enumerate().skip(*begin + 1).filter(|(_, t)| is_open(t)) {
            let own = highest(triangle)?;
            if own.1 > best.1.1 {
                best = (k, own);
            }
        }
    }
    Some((best.0, best.1.0))
}

/// Gives each point to the triangle that it is highest above, of those that it lies outside of.
fn share(points: &[Vec3], triangles: &mut [Triangle], all: Vec<usize>) {
    for p in all {
        let mut best: Option<(usize, f64)> = None;
        for (k, triangle) in triangles.iter().enumerate() {
            let height = triangle.height(points, p);
            if best.is_none_or(|(_, highest)| height > highest) && triangle.is_below(points, p) {
                best = Some((k, height));
            }
        }
        if let Some((k, _)) = best {
            triangles[k].outside.push(p);
        }
    }
}

/// Four points far apart; `None` if the points lie in a plane.
fn first_tetrahedron(points: &[Vec3], tolerance: f64) -> Option<Vec<Triangle>> {
    let farthest = |measure: &dyn Fn(Vec3) -> f64| {
        let mut best = 0;
        for k in 1..points.len() {
            if measure(points[k]) > measure(points[best]) {
                best = k;
            }
        }
        best
    };
    let a = farthest(&|p| -p.x);
    let b = farthest(&|p| (p - points[a]).length_squared());
    let along = (points[b] - points[a]).normalize_or_zero();
    let c = farthest(&|p| (p - points[a]).cross(along).length_squared());
    if (points[c] - points[a]).cross(along).length() <= tolerance {
        return None;
    }
    let normal = along.cross(points[c] - points[a]).normalize_or_zero();
    let d = farthest(&|p| normal.dot(p - points[a]).abs());
    let height = normal.dot(points[d] - points[a]);
    if height.abs() <= tolerance {
        return None;
    }
    let (b, c) = if height > 0.0 { (c, b) } else { (b, c) };
    let corners = [[a, b, c], [a, d, b], [b, d, c], [c, d, a]];
    Some(corners.into_iter().map(|corners| Triangle::new(points, corners)).collect())
}
