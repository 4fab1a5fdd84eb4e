//! Reads problem files and answers again, by code that shares nothing with the program but the definition of
//! the residual, and compares the answers.

use std::path::Path;

/// A problem as its file states it, at most sparse: u = W g + q, or u = H^T M^-1 (H g + f) + w with M of
/// blocks 3 x 3.
pub struct Problem {
    form: Form,
    friction: Vec<f64>,
    /// V of the residual, where the file states one (dumps of runs do).
    velocity_scale: Option<f64>,
}

enum Form {
    Local { w: Entries, q: Vec<f64> },
    Global { inverse_mass: Entries, h: Entries, f: Vec<f64>, w: Vec<f64> },
}

/// (row, column, value); entries at the same place add up.
type Entries = Vec<(usize, usize, f64)>;

/// What an answer is worth.
#[derive(Debug)]
pub struct Verdict {
    pub relaxed: f64,
    pub coulomb: f64,
    pub objective: f64,
    /// max |u - u of the answer| / max |u|.
    pub velocity_error: f64,
    /// Of the residuals, by round-off: where a heavy body stands on a light one, velocities are small
    /// differences of large impulses.
    pub rounding: f64,
}

impl Problem {
    pub fn read(path: &Path) -> Self {
        if path.extension().is_some_and(|extension| extension == "hdf5") {
            read_fclib(path)
        } else {
            read_siconos(&std::fs::read_to_string(path).unwrap())
        }
    }

    /// u and the diagonal of N (columns of unit impulses would be too slow for the large ones); of a matrix
    /// that is not symmetric `own` says whether it is taken as it is.
    fn velocity(&self, g: &[f64], own: bool) -> Vec<f64> {
        match &self.form {
            Form::Local { w, q } => {
                let mut u = q.clone();
                let transposed = if own { 0.0 } else { 0.5 };
                for &(i, j, x) in w {
                    u[i] += (1.0 - transposed) * x * g[j];
                    u[j] += transposed * x * g[i];
                }
                u
            }
            Form::Global { inverse_mass, h, f, w } => {
                let mut v = f.clone();
                h.iter().for_each(|&(i, j, x)| v[i] += x * g[j]);
                let mut moved = vec![0.0; v.len()];
                inverse_mass.iter().for_each(|&(i, j, x)| moved[i] += x * v[j]);
                let mut u = w.clone();
                h.iter().for_each(|&(i, j, x)| u[j] += x * moved[i]);
                u
            }
        }
    }

    fn diagonal(&self) -> Vec<f64> {
        let mut diagonal = vec![0.0; 3 * self.friction.len()];
        match &self.form {
            Form::Local { w, .. } => {
                w.iter().filter(|(i, j, _)| i == j).for_each(|&(i, _, x)| diagonal[i] += x);
            }
            Form::Global { inverse_mass, h, f, .. } => {
                let mut columns = vec![Vec::new(); diagonal.len()];
                h.iter().for_each(|&(i, j, x)| columns[j].push((i, x)));
                let mut rows = vec![Vec::new(); f.len()];
                inverse_mass.iter().for_each(|&(i, j, x)| rows[i].push((j, x)));
                for (column, sum) in columns.iter().zip(&mut diagonal) {
                    let entry =
                        |row: usize| column.iter().filter(|(i, _)| *i == row).map(|(_, x)| x).sum::<f64>();
                    *sum = column
                        .iter()
                        .map(|&(i, x)| x * rows[i].iter().map(|&(j, m)| m * entry(j)).sum::<f64>())
                        .sum();
                }
            }
        }
        diagonal
    }

