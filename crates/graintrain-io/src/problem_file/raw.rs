//! A contact problem as the files state it, before it becomes a [`Ccp`].

use super::error::{Defect, WRITE_AGAIN};
use super::matrix::Matrix;
use super::rolling::{self, spread_matrix, spread_vector};
use graintrain_ccp::RigidDelassus;

/// Everything that a file says.
pub(super) struct Stated {
    pub(super) raw: RawProblem,
    /// Empty where there is none.
    pub(super) title: String,
    /// What the user should know about the choice of what was read.
    pub(super) remark: Option<String>,
    pub(super) extras: Extras,
}

/// The two forms of FCLIB and Siconos.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum RawProblem {
    Local(LocalForm),
    Global(GlobalForm),
}

/// What FCLIB cannot say and the program's own dumps do.
#[derive(Default)]
pub(super) struct Extras {
    pub(super) velocity_scale: Option<f64>,
    pub(super) points: Vec<[f64; 3]>,
    pub(super) identity: Vec<u64>,
    pub(super) bodies: Option<RigidDelassus>,
    /// What the user should know about it.
    pub(super) remark: Option<String>,
}

/// u = W r + V lambda + q,  V^T r + R lambda + s = 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LocalForm {
    pub(super) w: Matrix,
    pub(super) q: Vec<f64>,
    pub(super) friction: Vec<f64>,
    /// Coefficients of rolling friction, m, of a problem with five rows per contact.
    pub(super) rolling: Option<Vec<f64>>,
    pub(super) equalities: Option<LocalEqualities>,
}

/// The bilateral part of a local problem.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct LocalEqualities {
    pub(super) v: Matrix,
    pub(super) r: Matrix,
    pub(super) s: Vec<f64>,
}

/// M v = H r + G lambda + f,  G^T v + b = 0,  u = H^T v + w.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct GlobalForm {
    pub(super) m: Matrix,
    pub(super) h: Matrix,
    pub(super) f: Vec<f64>,
    pub(super) w: Vec<f64>,
    pub(super) friction: Vec<f64>,
    /// Coefficients of rolling friction, m, of a problem with five rows per contact.
    pub(super) rolling: Option<Vec<f64>>,
    pub(super) equalities: Option<GlobalEqualities>,
}

/// The bilateral part of a global problem.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct GlobalEqualities {
    pub(super) g: Matrix,
    pub(super) b: Vec<f64>,
}

/// Checks that a matrix has the size that the rest of the file asks for.
pub(super) fn check_size(place: &str, matrix: &Matrix, rows: usize, columns: usize) -> Result<(), Defect> {
    if (matrix.rows, matrix.columns) == (rows, columns) {
        return Ok(());
    }
    let what = format!("a {} x {} matrix, expected {rows} x {columns}", matrix.rows, matrix.columns);
    Err(Defect::damaged(place, what, WRITE_AGAIN))
}

/// Checks that a matrix has so many columns per contact; gives their number.
fn check_columns(place: &str, matrix: &Matrix, each: usize) -> Result<usize, Defect> {
    if matrix.columns.is_multiple_of(each) {
        return Ok(matrix.columns);
    }
    let what = format!("a matrix of {} columns, which are not {each} per contact", matrix.columns);
    Err(Defect::damaged(place, what, WRITE_AGAIN))
}

/// Checks the length of a vector, and that its numbers are finite.
pub(super) fn check_vector(place: &str, vector: &[f64], length: usize) -> Result<(), Defect> {
    if vector.len() != length {
        let what = format!("{} numbers, expected {length}", vector.len());
        return Err(Defect::damaged(place, what, WRITE_AGAIN));
    }
    match vector.iter().position(|value| !value.is_finite()) {
        Some(k) => Err(Defect::damaged(place, format!("entry {k} is {}", vector[k]), WRITE_AGAIN)),
        None => Ok(()),
    }
}

/// Checks the coefficients of friction.
pub(super) fn check_friction(place: &str, friction: &[f64], contacts: usize) -> Result<(), Defect> {
    check_vector(place, friction, contacts)?;
    match friction.iter().position(|&mu| mu < 0.0) {
        Some(k) => {
            let what = format!("the coefficient of friction of contact {k} is {}", friction[k]);
            Err(Defect::damaged(place, what, "coefficients of friction must not be negative"))
        }
        None => Ok(()),
    }
}

