//! Sweeps of Gauss-Seidel over rigid bodies in single precision, eight contacts at a time.

use super::super::apgd::extrapolated;
use super::super::dispatch::vectorised;
use super::super::lanes::{Batch, add, dot, project_given, scale, sub, tangential_length, within_disc};
use super::super::octet::{EIGHT, InSingle, Octet, SingleVector, SingleWork};
use super::geometry::{Bodies, Geometry, load};
use super::kernel::SingleTally;
use super::operator::{Arrangement, CHUNK, PREFETCH, SingleOperator};
use crate::delassus::Delassus;
use crate::residual::FrictionModel;
use crate::solver::gauss_seidel::largest_eigenvalue;
use rayon::prelude::*;

/// What sweeps need beside the operator.
#[derive(Clone, Debug)]
pub(super) struct Sweeps {
    /// 1 / lambda_i, lambda_i the largest eigenvalue of N'_ii.
    step: Vec<Octet>,
    /// Which contacts of a batch move at once, 1 where they do: those of batch b at `first[b]..first[b + 1]`. Contacts that share a body that moves come one after the other.
    moves: Vec<Octet>,
    first: Vec<u32>,
}

impl Sweeps {
    /// Of contacts in this order, with their factors c / sqrt(e) over c.
    pub(super) fn new(
        delassus: &Delassus,
        order: &[u32],
        scaling: &[[f64; 2]],
        operator: &SingleOperator,
    ) -> Self {
        let step_of = |batch: &[u32]| {
            let mut step = Octet::default();
            for (step, &i) in step.0.iter_mut().zip(batch) {
                let [n, t] = scaling[i as usize];
                let factor = [n, t, t];
                let mut block = delassus.diagonal_block(i as usize);
                for (k, entry) in block.iter_mut().enumerate() {
                    *entry *= factor[k / 3] * factor[k % 3];
                }
                let largest = largest_eigenvalue(&block);
                // A contact between immovable bodies: any positive step leads to its solution or to infinity.
                *step = if largest > 0.0 { largest.recip() as f32 } else { 1.0 };
            }
            step
        };
        let step = match &operator.arrangement {
            // Scaled blocks of balls are unit matrices.
            Arrangement::Radial(all) if operator.masses.are_isotropic() => vec![Octet::splat(1.0); all.len()],
            _ => order.par_chunks(EIGHT).with_min_len(CHUNK).map(step_of).collect(),
        };
        let (mut moves, mut first) = (Vec::new(), vec![0]);
        let fixed = operator.num_places as u32;
        let mut group = |bodies: &Bodies| {
            let begin = moves.len();
            for lane in 0..EIGHT {
                let own = [bodies.place[0][lane], bodies.place[1][lane]];
                let meets = |with: &Octet| {
                    (0..lane).filter(|&l| with.0[l] == 1.0).any(|l| {
                        own.iter().any(|&body| {
                            body != fixed && (bodies.place[0][l] == body || bodies.place[1][l] == body)
                        })
                    })
                };
                let free = (begin..moves.len()).find(|&k| !meets(&moves[k]));
                let k = free.unwrap_or_else(|| {
                    moves.push(Octet::default());
                    moves.len() - 1
                });
                moves[k].0[lane] = 1.0;
            }
            first.push(moves.len() as u32);
        };
        match &operator.arrangement {
            Arrangement::Radial(all) => all.iter().for_each(|own| group(&own.bodies)),
            Arrangement::General(all) => all.iter().for_each(|own| group(&own.bodies)),
        }
        Self { step, moves, first }
    }

    /// One sweep with this over-relaxation from y = x + beta (x - previous), on one thread: x becomes its end, `previous` the x before, their images follow. Returns |d|^2 and d^T (x+ - x) with d = x+ - y.
    pub(super) fn sweep(
        &self,
        operator: &SingleOperator,
        vectors: [&mut [Batch<Octet>]; 2],
        images: [&mut [Octet]; 2],
        (beta, relaxation): (f64, f64),
        model: FrictionModel,
    ) -> [f64; 2] {
        let mut sums = [0.0; 2];
        let pass = Pass { sweeps: self, operator, vectors, images, beta, relaxation, sums: &mut sums };
        match (&operator.arrangement, model) {
            (Arrangement::Radial(all), FrictionModel::Coulomb) => pass.over::<_, true>(all),
            (Arrangement::Radial(all), FrictionModel::Relaxed) => pass.over::<_, false>(all),
            (Arrangement::General(all), FrictionModel::Coulomb) => pass.over::<_, true>(all),
            (Arrangement::General(all), FrictionModel::Relaxed) => pass.over::<_, false>(all),
        }
        sums
    }
}

/// One sweep.
struct Pass<'a> {
    sweeps: &'a Sweeps,
    operator: &'a SingleOperator,
    vectors: [&'a mut [Batch<Octet>]; 2],
    images: [&'a mut [Octet]; 2],
    beta: f64,
    relaxation: f64,
    sums: &'a mut [f64; 2],
}

impl Pass<'_> {
    fn over<G: Geometry, const EXACT: bool>(self, geometry: &[G]) {
        vectorised(InSingle(PassOver::<G, EXACT> { pass: self, geometry }));
    }
}

/// One sweep over contacts of this geometry.
struct PassOver<'a, 'b, G, const EXACT: bool> {
    pass: Pass<'a>,
    geometry: &'b [G],
}

impl<G: Geometry, const EXACT: bool> SingleWork for PassOver<'_, '_, G, EXACT> {
    #[inline(always)]
    fn run<V: SingleVector>(self) {
        let Pass { sweeps, operator, vectors, images, beta, relaxation, sums } = self.pass;
        let [image, previous_image] = images;
        for (image, previous) in V::of_slice(image).iter_mut().zip(V::of_slice(previous_image)) {
            let now = *image;
            *image = now + V::splat(beta) * (now - *previous);
            *previous = now;
        }
        let [x, previous] = vectors.map(|v| V::of_slice(v.as_flattened_mut()).as_chunks_mut::<3>().0);
        let mut tally = SingleTally::<V>::default();
        for (batch, own) in self.geometry.iter().enumerate() {
            if let Some(later) = self.geometry.get(batch + PREFETCH) {
                V::prefetch(later);
            }
            let numbers = &operator.contacts[batch];
            let step = V::splat(relaxation) * V::of(sweeps.step[batch]);
            let (mu, r) = (V::of(numbers.mu), load(&numbers.r));
            let (x, previous) = (&mut x[batch], &mut previous[batch]);
            for moves in &sweeps.moves[sweeps.first[batch] as usize..sweeps.first[batch + 1] as usize] {
                let moves = V::of(*moves);
                let u = add(&own.relative_velocity(image), &r);
                let y = extrapolated(x, previous, beta);
                let point = sub(&y, &scale(step, &u));
                let tangential = tangential_length(&point);
                let new = match EXACT {
                    true => within_disc(mu, &point, tangential),
                    false => project_given(mu, &point, tangential),
                };
                let change = scale(moves, &sub(&new, &y));
                tally.sum[0] += dot(&change, &change);
                tally.sum[1] += dot(&change, &sub(&new, x));
                for k in 0..3 {
                    let now = x[k];
                    x[k] = moves.at_most(V::default(), now, new[k]);
                    previous[k] = moves.at_most(V::default(), previous[k], now);
                }
                own.push(&change, &operator.masses, image);
            }
            if batch % CHUNK == CHUNK - 1 || batch + 1 == self.geometry.len() {
                for (total, own) in sums.iter_mut().zip(&mut tally.sum) {
                    *total += own.octet().sum();
                    *own = V::default();
                }
            }
        }
    }
}
