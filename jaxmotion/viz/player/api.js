// window.jaxmotionPlayer, which main.js describes, and the start.

function apiOf(player) {
  const { state } = player;
  const clipAt = (clip) => state.clips[clip];
  const number = (joint, clip) =>
    typeof joint === "string" ? clipAt(clip).number.get(joint) : joint;
  const box = () => player.picture.canvas.getBoundingClientRect();
  const mean = (list) => list.reduce((sum, x) => sum + x, 0) / (list.length || 1);
  const api = {
    numFrames: state.numFrames,
    frameTime: state.frameTime,
    joints: state.clips[0].joints,
    origin: player.content.origin,
    play: () => player.play(),
    pause: () => player.pause(),
    step: (frames) => player.step(frames),
    get renderer() {
      return player.picture.name;
    },
    get playing() {
      return state.playing;
    },
    viewport(clip = 0) {
      const { x, y, w, h } = player.looking.viewOf(clipAt(clip));
      return { x: x + box().x, y: y + box().y, w, h };
    },
    position(joint, clip = 0) {
      const own = clipAt(clip);
      return own.position(number(joint, clip), own.frameAt(state.time));
    },
    project(joint, clip = 0) {
      player.looking.followFigure();
      const view = api.viewport(clip);
      const seenBy = player.looking.viewOf(clipAt(clip)).camera;
      const at = projected(api.position(joint, clip), seenBy.matrix(view.w / view.h), view);
      return at && at.slice(0, 2);
    },
    get timing() {
      const { frames, draw, interval } = player.times;
      return { frames, draw: mean(draw), interval: mean(interval) };
    },
    measure(frames) {
      player.pause();
      const start = performance.now();
      for (let k = 0; k < frames; k++) {
        state.time = (k % state.numFrames) * state.frameTime;
        player.draw();
      }
      player.picture.finish();
      return (performance.now() - start) / frames;
    },
  };
  const both = (name, read, write) =>
    Object.defineProperty(api, name, { get: read, set: write, enumerable: true });
  both(
    "frame",
    () => state.frame,
    (frame) => player.seek(frame),
  );
  both(
    "time",
    () => state.time,
    (seconds) => player.seek(seconds / state.frameTime),
  );
  both(
    "speed",
    () => state.speed,
    (speed) => player.setSpeed(speed),
  );
  both(
    "loop",
    () => state.loop,
    (loop) => player.setLoop(loop),
  );
  both(
    "theme",
    () => player.theme,
    (theme) => player.setTheme(theme),
  );
  for (const name of ["picked", "hidden"])
    both(
      name,
      () => [...state[name]],
      (names) => {
        state[name] = new Set(names);
        player.timeline.isStale = player.curves.isStale = true;
        player.changed();
      },
    );
  for (const name of ["follow", "trail", "contacts", "marks", "sideBySide", "list"])
    both(
      name,
      () => state[name],
      (value) => {
        state[name] = Boolean(value);
        player.changed();
      },
    );
  both(
    "camera",
    () => cameraTold(player),
    (asked) => setCamera(player, asked),
  );
  return api;
}

function cameraTold(player) {
  player.looking.followFigure();
  const { camera } = player;
  const { w, h } = player.looking.views[0];
  const { eye, target, yaw, pitch, distance, near, far, view } = camera;
  return {
    eye,
    target,
    up: UP,
    fov: camera.angleOf(w / h),
    yaw,
    pitch,
    distance,
    near,
    far,
    view: [...view],
    projection: [...camera.projection(w / h)],
  };
}

function setCamera(player, asked) {
  const { camera } = player;
  if (asked.target) camera.target = [...asked.target];
  if (asked.eye) camera.eye = [...asked.eye];
  for (const name of ["yaw", "pitch", "distance", "fov"])
    if (Number.isFinite(asked[name])) camera[name] = asked[name];
  player.changed(false);
}

const content = JSON.parse(document.getElementById("data").textContent);
document.documentElement.classList.toggle("small", Boolean(content.isSmall));
const player = new Player(content);
listenToKeys(player);
listenToTime(player, player.timeline.canvas, player.timeline);
listenToTime(player, player.curves.canvas, player.timeline);
new ResizeObserver(() => player.resize()).observe(document.getElementById("stage"));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => player.recolour());
addEventListener("hashchange", () => readAddress(player));
player.resize();
readAddress(player);
const isCalm = content.isSmall || matchMedia("(prefers-reduced-motion: reduce)").matches;
const isAsked = new URLSearchParams(location.hash.slice(1)).has("paused");
if (!isCalm && !isAsked && player.state.numFrames > 1) player.play();
window.jaxmotionPlayer = apiOf(player);
