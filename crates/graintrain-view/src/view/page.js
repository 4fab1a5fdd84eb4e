// Replay of a run: draws the frames embedded in this page with WebGL 2. No network, no libraries.
"use strict";

const header = JSON.parse(document.getElementById("header").textContent);
const element = (id) => document.getElementById(id);
const state = { frame: 0, playing: false, chains: false, walls: true, color: "speed", range: "0.95" };
const VIRIDIS = [[68,1,84],[72,24,106],[71,45,123],[66,64,134],[59,82,139],[51,99,141],[44,114,142],[38,130,142],
  [33,145,140],[31,160,136],[40,174,128],[63,188,115],[94,201,98],[132,212,75],[173,220,48],[216,226,25],[253,231,37]];

function fail(message) {
  element("problem").hidden = false;
  element("problem").textContent = message;
}

// ---- data ---------------------------------------------------------------------------------------------------------

/** Unpacks the frames: see graintrain_view::view::pack for the layout. */
async function unpack() {
  const text = atob(element("data").textContent.trim());
  const packed = Uint8Array.from(text, (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  let offset = 0;
  const take = (Type, count) => {
    const bytes = count * Type.BYTES_PER_ELEMENT;
    const values = new Type(buffer.slice(offset, offset + bytes));
    offset += bytes;
    return values;
  };
  const { bodies, oriented, low, high } = header;
  const scale = [0, 1, 2].map((k) => (high[k] - low[k]) / 65535);
  let previous = new Uint16Array(3 * bodies);
  return header.frames.map(({ time, contacts, absent }) => {
    const coded = take(Uint16Array, 3 * bodies);
    for (let i = 0; i < coded.length; i++) coded[i] += previous[i];
    previous = coded;
    const position = new Float32Array(3 * bodies);
    for (let i = 0; i < bodies; i++)
      for (let k = 0; k < 3; k++) position[3 * i + k] = low[k] + scale[k] * coded[k * bodies + i];
    // Who is not there is drawn where nobody looks.
    for (const [first, end] of absent) position.fill(1e9, 3 * first, 3 * end);
    const turn = Float32Array.from(take(Int16Array, 4 * oriented.length), (q) => q / 32767);
    const speed = Float32Array.from(take(Uint16Array, bodies), (v) => (v / 65535) * header.speed_max);
    const force = Float32Array.from(take(Uint16Array, bodies), (v) => (v / 65535) * header.force_max);
    // Sizes relative to the first frame, where bodies grow.
    const size = header.size_max > 0 ? Float32Array.from(take(Uint16Array, bodies), (v) => (v / 65535) * header.size_max) : new Float32Array(bodies).fill(1);
    const a = take(Uint32Array, contacts), b = take(Uint32Array, contacts);
    const spot = take(Uint16Array, 3 * contacts);
    const load = Float32Array.from(take(Uint16Array, contacts), (v) => (v / 65535) * header.force_max);
    const point = Float32Array.from(spot, (v, i) => low[i % 3] + scale[i % 3] * v);
    return { time, position, turn, speed, force, size, contacts: { a, b, point, load } };
  });
}

// ---- mathematics ---------------------------------------------------------------------------------------------------

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const l = Math.hypot(...a) || 1; return a.map((x) => x / l); };

const up = header.up;
const side = (() => { const x = sub([1, 0, 0], up.map((u) => u * up[0])); return unit(Math.hypot(...x) > 1e-3 ? x : cross(up, [0, 1, 0])); })();
let camera;

/** The view that the box of the grains and tools just fills. */
function home() {
  camera = { around: -Math.PI / 3, above: 0.42, distance: 0, target: header.center.slice() };
  const { towards, right, top } = viewAxes(), [width, height] = lens();
  for (let k = 0; k < 8; k++) {
    const corner = header.half.map((h, axis) => ((k >> axis) & 1 ? h : -h));
    const wide = Math.max(Math.abs(dot(right, corner)) * width, Math.abs(dot(top, corner)) * height);
    camera.distance = Math.max(camera.distance, dot(towards, corner) + wide / 0.85);
  }
}

/** Scales of the projection: half widths at unit distance, inverted. */
function lens() {
  const canvas = element("scene"), aspect = canvas.clientWidth / canvas.clientHeight || 1, f = 1 / Math.tan((15 * Math.PI) / 180);
  return aspect < 1 ? [f, f * aspect] : [f / aspect, f];
}

function viewAxes() {
  const other = cross(up, side), { around, above } = camera;
  const towards = [0, 1, 2].map((k) => Math.cos(above) * (Math.cos(around) * side[k] + Math.sin(around) * other[k]) + Math.sin(above) * up[k]);
  const right = unit(cross(up, towards));
  return { towards, right, top: cross(towards, right) };
}

/** World to camera axes (right, top, towards the eye), column-major. */
function viewMatrix() {
  const { towards, right, top } = viewAxes();
  const eye = camera.target.map((t, k) => t + camera.distance * towards[k]);
  return new Float32Array([right[0], top[0], towards[0], 0, right[1], top[1], towards[1], 0, right[2], top[2], towards[2], 0,
    -dot(right, eye), -dot(top, eye), -dot(towards, eye), 1]);
}

function projection() {
  const near = camera.distance * 0.02, far = camera.distance + header.radius * 12, [width, height] = lens();
  return new Float32Array([width, 0, 0, 0, 0, height, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
}

// ---- drawing -------------------------------------------------------------------------------------------------------

const LIGHT = `
vec3 light(vec3 color, vec3 n, vec3 eye) {
  vec3 key = normalize(vec3(-0.5, 0.8, 0.65)), fill = normalize(vec3(0.8, 0.1, 0.5));
  float diffuse = 0.42 + 0.55 * max(dot(n, key), 0.0) + 0.18 * max(dot(n, fill), 0.0);
  float spark = 0.2 * pow(max(dot(n, normalize(key - normalize(eye))), 0.0), 40.0);
  return color * diffuse + spark;
}
uniform vec3 ramp[17];
vec3 ramped(float s) {
  float x = clamp(s, 0.0, 1.0) * 16.0; int i = min(int(x), 15);
  return mix(ramp[i], ramp[i + 1], x - float(i));
}`;

const SHADERS = {
  // A ball: a square that faces the eye and covers the silhouette; the ray meets the ball in the fragment.
  ball: [`#version 300 es
in vec2 corner; in vec3 center; in float radius; in float value;
uniform mat4 view, project; out vec3 ray; flat out vec3 middle; flat out float size, shade;
void main() {
  middle = (view * vec4(center, 1.0)).xyz; size = radius; shade = value;
  float d2 = dot(middle, middle), reach = radius * sqrt(d2 / max(d2 - radius * radius, 1e-12));
  vec3 forward = normalize(middle), right = normalize(cross(forward, vec3(0, 1, 0)));
  ray = middle + reach * (corner.x * right + corner.y * cross(right, forward));
  gl_Position = project * vec4(ray, 1.0);
}`, `#version 300 es
precision highp float;
in vec3 ray; flat in vec3 middle; flat in float size, shade;
uniform mat4 project; uniform float opacity; out vec4 color;${LIGHT}
void main() {
  float a = dot(ray, ray), b = dot(ray, middle), c = dot(middle, middle) - size * size, q = b * b - a * c;
  if (q < 0.0) discard;
  vec3 p = ray * (b - sqrt(q)) / a, n = (p - middle) / size;
  vec4 clip = project * vec4(p, 1.0);
  gl_FragDepth = 0.5 * clip.z / clip.w + 0.5;
  if (opacity < 1.0) { float rim = 1.0 - max(dot(n, -normalize(p)), 0.0); color = vec4(light(vec3(0.6, 0.64, 0.7), n, p), 0.10 + 0.3 * rim * rim); }
  else color = vec4(light(ramped(shade), n, p), 1.0);
}`],
  // Triangles of one geometry, placed by every body that has it.
  mesh: [`#version 300 es
in vec3 vertex, normal, place; in vec4 turn; in float value, grown;
uniform mat4 view, project; out vec3 at, facing; flat out float shade;
vec3 rotate(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
void main() {
  at = (view * vec4(place + rotate(turn, grown * vertex), 1.0)).xyz;
  facing = mat3(view) * rotate(turn, normal); shade = value;
  gl_Position = project * vec4(at, 1.0);
}`, `#version 300 es
precision highp float;
in vec3 at, facing; flat in float shade;
uniform vec4 tint; out vec4 color;${LIGHT}
void main() {
  vec3 n = normalize(facing); if (dot(n, at) > 0.0) n = -n;
  color = vec4(light(tint.a > 0.0 ? tint.rgb : ramped(shade), n, at), tint.a > 0.0 ? tint.a : 1.0);
}`],
  // A tube: a strip along the segment that faces the eye, shaded as if round.
  tube: [`#version 300 es
in vec2 corner; in vec3 from, to; in float radius; in float value;
uniform mat4 view, project; out vec3 at, across; out float edge; flat out float shade;
void main() {
  vec3 a = (view * vec4(from, 1.0)).xyz, b = (view * vec4(to, 1.0)).xyz;
  vec3 p = corner.y < 0.0 ? a : b; across = normalize(cross(b - a, p));
  edge = corner.x; shade = value; at = p + corner.x * radius * across;
  gl_Position = project * vec4(at, 1.0);
}`, `#version 300 es
precision highp float;
in vec3 at, across; in float edge; flat in float shade; out vec4 color;${LIGHT}
void main() {
  vec3 n = normalize(edge * across - sqrt(max(1.0 - edge * edge, 0.0)) * normalize(at));
  color = vec4(light(ramped(shade), n, at), 1.0);
}`],
};

let gl;
const programs = {};

function compile(name, [vertex, fragment]) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(`${name}: ${gl.getShaderInfoLog(shader)}`);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`${name}: ${gl.getProgramInfoLog(program)}`);
  return program;
}

/** An instanced draw: constant per-vertex attributes, per-instance ones set by `fill`. */
class Batch {
  constructor(program, mode, vertices, attributes) {
    this.program = program;
    this.mode = mode;
    this.vao = gl.createVertexArray();
    gl.bindVertexArray(this.vao);
    this.count = 0;
    this.instances = 0;
    this.buffers = {};
    for (const [name, [size, data]] of Object.entries(vertices)) {
      this.attribute(name, size, 0);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      this.count = data.length / size;
    }
    for (const [name, size] of Object.entries(attributes)) this.attribute(name, size, 1);
  }
  attribute(name, size, divisor) {
    const place = gl.getAttribLocation(this.program, name);
    this.buffers[name] = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
    if (place < 0) return;
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
    gl.vertexAttribDivisor(place, divisor);
  }
  fill(instances, values) {
    this.instances = instances;
    for (const [name, data] of Object.entries(values)) {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    }
  }
  draw(uniforms) {
    if (!this.instances) return;
    gl.useProgram(this.program);
    for (const [name, value] of Object.entries(uniforms)) {
      const place = gl.getUniformLocation(this.program, name);
      if (place === null) continue;
      if (typeof value === "number") gl.uniform1f(place, value);
      else if (value.length === 16) gl.uniformMatrix4fv(place, false, value);
      else if (value.length === 4) gl.uniform4fv(place, value);
      else gl.uniform3fv(place, value);
    }
    gl.bindVertexArray(this.vao);
    gl.drawArraysInstanced(this.mode, 0, this.count, this.instances);
  }
}

const SQUARE = [2, new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1])];
const RAMP = new Float32Array(VIRIDIS.flat().map((c) => c / 255));
let frames = [], balls, tubes, groups = [];
const grainBodies = header.grain.flatMap((grain, body) => (grain ? [body] : []));

