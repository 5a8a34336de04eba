"""The half of ``interchange_check.py`` that runs in Blender's Python: a file in, its joints out.

On stdin a line of JSON a job, {"source": path, "target": path, "rate": frames a second, "frames":
count, "turned": whether the importer turns y up to its own z up}; the target is JSON, {"names",
"positions": [frame][joint][3] in the file's axes and metres, "lengths": of the bones}.
"""

import json
import math
import sys

import bpy

for line in sys.stdin:
    job = json.loads(line)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = math.ceil(job["rate"])
    scene.render.fps_base = scene.render.fps / job["rate"]
    if job["source"].endswith(".glb"):
        # Blender's rate is fps / fps_base; its glTF importer goes by fps * fps_base.
        scene.render.fps_base = 1 / scene.render.fps_base
        bpy.ops.import_scene.gltf(filepath=job["source"])
    else:
        bpy.ops.wm.usd_import(filepath=job["source"])
    [armature] = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
    bones = armature.pose.bones
    positions = []
    for frame in range(job["frames"]):
        scene.frame_set(frame)
        places = [armature.matrix_world @ bone.head for bone in bones]
        positions.append([(p.x, p.z, -p.y) if job["turned"] else tuple(p) for p in places])
    answer = {
        "names": [bone.name for bone in bones],
        "positions": positions,
        "lengths": [bone.length for bone in bones],
    }
    with open(job["target"], "w") as file:
        json.dump(answer, file)
    print("\nanswer:done", flush=True)
