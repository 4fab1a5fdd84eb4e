//! Recognises rigid bodies in the matrices M and H of a global problem.
//!
//! A rigid body has six degrees of freedom (velocity u, angular velocity w), mass m I_3 and inertia J. A
//! contact with frame F (rows n, t1, t2) and arm r touches it with the rows `s [F, F [r]x^T R]` of H^T, s =
//! +1 for body A, -1 for body B: row k is `s (F_k, R^T (r x F_k))`. Programs differ in the axes of the
//! angular velocity: R = I where it is given in world axes, R = the attitude of the body where it is given in
//! body axes (Siconos). F follows from the first three columns, `K = R^T [r]x` from the others; R = I fits
//! where all K of a body are skew, else R follows from the K with the largest arm. What is recovered is
//! multiplied out again and must agree with the file to 1e-12.

use super::dense;
use super::error::{Defect, WRITE_AGAIN};
use super::matrix::Matrix;
use graintrain_ccp::{BodyInverseMass, FIXED, RigidContact, RigidDelassus};

/// Agreement asked for between the file and the recovered bodies, relative to the largest entry.
const AGREEMENT: f64 = 1e-12;

type Matrix3 = [[f64; 3]; 3];

/// Rigid bodies in contact, and H^T M^-1 f.
pub(super) struct Bodies {
    pub(super) delassus: RigidDelassus,
    pub(super) free_velocity: Vec<f64>,
}

/// One side of a contact as the file states it: row k of H^T is (linear[k], angular[k]).
struct Side {
    body: usize,
    linear: Matrix3,
    angular: Matrix3,
}

/// A contact whose frame is known: `sign` and `k = R^T [r]x` per side.
struct Framed {
    frame: Matrix3,
    sides: Vec<(Side, f64, Matrix3)>,
}

/// The rigid bodies behind M and H^T, or `None` where there are none.
///
/// # Errors
/// For a mass matrix of rigid bodies that is not positive definite.
pub(super) fn recognise(m: &Matrix, ht: &Matrix, f: &[f64]) -> Result<Option<Bodies>, Defect> {
    if !m.rows.is_multiple_of(6) || m.rows == 0 {
        return Ok(None);
    }
    let Some(masses) = (0..m.rows / 6).map(|body| body_mass(m, body)).collect::<Option<Vec<_>>>() else {
        return Ok(None);
    };
    let inverse: Vec<(f64, Matrix3)> = masses
        .iter()
        .enumerate()
        .map(|(body, (mass, inertia))| {
            invert(inertia).filter(|_| *mass > 0.0).map(|inverse| (1.0 / mass, inverse)).ok_or_else(|| {
                let what = format!("is not positive definite (body {body})");
                Defect::damaged("the mass matrix M", what, WRITE_AGAIN)
            })
        })
        .collect::<Result<_, _>>()?;
    let contacts = ht.rows / 3;
    let Some(framed) = (0..contacts).map(|i| framed(ht, i)).collect::<Option<Vec<_>>>() else {
        return Ok(None);
    };
    let Some(attitudes) = attitudes(&framed, inverse.len()) else {
        return Ok(None);
    };
    let Some(rigid) =
        framed.iter().map(|contact| rigid_contact(contact, &attitudes)).collect::<Option<Vec<_>>>()
    else {
        return Ok(None);
    };
    if !agrees(&rigid, &framed, &attitudes) {
        return Ok(None);
    }
    let velocity: Vec<f64> = inverse
        .iter()
        .zip(f.chunks_exact(6))
        .flat_map(|((linear, angular), f)| {
            let w = times(angular, [f[3], f[4], f[5]]);
            [linear * f[0], linear * f[1], linear * f[2], w[0], w[1], w[2]]
        })
        .collect();
    let mut free_velocity = vec![0.0; ht.rows];
    for entry in &ht.entries {
        free_velocity[entry.row] += entry.value * velocity[entry.column];
    }
    let bodies = inverse
        .iter()
        .zip(&attitudes)
        .map(|((linear, angular), attitude)| {
            let world = product(&product(attitude, angular), &transposed(attitude));
            BodyInverseMass {
                linear: [*linear; 3],
                angular: std::array::from_fn(|k| 0.5 * (world[k / 3][k % 3] + world[k % 3][k / 3])),
            }
        })
        .collect();
    Ok(Some(Bodies { delassus: RigidDelassus::new(rigid, bodies), free_velocity }))
}

