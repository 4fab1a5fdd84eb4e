//! How files and other languages describe a shape that lengths alone make.

use super::Shape;
use crate::error::ModelError;

/// A shape that lengths alone describe.
#[derive(Debug)]
pub struct Lengths {
    /// Name, such as `cylinder`.
    pub name: &'static str,
    /// Where pages tell of it.
    pub heading: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// The lengths as a table, for pages.
    pub example: &'static str,
    /// The lengths, in their order.
    pub lengths: &'static [Length],
    /// The shape of as many lengths, m.
    pub(super) make: fn(&[f64]) -> Shape,
}

impl Lengths {
    /// The shape of these lengths, m, in their order. They are not checked ([`Shape::validate`]).
    ///
    /// # Errors
    /// [`ModelError::Table`] for another number of lengths.
    pub fn shape(&self, lengths: &[f64]) -> Result<Shape, ModelError> {
        if lengths.len() != self.lengths.len() {
            let what = format!("a {} has {} lengths, not {}", self.name, self.lengths.len(), lengths.len());
            return Err(ModelError::Table { what });
        }
        Ok((self.make)(lengths))
    }
}

/// A length of a shape.
#[derive(Debug)]
pub struct Length {
    /// Name, such as `radius`.
    pub name: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// As a scene might write it.
    pub example: &'static str,
    /// Whether it must be given, and be positive; otherwise it is zero by default.
    pub is_required: bool,
}

impl Length {
    /// A length that must be given.
    pub(super) const fn required(name: &'static str, example: &'static str, meaning: &'static str) -> Self {
        Self { name, meaning, example, is_required: true }
    }
}
