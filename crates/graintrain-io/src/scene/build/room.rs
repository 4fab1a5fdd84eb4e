//! Lattices that cannot fit into their space, reported before their bodies are made: there may be millions of
//! them, each in contact with all others.

use crate::scene::error::{SceneError, SceneErrorKind};
use crate::scene::model::{PackingSource, PackingSpec};
use crate::scene::periodic::PeriodicSpec;
use std::f64::consts::PI;

const AXES: [&str; 3] = ["x", "y", "z"];

/// An error where balls of this radius, m, one in every body of the lattice, have more volume than the space
/// that holds them: some of them overlap then, wherever they are. Bodies at random places are only put where
/// they fit.
pub(super) fn check(
    name: &str,
    spec: &PackingSpec,
    radius: f64,
    periodic: Option<&PeriodicSpec>,
) -> Result<(), SceneError> {
    let PackingSource::Lattice(lattice) = &spec.source else { return Ok(()) };
    let edge = |k: usize| match periodic.filter(|cell| cell.axes.iter().any(|own| own == AXES[k])) {
        Some(cell) => cell.max[k] - cell.min[k],
        None => (lattice.counts[k] as f64 - 1.0) * lattice.pitch[k] + 2.0 * (lattice.jitter + radius),
    };
    let count: f64 = lattice.counts.iter().map(|&n| n as f64).product();
    let space: f64 = (0..3).map(edge).product();
    let solid: f64 = 4.0 / 3.0 * PI * radius.powi(3) * count;
    if solid <= space {
        return Ok(());
    }
    let problem = format!(
        "packing `{name}`: {count} bodies with a ball of radius {radius:.3e} m in each have {solid:.3e} m^3, but the space for them has \
         {space:.3e} m^3, so that they overlap"
    );
    Err(SceneError::at(SceneErrorKind::Contradiction(problem), &spec.location))
}
