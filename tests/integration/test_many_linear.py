"""Linear scenes of many coordinates: a step is one map, and nothing else is built before it."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm

import varint as vi
import varint.codegen.native_newton as native_newton
import varint.codegen.newton as newton_loop
from varint.integration import compiled_loop
from varint.integration.compiled_loop import kernel_of, native_kernel
from varint.integration.error_scale import error_scales, scales_of_nodes
from varint.integration.gears import BY_STAGES, newton, scheme_of


def network(n, damping=0.0, spread=1.0, drive=0.0):
    """Masses on three springs each, with dampers beside them, the first one shaken: the scene and
    x' = A x of x = (q, v, cos, sin).
    """
    g = np.random.default_rng(n)
    stiffness, friction = np.eye(n), np.zeros((n, n))
    for i in range(n):
        for j in g.integers(0, n, 3):
            unit = np.eye(n)[i] - np.eye(n)[j]
            stiffness += spread ** g.random() * np.outer(unit, unit)
            friction += damping * spread ** g.random() * np.outer(unit, unit)
    a = np.zeros((2 * n + 2, 2 * n + 2))
    a[:n, n : 2 * n], a[n : 2 * n, :n], a[n : 2 * n, n : 2 * n] = np.eye(n), -stiffness, -friction
    a[n, 2 * n], a[-2, -1], a[-1, -2] = drive, -2.0, 2.0
    q, v = vi.coordinates(*(f"u{i}" for i in range(n)))
    lagrangian = ca.sumsqr(v) / 2 - ca.bilin(ca.sparsify(ca.DM(stiffness)), q, q) / 2
    force, t = -(ca.sparsify(ca.DM(friction)) @ v), {}
    if drive:
        t = {"t": vi.time()}
        force[0] += drive * ca.cos(2 * t["t"])
    return vi.System(q, v, lagrangian, **({"force": force} if damping or drive else {}), **t), a


def start(n):
    g = np.random.default_rng(7)
    return {"q0": g.normal(size=n), "v0": g.normal(size=n)}


def exact(a, begin, duration):
    x = np.concatenate((begin["q0"], begin["v0"], [1.0, 0.0]))
    return (expm(a * duration) @ x)[: len(begin["q0"])]


def error_of(system, motion, a, begin, duration):
    off = np.abs(motion.q[-1] - exact(a, begin, duration))
    return (off / error_scales(system, motion)).max()


def never(*_, **__):
    raise AssertionError("it is not needed")


@pytest.mark.parametrize("tol", [1e-4, 1e-9])
@pytest.mark.parametrize("n", [13, 30, 60, 90])
@pytest.mark.parametrize("kind", ["free", "damped", "driven", "uneven"])
def test_a_default_call_takes_the_map_alone(monkeypatch, kind, n, tol):
    """What solves the steps of 60 masses with dampers took 113 s to build."""
    how = {
        "free": {},
        "damped": {"damping": 0.1},
        "driven": {"damping": 0.1, "drive": 0.5},
        "uneven": {"damping": 0.02, "spread": 30.0},
    }
    (system, a), begin = network(n, **how[kind]), start(n)
    monkeypatch.setattr(native_newton, "newton_routines", never)
    monkeypatch.setattr(newton_loop, "newton_routines", never)
    motion = vi.simulate(system, **begin, duration=8.0, tol=tol, progress=False)
    assert "one linear map a step" in motion.stats["backend"]
    assert error_of(system, motion, a, begin, 8.0) <= tol
    assert motion.stats["error_estimate"] <= tol


def test_ends_events_and_times_are_those_of_the_motion():
    (system, a), begin = network(40, damping=0.1), start(40)
    times = np.linspace(0, 6.0, 7)
    looked = vi.simulate(system, **begin, duration=6.0, at=times, progress=False)
    for t, q in zip(times, looked.q, strict=True):
        assert q == pytest.approx(exact(a, begin, t), abs=3e-9)
    crossing = {"events": {"first": system.q[0]}}
    seen = vi.simulate(system, **begin, duration=6.0, progress=False, **crossing)
    assert seen.events
    for event in seen.events:
        assert abs(exact(a, begin, event.time)[0]) < 3e-9
    until = vi.simulate(system, **begin, duration=6.0, until=system.q[0], progress=False)
    assert until.t[-1] == pytest.approx(seen.events[0].time, abs=1e-8)


@pytest.mark.parametrize("damping", [30.0, 1e3, 1e4])
@pytest.mark.parametrize("n", [2, 20])
def test_steps_that_are_too_long_for_powers_of_their_map_are_not_taken(n, damping):
    """Of h A beyond some twenty they leave nothing of what is slow: runs by such maps agreed late
    or never, and 20 masses with dampers of 1e3 went the long way for a second.
    """
    (system, a), begin = network(n, damping=damping), start(n)
    for tol in (1e-3, 1e-6):
        motion = vi.simulate(system, **begin, duration=0.5, tol=tol, progress=False)
        assert error_of(system, motion, a, begin, 0.5) <= tol
        assert "one linear map a step" in motion.stats["backend"]
        assert motion.stats["runs"] <= 3


def test_steps_are_solved_at_once_where_that_is_no_long_list():
    rule = vi.gauss(8)
    assert scheme_of(network(12, damping=0.1)[0], rule) is newton()
    assert scheme_of(network(60, damping=0.1)[0], rule) is BY_STAGES
    assert scheme_of(network(20, damping=0.1, spread=30.0)[0], rule) is BY_STAGES
    assert scheme_of(network(60, damping=0.1)[0], vi.gauss(2)) is newton()


def test_stages_of_linear_scenes_have_the_same_bytes_in_both_gears():
    (system, a), begin = network(45, damping=0.1), start(45)
    rule, asked = vi.gauss(8), {**begin, "h": 0.1, "steps": 30, "progress": False}
    assert native_kernel(system, rule) is not kernel_of(system, rule)
    one, other = (vi.simulate(system, rule, **asked, backend=x) for x in ("native", "compiled"))
    assert one.q.tobytes() == other.q.tobytes() and one.p.tobytes() == other.p.tobytes()
    assert one.q[-1] == pytest.approx(exact(a, begin, 3.0), abs=1e-10)


def test_a_beam_is_not_stepped_by_what_is_interpreted(monkeypatch):
    """Of 20 elements, 2e4 radians: coarse runs failed, and were made once more, for 120 s."""
    n = 40
    size = 2 / n
    bend = np.array(
        [
            [12, 6 * size, -12, 6 * size],
            [6 * size, 4 * size**2, -6 * size, 2 * size**2],
            [-12, -6 * size, 12, -6 * size],
            [6 * size, 2 * size**2, -6 * size, 4 * size**2],
        ]
    )
    inert = np.array(
        [
            [156, 22 * size, 54, -13 * size],
            [22 * size, 4 * size**2, 13 * size, -3 * size**2],
            [54, 13 * size, 156, -22 * size],
            [-13 * size, -3 * size**2, -22 * size, 4 * size**2],
        ]
    )
    stiffness, mass = np.zeros((n + 2, n + 2)), np.zeros((n + 2, n + 2))
    for k in range(0, n, 2):
        stiffness[k : k + 4, k : k + 4] += bend / size**3
        mass[k : k + 4, k : k + 4] += inert * size / 420
    matrices = (ca.sparsify(ca.DM(x[2:, 2:])) for x in (mass, stiffness))
    q, v = vi.coordinates(*(f"{kind}{i}" for i in range(n // 2) for kind in "wr"))
    inertia, springs = (ca.bilin(m, x, x) / 2 for m, x in zip(matrices, (v, q), strict=True))
    beam = vi.System(q, v, inertia - springs)
    x = np.arange(1, n // 2 + 1) * size
    begin = {"q0": np.array([0.05 * x**2 * (3 - x), 0.1 * (3 * x - 1.5 * x**2)]).T.ravel()}
    monkeypatch.setattr(compiled_loop, "interpreted_blocks", never)
    one, other = (
        vi.simulate(beam, **begin, v0=np.zeros(n), duration=0.5, tol=tol, progress=False)
        for tol in (1e-9, 1e-8)
    )
    assert one.stats["error_estimate"] <= 1e-9
    assert one.q[-1] == pytest.approx(other.q[-1], abs=1e-8 * np.abs(one.q).max())


def test_coordinates_that_went_off_have_infinite_scales_and_no_overflow():
    """Python's x**2 raises beyond 1e154: a coarse run of a long beam ended a call so."""
    (system, _), q = network(13), np.zeros((3, 13))
    q[1] = 1e200
    with np.errstate(over="ignore"):
        scales = scales_of_nodes(system, q, np.zeros(13), np.zeros(1), np.zeros(0))
    assert (scales >= 1e200).all()
