"""Lagrangians whose momentum saturates: p = ∂L/∂v reaches a bounded range only, however fast the
motion.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import varint as vi
from varint.discrete.lagrangian import point_function

DURATION = 2.0


def soap_film(speed: float) -> tuple[vi.System, float, float]:
    """The catenoid's profile r(x) = cosh x, from where it has this slope."""
    q, v = vi.coordinates("r")
    return vi.System(q, v, q * ca.sqrt(1 + v**2)), float(np.sqrt(1 + speed**2)), speed


def light_ray(speed: float) -> tuple[vi.System, float, float]:
    """A mirage: the index of refraction grows with height."""
    q, v = vi.coordinates("y")
    return vi.System(q, v, (1 + 0.3 * q + 0.2 * ca.sin(q)) * ca.sqrt(1 + v**2)), 1.0, speed


def relativistic_particle(speed: float) -> tuple[vi.System, float, float]:
    q, v = vi.coordinates("x")
    return vi.System(q, v, -ca.sqrt(1 - v**2) - 2 * q**2), 1.0, speed


# slow, and so fast that a step's gain of momentum leads out of the range of ∂L/∂v
SCENES = [
    pytest.param((build, speed), id=f"{build.__name__} {speed}")
    for build, speed in (
        (soap_film, -0.5),
        (soap_film, 3.0),
        (light_ray, -0.3),
        (light_ray, 2.0),
        (relativistic_particle, 0.0),
        (relativistic_particle, 0.9),
    )
]
RULES = [vi.gauss(2), vi.gauss(4), vi.gauss(8)]


def hamilton(system: vi.System, v_of_p):
    """(q, p) → (dq/dt, dp/dt), by the Legendre transform in closed form."""
    gradient = ca.Function("g", [system.q, system.v], [ca.gradient(system.lagrangian, system.q)])

    def flow(q: float, p: float) -> tuple[float, float]:
        v = v_of_p(q, p)
        return v, float(gradient(q, v))

    return flow


def closed_form(build: Callable):
    """Velocity of a momentum, in closed form."""
    if build is relativistic_particle:
        return lambda q, p: p / np.sqrt(1 + p**2)

    def index(q):
        return q if build is soap_film else 1 + 0.3 * q + 0.2 * np.sin(q)

    return lambda q, p: p / np.sqrt(index(q) ** 2 - p**2)


@cache
def _reference(build: Callable, speed: float, times: tuple[float, ...]) -> np.ndarray:
    system, q0, v0 = build(speed)
    flow = hamilton(system, closed_form(build))
    p0 = float(np.asarray(point_function(system)(q0, v0, 0, 0, 0)[1]).item())
    lagrangian = ca.Function("L", [system.q, system.v], [system.lagrangian])

    def slope(_, x):
        v, force = flow(x[0], x[1])
        return [v, force, float(lagrangian(x[0], v))]

    found = solve_ivp(
        slope, (0, times[-1]), [q0, p0, 0.0], "DOP853", t_eval=times, rtol=1e-13, atol=1e-14
    )
    return found.y


def reference(scene, times: np.ndarray) -> np.ndarray:
    """q, p and the action along the motion by Dormand and Prince's eighth order, at 1e-13."""
    return _reference(*scene, tuple(times.tolist()))


