// ---- mathematics and the camera ------------------------------------------------------------------------------------------

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const l = Math.hypot(...a) || 1; return a.map((x) => x / l); };
const along = (a, s, b) => a.map((x, k) => x + s * b[k]);
/** v turned by the quaternion x y z w, or back by its conjugate. */
function turned(q, v, back) {
  const u = back ? q.slice(0, 3).map((x) => -x) : q.slice(0, 3), t = cross(u, v).map((x, k) => x + q[3] * v[k]);
  return along(v, 2, cross(u, t));
}

const up = header.up, radiusOfAll = Math.hypot(...header.half);
const side = (() => { const x = sub([1, 0, 0], up.map((u) => u * up[0])); return unit(Math.hypot(...x) > 1e-3 ? x : cross(up, [0, 1, 0])); })();
let camera;

/** The view that the box of the grains and tools just fills, from the side or from where it is asked. */
function home(around = -Math.PI / 3, above = 0.42) {
  camera = { around, above, distance: 0, target: header.center.slice() };
  const { towards, right, top } = viewAxes(), [width, height] = lens();
  for (let k = 0; k < 8; k++) {
    const corner = header.half.map((h, axis) => ((k >> axis) & 1 ? h : -h));
    const wide = Math.max(Math.abs(dot(right, corner)) * width, Math.abs(dot(top, corner)) * height);
    camera.distance = Math.max(camera.distance, dot(towards, corner) + wide / 0.86);
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

const eyePoint = () => along(camera.target, camera.distance, viewAxes().towards);

/** The matrix, column-major, to axes with their origin at a point. */
const axesMatrix = (x, y, z, at) => new Float32Array([x[0], y[0], z[0], 0, x[1], y[1], z[1], 0, x[2], y[2], z[2], 0, -dot(x, at), -dot(y, at), -dot(z, at), 1]);

/** World to camera axes (right, top, towards the eye). */
function viewMatrix() {
  const { towards, right, top } = viewAxes();
  return axesMatrix(right, top, towards, eyePoint());
}

const depths = () => [camera.distance * 0.02, camera.distance + radiusOfAll * 12];

function projection() {
  const [near, far] = depths(), [width, height] = lens();
  return new Float32Array([width, 0, 0, 0, 0, height, 0, 0, 0, 0, (far + near) / (near - far), -1, 0, 0, (2 * far * near) / (near - far), 0]);
}

/** The sun: axes of its light and the ball that it lights. It stands still while the camera turns. */
const SUN = (() => {
  const other = cross(up, side), a = -Math.PI / 3 - 0.85;
  const towards = unit([0, 1, 2].map((k) => 0.75 * (Math.cos(a) * side[k] + Math.sin(a) * other[k]) + up[k]));
  const right = unit(cross(up, towards));
  return { towards, right, top: cross(towards, right), reach: 1.25 * radiusOfAll };
})();

/** World to the sun's axes, and from these to clip space: a box about the scene. */
function sunMatrices() {
  const { towards, right, top, reach } = SUN, s = 1 / reach;
  return [axesMatrix(right, top, towards, header.center), new Float32Array([s, 0, 0, 0, 0, s, 0, 0, 0, 0, -s, 0, 0, 0, 0, 1])];
}

/** The plane of the cut as (n, d): what has n . p > d is taken away; null where there is none. */
function cutPlane() {
  if (state.cut === "") return null;
  const sign = state.flip === state.towards ? -1 : 1, part = 2 * state.depth - 1;
  if (state.cut === "eye") {
    const { towards } = viewAxes(), reach = towards.reduce((sum, t, k) => sum + Math.abs(t) * header.half[k], 0);
    return [...towards.map((t) => sign * t), sign * (dot(towards, header.center) + part * reach)];
  }
  const axis = Number(state.cut), n = [0, 1, 2].map((k) => (k === axis ? sign : 0));
  return [...n, sign * (header.center[axis] + part * header.half[axis] * 1.02)];
}

// ---- picking -----------------------------------------------------------------------------------------------------------------

/** Where a ray first meets a triangle list, as the parameter; Moeller and Trumbore (1997). */
function meetTriangles(from, ray, corners) {
  let best = Infinity;
  for (let i = 0; i < corners.length; i += 9) {
    const e1x = corners[i + 3] - corners[i], e1y = corners[i + 4] - corners[i + 1], e1z = corners[i + 5] - corners[i + 2];
    const e2x = corners[i + 6] - corners[i], e2y = corners[i + 7] - corners[i + 1], e2z = corners[i + 8] - corners[i + 2];
    const px = ray[1] * e2z - ray[2] * e2y, py = ray[2] * e2x - ray[0] * e2z, pz = ray[0] * e2y - ray[1] * e2x;
    const det = e1x * px + e1y * py + e1z * pz;
    if (det === 0) continue;
    const sx = from[0] - corners[i], sy = from[1] - corners[i + 1], sz = from[2] - corners[i + 2], u = (sx * px + sy * py + sz * pz) / det;
    const qx = sy * e1z - sz * e1y, qy = sz * e1x - sx * e1z, qz = sx * e1y - sy * e1x, v = (ray[0] * qx + ray[1] * qy + ray[2] * qz) / det;
    const t = (e2x * qx + e2y * qy + e2z * qz) / det;
    if (u >= 0 && v >= 0 && u + v <= 1 && t > 0 && t < best) best = t;
  }
  return best;
}

/** The body that is seen at a point of the canvas (pixels from its upper left corner), or -1. */
function bodyAt(x, y) {
  const canvas = element("scene"), [width, height] = lens(), { towards, right, top } = viewAxes(), from = eyePoint();
  const h = (2 * x / canvas.clientWidth - 1) / width, v = (1 - 2 * y / canvas.clientHeight) / height;
  const ray = unit([0, 1, 2].map((k) => h * right[k] + v * top[k] - towards[k]));
  const frame = frames[moment().index], cut = cutPlane();
  let best = Infinity, found = -1;
  // Behind a cut the first point that is left counts.
  const meet = (body, enter, leave) => {
    let t = enter;
    if (cut) {
      const rest = cut[3] - dot(cut, from), slope = dot(cut, ray);
      if (slope * t > rest) t = slope < 0 ? rest / slope : Infinity;
      if (t > leave) return;
    }
    if (t > 0 && t < best) { best = t; found = body; }
  };
  model.balls.body.forEach((body, k) => {
    if (frame.absent[body]) return;
    const to = sub(place(frame, body), from), b = dot(to, ray), r = model.balls.radius[k] * grown(frame, body), q = b * b - dot(to, to) + r * r;
    if (q > 0) meet(body, b - Math.sqrt(q), b + Math.sqrt(q));
  });
  for (const walls of [false, true]) {
    // A wall only where there is nothing else.
    if (walls && (found >= 0 || !state.walls)) break;
    for (const { kind, bodies, triangles } of model.groups) {
      if ((kind === "wall") !== walls) continue;
      for (const body of bodies) {
        const to = sub(place(frame, body), from), b = dot(to, ray), r = model.radius[body] * grown(frame, body);
        if (frame.absent[body] || dot(to, to) - b * b > r * r) continue;
        const q = quaternion(frame, body), s = 1 / grown(frame, body);
        const t = meetTriangles(turned(q, to, true).map((p) => -s * p), turned(q, ray, true).map((d) => s * d), triangles);
        if (t < Infinity) meet(body, t, t + 2 * r);
      }
    }
  }
  return found;
}
