"""The half of ``blender_round_trip.py`` that runs in Blender's Python: a BVH file in and out.

On stdin a line of JSON a job, {"source": path, "target": path, "frames": count, "axes": options of
the importer}; on stdout, after what Blender says itself, a line that begins with "answer:".
"""

import json
import sys

import bpy

for line in sys.stdin:
    job = json.loads(line)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    answer = "done"
    try:
        # The scene's length is left alone: the importer would make it a frame too long, and never
        # shorten it.
        bpy.ops.import_anim.bvh(filepath=job["source"], update_scene_fps=True, **job["axes"])
        bpy.ops.export_anim.bvh(filepath=job["target"], frame_start=1, frame_end=job["frames"])
    except RuntimeError as error:
        lines = str(error).strip().splitlines()
        answer = [line for line in lines if not line.startswith("Location:")][-1]
    print(f"\nanswer:{answer}", flush=True)
