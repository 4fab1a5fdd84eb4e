//! Systematic points for functions with jumps, to be given to a cross as probes.

use crate::TtError;

/// An equidistant sub-grid of at most `most` points with both ends of every mode: d indices per point, for
/// use as `probes` of [`super::cross`]. Modes get 1, 2, 3, 5, 9, ... places, the ones with the coarsest
/// spacing first, while the product allows it.
///
/// # Errors
/// [`TtError::Shape`] if there is no mode or a mode is empty.
///
/// ```
/// use graintrain_tt::cross::sub_grid;
/// assert_eq!(sub_grid(&[5, 2], 6)?, [0, 0, 2, 0, 4, 0, 0, 1, 2, 1, 4, 1]);
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn sub_grid(modes: &[usize], most: usize) -> Result<Vec<usize>, TtError> {
    check_modes(modes)?;
    let mut places = vec![1usize; modes.len()];
    let count = |places: &[usize]| places.iter().fold(1usize, |product, &m| product.saturating_mul(m));
    let finer = |m: usize, n: usize| if m == 1 { 2.min(n) } else { (2 * m - 1).min(n) };
    // The mode with the widest spacing that can still be refined within the limit.
    while let Some(k) = (0..modes.len())
        .filter(|&k| places[k] < modes[k] && count(&places) / places[k] <= most / finer(places[k], modes[k]))
        .max_by_key(|&k| (modes[k] / places[k], std::cmp::Reverse(k)))
    {
        places[k] = finer(places[k], modes[k]);
    }
    let total = count(&places);
    let mut points = Vec::with_capacity(total * modes.len());
    let mut digits = vec![0; modes.len()];
    for _ in 0..total {
        for ((&digit, &m), &n) in digits.iter().zip(&places).zip(modes) {
            points.push(if m == 1 { n / 2 } else { digit * (n - 1) / (m - 1) });
        }
        for (digit, &m) in digits.iter_mut().zip(&places) {
            *digit += 1;
            if *digit < m {
                break;
            }
            *digit = 0;
        }
    }
    Ok(points)
}

/// The fibres through the two corners 0 and n - 1, and through all points of which the digits left of a bond
/// stand at one end and those right of it at the other: 2 d sum(n_k) points and less, d indices each, for use
/// as `probes` of [`super::cross`]. This is where functions of a sum of coordinates keep the rows that cross
/// interpolation misses last.
///
/// # Errors
/// [`TtError::Shape`] if there is no mode or a mode is empty.
///
/// ```
/// use graintrain_tt::cross::ends_of_modes;
/// let points = ends_of_modes(&[3, 3])?;
/// assert!(points.chunks_exact(2).any(|point| point == [2, 0]));
/// assert!(points.chunks_exact(2).all(|point| point != [1, 1]));
/// # Ok::<(), graintrain_tt::TtError>(())
/// ```
pub fn ends_of_modes(modes: &[usize]) -> Result<Vec<usize>, TtError> {
    check_modes(modes)?;
    let d = modes.len();
    let mut found = std::collections::BTreeSet::new();
    for bond in 0..d {
        for high in [false, true] {
            let corner: Vec<usize> =
                (0..d).map(|k| if (k < bond) == high { modes[k] - 1 } else { 0 }).collect();
            for k in 0..d {
                for i in 0..modes[k] {
                    let mut point = corner.clone();
                    point[k] = i;
                    found.insert(point);
                }
            }
        }
    }
    Ok(found.into_iter().flatten().collect())
}

fn check_modes(modes: &[usize]) -> Result<(), TtError> {
    if modes.is_empty() || modes.contains(&0) {
        return Err(TtError::Shape { what: "modes", expected: vec![1], got: modes.to_vec() });
    }
    Ok(())
}
