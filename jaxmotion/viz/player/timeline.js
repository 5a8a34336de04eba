// The timeline: a ruler to scrub on, the loop, and strips with errors, contacts and gaps.

const RULER = 24; // pixels high
const STRIP = 8;
const GAP = 4;
const MOST_ROWS = 16;
const FONT = "11px system-ui, sans-serif";

class Timeline {
  constructor(canvas, state) {
    this.canvas = canvas;
    this.state = state;
    this.rows = rowsOf(state);
    this.shown = this.rows.slice(0, MOST_ROWS); // there is no room for all
    const left = this.rows.length - MOST_ROWS;
    if (left > 0) this.shown.push({ name: `and ${left} rows more`, spans: () => [] });
    this.still = document.createElement("canvas"); // what does not move with the cursor
    this.isStale = true;
  }

  get height() {
    return RULER + (this.shown.length ? GAP : 0) + this.shown.length * (STRIP + GAP);
  }

  // Names stand left of the strips, where there is room for them.
  resize(width, scale) {
    Object.assign(this, { width, scale, left: gutterOf(width), right: 14, isStale: true });
    sized(this.canvas, width, this.height, scale);
    sized(this.still, width, this.height, scale);
  }

  x(frame) {
    const { left, right, width, state } = this;
    return left + ((frame + 0.5) / state.numFrames) * Math.max(width - left - right, 1);
  }

  frameOf(x) {
    const { left, right, width, state } = this;
    const part = (x - left) / Math.max(width - left - right, 1);
    return clamp(Math.floor(part * state.numFrames), 0, state.numFrames - 1);
  }

  draw() {
    const { state, width, height, scale } = this;
    if (this.isStale) this.drawStill();
    const c = this.canvas.getContext("2d");
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, this.canvas.width, this.canvas.height);
    c.drawImage(this.still, 0, 0);
    c.setTransform(scale, 0, 0, scale, 0, 0);
    const x = Math.round(this.x(state.frame)) + 0.5;
    const text = String(state.frame);
    c.font = `600 ${FONT}`;
    const half = c.measureText(text).width / 2 + 6;
    const middle = clamp(x, half, width - half);
    c.strokeStyle = c.fillStyle = state.colours.text.cursor;
    c.lineWidth = 1.5;
    line(c, x, 8, x, height);
    bar(c, middle - half, 0, 2 * half, 16, 5);
    c.fillStyle = state.colours.text.onCursor;
    c.textAlign = "center";
    c.textBaseline = "middle";
    c.fillText(text, middle, 8.5);
  }

  drawStill() {
    const { state, width, scale } = this;
    const c = this.still.getContext("2d");
    this.isStale = false;
    c.setTransform(scale, 0, 0, scale, 0, 0);
    c.clearRect(0, 0, width, this.height);
    c.font = FONT;
    const text = state.colours.text;
    this.drawLoop(c, text);
    this.drawRuler(c, text);
    this.shown.forEach((row, k) => this.drawRow(c, row, RULER + GAP + k * (STRIP + GAP), text));
  }

  drawRuler(c, text) {
    const { state } = this;
    const { step, label } = this.ticks();
    c.textBaseline = "middle";
    c.textAlign = "center";
    for (let frame = 0; frame < state.numFrames; frame += step) {
      const x = Math.round(this.x(frame)) + 0.5;
      const isLabelled = Math.round(frame / step) % label === 0;
      c.strokeStyle = text.line;
      c.lineWidth = 1;
      line(c, x, isLabelled ? RULER - 8 : RULER - 4, x, RULER);
      if (!isLabelled || x > this.width - this.right - 10) continue;
      c.fillStyle = text.faint;
      c.fillText(String(frame), x, 8);
    }
    c.textAlign = "right";
    c.fillStyle = text.faint;
    if (this.left > 40) c.fillText("frame", this.left - 10, 8);
    c.strokeStyle = text.line;
    line(c, this.x(-0.5), RULER + 0.5, this.x(state.numFrames - 0.5), RULER + 0.5);
  }

  // Every how many frames a tick, every how many ticks a number.
  ticks() {
    const pixels = this.x(1) - this.x(0);
    const step = Math.max(1, Math.round(roundStep((12 / pixels) * 1.99)));
    const label = Math.max(1, Math.ceil(64 / (pixels * step) / 5) * 5);
    return { step, label };
  }

  drawLoop(c, text) {
    const { loop } = this.state;
    if (!loop) return;
    const [a, b] = [this.x(loop[0] - 0.5), this.x(loop[1] + 0.5)];
    c.fillStyle = text.loop;
    c.fillRect(a, 0, b - a, this.height);
    c.fillStyle = text.loopEdge;
    c.fillRect(a - 1, 0, 2, this.height);
    c.fillRect(b - 1, 0, 2, this.height);
  }

  drawRow(c, row, y, text) {
    c.textAlign = "right";
    c.textBaseline = "middle";
    c.fillStyle = text.faint;
    if (this.left > 40)
      c.fillText(fitted(c, row.name, this.left - 14), this.left - 10, y + STRIP / 2);
    c.fillStyle = text.strip;
    bar(c, this.x(-0.5), y, this.x(this.state.numFrames - 0.5) - this.x(-0.5), STRIP);
    for (const spans of row.spans(this.state)) {
      c.fillStyle = spans.colour;
      for (const [a, b] of spans.of) {
        const [from, to] = [this.x(row.frame(a) - 0.5), this.x(row.frame(b) - 0.5)];
        bar(c, from, y, Math.max(to - from, 2), STRIP);
      }
    }
  }
}

