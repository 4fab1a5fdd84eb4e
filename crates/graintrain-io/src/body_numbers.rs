//! Who the bodies of a run are, while some enter and others leave.
//!
//! Indices of bodies move up when one of them leaves; numbers stay. The bodies of a scene have their index as
//! number, those that enter later the next ones. Whoever names bodies for longer than a step (measurements,
//! stages, frames) names numbers.

use graintrain::handle::BodyId;
use serde::{Deserialize, Serialize};

/// The numbers of the bodies that are there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BodyNumbers {
    /// Number of each body, ascending; empty while nobody has entered or left.
    number: Vec<u64>,
    /// The stream that each body came from; [`SCENE`] for those of the scene.
    stream: Vec<u32>,
    /// The number that the next body gets; 0 while nobody has entered or left.
    next: u64,
}

/// In the place of a stream: the scene itself.
const SCENE: u32 = u32::MAX;

/// Some bodies: named ones, and all that come from some streams.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Members {
    /// Numbers of bodies of the scene.
    pub bodies: Vec<BodyId>,
    /// Indices of streams.
    pub streams: Vec<u32>,
}

impl BodyNumbers {
    /// The numbers of the first so many bodies of a scene into which others will come.
    pub fn of_scene(bodies: usize) -> Self {
        let mut numbers = Self::default();
        numbers.begin(bodies);
        numbers
    }

    /// Whether somebody has entered or left.
    pub fn has_changed(&self) -> bool {
        self.next > 0
    }

    /// The number of the body with this index.
    pub fn number(&self, body: usize) -> u64 {
        self.number.get(body).copied().unwrap_or(body as u64)
    }

    /// How many numbers have been given, where there are now so many bodies.
    pub fn given(&self, bodies: usize) -> u64 {
        if self.has_changed() { self.next } else { bodies as u64 }
    }

    /// The index of the body with this number, if it is still there.
    pub fn index(&self, number: u64) -> Option<usize> {
        if self.has_changed() { self.number.binary_search(&number).ok() } else { Some(number as usize) }
    }

    /// The bodies of a list of numbers that are still there, by their indices.
    pub fn present(&self, numbers: &[BodyId]) -> Vec<BodyId> {
        let index = |number: &BodyId| self.index(number.index() as u64).map(BodyId::from_index);
        numbers.iter().filter_map(index).collect()
    }

    /// The members that are there, by their indices: named ones, then those of streams.
    pub fn members(&self, members: &Members) -> Vec<BodyId> {
        let mut found = self.present(&members.bodies);
        let from = |(_, stream): &(usize, &u32)| members.streams.contains(stream);
        found.extend(self.stream.iter().enumerate().filter(from).map(|(body, _)| BodyId::from_index(body)));
        found
    }

    /// A body has come from a stream, as the last of the world; before there were so many.
    pub(crate) fn enter(&mut self, bodies: usize, stream: u32) {
        self.begin(bodies);
        self.number.push(self.next);
        self.stream.push(stream);
        self.next += 1;
    }

    /// Bodies have left: `after` has the new index of every former one.
    pub(crate) fn leave(&mut self, after: &[Option<BodyId>]) {
        self.begin(after.len());
        let mut stays = after.iter().map(Option::is_some);
        self.number.retain(|_| stays.next().unwrap_or(true));
        let mut stays = after.iter().map(Option::is_some);
        self.stream.retain(|_| stays.next().unwrap_or(true));
    }

    fn begin(&mut self, bodies: usize) {
        if !self.has_changed() {
            self.number = (0..bodies as u64).collect();
            self.stream = vec![SCENE; bodies];
            self.next = bodies as u64;
        }
    }

    /// Whether it is one of a world of so many bodies with so many streams.
    pub(crate) fn fits(&self, bodies: usize, streams: usize) -> bool {
        if !self.has_changed() {
            return self.number.is_empty() && self.stream.is_empty();
        }
        self.number.len() == bodies
            && self.stream.len() == bodies
            && self.number.is_sorted_by(|a, b| a < b)
            && self.number.last().is_none_or(|last| *last < self.next)
            // Handles of bodies have 32 bits.
            && self.next < u64::from(u32::MAX)
            && self.stream.iter().all(|&stream| stream == SCENE || (stream as usize) < streams)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stay_while_indices_move_up() {
        let ids = |list: &[usize]| list.iter().map(|&i| BodyId::from_index(i)).collect::<Vec<_>>();
        let mut numbers = BodyNumbers::default();
        assert_eq!(numbers.present(&ids(&[0, 2])), ids(&[0, 2]));
        numbers.enter(3, 1);
        numbers.leave(&[
            Some(BodyId::from_index(0)),
            None,
            Some(BodyId::from_index(1)),
            Some(BodyId::from_index(2)),
        ]);
        numbers.enter(3, 0);
        assert_eq!((0..4).map(|body| numbers.number(body)).collect::<Vec<_>>(), [0, 2, 3, 4]);
        assert_eq!(numbers.present(&ids(&[0, 1, 2, 4])), ids(&[0, 1, 3]));
        let members = Members { bodies: ids(&[2]), streams: vec![1] };
        assert_eq!(numbers.members(&members), ids(&[1, 2]));
        assert!(numbers.fits(4, 2) && !numbers.fits(4, 1) && !numbers.fits(3, 2));
        assert_eq!(numbers.given(4), 5);
    }
}
