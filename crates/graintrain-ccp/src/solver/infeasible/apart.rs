//! Contacts that resist turning as contacts that slide alone, for the search.
//!
//! The cone of (g, h) is { g_n = a_n = b_n } with (g_n, g_t), (a_n, h_1, h_2) and (b_n, h_n, .) in friction
//! cones of mu, rolling and spinning. Where (g_n - a_n)^2 and (g_n - b_n)^2 are added to g^T N g, of any
//! weight, its zeros are those of N with equal normal impulses: the problem taken apart has the rays of the
//! problem itself, and no others. Its solutions are other ones.

use crate::arrays::blocks;
use crate::delassus::Delassus;
use crate::problem::{Ccp, CcpError};
use std::borrow::Cow;

/// The row of every row of a problem in the one taken apart; none where the cone leaves no impulse.
pub(super) fn places(problem: &Ccp) -> Vec<Option<usize>> {
    let mut end = 3 * problem.num_contacts();
    let mut places: Vec<Option<usize>> = (0..end).map(Some).collect();
    let mut part = |coefficient: f64| {
        (coefficient > 0.0).then(|| {
            end += 3;
            end - 3
        })
    };
    for turning in &problem.turning {
        let [rolling, spinning] = [turning.rolling, turning.spinning].map(&mut part);
        places.extend([spinning.map(|own| own + 1), rolling.map(|own| own + 1), rolling.map(|own| own + 2)]);
    }
    places
}

/// The problem taken apart.
pub(super) fn apart(problem: &Ccp) -> Result<Cow<'_, Ccp>, CcpError> {
    if problem.turning.is_empty() {
        return Ok(Cow::Borrowed(problem));
    }
    let (places, eta) = (places(problem), problem.diagonal_scale());
    let mut entries = Vec::new();
    for (i, j, block) in problem.delassus.assemble().iter() {
        for (e, value) in block.into_iter().enumerate() {
            if let (Some(row), Some(column)) = (places[3 * i + e / 3], places[3 * j + e % 3]) {
                entries.push((row, column, value));
            }
        }
    }
    let mut friction = problem.friction.clone();
    for turning in &problem.turning {
        let contact = turning.contact as usize;
        for coefficient in [turning.rolling, turning.spinning].into_iter().filter(|&c| c > 0.0) {
            let (normal, own, weight) = (3 * contact, 3 * friction.len(), eta[contact]);
            friction.push(coefficient);
            entries.extend([(normal, normal, weight), (own, own, weight)]);
            entries.extend([(normal, own, -weight), (own, normal, -weight)]);
        }
    }
    let mut r = vec![0.0; 3 * friction.len()];
    for (place, value) in places.into_iter().zip(&problem.r) {
        if let Some(place) = place {
            r[place] = *value;
        }
    }
    let delassus = match &*problem.delassus {
        // Nothing resists turning: bodies stay what they are.
        Delassus::Rigid(rigid) if friction.len() == problem.num_contacts() => {
            Delassus::Rigid(rigid.clone().with_turning(Vec::new()))
        }
        _ => Delassus::Sparse(blocks(&entries, friction.len())?),
    };
    Ccp::new(delassus, r, friction).map(Cow::Owned)
}