function setUp() {
  gl = element("scene").getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!gl) throw new Error("This browser offers no WebGL 2.");
  for (const [name, texts] of Object.entries(SHADERS)) programs[name] = compile(name, texts);
  balls = new Batch(programs.ball, gl.TRIANGLE_STRIP, { corner: SQUARE }, { center: 3, radius: 1, value: 1 });
  tubes = new Batch(programs.tube, gl.TRIANGLE_STRIP, { corner: SQUARE }, { from: 3, to: 3, radius: 1, value: 1 });
  const slot = new Map(header.oriented.map((body, i) => [body, i]));
  groups = header.groups.map((group) => {
    const corners = new Float32Array(group.triangles), normals = new Float32Array(corners.length);
    for (let i = 0; i < corners.length; i += 9) {
      const [a, b, c] = [0, 3, 6].map((k) => Array.from(corners.subarray(i + k, i + k + 3)));
      const n = unit(cross(sub(b, a), sub(c, a)));
      for (let k = 0; k < 9; k++) normals[i + k] = n[k % 3];
    }
    const batch = new Batch(programs.mesh, gl.TRIANGLES, { vertex: [3, corners], normal: [3, normals] }, { place: 3, turn: 4, value: 1, grown: 1 });
    return { ...group, batch, slots: group.bodies.map((body) => slot.get(body)) };
  });
  gl.enable(gl.DEPTH_TEST);
  gl.depthFunc(gl.LEQUAL);
  gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  gl.clearColor(1, 1, 1, 1);
}

