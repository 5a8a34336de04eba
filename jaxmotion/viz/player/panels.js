// What stands around the picture: buttons, names, the list of joints, help. Text is set as text.

const ICONS = {
  play: "M7 4.5v15l12-7.5z",
  pause: "M6.5 5h4v14h-4zM13.5 5h4v14h-4z",
  first: "M6 5h2v14H6zM19 5v14L9 12z",
  last: "M16 5h2v14h-2zM5 5v14l10-7z",
  back: "M15.5 5v14L6 12z",
  next: "M8.5 5v14L18 12z",
  joints: "M4 5h3v3H4zM9 5.5h11v2H9zM7 10.5h3v3H7zM12 11h8v2h-8zM7 16h3v3H7zM12 16.5h8v2h-8z",
  fit: "M4 4h6v2H6v4H4zM14 4h6v6h-2V6h-4zM4 14h2v4h4v2H4zM18 14h2v6h-6v-2h4z",
  theme: "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18zm0 2v14a7 7 0 0 1 0-14z",
  help:
    "M12 3a9 9 0 1 0 0 18 9 9 0 0 0 0-18zm-.2 13.2a1.2 1.2 0 1 1 0 2.4 1.2 1.2 0 0 1 0-2.4z" +
    "M8.5 9.2a3.5 3.5 0 1 1 5 3.2c-.6.3-.8.6-.8 1.1v.7h-1.9v-.9c0-1.2.6-2 1.7-2.5" +
    "a1.6 1.6 0 1 0-2.2-1.6z",
};

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];

function element(tag, props = {}, ...children) {
  const { data, ...rest } = props;
  const made = Object.assign(document.createElement(tag), rest);
  Object.assign(made.dataset, data);
  made.append(...children);
  return made;
}

