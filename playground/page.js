// The page: a scene in an editor, its numbers as sliders, a run in a worker, and the replay that the program makes of it.
import { basicSetup, EditorView } from "codemirror";
import { autocompletion } from "@codemirror/autocomplete";
import { HighlightStyle, StreamLanguage, syntaxHighlighting } from "@codemirror/language";
import { tags } from "@lezer/highlight";
import { toml } from "@codemirror/legacy-modes/mode/toml";
import { complete } from "./completion.js";
import { changed, parameters, range } from "./parameters.js";
import { bytes, text } from "./program.js";
import { SCENES } from "./scenes.js";

const element = (id) => document.getElementById(id);
const CHECK_AFTER = 500;
/** A replay of a run under way is made no more often, ms; and its making may take at most a third of the time. */
const LOOK_AFTER = 1500;

const page = { module: null, schema: null, running: null, files: {}, given: {}, showing: false, shown: 0, frames: 0, url: null };

// ---- the program -------------------------------------------------------------------------------------------------------

/** Runs the program in a worker of its own; `follow` is given the files so far. `ended` is rejected where it is stopped. */
function program(args, files, follow) {
  const worker = new Worker("worker.js", { type: "module" });
  let stop;
  const ended = new Promise((resolve, reject) => {
    worker.onmessage = ({ data }) => { if (data.done) { worker.terminate(); resolve(data.done); } else follow(data); };
    worker.onerror = (event) => { worker.terminate(); reject(new Error(event.message)); };
    stop = () => { worker.terminate(); reject(new Error("stopped")); };
  });
  worker.postMessage({ module: page.module, args, files, follow: Boolean(follow) });
  return { ended, stop };
}

// ---- the editor --------------------------------------------------------------------------------------------------------

const colors = HighlightStyle.define([
  { tag: tags.comment, color: "var(--faint)" },
  { tag: [tags.string, tags.number, tags.bool, tags.atom], color: "var(--accent)" },
  { tag: [tags.propertyName, tags.keyword], fontWeight: "600" },
]);

let waiting;
const editor = new EditorView({
  parent: element("editor"),
  extensions: [
    basicSetup,
    StreamLanguage.define(toml),
    syntaxHighlighting(colors),
    autocompletion({ override: [completions] }),
    EditorView.contentAttributes.of({ "aria-label": "Scene" }),
    EditorView.updateListener.of((update) => {
      if (!update.docChanged) return;
      clearTimeout(waiting);
      waiting = setTimeout(() => { drawSliders(); check(); }, CHECK_AFTER);
    }),
  ],
});

const scene = () => editor.state.doc.toString();
const setScene = (words) => editor.dispatch({ changes: { from: 0, to: editor.state.doc.length, insert: words } });

function completions(context) {
  const before = context.state.sliceDoc(0, context.pos), line = context.state.doc.lineAt(context.pos);
  const found = page.schema && complete(page.schema, before);
  if (!found || (!context.explicit && line.from + found.from === context.pos)) return null;
  return { from: line.from + found.from, options: found.options };
}

let checking = null;
/** The scene's file, by the name of the built-in one that it came from. */
const sceneFile = () => `${element("choice").value || "scene"}.toml`;

/** What a run can read: the scene, and the reader's own files beside it. */
const inputs = () => ({ ...page.given, [sceneFile()]: bytes(scene()) });

async function check() {
  checking?.stop();
  const mine = program(["check", sceneFile()], inputs());
  checking = mine;
  const done = await mine.ended.catch(() => null);
  if (!done) return;
  const fine = done.code === 0;
  element("check").textContent = fine ? done.said.trimEnd() : done.said.trim();
  element("check").className = fine ? "" : "bad";
  page.frames = fine ? Number(done.said.match(/output\s+(\d+) frames/)?.[1] ?? 0) : 0;
}

// ---- sliders -----------------------------------------------------------------------------------------------------------

/** Ends of the sliders, from the values that the scene came with. */
let ranges = new Map();

