// ---- what is shown, and how the reader says so -------------------------------------------------------------------------------

function fail(message) {
  element("problem").hidden = false;
  element("problem").textContent = message;
}

/** Name and ends of the colour bar; no ends where colours are names. */
function legend() {
  const { index } = moment(), quantity = QUANTITIES.get(state.color);
  if (state.chains) return ["normal contact force (N)", "0", digits(frames[index].contacts.shown)];
  if (quantity.names) return [quantity.label, "", ""];
  const [low, high, beyond] = colorRange(frames[index]);
  return [quantity.label, digits(low), (beyond ? "\u2265 " : "") + digits(high)];
}

/** Writes all that stands about the picture. */
function write() {
  if (!frames.length) return;
  const [name, first, last] = legend(), time = timeNow();
  element("quantity").textContent = name;
  element("ramp").hidden = first === "";
  element("ends").children[0].textContent = first;
  element("ends").children[1].textContent = last;
  element("clock").textContent = `t = ${time.toFixed(3)} s`;
  element("time").max = frames.length - 1;
  element("time").value = state.at;
  charts.forEach((chart) => chart.follow(time));
  writePicked();
}

function writePicked() {
  const box = element("picked"), body = state.picked;
  box.hidden = body < 0;
  if (body < 0) return;
  const frame = frames[moment().index], rows = [["material", header.materials[model.material[body]]]];
  header.fields.forEach(([, label], k) => rows.push([label, digits(fieldOf(frame, k, body))]));
  if (model.grain[body]) rows.push(["size: radius (m)", digits(model.radius[body] * grown(frame, body))]);
  rows.push(["place (m)", place(frame, body).map((x) => digits(Math.abs(x) < 1e-9 ? 0 : x)).join(", ")]);
  const table = document.createElement("table"), title = document.createElement("b");
  title.textContent = `${header.names[body] ?? "body"}${header.names[body] ? `, body ${body}` : ` ${body}`}${frame.absent[body] ? ": not there" : ""}`;
  for (const row of rows) row.reduce((tr, text) => { tr.insertCell().textContent = text; return tr; }, table.insertRow());
  box.replaceChildren(title, table);
}

let wanted = 0, rested = 0;

/** Draws, more coarsely where that takes long. */
function drawInTime(drawing) {
  if (quality.slow > 3) Object.assign(quality, { fine: 1, veil: false });
  const begin = performance.now();
  drawing();
  // What the graphics card takes shows when the next frame is asked for.
  requestAnimationFrame(() => { quality.slow = Math.max(0, Math.min(12, quality.slow + (performance.now() - begin > 45 ? 1 : -0.25))); });
}

/** Draws soon, at full quality once nothing moves any more. */
function redraw() {
  // A film draws what it needs.
  if (!wanted && !recorder) wanted = requestAnimationFrame(() => {
    wanted = 0;
    drawInTime(draw);
    clearTimeout(rested);
    if (quality.fine < 2) rested = setTimeout(() => { Object.assign(quality, { fine: 2, veil: true }); draw(); }, 250);
  });
}

/** Shows a frame, or a moment between two. */
function show(at) {
  state.at = Math.max(0, Math.min(frames.length - 1, at));
  write();
  redraw();
}

let playing = 0;

function pause() {
  playing++;
  state.playing = false;
  element("play").textContent = "Play";
}

/** Plays from the moment shown to the end; `each` is called after every picture, `done` at the end. */
function play(each = () => {}, done = () => {}) {
  const mine = ++playing;
  state.playing = true;
  element("play").textContent = "Pause";
  if (state.at >= frames.length - 1) state.at = 0;
  let before = null, time = timeNow();
  const tick = (now) => {
    if (mine !== playing) return;
    // The reader may have moved the slider.
    if (Math.abs(timeNow() - time) > 1e-9) time = timeNow();
    if (before !== null) time += ((now - before) / 1000) * Number(element("rate").value);
    before = now;
    let a = Math.floor(state.at);
    while (a + 1 < frames.length && frames[a + 1].time <= time) a++;
    const last = a >= frames.length - 1;
    show(last ? a : a + Math.max(0, time - frames[a].time) / (frames[a + 1].time - frames[a].time));
    time = timeNow();
    each();
    if (last) { pause(); done(); } else requestAnimationFrame(tick);
  };
  requestAnimationFrame(tick);
}

const toggle = () => (state.playing ? pause() : play());

