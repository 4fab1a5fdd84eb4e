//! Worlds: made from scenes, in code or from checkpoints, and stepped.

use crate::arrays::{Leases, is_unit, no_rotation, readable, vector, writable};
use crate::contacts::Contacts;
use crate::error::OrRaise;
use crate::plain::plain;
use crate::report::StepReport;
use graintrain::assemble::OverlapCorrection;
use graintrain::handle::GeometryId;
use graintrain::stepper::{self, SolverChoice, StepSettings};
use graintrain_ccp::{Criterion, FrictionModel, SolverSpec};
use graintrain_io::checkpoint;
use graintrain_io::files::OutputError;
use graintrain_io::run::{Ending, Observer, Run, RunError, RunSettings, RunTotals, StepView};
use graintrain_io::scene::{Scene, seconds, setting};
use graintrain_io::settings::{OutputSettings, Precision};
use numpy::PyArrayMethods;
use pyo3::exceptions::{PyIndexError, PyKeyError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long a signal may wait for an answer while a run is under way.
const PATIENCE: Duration = Duration::from_millis(50);

/// Bodies, what acts on them, and how their steps are made.
///
/// World() is empty: bodies are added in code. World.from_scene("file.toml") reads a scene. Arrays such as
/// positions look into the world's memory: what is written into them is the state of the next step, and they
/// follow the world as it steps.
#[pyclass(module = "graintrain")]
pub struct World {
    /// Behind a lock only because solvers are not made for sharing: whoever calls a method holds the world
    /// alone.
    run: Mutex<Run>,
    stop: Arc<AtomicBool>,
    pub(crate) leases: Leases,
    /// Geometries that shapes have become, by the shapes' numbers.
    pub(crate) geometries: HashMap<u64, GeometryId>,
    report: Option<stepper::StepReport>,
    contacts: Option<Py<Contacts>>,
}

/// Keeps the report of the last step.
#[derive(Default)]
struct LastReport(Option<stepper::StepReport>);

impl Observer for LastReport {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        self.0 = Some(step.report.clone());
        Ok(())
    }
}

/// A run that has been taken out of a world for a while, with what stops it.
pub(crate) struct Advance<'a> {
    run: &'a mut Run,
    report: &'a mut Option<stepper::StepReport>,
}

impl Advance<'_> {
    /// Steps until the number of steps done is `target`.
    pub(crate) fn to(&mut self, target: u64, strict: bool) -> Result<Ending, RunError> {
        self.watched_by(target, strict, &mut [])
    }

    /// As [`Self::to`], watched.
    pub(crate) fn watched_by(
        &mut self,
        target: u64,
        strict: bool,
        observers: &mut [&mut dyn Observer],
    ) -> Result<Ending, RunError> {
        let end = std::mem::replace(&mut self.run.settings.steps, target);
        self.run.strict = strict;
        let mut last = LastReport::default();
        let mut all: Vec<&mut dyn Observer> = vec![&mut last];
        all.extend(observers.iter_mut().map(|observer| &mut **observer as &mut dyn Observer));
        let ending = self.run.advance(&mut all);
        self.run.settings.steps = end;
        if last.0.is_some() {
            *self.report = last.0;
        }
        ending
    }
}

/// Does the work on a thread of its own, without the interpreter's lock, and looks for signals meanwhile: one
/// whose handler raises (Ctrl-C) sets the flags.
pub(crate) fn interruptible<T: Send>(
    py: Python<'_>,
    stops: &[Arc<AtomicBool>],
    work: impl FnOnce() -> T + Send,
) -> PyResult<T> {
    stops.iter().for_each(|stop| stop.store(false, Ordering::Relaxed));
    let mut interruption = None;
    let result = py.detach(|| {
        std::thread::scope(|scope| {
            let (done, waiting) = channel::<()>();
            let worker = scope.spawn(move || {
                // Dropped at the end, by a panic too: that ends the wait.
                let _done = done;
                work()
            });
            while waiting.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
                if let Err(raised) = Python::attach(|py| py.check_signals()) {
                    stops.iter().for_each(|stop| stop.store(true, Ordering::Relaxed));
                    interruption = Some(raised);
                    break;
                }
            }
            worker.join()
        })
    });
    match (interruption, result) {
        (_, Err(panic)) => std::panic::resume_unwind(panic),
        (Some(raised), _) => Err(raised),
        (None, Ok(value)) => Ok(value),
    }
}