/// Refuses contacts that have neither three components nor, with rolling friction, five; gives their number.
pub(super) fn check_dimension(dimension: i64) -> Result<usize, Defect> {
    match dimension {
        3 => Ok(3),
        5 => Ok(rolling::ROWS),
        2 => Err(Defect::unsupported(
            "a two-dimensional contact problem (2 components per contact)",
            "only three-dimensional problems are solved here; state the problem with 3 components per contact",
        )),
        other => Err(Defect::unsupported(
            format!("a contact problem with {other} components per contact"),
            "only problems with 3 components per contact (normal, tangent 1, tangent 2), or 5 with rolling friction, are solved here",
        )),
    }
}

impl RawProblem {
    /// Rows per contact.
    fn components(&self) -> usize {
        let rolling = match self {
            Self::Local(local) => &local.rolling,
            Self::Global(global) => &global.rolling,
        };
        if rolling.is_some() { rolling::ROWS } else { 3 }
    }

    /// Turns five rows per contact into block rows of three; gives the coefficients of rolling friction where
    /// there are any.
    pub(super) fn spread_rolling(&mut self) -> Result<Option<Vec<f64>>, Defect> {
        match self {
            Self::Local(local) => {
                let Some(rolling) = local.rolling.take() else { return Ok(None) };
                local.w = spread_matrix(std::mem::take(&mut local.w), true, true)?;
                local.q = spread_vector(&local.q);
                if let Some(equalities) = &mut local.equalities {
                    equalities.v = spread_matrix(std::mem::take(&mut equalities.v), true, false)?;
                }
                Ok(Some(rolling))
            }
            Self::Global(global) => {
                let Some(rolling) = global.rolling.take() else { return Ok(None) };
                global.h = spread_matrix(std::mem::take(&mut global.h), false, true)?;
                global.w = spread_vector(&global.w);
                Ok(Some(rolling))
            }
        }
    }

    /// Completes matrices that have to be symmetric and of which only one triangle is stored; gives their
    /// names.
    pub(super) fn mirror_triangles(&mut self) -> Vec<&'static str> {
        let symmetric: Vec<(&'static str, &mut Matrix)> = match self {
            Self::Local(local) => {
                let r = local.equalities.as_mut().map(|equalities| ("R", &mut equalities.r));
                std::iter::once(("W", &mut local.w)).chain(r).collect()
            }
            Self::Global(global) => vec![("M", &mut global.m)],
        };
        symmetric.into_iter().filter_map(|(name, matrix)| matrix.mirror_triangle().then_some(name)).collect()
    }

    /// Checks sizes and numbers; `name` gives the place of each part in the file.
    pub(super) fn check(&self, name: impl Fn(&str) -> String) -> Result<(), Defect> {
        let each = self.components();
        match self {
            Self::Local(local) => {
                let size = check_columns(&name("W"), &local.w, each)?;
                check_size(&name("W"), &local.w, size, size)?;
                check_friction(&name("mu"), &local.friction, size / each)?;
                if let Some(rolling) = &local.rolling {
                    check_friction(&name("mu_r"), rolling, size / each)?;
                }
                check_vector(&name("q"), &local.q, size)?;
                if let Some(equalities) = &local.equalities {
                    let p = equalities.s.len();
                    check_size(&name("V"), &equalities.v, size, p)?;
                    check_size(&name("R"), &equalities.r, p, p)?;
                    check_vector(&name("s"), &equalities.s, p)?;
                }
            }
            Self::Global(global) => {
                let size = check_columns(&name("H"), &global.h, each)?;
                let freedoms = global.m.rows;
                check_size(&name("M"), &global.m, freedoms, freedoms)?;
                check_size(&name("H"), &global.h, freedoms, size)?;
                check_friction(&name("mu"), &global.friction, size / each)?;
                if let Some(rolling) = &global.rolling {
                    check_friction(&name("mu_r"), rolling, size / each)?;
                }
                check_vector(&name("f"), &global.f, freedoms)?;
                check_vector(&name("w"), &global.w, size)?;
                if let Some(equalities) = &global.equalities {
                    let p = equalities.b.len();
                    check_size(&name("G"), &equalities.g, freedoms, p)?;
                    check_vector(&name("b"), &equalities.b, p)?;
                }
            }
        }
        Ok(())
    }
}
