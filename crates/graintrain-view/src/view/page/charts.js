// ---- charts ------------------------------------------------------------------------------------------------------------------

const INKS = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const [LEFT, RIGHT, TOP, BOTTOM] = [58, 10, 6, 34];

/** Multiples of d from low to high. No more than fit: sums of a tiny d would stand still. */
const multiples = (d, low, high) => Array.from({ length: 12 }, (_, k) => (Math.ceil(low / d - 1e-9) + k) * d).filter((v) => v <= high + 1e-9 * d);
const step = (span) => { const p = 10 ** Math.floor(Math.log10(span / 4)); return [1, 2, 5, 10].map((d) => d * p).find((s) => s >= span / 4); };

/** The index of the number nearest to x in a list. */
function nearest(list, x) {
  let best = 0;
  list.forEach((v, i) => { if (Math.abs(v - x) < Math.abs(list[best] - x)) best = i; });
  return best;
}

/** A chart of the run that follows the moment shown: a line at it, and the values there. */
class RunChart {
  constructor(data) {
    Object.assign(this, data);
    const box = document.createElement("section"), make = (tag, name, into) => { const e = document.createElement(tag); e.className = name; into.append(e); return e; };
    box.className = "chart";
    make("h2", "", box).textContent = `${this.title} ${this.y.match(/\([^()]*\)$/)?.[0] ?? ""}`;
    this.values = make("div", "values", box);
    this.plot = make("div", "plot", box);
    this.canvas = make("canvas", "", this.plot);
    this.now = make("div", "now", this.plot);
    this.spans = this.series.map((_, s) => { const e = make("span", "", this.values); e.style.color = INKS[s % INKS.length]; return e; });
    element(this.inner ? "inner" : "charts").append(box);
    const go = (event) => {
      if (!this.points || !event.buttons) return;
      const { left, width } = this.canvas.getBoundingClientRect(), x = this.xs[0] + ((event.clientX - left - LEFT) / (width - LEFT - RIGHT)) * (this.xs[1] - this.xs[0]);
      show(nearest(frames.map((f) => f.time), this.points[nearest(this.series[0].x, x)]));
    };
    this.plot.addEventListener("pointerdown", go);
    this.plot.addEventListener("pointermove", go);
  }
  usable(y) { return y !== null && Math.abs(y) <= 1e38 && (!this.log || y >= 1e-38); }
  ranges() {
    const on = (y) => (this.log ? Math.log10(y) : y);
    let [low, high, left, right] = [Infinity, -Infinity, Infinity, -Infinity];
    for (const { x, y } of this.series) y.forEach((v, i) => {
      if (!this.usable(v) || x[i] === null) return;
      low = Math.min(low, on(v)); high = Math.max(high, on(v)); left = Math.min(left, x[i]); right = Math.max(right, x[i]);
    });
    if (low > high) [low, high, left, right] = [0, 1, 0, 1];
    if (!this.log && low > 0 && low < 0.5 * high) low = 0;
    const pad = high - low > 1e-30 ? 0.05 * (high - low) : Math.abs(high) > 1e-30 ? 0.5 * Math.abs(high) : 1;
    this.xs = [left, right > left ? right : left + 1];
    this.ys = [low === 0 ? 0 : low - pad, high + pad];
  }
  /** Draws all that does not follow the time. */
  draw() {
    const { canvas } = this, ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width) return;
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    this.ranges();
    const c = canvas.getContext("2d"), style = getComputedStyle(document.documentElement), color = (name) => style.getPropertyValue(name);
    const [x0, x1] = this.xs, [low, high] = this.ys, on = (y) => (this.log ? Math.log10(y) : y);
    this.px = (x) => LEFT + ((x - x0) / (x1 - x0)) * (width - LEFT - RIGHT);
    const py = (y) => height - BOTTOM - ((on(y) - low) / (high - low)) * (height - TOP - BOTTOM);
    c.scale(ratio, ratio);
    c.font = "12px system-ui, sans-serif";
    c.strokeStyle = color("--line");
    c.fillStyle = color("--soft");
    c.textAlign = "center";
    for (const x of multiples(step(x1 - x0), x0, x1)) {
      c.beginPath(); c.moveTo(this.px(x), TOP); c.lineTo(this.px(x), height - BOTTOM); c.stroke();
      c.fillText(digits(Math.abs(x) < 1e-9 * (x1 - x0) ? 0 : x), this.px(x), height - BOTTOM + 14);
    }
    c.fillText(this.x, LEFT + 0.5 * (width - LEFT - RIGHT), height - 3);
    c.textAlign = "right";
    for (const y of multiples(this.log ? Math.max(1, Math.ceil((high - low) / 5)) : step(high - low), low, high)) {
      const v = this.log ? 10 ** y : y, at = py(v);
      c.beginPath(); c.moveTo(LEFT, at); c.lineTo(width - RIGHT, at); c.stroke();
      c.fillText(digits(!this.log && Math.abs(v) < 1e-9 * (high - low) ? 0 : v), LEFT - 4, at + 4);
    }
    c.strokeRect(LEFT, TOP, width - LEFT - RIGHT, height - TOP - BOTTOM);
    this.series.forEach(({ x, y }, s) => {
      c.strokeStyle = INKS[s % INKS.length];
      // Of profiles that of the moment shown.
      c.globalAlpha = this.profiles && s !== this.current ? 0.3 : 1;
      c.lineWidth = this.profiles && s === this.current ? 2.6 : 1.5;
      c.beginPath();
      let pen = false;
      y.forEach((v, i) => { const is = this.usable(v) && x[i] !== null; if (is) pen ? c.lineTo(this.px(x[i]), py(v)) : c.moveTo(this.px(x[i]), py(v)); pen = is; });
      c.stroke();
    });
  }
  follow(time) {
    if (!this.px) return;
    const value = (v) => (this.usable(v) ? digits(v) : "\u2013");
    if (this.points) {
      const i = nearest(this.points, time);
      this.series.forEach(({ label, y }, s) => { this.spans[s].textContent = `${label} ${value(y[i])}`; });
      this.now.style.left = `${this.px(this.series[0].x[i] ?? this.xs[0])}px`;
    } else {
      const current = nearest(this.profiles, time);
      this.series.forEach(({ label }, s) => { this.spans[s].textContent = s === current ? `${label} (now)` : label; });
      this.now.hidden = true;
      if (current !== this.current) { this.current = current; this.draw(); }
    }
  }
}

let charts = [];

function setUpCharts(list) {
  element("charts").replaceChildren();
  element("inner").replaceChildren();
  // What is zero all the time needs no chart.
  const reported = list.filter(({ series }) => series.some(({ y }) => y.some((v) => v)));
  charts = reported.map((data) => new RunChart(data));
  element("inside").hidden = !reported.some((data) => data.inner);
  drawCharts();
}

function drawCharts() {
  charts.forEach((chart) => chart.draw());
  if (frames.length) charts.forEach((chart) => chart.follow(timeNow()));
}
