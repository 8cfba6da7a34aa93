"""Compiled and interpreted runs answer alike: the same motion, or an error at the same step."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from scenes import double_pendulum, henon_heiles

import varint as vi
from varint.codegen.cache import compiler

pytestmark = [
    pytest.mark.skipif(compiler() is None, reason="no C compiler"),
    pytest.mark.filterwarnings("ignore:the energy"),
]

STIFF = [
    (a, b, h)
    for a, b in ((50, 10), (500, 100), (5000, 1000), (5000, 0), (0, 1e5))
    for h in (0.02, 0.05, 0.2)
]
STEPS = 40


@cache
def duffing(n):
    """L = v²/2 − a q² − b q⁴, in two coordinates coupled."""
    q, v = vi.coordinates(*"xy"[:n])
    c = vi.Parameters(a=1.0, b=1.0)
    potential = c.a * ca.sumsqr(q) + c.b * ca.sumsqr(q) ** 2
    if n == 2:
        potential += 0.3 * c.a * q[0] * q[1]
    return vi.System(q, v, ca.sumsqr(v) / 2 - potential, params=c)


def outcome(n, rule, a, b, h, backend, **options):
    """The motion, or the step at which there is none and the nodes before it."""
    start = {"q0": [1.0, 0.4][:n], "v0": np.zeros(n), "params": {"a": a, "b": b}}
    options = {"steps": STEPS} | start | options
    try:
        motion = vi.simulate(duffing(n), rule, h=h, backend=backend, **options)
    except vi.ConvergenceError as error:
        return error.step, error.trajectory
    return None, motion


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("stages", (2, 4, 8))
@pytest.mark.parametrize("n", (1, 2))
def test_stiff_oscillators_move_or_fail_alike_in_both_gears(n, stages):
    """Where fixed-point iteration overflows Newton's method takes over; hω reaches 100 here."""
    solved = 0
    for a, b, h in STIFF:
        (failed, motion), (failed_too, other) = (
            outcome(n, vi.gauss(stages), a, b, h, backend)
            for backend in ("interpreted", "compiled")
        )
        assert failed == failed_too, (a, b, h)
        assert len(motion) == len(other)
        solved += failed is None
        np.testing.assert_allclose(other.q, motion.q, rtol=0, atol=2e-9)
    assert solved >= 10


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("stages", (2, 4, 8))
def test_steps_far_longer_than_a_period_are_solved_to_round_off(stages):
    """A step forth and one back end where they began, however stiff: the sizes by which Newton's
    method stops are those of the motion, not of what the force at the start would do in a step.
    """
    step = vi.step_function(duffing(2), vi.gauss(stages))
    none, solved = np.zeros((0, stages)), 0
    for a, b, h in STIFF:
        there = step(q0=[1.0, 0.4], p0=[0, 0], u=none, params=[a, b], t=0, h=h)
        back = step(q0=there["q1"], p0=there["p1"], u=none, params=[a, b], t=h, h=-h)
        if max(float(there["residual"]), float(back["residual"])) > 1e-10:
            continue
        solved += 1
        end = np.array(back["q1"]).ravel()
        if np.abs(end - [1.0, 0.4]).max() < 0.01:  # no other solution
            np.testing.assert_allclose(end, [1.0, 0.4], rtol=0, atol=1e-10)
    assert solved >= 8


