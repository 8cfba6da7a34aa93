"""Scenes of first order, L = ϑ(q)·v − H(q): their energy tells of steps too large, and their
velocities are those of their equations, whatever forces act.
"""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
from scenes import slopes

import varint as vi
from varint import models

pytestmark = pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
ALARM = "the energy went from"
Q, V = vi.coordinates("x", "y")
PENDULUM = Q[1] ** 2 / 2 - ca.cos(Q[0])


def phase_space(force=0.0, gauge=0.0) -> vi.System:
    """A pendulum by its angle x and momentum y; a gauge changes ϑ and no equation."""
    lagrangian = Q[1] * V[0] - PENDULUM + gauge * ca.dot(ca.gradient(Q[0] * Q[1], Q), V)
    return vi.System(Q, V, lagrangian, force=force * V)


def vortices() -> tuple[vi.System, np.ndarray]:
    q, v = vi.coordinates(*(f"{axis}{i}" for i in range(3) for axis in "xy"))
    circulation, places, speeds = [1.0, 1.5, -0.5], ca.vertsplit(q, 2), ca.vertsplit(v, 2)
    one_form = sum(
        g * (a[0] * b[1] - a[1] * b[0]) / 2
        for g, a, b in zip(circulation, places, speeds, strict=True)
    )
    energy = sum(
        circulation[i] * circulation[j] * ca.log(ca.sumsqr(places[i] - places[j])) / (4 * ca.pi)
        for i in range(3)
        for j in range(i)
    )
    return vi.System(q, v, one_form + energy), np.array([0.0, 0.0, 0.4, 0.0, 0.0, 1.0])


@pytest.mark.parametrize("force", [0.0, -1e-4])
@pytest.mark.parametrize("gauge", [0.0, 3.0])
def test_steps_too_large_are_told_of_with_forces_and_without(force, gauge):
    start = dict(q0=[1.0, 0.0], steps=200)
    system = phase_space(force, gauge)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message="the Lagrangian is degenerate")
        good = vi.simulate(system, h=0.3, **start)
    assert np.abs(np.diff(good.energy[[0, -1]])) < 0.05
    with pytest.warns(UserWarning, match=ALARM):
        vi.simulate(phase_space(force), vi.midpoint(), h=8.0, **start)


def test_populations_and_vortices_are_told_of_where_steps_are_too_large_alone():
    prey = models.lotka_volterra()
    vortex, q0 = vortices()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message="the Lagrangian is degenerate")
        vi.simulate(prey.system, q0=prey.q0, h=0.5, steps=300)
        vi.simulate(vortex, q0=q0, h=0.1, steps=400)
    with pytest.warns(UserWarning, match=ALARM):
        vi.simulate(prey.system, vi.midpoint(), q0=prey.q0, h=2.0, steps=300)


def test_damping_takes_energy_without_an_alarm():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message="the Lagrangian is degenerate")
        motion = vi.simulate(phase_space(-0.3), q0=[2.0, 0.0], h=0.05, steps=800)
    assert motion.energy[-1] < motion.energy[0] - 0.5


@pytest.mark.parametrize("power", [1, 3])
def test_velocities_solve_the_equations_under_forces_of_the_velocities(power):
    """y' = −sin x + F_x and −x' = −y + F_y, F = −0.2 v |v|^(power − 1)."""
    speed = ca.sumsqr(V) ** ((power - 1) / 2)
    system = vi.System(Q, V, Q[1] * V[0] - PENDULUM, force=-0.2 * speed * V)
    motion = vi.simulate(system, q0=[1.0, 0.3], h=0.05, steps=40)
    (x, y), (vx, vy) = motion.q.T, motion.v.T
    size = np.hypot(vx, vy) ** (power - 1)
    np.testing.assert_allclose(-vy - np.sin(x) - 0.2 * size * vx, 0, atol=1e-12)
    np.testing.assert_allclose(vx - y - 0.2 * size * vy, 0, atol=1e-12)


def test_equations_that_determine_no_velocities_are_refused_at_the_start():
    q, v = vi.coordinates("a", "b", "c")
    odd = vi.System(q, v, q[1] * v[0] - ca.sumsqr(q))
    with pytest.raises(vi.InputError, match=r"no velocities at the start.*odd number"):
        vi.simulate(odd, q0=[1.0, 0.2, 0.1], h=0.1, steps=5)
    flat = vi.System(Q, V, Q[0] * V[0] - ca.sumsqr(Q))
    with pytest.raises(vi.InputError, match=r"no velocities at the start"):
        vi.simulate(flat, q0=[1.0, 0.2], h=0.1, steps=5)


