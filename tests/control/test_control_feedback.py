"""Predictive control beside what it was built for: states outside bounds, set-points that move."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from control_scenes import U

import varint as vi


def cart(bounds, cost=None, duration=2.0, steps=20, **given) -> tuple[vi.System, vi.Phase]:
    q, v = vi.coordinates("x")
    c = vi.Parameters(target=0.0, mass=1.0)
    system = vi.System(q, v, c.mass * v**2 / 2, force=U, control=U, params=c)
    limits = [(-2, U, 2)]
    limits += [(lower, dict(q=q, v=v, sum=q + v)[name], upper) for lower, name, upper in bounds]
    price = (q - c.target) ** 2 + 0.1 * v**2 + 0.01 * U**2 if cost is None else cost
    return system, vi.Phase(system, vi.gauss(2), duration, steps, price, bounds=limits, **given)


@pytest.mark.parametrize(
    ("bounds", "state", "least"),
    [
        ([(-1, "v", 1)], (1.0, -1.2), 0.2),  # too fast
        ([(-1, "q", 1)], (1.3, 0.0), 0.3),  # outside
        ([(-1, "q", 1)], (0.9, 1.0), 0.15),  # inside, but cannot stop in time: v²/2a = 0.25
        ([(None, "sum", 0.5)], (0.5, 0.4), 0.4),  # an expression of both
    ],
)
def test_a_state_that_cannot_keep_its_bounds_gets_a_plan_that_returns(bounds, state, least):
    _, phase = cart(bounds)
    controller = vi.mpc(phase)
    plan = controller([state[0]], [state[1]])
    softened = plan.stats["softened"]
    assert softened and max(softened.values()) == pytest.approx(least, abs=0.06)
    low, name, high = bounds[0]
    values = dict(q=plan.q[:, 0], v=plan.v[:, 0], sum=plan.q[:, 0] + plan.v[:, 0])[name]
    off = np.maximum(values - high, -np.inf if low is None else low - values)
    assert off[10:].max() < 1e-6  # back within a second, and to stay
    assert np.abs(plan.u).max() <= 2 + 1e-9
    assert np.abs(plan.replay().q - plan.q).max() < 1e-9


def test_a_violation_is_no_longer_than_it_must_be():
    """Outside by 0.3 at rest: back by full force, half the way to brake, is the fastest return."""
    _, phase = cart([(-1, "q", 1)])
    plan = vi.mpc(phase)([1.3], [0.0])
    back = plan.t[np.argmax(plan.q[:, 0] <= 1 + 1e-6)]
    assert back == pytest.approx(np.sqrt(2 * 0.3 / 2), abs=0.11)  # one step


def test_bounds_that_can_be_kept_are_kept_and_cost_what_they_cost_before():
    _, phase = cart([(-0.5, "v", 0.5)])
    controller = vi.mpc(phase)
    plan = controller([1.0], [0.0])
    assert "softened" not in plan.stats
    assert plan.v.min() >= -0.5 - 1e-9
    elastic, solver = controller._elastic
    start = elastic.start(plan.solution.origin.outcome.x)
    low, high = controller.problem.nlp.x_low.copy(), controller.problem.nlp.x_high.copy()
    slots = controller.problem.phases[0].slots
    low[slots.q[0]] = high[slots.q[0]] = 1.0
    low[slots.v[0]] = high[slots.v[0]] = 0.0
    z_low, z_high = elastic.bounds(low, high)
    exact = solver(start, x_low=z_low, x_high=z_high, progress=False)
    assert np.abs(elastic.excess(exact.x)).max() < 1e-8  # the penalty is exact
    assert elastic.result(exact, elastic.nlp.p).cost == pytest.approx(plan.cost, rel=1e-7)


def test_a_noisy_speed_beyond_its_bound_does_not_lose_the_loop(capsys):
    _, phase = cart([(-0.6, "v", 0.6)])
    controller = vi.mpc(phase)
    noise = np.random.default_rng(3).normal(scale=0.15, size=(40, 1))
    motion, plans = vi.closed_loop(controller, [1.5], [0.0], 40, disturbance=noise)
    softened = [plan for plan in plans if "softened" in plan.stats]
    assert len(plans) == 40 and 1 <= len(softened) < 40
    assert np.abs(motion.v).max() > 0.6
    assert abs(motion.q[-1, 0]) < 0.3
    softened[0].report()
    assert "softened" in capsys.readouterr().out


def test_set_points_and_parameters_change_at_run_time():
    _, phase = cart([])
    controller = vi.mpc(phase)
    motion, plans = vi.closed_loop(
        controller, [0.0], [0.0], 60, params=lambda t: dict(target=1.0 if t < 2.95 else -1.0)
    )
    assert motion.q[29, 0] == pytest.approx(1, abs=0.05)
    assert motion.q[-1, 0] == pytest.approx(-1, abs=0.05)
    assert float(plans[-1].parameters["target"]) == -1.0
    rebuilt = vi.Phase(**{**vars(phase), "params": dict(target=0.4, mass=3.0)})
    expected = vi.mpc(rebuilt)([0.2], [0.1])
    found = controller([0.2], [0.1], params=dict(target=0.4, mass=3.0))
    assert found.cost == pytest.approx(expected.cost, rel=1e-9)
    assert found.q == pytest.approx(expected.q, abs=1e-7)


def test_velocities_are_those_of_the_motion_when_the_mass_changes_on_the_way():
    """Each plan begins with the velocity to which the motion came under the mass of before."""
    _, phase = cart([])
    motion, plans = vi.closed_loop(
        vi.mpc(phase), [1.0], [0.5], 6, params=lambda t: dict(mass=1.0 + 10 * t)
    )
    starts = np.array([plan.v[0] for plan in plans])
    assert [float(plan.parameters["mass"]) for plan in plans] == pytest.approx(1 + np.arange(6))
    assert motion.v[:-1] == pytest.approx(starts, rel=1e-12)
    assert motion.v[-1] == pytest.approx(plans[-1].v[1], rel=1e-7)


def test_the_loop_moves_with_the_parameters_of_the_phase():
    _, phase = cart([], params=dict(mass=4.0))
    motion, plans = vi.closed_loop(vi.mpc(phase), [1.0], [0.0], 5)
    assert motion.q[1] == pytest.approx(plans[0].q[1], abs=1e-10)


def test_senseless_states_and_parameters_are_refused():
    _, phase = cart([(-1, "v", 1)], params=dict(mass=vi.free(1.0, 0.5, 2.0)))
    controller = vi.mpc(phase)
    for state in ([np.nan], [1.0, 2.0], ["a"]):
        with pytest.raises(vi.InputError):
            controller(state, [0.0])
    with pytest.raises(vi.InputError, match="unknown parameters"):
        controller([0.0], [0.0], params=dict(aim=1.0))
    with pytest.raises(vi.InputError, match="free"):
        controller([0.0], [0.0], params=dict(mass=1.0))
    with pytest.raises(vi.InputError, match="dictionary"):
        vi.closed_loop(controller, [0.0], [0.0], 2, params=3.0)


def test_a_loop_without_a_plan_keeps_its_motion():
    """An end that is out of reach is never softened; the motion until then is not lost."""
    _, phase = cart([(-1, "v", 1)], duration=1.0, steps=10, end=dict(q=[0.0], v=[0.0]))
    kicks = np.zeros((10, 1))
    kicks[4] = 3.0
    with pytest.raises(vi.SolverError, match=r"step 5 of 10.*until then") as caught:
        vi.closed_loop(vi.mpc(phase), [0.1], [0.0], 10, disturbance=kicks)
    assert len(caught.value.iterate) == 6


def test_states_with_constraints_outside_a_bound_get_a_plan():
    q, v = vi.coordinates("x", "y")
    torque = U * ca.vertcat(-q[1], q[0])
    rod = vi.System(
        q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(q) - 1, force=torque, control=U
    )
    phase = vi.Phase(
        rod,
        vi.lobatto(3),
        1.0,
        12,
        (q[1] + 1) + 0.1 * ca.sumsqr(v) + 0.001 * U**2,
        bounds=[(-20, U, 20), (-0.3, q[0], 0.3)],
    )
    angle = 0.5
    plan = vi.mpc(phase)([np.sin(angle), -np.cos(angle)], [0.0, 0.0])
    assert plan.stats["softened"]["x above"] == pytest.approx(np.sin(angle) - 0.3, abs=0.1)
    assert np.abs(plan.q[6:, 0]).max() <= 0.3 + 1e-6
    assert np.abs((plan.q**2).sum(axis=1) - 1).max() < 1e-9
