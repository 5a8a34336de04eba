"""Exact geodesic smoothing of a long clip: solve, value-and-gradient, compile time, memory, steps.

    python benchmarks/bench_geodesic.py [frames] [joints]

The peer in the same process is the chordal smoother (Eq. 11), whose answer is the start of the
geodesic one. Wall times are medians of interleaved runs; CPU times add up all threads.
"""

import statistics
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

from jaxmotion import quaternion  # noqa: E402
from jaxmotion.smoothing import geodesic, smooth_quaternions  # noqa: E402

REPEATS = 5


def clip(frames: int, joints: int):
    """Sines of 0.2 to 1.5 Hz and 0.5 rad at 60 fps, with 0.03 rad of noise."""
    rng = np.random.default_rng(0)
    seconds = np.arange(frames)[:, None, None] / 60
    frequency, phase = rng.uniform(0.2, 1.5, (1, joints, 3)), rng.uniform(0, 6, (1, joints, 3))
    smooth = 0.5 * np.sin(2 * np.pi * seconds * frequency + phase)
    noise = 0.03 * rng.standard_normal((frames, joints, 3))
    return quaternion.multiply(quaternion.exp(jnp.asarray(smooth)), quaternion.exp(noise))


def compiled(function, *inputs):
    start = time.perf_counter()
    program = jax.jit(function).lower(*inputs).compile()
    seconds = time.perf_counter() - start
    jax.block_until_ready(program(*inputs))
    return program, seconds


def timed(program, inputs):
    wall, cpu = time.perf_counter(), time.process_time()
    jax.block_until_ready(program(*inputs))
    return time.perf_counter() - wall, time.process_time() - cpu


def main(frames: int = 2526, joints: int = 65):
    exact = clip(frames, joints)
    target = jnp.asarray(np.random.default_rng(1).standard_normal(exact.shape))
    header = ("", "compile s", "wall s", "cpu s", "ratio", "temp MB", "steps")
    print("{:32}{:>11}{:>9}{:>9}{:>8}{:>9}{:>7}".format(*header))
    for dtype in (jnp.float64, jnp.float32):
        q, weight = exact.astype(dtype), target.astype(dtype)
        for order in (2, 1):

            def chordal(q, lam, sigma, order=order):
                return smooth_quaternions(q, lam, sigma, order=order)

            def solve(q, lam, sigma, order=order):
                found = geodesic(q, lam, sigma, order=order)
                return found.mean, found.num_steps

            def loss(q, lam, sigma, solve=solve, weight=weight):
                return jnp.vdot(weight, solve(q, lam, sigma)[0])

            inputs = (q, jnp.asarray(30.0, dtype), jnp.asarray(0.1, dtype))
            rows = {
                "chordal": chordal,
                "geodesic": solve,
                "geodesic, value and gradient": jax.value_and_grad(loss, (1, 2)),
            }
            programs = {name: compiled(function, *inputs) for name, function in rows.items()}
            times = {name: [] for name in rows}
            for _ in range(REPEATS):
                for name, (program, _) in programs.items():
                    times[name].append(timed(program, inputs))
            steps = int(programs["geodesic"][0](*inputs)[1])
            median = {
                name: tuple(map(statistics.median, zip(*pairs, strict=True)))
                for name, pairs in times.items()
            }
            for name, (program, seconds) in programs.items():
                wall, cpu = median[name]
                memory = program.memory_analysis().temp_size_in_bytes / 1e6
                label = f"{dtype.__name__} order {order} {name}"
                ratio = wall / median["geodesic"][0]
                print(
                    f"{label:46.46}{seconds:7.1f}{wall:9.3f}{cpu:9.3f}{ratio:8.2f}{memory:9.0f}"
                    + (f"{steps:7d}" if name == "geodesic" else "")
                )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
