//! Compliant contacts: a diagonal beside D^T M^-1 D.

use super::RigidDelassus;
use std::sync::OnceLock;

impl RigidDelassus {
    /// N = D^T M^-1 D + C, where C has the compliance c_i >= 0 of contact i, 1/kg, on its normal row: a
    /// contact with the velocity u_n along the normal in D^T v needs u_n + c_i g_n + r_n >= 0 only. Of a
    /// spring of stiffness k under implicit Euler, c = 1 / (k dt^2); zero is a rigid contact. An empty list:
    /// all are rigid. First-order methods take it as it is; others get N as a matrix ([`Self::assemble`])
    /// from their [cascade](crate::solver::cascade).
    ///
    /// Source: M. Anitescu, G. D. Hart, "A constraint-stabilized time-stepping approach for rigid multibody
    /// dynamics with joints, contact and friction", Int. J. Numer. Methods Eng. 60(14):2335-2371, 2004; A. M.
    /// Castro, F. N. Permenter, X. Han, "An unconstrained convex formulation of compliant contact", IEEE
    /// Transactions on Robotics 39(2):1301-1320, 2023.
    ///
    /// # Panics
    /// If the list is not empty and has another length than the contacts, or an entry is negative or not
    /// finite.
    #[must_use]
    pub fn with_compliance(mut self, compliance: Vec<f64>) -> Self {
        assert!(
            compliance.is_empty() || compliance.len() == self.num_contacts(),
            "one compliance per contact"
        );
        assert!(
            compliance.iter().all(|c| c.is_finite() && *c >= 0.0),
            "a compliance is finite and not negative"
        );
        let any = compliance.iter().any(|&c| c > 0.0);
        self.compliance = if any { compliance } else { Vec::new() };
        self.diagonal = OnceLock::new();
        self
    }

    /// Compliances of the contacts' normal rows, 1/kg; empty where all are rigid.
    pub fn compliance(&self) -> &[f64] {
        &self.compliance
    }

    /// Whether N = D^T M^-1 D with bodies that move one by one: neither coupled bodies nor compliant contacts
    /// nor a stress-controlled cell.
    pub fn is_plain(&self) -> bool {
        self.coupled.is_empty() && self.compliance.is_empty() && self.cell.is_none()
    }

    /// u <- u + C g.
    pub(super) fn add_compliance(&self, g: &[f64], u: &mut [f64]) {
        for ((c, g), u) in self.compliance.iter().zip(g.chunks_exact(3)).zip(u.chunks_exact_mut(3)) {
            u[0] += c * g[0];
        }
    }

    /// The compliance of contact i, 1/kg.
    pub(super) fn compliance_of(&self, i: usize) -> f64 {
        self.compliance.get(i).copied().unwrap_or(0.0)
    }
}
