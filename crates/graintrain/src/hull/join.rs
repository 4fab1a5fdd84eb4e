//! Triangles of a hull joined to plane polygons.

use super::triangulate::{edges, triangulate};
use super::{Hull, HullEdge, HullFace};
use crate::math::Vec3;
use std::collections::HashMap;

/// Faces and corners may lie off each other's planes by so many tolerances.
pub(super) const PLAY: f64 = 20.0;

/// The hull with triangles joined whose corners lie in one plane within four tolerances; `None` if no hull of
/// plane convex polygons that holds all points within [`PLAY`] tolerances comes of it. With a tolerance of
/// zero no triangles are joined.
///
/// Corners between fewer than three faces lie in the middle of a face or an edge and are left out; the hull
/// of the others is taken again, until there are no such corners.
pub(super) fn join(points: &[Vec3], triangles: &[[usize; 3]], tolerance: f64, play: f64) -> Option<Hull> {
    let mut triangles = triangles.to_vec();
    let (kept, faces) = loop {
        let faces = polygons(points, &triangles, 4.0 * tolerance)?;
        let mut meeting = vec![0_usize; points.len()];
        faces.iter().flat_map(|(_, around)| around).for_each(|&p| meeting[p] += 1);
        let mut used = vec![false; points.len()];
        triangles.iter().flatten().for_each(|&p| used[p] = true);
        let kept: Vec<usize> = (0..points.len()).filter(|&p| meeting[p] >= 3).collect();
        if kept.len() == used.iter().filter(|used| **used).count() {
            break (kept, faces);
        }
        let own: Vec<Vec3> = kept.iter().map(|&p| points[p]).collect();
        if own.len() < 4 {
            return None;
        }
        triangles = triangulate(&own, tolerance, None)?.into_iter().map(|t| t.map(|k| kept[k])).collect();
    };
    let hull = assembled(points, &kept, &faces)?;
    let is_convex = |face: &HullFace| {
        let at = |k: usize| hull.corners[face.corners[k % face.corners.len()] as usize];
        (0..face.corners.len()).all(|k| {
            let (chord, to) = (at(k + 2) - at(k), at(k + 1) - at(k));
            // How far a corner lies on the inner side of the line between its neighbours.
            chord.cross(to).dot(face.normal) <= play * chord.length()
        })
    };
    let holds = |face: &HullFace| points.iter().all(|p| face.normal.dot(*p) - face.offset <= play);
    (hull.faces.iter().all(|face| is_convex(face) && holds(face)) && hull.validate_within(play).is_ok())
        .then_some(hull)
}

/// Normals and borders of the plane regions of a surface: each grows from the largest triangle that is left,
/// over neighbours whose corners are within a height of its plane.
fn polygons(points: &[Vec3], triangles: &[[usize; 3]], height: f64) -> Option<Vec<(Vec3, Vec<usize>)>> {
    let mut owner: HashMap<[usize; 2], usize> = HashMap::new();
    for (k, &corners) in triangles.iter().enumerate() {
        owner.extend(edges(corners).map(|edge| (edge, k)));
    }
    // Twice the area along the normal.
    let area = |k: usize| {
        let [a, b, c] = triangles[k].map(|p| points[p]);
        (b - a).cross(c - a)
    };
    let mut order: Vec<usize> = (0..triangles.len()).collect();
    order.sort_by(|&a, &b| area(b).length().total_cmp(&area(a).length()).then(a.cmp(&b)));
    let mut region = vec![usize::MAX; triangles.len()];
    let mut faces = Vec::new();
    for seed in order {
        if region[seed] != usize::MAX {
            continue;
        }
        let (normal, foot) = (area(seed).normalize_or_zero(), points[triangles[seed][0]]);
        let is_near = |k: usize| triangles[k].iter().all(|&p| normal.dot(points[p] - foot).abs() <= height);
        let mut members = vec![seed];
        region[seed] = seed;
        let mut next = 0;
        while let Some(&k) = members.get(next) {
            next += 1;
            for [a, b] in edges(triangles[k]) {
                let other = *owner.get(&[b, a])?;
                if height > 0.0 && region[other] == usize::MAX && is_near(other) {
                    region[other] = seed;
                    members.push(other);
                }
            }
        }
        let is_inner = |[a, b]: [usize; 2]| region[owner[&[b, a]]] == seed;
        let border: Vec<[usize; 2]> =
            members.iter().flat_map(|&k| edges(triangles[k])).filter(|&edge| !is_inner(edge)).collect();
        let sum: Vec3 = members.iter().map(|&k| area(k)).sum();
        faces.push((sum.normalize_or_zero(), simple_loop(&border)?));
    }
    Some(faces)
}

/// The points around, if edges are one loop that meets no point twice; from the point with the lowest number.
fn simple_loop(edges: &[[usize; 2]]) -> Option<Vec<usize>> {
    let next: HashMap<usize, usize> = edges.iter().map(|&[a, b]| (a, b)).collect();
    let first = *next.keys().min()?;
    let mut around = vec![first];
    let mut at = next[&first];
    while at != first && around.len() < edges.len() {
        around.push(at);
        at = *next.get(&at)?;
    }
    (at == first && around.len() == edges.len()).then_some(around)
}

/// The hull of polygons around points, with its edges; `None` unless every edge has two faces and Euler's
/// formula holds.
fn assembled(points: &[Vec3], kept: &[usize], faces: &[(Vec3, Vec<usize>)]) -> Option<Hull> {
    let mut number = vec![u32::MAX; points.len()];
    for (&p, k) in kept.iter().zip(0..) {
        number[p] = k;
    }
    let corners: Vec<Vec3> = kept.iter().map(|&p| points[p]).collect();
    let mut hull = Hull { corners, faces: Vec::new(), edges: Vec::new() };
    for (normal, around) in faces {
        let own: Vec<u32> = around.iter().map(|&p| number[p]).collect();
        let height = |&p: &usize| normal.dot(points[p]);
        let offset = around.iter().map(height).fold(f64::NEG_INFINITY, f64::max);
        hull.faces.push(HullFace { normal: *normal, offset, corners: own });
    }
    let mut sides: HashMap<[u32; 2], u32> = HashMap::new();
    for (face, k) in hull.faces.iter().zip(0..) {
        for (&a, &b) in face.corners.iter().zip(face.corners.iter().cycle().skip(1)) {
            if let Some(&other) = sides.get(&[b, a]) {
                hull.edges.push(HullEdge { corners: [b, a], faces: [other, k] });
            }
            sides.insert([a, b], k);
        }
    }
    let closes = 2 * hull.edges.len() == sides.len();
    (closes && hull.corners.len() + hull.faces.len() == hull.edges.len() + 2).then_some(hull)
}
