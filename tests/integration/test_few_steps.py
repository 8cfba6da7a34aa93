"""Runs of a few steps in one call of the core are those of the loops, and looked at as those."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.errors import ConvergenceError
from varint.integration import few_steps, fixed_steps

q1, v1 = vi.coordinates("theta")
q2, v2 = vi.coordinates("x", "y")
PENDULUM = vi.System(q1, v1, v1**2 / 2 + 9.81 * ca.cos(q1))
POLAR = vi.System(q2, v2, (v2[0] ** 2 + q2[0] ** 2 * v2[1] ** 2) / 2 - (q2[0] - 2) ** 2)
CHARGE = vi.System(
    q2, v2, ca.sumsqr(v2) / 2 + (q2[0] * v2[1] - q2[1] * v2[0]) / 2 - 1 / ca.norm_2(q2)
)
SCENES = {
    "pendulum": (PENDULUM, [2.0], [0.3]),
    "polar": (POLAR, [1.5, 0.2], [0.1, 1.0]),
    "charge": (CHARGE, [1.0, 0.1], [0.2, -0.4]),
}


@pytest.mark.parametrize("steps", [1, 9])
@pytest.mark.parametrize("rule", [None, vi.gauss(1), vi.gauss(4), vi.gauss(8)])
@pytest.mark.parametrize("scene", SCENES)
def test_a_few_steps_are_those_of_the_loop(monkeypatch, scene, rule, steps):
    system, q0, v0 = SCENES[scene]
    start = dict(q0=q0, v0=v0, h=-0.03, steps=steps, t0=0.7)
    few = vi.simulate(system, rule, **start)
    monkeypatch.setattr(few_steps, "FEW", 0)
    other = vi.simulate(system, rule, **start)
    for name in "tqpku":
        assert np.array_equal(getattr(few, name), getattr(other, name))
    for name in ("iterations", "residual", "steps", "backend"):
        assert few.stats[name] == other.stats[name]


def test_the_core_takes_runs_of_a_few_steps(monkeypatch):
    def none(*_):
        raise AssertionError("not by the core")

    monkeypatch.setattr(fixed_steps, "short_run", none)
    assert len(vi.simulate(PENDULUM, vi.gauss(4), q0=1.0, v0=0.0, h=0.1, steps=5)) == 6


def test_a_step_that_is_too_large_for_the_energy_is_told():
    with pytest.warns(UserWarning, match="the energy went from"):
        vi.simulate(PENDULUM, q0=3.1, v0=20.0, h=2.0, steps=5)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vi.simulate(PENDULUM, q0=3.1, v0=2.0, h=0.01, steps=5)


def test_an_energy_that_is_no_number_is_told():
    wall = vi.System(q1, v1, v1**2 / 2 - ca.log(1 - q1))
    with pytest.warns(UserWarning, match="the energy is not defined"):
        vi.simulate(wall, vi.gauss(4), q0=0.9, v0=30.0, h=0.5, steps=3)


def test_a_step_that_is_not_possible_ends_the_run():
    edge = vi.System(q1, v1, v1**2 / 2 + ca.sqrt(1 - q1))
    with pytest.raises(ConvergenceError):
        vi.simulate(edge, vi.gauss(4), q0=0.9, v0=3.0, h=0.5, steps=3)


SPRING_K = ca.SX.sym("k")
SPRING = vi.System(q1, v1, v1**2 / 2 - SPRING_K * q1**2 / 2, params={SPRING_K: 2.0})
ASKED = {"steps": dict(h=0.01, steps=3), "tol": dict(duration=1.0, tol=1e-6)}


@pytest.mark.parametrize("asked", ASKED)
@pytest.mark.parametrize(
    "bad", [np.nan, -np.inf, "one", [1.0, 2.0], [[1.0]], [None], [], True, 1j, 10**400, [10**400]]
)
def test_what_is_no_start_is_refused_between_those_that_are(asked, bad):
    how = ASKED[asked]
    good = vi.simulate(PENDULUM, q0=[1.0], v0=[0.5], **how)
    for start in (dict(q0=bad, v0=[0.5]), dict(q0=[1.0], v0=bad)):
        if bad is True:  # a number for Python, and for NumPy
            assert len(vi.simulate(PENDULUM, **start, **how)) == len(good)
            continue
        with pytest.raises(vi.InputError, match="q0" if start["q0"] is bad else "v0"):
            vi.simulate(PENDULUM, **start, **how)
    again = vi.simulate(PENDULUM, q0=[1.0], v0=[0.5], **how)
    assert again.q.tobytes() == good.q.tobytes() and again.p.tobytes() == good.p.tobytes()


@pytest.mark.parametrize("asked", ASKED)
def test_numbers_of_any_kind_are_the_same_start(asked):
    kinds = [2.0], (2,), 2, np.array([2.0]), np.array([2], dtype=np.int32), np.float32(2), ["2"]
    found = [vi.simulate(PENDULUM, q0=x, v0=x, t0=1, **ASKED[asked]) for x in kinds]
    assert len({(x.t.tobytes(), x.q.tobytes(), x.p.tobytes()) for x in found}) == 1


@pytest.mark.parametrize("asked", ASKED)
def test_parameters_of_a_call_are_not_those_of_the_next(asked):
    def run(k):
        params = None if k is None else {"k": k}
        return vi.simulate(SPRING, q0=1.0, v0=0.0, params=params, **ASKED[asked])

    first, stiff = run(None), run(5.0)
    with pytest.raises(vi.InputError):
        run(np.nan)
    assert run(None).q.tobytes() == first.q.tobytes() == run(2.0).q.tobytes()
    assert run(5.0).q.tobytes() == stiff.q.tobytes() != first.q.tobytes()


@pytest.mark.parametrize(
    "name, value", [("steps", True), ("steps", 3.0), ("steps", 0), ("h", np.nan), ("h", 0.0)]
)
def test_a_grid_that_is_none_is_refused_after_one_that_is(name, value):
    grid = dict(h=0.1, steps=3)
    vi.simulate(PENDULUM, q0=1.0, v0=0.0, **grid)
    with pytest.raises(vi.InputError, match=f"{name} must"):
        vi.simulate(PENDULUM, q0=1.0, v0=0.0, **(grid | {name: value}))
