//! Functions of several variables on named grids as quantized trains, and back: evaluation, integrals,
//! restriction.
//!
//! A variable x of an interval has 2^bits points, numbered by binary digits; f(x, y, ...) on the product of
//! the grids is a train of modes 2 whose digits run axis after axis or level by level ([`DigitOrder`]).
//! Smooth functions have small ranks in either order (I. Oseledets, SIAM J. Matrix Anal. Appl. 31, 2010; B.
//! Khoromskij, Constr. Approx. 34, 2011), so 2^60 points cost no more than some thousand values of f: see
//! [`GridFunction::cross`].
//!
//! What is exact here is linear algebra on the train; what is not is the grid. Integrals are the rule of the
//! [`Points`], of second order in the step h for smooth functions (of every order for smooth periodic ones);
//! between points the function is interpolated linearly in every variable, with an error up to h^2 / 8 times
//! its second derivative.

use crate::cross::{CrossReport, CrossSettings, EntrySource, cross_within};
use crate::qtt::DigitOrder;
use crate::vector::{LARGEST_FULL, check_index};
use crate::{Stop, Truncation, TruncationReport, TtError, TtVector};
use serde::{Deserialize, Serialize};

/// Bits of an axis at most: the numbers of points are exact as floats.
const MOST_BITS: usize = 52;
/// Digits of a grid at most.
const MOST_DIGITS: usize = 1 << 16;
/// Axes at most between whose points there is interpolation: a point has 2^axes neighbours.
const MOST_INTERPOLATED: usize = 20;
/// Neighbours that are evaluated at a time.
const NEIGHBOURS_TOGETHER: usize = 1 << 16;
/// Sums of up to three trains lose their dependent ranks to this.
const EXACT: f64 = 1e-14;

/// Where the points of an axis lie in its interval, which is also the rule of its integrals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Points {
    /// In the middle of 2^bits cells, x_j = low + (j + 1/2) h: the midpoint rule, no point at an end.
    Midpoints,
    /// At both ends and between, x_j = low + j (high - low) / (2^bits - 1): the trapezoidal rule.
    Ends,
    /// x_j = low + j h of a function of period high - low: the trapezoidal rule of a period. Any number is a
    /// place.
    Periodic,
}

/// One variable: its name, its interval and the binary digits of its points.
#[derive(Clone, Debug, PartialEq)]
pub struct Axis {
    name: String,
    low: f64,
    high: f64,
    bits: usize,
}

