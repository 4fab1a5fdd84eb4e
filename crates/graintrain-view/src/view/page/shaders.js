// ---- shaders -----------------------------------------------------------------------------------------------------------------

/** Places between two frames: fractions of their boxes, with whether the body is there in the fourth number. */
const PLACED = `
uniform vec3 lowA, spanA, lowB, spanB; uniform float along, jump; uniform mat4 view, project;
bool there(vec4 a, vec4 b) { return (along < 0.5 ? a.w : b.w) > 0.5; }
vec3 between(vec4 a, vec4 b) {
  vec3 p = lowA + spanA * a.xyz, q = lowB + spanB * b.xyz;
  return a.w < 0.5 || b.w < 0.5 || distance(p, q) > jump ? (along < 0.5 ? p : q) : mix(p, q, along);
}`;

/** Colours, light and shadow in the fragment; the plane of the cut in camera axes: what has cut.xyz . p > cut.w is away. */
const LIGHT = `
precision highp float; precision highp sampler2DShadow;
uniform vec3 ramp[17]; uniform vec4 tint, cut; uniform vec3 sun, fill, sky; uniform mat4 toSun; uniform sampler2DShadow shadow; uniform float names, bias;
out vec4 color;
bool away(vec3 p) { return dot(cut.xyz, p) > cut.w; }
float lit(vec3 p, vec3 n) {
  vec3 q = (toSun * vec4(p + bias * n, 1.0)).xyz;
  if (any(lessThan(q, vec3(0.0))) || any(greaterThan(q, vec3(1.0)))) return 1.0;
  float step = 0.8 / float(textureSize(shadow, 0).x), sum = 0.0;
  for (int i = 0; i < 4; i++) sum += texture(shadow, q + vec3(step * vec2(float(i & 1) * 2.0 - 1.0, float(i >> 1) * 2.0 - 1.0), 0.0));
  return 0.25 * sum;
}
vec3 light(vec3 base, vec3 n, vec3 p) {
  float facing = max(dot(n, sun), 0.0), open = facing > 0.0 ? lit(p, n) : 0.0;
  float diffuse = 0.42 + 0.10 * dot(n, sky) + 0.58 * facing * open + 0.20 * max(dot(n, fill), 0.0);
  return base * diffuse + 0.18 * open * pow(max(dot(n, normalize(sun - normalize(p))), 0.0), 40.0);
}
vec3 paint(float s) {
  if (tint.a > 0.0) return tint.rgb;
  if (s < -1.0) return vec3(1.0, 0.33, 0.1);
  if (names > 0.0) { vec3 k = mod(vec3(5.0, 3.0, 1.0) + 6.0 * fract(s * 0.618034), 6.0); return 0.88 - 0.44 * clamp(min(k, 4.0 - k), 0.0, 1.0); }
  float x = clamp(s, 0.0, 1.0) * 16.0; int i = min(int(x), 15);
  return mix(ramp[i], ramp[i + 1], x - float(i));
}`;

const BALL = `#version 300 es
in vec2 corner; in vec4 placeA, placeB; in float radiusA, radiusB, valueA, valueB;${PLACED}
out vec3 ray; flat out vec3 middle; flat out float size, shade;`;
const TURN = `
in vec3 vertex, normal; in vec4 placeA, placeB, turnA, turnB; in float grownA, grownB, valueA, valueB;${PLACED}
vec3 rotate(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
vec4 turning() { return normalize(mix(turnA, dot(turnA, turnB) < 0.0 ? -turnB : turnB, along)); }
vec3 cornerPlace(vec4 q) { return (view * vec4(between(placeA, placeB) + rotate(q, mix(grownA, grownB, along) * vertex), 1.0)).xyz; }`;
const NOWHERE = "if (!there(placeA, placeB)) { gl_Position = vec4(2.0, 2.0, 2.0, 1.0); return; }";

