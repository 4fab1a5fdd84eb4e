// What may stand at a place of a scene, from the JSON Schema that `graintrain schema` prints.

/** All schemas that a value of this schema may follow: references, alternatives and conjunctions opened. */
function alternatives(root, schema, seen = new Set()) {
  if (!schema || typeof schema !== "object" || seen.has(schema)) return [];
  seen.add(schema);
  const found = [schema], open = (part) => { found.push(...alternatives(root, part, seen)); };
  if (schema.$ref) open(schema.$ref.replace(/^#\//, "").split("/").reduce((at, key) => at?.[key.replace(/~1/g, "/").replace(/~0/g, "~")], root));
  for (const word of ["allOf", "anyOf", "oneOf"]) for (const part of schema[word] ?? []) open(part);
  return found;
}

/** The schemas of a key in values of these schemas. */
function below(root, schemas, key) {
  const found = [];
  for (const schema of schemas) {
    let known = schema.properties && key in schema.properties ? [schema.properties[key]] : [];
    for (const [pattern, part] of Object.entries(schema.patternProperties ?? {})) if (new RegExp(pattern, "u").test(key)) known.push(part);
    if (known.length === 0 && typeof schema.additionalProperties === "object") known = [schema.additionalProperties];
    for (const part of known) found.push(...alternatives(root, part));
  }
  // A list of tables, `[[stage]]`, is written as one of its tables.
  return found.flatMap((schema) => (schema.items ? [schema, ...alternatives(root, schema.items)] : [schema]));
}

/** `a."b c".d` as ["a", "b c", "d"]. */
export function dotted(name) {
  return [...name.matchAll(/"([^"]*)"|'([^']*)'|([\w-]+)/g)].map(([, one, two, three]) => one ?? two ?? three);
}

/** The table that a line belongs to: the last header above it. */
export function tableAbove(lines) {
  for (let k = lines.length - 1; k >= 0; k--) {
    const header = lines[k].match(/^\s*\[{1,2}([^\]]+)\]{1,2}\s*(#.*)?$/);
    if (header) return dotted(header[1]);
  }
  return [];
}

const first = (schemas, word) => schemas.map((schema) => schema[word]).find((value) => value !== undefined);

/** The keys that may stand in a table: `[{label, detail, info}]`. */
export function keysOf(root, path) {
  let schemas = alternatives(root, root);
  for (const key of path) schemas = below(root, schemas, key);
  const keys = new Map();
  for (const schema of schemas) {
    for (const [label, part] of Object.entries(schema.properties ?? {})) {
      if (keys.has(label)) continue;
      const parts = alternatives(root, part), example = (first(parts, "examples") ?? [])[0];
      keys.set(label, { label, detail: example === undefined ? "" : `e.g. ${JSON.stringify(example)}`, info: first(parts, "description") ?? "" });
    }
  }
  return [...keys.values()];
}

/** The words that a key may have as its value, where these are known. */
export function valuesOf(root, path, key) {
  let schemas = alternatives(root, root);
  for (const part of [...path, ...dotted(key)]) schemas = below(root, schemas, part);
  const values = new Set();
  for (const schema of schemas) for (const value of schema.const !== undefined ? [schema.const] : (schema.enum ?? [])) values.add(JSON.stringify(value));
  return [...values];
}

/** Completion for the text up to the cursor: `{from, options}`, `from` counted in the last line; null where nothing is known. */
export function complete(root, before) {
  const lines = before.split("\n"), line = lines.pop();
  if (/^[^"]*#/.test(line)) return null;
  const value = line.match(/^\s*([\w."'-]+)\s*=\s*("?[\w-]*)$/);
  if (value) {
    const options = valuesOf(root, tableAbove(lines), value[1]).map((label) => ({ label, type: "enum" }));
    return options.length > 0 ? { from: line.length - value[2].length, options } : null;
  }
  const header = line.match(/^\s*\[{1,2}([\w."'-]*?)([\w-]*)$/);
  const key = line.match(/^\s*([\w-]*)$/);
  if (!header && !key) return null;
  const options = header ? keysOf(root, dotted(header[1])) : keysOf(root, tableAbove(lines));
  return options.length > 0 ? { from: line.length - (header ? header[2] : key[1]).length, options: options.map((option) => ({ ...option, type: "property" })) } : null;
}
