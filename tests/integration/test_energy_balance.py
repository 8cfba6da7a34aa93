"""Runs that blow up are told of whatever acts on the scene; those that are driven are not."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi

SILENT = "the energy went from"


def oscillator(force=0.0, t: ca.SX | None = None, extra=0.0) -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - q**2 / 2 + extra * q, force=force * v, t=t)


def kepler(drag: float, t: ca.SX | None = None) -> vi.System:
    q, v = vi.coordinates("x", "y")
    pull = 0 if t is None else 1e-4 * ca.cos(t) * q[0]
    return vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q) + pull, force=-drag * v, t=t)


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
@pytest.mark.parametrize("every", [1, 50])
@pytest.mark.parametrize("driven", ["drag", "time"])
def test_an_unstable_step_is_told_of_under_forces_and_explicit_time(backend, every, driven):
    t = vi.time()
    system = oscillator(-1e-3) if driven == "drag" else oscillator(t=t, extra=1e-3 * ca.cos(t))
    with pytest.warns(UserWarning, match=SILENT):
        motion = vi.simulate(
            system,
            vi.lobatto(2),
            q0=1,
            v0=0,
            h=2.3,
            steps=100,
            save_every=every,
            backend=backend,
        )
    assert np.abs(motion.q).max() > 1e20


@pytest.mark.parametrize("driven", ["drag", "time"])
def test_an_encounter_that_is_stepped_over_is_told_of(driven):
    system = kepler(1e-6) if driven == "drag" else kepler(0.0, vi.time())
    e = 0.9  # from pericentre, at the largest kinetic energy of the motion
    with pytest.warns(UserWarning, match=SILENT):
        vi.simulate(
            system,
            vi.trapezoidal(),
            q0=[1 - e, 0],
            v0=[0, np.sqrt((1 + e) / (1 - e))],
            h=0.1,
            steps=1000,
        )


@pytest.mark.parametrize("every", [1, 7, 100])
def test_scenes_that_gain_and_lose_much_energy_raise_no_false_alarm(every):
    t, u = vi.time(), ca.SX.sym("u")
    q, v = vi.coordinates("x")
    quiet = [
        (vi.System(q, v, v**2 / 2 - q**2 / 2, force=-0.5 * v), None),
        (vi.System(q, v, v**2 / 2 - q**2 / 2, force=ca.cos(t), t=t), None),
        (vi.System(q, v, v**2 / 2 - (1 + 0.3 * ca.cos(2 * t)) * q**2 / 2, t=t), None),
        (vi.System(q, v, v**2 / 2 + ca.cos(q), force=-3 * ca.tanh(v / 0.1)), None),
        (vi.System(q, v, v**2 / 2, force=u, control=u), np.sign(np.sin(np.arange(2000) / 30))),
        (vi.System(q, v, v**2 / 2, force=ca.if_else(t < 1, 100, -2 * v), t=t), None),
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for system, controls in quiet:
            vi.simulate(system, q0=1, v0=0, h=0.05, steps=2000, save_every=every, u=controls)


def bead_on_a_line_that_moves(omega: float) -> vi.System:
    """A spring along a line that goes up and down: what the line does is known, the spring's
    motion is not changed by it.
    """
    q, v = vi.coordinates("x", "y")
    t = vi.time()
    line = q[1] - 0.3 * ca.sin(2 * t) - 0.1 * q[0]
    return vi.System(q, v, ca.sumsqr(v) / 2 - omega**2 * q[0] ** 2 / 2, constraint=line, t=t)


def skate(omega: float, **more) -> vi.System:
    """ẏ = x ż: no work is done by what holds it."""
    q, v = vi.coordinates("x", "y", "z")
    rows = ca.horzcat(0, 1, -q[0])
    energy = ca.sumsqr(v) / 2 - omega**2 * ca.sumsqr(q) / 2
    return vi.System(q, v, energy, nonholonomic=rows, **more)


@pytest.mark.parametrize("backend", ["interpreted", "compiled"])
@pytest.mark.parametrize("scene", ["moving", "skate"])
def test_an_unstable_step_is_told_of_under_constraints_that_move_or_bind_velocities(scene, backend):
    system = bead_on_a_line_that_moves(2.3) if scene == "moving" else skate(2.3)
    start = ([1, 0.1], [0, 0.6]) if scene == "moving" else ([1, 0, 0], [0, 0, 0])
    run = dict(q0=start[0], v0=start[1], h=1.0, backend=backend)
    with pytest.warns(UserWarning, match=SILENT):
        motion = vi.simulate(system, vi.lobatto(2), **run, steps=60)
    assert np.abs(motion.q).max() > 1e6


def test_constraints_that_move_or_bind_velocities_raise_no_false_alarm():
    t, (q, v) = vi.time(), vi.coordinates("x", "y")
    pivot = q - ca.vertcat(0.5 * ca.sin(3 * t), 2 * t)
    swing = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.sumsqr(pivot) - 1, t=t)
    table = vi.System(
        q,
        v,
        ca.sumsqr(v) / 2 - 9.81 * q[1],
        contact=q[1] - 0.2 * ca.sin(9 * t),
        restitution=0.5,
        t=t,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vi.simulate(swing, q0=[0, -1], v0=[1.5, 2], h=0.02, steps=1000)
        vi.simulate(bead_on_a_line_that_moves(2.3), q0=[1, 0.1], v0=[0, 0.6], h=0.05, steps=1000)
        vi.simulate(skate(1.0), vi.lobatto(2), q0=[1, 0, 0.5], v0=[0, 1, 1], h=0.05, steps=1000)
        slowed = skate(1.0, force=ca.vertcat(0, 0, -1))
        vi.simulate(slowed, vi.lobatto(2), q0=[1, 0, 0.5], v0=[0, 1, 1], h=0.05, steps=1000)
        vi.simulate(table, q0=[0, 1], v0=[1, 0], h=0.01, steps=400)


def test_a_motion_that_comes_back_between_evenly_spaced_nodes_is_told_of():
    """Verlet turns by 8π/9 a step here, so that every ninth node has the energy of the start."""
    h, steps = 2 * np.sin(4 * np.pi / 9), 81 * 4
    with pytest.warns(UserWarning, match=SILENT):
        motion = vi.simulate(oscillator(), vi.composition("verlet"), q0=1, v0=0, h=h, steps=steps)
    even = motion.energy[:: steps // 9]
    assert np.ptp(even) < 1e-9 and np.ptp(motion.energy) > 0.4


@pytest.mark.parametrize("every", [1, 10])
@pytest.mark.parametrize("driven", ["drag", "time", "control"])
def test_members_of_an_ensemble_are_watched_under_forces_and_explicit_time(driven, every):
    t, u, c = vi.time(), ca.SX.sym("u"), vi.Parameters(k=1.0)
    q, v = vi.coordinates("x")
    more = {
        "drag": dict(force=-1e-3 * v),
        "time": dict(force=1e-3 * ca.cos(t), t=t),
        "control": dict(force=1e-3 * u, control=u),
    }[driven]
    system = vi.System(q, v, v**2 / 2 - c.k * q**2 / 2, params=c, **more)
    run = dict(q0=1, v0=0, h=1.0, steps=100, save_every=every, backend="interpreted")
    run |= dict(u=np.cos(np.arange(100.0))[:, None]) if driven == "control" else {}
    k = [0.1, 5.0, 0.2, 6.0]
    with pytest.warns(UserWarning, match=r"energy of 2 members .*members \[1, 3\]"):
        vi.ensemble(system, vi.lobatto(2), params={"k": k}, **run)


@pytest.mark.parametrize("every", [1, 7])
def test_members_that_gain_and_lose_much_energy_raise_no_false_alarm(every):
    t, c = vi.time(), vi.Parameters(k=1.0)
    q, v = vi.coordinates("x")
    for force in (-c.k * v, 5 * ca.cos(c.k * t), -ca.tanh(20 * v)):
        system = vi.System(q, v, v**2 / 2 - q**2 / 2, force=force, params=c, t=t)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            run = dict(q0=1, v0=0, h=0.05, steps=500, save_every=every, backend="interpreted")
            vi.ensemble(system, vi.gauss(1), params={"k": [0.1, 0.5, 1.0, 1.5]}, **run)
