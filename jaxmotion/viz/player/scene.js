// What is to be drawn at a time: bones, balls and marks on the floor, whoever draws them.
//
// A shape is {from, to, radius, colour [r, g, b, alpha]}; a ball's from and to are the same. Lists:
// `solid` shapes are lit and throw shadows, `clear` ones are seen through, `floor` ones lie flat.

const GHOSTS = [-3, -2, -1, 1]; // steps of GHOST_STEP seconds
const GHOST_STEP = 0.15;
const PATH_SECONDS = 1.5; // before and after
const PATH_POINTS = 60;
const DEFAULT_PATHS =
  /^(.*[:_\s])?(hips?|pelvis|root|(left|right|l|r)[_.]?(hand|foot|wrist|ankle))$/i;

class Scene {
  constructor(state) {
    this.state = state;
  }

  // Ghosts only of the `last` clip of a view: of several they would hide one another.
  build(clip, isLast = true) {
    const { state } = this;
    const lists = { solid: [], clear: [], floor: [] };
    if (!clip.visible) return lists;
    const frame = clip.frameAt(state.time);
    const faded = clip.hasEnded(state.time) ? 0.25 : 1;
    this.figure(clip, frame, faded, faded < 1 ? lists.clear : lists.solid);
    if (state.trail) {
      if (isLast) this.ghosts(clip, frame, lists.clear);
      this.paths(clip, frame, lists.clear);
    }
    if (state.contacts) this.footprints(clip, frame, lists);
    return lists;
  }

  // The colour of a joint at a frame, picked and hovered ones and errors standing out.
  colour(clip, frame, joint, alpha) {
    const { state } = this;
    const theme = state.colours;
    const name = clip.joints[joint];
    if (state.picked.has(name)) return [...theme.picked, alpha];
    if (state.marks && clip.isError(frame, joint)) return [...theme.error, alpha];
    const own = theme.clips[clip.index % theme.clips.length];
    const other = state.picked.size ? mixed(own, theme.faded, 0.4) : own;
    return [...(state.hover === name ? mixed(other, theme.picked, 0.5) : other), alpha];
  }

  figure(clip, frame, alpha, list, isGhost = false) {
    const { state } = this;
    const pose = clip.at(frame);
    const thick = new Float32Array(clip.numPoints); // of the ball at each point
    const radii = this.radii(clip);
    for (let p = 0; p < clip.numPoints; p++) {
      const parent = clip.parents[p];
      if (parent < 0 || Number.isNaN(pose[3 * p]) || Number.isNaN(pose[3 * parent])) continue;
      const from = [...pose.subarray(3 * parent, 3 * parent + 3)];
      const to = [...pose.subarray(3 * p, 3 * p + 3)];
      const radius = radii[p];
      if (radius === 0 || (clip.loose.has(p) && clip.apart.has(parent))) continue;
      thick[parent] = Math.max(thick[parent], 0.62 * radius);
      thick[p] = Math.max(thick[p], 0.5 * radius);
      if (state.hidden.has(clip.joints[parent])) continue;
      list.push({ from, to, radius, colour: this.colour(clip, frame, parent, alpha) });
    }
    if (isGhost) return;
    const least = 0.004 * clip.size;
    for (let j = 0; j < clip.numPoints; j++) {
      if (Number.isNaN(pose[3 * j]) || state.hidden.has(clip.joints[clip.owner(j)])) continue;
      if (clip.apart.has(j) && thick[j] === 0) continue;
      const isEnd = j >= clip.numJoints;
      const colour = this.colour(clip, frame, clip.owner(j), alpha);
      const picked = !isEnd && state.picked.has(clip.joints[j]);
      const at = [...pose.subarray(3 * j, 3 * j + 3)];
      const grown = picked || (!isEnd && state.hover === clip.joints[j]) ? 1.35 : 1;
      const radius = grown * (isEnd ? 0.85 * thick[j] : Math.max(1.15 * thick[j], least));
      list.push({ from: at, to: at, radius, colour: isEnd || picked ? colour : lighter(colour) });
    }
  }

  // Of each bone, by its length in the first frame it is known; long ones are not fat.
  radii(clip) {
    if (clip.radii) return clip.radii;
    const radii = new Float32Array(clip.numPoints);
    for (let p = 0; p < clip.numPoints; p++) {
      const parent = clip.parents[p];
      for (let frame = 0; parent >= 0 && frame < clip.frames; frame++) {
        const long = length(subtract(clip.position(p, frame), clip.position(parent, frame)));
        if (Number.isNaN(long)) continue;
        const most = clip.loose.has(p) ? 0.005 : 0.024; // of what is no bone, a line
        const thick = clamp(0.13 * long, 0.0035 * clip.size, most * clip.size);
        radii[p] = long > 1e-5 * clip.size ? Math.min(thick, 0.5 * long) : 0;
        break;
      }
    }
    clip.radii = radii;
    return radii;
  }

  ghosts(clip, frame, list) {
    for (const step of GHOSTS) {
      const other = frame + Math.round((step * GHOST_STEP) / clip.frameTime);
      if (other < 0 || other >= clip.frames || other === frame) continue;
      this.figure(clip, other, 0.22 - 0.045 * Math.abs(step), list, true);
    }
    clip.at(frame);
  }

  // Where the picked joints, else hips, hands and feet, were and will be.
  paths(clip, frame, list) {
    const { picked, colours } = this.state;
    let joints = clip.joints.map((_, j) => j).filter((j) => picked.has(clip.joints[j]));
    if (!joints.length)
      joints = clip.joints.map((_, j) => j).filter((j) => DEFAULT_PATHS.test(clip.joints[j]));
    if (!joints.length) joints = [0];
    const reach = Math.round(PATH_SECONDS / clip.frameTime);
    const step = Math.max(1, Math.round(reach / PATH_POINTS));
    const own = colours.clips[clip.index % colours.clips.length];
    for (const joint of joints)
      for (
        let a = Math.max(0, frame - reach);
        a < Math.min(clip.frames - 1, frame + reach);
        a += step
      ) {
        const b = Math.min(a + step, clip.frames - 1);
        const [from, to] = [clip.place(a, joint), clip.place(b, joint)];
        if (Number.isNaN(from[0]) || Number.isNaN(to[0])) continue;
        const alpha = 0.75 * (1 - Math.abs(a - frame) / (reach + 1));
        const colour = [...(a < frame ? own : mixed(own, colours.faded, 0.6)), alpha];
        list.push({ from, to, radius: 0.0035 * clip.size, colour, isLine: true });
      }
  }

  // Of past and coming contacts faint discs, of those that hold now a ring of colour.
  footprints(clip, frame, lists) {
    const { colours } = this.state;
    const window = Math.round(4 / clip.frameTime);
    for (const span of clip.contactSpans) {
      const holds = span.first <= frame && frame <= span.last;
      if (!holds && (span.first > frame + window || span.last < frame - window)) continue;
      const place = span.place;
      const radius = 0.028 * clip.size;
      const floor = [place[0], 0, place[2]];
      lists.floor.push({
        from: floor,
        to: floor,
        radius,
        colour: [...colours.contact, holds ? 0.85 : 0.28],
      });
      if (holds)
        lists.clear.push({
          from: place,
          to: place,
          radius: 0.55 * radius,
          colour: [...colours.contact, 0.55],
        });
    }
  }
}

const lighter = ([r, g, b, alpha]) => [...mixed([r, g, b], [1, 1, 1], 0.14), alpha];
