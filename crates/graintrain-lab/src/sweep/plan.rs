//! Which runs a sweep is made of.

use super::SweepError;
use graintrain_io::scene::{Scene, SceneError};
use serde::{Deserialize, Serialize};

/// From seed to seed: packing number k of a scene uses the seed + k, so that neighbours would share them.
const SEED_STRIDE: u64 = 1000;

/// More runs than this are a slip of the keyboard.
const MOST_RUNS: usize = 1_000_000;

/// A key of the scene and its value, as after `--set`.
pub type Setting = (String, String);

/// A sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Scene file, or name of a built-in scene.
    pub scene: String,
    /// Settings of all runs.
    pub settings: Vec<Setting>,
    /// Settings of each point, all of the same keys.
    pub points: Vec<Vec<Setting>>,
    /// Runs per point, with seeds of their own.
    pub seeds: u64,
    /// Whether the runs write frames.
    pub frames: bool,
}

/// One run of a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// Index of its point.
    pub point: usize,
    /// Number of its seed, from 0.
    pub seed: u64,
    /// Name of its folder.
    pub name: String,
    /// All of its settings.
    pub settings: Vec<Setting>,
}

/// `KEY=V1,V2,...` as after `--over`; commas in brackets or quotes belong to a value.
///
/// # Errors
/// [`SweepError::Plan`] where there is no key or no value, or a value stands twice.
pub fn over(text: &str) -> Result<(String, Vec<String>), SweepError> {
    let wrong = |why: &str| SweepError::Plan(format!("`{text}` is not of the form KEY=V1,V2,...: {why}"));
    let (key, list) = text.split_once('=').ok_or_else(|| wrong("there is no `=`"))?;
    let mut values = vec![String::new()];
    let (mut depth, mut quoted) = (0_i64, false);
    for c in list.chars() {
        match c {
            '"' | '\'' => quoted = !quoted,
            '[' | '{' | '(' => depth += 1,
            ']' | '}' | ')' => depth -= 1,
            _ => {}
        }
        match values.last_mut() {
            Some(value) if c != ',' || quoted || depth > 0 => value.push(c),
            _ => values.push(String::new()),
        }
    }
    let values: Vec<String> = values.iter().map(|value| value.trim().to_string()).collect();
    if key.trim().is_empty() || values.iter().any(String::is_empty) {
        return Err(wrong("a key or value is empty"));
    }
    for (k, value) in values.iter().enumerate() {
        if values[..k].contains(value) {
            return Err(wrong(&format!("the value {value} stands twice")));
        }
    }
    Ok((key.trim().to_string(), values))
}

/// All combinations of the values of the keys, the last key changing fastest; one point without keys where
/// there are none.
///
/// # Errors
/// [`SweepError::Plan`] for a key that stands twice, or far too many points.
pub fn grid(keys: &[(String, Vec<String>)]) -> Result<Vec<Vec<Setting>>, SweepError> {
    let mut points: Vec<Vec<Setting>> = vec![Vec::new()];
    for (k, (key, values)) in keys.iter().enumerate() {
        if keys[..k].iter().any(|(known, _)| known == key) {
            return Err(SweepError::Plan(format!("the key {key} stands twice")));
        }
        if points.len().saturating_mul(values.len()) > MOST_RUNS {
            return Err(SweepError::Plan(format!("there would be more than {MOST_RUNS} runs")));
        }
        let with = |point: &Vec<Setting>, value: &String| {
            let mut point = point.clone();
            point.push((key.clone(), value.clone()));
            point
        };
        points = points.iter().flat_map(|point| values.iter().map(move |value| with(point, value))).collect();
    }
    Ok(points)
}

/// The points of a CSV file: keys in the header, a point per line.
///
/// # Errors
/// [`SweepError::Plan`] for lines that do not fit the header, no lines, or the same point twice.
pub fn table(text: &str) -> Result<Vec<Vec<Setting>>, SweepError> {
    let text = text.trim_start_matches('\u{feff}');
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let keys = lines.next().map(|(number, line)| fields(line, number + 1)).transpose()?.unwrap_or_default();
    if let Some((_, key)) = keys.iter().enumerate().find(|(k, key)| keys[..*k].contains(key)) {
        return Err(SweepError::Plan(format!("the header names the key `{key}` twice")));
    }
    let mut points: Vec<Vec<Setting>> = Vec::new();
    for (number, line) in lines {
        let number = number + 1;
        let values = fields(line, number)?;
        if values.len() != keys.len() || values.iter().any(String::is_empty) {
            let problem = format!("line {number} does not give each key of the header one value");
            return Err(SweepError::Plan(problem));
        }
        let point: Vec<Setting> = keys.iter().cloned().zip(values).collect();
        if points.contains(&point) {
            return Err(SweepError::Plan(format!("line {number} is a point that was already there")));
        }
        points.push(point);
    }
    if points.is_empty() || keys.iter().any(String::is_empty) {
        return Err(SweepError::Plan("the table needs a header of keys and a line per point".into()));
    }
    Ok(points)
}

/// The fields of a line of a CSV file; one in quotes may hold commas, and two quotes for one.
fn fields(line: &str, number: usize) -> Result<Vec<String>, SweepError> {
    let mut fields = Vec::new();
    let mut rest = line;
    loop {
        rest = rest.trim_start();
        let mut field = String::new();
        if let Some(mut inside) = rest.strip_prefix('"') {
            loop {
                let Some((text, after)) = inside.split_once('"') else {
                    return Err(SweepError::Plan(format!("line {number}: a quote is not closed")));
                };
                field += text;
                match after.strip_prefix('"') {
                    Some(more) => {
                        field.push('"');
                        inside = more;
                    }
                    None => {
                        rest = after.trim_start();
                        break;
                    }
                }
            }
            if !(rest.is_empty() || rest.starts_with(',')) {
                return Err(SweepError::Plan(format!("line {number}: `{rest}` follows a closed quote")));
            }
        } else {
            let end = rest.find(',').unwrap_or(rest.len());
            field += rest[..end].trim();
            rest = &rest[end..];
        }
        fields.push(field);
        match rest.strip_prefix(',') {
            Some(more) => rest = more,
            None => return Ok(fields),
        }
    }
}

