"""The search for zeros in C finds what the search by NumPy finds, all steps at once, finds."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration.backend import kernel_for
from varint.integration.events import native_crossings
from varint.integration.events.crossings import crossing_search, find_crossings, parse_watch
from varint.integration.events.native_crossings import crossings_by
from varint.integration.events.substeps import substeps_of
from varint.integration.plan import plan
from varint.integration.problem import RunOptions, Start, initial_value_problem

A, B = vi.coordinates("a", "b")
CHAIN = vi.System(
    A,
    B,
    B[0] ** 2
    + B[1] ** 2 / 2
    + B[0] * B[1] * ca.cos(A[0] - A[1])
    + 9.81 * ca.dot(ca.DM([2, 1]), ca.cos(A)),
)
X, W = vi.coordinates("x", "y")
SPRING = vi.System(X, W, ca.sumsqr(W) / 2 - (ca.sumsqr(X) / 2 + X[0] ** 2 * X[1] - X[1] ** 3 / 3))
ROD = vi.System(X, W, ca.sumsqr(W) / 2 - 9.81 * X[1], constraint=ca.sumsqr(X) - 1)
DAMPED = vi.System(A, B, ca.sumsqr(B) / 2 - ca.sumsqr(A) / 2, force=-0.1 * B)
PUSH = ca.SX.sym("push")
PUSHED = vi.System(A, B, ca.sumsqr(B) / 2 + ca.sum1(ca.cos(A)), control=PUSH, force=PUSH * A)

MOTIONS = {
    "chain": (CHAIN, vi.gauss(8), [1.0, 0.5], [0.0, 0.0], 0.1),
    "spring": (SPRING, vi.gauss(4), [0.0, 0.1], [0.4, 0.0], 0.5),
    "explicit": (SPRING, vi.composition("kahan-li8"), [0.0, 0.1], [0.4, 0.0], 0.3),
    "leapfrog": (SPRING, vi.composition("verlet"), [0.0, 0.1], [0.4, 0.0], 0.05),
    "backwards": (DAMPED, vi.gauss(2), [1.0, 0.3], [0.0, 1.0], -0.05),
    "pushed": (PUSHED, vi.gauss(3), [1.0, 0.3], [0.0, 1.0], 0.1),
    "rod": (ROD, vi.lobatto(4), [0.8, 0.6], [0.0, 0.0], 0.05),
}


def watched(name, system):
    q, v, t = system.q, system.v, system.t
    usual = {
        "coordinate": (q[0], 1),
        "velocity": (v[0], 0),
        "both": (q[0] * v[1] - q[1] * v[0] + 0.05, -1),
    }
    if name != "spring":
        return usual
    return usual | {
        "level": (q[1] - 0.1, 0),
        "several in a step": (ca.sin(40 * t), 1),
        "time": (t - 1.2345, 0),
        "pole": (1 / q[0], 0),
        "touching": ((q[0] - 0.05) ** 2, 0),
        "nearly touching": ((q[0] - 0.05) ** 2 - 1e-6, 0),
        "zero up to round-off": ((q[0] + 1) - q[0] - 1, 0),
        "never": (ca.sumsqr(q) + 1, 0),
        "at the start": (q[1] - 0.1, -1),
    }


def run(name):
    system, rule, q0, v0, h = MOTIONS[name]
    u = np.sin(np.arange(200.0))[:, None] if system is PUSHED else None
    problem = initial_value_problem(
        system, plan(system, rule).rule, Start(q0, v0, u=u), RunOptions(h=h, steps=200)
    )
    kernel = kernel_for(system, rule, problem, "native")
    start = dict(q0=q0, v0=v0, h=h, steps=200, u=u)
    return vi.simulate(system, rule, **start, backend="native"), kernel


@pytest.mark.parametrize("name", MOTIONS)
def test_both_searches_find_the_same_zeros(name, monkeypatch):
    """Nodes and order exactly, times and states to round-off over the slope."""
    motion, kernel = run(name)
    pairs = []
    for what, asked in watched(name, motion.system).items():
        search = crossing_search(motion.system, parse_watch(what, asked))
        pairs.append((what, search, find_crossings(search, motion, {}, substeps_of(kernel))))
    monkeypatch.setattr(native_crossings, "find_crossings", None)  # the other one is not asked
    some = 0
    for what, search, other in pairs:
        found = crossings_by(kernel, search, motion, {})
        assert np.array_equal(found.before.node, other.before.node), what
        close = 1e-12 if "touching" not in what else 1e-7
        for one, two in zip(found.after[1:5], other.after[1:5], strict=True):
            assert np.allclose(one, two, rtol=0, atol=close * max(abs(two).max(initial=1.0), 1.0))
        assert not found.jump.any()
        some += len(found.jump)
    assert some > 2


def test_any_number_of_zeros_has_room():
    """1,000 zeros of a sine in a hundred steps, more than a call has room for, lie right."""
    motion, kernel = run("spring")
    search = crossing_search(SPRING, parse_watch("many", ca.sin(20 * np.pi * (SPRING.t + 0.01))))
    found = crossings_by(kernel, search, motion[:101], {})
    assert np.allclose(found.after.t, 0.05 * np.arange(1000) + 0.04, rtol=0, atol=1e-12)


def test_watched_controls_and_driven_contacts_go_to_the_other_search(monkeypatch):
    """It is asked where the loop in C does not know the motion."""
    asked = []
    other = native_crossings.find_crossings
    monkeypatch.setattr(native_crossings, "find_crossings", lambda *x: asked.append(1) or other(*x))
    q, v = vi.coordinates("z")
    push = ca.SX.sym("push")
    driven = vi.System(q, v, v**2 / 2 - q**2 / 2, control=push, force=push)
    ball = vi.System(q, v, v**2 / 2 - q, contact=q, restitution=0.5, control=push, force=push)
    for system, watched in ((driven, q - 0.5 + push), (ball, q - 0.5)):
        motion = vi.simulate(
            system, q0=1, v0=0, h=0.01, steps=200, events={"half": watched}, u=[0.0]
        )
        assert asked and any(event.kind == "half" for event in motion.events)
        asked.clear()


@pytest.mark.parametrize("radius", (0.3, 1.0, 1.5))
def test_a_node_where_the_slope_is_none_hides_no_zero(radius):
    """A distance has no slope where it is zero, and one there: x/√x in place of √x is none."""
    q, v = vi.coordinates("x", "y")
    free = vi.System(q, v, ca.sumsqr(v) / 2)
    rim = ca.norm_2(q - ca.DM([10.0, 0.0])) - radius
    start = {"q0": [0.0, 0.0], "v0": [1.0, 0.0], "duration": 20.0}
    motion = vi.simulate(free, **start, events={"rim": rim})
    assert (motion.q == [10.0, 0.0]).all(axis=1).any()  # a node
    times = [event.time for event in motion.events]
    np.testing.assert_allclose(times, [10 - radius, 10 + radius], rtol=1e-13)
    assert abs(vi.simulate(free, **start, until=rim).t[-1] - 10 + radius) < 1e-12


@pytest.mark.parametrize("radius", (1.16e-5, 4.26e-5, 1e-3))
def test_a_small_body_on_the_way_is_met(radius):
    """A probe on a circular orbit meets a disc of the Moon's size in astronomical units, whose
    distance has a kink that is ten thousand times narrower than a step.
    """
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    start = {"q0": [1.0, 0.0], "v0": [0.0, 1.0], "duration": 2.5}
    rim = ca.norm_2(q - ca.DM([np.cos(2.0), np.sin(2.0)])) - radius
    exact = [2.0 - 2 * np.arcsin(radius / 2), 2.0 + 2 * np.arcsin(radius / 2)]
    motion = vi.simulate(system, **start, events={"rim": rim})
    np.testing.assert_allclose([event.time for event in motion.events], exact, atol=1e-9)
    assert abs(vi.simulate(system, **start, until=rim).t[-1] - exact[0]) < 1e-9
    found = find_crossings(crossing_search(system, parse_watch("rim", rim)), motion, {})
    np.testing.assert_allclose(found.before.t, exact, atol=1e-9)


def test_narrow_dips_of_quick_expressions_are_found():
    """956 of them in sixteen steps."""
    q, v = vi.coordinates("x")
    t = vi.time()
    system = vi.System(q, v, v**2 / 2 + ca.cos(q), t=t)
    motion = vi.simulate(
        system, q0=1.0, v0=0.0, duration=10.0, events={"dip": ca.sin(300 * t) - 0.9999}
    )
    turns = 2 * np.pi * np.arange(480)
    exact = np.append(np.arcsin(0.9999) + turns, np.pi - np.arcsin(0.9999) + turns) / 300
    exact = np.sort(exact[exact < 10])
    np.testing.assert_allclose([event.time for event in motion.events], exact, atol=1e-12)
