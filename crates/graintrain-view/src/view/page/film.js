// ---- stills and films --------------------------------------------------------------------------------------------------------

/** Writes the legend and the time over a picture of the canvas: what the page shows beside it. */
function letter(c, width, height) {
  const unit = Math.max(height, 0.6 * width) / 100, style = getComputedStyle(document.documentElement), ink = style.getPropertyValue("--ink");
  const [left, top, long, high] = [width - 30 * unit, 3 * unit, 27 * unit, 2 * unit], ramp = c.createLinearGradient(left, 0, left + long, 0);
  const [name, first, last] = legend();
  c.fillStyle = ink;
  c.font = `${2.4 * unit}px system-ui, sans-serif`;
  c.textBaseline = "top";
  c.fillText(`t = ${timeNow().toFixed(3)} s`, 2 * unit, height - 5 * unit);
  c.fillText(name, left, top);
  if (first === "") return;
  VIRIDIS.forEach((color, k) => ramp.addColorStop(k / (VIRIDIS.length - 1), `rgb(${color})`));
  c.fillStyle = ramp;
  c.fillRect(left, top + 3.4 * unit, long, high);
  c.fillStyle = ink;
  c.fillText(first, left, top + 6 * unit);
  c.textAlign = "right";
  c.fillText(last, left + long, top + 6 * unit);
  c.textAlign = "left";
}

/** A canvas with the moment shown, letters included. */
function composed(onto = document.createElement("canvas"), ratio) {
  draw(ratio);
  const canvas = element("scene"), even = (n) => n - (n % 2);
  if (onto.width !== even(canvas.width) || onto.height !== even(canvas.height)) { onto.width = even(canvas.width); onto.height = even(canvas.height); }
  const c = onto.getContext("2d");
  c.drawImage(canvas, 0, 0);
  letter(c, onto.width, onto.height);
  return onto;
}

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const fileName = (ending) => `${header.title.replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "").slice(0, 60) || "replay"}${ending}`;

/** The picture shown at twice its size. */
function still() {
  composed(undefined, 2 * Math.min(window.devicePixelRatio || 1, 2)).toBlob((blob) => save(blob, fileName(`-${timeNow().toFixed(3)}s.png`)), "image/png");
  draw();
}

let recorder = null;

/** Plays the replay from its start to its end and saves what is seen as a film; a second call ends it early. */
function film() {
  if (recorder) return recorder.stop();
  const kind = ["video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm", "video/mp4"].find((type) => window.MediaRecorder?.isTypeSupported(type));
  if (!kind) return fail("This browser records no films: `graintrain render --film` makes one of the same run.");
  pause();
  show(0);
  // A picture enters the film when it is asked for: canvases outside of the page are not watched.
  const canvas = composed(), parts = [], stream = canvas.captureStream(0), [track] = stream.getVideoTracks();
  const add = () => drawInTime(() => { composed(canvas); track.requestFrame?.(); });
  recorder = new MediaRecorder(track.requestFrame ? stream : canvas.captureStream(30), { mimeType: kind, videoBitsPerSecond: 12e6 });
  recorder.ondataavailable = (event) => { if (event.data.size) parts.push(event.data); };
  recorder.onstop = () => {
    recorder = null;
    element("film").classList.remove("on");
    pause();
    window.filmed = new Blob(parts, { type: kind });
    save(window.filmed, fileName(kind.startsWith("video/mp4") ? ".mp4" : ".webm"));
  };
  element("film").classList.add("on");
  recorder.start();
  const last = frames.length - 1, end = () => { if (recorder) recorder.stop(); };
  play(add, () => { show(last); add(); setTimeout(end, 400); });
}
