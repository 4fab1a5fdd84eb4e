// What the tests of the built page share: where it is, and a server for it.
import { readFile } from "node:fs/promises";
import { createServer } from "node:http";
import { extname } from "node:path";
import { fileURLToPath } from "node:url";

const built = (path) => fileURLToPath(new URL(`../../../site/${path}`, import.meta.url));
export const native = process.env.GRAINTRAIN ?? fileURLToPath(new URL("../../../target/debug/graintrain", import.meta.url));

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
