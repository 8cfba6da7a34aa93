"""Machines from MJCF: masses, places and forces are MuJoCo's, to round-off."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from machine_terms import off, places_of, terms_of
from references import entries

import varint.multibody as mb

MACHINES = Path(__file__).parents[1] / "reference" / "machines"
CLOSE = 1e-12


def read(name: str) -> mb.Model:
    """A reference machine; that its geoms could touch is said."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", ".*contacts.*")
        return mb.from_mjcf(MACHINES / name)


@pytest.mark.parametrize("name", ["geoms.xml", "driven.xml", "closed.xml"])
def test_mass_matrix_bias_forces_and_places_are_those_of_mujoco(name):
    model = read(name)
    model.machine.loops.clear()
    model.machine.couplings.clear()  # what MuJoCo holds softly is no part of these
    terms, places = terms_of(model), places_of(model, [x for x in model.bodies if "/" not in x])
    for state in entries("g")[name]:
        q, v, u = (np.array(state[key]) for key in "qvu")
        found = terms(q, v, u)
        assert off(found.mass_matrix, state["mass_matrix"]) < CLOSE
        assert off(found.bias, state["bias"]) < CLOSE
        forces = np.array(state["passive"]) + state["actuator"]
        assert off(found.spring + found.force, forces) < CLOSE
        assert off(places(q), state["bodies"]) < CLOSE


def test_at_home_every_body_stands_where_the_file_puts_it():
    """MuJoCo's qpos0: free joints at their body's pose, hinges and slides at their reference."""
    model = read("closed.xml")
    model.machine.couplings.clear()
    q, _ = mb.start_values(model)
    spots = places_of(model, ["crank", "rod", "rocker", "plate", "box", "gear"])(q)
    expected = [[0, 0, 0], [0, 0, 0.3], [0.6, 0, 0.2], [1, 1, 1], [1, 1.5, 1], [0, 1, 0]]
    assert off(spots[:, :3], expected) < CLOSE
    # the pin and weld of what stands as it stands
    held = terms_of(model)(q, np.zeros(13), np.zeros(0)).constraint[:8]
    assert held == pytest.approx(np.zeros(8), abs=CLOSE)


def test_sites_are_markers_where_mujoco_has_them():
    for name, sites in (("geoms.xml", ["tip"]), ("driven.xml", ["nozzle", "rotor"])):
        places = places_of(read(name), sites)
        for state in entries("g")[name]:
            assert off(places(np.array(state["q"])), state["sites"]) < CLOSE


def test_closures_are_open_by_what_mujoco_says():
    """Points by the same vector, welded frames by the same angle, gears by the same difference."""
    model = read("closed.xml")
    [coupling] = model.machine.couplings
    model.machine.couplings.clear()
    assert coupling.follower == "gear"
    terms = terms_of(model)
    counts = [3 if name in ("pin", "sites") else 6 for name in model.machine.loops]
    for state in entries("g")["closed.xml"]:
        q = np.array(state["q"])
        found = terms(q, np.array(state["v"]), np.zeros(0)).constraint
        found = np.insert(found, 1, 0.0)  # across the plane of the linkage, where nothing moves
        theirs = np.array(state["equality"])
        for count in counts:
            assert off(found[:3], -theirs[:3]) < CLOSE
            # MuJoCo has the sine of half the angle, here is twice its sine
            half = np.linalg.norm(theirs[3:count])
            full = 4 * half * np.sqrt(1 - half**2)
            assert abs(np.linalg.norm(found[3:count]) - full) < CLOSE
            found, theirs = found[count:], theirs[count:]
        values = dict(zip(model.system().names, q, strict=True))
        led = np.polynomial.Polynomial(coupling.coefficients)(values["crank"])
        assert theirs == pytest.approx([values["gear"] - led], abs=CLOSE)
