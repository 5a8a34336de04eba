#!/usr/bin/env bash
# Blender 5.0.1 (bpy): glTF keys fall beside the frames where a scene's rate has a base.
#
# A Blender scene plays at render.fps / render.fps_base: 30 with base 1.001 is 29.97 frames a second.
# Its glTF importer places a key at t seconds on frame t * fps * fps_base, the base on the wrong
# side. So a clip of 29.97 frames a second, read into a scene that is set to just that rate, has its
# keys at every 1.002nd frame, and drifts by a frame in 500; with fps 60 and base 2, a scene of 30
# frames a second, the clip is four times too long. A base is how Blender holds NTSC rates, and any
# rate that is not whole, which captures at 59.94 or 119.88 frames a second have.
#
# A node that moves for 241 frames at 30000/1001 a second, written with pygltflib. Last keys seen, by
# fps and base, and where they are due: 240.24 for (30, 1), due 240.24; 240.48 for (30, 1.001), due
# 240; 960.96 for (60, 2), due 240.24. With the inverse of the base during the import, and the base
# itself set after it, keys lie on the frames: 240 for (30, 1/1.001). Fails if that changes. Needs
# Python 3.11, for bpy.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3.11 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet bpy==5.0.1 pygltflib==1.16.5
cd "$folder"
"$folder/venv/bin/python" - <<'PYTHON'
import bpy
import numpy as np
import pygltflib as gl

frames, rate = 241, 30000 / 1001
times = (np.arange(frames) / rate).astype("<f4")
places = np.stack([np.arange(frames), np.zeros(frames), np.zeros(frames)], 1).astype("<f4")
whole = gl.GLTF2(
    asset=gl.Asset(version="2.0"),
    scene=0,
    scenes=[gl.Scene(nodes=[0])],
    nodes=[gl.Node(name="Node", translation=[0.0, 0.0, 0.0])],
    animations=[
        gl.Animation(
            name="Clip",
            channels=[
                gl.AnimationChannel(
                    sampler=0, target=gl.AnimationChannelTarget(node=0, path="translation")
                )
            ],
            samplers=[gl.AnimationSampler(input=0, output=1, interpolation="LINEAR")],
        )
    ],
    accessors=[
        gl.Accessor(
            bufferView=0,
            componentType=gl.FLOAT,
            count=frames,
            type="SCALAR",
            min=[float(times[0])],
            max=[float(times[-1])],
        ),
        gl.Accessor(bufferView=1, componentType=gl.FLOAT, count=frames, type="VEC3"),
    ],
    bufferViews=[
        gl.BufferView(buffer=0, byteOffset=0, byteLength=times.nbytes),
        gl.BufferView(buffer=0, byteOffset=times.nbytes, byteLength=places.nbytes),
    ],
    buffers=[gl.Buffer(byteLength=times.nbytes + places.nbytes)],
)
whole.set_binary_blob(times.tobytes() + places.tobytes())
whole.save_binary("clip.glb")


def last_key(fps, base):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    render = bpy.context.scene.render
    render.fps, render.fps_base = fps, base
    bpy.ops.import_scene.gltf(filepath="clip.glb")
    return render.fps / render.fps_base, float(bpy.data.actions[0].frame_range[1])


print("bpy", bpy.app.version_string, "pygltflib", "1.16.5")
seen = {}
for fps, base in ((30, 1.0), (30, 1.001), (60, 2.0), (30, 1 / 1.001)):
    scene_rate, seen[fps, base] = last_key(fps, base)
    due = (frames - 1) / rate * scene_rate
    print(f"fps {fps}, base {base:.6f}: {scene_rate:.6f} a second, last key {seen[fps, base]:.3f}, due {due:.3f}")
for (fps, base), key in seen.items():
    assert abs(key - (frames - 1) / rate * fps * base) < 1e-2, (fps, base, key)
assert abs(seen[60, 2.0] - 960.96) < 1e-2, seen
PYTHON