/// As [`interruptible`] for work that is known to be short: without a thread, which costs more than a step of
/// a small world.
fn brief<T: Send>(py: Python<'_>, stop: &AtomicBool, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    stop.store(false, Ordering::Relaxed);
    let result = py.detach(work);
    py.check_signals()?;
    Ok(result)
}

impl World {
    fn new(world: graintrain::world::World, settings: RunSettings, totals: RunTotals) -> PyResult<Self> {
        let stop = Arc::<AtomicBool>::default();
        let run = Run::new(world, settings, totals, Arc::clone(&stop)).or_raise()?;
        Ok(Self {
            run: Mutex::new(run),
            stop,
            leases: Leases::default(),
            geometries: HashMap::new(),
            report: None,
            contacts: None,
        })
    }

    /// The world of a scene, ready to be stepped.
    pub(crate) fn of_scene(scene: &Scene) -> PyResult<Self> {
        let simulation = scene.build().or_raise()?;
        let settings = RunSettings::new(&simulation, None);
        Self::new(simulation.world, settings, RunTotals::default())
    }

    pub(crate) fn run(&mut self) -> &mut Run {
        self.run.get_mut().unwrap_or_else(PoisonError::into_inner)
    }

    /// The state.
    pub(crate) fn state(&mut self) -> &mut graintrain::world::World {
        &mut self.run().world
    }

    pub(crate) fn stop(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.stop)
    }

    /// Ready to step: what was written into arrays is checked, what is known of the last step forgotten.
    pub(crate) fn begin(&mut self) -> PyResult<Advance<'_>> {
        let turns = &self.state().bodies.orientation;
        if let Some(body) = turns.iter().position(|&q| !is_unit(q)) {
            return Err(no_rotation(&format!("quaternions[{body}]"), turns[body]));
        }
        // Single precision leaves them longer by 1e-7 than a state may keep.
        let turns = &mut self.state().bodies.orientation;
        turns.iter_mut().filter(|q| (q.length() - 1.0).abs() > 1e-12).for_each(|q| *q = q.normalize());
        self.contacts = None;
        if self.run().changes_bodies() {
            self.leases.refuse_resize()?;
        }
        let run = self.run.get_mut().unwrap_or_else(PoisonError::into_inner);
        Ok(Advance { run, report: &mut self.report })
    }

    /// Before bodies are added or removed.
    pub(crate) fn resize(&mut self) -> PyResult<&mut graintrain::world::World> {
        self.leases.refuse_resize()?;
        self.contacts = None;
        Ok(self.state())
    }

    /// The index of a body given by its index, negative ones counted from the end, or by its name.
    pub(crate) fn index_of(&mut self, body: &Bound<'_, PyAny>) -> PyResult<usize> {
        let bodies = &self.state().bodies;
        if let Ok(name) = body.extract::<String>() {
            let found = bodies.name.iter().position(|known| *known == name);
            return found.ok_or_else(|| {
                let mut known: Vec<&str> =
                    bodies.name.iter().map(String::as_str).filter(|name| !name.is_empty()).collect();
                known.dedup();
                known.truncate(20);
                PyKeyError::new_err(format!(
                    "there is no body named '{name}'; named are: {}",
                    known.join(", ")
                ))
            });
        }
        let len = bodies.len();
        let index: i64 = body
            .extract()
            .map_err(|_| PyTypeError::new_err("a body is given by its index (int) or its name (str)"))?;
        let counted = if index < 0 { index + len as i64 } else { index };
        usize::try_from(counted).ok().filter(|&index| index < len).ok_or_else(|| {
            PyIndexError::new_err(format!("there is no body {index}; the world has {len}, counted from 0"))
        })
    }

    /// The number of steps that a run has to reach.
    pub(crate) fn target(&mut self, until: Option<&Bound<'_, PyAny>>, steps: Option<u64>) -> PyResult<u64> {
        let run = self.run();
        match (until, steps) {
            (Some(_), Some(_)) => Err(PyValueError::new_err("give either until or steps, not both")),
            (None, Some(steps)) => Ok(run.world.step.saturating_add(steps)),
            (None, None) if run.settings.steps == 0 => Err(PyValueError::new_err(
                "this world was built in code and has no end of its own: give until (a time) or steps",
            )),
            (None, None) => Ok(run.settings.steps),
            (Some(until), None) => {
                let end = match until.extract::<String>() {
                    Ok(text) => seconds(&text)
                        .map_err(|problem| PyValueError::new_err(format!("until = '{text}': {problem}")))?,
                    Err(_) => until.extract::<f64>()?,
                };
                if !end.is_finite() {
                    return Err(PyValueError::new_err(format!("until is {end}; it must be finite")));
                }
                // Whole steps up to round-off, as in scenes.
                let ratio = (end - run.world.time) / run.settings.stepping.step;
                let steps = (ratio - 1e-9 * ratio.abs().max(1.0)).ceil().max(0.0) as u64;
                Ok(run.world.step.saturating_add(steps))
            }
        }
    }
}

