// The program of the page against the program of this machine: the same bits, the same words, and no files but those it was given.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import test from "node:test";
import { bytes, execute, text } from "../program.js";
import { RUNS, native, wasm } from "./support/site.mjs";

const program = await wasm();
const hash = (summary) => JSON.parse(summary).state_hash;
for (const args of RUNS) {
  test(`${args.join(" ")}: one state_hash here and there`, async () => {
    const folder = mkdtempSync(join(tmpdir(), "graintrain-"));
    try {
      execFileSync(native, ["run", ...args, "--out", join(folder, "run"), "--quiet"], { stdio: "pipe" });
      const there = await execute(program, ["run", ...args, "--out", "run"]);
      assert.equal(there.code, 0, there.said);
      assert.equal(hash(text(there.files["run/summary.json"])), hash(readFileSync(join(folder, "run/summary.json"), "utf8")));
      assert.equal(text(there.files["run/steps.csv"]).split("\n").length, readFileSync(join(folder, "run/steps.csv"), "utf8").split("\n").length);
    } finally {
      rmSync(folder, { recursive: true });
    }
  });
}

test("a run goes on from its checkpoint, and its replay is made of its files", async () => {
  const whole = await execute(program, ["run", "stack", "--steps", "60", "--out", "run"]);
  const half = await execute(program, ["run", "stack", "--steps", "30", "--out", "run"]);
  const rest = await execute(program, ["resume", "run", "--steps", "60"], half.files);
  assert.equal(rest.code, 0, rest.said);
  assert.equal(hash(text(rest.files["run/summary.json"])), hash(text(whole.files["run/summary.json"])));
  const shown = await execute(program, ["view", "run", "--out", "replay.html"], whole.files);
  assert.match(text(shown.files["replay.html"]), /<canvas/);
});

test("files so far can be looked at while it runs", async () => {
  let most = 0;
  await execute(program, ["run", "stack", "--steps", "40", "--out", "run"], {}, (files) => { most = Math.max(most, Object.keys(files()).length); });
  assert.ok(most > 20);
});

test("mistakes are named as on a terminal, without colours", async () => {
  const done = await execute(program, ["check", "mine.toml"], { "mine.toml": bytes("[time]\nstp = 3\n") });
  assert.equal(done.code, 2);
  assert.match(done.said, /unknown key `stp`[\s\S]*did you mean `step`/);
  assert.doesNotMatch(done.said, /\u001b/);
  const limit = await execute(program, ["run", "stack", "--max-seconds", "1", "--out", "run"]);
  assert.notEqual(limit.code, 0);
  assert.match(limit.said, /--max-seconds/);
});
