"""Soft bounds, |u|, largest values and slacks: exact penalties against closed forms."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from control_scenes import U, coarse, move, particle, pendulum, replay_defect

import varint as vi

SLOPE = 12.0  # of −μ in s = 1 − 2t, for the three-part controls below


def _soft_move(bound: float, weight: float) -> tuple[float, float]:
    """Distance and ∫u² of the transfer in unit time whose costate is −μ = 12 s, s = 1 − 2t, where
    |u| ≤ bound costs weight × violation: u = 6 s up to the bound, the bound until 12 s = 2 bound +
    weight, then (12 s − weight)/2 (Pontryagin); the distance is ½ ∫₀¹ u s ds.
    """
    a, b = min(2 * bound / SLOPE, 1), min((2 * bound + weight) / SLOPE, 1)
    pieces = [(0, a, SLOPE / 2, 0.0), (a, b, 0.0, bound), (b, 1, SLOPE / 2, -weight / 2)]
    distance = cost = 0.0
    for low, high, slope, level in pieces:
        distance += slope * (high**3 - low**3) / 6 + level * (high**2 - low**2) / 4
        cost += slope**2 * (high**3 - low**3) / 3 + slope * level * (high**2 - low**2)
        cost += level**2 * (high - low)
    return distance, cost


def _priced(motion, bound, weight):
    """∫ weight × violation of |u| ≤ bound by the rule's nodes."""
    excess = np.maximum(np.abs(motion.u) - bound, 0)
    return weight * motion.h * (excess[..., 0] @ np.array(motion.rule.weights)).sum()


def test_weight_below_the_multiplier_gives_the_relaxed_solution_of_the_theory():
    bound, weight = 3.0, 3.6  # the parts meet at s = 1/2 and 4/5: ends of steps
    distance, square = _soft_move(bound, weight)
    motion = move(
        vi.gauss(2), 20, end=dict(q=[distance], v=[0]), bounds=[vi.soft(U, -bound, bound, weight)]
    )
    peak = (SLOPE - weight) / 2
    excess = 2 * weight * (peak - bound) * 0.2 / 2 / 2  # two triangles of base 0.2 in s
    assert motion.cost == pytest.approx(square + excess, rel=1e-10)
    assert motion.cost - _priced(motion, bound, weight) == pytest.approx(square, rel=1e-10)
    assert dict(motion.stats["softened"]) == pytest.approx(
        {"u below": np.abs(motion.u).max() - bound, "u above": np.abs(motion.u).max() - bound}
    )
    assert np.abs(motion.u).max() == pytest.approx(peak - 6 * 0.1 * motion.rule.nodes[0], rel=1e-8)
    assert replay_defect(motion) < 1e-10


def test_weight_above_the_multiplier_gives_the_hard_solution():
    hard = move(vi.gauss(3), 20, bounds=[(-5, U, 5)])
    most = np.abs(hard.costates.p).max() - 10  # of the bound's multiplier: |μ| − 2 bound
    for factor in (1.05, 4.0):
        soft = move(vi.gauss(3), 20, bounds=[vi.soft(U, -5, 5, factor * most)])
        assert soft.cost == pytest.approx(hard.cost, rel=1e-10)
        assert np.abs(soft.u - hard.u).max() < 1e-7
        assert not soft.stats["softened"]
    less = move(vi.gauss(3), 20, bounds=[vi.soft(U, -5, 5, 0.8 * most)])
    assert less.cost < hard.cost - 1e-4
    assert set(less.stats["softened"]) == {"u above", "u below"}


def test_soft_bounds_reach_what_hard_ones_cannot(capsys):
    motion = move(vi.gauss(2), 10, bounds=[vi.soft(U, -1, 1, 100.0)])
    with pytest.raises(vi.SolverError):
        move(vi.gauss(2), 10, bounds=[(-1, U, 1)])
    assert motion.q[-1, 0] == pytest.approx(1, abs=1e-12)
    motion.report()
    assert "softened             u above its bound, violated by" in capsys.readouterr().out


def test_soft_bounds_on_states_mix_with_hard_ones():
    v = particle().v
    both = [(-8, U, 8), vi.soft(v, None, 1.2, 30.0)]
    motion = move(vi.gauss(3), 20, bounds=both)
    # ∫ 30 (v − 1.2)₊ dt beside ∫ u² dt: u' jumps by 15 where v crosses 1.2
    fast = motion.v[:, 0] > 1.2
    assert fast.any() and not fast.all()
    assert motion.stats["softened"]["x_dot above"] == pytest.approx(motion.v.max() - 1.2, abs=2e-3)
    assert motion.cost < move(vi.gauss(3), 20, bounds=[(-8, U, 8), (None, v, 1.2)]).cost


def test_fuel_of_a_transfer_is_its_three_phase_closed_form():
    """|u| ≤ 1, T = 4, distance 3: full thrust for a second, coasting, braking; ∫|u| dt = 2."""
    motion = move(vi.gauss(2), 16, 4.0, cost=vi.abs(U), end=dict(q=[3], v=[0]), bounds=[(-1, U, 1)])
    assert motion.cost == pytest.approx(2.0, rel=1e-8)
    force = np.where(motion.t[:-1] < 1, 1.0, np.where(motion.t[:-1] < 3, 0.0, -1.0))
    assert np.abs(motion.u[..., 0] - force[:, None]).max() < 1e-6
    assert motion.solution.violation < 1e-9


def test_fuel_between_the_nodes_of_the_mesh_is_found_by_refinement():
    distance, duration = 2.3, 4.0
    burn = (duration - np.sqrt(duration**2 - 4 * distance)) / 2
    rough = move(
        vi.gauss(1),
        10,
        duration,
        cost=vi.abs(U),
        end=dict(q=[distance], v=[0]),
        bounds=[(-1, U, 1)],
    )
    fine = vi.refine(rough, 1e-5)
    assert fine.cost == pytest.approx(2 * burn, rel=1e-5)


