"""What workers are given to do in the tests; importable there."""

import os
import signal
import time
from pathlib import Path


def echo(item):
    """The item itself."""
    return item


def die_at(name, item):
    """The item; but the process is gone for that of one name."""
    if item == name:
        os._exit(3)
    return item


def die_once(folder, item):
    """The item; the process is killed the first time that it comes to it."""
    mark = Path(folder) / f"met-{item}"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def first_frames(motion):
    """Ten frames."""
    return motion[:10]


def first_frames_later(motion):
    """Ten frames, after a while."""
    time.sleep(0.1)
    return motion[:10]


def written_and_died(folder, motion):
    """Ten frames, each of which is written by a process that ends before it can say so."""
    from jaxmotion.corpus import places

    put = places.put

    def last(write, name):
        put(write, name)
        places.put = put
        mark = Path(folder) / f"met-{Path(name).name}"
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)

    places.put = last
    return motion[:10]


def refusing(name, motion):
    """The motion; clips of so many frames are refused."""
    if motion.num_frames == name:
        raise ValueError(f"{name} frames are refused")
    return motion


def exiting(frames, motion):
    """The motion; the process ends at clips of so many frames, or asks Python to."""
    if motion.num_frames == frames:
        os._exit(1)
    if motion.num_frames == frames + 1:
        raise SystemExit(2)
    return motion


def shifted(by, motion):
    """The motion, moved by an array."""
    return motion.with_transforms(translations=motion.translations + by[:3])


def as_it_is_here(motion):
    """The motion as this process has it: whether JAX keeps 64 bits is in its frame time."""
    import jax.numpy as jnp

    rate = 0.5 if jnp.zeros(()).dtype == "float64" else 0.25
    return motion.replace(frame_time=motion.frame_time * 0 + rate)


def not_a_motion(motion):
    """Something else."""
    return 3