def simulated(scene, rule: vi.Rule, h: float) -> vi.Trajectory:
    build, speed = scene
    system, q0, v0 = build(speed)
    return vi.simulate(system, rule, q0=q0, v0=v0, h=h, steps=round(DURATION / h))


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("rule", RULES, ids=str)
def test_motion_action_and_dense_output_have_the_order_of_the_rule(scene, rule):
    errors = []
    for h in (0.1, 0.05, 0.025):
        motion = simulated(scene, rule, h)
        q, p, action = reference(scene, motion.t)
        between = motion.t[:-1] + 0.37 * h
        energy = motion.energy
        errors.append(
            [
                np.abs(motion.q[:, 0] - q).max() / np.abs(q).max(),
                np.abs(motion.p[:, 0] - p).max() / np.abs(p).max(),
                abs(motion.action - action[-1]) / max(abs(action[-1]), 1),
                np.abs(energy - energy[0]).max() / (np.abs(q) + np.abs(p)).max(),
                np.abs(motion.at(between).q[:, 0] - reference(scene, between)[0]).max()
                / np.abs(q).max(),
            ]
        )
    errors = np.array(errors)
    floor = 2e-11  # of the reference, and of round-off times the growth along the motion
    for coarse, fine in pairwise(errors):
        order = np.log2(coarse / np.maximum(fine, 1e-300))
        assert ((order > rule.order - 0.7) | (fine < floor)).all(), errors
    assert (errors[-1] < {4: 3e-5, 8: 3e-9, 16: floor}[rule.order]).all(), errors


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("h", [0.1, 0.05, 0.025])
def test_every_step_solves_its_own_equations(scene, rule, h):
    """Gauss collocation of Hamilton's equations, stages by iteration, from each node to the
    next: no scale, no tolerance and no code of the stepper in it.
    """
    motion = simulated(scene, rule, h)
    build, speed = scene
    system, _, _ = build(speed)
    flow = hamilton(system, closed_form(build))
    nodes, weights = np.array(rule.nodes), np.array(rule.weights)
    powers = np.vander(nodes, increasing=True)
    integrals = nodes[:, None] * powers / np.arange(1, len(nodes) + 1)
    table = integrals @ np.linalg.inv(powers)
    assert motion.stats["residual"] < 1e-12
    for k in range(len(motion) - 1):
        q, p = motion.q[k, 0], motion.p[k, 0]
        v = np.zeros(len(nodes))
        f = np.zeros(len(nodes))
        for _ in range(200):
            pairs = [flow(*x) for x in zip(q + h * table @ v, p + h * table @ f, strict=True)]
            new_v, new_f = np.array(pairs).T
            change = max(np.abs(new_v - v).max(), np.abs(new_f - f).max())
            v, f = new_v, new_f
            if change < 1e-15:
                break
        slope = 1 + (1 + (v**2).max()) ** 1.5  # of v in p: what round-off of p does to v
        assert abs(motion.q[k + 1, 0] - q - h * weights @ v) < 1e-14 * slope
        assert abs(motion.p[k + 1, 0] - p - h * weights @ f) < 1e-14 * slope


def test_a_relativistic_particle_in_the_plane_keeps_its_angular_momentum():
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, -ca.sqrt(1 - ca.sumsqr(v)) - 5 * ca.sumsqr(q))
    motion = vi.simulate(system, vi.gauss(4), q0=[1, 0], v0=[0, 0.6], h=0.05, steps=2000)
    turned = motion.q[:, 0] * motion.p[:, 1] - motion.q[:, 1] * motion.p[:, 0]
    assert np.abs(turned - turned[0]).max() < 1e-13
    assert np.abs(motion.energy - motion.energy[0]).max() < 1e-2
    assert (np.sqrt((motion.v**2).sum(axis=1)) < 1).all()


@pytest.mark.parametrize("rule", RULES, ids=str)
@pytest.mark.parametrize("h", [0.1, 0.05, 0.025])
def test_a_steep_catenoid_is_the_hyperbolic_cosine(rule, h):
    """r = cosh up to 200: an energy off by a part in a thousand had a residual of 1e-20."""
    system, q0, v0 = soap_film(10.0)
    motion = vi.simulate(system, rule, q0=q0, v0=v0, h=h, steps=round(3 / h))
    exact = np.cosh(np.arcsinh(v0) + motion.t)
    error = np.abs(motion.q[:, 0] / exact - 1).max()
    assert error < (0.01 * h**4 if rule.order == 4 else 1e-11)
    assert np.abs(motion.energy / motion.energy[0] - 1).max() < 3e-11
