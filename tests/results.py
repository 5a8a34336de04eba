"""What public functions return: every type of it, and a small example of each.

    NAMES             of the types
    example(name)     one of that type, made once; nothing is compiled
    result_types()    the types: what is public, what that returns, holds and can be asked for

The arrays of an example have the shapes and dtypes of a true one, and not always its values.
"""

import functools
import importlib
import inspect
import pkgutil
import typing
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import lineax
import numpy as np
import optimistix

import jaxmotion as jm
from jaxmotion import (
    axes,
    cleaning,
    contacts,
    corpus,
    displacement,
    kinematics,
    linalg,
    metrics,
    multiresolution,
    samples,
    smoothing,
    spacetime,
    style,
    timing,
    viz,
)
from jaxmotion._asf_bone import AsfBone
from jaxmotion.linalg.chain_covariance import State
from jaxmotion.linalg.difference_chain import Gains, Information
from jaxmotion.metrics import Findings
from jaxmotion.skeleton import Conventions
from jaxmotion.smoothing.design import Observations
from jaxmotion.smoothing.geodesic_regression import _Problem
from tests.helpers import random_motion, random_skeleton

FRAMES, JOINTS, SECONDS = 24, 7, 1 / 60
FEET = ("LeftFoot", "LeftToe", "RightFoot", "RightToe")


def zeros(*shape, dtype=np.float64):
    return jnp.asarray(np.zeros(shape, dtype))


@functools.cache
def motion() -> jm.Motion:
    """24 frames of 7 joints, two of which have end sites; in JAX's arrays."""
    rng = np.random.default_rng(0)
    found = random_skeleton(rng, JOINTS)
    bones = [AsfBone(axis=(0.0, 10.0 * j, 0.0), limits=((-20.0, 20.0),)) for j in range(JOINTS)]
    skeleton = jm.Skeleton(
        ["Hips", "Spine", *FEET, "Head"],
        found.parents,
        found.offsets,
        end_joints=found.end_joints,
        end_offsets=found.end_offsets,
        asf=bones,
    )
    clip = random_motion(rng, FRAMES, skeleton)
    clip = clip.replace(frame_time=SECONDS, frame_time_text=".0166667")
    return jax.tree.map(jnp.asarray, clip)


def as_returned(function: Callable, *args) -> Any:
    """What a function returns, of ones: it is traced, not compiled."""
    shapes = jax.eval_shape(function, *args)
    return jax.tree.map(lambda x: jnp.asarray(np.ones(x.shape, x.dtype)), shapes)


def chain() -> linalg.DifferenceChain:
    return linalg.DifferenceChain(*(zeros(FRAMES, 1, 1) for _ in range(4)))


def errors() -> cleaning.DetectedErrors:
    mask = zeros(FRAMES, JOINTS, dtype=bool)
    numbers = zeros(FRAMES, JOINTS), zeros(FRAMES, JOINTS)
    return cleaning.DetectedErrors(mask, *numbers, {"jump": mask}, motion())


def points() -> contacts.ContactPoints:
    return contacts.ContactPoints(motion().skeleton, FEET, names=[f"{foot}.end" for foot in FEET])


def touched() -> contacts.Contacts:
    mask = np.zeros((FRAMES, len(FEET)), bool)
    return contacts.Contacts(
        points(), mask, zeros(*mask.shape, 3), kind=np.int8(mask), confidence=zeros(*mask.shape)
    )


def geodesic() -> smoothing.GeodesicPosterior:
    q = motion().rotations
    seen = Observations(None, None, None, FRAMES)
    rows = zeros(FRAMES - 2, 1, JOINTS)
    problem = _Problem(q, q, None, rows, zeros(JOINTS), seen, 2, "l2")
    done = optimistix.RESULTS.successful
    return smoothing.GeodesicPosterior(q, zeros(dtype=np.int32), done, problem)


def tuning() -> smoothing.Tuning:
    return smoothing.Tuning(*(zeros(JOINTS) for _ in range(3)))


def smoother() -> smoothing.StreamingSmoother:
    return smoothing.StreamingSmoother(jnp.asarray(1.0), jnp.asarray(0.5), lag=5)


