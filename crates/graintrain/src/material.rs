//! Materials: density, and friction, restitution and resistance to turning of every pair.

use crate::error::{ModelError, index, not_below_zero, positive};
use crate::handle::MaterialId;
use serde::{Deserialize, Serialize};

/// How a pair resists rolling or spinning: a coefficient with the dimension of a length (see
/// [`crate::turning`]).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TurningResistance {
    /// So many effective radii of the pair, R_A R_B / (R_A + R_B); dimensionless.
    Ratio(f64),
    /// The length itself, m, whatever the bodies' sizes.
    Length(f64),
}

impl TurningResistance {
    /// None.
    pub const NONE: Self = Self::Ratio(0.0);

    /// Whether it is none.
    pub fn is_none(&self) -> bool {
        self.value() == 0.0
    }

    /// The coefficient, m, where the effective radius is this.
    pub fn length(self, effective_radius: f64) -> f64 {
        match self {
            Self::Ratio(ratio) => ratio * effective_radius,
            Self::Length(length) => length,
        }
    }

    /// The number, in its own unit.
    pub fn value(self) -> f64 {
        match self {
            Self::Ratio(value) | Self::Length(value) => value,
        }
    }
}

/// Spring and dashpot of a contact along its normal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Elasticity {
    /// k, N/m per contact; zero: rigid.
    pub stiffness: f64,
    /// d, N s/m per contact.
    pub damping: f64,
}

impl Elasticity {
    /// None: contacts are rigid.
    pub const RIGID: Self = Self { stiffness: 0.0, damping: 0.0 };

    /// Whether contacts are rigid.
    pub fn is_rigid(&self) -> bool {
        self.stiffness == 0.0
    }

    /// Checks both numbers; `of` says whose they are.
    ///
    /// # Errors
    /// [`ModelError::Value`] unless both are finite and not negative, and there is a stiffness where there is
    /// damping.
    pub fn validate(&self, of: &str) -> Result<(), ModelError> {
        if self.stiffness == 0.0 && self.damping > 0.0 {
            let (what, value) = (format!("the damping {of}, without a stiffness,"), self.damping);
            return Err(ModelError::Value { what, value, expected: "0" });
        }
        if self.stiffness != 0.0 {
            positive(format!("the stiffness {of}"), self.stiffness)?;
        }
        not_below_zero(format!("the damping {of}"), self.damping)
    }
}

/// Largest cohesion, N: speeds that it gives to the lightest bodies, and their squares, are numbers.
pub const MOST_COHESION: f64 = 1e30;

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
    /// Resistance of a pair to rolling: entry `i * len + j`, symmetric. Empty where no pair resists turning,
    /// like `spinning`.
    pub rolling: Vec<TurningResistance>,
    /// Resistance of a pair to spinning about the contact normal: entry `i * len + j`, symmetric.
    pub spinning: Vec<TurningResistance>,
    /// Stiffness and damping of a pair: entry `i * len + j`, symmetric. Empty where all are rigid.
    pub elasticity: Vec<Elasticity>,
    /// Force with which bodies of a pair pull each other while they touch, N: entry `i * len + j`, symmetric.
    /// Empty where none do.
    pub cohesion: Vec<f64>,
}

/// A table of pairs of `old` materials with one more, whose pairs get `value`.
fn grown<T: Copy>(table: &[T], old: usize, value: T) -> Vec<T> {
    let mut grown = vec![value; (old + 1) * (old + 1)];
    for i in 0..old {
        grown[i * (old + 1)..i * (old + 1) + old].copy_from_slice(&table[i * old..(i + 1) * old]);
    }
    grown
}

