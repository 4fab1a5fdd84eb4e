//! The cone complementarity problem: N, r, mu.

use crate::cone::{FrictionCone, TurningCone, tangential_length};
use crate::delassus::{Delassus, DelassusIdentity, DelassusWork, RigidDelassus};
use graintrain_linalg::block3::PatternError;
use graintrain_linalg::parallel::axpy;
use rayon::prelude::*;
use std::sync::Arc;

/// N of bodies as a matrix, and of which N it is.
pub(crate) type KnownMatrix = Option<(DelassusIdentity, Arc<Delassus>)>;

/// Contacts per parallel task.
const TASK: usize = 4096;

/// A cone complementarity problem: find g with Y_i contains g_i perpendicular to (N g + r)_i in the dual cone
/// Y_i^*.
#[derive(Clone, Debug)]
pub struct Ccp {
    /// N = D^T M^-1 D, 1/kg. Shared: problems that hold the same N, one and not merely equal ones, differ in
    /// r, mu or V alone, and a solver that meets them one after the other prepares itself for N once.
    /// `Ccp { r, ..problem.clone() }` is such a problem.
    pub delassus: Arc<Delassus>,
    /// Free relative velocity r = b + D^T M^-1 k, length 3 N_c, m/s; then three turning velocities (about the
    /// normal and the two tangents, times the length of the rows, m/s) of every entry of `turning`.
    pub r: Vec<f64>,
    /// Coefficient of friction of each contact.
    pub friction: Vec<f64>,
    /// The contacts that resist turning, ascending; empty in most problems. Entry k owns block row N_c + k of
    /// N.
    pub turning: Vec<TurningFriction>,
    /// Velocity V, m/s, that makes residuals dimensionless: |gravity| x step in a simulation. `None` for a
    /// bare problem, whose V is sqrt(mean_i |r_i|^2). See [`crate::residual::Residual`].
    pub velocity_scale: Option<f64>,
    /// Contact points in space, m, for geometric orderings; empty where they are not known.
    pub points: Vec<[f64; 3]>,
    /// A number per contact that stays the same from step to step while the contact persists; empty where not
    /// known.
    pub identity: Vec<u64>,
}

/// Rolling and spinning friction of one contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurningFriction {
    /// Index of the contact.
    pub contact: u32,
    /// Coefficient of rolling friction over the length of the rows, dimensionless: |(h_1, h_2)| <= rolling
    /// g_n.
    pub rolling: f64,
    /// Coefficient of spinning friction over the length of the rows, dimensionless: |h_n| <= spinning g_n.
    pub spinning: f64,
}

