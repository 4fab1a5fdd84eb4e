//! Functions of the entries of trains: by cross interpolation for any function, with equations that every
//! entry has to satisfy for reciprocals and square roots.
//!
//! What cross reports is an error at points. A reciprocal and a root can do better: x y = 1 and y y = x are
//! equations between trains, so their residual is a norm over ALL entries, from triangles, with its rounding
//! floor.

use crate::cross::{CrossReport, CrossSettings, EntrySource, cross_within};
use crate::solve::{SolveReport, SolveSettings, SolveStatus, solve_within};
use crate::{Measured, Stop, Truncation, TtError, TtMatrix, TtVector};
use serde::{Deserialize, Serialize};

/// Newton steps of a root at most: each squares the error.
const NEWTON_STEPS: usize = 8;

/// A function of the entries of several trains at the same place.
struct Composed<'a, F> {
    trains: &'a [&'a TtVector],
    function: F,
}

impl<F: Fn(&[f64]) -> f64 + Sync> EntrySource for Composed<'_, F> {
    fn modes(&self) -> Vec<usize> {
        self.trains[0].modes()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        // (The cross asks only for indices inside the modes.)
        let columns: Vec<Vec<f64>> =
            self.trains.iter().map(|train| train.entries(indices).unwrap_or_default()).collect();
        let mut point = vec![0.0; columns.len()];
        for (k, value) in values.iter_mut().enumerate() {
            point.iter_mut().zip(&columns).for_each(|(x, c)| *x = c.get(k).copied().unwrap_or(f64::NAN));
            *value = (self.function)(&point);
        }
    }
}

/// What a square root is known to be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RootReport {
    /// Whether `residual` is at most the tolerance.
    pub converged: bool,
    /// ||y y - x|| / ||x|| over all entries, from the trains.
    pub residual: f64,
    /// What rounding leaves uncertain about the residual.
    pub floor: f64,
    /// Newton steps after the cross.
    pub newton_steps: usize,
    /// The cross that gave the start.
    pub cross: CrossReport,
}

