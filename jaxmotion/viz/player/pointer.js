// Mouse, pen and fingers: on the picture they turn, move, zoom and pick; on the timeline they
// scrub.

const NEAR = 16; // pixels from a joint
const CLICK = 4; // pixels that a click may move

function listenToStage(player, canvas) {
  const down = new Map(); // pointers on the picture
  let moved = 0;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
    if (down.size === 0) moved = 0;
    down.set(event.pointerId, place(event));
    player.setHover(null);
  });
  canvas.addEventListener("pointermove", (event) => {
    const at = place(event);
    const before = down.get(event.pointerId);
    if (!before) {
      if (event.pointerType !== "touch") player.hoverAt(at, NEAR);
      return;
    }
    const [dx, dy] = [at[0] - before[0], at[1] - before[1]];
    moved += Math.hypot(dx, dy);
    const others = [...down.entries()].filter(([id]) => id !== event.pointerId).map(([, p]) => p);
    if (others.length) pinch(player, before, at, others[0]);
    else if (event.shiftKey || event.buttons & 6) player.looking.pan(dx, dy);
    else player.looking.orbit(dx, dy);
    down.set(event.pointerId, at);
  });
  const up = (event) => {
    const at = down.get(event.pointerId);
    down.delete(event.pointerId);
    if (event.type === "pointerup" && at && !down.size && moved < CLICK && event.button === 0)
      player.pickAt(at, NEAR, event.shiftKey || event.ctrlKey || event.metaKey);
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("pointerleave", () => player.setHover(null));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", () => player.looking.frameAll());
  const wheel = (event) => {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : 1);
    player.looking.zoom(Math.exp(clamp(pixels, -240, 240) * 0.0015));
  };
  canvas.addEventListener("wheel", wheel, { passive: false });
}

// Two fingers: their distance zooms, their middle moves.
function pinch(player, before, at, other) {
  const wide = (p) => Math.max(Math.hypot(p[0] - other[0], p[1] - other[1]), 1);
  player.looking.zoom(wide(before) / wide(at));
  player.looking.pan((at[0] - before[0]) / 2, (at[1] - before[1]) / 2);
}

// Scrub; with shift from one end of a loop to the other; the edges of a loop can be dragged.
function listenToTime(player, canvas, timeline) {
  let drag = null;
  const x = (event) => event.clientX - canvas.getBoundingClientRect().left;
  const edge = (at) => {
    const { loop } = player.state;
    if (!loop) return null;
    const [a, b] = [timeline.x(loop[0] - 0.5), timeline.x(loop[1] + 0.5)];
    if (Math.abs(at - a) < 6) return loop[1];
    return Math.abs(at - b) < 6 ? loop[0] : null;
  };
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    const frame = timeline.frameOf(x(event));
    const other = edge(x(event));
    drag = event.shiftKey ? { from: frame } : other !== null ? { from: other } : {};
    if (drag.from === undefined) player.scrub(frame);
  });
  canvas.addEventListener("pointermove", (event) => {
    const at = x(event);
    canvas.style.cursor = edge(at) !== null ? "ew-resize" : "";
    if (!drag) return;
    const frame = timeline.frameOf(at);
    if (drag.from === undefined) player.scrub(frame);
    else player.setLoop([Math.min(drag.from, frame), Math.max(drag.from, frame)]);
  });
  const up = () => {
    if (drag) player.endScrub();
    drag = null;
  };
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("dblclick", () => player.setLoop(null));
}
