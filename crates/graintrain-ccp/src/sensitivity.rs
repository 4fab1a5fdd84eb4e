//! Derivatives of the solution of a problem, by the implicit function theorem.
//!
//! Where every contact is strictly in one state, the solution g of the relaxed problem is, near by, that of
//! the equations of these states (u = N g + r):
//!
//! | state | impulse | equations |
//! |---|---|---|
//! | apart | g = 0, u inside the dual cone | dg = 0 |
//! | sticking | g inside the cone | du = 0 |
//! | sliding | g = a (1, mu s), u_t = -&#124;u_t&#124; s, a > 0, &#124;u_t&#124; > 0 | (1, mu s) . du = &#124;u_t&#124; dmu, s' . du_t + &#124;u_t&#124; / (mu a) db = 0 |
//!
//! with the direction s of friction, s' at right angles to it, and dg = (1, mu s) da + (0, s') db + (0, a s)
//! dmu. With the columns E of dg = E x + G dmu and the diagonal C of the terms |u_t| / (mu a), that is
//!
//! ```text
//! K x = -E^T (dr + N G dmu) - c dmu,   K = E^T N E + C,   c = s . u_t in the first row of sliding contacts
//! ```
//!
//! K is symmetric and positive semi-definite; where contacts are more than the bodies need (four corners of a
//! box on the ground) it is singular, and impulses are not unique, but the velocities D g of bodies and their
//! derivatives are. For a number L with dL = y . dg the adjoint K z = E^T y gives dL/dr = -E z and dL/dmu = G
//! . (y - N E z) - c z. Source: Facchinei, Pang, "Finite-Dimensional Variational Inequalities and
//! Complementarity Problems", 2003, section 5.4.
//!
//! K is applied by way of the bodies, and its systems are solved by conjugate gradients with the factors of
//! K + eps in body space ([`crate::newton::body::BodyCholesky`]'s identity) as preconditioner: a few
//! iterations.

use crate::delassus::{Delassus, RigidDelassus};
use crate::newton::body_matrix::BodyMatrix;
use crate::problem::Ccp;
use crate::residual::velocity_scale;
use graintrain_linalg::block3::Block;
use graintrain_linalg::cholesky::SparseCholesky;
use graintrain_linalg::krylov::{KrylovSettings, KrylovWork, conjugate_gradient};
use graintrain_linalg::ordering::Ordering;
use graintrain_linalg::parallel::norm;
use graintrain_linalg::real;

/// The state that a contact is strictly in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ContactState {
    /// No impulse, and parting.
    Apart,
    /// An impulse inside the friction cone, and no relative velocity.
    Sticking,
    /// An impulse on the edge of the cone, and slip. Without friction: whatever presses.
    Sliding,
}

/// Why a solution has no derivative here.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SensitivityError {
    /// A contact between two states.
    #[error(
        "contact {contact} is at a kink: {what} (to {margin:.0e} of the velocity scale); derivatives from both sides differ there"
    )]
    Kink {
        /// Index of the contact.
        contact: usize,
        /// Between which states.
        what: &'static str,
        /// How near counts as there, relative.
        margin: f64,
    },
    /// Impulses that are no solution.
    #[error(
        "contact {contact} is in no state: its impulse does not solve the problem; solve it to a tolerance of 1e-9 or below"
    )]
    Unsolved {
        /// Index of the contact.
        contact: usize,
    },
    /// N without bodies.
    #[error("derivatives need a problem with bodies, and this one gives N as a matrix")]
    NoBodies,
    /// Rolling or spinning friction.
    #[error("contacts with rolling or spinning friction have no derivatives yet")]
    Turning,
    /// The linear system of the adjoint was not solved.
    #[error("the adjoint system was solved to {residual:.1e} only")]
    Adjoint {
        /// Relative residual.
        residual: f64,
    },
}

/// Nearer than this to another state, relative to the velocity scale, a contact is at a kink.
const MARGIN: f64 = 1e-6;

/// Weight of eps in the preconditioner, relative to the contact's own diagonal.
const EPSILON: f64 = 1e-8;

/// Relative residual asked of the adjoint system, the largest one accepted, and iterations for it.
const ADJOINT: (f64, f64, usize) = (1e-13, 1e-8, 200);

/// One contact's part of the equations.
#[derive(Clone, Copy, Debug)]
struct Part {
    state: ContactState,
    /// Columns of E, and which of them there are.
    columns: [[f64; 3]; 3],
    count: usize,
    /// C: |u_t| / (mu a) belongs to the second column.
    curvature: f64,
    /// G, N s.
    by_friction: [f64; 3],
    /// c = s . u_t, m/s; NaN where friction has no derivative.
    slip: f64,
}

/// Derivatives at a solution.
pub struct Sensitivity {
    parts: Vec<Part>,
    matrix: BodyMatrix,
    factor: SparseCholesky,
    /// C + eps of each column.
    weight: Vec<[f64; 3]>,
    problem: Ccp,
}

