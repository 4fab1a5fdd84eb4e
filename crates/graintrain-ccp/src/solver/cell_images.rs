//! Images of bodies across the boundary of a stress-controlled cell, among the bodies that passes see.
//!
//! A contact across the boundary is packed as one with a body of its own, the image, at a place behind all
//! bodies. Passes over contacts know nothing of cells. A pass over bodies lets images follow: with the body
//! k(b) that is at the way b from its image,
//!
//! ```text
//! u_image = u_k + L b,   w_image = w_k;     L_c = 1/W_c sum over images of f_row(c) b_column(c)
//! ```
//!
//! where the force f on an image counts among those on its body, too ([`SlotTable`]). L lies in an image
//! vector like the velocity of one more body, so that linear combinations of images of impulses hold for the
//! places of images as well.

use super::combination::Combination;
use super::lanes::{LANES, Lanes};
use super::octet::{EIGHT, Octet};
use super::slots::SlotTable;
use crate::delassus::{CellModes, RigidDelassus};
use std::collections::HashMap;

/// An image of a body.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImageBody {
    /// Place of the body; `None` where it is fixed.
    pub of: Option<u32>,
    /// Way b from the body to its image, m (or the unit of the operator).
    pub way: [f64; 3],
}

/// The images that contacts of a problem reach, in the order in which they are met, and the contacts of each.
#[derive(Clone, Debug, Default)]
pub(super) struct Images {
    pub all: Vec<ImageBody>,
    /// Contacts across the boundary, ascending, and the images that they reach.
    reached: Vec<(u32, u32)>,
}

impl Images {
    /// Of the cell of a problem, where it has one; `place_of` has the places of bodies.
    pub fn new(rigid: &RigidDelassus, place_of: impl Fn(u32) -> Option<u32>) -> Self {
        let mut images = Self::default();
        let mut known = HashMap::new();
        for &(contact, way) in rigid.cell().into_iter().flat_map(|cell| &cell.ways) {
            let of = place_of(rigid.contacts()[contact as usize].body_b);
            let next = images.all.len() as u32;
            let image = *known.entry((of, way.map(f64::to_bits))).or_insert(next);
            if image == next {
                images.all.push(ImageBody { of, way });
            }
            images.reached.push((contact, image));
        }
        images
    }

    /// The image that a contact reaches.
    pub fn of_contact(&self, contact: u32) -> Option<u32> {
        let place = self.reached.binary_search_by_key(&contact, |(contact, _)| *contact).ok()?;
        Some(self.reached[place].1)
    }
}

/// Eight numbers of an image or a slot: a velocity (u, w) or a force and moment, three numbers and one
/// without meaning each, or what else an image has.
pub(super) trait Motion: Copy {
    /// The first four and the last four.
    fn pair(self) -> [Lanes; 2];

    /// Of the first four and the last four.
    fn of_pair(pair: [Lanes; 2]) -> Self;

    /// Of eight numbers.
    fn of_numbers(numbers: [f64; EIGHT]) -> Self {
        Self::of_pair([0, LANES].map(|first| Lanes(std::array::from_fn(|k| numbers[first + k]))))
    }

    /// Number k.
    fn number(&self, k: usize) -> f64;
}

impl Motion for [Lanes; 2] {
    fn pair(self) -> [Lanes; 2] {
        self
    }

    fn of_pair(pair: [Lanes; 2]) -> Self {
        pair
    }

    #[inline(always)]
    fn number(&self, k: usize) -> f64 {
        self[k / LANES].0[k % LANES]
    }
}

impl Motion for Octet {
    fn pair(self) -> [Lanes; 2] {
        [0, LANES].map(|first| Lanes(std::array::from_fn(|k| f64::from(self.0[first + k]))))
    }

    fn of_pair(pair: [Lanes; 2]) -> Self {
        Self(std::array::from_fn(|k| pair[k / LANES].0[k % LANES] as f32))
    }

    #[inline(always)]
    fn number(&self, k: usize) -> f64 {
        f64::from(self.0[k])
    }
}

