// What stands behind # in the address; main.js lists it.

function readAddress(player) {
  const asked = new URLSearchParams(location.hash.slice(1));
  const numbers = (name) => asked.get(name).split(",").map(Number);
  const { state, camera } = player;
  if (asked.has("theme")) player.setTheme(asked.get("theme"));
  if (asked.has("speed")) player.setSpeed(Number(asked.get("speed")) || 1);
  if (asked.has("side") && (asked.get("side") !== "0") !== state.sideBySide)
    player.flip("sideBySide");
  for (const name of ["trail", "contacts", "list", "follow"])
    if (asked.has(name)) state[name] = asked.get(name) !== "0";
  if (asked.has("pick")) {
    state.picked = new Set(asked.getAll("pick"));
    player.timeline.isStale = player.curves.isStale = true;
  }
  if (asked.has("curve")) {
    const kind = player.curves.kinds.find((k) => k.name === asked.get("curve"));
    if (kind) player.setCurve(kind);
  }
  if (asked.has("loop")) {
    const [a, b] = asked.get("loop").split("-").map(Number);
    if (Number.isFinite(a) && Number.isFinite(b)) player.setLoop([a, b]);
  }
  if (asked.has("time")) player.seek(Number(asked.get("time")) / state.frameTime || 0);
  if (asked.has("frame")) player.seek(Number(asked.get("frame")) || 0);
  if (asked.has("camera")) {
    const [yaw, pitch, distance] = numbers("camera").map((x, k) =>
      k < 2 ? (x * Math.PI) / 180 : x,
    );
    if (Number.isFinite(yaw)) camera.yaw = yaw;
    if (Number.isFinite(pitch)) camera.pitch = clamp(pitch, -1.55, 1.55);
    if (Number.isFinite(distance) && distance > 0) camera.distance = distance;
  }
  if (asked.has("target")) {
    const target = numbers("target");
    if (target.length === 3 && target.every(Number.isFinite)) {
      state.follow = false;
      camera.target = target;
    }
  }
  if (asked.has("paused")) player.pause();
  player.changed();
}
