// The site's front page and its gallery: each scene run, drawn and made a replay of by the program. node site.mjs PROGRAM FOLDER
import { execFileSync } from "node:child_process";
import { copyFileSync, existsSync, mkdirSync, mkdtempSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { SCENES } from "./scenes.js";

const [program, site] = process.argv.slice(2);
const graintrain = (...args) => execFileSync(program, args, { encoding: "utf8", stdio: ["ignore", "pipe", "inherit"] });
const escaped = (words) => words.replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

/** What each built-in scene shows, by name. */
const shows = new Map(graintrain("scenes").split("\n").map((line) => line.match(/^(\S+)\s+(.*)$/)).filter(Boolean).map(([, name, what]) => [name, what]));

function card({ name, title, set, picture }) {
  const work = mkdtempSync(join(tmpdir(), "graintrain-site-")), folder = join(site, "gallery", name), run = join(work, name);
  mkdirSync(folder, { recursive: true });
  try {
    const pairs = Object.entries(set).flatMap(([key, value]) => ["--set", `${key}=${value}`]);
    graintrain("run", name, ...pairs, "--out", run, "--quiet");
    graintrain("render", run, ...picture, "--size", "960x720", "--out", join(folder, "picture.png"));
    graintrain("view", run, "--out", join(folder, "replay.html"));
    writeFileSync(join(folder, "scene.toml"), graintrain("scenes", name));
    copyFileSync(join(run, "summary.json"), join(folder, "summary.json"));
    const command = ["graintrain run", name, ...pairs].join(" ");
    console.log(`gallery/${name}`);
    return `<article>
  <a href="gallery/${name}/replay.html"><img src="gallery/${name}/picture.png" width="960" height="720" loading="lazy" alt="${escaped(title)}"></a>
  <h3>${escaped(title)}</h3>
  <p>${escaped(shows.get(name) ?? "").replace(/`([^`]*)`/g, "<b>$1</b>")}</p>
  <code>${escaped(command)}</code>
  <p><a href="gallery/${name}/replay.html">Replay</a> <a href="playground/index.html#name=${name}">Run it here</a> <a href="gallery/${name}/scene.toml">Scene</a></p>
</article>`;
  } finally {
    rmSync(work, { recursive: true });
  }
}

/** Notebooks that were made before, by name. */
const notebooks = existsSync(join(site, "notebooks")) ? readdirSync(join(site, "notebooks")).filter((name) => name.endsWith(".ipynb")).sort() : [];
const page = (name) => { const html = name.replace(/ipynb$/, "html"); return existsSync(join(site, "notebooks", html)) ? html : name; };
const listed = notebooks.map((name) => `<li><a href="notebooks/${page(name)}">${name.replace(/\.ipynb$/, "").replace(/_/g, " ")}</a></li>`);

const cards = SCENES.map(card);
writeFileSync(join(site, "index.html"), `<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>graintrain: granular and multibody dynamics with hard contact</title>
<link rel="icon" href="data:,">
<link rel="stylesheet" href="front.css">
</head>
<body>
<header>
  <h1>graintrain</h1>
  <p>Granular and multibody dynamics with hard contact and exact Coulomb friction. A scene is one file; steps are a thousand times those of penalty
  methods; every figure comes with the error that it has.</p>
  <nav><a href="playground/index.html">Run it in the browser</a> <a href="book/index.html">Book</a> <a href="api/graintrain/index.html">Rust</a></nav>
</header>
<main>${cards.join("\n")}</main>
${listed.length > 0 ? `<section><h2>Notebooks</h2><ul>${listed.join("")}</ul></section>` : ""}
<footer><p>Each run of this page has the same bits in the browser and in the program: <code>state_hash</code> of <code>summary.json</code>.</p></footer>
</body>
</html>
`);