/// What one number's derivative by the impulses becomes.
#[derive(Clone, Debug, PartialEq)]
pub struct Adjoint {
    /// dL/dr, length 3 N_c.
    pub r: Vec<f64>,
    /// dL/dmu, one per contact; NaN where a contact without friction does not slip.
    pub friction: Vec<f64>,
}

impl Part {
    fn of(
        problem: &Ccp,
        eta: f64,
        g: [f64; 3],
        u: [f64; 3],
        contact: usize,
    ) -> Result<Self, SensitivityError> {
        let (mu, scale) = (problem.friction[contact], velocity_scale(problem));
        let kink = |what| Err(SensitivityError::Kink { contact, what, margin: MARGIN });
        let small = |velocity: f64| velocity <= MARGIN * scale;
        let (friction, slip) = (real::hypot(g[1], g[2]), real::hypot(u[1], u[2]));
        let nothing = Self {
            state: ContactState::Apart,
            columns: [[0.0; 3]; 3],
            count: 0,
            curvature: 0.0,
            by_friction: [0.0; 3],
            slip: 0.0,
        };
        let parting = (u[0] - mu * slip) / real::hypot(mu, 1.0);
        if small(eta * real::hypot(g[0], friction)) {
            return if small(parting) { kink("it touches without pressing") } else { Ok(nothing) };
        }
        let inside = (mu * g[0] - friction) / real::hypot(mu, 1.0);
        if mu > 0.0 && !small(eta * inside) {
            if !small(real::hypot(u[0], slip)) {
                return Err(SensitivityError::Unsolved { contact });
            }
            let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            return Ok(Self { state: ContactState::Sticking, columns, count: 3, ..nothing });
        }
        if !small(eta * -inside) || !small(parting.abs()) {
            return Err(SensitivityError::Unsolved { contact });
        }
        if mu > 0.0 && small(slip) {
            return kink("it is about to slide");
        }
        let direction = match (mu > 0.0, small(slip)) {
            (true, _) => [g[1] / friction, g[2] / friction],
            (false, false) => [-u[1] / slip, -u[2] / slip],
            (false, true) => [f64::NAN; 2],
        };
        let [x, y] = direction;
        let along = if mu > 0.0 { [1.0, mu * x, mu * y] } else { [1.0, 0.0, 0.0] };
        Ok(Self {
            state: ContactState::Sliding,
            columns: [along, [0.0, -y, x], [0.0; 3]],
            count: if mu > 0.0 { 2 } else { 1 },
            curvature: if mu > 0.0 { slip / (mu * g[0]) } else { 0.0 },
            by_friction: [0.0, g[0] * x, g[0] * y],
            slip: x * u[1] + y * u[2],
        })
    }

    /// E x.
    fn expand(&self, x: &[f64]) -> [f64; 3] {
        std::array::from_fn(|k| (0..self.count).map(|c| self.columns[c][k] * x[c]).sum())
    }

    /// E^T y, in three places of which the first `count` are used.
    fn restrict(&self, y: &[f64]) -> [f64; 3] {
        std::array::from_fn(|c| {
            if c < self.count { (0..3).map(|k| self.columns[c][k] * y[k]).sum() } else { 0.0 }
        })
    }

    /// C x.
    fn curved(&self, x: &[f64], c: usize) -> f64 {
        if c == 1 { self.curvature * x[1] } else { 0.0 }
    }
}

impl Sensitivity {
    /// At impulses that solve the problem with relaxed friction, to 1e-9 of the velocity scale or better.
    ///
    /// # Errors
    /// [`SensitivityError`]: a contact at a kink, impulses that do not solve the problem, a problem without bodies.
    pub fn new(problem: &Ccp, impulse: &[f64]) -> Result<Self, SensitivityError> {
        let Delassus::Rigid(rigid) = &*problem.delassus else { return Err(SensitivityError::NoBodies) };
        if !problem.turning.is_empty() {
            return Err(SensitivityError::Turning);
        }
        if !rigid.is_plain() {
            return Err(SensitivityError::NoBodies);
        }
        let mut u = vec![0.0; impulse.len()];
        problem.velocity(impulse, &mut u, &mut problem.delassus.work());
        let eta = problem.diagonal_scale();
        let three = |x: &[f64], i: usize| [x[3 * i], x[3 * i + 1], x[3 * i + 2]];
        let parts = (0..problem.num_contacts())
            .map(|i| Part::of(problem, eta[i], three(impulse, i), three(&u, i), i))
            .collect::<Result<Vec<_>, _>>()?;
        let weight: Vec<[f64; 3]> = parts
            .iter()
            .zip(&eta)
            .map(|(part, eta)| [0.0, part.curvature, 0.0].map(|curvature| curvature + EPSILON * eta))
            .collect();
        let (matrix, factor) = factorised(rigid, &parts, &weight)?;
        Ok(Self { parts, matrix, factor, weight, problem: problem.clone() })
    }