impl TtVector {
    /// The train with entries f(x_1(i), x_2(i), ...) for trains x_1, x_2, ... of the same modes, by cross
    /// interpolation from the rows of the first one.
    ///
    /// The report is that of [`cross`](crate::cross::cross): errors at points that the method did not choose,
    /// and an upper bound with 95 % confidence. O(evaluations d r^2), O(sweeps d n r^2) evaluations.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no train or their modes differ, else as for
    /// [`cross`](crate::cross::cross); [`TtError::Entry`] where f is not finite.
    ///
    /// ```
    /// use graintrain_tt::{TtVector, cross::{CrossSettings, CrossStatus}, qtt};
    /// // exp(-x) / (1 + x) on 2^20 points of [0, 4)
    /// let x = qtt::ramp(20, 0.0, 2f64.powi(-18))?;
    /// let settings = CrossSettings { tolerance: 1e-8, ..Default::default() };
    /// let (y, report) = TtVector::map(&[&x], |x| (-x[0]).exp() / (1.0 + x[0]), &settings)?;
    /// assert_eq!(report.status, CrossStatus::Converged);
    /// assert!((y.sum() * 2f64.powi(-18) - 0.5932643).abs() < 1e-4);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn map(
        trains: &[&Self],
        function: impl Fn(&[f64]) -> f64 + Sync,
        settings: &CrossSettings,
    ) -> Result<(Self, CrossReport), TtError> {
        Self::map_within(trains, function, settings, &|| false)
    }

    /// As [`TtVector::map`], as long as `stop` is false: it is asked at every site.
    ///
    /// # Errors
    /// As for [`TtVector::map`], and [`TtError::Stopped`].
    pub fn map_within(
        trains: &[&Self],
        function: impl Fn(&[f64]) -> f64 + Sync,
        settings: &CrossSettings,
        stop: Stop<'_>,
    ) -> Result<(Self, CrossReport), TtError> {
        let Some(first) = trains.first() else {
            return Err(TtError::Shape { what: "trains of a function", expected: vec![1], got: vec![0] });
        };
        trains.iter().try_for_each(|train| first.check_same_modes(train))?;
        cross_within(&Composed { trains, function }, None, &[], settings, stop)
    }

    /// y with x y = 1 entry by entry, by AMEn on diag(x) y = 1. The report's residual is ||x y - 1|| / ||1||
    /// over all entries, from the trains, so
    /// ||y - 1/x|| is at most it times ||1|| / min |x|.
    ///
    /// # Errors
    /// As for [`solve`](crate::solve::solve); a zero among the entries shows as a residual that does not
    /// fall.
    ///
    /// ```
    /// use graintrain_tt::{qtt, solve::{SolveSettings, SolveStatus}};
    /// let x = qtt::ramp(24, 1.0, 2f64.powi(-20))?; // 1 to 17
    /// let (y, report) = x.reciprocal(&SolveSettings { tolerance: 1e-9, ..Default::default() })?;
    /// assert_eq!(report.status, SolveStatus::Converged);
    /// assert!((y.entry(&[1; 24])? * (17.0 - 2f64.powi(-20)) - 1.0).abs() < 1e-6);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn reciprocal(&self, settings: &SolveSettings) -> Result<(Self, SolveReport), TtError> {
        self.reciprocal_within(settings, &|| false)
    }

    /// As [`TtVector::reciprocal`], as long as `stop` is false: it is asked at every site.
    ///
    /// # Errors
    /// As for [`TtVector::reciprocal`], and [`TtError::Stopped`].
    pub fn reciprocal_within(
        &self,
        settings: &SolveSettings,
        stop: Stop<'_>,
    ) -> Result<(Self, SolveReport), TtError> {
        let one = Self::constant(&self.modes(), 1.0)?;
        solve_within(&TtMatrix::from_diagonal(self), &one, None, settings, stop)
    }

    /// y >= 0 with y y = x entry by entry, for x >= 0: by cross, then by Newton's iteration diag(2 y) h = x -
    /// y y until the residual over ALL entries meets the tolerance of the settings or no longer falls; the
    /// best y is returned. Where x has zeros the root has an edge, ranks grow and Newton's equations are
    /// singular there: then the cross alone decides.
    ///
    /// # Errors
    /// As for [`TtVector::map`]: [`TtError::Entry`] if a negative entry is met.
    ///
    /// ```
    /// use graintrain_tt::{cross::CrossSettings, qtt};
    /// let x = qtt::ramp(16, 1.0, 1e-3)?;
    /// let (y, report) = x.square_root(&CrossSettings { tolerance: 1e-10, ..Default::default() })?;
    /// assert!(report.converged && report.residual <= 1e-10);
    /// assert!((y.entry(&[0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0])? - 1.01f64.sqrt()).abs() < 1e-8);
    /// # Ok::<(), graintrain_tt::TtError>(())
    /// ```
    pub fn square_root(&self, settings: &CrossSettings) -> Result<(Self, RootReport), TtError> {
        self.square_root_within(settings, &|| false)
    }

    /// As [`TtVector::square_root`], as long as `stop` is false: it is asked at every site.
    ///
    /// # Errors
    /// As for [`TtVector::square_root`], and [`TtError::Stopped`].
    pub fn square_root_within(
        &self,
        settings: &CrossSettings,
        stop: Stop<'_>,
    ) -> Result<(Self, RootReport), TtError> {
        let (mut y, cross) = Self::map_within(&[self], |x| x[0].sqrt(), settings, stop)?;
        let mut measured = self.square_residual(&y)?;
        let mut newton_steps = 0;
        while measured.value > settings.tolerance && newton_steps < NEWTON_STEPS {
            let fine = Truncation::capped(0.01 * settings.tolerance, settings.max_rank);
            let square = y.hadamard(&y)?;
            let (rest, _) = Self::sum_rounded(&[(1.0, self), (-1.0, &square)], &Truncation::to(1e-2))?;
            let inner =
                SolveSettings { tolerance: 1e-2, max_rank: settings.max_rank, ..SolveSettings::default() };
            let (step, report) =
                solve_within(&TtMatrix::from_diagonal(&y.scale(2.0)), &rest, None, &inner, stop)?;
            if report.status != SolveStatus::Converged {
                break;
            }
            let (next, _) = Self::sum_rounded(&[(1.0, &y), (1.0, &step)], &fine)?;
            let found = self.square_residual(&next)?;
            newton_steps += 1;
            if found.value >= measured.value || found.value.is_nan() {
                break;
            }
            (y, measured) = (next, found);
        }
        let Measured { value: residual, floor } = measured;
        let converged = residual <= settings.tolerance;
        Ok((y, RootReport { converged, residual, floor, newton_steps, cross }))
    }

    /// ||y y - x|| / ||x||.
    fn square_residual(&self, y: &Self) -> Result<Measured, TtError> {
        y.hadamard(y)?.measured_distance(self)
    }
}
