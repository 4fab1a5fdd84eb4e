//! The error on points that the sweeps did not choose.

use super::EntrySource;
use super::sweep::norm;
use crate::error::at_core;
use crate::scale::{largest_finite, scale_by_power};
use crate::{TtError, TtVector};

/// Entries set aside for measuring the error.
pub(super) struct Sample {
    points: Vec<usize>,
    pub(super) values: Vec<f64>,
    pub(super) norm: f64,
    modes: usize,
}

impl Sample {
    pub(super) fn new(source: &dyn EntrySource, points: Vec<usize>) -> Self {
        let modes = source.modes().len();
        let mut values = vec![0.0; points.len() / modes];
        source.entries(&points, &mut values);
        Self { points, norm: norm(&values), values, modes }
    }

    pub(super) fn largest(&self) -> Result<f64, TtError> {
        largest_finite(&self.values).map_err(at_core(0))
    }

    pub(super) fn scale(&mut self, power: i32) {
        scale_by_power(&mut self.values, power);
        self.norm = norm(&self.values);
    }

    /// The relative error of the train and the `count` points with the largest errors.
    pub(super) fn error(
        &self,
        train: &TtVector,
        count: usize,
    ) -> Result<(Option<f64>, Vec<Vec<usize>>), TtError> {
        if self.values.is_empty() {
            return Ok((None, Vec::new()));
        }
        let approximate = train.entries(&self.points)?;
        let errors: Vec<f64> = approximate.iter().zip(&self.values).map(|(a, b)| (a - b).abs()).collect();
        let error = errors.iter().map(|x| x * x).sum::<f64>().sqrt() / self.norm;
        let mut order: Vec<usize> = (0..errors.len()).filter(|&p| count > 0 && errors[p] > 0.0).collect();
        let largest_first = |a: &usize, b: &usize| errors[*b].total_cmp(&errors[*a]).then(a.cmp(b));
        if count > 0 && count < order.len() {
            order.select_nth_unstable_by(count, largest_first);
            order.truncate(count);
        }
        order.sort_by(largest_first);
        let worst =
            order.iter().map(|&p| self.points[p * self.modes..(p + 1) * self.modes].to_vec()).collect();
        Ok(((self.norm > 0.0).then_some(error), worst))
    }
}