/// What is wrong with a problem, or why a solver cannot take it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CcpError {
    /// Two parts of the problem disagree in size.
    #[error("{what} has {got} entries, expected {expected}")]
    Size {
        /// Which part.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length that fits the other parts.
        expected: usize,
    },
    /// A number that is NaN or infinite, or a negative coefficient of friction.
    #[error("{what} of contact {contact} is {value}; {expected}")]
    Value {
        /// Which quantity.
        what: &'static str,
        /// Index of the contact, from 0.
        contact: usize,
        /// The offending number.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// An index beyond what there is.
    #[error("{what} {index} is out of range: there are {bound}")]
    Index {
        /// What is counted.
        what: &'static str,
        /// The index, from 0.
        index: usize,
        /// How many there are.
        bound: usize,
    },
    /// An entry of N that a symmetric positive semi-definite matrix cannot have.
    #[error("N has {value} in row {row}, column {column}; {expected}")]
    Entry {
        /// Row, from 0; contact i has the rows 3 i to 3 i + 2.
        row: usize,
        /// Column, from 0.
        column: usize,
        /// The offending number.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// The arrays of a sparse matrix do not fit together.
    #[error(transparent)]
    Pattern(#[from] PatternError),
    /// No solver has this name.
    #[error("unknown solver '{name}'; known solvers: {known}")]
    UnknownSolver {
        /// The name asked for.
        name: String,
        /// Comma-separated names.
        known: String,
    },
    /// The solver exists, but this build has left it out.
    #[error("solver '{name}' is not compiled in: it needs the feature '{feature}' of graintrain-ccp")]
    NotCompiled {
        /// The name asked for.
        name: String,
        /// The cargo feature that it needs.
        feature: &'static str,
    },
    /// The solver cannot treat this problem.
    #[error("solver {solver} cannot treat this problem: {reason}")]
    Unsupported {
        /// Name of the solver.
        solver: String,
        /// Why not.
        reason: String,
    },
}

impl Ccp {
    /// A bare problem (N, r, mu) as it is given.
    pub fn bare(delassus: impl Into<Arc<Delassus>>, r: Vec<f64>, friction: Vec<f64>) -> Self {
        Self {
            delassus: delassus.into(),
            r,
            friction,
            turning: Vec::new(),
            velocity_scale: None,
            points: Vec::new(),
            identity: Vec::new(),
        }
    }

    /// A bare problem, checked.
    ///
    /// # Errors
    /// See [`Ccp::validate`].
    pub fn new(
        delassus: impl Into<Arc<Delassus>>,
        r: Vec<f64>,
        friction: Vec<f64>,
    ) -> Result<Self, CcpError> {
        Self::with_turning(delassus, r, friction, Vec::new())
    }

    /// The same problem where these contacts resist turning: N and r must have three more rows for each of
    /// them.
    ///
    /// # Errors
    /// See [`Ccp::validate`].
    pub fn with_turning(
        delassus: impl Into<Arc<Delassus>>,
        r: Vec<f64>,
        friction: Vec<f64>,
        turning: Vec<TurningFriction>,
    ) -> Result<Self, CcpError> {
        let problem = Self { turning, ..Self::bare(delassus, r, friction) };
        problem.validate()?;
        Ok(problem)
    }

    /// Checks that the parts fit together and hold finite numbers.
    ///
    /// # Errors
    /// [`CcpError::Size`] or [`CcpError::Value`] for the first defect found.
    pub fn validate(&self) -> Result<(), CcpError> {
        let blocks = self.delassus.num_blocks();
        let contacts = self.num_contacts();
        let size = |what, got, expected| {
            if got == expected { Ok(()) } else { Err(CcpError::Size { what, got, expected }) }
        };
        let number = |what, contact, value: f64, is_right: bool, expected| {
            if is_right { Ok(()) } else { Err(CcpError::Value { what, contact, value, expected }) }
        };
        let finite = |what, contact, x: f64| number(what, contact, x, x.is_finite(), "it must be finite");
        let not_negative = |what, contact, x: f64| {
            let is_right = x.is_finite() && x >= 0.0;
            number(what, contact, x, is_right, "it must be finite and not negative")
        };
        size("r", self.r.len(), 3 * blocks)?;
        size("friction", self.friction.len(), contacts)?;
        if let Delassus::Rigid(rigid) = &*self.delassus {
            size("turning", self.turning.len(), rigid.turning().len())?;
        }
        if !self.points.is_empty() {
            size("points", self.points.len(), contacts)?;
        }
        if !self.identity.is_empty() {
            size("identity", self.identity.len(), contacts)?;
        }
        for (k, &r) in self.r.iter().enumerate() {
            finite("r", k / 3, r)?;
        }
        not_negative("the velocity scale", 0, self.velocity_scale.unwrap_or(0.0))?;
        for (contact, &mu) in self.friction.iter().enumerate() {
            not_negative("friction", contact, mu)?;
        }
        for (k, turning) in self.turning.iter().enumerate() {
            let TurningFriction { contact, rolling, spinning } = *turning;
            let ascends = k == 0 || self.turning[k - 1].contact < contact;
            let owned = match &*self.delassus {
                Delassus::Rigid(rigid) => rigid.turning()[k].contact == contact,
                Delassus::Sparse(_) => true,
            };
            if contact as usize >= contacts {
                let bound = contacts;
                return Err(CcpError::Index { what: "turning contact", index: contact as usize, bound });
            }
            let expected = "entries must ascend by contact, and be those of the turning rows of N";
            let contact = contact as usize;
            number("the place in `turning`", contact, k as f64, ascends && owned, expected)?;
            not_negative("rolling friction", contact, rolling)?;
            not_negative("spinning friction", contact, spinning)?;
        }
        for block in 0..blocks {
            let turning = block.checked_sub(contacts);
            let contact = turning.map_or(block, |k| self.turning[k].contact as usize);
            for value in self.delassus.diagonal_block(block) {
                finite("the diagonal block of N", contact, value)?;
            }
        }
        Ok(())
    }

    /// Number of contacts N_c.
    pub fn num_contacts(&self) -> usize {
        self.delassus.num_blocks().saturating_sub(self.turning.len())
    }

    /// Friction cone of contact i.
    #[inline]
    pub fn cone(&self, i: usize) -> FrictionCone {
        FrictionCone { mu: self.friction[i] }
    }

    /// The entry of [`Self::turning`] of contact i, if it resists turning. Cost: a search among them, nothing
    /// where there are none.
    #[inline]
    pub fn turning_of(&self, i: usize) -> Option<usize> {
        if self.turning.is_empty() {
            return None;
        }
        self.turning.binary_search_by_key(&(i as u32), |turning| turning.contact).ok()
    }

    /// De Saxce's s_i of contact i for velocities u (length of r), m/s: mu |u_t|, and where it resists
    /// turning the same of rolling and spinning. The relaxed law parts contacts by it.
    pub fn de_saxce(&self, u: &[f64], i: usize) -> f64 {
        let of = |first: usize| [u[first], u[first + 1], u[first + 2]];
        let sliding = self.friction[i] * tangential_length(of(3 * i));
        let Some(k) = self.turning_of(i) else { return sliding };
        let (TurningFriction { rolling, spinning, .. }, w) =
            (self.turning[k], of(3 * (self.num_contacts() + k)));
        sliding + rolling * tangential_length(w) + spinning * w[0].abs()
    }

    /// Whether any contact has friction, of sliding, rolling or spinning.
    pub fn has_friction(&self) -> bool {
        self.friction.iter().any(|&mu| mu > 0.0)
            || self.turning.iter().any(|turning| turning.rolling > 0.0 || turning.spinning > 0.0)
    }

    /// The same problem without friction. Exact friction lets no contact close, u_n >= 0, and has no solution
    /// where this problem has none; that the relaxation has none proves nothing about it.
    pub(crate) fn frictionless(&self) -> Self {
        let mut problem = Self { friction: vec![0.0; self.num_contacts()], ..self.clone() };
        for turning in &mut problem.turning {
            (turning.rolling, turning.spinning) = (0.0, 0.0);
        }
        problem
    }

    /// Cone of contact i and of entry k of [`Self::turning`], which is its own.
    pub fn turning_cone(&self, i: usize, k: usize) -> TurningCone {
        let TurningFriction { rolling, spinning, .. } = self.turning[k];
        TurningCone { mu: self.friction[i], rolling, spinning }
    }

    /// Projects impulses (length of r) on the cones of their contacts.
    pub fn project(&self, g: &mut [f64]) {
        let contacts = self.num_contacts();
        let (g, h) = g.split_at_mut(3 * contacts);
        if self.turning.is_empty() {
            let own = g.par_chunks_exact_mut(3).enumerate().with_min_len(TASK);
            return own.for_each(|(i, g)| g.copy_from_slice(&self.cone(i).project([g[0], g[1], g[2]])));
        }
        let mut next = 0;
        for (i, g) in g.chunks_exact_mut(3).enumerate() {
            let own = [g[0], g[1], g[2]];
            if self.turning.get(next).is_some_and(|turning| turning.contact as usize == i) {
                let h = &mut h[3 * next..3 * next + 3];
                let [pg, ph] = self.turning_cone(i, next).project(own, [h[0], h[1], h[2]]);
                g.copy_from_slice(&pg);
                h.copy_from_slice(&ph);
                next += 1;
            } else {
                g.copy_from_slice(&self.cone(i).project(own));
            }
        }
    }

    /// Contacts across the boundary of a stress-controlled cell: N as a matrix has a block for each two of
    /// them.
    pub(crate) fn contacts_across(&self) -> usize {
        match &*self.delassus {
            Delassus::Rigid(rigid) => rigid.cell().map_or(0, |cell| cell.ways.len()),
            Delassus::Sparse(_) => 0,
        }
    }

    /// The same problem with N as a matrix, which every solver takes, where these are bodies that `asks` for
    /// it; the one `known` where it is of this N.
    pub(crate) fn as_matrix_if(
        &self,
        asks: impl FnOnce(&RigidDelassus) -> bool,
        known: &mut KnownMatrix,
    ) -> Option<Self> {
        let Delassus::Rigid(rigid) = &*self.delassus else { return None };
        if !asks(rigid) {
            return None;
        }
        let delassus = match known {
            Some((of, matrix)) if of.is(&self.delassus) => Arc::clone(matrix),
            _ => {
                let matrix = Arc::new(Delassus::Sparse(rigid.assemble()));
                *known = Some((DelassusIdentity::of(&self.delassus), Arc::clone(&matrix)));
                matrix
            }
        };
        Some(Self { delassus, ..self.clone() })
    }

    /// eta_i = trace(N_ii) / 3 of every contact, 1/kg; contacts between immovable bodies get the smallest
    /// positive eta of the problem (1 if there is none), so that dividing by it is safe.
    pub fn diagonal_scale(&self) -> Vec<f64> {
        let diagonals = self.delassus.diagonals();
        let of = |[nn, t1, t2]: &[f64; 3]| (nn + t1 + t2) / 3.0;
        let mut eta: Vec<f64> =
            diagonals[..self.num_contacts()].par_iter().with_min_len(TASK).map(of).collect();
        let smallest = eta.iter().copied().filter(|&e| e > 0.0).fold(f64::INFINITY, f64::min);
        let replacement = if smallest.is_finite() { smallest } else { 1.0 };
        for e in &mut eta {
            if *e <= 0.0 {
                *e = replacement;
            }
        }
        eta
    }

    /// u <- N g + r: the relative velocities (m/s, contact frames) that impulses g (N s) leave.
    pub fn velocity(&self, g: &[f64], u: &mut [f64], work: &mut DelassusWork) {
        self.delassus.multiply(g, u, work);
        axpy(1.0, &self.r, u);
    }

    /// Objective 1/2 g^T N g + r^T g, given u = N g + r.
    pub fn objective(&self, g: &[f64], u: &[f64]) -> f64 {
        use graintrain_linalg::parallel::dot;
        0.5 * (dot(g, u) + dot(g, &self.r))
    }
}