def moved() -> displacement.Displacement:
    return displacement.Displacement(zeros(FRAMES, JOINTS, 3), zeros(FRAMES, JOINTS, 3))


def compressed() -> multiresolution.CompressedMotion:
    rows = motion().num_frames // 2
    codes = np.zeros((rows, JOINTS, 3), np.int16)
    return multiresolution.CompressedMotion(
        base=motion()[::2],
        codes=((codes, codes),),
        steps=(0.001, 0.002),
        times=None,
        num_bytes=4321,
        ratio=5.4321,
        translation_error=0.00123456,
        rotation_error=0.0023456,
        frames=(rows, FRAMES),
        frame_time_text=".0166667",
    )


@functools.cache
def clips() -> corpus.Corpus:
    return corpus.Corpus({"walk": motion(), "run": motion()[4:]})


def usual() -> corpus.CorpusStatistics:
    numbers = (zeros(JOINTS, 4), zeros(JOINTS, 3, 3), zeros(JOINTS, 3), zeros(JOINTS, 3))
    counts = zeros(JOINTS, 3, 512, dtype=np.int64)
    return corpus.CorpusStatistics(
        *(motion().skeleton.names, 2, 44, zeros(2, dtype=np.int32), zeros(), *numbers, counts),
        *(zeros(JOINTS), *(zeros(JOINTS, 3) for _ in range(4))),
    )


PEAK = metrics.Peak(0.123456789, 12, "LeftFoot", 0.01234567, 0.1)