def walled():
    """The force is not a number left of x = 0."""
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - q + ca.sqrt(q))


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("backend", ("interpreted", "compiled"))
def test_a_step_that_fails_between_two_saved_nodes_is_named(backend):
    """And what lies before it is the same however many nodes are kept."""
    found = []
    for every in (1, 10):
        with pytest.raises(vi.ConvergenceError) as caught:
            vi.simulate(
                walled(),
                vi.gauss(4),
                q0=0.3,
                v0=-2.0,
                h=0.0043,
                steps=200,
                save_every=every,
                backend=backend,
            )
        found.append(caught.value)
    step, motion, kept = found[0].step, found[0].trajectory, found[1].trajectory
    assert found[1].step == step and step > 20 and step % 10
    assert kept.k.tolist() == list(range(0, step, 10))
    np.testing.assert_allclose(kept.q, motion.q[::10], rtol=0, atol=1e-12)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_where_no_step_is_possible_both_gears_raise_the_same_error():
    """As where the motion reaches x = 0 in the third step."""
    errors = []
    for backend in ("interpreted", "compiled"):
        with pytest.raises(vi.ConvergenceError) as caught:
            vi.simulate(walled(), vi.gauss(4), q0=0.3, v0=-2.0, h=0.06, steps=50, backend=backend)
        errors.append(caught.value)
    assert errors[0].step == errors[1].step > 0
    assert np.isnan(errors[0].residual) == np.isnan(errors[1].residual)
    np.testing.assert_allclose(errors[0].trajectory.q, errors[1].trajectory.q, rtol=0, atol=1e-12)


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_drawn_stiff_oscillators_end_alike_in_every_gear():
    """Where the energy leaps and a later step has no solution the run ends before the leap: which
    of the later steps that is depends on the way to their solutions.
    """
    rng, astray = np.random.default_rng(14), 0
    rules = [vi.gauss(1), vi.gauss(2), vi.gauss(4), vi.lobatto(3), vi.lobatto(4)]
    for i in range(25):
        a, b, h = 10 ** rng.uniform((1, 0, -2.3), (5, 5, -0.3))
        start = {"q0": rng.uniform(0.3, 2, 1), "v0": 10 * rng.normal(size=1)}
        ends = []
        for backend in ("interpreted", "native"):
            case = 1, rules[i % 5], a, b, h, backend
            ends.append(outcome(*case, **start, steps=100))
        (failed, motion), (failed_too, other) = ends
        assert failed == failed_too
        assert len(motion) == len(other)
        if failed is not None:
            astray += 1
            np.testing.assert_allclose(other.q, motion.q, rtol=1e-8, atol=1e-8)
    assert astray > 4


def charge_in_a_field():
    """Linear: bound in a plane, a magnetic field across it, pulled along x."""
    q, v = vi.coordinates("x", "y")
    magnetic = 0.75 * (q[0] * v[1] - q[1] * v[0])
    bound = (q[0] ** 2 + q[0] * q[1] + q[1] ** 2) / 2 - 0.3 * q[0]
    return vi.System(q, v, ca.sumsqr(v) / 2 + magnetic - bound)


def test_large_linear_scenes_are_solved_to_round_off_compiled_as_interpreted():
    """The factors are the same in every step, so their round-off would add up in one direction."""
    run = dict(q0=[1, 0.5], v0=[0.3, 1], h=0.02, steps=1000)
    rule = vi.gauss(7)  # 14 unknowns: more than a constant map is made for
    ours, other = (
        vi.simulate(charge_in_a_field(), rule, **run, backend=backend)
        for backend in ("compiled", "interpreted")
    )
    assert "factorised once" in ours.stats["backend"]
    assert np.abs(ours.q - other.q).max() < 1e-14
    assert np.abs(ours.energy - ours.energy[0]).max() < 1e-14


@pytest.mark.parametrize(
    ("scene", "rule"),
    [
        (charge_in_a_field, vi.gauss(2)),
        (charge_in_a_field, vi.gauss(7)),
        (lambda: duffing(2), vi.gauss(2)),
        (lambda: duffing(2), vi.lobatto(3)),
    ],
    ids=["map", "linear", "stages", "newton"],
)
def test_compiled_runs_state_the_residual_that_they_leave(rule, scene):
    """Not zero, which no sum of rounded terms is, and no more than round-off."""
    run = dict(q0=[1, 0.5], v0=[0.3, 1], h=0.05, steps=200)
    motion = vi.simulate(scene(), rule, **run, backend="compiled")
    assert 1e-18 < motion.stats["residual"] < 1e-12


@pytest.mark.parametrize("every", (1, 4))
@pytest.mark.parametrize("scene", (double_pendulum, henon_heiles))
def test_a_short_run_in_one_call_is_bitwise_the_run_in_blocks(scene, every):
    """What is watched goes block by block, what is not in one call of its loop."""
    start = dict(q0=[0.4, 0.2], v0=[0.1, 0.0], h=0.01, steps=40, save_every=every)
    one = vi.simulate(scene(), vi.gauss(3), **start, backend="compiled")
    watched = vi.simulate(scene(), vi.gauss(3), **start, backend="compiled", progress=True)
    for array in ("t", "q", "p", "k"):
        assert getattr(one, array).tobytes() == getattr(watched, array).tobytes()
    same = ("backend", "steps", "iterations", "interrupted", "residual")
    assert [one.stats[x] for x in same] == [watched.stats[x] for x in same]
    assert (one.h, one.origin, one.events) == (watched.h, watched.origin, watched.events)
