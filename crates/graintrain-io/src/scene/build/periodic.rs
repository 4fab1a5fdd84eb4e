//! The periodic cell of a scene.

use super::{Builder, SceneError, function, model_error};
use crate::scene::periodic::{DriveSpec, PeriodicSpec};
use crate::stage::CellDrive;
use graintrain::cell::{Cell, Drive, NAMES};

impl Builder {
    /// Makes space repeat, after all bodies are there, in a run of steps of this length (s).
    pub(super) fn periodic(&mut self, spec: &PeriodicSpec, step: f64) -> Result<(), SceneError> {
        let at = |error| model_error(error, &spec.location);
        let repeats = |axis: &str| spec.axes.iter().any(|own| own == axis);
        let mut cell = Cell::new(spec.min, spec.max, ["x", "y", "z"].map(repeats)).map_err(at)?;
        let CellDrive { drive, fastest } = cell_drive(&spec.drive)?;
        (cell.drive, cell.fastest) = (drive, fastest);
        cell.validate_step(0.0, step).map_err(at)?;
        self.world.set_cell(Some(cell)).map_err(at)
    }
}

/// What drives a cell.
pub(super) fn cell_drive(spec: &DriveSpec) -> Result<CellDrive, SceneError> {
    let mut drive = [Drive::HELD; 6];
    for (k, name) in NAMES.iter().enumerate() {
        let named = |list: &[(String, _)]| list.iter().position(|(own, _)| own == name);
        if let Some(place) = named(&spec.rate) {
            drive[k] = Drive::Rate(function(&spec.rate[place].1)?);
        }
        if let Some(place) = named(&spec.stress) {
            drive[k] = Drive::Stress(function(&spec.stress[place].1)?);
        }
    }
    Ok(CellDrive { drive, fastest: spec.fastest.unwrap_or(f64::INFINITY) })
}
