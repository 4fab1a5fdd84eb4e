// The program as a function: arguments and files in, exit code, words and files out. The same in a browser and in Node.js.
import { ConsoleStdout, Directory, File, PreopenDirectory, WASI, wasi } from "@bjorn3/browser_wasi_shim";

/** Output that is no terminal: no colours, no bars. */
class Words extends ConsoleStdout {
  fd_fdstat_get() {
    const { ret, fdstat } = super.fd_fdstat_get();
    fdstat.fs_filetype = wasi.FILETYPE_UNKNOWN;
    return { ret, fdstat };
  }
}

/** A tree of folders from `{"folder/file": bytes}`. */
function tree(files) {
  const root = new Map();
  for (const [path, bytes] of Object.entries(files)) {
    const folders = path.split("/"), name = folders.pop();
    let at = root;
    for (const folder of folders) {
      if (!at.has(folder)) at.set(folder, new Directory(new Map()));
      at = at.get(folder).contents;
    }
    at.set(name, new File(bytes));
  }
  return root;
}

/** `{"folder/file": bytes}` from a tree of folders. */
function flat(contents, before = "", files = {}) {
  for (const [name, entry] of contents) {
    if (entry instanceof Directory) flat(entry.contents, `${before}${name}/`, files);
    else files[before + name] = entry.data;
  }
  return files;
}

/**
 * Runs the compiled program with these arguments, on these files alone.
 *
 * @param {WebAssembly.Module} compiled
 * @param {string[]} args as after `graintrain` in a terminal
 * @param {Record<string, Uint8Array>} files what it can read, by path
 * @param {(files: () => Record<string, Uint8Array>) => void} [looked] called after each file that it has closed
 * @returns {Promise<{code: number, said: string, files: Record<string, Uint8Array>}>} its exit code (-1: it crashed), what it printed, and all files
 */
export async function execute(compiled, args, files = {}, looked) {
  let said = "";
  const words = () => { const text = new TextDecoder(); return new Words((bytes) => { said += text.decode(bytes, { stream: true }); }); };
  const root = new PreopenDirectory("/", tree(files)), all = () => flat(root.dir.contents);
  const system = new WASI(["graintrain", ...args], ["NO_COLOR=1"], [new Words(() => {}), words(), words(), root], { debug: false });
  const imports = system.wasiImport, close = imports.fd_close;
  if (looked) imports.fd_close = (fd) => { const code = close(fd); looked(all); return code; };
  const instance = await WebAssembly.instantiate(compiled, { wasi_snapshot_preview1: imports });
  let code = -1;
  try {
    code = system.start(instance);
  } catch (error) {
    said += `\nThe program crashed: ${error.message}\n`;
  }
  return { code, said, files: all() };
}

export const text = (bytes) => new TextDecoder().decode(bytes);
export const bytes = (words) => new TextEncoder().encode(words);