/** Values of the chosen quantity by body. */
function values(frame) {
  if (state.color !== "radius") return frame[state.color];
  const all = new Float32Array(header.bodies);
  header.balls.body.forEach((body, i) => { all[body] = header.balls.radius[i] * frame.size[body]; });
  return all;
}

const ranges = new Map();

/** Ends of the colours: percentiles of the grains' values, in all frames or in the one that is shown; most are looked at, not all. */
function range(frame) {
  const now = state.range === "now", share = now ? 0.99 : Number(state.range), key = `${state.color} ${state.range}`;
  if (!now && ranges.has(key)) return ranges.get(key);
  const grains = state.color === "radius" ? header.balls.body : grainBodies, sample = [];
  const shown = now ? [frame] : frames, stride = Math.max(1, Math.ceil((shown.length * grains.length) / 200000));
  let k = 0;
  for (const one of shown) {
    const all = values(one);
    for (; k < grains.length; k += stride) sample.push(all[grains[k]]);
    k -= grains.length;
  }
  sample.sort((a, b) => a - b);
  const at = (part) => sample[Math.min(sample.length - 1, Math.round(part * (sample.length - 1)))] ?? 0;
  let [low, high] = state.color === "radius" ? [at(1 - share), at(share)] : [0, at(share)];
  // Where nearly all are at rest, what moves still has a colour.
  if (!(high > low)) high = at(1) > low ? at(1) : low + (Math.abs(low) || 1);
  const found = [low, high, at(1) > high * (1 + 1e-6)];
  if (!now) ranges.set(key, found);
  return found;
}