/// Values of a point for people: `mu=0.1, n=4`.
pub fn label(point: &[Setting]) -> String {
    if point.is_empty() {
        return "the scene as it is".into();
    }
    point.iter().map(|(key, value)| format!("{key}={value}")).collect::<Vec<_>>().join(", ")
}

/// The same as the name of a folder: what may stand in one stays, the rest becomes `_`; with a number of its
/// bits where that made a difference.
fn folder_name(point: &[Setting], seed: u64) -> String {
    let plain: String = point.iter().map(|(key, value)| format!("{key}={value},")).collect();
    let safe = |c: char| if c.is_ascii_alphanumeric() || "=.,-+".contains(c) { c } else { '_' };
    let mut name: String = plain.chars().map(safe).collect();
    if name != plain || name.len() > 150 {
        let bits = plain.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
        });
        name.truncate(150);
        name += &format!("{:08x},", bits >> 32);
    }
    name + &format!("seed={seed}")
}

impl Plan {
    /// Keys that change from point to point.
    pub fn keys(&self) -> Vec<&str> {
        self.points.first().map_or(Vec::new(), |point| point.iter().map(|(key, _)| key.as_str()).collect())
    }

    /// All runs, seed by seed, so that a sweep that is stopped has all points once before it has one of them
    /// twice.
    ///
    /// # Errors
    /// [`SweepError::Scene`] where the scene itself cannot be read; [`SweepError::Plan`] where there are too
    /// many runs.
    pub fn cells(&self) -> Result<Vec<Cell>, SweepError> {
        if self.points.len().saturating_mul(self.seeds as usize) > MOST_RUNS {
            return Err(SweepError::Plan(format!("there would be more than {MOST_RUNS} runs")));
        }
        let mut cells = Vec::new();
        for seed in 0..self.seeds {
            for point in 0..self.points.len() {
                cells.push(self.cell(point, seed)?);
            }
        }
        Ok(cells)
    }

    /// The run of a point with its seed of this number, from 0.
    ///
    /// # Errors
    /// [`SweepError::Scene`] where the scene itself cannot be read.
    pub fn cell(&self, point: usize, seed: u64) -> Result<Cell, SweepError> {
        let mut settings = [self.settings.clone(), self.points[point].clone()].concat();
        let base = self.load(&self.points[point], &[])?.seed;
        if seed > 0 {
            settings.push(("seed".into(), base.wrapping_add(SEED_STRIDE * seed).to_string()));
        }
        if !self.frames {
            settings.extend(["output.bodies", "output.contacts"].map(|key| (key.into(), "false".into())));
        }
        Ok(Cell { point, seed, name: folder_name(&self.points[point], seed), settings })
    }

    /// The scene of a point with more settings.
    ///
    /// # Errors
    /// [`SweepError::Scene`].
    pub fn load(&self, point: &[Setting], more: &[Setting]) -> Result<Scene, SweepError> {
        let settings = [self.settings.as_slice(), point, more].concat();
        let wrong = |error: SceneError| SweepError::Scene { point: label(point), error: Box::new(error) };
        Scene::load(&self.scene, &settings).map_err(wrong)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_and_tables() {
        let keys = [over("mu=0.1, 0.3").unwrap(), over("box=[1,2],[3,4],\"a,b\"").unwrap()];
        assert_eq!(keys[1].1, ["[1,2]", "[3,4]", "\"a,b\""]);
        let points = grid(&keys).unwrap();
        assert_eq!(points.len(), 6);
        assert_eq!(label(&points[1]), "mu=0.1, box=[3,4]");
        assert_eq!(grid(&[]).unwrap(), [Vec::new()]);
        let rows = table("mu, n\n0.1,4\n\n0.3,8\n").unwrap();
        assert_eq!(label(&rows[1]), "mu=0.3, n=8");
        for bad in ["mu", "=1", "mu=", "mu=1,,2", "mu=1,1"] {
            assert!(over(bad).is_err(), "{bad}");
        }
        let quoted = table("size,\"a\"\n \"[1, 2]\" ,\"say \"\"x\"\"\"\n3,4\n").unwrap();
        assert_eq!(label(&quoted[0]), "size=[1, 2], a=say \"x\"");
        let again = table("mu,n,mu\n1,2,3\n").unwrap_err().to_string();
        assert!(again.contains("`mu` twice"), "{again}");
        for bad in ["", "mu,n\n", "mu,n\n1\n", "mu\n1\n1\n", "mu,\n1,2\n", "mu\n\"1\n", "mu\n\"1\"2\n"] {
            assert!(table(bad).is_err(), "{bad}");
        }
        assert!(grid(&[keys[0].clone(), keys[0].clone()]).is_err());
    }

    #[test]
    fn folders_of_different_points_differ() {
        let set = |value: &str| vec![("a".to_string(), value.to_string())];
        let names = ["1 m", "1_m", "1/m", "1"].map(|value| folder_name(&set(value), 2));
        assert!(names.iter().all(|name| !name.contains('/') && name.ends_with("seed=2")));
        for (k, name) in names.iter().enumerate() {
            assert!(!names[..k].contains(name), "{name}");
        }
        assert_eq!(names[3], "a=1,seed=2");
    }
}
