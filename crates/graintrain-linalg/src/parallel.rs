//! Parallel loops and sums whose bits do not depend on the number of threads.
//!
//! A loop that writes disjoint chunks is deterministic by itself. A sum is made so by adding fixed
//! chunks of [`CHUNK`] terms, each from left to right, and then the chunk sums from left to right.

use rayon::prelude::*;

/// Terms per chunk. Fixed: it is part of the definition of every sum made here.
pub const CHUNK: usize = 4096;

/// Dot product sum_i x_i y_i.
///
/// # Panics
/// If the lengths differ.
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    assert_eq!(x.len(), y.len(), "dot product of vectors of different length");
    sum_chunks(x.len(), |range| x[range.clone()].iter().zip(&y[range]).map(|(a, b)| a * b).sum())
}

/// Euclidean norm.
pub fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// y <- y + a x.
pub fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    assert_eq!(x.len(), y.len(), "axpy of vectors of different length");
    y.par_chunks_mut(CHUNK).zip(x.par_chunks(CHUNK)).for_each(|(y, x)| {
        for (y, x) in y.iter_mut().zip(x) {
            *y += a * x;
        }
    });
}

/// Sum over fixed chunks of `0..len`: `chunk_sum` gets each index range, and the results are added in order.
pub fn sum_chunks(len: usize, chunk_sum: impl Fn(std::ops::Range<usize>) -> f64 + Sync) -> f64 {
    fold_chunks(len, 0.0, chunk_sum, |sum, chunk| sum + chunk)
}

/// What `of_chunk` makes of each fixed chunk of `0..len`, folded in order. On one thread nothing is
/// allocated.
pub fn fold_chunks<T: Send, U>(
    len: usize,
    start: U,
    of_chunk: impl Fn(std::ops::Range<usize>) -> T + Sync,
    fold: impl FnMut(U, T) -> U,
) -> U {
    let chunks = len.div_ceil(CHUNK);
    let range = |chunk: usize| chunk * CHUNK..((chunk + 1) * CHUNK).min(len);
    if chunks <= 1 || rayon::current_num_threads() == 1 {
        return (0..chunks).map(|chunk| of_chunk(range(chunk))).fold(start, fold);
    }
    let found: Vec<T> = (0..chunks).into_par_iter().map(|chunk| of_chunk(range(chunk))).collect();
    found.into_iter().fold(start, fold)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_do_not_depend_on_the_number_of_threads() {
        let x: Vec<f64> = (0..100_001).map(|i| f64::sin(i as f64) * 1e3).collect();
        let with = |threads| {
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| dot(&x, &x))
        };
        let one = with(1);
        assert_eq!(one.to_bits(), with(2).to_bits());
        assert_eq!(one.to_bits(), with(5).to_bits());
    }
}
