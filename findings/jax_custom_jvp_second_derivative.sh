#!/usr/bin/env bash
# jax 0.10.2: a second derivative by reverse mode leaves out part of a custom_jvp rule, in silence.
#
# The tutorial on custom derivative rules says that a rule is used again by every further derivative
# if it calls the function for its primal output. It also has to stand on its own where it calls the
# function with a tangent: there reverse mode keeps the function and drops the rule. A function whose
# own derivative is not what its rule says (it stops a gradient, as implicit solvers do) then has the
# right first derivative in both modes and the right second one by jacfwd(jacfwd), and by
# jacfwd(grad), which is jax.hessian's kind, a wrong one: part of it, or inside a scan none of it.
#
# s^3 at 2 by three multiplications: first derivative 12, second 12. Seen: jacfwd(grad) gives 6 for
# the loop written out and 0 for the scan. Fails if that changes.
set -euo pipefail
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet jax==0.10.2 jaxlib==0.10.2
JAX_PLATFORMS=cpu "$folder/venv/bin/python" - <<'PYTHON'
import jax

jax.config.update("jax_enable_x64", True)


@jax.custom_jvp
def times(x, s):
    return jax.lax.stop_gradient(s) * x


@times.defjvp
def _(primals, tangents):
    (x, s), (dx, ds) = primals, tangents
    return times(x, s), times(dx, s) + x * ds


def written_out(s):
    return times(times(times(1.0, s), s), s)


def scanned(s):
    return jax.lax.scan(lambda x, _: (times(x, s), None), 1.0, length=3)[0]


seen = {
    f.__name__: [
        float(derivative(2.0))
        for derivative in (
            jax.grad(f),
            jax.jacfwd(f),
            jax.jacfwd(jax.jacfwd(f)),
            jax.jacfwd(jax.grad(f)),
        )
    ]
    for f in (written_out, scanned)
}
print("jax", jax.__version__, "grad, jacfwd, jacfwd(jacfwd), jacfwd(grad); the truth is 12 for all")
print(seen)
assert seen == {"written_out": [12.0, 12.0, 12.0, 6.0], "scanned": [12.0, 12.0, 12.0, 0.0]}, seen
PYTHON