const LABELS = { speed: "speed (m/s)", force: "largest contact force (N)", radius: "radius (m)" };

/** Values of the chosen quantity as fractions of the colour range, by body; the range, whether some are beyond it, the label. */
function shades(frame) {
  const [low, high, beyond] = range(frame);
  return [values(frame).map((v) => (v - low) / (high - low)), low, high, beyond, LABELS[state.color]];
}

const digits = (x) => (x === 0 ? "0" : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3 ? x.toExponential(1) : String(Number(x.toPrecision(3))));

/** Moves the data of the current frame to the graphics memory. */
function load() {
  const frame = frames[state.frame];
  const [shade, low, high, beyond, label] = shades(frame);
  const { body, radius } = header.balls;
  const center = new Float32Array(3 * body.length), value = new Float32Array(body.length);
  body.forEach((b, i) => { center.set(frame.position.subarray(3 * b, 3 * b + 3), 3 * i); value[i] = shade[b]; });
  balls.fill(body.length, { center, radius: Float32Array.from(body, (b, i) => radius[i] * frame.size[b]), value });
  for (const { batch, bodies, slots } of groups) {
    const place = new Float32Array(3 * bodies.length), turn = new Float32Array(4 * bodies.length);
    bodies.forEach((b, i) => {
      place.set(frame.position.subarray(3 * b, 3 * b + 3), 3 * i);
      turn.set(frame.turn.subarray(4 * slots[i], 4 * slots[i] + 4), 4 * i);
    });
    batch.fill(bodies.length, { place, turn, value: Float32Array.from(bodies, (b) => shade[b]), grown: Float32Array.from(bodies, (b) => frame.size[b]) });
  }
  let count = 0;
  const { a, b, point, load } = frame.contacts, thick = header.grain_radius * 0.45;
  const from = [], to = [], width = [], strength = [];
  if (state.chains) {
    for (let i = 0; i < a.length; i++) {
      const part = Math.min(load[i] / header.chain_shown, 1);
      if (part < 0.027) continue;
      for (const end of [a[i], b[i]]) {
        if (!header.grain[end]) continue;
        from.push(...frame.position.subarray(3 * end, 3 * end + 3));
        to.push(...point.subarray(3 * i, 3 * i + 3));
        width.push(thick * part);
        strength.push(part);
        count++;
      }
    }
  }
  tubes.fill(count, { from: new Float32Array(from), to: new Float32Array(to), radius: new Float32Array(width), value: new Float32Array(strength) });
  const [name, first, last] = state.chains ? ["normal contact force (N)", 0, header.chain_shown] : [label, low, high];
  element("quantity").textContent = name;
  element("ends").children[0].textContent = digits(first);
  element("ends").children[1].textContent = (beyond && !state.chains ? "\u2265 " : "") + digits(last);
  element("clock").textContent = `t = ${frame.time.toFixed(3)} s`;
  element("time").value = state.frame;
  draw();
  plots.forEach((plot) => plot.draw());
}

