"""Importing is cheap and leaves the process as it found it. Each check has a Python of its own."""

import subprocess
import sys
import textwrap


def _run(code):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_does_not_import_jax():
    _run("""
        import sys, jaxmotion
        assert "jax" not in sys.modules
        assert "Motion" in dir(jaxmotion)
        assert "jax" not in sys.modules
    """)


def test_pictures_are_there_and_load_matplotlib_when_they_are_drawn():
    """And a notebook that has not imported pyplot shows them."""
    _run("""
        import sys
        import numpy as np
        import jaxmotion as jm
        assert "viz" in dir(jm)
        assert "plot_contacts" in dir(jm.viz)
        assert "matplotlib" not in sys.modules
        skeleton = jm.Skeleton(["root", "tip"], [-1, 0], np.ones((2, 3), "float32"))
        points = jm.contacts.ContactPoints(skeleton, [])
        none = jm.contacts.Contacts(points, np.zeros((4, 0), bool), np.zeros((4, 0, 3), "float32"))
        q = np.tile(np.eye(4, dtype="float32")[0], (4, 2, 1))
        motion = jm.Motion(skeleton, np.ones((4, 2, 3), "float32"), q, 0.1)
        figure = jm.viz.plot_contacts(motion, none)
        assert "matplotlib.pyplot" not in sys.modules
        assert figure._repr_png_().startswith(bytes([0x89]) + b"PNG")
    """)


def test_extras_load_when_they_are_used():
    _run("""
        import sys
        import jaxmotion.io.gltf, jaxmotion.io.usd, jaxmotion.viz
        assert callable(jaxmotion.viz.log_rerun)
        assert not {"pygltflib", "pxr", "rerun", "matplotlib"} & set(sys.modules)
    """)


def test_help_does_not_import_jax():
    help_text = _run("""
        import sys
        from jaxmotion.cli import main
        sys.argv = ["jaxmotion", "--help"]
        try:
            main()
        except SystemExit as leaving:
            assert not leaving.code
        assert "jax" not in sys.modules
    """)
    assert "denoise" in help_text


def test_use_changes_no_setting_and_no_warning_filter():
    _run("""
        import warnings
        import equinox, jax, jaxtyping, lineax, numpy, optimistix, scipy.sparse

        def settings():
            return (
                dict(jax.config.values), list(warnings.filters), numpy.geterr(),
                numpy.get_printoptions(),
            )

        before = settings()
        import jaxmotion as jm
        for name in jm.__all__:
            getattr(jm, name)
        skeleton = jm.Skeleton(["root", "tip"], [-1, 0], numpy.ones((2, 3), "float32"))
        q = jm.quaternion.identity((4, 2), "float32")
        motion = jm.Motion.from_root(skeleton, numpy.zeros((4, 3), "float32"), q, 0.1)
        pose = jm.forward_kinematics(motion)
        assert pose.positions.dtype == "float32"
        assert jm.quaternion.mean(q).dtype == "float32"
        after = settings()
        for a, b in zip(before, after):
            assert a == b, (a, b)
    """)
