//! What overlapping parts of a compound have in common, so that a compound can be given the mass of the
//! union.
//!
//! With c(p) the number of parts that hold the point p, the union is the sum of the parts less the integral
//! of c - 1 over the points with c > 1. That integral is a closed form for two spheres that overlap nothing
//! else (a lens: two caps), and a sum over a tree of cells otherwise: a cell whose centre is farther from
//! every surface than its corners has one c; others are cut in eight, [`DEPTH`] times, and the smallest are
//! sampled at [`SAMPLES`]^3 points. The tree covers the box around what the parts have in common only, so
//! that the error is one of the common volume: below 1e-3 of it (tests).

use super::narrow::{Collidable, Placed, body_contacts};
use crate::math::{Mat3, Quat, Vec3};
use crate::moments::{Moments, outer};
use crate::shape::{Geometry, Part, Shape, Sphere};
use parry3d_f64::bounding_volume::Aabb;
use std::f64::consts::PI;

/// Parts overlap if they are deeper than this fraction of the smaller one's bounding radius inside each
/// other.
const TOUCHING: f64 = 1e-9;

/// How often cells of the tree are halved.
const DEPTH: usize = 6;

/// Points per direction in the smallest cells.
const SAMPLES: usize = 4;

/// What is counted more than once in the sum of the parts: the integrals of c - 1; `None` if no two parts
/// overlap. Parts without volume (planes, meshes) do not count. Cost: pairs of parts, and for overlaps
/// without closed form some ten thousand cells, about 0.1 s.
pub(crate) fn counted_twice(parts: &[Part]) -> Option<Moments> {
    let solid: Vec<&Part> = parts.iter().filter(|part| part.shape.volume() > 0.0).collect();
    let mut pairs: Vec<[usize; 2]> = Vec::new();
    for i in 0..solid.len() {
        pairs.extend((i + 1..solid.len()).filter(|&j| overlap(solid[i], solid[j])).map(|j| [i, j]));
    }
    if pairs.is_empty() {
        return None;
    }
    let mut total = Moments::ZERO;
    for group in groups(solid.len(), &pairs) {
        let members: Vec<&Part> = group.iter().map(|&i| solid[i]).collect();
        total.add(&match members.as_slice() {
            [
                Part { shape: Shape::Sphere(Sphere { radius: r_a }), position: a, .. },
                Part { shape: Shape::Sphere(Sphere { radius: r_b }), position: b, .. },
            ] => lens(*a, *r_a, *b, *r_b),
            _ => {
                let inside = pairs.iter().filter(|pair| group.contains(&pair[0]));
                by_cells(&members, inside.map(|&[i, j]| common_box(solid[i], solid[j])))
            }
        });
    }
    Some(total)
}

fn overlap(a: &Part, b: &Part) -> bool {
    let (r_a, r_b) = (a.shape.bounding_radius(), b.shape.bounding_radius());
    let allowed = TOUCHING * r_a.min(r_b);
    let apart = (a.position - b.position).length() - r_a - r_b;
    if apart >= -allowed {
        return false;
    }
    if let (Shape::Sphere(_), Shape::Sphere(_)) = (&a.shape, &b.shape) {
        return true;
    }
    let Ok([form_a, form_b]) = [a, b]
        .map(|part| Geometry::single(part.shape.clone()).map(Collidable::new))
        .into_iter()
        .collect::<Result<Vec<_>, _>>()
        .map(|forms| <[Collidable; 2]>::try_from(forms).unwrap_or_else(|_| unreachable!("two parts")))
    else {
        return false;
    };
    let place = |form, part: &Part| Placed { form, position: part.position, orientation: part.orientation };
    let mut touches = Vec::new();
    body_contacts(place(&form_a, a), place(&form_b, b), 0.0, &mut touches);
    touches.iter().any(|touch| touch.gap < -allowed)
}

/// Parts that overlap directly or through others, ascending.
fn groups(count: usize, pairs: &[[usize; 2]]) -> Vec<Vec<usize>> {
    let mut group: Vec<usize> = (0..count).collect();
    for &[i, j] in pairs {
        let (keep, drop) = (group[i].min(group[j]), group[i].max(group[j]));
        for entry in &mut group {
            if *entry == drop {
                *entry = keep;
            }
        }
    }
    let members = |g: usize| (0..count).filter(|&i| group[i] == g).collect::<Vec<_>>();
    (0..count).map(members).filter(|list| list.len() > 1).collect()
}

/// Common part of two overlapping balls: the caps cut off by the plane of their common circle, or the smaller
/// ball.
fn lens(a: Vec3, r_a: f64, b: Vec3, r_b: f64) -> Moments {
    let d = (b - a).length();
    if d <= (r_a - r_b).abs() {
        let (centre, radius) = if r_a < r_b { (a, r_a) } else { (b, r_b) };
        return cap(Vec3::Z, radius, -radius).moved(centre);
    }
    let way = (b - a) / d;
    let plane = (d * d + r_a * r_a - r_b * r_b) / (2.0 * d);
    let mut sum = cap(way, r_a, plane).moved(a);
    sum.add(&cap(-way, r_b, d - plane).moved(b));
    sum
}