/// Mass and inertia of a body, where M couples it to no other body and its translation not to its rotation.
fn body_mass(m: &Matrix, body: usize) -> Option<(f64, Matrix3)> {
    let first = 6 * body;
    let mut block = [[0.0; 6]; 6];
    for entry in m.rows_in(first..first + 6) {
        let row = entry.row - first;
        *block[row].get_mut(entry.column.checked_sub(first)?)? = entry.value;
    }
    let mass = block[0][0];
    let translation_is_scalar = (0..3).all(|i| {
        (0..6).all(|j| {
            let expected = if i == j { mass } else { 0.0 };
            block[i][j] == expected && (j < 3 || block[j][i] == 0.0)
        })
    });
    let inertia: Matrix3 =
        std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (block[3 + i][3 + j] + block[3 + j][3 + i])));
    translation_is_scalar.then_some((mass, inertia))
}

/// The sides of contact i and its frame; `None` where they are not those of rigid bodies.
fn framed(ht: &Matrix, i: usize) -> Option<Framed> {
    let mut sides: Vec<Side> = Vec::with_capacity(2);
    for entry in ht.rows_in(3 * i..3 * i + 3) {
        let (row, body, axis) = (entry.row - 3 * i, entry.column / 6, entry.column % 6);
        let known = sides.iter().position(|side| side.body == body);
        let side = match known {
            Some(side) => side,
            None if sides.len() < 2 => {
                sides.push(Side { body, linear: Matrix3::default(), angular: Matrix3::default() });
                sides.len() - 1
            }
            None => return None,
        };
        let part = if axis < 3 { &mut sides[side].linear } else { &mut sides[side].angular };
        part[row][axis % 3] = entry.value;
    }
    // A is the side whose frame is right-handed: which side is called A is free, n points from B to A either
    // way.
    sides.sort_by(|a, b| determinant(&b.linear).total_cmp(&determinant(&a.linear)));
    let frame = match sides.first() {
        Some(side) => {
            let sign = determinant(&side.linear).signum();
            side.linear.map(|row| row.map(|x| sign * x))
        }
        None => [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    };
    let sides = sides
        .into_iter()
        .map(|side| {
            let sign = determinant(&side.linear).signum();
            let k = std::array::from_fn(|a| {
                std::array::from_fn(|b| (0..3).map(|c| sign * side.angular[c][a] * frame[c][b]).sum())
            });
            (side, sign, k)
        })
        .collect();
    Some(Framed { frame, sides })
}

/// R of every body: the identity where that makes all its K skew.
fn attitudes(contacts: &[Framed], bodies: usize) -> Option<Vec<Matrix3>> {
    let mut arms: Vec<Vec<&Matrix3>> = vec![Vec::new(); bodies];
    for contact in contacts {
        for (side, _, k) in &contact.sides {
            arms[side.body].push(k);
        }
    }
    let identity = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    arms.iter()
        .map(|arms| {
            let largest = arms.iter().max_by(|a, b| norm(a).total_cmp(&norm(b)));
            let Some(largest) = largest else { return Some(identity) };
            let tolerance = AGREEMENT * norm(largest);
            let fits = |r: &Matrix3| arms.iter().all(|k| skew_defect(&product(r, k)) <= tolerance);
            if fits(&identity) {
                return Some(identity);
            }
            attitude_candidates(largest).into_iter().find(|r| fits(r))
        })
        .collect()
}

/// The two rotations R for which R K is skew, K = R^T [r]x.
///
/// K^T K = |r|^2 I - r r^T gives r up to its sign. With e1, e2, r / |r| right-handed and orthonormal,
/// K e1 = |r| R^T e2 and K e2 = -|r| R^T e1.
fn attitude_candidates(k: &Matrix3) -> Vec<Matrix3> {
    let gram = product(&transposed(k), k);
    let square = 0.5 * (gram[0][0] + gram[1][1] + gram[2][2]);
    let length = square.sqrt();
    let outer: Matrix3 =
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { square } else { 0.0 } - gram[i][j]));
    let widest = (0..3).max_by(|&a, &b| outer[a][a].total_cmp(&outer[b][b])).unwrap_or(0);
    let axis = unit(std::array::from_fn(|i| outer[i][widest]));
    let thinnest = (0..3).min_by(|&a, &b| axis[a].abs().total_cmp(&axis[b].abs())).unwrap_or(0);
    let other = std::array::from_fn(|i| if i == thinnest { 1.0 } else { 0.0 });
    [1.0, -1.0]
        .into_iter()
        .map(|sign| {
            let axis = axis.map(|x| sign * x);
            let e1 = unit(cross(axis, other));
            let e2 = cross(axis, e1);
            let image2 = unit(times(k, e1).map(|x| x / length));
            let image1 = unit(times(k, e2).map(|x| -x / length));
            let image3 = cross(image1, image2);
            // R^T = sum of image_i e_i^T, so R = sum of e_i image_i^T.
            std::array::from_fn(|i| {
                std::array::from_fn(|j| e1[i] * image1[j] + e2[i] * image2[j] + axis[i] * image3[j])
            })
        })
        .collect()
}

