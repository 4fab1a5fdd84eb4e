//! What the runs say of the aims: numbers of tables, and curves read off at the abscissae of measured ones.

use super::inference::{Aim, Observation};
use super::question::{Question, Target, is_same_key, thinned};
use crate::sweep::collect::{check_names, collect};
use crate::sweep::execute::{check, run_folder};
use crate::sweep::plan::{Cell, Plan, Setting};
use crate::sweep::{SweepError, read_table};
use graintrain_io::measure::{Measure, Quantity};
use graintrain_view::view::tables::Table;
use std::collections::BTreeMap;
use std::path::Path;

/// Where the number of an aim comes from.
#[derive(Clone, Debug, PartialEq)]
enum From {
    /// An observable of a run.
    Observable(String),
    /// A column of a measurement where another column has a value.
    Column {
        measure: String,
        column: String,
        abscissa: String,
        x: f64,
        /// Records are of bins: each bin is averaged over time.
        bins: bool,
    },
}

/// One number to be reached.
#[derive(Clone, Debug, PartialEq)]
pub struct Element {
    /// For people: `shear.tau at displacement = 0.001`.
    pub label: String,
    /// The number and its error.
    pub aim: Aim,
    /// Index of its target in the question.
    pub target: usize,
    /// Abscissa, of a point of a curve.
    pub x: Option<f64>,
    /// Index of the condition under which it is observed.
    condition: usize,
    from: From,
}

/// All numbers to be reached, and the conditions under which a point has to be run.
#[derive(Clone, Debug, PartialEq)]
pub struct Aims {
    /// The numbers.
    pub elements: Vec<Element>,
    /// Settings of each condition: none but for curves over a key of the scene.
    pub conditions: Vec<Vec<Setting>>,
}

/// Whether a measurement has a record per bin.
fn has_bins(measure: &Measure) -> bool {
    measure.quantities.iter().any(Quantity::has_bins)
}

impl Aims {
    /// Of a question; the scene is built at both ends of all ranges, so that what is wrong is said before the
    /// first run.
    ///
    /// # Errors
    /// [`SweepError::Scene`] where the scene is wrong at an end of the ranges; [`SweepError::Observable`] for
    /// observables that it does not have; [`SweepError::Plan`].
    pub fn new(question: &Question) -> Result<Self, SweepError> {
        question.validate()?;
        let dimension = question.parameters.len();
        let ends = [0.0, 1.0].map(|end| question.settings(&vec![end; dimension]));
        let scene = question.plan.load(&ends[0], &[])?.build().map_err(|error| SweepError::Scene {
            point: crate::sweep::plan::label(&ends[0]),
            error: Box::new(error),
        })?;
        let mut aims = Self { elements: Vec::new(), conditions: Vec::new() };
        for (target, wanted) in question.targets.iter().enumerate() {
            aims.add(target, wanted, &scene.measures, question)?;
        }
        let settings = |end: &Vec<Setting>| -> Vec<Vec<Setting>> {
            aims.conditions.iter().map(|condition| [end.clone(), condition.clone()].concat()).collect()
        };
        let plan =
            Plan { points: ends.iter().flat_map(settings).collect(), seeds: 1, ..question.plan.clone() };
        let known = check(&plan, &plan.cells()?, question.from)?;
        let asked = aims.elements.iter().filter_map(|element| match &element.from {
            From::Observable(name) => Some(name.clone()),
            From::Column { .. } => None,
        });
        check_names(&asked.collect::<Vec<_>>(), &known)?;
        Ok(aims)
    }

    /// Index of a condition, which is added where it is new.
    fn condition(&mut self, settings: Vec<Setting>) -> usize {
        self.conditions.iter().position(|known| *known == settings).unwrap_or_else(|| {
            self.conditions.push(settings);
            self.conditions.len() - 1
        })
    }