def test_largest_of_several_costs_is_a_slack_of_ones_own():
    """max(u², 9) in the cost, and the same with a control that acts in cost and bounds only."""
    q, v = vi.coordinates("x")
    s = ca.SX.sym("s")
    own = vi.System(q, v, v**2 / 2, force=U, control=ca.vertcat(U, s))
    ends = dict(start=dict(q=[0], v=[0]), end=dict(q=[1], v=[0]))
    slack = vi.optimal_control(
        own,
        vi.gauss(2),
        duration=1,
        steps=20,
        cost=s,
        bounds=[(0, s - U**2, None), (9, s, None)],
        **ends,
    )
    largest = move(vi.gauss(2), 20, cost=vi.max(U**2, 9))
    assert largest.cost == pytest.approx(slack.cost, rel=1e-9)
    true = (
        largest.h * (np.maximum(largest.u[..., 0] ** 2, 9) @ np.array(largest.rule.weights)).sum()
    )
    assert largest.cost == pytest.approx(true, rel=1e-9)
    assert 12 < largest.cost < 15
    assert slack.u.shape == (20, 2, 2)
    assert slack.replay().q[-1] == pytest.approx(slack.q[-1], abs=1e-10)


def test_absolute_value_at_the_end_is_an_exact_penalty():
    """∫u² + w |x(1) − 1|, v(1) = 0: 24 x(1) = w until it reaches 1 (the cost of x is 12 x²)."""
    x = particle().q
    for weight, reached in ((12.0, 0.5), (18.0, 0.75), (30.0, 1.0)):
        motion = move(vi.gauss(2), 5, terminal_cost=weight * vi.abs(x - 1), end=dict(v=[0]))
        assert motion.q[-1, 0] == pytest.approx(reached, abs=1e-9)
        assert motion.cost == pytest.approx(12 * reached**2 + weight * (1 - reached), rel=1e-10)


def test_largest_values_inside_each_other_and_constant_controls():
    nested = vi.max(vi.abs(U) - 2, 0)
    motion = move(vi.gauss(2), 20, cost=U**2 + nested, control="constant")
    true = motion.u**2 + np.maximum(np.abs(motion.u) - 2, 0)
    assert motion.cost == pytest.approx(motion.h * true.sum(), rel=1e-9)


def test_solved_again_soft_bounds_say_what_they_are_violated_by_now():
    first = move(vi.gauss(2), 10, bounds=[vi.soft(U, -5, 5, 1.0)])
    again = first.again(end=dict(q=[0.7]))
    assert first.stats["softened"] and not again.stats["softened"]
    assert again.cost == pytest.approx(12 * 0.49, rel=1e-10)


def test_predictive_control_takes_soft_bounds_and_costs_with_kinks():
    q, v = particle().q, particle().v
    ahead = vi.Phase(
        particle(),
        vi.gauss(2),
        3.0,
        15,
        q**2 + v**2 + vi.abs(U),
        bounds=[(-1, U, 1), vi.soft(v, -0.5, 0.5, 50.0)],
    )
    plan = vi.mpc(ahead)([2.0], [0.0])
    [fresh] = vi.optimal_phases([replace(ahead, start=dict(q=[2.0], v=[0.0]))])
    assert plan.cost == pytest.approx(fresh.cost, rel=1e-8)


def _concave_along_the_path():
    return move(vi.gauss(2), 8, cost=U**2 + 0.1 * particle().q * vi.abs(U), end=dict(q=[-1], v=[0]))


@coarse
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: move(vi.gauss(2), 5, cost=U**2 - vi.abs(U)), "falls with abs"),
        (lambda: move(vi.gauss(2), 5, cost=vi.max(-vi.max(U, 0), 1)), r"falls with max\(u, 0\)"),
        (lambda: move(vi.gauss(2), 5, bounds=[(1, vi.abs(U), 1)]), r"\(-b, x, b\)"),
        (lambda: move(vi.gauss(2), 5, end=dict(bounds=[(0, vi.abs(particle().q), 1)])), "costs"),
        (lambda: move(vi.gauss(2), 5, cost=vi.abs(ca.SX.sym("w"))), "depends on"),
        (_concave_along_the_path, "falls with"),
        (
            lambda: vi.System(particle().q, particle().v, particle().v ** 2, force=vi.max(U, 0)),
            "in the force",
        ),
        (lambda: vi.soft(U, 0, 1, -1), "must be positive"),
        (lambda: vi.soft(U, 0, 1, "much"), "must be a number"),
        (lambda: move(vi.gauss(2), 5, bounds=[vi.soft(U, 1, 0, 1.0)]), "contradict"),
        (lambda: move(vi.gauss(2), 5, bounds=[vi.soft(particle().t, 1, 2, 1.0)]), "path"),
        (lambda: vi.max(U), "two or more"),
        (lambda: vi.abs("u"), "SX expressions"),
        (lambda: vi.abs(ca.MX.sym("u")), "SX"),
        (
            lambda: vi.optimal_control(
                vi.System(
                    particle().q,
                    particle().v,
                    particle().v ** 2 / 2,
                    force=U,
                    control=ca.vertcat(U, ca.SX.sym("idle")),
                ),
                duration=1,
                steps=3,
                cost=U**2,
            ),
            r"\['idle'\] do not act",
        ),
    ],
)
def test_kinks_and_soft_bounds_are_refused_where_they_cannot_stand(make, message):
    with pytest.raises(vi.InputError, match=message):
        make()
    assert pendulum() is not None
