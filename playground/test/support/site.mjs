// What the tests of pages share: where the built site is, a server for it, and a browser.
import { existsSync } from "node:fs";
import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { extname } from "node:path";
import { fileURLToPath } from "node:url";
import { chromium } from "playwright-core";

const built = (path) => fileURLToPath(new URL(`../../../site/${path}`, import.meta.url));
export const native = process.env.GRAINTRAIN ?? fileURLToPath(new URL("../../../target/debug/graintrain", import.meta.url));

/** Runs whose `state_hash` is the same everywhere. */
export const RUNS = [
  ["sedimentation", "--set", "n=2"],
  ["excavator", "--steps", "50"],
  ["shear-box", "--steps", "50"],
  ["direct-shear", "--set", "n=1", "--steps", "100", "--friction", "relaxed"],
  ["repose", "--steps", "60"],
];

/** The program that the page loads. */
export const wasm = async () => WebAssembly.compile(await readFile(built("playground/graintrain.wasm")));

const TYPES = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".wasm": "application/wasm", ".json": "application/json" };

/** Serves the site at a free port of this machine; close it. */
export async function serve() {
  const server = createServer(async ({ url }, response) => {
    const path = new URL(url, "http://localhost").pathname;
    const body = path.includes("..") ? null : await readFile(built(path.slice(1))).catch(() => null);
    response.writeHead(body ? 200 : 404, { "content-type": TYPES[extname(path)] ?? "application/octet-stream" }).end(body);
  });
  await new Promise((listening) => server.listen(0, "127.0.0.1", listening));
  return { address: `http://127.0.0.1:${server.address().port}`, close: () => server.close() };
}

const executablePath = process.env.CHROMIUM ?? "/usr/bin/chromium";
/** Why tests in a browser are skipped; false where there is one. */
export const noBrowser = !existsSync(executablePath) && `no ${executablePath}`;
/** Drawing in software; nothing of the browser's own goes over the network. */
export const launch = () => chromium.launch({ executablePath, args: ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
  "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"] });

/** A page whose errors are kept in `errors`. */
export async function watched(browser, options = {}) {
  const page = await browser.newPage({ viewport: { width: 1280, height: 800 }, ...options });
  page.errors = [];
  page.on("pageerror", (error) => page.errors.push(error.message));
  page.on("console", (message) => { if (message.type() === "error") page.errors.push(message.text()); });
  return page;
}
