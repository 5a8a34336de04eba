"""Derivatives written out: linear maps with their transposes, values with their derivatives.

    linear   change(*at, *x), linear in x; backwards pull(*at, y)
    driven   a value whose derivative is change(*at, d by), whatever it was computed from

The contract. ``change`` is linear in x (in d by) for every ``at`` and pure; ``pull`` is its exact
transpose, with the same ``at``, and makes one cotangent for each leaf of x, of its shape and dtype;
both return arrays of shapes that depend on shapes only. Nothing checks this: a test beside each map
compares the pair (⟨change x, y⟩ = ⟨x, pull y⟩) and its derivatives with JAX's own of the plain
function. ``at`` may have derivatives, but for whole numbers. What holds then: derivatives of any
order in both modes, ``vmap``, loops, ``jit``, exports.

Both are primitives, and this is the only file that touches ``jax.extend`` and ``jax.interpreters``,
which JAX may change between versions; run on 0.7.2 and 0.10.2. Left to JAX, a transpose is fed by
dozens of stored intermediates; and a ``custom_jvp`` whose function has another derivative than its
rule says is wrong where JAX drops the rule, as it does in a derivative of a scan's derivative.

XLA fuses elementwise chains without limit on a CPU, and computes what several consumers share once
for each, which makes a gradient explode in time and code. It does not fuse across a branch, so
every map is a branch of a condition that always holds (:func:`fenced`).
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax.core import ShapedArray
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir


def fenced(f: Callable[..., Any], *args: Any) -> Any:
    """f(*args), computed once and stored, whoever uses it."""
    always = jax.lax.optimization_barrier(jnp.asarray(True))
    f = jax.jit(f, inline=True)  # traced once
    shapes = jax.eval_shape(f, *args)

    def never(*_):
        return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shapes)

    return jax.lax.cond(always, f, never, *args)


def linear(change: Callable, pull: Callable, at: tuple, x: tuple) -> Any:
    """change(*at, *x), linear in x; its transpose is pull(*at, y), a tuple like ``x``."""
    change, pull = (jax.jit(f, inline=True) for f in (change, pull))  # traced once
    (at_leaves, at_tree), (x_leaves, x_tree) = jax.tree.flatten(at), jax.tree.flatten(x)
    shapes = jax.eval_shape(change, *at, *x)

    def forward(at_leaves, x_leaves):
        at, x = jax.tree.unflatten(at_tree, at_leaves), jax.tree.unflatten(x_tree, x_leaves)
        return jax.tree.leaves(change(*at, *x))

    def backward(at_leaves, y_leaves):
        at = jax.tree.unflatten(at_tree, at_leaves)
        y = jax.tree.unflatten(jax.tree.structure(shapes), y_leaves)
        return jax.tree.leaves(pull(*at, y))

    y = _linear.bind(*at_leaves, *x_leaves, given=len(at_leaves), change=forward, pull=backward)
    return jax.tree.unflatten(jax.tree.structure(shapes), y)


def driven(
    change: Callable,
    pull: Callable,
    value: Any,
    by: Any,
    at: tuple = (),
    *,
    own: Callable[[Any], tuple] | None = None,
) -> Any:
    """``value``, whose derivative is change(*at, d by) and no other, linear in d by, with
    pull(*at, cotangent) for its transpose; ``own`` is what of the value itself comes first in
    ``at``."""
    leaves, tree = jax.tree.flatten((value, by, at))
    size = len(jax.tree.leaves(value))
    kept = _driven.bind(*leaves, tree=tree, size=size, own=own, change=change, pull=pull)
    return jax.tree.unflatten(jax.tree.structure(value), kept)


_linear, _driven = Primitive("linear_map"), Primitive("driven")
_linear.multiple_results = _driven.multiple_results = True


def _apply_linear(*args, given, change, pull):
    return fenced(change, list(args[:given]), list(args[given:]))


def _linear_shapes(*avals, given, change, pull):
    args = [jax.ShapeDtypeStruct(a.shape, a.dtype) for a in avals]
    out = jax.eval_shape(change, args[:given], args[given:])
    return [ShapedArray(y.shape, y.dtype) for y in out]


def _linear_jvp(primals, tangents, *, given, change, pull):
    parameters = {"given": given, "change": change, "pull": pull}
    at, x = list(primals[:given]), list(primals[given:])
    y = _linear.bind(*primals, **parameters)
    terms = []
    if any(type(t) is not ad.Zero for t in tangents[given:]):
        dx = [ad.instantiate_zeros(t) for t in tangents[given:]]
        terms.append(_linear.bind(*at, *dx, **parameters))
    moving = [k for k, t in enumerate(tangents[:given]) if type(t) is not ad.Zero]
    if moving:

        def at_these(*some):
            there = list(at)
            for k, value in zip(moving, some, strict=True):
                there[k] = value
            return fenced(change, there, x)

        some, changes = [at[k] for k in moving], [tangents[k] for k in moving]
        terms.append(jax.jvp(at_these, some, changes)[1])
    return y, [sum(parts[1:], start=parts[0]) for parts in zip(*terms, strict=True)]


def _linear_transpose(pulls, *args, given, change, pull):
    at, x = args[:given], args[given:]
    pulls = [ad.instantiate_zeros(p) for p in pulls]
    back = _linear.bind(*at, *pulls, given=given, change=pull, pull=change)
    wanted = [b if ad.is_undefined_primal(a) else None for a, b in zip(x, back, strict=True)]
    return [None] * given + wanted


def _linear_batch(args, dims, *, given, change, pull):
    size = _batch_size(args, dims)
    pairs = zip(args[:given], dims[:given], strict=True)
    at = [a if d is None else jnp.moveaxis(a, d, 0) for a, d in pairs]
    x = [_batched(a, d, size) for a, d in zip(args[given:], dims[given:], strict=True)]
    axes = ([None if d is None else 0 for d in dims[:given]], 0)
    y = _linear.bind(
        *at,
        *x,
        given=given,
        change=jax.vmap(change, in_axes=axes),
        pull=jax.vmap(pull, in_axes=axes),
    )
    return y, [0] * len(y)


def _keep(*leaves, size, **_):
    return list(leaves[:size])


def _driven_jvp(primals, tangents, *, tree, size, own, change, pull):
    kept = _driven.bind(*primals, tree=tree, size=size, own=own, change=change, pull=pull)
    value, by, at = jax.tree.unflatten(tree, primals)
    changes = tangents[size : size + len(jax.tree.leaves(by))]
    if all(type(t) is ad.Zero for t in changes):
        return kept, [ad.Zero(jax.typeof(x).to_tangent_aval()) for x in kept]
    d_by = jax.tree.unflatten(jax.tree.structure(by), [ad.instantiate_zeros(t) for t in changes])
    if own is not None:
        at = (*own(jax.tree.unflatten(jax.tree.structure(value), kept)), *at)
    d_value = linear(change, lambda *at_and_y: (pull(*at_and_y),), at, (d_by,))
    return kept, jax.tree.leaves(d_value)


def _driven_batch(args, dims, *, tree, size, own, change, pull):
    count = _batch_size(args, dims)
    leaves = [_batched(a, d, count) for a, d in zip(args, dims, strict=True)]
    change, pull = jax.vmap(change), jax.vmap(pull)
    kept = _driven.bind(*leaves, tree=tree, size=size, own=own, change=change, pull=pull)
    return kept, [0] * len(kept)


def _batch_size(args, dims):
    return next(a.shape[d] for a, d in zip(args, dims, strict=True) if d is not None)


def _batched(x, axis, size):
    if axis is None:
        return jnp.broadcast_to(x, (size, *x.shape))
    return jnp.moveaxis(x, axis, 0)


_linear.def_impl(_apply_linear)
_linear.def_abstract_eval(_linear_shapes)
ad.primitive_jvps[_linear] = _linear_jvp
ad.primitive_transposes[_linear] = _linear_transpose
batching.primitive_batchers[_linear] = _linear_batch
mlir.register_lowering(_linear, mlir.lower_fun(_apply_linear, multiple_results=True))

_driven.def_impl(_keep)
_driven.def_abstract_eval(lambda *avals, size, **_: list(avals[:size]))
ad.primitive_jvps[_driven] = _driven_jvp
batching.primitive_batchers[_driven] = _driven_batch
mlir.register_lowering(_driven, mlir.lower_fun(_keep, multiple_results=True))
