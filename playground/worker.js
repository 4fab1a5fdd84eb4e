// A run off the page's thread. In: {module, args, files}; out: {shown} while it goes (the files so far), {done} at its end.
import { execute } from "./program.js";

/** Files so far are sent no more often, ms. */
const BETWEEN = 500;

onmessage = async ({ data: { module, args, files, follow } }) => {
  let last = performance.now(), frames = 0;
  const looked = (all) => {
    const now = performance.now();
    if (now - last < BETWEEN) return;
    last = now;
    const shown = all(), count = Object.keys(shown).filter((path) => /frames\/bodies_\d+\.vtp$/.test(path)).length;
    if (count > frames) postMessage({ shown, frames: count });
    frames = count;
  };
  postMessage({ done: await execute(module, args, files, follow ? looked : undefined) });
};
