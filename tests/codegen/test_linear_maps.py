"""Steps of linear scenes as one affine map, found in numbers: exact to round-off, driven or not."""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.codegen.cache import compiler

MAP = "one constant linear map a step"
RULES = [vi.midpoint(), vi.gauss(2), vi.lobatto(3), vi.gauss(4)]


def plate(slow: float = 1.0, unit: float = 1.0) -> vi.System:
    """Two coupled oscillators in a magnetic field, x in another unit."""
    q, v = vi.coordinates("x", "y")
    x, y, vx, vy = q[0] / unit, q[1], v[0] / unit, v[1]
    kinetic = vx**2 / 2 + vy**2 + 0.3 * vx * vy + 0.4 * (x * vy - y * vx)
    return vi.System(q, v, kinetic - 2 * slow * x**2 - 3 * y**2 + 0.5 * slow * x * y)


def driven() -> vi.System:
    """Coupled inertia, a large constant force, damping, time and a control."""
    q, v = vi.coordinates("x", "y")
    t, u = vi.time(), ca.SX.sym("u")
    kinetic = v[0] ** 2 / 2 + v[1] ** 2 + 0.3 * v[0] * v[1]
    potential = 2 * q[0] ** 2 + 3 * q[1] ** 2 - 0.5 * q[0] * q[1] - 1e3 * q[0]
    force = ca.vertcat(ca.sin(t) - 0.1 * v[0], 2 * u)
    return vi.System(q, v, kinetic - potential, force=force, control=u, t=t)


@pytest.mark.parametrize("rule", RULES, ids=str)
def test_the_map_is_what_newtons_method_finds_also_with_time_and_controls(rule):
    for scene, more in ((plate(), {}), (driven(), {"u": np.sin(np.arange(60) / 10)[:, None]})):
        run = {"q0": [1.0, 0.2], "v0": [0.1, 0.3], "h": 0.1, "steps": 60, **more}
        mapped = vi.simulate(scene, rule, **run, backend="native")
        solved = vi.simulate(scene, rule, **run, backend="interpreted")
        assert mapped.stats["backend"] == f"native: {MAP}"
        assert mapped.stats["residual"] < 1e-14
        size = np.abs(solved.q).max()
        assert np.abs(mapped.q - solved.q).max() < 1e-13 * size
        assert np.abs(mapped.p - solved.p).max() < 1e-13 * np.abs(solved.p).max()


@pytest.mark.parametrize("backend", ("native", "interpreted"))
@pytest.mark.parametrize("unit", (1e-8, 1e8))
def test_a_linear_scene_moves_alike_in_all_units(unit, backend):
    """Matrices of steps are not taken for singular because their numbers are small."""
    run = {"h": 0.1, "steps": 60, "backend": backend}
    here = vi.simulate(plate(), vi.gauss(2), q0=[1, 0.2], v0=[0.1, 0.3], **run)
    there = vi.simulate(plate(unit=unit), vi.gauss(2), q0=[unit, 0.2], v0=[0.1 * unit, 0.3], **run)
    assert np.abs(there.q / [unit, 1] - here.q).max() < 1e-12


@pytest.mark.skipif(compiler() is None, reason="no C compiler")
def test_the_map_has_the_same_bytes_in_both_gears():
    run = {"q0": [1.0, 0.2], "v0": [0.1, 0.3], "h": 0.1, "steps": 3000, "save_every": 30}
    table = np.sin(np.arange(3000) / 10)[:, None]
    for scene, more in ((plate(), {}), (driven(), {"u": table})):
        low, high = (
            vi.simulate(scene, vi.gauss(2), **run, **more, backend=backend)
            for backend in ("native", "compiled")
        )
        assert low.q.tobytes() == high.q.tobytes() and low.p.tobytes() == high.p.tobytes()


@pytest.mark.parametrize("unit", (1.0, 1e8))
@pytest.mark.parametrize("slow", (1.0, 1e-10))
@pytest.mark.parametrize("rule", RULES, ids=str)
def test_gauss_rules_keep_quadratic_invariants_whatever_the_units(rule, unit, slow):
    """And Lobatto rules an energy nearby: none of them drifts over 20,000 steps."""
    scene = plate(slow, unit)
    run = {"q0": [unit, 0.2], "v0": [0.1 * unit, 0.3], "h": 0.1, "steps": 20_000}
    motion = vi.simulate(scene, rule, **run, save_every=100, backend="native")
    energy = motion.energy
    if rule == vi.lobatto(3):
        early, late = np.ptp(energy[:50]), np.ptp(energy[-50:])
        assert 0 < late < 1.5 * early
    else:
        # each step repeats the last digits of the same matrices
        assert np.abs(energy / energy[0] - 1).max() < 1e-16 * 20_000
