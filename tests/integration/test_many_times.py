"""Many times within a step: found all at once, as accurately as the nodes, in whatever way they are
asked for.
"""

from __future__ import annotations

import dataclasses

import casadi as ca
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.special import ellipj, ellipk

import varint as vi
from varint.codegen.gauss import gauss_kernel
from varint.codegen.native import native_gauss
from varint.codegen.times import states_at_times
from varint.codegen.within_steps import NOTHING_WITHIN, tables_of, within
from varint.integration.many_times import MANY, looking_of

MOST = vi.gauss(16)


def _pendulum() -> vi.System:
    q, v = vi.coordinates("a")
    return vi.System(q, v, v**2 / 2 + ca.cos(q))


def _stars() -> vi.System:
    q, v = vi.coordinates("x", "y")
    potential = ca.sumsqr(q) / 2 + q[0] ** 2 * q[1] - q[1] ** 3 / 3
    return vi.System(q, v, ca.sumsqr(v) / 2 - potential)


def _double() -> vi.System:
    q, v = vi.coordinates("a", "b")
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    return vi.System(q, v, kinetic + 2 * ca.cos(q[0]) + ca.cos(q[1]))


def _driven() -> vi.System:
    (q, v), t = vi.coordinates("a"), vi.time()
    return vi.System(q, v, v**2 / 2 + ca.cos(q), force=ca.cos(0.7 * t) - 0.1 * v, t=t)


def _fast() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, 1 - ca.sqrt(1 - v**2) - q**2 / 2)


SCENES = {
    "unknown accelerations": (_stars, [0.1, 0.1], [0.3, 0.1]),
    "unknown velocities": (_double, [1.0, 0.7], [0.0, 0.2]),
    "explicit time": (_driven, 0.5, 0.0),
    "Legendre transform without a formula": (_fast, 0.8, 0.0),
}


def _springs() -> vi.System:
    q, v = vi.coordinates("x", "y")
    force = ca.vertcat(v[1], -v[0])  # a magnetic field, of a scene that is one linear map
    return vi.System(q, v, ca.sumsqr(v) / 2 - q[0] ** 2 / 2 - q[1] ** 2, force=force)


def _by_steps(motion: vi.Trajectory, t: np.ndarray) -> tuple[np.ndarray, ...]:
    """q, p and k by shorter steps of the motion's own rule."""
    nodes = motion.t, motion.q, motion.p, motion.k
    kernel = native_gauss(motion.system, motion.rule)
    found = states_at_times(kernel, nodes, motion.c, (motion.h, 0.0), t)
    assert found is not None
    return found