function draw() {
  const canvas = element("scene"), ratio = Math.min(window.devicePixelRatio || 1, 2);
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  gl.viewport(0, 0, width, height);
  gl.depthMask(true);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  const common = { view: viewMatrix(), project: projection(), ramp: RAMP, opacity: state.chains ? 0.5 : 1 };
  const tints = { grain: [0, 0, 0, 0], tool: [0.42, 0.48, 0.56, 1], wall: [1.25, 1.26, 1.28, 1] };
  const render = (kind) => groups.filter((group) => group.kind === kind).forEach((group) => group.batch.draw({ ...common, tint: tints[kind] }));
  if (!state.chains) { balls.draw(common); render("grain"); }
  render("tool");
  // Walls between the eye and the grains show their backs, which are not drawn.
  if (state.walls) { gl.enable(gl.CULL_FACE); render("wall"); gl.disable(gl.CULL_FACE); }
  tubes.draw(common);
  gl.enable(gl.BLEND);
  if (state.chains) {
    // Depth first, so that only the nearest ghost counts.
    gl.colorMask(false, false, false, false);
    balls.draw(common);
    gl.colorMask(true, true, true, true);
    balls.draw(common);
  }
  gl.disable(gl.BLEND);
}

// ---- plots ---------------------------------------------------------------------------------------------------------