/// The ball of radius r about the origin beyond height z along `axis`: discs of radius^2 r^2 - z^2,
/// integrated.
fn cap(axis: Vec3, r: f64, z: f64) -> Moments {
    let between = |f: &dyn Fn(f64) -> f64| PI * (f(r) - f(z));
    let volume = between(&|z| r * r * z - z.powi(3) / 3.0);
    let first = between(&|z| r * r * z * z / 2.0 - z.powi(4) / 4.0);
    let along = between(&|z| r * r * z.powi(3) / 3.0 - z.powi(5) / 5.0);
    // A disc of radius s has second moment pi s^4 / 4 about each diameter.
    let across = between(&|z| (r.powi(4) * z - 2.0 / 3.0 * r * r * z.powi(3) + z.powi(5) / 5.0) / 4.0);
    let second = Mat3::from_diagonal(Vec3::splat(across)) + (along - across) * outer(axis, axis);
    Moments { volume, first: first * axis, second }
}

fn bounds(part: &Part) -> Aabb {
    let [low, high] = part.bounds(Vec3::ZERO, Quat::IDENTITY);
    Aabb::new(low, high)
}

fn common_box(a: &Part, b: &Part) -> Aabb {
    let (a, b) = (bounds(a), bounds(b));
    Aabb::new(a.mins.max(b.mins), a.maxs.min(b.maxs))
}

/// A part with the inverse of its rotation.
struct Member<'a> {
    shape: &'a Shape,
    position: Vec3,
    inverse: Quat,
}

impl Member<'_> {
    fn distance(&self, p: Vec3) -> f64 {
        self.shape.form().signed_distance(self.inverse * (p - self.position)).value
    }
}

fn by_cells(parts: &[&Part], boxes: impl Iterator<Item = Aabb>) -> Moments {
    let around = boxes.reduce(|a, b| Aabb::new(a.mins.min(b.mins), a.maxs.max(b.maxs)));
    let Some(around) = around else { return Moments::ZERO };
    let members: Vec<Member<'_>> = parts
        .iter()
        .map(|part| Member {
            shape: &part.shape,
            position: part.position,
            inverse: part.orientation.conjugate(),
        })
        .collect();
    let (centre, half) = (around.center(), around.half_extents());
    // About the centre of the box, so that far parts do not cost digits.
    let mut sum = Moments::ZERO;
    let all: Vec<&Member<'_>> = members.iter().collect();
    add_cell(&all, 0, centre, Vec3::ZERO, half, DEPTH, &mut sum);
    sum.moved(centre)
}

/// Adds the integrals over the cell about `origin + at`, moments about `origin`. `inside` parts hold all of
/// it, `members` may have their surface in it: a cell asks those alone that its parent could not decide.
fn add_cell(
    members: &[&Member<'_>],
    mut inside: usize,
    origin: Vec3,
    at: Vec3,
    half: Vec3,
    depth: usize,
    sum: &mut Moments,
) {
    let reach = half.length();
    let mut near = Vec::with_capacity(members.len());
    for &member in members {
        let distance = member.distance(origin + at);
        if distance.abs() < reach {
            near.push(member);
        } else {
            inside += usize::from(distance < 0.0);
        }
    }
    if near.is_empty() {
        if inside > 1 {
            let volume = (inside - 1) as f64 * 8.0 * half.x * half.y * half.z;
            let own = Moments {
                volume,
                first: Vec3::ZERO,
                second: Mat3::from_diagonal(volume / 3.0 * half * half),
            };
            sum.add(&own.moved(at));
        }
    } else if depth > 0 {
        let half = 0.5 * half;
        for corner in 0..8 {
            let side = |axis: usize| if corner >> axis & 1 == 1 { half[axis] } else { -half[axis] };
            let shift = Vec3::new(side(0), side(1), side(2));
            add_cell(&near, inside, origin, at + shift, half, depth - 1, sum);
        }
    } else {
        let small = half / SAMPLES as f64;
        let cell = 8.0 * small.x * small.y * small.z;
        for index in 0..SAMPLES.pow(3) {
            let number = [index % SAMPLES, index / SAMPLES % SAMPLES, index / (SAMPLES * SAMPLES)];
            let place = number.map(|k| (2 * k + 1) as f64);
            let p = at - half + small * Vec3::from_array(place);
            let holding = inside + near.iter().filter(|member| member.distance(origin + p) < 0.0).count();
            if holding > 1 {
                let volume = (holding - 1) as f64 * cell;
                sum.add(&Moments { volume, first: volume * p, second: volume * outer(p, p) });
            }
        }
    }
}
