//! A run under way on the replay's page: a server for this machine alone.
//!
//! The page comes from `/`, frames, charts and the state of the run from `/events` (server-sent events,
//! WHATWG HTML standard, section 9.2), and its buttons ask for `/pause`, `/go`, `/step` and `/stop`. Only the
//! loopback address is listened to, and only requests that name it as their host are answered, so that no
//! page of another site can reach the run through a browser.

use super::ViewError;
use super::model::Model;
use super::pack::pack_model;
use super::page::{chart_data, header, html, packed};
use graintrain::world::World;
use graintrain_io::files::OutputError;
use graintrain_io::run::{Observer, StepView};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Frames that are kept for pages that open later; when there are as many, every second one is dropped.
const MOST_FRAMES: usize = 240;
/// Frames come no more often.
const BETWEEN_FRAMES: Duration = Duration::from_millis(100);
/// Making a frame, or reading the tables again, takes no more than one part in so many of the time.
const SHARE: u32 = 20;
/// Charts are drawn anew no more often.
const BETWEEN_CHARTS: Duration = Duration::from_secs(2);
/// Connections at a time: a page takes two.
const MOST_CONNECTIONS: usize = 32;
/// Longest request, bytes: browsers send a kilobyte.
const LONGEST_REQUEST: u64 = 16_384;
/// A page that does not listen is let go.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long the end of the run waits for pages to hear of it.
const FAREWELL: Duration = Duration::from_secs(1);

/// A run on a page. Let it observe the run.
pub struct Live {
    shared: Arc<Shared>,
    address: SocketAddr,
    model: Model,
    /// Forms of the bodies that the model is of.
    forms: Vec<usize>,
    step: f64,
    steps: u64,
    title: String,
    last: Instant,
    cost: Duration,
}

struct Shared {
    state: Mutex<State>,
    /// Something has happened.
    changed: Condvar,
    connections: AtomicUsize,
    /// The run's folder, whose tables are drawn.
    folder: Option<PathBuf>,
    stop: Box<dyn Fn() + Send + Sync>,
}

#[derive(Default)]
struct State {
    /// The page without frames.
    page: String,
    /// Header and model as an event, for pages that know other bodies.
    bodies: String,
    /// How often bodies have come or gone.
    generation: u64,
    /// Events of the frames, each with its number.
    frames: Vec<(u64, Arc<str>)>,
    next_frame: u64,
    /// Changes of `reported`.
    news: u64,
    reported: String,
    paused: bool,
    /// Steps that a paused run may make.
    granted: u64,
    asked_to_stop: bool,
    ended: bool,
}

impl Shared {
    /// The state; a thread that panicked while it had it has changed whole values only.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn event(name: &str, data: &str) -> String {
    // JSON has no line breaks of its own.
    format!("event: {name}\ndata: {data}\n\n")
}