/// A stress-controlled cell, as a pass over bodies sees it.
#[derive(Clone, Debug)]
pub(super) struct PackedCell {
    images: Vec<ImageBody>,
    /// 1 / W of every component, in the units of the operator.
    mobility: [f64; 6],
    /// Number of bodies: the place of the first image. The fixed body comes after the last one, then L.
    bodies: usize,
}

impl PackedCell {
    /// With lengths in units of `length` (m) and mobilities in units of `mobility` (1/kg); `None` where
    /// nothing reaches across.
    pub fn new(rigid: &RigidDelassus, images: &Images, [mobility, length]: [f64; 2]) -> Option<Self> {
        let cell = rigid.cell()?;
        let scaled = |image: &ImageBody| ImageBody { way: image.way.map(|x| x / length), ..*image };
        Some(Self {
            images: images.all.iter().map(scaled).collect(),
            mobility: cell.mobility.map(|m| m * (length * length / mobility)),
            bodies: rigid.num_bodies(),
        })
    }

    /// Lets the images in image vectors follow their bodies, whose new velocities these hold; the part of L
    /// in the quadratic form. Costs some 30 flops per image, on one thread: their number grows like that of
    /// bodies to the power 2/3.
    pub fn follow<M: Motion, const K: usize>(
        &self,
        (slots, table): (&[M], &SlotTable),
        vectors: [&mut [M]; K],
        combination: &impl Combination<K>,
    ) -> f64 {
        let mut push = [0.0; 6];
        for (image, place) in self.images.iter().zip(self.bodies..) {
            let mut force = [0.0; 3];
            for &slot in table.of_body(place) {
                let [own, _] = slots[slot as usize].pair();
                force.iter_mut().zip(own.0).for_each(|(sum, own)| *sum += own);
            }
            push.iter_mut().zip(CellModes::push(force, image.way)).for_each(|(sum, push)| *sum += push);
        }
        let fresh: [f64; 6] = std::array::from_fn(|c| self.mobility[c] * push[c]);
        let quadratic = push.iter().zip(&fresh).map(|(push, fresh)| push * fresh).sum();
        let fresh = [0, 3].map(|first| Lanes([fresh[first], fresh[first + 1], fresh[first + 2], 0.0]));
        let last = self.bodies + self.images.len() + 1;
        let known = vectors.each_ref().map(|vector| vector[last].pair());
        let new = [0, 1].map(|half| combination.of(fresh[half], known.map(|pair| pair[half])));
        for (k, vector) in vectors.into_iter().enumerate() {
            let [diagonal, shear] = [new[0][k], new[1][k]];
            vector[last] = M::of_pair([diagonal, shear]);
            let rate: [f64; 6] = std::array::from_fn(|c| if c < 3 { diagonal.0[c] } else { shear.0[c - 3] });
            for (image, place) in self.images.iter().zip(self.bodies..) {
                let [mut u, w] = image.of.map_or_else(Default::default, |of| vector[of as usize].pair());
                let along = CellModes::image_velocity(&rate, image.way);
                u.0.iter_mut().zip(along).for_each(|(u, along)| *u += along);
                vector[place] = M::of_pair([u, w]);
            }
        }
        quadratic
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::first_order::FirstOrder;
    use super::super::interface::CcpSolver;
    use super::super::settings::SolveSettings;
    use super::super::{AcceleratedSweeps, Apgd, Cascade, GaussSeidel};
    use crate::delassus::cell_tests::random_cell;
    use crate::delassus::{Delassus, RigidDelassus};
    use crate::problem::Ccp;
    use crate::residual::FrictionModel;
    use crate::solver::Status;

    /// With impulses that part all bodies: r = s - N g of some g in the cones and an s in the interior of
    /// their duals.
    pub(in crate::solver) fn solvable(rigid: RigidDelassus) -> Ccp {
        let contacts = rigid.num_contacts();
        let delassus = Delassus::Rigid(rigid);
        let component = |k: usize| if k.is_multiple_of(3) { 1.0 } else { 0.2 * (1.7 * k as f64).sin() };
        let g: Vec<f64> = (0..3 * contacts).map(component).collect();
        let mut r = vec![0.0; g.len()];
        delassus.multiply(&g, &mut r, &mut delassus.work());
        for (k, r) in r.iter_mut().enumerate() {
            *r = if k.is_multiple_of(3) { 0.5 - *r } else { -*r };
        }
        Ccp::new(delassus, r, vec![0.3; contacts]).unwrap()
    }

    pub(in crate::solver) fn relative_velocities(
        problem: &Ccp,
        solver: &mut dyn CcpSolver,
        settings: &SolveSettings,
    ) -> Vec<f64> {
        let mut g = vec![0.0; problem.r.len()];
        let report = solver.solve(problem, &mut g, settings).unwrap();
        assert_eq!(report.status, Status::Converged, "{}", report.solver);
        let mut u = vec![0.0; g.len()];
        problem.delassus.multiply(&g, &mut u, &mut problem.delassus.work());
        u
    }

    /// The velocities that impulses make are unique: over bodies and images they are those over the rows of
    /// N, in double and begun in single precision.
    #[test]
    fn images_do_what_the_matrix_does() {
        for (bodies, contacts) in [(30, 60), (400, 900)] {
            let over_bodies = solvable(random_cell(bodies, contacts, 11));
            let over_rows = over_bodies.as_matrix_if(|_| true, &mut None).unwrap();
            for (tolerance, allowed) in [(1e-9, 1e-6), (2e-3, 0.3)] {
                let settings = SolveSettings { tolerance, ..SolveSettings::default() };
                let mut apgd = FirstOrder::new(Apgd::default());
                let expected = relative_velocities(&over_rows, &mut apgd, &settings);
                let found = relative_velocities(&over_bodies, &mut apgd, &settings);
                let largest = found.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(largest < allowed, "{contacts} contacts to {tolerance:e}: {largest:e}");
            }
        }
    }

    /// Exact friction and sweeps take it, too.
    #[test]
    fn sweeps_and_exact_friction_take_a_cell() {
        let over_bodies = solvable(random_cell(30, 60, 3));
        let settings = SolveSettings { tolerance: 1e-8, ..SolveSettings::default() };
        let expected = relative_velocities(&over_bodies, &mut FirstOrder::new(Apgd::default()), &settings);
        let mut sweeps = Cascade::of(Box::new(FirstOrder::new(GaussSeidel::default())));
        let found = relative_velocities(&over_bodies, &mut sweeps, &settings);
        assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6));
        for name in ["auto", "apgd", "ipm"] {
            let mut solver = name.parse::<crate::SolverSpec>().unwrap().build().unwrap();
            let exact =
                SolveSettings { friction: FrictionModel::Coulomb, tolerance: 1e-6, ..settings.clone() };
            let mut g = vec![0.0; over_bodies.r.len()];
            let report = solver.solve(&over_bodies, &mut g, &exact).unwrap();
            assert_eq!(report.status, Status::Converged, "{name}");
        }
    }

    /// Where many contacts reach across the boundary, gradients over bodies and images begin, and sweeps take
    /// the rows of N.
    #[test]
    fn gradients_begin_in_a_large_cell() {
        let over_bodies = solvable(random_cell(400, 900, 11));
        assert!(over_bodies.contacts_across() > 200);
        let settings = SolveSettings { tolerance: 2e-3, ..SolveSettings::default() };
        let mut sweeps = Cascade::of(Box::new(FirstOrder::new(AcceleratedSweeps::default())));
        relative_velocities(&over_bodies, &mut sweeps, &settings);
        let settings =
            SolveSettings { friction: FrictionModel::Coulomb, max_iterations: Some(300), ..settings };
        let mut g = vec![0.0; over_bodies.r.len()];
        let report = Cascade::auto().solve(&over_bodies, &mut g, &settings).unwrap();
        let first = &report.stages[0];
        assert_eq!((first.solver.as_str(), first.start.as_str()), ("apgd", "last"), "{:?}", report.stages);
    }
}