class Plot {
  constructor(spec) {
    Object.assign(this, spec);
    this.canvas = document.createElement("canvas");
    element("plots").append(this.canvas);
    this.canvas.addEventListener("pointerdown", (event) => {
      const { left, width } = this.canvas.getBoundingClientRect();
      const [x0, x1] = this.range, s = (event.clientX - left - 62) / (width - 74);
      const time = x0 + s * (x1 - x0);
      let best = 0;
      frames.forEach((frame, i) => { if (Math.abs(frame.time - time) < Math.abs(frames[best].time - time)) best = i; });
      state.frame = best;
      load();
    });
  }
  draw() {
    const { canvas } = this, ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const c = canvas.getContext("2d");
    c.scale(ratio, ratio);
    c.font = "12px Helvetica, Arial, sans-serif";
    const on = (y) => (this.log ? Math.log10(y) : y), usable = (y) => Math.abs(y) <= 1e250 && (!this.log || y >= 1e-250);
    let low = Infinity, high = -Infinity;
    for (const { y } of this.series) for (const v of y) if (usable(v)) { low = Math.min(low, on(v)); high = Math.max(high, on(v)); }
    if (low > high) [low, high] = [0, 1];
    if (!this.log && low > 0 && low < 0.5 * high) low = 0;
    const pad = high - low > 1e-250 ? 0.05 * (high - low) : Math.abs(high) > 1e-250 ? 0.5 * Math.abs(high) : 1;
    [low, high] = [low === 0 ? 0 : low - pad, high + pad];
    this.range = [this.x[0] ?? 0, this.x[this.x.length - 1] ?? 1];
    const [x0, x1] = this.range;
    const px = (x) => 62 + ((x - x0) / (x1 - x0 || 1)) * (width - 74), py = (y) => height - 34 - ((on(y) - low) / (high - low)) * (height - 62);
    c.fillStyle = "#222";
    c.textAlign = "center";
    c.fillText(this.title, 0.5 * width, 14);
    c.fillText("time (s)", 62 + 0.5 * (width - 74), height - 4);
    // Multiples of d from low to high. No more than fit: sums of a tiny d would stand still.
    const multiples = (d, low, high) => Array.from({ length: 12 }, (_, k) => (Math.ceil(low / d - 1e-9) + k) * d).filter((v) => v <= high + 1e-9 * d);
    const step = (span) => { const p = 10 ** Math.floor(Math.log10(span / 4)); return [1, 2, 5, 10].map((d) => d * p).find((s) => s >= span / 4); };
    c.strokeStyle = "#e2e2e2";
    for (const x of multiples(step(x1 - x0 || 1), x0, x1)) {
      c.beginPath(); c.moveTo(px(x), 28); c.lineTo(px(x), height - 34); c.stroke();
      c.fillText(digits(Math.abs(x) < 1e-12 ? 0 : x), px(x), height - 20);
    }
    c.textAlign = "right";
    for (const y of multiples(this.log ? Math.max(1, Math.ceil((high - low) / 5)) : step(high - low), low, high)) {
      const v = this.log ? 10 ** y : y, at = py(v);
      c.beginPath(); c.moveTo(62, at); c.lineTo(width - 12, at); c.stroke();
      c.fillText(digits(Math.abs(v) < 1e-12 * high ? 0 : v), 58, at + 4);
    }
    c.strokeStyle = "#222";
    c.strokeRect(62, 28, width - 74, height - 62);
    const inks = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
    c.lineWidth = 1.6;
    c.textAlign = "right";
    this.series.forEach(({ label, y }, s) => {
      c.strokeStyle = c.fillStyle = inks[s % inks.length];
      c.beginPath();
      let pen = false;
      y.forEach((v, i) => { if (!usable(v)) { pen = false; return; } pen ? c.lineTo(px(this.x[i]), py(v)) : c.moveTo(px(this.x[i]), py(v)); pen = true; });
      c.stroke();
      if (this.series.length > 1) c.fillText(label, width - 18, height - 42 - 15 * (this.series.length - 1 - s));
    });
    c.strokeStyle = "#a00";
    c.lineWidth = 1;
    const now = px(frames[state.frame].time);
    c.beginPath(); c.moveTo(now, 28); c.lineTo(now, height - 34); c.stroke();
  }
}
let plots = [], autoplay = false;

// ---- interaction ---------------------------------------------------------------------------------------------------

