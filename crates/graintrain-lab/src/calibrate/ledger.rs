//! What a calibration asked and where it ran, on disk before the runs begin.

use super::inference::Observation;
use super::observe::Aims;
use super::question::Question;
use crate::sweep::execute::{make_own_folder, write};
use crate::sweep::{SweepError, read_table};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const QUESTION: &str = "question.json";
const LEDGER: &str = "ledger.csv";

/// The points of a calibration, in `ledger.csv`; its question, in `question.json`.
#[derive(Clone, Debug)]
pub struct Ledger {
    folder: PathBuf,
    question: Question,
    /// Points of the unit cube, in the order in which they were chosen.
    pub points: Vec<Vec<f64>>,
    /// Number of the round of each.
    rounds: Vec<usize>,
}

impl Ledger {
    /// The ledger of a folder, or a new one.
    ///
    /// # Errors
    /// [`SweepError::Plan`] where the folder holds another question; [`SweepError::Read`] for files that are
    /// damaged; [`SweepError::Occupied`]; [`SweepError::Output`].
    pub fn open(folder: &Path, question: &Question) -> Result<Self, SweepError> {
        let (asked, path) = (folder.join(QUESTION), folder.join(LEDGER));
        let mut ledger = Self {
            folder: folder.to_path_buf(),
            question: question.clone(),
            points: Vec::new(),
            rounds: Vec::new(),
        };
        if !asked.exists() {
            make_own_folder(folder)?;
            let text = serde_json::to_string_pretty(question).map_err(|error| unreadable(&asked, error))?;
            write(&asked, &(text + "\n"))?;
            return Ok(ledger);
        }
        let text = std::fs::read_to_string(&asked).map_err(|error| unreadable(&asked, error))?;
        let before: Question = serde_json::from_str(&text).map_err(|error| {
            let remedy = "remove it and ledger.csv to begin anew; runs that are there are kept";
            unreadable(&asked, format!("it is damaged ({error}): {remedy}"))
        })?;
        // More points may be asked for.
        if (Question { most_points: question.most_points, ..before }) != *question {
            return Err(SweepError::Plan(format!(
                "{} holds a calibration of other parameters, ranges, targets or settings: choose another folder with --out, or remove it",
                folder.display()
            )));
        }
        if path.exists() {
            ledger.read(&path)?;
        }
        Ok(ledger)
    }

    fn read(&mut self, path: &Path) -> Result<(), SweepError> {
        let table = read_table(path)?;
        let column = |name: &str| {
            let numbers = table.numbers(name).filter(|list| list.iter().all(|x| x.is_finite()));
            numbers.filter(|_| table.odd_lines == 0).ok_or_else(|| {
                unreadable(path, format!("it is damaged (column `{name}`): remove it to begin anew; runs that are there are kept"))
            })
        };
        self.rounds = column("round")?.into_iter().map(|round| round as usize).collect();
        let values: Vec<Vec<f64>> = self
            .question
            .parameters
            .iter()
            .map(|parameter| column(&parameter.key))
            .collect::<Result<_, _>>()?;
        let coordinates = |k: usize| {
            let each = self.question.parameters.iter().zip(&values);
            each.map(|(parameter, list)| parameter.coordinate(list[k])).collect()
        };
        self.points = (0..self.rounds.len()).map(coordinates).collect();
        Ok(())
    }

    /// Adds the points of a round, and has them on disk.
    ///
    /// # Errors
    /// [`SweepError::Output`].
    pub fn add(&mut self, points: Vec<Vec<f64>>) -> Result<(), SweepError> {
        let round = self.rounds.last().map_or(0, |round| round + 1);
        self.rounds.extend(std::iter::repeat_n(round, points.len()));
        self.points.extend(points);
        let keys = self.question.parameters.iter().map(|parameter| parameter.key.clone());
        let mut text =
            ["point".to_string(), "round".to_string()].into_iter().chain(keys).collect::<Vec<_>>().join(",");
        text.push('\n');
        for (k, point) in self.points.iter().enumerate() {
            let values = self.question.settings(point).into_iter().map(|(_, value)| value);
            let record = [k.to_string(), self.rounds[k].to_string()].into_iter().chain(values);
            let _ = writeln!(text, "{}", record.collect::<Vec<_>>().join(","));
        }
        write(&self.folder.join(LEDGER), &text)?;
        Ok(())
    }

    /// Writes `observed.csv`: what every run said of every aim.
    ///
    /// # Errors
    /// [`SweepError::Output`].
    pub fn conclude(
        &self,
        question: &Question,
        aims: &Aims,
        observations: &[Observation],
    ) -> Result<(), SweepError> {
        let keys = question.parameters.iter().map(|parameter| parameter.key.clone());
        let labels =
            aims.elements.iter().map(|element| format!("\"{}\"", element.label.replace('"', "\"\"")));
        let mut text = keys.chain(labels).collect::<Vec<_>>().join(",") + "\n";
        for run in observations {
            let values = question.settings(&run.point).into_iter().map(|(_, value)| value);
            let found =
                run.values.iter().map(|x| if x.is_finite() { format!("{x:?}") } else { String::new() });
            let _ = writeln!(text, "{}", values.chain(found).collect::<Vec<_>>().join(","));
        }
        write(&self.folder.join("observed.csv"), &text)?;
        Ok(())
    }
}

fn unreadable(path: &Path, reason: impl ToString) -> SweepError {
    SweepError::Read { path: path.to_path_buf(), reason: reason.to_string() }
}

#[cfg(test)]
mod tests {
    use super::super::question::{Parameter, Target};
    use super::*;
    use crate::sweep::plan::Plan;

    #[test]
    fn points_come_back_from_disk() {
        let plan =
            Plan { scene: "stack".into(), settings: Vec::new(), points: Vec::new(), seeds: 1, frames: false };
        let question = Question {
            plan,
            parameters: vec![
                Parameter::parse("mu=0.1..0.8").unwrap(),
                Parameter::parse("load=log:1..1e6").unwrap(),
            ],
            targets: vec![Target::Value { observable: "a.b".into(), value: 1.0, error: 0.1 }],
            from: None,
            batch: 4,
            most_points: 20,
        };
        let folder = tempfile::tempdir().unwrap();
        let mut ledger = Ledger::open(folder.path(), &question).unwrap();
        let points: Vec<Vec<f64>> =
            (0..5).map(|k| question.rounded(&super::super::quasi_random::halton(k, 2))).collect();
        ledger.add(points[..3].to_vec()).unwrap();
        ledger.add(points[3..].to_vec()).unwrap();
        let again = Ledger::open(folder.path(), &Question { most_points: 40, ..question.clone() }).unwrap();
        assert_eq!((again.points, again.rounds), (ledger.points.clone(), vec![0, 0, 0, 1, 1]));
        let other = Question { batch: 5, ..question.clone() };
        assert!(Ledger::open(folder.path(), &other).unwrap_err().to_string().contains("other parameters"));
        let asked = folder.path().join(QUESTION);
        let whole = std::fs::read_to_string(&asked).unwrap();
        std::fs::write(&asked, &whole[..whole.len() / 2]).unwrap();
        assert!(Ledger::open(folder.path(), &question).unwrap_err().to_string().contains("remove it and"));
        std::fs::write(&asked, &whole).unwrap();
        std::fs::write(folder.path().join(LEDGER), "point,round,mu\n0,0,x\n").unwrap();
        assert!(Ledger::open(folder.path(), &question).unwrap_err().to_string().contains("damaged"));
    }
}
