// The numbers of a scene's table `parameters`, as sliders see them: read from the text, and written back into it.

/** Literal numbers of `[parameters]` with their units and comments; formulas are left to the editor. */
export function parameters(scene) {
  const found = [];
  let within = false;
  scene.split("\n").forEach((line, index) => {
    const header = line.match(/^\s*\[+([^\]]*)\]+/);
    if (header) within = header[1].trim() === "parameters";
    if (!within) return;
    const entry = line.match(/^\s*([\w-]+)\s*=\s*("?)(-?\d+(?:\.\d+)?(?:e[-+]?\d+)?)((?:\s*[^\d\s"*+()/#-][^"*+()#]*?)?)\2\s*(?:#\s*(.*))?$/i);
    if (!entry) return;
    const [, name, , number, unit, comment] = entry;
    found.push({ name, value: Number(number), whole: /^-?\d+$/.test(number) && unit.trim() === "", unit: unit.trim(), comment: (comment ?? "").trim(), line: index });
  });
  return found;
}

/** Ends and step of a parameter's slider, from the value that the scene came with. */
export function range({ value, whole }) {
  if (value === 0) return { low: 0, high: 1, step: whole ? 1 : 0.01 };
  const size = Math.abs(value), step = whole ? 1 : Number((size / 40).toPrecision(1));
  const high = whole ? Math.max(Math.ceil(2.5 * size), 3) : 2.5 * size, low = whole ? 1 : step;
  return value > 0 ? { low, high, step } : { low: -high, high: -low, step };
}

/** The scene with another number in that line. */
export function changed(scene, { name, line, whole }, value) {
  const lines = scene.split("\n"), number = whole ? String(Math.round(value)) : String(Number(value.toPrecision(4)));
  lines[line] = lines[line].replace(new RegExp(`^(\\s*${name}\\s*=\\s*"?)-?\\d+(?:\\.\\d+)?(?:e[-+]?\\d+)?`, "i"), (_, before) => before + number);
  return lines.join("\n");
}