impl Axis {
    /// 2^bits points of \[low, high\].
    ///
    /// # Errors
    /// [`TtError::Axis`] unless low < high are finite, bits in 1..=52 and the name not empty.
    pub fn new(name: &str, low: f64, high: f64, bits: usize) -> Result<Self, TtError> {
        let wrong = |what: String| Err(TtError::Axis { name: name.to_string(), what });
        if name.is_empty() {
            return wrong("the name is empty".to_string());
        }
        if !(low < high && (high - low).is_finite()) {
            return wrong(format!("the interval [{low}, {high}] is not one of finite length"));
        }
        if !(1..=MOST_BITS).contains(&bits) {
            return wrong(format!("{bits} bits, expected 1 to {MOST_BITS}"));
        }
        Ok(Self { name: name.to_string(), low, high, bits })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its interval.
    pub fn interval(&self) -> (f64, f64) {
        (self.low, self.high)
    }

    /// Binary digits of its points.
    pub fn bits(&self) -> usize {
        self.bits
    }

    fn size(&self) -> u64 {
        1 << self.bits
    }

    /// Distance of neighbouring points.
    fn step(&self, points: Points) -> f64 {
        let steps = if points == Points::Ends { self.size() - 1 } else { self.size() };
        (self.high - self.low) / steps as f64
    }

    /// Point number j.
    fn point(&self, j: u64, points: Points) -> f64 {
        let offset = if points == Points::Midpoints { 0.5 } else { 0.0 };
        self.low + (j as f64 + offset) * self.step(points)
    }

    /// Neighbouring points j, k and the weight t of k with which x = (1 - t) x_j + t x_k: linear beyond the
    /// outer midpoints, cyclic for a period.
    fn between(&self, x: f64, points: Points) -> Result<(u64, u64, f64), TtError> {
        let inside = if points == Points::Periodic { x.is_finite() } else { x >= self.low && x <= self.high };
        if !inside {
            let (low, high) = (self.low, self.high);
            return Err(TtError::Axis {
                name: self.name.clone(),
                what: format!("{x} lies outside [{low}, {high}]"),
            });
        }
        let (n, place) = (self.size(), (x - self.low) / self.step(points));
        Ok(match points {
            Points::Periodic => {
                let place = place.rem_euclid(n as f64);
                let j = (place.floor() as u64).min(n - 1);
                (j, (j + 1) % n, place - j as f64)
            }
            _ => {
                let place = if points == Points::Midpoints { place - 0.5 } else { place };
                let j = (place.floor().max(0.0) as u64).min(n - 2);
                (j, j + 1, place - j as f64)
            }
        })
    }
}

/// Named axes with their digits in an order.
///
/// ```
/// use graintrain_tt::{qtt::DigitOrder, quantics::{Axis, Grid, Points}};
/// let axes = vec![Axis::new("x", 0.0, 1.0, 2)?, Axis::new("y", 0.0, 8.0, 3)?];
/// let grid = Grid::new(axes, DigitOrder::Separated, Points::Periodic)?;
/// assert_eq!(grid.modes(), [2; 5]);
/// assert_eq!(grid.points(&[1, 0, 1, 0, 1])?, [0.25, 5.0]);
/// assert_eq!(grid.nearest(&[0.3, 4.8])?, [1, 0, 1, 0, 1]);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    axes: Vec<Axis>,
    order: DigitOrder,
    points: Points,
    /// Core of digit k (fine to coarse) of every axis.
    places: Vec<Vec<usize>>,
}