impl Live {
    /// Serves a run of `steps` steps of `step` s that begins in this world, at a port of the loopback address
    /// (0: any that is free). Charts are drawn of the tables in `folder`. `stop` is called where a page asks
    /// for the run's end.
    ///
    /// # Errors
    /// Where the port cannot be had.
    pub fn serve(
        world: &World,
        title: &str,
        step: f64,
        steps: u64,
        folder: Option<PathBuf>,
        port: u16,
        stop: impl Fn() + Send + Sync + 'static,
    ) -> Result<Self, ViewError> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            state: Mutex::default(),
            changed: Condvar::new(),
            connections: AtomicUsize::new(0),
            folder,
            stop: Box::new(stop),
        });
        let mut live = Self {
            shared: Arc::clone(&shared),
            address,
            model: Model::new(world),
            forms: forms(world),
            step,
            steps,
            title: title.to_string(),
            last: Instant::now(),
            cost: Duration::ZERO,
        };
        live.begin(world)?;
        live.show(world)?;
        std::thread::spawn(move || accept(&listener, &shared, address));
        Ok(live)
    }

    /// Where the page is.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// Lets the next step wait until a page says otherwise.
    pub fn pause(&self) {
        self.shared.lock().paused = true;
    }

    /// Tells the pages that the run is over, and waits a moment for them to hear it.
    pub fn end(&self, how: &str) {
        let mut state = self.shared.lock();
        state.ended = true;
        state.reported = reported(how, false, true);
        state.news += 1;
        drop(state);
        self.shared.changed.notify_all();
        let begin = Instant::now();
        while self.shared.connections.load(Ordering::Relaxed) > 0 && begin.elapsed() < FAREWELL {
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Makes the page of the bodies that are there now.
    fn begin(&mut self, world: &World) -> Result<(), ViewError> {
        let frame = self.model.frame(world, self.step, false);
        let scene = self.model.fitted(&[frame], &[Vec::new()]);
        let facts = format!("{} bodies, under way", self.model.count);
        let header = header(world, &self.model, &self.title, scene, facts);
        let model = pack_model(&self.model)?;
        let mut state = self.shared.lock();
        state.generation += 1;
        state.frames.clear();
        let header = header.of_generation(state.generation);
        state.page = html(&header, &model, "")?;
        let text = serde_json::to_string(&header).map_err(io::Error::from)?;
        state.bodies = event("bodies", &format!("{{\"header\":{text},\"model\":\"{model}\"}}"));
        Ok(())
    }

    /// Adds the world as a frame.
    fn show(&mut self, world: &World) -> Result<(), ViewError> {
        let begin = Instant::now();
        let forms = forms(world);
        if forms != self.forms {
            (self.model, self.forms) = (Model::new(world), forms);
            self.begin(world)?;
        }
        let frame = self.model.frame(world, self.step, true);
        let (chunk, data) = packed(vec![frame], vec![Vec::new()])?;
        let chunk = serde_json::to_string(&chunk).map_err(io::Error::from)?;
        let text: Arc<str> = event("frame", &format!("{{\"chunk\":{chunk},\"data\":\"{data}\"}}")).into();
        let mut state = self.shared.lock();
        if state.frames.len() >= MOST_FRAMES {
            let mut keep = false;
            state.frames.retain(|_| {
                keep = !keep;
                keep
            });
        }
        let number = state.next_frame;
        state.next_frame += 1;
        state.frames.push((number, text));
        let text = format!("step {} of {}, t = {:.4} s", world.step, self.steps, world.time);
        state.reported = reported(&text, state.paused, false);
        state.news += 1;
        drop(state);
        self.shared.changed.notify_all();
        (self.last, self.cost) = (Instant::now(), begin.elapsed());
        Ok(())
    }

    /// Waits while the run is paused.
    fn wait(&mut self, world: &World) -> Result<(), ViewError> {
        let is_held = |state: &State| state.paused && state.granted == 0 && !state.asked_to_stop;
        if is_held(&self.shared.lock()) {
            // What stands still is shown as it is.
            self.show(world)?;
        }
        let mut state = self.shared.lock();
        while is_held(&state) {
            let waited = self.shared.changed.wait_timeout(state, BETWEEN_FRAMES);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        state.granted = state.granted.saturating_sub(1);
        Ok(())
    }
}

/// The event of the run's state.
fn reported(text: &str, paused: bool, ended: bool) -> String {
    let text = serde_json::Value::from(text);
    event("state", &format!("{{\"text\":{text},\"paused\":{paused},\"ended\":{ended}}}"))
}

fn forms(world: &World) -> Vec<usize> {
    world.bodies.geometry.iter().map(|geometry| geometry.index()).collect()
}

impl Observer for Live {
    fn observe(&mut self, step: StepView<'_>) -> Result<(), OutputError> {
        let is_due = self.last.elapsed() >= BETWEEN_FRAMES.max(SHARE * self.cost);
        let is_last = step.world.step == self.steps;
        let shown = if is_due || is_last { self.show(step.world) } else { Ok(()) };
        shown.and_then(|()| self.wait(step.world)).map_err(|error| {
            OutputError::new("show", std::path::Path::new(&self.url()), io::Error::other(error))
        })
    }
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>, address: SocketAddr) {
    for stream in listener.incoming() {
        let Ok(stream) = stream else { continue };
        if shared.connections.fetch_add(1, Ordering::Relaxed) >= MOST_CONNECTIONS {
            shared.connections.fetch_sub(1, Ordering::Relaxed);
            continue;
        }
        let shared = Arc::clone(shared);
        std::thread::spawn(move || {
            // A page that goes away is no error of the run.
            let _ = answer(&stream, &shared, address);
            shared.connections.fetch_sub(1, Ordering::Relaxed);
        });
    }
}

/// Method, path and whether the request is meant for this server.
fn request(stream: &TcpStream, address: SocketAddr) -> io::Result<(String, String, bool)> {
    let mut lines = BufReader::new(stream.take(LONGEST_REQUEST)).lines();
    let first = lines.next().unwrap_or_else(|| Ok(String::new()))?;
    let mut words = first.split(' ').map(str::to_string);
    let (method, path) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let hosts = [address.to_string(), format!("localhost:{}", address.port())];
    let (mut is_named, mut is_own) = (false, true);
    for line in lines {
        let line = line?;
        if line.is_empty() {
            break;
        }
        let Some((name, value)) = line.split_once(':') else { continue };
        let value = value.trim();
        match name.to_ascii_lowercase().as_str() {
            "host" => is_named = hosts.iter().any(|host| host == value),
            "origin" => is_own &= hosts.iter().any(|host| format!("http://{host}") == value),
            _ => {}
        }
    }
    Ok((method, path, is_named && is_own))
}

fn answer(stream: &TcpStream, shared: &Shared, address: SocketAddr) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let (method, target, is_meant) = request(stream, address)?;
    let (path, query) = target.split_once('?').unwrap_or((&target, ""));
    match (method.as_str(), path) {
        _ if !is_meant => {
            reply(stream, "403 Forbidden", "text/plain", "this run is for its own page alone\n")
        }
        ("GET", "/") => {
            let page = shared.lock().page.clone();
            reply(stream, "200 OK", "text/html; charset=utf-8", &page)
        }
        ("GET", "/events") => {
            let known = query.strip_prefix("generation=").and_then(|number| number.parse().ok());
            events(stream, shared, known.unwrap_or(0))
        }
        ("POST", "/pause" | "/go" | "/step" | "/stop") => {
            command(shared, path);
            reply(stream, "204 No Content", "text/plain", "")
        }
        _ => reply(stream, "404 Not Found", "text/plain", "there is nothing here\n"),
    }
}

fn command(shared: &Shared, path: &str) {
    let mut state = shared.lock();
    match path {
        "/pause" => state.paused = true,
        "/go" => (state.paused, state.granted) = (false, 0),
        "/step" => (state.paused, state.granted) = (true, state.granted + 1),
        _ => state.asked_to_stop = true,
    }
    if state.asked_to_stop {
        (shared.stop)();
    }
    drop(state);
    shared.changed.notify_all();
}

fn reply(mut stream: &TcpStream, status: &str, kind: &str, body: &str) -> io::Result<()> {
    let length = body.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n{body}"
    )
}

