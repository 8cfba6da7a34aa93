"""Control of constrained scenes: rods and closed loops cost what their reduced form costs; guesses
are brought onto g = 0.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, coarse, pendulum, replay_defect, rod_swing, swing

import varint as vi
from varint.control.constrained_guess import move_onto_constraints
from varint.control.guess import build_start
from varint.control.problem import transcribe

models = vi.models


@pytest.mark.parametrize("stages", [3, 4])
def test_particle_on_a_rod_costs_what_the_pendulum_costs_to_the_order_of_the_rule(stages):
    exact = swing(pendulum(9.81), 3.0, 40).cost
    errors = [abs(rod_swing(vi.lobatto(stages), steps).cost - exact) for steps in (20, 40)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * stages - 2, abs=0.25)
    assert errors[1] < 2e-5 * exact if stages == 4 else 1e-3 * exact


def test_constraints_hold_in_positions_and_velocities_and_multipliers_are_the_tension():
    motion = rod_swing(vi.lobatto(4), 40)
    q, v = motion.q, motion.v
    assert np.abs((q**2).sum(axis=1) - 1).max() < 1e-12
    assert np.abs((q * v).sum(axis=1)).max() < 1e-11
    tension = (v**2).sum(axis=1) - 9.81 * q[:, 1]
    assert -2 * motion.multipliers[:, 0] == pytest.approx(tension, abs=1e-10)
    assert replay_defect(motion) < 1e-9


@pytest.fixture(scope="module")
def reduced():
    return models.carried_load_reduced(steps=30).solve()[0]


@pytest.mark.parametrize(("stages", "steps"), [(2, 20), (3, 10), (4, 20)])
@coarse
def test_two_arms_with_a_load_cost_what_the_load_alone_costs_to_the_order_of_the_rule(
    stages, steps, reduced
):
    errors = [
        abs(models.carried_load(steps=n, stages=stages).solve()[0].cost - reduced.cost)
        for n in (steps, 2 * steps)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2 * (stages - 1), abs=0.3)


def test_a_closed_loop_keeps_its_constraints_replays_and_moves_like_its_reduced_form(reduced):
    [loop] = models.carried_load(steps=30).solve()
    s = loop.system
    hidden = ca.Function("hidden", [s.q, s.v], [s.constraint, ca.jtimes(s.constraint, s.q, s.v)])
    for gap in hidden.map(len(loop))(loop.q.T, loop.v.T):
        assert np.abs(np.array(gap)).max() < 1e-10
    assert loop.q[:, 4:] == pytest.approx(reduced.q, abs=1e-8)
    assert loop.u[5] == pytest.approx(loop.solution.u(np.array(loop.rule.nodes) / 30 + 5 / 30))
    assert replay_defect(loop) < 1e-9


def _slider_crank() -> tuple[vi.System, vi.System]:
    """Crank angle, rod angle and slider as coordinates closed by two constraints; and the crank
    angle alone.
    """
    r, rod, m, inertia = 0.5, 1.2, 1.5, 0.2

    def lagrangian(angle, tilt, x, q, v):
        rates = [ca.jtimes(y, q, v) for y in (angle, tilt, x)]
        return (
            inertia * rates[0] ** 2 / 2
            + 0.1 * rates[1] ** 2 / 2
            + m * rates[2] ** 2 / 2
            - 2.0 * ca.sin(angle)
        )

    q, v = vi.coordinates("crank", "rod", "slider")
    closed = ca.vertcat(
        r * ca.cos(q[0]) + rod * ca.cos(q[1]) - q[2], r * ca.sin(q[0]) + rod * ca.sin(q[1])
    )
    loop = vi.System(
        q,
        v,
        lagrangian(q[0], q[1], q[2], q, v),
        constraint=closed,
        force=ca.vertcat(U, 0, 0),
        control=U,
    )
    p, w = vi.coordinates("crank")
    tilt = -ca.asin(r * ca.sin(p) / rod)
    alone = vi.System(
        p, w, lagrangian(p, tilt, r * ca.cos(p) + rod * ca.cos(tilt), p, w), force=U, control=U
    )
    return loop, alone


def test_a_crank_is_turned_past_both_dead_centres_from_a_straight_guess():
    """The ends are given by the crank's angle alone: rod and slider follow from the constraints."""
    loop, alone = _slider_crank()
    ends = [dict(q=[x, None, None], v=[0, None, None]) for x in (0.4, 0.4 + 2 * np.pi)]
    both = dict(duration=1.5, cost=U**2)
    one = vi.optimal_control(
        loop,
        vi.lobatto(4),
        steps=50,
        start=ends[0] | dict(bounds=[(0, loop.q[2], None)]),
        end=ends[1],
        **both,
    )
    two = vi.optimal_control(
        alone,
        vi.gauss(4),
        steps=50,
        start=dict(q=[0.4], v=[0]),
        end=dict(q=[0.4 + 2 * np.pi], v=[0]),
        **both,
    )
    assert one.cost == pytest.approx(two.cost, rel=1e-6)
    assert one.q[:, 0] == pytest.approx(two.q[:, 0], abs=1e-5)