@pytest.mark.filterwarnings("ignore:the Lagrangian is degenerate")
@pytest.mark.parametrize("tol", [1e-2, 1e-3])
def test_a_loose_tolerance_over_many_turns_is_met(tol):
    model = vi.models.lotka_volterra()
    how = dict(q0=model.q0, duration=1000.0)
    rough = vi.simulate(model.system, tol=tol, **how)
    fine = vi.simulate(model.system, tol=1e-7, **how)
    # sizes of the coordinates are about one
    assert np.abs(rough.q[-1] - fine.q[-1]).max() <= tol
    assert rough.stats["error_estimate"] <= tol


@pytest.mark.parametrize(
    "rule", [vi.midpoint(), vi.gauss(3), vi.gauss(8), vi.composition("kahan-li8")], ids=str
)
@pytest.mark.parametrize("which", ["pendulum", "gauge", "damped", "cubic damping", "vortices"])
def test_native_and_compiled_runs_are_the_same_bytes_and_agree_with_interpreted_ones(which, rule):
    speed = ca.sumsqr(V)
    cubic = vi.System(Q, V, Q[1] * V[0] - PENDULUM, force=-0.2 * speed * V)
    systems = {
        "pendulum": (phase_space(), [1.0, 0.3]),
        "gauge": (phase_space(gauge=3.0), [1.0, 0.3]),
        "damped": (phase_space(-0.2), [1.0, 0.3]),
        "cubic damping": (cubic, [1.0, 0.3]),  # its velocities are solved for
        "vortices": vortices(),
    }
    system, q0 = systems[which]
    if which == "cubic damping" and rule in (vi.gauss(3), vi.gauss(8)):
        pytest.skip("its velocities are no expression")
    slow, native, compiled = (
        vi.simulate(system, rule, q0=q0, h=0.05, steps=200, backend=backend)
        for backend in ("interpreted", "native", "compiled")
    )
    assert native.stats["backend"].startswith("native: ")
    for name in ("q", "v", "p"):
        assert np.array_equal(getattr(native, name), getattr(compiled, name))
        np.testing.assert_allclose(getattr(native, name), getattr(slow, name), atol=1e-12)


def test_a_long_native_run_keeps_its_momentum_at_that_of_its_place():
    """p − ϑ(q) swings from step to step by what the first made of it, and does not grow."""
    system, q0 = vortices()
    one_form = ca.Function("one_form", [system.q], [system.momentum])
    motion = vi.simulate(system, q0=q0, h=0.05, steps=200_000, save_every=1000, backend="native")
    assert np.abs(motion.p - np.array(one_form(motion.q.T)).T).max() < 1e-12
    assert np.ptp(motion.energy) < 1e-3


@pytest.mark.parametrize("stages", [1, 2, 3, 4])
@pytest.mark.parametrize("which", ["pendulum", "gauge", "damped", "vortices", "driven"])
def test_gauss_rules_have_their_order_where_the_one_form_is_linear(which, stages):
    t = ca.SX.sym("t")
    driven = vi.System(Q, V, Q[1] * V[0] - PENDULUM * (1 + ca.sin(t) / 3), t=t)
    systems = {
        "pendulum": (phase_space(), [1.0, 0.3]),
        "gauge": (phase_space(gauge=3.0), [1.0, 0.3]),
        "damped": (phase_space(-0.2), [1.0, 0.3]),
        "vortices": vortices(),
        "driven": (driven, [1.0, 0.3]),
    }
    system, q0 = systems[which]
    how = dict(q0=q0, duration=4.0)
    fine = vi.simulate(system, vi.gauss(8), steps=40, **how).q[-1]
    steps = {1: [80, 120, 160], 2: [32, 48, 64], 3: [24, 32, 40], 4: [14, 18, 22]}[stages]
    runs = [vi.simulate(system, vi.gauss(stages), steps=n, **how) for n in steps]
    errors = np.array([[np.abs(run.q[-1] - fine).max()] for run in runs])
    np.testing.assert_allclose(slopes(steps, errors, 1e-14), 2 * stages, atol=0.25)


