"""Each term's Jacobian against jvp of its rows, and a new term through the whole solver."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmotion.spacetime import JointLimits
from jaxmotion.spacetime.prior import Prior
from jaxmotion.spacetime.problem import Problem
from jaxmotion.spacetime.solve import meet, problem_of
from jaxmotion.spacetime.terms.contacts import contact_term
from jaxmotion.spacetime.terms.floor import FloorTerm
from jaxmotion.spacetime.terms.limits import LimitTerm
from jaxmotion.spacetime.terms.term import Term
from tests.spacetime.scene import FRAMES, RAMP, WEIGHTS, Oracle, case, difference, limits_of

NORMAL, OFFSET, FIRMNESS = np.array([0.6, 0.0, 0.8]), 0.05, 0.3


class Plane(Term):
    """Points on the plane ``normal . y = offset``: what a new constraint takes, and no more."""

    normal: jax.Array
    offset: jax.Array
    pull: jax.Array

    def rows(self, pose):
        return self.pull * (pose.points @ self.normal - self.offset) / pose.length

    def jacobian(self, pose, slopes):
        return self.pull * jnp.einsum("tcid,i->tcd", slopes.points, self.normal)

    def report(self, motion, points):
        return {}


def contacts_of(motion, contacts):
    position, ramp = jnp.asarray(WEIGHTS.position), jnp.asarray(RAMP)
    return contact_term(motion, contacts, contacts.target, position, ramp)


TERMS = {
    "contacts": lambda: contacts_of(*case()),
    "floor": lambda: FloorTerm(jnp.asarray(-1.2), jnp.asarray(0.6)),
    "limits": lambda: LimitTerm(limits_of(), jnp.asarray(0.8)),
    "plane": lambda: Plane(jnp.asarray(NORMAL), jnp.asarray(OFFSET), jnp.asarray(FIRMNESS)),
}


def prior(motion):
    size, bend = jnp.asarray(WEIGHTS.size), jnp.asarray(WEIGHTS.bend)
    return Prior(size, bend / motion.frame_time**4), jnp.asarray(WEIGHTS.root)


def problem() -> Problem:
    motion, contacts = case()
    return problem_of(motion, contacts.points, [make() for make in TERMS.values()], *prior(motion))


@pytest.fixture(scope="module")
def derivatives():
    """Of all terms at once, compiled once: rows, the Jacobian by hand, and jvp's by column."""

    @jax.jit
    def everything(z):
        whole, columns = problem(), jnp.eye(z.shape[1])
        found = {}
        for name, term in zip(TERMS, whole.terms, strict=True):
            part = eqx.tree_at(lambda p: p.terms, whole, (term,))
            rows, slope = part.linearized(z)
            found[name] = part.rows(z), rows, slope
        # Rows are of their own frame, so one direction serves all frames.
        column = jax.vmap(
            lambda e: jax.jvp(whole.rows, (z,), (jnp.broadcast_to(e, z.shape),))[1], out_axes=2
        )
        single = jnp.zeros_like(z).at[2].set(1)
        return found, column(columns), jax.jvp(whole.rows, (z,), (single,))[1]

    motion, _ = case()
    rng = np.random.default_rng(5)
    z = 0.3 * rng.standard_normal((motion.num_frames, 3 + 3 * 4))
    return jax.tree.map(np.asarray, everything(jnp.asarray(z)))


@pytest.mark.parametrize("name", TERMS)
def test_jacobians_by_hand_are_those_of_the_rows(name, derivatives):
    found, columns, _ = derivatives
    before = list(TERMS)[: list(TERMS).index(name)]
    first = sum(found[other][0].shape[1] for other in before)
    rows, again, slope = found[name]
    np.testing.assert_allclose(again, rows, atol=1e-14)
    want = columns[:, first : first + rows.shape[1]]
    assert slope.shape == want.shape
    np.testing.assert_allclose(slope, want, atol=1e-12)
    assert np.count_nonzero(want) > FRAMES  # the term asks something here
    assert np.count_nonzero(rows) < rows.size or name == "plane"  # and not everywhere


def test_rows_are_of_their_own_frame(derivatives):
    _, columns, single = derivatives
    np.testing.assert_allclose(single[2], columns[2].sum(-1), atol=1e-12)
    np.testing.assert_array_equal(np.delete(single, 2, axis=0), 0)


class PlaneOracle(Oracle):
    """The cost of contacts, with the plane's rows beside it."""

    def residuals(self, flat):
        y = self.points(self.moved(flat.reshape(self.frames, -1)))
        missed = FIRMNESS * (y @ NORMAL - OFFSET) / self.length
        return np.concatenate([super().residuals(flat), missed.ravel()])


def test_a_new_term_is_one_class():
    motion, contacts = case()
    oracle = PlaneOracle(motion, contacts, None, None)
    want = oracle.minimum()
    terms = [TERMS["plane"](), contacts_of(motion, contacts)]

    @jax.jit
    def solve(motion):
        how = "gauss_newton", 1e-9, 200
        return meet(motion, contacts.points, terms, *prior(motion), *how)

    answer, solution = solve(motion)
    assert bool(solution.converged)
    np.testing.assert_allclose(solution.after, want.cost, rtol=1e-7)
    np.testing.assert_allclose(solution.before, 0.5 * np.sum(oracle.residuals(0 * want.x) ** 2))
    assert difference(answer, oracle.moved(want.x.reshape(FRAMES, -1))) < 1e-4
    alone = Oracle(motion, contacts, None, None).residuals(want.x)
    assert want.cost > 1.05 * 0.5 * np.sum(alone**2)  # the plane matters


def test_what_a_term_tells_of_itself():
    _, contacts = case()
    touching, floor, limits, plane = (make() for make in TERMS.values())
    held = np.asarray(contacts.mask).any(axis=1)
    np.testing.assert_allclose(touching.firmness[held], WEIGHTS.position)
    assert np.all(touching.firmness[~held] < WEIGHTS.position)
    assert floor.firmness is limits.firmness is plane.firmness is None
    assert touching.box is floor.box is plane.box is None
    np.testing.assert_array_equal(limits.box.upper, limits_of().upper)
    assert [term.asks_each_joint for term in (touching, floor, limits, plane)] == [0, 0, 1, 0]
    upper = jnp.arange(15.0).reshape(5, 3)
    part = LimitTerm(JointLimits(-upper, upper), limits.pull).within(jnp.asarray([3, 1]))
    np.testing.assert_array_equal(part.limits.upper, upper[jnp.asarray([3, 1])])
    assert plane.within((0, 1)) is plane
