// The half of interchange_check.py that runs in node: three.js's own loaders and the Khronos
// validator. Arguments: a file of jobs, [{"source", "target", "frames", "rate"}]. Each target is
// JSON, {"names", "positions": [frame][joint][3], "messages"}.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";

const require = createRequire(process.cwd() + "/");
const at = (place) => import(pathToFileURL(`${process.cwd()}/node_modules/three/${place}`).href);
globalThis.self = globalThis;
const THREE = await at("build/three.module.js");
const { GLTFLoader } = await at("examples/jsm/loaders/GLTFLoader.js");
const { USDLoader } = await at("examples/jsm/loaders/USDLoader.js");
const validator = require("gltf-validator");

for (const job of JSON.parse(readFileSync(process.argv[2], "utf8"))) {
  const bytes = readFileSync(job.source);
  const buffer = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length);
  let scene, animations, messages = [];
  if (job.source.endsWith(".glb")) {
    const report = await validator.validateBytes(new Uint8Array(buffer));
    messages = report.issues.messages.map((m) => [m.severity, m.code, m.pointer]);
    const read = await new Promise((ok, no) => new GLTFLoader().parse(buffer, "", ok, no));
    ({ scene, animations } = read);
  } else {
    scene = new USDLoader().parse(job.source.endsWith("a") ? bytes.toString("utf8") : buffer);
    animations = scene.animations;
  }
  const bones = [];
  scene.traverse((node) => { if (node.isBone) bones.push(node); });
  const mixer = new THREE.AnimationMixer(scene);
  const action = mixer.clipAction(animations[0]);
  action.setLoop(THREE.LoopOnce);
  action.clampWhenFinished = true;
  action.play();
  const times = animations[0].tracks[0].times;
  const positions = [];
  for (let frame = 0; frame < job.frames; frame++) {
    action.reset();
    mixer.setTime(times[frame]);
    scene.updateMatrixWorld(true);
    positions.push(bones.map((bone) => bone.getWorldPosition(new THREE.Vector3()).toArray()));
  }
  const names = bones.map((bone) => bone.userData.name ?? bone.name);
  writeFileSync(job.target, JSON.stringify({ names, positions, messages, duration: animations[0].duration }));
}
