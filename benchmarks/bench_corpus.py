"""A corpus of the Bandai captures: read once, then as batches for training.

    read          103 BVH files into an empty cache, in seconds and bytes; and again from the cache
    a batch       32 windows of 64 frames, against the same slices of clips that are in memory
    a training    of a small recurrent model (equinox, Adam by hand) on such batches: the share of
                  its time that it waits for them, which is to be 5 % at most

The share is that of the seconds spent in ``next`` while each step is waited for, so that nothing of
the step hides behind it; beside it how much longer an epoch takes than with batches that were made
before. ``python -m pytest -c benchmarks/pytest.ini --benchmark-only -s benchmarks/bench_corpus.py``
"""

import os
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm

LENGTH, BATCH, HIDDEN = 64, 32, 96


@pytest.fixture(scope="module")
def captures():
    """The folder; see tests/conftest.py for where real captures are."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    path = Path(os.environ.get("JAXMOTION_TEST_DATA", beside)) / "bandai"
    if not path.is_dir():
        pytest.skip(f"no {path}")
    return path


@pytest.fixture(scope="module")
def corpus(captures, tmp_path_factory):
    made = jm.corpus.Corpus(captures, cache=tmp_path_factory.mktemp("cache"), dtype=np.float32)
    made.build()
    return made


def test_read(race, captures, tmp_path, capsys):
    folders = iter(tmp_path / str(k) for k in range(100))

    def read(folder):
        made = jm.corpus.Corpus(captures, cache=folder, dtype=np.float32)
        made.build()
        return made

    read(next(folders))
    first = tmp_path / "0"
    race(
        "open 103 cached clips", lambda: read(first), {"reading them": lambda: read(next(folders))}
    )
    size = sum(path.stat().st_size for path in first.iterdir())
    text = sum(path.stat().st_size for path in captures.iterdir())
    frames = int(read(first).lengths.sum())
    with capsys.disabled():
        print(f"\ncache of {frames} frames: {size} bytes, {size / frames:.0f} a frame; BVH {text}")


def test_a_batch(race, corpus):
    source = corpus.window_source(LENGTH, 4)
    clips = [jax.tree.map(np.asarray, clip) for clip in corpus]
    numbers = np.random.default_rng(0).permutation(len(source))[:BATCH]
    places = [source.place(int(i)) for i in numbers]

    def slices():
        parts = [(clips[k], slice(start, start + LENGTH)) for k, start in places]
        t = np.stack([clip.translations[frames] for clip, frames in parts])
        return t, np.stack([clip.rotations[frames] for clip, frames in parts])

    ours, theirs = race(
        f"batch of {BATCH} windows of {LENGTH} frames",
        lambda: source.gather(numbers),
        {"slices of clips in memory": slices},
    )
    np.testing.assert_array_equal(ours.rotations, theirs["slices of clips in memory"][1])


class Model(eqx.Module):
    """Foretells the next frame of every window."""

    cell: eqx.nn.GRUCell
    out: eqx.nn.Linear

    def __init__(self, features, key):
        one, two = jax.random.split(key)
        self.cell = eqx.nn.GRUCell(features, HIDDEN, key=one, dtype=jnp.float32)
        self.out = eqx.nn.Linear(HIDDEN, features, key=two, dtype=jnp.float32)

    def __call__(self, x):
        def step(state, frame):
            state = self.cell(frame, state)
            return state, self.out(state)

        return jax.lax.scan(step, jnp.zeros(HIDDEN, jnp.float32), x[:-1])[1]


@eqx.filter_jit
def train_step(model, moments, count, batch):
    """A step of Adam on the error of what is foretold."""

    def loss(model):
        def of_clip(clip):
            x = jm.quaternion.to_rotation_6d(clip.rotations).reshape(LENGTH, -1)
            return jnp.mean((model(x) - x[1:]) ** 2)

        return jnp.mean(jax.vmap(of_clip)(batch))

    value, slope = eqx.filter_value_and_grad(loss)(model)
    first = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, moments[0], slope)
    second = jax.tree.map(lambda m, g: 0.999 * m + 0.001 * g**2, moments[1], slope)
    scale = 1e-3 * jnp.sqrt(1 - 0.999**count) / (1 - 0.9**count)
    change = jax.tree.map(lambda m, v: -scale * m / (jnp.sqrt(v) + 1e-8), first, second)
    return eqx.apply_updates(model, change), (first, second), value


def trained(batches):
    """(steps, seconds in all, seconds waited, first and last loss)."""
    model = Model(22 * 6, jax.random.key(0))
    zeros = jax.tree.map(jnp.zeros_like, eqx.filter(model, eqx.is_array))
    moments, waited, losses = (zeros, zeros), 0.0, []
    began = time.perf_counter()
    stream = iter(batches)
    while True:
        before = time.perf_counter()
        batch = next(stream, None)
        waited += time.perf_counter() - before
        if batch is None:
            return len(losses), time.perf_counter() - began, waited, losses[0], losses[-1]
        count = jnp.asarray(len(losses) + 1, jnp.float32)
        model, moments, loss = train_step(model, moments, count, batch)
        losses.append(float(loss))


def test_a_training(benchmark, corpus, capsys):
    def windows(**more):
        return corpus.windows(LENGTH, BATCH, stride=4, seed=0, drop_last=True, **more)

    ready = list(windows())
    trained(ready[:2])  # compiles
    rounds = []

    def race_once():
        rounds.append((trained(ready), trained(windows()), trained(windows(prefetch=0))))

    benchmark.pedantic(race_once, rounds=5)
    waits = [float(np.median([r[k][2] / r[k][1] for r in rounds])) for k in range(3)]
    benchmark.extra_info["waiting for batches"] = {
        "value": waits[1],
        "peers": {"without a thread": waits[2]},
    }
    with capsys.disabled():
        for k, name in enumerate(("ready", "prefetched", "no thread")):
            seconds = np.median([r[k][1] for r in rounds])
            longer = np.median([r[k][1] / r[0][1] for r in rounds]) - 1
            steps, *_, first, last = rounds[0][k]
            print(
                f"\n{name:10}: {steps} steps, {1e3 * seconds / steps:.2f} ms each, waits "
                f"{100 * waits[k]:.2f} % of the time, {100 * longer:+.1f} % longer; "
                f"loss {first:.4f} to {last:.4f}"
            )
    assert rounds[0][1][3:] == rounds[0][0][3:]
