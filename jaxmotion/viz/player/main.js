// The player: its state, what changes it, and the loop that draws.
//
// The address understands, behind #: frame=120, time=2.5 (seconds), paused, speed=0.5, loop=40-80,
// camera=yaw,pitch,distance (degrees and length units), target=x,y,z (which ends following),
// follow=0, trail, contacts=0, side, list (of joints), pick=LeftFoot (may stand several times),
// curve=joint speed, theme=dark; canvas2d (no WebGL), webgl2 (also where that is slow). So
// player.html#frame=120&paused.
//
// window.jaxmotionPlayer, for tests and pages around it. `clip` is a number, 0 the first. The world
// has Y up, the floor at 0; `origin` is where that is in the file's world, turned Y up.
//
//   frame, time, playing, speed, loop [first, last] or null      get and set (playing: get)
//   numFrames, frameTime, joints, renderer ("webgl2", "canvas2d"), origin
//   play(), pause(), step(frames)
//   camera        eye, target, up, fov (vertical, radians), yaw, pitch, distance, near, far, view
//                 and projection (column after column); set any of eye, target, yaw, pitch,
//                 distance, fov
//   viewport(clip)                    {x, y, w, h} in CSS pixels of the window
//   position(joint, clip = 0)         in the world, at the frame shown; a name or a number
//   project(joint, clip = 0)          [x, y] in CSS pixels of the window, null behind the camera
//   picked, hidden                    names of joints, get and set
//   follow, trail, contacts, marks (errors in colour), sideBySide, list, theme     get and set
//   timing        {frames, draw, interval}: frames drawn, ms of the last thirty, their mean
//   measure(n)    draws n frames one after another: ms a frame

const SCALE_MOST = 2; // pixels of the picture a CSS pixel
const KEPT = 30; // times of frames
const SLOW = 40; // ms a frame

class Player {
  constructor(content) {
    this.content = content;
    const clips = content.clips.map((given, index) => new Clip(given, index));
    const frameTime = clips[0].frameTime;
    const seconds = Math.max(...clips.map((clip) => (clip.frames - 1) * clip.frameTime));
    this.state = {
      clips,
      frameTime,
      numFrames: Math.round(seconds / frameTime) + 1,
      time: 0,
      playing: false,
      speed: 1,
      loop: null,
      follow: false,
      trail: false,
      contacts: true,
      marks: true,
      sideBySide: content.sideBySide,
      list: false,
      help: false,
      hidden: new Set(),
      picked: new Set(content.picked),
      hover: null,
      colours: null,
      get frame() {
        return clamp(Math.round(this.time / frameTime), 0, this.numFrames - 1);
      },
    };
    this.size = Math.max(...clips.map((clip) => clip.size));
    this.looking = new Looking(this.state, this.size, () => this.changed(false));
    this.camera = this.looking.camera;
    this.scene = new Scene(this.state);
    this.timeline = new Timeline(document.getElementById("timeline"), this.state);
    this.curves = new Curves(
      document.getElementById("curves"),
      this.state,
      this.timeline,
      curveKinds(content, clips),
    );
    this.times = { draw: [], interval: [], frames: 0, last: 0 };
    this.readColours();
    this.panels = new Panels(this);
    this.startPicture(new URLSearchParams(location.hash.slice(1)));
  }