    /// Compares a solution file. Exact friction is a matter of W as the file has it, the relaxation (a
    /// minimum) of its symmetric part.
    pub fn verdict(&self, solution: &Path, exact: bool) -> Verdict {
        let text = std::fs::read_to_string(solution).unwrap();
        let mut lines = text.lines();
        let header = "contact,impulse_n,impulse_t1,impulse_t2,velocity_n,velocity_t1,velocity_t2";
        assert_eq!(lines.next(), Some(header));
        let rows: Vec<Vec<f64>> =
            lines.map(|line| line.split(',').map(|field| field.parse().unwrap()).collect()).collect();
        assert_eq!(rows.len(), self.friction.len());
        assert!(rows.iter().enumerate().all(|(i, row)| row.len() == 7 && row[0] == i as f64));
        let g: Vec<f64> = rows.iter().flat_map(|row| row[1..4].to_vec()).collect();
        let stated: Vec<f64> = rows.iter().flat_map(|row| row[4..7].to_vec()).collect();

        let (u, r) = (self.velocity(&g, exact), self.velocity(&vec![0.0; g.len()], exact));
        let eta: Vec<f64> = self.diagonal().chunks(3).map(|d| d.iter().sum::<f64>() / 3.0).collect();
        let square = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
        let bare = (r.chunks(3).map(square).sum::<f64>() / eta.len() as f64).sqrt();
        let scale = self.velocity_scale.unwrap_or(bare);
        let residual = |coulomb: f64| {
            (0..eta.len())
                .map(|i| {
                    let (g, u, mu) = (&g[3 * i..3 * i + 3], &u[3 * i..3 * i + 3], self.friction[i]);
                    let normal = u[0] + coulomb * mu * square(&u[1..]).sqrt();
                    let x = [g[0] - normal / eta[i], g[1] - u[1] / eta[i], g[2] - u[2] / eta[i]];
                    let p = project(x, mu);
                    eta[i] * square(&[g[0] - p[0], g[1] - p[1], g[2] - p[2]]).sqrt() / scale
                })
                .fold(0.0, |m: f64, x| if x.is_nan() { x } else { m.max(x) })
        };
        let largest = u.iter().fold(f64::MIN_POSITIVE, |m, x| m.max(x.abs()));
        let both = r.iter().fold(largest, |m, x| m.max(x.abs()));
        Verdict {
            relaxed: residual(0.0),
            coulomb: residual(1.0),
            objective: g.iter().zip(&u).zip(&r).map(|((g, u), r)| 0.5 * g * (u + r)).sum(),
            rounding: (0..eta.len())
                .map(|i| 4.0 * f64::EPSILON * eta[i] * square(&g[3 * i..3 * i + 3]).sqrt() / scale)
                .fold(0.0, f64::max),
            velocity_error: u.iter().zip(&stated).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs())) / both,
        }
    }
}

/// Projection on the friction cone by Moreau: x minus its projection on the polar cone's mantle where outside
/// both.
fn project(x: [f64; 3], mu: f64) -> [f64; 3] {
    let t = (x[1] * x[1] + x[2] * x[2]).sqrt();
    if t <= mu * x[0] {
        return x;
    }
    if mu * t + x[0] <= 0.0 {
        return [0.0; 3];
    }
    // Outward normal of the mantle at x: (-mu, t1, t2) / sqrt(1 + mu^2).
    let distance = (t - mu * x[0]) / (1.0 + mu * mu);
    [x[0] + mu * distance, x[1] - distance * x[1] / t, x[2] - distance * x[2] / t]
}

fn read_fclib(path: &Path) -> Problem {
    let file = hdf5_pure::File::open(path).unwrap();
    let numbers = |name: &str| file.dataset(name).unwrap().read_f64().unwrap();
    let matrix = |name: &str| {
        let integers = |field: &str| file.dataset(&format!("{name}/{field}")).unwrap().read_i64().unwrap();
        let (nz, p, i, x) = (integers("nz")[0], integers("p"), integers("i"), numbers(&format!("{name}/x")));
        if nz >= 0 {
            return (0..nz as usize).map(|k| (i[k] as usize, p[k] as usize, x[k])).collect::<Entries>();
        }
        let mut entries = Vec::new();
        for major in 0..p.len() - 1 {
            for k in p[major] as usize..p[major + 1] as usize {
                let minor = i[k] as usize;
                entries.push(if nz == -2 { (major, minor, x[k]) } else { (minor, major, x[k]) });
            }
        }
        entries
    };
    let local = file.root().groups().unwrap().contains(&"fclib_local".to_string());
    let prefix = if local { "fclib_local" } else { "fclib_global" };
    let vector = |name: &str| numbers(&format!("{prefix}/vectors/{name}"));
    let form = if local {
        Form::Local { w: matrix("fclib_local/W"), q: vector("q") }
    } else {
        let inverse_mass = invert(&matrix("fclib_global/M"), vector("f").len());
        Form::Global { inverse_mass, h: matrix("fclib_global/H"), f: vector("f"), w: vector("w") }
    };
    let velocity_scale =
        file.dataset("graintrain/velocity_scale").ok().map(|scale| scale.read_f64().unwrap()[0]);
    Problem { form, friction: vector("mu"), velocity_scale }
}