function icon(name) {
  const space = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(space, "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(space, "path");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
}

class Panels {
  constructor(player) {
    this.player = player;
    this.state = player.state;
    this.buttons = new Map();
    this.rows = new Map(); // of the list of joints, by name
    this.transport();
    this.tools();
    this.header();
    this.jointList();
    this.help();
    this.curveList();
  }

  at(id) {
    return document.getElementById(id);
  }

  button(name, title, act, content) {
    const made = element("button", { type: "button", title, onclick: act }, content);
    made.setAttribute("aria-label", title);
    made.dataset.name = name;
    this.buttons.set(name, made);
    return made;
  }

  transport() {
    const { player, state } = this;
    this.at("buttons").append(
      this.button("first", "first frame (Home)", () => player.seek(0), icon("first")),
      this.button("back", "a frame back (←)", () => player.step(-1), icon("back")),
      this.button("play", "play or pause (space)", () => player.toggle(), icon("play")),
      this.button("next", "a frame on (→)", () => player.step(1), icon("next")),
      this.button("last", "last frame (End)", () => player.seek(state.numFrames - 1), icon("last")),
    );
    const options = SPEEDS.map((s) => element("option", { value: s, textContent: `${s}×` }));
    this.frame = element("b");
    this.seconds = element("span");
    this.at("clock").append(this.frame, this.seconds);
    this.speed = element(
      "select",
      { title: "speed (, and .)", onchange: () => player.setSpeed(+this.speed.value) },
      ...options,
    );
    this.speed.setAttribute("aria-label", "speed");
    const flag = (name, words, title) => this.button(name, title, () => player.flip(name), words);
    this.at("toggles").append(this.speed);
    this.at("toggles").append(flag("follow", "Follow", "the camera follows (f)"));
    this.at("toggles").append(flag("trail", "Trail", "poses and paths before and after (t)"));
    if (state.clips.some((clip) => clip.contacts))
      this.at("toggles").append(flag("contacts", "Contacts", "foot prints (c)"));
    if (state.clips.some((clip) => clip.errors))
      this.at("toggles").append(flag("marks", "Errors", "joints in error in colour (x)"));
    if (state.clips.length > 1)
      this.at("toggles").append(
        flag("sideBySide", "Side by side", "beside, not over one another (s)"),
      );
  }

  tools() {
    const { player } = this;
    this.at("tools").append(
      this.button("joints", "joints (j)", () => player.flip("list"), icon("joints")),
      this.button("fit", "all of the figure (r)", () => player.looking.frameAll(), icon("fit")),
      this.button("theme", "dark or light (d)", () => player.flipTheme(), icon("theme")),
      this.button("help", "keys (?)", () => player.flip("help"), icon("help")),
    );
  }

  header() {
    const { state, player } = this;
    const { title } = player.content;
    const [first] = state.clips;
    this.at("title").textContent = title || (state.clips.length === 1 ? first.name : "");
    this.at("about").textContent = aboutClip(first);
    if (state.clips.length < 2) return;
    this.at("about").hidden = true;
    for (const clip of state.clips) {
      const swatch = element("i", { className: "swatch" });
      const name = element("b", { textContent: clip.name });
      const chip = element(
        "button",
        { type: "button", title: "show or hide" },
        swatch,
        name,
        element("span", { textContent: aboutClip(clip) }),
      );
      chip.onclick = () => player.showClip(clip, !clip.visible);
      clip.chip = chip;
      clip.swatch = swatch;
      this.at("legend").append(element("li", {}, chip));
    }
  }

  // Joints of the first clip as a tree, then those that only others have.
  jointList() {
    const { state, player } = this;
    const seen = new Set();
    for (const clip of state.clips) {
      const depth = [];
      clip.joints.forEach((name, j) => {
        depth[j] = j ? depth[clip.parents[j]] + 1 : 0;
        if (seen.has(name)) return;
        seen.add(name);
        this.at("list").append(this.jointRow(name, depth[j]));
      });
    }
    this.at("search").oninput = (event) => {
      const wanted = event.target.value.toLowerCase();
      for (const [name, row] of this.rows) row.hidden = !name.toLowerCase().includes(wanted);
    };
    this.at("list").onmouseleave = () => player.setHover(null);
  }

  jointRow(name, depth) {
    const { player } = this;
    const eye = element("button", {
      type: "button",
      className: "eye",
      title: "hide or show it and what hangs from it (shift: it alone)",
    });
    eye.setAttribute("aria-label", `hide or show ${name}`);
    eye.onclick = (event) => player.flipHidden(name, event.shiftKey);
    const label = element("button", {
      type: "button",
      className: "joint",
      textContent: name,
      title: name,
    });
    label.onclick = (event) => player.pick(name, event.shiftKey || event.ctrlKey || event.metaKey);
    label.style.paddingLeft = `${4 + 9 * Math.min(depth, 12)}px`;
    const row = element("li", { onmouseenter: () => player.setHover(name) }, label, eye);
    this.rows.set(name, row);
    return row;
  }

  help() {
    const close = element("button", {
      type: "button",
      className: "close",
      textContent: "Close",
      onclick: () => this.player.flip("help"),
    });
    const keys = KEY_HELP.flatMap(([key, words]) => [
      element("dt", {}, ...key.split(" ").map((k) => element("kbd", { textContent: k }))),
      element("dd", { textContent: words }),
    ]);
    this.at("help").append(
      element("h2", { textContent: "Keys and pointer" }),
      element("dl", {}, ...keys),
      close,
    );
  }

  curveList() {
    const { player } = this;
    const which = this.at("which");
    player.curves.kinds.forEach((kind, k) =>
      which.append(element("option", { value: k, textContent: kind.name })),
    );
    which.onchange = () => player.setCurve(player.curves.kinds[+which.value]);
  }

  // Show what the state is.
  update() {
    const { state, player } = this;
    for (const name of ["follow", "trail", "contacts", "marks", "sideBySide"])
      this.buttons.get(name)?.setAttribute("aria-pressed", String(state[name]));
    this.buttons.get("joints").setAttribute("aria-pressed", String(state.list));
    this.buttons.get("help").setAttribute("aria-pressed", String(state.help));
    this.buttons.get("play").replaceChildren(icon(state.playing ? "pause" : "play"));
    const isKnown = [...this.speed.options].some((option) => +option.value === state.speed);
    if (!isKnown) {
      const textContent = `${+state.speed.toPrecision(3)}×`;
      this.speed.append(element("option", { value: state.speed, textContent }));
    }
    this.speed.value = String(state.speed);
    this.at("joints").hidden = !state.list;
    this.at("help").hidden = !state.help;
    this.at("which").value = String(player.curves.kinds.indexOf(player.curves.kind));
    for (const [name, row] of this.rows) {
      row.classList.toggle("hidden-joint", state.hidden.has(name));
      row.classList.toggle("picked", state.picked.has(name));
    }
    for (const clip of state.clips) {
      if (!clip.chip) continue;
      clip.chip.setAttribute("aria-pressed", String(clip.visible));
      clip.swatch.style.background = css(
        state.colours.clips[clip.index % state.colours.clips.length],
      );
    }
  }

  // What changes with every frame; only text that is another is set.
  updateFrame() {
    const { state, player } = this;
    const { shown, kind } = player.curves;
    if (this.shown !== shown) this.startValues(shown);
    say(this.frame, `${state.frame} / ${state.numFrames - 1}`);
    say(this.seconds, `${(state.frame * state.frameTime).toFixed(2)} s`);
    shown.forEach((one, k) => {
      const value = one.values[one.clip.frameAt(state.time)];
      say(this.numbers[k], Number.isFinite(value) ? short(value) + kind.unit : "–");
    });
  }

  startValues(shown) {
    this.shown = shown;
    this.numbers = shown.map(() => element("b"));
    const items = shown.map((one, k) => {
      const swatch = element("i", { className: "swatch" });
      swatch.style.background = css(one.colour);
      return element(
        "li",
        {},
        swatch,
        element("span", { textContent: one.label }),
        this.numbers[k],
      );
    });
    this.at("values").replaceChildren(...items);
  }

  // Names over the pictures that stand side by side.
  labels(views) {
    const shown = views.length > 1 ? views : [];
    this.at("labels").replaceChildren(
      ...shown.map(({ x, y, w, h, clips }) => {
        const label = element("span", { textContent: clips[0].name });
        Object.assign(label.style, {
          left: `${x}px`,
          top: `${y}px`,
          width: `${w}px`,
          height: `${h}px`,
        });
        return label;
      }),
    );
  }

  tip(name, x, y) {
    const tip = this.at("tip");
    tip.hidden = name === null;
    if (name === null) return;
    tip.textContent = name;
    tip.style.left = `${x}px`;
    tip.style.top = `${y}px`;
  }

  notice(text) {
    this.at("notice").hidden = !text;
    say(this.at("notice"), text);
  }
}

function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function aboutClip(clip) {
  const seconds = clip.frames * clip.frameTime;
  const rate = Number((1 / clip.frameTime).toPrecision(5));
  const frames = `${clip.frames} frame${clip.frames === 1 ? "" : "s"}`;
  return `${frames} · ${seconds.toFixed(2)} s · ${rate} fps · ${clip.numJoints} joints`;
}
