//! Bodies that enter, leave and grow between the steps of a run, and what they bring and take.

use crate::body_numbers::BodyNumbers;
use crate::growth::Growth;
use crate::stream::{Amount, Moment, Outlet, Stream, StreamState, take_out};
use graintrain::collide::Collider;
use graintrain::error::ModelError;
use graintrain::world::World;
use serde::{Deserialize, Serialize};

/// Ways in and out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OpenBoundaries {
    /// Ways in.
    pub streams: Vec<Stream>,
    /// Ways out.
    pub outlets: Vec<Outlet>,
}

/// What went through them so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OpenBoundaryState {
    /// Who is there.
    pub numbers: BodyNumbers,
    /// Of each stream.
    pub streams: Vec<StreamState>,
    /// What left through each outlet.
    pub outlets: Vec<Amount>,
    /// Mass and kinetic energy by growth.
    pub grown: Amount,
    /// Number of the last step that bodies have entered and left for: a step that was stopped and is made
    /// again takes no others.
    prepared: u64,
}

impl OpenBoundaryState {
    /// All that has come: what streams gave, and mass by growth.
    pub fn entered(&self) -> Amount {
        let mut sum = self.grown;
        self.streams.iter().for_each(|stream| sum.add(&stream.given));
        sum
    }

    /// All that left.
    pub fn left(&self) -> Amount {
        let mut sum = Amount::default();
        self.outlets.iter().for_each(|amount| sum.add(amount));
        sum
    }

    /// How many streams have a body that waits for a free place.
    pub fn waiting(&self) -> usize {
        self.streams.iter().filter(|stream| stream.waits).count()
    }
}

impl OpenBoundaries {
    /// Whether the number of bodies may change.
    pub fn changes_bodies(&self) -> bool {
        !(self.streams.is_empty() && self.outlets.is_empty())
    }

    /// Whether all streams that flow in a stage have given all.
    pub fn is_filled(&self, stage: usize, state: &OpenBoundaryState) -> bool {
        let here = |stream: &Stream| stream.stage.is_none_or(|only| only == stage);
        let mut done = self.streams.iter().zip(&state.streams);
        state.streams.len() == self.streams.len()
            && done.all(|(stream, state)| !here(stream) || state.is_done)
    }

    /// Lets bodies leave, enter and grow before the next step, once. `overlap` is the deepest one over size
    /// that the last step left.
    ///
    /// # Errors
    /// [`ModelError`] for bodies that the world does not take.
    pub fn prepare(
        &self,
        world: &mut World,
        collider: &mut Collider,
        state: &mut OpenBoundaryState,
        growth: Option<&Growth>,
        now: Moment,
        overlap: f64,
    ) -> Result<(), ModelError> {
        if state.prepared == world.step + 1 || !(self.changes_bodies() || growth.is_some()) {
            return Ok(());
        }
        state.prepared = world.step + 1;
        state.streams.resize(self.streams.len(), StreamState::default());
        state.outlets.resize(self.outlets.len(), Amount::default());
        if let Some(after) = take_out(world, &self.outlets, &mut state.outlets) {
            state.numbers.leave(&after);
        }
        for (index, (stream, made)) in (0..).zip(self.streams.iter().zip(&mut state.streams)) {
            stream.flow(index, world, collider, &mut state.numbers, made, now)?;
        }
        if let Some(growth) = growth {
            state.grown.add(&growth.grow(world, &state.numbers, now.step, overlap)?);
        }
        Ok(())
    }

    /// What is wrong with it or its state for a world: scenes give nothing, a damaged file may.
    pub(crate) fn defect(&self, world: &World, state: &OpenBoundaryState) -> Option<String> {
        let bodies = world.bodies.len();
        if !state.numbers.fits(bodies, self.streams.len()) {
            return Some("the numbers of its bodies fit no run of it".into());
        }
        if state.streams.len() > self.streams.len() || state.outlets.len() > self.outlets.len() {
            return Some("more streams or outlets have begun than there are".into());
        }
        let unfit = self.streams.iter().find(|stream| !stream.fits(world));
        unfit.map(|stream| format!("stream {} fits no run of it", stream.name))
    }
}
