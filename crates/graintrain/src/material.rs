//! Materials: density, and friction and restitution of every pair.

use serde::{Deserialize, Serialize};

/// Materials by index, with symmetric tables of pair properties.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Materials {
    /// Names, unique.
    pub names: Vec<String>,
    /// Densities, kg/m^3.
    pub density: Vec<f64>,
    /// Coefficient of friction of a pair (i, j): entry `i * len + j`, symmetric.
    pub friction: Vec<f64>,
    /// Newton's coefficient of restitution of a pair, in [0, 1]: entry `i * len + j`, symmetric.
    pub restitution: Vec<f64>,
}

impl Materials {
    /// Number of materials.
    pub fn len(&self) -> usize {
        self.names.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// Coefficient of friction between materials i and j.
    pub fn pair_friction(&self, i: usize, j: usize) -> f64 {
        self.friction[i * self.len() + j]
    }

    /// Coefficient of restitution between materials i and j.
    pub fn pair_restitution(&self, i: usize, j: usize) -> f64 {
        self.restitution[i * self.len() + j]
    }
}