_MAKERS: dict[str, Callable[[], Any]] = {
    "Motion": motion,
    "Skeleton": lambda: motion().skeleton,
    "Conventions": Conventions,
    "AsfBone": lambda: motion().skeleton.asf[0],
    "UpGuess": lambda: axes.UpGuess("y", "it stands along y, on a level floor"),
    "Displacement": moved,
    "WorldPose": lambda: kinematics.WorldPose(
        zeros(FRAMES, JOINTS, 3), zeros(FRAMES, JOINTS, 4), zeros(FRAMES, 2, 3)
    ),
    "WorldVelocity": lambda: kinematics.WorldVelocity(
        zeros(FRAMES, JOINTS, 3), zeros(FRAMES, JOINTS, 3)
    ),
    "Sample": lambda: samples.Sample(
        motion(),
        np.zeros((FRAMES, 2), bool),
        zeros(FRAMES, 2, 3),
        zeros(2, 3),
        (2, 4),
        FEET[:2],
        zeros(),
    ),
    "Corrupted": lambda: samples.Corrupted(
        motion(), zeros(FRAMES, JOINTS, dtype=bool), zeros(FRAMES, JOINTS)
    ),
    "MotionLayers": lambda: jm.MotionLayers(
        motion(), moved(), moved(), zeros(), zeros(), zeros(dtype=bool), None
    ),
    "Posterior": lambda: as_returned(lambda y: smoothing.lgs(y, 1.0, 1.0), zeros(FRAMES, 3)),
    "GeodesicPosterior": lambda: geodesic(),
    "Tuning": tuning,
    "MotionTuning": lambda: smoothing.MotionTuning(tuning(), tuning()),
    "KeySuggestions": lambda: smoothing.KeySuggestions(zeros(3, dtype=np.int32), zeros(3, FRAMES)),
    "MotionPrior": lambda: smoothing.MotionPrior(("Hips", "Spine"), zeros(6, 6), 250),
    "Bridge": lambda: smoothing.bridges.Bridge("LeftFoot", 12, 13, 0.2, 45.0),
    "Removal": lambda: smoothing.Removal(
        *("LeftFoot", 3.2, 12, 0.2, 0.987654321, 0.02, 0.4, 0.1, 2.345678),
        ("correlation", "contact"),
    ),
    "StreamingSmoother": smoother,
    "StreamState": lambda: as_returned(smoother().init, zeros(JOINTS, 3)),
    "Pyramid": lambda: as_returned(lambda m: multiresolution.build_pyramid(m, 1), motion()),
    "CompressedMotion": compressed,
    "ContactPoints": points,
    "Contacts": touched,
    "Interval": lambda: contacts.Interval(
        "LeftFoot.heel", 2, 3, 17, "point", (0.123456789, 1e-12, -23.456789), 0.987654321
    ),
    "LimbTurn": lambda: contacts.LimbTurn(
        zeros(FRAMES, 4), zeros(FRAMES, 4), zeros(FRAMES), zeros(FRAMES, 3)
    ),
    "JointLimits": lambda: spacetime.JointLimits(
        zeros(JOINTS, 3), zeros(JOINTS, 3), zeros(JOINTS, 4)
    ),
    "Weights": spacetime.Weights,
    "Report": lambda: spacetime.Report(
        *(zeros(FRAMES, n) for n in (4, 4, JOINTS)),
        *(zeros(), zeros(), zeros(dtype=np.int32), zeros(dtype=bool)),
    ),
    "MotionStyle": lambda: style_of_motion(),
    "StyleReport": lambda: style.StyleReport(*styled()),
    "StyleSegment": lambda: style.StyleSegment(120, 250, 3.2),
    "StyleTransfer": lambda: style.StyleTransfer(
        *(motion(), None, style_of_motion(), style_of_motion(), style.StyleReport(*styled()))
    ),
    "Variations": lambda: jm.Variations(
        *(motion(), None, zeros(2), zeros(2, 1), zeros(2, FRAMES), zeros(2, JOINTS)),
        *(zeros(2), zeros(2), zeros(), zeros()),
    ),
    "Alignment": lambda: timing.Alignment(
        motion(), zeros(FRAMES), zeros(40, 2, dtype=np.int32), zeros(dtype=np.int32), zeros()
    ),
    "WarpPath": lambda: timing.WarpPath(
        zeros(), zeros(40, 2, dtype=np.int32), zeros(dtype=np.int32)
    ),
    "MotionWords": lambda: cleaning.MotionWords(
        zeros(5, 15, JOINTS, 4), zeros(5, dtype=np.int32), tuple(range(JOINTS))
    ),
    "Neighbours": lambda: cleaning.Neighbours(
        *(zeros(5, dtype=np.int32), zeros(5, 8, dtype=np.int32), zeros(5, 8, dtype=np.int32)),
        *(zeros(5, 8), zeros(5, 8, 15, dtype=np.int32), zeros(5), 0.0321, tuple(range(JOINTS))),
    ),
    "Digression": lambda: cleaning.Digression(
        *(zeros(FRAMES, JOINTS), zeros(FRAMES, JOINTS), zeros(FRAMES, JOINTS, 3)),
        *(zeros(FRAMES, JOINTS, 4), {}, 1),
    ),
    "DetectedErrors": errors,
    "Levels": lambda: cleaning.Levels(zeros(JOINTS), zeros(JOINTS), zeros(JOINTS)),
    "Repaired": lambda: cleaning.Repaired(
        motion(), zeros(FRAMES, JOINTS, dtype=bool), motion(), errors()
    ),
    "ErrorRun": lambda: cleaning.ErrorRun(3, 17, ("Hips",), 0.98765432, ("jump",), 0.75),
    "RepairedRun": lambda: cleaning.RepairedRun(3, 17, ("Hips",), 0.98765432, 1.5, 0.125),
    "DetectionScores": lambda: metrics.DetectionScores(*[0.9] * 5, 100, 12),
    "MotionWarp": lambda: timing.MotionWarp(
        *(zeros(FRAMES, dtype=np.int32), zeros(FRAMES, 9), zeros(FRAMES, 9), zeros(100)),
        *(zeros(dtype=bool), zeros(dtype=np.int32), 8, 192),
    ),
    "ContactScores": lambda: metrics.ContactScores(0.987654321, 1.0),
    "Mapped": lambda: corpus.Mapped(
        "takes/walk.bvh", "out/walk.bvh", "failed", "ValueError: no feet", (), 0.123456789
    ),
    "Player": lambda: viz.Player("<!doctype html>", ("before", "after"), FRAMES),
    "Difference": lambda: metrics.Difference(240, 33, PEAK, PEAK, PEAK, PEAK),
    "Peak": lambda: PEAK,
    "Problem": lambda: metrics.Problem(
        "spike", "LeftFoot turns by 45 degrees and back within a frame", 12, 13, "LeftFoot"
    ),
    "Corpus": clips,
    "WindowSource": lambda: clips().window_source(8),
    "Batches": lambda: clips().windows(8, batch=2),
    "CorpusStatistics": usual,
    "BandedFactor": lambda: linalg.BandedFactor(zeros(FRAMES, 1), zeros(FRAMES)),
    "BlockBandedFactor": lambda: linalg.BlockBandedFactor(
        zeros(FRAMES, 1, 3, 3), zeros(FRAMES, 3, 3)
    ),
    "DifferenceChain": chain,
    "ChainFactor": lambda: as_returned(linalg.chain_factor, chain()),
    "Knowledge": lambda: linalg.Knowledge(information(), information()),
    "Information": lambda: information(),
    "Gains": lambda: Gains(*(zeros(FRAMES, 1, 1) for _ in range(7))),
    "State": lambda: State(*(zeros(FRAMES, 1, 1) for _ in range(3))),
}


