// Where the camera stands and what it sees: framing, following, the views of the stage.

class Looking {
  // `size`: of the figures; `changed`: tells that there is something to draw.
  constructor(state, size, changed) {
    Object.assign(this, { state, size, changed, width: 0, height: 0, followed: null });
    this.camera = new Camera(size);
    state.follow = this.travel() > 0.4 * size;
    this.lookFrom((35 * Math.PI) / 180, 0.16);
  }

  travel() {
    const clip = this.state.clips[0];
    let first = [NaN, NaN, NaN];
    for (let frame = 0; frame < clip.frames && Number.isNaN(first[0]); frame++)
      first = clip.middleAt(frame);
    let most = 0;
    for (let frame = 0; frame < clip.frames; frame += 1 + (clip.frames >> 8)) {
      const [x, , z] = subtract(clip.middleAt(frame), first);
      if (Number.isFinite(x + z)) most = Math.max(most, Math.hypot(x, z));
    }
    return most;
  }

  frameAll() {
    const { state, camera } = this;
    const clips = state.clips.filter((clip) => clip.visible && !this.isApart(clip));
    const [low, high] = [
      [Infinity, Infinity, Infinity],
      [-Infinity, -Infinity, -Infinity],
    ];
    for (const clip of clips)
      for (const frame of state.follow ? [clip.frameAt(state.time)] : sampled(clip.frames))
        clip.at(frame).forEach((x, k) => {
          if (Number.isNaN(x) || clip.apart.has(Math.floor(k / 3))) return;
          low[k % 3] = Math.min(low[k % 3], x);
          high[k % 3] = Math.max(high[k % 3], x);
        });
    const isKnown = low[0] <= high[0];
    camera.target = isKnown ? mixed(low, high, 0.5) : [0, this.size / 2, 0];
    camera.target[1] += 0.04 * this.size; // below the names on top
    const [x, y, z] = isKnown ? subtract(high, low) : [0, this.size, 0];
    const aspect = this.width / this.height;
    const tall = (0.7 * Math.max(y, this.size)) / Math.max(1 / aspect, 1);
    const wide = (0.6 * Math.hypot(x, z)) / Math.max(aspect, 1);
    camera.distance = Math.max(tall, wide) / Math.tan(camera.fov / 2) + Math.hypot(x, z) / 3;
    this.followed = null;
    this.followFigure();
    this.changed();
  }

  lookFrom(yaw, pitch) {
    this.camera.yaw = (this.state.clips[0].facing ?? 0) + yaw;
    this.camera.pitch = pitch;
    this.changed();
  }

  orbit(dx, dy) {
    this.camera.orbit(dx, dy);
    this.changed();
  }

  pan(dx, dy) {
    const { w, h } = this.views[0];
    this.camera.pan(dx, dy, Math.min(w, h));
    this.changed();
  }

  zoom(factor) {
    this.camera.zoom(factor);
    this.changed();
  }

  // Move the camera as far over the ground as the first clip shown has gone.
  followFigure() {
    const { state, camera } = this;
    const clip = state.clips.find((c) => c.visible);
    if (!state.follow || !clip) {
      this.followed = null;
      return;
    }
    const [x, , z] = clip.middleAt(clip.frameAt(state.time));
    if (!Number.isFinite(x + z)) return;
    if (this.followed) camera.target = add(camera.target, subtract([x, 0, z], this.followed));
    this.followed = [x, 0, z];
  }

  // Side by side, a clip that starts elsewhere than the first shown has a camera that goes with it;
  // others share one, so that what differs is seen.
  isApart(clip) {
    const [first] = this.state.clips.filter((c) => c.visible);
    if (!this.state.sideBySide || !first || clip === first) return false;
    return length(onGround(subtract(clip.middleAt(0), first.middleAt(0)))) > 0.5 * this.size;
  }

  cameraOf(clip) {
    if (!this.isApart(clip)) return this.camera;
    const { state } = this;
    const first = state.clips.find((c) => c.visible);
    const place = (c) => c.middleAt(state.follow ? c.frameAt(state.time) : 0);
    const away = onGround(subtract(place(clip), place(first)));
    return Number.isFinite(length(away)) ? this.camera.moved(away) : this.camera;
  }

  // {x, y, w, h, clips, camera} in CSS pixels of the stage: one, or one a clip.
  get views() {
    const { state, width, height } = this;
    const shown = state.clips.filter((clip) => clip.visible);
    if (!state.sideBySide || shown.length < 2)
      return [{ x: 0, y: 0, w: width, h: height, clips: shown, camera: this.camera }];
    const n = shown.length;
    const isWide = width >= height;
    return shown.map((clip, k) => ({
      x: isWide ? Math.round((k * width) / n) : 0,
      y: isWide ? 0 : Math.round((k * height) / n),
      w: isWide ? width / n : width,
      h: isWide ? height : height / n,
      clips: [clip],
      camera: this.cameraOf(clip),
    }));
  }

  viewOf(clip) {
    return this.views.find((view) => view.clips.includes(clip)) || this.views[0];
  }

  // The joint that is seen nearest to a place of the stage, within some pixels.
  jointAt([x, y], reach) {
    const { state } = this;
    let best = { cost: reach, name: null };
    for (const view of this.views) {
      const matrix = view.camera.matrix(view.w / view.h);
      for (const clip of view.clips) {
        const pose = clip.at(clip.frameAt(state.time));
        for (let j = 0; j < clip.numJoints; j++) {
          const name = clip.joints[j];
          const at = state.hidden.has(name)
            ? null
            : projected(pose.subarray(3 * j, 3 * j + 3), matrix, view);
          const cost = at ? Math.hypot(at[0] - x, at[1] - y) : Infinity;
          if (cost < best.cost) best = { cost, name };
        }
      }
    }
    return best.name;
  }
}

function sampled(frames) {
  const every = 1 + (frames >> 7);
  return Array.from({ length: Math.ceil(frames / every) }, (_, k) => k * every);
}

const onGround = ([x, , z]) => [x, 0, z];