/// A friction model by its name.
pub(crate) fn friction_model(name: &str) -> PyResult<FrictionModel> {
    let found = FrictionModel::NAMES.iter().find(|(known, _)| *known == name);
    found
        .map(|&(_, model)| model)
        .ok_or_else(|| PyValueError::new_err(format!("friction = '{name}': choose relaxed or coulomb")))
}

/// Settings of the steps of a world made in code, or the changed ones of another.
fn changed(settings: &mut StepSettings, changes: &Bound<'_, PyDict>) -> PyResult<()> {
    const KNOWN: &str = "step, envelope, solver, tolerance, strict_max, max_iterations, friction, overlap";
    for (key, value) in changes.iter() {
        let key: String = key.extract()?;
        let solver = &mut settings.solver;
        match key.as_str() {
            "step" => settings.step = value.extract()?,
            "envelope" => settings.envelope = value.extract()?,
            "solver" => solver.name = value.extract::<String>()?.parse::<SolverSpec>().or_raise()?,
            "tolerance" => solver.tolerance = value.extract()?,
            "strict_max" => {
                solver.criterion = if value.extract()? { Criterion::Maximum } else { Criterion::Mixed };
            }
            "max_iterations" => solver.max_iterations = value.extract()?,
            "friction" => solver.friction = friction_model(&value.extract::<String>()?)?,
            "overlap" => {
                settings.overlap = match value.extract::<String>()?.as_str() {
                    "position" => OverlapCorrection::Position,
                    "velocity" => OverlapCorrection::Velocity,
                    other => {
                        let text = format!("overlap = '{other}': choose position or velocity");
                        return Err(PyValueError::new_err(text));
                    }
                }
            }
            _ => return Err(PyTypeError::new_err(format!("unknown setting '{key}'; known: {KNOWN}"))),
        }
    }
    Ok(())
}