    fn add(
        &mut self,
        target: usize,
        wanted: &Target,
        measures: &[Measure],
        question: &Question,
    ) -> Result<(), SweepError> {
        match wanted {
            Target::Value { observable, value, error } => {
                let condition = self.condition(Vec::new());
                let aim = Aim { value: *value, error: *error };
                let from = From::Observable(observable.clone());
                let label = observable.clone();
                self.elements.push(Element { label, aim, target, x: None, condition, from });
            }
            Target::Curve { observable, abscissa, points, .. } => {
                let found = observable.rsplit_once('.').and_then(|(measure, column)| {
                    let measure = measures.iter().find(|known| known.name == measure)?;
                    let names: Vec<&str> = measure.columns().iter().map(|column| column.name).collect();
                    (names.contains(&column) && names.contains(&abscissa.as_str()))
                        .then_some((measure, column))
                });
                let points = if found.is_some() { thinned(points) } else { points.clone() };
                for point in &points {
                    let label = format!("{observable} at {abscissa} = {}", point.x);
                    let aim = Aim { value: point.y, error: point.error };
                    let (condition, from) = match found {
                        Some((measure, column)) => {
                            let from = From::Column {
                                measure: measure.name.clone(),
                                column: column.into(),
                                abscissa: abscissa.clone(),
                                x: point.x,
                                bins: has_bins(measure),
                            };
                            (self.condition(Vec::new()), from)
                        }
                        // A key of the scene: a run for each of its values.
                        None => {
                            if question.parameters.iter().any(|fitted| is_same_key(&fitted.key, abscissa)) {
                                return Err(SweepError::Plan(format!(
                                    "`{abscissa}` is the abscissa of the curve of `{observable}` and fitted, too: it has the curve's values in all runs, so that nothing would be varied"
                                )));
                            }
                            let setting = (abscissa.clone(), format!("{:?}", point.x));
                            (self.condition(vec![setting]), From::Observable(observable.clone()))
                        }
                    };
                    self.elements.push(Element { label, aim, target, x: Some(point.x), condition, from });
                }
            }
        }
        Ok(())
    }

    /// The numbers with their errors.
    pub fn values(&self) -> Vec<Aim> {
        self.elements.iter().map(|element| element.aim).collect()
    }

    /// What the runs of these cells (all conditions of all points) say; points are those of the cells, in the
    /// unit cube.
    ///
    /// # Errors
    /// [`SweepError::Read`] for tables of finished runs that cannot be read.
    pub fn observe(
        &self,
        folder: &Path,
        cells: &[Cell],
        points: &[Vec<f64>],
        question: &Question,
    ) -> Result<Vec<Observation>, SweepError> {
        let collected = collect(folder, cells, question.from)?;
        let (conditions, seeds) = (self.conditions.len(), question.plan.seeds as usize);
        let mut observations: Vec<Observation> = points
            .iter()
            .flat_map(|point| {
                let empty = Observation { point: point.clone(), values: vec![f64::NAN; self.elements.len()] };
                std::iter::repeat_n(empty, seeds)
            })
            .collect();
        // Cells are in the order of points, conditions, seeds.
        for (index, (cell, sample)) in cells.iter().zip(&collected.samples).enumerate() {
            let Some(sample) = sample else { continue };
            let (point, condition, seed) = (cell.point / conditions, cell.point % conditions, index % seeds);
            let mut tables = BTreeMap::new();
            for (k, element) in self.elements.iter().enumerate().filter(|(_, e)| e.condition == condition) {
                let value = match &element.from {
                    From::Observable(name) => sample.found.get(name).map_or(f64::NAN, |found| found.value),
                    From::Column { measure, column, abscissa, x, bins } => {
                        if !tables.contains_key(measure.as_str()) {
                            tables.insert(measure.as_str(), table(folder, cell, measure)?);
                        }
                        let table = &tables[measure.as_str()];
                        let of = |name: &str| table.numbers(name).unwrap_or_default();
                        let (times, xs, ys) = (of("time"), of(abscissa), of(column));
                        let curve = if *bins { over_bins(&times, &xs, &ys, question.from) } else { (xs, ys) };
                        at(&curve.0, &curve.1, *x)
                    }
                };
                observations[point * seeds + seed].values[k] = value;
            }
        }
        Ok(observations)
    }