/// Writes the value of a pair of `len` materials into a table, which is empty or holds all pairs.
fn put<T: Copy>(table: &mut Vec<T>, [i, j]: [usize; 2], len: usize, value: T, none: T) {
    table.resize(len * len, none);
    (table[i * len + j], table[j * len + i]) = (value, value);
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
            *table = grown(table, old, 0.0);
        }
        for table in [&mut self.rolling, &mut self.spinning].into_iter().filter(|table| !table.is_empty()) {
            *table = grown(table, old, TurningResistance::NONE);
        }
        if self.has_elastic_pairs() {
            self.elasticity = grown(&self.elasticity, old, Elasticity::RIGID);
        }
        if self.has_cohesive_pairs() {
            self.cohesion = grown(&self.cohesion, old, 0.0);
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
        let [i, j] = self.pair_index(i, j)?;
        not_below_zero(format!("the friction {}", self.pair_name(i, j)), friction)?;
        if !(0.0..=1.0).contains(&restitution) {
            let what = format!("the restitution {}", self.pair_name(i, j));
            return Err(ModelError::Value { what, value: restitution, expected: "in [0, 1]" });
        }
        self.check_rebound(i, j, restitution, self.pair_elasticity(i, j))?;
        let len = self.len();
        put(&mut self.friction, [i, j], len, friction, 0.0);
        put(&mut self.restitution, [i, j], len, restitution, 0.0);
        Ok(())
    }

    /// Sets how materials i and j (which may be the same) resist rolling on each other, and spinning about
    /// the contact normal.
    ///
    /// ```
    /// use graintrain::material::{Materials, TurningResistance};
    /// let mut materials = Materials::single("gravel", 2600.0, 0.5, 0.0)?;
    /// let gravel = materials.handles().next().unwrap();
    /// materials.set_pair_turning(gravel, gravel, TurningResistance::Ratio(0.1), TurningResistance::Length(1e-4))?;
    /// # Ok::<(), graintrain::error::ModelError>(())
    /// ```
    ///
    /// # Errors
    /// [`ModelError::Index`], or [`ModelError::Value`] unless both are finite and not negative.
    pub fn set_pair_turning(
        &mut self,
        i: MaterialId,
        j: MaterialId,
        rolling: TurningResistance,
        spinning: TurningResistance,
    ) -> Result<(), ModelError> {
        let [i, j] = self.pair_index(i, j)?;
        for (what, resistance) in [("rolling", rolling), ("spinning", spinning)] {
            not_below_zero(format!("the {what} friction {}", self.pair_name(i, j)), resistance.value())?;
        }
        if rolling.is_none() && spinning.is_none() && !self.resist_turning() {
            return Ok(());
        }
        let len = self.len();
        for (table, resistance) in [(&mut self.rolling, rolling), (&mut self.spinning, spinning)] {
            let resistance = if resistance.is_none() { TurningResistance::NONE } else { resistance };
            put(table, [i, j], len, resistance, TurningResistance::NONE);
        }
        Ok(())
    }

    /// Sets stiffness and damping of contacts between materials i and j (which may be the same).
    ///
    /// # Errors
    /// [`ModelError::Index`]; [`ModelError::Value`] for numbers that are negative or not finite, damping
    /// without stiffness, and a pair with restitution.
    pub fn set_pair_elasticity(
        &mut self,
        i: MaterialId,
        j: MaterialId,
        elasticity: Elasticity,
    ) -> Result<(), ModelError> {
        let [i, j] = self.pair_index(i, j)?;
        elasticity.validate(&self.pair_name(i, j))?;
        self.check_rebound(i, j, self.pair_restitution(i, j), elasticity)?;
        if !(elasticity.is_rigid() && self.elasticity.is_empty()) {
            let len = self.len();
            put(&mut self.elasticity, [i, j], len, elasticity, Elasticity::RIGID);
        }
        Ok(())
    }

    /// Sets the force, N, with which bodies of materials i and j (which may be the same) pull each other
    /// while they touch.
    ///
    /// # Errors
    /// [`ModelError::Index`], or [`ModelError::Value`] unless it is not negative and at most
    /// [`MOST_COHESION`].
    pub fn set_pair_cohesion(&mut self, i: MaterialId, j: MaterialId, force: f64) -> Result<(), ModelError> {
        let [i, j] = self.pair_index(i, j)?;
        if !(0.0..=MOST_COHESION).contains(&force) {
            let what = format!("the cohesion {}", self.pair_name(i, j));
            return Err(ModelError::Value { what, value: force, expected: "between 0 and 1e30 N" });
        }
        if !(force == 0.0 && self.cohesion.is_empty()) {
            let len = self.len();
            put(&mut self.cohesion, [i, j], len, force, 0.0);
        }
        Ok(())
    }

    fn pair_index(&self, i: MaterialId, j: MaterialId) -> Result<[usize; 2], ModelError> {
        let pair = [i.index(), j.index()];
        pair.into_iter().try_for_each(|one| index("material", one, self.len()))?;
        Ok(pair)
    }

    fn pair_name(&self, i: usize, j: usize) -> String {
        format!("between materials '{}' and '{}'", self.names[i], self.names[j])
    }

    fn check_rebound(
        &self,
        i: usize,
        j: usize,
        restitution: f64,
        elasticity: Elasticity,
    ) -> Result<(), ModelError> {
        if restitution > 0.0 && !elasticity.is_rigid() {
            let what = format!("the restitution {}", self.pair_name(i, j));
            let expected = "0 where contacts have a stiffness, which rebounds by itself: give it damping";
            return Err(ModelError::Value { what, value: restitution, expected });
        }
        Ok(())
    }

    /// Whether any pair may have a stiffness.
    pub fn has_elastic_pairs(&self) -> bool {
        !self.elasticity.is_empty()
    }

    /// Whether any pair may pull.
    pub fn has_cohesive_pairs(&self) -> bool {
        !self.cohesion.is_empty()
    }

    /// Stiffness and damping of contacts between materials i and j.
    pub fn pair_elasticity(&self, i: usize, j: usize) -> Elasticity {
        self.elasticity.get(i * self.len() + j).copied().unwrap_or(Elasticity::RIGID)
    }

    /// Force, N, with which bodies of materials i and j pull each other while they touch.
    pub fn pair_cohesion(&self, i: usize, j: usize) -> f64 {
        self.cohesion.get(i * self.len() + j).copied().unwrap_or(0.0)
    }

    /// Whether any pair may resist turning.
    pub fn resist_turning(&self) -> bool {
        !self.rolling.is_empty()
    }

    /// Resistance to rolling between materials i and j.
    pub fn pair_rolling(&self, i: usize, j: usize) -> TurningResistance {
        self.rolling.get(i * self.len() + j).copied().unwrap_or(TurningResistance::NONE)
    }

    /// Resistance to spinning between materials i and j.
    pub fn pair_spinning(&self, i: usize, j: usize) -> TurningResistance {
        self.spinning.get(i * self.len() + j).copied().unwrap_or(TurningResistance::NONE)
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
    fn stiffness_and_cohesion_survive_the_addition_of_materials_and_are_symmetric() {
        let mut materials = Materials::single("glass", 2500.0, 0.3, 0.0).unwrap();
        let glass = MaterialId::default();
        materials.set_pair_elasticity(glass, glass, Elasticity::RIGID).unwrap();
        assert!(!materials.has_elastic_pairs() && !materials.has_cohesive_pairs());
        let steel = materials.add("steel", 7800.0).unwrap();
        let spring = Elasticity { stiffness: 1e4, damping: 3.0 };
        materials.set_pair_elasticity(glass, steel, spring).unwrap();
        materials.set_pair_cohesion(steel, steel, 0.2).unwrap();
        materials.add("rubber", 1100.0).unwrap();
        assert_eq!(
            (materials.pair_elasticity(1, 0), materials.pair_elasticity(1, 2)),
            (spring, Elasticity::RIGID)
        );
        assert_eq!((materials.pair_cohesion(1, 1), materials.pair_cohesion(2, 1)), (0.2, 0.0));
        let text = |result: Result<(), ModelError>| result.unwrap_err().to_string();
        assert!(text(materials.set_pair(glass, steel, 0.1, 0.5)).contains("damping"));
        materials.set_pair(glass, glass, 0.1, 0.5).unwrap();
        assert!(text(materials.set_pair_elasticity(glass, glass, spring)).contains("restitution"));
        let wrong = |stiffness: f64, damping: f64| Elasticity { stiffness, damping };
        for (bad, word) in [
            (wrong(-1.0, 0.0), "stiffness"),
            (
                wrong(0.0, 1.0),
                "the damping between materials 'steel' and 'steel', without a stiffness, is 1; it must be 0",
            ),
            (wrong(1.0, f64::NAN), "damping"),
        ] {
            assert!(text(materials.set_pair_elasticity(steel, steel, bad)).contains(word));
        }
        for bad in [-1.0, f64::NAN, f64::INFINITY, 1e308] {
            assert!(text(materials.set_pair_cohesion(steel, glass, bad)).contains("cohesion"));
        }
        materials.set_pair_cohesion(steel, glass, MOST_COHESION).unwrap();
    }

    #[test]
    fn resistance_to_turning_survives_the_addition_of_materials_and_is_symmetric() {
        let mut materials = Materials::single("glass", 2500.0, 0.3, 0.5).unwrap();
        let glass = MaterialId::default();
        let (ratio, length) = (TurningResistance::Ratio(0.1), TurningResistance::Length(1e-3));
        materials
            .set_pair_turning(glass, glass, TurningResistance::Length(0.0), TurningResistance::NONE)
            .unwrap();
        assert!(!materials.resist_turning());
        let steel = materials.add("steel", 7800.0).unwrap();
        materials.set_pair_turning(glass, steel, ratio, length).unwrap();
        materials.add("rubber", 1100.0).unwrap();
        assert!(materials.resist_turning());
        assert_eq!((materials.pair_rolling(1, 0), materials.pair_spinning(0, 1)), (ratio, length));
        assert_eq!(materials.pair_rolling(1, 2), TurningResistance::NONE);
        assert_eq!((ratio.length(0.5), length.length(0.5)), (0.05, 1e-3));
        let bad = materials.set_pair_turning(glass, steel, TurningResistance::Ratio(-0.1), length);
        assert!(bad.unwrap_err().to_string().contains("rolling"));
        let bad = materials.set_pair_turning(glass, steel, ratio, TurningResistance::Length(f64::NAN));
        assert!(bad.unwrap_err().to_string().contains("spinning"));
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