  // The picture, and its canvas: WebGL's, or where there is none a plain one.
  startPicture(asked) {
    let canvas = document.getElementById("scene");
    try {
      if (asked.has("canvas2d")) throw new Error("asked for");
      this.picture = new WebGLPicture(canvas);
    } catch {
      const other = canvas.cloneNode();
      canvas.replaceWith(other);
      canvas = other;
      this.picture = new CanvasPicture(canvas);
    }
    this.isChosen = asked.has("webgl2");
    listenToStage(this, canvas);
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.goPlain();
    });
  }

  goPlain() {
    this.startPicture(new Set(["canvas2d"]));
    this.resize();
  }

  // WebGL without a graphics card is slower than a plain canvas.
  leaveSlowPicture() {
    const { interval } = this.times;
    if (this.isChosen || this.picture.name !== "webgl2" || interval.length < KEPT) return;
    const middle = [...interval].sort((a, b) => a - b)[KEPT >> 1];
    if (middle > SLOW) this.goPlain();
  }

  readColours() {
    document.documentElement.dataset.look = this.theme;
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(`--${name}`).trim();
    const many = this.state.clips.length > 1;
    this.state.colours = {
      clips: read(many ? "clips" : "clip")
        .split(" ")
        .map(colourOf),
      curves: read("curves").split(" ").map(colourOf),
      picked: colourOf(read("picked")),
      error: colourOf(read("error")),
      contact: colourOf(read("contact")),
      faded: colourOf(read("faded")),
      text: Object.fromEntries(
        ["cursor", "on-cursor", "faint", "line", "strip", "loop", "loop-edge", "missing"].map(
          (name) => [name.replace(/-(.)/, (_, letter) => letter.toUpperCase()), read(name)],
        ),
      ),
    };
    this.look = {
      light: normalized([0.45, 1, 0.55]),
      sky: [...colourOf(read("sky")), Number(read("rim"))],
      shade: [...colourOf(read("shade")), Number(read("shade-alpha"))],
      line: [...colourOf(read("grid")), Number(read("grid-alpha"))],
      cell: roundStep(this.size / 4),
      reach: 14 * this.size,
    };
  }

  // Time

  get end() {
    return (this.state.numFrames - 1) * this.state.frameTime;
  }

  seek(frame) {
    this.state.time = clamp(Math.round(frame), 0, this.state.numFrames - 1) * this.state.frameTime;
    this.changed(false);
  }

  step(frames) {
    this.pause();
    this.seek(this.state.frame + frames);
  }

  play() {
    if (this.state.playing) return;
    this.state.playing = true;
    this.clock = null;
    if (!this.state.loop && this.state.frame === this.state.numFrames - 1) this.state.time = 0;
    this.changed();
  }

  pause() {
    if (!this.state.playing) return;
    this.state.playing = false;
    this.changed();
  }

  toggle() {
    if (this.state.playing) this.pause();
    else this.play();
  }

  scrub(frame) {
    if (this.wasPlaying === undefined) this.wasPlaying = this.state.playing;
    this.pause();
    this.seek(frame);
  }

  endScrub() {
    if (this.wasPlaying) this.play();
    this.wasPlaying = undefined;
  }

  setSpeed(speed) {
    this.state.speed = clamp(speed, 0.01, 100);
    this.changed();
  }

  setLoop(loop) {
    const last = this.state.numFrames - 1;
    const frames = loop && loop.map((f) => clamp(Math.round(f), 0, last)).sort((a, b) => a - b);
    this.state.loop = frames;
    this.timeline.isStale = this.curves.isStale = true;
    this.changed();
  }

  nextError(way) {
    const { state, timeline } = this;
    const starts = timeline.rows
      .filter((row) => row.errors)
      .flatMap((row) => row.errors.map(([first]) => Math.round(row.frame(first))))
      .sort((a, b) => way * (a - b));
    const found = starts.find((frame) => way * (frame - state.frame) > 0);
    if (found === undefined) return;
    this.pause();
    this.seek(found);
  }

  // The time that has passed, and back to the start of the loop. A frame lasts from half a frame
  // before its time to half a frame after.
  advance(now) {
    const { state } = this;
    const passed = this.clock === null ? 0 : Math.min((now - this.clock) / 1000, 0.25);
    this.clock = now;
    state.time += passed * state.speed;
    const [first, last] = state.loop || [0, state.numFrames - 1];
    const [start, stop] = [first - 0.5, last + 0.5].map((frame) => frame * state.frameTime);
    if (state.time >= stop || state.time < start)
      state.time =
        start + ((((state.time - start) % (stop - start)) + (stop - start)) % (stop - start));
  }

  // Joints

  hoverAt(at, reach) {
    const name = this.looking.jointAt(at, reach);
    this.setHover(name);
    this.panels.tip(name, ...at);
  }

  setHover(name) {
    if (name === null) this.panels.tip(null);
    if (this.state.hover === name) return;
    this.state.hover = name;
    this.changed(false);
  }

  pickAt(at, reach, isMore) {
    this.pick(this.looking.jointAt(at, reach), isMore);
  }

  pick(name, isMore = false) {
    const { picked } = this.state;
    const was = name !== null && picked.has(name) && (isMore || picked.size === 1);
    if (!isMore) picked.clear();
    if (was) picked.delete(name);
    else if (name !== null) picked.add(name);
    this.timeline.isStale = this.curves.isStale = true;
    this.changed();
  }

  // A joint and what hangs from it, or it alone.
  flipHidden(name, isAlone) {
    const { state } = this;
    const hide = !state.hidden.has(name);
    const below = new Set([name]);
    for (const clip of isAlone ? [] : state.clips)
      clip.joints.forEach(
        (other, j) => j && below.has(clip.joints[clip.parents[j]]) && below.add(other),
      );
    for (const other of below) state.hidden[hide ? "add" : "delete"](other);
    this.changed();
  }

  showClip(clip, isVisible) {
    clip.visible = isVisible;
    this.curves.isStale = true;
    this.changed();
  }

  setCurve(kind) {
    this.curves.kind = kind;
    this.curves.isStale = true;
    this.changed();
  }

  // Everything else

  flip(name) {
    this.state[name] = !this.state[name];
    const isApart = (clip) => this.looking.isApart(clip);
    if (name === "sideBySide" && this.state.clips.some(isApart)) this.looking.frameAll();
    this.changed();
  }

  escape() {
    const { state } = this;
    if (state.help) state.help = false;
    else if (state.picked.size) this.pick(null);
    else if (state.list) state.list = false;
    document.activeElement?.blur();
    this.changed();
  }

  get theme() {
    const asked = document.documentElement.dataset.theme;
    if (asked !== "auto") return asked;
    return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  }

  setTheme(theme) {
    if (!["auto", "light", "dark"].includes(theme)) return;
    document.documentElement.dataset.theme = theme;
    this.recolour();
  }

  flipTheme() {
    this.setTheme(this.theme === "dark" ? "light" : "dark");
  }

  recolour() {
    this.readColours();
    this.timeline.isStale = this.curves.isStale = true;
    this.changed();
  }

  // Drawing

  resize() {
    const stage = document.getElementById("stage").getBoundingClientRect();
    const { canvas } = this.picture;
    this.scale = Math.min(devicePixelRatio || 1, SCALE_MOST);
    this.looking.width = Math.max(stage.width, 1);
    this.looking.height = Math.max(stage.height, 1);
    if (!this.isFramed) this.looking.frameAll();
    this.isFramed = true;
    canvas.width = Math.round(this.looking.width * this.scale);
    canvas.height = Math.round(this.looking.height * this.scale);
    const width = Math.max(document.getElementById("dock").clientWidth, 1);
    this.timeline.resize(width, this.scale);
    this.curves.resize(width, this.scale);
    this.changed();
    this.draw();
  }

  // Something is to be drawn anew; `isPanel`: not only the picture.
  changed(isPanel = true) {
    this.isPanelStale ||= isPanel;
    if (this.isWaiting) return;
    this.isWaiting = true;
    requestAnimationFrame((now) => this.tick(now));
  }

  tick(now) {
    this.isWaiting = false;
    const { times, state } = this;
    if (state.playing) {
      if (times.last) keep(times.interval, now - times.last);
      this.leaveSlowPicture();
      times.last = now;
      this.advance(now);
      this.changed(false);
    } else {
      times.last = 0;
    }
    this.draw();
  }

  draw() {
    if (!this.looking.width) return;
    const start = performance.now();
    const { state, picture } = this;
    this.looking.followFigure();
    if (this.isPanelStale) {
      this.panels.update();
      this.panels.labels(this.looking.views);
    }
    const views = this.looking.views.map((view) => ({
      ...view,
      lists: view.clips.map((clip, k) => this.scene.build(clip, k === view.clips.length - 1)),
    }));
    picture.draw(views, this.look, this.scale);
    this.timeline.draw();
    this.curves.draw();
    this.panels.updateFrame();
    this.panels.notice(this.missing());
    this.isPanelStale = false;
    keep(this.times.draw, performance.now() - start);
    this.times.frames++;
  }

  missing() {
    const { state } = this;
    const without = state.clips.filter((clip) => {
      if (!clip.visible) return false;
      const pose = clip.at(clip.frameAt(state.time));
      return pose.every(Number.isNaN);
    });
    const named =
      state.clips.length > 1 ? ` of ${without.map((clip) => clip.name).join(", ")}` : "";
    return without.length ? `nothing is known${named} at this frame` : "";
  }
}

function keep(list, value) {
  list.push(value);
  if (list.length > KEPT) list.shift();
}