def style_of_motion() -> style.MotionStyle:
    names = motion().skeleton.names
    return style.MotionStyle(
        names, zeros(JOINTS, 4), zeros(JOINTS, 3, 3), *(zeros(6),) * 2, zeros(3), zeros()
    )


def styled() -> tuple:
    """The fields of a report."""
    names = motion().skeleton.names
    return names, zeros(JOINTS), zeros(JOINTS), zeros(JOINTS, dtype=bool), zeros(), names[:2]


def information() -> Information:
    return Information(*(zeros(FRAMES, 1, 1) for _ in range(3)))


NAMES = tuple(_MAKERS)


@functools.cache
def example(name: str) -> Any:
    """One of the type of that name."""
    return _MAKERS[name]()


# The types


def result_types() -> dict[str, type]:
    """By name: what the rooms name in ``__all__``, and from there on what their functions, methods
    and properties are annotated to return, and what their public fields hold; without errors,
    warnings, the solvers, whose form is that of lineax and optimistix, and findings, a line a
    kind."""
    waiting = [x for name in ["", *_rooms()] for x in _public(name)]
    found: dict[str, type] = {}
    while waiting:
        thing = waiting.pop()
        if not inspect.isclass(thing):
            waiting += _classes(_returned(thing))
        elif thing.__name__ not in found and _is_result(thing):
            found[thing.__name__] = thing
            waiting += _classes(
                t for name, t in inspect.get_annotations(thing).items() if name[0] != "_"
            )
            waiting += [
                x.fget if isinstance(x, property) else x
                for name, x in vars(thing).items()
                if name[0] != "_" and (callable(x) or isinstance(x, property))
            ]
    return found


def _rooms() -> list[str]:
    rooms = [info.name for info in pkgutil.iter_modules(jm.__path__)]
    return [name for name in rooms if name[0] != "_" and name != "cli"]


def _public(room: str) -> list:
    module = importlib.import_module(f"jaxmotion.{room}".rstrip("."))
    return [getattr(module, name) for name in getattr(module, "__all__", ())]


def _returned(function) -> Any:
    try:
        return inspect.signature(function).return_annotation
    except (TypeError, ValueError):
        return None


def _classes(annotation) -> list[type]:
    """The package's own in an annotation, or in several."""
    if inspect.isclass(annotation):
        return [annotation] if annotation.__module__.startswith("jaxmotion") else []
    inner = typing.get_args(annotation)
    if not inner and not isinstance(annotation, str) and hasattr(annotation, "__iter__"):
        inner = tuple(annotation)
    return [cls for part in inner for cls in _classes(part)]


def _is_result(cls: type) -> bool:
    solver = lineax.AbstractLinearSolver, optimistix.AbstractLeastSquaresSolver
    return not issubclass(cls, (Exception, Findings, *solver)) and cls.__module__.startswith(
        "jaxmotion"
    )