@pytest.mark.parametrize("stages", [2, 3, 8])
def test_gauss_steps_keep_the_one_form_its_exterior_derivative_and_the_impulse_of_vortices(stages):
    """p = ϑ(q), ω = Aᵀ − A and Σ Γ |r|², all linear or quadratic, to round-off; reversible."""
    system, q0 = vortices()
    one_form = ca.Function("one_form", [system.q], [system.momentum])
    form = np.array(ca.DM(ca.jacobian(system.momentum, system.q)))
    rule, how = vi.gauss(stages), dict(h=0.3, steps=40)
    motion = vi.simulate(system, rule, q0=q0, **how)
    assert np.abs(motion.p - np.array(one_form(motion.q.T)).T).max() < 1e-13
    impulse = (motion.q**2).reshape(-1, 3, 2).sum(axis=2) @ [1.0, 1.5, -0.5]
    assert np.abs(impulse - impulse[0]).max() < 1e-13
    back = vi.simulate(system, rule, q0=motion.q[-1], h=-0.3, steps=40)
    np.testing.assert_allclose(back.q[-1], q0, atol=1e-12)
    small, slope = 3e-4, np.empty((6, 6))
    for i, e in enumerate(np.eye(6) * small):
        starts = (q0 + x for x in (2 * e, e, -e, -2 * e))
        ends = [vi.simulate(system, rule, q0=x, h=0.3, steps=3).q[-1] for x in starts]
        slope[:, i] = np.array([-1, 8, -8, 1]) @ ends / (12 * small)
    omega = form.T - form
    np.testing.assert_allclose(slope.T @ omega @ slope, omega, atol=1e-9)


def test_a_linear_one_form_is_stepped_by_default_with_high_order_and_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = vi.simulate(phase_space(), q0=[1.0, 0.3], duration=50.0)
    assert motion.stats["rule"] == "gauss(8)"
    angle = vi.System(Q[:1], V[:1], V[0] ** 2 / 2 + ca.cos(Q[0]))
    same = vi.simulate(angle, q0=[1.0], v0=[0.3], duration=50.0, tol=1e-12)
    assert np.abs(motion.q[-1] - [same.q[-1, 0], same.v[-1, 0]]).max() < 1e-9
    np.testing.assert_allclose(motion.energy, motion.energy[0], atol=1e-9)


def test_a_start_that_plays_no_part_is_told_of_where_it_is_another_one():
    model = models.lotka_volterra()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vi.simulate(model.system, q0=model.q0, v0=model.v0, h=0.1, steps=5)
        vi.simulate(phase_space(), q0=[1.0, 0.3], p0=[0.3, 0.0], h=0.1, steps=5)
    with pytest.warns(UserWarning, match=r"degenerate.*v0 plays no part"):
        vi.simulate(phase_space(), q0=[1.0, 0.3], v0=[0.0, 0.0], h=0.1, steps=5)
    with pytest.warns(UserWarning, match=r"degenerate.*p0 plays no part"):
        vi.simulate(phase_space(), q0=[1.0, 0.3], p0=[0.4, 0.0], h=0.1, steps=5)


def test_rules_that_would_be_unstable_are_refused_where_the_one_form_is_not_linear():
    curved = vi.System(Q, V, (Q[1] + Q[1] ** 3 / 5) * V[0] - PENDULUM)
    with pytest.raises(vi.InputError, match=r"degenerate.*unstable for it; use midpoint"):
        vi.simulate(curved, vi.gauss(2), q0=[1.0, 0.3], h=0.1, steps=5)
    with pytest.raises(vi.InputError, match=r"degenerate.*or another gauss"):
        vi.simulate(phase_space(), vi.lobatto(3), q0=[1.0, 0.3], h=0.1, steps=5)


def test_an_error_is_below_what_was_asked_by_the_largest_coordinate_too():
    """z of the guiding centre swings to both sides of zero: its range is twice its largest."""
    model = models.guiding_centre()
    fine = vi.simulate(model.system, q0=model.q0, duration=10.0, tol=1e-11).q[-1]
    for tol in (1e-2, 1e-3, 1e-5):
        motion = vi.simulate(model.system, vi.midpoint(), q0=model.q0, duration=10.0, tol=tol)
        assert np.abs(motion.q[-1] - fine).max() <= tol * np.abs(motion.q).max()
