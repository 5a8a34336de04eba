"""A program of its own: batches of clips on two devices, the clip axis shared between them.

    python -m tests.on_two_devices NAME ...

Prints as JSON, of every function named: how far its result is from that of one device, how its
arrays are shared out, and the largest array that goes from device to device.
"""

import json
import math
import os
import re
import sys
from functools import cache

import equinox as eqx
import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

import jaxmotion as jm

FRAMES = 24
_SENT = re.compile(
    r"(\w+\[[^=]*?) (?:all-gather|all-to-all|collective-permute|all-reduce|reduce-scatter)"
    r"(?:-start)?\("
)


@cache
def clips():
    walk = jm.samples.load("walk", num_frames=80, dtype=np.float64).motion
    return [walk[9 * k : 9 * k + FRAMES - k] for k in range(4)]


@cache
def another():
    return jm.samples.load("run", num_frames=FRAMES, dtype=np.float64).motion


@cache
def contacts():
    return jm.contacts.detect(clips()[0], joints=["LeftFoot", "RightFoot"])


def manner(motion, length):
    made = jm.style.transfer_style(motion, another(), warp=None, keep_contacts=False)
    return made.motion.rotations


def planted(motion, length):
    return jm.spacetime.satisfy(motion, contacts(), max_steps=4)[0].rotations


FUNCTIONS = {
    "forward_kinematics": lambda m, n: jm.forward_kinematics(m).positions,
    "denoise": lambda m, n: jm.denoise(m, length=n).rotations,
    "decompose": lambda m, n: jm.decompose(m, length=n).base.rotations,
    "build_pyramid": lambda m, n: jm.multiresolution.build_pyramid(m, length=n),
    "dtw": lambda m, n: jm.timing.dtw(m.rotations[:, 1], m.rotations[::-1, 1]).cost,
    "pose_distance": lambda m, n: jm.timing.pose_distance(m.rotations, m.rotations),
    "transfer_style": manner,
    "satisfy": planted,
}


def sent(text):
    """Entries of the largest array that goes between devices, in a compiled program's text."""
    sizes = [0]
    for shapes in _SENT.findall(text):
        for dimensions in re.findall(r"\w+\[([\d,]*)\]", shapes):
            sizes.append(math.prod(int(n) for n in dimensions.split(",") if n))
    return max(sizes)


def tried(function):
    mesh = Mesh(np.array(jax.devices()), ("clip",))
    batch = jm.stack(clips())
    there = jax.device_put(batch, jax.devices()[0])
    shared = jax.device_put(batch, NamedSharding(mesh, PartitionSpec("clip")))
    program = jax.jit(jax.vmap(function))
    found, wanted = program(*shared), program(*there)
    arrays = [jax.tree.leaves(eqx.filter(x, eqx.is_array)) for x in (found, wanted)]
    off = [
        np.abs(np.asarray(a, float) - np.asarray(b, float)) for a, b in zip(*arrays, strict=True)
    ]
    return {
        "off": max(float(np.nanmax(x, initial=0)) for x in off),
        "shared": sorted({str(tuple(x.sharding.spec)) for x in arrays[0]}),
        "sent": sent(program.lower(*shared).compile().as_text()),
        "size": max(x.size for x in arrays[0]),
    }


if __name__ == "__main__":
    jax.config.update("jax_num_cpu_devices", 2)
    jax.config.update("jax_enable_x64", True)
    if folder := os.environ.get("JAXMOTION_TEST_CACHE"):
        jax.config.update("jax_compilation_cache_dir", folder)
    another(), contacts()  # while nothing is traced
    print(json.dumps({name: tried(FUNCTIONS[name]) for name in sys.argv[1:] or FUNCTIONS}))
