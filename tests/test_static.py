"""Flags and numbers of things that are traced are refused by name, with what to do about it."""

import inspect
import typing
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion._checks import static
from tests.helpers import random_motion
from tests.test_sweep import FUNCTIONS

# Functions that nothing traced may come into: files, measures on the host, pictures.
ON_THE_HOST = ("io.", "metrics.", "viz.")


def is_static(parameter) -> bool:
    """Whether the annotation is for a flag or a whole number, and no array."""
    hint = parameter.annotation
    options = (hint, *typing.get_args(hint))
    if typing.get_origin(hint) in (tuple, Sequence) or float in options:
        return False
    numbers = (
        typing.get_origin(option) is typing.Literal
        and all(isinstance(value, int) for value in typing.get_args(option))
        for option in options
    )
    return bool in options or int in options or any(numbers)


CASES = [
    (name, parameter.name)
    for name, function in FUNCTIONS.items()
    if not inspect.isclass(function) and not name.startswith(ON_THE_HOST)
    for parameter in inspect.signature(function).parameters.values()
    if is_static(parameter)
]


@pytest.mark.parametrize(("name", "argument"), CASES)
def test_what_is_static_is_refused_where_it_is_traced(name, argument):
    """The arguments of the function are looked at before anything else of them."""
    function = FUNCTIONS[name]
    needed = [
        None
        for parameter in inspect.signature(function).parameters.values()
        if parameter.default is parameter.empty
        and parameter.kind is not parameter.KEYWORD_ONLY
        and parameter.name != argument
    ]
    words = rf"{function.__name__}: {argument} is traced.*static_argnames='{argument}'"
    with pytest.raises(ValueError, match=words):
        jax.eval_shape(lambda value: function(*needed, **{argument: value}), jnp.asarray(1))


def test_there_are_many():
    assert ("layers.denoise", "tune") in CASES
    assert ("quaternion.to_euler", "unwrap") in CASES
    assert len(CASES) > 60


def test_a_flag_under_jit_works_once_it_is_said_to_be_static():
    motion = random_motion(np.random.default_rng(0), 4, 3)
    with pytest.raises(ValueError, match="to_euler: unwrap is traced"):
        jax.jit(jm.quaternion.to_euler)(motion.rotations, unwrap=True)
    turned = jax.jit(jm.quaternion.to_euler, static_argnames="unwrap")
    np.testing.assert_allclose(
        turned(motion.rotations, unwrap=True), jm.quaternion.to_euler(motion.rotations, unwrap=True)
    )


def test_arguments_are_found_by_place_and_by_name():
    @static("flag")
    def shown(x, flag=False):
        """What it does."""
        return x if flag else -x

    assert shown(1, True) == shown(1, flag=True) == -shown(1) == 1
    assert (shown.__name__, shown.__doc__) == ("shown", "What it does.")
    with pytest.raises(ValueError, match="shown: flag is traced"):
        jax.jit(shown)(1, True)
    assert jax.jit(shown)(1) == -1
