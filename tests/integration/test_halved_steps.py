"""A first run is halved on the way where equal steps do not get through, or forces bend."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest
from both_gears import require_same_bytes
from scipy.integrate import solve_ivp

import varint as vi
from varint.integration import short_trials


def spun(drag: float = 0.2):
    """A ball on a rod by its angle from the pole and around it, in a wind along the ground: it
    passes close to the pole, where it turns fast.
    """
    q, v, t = *vi.coordinates("a", "b"), vi.time()
    energy = (v[0] ** 2 + ca.sin(q[0]) ** 2 * v[1] ** 2) / 2 + 3 * ca.cos(q[0])
    rod = ca.sin(q[0]) * ca.vertcat(ca.cos(q[1]), ca.sin(q[1]))
    wind = ca.vertcat(2 + ca.sin(1.3 * t), 0.5)
    over = wind - ca.jtimes(rod, q, v)
    push = drag * ca.norm_2(over) * over
    return vi.System(q, v, energy, force=ca.jacobian(rod, q).T @ push, t=t)


def rubbed(width: float = 0.2, friction: float = 0.3):
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - 2 * q**2, force=-friction * ca.tanh(v / width))


def reference(system, start, times, longest):
    """DOP853 by Lagrange's equations."""
    push = ca.gradient(system.lagrangian, system.q) + system.force
    push -= ca.jtimes(system.momentum, system.q, system.v)
    a = ca.solve(system.mass_matrix, push)
    how = ca.Function("a", [system.t, ca.vertcat(system.q, system.v)], [ca.vertcat(system.v, a)])
    asked = {"rtol": 1e-13, "atol": 1e-14, "method": "DOP853", "max_step": longest}
    found = solve_ivp(
        lambda t, y: how(t, y).full().ravel(), (times[0], times[-1]), start, t_eval=times, **asked
    )
    return found.y.T


CASES = {
    "near the pole": (spun(), {"q0": [0.5, 0.3], "v0": [0.0, 0.0], "duration": 8.0}, 80),
    "friction": (rubbed(), {"q0": [2.0], "v0": [0.0], "duration": 10.0}, 160),
    "backwards": (rubbed(friction=-0.3), {"q0": [2.0], "v0": [0.0], "duration": -10.0}, 160),
}
# scenes that are not made alike, and move alike
OTHERS, UNHALVED = (
    {
        "near the pole": spun(0.2 + less),
        "friction": rubbed(friction=0.3 + less),
        "backwards": rubbed(friction=-0.3 - less),
    }
    for less in (1e-15, 2e-15)
)


@pytest.mark.parametrize("tol", (1e-7, 1e-9, 1e-11))
@pytest.mark.parametrize("case", CASES)
def test_steps_are_powers_of_two_of_one_another_and_errors_what_is_asked_for(case, tol):
    system, start, _ = CASES[case]
    motion = vi.simulate(system, **start, tol=tol)
    halvings = np.log2(np.abs(motion.sizes).max() / np.abs(motion.sizes))
    assert np.abs(halvings - np.rint(halvings)).max() < 1e-6 and halvings.max() >= 1
    exact = reference(system, start["q0"] + start["v0"], motion.t, 0.02)
    off = np.abs(motion.q - exact[:, : system.structure.n]).max() / np.abs(exact).max()
    assert off <= tol and motion.stats["error_estimate"] <= tol
    assert motion.t[-1] == start["duration"]


@pytest.mark.parametrize("case", CASES)
def test_equal_steps_are_more(case, monkeypatch):
    """480 and seven runs near the pole before."""
    system, start, most = CASES[case]
    motion = vi.simulate(system, **start)
    assert len(motion) <= most and motion.sizes is not None
    limits = short_trials._REFINED.copy()
    limits[-5], limits[-2] = 1e9, 0.0  # none lost, nothing bent
    monkeypatch.setattr(short_trials, "_REFINED", limits)
    other = vi.simulate(OTHERS[case], **start)
    assert other.stats["runs"] > motion.stats["runs"]
    assert np.abs(other.q[-1] - motion.q[-1]).max() <= 2e-9 * np.abs(motion.q).max()


@pytest.mark.parametrize("case", CASES)
def test_all_ways_take_the_same_steps(case, capsys):
    system, start, _ = CASES[case]
    short, again, shown = (
        vi.simulate(system, **start, **more) for more in ({}, {}, {"progress": True})
    )
    for motion in (again, shown, pickle.loads(pickle.dumps(short))):
        for name in ("t", "q", "p", "v", "sizes", "k"):
            assert getattr(short, name).tobytes() == getattr(motion, name).tobytes()
        assert short.stats["runs"] == motion.stats["runs"]
    capsys.readouterr()


@pytest.mark.parametrize(("case", "radians"), (("near the pole", 14.0), ("friction", 20.0)))
def test_nodes_are_the_same_as_data_and_compiled(case, radians, monkeypatch):
    system, start, _ = CASES[case]
    require_same_bytes(monkeypatch, system, *start.values(), 1e-9, radians)


@pytest.mark.parametrize("case", CASES)
def test_where_no_halving_is_enough_the_search_goes_on_without(case, monkeypatch):
    """No step is good enough for its limits: it is lost when it is as short as they become."""
    system, start, _ = CASES[case]
    halved = vi.simulate(system, **start)  # by limits that are kept with the scene
    limits = short_trials._REFINED.copy()
    limits[-4] = 0.0  # what the highest coefficients may be
    monkeypatch.setattr(short_trials, "_REFINED", limits)
    motion = vi.simulate(UNHALVED[case], **start)
    exact = reference(system, start["q0"] + start["v0"], motion.t, 0.02)
    off = np.abs(motion.q - exact[:, : system.structure.n]).max() / np.abs(exact).max()
    assert off <= 1e-9 and motion.stats["error_estimate"] <= 1e-9
    assert motion.stats["runs"] > halved.stats["runs"]