/// The inverse of a matrix of blocks 3 x 3, by the adjugate.
fn invert(m: &Entries, size: usize) -> Entries {
    let mut blocks = vec![[[0.0; 3]; 3]; size.div_ceil(3)];
    for &(i, j, x) in m {
        assert!(i / 3 == j / 3 || x == 0.0, "mass matrix of blocks expected");
        if x != 0.0 {
            blocks[i / 3][i % 3][j % 3] += x;
        }
    }
    let mut inverse = Vec::new();
    for (k, b) in blocks.iter().enumerate() {
        let minor = |i: usize, j: usize| {
            let (r, c) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
            b[r[0]][c[0]] * b[r[1]][c[1]] - b[r[0]][c[1]] * b[r[1]][c[0]]
        };
        let determinant: f64 = (0..3).map(|j| b[0][j] * minor(0, j)).sum();
        for i in 0..3 {
            for j in (0..3).filter(|&j| minor(j, i) != 0.0) {
                inverse.push((3 * k + i, 3 * k + j, minor(j, i) / determinant));
            }
        }
    }
    inverse
}

/// The words of a Siconos text file, without what CSparse prints around the numbers.
fn read_siconos(text: &str) -> Problem {
    let words: Vec<f64> = text
        .lines()
        .filter(|line| !line.starts_with("CSparse") && !line.contains("nnz:"))
        .flat_map(str::split_whitespace)
        .filter(|word| *word != ":")
        .map(|word| word.parse().unwrap())
        .collect();
    // Numbers of triplets, lost with their line, in order of appearance.
    let counts: Vec<usize> = text
        .lines()
        .filter_map(|line| line.split("nnz: ").nth(1))
        .map(|count| count.trim().parse().unwrap())
        .collect();
    let (mut at, mut triplets) = (2, counts.into_iter());
    let contacts = words[1] as usize;
    let first = matrix(&words, &mut at, &mut triplets);
    let take = |count: usize, at: &mut usize| {
        *at += count;
        words[*at - count..*at].to_vec()
    };
    if words.len() - at <= 4 * contacts + 1 {
        let q = take(3 * contacts, &mut at);
        let form = Form::Local { w: first, q };
        return Problem { form, friction: take(contacts, &mut at), velocity_scale: None };
    }
    let size = first.iter().map(|entry| entry.0).max().unwrap() + 1;
    let h = matrix(&words, &mut at, &mut triplets);
    let f = take(size, &mut at);
    let w = take(3 * contacts, &mut at);
    let form = Form::Global { inverse_mass: invert(&first, size), h, f, w };
    Problem { form, friction: take(contacts, &mut at), velocity_scale: None }
}

fn matrix(words: &[f64], at: &mut usize, triplets: &mut impl Iterator<Item = usize>) -> Entries {
    let mut next = || {
        *at += 1;
        words[*at - 1]
    };
    let (storage, rows, columns) = (next(), next() as usize, next() as usize);
    let mut entries = Vec::new();
    if storage == 0.0 {
        next();
        next();
        for k in 0..rows * columns {
            entries.push((k % rows, k / rows, next()));
        }
    } else if storage == 1.0 {
        let (blocks, down, across) = (next() as usize, next() as usize, next() as usize);
        for _ in 0..down + across + 2 {
            next();
        }
        let starts: Vec<usize> = (0..=down).map(|_| next() as usize).collect();
        let columns: Vec<usize> = (0..blocks).map(|_| next() as usize).collect();
        for i in 0..down {
            for block in starts[i]..starts[i + 1] {
                next();
                // All blocks of contact problems are 3 x 3.
                for k in 0..9 {
                    entries.push((3 * i + k % 3, 3 * columns[block] + k / 3, next()));
                }
            }
        }
    } else {
        next();
        for _ in 0..triplets.next().unwrap() {
            entries.push((next() as usize, next() as usize, next()));
        }
    }
    entries
}