function drawSliders() {
  const box = element("sliders"), active = document.activeElement?.dataset?.parameter;
  const found = parameters(scene());
  if (active && found.some(({ name }) => name === active)) {
    for (const { name, value, unit } of found) {
      const slider = box.querySelector(`input[data-parameter="${name}"]`);
      if (slider && name !== active) slider.value = value;
      if (slider) slider.nextElementSibling.textContent = `${value} ${unit}`;
    }
    return;
  }
  box.replaceChildren(...found.flatMap((parameter) => {
    const { name, value, unit, comment } = parameter;
    if (!ranges.has(name)) ranges.set(name, range(parameter));
    const { low, high, step } = ranges.get(name);
    const label = Object.assign(document.createElement("label"), { textContent: name, title: comment, htmlFor: `parameter-${name}` });
    const slider = Object.assign(document.createElement("input"), { type: "range", id: `parameter-${name}`, min: low, max: high, step, title: comment });
    const shown = Object.assign(document.createElement("output"), { textContent: `${value} ${unit}` });
    slider.dataset.parameter = name;
    slider.value = value;
    slider.oninput = () => {
      const now = parameters(scene()).find((one) => one.name === name);
      if (!now) return;
      setScene(changed(scene(), now, Number(slider.value)));
      shown.textContent = `${Number(Number(slider.value).toPrecision(4))} ${unit}`;
    };
    return [label, slider, shown];
  }));
}

async function choose(name) {
  const { set } = SCENES.find((one) => one.name === name);
  const done = await program(["scenes", name], {}).ended;
  let words = done.said;
  for (const [key, value] of Object.entries(set)) {
    const parameter = parameters(words).find((one) => one.name === key);
    if (parameter) words = changed(words, parameter, value);
  }
  ranges = new Map();
  document.activeElement?.blur?.();
  setScene(words);
}

// ---- runs --------------------------------------------------------------------------------------------------------------

/** Shows a replay: from its start, or the newest frame of a run under way. */
function showReplay(html, newest) {
  if (page.url) URL.revokeObjectURL(page.url);
  page.url = URL.createObjectURL(new Blob([html], { type: "text/html" }));
  element("replay").src = newest ? `${page.url}#frame=${newest}` : page.url;
  element("replay").classList.add("shown");
  element("empty").className = "hidden";
}

/** Makes the replay of the files so far; `frames` of a run under way. */
async function look(files, frames) {
  if (page.showing) return;
  page.showing = true;
  const begin = performance.now();
  try {
    const done = await program(["view", "run", "--out", "replay.html"], files).ended;
    const html = done.files["replay.html"];
    if (html) showReplay(html, frames && frames - 1);
  } finally {
    page.shown = performance.now() + 2 * (performance.now() - begin);
    page.showing = false;
  }
}

async function run() {
  element("go").hidden = true;
  element("stop").hidden = false;
  element("said").textContent = "";
  element("said").className = "";
  const progress = element("progress");
  progress.hidden = false;
  progress.removeAttribute("value");
  page.files = {};
  page.shown = performance.now();
  const running = program(["run", sceneFile(), "--out", "run"], inputs(), ({ shown, frames }) => {
    Object.assign(page.files, shown);
    if (page.frames) progress.value = frames / page.frames;
    if (frames > 1 && performance.now() > page.shown + LOOK_AFTER) look(page.files, frames);
  });
  page.running = running;
  try {
    const done = await running.ended;
    page.files = done.files;
    tell(done);
  } catch (error) {
    element("said").textContent = error.message === "stopped" ? "Stopped: the replay is of what was done." : error.message;
  }
  page.running = null;
  while (page.showing) await new Promise((after) => setTimeout(after, 50));
  if (Object.keys(page.files).some((path) => path.startsWith("run/frames/"))) await look(page.files).catch(() => {});
  listFiles();
  progress.hidden = true;
  element("stop").hidden = true;
  element("go").hidden = false;
}

