"""Steps are shorter where forces bend sharply, and nowhere else; errors are what was asked for."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest
from both_gears import require_same_bytes
from scipy.integrate import solve_ivp

import varint as vi
from varint.integration.bent_steps import closer_looks

FORCES = {
    "root": (lambda v, e: v / ca.sqrt(v**2 + e**2), lambda v, e: v / np.sqrt(v**2 + e**2)),
    "tanh": (lambda v, e: ca.tanh(v / e), lambda v, e: np.tanh(v / e)),
    "atan": (lambda v, e: ca.atan(v / e), lambda v, e: np.arctan(v / e)),
    "drag": (lambda v, e: v * ca.sqrt(v**2 + e**2), lambda v, e: v * np.sqrt(v**2 + e**2)),
}


def pendulum(kind="drag", c=0.05, e=1e-2):
    q, v = vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=-c * FORCES[kind][0](v, e))


def driven(kind="root", c=0.3, e=1e-3):
    q, v, t = *vi.coordinates("x"), vi.time()
    force = 3 * ca.cos(1.7 * t) - c * FORCES[kind][0](v, e)
    return vi.System(q, v, v**2 / 2 - 2 * q**2, force=force, t=t)


def two_masses(kind="atan", c=0.2, e=1e-2):
    q, v = vi.coordinates("x", "y")
    rubbed = c * FORCES[kind][0](v[0] - v[1], e)
    springs = 2 * q[0] ** 2 + 1.5 * (q[0] - q[1]) ** 2 + q[1] ** 2
    return vi.System(q, v, ca.sumsqr(v) / 2 - springs, force=ca.vertcat(-rubbed, rubbed))


def accelerations(make, kind, c, e):
    rub = FORCES[kind][1]
    if make is pendulum:
        return lambda t, y: [y[1], -9.81 * np.sin(y[0]) - c * rub(y[1], e)]
    if make is driven:
        return lambda t, y: [y[1], -4 * y[0] + 3 * np.cos(1.7 * t) - c * rub(y[1], e)]

    def two(t, y):
        pulled, rubbed = 3 * (y[0] - y[1]), c * rub(y[2] - y[3], e)
        return [y[2], y[3], -4 * y[0] - pulled - rubbed, -2 * y[1] + pulled + rubbed]

    return two


def reference(how, start, times, longest=0.05):
    """DOP853 with steps that do not pass over a bend unseen."""
    asked = {"rtol": 1e-13, "atol": 1e-15, "method": "DOP853", "max_step": longest}
    return solve_ivp(how, (times[0], times[-1]), start, t_eval=times, **asked).y.T


START = {"q0": 2.0, "v0": 0.0, "duration": 10.0}


@pytest.mark.parametrize("tol", (1e-7, 1e-9, 1e-11))
@pytest.mark.parametrize(
    ("make", "kind", "c", "e"),
    [
        (pendulum, "drag", 0.05, 1e-2),
        (pendulum, "root", 0.2, 1e-2),
        (driven, "root", 0.3, 1e-3),
        (driven, "tanh", 0.1, 1e-4),
        (two_masses, "atan", 0.2, 1e-2),
    ],
)
def test_errors_stay_below_what_was_asked_for(make, kind, c, e, tol):
    n = 2 if make is two_masses else 1
    start = {"q0": [2.0, 0.5][:n], "v0": [0.0, -1.0][:n], "duration": 6.0}
    motion = vi.simulate(make(kind, c, e), **start, tol=tol)
    exact = reference(accelerations(make, kind, c, e), [*start["q0"], *start["v0"]], motion.t)
    off = np.abs(motion.q - exact[:, :n]).max() / np.abs(motion.q).max()
    assert off <= tol and motion.stats["error_estimate"] <= tol
    if tol < 1e-8:
        assert motion.sizes is not None


@pytest.mark.parametrize("width", (1e-2, 1e-4, 1e-6))
def test_a_throw_turns_when_it_should(width):
    """dv/dt = −g − μ tanh(v/ε): t = ε [μ log(g cosh u + μ sinh u) − g u] / (g² − μ²), u = v/ε."""
    g, c, tol = 9.81, 4.0, 1e-9
    q, v = vi.coordinates("z")
    scene = vi.System(q, v, v**2 / 2 - g * q, force=-c * ca.tanh(v / width))
    motion = vi.simulate(scene, q0=0.0, v0=10.0, duration=2.0, tol=tol)

    def when(v):
        u = v / width
        grown = np.abs(u) + np.log(
            ((g + c * np.sign(u)) + (g - c * np.sign(u)) * np.exp(-2 * np.abs(u))) / 2
        )
        return width * (c * grown - g * u) / (g**2 - c**2)

    late = when(motion.v[:, 0]) - when(10.0) - motion.t
    assert motion.v[0, 0] == 10 and motion.v[-1, 0] < -4
    assert np.abs(late).max() <= 1e-8
    assert len(motion) < 600


def test_steps_are_short_where_forces_bend_and_nowhere_else():
    motion = vi.simulate(pendulum(), **START)
    sizes, speeds = motion.sizes, np.abs(motion.v[:-1, 0])
    halvings = np.log2(sizes.max() / sizes)
    assert np.abs(halvings - np.rint(halvings)).max() < 1e-6
    assert halvings.max() >= 4
    assert (speeds[halvings > 4] < 1).all()
    assert halvings[speeds > 3].max() < 3
    assert motion.t[0] == 0 and motion.t[-1] == 10
    assert np.array_equal(sizes, np.diff(motion.t))


def test_equal_steps_are_many_more():
    motion = vi.simulate(pendulum(), **START)
    equal = vi.simulate(pendulum(), **START, events={"never": vi.coordinates("theta")[0] - 50})
    assert motion.sizes is not None and equal.sizes is None
    assert 4 * len(motion) < len(equal)
    assert abs(motion.q[-1, 0] - equal.q[-1, 0]) <= 2e-9 * np.abs(motion.q).max()


def test_smooth_forces_have_equal_steps():
    for scene in (pendulum(e=3.0), driven("tanh", 0.3, 5.0)):
        assert vi.simulate(scene, **START, tol=1e-11).sizes is None


@pytest.mark.parametrize("scene", (pendulum(), driven(), two_masses()))
def test_nodes_are_the_same_as_data_and_compiled(scene, monkeypatch):
    n = scene.structure.n
    require_same_bytes(monkeypatch, scene, [2.0] * n, [0.1] * n, 8.0, 1e-10, 25.0)


@pytest.mark.parametrize("make", (pendulum, driven))
def test_all_ways_take_the_same_steps(make):
    scene = make()
    short, again, shown = (
        vi.simulate(scene, **START, **more) for more in ({}, {}, {"progress": True})
    )
    assert short.sizes is not None
    for motion in (again, shown, pickle.loads(pickle.dumps(short))):
        for name in ("t", "q", "p", "v", "sizes", "k", "energy"):
            assert getattr(short, name).tobytes() == getattr(motion, name).tobytes()
        assert short.stats["error_estimate"] == motion.stats["error_estimate"]
        assert short.stats["runs"] == motion.stats["runs"]


@pytest.mark.parametrize("t0", (0.0, 2.5))
def test_what_is_asked_for_between_nodes_is_found_there(t0):
    scene, times = driven(), np.linspace(t0, t0 + 8.0, 101)
    asked = {"q0": 2.0, "v0": 0.3, "t0": t0, "duration": 8.0}
    exact = reference(accelerations(driven, "root", 0.3, 1e-3), [2.0, 0.3], times)
    motion, there = vi.simulate(scene, **asked), vi.simulate(scene, **asked, at=times)
    assert motion.sizes is not None
    assert np.array_equal(there.t, times)
    for found in (there, motion.at(times)):
        assert np.abs(found.q[:, 0] - exact[:, 0]).max() <= 1e-9 * np.abs(exact[:, 0]).max()
    v = motion.at(times).v[:, 0]
    assert np.abs(v - exact[:, 1]).max() <= 1e-7


def test_a_fitted_motion_can_be_kept(tmp_path):
    motion = vi.simulate(driven(), **START)
    motion.save(tmp_path / "motion.npz")
    again = vi.load(tmp_path / "motion.npz")
    for name in ("t", "q", "p", "v", "sizes"):
        assert getattr(again, name).tobytes() == getattr(motion, name).tobytes()


def test_a_bend_at_the_start_is_not_missed():
    """From rest friction turns over within 2e-6, before the first look at a step of 0.06."""
    q, v = vi.coordinates("x")
    rub = FORCES["tanh"]
    c, e = 0.2716604637486136, 1.1388048735977514e-05
    scene = vi.System(q, v, v**2 / 2 - 2 * q**2, force=-c * rub[0](v, e))
    motion = vi.simulate(scene, q0=1.7260066, v0=0.0, duration=6.738903901422237, tol=5.7e-9)
    exact = reference(
        lambda t, y: [y[1], -4 * y[0] - c * rub[1](y[1], e)], [1.7260066, 0.0], motion.t
    )
    assert motion.sizes is not None
    assert np.abs(motion.q[:, 0] - exact[:, 0]).max() <= 5.7e-9 * 1.7260066


@pytest.mark.parametrize("above", (1.0, 4.0))
def test_a_speed_that_only_touches_a_bend_is_seen(above):
    """A mass on a belt is faster and faster until its speed is nearly the belt's, for an instant;
    and a pendulum has steps fitted. Where friction were the same all the time, it would be slower
    by some ε.
    """
    c, e, w = 0.3, 1e-4, 4.0
    q, v = vi.coordinates("x", "y")
    (belt, rub), (drag, _) = FORCES["tanh"], FORCES["drag"]
    force = ca.vertcat(-c * belt(v[0] - w, e), -0.05 * drag(v[1], 1e-2))
    scene = vi.System(q, v, ca.sumsqr(v) / 2 - 2 * q[0] ** 2 + 9.81 * ca.cos(q[1]), force=force)
    x0 = c / 4 - (w - above * e) / 2
    motion = vi.simulate(scene, q0=[x0, 2.0], v0=[0.0, 0.0], duration=10.0)
    exact = reference(
        lambda t, y: [y[1], -4 * y[0] - c * rub(y[1] - w, e)], [x0, 0.0], motion.t, 5e-3
    )
    assert motion.sizes is not None
    assert np.abs(motion.q[:, 0] - exact[:, 0]).max() <= 1e-9 * np.abs(motion.q).max()


def test_friction_that_holds_is_proved_by_equal_steps():
    """Long steps do not damp the momentum of what is held, by less than 1e-11."""
    q, v = vi.coordinates("x", "y")
    rubbed = 0.66 * ca.tanh((v[0] - v[1]) / 0.0068)
    springs = 2 * q[0] ** 2 + 1.5 * (q[0] - q[1]) ** 2 + 0.9 * q[1] ** 2
    scene = vi.System(q, v, ca.sumsqr(v) / 2 - springs, force=ca.vertcat(-rubbed, rubbed))
    start = {"q0": [2.0, 1.5], "v0": [-2.8, -2.9], "duration": 12.0}
    motion = vi.simulate(scene, **start, tol=1e-11)
    other = vi.simulate(scene, **start, tol=1e-9)
    assert np.abs(motion.q[-1] - other.q[-1]).max() <= 1e-9 * np.abs(motion.q).max()
    assert motion.stats["error_estimate"] <= 1e-11


def test_looks_show_what_bends_and_what_ends_miss():
    """The two highest coefficients of polynomials of these degrees; at the ends nothing of them."""
    x, *weights = closer_looks(16)
    assert x[0] == 0 and x[-1] == 1 and np.allclose(x + x[::-1], 1)
    for degree in range(16):
        values = np.polynomial.legendre.Legendre.basis(degree)(2 * x - 1)
        wanted = [float(degree == 14), float(degree == 15), 0.0, 0.0]
        assert np.array(weights) @ values == pytest.approx(wanted, abs=1e-12)
    for end in (0, -1):
        jump = np.zeros(18)
        jump[end] = 1
        assert np.abs(np.array(weights) @ jump).max() == pytest.approx(x[1])