/// Sends what happens until the run or the page ends.
fn events(mut stream: &TcpStream, shared: &Shared, mut generation: u64) -> io::Result<()> {
    stream.write_all(
        b"HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n",
    )?;
    let (mut next, mut news) = (0, 0);
    let (mut charted, mut cost) = (None::<Instant>, Duration::ZERO);
    loop {
        let mut state = shared.lock();
        if state.generation == generation && state.next_frame <= next && state.news == news {
            let waited = shared.changed.wait_timeout(state, BETWEEN_CHARTS);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        let mut text = String::new();
        if state.generation != generation {
            generation = state.generation;
            text.push_str(&state.bodies);
        }
        state.frames.iter().filter(|(number, _)| *number >= next).for_each(|(_, frame)| text.push_str(frame));
        next = state.next_frame;
        if state.news != news {
            news = state.news;
            text.push_str(&state.reported);
        }
        let ended = state.ended;
        drop(state);
        let is_due = charted.is_none_or(|last| last.elapsed() >= BETWEEN_CHARTS.max(SHARE * cost));
        if let Some(folder) = shared.folder.as_ref().filter(|_| is_due || ended) {
            let begin = Instant::now();
            // Tables that are being written may be read in the middle of a line: the next time they are
            // whole.
            if let Ok(Ok(charts)) = chart_data(folder).map(|charts| serde_json::to_string(&charts)) {
                text.push_str(&event("charts", &charts));
            }
            (charted, cost) = (Some(Instant::now()), begin.elapsed());
        }
        // A page that has gone is noticed by writing.
        stream.write_all(if text.is_empty() { b": still here\n\n" } else { text.as_bytes() })?;
        if ended {
            return Ok(());
        }
    }
}
