// The page in headless Chromium (CHROMIUM, default /usr/bin/chromium): chosen, changed, run, looked at, stopped, shared. Skipped where there is none.
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import test, { after, before } from "node:test";
import { execute, text } from "../program.js";
import { SCENES } from "../scenes.js";
import { RUNS, launch, native, noBrowser as skip, serve, wasm, watched } from "./support/site.mjs";

let browser, site;
before(async () => { if (!skip) { site = await serve(); browser = await launch(); } });
after(async () => { await browser?.close(); site?.close(); });

/** The page, ready to run; errors of its scripts are kept. */
async function open(hash = "", options = {}) {
  const page = await watched(browser, options);
  await page.goto(`${site.address}/playground/index.html${hash}`);
  await page.waitForSelector("#go:not(:disabled)", { timeout: 60_000 });
  return page;
}

/** What the editor shows of the scene. */
const scene = (page) => page.locator(".cm-content").innerText();

async function run(page) {
  await page.click("#go");
  await page.waitForSelector("#stop:visible");
  await page.waitForSelector("#go:visible", { timeout: 120_000 });
  return page.textContent("#said");
}

test("a scene runs to the state that the program reaches in Node.js, and its replay is shown", { skip }, async () => {
  const page = await open();
  await page.selectOption("#choice", "stack");
  await page.waitForFunction(() => document.getElementById("check").textContent.includes("frames"));
  const said = await run(page), there = await execute(await wasm(), ["run", "stack", "--out", "run"]);
  assert.equal(said.match(/state_hash\s+(\w+)/)[1], JSON.parse(text(there.files["run/summary.json"])).state_hash);
  const replay = page.frameLocator("#replay");
  await replay.locator("canvas").first().waitFor();
  assert.match(await replay.locator("#facts").textContent(), /bodies/);
  assert.ok((await page.locator("#files li").count()) > 3);
  assert.deepEqual(page.errors, []);
  await page.close();
});

for (const args of RUNS) {
  test(`${args.join(" ")}: the browser's state_hash is the program's`, { skip }, async () => {
    const folder = mkdtempSync(join(tmpdir(), "graintrain-")), page = await watched(browser);
    try {
      execFileSync(native, ["run", ...args, "--out", join(folder, "run"), "--quiet"], { stdio: "pipe" });
      await page.goto(`${site.address}/playground/index.html`);
      const there = await page.evaluate(async (args) => {
        const module = await WebAssembly.compile(await (await fetch("graintrain.wasm")).arrayBuffer());
        const worker = new Worker("worker.js", { type: "module" });
        const done = new Promise((resolve) => { worker.onmessage = ({ data }) => resolve(data.done); });
        worker.postMessage({ module, args: ["run", ...args, "--out", "run"], files: {} });
        const { code, said, files } = await done;
        return { code, said, summary: files["run/summary.json"] && new TextDecoder().decode(files["run/summary.json"]) };
      }, args);
      assert.equal(there.code, 0, there.said);
      assert.equal(JSON.parse(there.summary).state_hash, JSON.parse(readFileSync(join(folder, "run/summary.json"), "utf8")).state_hash);
    } finally {
      await page.close();
      rmSync(folder, { recursive: true });
    }
  });
}

test("sliders change the scene, and mistakes are reported", { skip }, async () => {
  const page = await open();
  await page.selectOption("#choice", "incline");
  await page.waitForSelector("#parameter-angle");
  await page.fill("#parameter-angle", "30");
  assert.match(await scene(page), /angle = "30 deg"/);
  await page.click(".cm-content");
  await page.keyboard.press("Control+Home");
  await page.keyboard.type("nonsense = 1\n");
  await page.waitForFunction(() => document.getElementById("check").className === "bad");
  assert.match(await page.textContent("#check"), /unknown key `nonsense`/);
  assert.deepEqual(page.errors, []);
  await page.close();
});

test("a scene reads files of the reader's own", { skip }, async () => {
  const page = await open();
  const words = "[material.m]\ndensity = 1000\n[time]\nstep = '1 ms'\nend = '10 ms'\n[packing.p]\nmaterial = 'm'\nfile = { path = 'mine.csv' }\n";
  await page.click(".cm-content");
  await page.keyboard.press("Control+A");
  await page.keyboard.insertText(words);
  await page.waitForFunction(() => document.getElementById("check").className === "bad");
  await page.setInputFiles("#added", { name: "mine.csv", mimeType: "text/csv", buffer: Buffer.from("x,y,z,radius\n0,0,1,0.1\n0,0,2,0.1\n") });
  await page.waitForFunction(() => document.getElementById("check").textContent.includes("2 free"));
  assert.match(await page.textContent("#given"), /mine\.csv/);
  assert.match(await run(page), /state_hash/);
  await page.close();
});

test("keys are completed", { skip }, async () => {
  const page = await open();
  await page.click(".cm-content");
  await page.keyboard.press("Control+End");
  await page.keyboard.type("\n[time]\nst");
  await page.waitForSelector(".cm-tooltip-autocomplete");
  assert.match(await page.textContent(".cm-tooltip-autocomplete"), /steps?/);
  await page.close();
});

test("a run that is stopped shows what was done", { skip }, async () => {
  const page = await open();
  await page.selectOption("#choice", "excavator");
  await page.waitForFunction(() => document.getElementById("check").textContent.includes("bucket"));
  await page.click("#go");
  await page.waitForSelector("#replay.shown", { timeout: 60_000 });
  await page.click("#stop");
  await page.waitForSelector("#go:visible", { timeout: 60_000 });
  assert.match(await page.textContent("#said"), /Stopped/);
  await page.close();
});

test("an address holds a scene, and narrow and dark pages fit", { skip }, async () => {
  const page = await open();
  await page.click("#link");
  await page.waitForFunction(() => location.hash.length > 100);
  const hash = await page.evaluate(() => location.hash);
  await page.close();
  const phone = await open(hash, { viewport: { width: 400, height: 800 }, colorScheme: "dark" });
  assert.match(await scene(phone), /title = "Sedimentation/);
  await phone.click("#link");
  assert.equal(await phone.evaluate(() => location.hash), hash);
  assert.ok((await phone.evaluate(() => document.documentElement.scrollWidth)) <= 400);
  await phone.close();
});

test("there are ten scenes", { skip }, async () => {
  const page = await open();
  assert.equal(await page.locator("#choice option").count(), SCENES.length);
  assert.equal(SCENES.length, 10);
  await page.close();
});
