"""Fig. 5 of Eom et al. 2019 on real captures: noise added to clean clips, and taken out again.

    python benchmarks/denoising.py FOLDER_OR_FILES [--seed 0]

White noise turns every joint (rotation vectors of the given standard deviation per axis) and
shifts every translated joint (a share of the clip's height). The table has the mean joint position
error in per mille of the height, for the noisy clip, the smoothers here, and zero-phase
Butterworth filters of order 2 run forward and backward over sign-aligned quaternions and
translations; the last columns have the best cut-off that a search finds knowing the truth.
"""

import argparse
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import butter, filtfilt

import jaxmotion as jm
from jaxmotion import quaternion

LEVELS = ((0.02, 0.0), (0.06, 0.0), (0.06, 0.006))  # radians per axis, share of the height
CUTOFFS = (3.0, 6.0, 9.0, 12.0)
SEARCH = np.geomspace(0.5, 14.0, 40)


def butterworth(motion: jm.Motion, cutoff: float) -> jm.Motion:
    """Zero-phase low-pass of ``cutoff`` Hz."""
    b, a = butter(2, min(cutoff * 2 * float(motion.frame_time), 0.99))
    q = filtfilt(b, a, np.asarray(quaternion.align_signs(motion.rotations)), axis=0)
    p = filtfilt(b, a, np.asarray(motion.translations), axis=0)
    return motion.with_transforms(jnp.asarray(p), quaternion.normalize(q))


def add_noise(motion: jm.Motion, turn: float, shift: float, key) -> jm.Motion:
    """White noise on every joint's rotation and on the translations that vary."""
    first, second = jax.random.split(key)
    v = turn * jax.random.normal(first, (*motion.rotations.shape[:-1], 3), motion.dtype)
    moved = np.asarray(motion.translated_joints)
    u = shift * jax.random.normal(second, (motion.num_frames, len(moved), 3), motion.dtype)
    return motion.with_transforms(
        motion.translations.at[:, moved].add(u),
        quaternion.multiply(motion.rotations, quaternion.exp(v)),
    )


def errors(path: Path, turn: float, share: float, seed: int) -> dict[str, float]:
    """Mean joint position error of every method, in per mille of the height."""
    clean = jm.load(path, dtype=np.float64)
    truth = jm.forward_kinematics(clean).positions
    height = float(jnp.mean(jnp.ptp(truth[..., 1], axis=1)))
    noisy = add_noise(clean, turn, share * height, jax.random.key(seed))

    def error(motion):
        x = jm.forward_kinematics(motion).positions
        return 1000 * float(jnp.mean(jnp.linalg.norm(x - truth, axis=-1))) / height

    found = {"noisy": error(noisy), "tuned": error(jm.denoise(noisy))}
    found["λ=σ=1"] = error(jm.denoise(noisy, tune=False))
    found |= {f"{c:g} Hz": error(butterworth(noisy, c)) for c in CUTOFFS}
    found["best cut-off"] = min(error(butterworth(noisy, c)) for c in SEARCH)
    found["tuned/best"] = found["tuned"] / found["best cut-off"]
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("paths", nargs="+", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    paths = [
        file
        for path in options.paths
        for file in (
            sorted([*path.glob("*.bvh"), *path.glob("*.amc")]) if path.is_dir() else [path]
        )
    ]
    for turn, share in LEVELS:
        rows = [(p.stem, errors(p, turn, share, options.seed)) for p in paths]
        names = list(rows[0][1])
        print(f"\nnoise {turn:g} rad, {1000 * share:g} ‰ of the height; errors in ‰ of the height")
        print(f"{'clip':32}" + "".join(f"{n:>13}" for n in names))
        for stem, row in rows:
            print(f"{stem:32}" + "".join(f"{row[n]:13.2f}" for n in names))
        means = {n: np.mean([row[n] for _, row in rows]) for n in names}
        print(f"{'mean':32}" + "".join(f"{means[n]:13.2f}" for n in names))


if __name__ == "__main__":
    main()
