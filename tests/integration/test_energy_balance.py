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
