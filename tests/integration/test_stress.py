"""Numerical stability where integrators break: limits of hω, stiffness, chaos, collisions,
poles, chains, units.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import varint as vi

sys.path.append(str(Path(__file__).resolve().parents[2] / "benchmarks"))
import stress

pytestmark = pytest.mark.stress


@pytest.mark.parametrize("rule", stress.RULES, ids=str)
def test_every_rule_is_stable_up_to_its_limit_and_no_further(rule):
    found, theory = (
        limit(rule, grid=0.01) for limit in (stress.stability_limit, stress.stability_in_theory)
    )
    assert found == pytest.approx(theory, abs=0.015), (
        "one step of the grid, for the limit may lie on it"
    )


@pytest.mark.parametrize(
    ("rule", "limit"), [(vi.lobatto(2), 2.0), (vi.lobatto(3), np.sqrt(8.0))], ids=str
)
def test_the_limits_known_in_closed_form_are_found(rule, limit):
    """Störmer–Verlet's, and that of 1 − x²/2 + …, three points."""
    assert stress.stability_limit(rule, most=6.0) == pytest.approx(limit, abs=2e-3)


def test_a_double_pendulum_at_rest_from_right_angles_keeps_its_energy():
    assert stress.chaotic_double_pendulum(duration=50.0) < 1e-11


@pytest.mark.parametrize("h_omega", [0.5, 5.0, 30.0])
def test_a_stiff_chain_stays_bounded_however_large_h_omega(h_omega):
    error, _ = stress.stiff_chain(h_omega, duration=100.0)
    assert error < 0.5


def test_a_near_collision_is_a_result_an_alarm_or_a_refusal_but_never_silent():
    assert stress.near_collision(0.9).startswith("energy error")
    for e in (0.9999, 1 - 1e-8):
        found = stress.near_collision(e, steps_an_orbit=500)
        assert found.startswith(("alarm", "refused")), found


def test_a_top_near_gimbal_lock_runs_and_in_it_is_refused():
    assert float(stress.gimbal_lock(0.1).removeprefix("energy error ")) < 1e-6
    assert stress.gimbal_lock(0.0).startswith("refused"), "the mass matrix is singular there"


def test_a_linkage_that_folds_is_refused_there_and_passes_with_its_constraints():
    """Which branch it takes is not determined; that its bars keep their lengths is."""
    assert "folded linkage" in stress.folding_linkage(
        0.0, 1e-2
    ) or "dependent" in stress.folding_linkage(0.0, 1e-2)
    passed = stress.folding_linkage(1.0, 3.7e-3)
    assert float(passed.split("|g| ")[1].split(",")[0]) < 1e-12, passed


def test_random_lagrangians_run_or_say_why_not():
    ends = stress.random_lagrangians(150, seed=2)
    ran, alarm, failed, refused = (int(part.split()[0]) for part in ends.split(", "))
    assert ran + alarm + failed + refused == 150 and ran > 30 and failed and refused


def test_a_chain_of_200_rods_lets_go_and_holds_its_constraints():
    gap, energy = stress.whipping_chain(200, steps=100)
    assert gap < 1e-10 and energy < 1e-2


def test_round_off_does_not_drift_over_1e6_steps():
    drift, largest = stress.round_off_drift(10**6)
    assert abs(drift) < 2e-13 and largest < 1e-9


@pytest.mark.parametrize("rule", [vi.gauss(2), vi.lobatto(3)], ids=str)
@pytest.mark.parametrize("size", [1e-20, 1e20])
@pytest.mark.parametrize("unit", ["length", "time", "mass"])
def test_units_from_1e_minus_20_to_1e20_give_the_same_motion(unit, size, rule):
    scales = dict(length=1.0, time=1.0, mass=1.0) | {unit: size}
    assert stress.units(**scales, rule=rule) < 1e-11


@pytest.mark.long
def test_every_stress_scene_at_full_length(capsys):
    stress.main()
    assert "nan" not in capsys.readouterr().out