/** Sets what the reader chose, there and in the controls. */
function choose(name, value) {
  state[name] = value;
  // What a new cut takes away is the side that faces the reader.
  if (name === "cut") state.towards = !(viewAxes().towards[Number(value)] < 0);
  const control = element(name);
  if (control?.type === "checkbox") control.checked = value; else if (control) control.value = value;
  element("cutting").hidden = state.cut === "";
  if (name === "color" || name === "range") writeRange();
  write();
  redraw();
}

/** Writes the ends of the colours where they can be set by hand. */
function writeRange() {
  if (!frames.length || state.range === "hand") return;
  [state.low, state.high] = colorRange(frames[moment().index]);
  for (const name of ["low", "high"]) element(name).value = Number(state[name].toPrecision(4));
}

function pick(body) {
  state.picked = body;
  write();
  redraw();
}

/** Turning, moving, zooming and picking with mouse or fingers. */
function listenToScene() {
  const canvas = element("scene"), pointers = new Map();
  let way = 0;
  canvas.addEventListener("pointerdown", (e) => { pointers.set(e.pointerId, [e.clientX, e.clientY]); canvas.setPointerCapture(e.pointerId); way = pointers.size > 1 ? 100 : 0; });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (e) => {
    pointers.delete(e.pointerId);
    const { left, top } = canvas.getBoundingClientRect();
    if (name === "pointerup" && way < 5 && frames.length) { const body = bodyAt(e.clientX - left, e.clientY - top); pick(body === state.picked ? -1 : body); }
  });
  canvas.addEventListener("pointermove", (e) => {
    const last = pointers.get(e.pointerId);
    if (!last) return;
    const [dx, dy] = [e.clientX - last[0], e.clientY - last[1]];
    way += Math.abs(dx) + Math.abs(dy);
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== e.pointerId)[1], gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      camera.distance *= gap(last) / gap([e.clientX, e.clientY]);
    } else if (e.shiftKey || e.buttons === 2) {
      const { right, top } = viewAxes(), s = (camera.distance * 0.54) / canvas.clientHeight;
      camera.target = camera.target.map((t, k) => t - s * dx * right[k] + s * dy * top[k]);
    } else {
      camera.around -= dx * 0.008;
      camera.above = Math.max(-1.5, Math.min(1.5, camera.above + dy * 0.008));
    }
    pointers.set(e.pointerId, [e.clientX, e.clientY]);
    redraw();
  });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    camera.distance = Math.max(radiusOfAll * 0.05, Math.min(radiusOfAll * 20, camera.distance * Math.exp(e.deltaY * 0.001)));
    redraw();
  }, { passive: false });
}

const look = (around, above) => { home(around, above); redraw(); };

function theme(dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  element("theme").textContent = dark ? "Light" : "Dark";
  drawCharts();
  redraw();
}

function listenToKeys() {
  const keys = { " ": toggle, ArrowRight: () => show(Math.floor(state.at) + 1), ArrowLeft: () => show(Math.ceil(state.at) - 1), Home: () => show(0), End: () => show(frames.length - 1),
    c: () => choose("chains", !state.chains), w: () => choose("walls", !state.walls), l: () => choose("shadows", !state.shadows), r: () => look(),
    1: () => look(0, 0), 2: () => look(-Math.PI / 2, 0), 3: () => look(-Math.PI / 2, 1.5), x: () => choose("cut", "0"), y: () => choose("cut", "1"), z: () => choose("cut", "2"),
    v: () => choose("cut", "eye"), n: () => choose("cut", ""), s: still, f: film, d: () => theme(!isDark()), "?": () => element("keys").showModal(), Escape: () => pick(-1) };
  window.addEventListener("keydown", (e) => {
    const own = e.target === document.body || e.target === element("scene"), act = keys[e.key.length === 1 ? e.key.toLowerCase() : e.key];
    if (!own || !act || e.ctrlKey || e.metaKey || e.altKey || !frames.length) return;
    e.preventDefault();
    if (e.key.startsWith("Arrow")) pause();
    act();
  });
}