/// The contact with its arms, [r]x = R K.
fn rigid_contact(contact: &Framed, attitudes: &[Matrix3]) -> Option<RigidContact> {
    let mut rigid =
        RigidContact { body_a: FIXED, body_b: FIXED, frame: contact.frame, arm_a: [0.0; 3], arm_b: [0.0; 3] };
    for (side, sign, k) in &contact.sides {
        let s = product(&attitudes[side.body], k);
        let arm = [0.5 * (s[2][1] - s[1][2]), 0.5 * (s[0][2] - s[2][0]), 0.5 * (s[1][0] - s[0][1])];
        let (body, place) = if *sign > 0.0 {
            (&mut rigid.body_a, &mut rigid.arm_a)
        } else {
            (&mut rigid.body_b, &mut rigid.arm_b)
        };
        if *body != FIXED {
            return None;
        }
        (*body, *place) = (side.body as u32, arm);
    }
    Some(rigid)
}

/// Whether the recovered contacts, multiplied out again, are the H of the file.
fn agrees(rigid: &[RigidContact], framed: &[Framed], attitudes: &[Matrix3]) -> bool {
    let sides = || framed.iter().flat_map(|contact| &contact.sides);
    let largest =
        sides().flat_map(|(side, _, _)| side.angular.as_flattened()).fold(0.0_f64, |m, x| m.max(x.abs()));
    let close = |a: [f64; 3], b: [f64; 3], scale: f64| {
        (0..3).all(|axis| (a[axis] - b[axis]).abs() <= AGREEMENT * scale)
    };
    rigid.iter().zip(framed).all(|(rigid, framed)| {
        framed.sides.iter().all(|(side, sign, _)| {
            let arm = if *sign > 0.0 { rigid.arm_a } else { rigid.arm_b };
            let into_body_axes = transposed(&attitudes[side.body]);
            (0..3).all(|k| {
                let linear = rigid.frame[k].map(|x| sign * x);
                let angular = times(&into_body_axes, cross(arm, rigid.frame[k])).map(|x| sign * x);
                close(linear, side.linear[k], 1.0) && close(angular, side.angular[k], largest)
            })
        })
    })
}

