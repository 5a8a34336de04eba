"""What first calls cost: processor seconds of each edit of a walk in a new process, with nothing
kept on disk and with what the process before kept.

    python benchmarks/first_calls.py [FRAMES]      by default 96; some five minutes

Each process calls :func:`jaxmotion.enable_compilation_cache` for an empty folder, which the second
finds full. Eager calls, float32, 22 joints; what an edit shares with those above it is compiled
there.
"""

import json
import subprocess
import sys
import tempfile
import time


def edits(frames: int) -> dict:
    """Calls by name."""
    import jax

    import jaxmotion as jm

    walk = jm.samples.load("walk", num_frames=frames).motion
    noisy = jm.samples.add_noise(walk, jax.random.key(0), rotation=0.05).motion
    run = jm.samples.load("run", num_frames=frames - 16).motion
    key = jax.random.key(0)
    return {
        "smooth_motion": lambda: jm.smoothing.smooth_motion(noisy, 10.0, 1.0),
        "decompose": lambda: jm.decompose(noisy),
        "denoise": lambda: jm.denoise(noisy),
        "tune": lambda: jm.smoothing.tune(noisy),
        "stylize": lambda: jm.stylize(noisy, 2.0),
        "keep_contacts": lambda: jm.spacetime.keep_contacts(jm.stylize(walk, 1.5), original=walk),
        "transfer_style": lambda: jm.style.transfer_style(walk, run).motion,
        "stitch": lambda: jm.multiresolution.stitch([walk, run]),
        "align": lambda: jm.timing.align(walk, run).motion,
        "mirror": lambda: jm.mirror(walk),
        "cleanup_footskate": lambda: jm.contacts.cleanup_footskate(walk, jm.contacts.detect(walk)),
        "time_warp": lambda: jm.time_warp(walk, amount=0.2),
        "resample": lambda: jm.resample(walk, fps=24),
        "denoise, geodesic": lambda: jm.denoise(noisy, method="geodesic"),
        "augment": lambda: jm.augment(walk, key, n=2).motions,
    }


def measured(folder: str, frames: int) -> dict[str, float]:
    """In this process."""
    import jax

    import jaxmotion as jm

    jm.enable_compilation_cache(folder)
    seconds = {}
    for name, call in edits(frames).items():
        begun = time.process_time()
        jax.block_until_ready(jax.tree.leaves(call()))
        seconds[name] = time.process_time() - begun
    return seconds


def main() -> None:
    """Two processes, one after the other."""
    if sys.argv[1:2] == ["--in"]:
        print(json.dumps(measured(sys.argv[2], int(sys.argv[3]))))
        return
    frames = sys.argv[1] if len(sys.argv) > 1 else "96"
    with tempfile.TemporaryDirectory() as folder:
        words = [sys.executable, __file__, "--in", folder, frames]
        cold, warm = (
            json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
            for _ in range(2)
        )
    print(f"{'processor seconds':20} {'new':>6} {'kept':>6}")
    for name in cold:
        print(f"{name:20} {cold[name]:6.1f} {warm[name]:6.1f}")
    print(f"{'all':20} {sum(cold.values()):6.1f} {sum(warm.values()):6.1f}")


if __name__ == "__main__":
    main()