function listen() {
  listenToScene();
  listenToKeys();
  new ResizeObserver(() => { drawCharts(); redraw(); }).observe(element("stage"));
  element("time").addEventListener("input", (e) => show(Number(e.target.value)));
  for (const name of ["color", "range", "cut"]) element(name).addEventListener("change", (e) => choose(name, e.target.value));
  for (const name of ["chains", "walls", "shadows", "flip"]) element(name).addEventListener("change", (e) => choose(name, e.target.checked));
  for (const name of ["low", "high"]) element(name).addEventListener("change", (e) => { state[name] = Number(e.target.value); choose("range", "hand"); });
  element("depth").addEventListener("input", (e) => { state.depth = Number(e.target.value) / 1000; redraw(); });
  element("inside").addEventListener("toggle", drawCharts);
  for (const [name, act] of [["play", toggle], ["home", () => look()], ["still", still], ["film", film], ["theme", () => theme(!isDark())], ["help", () => element("keys").showModal()]]) element(name).addEventListener("click", act);
}

/** Frames sent by a run under way, and its buttons. */
function listenToRun() {
  const source = new EventSource(`events?generation=${header.live}`), send = (what) => fetch(what, { method: "POST" });
  element("live").hidden = false;
  element("pause").addEventListener("click", () => send(element("pause").dataset.paused ? "go" : "pause"));
  element("one").addEventListener("click", () => send("step"));
  element("stop").addEventListener("click", () => send("stop"));
  source.addEventListener("frame", async (event) => {
    const { chunk, data } = JSON.parse(event.data), buffer = await inflate(data), follows = state.at >= frames.length - 1;
    try { frames.push(...readFrames(buffer, chunk)); } catch { return; } // Of other bodies.
    frames.sort((p, q) => p.time - q.time);
    if (follows) state.at = frames.length - 1;
    writeRange();
    show(state.at);
  });
  // Bodies have come or gone: what was sent about them holds no more.
  source.addEventListener("bodies", async (event) => {
    const sent = JSON.parse(event.data), { charts: _, ...rest } = sent.header;
    Object.assign(header, rest);
    [frames, state.at, state.picked] = [[], 0, -1];
    element("facts").textContent = header.facts;
    model = readModel(await inflate(sent.model));
    ranges.clear();
    loaded.key = "";
    setUpModel();
  });
  source.addEventListener("charts", (event) => setUpCharts(JSON.parse(event.data)));
  source.addEventListener("state", (event) => {
    const { text, paused, ended } = JSON.parse(event.data);
    element("state").textContent = text;
    element("pause").dataset.paused = paused ? "1" : "";
    element("pause").textContent = paused ? "Go on" : "Pause the run";
    if (ended) { source.close(); for (const name of ["pause", "one", "stop"]) element(name).disabled = true; }
  });
}

/** #frame=K&chains&color=NAME&range=SHARE&cut=AXIS&depth=PART&dark in the address choose what is shown first. */
function begin() {
  const asked = new URLSearchParams(location.hash.slice(1)), last = frames.length - 1;
  for (const name of ["color", "range", "cut"]) if (asked.get(name)) choose(name, asked.get(name));
  if (asked.has("depth")) state.depth = Number(asked.get("depth"));
  if (asked.has("chains")) choose("chains", true);
  theme(asked.has("dark") || (!asked.has("light") && matchMedia("(prefers-color-scheme: dark)").matches));
  writeRange();
  // The last moment as a poster, then all of it from the start; not where the address names a moment or the reader wants no motion.
  show(asked.has("frame") ? Number(asked.get("frame")) : last);
  if (header.live || asked.has("frame") || last < 1 || matchMedia("(prefers-reduced-motion: reduce)").matches) return;
  const auto = setTimeout(() => { if (!state.playing) { state.at = 0; play(); } }, 1500);
  for (const name of ["pointerdown", "keydown"]) window.addEventListener(name, () => clearTimeout(auto), { capture: true, once: true });
}

(async () => {
  try {
    element("ramp").style.background = `linear-gradient(to right, ${VIRIDIS.map((c) => `rgb(${c})`).join(",")})`;
    element("facts").textContent = header.facts;
    model = readModel(await inflate(element("model").textContent));
    if (header.chunk.ranges) frames = readFrames(await inflate(element("data").textContent), header.chunk);
    for (const [name, { label }] of QUANTITIES) element("color").append(new Option(label.replace(/ \(.*/, ""), name));
    setUp();
    setUpModel();
    home();
    setUpCharts(header.charts);
    listen();
    begin();
    if (header.live) listenToRun();
  } catch (error) {
    fail(`The replay cannot be shown: ${error.message}.`);
    throw error;
  }
})();
