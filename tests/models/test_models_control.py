"""Every ready control problem reaches the cost it names, replays, and does what its claim says."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from control_scenes import REFERENCE, replay_defect
from references import entries

import varint as vi

CATALOGUE = vi.models.control_catalogue
ACCURACY = {
    "swing_up_rod": 1e-7,
    "fastest_wire": 1e-9,
    "swing_up_cart_pole": 1e-8,
    "swing_up_acrobot": 1e-6,
    "overhead_crane": 1e-6,
    "falling_cat": 1e-8,
    "carried_load": 1e-7,
}
COMPUTED = entries("e")


@pytest.fixture(scope="module")
def solved():
    return {name: (model := factory(), model.solve()) for name, factory in CATALOGUE.items()}


@pytest.mark.parametrize("name", CATALOGUE)
def test_ready_problem_reaches_its_cost_and_replays(name, solved):
    model, found = solved[name]
    assert model.name == name
    assert model.claim and model.source
    if model.cost is not None:
        assert found[0].solution.total_cost == pytest.approx(
            model.cost, rel=ACCURACY.get(name, 1e-9)
        )
    assert max(motion.solution.violation for motion in found) < 1e-9
    assert max(map(replay_defect, found)) < 1e-9


def test_known_costs_are_those_of_the_references():
    numbers = json.loads(
        (Path(__file__).parents[1] / "reference" / "b.json").read_text(encoding="utf-8")
    )
    pairs = [
        (
            CATALOGUE["swing_up_cart_pole"]().cost,
            REFERENCE["D02_cartpole_kelly"]["reference"]["J_int_u2"],
        ),
        (
            CATALOGUE["orbit_transfer"]().cost,
            REFERENCE["D02_orbit_transfer_d1"]["reference"]["J_int_u2"],
        ),
        (CATALOGUE["fastest_wire"]().cost, numbers["B03_brachistochrone_dymos"]["reference"]["T"]),
        (CATALOGUE["free_floating_robot"]().cost, 76.8),
    ]
    pairs += [(CATALOGUE[x["title"]]().cost, x["reference"]["J"]) for x in COMPUTED.values()]
    for found, expected in pairs:
        assert found == pytest.approx(expected, rel=1e-13)


def test_brachistochrone_needs_a_constant_push_across_the_path(solved):
    numbers = json.loads(
        (Path(__file__).parents[1] / "reference" / "b.json").read_text(encoding="utf-8")
    )
    rate = numbers["B03_brachistochrone_dymos"]["reference"]["control_angle_rate"]
    [motion] = solved["fastest_wire"][1]
    assert -motion.u[1:] == pytest.approx(2 * rate * np.ones_like(motion.u[1:]), rel=1e-3)
    assert np.abs(motion.energy - motion.energy[0]).max() < 1e-6  # the wire does no work


def test_satellite_turns_without_angular_momentum(solved):
    [motion] = solved["falling_cat"][1]
    assert np.abs(motion.p[:, 0]).max() < 1e-11
    assert motion.q[-1] == pytest.approx([0.6, 0, 0], abs=1e-12)


def test_crane_stops_its_load_at_rest_within_the_bound(solved):
    [motion] = solved["overhead_crane"][1]
    assert motion.v[-1] == pytest.approx([0, 0], abs=1e-9)
    assert np.abs(motion.q[:, 1]).max() <= 0.4 + 1e-9
    assert np.abs(motion.u).max() == pytest.approx(6, rel=1e-2)


def test_acrobot_gains_the_work_of_its_elbow(solved):
    from varint.control.balances import energy_balance

    [motion] = solved["swing_up_acrobot"][1]
    gained, work = energy_balance(motion, motion.solution.q)
    assert gained == pytest.approx(work, rel=5e-3)
    assert gained > 30
