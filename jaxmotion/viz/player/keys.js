// The keyboard.

const KEY_HELP = [
  ["space", "play, pause"],
  ["← →", "a frame back, on; with shift ten"],
  ["Home End", "first frame, last frame"],
  [", .", "slower, faster"],
  ["[ ]", "loop from here, to here"],
  ["\\", "no loop"],
  ["n p", "next, previous error"],
  ["f", "the camera follows"],
  ["t", "trail: poses and paths before and after"],
  ["c x", "contacts; errors in colour"],
  ["s", "side by side, or over one another"],
  ["r", "all of the figure"],
  ["1 2 3", "from the front, the side, above"],
  ["+ -", "nearer, farther"],
  ["j", "list of joints"],
  ["d", "dark, light"],
  ["Esc", "pick nothing, close"],
  ["drag", "turn; with shift or the right button move"],
  ["wheel", "nearer, farther; on a screen two fingers"],
  ["click", "on a joint: pick it, and its curve; with shift several"],
  ["shift+drag", "on the timeline: loop a range"],
];

function listenToKeys(player) {
  const { state } = player;
  const last = state.numFrames - 1;
  const actions = {
    " ": () => player.toggle(),
    ArrowLeft: (e) => player.step(e.shiftKey ? -10 : -1),
    ArrowRight: (e) => player.step(e.shiftKey ? 10 : 1),
    Home: () => player.seek(0),
    End: () => player.seek(state.numFrames - 1),
    ",": () => player.setSpeed(SPEEDS.findLast((speed) => speed < state.speed) ?? SPEEDS[0]),
    ".": () => player.setSpeed(SPEEDS.find((speed) => speed > state.speed) ?? SPEEDS.at(-1)),
    "[": () => player.setLoop([state.frame, state.loop?.[1] > state.frame ? state.loop[1] : last]),
    "]": () => player.setLoop([state.loop?.[0] < state.frame ? state.loop[0] : 0, state.frame]),
    "\\": () => player.setLoop(null),
    n: () => player.nextError(1),
    p: () => player.nextError(-1),
    f: () => player.flip("follow"),
    t: () => player.flip("trail"),
    c: () => player.flip("contacts"),
    x: () => player.flip("marks"),
    s: () => player.flip("sideBySide"),
    r: () => player.looking.frameAll(),
    1: () => player.looking.lookFrom(0, 0.08),
    2: () => player.looking.lookFrom(Math.PI / 2, 0.08),
    3: () => player.looking.lookFrom(0, 1.5),
    "+": () => player.looking.zoom(0.85),
    "=": () => player.looking.zoom(0.85),
    "-": () => player.looking.zoom(1 / 0.85),
    j: () => player.flip("list"),
    d: () => player.flipTheme(),
    "?": () => player.flip("help"),
    Escape: () => player.escape(),
  };
  document.addEventListener("keydown", (event) => {
    const { target } = event;
    const isTyping = target.tagName === "INPUT" || target.tagName === "SELECT";
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (isTyping && event.key !== "Escape") return;
    const act = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault(); // a space would press the button that has the focus, too
    act(event);
  });
  // A space on a button that has the focus is no click, and a list gives the keys back.
  document.addEventListener("keyup", (event) => {
    if (event.key === " " && event.target.tagName === "BUTTON") event.preventDefault();
  });
  document.addEventListener("change", (event) => {
    if (event.target.tagName === "SELECT") event.target.blur();
  });
}
