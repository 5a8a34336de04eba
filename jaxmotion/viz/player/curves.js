// Curves over time, below the timeline and with its scale: of the picked joints, else the mean of
// all; of every clip that is shown.

const CURVES_HEIGHT = 104;
const MOST_CURVES = 8;
const DASHES = [[], [5, 3], [1.5, 2.5]];

class Curves {
  constructor(canvas, state, timeline, kinds) {
    this.canvas = canvas;
    this.state = state;
    this.timeline = timeline;
    this.kinds = kinds;
    this.kind = kinds.find((kind) => kind.isGiven) || kinds[0];
    this.still = document.createElement("canvas");
    this.known = new Map(); // values by kind, clip and joint
    this.isStale = true;
  }

  resize(width, scale) {
    const height = CURVES_HEIGHT;
    Object.assign(this, { width, height, scale, isStale: true });
    sized(this.canvas, width, height, scale);
    sized(this.still, width, height, scale);
  }

  // {label, clip, joint, values, colour, dash}; joint null for what is no joint's.
  series() {
    const { state, kind } = this;
    const found = [];
    const isShared = this.isShared(kind);
    const clips = state.clips.filter(
      (clip) => (clip.visible || isShared) && (!kind.of || kind.of.has(clip)),
    );
    const names = kind.perJoint ? [...state.picked] : [];
    const several = state.clips.length > 1 && !isShared;
    // The first of these colours are clips'.
    const palette = state.colours.curves;
    const from = isShared ? 2 : 0;
    for (const clip of clips) {
      const joints = names.filter((name) => clip.number.has(name));
      const own = isShared
        ? palette[from]
        : state.colours.clips[clip.index % state.colours.clips.length];
      if (!joints.length)
        found.push({ clip, joint: null, label: this.whole(clip, several), colour: own, dash: 0 });
      for (const name of joints.slice(0, MOST_CURVES)) {
        const k = names.indexOf(name);
        const colour = names.length > 1 ? palette[(k + from) % palette.length] : own;
        const dash = names.length > 1 ? clips.indexOf(clip) % DASHES.length : 0;
        const label = several ? `${clip.name}, ${name}` : name;
        found.push({ clip, joint: clip.number.get(name), label, colour, dash });
      }
    }
    for (const one of found) one.values = this.values(one.clip, one.joint);
    return found;
  }

  // Of several clips together: how far apart they are, say; of none of them.
  isShared(kind) {
    return Boolean(kind.isShared) && this.state.clips.length > 1;
  }

  whole(clip, several) {
    const words = [several ? clip.name : "", this.kind.perJoint ? "mean of joints" : ""];
    return words.filter(Boolean).join(", ") || this.kind.name;
  }

  values(clip, joint) {
    const key = `${this.kinds.indexOf(this.kind)}/${clip.index}/${joint}`;
    if (this.known.has(key)) return this.known.get(key);
    const { read, perJoint } = this.kind;
    const values = new Float32Array(clip.frames);
    for (let frame = 0; frame < clip.frames; frame++)
      values[frame] =
        joint === null && perJoint ? mean(clip, read, frame) : read(clip, frame, joint);
    this.known.set(key, values);
    return values;
  }