impl Grid {
    /// From its axes. In [`DigitOrder::Morton`] the coarsest digits of all axes are the last ones; where axes
    /// have different numbers of bits, the shorter ones have no digits on the finest levels.
    ///
    /// # Errors
    /// [`TtError::Shape`] if there is no axis or more than 2^16 digits, [`TtError::Axis`] if two have the
    /// same name.
    pub fn new(axes: Vec<Axis>, order: DigitOrder, points: Points) -> Result<Self, TtError> {
        let digits: usize = axes.iter().map(Axis::bits).sum();
        if digits == 0 || digits > MOST_DIGITS {
            let what = "digits of a grid, at least and at most";
            return Err(TtError::Shape { what, expected: vec![1, MOST_DIGITS], got: vec![digits] });
        }
        let mut names: Vec<&str> = axes.iter().map(Axis::name).collect();
        names.sort_unstable();
        if let Some(pair) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            let what = "two axes have this name".to_string();
            return Err(TtError::Axis { name: pair[0].to_string(), what });
        }
        let mut places = vec![Vec::new(); axes.len()];
        let levels = axes.iter().map(Axis::bits).max().unwrap_or(0);
        let mut next = 0..digits;
        match order {
            DigitOrder::Separated => {
                for (axis, place) in axes.iter().zip(&mut places) {
                    place.extend(next.by_ref().take(axis.bits));
                }
            }
            DigitOrder::Morton => {
                for level in 0..levels {
                    let reach = axes.iter().zip(&mut places).filter(|(axis, _)| axis.bits + level >= levels);
                    reach.for_each(|(_, place)| place.extend(next.next()));
                }
            }
        }
        Ok(Self { axes, order, points, places })
    }

    /// The axes.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// How the digits are arranged.
    pub fn order(&self) -> DigitOrder {
        self.order
    }

    /// Where the points lie.
    pub fn kind(&self) -> Points {
        self.points
    }

    /// Modes of a train on the grid: 2 for every digit.
    pub fn modes(&self) -> Vec<usize> {
        vec![2; self.num_digits()]
    }

    fn num_digits(&self) -> usize {
        self.axes.iter().map(Axis::bits).sum()
    }

    /// The number of the axis of this name.
    ///
    /// # Errors
    /// [`TtError::Axis`] if there is none.
    pub fn axis(&self, name: &str) -> Result<usize, TtError> {
        self.axes.iter().position(|axis| axis.name == name).ok_or_else(|| {
            let known = self.axes.iter().map(Axis::name).collect::<Vec<_>>().join(", ");
            TtError::Axis { name: name.to_string(), what: format!("there is none; axes are {known}") }
        })
    }

    /// All points of an axis.
    ///
    /// # Errors
    /// [`TtError::Axis`] if there is none of this name, [`TtError::TooLarge`] above 2^31 points.
    pub fn coordinates(&self, name: &str) -> Result<Vec<f64>, TtError> {
        let axis = &self.axes[self.axis(name)?];
        if axis.size() as f64 > LARGEST_FULL {
            return Err(TtError::TooLarge { entries: axis.size() as f64 });
        }
        Ok((0..axis.size()).map(|j| axis.point(j, self.points)).collect())
    }

    /// Coordinates, one number per axis and point, of entries (all digits of a point, one point after the
    /// other).
    ///
    /// # Errors
    /// [`TtError::Index`] or [`TtError::Shape`] for digits that do not fit.
    pub fn points(&self, indices: &[usize]) -> Result<Vec<f64>, TtError> {
        let modes = self.modes();
        let mut points = Vec::with_capacity(indices.len() / modes.len() * self.axes.len());
        for index in indices.chunks(modes.len()) {
            check_index(&modes, index)?;
            self.push_point(index, &mut points);
        }
        Ok(points)
    }

    fn push_point(&self, index: &[usize], points: &mut Vec<f64>) {
        for (axis, places) in self.axes.iter().zip(&self.places) {
            let j = places.iter().enumerate().map(|(k, &place)| (index[place] as u64) << k).sum();
            points.push(axis.point(j, self.points));
        }
    }

    /// Writes the digits of point j of an axis into an index.
    fn set_digits(&self, axis: usize, j: u64, index: &mut [usize]) {
        self.places[axis].iter().enumerate().for_each(|(k, &place)| index[place] = (j >> k & 1) as usize);
    }

    /// The entries nearest to points (one number per axis and point): for the `probes` of a cross and for
    /// looking up.
    ///
    /// # Errors
    /// [`TtError::Axis`] for a coordinate outside its interval, [`TtError::Shape`] for coordinates that are
    /// no whole points.
    pub fn nearest(&self, points: &[f64]) -> Result<Vec<usize>, TtError> {
        self.check_points(points)?;
        let digits = self.num_digits();
        let mut indices = Vec::with_capacity(points.len() / self.axes.len() * digits);
        let mut index = vec![0; digits];
        for point in points.chunks_exact(self.axes.len()) {
            for (a, (axis, &x)) in self.axes.iter().zip(point).enumerate() {
                let (j, k, t) = axis.between(x, self.points)?;
                self.set_digits(a, if t > 0.5 { k } else { j }, &mut index);
            }
            indices.extend_from_slice(&index);
        }
        Ok(indices)
    }

    fn check_points(&self, points: &[f64]) -> Result<(), TtError> {
        if points.len().is_multiple_of(self.axes.len()) {
            return Ok(());
        }
        Err(TtError::Shape {
            what: "coordinates per point",
            expected: vec![self.axes.len()],
            got: vec![points.len() % self.axes.len()],
        })
    }

    /// For every entry of a full array over the axes, the first axis the fastest, its place in the full form
    /// of the train.
    fn place_in_train(&self) -> impl Fn(usize) -> usize + '_ {
        let order: Vec<usize> = self.places.iter().flatten().copied().collect();
        move |entry| order.iter().enumerate().map(|(k, &place)| (entry >> k & 1) << place).sum()
    }
}

/// A function of a point as entries of a train on a grid.
struct OnGrid<'a, F> {
    grid: &'a Grid,
    function: F,
}

