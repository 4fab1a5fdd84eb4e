// ---- drawing -----------------------------------------------------------------------------------------------------------------

const VIRIDIS = [[68,1,84],[72,24,106],[71,45,123],[66,64,134],[59,82,139],[51,99,141],[44,114,142],[38,130,142],
  [33,145,140],[31,160,136],[40,174,128],[63,188,115],[94,201,98],[132,212,75],[173,220,48],[216,226,25],[253,231,37]];
const RAMP = new Float32Array(VIRIDIS.flat().map((c) => c / 255));
const SQUARE = { size: 2, data: new Float32Array([-1, -1, 1, -1, -1, 1, 1, 1]) };
const SHADOW_PIXELS = 2048;
/** No cut. */
const UNCUT = new Float32Array([0, 0, 0, 1e30]);

let gl, programs = {}, balls, tubes, groups = [], screen, sunTarget, target;
/** Samples along a pixel's edge and whether the sky's light is veiled: less while a slow machine moves, all when it rests. */
const quality = { fine: 2, veil: true, slow: 0 };

function compile(name, [vertex, fragment]) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(`${name}: ${gl.getShaderInfoLog(shader)}`);
    gl.attachShader(program, shader);
  }
  // Two programs share a batch's attributes: the same place in both.
  ATTRIBUTES.forEach((attribute, place) => gl.bindAttribLocation(program, place, attribute));
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(`${name}: ${gl.getProgramInfoLog(program)}`);
  const places = new Map();
  for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i++) {
    const uniform = gl.getActiveUniform(program, i).name;
    places.set(uniform.replace("[0]", ""), gl.getUniformLocation(program, uniform));
  }
  return { program, places };
}
const ATTRIBUTES = ["corner", "placeA", "placeB", "radiusA", "radiusB", "valueA", "valueB", "vertex", "normal", "turnA", "turnB", "grownA", "grownB", "from", "to"];

/** What is drawn many times over: numbers of each corner, and numbers of each body that `fill` sets. */
class Batch {
  constructor(mode, corners, bodies) {
    Object.assign(this, { mode, vao: gl.createVertexArray(), count: 0, instances: 0, buffers: {} });
    gl.bindVertexArray(this.vao);
    for (const [name, { size, data }] of Object.entries(corners)) {
      this.attribute(name, size, gl.FLOAT, 0);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      this.count = data.length / size;
    }
    for (const [name, [size, type]] of Object.entries(bodies)) this.attribute(name, size, type, 1);
  }
  attribute(name, size, type, divisor) {
    const place = ATTRIBUTES.indexOf(name);
    this.buffers[name] = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, type, type !== gl.FLOAT, 0, 0);
    gl.vertexAttribDivisor(place, divisor);
  }
  fill(instances, values) {
    this.instances = instances;
    for (const [name, data] of Object.entries(values)) {
      gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[name]);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    }
  }
  draw({ program, places }, uniforms) {
    if (!this.instances) return;
    gl.useProgram(program);
    let unit = 0;
    for (const [name, place] of places) {
      const value = uniforms[name];
      if (value === undefined) throw new Error(`nothing for ${name}`);
      if (typeof value === "number") gl.uniform1f(place, value);
      else if (value.length === 16) gl.uniformMatrix4fv(place, false, value);
      else if (value.length === 4) gl.uniform4fv(place, value);
      else if (value.length) gl.uniform3fv(place, value);
      else { gl.activeTexture(gl.TEXTURE0 + unit); gl.bindTexture(gl.TEXTURE_2D, value); gl.uniform1i(place, unit++); }
    }
    gl.bindVertexArray(this.vao);
    gl.drawArraysInstanced(this.mode, 0, this.count, this.instances);
  }
}

/** Normals of a surface's corners: means over the faces about them that turn by less than 35 degrees. */
function normals(corners) {
  const faces = corners.length / 9, own = new Float32Array(3 * faces), about = new Map();
  const key = (i) => `${corners[i].toPrecision(5)} ${corners[i + 1].toPrecision(5)} ${corners[i + 2].toPrecision(5)}`;
  for (let f = 0; f < faces; f++) {
    const [a, b, c] = [0, 3, 6].map((k) => Array.from(corners.subarray(9 * f + k, 9 * f + k + 3)));
    own.set(unit(cross(sub(b, a), sub(c, a))), 3 * f);
    for (const k of [0, 3, 6]) { const at = key(9 * f + k); about.has(at) ? about.get(at).push(f) : about.set(at, [f]); }
  }
  const found = new Float32Array(corners.length);
  for (let f = 0; f < faces; f++) for (const k of [0, 3, 6]) {
    const n = own.subarray(3 * f, 3 * f + 3), sum = [0, 0, 0];
    for (const g of about.get(key(9 * f + k))) if (n[0] * own[3 * g] + n[1] * own[3 * g + 1] + n[2] * own[3 * g + 2] > 0.82) for (let j = 0; j < 3; j++) sum[j] += own[3 * g + j];
    found.set(unit(sum), 9 * f + k);
  }
  return found;
}