  draw() {
    if (this.isStale) this.drawStill();
    const { state, scale, height } = this;
    const c = this.canvas.getContext("2d");
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, this.canvas.width, this.canvas.height);
    c.drawImage(this.still, 0, 0);
    c.setTransform(scale, 0, 0, scale, 0, 0);
    const x = Math.round(this.timeline.x(state.frame)) + 0.5;
    c.strokeStyle = state.colours.text.cursor;
    c.lineWidth = 1.5;
    line(c, x, 0, x, height);
    for (const one of this.shown) {
      const value = one.values[one.clip.frameAt(state.time)];
      if (!Number.isFinite(value)) continue;
      c.fillStyle = css(one.colour);
      c.beginPath();
      c.arc(x, this.y(value), 3.5, 0, 2 * Math.PI);
      c.fill();
    }
  }

  y(value) {
    const { low, high } = this.range;
    return 8 + (1 - (value - low) / (high - low)) * (this.height - 16);
  }

  drawStill() {
    const { state, scale, timeline } = this;
    const text = state.colours.text;
    const c = this.still.getContext("2d");
    this.isStale = false;
    this.shown = this.series();
    this.range = rangeOf(this.shown);
    c.setTransform(scale, 0, 0, scale, 0, 0);
    c.clearRect(0, 0, this.width, this.height);
    c.font = FONT;
    const [left, right] = [timeline.x(-0.5), timeline.x(state.numFrames - 0.5)];
    this.drawErrors(c);
    if (state.loop) {
      c.fillStyle = text.loop;
      const from = timeline.x(state.loop[0] - 0.5);
      c.fillRect(from, 0, timeline.x(state.loop[1] + 0.5) - from, this.height);
    }
    c.lineWidth = 1;
    c.textBaseline = "middle";
    const isWide = timeline.left > 40;
    c.textAlign = isWide ? "right" : "left";
    const { levels, digits } = levelsOf(this.range);
    for (const value of levels) {
      const y = Math.round(this.y(value)) + 0.5;
      c.strokeStyle = text.line;
      line(c, left, y, right, y);
      c.fillStyle = text.faint;
      const unit = this.kind.unit === "°" ? "°" : "";
      c.fillText(value.toFixed(digits) + unit, isWide ? left - 10 : left + 2, isWide ? y : y - 7);
    }
    for (const one of this.shown) this.drawCurve(c, one);
  }

  // Frames with errors of the picked joints, or of any, behind the curves.
  drawErrors(c) {
    const { state, timeline, height } = this;
    c.fillStyle = css(state.colours.error, 0.12);
    for (const row of timeline.rows) {
      if (!row.errors || !row.clip.visible) continue;
      const spans = row.spans(state);
      for (const [a, b] of spans[spans.length - 1].of) {
        const from = timeline.x(row.frame(a) - 0.5);
        c.fillRect(from, 0, timeline.x(row.frame(b) - 0.5) - from, height);
      }
    }
  }

  // Of many frames in one pixel, from the least to the greatest.
  drawCurve(c, { clip, values, colour, dash }) {
    const { state, timeline } = this;
    const x = (frame) => timeline.x((frame * clip.frameTime) / state.frameTime);
    const every = Math.max(1, Math.floor(clip.frames / (2 * this.width)));
    c.strokeStyle = css(colour);
    c.lineWidth = 1.5;
    c.lineJoin = "round";
    c.setLineDash(DASHES[dash]);
    c.beginPath();
    let isDown = false;
    for (let frame = 0; frame < values.length; frame += every) {
      const part =
        every > 1 ? values.subarray(frame, frame + every).filter(Number.isFinite) : [values[frame]];
      if (!part.length || !Number.isFinite(part[0])) {
        isDown = false;
        continue;
      }
      for (const value of every > 1 ? [Math.min(...part), Math.max(...part)] : part) {
        if (isDown) c.lineTo(x(frame), this.y(value));
        else c.moveTo(x(frame), this.y(value));
        isDown = true;
      }
    }
    c.stroke();
    c.setLineDash([]);
  }
}

function mean(clip, read, frame) {
  let sum = 0;
  let count = 0;
  for (let joint = 0; joint < clip.numJoints; joint++) {
    const value = read(clip, frame, joint);
    if (!Number.isFinite(value)) continue;
    sum += value;
    count++;
  }
  return count ? sum / count : NaN;
}

// The least and the greatest of some curves; 0 is in it where that costs little.
function rangeOf(series) {
  let [low, high] = [Infinity, -Infinity];
  for (const { values } of series)
    for (const value of values)
      if (Number.isFinite(value)) {
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
  if (low > high) [low, high] = [0, 1];
  if (low > 0 && low < 0.6 * high) low = 0;
  if (high - low < 1e-9 * Math.max(1, Math.abs(high))) [low, high] = [low - 0.5, high + 0.5];
  return { low, high };
}

// Round numbers in a range, two to five.
function levelsOf({ low, high }) {
  const step = roundStep((high - low) / 2);
  const levels = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) levels.push(k * step);
  return { levels, digits: clamp(-Math.floor(Math.log10(step) + 1e-9), 0, 12) };
}
