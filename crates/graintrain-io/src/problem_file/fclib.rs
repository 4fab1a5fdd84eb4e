//! Reads FCLIB problems (HDF5): `fclib_local` and `fclib_global`, and those with rolling friction,
//! `fclib_local_rolling` and `fclib_global_rolling`, whose contacts have five rows and a second coefficient,
//! `mu_r`.
//!
//! Meanings after the FCLIB report (Acary, Bremond, Huber: FCLIB: a collection of discrete 3D frictional
//! contact problems, Inria RT-444) and `fclib.h`:
//!
//! ```text
//! local:   u = W r + V lambda + q,      V^T r + R lambda + s = 0          (V, R, s optional)
//! global:  M v = H r + G lambda + f,    G^T v + b = 0,    u = H^T v + w   (G, b optional)
//! ```
//!
//! A matrix is a group of `m` rows, `n` columns, `nz` (-1 compressed columns, -2 compressed rows, else the
//! number of triplets), `p`, `i`, `x`. Triplets follow CSparse and thus Siconos: `i` rows, `p` columns.
//! `fclib.h` says the opposite; where only its reading fits the size of the matrix, it is taken.

use super::error::{COPY_AGAIN, Defect, WRITE_AGAIN};
use super::matrix::{Entry, Matrix};
use super::raw::{GlobalEqualities, GlobalForm, LocalEqualities, LocalForm, RawProblem, check_dimension};
use super::rolling::ROWS;
use hdf5_pure::{AttrValue, Error, File, FormatError};

/// What an FCLIB file says.
pub(super) struct Read {
    pub(super) raw: RawProblem,
    /// Its group.
    pub(super) group: &'static str,
    /// Title; empty where there is none.
    pub(super) title: String,
    /// What the user should know about the choice of what was read.
    pub(super) remark: Option<String>,
}

/// Reads the problem.
pub(super) fn read(file: &File) -> Result<Read, Defect> {
    let groups = file.root().groups().map_err(|error| damaged("/", &error))?;
    let find =
        |names: [&'static str; 2]| names.into_iter().find(|name| groups.iter().any(|group| group == name));
    let global_path = find(["fclib_global", "fclib_global_rolling"]);
    let local_path = find(["fclib_local", "fclib_local_rolling"]);
    if let Some(path) = global_path {
        let group = Group { file, path };
        let remark = local_path.map(|_| {
            format!("the file holds a global and a local problem; the global one ({path}) is solved")
        });
        Ok(Read { raw: RawProblem::Global(global(&group)?), group: path, title: group.title(), remark })
    } else if let Some(path) = local_path {
        let group = Group { file, path };
        Ok(Read { raw: RawProblem::Local(local(&group)?), group: path, title: group.title(), remark: None })
    } else {
        let found = if groups.is_empty() { "nothing".to_string() } else { groups.join(", ") };
        Err(Defect::damaged(
            "/",
            format!("neither fclib_local nor fclib_global, but {found}"),
            "this HDF5 file is no FCLIB problem",
        ))
    }
}

fn local(group: &Group<'_>) -> Result<LocalForm, Defect> {
    let equalities = match (group.has("V")?, group.has("R")?) {
        (true, true) => Some(LocalEqualities {
            v: group.matrix("V")?,
            r: group.matrix("R")?,
            s: group.numbers("vectors/s")?,
        }),
        (false, false) => None,
        (has_v, _) => {
            let (given, missing) = if has_v { ("V", "R") } else { ("R", "V") };
            return Err(Defect::damaged(
                group.place(given),
                format!("stands without {missing}: equality constraints need both"),
                "write V, R and s, or eliminate the equality constraints (W - V R^-1 V^T, q - V R^-1 s)",
            ));
        }
    };
    let q = group.numbers("vectors/q")?;
    let (friction, rolling) = group.friction(q.len())?;
    Ok(LocalForm { w: group.matrix("W")?, friction, rolling, q, equalities })
}

fn global(group: &Group<'_>) -> Result<GlobalForm, Defect> {
    let equalities = if group.has("G")? {
        Some(GlobalEqualities { g: group.matrix("G")?, b: group.numbers("vectors/b")? })
    } else {
        None
    };
    let w = group.numbers("vectors/w")?;
    let (friction, rolling) = group.friction(w.len())?;
    Ok(GlobalForm {
        m: group.matrix("M")?,
        h: group.matrix("H")?,
        f: group.numbers("vectors/f")?,
        friction,
        rolling,
        w,
        equalities,
    })
}

/// What HDF5 says is wrong, at a place.
pub(super) fn damaged(place: &str, error: &Error) -> Defect {
    match error {
        Error::Format(FormatError::PathNotFound(_)) => {
            Defect::damaged(place, "is missing", "the file is no complete FCLIB problem")
        }
        Error::Format(FormatError::UnsupportedFilter(filter)) => Defect::unsupported(
            format!("{place} is compressed by HDF5 filter {filter}, which is not read here"),
            "repack the file with a filter that is: h5repack -f GZIP=6 OLD NEW",
        ),
        Error::Format(FormatError::TypeMismatch { actual, .. }) => {
            Defect::damaged(place, format!("holds {actual} where numbers belong"), "write numbers there")
        }
        Error::NotADataset(_) | Error::NotAGroup(_) => Defect::damaged(
            place,
            error.to_string(),
            "a matrix is a group of m, n, nz, nzmax, p, i and x, a vector is a data set in the group vectors",
        ),
        other => Defect::damaged(place, other.to_string(), COPY_AGAIN),
    }
}

/// A group of the file.
pub(super) struct Group<'a> {
    pub(super) file: &'a File,
    pub(super) path: &'static str,
}