// A strip: its name, spans [first, after the last] by colour, and from a clip's frames to the
// timeline's.
function rowsOf(state) {
  const rows = [];
  const marked = (what) => state.clips.filter((clip) => clip[what]).length > 1;
  for (const clip of state.clips) {
    const own = (several) => (several ? `${clip.name} ` : "");
    const frame = (f) => (f * clip.frameTime) / state.frameTime;
    const gaps = clip.missingSpans();
    const errors = clip.errorSpans();
    if (gaps.length)
      rows.push({
        name: `${own(state.clips.length > 1)}missing`,
        frame,
        clip,
        spans: (s) => [{ of: gaps, colour: s.colours.text.missing }],
      });
    if (clip.errors)
      rows.push({
        name: `${own(marked("errors"))}errors`,
        frame,
        clip,
        errors,
        spans: (s) => errorSpans(clip, errors, s),
      });
    for (const [k, name] of (clip.contacts?.names || []).entries()) {
      const of = clip.contactSpans.filter((s) => s.point === k).map((s) => [s.first, s.last + 1]);
      if (of.length)
        rows.push({
          name: own(marked("contacts")) + name,
          frame,
          clip,
          spans: (s) => [{ of, colour: css(s.colours.contact, 0.8) }],
        });
    }
  }
  return rows;
}

// All errors, and over them those of the picked joints.
function errorSpans(clip, errors, state) {
  const joints = [...state.picked]
    .map((name) => clip.number.get(name))
    .filter((j) => j !== undefined);
  if (!joints.length) return [{ of: errors, colour: css(state.colours.error, 0.9) }];
  return [
    { of: errors, colour: css(state.colours.error, 0.3) },
    { of: clip.errorSpans(joints), colour: css(state.colours.error) },
  ];
}

// Drawing on a canvas.

const gutterOf = (width) => (width >= 560 ? 116 : 38);

function sized(canvas, width, height, scale) {
  canvas.width = Math.round(width * scale);
  canvas.height = Math.round(height * scale);
  canvas.style.height = `${height}px`;
}

function line(c, x0, y0, x1, y1) {
  c.beginPath();
  c.moveTo(x0, y0);
  c.lineTo(x1, y1);
  c.stroke();
}

function bar(c, x, y, width, height, round = 3) {
  if (!(width > 0)) return; // in a frame that is hidden, or all but
  c.beginPath();
  c.roundRect(x, y, width, height, Math.min(round, width / 2));
  c.fill();
}

// A text, or its beginning and its end: what tells names apart is often last.
function fitted(c, text, width) {
  if (c.measureText(text).width <= width) return text;
  const short = (count) => `${text.slice(0, count >> 1)}…${text.slice(text.length - (count + 1 >> 1))}`;
  let count = text.length - 1;
  while (count > 0 && c.measureText(short(count)).width > width) count -= 1;
  return count > 0 ? short(count) : "…";
}