/** What the program said, and the hash of the state at the end. */
function tell({ code, said, files }) {
  const summary = files["run/summary.json"], hash = summary && text(summary).match(/"state_hash": "(\w+)"/)?.[1];
  const lines = said.trim().split("\n").filter((line) => !/^\s*(Files|Next) /.test(line));
  if (hash) lines.push(`  state_hash  ${hash}, as the program has it on any other machine`);
  element("said").textContent = lines.join("\n");
  element("said").className = code === 0 ? "" : "bad";
}

function listFiles() {
  const wanted = Object.entries(page.files).filter(([path]) => /^run\/[^/]+\.(csv|json|toml)$/.test(path));
  element("files").hidden = wanted.length === 0;
  element("files").querySelector("ul").replaceChildren(...wanted.map(([path, data]) => {
    const link = Object.assign(document.createElement("a"), { textContent: path.slice(4), download: path.slice(4), href: "#" });
    link.onclick = () => { link.href = URL.createObjectURL(new Blob([data])); };
    const item = document.createElement("li");
    item.append(link);
    return item;
  }));
}

// ---- beginning ---------------------------------------------------------------------------------------------------------

const asked = () => new URLSearchParams(location.hash.slice(1));

/** The scene of the address `#scene=...`: gzip, base64url. */
async function fromAddress() {
  const coded = asked().get("scene");
  if (!coded) return null;
  const packed = Uint8Array.from(atob(coded.replace(/-/g, "+").replace(/_/g, "/")), (c) => c.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

/** Takes files of the reader's own; they stay in the page. */
async function take(files) {
  for (const file of files) page.given[file.name] = new Uint8Array(await file.arrayBuffer());
  element("given").textContent = `beside the scene: ${Object.keys(page.given).join(", ")}`;
  element("given").hidden = false;
  check();
}

/** The program; some servers do not know what it is. */
async function load(address) {
  const answer = await fetch(address);
  if (!answer.ok) throw new Error(`${address}: ${answer.status} ${answer.statusText}`);
  return WebAssembly.compile(await answer.arrayBuffer());
}

async function toAddress(words) {
  const packed = new Uint8Array(await new Response(new Blob([words]).stream().pipeThrough(new CompressionStream("gzip"))).arrayBuffer());
  const coded = btoa(String.fromCharCode(...packed)).replace(/\+/g, "-").replace(/\//g, "_").replace(/=+$/, "");
  return `${location.href.split("#")[0]}#scene=${coded}`;
}

async function begin() {
  for (const { name, title } of SCENES) element("choice").append(new Option(title, name));
  page.module = await load("graintrain.wasm");
  page.schema = await (await fetch("graintrain.schema.json")).json();
  const given = await fromAddress().catch(() => null);
  if (given) { element("choice").prepend(new Option("from the address", "")); element("choice").value = ""; setScene(given); } else {
    const { name } = SCENES.find((one) => one.name === asked().get("name")) ?? SCENES[0];
    element("choice").value = name;
    await choose(name);
  }
  element("choice").onchange = ({ target }) => { if (target.value) choose(target.value); };
  element("add").onclick = () => element("added").click();
  element("added").onchange = ({ target }) => take(target.files);
  element("go").onclick = run;
  element("stop").onclick = () => page.running?.stop();
  element("link").onclick = async () => {
    const address = await toAddress(scene());
    history.replaceState(null, "", address);
    await navigator.clipboard?.writeText(address).catch(() => {});
    element("link").textContent = "Copied";
    setTimeout(() => { element("link").textContent = "Link"; }, 1500);
  };
  element("go").textContent = "Run";
  element("go").disabled = false;
}

begin().catch((error) => {
  element("go").textContent = "Cannot run";
  const remedy = location.protocol === "file:" ? ". Browsers load no programs from files: python3 -m http.server -d site" : "";
  element("said").textContent = `This page could not load the program: ${error.message}${remedy}`;
  element("said").className = "bad";
});