impl Group<'_> {
    fn place(&self, name: &str) -> String {
        format!("{}/{name}", self.path)
    }

    /// Whether the group has a child group.
    fn has(&self, name: &str) -> Result<bool, Defect> {
        match self.file.group(&self.place(name)) {
            Ok(_) => Ok(true),
            Err(Error::Format(FormatError::PathNotFound(_))) => Ok(false),
            Err(error) => Err(damaged(&self.place(name), &error)),
        }
    }

    pub(super) fn numbers(&self, name: &str) -> Result<Vec<f64>, Defect> {
        let place = self.place(name);
        let numbers = self.file.dataset(&place).and_then(|dataset| dataset.read_f64());
        numbers.map_err(|error| damaged(&place, &error))
    }

    pub(super) fn integers(&self, name: &str) -> Result<Vec<i64>, Defect> {
        let place = self.place(name);
        let numbers = self.file.dataset(&place).and_then(|dataset| dataset.read_i64());
        let numbers = numbers.map_err(|error| damaged(&place, &error))?;
        // Whole numbers may be stored as floats; what is none (NaN, 0.5) must not be rounded to another
        // matrix.
        let as_stored = self.numbers(name)?;
        match as_stored.iter().zip(&numbers).find(|(stored, number)| **stored != **number as f64) {
            None => Ok(numbers),
            Some((stored, _)) => {
                Err(Defect::damaged(place, format!("{stored} is no whole number"), WRITE_AGAIN))
            }
        }
    }

    /// One whole number: a data set, scalar or of one number, or an attribute of the group it belongs to.
    fn integer(&self, name: &str) -> Result<i64, Defect> {
        if let Some(value) = self.attribute(name) {
            return Ok(value);
        }
        let numbers = self.integers(name)?;
        numbers.first().copied().ok_or_else(|| Defect::damaged(self.place(name), "is empty", COPY_AGAIN))
    }

    /// The whole number `name` where it is an attribute.
    fn attribute(&self, name: &str) -> Option<i64> {
        let (parent, leaf) = match name.rsplit_once('/') {
            Some((parent, leaf)) => (self.place(parent), leaf),
            None => (self.path.to_string(), name),
        };
        let attributes = self.file.group(&parent).ok()?.attrs().ok()?;
        match attributes.get(leaf)? {
            AttrValue::I32(value) => Some(i64::from(*value)),
            AttrValue::I64(value) => Some(*value),
            AttrValue::U32(value) => Some(i64::from(*value)),
            AttrValue::U64(value) => i64::try_from(*value).ok(),
            AttrValue::I32Array(values) => values.first().copied().map(i64::from),
            AttrValue::I64Array(values) => values.first().copied(),
            _ => None,
        }
    }

    fn size(&self, name: &str) -> Result<usize, Defect> {
        let value = self.integer(name)?;
        usize::try_from(value)
            .map_err(|_| Defect::damaged(self.place(name), format!("{value} is no size"), WRITE_AGAIN))
    }

    fn indices(&self, name: &str) -> Result<Vec<usize>, Defect> {
        let integers = self.integers(name)?.into_iter();
        let convert = |value: i64| {
            usize::try_from(value)
                .map_err(|_| Defect::damaged(self.place(name), format!("{value} is no index"), WRITE_AGAIN))
        };
        integers.map(convert).collect()
    }

    /// Coefficients of friction, and of rolling friction where contacts have five rows, of a problem with
    /// `size` unknowns; a single one holds for every contact. Refuses problems that are not
    /// three-dimensional; where `spacedim` is missing there has to be a coefficient per three unknowns.
    fn friction(&self, size: usize) -> Result<(Vec<f64>, Option<Vec<f64>>), Defect> {
        let mut each = 3;
        let friction = self.numbers("vectors/mu")?;
        let has_dimension =
            self.attribute("spacedim").is_some() || self.file.dataset(&self.place("spacedim")).is_ok();
        if has_dimension {
            each = check_dimension(self.integer("spacedim")?)?;
        } else if friction.len() * 3 != size {
            return Err(Defect::damaged(
                self.place("spacedim"),
                format!("is missing, and {size} unknowns for {} contacts are not three each", friction.len()),
                "write spacedim = 3 and a coefficient of friction per contact",
            ));
        }
        let rolls = self.file.dataset(&self.place("vectors/mu_r")).is_ok();
        if rolls != (each == ROWS) {
            let what = if rolls {
                "gives coefficients of rolling friction, but contacts have three rows (spacedim)"
            } else {
                "is missing, and contacts have five rows (spacedim), two of them of rolling friction"
            };
            let remedy = "write spacedim = 5 with mu_r and five rows per contact, or spacedim = 3 without";
            return Err(Defect::damaged(self.place("vectors/mu_r"), what, remedy));
        }
        let for_all = |given: Vec<f64>| {
            if given.len() == 1 { vec![given[0]; (size / each).max(1)] } else { given }
        };
        let rolling = rolls.then(|| self.numbers("vectors/mu_r")).transpose()?;
        Ok((for_all(friction), rolling.map(for_all)))
    }

    /// Title of the problem; empty where there is none that is text.
    fn title(&self) -> String {
        let strings = self.file.dataset(&self.place("info/title")).and_then(|dataset| dataset.read_string());
        strings.ok().and_then(|strings| strings.first().cloned()).unwrap_or_default().trim().to_string()
    }

    fn matrix(&self, name: &str) -> Result<Matrix, Defect> {
        let part = |field: &str| format!("{name}/{field}");
        let place = self.place(name);
        let (rows, columns) = (self.size(&part("m"))?, self.size(&part("n"))?);
        let nz = self.integer(&part("nz"))?;
        let p = self.indices(&part("p"))?;
        let i = self.indices(&part("i"))?;
        let x = self.numbers(&part("x"))?;
        let entries = match nz {
            -2 => compressed(&place, rows, &p, &i, &x, true)?,
            -1 => compressed(&place, columns, &p, &i, &x, false)?,
            0.. => {
                let count = nz as usize;
                if [p.len(), i.len(), x.len()].iter().any(|&length| length < count) {
                    let what = format!("nz is {count}, but p, i, x hold fewer entries");
                    return Err(Defect::damaged(place, what, COPY_AGAIN));
                }
                triplets(rows, columns, &p[..count], &i[..count], &x[..count])
            }
            _ => {
                let what = format!("nz is {nz}, expected -1, -2 or a number of triplets");
                return Err(Defect::damaged(place, what, WRITE_AGAIN));
            }
        };
        Matrix::new(&place, rows, columns, entries)
    }
}