/** A picture in the graphics memory: colours if wanted, depths. */
function makeTarget(width, height, withColor, compares) {
  const made = { width, height, frame: gl.createFramebuffer(), depth: gl.createTexture(), color: null };
  const texture = (texture, inside, format, type, filter) => {
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, inside, width, height, 0, format, type, null);
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, filter], [gl.TEXTURE_MAG_FILTER, filter], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE]]) gl.texParameteri(gl.TEXTURE_2D, name, value);
  };
  gl.bindFramebuffer(gl.FRAMEBUFFER, made.frame);
  texture(made.depth, gl.DEPTH_COMPONENT24, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, compares ? gl.LINEAR : gl.NEAREST);
  if (compares) { gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE); gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_FUNC, gl.LEQUAL); }
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, made.depth, 0);
  if (withColor) {
    made.color = gl.createTexture();
    texture(made.color, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, gl.NEAREST);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, made.color, 0);
  } else { gl.drawBuffers([gl.NONE]); gl.readBuffer(gl.NONE); }
  return made;
}

function dropTarget(old) {
  gl.deleteTexture(old.depth);
  if (old.color) gl.deleteTexture(old.color);
  gl.deleteFramebuffer(old.frame);
}

function setUp() {
  gl = element("scene").getContext("webgl2", { antialias: false, alpha: false });
  if (!gl) throw new Error("this browser offers no WebGL 2");
  for (const [name, texts] of Object.entries(SHADERS)) programs[name] = compile(name, texts);
  sunTarget = makeTarget(SHADOW_PIXELS, SHADOW_PIXELS, false, true);
  screen = new Batch(gl.TRIANGLE_STRIP, { corner: SQUARE }, {});
  screen.instances = 1;
  tubes = new Batch(gl.TRIANGLE_STRIP, { corner: SQUARE }, { from: [3, gl.FLOAT], to: [3, gl.FLOAT], radiusA: [1, gl.FLOAT], valueA: [1, gl.FLOAT] });
  gl.enable(gl.DEPTH_TEST);
  gl.depthFunc(gl.LEQUAL);
  gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
}

/** Surfaces of the model. */
function setUpModel() {
  const two = (name, entry) => ({ [`${name}A`]: entry, [`${name}B`]: entry }), places = two("place", [4, gl.UNSIGNED_SHORT]), one = [1, gl.FLOAT];
  balls = new Batch(gl.TRIANGLE_STRIP, { corner: SQUARE }, { ...places, ...two("radius", one), ...two("value", one) });
  groups = model.groups.map(({ kind, bodies, triangles }) => {
    const corners = { vertex: { size: 3, data: triangles }, normal: { size: 3, data: normals(triangles) } };
    return { kind, bodies, batch: new Batch(gl.TRIANGLES, corners, { ...places, ...two("turn", [4, gl.SHORT]), ...two("grown", one), ...two("value", one) }) };
  });
}

/** Places of some bodies in a frame, with whether they are there. */
function placesOf({ planes, absent }, bodies) {
  const all = header.bodies, found = new Uint16Array(4 * bodies.length);
  for (let i = 0; i < bodies.length; i++) {
    const b = bodies[i];
    found[4 * i] = planes[b]; found[4 * i + 1] = planes[all + b]; found[4 * i + 2] = planes[2 * all + b]; found[4 * i + 3] = absent[b] ? 0 : 65535;
  }
  return found;
}

function picks(values, bodies) {
  const found = new Float32Array(bodies.length);
  for (let i = 0; i < bodies.length; i++) found[i] = values[bodies[i]];
  return found;
}