/// The settings of `set=`: a dict, or texts of the form KEY=VALUE.
pub(crate) fn overrides(set: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<(String, String)>> {
    let Some(set) = set else { return Ok(Vec::new()) };
    let texts: Vec<String> =
        set.py().import("graintrain._scene")?.call_method1("settings", (set,))?.extract()?;
    texts.iter().map(|text| setting(text).or_raise()).collect()
}

/// A scene from a file, the name of a built-in scene, or a dict.
pub(crate) fn scene_of(scene: &Bound<'_, PyAny>, set: Option<&Bound<'_, PyAny>>) -> PyResult<Scene> {
    let set = overrides(set)?;
    if scene.cast::<PyDict>().is_ok() {
        let text: String =
            scene.py().import("graintrain._scene")?.call_method1("text", (scene,))?.extract()?;
        return Scene::parse("dict", "dict", &text, Path::new(""), &set).or_raise();
    }
    let path: PathBuf = scene
        .extract()
        .map_err(|_| PyTypeError::new_err("a scene is a path, the name of a built-in scene, or a dict"))?;
    Scene::load(&path.to_string_lossy(), &set).or_raise()
}

/// A getter of a list of the bodies.
macro_rules! list {
    ($slf:expr, $view:ident, $list:ident) => {{
        let owner = $slf.clone().into_any();
        let mut world = $slf.try_borrow_mut()?;
        let leases = world.leases.clone();
        $view(&owner, &leases, &mut world.state().bodies.$list)
    }};
}

/// A setter of all of such a list: world.positions = x, and what makes world.positions += x work.
fn assign(array: &Bound<'_, PyAny>, value: &Bound<'_, PyAny>) -> PyResult<()> {
    if array.is(value) {
        return Ok(());
    }
    array.set_item(pyo3::types::PyEllipsis::get(array.py()), value)
}

/// Bodies, corners of their triangles, kind.
type Surface<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, &'static str);

#[pymethods]
impl World {
    /// An empty world.
    ///
    /// gravity: m/s^2. settings: step (time step, s), envelope (m), solver, tolerance, strict_max,
    /// max_iterations, friction ("relaxed" or "coulomb"), overlap ("position" or "velocity"); see `settings`.
    #[new]
    #[pyo3(signature = (*, gravity=None, **settings))]
    fn empty(gravity: Option<&Bound<'_, PyAny>>, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut stepping = StepSettings::default();
        if let Some(settings) = settings {
            changed(&mut stepping, settings)?;
        }
        let mut world = graintrain::world::World::default();
        if let Some(gravity) = gravity {
            world.gravity = vector("gravity", gravity)?;
        }
        let output = OutputSettings {
            every: 1,
            bodies: true,
            contacts: false,
            precision: Precision::default(),
            checkpoint_every: 1,
        };
        let settings = RunSettings {
            scene: "python".to_string(),
            stepping,
            steps: 0,
            output,
            open_boundaries: Default::default(),
            dump_problem_every: None,
            measures: Vec::new(),
            stages: Vec::new(),
        };
        Self::new(world, settings, RunTotals::default())
    }

    /// The world of a scene: a TOML file, the name of a built-in scene, or a dict with the same keys.
    ///
    /// set: changes, as --set of the command line: {"n": 4, "time.step": "1 ms"} or ["n=4"].
    #[staticmethod]
    #[pyo3(signature = (scene, set=None))]
    fn from_scene(scene: &Bound<'_, PyAny>, set: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        Self::of_scene(&scene_of(scene, set)?)
    }

    /// The world of a scene given as TOML text; relative paths in it start at `folder`.
    #[staticmethod]
    #[pyo3(signature = (text, set=None, folder=PathBuf::new()))]
    fn from_text(text: &str, set: Option<&Bound<'_, PyAny>>, folder: PathBuf) -> PyResult<Self> {
        let settings = overrides(set)?;
        Self::of_scene(&Scene::parse("text", "text", text, &folder, &settings).or_raise()?)
    }

    /// The world of a checkpoint, as to_bytes gives it, or as the command line writes it into a run's folder.
    #[staticmethod]
    fn from_bytes(data: &[u8]) -> PyResult<Self> {
        let read = checkpoint::from_bytes(data, "data").or_raise()?;
        Self::new(read.world, read.settings, read.totals)
    }

    /// Everything needed to go on, bit for bit: a checkpoint as bytes.
    fn to_bytes<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyBytes>> {
        let mut world = slf.try_borrow_mut()?;
        let run = world.run();
        let bytes = checkpoint::to_bytes(&run.settings, &run.totals, &run.world)?;
        Ok(PyBytes::new(slf.py(), &bytes))
    }

    /// Another world with the same state and settings.
    fn copy(&mut self) -> PyResult<Self> {
        let run = self.run();
        let mut copy = Self::new(run.world.clone(), run.settings.clone(), run.totals.clone())?;
        copy.geometries = self.geometries.clone();
        Ok(copy)
    }

    fn __copy__(&mut self) -> PyResult<Self> {
        self.copy()
    }

    fn __deepcopy__(&mut self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.copy()
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        Ok((slf.get_type().getattr("from_bytes")?, (Self::to_bytes(slf)?,)))
    }

    fn __len__(&mut self) -> usize {
        self.state().bodies.len()
    }

    fn __repr__(&mut self) -> String {
        let state = self.state();
        format!(
            "<graintrain.World: {} bodies, t = {:.6} s, step {}>",
            state.bodies.len(),
            state.time,
            state.step
        )
    }

    /// Makes `steps` time steps and returns the report of the last one.
    #[pyo3(signature = (steps=1))]
    fn step(&mut self, py: Python<'_>, steps: u64) -> PyResult<Option<StepReport>> {
        let stop = self.stop();
        let mut advance = self.begin()?;
        let target = advance.run.world.step.saturating_add(steps);
        let work = || advance.to(target, false);
        let outcome = if steps > 1 { interruptible(py, &[stop], work) } else { brief(py, &stop, work) };
        outcome?.or_raise()?;
        Ok(self.report())
    }

    /// Steps until a time (s, or a text such as "20 ms"), for a number of steps, or to the end that the scene
    /// names.
    ///
    /// callback(world) is called after every `every` steps and after the last; it may read and write the
    /// state, and ends the run by returning True. With strict=True a solve that does not reach its tolerance
    /// raises NotConverged. Ctrl-C raises KeyboardInterrupt and leaves the state after the last complete
    /// step. Other Python threads run meanwhile; they must leave this world alone.
    #[pyo3(name = "run", signature = (until=None, *, steps=None, callback=None, every=1, strict=false))]
    fn run_until(
        slf: &Bound<'_, Self>,
        until: Option<&Bound<'_, PyAny>>,
        steps: Option<u64>,
        callback: Option<&Bound<'_, PyAny>>,
        every: u64,
        strict: bool,
    ) -> PyResult<Option<StepReport>> {
        let py = slf.py();
        if every == 0 {
            return Err(PyValueError::new_err("every is 0; it must be at least 1"));
        }
        let target = slf.try_borrow_mut()?.target(until, steps)?;
        // Steps between two calls back, while they are quick, are made here.
        let mut quick = false;
        loop {
            let mut world = slf.try_borrow_mut()?;
            let done = world.state().step;
            if done >= target {
                return Ok(world.report());
            }
            let next = if callback.is_some() { target.min(done.saturating_add(every)) } else { target };
            let stop = world.stop();
            let mut advance = world.begin()?;
            let begin = Instant::now();
            let work = || advance.to(next, strict);
            let outcome = if quick { brief(py, &stop, work) } else { interruptible(py, &[stop], work) };
            let ending = outcome?.or_raise()?;
            // The last stage of a scene may end before the steps that were asked for.
            let is_over = ending == Ending::Finished && world.state().step < next;
            quick = callback.is_some() && begin.elapsed() < PATIENCE;
            drop(world);
            if let Some(callback) = callback
                && callback.call1((slf,))?.extract::<bool>().unwrap_or(false)
            {
                return Ok(slf.try_borrow_mut()?.report());
            }
            if is_over {
                return Ok(slf.try_borrow_mut()?.report());
            }
        }
    }

    /// Report of the last step, or None before the first.
    #[getter]
    fn last_report(&mut self) -> Option<StepReport> {
        self.report()
    }

    /// Changes how steps are made: step, envelope, solver, tolerance, strict_max, max_iterations, friction,
    /// overlap.
    #[pyo3(signature = (**settings))]
    fn configure(&mut self, settings: Option<&Bound<'_, PyDict>>) -> PyResult<()> {
        let stop = self.stop();
        let run = self.run();
        let mut new = run.settings.clone();
        if let Some(changes) = settings {
            changed(&mut new.stepping, changes)?;
        }
        let ratio = run.settings.stepping.step / new.stepping.step;
        if ratio != 1.0 && new.steps > 0 && ratio.is_finite() {
            if !new.stages.is_empty() {
                return Err(PyValueError::new_err(
                    "step: the stages of this scene are counted in steps of the one it was made with; give time.step in `set` of from_scene",
                ));
            }
            // The end stays where it is in time.
            let left = new.steps.saturating_sub(run.world.step) as f64 * ratio;
            new.steps = run.world.step.saturating_add(left.round() as u64);
        }
        // The state is handed over only once nothing can fail any more.
        let empty = graintrain::world::World::default();
        let mut fresh = Run::new(empty, new, run.totals.clone(), stop).or_raise()?;
        std::mem::swap(&mut fresh.world, &mut run.world);
        *run = fresh;
        Ok(())
    }

    /// How steps are made, as a dict.
    #[getter]
    fn settings<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let StepSettings { step, envelope, solver, overlap } = self.run().settings.stepping.clone();
        let SolverChoice { name, tolerance, criterion, max_iterations, friction } = solver;
        let dict = PyDict::new(py);
        dict.set_item("step", step)?;
        dict.set_item("envelope", envelope)?;
        dict.set_item("solver", name.to_string())?;
        dict.set_item("tolerance", tolerance)?;
        dict.set_item("strict_max", criterion == Criterion::Maximum)?;
        dict.set_item("max_iterations", max_iterations)?;
        dict.set_item("friction", plain(py, &friction)?)?;
        dict.set_item("overlap", plain(py, &overlap)?)?;
        Ok(dict)
    }

    /// Sums and extremes over all steps so far, as in summary.json of a run.
    #[getter]
    fn totals<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let totals = plain(py, &self.run().totals)?;
        let figures = totals.call_method1("pop", ("figures",))?;
        totals.call_method1("update", (figures,))?;
        Ok(totals)
    }

    /// Simulated time, s.
    #[getter]
    fn time(&mut self) -> f64 {
        self.state().time
    }

    /// Steps done.
    #[getter]
    fn steps(&mut self) -> u64 {
        self.state().step
    }

    /// Time step, s.
    #[getter]
    fn dt(&mut self) -> f64 {
        self.run().settings.stepping.step
    }

    /// The time at which the scene ends, s; None for worlds made in code.
    #[getter]
    fn end(&mut self) -> Option<f64> {
        let Run { settings, world, .. } = &*self.run();
        let left = settings.steps.saturating_sub(world.step) as f64;
        (settings.steps > 0).then_some(world.time + left * settings.stepping.step)
    }

    /// Gravitational acceleration, m/s^2.
    #[getter]
    fn gravity(&mut self) -> [f64; 3] {
        self.state().gravity.to_array()
    }

    #[setter]
    fn set_gravity(&mut self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        self.state().gravity = vector("gravity", value)?;
        Ok(())
    }

    /// A number made of every bit of the state: equal states have equal hashes.
    #[getter]
    fn state_hash(&mut self) -> u64 {
        self.state().state_hash()
    }

    /// Kinetic energy of the bodies that can move, J.
    #[getter]
    fn kinetic_energy(&mut self) -> f64 {
        self.state().kinetic_energy()
    }

    /// Work against gravity that it took to bring the bodies that can move from the origin to where they
    /// are, -sum m g.x, J.
    #[getter]
    fn potential_energy(&mut self) -> f64 {
        let state = self.state();
        let of = |body: usize| -state.bodies.mass[body] * state.gravity.dot(state.bodies.position[body]);
        (0..state.bodies.len()).filter(|&body| !state.is_prescribed(body)).map(of).sum()
    }

    /// Centres of mass, m, shape (n, 3). Writable; a view, not a copy.
    #[getter]
    fn positions<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        list!(slf, writable, position)
    }

    #[setter]
    fn set_positions(slf: &Bound<'_, Self>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        assign(&Self::positions(slf)?, value)
    }

    /// Rotations from body axes to world axes, unit quaternions (x, y, z, w), shape (n, 4). Writable; a view.
    #[getter]
    fn quaternions<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        list!(slf, writable, orientation)
    }

    #[setter]
    fn set_quaternions(slf: &Bound<'_, Self>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        assign(&Self::quaternions(slf)?, value)
    }

    /// Velocities of the centres of mass, m/s, shape (n, 3). Writable; a view.
    #[getter]
    fn velocities<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        list!(slf, writable, velocity)
    }

    #[setter]
    fn set_velocities(slf: &Bound<'_, Self>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        assign(&Self::velocities(slf)?, value)
    }

    /// Angular velocities in world axes, rad/s, shape (n, 3). Writable; a view.
    #[getter]
    fn angular_velocities<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        list!(slf, writable, angular_velocity)
    }

    #[setter]
    fn set_angular_velocities(slf: &Bound<'_, Self>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        assign(&Self::angular_velocities(slf)?, value)
    }

    /// External forces on the centres of mass in world axes, N, shape (n, 3): they act in every step until
    /// they are set anew, on top of gravity and loads. Writable; a view.
    #[getter]
    fn forces<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        list!(slf, writable, force)
    }

    #[setter]
    fn set_forces(slf: &Bound<'_, Self>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        assign(&Self::forces(slf)?, value)
    }

    /// External torques in world axes, N m, shape (n, 3); as forces.
    #[getter]
    fn torques<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        list!(slf, writable, torque)
    }

    #[setter]
    fn set_torques(slf: &Bound<'_, Self>, value: &Bound<'_, PyAny>) -> PyResult<()> {
        assign(&Self::torques(slf)?, value)
    }

    /// Masses, kg; 0 for boundaries. Read-only: inertias belong to them.
    #[getter]
    fn masses<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        list!(slf, readable, mass)
    }

    /// Inertias about the centres of mass in body axes, kg m^2, shape (n, 3, 3). Read-only.
    #[getter]
    fn inertias<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        list!(slf, readable, inertia)
    }

    /// Radii of the smallest balls about the centres of mass that hold the bodies, m: of a ball its radius,
    /// of a plane infinity. A copy.
    #[getter]
    fn radii<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let state = self.state();
        let of_part = |part: &graintrain::shape::Part| part.position.length() + part.shape.bounding_radius();
        let of_geometry: Vec<f64> =
            state.geometries.iter().map(|g| g.parts.iter().map(of_part).fold(0.0, f64::max)).collect();
        let radii = state.bodies.geometry.iter().map(|geometry| of_geometry[geometry.index()]).collect();
        Ok(numpy::PyArray1::from_vec(py, radii).into_any())
    }

    /// Which bodies have six dynamic degrees of freedom, a bool per body. A copy.
    #[getter]
    fn free<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyAny> {
        let state = self.state();
        let free = (0..state.bodies.len()).map(|body| state.is_free(body)).collect();
        numpy::PyArray1::from_vec(py, free).into_any()
    }

    /// Surfaces of the bodies: a list of (bodies, triangles, kind), where the bodies (indices) share the
    /// triangles, corners (t, 3, 3) in m in their axes, and kind is "grain" (free), "tool" or "wall". Balls,
    /// whose radii are known, are in none. Planes end at the scene's box. Copies.
    fn surfaces<'py>(&mut self, py: Python<'py>) -> PyResult<Vec<Surface<'py>>> {
        let groups = graintrain_view::view::model::Model::new(self.state()).groups;
        let surface = |group: graintrain_view::view::model::Group| {
            let count = group.triangles.len() / 9;
            let corners = numpy::PyArray1::from_vec(py, group.triangles).reshape([count, 3, 3])?;
            Ok((numpy::PyArray1::from_vec(py, group.bodies).into_any(), corners.into_any(), group.kind))
        };
        groups.into_iter().map(surface).collect()
    }

    /// Names of the bodies; empty for the many made by a packing.
    #[getter]
    fn names(&mut self) -> Vec<String> {
        self.state().bodies.name.clone()
    }

    /// The index of a body by its name.
    fn index(&mut self, name: &Bound<'_, PyAny>) -> PyResult<usize> {
        self.index_of(name)
    }

    /// Contacts of the last step with their impulses.
    #[getter]
    fn contacts(&mut self, py: Python<'_>) -> PyResult<Py<Contacts>> {
        if let Some(contacts) = &self.contacts {
            return Ok(contacts.clone_ref(py));
        }
        let contacts = Py::new(py, Contacts::new(self.state().contacts.clone()))?;
        self.contacts = Some(contacts.clone_ref(py));
        Ok(contacts)
    }

    /// Force (N) and torque about its centre (N m) that contacts exerted on a body that is not free, averaged
    /// over the last step.
    fn wrench(&mut self, body: &Bound<'_, PyAny>) -> PyResult<([f64; 3], [f64; 3])> {
        let index = self.index_of(body)?;
        let report =
            self.report.as_ref().ok_or_else(|| PyValueError::new_err("no step has been made yet"))?;
        let wrench = report.wrenches.iter().find(|wrench| wrench.body.index() == index);
        let wrench = wrench.ok_or_else(|| {
            PyValueError::new_err(format!(
                "body {index} is free: wrenches are of bodies that are held or driven"
            ))
        })?;
        Ok((wrench.force.to_array(), wrench.torque.to_array()))
    }

    /// Adds a force (N) that acts at a point (m, world frame) to those on a body.
    fn add_force_at(
        &mut self,
        body: &Bound<'_, PyAny>,
        force: &Bound<'_, PyAny>,
        point: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let body = graintrain::handle::BodyId::from_index(self.index_of(body)?);
        self.state().add_force_at(body, vector("force", force)?, vector("point", point)?).or_raise()
    }

    /// Sets external forces and torques to zero; loads stay.
    fn clear_forces(&mut self) {
        self.state().clear_forces();
    }

    /// Removes bodies by a mask (a bool per body). The others keep their order and move up. Raises
    /// BufferError while arrays look into the world's memory.
    fn remove_bodies(&mut self, mask: Vec<bool>) -> PyResult<()> {
        let state = self.resize()?;
        if mask.len() != state.bodies.len() {
            return Err(PyValueError::new_err(format!(
                "mask has {} entries, expected one per body, {}",
                mask.len(),
                state.bodies.len()
            )));
        }
        state.remove_bodies(|body| mask[body]);
        Ok(())
    }
}

impl World {
    /// The report of the last step.
    pub(crate) fn report(&self) -> Option<StepReport> {
        self.report.clone().map(StepReport::new)
    }
}