function listen() {
  const canvas = element("scene"), pointers = new Map();
  canvas.addEventListener("pointerdown", (e) => { pointers.set(e.pointerId, [e.clientX, e.clientY]); canvas.setPointerCapture(e.pointerId); });
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (e) => pointers.delete(e.pointerId));
  canvas.addEventListener("pointermove", (e) => {
    const last = pointers.get(e.pointerId);
    if (!last) return;
    const [dx, dy] = [e.clientX - last[0], e.clientY - last[1]];
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== e.pointerId)[1];
      const gap = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]) || 1;
      camera.distance *= gap(last) / gap([e.clientX, e.clientY]);
    } else if (e.shiftKey || e.buttons === 2) {
      const { right, top } = viewAxes(), s = (camera.distance * 0.54) / canvas.clientHeight;
      camera.target = camera.target.map((t, k) => t - s * dx * right[k] + s * dy * top[k]);
    } else {
      camera.around -= dx * 0.008;
      camera.above = Math.max(-1.5, Math.min(1.5, camera.above + dy * 0.008));
    }
    pointers.set(e.pointerId, [e.clientX, e.clientY]);
    draw();
  });
  canvas.addEventListener("contextmenu", (e) => e.preventDefault());
  canvas.addEventListener("wheel", (e) => {
    e.preventDefault();
    camera.distance = Math.max(header.radius * 0.05, Math.min(header.radius * 20, camera.distance * Math.exp(e.deltaY * 0.001)));
    draw();
  }, { passive: false });
  window.addEventListener("resize", load);
  element("time").max = frames.length - 1;
  element("time").addEventListener("input", (e) => { state.frame = Number(e.target.value); load(); });
  element("color").addEventListener("change", (e) => { state.color = e.target.value; load(); });
  element("range").addEventListener("change", (e) => { state.range = e.target.value; load(); });
  element("chains").addEventListener("change", (e) => { state.chains = e.target.checked; load(); });
  element("walls").addEventListener("change", (e) => { state.walls = e.target.checked; draw(); });
  element("home").addEventListener("click", () => { home(); draw(); });
  const play = () => {
    state.playing = !state.playing;
    element("play").textContent = state.playing ? "Pause" : "Play";
    if (!state.playing) return;
    if (state.frame === frames.length - 1) state.frame = 0;
    let start = performance.now(), base = frames[state.frame].time;
    const tick = (now) => {
      if (!state.playing) return;
      const time = base + ((now - start) / 1000) * Number(element("rate").value);
      let next = state.frame;
      while (next + 1 < frames.length && frames[next + 1].time <= time) next++;
      if (next !== state.frame) { state.frame = next; load(); }
      if (next === frames.length - 1) return play();
      requestAnimationFrame(tick);
    };
    element("rate").onchange = () => { start = performance.now(); base = frames[state.frame].time; };
    element("time").onchange = () => { start = performance.now(); base = frames[state.frame].time; };
    requestAnimationFrame(tick);
  };
  element("play").addEventListener("click", play);
  // The last moment as a poster, then all of it from the start; not where the address names a moment or the reader wants no motion.
  if (autoplay && !matchMedia("(prefers-reduced-motion: reduce)").matches) setTimeout(() => { if (!state.playing && autoplay) play(); }, 1500);
  for (const name of ["pointerdown", "keydown"]) window.addEventListener(name, () => { autoplay = false; }, { capture: true, once: true });
  window.addEventListener("keydown", (e) => {
    const move = { ArrowRight: 1, ArrowLeft: -1 }[e.key];
    if (e.key === " " && e.target === document.body) { e.preventDefault(); play(); }
    else if (move && e.target === document.body) { state.frame = Math.max(0, Math.min(frames.length - 1, state.frame + move)); load(); }
  });
}

(async () => {
  try {
    element("ramp").style.background = `linear-gradient(to right, ${VIRIDIS.map((c) => `rgb(${c})`).join(",")})`;
    element("facts").textContent = header.facts;
    frames = await unpack();
    // #frame=K&chains&color=NAME&range=SHARE in the address choose what is shown first.
    const wanted = new URLSearchParams(location.hash.slice(1));
    autoplay = !wanted.has("frame");
    state.frame = Math.max(0, Math.min(frames.length - 1, Number(wanted.get("frame") ?? frames.length - 1)));
    state.chains = element("chains").checked = wanted.has("chains");
    for (const name of ["color", "range"]) if (wanted.get(name)) state[name] = element(name).value = wanted.get(name);
    setUp();
    home();
    plots = header.plots.map((spec) => new Plot(spec));
    listen();
    load();
  } catch (error) {
    fail(`The replay cannot be shown: ${error.message}`);
  }
})();
