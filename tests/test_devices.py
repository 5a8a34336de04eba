"""Batches of clips on two devices: the same results, each device with its own clips."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import on_two_devices

ROOT = Path(__file__).parents[1]
QUICK = ("forward_kinematics", "dtw", "pose_distance")
SLOW = ("denoise",)
OTHERS = tuple(name for name in on_two_devices.FUNCTIONS if name not in (*QUICK, *SLOW))
CASES = [
    QUICK,
    pytest.param(SLOW, marks=pytest.mark.slow),
    *(pytest.param((name,), marks=pytest.mark.sweep) for name in OTHERS),
]


@pytest.mark.parametrize("names", CASES, ids="-".join)
def test_clips_stay_on_their_devices(names):
    """Between devices goes no more than a number a clip: whether an iteration goes on."""
    paths = filter(None, (str(ROOT), os.environ.get("PYTHONPATH")))
    ran = subprocess.run(
        [sys.executable, "-m", "tests.on_two_devices", *names],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        timeout=600,
    )
    assert ran.returncode == 0, ran.stderr[-2000:]
    found = json.loads(ran.stdout.splitlines()[-1])
    assert set(found) == set(names)
    for name, seen in found.items():
        assert seen["off"] < 1e-9, (name, seen)
        assert seen["shared"] == ["('clip',)"], (name, seen)
        assert seen["sent"] <= 4 < seen["size"] or name == "dtw", (name, seen)


def test_what_is_sent_is_found():
    """In texts as XLA writes them."""
    text = """
  %a = f64[4,24,22,4]{3,2,1,0} all-gather(f64[2,24,22,4]{3,2,1,0} %p), channel_id=1
  %b = (pred[], s32[2]{0}) all-reduce(pred[] %x, s32[2]{0} %y), channel_id=2
  %c = f64[99]{0} add(f64[99]{0} %u, f64[99]{0} %v)
"""
    assert on_two_devices.sent(text) == 4 * 24 * 22 * 4
    assert on_two_devices.sent(text.replace("all-gather", "copy")) == 2
    assert on_two_devices.sent("") == 0