impl<F: Fn(&[f64]) -> f64 + Sync> EntrySource for OnGrid<'_, F> {
    fn modes(&self) -> Vec<usize> {
        self.grid.modes()
    }

    fn entries(&self, indices: &[usize], values: &mut [f64]) {
        let mut point = Vec::with_capacity(self.grid.axes.len());
        for (index, value) in indices.chunks_exact(self.grid.num_digits()).zip(values) {
            point.clear();
            self.grid.push_point(index, &mut point);
            *value = (self.function)(&point);
        }
    }
}

/// A function on a grid as a train.
///
/// ```
/// use graintrain_tt::{qtt::DigitOrder, quantics::{Axis, Grid, GridFunction, Points}};
/// let axes = ["x", "y", "z"].map(|name| Axis::new(name, 0.0, 1.0, 16)).into_iter().collect::<Result<_, _>>()?;
/// let grid = Grid::new(axes, DigitOrder::Morton, Points::Midpoints)?;
/// let (f, report) = GridFunction::cross(&grid, |p| (-p[0] * p[1] - p[2]).exp(), &[], &Default::default())?;
/// assert!(report.upper_bound.is_some() && f.train().num_parameters() < 20_000);
/// // The integral over z is (1 - 1/e) exp(-x y), that over all of it 0.7965995993 (1 - 1/e).
/// let g = f.integrate(&["z"])?;
/// assert!((g.values(&[0.3, 0.7])?[0] - 0.6321205588 * (-0.21f64).exp()).abs() < 1e-6);
/// assert!((f.integral()? - 0.7965995993 * 0.6321205588).abs() < 1e-6);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct GridFunction {
    grid: Grid,
    train: TtVector,
}

impl GridFunction {
    /// A train on a grid.
    ///
    /// # Errors
    /// [`TtError::Shape`] if its modes are not those of the grid.
    pub fn new(grid: &Grid, train: TtVector) -> Result<Self, TtError> {
        let (expected, got) = (grid.modes(), train.modes());
        if expected != got {
            return Err(TtError::Shape { what: "modes of a function on a grid", expected, got });
        }
        Ok(Self { grid: grid.clone(), train })
    }

    /// f on the grid by [`cross`](crate::cross::cross), from some of its values; the report says what is
    /// known of the error. `probes` are points (one number per axis each) that matter: peaks and jumps that
    /// random points would miss, given here, become pivots.
    ///
    /// # Errors
    /// [`TtError::Entry`] where f is not finite, [`TtError::Axis`] or [`TtError::Shape`] for probes that do
    /// not fit, else as for [`cross`](crate::cross::cross).
    pub fn cross(
        grid: &Grid,
        f: impl Fn(&[f64]) -> f64 + Sync,
        probes: &[f64],
        settings: &CrossSettings,
    ) -> Result<(Self, CrossReport), TtError> {
        Self::cross_source(grid, &OnGrid { grid, function: f }, probes, settings, &|| false)
    }

    /// As [`GridFunction::cross`] from a source of entries over the digits of the grid (see
    /// [`Grid::points`]), as long as `stop` is false: it is asked at every site.
    ///
    /// # Errors
    /// As for [`GridFunction::cross`], [`TtError::Shape`] if the modes of the source are not those of the
    /// grid, and [`TtError::Stopped`].
    pub fn cross_source(
        grid: &Grid,
        source: &dyn EntrySource,
        probes: &[f64],
        settings: &CrossSettings,
        stop: Stop<'_>,
    ) -> Result<(Self, CrossReport), TtError> {
        let (train, report) = cross_within(source, None, &grid.nearest(probes)?, settings, stop)?;
        Ok((Self::new(grid, train)?, report))
    }

