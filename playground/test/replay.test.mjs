// Replays and the page of a run under way, as `graintrain view` and `run --live` make them, in headless Chromium.
import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import test, { after, before } from "node:test";
import { launch, native, noBrowser as skip, watched } from "./support/site.mjs";

let browser, folder;
before(async () => {
  if (skip) return;
  folder = mkdtempSync(join(tmpdir(), "graintrain-"));
  execFileSync(native, ["run", "excavator", "--set", "rows=8", "--set", "columns=3", "--set", "layers=2", "--steps", "300", "--out", join(folder, "run"), "--quiet"], { stdio: "pipe" });
  execFileSync(native, ["view", join(folder, "run"), "--out", join(folder, "replay.html")], { stdio: "pipe" });
  browser = await launch();
});
after(async () => { await browser?.close(); if (folder) rmSync(folder, { recursive: true }); });

async function open(hash = "", options = {}) {
  const page = await watched(browser, options);
  await page.goto(`file://${join(folder, "replay.html")}${hash}`);
  await page.waitForFunction(() => document.getElementById("facts").textContent.includes("frames"));
  return page;
}

/** How many colours the picture of the bodies has: a blank one has one. */
const colors = (page) => page.evaluate(() => {
  draw();
  const canvas = document.getElementById("scene"), copy = Object.assign(document.createElement("canvas"), { width: canvas.width, height: canvas.height });
  const c = copy.getContext("2d");
  c.drawImage(canvas, 0, 0);
  const { data } = c.getImageData(0, 0, copy.width, copy.height), found = new Set();
  for (let i = 0; i < data.length; i += 4) found.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
  return found.size;
});

for (const [name, width, scheme] of [["wide and light", 1280, "light"], ["narrow and dark", 400, "dark"]]) {
  test(`a replay is drawn, ${name}`, { skip }, async () => {
    const page = await open("#frame=5", { viewport: { width, height: 800 }, colorScheme: scheme });
    assert.ok((await colors(page)) > 100);
    assert.equal(await page.evaluate(() => document.documentElement.dataset.theme ?? "light"), scheme);
    assert.ok((await page.evaluate(() => document.documentElement.scrollWidth)) <= width);
    assert.ok((await page.locator("#charts svg, #charts canvas").count()) > 2);
    assert.deepEqual(page.errors, []);
    await page.close();
  });
}

test("it plays by itself, and every colour, cut and switch draws", { skip }, async () => {
  const page = await open("", { viewport: { width: 500, height: 400 } });
  await page.waitForFunction(() => state.playing, { timeout: 20_000 });
  await page.keyboard.press("Space");
  await page.evaluate(() => show(8));
  for (const name of await page.locator("#color option").evaluateAll((all) => all.map(({ value }) => value))) {
    await page.selectOption("#color", name);
    assert.ok((await colors(page)) > 50, name);
  }
  for (const key of ["x", "y", "z", "v", "n", "c", "c", "w", "l", "1", "2", "3", "r"]) {
    await page.keyboard.press(key);
    assert.ok((await colors(page)) > 20, key);
  }
  assert.deepEqual(page.errors, []);
  await page.close();
});

test("a click names a body", { skip }, async () => {
  const page = await open("#frame=5", { viewport: { width: 900, height: 700 } });
  const at = await page.evaluate(() => {
    const { left, top } = element("scene").getBoundingClientRect(), { clientWidth: w, clientHeight: h } = element("scene");
    for (let y = 0; y < h; y += 7) for (let x = 0; x < w; x += 7) { const body = bodyAt(x, y); if (body >= 0 && model.grain[body]) return { x: left + x, y: top + y }; }
    return null;
  });
  await page.mouse.click(at.x, at.y);
  await page.waitForSelector("#picked:visible");
  assert.match(await page.textContent("#picked"), /m\/s[\s\S]*N/);
  await page.keyboard.press("Escape");
  assert.equal(await page.isVisible("#picked"), false);
  await page.close();
});

test("a still and a film are saved", { skip }, async () => {
  const page = await open("#frame=5", { viewport: { width: 420, height: 360 } });
  await page.evaluate(() => choose("shadows", false));
  const [still] = await Promise.all([page.waitForEvent("download"), page.click("#still")]);
  assert.deepEqual([...readFileSync(await still.path()).subarray(1, 4)], [...Buffer.from("PNG")]);
  await page.selectOption("#rate", "4");
  const [film] = await Promise.all([page.waitForEvent("download", { timeout: 120_000 }), page.click("#film")]);
  const bytes = readFileSync(await film.path());
  assert.match(film.suggestedFilename(), /\.webm$/);
  assert.deepEqual([...bytes.subarray(0, 4)], [0x1a, 0x45, 0xdf, 0xa3]);
  assert.ok(bytes.length > 10_000);
  assert.deepEqual(page.errors, []);
  await page.close();
});

test("a run under way is shown, paused, stepped and stopped", { skip }, async () => {
  const run = spawn(native, ["run", "excavator", "--out", join(folder, "live"), "--live", "0"], { stdio: ["ignore", "pipe", "pipe"] });
  const ended = new Promise((resolve) => run.on("close", resolve));
  let said = "";
  const address = await new Promise((resolve, reject) => {
    const listen = (data) => { said += data; const found = said.match(/http:\/\/127\.0\.0\.1:\d+\//); if (found) resolve(found[0]); };
    run.stdout.on("data", listen);
    run.stderr.on("data", listen);
    ended.then(() => reject(new Error(said)));
  });
  const page = await watched(browser, { viewport: { width: 500, height: 400 } });
  await page.goto(address);
  await page.waitForSelector("#live:visible");
  await page.waitForFunction(() => frames.length > 2, { timeout: 60_000 });
  await page.click("#pause");
  await page.waitForFunction(() => document.getElementById("state").textContent.length > 0);
  await page.waitForTimeout(1500);
  const before = await page.evaluate(() => frames.length);
  await page.click("#one");
  await page.waitForFunction((count) => frames.length > count, before, { timeout: 20_000 });
  await page.click("#stop");
  assert.notEqual(await ended, null);
  // The connection ends with the run.
  assert.deepEqual(page.errors.filter((error) => !/ERR_/.test(error)), []);
  await page.close();
});