/// Entries of compressed rows or columns; arrays may be longer than what the starts `p` use.
fn compressed(
    place: &str,
    majors: usize,
    p: &[usize],
    i: &[usize],
    x: &[f64],
    by_row: bool,
) -> Result<Vec<Entry>, Defect> {
    let sound = p.len() == majors.saturating_add(1)
        && p[0] == 0
        && p.windows(2).all(|pair| pair[0] <= pair[1])
        && p[majors] <= i.len().min(x.len());
    if !sound {
        let what = format!(
            "p has {} starts and ends at {}, for {majors} compressed rows or columns and {} entries",
            p.len(),
            p.last().unwrap_or(&0),
            i.len().min(x.len())
        );
        return Err(Defect::damaged(place, what, COPY_AGAIN));
    }
    let mut entries = Vec::with_capacity(p[majors]);
    for major in 0..majors {
        for k in p[major]..p[major + 1] {
            let (row, column) = if by_row { (major, i[k]) } else { (i[k], major) };
            entries.push(Entry { row, column, value: x[k] });
        }
    }
    Ok(entries)
}

/// Entries of triplets, in the reading of CSparse, or of `fclib.h` where only that fits.
fn triplets(rows: usize, columns: usize, p: &[usize], i: &[usize], x: &[f64]) -> Vec<Entry> {
    let fits = |row: &[usize], column: &[usize]| {
        row.iter().all(|&row| row < rows) && column.iter().all(|&column| column < columns)
    };
    let (row, column) = if !fits(i, p) && fits(p, i) { (p, i) } else { (i, p) };
    row.iter().zip(column).zip(x).map(|((&row, &column), &value)| Entry { row, column, value }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Files of such filters cannot be written here, so that the translation alone is tested.
    #[test]
    fn compression_that_is_not_read_is_distinguished_from_damage() {
        let error = Error::Format(FormatError::UnsupportedFilter(4));
        let Defect::Unsupported { what, remedy } = damaged("fclib_local/W/x", &error) else {
            panic!("no damage");
        };
        assert!(what.contains("fclib_local/W/x") && what.contains("filter 4") && remedy.contains("h5repack"));
    }
}
