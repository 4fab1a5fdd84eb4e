//! Measurements: plain numbers from a world and the contacts of its last step. Nothing here changes a world.
//!
//! | module | measures |
//! |---|---|
//! | [`space`] | which bodies are meant, volumes inside a region, porosity |
//! | [`contacts`] | coordination, rattlers, sliding contacts, fabric, distribution of forces |
//! | [`stress`] | the stress tensor of a volume |
//! | [`profile`] | velocity, density, temperature in bins along an axis or a radius |
//! | [`flow`] | mass through a plane, force through a plane, force on bodies |
//! | [`mixing`] | Lacey's index |
//! | [`repose`] | the angle of a slope |
//! | [`wheel`] | slip, sinkage, pull, load and torque of a wheel |
//! | [`energy`] | energies, and the ledger of a step |
//! | [`statistics`] | means of correlated series with their errors, where a series becomes steady |
//!
//! Forces are impulses of the last step over its length. Contact points and normals are those at the start of
//! the step, places of bodies those at its end; the frames of a run hold the same numbers, so that every
//! measurement can be made from them again.

pub mod contacts;
pub mod energy;
pub mod flow;
pub mod mixing;
pub mod profile;
pub mod repose;
pub mod space;
pub mod statistics;
pub mod stress;
pub mod wheel;

#[cfg(test)]
mod samples;