def _pendulum_at(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From rest at one radian: Abramowitz & Stegun (1964), chapter 16."""
    m = np.sin(0.5) ** 2
    sn, cn, _, _ = ellipj(ellipk(m) - t, m)
    return 2 * np.arcsin(np.sin(0.5) * sn), 2 * np.sin(0.5) * -cn


@pytest.mark.parametrize("tol", [1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("backwards", [False, True])
def test_a_thousand_times_are_as_accurate_as_the_nodes(tol, backwards):
    t = np.linspace(0.0, 20.0, 1000) * (-1 if backwards else 1)
    motion = vi.simulate(_pendulum(), q0=1.0, v0=0.0, at=t, tol=tol)
    nodes = vi.simulate(_pendulum(), q0=1.0, v0=0.0, duration=t[-1], tol=tol)
    assert len(nodes) < 100

    def error(x):
        q, v = _pendulum_at(np.abs(x.t))
        return max(np.abs(x.q[:, 0] - q).max(), np.abs(x.p[:, 0] - np.sign(t[-1]) * v).max())

    assert error(motion) <= 1.5 * error(nodes) + 1e-3 * tol + 1e-14
    drift = np.ptp(motion.energy)
    assert drift <= 1.5 * np.ptp(nodes.energy) + 1e-14


@pytest.mark.parametrize("name", SCENES)
def test_they_agree_with_shorter_steps_of_the_rule(name):
    make, q0, v0 = SCENES[name]
    system = make()
    motion = vi.simulate(system, q0=q0, v0=v0, duration=10.0)
    t = np.linspace(0.0, 10.0, 1500)
    found, (q, p, k) = motion.at(t), _by_steps(motion, t)
    np.testing.assert_array_equal(found.k, k)
    for one, other in ((found.q, q), (found.p, p)):
        assert 0 < np.abs(one - other).max() <= 1e-12
    few = motion.at(t[: MANY - 1])
    np.testing.assert_array_equal(few.q, q[: MANY - 1])


@pytest.mark.parametrize("name", SCENES)
def test_all_ways_to_ask_give_the_same_bytes(name):
    make, q0, v0 = SCENES[name]
    system, t = make(), np.linspace(0.0, 10.0, 700)
    asked = vi.simulate(system, q0=q0, v0=v0, at=t)
    later = vi.simulate(system, q0=q0, v0=v0, duration=10.0).at(t)
    member = vi.ensemble(system, q0=[q0, q0], v0=[v0, v0], at=t)[1]
    for other in (later, member):
        for at in ("q", "p", "k"):
            assert getattr(other, at).tobytes() == getattr(asked, at).tobytes()


@pytest.mark.parametrize("count", [7, 8, 40, 900])
def test_linear_scenes_are_where_their_exponential_has_them(count):
    t = np.linspace(0.0, 12.0, count)
    motion = vi.simulate(_springs(), q0=[1.0, 0.2], v0=[0.0, 0.5], at=t)
    later = vi.simulate(_springs(), q0=[1.0, 0.2], v0=[0.0, 0.5], duration=12.0).at(t)
    rates = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-1, 0, 0, 1], [0, -2, -1, 0]], float)
    exact = np.array([expm(rates * x) @ [1.0, 0.2, 0.0, 0.5] for x in t])
    assert np.abs(np.hstack((motion.q, motion.v)) - exact).max() <= 1e-10
    assert later.q.tobytes() == motion.q.tobytes()
    assert later.p.tobytes() == motion.p.tobytes()


@pytest.mark.parametrize("e", [0.8, 0.97])
@pytest.mark.parametrize("tol", [1e-4, 1e-9])
def test_times_that_a_clock_shows_are_those_of_the_ellipse(e, tol):
    model = vi.models.kepler(e=e)
    t = np.linspace(0.0, 20.0, 800)
    start = {"q0": model.q0, "v0": model.v0, "tol": tol}
    motion = vi.simulate(model.system, **start, at=t)
    nodes = vi.simulate(model.system, **start, duration=20.0)
    assert nodes.fictitious is not None
    inner = motion.fictitious
    assert np.abs(inner.q[:, -1] - inner.q[0, -1] - t).max() <= 1e-13

    def errors(x):
        q, v = model.exact(x.t)
        return np.abs(x.q - q).max(), np.abs(x.v - v).max()

    for found, own in zip(errors(motion), errors(nodes), strict=True):
        assert found <= 2 * own + 1e-12
    assert np.ptp(motion.energy) <= 1.5 * np.ptp(nodes.energy) + 1e-13
    assert motion.q.tobytes() == nodes.at(t).q.tobytes()
    # in another order each time is looked for on its own
    order = np.argsort(np.sin(np.arange(len(t))))
    alone = nodes.at(t[order])
    assert 0 < np.abs(alone.q - motion.q[order]).max() <= 1e-11


@pytest.mark.parametrize("tol", [1e-4, 1e-9])
def test_steps_of_more_than_one_size_are_looked_at_in_the_same_way(tol):
    q, v = vi.coordinates("a")
    system = vi.System(q, v, v**2 / 2 + 9.81 * ca.cos(q), force=-1.5 * v)
    start, t = {"q0": 1.2, "v0": 0.3}, np.linspace(0.0, 60.0, 2000)
    motion = vi.simulate(system, **start, duration=60.0, tol=tol)
    assert motion.sizes is not None and np.ptp(motion.sizes) > 0.01
    found = motion.at(t)
    again = dataclasses.replace(motion, functions=motion.functions._replace(at_once=None))
    steps = again.at(t)
    assert 0 < np.abs(found.q - steps.q).max() <= 1e-2 * tol
    assert np.abs(found.p - steps.p).max() <= 1e-2 * tol
    np.testing.assert_array_equal(found.k, steps.k)
    few = t[:: len(t) // 20]
    np.testing.assert_array_equal(motion.at(few).q, again.at(few).q)
    asked = vi.simulate(system, **start, at=t, tol=tol)
    assert asked.q.tobytes() == found.q.tobytes()


@pytest.mark.parametrize("name", SCENES)
def test_both_gears_give_the_same_bytes(name):
    make, q0, v0 = SCENES[name]
    system, t = make(), np.linspace(0.0, 10.0, 700)
    motion = vi.simulate(system, q0=q0, v0=v0, duration=10.0)
    nodes = motion.t, motion.q, motion.p, motion.k
    own = native_gauss(system, motion.rule)
    kernels = native_gauss(system, MOST), gauss_kernel(system, MOST)
    ways = [within(x, motion.rule.order, 3) for x in kernels]
    steps, low, high = (
        states_at_times(own, nodes, motion.c, (motion.h, 0.0), t, way)
        for way in (NOTHING_WITHIN, *ways)
    )
    for one, other in zip(low, high, strict=True):
        assert one.tobytes() == other.tobytes()
    assert low[0].tobytes() != steps[0].tobytes()


def test_where_forces_have_kinks_shorter_steps_are_taken():
    q, v = vi.coordinates("x")
    system = vi.System(q, v, v**2 / 2 - q**2 / 2 - ca.fabs(q) ** 3)
    t = np.linspace(0.0, 6.0, 600)
    motion = vi.simulate(system, vi.gauss(8), q0=1.0, v0=0.0, h=0.5, steps=12)
    found, steps = motion.at(t), _by_steps(motion, t)[0]
    passed = np.flatnonzero(np.diff(np.sign(motion.q[:, 0])))
    assert len(passed) > 1
    through = np.isin(found.k, motion.k[passed])
    np.testing.assert_array_equal(found.q[through], steps[through])
    assert not np.array_equal(found.q[~through], steps[~through])


@pytest.mark.parametrize("stages", [1, 2, 3])
def test_rules_of_few_stages_are_looked_at_by_their_own_steps(stages):
    assert looking_of(_stars(), vi.gauss(stages)) is None
    assert looking_of(_stars(), vi.gauss(4)) is not None


def test_steps_that_err_by_much_are_looked_at_by_their_own_steps():
    motion = vi.simulate(_stars(), vi.gauss(4), q0=[0.3, 0.1], v0=[0.3, 0.1], h=2.0, steps=10)
    t = np.linspace(0.0, 20.0, 300)
    np.testing.assert_array_equal(motion.at(t).q, _by_steps(motion, t)[0])


@pytest.mark.parametrize("stages", [4, 16])
def test_the_tables_integrate_polynomials_exactly(stages):
    modes, first, second = tables_of(stages).reshape(3, stages, stages)
    c, b = np.array(vi.gauss(stages).nodes), np.array(vi.gauss(stages).weights)
    x = np.linspace(0.0, 1.0, 23)
    powers = np.vander(2 * x - 1, stages, increasing=True)
    for k in range(stages):
        a = (b * c**k) @ modes
        once, twice = x * (powers @ (a @ first)), x**2 * (powers @ (a @ second))
        np.testing.assert_allclose(once, x ** (k + 1) / (k + 1), atol=1e-14)
        np.testing.assert_allclose(twice, x ** (k + 2) / (k + 1) / (k + 2), atol=1e-14)
