//! Linear combinations of images: what becomes of them when a pass has computed a new one.

use super::lanes::Numbers;

/// What becomes of a method's images when a pass has computed a new one: a linear combination, number by
/// number.
pub trait Combination<const K: usize>: Sync {
    /// The images' new numbers, given those of the fresh image.
    fn of<V: Numbers>(&self, fresh: V, images: [V; K]) -> [V; K];
}

/// Image <- the fresh one.
pub struct Replace;

impl Combination<1> for Replace {
    #[inline(always)]
    fn of<V: Numbers>(&self, fresh: V, _: [V; 1]) -> [V; 1] {
        [fresh]
    }
}

/// Image <- image + the fresh one.
pub struct Accumulate;

impl Combination<1> for Accumulate {
    #[inline(always)]
    fn of<V: Numbers>(&self, fresh: V, [image]: [V; 1]) -> [V; 1] {
        [image + fresh]
    }
}
