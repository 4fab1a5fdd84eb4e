// A run off the page's thread. In: {module, args, files, follow}; out: {shown, frames} while it goes (files that are new or have changed), {done} at its end.
import { execute } from "./program.js";

/** Files so far are sent no more often, ms. */
const BETWEEN = 500;

onmessage = async ({ data: { module, args, files, follow } }) => {
  let last = performance.now(), frames = 0;
  const sent = new Map();
  const looked = (all) => {
    const now = performance.now();
    if (now - last < BETWEEN) return;
    last = now;
    const whole = Object.entries(all()).filter(([path]) => !path.endsWith(".part"));
    const count = whole.filter(([path]) => /frames\/bodies_\d+\.vtp$/.test(path)).length;
    if (count === frames) return;
    frames = count;
    // What grows is another array afterwards.
    const shown = Object.fromEntries(whole.filter(([path, data]) => sent.get(path) !== data));
    for (const [path, data] of Object.entries(shown)) sent.set(path, data);
    postMessage({ shown, frames });
  };
  postMessage({ done: await execute(module, args, files, follow ? looked : undefined) });
};
