"""A zero costs one sub-step where the nodes around tell where it is, and is no less accurate."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration.events import crossings as c
from varint.integration.events.substeps import interpreted_substeps
from varint.integration.step_function import guided_step_function, step_function

Q, V = vi.coordinates("q")
PENDULUM = vi.System(Q, V, V**2 / 2 + ca.cos(Q))
X, U = vi.coordinates("x", "y")
KEPLER = vi.System(X, U, ca.sumsqr(U) / 2 + 1 / ca.norm_2(X))
BEAD = vi.System(X, U, ca.sumsqr(U) / 2 - X[1], constraint=ca.sumsqr(X) - 1)


def found(system, rule, start, h, steps, watched):
    """Zeros, how many sub-steps they took, and the motion."""
    motion = vi.simulate(system, rule, q0=start[0], v0=start[1], h=h, steps=steps)
    taken = []

    def counted(motion, node, t):
        taken.append(len(t))
        return interpreted_substeps(motion, node, t)

    search = c.crossing_search(system, c.Watch("zero", watched, 0))
    return c.find_crossings(search, motion, {}, counted).before, sum(taken), motion


@pytest.mark.parametrize(
    ("system", "start", "watched", "h"),
    [
        (PENDULUM, ([1.0], [0.0]), Q - 0.3, 0.15),
        (PENDULUM, ([1.0], [0.0]), V * ca.cos(Q), 0.1),
        (KEPLER, ([1.0, 0.0], [0.0, 1.1]), X[1] - 0.1, 0.1),
        (BEAD, ([1.0, 0.0], [0.0, 0.0]), X[0], 0.05),
    ],
)
@pytest.mark.parametrize("rule", [vi.gauss(4), vi.lobatto(4)])
def test_one_substep_locates_a_zero_where_dense_output_has_it(system, start, watched, h, rule):
    if system is BEAD and rule.name.startswith("gauss"):
        pytest.skip("constraints want Lobatto's rules")
    zeros, taken, motion = found(system, rule, start, h, 1500, watched)
    assert len(zeros.t) >= 20
    assert taken <= 1.1 * len(zeros.t) + 1
    for t, q, v, p in list(zip(zeros.t, zeros.q, zeros.v, zeros.p, strict=True))[::9]:
        there = motion.at(t)  # a sub-step from its node to this very time
        for mine, exact in ((q, there.q), (v, there.v), (p, there.p)):
            np.testing.assert_allclose(mine, np.ravel(exact), rtol=0, atol=2e-13)
    values = ca.Function("value", [system.q, system.v], [watched])
    of_all = np.array(values.map(len(zeros.t))(zeros.q.T, zeros.v.T))
    assert np.abs(of_all).max() < 3e-13


def test_zeros_that_the_nodes_around_do_not_tell_take_more_substeps_and_are_as_exact():
    """Velocities of a rule of second order are none of the curve through its nodes."""
    zeros, taken, motion = found(PENDULUM, vi.lobatto(2), ([1.0], [0.0]), 0.15, 1500, Q - 0.3)
    assert taken > 1.5 * len(zeros.t)
    exact = [float(motion.at(t).q[0]) for t in zeros.t[::5]]
    np.testing.assert_allclose(exact, 0.3, rtol=0, atol=1e-13)


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.gauss(8), vi.lobatto(4)])
def test_a_guided_step_is_the_step(rule):
    """Whatever it starts from: the same root."""
    step, guided = step_function(PENDULUM, rule), guided_step_function(PENDULUM, rule)
    q, p, h = 1.0, 0.2, 0.1
    plain = step(q0=q, p0=p, t=0, h=h)
    for guess in (0.0, 0.2, 1.0):
        q1, p1 = guided(q, p, ca.DM(0, 1), ca.DM(0, 1), 0, h, ca.DM([guess] * rule.degree))
        np.testing.assert_allclose(
            [float(q1), float(p1)], [float(plain["q1"]), float(plain["p1"])], rtol=0, atol=4e-16
        )
    assert guided_step_function(PENDULUM, vi.lobatto(2)) is None  # explicit: nothing to start
