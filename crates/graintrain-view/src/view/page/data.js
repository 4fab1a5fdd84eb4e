// Replay of a run: draws the frames embedded in this page, or sent by a run under way, with WebGL 2. No network, no libraries.
"use strict";

const element = (id) => document.getElementById(id);
const header = JSON.parse(element("header").textContent);
const state = { at: 0, playing: false, chains: false, walls: true, shadows: true, color: "speed", range: "0.95", low: 0, high: 1,
  cut: "", depth: 0.5, flip: false, towards: true, picked: -1 };
/** The frames in the order of their times, and what does not change between them. */
let frames = [], model;

/** Bytes of a text of gzip in base64. */
async function inflate(text) {
  const coded = atob(text.trim()), packed = new Uint8Array(coded.length);
  for (let i = 0; i < coded.length; i++) packed[i] = coded.charCodeAt(i);
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

/** A function that takes so many numbers of a type after those taken before. */
function taker(buffer) {
  let offset = 0;
  return (Type, count) => {
    const bytes = count * Type.BYTES_PER_ELEMENT, values = new Type(buffer.slice(offset, offset + bytes));
    if (values.length < count) throw new Error("its data end early");
    offset += bytes;
    return values;
  };
}

/** What does not change from frame to frame: see graintrain_view::view::pack for the layout. */
function readModel(buffer) {
  const take = taker(buffer), grain = take(Uint8Array, header.bodies), material = take(Uint16Array, header.bodies);
  const balls = { body: take(Uint32Array, header.balls), radius: take(Float32Array, header.balls) };
  const oriented = take(Uint32Array, header.oriented), slot = new Int32Array(header.bodies).fill(-1);
  oriented.forEach((body, k) => { slot[body] = k; });
  const groups = header.groups.map((group) => ({ kind: group.kind, bodies: take(Uint32Array, group.bodies), triangles: take(Float32Array, 9 * group.triangles) }));
  const radius = new Float32Array(header.bodies);
  balls.body.forEach((body, k) => { radius[body] = balls.radius[k]; });
  for (const group of groups) {
    let far = 0;
    for (let i = 0; i < group.triangles.length; i += 3) far = Math.max(far, Math.hypot(group.triangles[i], group.triangles[i + 1], group.triangles[i + 2]));
    group.bodies.forEach((body) => { radius[body] = Math.max(radius[body], far); });
  }
  const grains = [];
  grain.forEach((is, body) => { if (is) grains.push(body); });
  return { grain, grains, material, balls, oriented, slot, groups, radius };
}

/** Frames that were packed together: see graintrain_view::view::pack for the layout. Places stay fractions of the box, as the graphics memory takes them. */
function readFrames(buffer, chunk) {
  const take = taker(buffer), { bodies, oriented } = header, { low, high, fields, force, size } = chunk.ranges;
  const box = { low, span: low.map((l, k) => high[k] - l) };
  let previous = new Uint16Array(3 * bodies);
  return chunk.frames.map(({ time, contacts, absent }) => {
    const planes = take(Uint16Array, 3 * bodies);
    for (let i = 0; i < planes.length; i++) planes[i] += previous[i];
    previous = planes;
    const frame = { time, planes, box, absent: new Uint8Array(bodies) };
    for (const [first, end] of absent) frame.absent.fill(1, first, end);
    frame.turn = take(Int16Array, 4 * oriented);
    frame.fields = fields.map((most) => ({ most, part: take(Uint16Array, bodies) }));
    // Sizes relative to the first frame, where bodies grow.
    frame.size = size > 0 ? { most: size, part: take(Uint16Array, bodies) } : null;
    const a = take(Uint32Array, contacts), b = take(Uint32Array, contacts), point = take(Uint16Array, 3 * contacts), load = take(Uint16Array, contacts);
    frame.contacts = { a, b, point: Float32Array.from(point, (v, i) => low[i % 3] + (box.span[i % 3] * v) / 65535), load: Float32Array.from(load, (v) => (v / 65535) * force), shown: chunk.chain_shown };
    return frame;
  });
}

const place = ({ planes, box }, body) => [0, 1, 2].map((k) => box.low[k] + (box.span[k] * planes[k * header.bodies + body]) / 65535);
const grown = (frame, body) => (frame.size ? (frame.size.most * frame.size.part[body]) / 65535 : 1);
const quaternion = (frame, body) => { const s = 4 * model.slot[body]; return [0, 1, 2, 3].map((k) => frame.turn[s + k] / 32767); };
const fieldOf = (frame, k, body) => (frame.fields[k].most * frame.fields[k].part[body]) / 65535;

/** The frame at or before the moment shown, the one after it, and how far the moment is between them. */
function moment() {
  const a = Math.min(Math.floor(state.at), frames.length - 1), b = Math.min(a + 1, frames.length - 1);
  // Contacts belong to a frame: between frames there are none.
  const along = state.chains ? 0 : state.at - a;
  return { a: frames[a], b: frames[along > 0 ? b : a], along, index: Math.min(Math.round(state.at), frames.length - 1) };
}

const timeNow = () => { const { a, b, along } = moment(); return a.time + along * (b.time - a.time); };

// ---- what colours stand for -------------------------------------------------------------------------------------------

/** The first frame in which each body is there. */
function born() {
  if (model.born?.count === frames.length) return model.born.frame;
  const frame = new Int32Array(header.bodies).fill(-1);
  frames.forEach((one, k) => { for (let b = 0; b < frame.length; b++) if (frame[b] < 0 && !one.absent[b]) frame[b] = k; });
  model.born = { count: frames.length, frame };
  return frame;
}

const heights = (frame, body) => { const p = place(frame, body); return p[0] * header.up[0] + p[1] * header.up[1] + p[2] * header.up[2]; };
const every = (value) => { const all = new Float32Array(header.bodies); for (let b = 0; b < all.length; b++) all[b] = value(b); return all; };

/** Quantities by name: label, numbers of all bodies in a frame, whether the colours begin at zero, whether numbers are names. */
const QUANTITIES = new Map(header.fields.map(([name, label], k) => [name, { label, fromZero: true, of: (frame) => every((b) => fieldOf(frame, k, b)) }]));
QUANTITIES.set("height", { label: "height (m)", of: (frame) => every((b) => heights(frame, b)) });
QUANTITIES.set("origin", { label: "height at the start (m)", of: () => { const first = born(); return every((b) => heights(frames[Math.max(first[b], 0)], b)); } });
QUANTITIES.set("radius", { label: "radius (m)", of: (frame) => every((b) => model.radius[b] * grown(frame, b)) });
if (header.materials.length > 1) QUANTITIES.set("material", { label: "material", names: true, of: () => every((b) => model.material[b]) });
QUANTITIES.set("body", { label: "body", names: true, of: () => every((b) => b) });

const ranges = new Map();

/** Ends of the colours: percentiles of the grains' values, in all frames or in the one that is shown; most are looked at, not all. */
function colorRange(frame) {
  const quantity = QUANTITIES.get(state.color);
  if (quantity.names) return [0, 1, false];
  if (state.range === "hand") return [state.low, state.high > state.low ? state.high : state.low + 1, false];
  const now = state.range === "now", share = now ? 0.99 : Number(state.range), key = `${state.color} ${state.range} ${frames.length}`;
  if (!now && ranges.has(key)) return ranges.get(key);
  const shown = now ? [frame] : frames, stride = Math.max(1, Math.ceil((shown.length * model.grains.length) / 200000)), sample = [];
  let k = 0;
  for (const one of shown) {
    const all = quantity.of(one);
    for (; k < model.grains.length; k += stride) if (!one.absent[model.grains[k]]) sample.push(all[model.grains[k]]);
    k -= model.grains.length;
  }
  sample.sort((a, b) => a - b);
  const at = (part) => sample[Math.max(0, Math.min(sample.length - 1, Math.round(part * (sample.length - 1))))] ?? 0;
  let [low, high] = quantity.fromZero ? [0, at(share)] : [at(1 - share), at(share)];
  // Where nearly all are at rest, what moves still has a colour.
  if (!(high > low)) high = at(1) > low ? at(1) : low + (Math.abs(low) || 1);
  const found = [low, high, at(1) > high * (1 + 1e-6)];
  if (!now) ranges.set(key, found);
  return found;
}

/** Numbers of all bodies as fractions of the colour range; -2 for the one that is picked. */
function shades(frame) {
  const quantity = QUANTITIES.get(state.color), all = quantity.of(frame), [low, high] = colorRange(frame);
  if (!quantity.names) for (let b = 0; b < all.length; b++) all[b] = Math.min(1, Math.max(0, (all[b] - low) / (high - low)));
  if (state.picked >= 0) all[state.picked] = -2;
  return all;
}

const digits = (x) => (x === 0 ? "0" : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3 ? x.toExponential(1) : String(Number(x.toPrecision(3))));