/** Moves what a frame has of balls and groups to the graphics memory, as the first or the second of two. */
function upload(frame, which) {
  const shade = shades(frame), { body, radius } = model.balls;
  const radii = frame.size ? Float32Array.from(body, (b, i) => radius[i] * grown(frame, b)) : radius;
  balls.fill(body.length, { [`place${which}`]: placesOf(frame, body), [`radius${which}`]: radii, [`value${which}`]: picks(shade, body) });
  for (const { batch, bodies } of groups) {
    const turn = new Int16Array(4 * bodies.length), sizes = new Float32Array(bodies.length);
    for (let i = 0; i < bodies.length; i++) {
      const slot = 4 * model.slot[bodies[i]];
      for (let k = 0; k < 4; k++) turn[4 * i + k] = frame.turn[slot + k];
      sizes[i] = grown(frame, bodies[i]);
    }
    batch.fill(bodies.length, { [`place${which}`]: placesOf(frame, bodies), [`turn${which}`]: turn, [`grown${which}`]: sizes, [`value${which}`]: picks(shade, bodies) });
  }
}

/** Tubes of the contact forces of a frame, and of the way of the body that is picked. */
function uploadTubes(frame) {
  const from = [], to = [], width = [], strength = [], { a, b, point, load, shown } = frame.contacts;
  const add = (p, q, radius, value) => { from.push(...p); to.push(...q); width.push(radius); strength.push(value); };
  if (state.chains) for (let i = 0; i < a.length; i++) {
    const part = Math.min(load[i] / shown, 1), at = point.subarray(3 * i, 3 * i + 3);
    if (part >= 0.027) for (const end of [a[i], b[i]]) {
      const p = place(frame, end);
      // Across the faces of a periodic cell the other body is elsewhere.
      if (model.grain[end] && Math.hypot(...sub(p, at)) < header.jump) add(p, at, header.grain_radius * 0.45 * part, part);
    }
  }
  if (state.picked >= 0) for (let k = 1; k < frames.length; k++) {
    const [p, q] = [frames[k - 1], frames[k]].map((one) => place(one, state.picked));
    const is = !frames[k - 1].absent[state.picked] && !frames[k].absent[state.picked] && Math.hypot(...sub(p, q)) < header.jump;
    if (is) add(p, q, header.grain_radius * 0.12, -2);
  }
  tubes.fill(width.length, { from: new Float32Array(from), to: new Float32Array(to), radiusA: new Float32Array(width), valueA: new Float32Array(strength) });
}

const loaded = { key: "" };

/** Sees to it that the graphics memory has the two frames about the moment. */
function load() {
  const { a, b } = moment();
  const key = `${state.color} ${state.range} ${state.low} ${state.high} ${state.picked} ${state.chains} ${frames.length}`;
  if (loaded.key === key && loaded.a === a && loaded.b === b) return;
  upload(a, "A");
  upload(b, "B");
  if (loaded.key !== key || loaded.a !== a) uploadTubes(a);
  Object.assign(loaded, { key, a, b, sun: "" });
}

/** v in camera axes. */
const seen = (view, v) => [0, 1, 2].map((k) => view[k] * v[0] + view[4 + k] * v[1] + view[8 + k] * v[2]);

/** The cut in axes whose matrix is `view`. */
function cutIn(view) {
  const plane = cutPlane();
  if (!plane) return UNCUT;
  const n = seen(view, plane);
  return new Float32Array([...n, plane[3] + dot(n, [view[12], view[13], view[14]])]);
}

/** Depths as the sun sees them; only where something has changed. */
function drawShadows(places) {
  const [view, project] = sunMatrices(), cut = cutIn(view), key = [places.along, state.chains, state.shadows, ...cut].join();
  if (loaded.sun === key) return;
  loaded.sun = key;
  gl.bindFramebuffer(gl.FRAMEBUFFER, sunTarget.frame);
  gl.viewport(0, 0, SHADOW_PIXELS, SHADOW_PIXELS);
  gl.depthMask(true);
  gl.clear(gl.DEPTH_BUFFER_BIT);
  if (!state.shadows) return;
  const uniforms = { ...places, view, project, cut };
  if (!state.chains) balls.draw(programs.ballShadow, uniforms);
  for (const { kind, batch } of groups) if (kind === "tool" || (kind === "grain" && !state.chains)) batch.draw(programs.meshShadow, uniforms);
}

/** The product of two matrices, column-major. */
const times = (a, b) => new Float32Array(16).map((_, i) => { let sum = 0; for (let k = 0; k < 4; k++) sum += a[4 * k + (i % 4)] * b[4 * (i >> 2) + k]; return sum; });

