// What encode.py wrote, read back: clips, their marks, and curves over time.

function bytesOf(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

const numbersOf = (text, Type) => new Type(bytesOf(text).buffer);

class Clip {
  constructor(given, index) {
    this.index = index;
    this.name = given.name;
    this.frames = given.frames;
    this.frameTime = given.frameTime;
    this.size = given.size;
    this.facing = given.facing;
    this.joints = given.joints;
    this.parents = given.parents;
    this.loose = new Set(given.loose); // points that no bone of one length holds
    this.apart = new Set(given.apart); // those that are none of the figure, as a root that stays
    this.numPoints = given.parents.length;
    this.numJoints = given.joints.length;
    this.middle = numbersOf(given.middle, Float32Array);
    this.reach = numbersOf(given.reach, Float32Array);
    this.places = numbersOf(given.places, Int16Array);
    this.angles = numbersOf(given.angles, Uint16Array);
    this.errors = given.errors ? bytesOf(given.errors) : null;
    this.contacts = given.contacts || null;
    this.contactSpans = (given.contacts?.spans || []).map(([point, first, last, ...place]) => ({
      point,
      first,
      last,
      place,
    }));
    this.visible = true;
    this.number = new Map(given.joints.map((name, j) => [name, j]));
    this.pose = new Float32Array(3 * this.numPoints);
    this.posed = -1;
  }

  // World positions at a frame, NaN where they are not known; the same array every time.
  at(frame) {
    if (this.posed === frame) return this.pose;
    this.posed = frame;
    const { pose, places, reach, middle, numPoints } = this;
    const start = 3 * numPoints * frame;
    for (let p = 0, k = 0; p < numPoints; p++)
      for (let axis = 0; axis < 3; axis++, k++) {
        const step = places[start + k];
        pose[k] = step === -32768 ? NaN : middle[3 * frame + axis] + step * reach[p];
      }
    return pose;
  }

  position(point, frame) {
    return [...this.at(frame).subarray(3 * point, 3 * point + 3)];
  }

  middleAt(frame) {
    return [...this.middle.subarray(3 * frame, 3 * frame + 3)];
  }

  // The frame shown at a time of the shared clock; the last one stays.
  frameAt(seconds) {
    return clamp(Math.round(seconds / this.frameTime), 0, this.frames - 1);
  }

  hasEnded(seconds) {
    return seconds > (this.frames - 0.5) * this.frameTime;
  }

  // The joint that a point belongs to: end sites belong to the joint they hang from.
  owner(point) {
    return point < this.numJoints ? point : this.parents[point];
  }

  isError(frame, joint) {
    const bit = frame * this.numJoints + joint;
    return this.errors !== null && ((this.errors[bit >> 3] >> (bit & 7)) & 1) === 1;
  }

  // [first, after the last] of the frames with an error, in any joint or in one of those given.
  errorSpans(joints = null) {
    if (!this.errors) return [];
    const every = joints || Array.from({ length: this.numJoints }, (_, j) => j);
    return spansOf(this.frames, (frame) => every.some((j) => this.isError(frame, j)));
  }

  missingSpans() {
    const stride = 3 * this.numPoints;
    return spansOf(this.frames, (frame) => {
      for (let k = frame * stride; k < (frame + 1) * stride; k += 3)
        if (this.places[k] === -32768) return true;
      return false;
    });
  }

  // Radians, from the pose of the file's offsets.
  angle(frame, joint) {
    const step = this.angles[frame * this.numJoints + joint];
    return step === 65535 ? NaN : (step / 65534) * Math.PI;
  }

  // Length units a second, between the frames before and after.
  speed(frame, joint) {
    const a = Math.max(frame - 1, 0);
    const b = Math.min(frame + 1, this.frames - 1);
    if (a === b) return 0;
    const { places, middle, numPoints, reach } = this;
    let sum = 0;
    for (let axis = 0; axis < 3; axis++) {
      const before = places[3 * (a * numPoints + joint) + axis];
      const after = places[3 * (b * numPoints + joint) + axis];
      if (before === -32768 || after === -32768) return NaN;
      const moved = middle[3 * b + axis] - middle[3 * a + axis] + (after - before) * reach[joint];
      sum += moved * moved;
    }
    return Math.sqrt(sum) / ((b - a) * this.frameTime);
  }

  // Of a joint, without posing the figure.
  place(frame, joint) {
    const k = 3 * (frame * this.numPoints + joint);
    if (this.places[k] === -32768) return [NaN, NaN, NaN];
    return [0, 1, 2].map(
      (axis) => this.middle[3 * frame + axis] + this.places[k + axis] * this.reach[joint],
    );
  }

  // From the joint of that name in another clip, at the same time.
  distance(frame, joint, other) {
    const there = other.number.get(this.joints[joint]);
    if (there === undefined) return NaN;
    const at = other.frameAt(frame * this.frameTime);
    return length(subtract(this.place(frame, joint), other.place(at, there)));
  }
}

function spansOf(frames, holds) {
  const spans = [];
  for (let frame = 0, start = -1; frame <= frames; frame++) {
    const on = frame < frames && holds(frame);
    if (on && start < 0) start = frame;
    if (!on && start >= 0) {
      spans.push([start, frame]);
      start = -1;
    }
  }
  return spans;
}

// Kinds of curves, by name: how to read one of a clip's joint (null: of all) at a frame.
function curveKinds(content, clips) {
  const kinds = [
    {
      name: "rotation angle",
      unit: "°",
      perJoint: true,
      read: (clip, frame, joint) => (180 / Math.PI) * clip.angle(frame, joint),
    },
    {
      name: "joint speed",
      unit: " /s",
      perJoint: true,
      read: (clip, frame, joint) => clip.speed(frame, joint),
    },
  ];
  const [first] = clips;
  if (clips.length > 1)
    kinds.push({
      name: `distance from ${first.name}`,
      unit: "",
      perJoint: true,
      of: new Map(clips.slice(1).map((clip) => [clip, null])),
      read: (clip, frame, joint) => clip.distance(frame, joint, first),
    });
  for (const given of content.curves) {
    let kind = kinds.find((k) => k.name === given.name && k.isGiven);
    if (!kind) {
      const unit = given.name.endsWith("°") ? "°" : "";
      kind = { name: given.name, unit, perJoint: given.perJoint, of: new Map(), isGiven: true };
      kind.isShared = given.isShared;
      kind.read = (clip, frame, joint) => {
        const own = kind.of.get(clip);
        if (!own) return NaN;
        const step = own.values[own.perJoint ? frame * clip.numJoints + joint : frame];
        return step === 65535 ? NaN : own.low + ((own.high - own.low) * step) / 65534;
      };
      kinds.push(kind);
    }
    kind.perJoint = kind.perJoint || given.perJoint;
    kind.of.set(clips[given.clip], { ...given, values: numbersOf(given.values, Uint16Array) });
  }
  return kinds;
}