@pytest.mark.parametrize("name", ["swing_up_rod", "walker", "carried_load"])
def test_default_guesses_keep_to_the_constraints_and_do_not_jump(name):
    """The straight line of the rod even passes the centre of its circle, as far from one side as
    from the other.
    """
    model = vi.models.control_catalogue[name]()
    phase = replace(model.phases[0], guess=None)
    one = transcribe([phase], [], 0.0)
    x, slots, s = build_start(one), one.phases[0].slots, phase.system
    gap = ca.Function("gap", [s.q], [s.constraint])
    for q in (x[slots.q], x[slots.inner].reshape(-1, x[slots.q].shape[1])):
        assert np.abs(np.array(gap.map(len(q))(q.T))).max() < 1e-8
    apart = np.linalg.norm(np.diff(x[slots.q], axis=0), axis=1)
    assert apart.max() <= 4 * apart.mean()


def test_constrained_scenes_are_solved_from_the_default_guess():
    known = models.swing_up_rod(20, 3)
    [told] = known.solve()
    [alone] = vi.optimal_phases([replace(known.phases[0], guess=None)])
    assert abs(alone.cost / told.cost - 1) < 1e-9


def test_points_that_cannot_be_brought_onto_the_constraints_stay_where_they_are():
    q, v = vi.coordinates("x", "y")
    circle = vi.System(q, v, ca.sumsqr(v) / 2, constraint=ca.sumsqr(q) - 1)
    given = np.array([[0.0, 0.0], [2.0, 0.0], [0.6, 0.8]])
    found, fits = move_onto_constraints(circle, given, np.zeros(3), np.zeros(0))
    assert fits.tolist() == [False, True, True]
    assert found == pytest.approx(np.array([[0, 0], [1, 0], [0.6, 0.8]]), abs=1e-12)
    held, fits = move_onto_constraints(
        circle,
        given[1:2] * [0.3, 1] + [0, 0.1],
        np.zeros(1),
        np.zeros(0),
        np.array([[False, True]]),
    )
    assert fits.all()
    assert held == pytest.approx(np.array([[0.6, 0.8]]))


def test_predictive_control_balances_a_particle_on_its_rod():
    scene = models.swing_up_rod().phases[0].system
    top = ca.sumsqr(scene.q - ca.DM([0, 1])) + ca.sumsqr(scene.v) / 10
    controller = vi.mpc(vi.Phase(scene, vi.lobatto(3), 1.0, 15, top + 0.01 * scene.control**2))
    start = np.array([np.sin(2.8), -np.cos(2.8)])
    motion, plans = vi.closed_loop(controller, start, [0.0, 0.0], 25)
    assert motion.q[-1] == pytest.approx([0, 1], abs=0.02)
    assert np.abs((motion.q**2).sum(axis=1) - 1).max() < 1e-10
    assert plans[0].q[0] == pytest.approx(start, abs=1e-12)
    with pytest.raises(vi.InputError, match="q violates constraint 0"):
        controller([1.0, 1.0], [0, 0])
    with pytest.raises(vi.InputError, match="G v = 0 of constraint 0"):
        controller([0.0, -1.0], [0, 1.0])


@coarse
def test_ranks_of_constraints_are_judged_where_they_hold():
    """At q = 0, where a free end's guess lies, the circle's constraint has no gradient."""
    scene = models.swing_up_rod().phases[0].system
    cost = scene.control**2 + scene.q[1] + ca.sumsqr(scene.v)
    motion = vi.optimal_control(scene, duration=1.0, steps=10, cost=cost, end=dict(v=[0, 0]))
    assert np.abs(motion.q[-1]) == pytest.approx([0, 1], abs=1e-6)  # at rest, hanging or standing
    assert np.abs((motion.q**2).sum(axis=1) - 1).max() < 1e-10


def test_costates_of_a_constrained_scene_are_the_derivatives_of_the_cost_along_the_constraint():
    phase = models.swing_up_rod(30, 4).phases[0]
    angle, rate, step = 0.3, 0.4, 1e-5

    def solve(angle, rate, guess=None):
        there, along = (
            np.array([np.sin(angle), -np.cos(angle)]),
            np.array([np.cos(angle), np.sin(angle)]),
        )
        start = dict(q=there.tolist(), v=(rate * along).tolist())
        return vi.optimal_phases([replace(phase, start=start, guess=guess or phase.guess)])[0]

    base = solve(angle, rate)
    along, across = (
        np.array([np.cos(angle), np.sin(angle)]),
        np.array([-np.sin(angle), np.cos(angle)]),
    )
    q, p = base.costates.q[0], base.costates.p[0]
    by_angle = solve(angle + step, rate, base).cost - solve(angle - step, rate, base).cost
    by_rate = solve(angle, rate + step, base).cost - solve(angle, rate - step, base).cost
    # v turns with the rod
    assert by_angle / (2 * step) == pytest.approx(q @ along + rate * p @ across, rel=1e-6)
    assert by_rate / (2 * step) == pytest.approx(p @ along, rel=1e-6)