    /// From where to where the abscissa of an aim goes in the records of the finished runs; `None` for aims
    /// that are no points of a curve over a column.
    ///
    /// # Errors
    /// [`SweepError::Read`] for tables of finished runs that cannot be read.
    pub fn covered(
        &self,
        folder: &Path,
        cells: &[Cell],
        question: &Question,
        aim: usize,
    ) -> Result<Option<[f64; 2]>, SweepError> {
        let From::Column { measure, abscissa, .. } = &self.elements[aim].from else { return Ok(None) };
        let collected = collect(folder, cells, question.from)?;
        let mut ends: Option<[f64; 2]> = None;
        for (cell, _) in cells.iter().zip(&collected.samples).filter(|(_, sample)| sample.is_some()) {
            let xs = table(folder, cell, measure)?.numbers(abscissa).unwrap_or_default();
            for x in xs.into_iter().filter(|x| x.is_finite()) {
                ends = ends.map_or(Some([x, x]), |[low, high]| Some([low.min(x), high.max(x)]));
            }
        }
        Ok(ends)
    }
}

/// The table of a measurement of a finished run.
fn table(folder: &Path, cell: &Cell, measure: &str) -> Result<Table, SweepError> {
    let path = run_folder(folder, cell).join("measures").join(format!("{measure}.csv"));
    read_table(&path)
}

/// Every bin averaged over the records from `from` (s) on, or over the second half of the time.
fn over_bins(times: &[f64], xs: &[f64], ys: &[f64], from: Option<f64>) -> (Vec<f64>, Vec<f64>) {
    let last = times.iter().copied().fold(0.0, f64::max);
    let from = from.unwrap_or(0.5 * last) * (1.0 - 1e-12);
    let mut bins: Vec<(f64, f64, f64)> = Vec::new();
    for ((_, x), y) in times.iter().zip(xs).zip(ys).filter(|((time, _), y)| **time >= from && y.is_finite()) {
        match bins.iter_mut().find(|bin| bin.0 == *x) {
            Some(bin) => (bin.1, bin.2) = (bin.1 + y, bin.2 + 1.0),
            None => bins.push((*x, *y, 1.0)),
        }
    }
    bins.sort_by(|a, b| a.0.total_cmp(&b.0));
    bins.into_iter().map(|(x, sum, count)| (x, sum / count)).unzip()
}

/// The ordinate of a curve where it first passes an abscissa, linear between records; NaN where it never
/// does.
fn at(xs: &[f64], ys: &[f64], x: f64) -> f64 {
    let points: Vec<(f64, f64)> =
        xs.iter().copied().zip(ys.iter().copied()).filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    let scale = points.iter().fold(x.abs(), |most, (x, _)| most.max(x.abs()));
    let near = |a: f64| (a - x).abs() <= 1e-9 * scale;
    for pair in points.windows(2) {
        let ((a, left), (b, right)) = (pair[0], pair[1]);
        if (a.min(b)..=a.max(b)).contains(&x) && a != b {
            return left + (right - left) * (x - a) / (b - a);
        }
    }
    // The ends themselves, to rounding.
    points.iter().find(|(a, _)| near(*a)).map_or(f64::NAN, |(_, y)| *y)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_read_where_they_pass() {
        let (xs, ys) = ([0.0, 1.0, 2.0, f64::NAN, 4.0], [5.0, 7.0, 6.0, 1.0, 2.0]);
        assert_eq!(at(&xs, &ys, 0.5), 6.0);
        assert_eq!(at(&xs, &ys, 3.0), 4.0);
        assert_eq!(at(&xs, &ys, 4.0), 2.0);
        assert!(at(&xs, &ys, 4.1).is_nan() && at(&[], &[], 1.0).is_nan());
        assert_eq!(at(&[3.0], &[8.0], 3.0), 8.0);
        // There and back: the way there counts.
        assert_eq!(at(&[0.0, 2.0, 0.0], &[0.0, 2.0, 9.0], 1.0), 1.0);
    }

    #[test]
    fn bins_are_averaged_over_the_end() {
        let times = [1.0, 1.0, 2.0, 2.0, 3.0, 3.0];
        let xs = [0.1, 0.2, 0.1, 0.2, 0.1, 0.2];
        let ys = [9.0, 9.0, 1.0, 2.0, 3.0, f64::NAN];
        assert_eq!(over_bins(&times, &xs, &ys, None), (vec![0.1, 0.2], vec![2.0, 2.0]));
        assert_eq!(over_bins(&times, &xs, &ys, Some(3.0)), (vec![0.1], vec![3.0]));
    }
}