    /// From all values on the grid, the first axis the fastest; as [`TtVector::from_full`], whose promise it
    /// keeps.
    ///
    /// # Errors
    /// As for [`TtVector::from_full`].
    pub fn from_full(
        grid: &Grid,
        full: &[f64],
        truncation: &Truncation,
    ) -> Result<(Self, TruncationReport), TtError> {
        let modes = grid.modes();
        let entries = (modes.len() as f64).exp2();
        if full.len() as f64 != entries {
            let expected = grid.axes.iter().map(|axis| axis.size() as usize).collect();
            return Err(TtError::Shape { what: "values on a grid", expected, got: vec![full.len()] });
        }
        let (place, mut turned) = (grid.place_in_train(), vec![0.0; full.len()]);
        full.iter().enumerate().for_each(|(entry, &value)| turned[place(entry)] = value);
        let (train, report) = TtVector::from_full(&turned, &modes, truncation)?;
        Ok((Self::new(grid, train)?, report))
    }

    /// All values on the grid, the first axis the fastest.
    ///
    /// # Errors
    /// [`TtError::TooLarge`] above 2^31.
    pub fn to_full(&self) -> Result<Vec<f64>, TtError> {
        let (full, place) = (self.train.to_full()?, self.grid.place_in_train());
        Ok((0..full.len()).map(|entry| full[place(entry)]).collect())
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The train, for everything that trains can do.
    pub fn train(&self) -> &TtVector {
        &self.train
    }

    /// Values at points (one number per axis and point): of the train at points of the grid, between them
    /// linear in every variable. O(2^D d r^2) per point for D axes.
    ///
    /// # Errors
    /// [`TtError::Axis`] for a coordinate outside its interval (or not finite), [`TtError::Shape`] for
    /// coordinates that are no whole points, [`TtError::TooLarge`] for more than 20 axes.
    pub fn values(&self, points: &[f64]) -> Result<Vec<f64>, TtError> {
        self.grid.check_points(points)?;
        let axes = self.grid.axes.len();
        if axes > MOST_INTERPOLATED {
            return Err(TtError::TooLarge { entries: (axes as f64).exp2() });
        }
        let together = (NEIGHBOURS_TOGETHER >> axes).max(1) * axes;
        let mut values = Vec::with_capacity(points.len() / axes);
        for points in points.chunks(together) {
            values.extend(self.some_values(points)?);
        }
        Ok(values)
    }

    fn some_values(&self, points: &[f64]) -> Result<Vec<f64>, TtError> {
        let Grid { axes, points: kind, .. } = &self.grid;
        let (mut indices, mut weights, mut owner) = (Vec::new(), Vec::new(), Vec::new());
        let mut index = vec![0; self.train.num_cores()];
        for (p, point) in points.chunks_exact(axes.len()).enumerate() {
            let between: Vec<(u64, u64, f64)> =
                axes.iter().zip(point).map(|(axis, &x)| axis.between(x, *kind)).collect::<Result<_, _>>()?;
            for corner in 0..1usize << axes.len() {
                let mut weight = 1.0;
                for (a, &(j, k, t)) in between.iter().enumerate() {
                    let second = corner >> a & 1 == 1;
                    weight *= if second { t } else { 1.0 - t };
                    self.grid.set_digits(a, if second { k } else { j }, &mut index);
                }
                if weight != 0.0 {
                    indices.extend_from_slice(&index);
                    weights.push(weight);
                    owner.push(p);
                }
            }
        }
        let mut values = vec![0.0; points.len() / axes.len()];
        let entries = self.train.entries(&indices)?;
        entries
            .iter()
            .zip(&weights)
            .zip(&owner)
            .for_each(|((entry, weight), &p)| values[p] += weight * entry);
        Ok(values)
    }

    /// The integral over the axes of these names as a function of the others, by the rule of the [`Points`].
    /// Ranks do not grow. O(d r^3).
    ///
    /// # Errors
    /// [`TtError::Axis`] if there is no axis of a name or none is left (see [`GridFunction::integral`]).
    pub fn integrate(&self, names: &[&str]) -> Result<Self, TtError> {
        let over: Vec<usize> = names.iter().map(|name| self.grid.axis(name)).collect::<Result<_, _>>()?;
        let kept = (0..self.grid.axes.len()).filter(|axis| !over.contains(axis));
        let grid = self.grid_of(kept.collect(), names.first().copied().unwrap_or_default())?;
        Self::new(&grid, self.integrated(&over)?)
    }

    /// The integral over all axes. O(d r^2).
    ///
    /// # Errors
    /// [`TtError::Dense`] for entries that are not finite.
    pub fn integral(&self) -> Result<f64, TtError> {
        self.integrated(&(0..self.grid.axes.len()).collect::<Vec<_>>())?.entry(&[0])
    }

    fn integrated(&self, over: &[usize]) -> Result<TtVector, TtError> {
        let mut train = self.train.clone();
        let mut done = vec![false; self.grid.axes.len()];
        for &a in over {
            if std::mem::replace(&mut done[a], true) {
                continue;
            }
            let (axis, places) = (&self.grid.axes[a], &self.grid.places[a]);
            let (n, h) = (axis.size() as f64, axis.step(self.grid.points));
            // Means over the digits: sums over very many would overflow.
            let mut terms = vec![(h * n, vec![[0.5, 0.5]; axis.bits])];
            if self.grid.points == Points::Ends {
                terms.push((-0.5 * h, vec![[1.0, 0.0]; axis.bits]));
                terms.push((-0.5 * h, vec![[0.0, 1.0]; axis.bits]));
            }
            train = contracted(&train, places, &terms)?;
        }
        // (Modes of contracted digits are of size one until all are done, so that places stay.)
        Ok(train.squeeze())
    }

    /// The function of the other variables at one value of this one, interpolated linearly between its
    /// points. O(d r^3).
    ///
    /// # Errors
    /// [`TtError::Axis`] if there is no axis of this name or no other one, or the value lies outside the
    /// interval.
    pub fn restrict(&self, name: &str, value: f64) -> Result<Self, TtError> {
        let a = self.grid.axis(name)?;
        let axis = &self.grid.axes[a];
        let grid = self.grid_of((0..self.grid.axes.len()).filter(|&kept| kept != a).collect(), name)?;
        let (j, k, t) = axis.between(value, self.grid.points)?;
        let unit =
            |j: u64| (0..axis.bits).map(move |bit| if j >> bit & 1 == 1 { [0.0, 1.0] } else { [1.0, 0.0] });
        let ends = [(1.0 - t, unit(j).collect()), (t, unit(k).collect())];
        let terms: Vec<_> = ends.into_iter().filter(|(weight, _)| *weight != 0.0).collect();
        Self::new(&grid, contracted(&self.train, &self.grid.places[a], &terms)?.squeeze())
    }

    /// The grid of some of the axes.
    fn grid_of(&self, kept: Vec<usize>, last: &str) -> Result<Grid, TtError> {
        if kept.is_empty() {
            let what = "no axis is left; the integral over all of them is a number".to_string();
            return Err(TtError::Axis { name: last.to_string(), what });
        }
        let axes = kept.into_iter().map(|a| self.grid.axes[a].clone()).collect();
        Grid::new(axes, self.grid.order, self.grid.points)
    }
}

/// The digits at `places` summed against sum_t w_t prod_k v_{t,k}: modes of size one are left there.
fn contracted(
    train: &TtVector,
    places: &[usize],
    terms: &[(f64, Vec<[f64; 2]>)],
) -> Result<TtVector, TtError> {
    let mut parts = Vec::with_capacity(terms.len());
    for (weight, factors) in terms {
        let mut part = train.clone();
        for (&place, factor) in places.iter().zip(factors) {
            part = part.mode_product(place, factor, 1)?;
        }
        parts.push((*weight, part));
    }
    match parts.as_slice() {
        [(weight, part)] => Ok(part.scale(*weight)),
        parts => {
            let terms: Vec<(f64, &TtVector)> = parts.iter().map(|(weight, part)| (*weight, part)).collect();
            Ok(TtVector::sum_rounded(&terms, &Truncation::to(EXACT))?.0)
        }
    }
}
