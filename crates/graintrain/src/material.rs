//! Materials: density, and friction and restitution of every pair.

use crate::error::{ModelError, positive};
use crate::handle::MaterialId;
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
    /// One material, with its own friction and restitution.
    ///
    /// # Errors
    /// As [`Materials::add`] and [`Materials::set_pair`].
    pub fn single(name: &str, density: f64, friction: f64, restitution: f64) -> Result<Self, ModelError> {
        let mut materials = Self::default();
        let index = materials.add(name, density)?;
        materials.set_pair(index, index, friction, restitution)?;
        Ok(materials)
    }

    /// Adds a material and returns its handle. Its pairs have no friction and no restitution until
    /// [`Materials::set_pair`] gives them some.
    ///
    /// # Errors
    /// [`ModelError::DuplicateMaterial`], or [`ModelError::Value`] unless the density is positive.
    pub fn add(&mut self, name: &str, density: f64) -> Result<MaterialId, ModelError> {
        positive(format!("the density of material '{name}'"), density)?;
        if self.names.iter().any(|known| known == name) {
            return Err(ModelError::DuplicateMaterial { name: name.to_string() });
        }
        let old = self.len();
        self.names.push(name.to_string());
        self.density.push(density);
        for table in [&mut self.friction, &mut self.restitution] {
            let mut grown = vec![0.0; (old + 1) * (old + 1)];
            for i in 0..old {
                grown[i * (old + 1)..i * (old + 1) + old].copy_from_slice(&table[i * old..(i + 1) * old]);
            }
            *table = grown;
        }
        Ok(MaterialId::from_index(old))
    }

    /// Sets friction and restitution between materials i and j (which may be the same).
    ///
    /// # Errors
    /// [`ModelError::Index`], or [`ModelError::Value`] unless 0 <= friction and 0 <= restitution <= 1.
    pub fn set_pair(
        &mut self,
        i: MaterialId,
        j: MaterialId,
        friction: f64,
        restitution: f64,
    ) -> Result<(), ModelError> {
        let len = self.len();
        let (i, j) = (i.index(), j.index());
        for index in [i, j] {
            if index >= len {
                return Err(ModelError::Index { what: "material", index, len });
            }
        }
        let pair = || format!("between materials '{}' and '{}'", self.names[i], self.names[j]);
        if !(friction.is_finite() && friction >= 0.0) {
            let what = format!("the friction {}", pair());
            return Err(ModelError::Value { what, value: friction, expected: "finite and not negative" });
        }
        if !(0.0..=1.0).contains(&restitution) {
            let what = format!("the restitution {}", pair());
            return Err(ModelError::Value { what, value: restitution, expected: "in [0, 1]" });
        }
        for entry in [i * len + j, j * len + i] {
            self.friction[entry] = friction;
            self.restitution[entry] = restitution;
        }
        Ok(())
    }

    /// The materials in the order in which they were added.
    pub fn handles(&self) -> impl Iterator<Item = MaterialId> + use<> {
        (0..self.len()).map(MaterialId::from_index)
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_survive_the_addition_of_materials_and_are_symmetric() {
        let mut materials = Materials::single("glass", 2500.0, 0.3, 0.5).unwrap();
        let steel = materials.add("steel", 7800.0).unwrap();
        materials.set_pair(MaterialId::default(), steel, 0.2, 0.4).unwrap();
        let rubber = materials.add("rubber", 1100.0).unwrap().index();
        assert_eq!(materials.pair_friction(0, 0), 0.3);
        assert_eq!(materials.pair_friction(1, 0), 0.2);
        assert_eq!(materials.pair_restitution(0, 1), 0.4);
        assert_eq!(materials.pair_friction(rubber, 1), 0.0);
    }

    #[test]
    fn bad_values_are_refused() {
        let mut materials = Materials::single("glass", 2500.0, 0.3, 0.5).unwrap();
        assert!(materials.add("glass", 1.0).is_err());
        assert!(materials.add("void", 0.0).is_err());
        let (glass, none) = (MaterialId::default(), MaterialId::from_index(1));
        assert!(materials.set_pair(glass, none, 0.1, 0.1).is_err());
        assert!(materials.set_pair(glass, glass, -0.1, 0.1).is_err());
        assert!(materials.set_pair(glass, glass, 0.1, 1.1).is_err());
        assert!(materials.set_pair(glass, glass, f64::NAN, 0.1).is_err());
    }
}
