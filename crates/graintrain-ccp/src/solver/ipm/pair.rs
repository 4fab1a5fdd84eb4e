//! One contact inside the interior point: its primal-dual pair in cone coordinates, the scaling of the pair,
//! and its blocks of Newton's matrix. A contact without friction is the half line g_n >= 0 with g_t = 0.

use super::cone::{Point, Scaling};
use graintrain_linalg::block3::Block;

/// Coefficients of friction below this are taken as zero.
pub(crate) const FRICTIONLESS: f64 = 1e-9;
/// H of the tangential components of a frictionless contact, relative to eta: they are held at zero.
const HELD: f64 = 1e8;

/// One contact: its primal-dual pair in cone coordinates, or the half lines of a frictionless one.
#[derive(Clone, Copy)]
pub(crate) enum Pair {
    Cone { x: Point, s: Point },
    Line { x: f64, s: f64 },
}

/// Scaling of a pair, or that of a half line: sqrt(x / s) and lambda = sqrt(x s).
#[derive(Clone, Copy)]
pub(crate) enum PairScaling {
    Cone(Scaling),
    Line { w: f64, lambda: f64 },
}

/// Diagonal of T.
pub(crate) fn cone_map(mu: f64) -> [f64; 3] {
    if mu <= FRICTIONLESS { [1.0, 0.0, 0.0] } else { [mu.recip().min(1.0), mu.min(1.0), mu.min(1.0)] }
}

pub(crate) fn componentwise(t: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    [t[0] * v[0], t[1] * v[1], t[2] * v[2]]
}

pub(crate) fn divide_by(t: [f64; 3], v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| if t[k] > 0.0 { v[k] / t[k] } else { 0.0 })
}

impl Pair {
    pub fn start(mu: f64, z: [f64; 3], barrier: f64) -> Self {
        if mu <= FRICTIONLESS {
            let root = (z[0] * z[0] + 4.0 * barrier).sqrt();
            let x = if z[0] >= 0.0 { 0.5 * (z[0] + root) } else { 2.0 * barrier / (root - z[0]) };
            Self::Line { x, s: barrier / x }
        } else {
            let (x, s) = Point::smoothed_pair(z, barrier);
            Self::Cone { x, s }
        }
    }

    /// x and s as vectors.
    pub fn vectors(&self) -> ([f64; 3], [f64; 3]) {
        match self {
            Self::Cone { x, s } => (x.vector(), s.vector()),
            Self::Line { x, s } => ([*x, 0.0, 0.0], [*s, 0.0, 0.0]),
        }
    }

    pub fn complementarity(&self) -> f64 {
        match self {
            Self::Cone { x, s } => x.dot(s),
            Self::Line { x, s } => x * s,
        }
    }

    pub fn scaling(&self) -> PairScaling {
        match self {
            Self::Cone { x, s } => PairScaling::Cone(Scaling::new(x, s)),
            Self::Line { x, s } => PairScaling::Line { w: (x / s).sqrt(), lambda: (x * s).sqrt() },
        }
    }

    pub fn advance(&mut self, alpha: f64, dx: [f64; 3], ds: [f64; 3]) {
        match self {
            Self::Cone { x, s } => {
                *x = x.advance(alpha, dx);
                *s = s.advance(alpha, ds);
            }
            Self::Line { x, s } => {
                *x = (*x + alpha * dx[0]).max(1e-6 * *x);
                *s = (*s + alpha * ds[0]).max(1e-6 * *s);
            }
        }
    }
}

impl PairScaling {
    pub fn lambda(&self) -> [f64; 3] {
        match self {
            Self::Cone(w) => w.lambda,
            Self::Line { lambda, .. } => [*lambda, 0.0, 0.0],
        }
    }

    pub fn inverse_times(&self, v: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Cone(scaling) => scaling.inverse_times(v),
            Self::Line { w, .. } => [v[0] / w, 0.0, 0.0],
        }
    }

    pub fn divide(&self, d: [f64; 3]) -> [f64; 3] {
        match self {
            Self::Cone(scaling) => scaling.divide(d),
            Self::Line { lambda, .. } => [d[0] / lambda, 0.0, 0.0],
        }
    }

    pub fn longest_step(&self, d: [f64; 3]) -> f64 {
        match self {
            Self::Cone(scaling) => scaling.longest_step(d),
            Self::Line { lambda, .. } => {
                if d[0] < 0.0 {
                    -lambda / d[0]
                } else {
                    f64::INFINITY
                }
            }
        }
    }

    /// The blocks of Newton's matrix with E = W^-2 + delta I, delta = proximal T_n^2:
    /// H = T^-1 E T^-1, F = T E^(-1/2), and what turns the scaled unknown z = F^-1 dg into W^-1 dx = C z.
    pub fn blocks(&self, t: [f64; 3], proximal: f64) -> Blocks {
        match self {
            Self::Cone(scaling) => {
                let delta = proximal * t[0] * t[0];
                let h = scaling.function(|e| e + delta);
                let (root, inverse_root) = (
                    scaling.function(|e| (e + delta).sqrt()),
                    scaling.function(|e| (e + delta).sqrt().recip()),
                );
                Blocks {
                    added: std::array::from_fn(|k| h[k] / (t[k / 3] * t[k % 3])),
                    factor: std::array::from_fn(|k| inverse_root[k] * t[k / 3]),
                    factor_inverse: std::array::from_fn(|k| root[k] / t[k % 3]),
                    to_step: inverse_root,
                    to_scaled: scaling.function(|e| (e / (e + delta)).sqrt()),
                }
            }
            Self::Line { w, .. } => {
                let e = 1.0 / (w * w);
                let h = e + proximal;
                let diagonal = |a: f64, b: f64| [a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, b];
                Blocks {
                    added: diagonal(h, HELD),
                    factor: diagonal(1.0 / h.sqrt(), 1.0 / HELD.sqrt()),
                    factor_inverse: diagonal(h.sqrt(), HELD.sqrt()),
                    to_step: diagonal(1.0 / h.sqrt(), 0.0),
                    to_scaled: diagonal((e / h).sqrt(), 0.0),
                }
            }
        }
    }
}

/// See [`PairScaling::blocks`].
pub(crate) struct Blocks {
    pub added: Block,
    pub factor: Block,
    pub factor_inverse: Block,
    /// E^(-1/2): dx from z.
    pub to_step: Block,
    /// C = W^-1 E^(-1/2): W^-1 dx from z.
    pub to_scaled: Block,
}
