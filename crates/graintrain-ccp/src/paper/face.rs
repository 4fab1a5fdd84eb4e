//! Faces of the friction cones: in which directions an impulse can move on.

use crate::solver::lanes::{Batch, Vector, dot, scale};

/// Relative distance to the mantle below which an impulse counts as sliding.
const ON_MANTLE: f64 = 1e-9;

/// For impulses x in the cones: `inside` where the contact sticks, else `boundary` (on the mantle, at the
/// apex, or frictionless).
#[inline(always)]
pub fn where_sticking<V: Vector>(mu: V, x: &Batch<V>, inside: &Batch<V>, boundary: &Batch<V>) -> Batch<V> {
    let square = x[1] * x[1] + x[2] * x[2];
    let bound = V::splat(1.0 - ON_MANTLE) * mu * x[0].max(V::splat(0.0));
    // Squares save a root. A frictionless contact has no inside: 0 <= -MIN_POSITIVE is false.
    let bound = bound * bound - V::splat(f64::MIN_POSITIVE);
    [
        square.at_most(bound, inside[0], boundary[0]),
        square.at_most(bound, inside[1], boundary[1]),
        square.at_most(bound, inside[2], boundary[2]),
    ]
}

/// Component of g along the face of the cone that x lies on: all of it inside, along the ray on the mantle,
/// none at the apex. Moving along a face keeps an impulse on it until the apex or the mantle is met.
#[inline(always)]
pub fn along_face<V: Vector>(mu: V, x: &Batch<V>, g: &Batch<V>) -> Batch<V> {
    let square = dot(x, x).max(V::splat(f64::MIN_POSITIVE));
    let ray = scale(dot(x, g).divide(square), x);
    where_sticking(mu, x, g, &ray)
}

/// Component of g in the tangent space of the cone at x: all of it inside, the tangent plane on the mantle
/// (along the ray where there is no friction), none at the apex. `tangential` is |x_t|.
#[inline(always)]
pub fn in_tangent_space<V: Vector>(mu: V, x: &Batch<V>, tangential: V, g: &Batch<V>) -> Batch<V> {
    let (zero, tiny) = (V::splat(0.0), V::splat(f64::MIN_POSITIVE));
    let square = x[1] * x[1] + x[2] * x[2];
    // With the normal (-mu, x_t / |x_t|) / sqrt(1 + mu^2) of the mantle: g - (normal . g) normal, with one
    // division.
    let along = x[1] * g[1] + x[2] * g[2] - mu * tangential * g[0];
    let factor = along.divide(((V::splat(1.0) + mu * mu) * square).max(tiny));
    let plane = [g[0] + mu * tangential * factor, g[1] - factor * x[1], g[2] - factor * x[2]];
    // Where there is no tangential part (no friction, or the apex) there is no tangent plane, only the ray or
    // nothing.
    let ray = x[0].at_most(zero, zero, g[0]);
    let mantle = [
        square.at_most(zero, ray, plane[0]),
        square.at_most(zero, zero, plane[1]),
        square.at_most(zero, zero, plane[2]),
    ];
    where_sticking(mu, x, g, &mantle)
}
