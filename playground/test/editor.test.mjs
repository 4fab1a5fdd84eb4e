// The editor's completion and sliders, on the schema and the scenes of the program (GRAINTRAIN, default target/debug/graintrain). Needs no packages.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import test from "node:test";
import { fileURLToPath } from "node:url";
import { complete, dotted, keysOf, tableAbove, valuesOf } from "../completion.js";
import { changed, parameters, range } from "../parameters.js";
import { SCENES } from "../scenes.js";

const program = process.env.GRAINTRAIN ?? fileURLToPath(new URL("../../target/debug/graintrain", import.meta.url));
const graintrain = (...args) => execFileSync(program, args, { encoding: "utf8", maxBuffer: 1 << 26 });
const schema = JSON.parse(graintrain("schema"));
const labels = (found) => found.options.map(({ label }) => label);

test("keys of a table are those that the program names", () => {
  const keys = keysOf(schema, ["time"]).map(({ label }) => label);
  assert.deepEqual(keys.sort(), ["end", "step", "steps"]);
  assert.ok(keysOf(schema, []).some(({ label }) => label === "material"));
  assert.ok(keysOf(schema, ["material", "glass"]).some(({ label, info }) => label === "friction" && info.length > 10));
  assert.ok(keysOf(schema, ["stage"]).some(({ label }) => label === "name"), "a list of tables");
  assert.deepEqual(keysOf(schema, ["no such table"]), []);
});

test("what may stand at the cursor", () => {
  assert.ok(labels(complete(schema, "[ti")).includes("time"));
  assert.equal(complete(schema, "[ti").from, 1);
  assert.ok(labels(complete(schema, "[time]\nst")).includes("step"));
  assert.ok(labels(complete(schema, "[solver]\nfriction = ")).includes('"relaxed"'));
  assert.equal(complete(schema, '[solver]\nfriction = "re').from, 'friction = '.length);
  assert.equal(complete(schema, "[time] # st"), null);
  assert.deepEqual(valuesOf(schema, ["time"], "step"), []);
  assert.deepEqual(dotted('body."a b".shape'), ["body", "a b", "shape"]);
  assert.deepEqual(tableAbove(["[time]", "step = 1", "[[stage]]", "name = 2"]), ["stage"]);
});

test("sliders read literal numbers and write them back", () => {
  const scene = '[parameters]\nn = 8   # of grains\nradius = "0.1 m"\nspeed = "10 mm/s" # of the wall\nside = "2*n * radius"\nmu = 2.5e-1\ncold = "-3 K"\n[time]\nstep = 1\n';
  const found = parameters(scene);
  assert.deepEqual(found.map(({ name, value, unit }) => [name, value, unit]), [["n", 8, ""], ["radius", 0.1, "m"], ["speed", 10, "mm/s"], ["mu", 0.25, ""], ["cold", -3, "K"]]);
  assert.equal(found[0].comment, "of grains");
  const other = changed(changed(scene, found[0], 3.2), found[2], 12.3456);
  assert.deepEqual(parameters(other).map(({ value }) => value), [3, 0.1, 12.35, 0.25, -3]);
  assert.equal(other.split("\n")[3], 'speed = "12.35 mm/s" # of the wall');
  for (const parameter of found) {
    const { low, high, step } = range(parameter);
    assert.ok(low <= parameter.value && parameter.value <= high && step > 0);
  }
});

test("every scene on offer exists, with the parameters that are set", () => {
  for (const { name, set } of SCENES) {
    const known = parameters(graintrain("scenes", name)).map((parameter) => parameter.name);
    for (const key of Object.keys(set)) assert.ok(known.includes(key), `${name}: ${key}`);
    const pairs = Object.entries(set).flatMap(([key, value]) => ["--set", `${key}=${value}`]);
    assert.match(graintrain("check", name, ...pairs), /frames/);
  }
});