/** From camera axes to the picture of the sun, with numbers from 0 to 1. */
function toSun() {
  const { towards, right, top } = viewAxes(), eye = eyePoint(), [view, project] = sunMatrices();
  const back = new Float32Array([...right, 0, ...top, 0, ...towards, 0, ...eye, 1]);
  const half = new Float32Array([0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0.5, 0.5, 0.5, 1]);
  return times(half, times(project, times(view, back)));
}

const isDark = () => document.documentElement.dataset.theme === "dark";
const ground = () => (isDark() ? [0.078, 0.09, 0.106] : [0.945, 0.955, 0.965]);

/** Draws bodies, walls and tubes. */
function drawBodies(common) {
  const tints = { grain: [0, 0, 0, 0], tool: [0.45, 0.51, 0.59, 1], wall: isDark() ? [0.5, 0.52, 0.55, 1] : [0.8, 0.81, 0.83, 1] };
  const render = (kind) => { for (const group of groups) if (group.kind === kind) group.batch.draw(programs.mesh, { ...common, tint: tints[kind], solid: kind === "wall" ? 0 : 1, cut: kind === "wall" ? UNCUT : common.cut }); };
  const all = { ...common, tint: tints.grain };
  if (!state.chains) { balls.draw(programs.ball, { ...all, ghost: 0 }); render("grain"); }
  render("tool");
  // Walls between the eye and the grains show their backs, which are not drawn.
  if (state.walls) { gl.enable(gl.CULL_FACE); render("wall"); gl.disable(gl.CULL_FACE); }
  tubes.draw(programs.tube, { ...all, names: 0 });
  if (!state.chains) return;
  gl.enable(gl.BLEND);
  // Depth first, so that only the nearest ghost counts.
  gl.colorMask(false, false, false, false);
  balls.draw(programs.ball, { ...all, ghost: 1 });
  gl.colorMask(true, true, true, true);
  balls.draw(programs.ball, { ...all, ghost: 1 });
  gl.disable(gl.BLEND);
}

/** Draws the moment into the canvas, whose pixels are `ratio` to a CSS pixel. */
function draw(ratio = Math.min(window.devicePixelRatio || 1, 2)) {
  if (!frames.length) return;
  load();
  const canvas = element("scene"), { a, b, along } = moment(), fine = ratio >= 2 && quality.fine > 1 ? 1 : quality.fine;
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  if (!target || target.big.width !== width * fine || target.big.height !== height * fine) {
    if (target) { dropTarget(target.big); dropTarget(target.veil); }
    target = { big: makeTarget(width * fine, height * fine, true, false), veil: makeTarget(width, height, true, false) };
  }
  const places = { lowA: a.box.low, spanA: a.box.span, lowB: b.box.low, spanB: b.box.span, along, jump: header.jump };
  drawShadows(places);
  const view = viewMatrix(), [near, far] = depths(), [wide, high] = lens(), names = QUANTITIES.get(state.color).names ? 1 : 0;
  gl.bindFramebuffer(gl.FRAMEBUFFER, target.big.frame);
  gl.viewport(0, 0, width * fine, height * fine);
  gl.depthMask(true);
  gl.clearColor(...ground(), 1);
  gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  drawBodies({ ...places, view, project: projection(), ramp: RAMP, names, cut: cutIn(view), sun: seen(view, SUN.towards), sky: seen(view, up), fill: unit([0.8, 0.1, 0.5]),
    toSun: toSun(), shadow: sunTarget.depth, bias: (3 * SUN.reach) / SHADOW_PIXELS });
  const scales = [fine, 2.5 * header.grain_radius, 0.5 * high * height * fine], optics = new Float32Array([near, far, wide, high]);
  const through = { scales, optics, depth: target.big.depth, image: target.big.color, veil: target.veil.color, ground: ground(), strength: quality.veil ? (state.chains ? 0.5 : 1.25) : 0, near: (2 * header.grain_radius) / camera.distance };
  gl.disable(gl.DEPTH_TEST);
  gl.viewport(0, 0, width, height);
  if (quality.veil) { gl.bindFramebuffer(gl.FRAMEBUFFER, target.veil.frame); screen.draw(programs.hidden, through); }
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  screen.draw(programs.whole, through);
  gl.enable(gl.DEPTH_TEST);
}
