"""Scenes in polar coordinates and the like, whose inertia varies, take steps by the speed that the
start's energy leaves, and keep the promise of their error.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import varint as vi
from varint.codegen.two_runs import NOT_PROVED
from varint.integration import to_tolerance
from varint.integration.time_transformation import varying_call
from varint.integration.time_transformation.flight_rate import flight_rate
from varint.integration.time_transformation.metric_rate import SHARE, metric_rate

POLAR, SPEEDS = vi.coordinates("r", "phi")
PLANE = SPEEDS[0] ** 2 / 2 + POLAR[0] ** 2 * SPEEDS[1] ** 2 / 2


def in_polar(potential: ca.SX) -> vi.System:
    return vi.System(POLAR, SPEEDS, PLANE - potential)


def double_pendulum() -> vi.System:
    return vi.models.double_pendulum().system


def test_about_a_circle_it_is_a_part_of_the_small_motions_of_the_radius():
    """ω² = 3 v²/r² of r̈ = J²/r³ − …, J = r v."""
    system, r = in_polar(-1 / POLAR[0]), 0.7
    found = ca.Function("rate", [system.q, system.c], [metric_rate(system)])([r, 0.3], [])
    assert float(found) == pytest.approx(SHARE / 0.75 * 3 / r**2, rel=1e-14)


@settings(deadline=None, derandomize=True)
@given(st.floats(0.3, 3), st.floats(-2, 2), st.floats(0.2, 2))
def test_no_linear_change_of_coordinates_alters_it(size, mixed, radius):
    q, v = vi.coordinates("a", "b")
    change = ca.DM([[size, mixed], [0.0, 1.0]])
    there, speed = change @ q, change @ v
    kinetic = speed[0] ** 2 / 2 + there[0] ** 2 * speed[1] ** 2 / 2
    other = vi.System(q, v, kinetic + 1 / there[0])
    at = np.array(ca.solve(change, ca.DM([radius, 0.4]))).ravel()
    rates = [
        float(ca.Function("rate", [s.q, s.c], [metric_rate(s)])(x, []))
        for s, x in ((in_polar(-1 / POLAR[0]), [radius, 0.4]), (other, at))
    ]
    assert rates[1] == pytest.approx(rates[0], rel=1e-9)


def test_where_inertia_changes_by_about_as_much_everywhere_there_is_none():
    assert metric_rate(double_pendulum()) is None
    assert flight_rate(double_pendulum()).reason


def test_scenes_of_constant_inertia_keep_their_own_rate():
    assert metric_rate(vi.models.kepler().system) is None


@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize(
    ("potential", "swing"),
    [
        (lambda r: -1 / r, 0.05),
        (lambda r: r**2 / 2 + r**4 / 20, 0.01),
        (lambda r: ca.log(r**2 + 0.04) / 2, 0.03),
    ],
    ids=["Kepler", "quartic well", "logarithm"],
)
def test_a_narrow_passage_is_met_by_few_steps_and_to_the_wanted_error(potential, swing, tol):
    """Beside the same motion in Cartesian coordinates."""
    q, v = vi.coordinates("x", "y")
    flat = vi.System(q, v, ca.sumsqr(v) / 2 - potential(ca.norm_2(q)))
    motion = vi.simulate(
        in_polar(potential(POLAR[0])), q0=[1, 0], v0=[0, swing], duration=30.0, tol=tol
    )
    exact = vi.simulate(flat, q0=[1, 0], v0=[0, swing], tol=1e-11, at=motion.t[1:])
    r = np.linalg.norm(exact.q, axis=1)[-len(motion.t) + 1 :]
    off = np.abs(motion.q[1:, 0] - r).max() / np.ptp(motion.q[:, 0])
    assert off <= tol
    assert motion.stats["error_estimate"] <= tol
    assert motion.fictitious is not None  # equal steps would be more by what they vary
    steps = np.diff(motion.t)
    assert steps.max() > 5 * steps.min()


def test_the_time_scale_of_such_a_scene_is_its_own_too():
    """No drift of the energy over many passages, nor of the angle's momentum."""
    system = in_polar(POLAR[0] ** 2 / 2 + POLAR[0] ** 4 / 20)
    start = dict(q0=[1, 0], v0=[0, 0.02], duration=1000.0)
    motion = vi.simulate(system, vi.gauss(8), h=0.5, time_scale="auto", **start)
    error = np.abs(motion.energy - motion.energy[0])
    assert error.max() < 1e-9
    late = error[len(error) // 2 :].max()
    assert late < 3 * error[: len(error) // 2].max() + 1e-13
    assert np.abs(motion.p[:, 1] - motion.p[0, 1]).max() < 1e-13


def test_it_runs_backwards_to_where_it_came_from():
    system = in_polar(-1 / POLAR[0])
    there = vi.simulate(system, q0=[1, 0], v0=[0, 0.1], duration=20.0, tol=1e-10)
    back = vi.simulate(system, q0=there.q[-1], v0=there.v[-1], duration=-20.0, tol=1e-10)
    assert np.abs(back.q[-1] - [1, 0]).max() < 1e-6


def test_a_coarse_run_that_is_lost_is_followed_by_one_of_more_steps_in_the_core_as_in_python(
    monkeypatch,
):
    system = in_polar(ca.log(POLAR[0] ** 2 + 0.04) / 2)
    asked = dict(q0=[1.0, 0.0], v0=[0.0, 0.05], duration=100.0, tol=1e-6)
    with monkeypatch.context() as patched:  # without Python's own search
        patched.setattr(to_tolerance, "simulate_to_tolerance", None)
        whole = vi.simulate(system, **asked)
    assert whole.stats["runs"] == 3  # the first of them is lost
    monkeypatch.setattr(varying_call, "varying_runs", lambda *_: NOT_PROVED)
    again = vi.simulate(system, **asked)
    assert again.q.tobytes() == whole.q.tobytes()
    for name in ("steps", "runs", "error_estimate"):
        assert again.stats[name] == whole.stats[name]
