//! Pictures and replays.

use crate::arrays::owned;
use crate::error::OrRaise;
use crate::report::StepReport;
use crate::world::{World, interruptible};
use graintrain_io::files::write_atomically;
use graintrain_io::output::recorder::Recorder;
use graintrain_io::output::summary::RunStatus;
use graintrain_io::run::{Ending, RunTotals};
use graintrain_view::render::{ColorBy, Image, RenderSettings, render};
use graintrain_view::view::{RunFolder, ViewSettings, page};
use pyo3::exceptions::{PyFileExistsError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::path::PathBuf;

/// A picture, which notebooks show.
#[pyclass(frozen, module = "graintrain")]
pub struct Picture {
    image: Image,
}

impl Picture {
    fn bytes(&self) -> PyResult<Vec<u8>> {
        let mut bytes = Vec::new();
        self.image.write_png(&mut bytes).map_err(|error| PyRuntimeError::new_err(error.to_string()))?;
        Ok(bytes)
    }
}

#[pymethods]
impl Picture {
    /// The picture as a PNG file.
    #[getter]
    fn png<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        Ok(PyBytes::new(py, &self.bytes()?))
    }

    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.png(py)
    }

    /// Writes a PNG file.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        write_atomically(&path, &self.bytes()?).or_raise()
    }

    /// The pixels, (height, width, 3), uint8: for matplotlib's imshow.
    fn to_numpy<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let shape = [self.image.height, self.image.width, 3];
        Ok(owned(py, self.image.bytes(), &shape)?.into_any())
    }

    fn __repr__(&self) -> String {
        format!("<graintrain.Picture: {} x {}>", self.image.width, self.image.height)
    }
}

/// Makes the replay of a run's folder, one HTML page.
#[pyfunction]
#[pyo3(signature = (folder, path, *, max_frames=240, force_chains=true))]
pub fn replay(
    py: Python<'_>,
    folder: PathBuf,
    path: PathBuf,
    max_frames: usize,
    force_chains: bool,
) -> PyResult<()> {
    let settings = ViewSettings { max_frames: max_frames.max(1), force_chains };
    let html = py.detach(|| RunFolder::open(&folder).and_then(|run| page(&run, &settings))).or_raise()?;
    write_atomically(&path, html.as_bytes()).or_raise()
}

#[pymethods]
impl World {
    /// A picture of the present state, without a display.
    ///
    /// color: what colours stand for, "speed", "force", "radius" or "id". range: values at the ends of the
    /// colour bar. force_chains: contact forces as tubes. view: degrees around the vertical and above the
    /// horizon.
    #[pyo3(signature = (width=800, height=600, *, color="speed", range=None, force_chains=false, view=(-60.0, 24.0)))]
    fn render(
        &mut self,
        py: Python<'_>,
        width: usize,
        height: usize,
        color: &str,
        range: Option<[f64; 2]>,
        force_chains: bool,
        view: (f64, f64),
    ) -> PyResult<Picture> {
        let settings = RenderSettings {
            width,
            height,
            color: color.parse::<ColorBy>().or_raise()?,
            range,
            force_chains,
            view: [view.0, view.1],
            step: self.run().settings.stepping.step,
            bounds: None,
        };
        let state = &*self.state();
        Ok(Picture { image: py.detach(|| render(state, &settings)).or_raise()? })
    }

    fn _repr_png_<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        self.render(py, 800, 600, "speed", None, false, (-60.0, 24.0))?.png(py)
    }

    /// Runs as run() does and writes what the command line writes into a folder: frames for ParaView and
    /// OVITO every `every` steps (by default what the scene says), tables, checkpoints.
    /// graintrain.replay(folder, "x.html") makes a page of it. The folder must be new or empty, unless
    /// force=True, which replaces the files of an earlier run in it.
    #[pyo3(signature = (folder, until=None, *, steps=None, every=None, contacts=true, force=false))]
    fn record(
        &mut self,
        py: Python<'_>,
        folder: PathBuf,
        until: Option<&Bound<'_, PyAny>>,
        steps: Option<u64>,
        every: Option<u64>,
        contacts: bool,
        force: bool,
    ) -> PyResult<Option<StepReport>> {
        if every == Some(0) {
            return Err(PyValueError::new_err("every is 0; it must be at least 1"));
        }
        let target = self.target(until, steps)?;
        let run = self.run();
        let mut settings = run.settings.clone();
        settings.steps = target;
        settings.output.contacts = contacts;
        settings.output.checkpoint_every = target.max(1);
        settings.output.every = every.unwrap_or(settings.output.every);
        let taken = graintrain_io::output::folder::RunFolder::create(&folder, force)
            .map_err(|error| PyFileExistsError::new_err(error.to_string()))?;
        let text = "# made from Python: the scene is in the checkpoints\n";
        let mut recorder = Recorder::begin(taken, &settings, &run.world, text).or_raise()?;
        let stop = self.stop();
        let mut advance = self.begin()?;
        let outcome = interruptible(py, &[stop], || advance.watched_by(target, false, &mut [&mut recorder]));
        let run = self.run();
        let totals: &RunTotals = &run.totals;
        match &outcome {
            Ok(Ok(Ending::Finished)) => {
                recorder.checkpoint(&run.world, totals, RunStatus::Finished).or_raise()?;
            }
            Ok(Ok(Ending::Stopped)) | Err(_) => {
                recorder.checkpoint(&run.world, totals, RunStatus::Stopped).or_raise()?;
            }
            Ok(Err(_)) => {
                recorder.fail(&run.world, totals).or_raise()?;
            }
        }
        outcome?.or_raise()?;
        Ok(self.report())
    }

    /// Runs as run() does and makes a replay of it, one HTML page with a picture of every `every` steps (by
    /// default what the scene says): record() into a folder that is thrown away, and graintrain.replay.
    #[pyo3(signature = (path, until=None, *, steps=None, every=None, max_frames=240, force_chains=true))]
    fn replay(
        &mut self,
        py: Python<'_>,
        path: PathBuf,
        until: Option<&Bound<'_, PyAny>>,
        steps: Option<u64>,
        every: Option<u64>,
        max_frames: usize,
        force_chains: bool,
    ) -> PyResult<Option<StepReport>> {
        let holder = py.import("tempfile")?.call_method0("TemporaryDirectory")?;
        let folder = holder.getattr("name")?.extract::<PathBuf>()?.join("run");
        let report = self.record(py, folder.clone(), until, steps, every, force_chains, false)?;
        replay(py, folder, path, max_frames, force_chains)?;
        holder.call_method0("cleanup")?;
        Ok(report)
    }
}