/// Contact points in a common space: bodies are placed along the contacts between them, x_B = x_A + r_A - r_B
/// (the gaps, small beside the arms, are not known); groups of bodies without contact to each other lie side
/// by side along x. Empty where a contact has no body.
pub(super) fn relative_points(delassus: &RigidDelassus) -> Vec<[f64; 3]> {
    let contacts = delassus.contacts();
    let mut position: Vec<Option<[f64; 3]>> = vec![None; delassus.num_bodies()];
    let mut edge = 0.0_f64;
    for first in 0..delassus.num_bodies() {
        if position[first].is_some() || delassus.sides(first).is_empty() {
            continue;
        }
        position[first] = Some([0.0; 3]);
        let (mut group, mut next) = (vec![first], 0);
        while next < group.len() {
            let body = group[next];
            next += 1;
            let here = position[body].unwrap_or_default();
            for side in delassus.sides(body) {
                let contact = &contacts[side.contact as usize];
                let (other, other_arm) = if side.sign > 0.0 {
                    (contact.body_b, contact.arm_b)
                } else {
                    (contact.body_a, contact.arm_a)
                };
                if other != FIXED && position[other as usize].is_none() {
                    position[other as usize] =
                        Some(std::array::from_fn(|k| here[k] + side.arm[k] - other_arm[k]));
                    group.push(other as usize);
                }
            }
        }
        let extent = |body: &usize| position[*body].map_or(0.0, |x| x[0]);
        let arms = group.iter().flat_map(|&body| delassus.sides(body)).map(|side| norm3(side.arm));
        let margin = 2.0 * arms.fold(0.0, f64::max);
        let low = group.iter().map(extent).fold(f64::INFINITY, f64::min);
        let high = group.iter().map(extent).fold(f64::NEG_INFINITY, f64::max);
        for &body in &group {
            if let Some(x) = &mut position[body] {
                x[0] += edge + margin - low;
            }
        }
        edge += high - low + 2.0 * margin;
    }
    let point = |contact: &RigidContact| {
        let (body, arm) = if contact.body_a == FIXED {
            (contact.body_b, contact.arm_b)
        } else {
            (contact.body_a, contact.arm_a)
        };
        let x = (*position.get(body as usize)?)?;
        Some(std::array::from_fn(|k| x[k] + arm[k]))
    };
    contacts.iter().map(point).collect::<Option<Vec<_>>>().unwrap_or_default()
}

/// Inverse of a symmetric positive definite matrix; `None` for any other.
pub(super) fn invert(a: &Matrix3) -> Option<Matrix3> {
    dense::cholesky(a.as_flattened().to_vec(), 3)?;
    let columns = [cross(a[1], a[2]), cross(a[2], a[0]), cross(a[0], a[1])];
    let determinant = determinant(a);
    Some(std::array::from_fn(|i| std::array::from_fn(|j| columns[j][i] / determinant)))
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn norm3(a: [f64; 3]) -> f64 {
    (a[0] * a[0] + a[1] * a[1] + a[2] * a[2]).sqrt()
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = norm3(a);
    a.map(|x| x / length)
}

fn determinant(m: &Matrix3) -> f64 {
    let c = cross(m[1], m[2]);
    m[0][0] * c[0] + m[0][1] * c[1] + m[0][2] * c[2]
}

fn times(m: &Matrix3, x: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * x[0] + row[1] * x[1] + row[2] * x[2])
}

fn transposed(m: &Matrix3) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
}

fn product(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Frobenius norm.
fn norm(m: &Matrix3) -> f64 {
    m.as_flattened().iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Largest entry of the symmetric part.
fn skew_defect(m: &Matrix3) -> f64 {
    let entry = |i: usize, j: usize| (0.5 * (m[i][j] + m[j][i])).abs();
    (0..9).fold(0.0_f64, |largest, k| largest.max(entry(k / 3, k % 3)))
}