    /// The contacts' states.
    pub fn states(&self) -> impl ExactSizeIterator<Item = ContactState> + '_ {
        self.parts.iter().map(|part| part.state)
    }

    /// Of a number L with dL = y . dg: its derivatives by r and mu. `y` (length 3 N_c) is D^T of something
    /// where impulses are not unique. Cost: one solve in body space and some products with N.
    ///
    /// # Errors
    /// [`SensitivityError::Adjoint`] where the linear system is not solved.
    pub fn adjoint(&mut self, y: &[f64]) -> Result<Adjoint, SensitivityError> {
        let Self { parts, matrix, factor, weight, problem } = self;
        let size = y.len();
        let mut work = problem.delassus.work();
        let rhs: Vec<f64> =
            parts.iter().zip(y.chunks_exact(3)).flat_map(|(part, y)| part.restrict(y)).collect();
        let (mut expanded, mut image) = (vec![0.0; size], vec![0.0; size]);
        let expand = |x: &[f64], expanded: &mut [f64]| {
            for ((part, x), e) in parts.iter().zip(x.chunks_exact(3)).zip(expanded.chunks_exact_mut(3)) {
                e.copy_from_slice(&part.expand(x));
            }
        };
        let mut velocity = vec![0.0; 6 * matrix.num_bodies()];
        // (K + eps)^-1 = P (I + A^T A)^-1 P with P = (C + eps)^-1/2, by the identity of Woodbury.
        let mut precondition = |b: &[f64], z: &mut [f64]| {
            let scale = |z: &mut [f64]| {
                z.chunks_exact_mut(3)
                    .zip(&*weight)
                    .for_each(|(z, weight)| z.iter_mut().zip(weight).for_each(|(z, w)| *z /= w.sqrt()));
            };
            let mut scaled = b.to_vec();
            scale(&mut scaled);
            matrix.gather(&scaled, &mut velocity);
            factor.solve(&mut velocity);
            z.copy_from_slice(&scaled);
            matrix.scatter(-1.0, &velocity, z);
            scale(z);
        };
        let mut apply = |x: &[f64], out: &mut [f64]| {
            expand(x, &mut expanded);
            problem.delassus.multiply(&expanded, &mut image, &mut work);
            for (k, (part, out)) in parts.iter().zip(out.chunks_exact_mut(3)).enumerate() {
                let restricted = part.restrict(&image[3 * k..3 * k + 3]);
                for c in 0..3 {
                    out[c] = restricted[c] + part.curved(&x[3 * k..3 * k + 3], c);
                }
            }
        };
        let mut x = vec![0.0; size];
        let (tolerance, accepted, limit) = ADJOINT;
        if norm(&rhs) > 0.0 {
            let settings = KrylovSettings { relative_tolerance: tolerance, max_iterations: limit };
            let mut krylov = KrylovWork::default();
            let report =
                conjugate_gradient(&mut apply, &mut precondition, &rhs, &mut x, settings, &mut krylov);
            if report.residual.is_nan() || report.residual > accepted {
                return Err(SensitivityError::Adjoint { residual: report.residual });
            }
        }
        let mut change = vec![0.0; size];
        for ((part, x), e) in parts.iter().zip(x.chunks_exact(3)).zip(change.chunks_exact_mut(3)) {
            e.copy_from_slice(&part.expand(x));
        }
        let mut image = vec![0.0; size];
        problem.delassus.multiply(&change, &mut image, &mut problem.delassus.work());
        let by_friction = |(k, part): (usize, &Part)| match part.state {
            ContactState::Sliding => {
                let left = (0..3).map(|c| part.by_friction[c] * (y[3 * k + c] - image[3 * k + c]));
                left.sum::<f64>() - part.slip * x[3 * k]
            }
            ContactState::Apart | ContactState::Sticking => 0.0,
        };
        let friction = parts.iter().enumerate().map(by_friction).collect();
        change.iter_mut().for_each(|e| *e = -*e);
        Ok(Adjoint { r: change, friction })
    }
}

/// I + A A^T in body space with A = D~ E (C + eps)^-1/2, and its factors.
fn factorised(
    rigid: &RigidDelassus,
    parts: &[Part],
    weight: &[[f64; 3]],
) -> Result<(BodyMatrix, SparseCholesky), SensitivityError> {
    let mut matrix = BodyMatrix::new(rigid);
    let columns: Vec<Block> = parts
        .iter()
        .zip(weight)
        .map(|(part, weight)| {
            std::array::from_fn(|e| {
                let (k, c) = (e / 3, e % 3);
                if c < part.count { part.columns[c][k] / weight[c].sqrt() } else { 0.0 }
            })
        })
        .collect();
    matrix.assemble(&columns);
    let mut factor =
        SparseCholesky::new(6, matrix.row_starts(), matrix.columns(), Ordering::NestedDissection);
    match factor.factorize(matrix.blocks().as_flattened()) {
        Ok(()) => Ok((matrix, factor)),
        // I + A A^T is positive definite: only numbers that are none get here.
        Err(_) => Err(SensitivityError::Adjoint { residual: f64::NAN }),
    }
}
