"""Budgets: what integrals may be and states end with, their prices, and what stands in the way."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, move

import varint as vi


def test_the_price_of_a_budget_is_the_derivative_of_the_least_time():
    """With ∫u² = 12 d²/T³ ≤ B the least time is T = (12 d²/B)^⅓: dT/dB = −T/(3 B)."""
    budget = "integral of sq(u) <= 12"
    motion = move(vi.gauss(2), 8, vi.free(1, 0.1, 9), cost=1, integral=[(0, U**2, 12)])
    found = motion.solution.sensitivity(budget, "integral of sq(u) >= 0", "end.q.x")
    assert found.cost == pytest.approx([-1 / 36, 0, 2 / 3], abs=1e-9)
    assert found.duration[0] == pytest.approx(-1 / 36, abs=1e-9)
    assert budget in motion.solution.sensitivity().names


def test_a_budget_that_does_not_suffice_is_named():
    """From 0 to 1 within 2 from rest to rest takes ∫u² = 3/2; with 1 it goes √(2/3) at most."""
    with pytest.raises(vi.SolverError, match="contradict each other") as caught:
        move(vi.gauss(2), 8, 2.0, integral=[(0, U**2, 1)])
    found = caught.value.contradiction
    name, size, _ = found.broken[0]
    assert name == "end.q.x = 1" and size == pytest.approx(np.sqrt(2 / 3) - 1, abs=1e-4)
    assert "integral of sq(u) in 0 … 1" in dict(found.opposed)


def rocket(first=1.0, last=0.5, **given) -> vi.Trajectory:
    """Mass m, thrust u, dm/dt = −u/2, no gravity: the speed reached is 2 log(m0/m)."""
    q, v = vi.coordinates("x")
    m = ca.SX.sym("m")
    system = vi.System(q, v, v**2 / 2, force=U / m, control=ca.vertcat(U, m))
    given = dict(terminal_cost=-v, states={m: -U / 2}, bounds=[(0, U, 1.5)]) | given
    start = dict(q=[0], v=[0], states={m: first})
    end = dict(states={m: last}) | given.pop("end", {})
    return vi.optimal_control(
        system, vi.gauss(3), duration=1.0, steps=16, start=start, end=end, **given
    )


def test_the_cost_changes_with_the_states_at_the_ends_as_in_the_rockets_equation():
    found = rocket().solution.sensitivity("start.states.m", "end.states.m")
    assert found.cost == pytest.approx([-2, 4], rel=1e-6)


def test_states_at_the_ends_that_cannot_be_reached_are_named():
    """A thrust of at most 1/2 burns a quarter of what shall be burnt."""
    with pytest.raises(vi.SolverError) as caught:
        rocket(bounds=[(0, U, 0.25)])
    found = caught.value.contradiction
    assert found.broken[0][0] in ("end.states.m = 0.5", "u in 0 … 0.25")
    names = {name for name, *_ in (*found.broken, *found.opposed)}
    assert {"end.states.m = 0.5", "start.states.m = 1", "u in 0 … 0.25"} <= names


@pytest.mark.parametrize("first, last, named", [(1.0, 0.5, "end has m = 0.5"), (2, 0.8, "start")])
def test_states_at_the_ends_lie_within_their_bounds(first, last, named):
    q, v = vi.coordinates("x")
    m = ca.SX.sym("m")
    system = vi.System(q, v, v**2 / 2, force=U / m, control=ca.vertcat(U, m))
    with pytest.raises(vi.InputError, match=rf"the {named}.*outside its bounds 0\.7 … 1\.5"):
        vi.optimal_control(
            system,
            duration=1.0,
            steps=4,
            cost=U**2,
            states={m: -U / 2},
            bounds=[(0.7, m, 1.5)],
            start=dict(q=[0], v=[0], states={m: first}),
            end=dict(states={m: last}),
        )


@pytest.mark.long
def test_a_search_that_finds_no_motion_is_explained_too(capfd):
    """Goddard's rocket is asked for a height of 1.02 and reaches 1.01283. Solvers find no
    motion; rounding decides whether they find that there is none, or take as many iterations as
    they may. Both are explained; nothing but the error is said, not by simulations that leave all
    bounds on the way either.
    """
    q, v = vi.coordinates("height")
    thrust, mass = ca.SX.sym("thrust"), ca.SX.sym("mass")
    drag = 310 * v**2 * ca.exp(-500 * (q - 1))
    force, lagrangian = (thrust - drag) / mass, v**2 / 2 + 1 / q
    system = vi.System(q, v, lagrangian, force=force, control=ca.vertcat(thrust, mass))
    ended = "(Maximum_Iterations_Exceeded|Infeasible_Problem_Detected): no motion that keeps"
    with pytest.raises(vi.SolverError, match=ended) as caught:
        vi.optimal_control(
            system,
            vi.gauss(3),
            duration=vi.free(0.2, 0.05, 1),
            steps=30,
            cost=0,
            terminal_cost=-q,
            states={mass: -2 * thrust},
            start=dict(q=[1], v=[0], states={mass: 1.0}),
            end=dict(q=[1.02], states={mass: 0.6}),
            bounds=[(0, thrust, 3.5)],
        )
    name, size, _ = caught.value.contradiction.broken[0]
    assert name == "end.q.height = 1.02" and size == pytest.approx(1.01283 - 1.02, abs=3e-4)
    assert "WARNING" not in "".join(capfd.readouterr())