const SHADERS = {
  // A ball: a square that faces the eye and covers the silhouette; the ray meets the ball in the fragment. A cut shows its flat inside.
  ball: [`${BALL}
void main() {
  ${NOWHERE}
  middle = (view * vec4(between(placeA, placeB), 1.0)).xyz; size = mix(radiusA, radiusB, along); shade = mix(valueA, valueB, along);
  float d2 = dot(middle, middle), reach = size * sqrt(d2 / max(d2 - size * size, 1e-12));
  vec3 forward = normalize(middle), right = normalize(cross(forward, vec3(0, 1, 0)));
  ray = middle + reach * (corner.x * right + corner.y * cross(right, forward));
  gl_Position = project * vec4(ray, 1.0);
}`, `#version 300 es${LIGHT}
in vec3 ray; flat in vec3 middle; flat in float size, shade;
uniform mat4 project; uniform float ghost;
void main() {
  float a = dot(ray, ray), b = dot(ray, middle), c = dot(middle, middle) - size * size, q = b * b - a * c;
  if (q < 0.0) discard;
  q = sqrt(q);
  vec3 p = ray * (b - q) / a, n = (p - middle) / size;
  if (away(p)) {
    float t = cut.w / dot(cut.xyz, ray);
    if (!(t > (b - q) / a && t < (b + q) / a)) discard;
    p = ray * t; n = cut.xyz;
  }
  vec4 clip = project * vec4(p, 1.0);
  gl_FragDepth = 0.5 * clip.z / clip.w + 0.5;
  if (ghost > 0.0 && shade > -1.0) { float rim = 1.0 - max(dot(n, -normalize(p)), 0.0); color = vec4(light(vec3(0.6, 0.64, 0.7), n, p), 0.10 + 0.3 * rim * rim); }
  else color = vec4(light(paint(shade), n, p), 1.0);
}`],
  // The same seen from the sun, whose rays are parallel.
  ballShadow: [`${BALL}
void main() {
  ${NOWHERE}
  middle = (view * vec4(between(placeA, placeB), 1.0)).xyz; size = mix(radiusA, radiusB, along); ray = vec3(corner, 0.0);
  gl_Position = project * vec4(middle + size * ray, 1.0);
}`, `#version 300 es
precision highp float;
in vec3 ray; flat in vec3 middle; flat in float size; uniform mat4 project; uniform vec4 cut;
void main() {
  float r2 = dot(ray.xy, ray.xy);
  if (r2 > 1.0) discard;
  vec3 p = middle + size * vec3(ray.xy, sqrt(1.0 - r2));
  if (dot(cut.xyz, p) > cut.w) discard;
  gl_FragDepth = 0.5 * (project * vec4(p, 1.0)).z + 0.5;
}`],
  // Triangles of one geometry, placed by every body that has it.
  mesh: [`#version 300 es${TURN}
out vec3 at, facing; flat out float shade;
void main() {
  ${NOWHERE}
  vec4 q = turning();
  at = cornerPlace(q); facing = mat3(view) * rotate(q, normal); shade = mix(valueA, valueB, along);
  gl_Position = project * vec4(at, 1.0);
}`, `#version 300 es${LIGHT}
in vec3 at, facing; flat in float shade; uniform float solid;
void main() {
  if (away(at)) discard;
  vec3 n = normalize(facing);
  // Inside of what is cut the plane of the cut shows.
  if (!gl_FrontFacing) n = solid > 0.0 && cut.w < 1e20 ? cut.xyz : -n;
  color = vec4(light(shade < -1.0 ? vec3(1.0, 0.33, 0.1) : paint(shade), n, at), 1.0);
}`],
  meshShadow: [`#version 300 es${TURN}
out vec3 at;
void main() { ${NOWHERE} at = cornerPlace(turning()); gl_Position = project * vec4(at, 1.0); }`, `#version 300 es
precision highp float;
in vec3 at; uniform vec4 cut;
void main() { if (dot(cut.xyz, at) > cut.w) discard; }`],
  // A tube: a strip along the segment that faces the eye, shaded as if round.
  tube: [`#version 300 es
in vec2 corner; in vec3 from, to; in float radiusA, valueA; uniform mat4 view, project;
out vec3 at, across; out float edge; flat out float shade;
void main() {
  vec3 a = (view * vec4(from, 1.0)).xyz, b = (view * vec4(to, 1.0)).xyz;
  vec3 p = corner.y < 0.0 ? a : b; across = normalize(cross(b - a, p));
  edge = corner.x; shade = valueA; at = p + corner.x * radiusA * across;
  gl_Position = project * vec4(at, 1.0);
}`, `#version 300 es${LIGHT}
in vec3 at, across; in float edge; flat in float shade;
void main() {
  if (away(at)) discard;
  vec3 n = normalize(edge * across - sqrt(max(1.0 - edge * edge, 0.0)) * normalize(at));
  color = vec4(light(paint(shade), n, at), 1.0);
}`],
  // How much of the sky is hidden at each pixel: screen-space obscurance (McGuire et al. 2011), as in graintrain_view::render.
  hidden: [`#version 300 es
in vec2 corner; void main() { gl_Position = vec4(corner, 0.0, 1.0); }`, `#version 300 es
precision highp float;
uniform highp sampler2D depth; uniform vec3 scales; uniform vec4 optics; out vec4 color;
vec3 place(ivec2 at) {
  ivec2 size = textureSize(depth, 0); at = clamp(at, ivec2(0), size - 1);
  float z = optics.x * optics.y / (optics.y - texelFetch(depth, at, 0).r * (optics.y - optics.x));
  return vec3(((vec2(at) + 0.5) / vec2(size) * 2.0 - 1.0) / optics.zw, -1.0) * z;
}
vec3 flatter(vec3 a, vec3 b) { return abs(a.z) < abs(b.z) ? a : b; }
void main() {
  int fine = int(scales.x); ivec2 here = ivec2(gl_FragCoord.xy) * fine;
  if (texelFetch(depth, here, 0).r >= 1.0) { color = vec4(0.0); return; }
  vec3 p = place(here), dx = flatter(place(here + ivec2(fine, 0)) - p, p - place(here - ivec2(fine, 0))), dy = flatter(place(here + ivec2(0, fine)) - p, p - place(here - ivec2(0, fine)));
  vec3 n = normalize(cross(dx, dy));
  float reach = scales.y, radius = min(reach * scales.z / -p.z, 0.2 * float(textureSize(depth, 0).y)), sum = 0.0;
  float turn = float((int(gl_FragCoord.x) & 3) * 4 + (int(gl_FragCoord.y) & 3)) / 16.0;
  for (int k = 0; k < 12; k++) {
    float far = radius * sqrt((float(k) + turn) / 12.0), angle = 2.399963 * float(k) + 6.2831853 * turn;
    vec3 to = place(here + ivec2(far * vec2(cos(angle), sin(angle)))) - p; float l = length(to);
    if (l > 0.0) sum += max(dot(n, to) / l - 0.06, 0.0) * max(1.0 - l / reach, 0.0);
  }
  color = vec4(min(sum / 6.0, 1.0));
}`],
  // Samples of a pixel averaged, darkened where the sky is hidden.
  whole: [`#version 300 es
in vec2 corner; void main() { gl_Position = vec4(corner, 0.0, 1.0); }`, `#version 300 es
precision highp float;
uniform sampler2D image, veil; uniform highp sampler2D depth; uniform vec3 scales, ground; uniform float strength, near; out vec4 color;
void main() {
  int fine = int(scales.x); ivec2 at = ivec2(gl_FragCoord.xy); vec3 sum = vec3(0.0);
  for (int k = 0; k < fine * fine; k++) { ivec2 s = at * fine + ivec2(k % fine, k / fine); sum += texelFetch(depth, s, 0).r >= 1.0 ? ground : texelFetch(image, s, 0).rgb; }
  sum /= float(fine * fine);
  float d = texelFetch(depth, at * fine, 0).r, dark = 0.0, weight = 0.0;
  if (strength > 0.0 && d < 1.0) for (int k = 0; k < 16; k++) {
    ivec2 s = clamp(at + ivec2(k & 3, k >> 2) - 1, ivec2(0), textureSize(veil, 0) - 1);
    // Only over the same surface: edges stay sharp.
    if (abs(texelFetch(depth, s * fine, 0).r - d) < near * (1.0 - d)) { dark += texelFetch(veil, s, 0).r; weight += 1.0; }
  }
  color = vec4(sum * clamp(1.0 - strength * dark / max(weight, 1.0), 0.25, 1.0), 1.0);
}`],
};
