"""The picture shows what the alignment holds."""

import numpy as np

from jaxmotion.timing import align
from jaxmotion.viz import plot_alignment
from tests.timing.test_align import TIMES, WARPED, waving


def test_the_picture_holds_the_path_and_the_times(tmp_path):
    found = align(waving(TIMES[:20]), waving(WARPED[:24]))
    figure = plot_alignment(found, source="$w_$alk.bvh", reference="hob\x1bble.bvh")
    (axes,) = figure.axes
    pairs, times = (line.get_xydata() for line in axes.lines)
    path = np.asarray(found.path)[: int(found.length)]
    np.testing.assert_array_equal(pairs, path[:, ::-1])
    np.testing.assert_allclose(times[:, 1], found.source_frame)
    assert axes.get_xlabel() == r"frame of hob\x1bble.bvh"
    assert axes.get_ylabel() == "frame of $w_$alk.bvh"
    assert f"{np.degrees(found.distance):.3g}°" in axes.get_title()
    figure.savefig(tmp_path / "path.png")
    assert (tmp_path / "path.png").read_bytes().startswith(b"\x89PNG")
