"""Scenes that several tests share, each nonlinear enough to show an order or a defect."""

from __future__ import annotations

import casadi as ca
import numpy as np

import varint as vi

GALERKIN = [vi.gauss(s) for s in range(1, 11)] + [vi.lobatto(s) for s in range(2, 11)]
COMPOSITIONS = [
    vi.composition(name)
    for name in (
        "verlet",
        "yoshida4",
        "yoshida6",
        "yoshida8",
        "suzuki4",
        "blanes-moan4",
        "blanes-moan6",
        "kahan-li6",
        "kahan-li8",
        "sofroniou-spaletta10",
    )
]


def pendulum() -> vi.System:
    """Separable, one degree of freedom."""
    q, v = vi.coordinates("theta")
    return vi.System(q, v, v**2 / 2 + ca.cos(q))


def henon_heiles() -> vi.System:
    """Separable, two degrees of freedom."""
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, (ca.sumsqr(v) - ca.sumsqr(q)) / 2 - q[0] ** 2 * q[1] + q[1] ** 3 / 3)


def double_pendulum() -> vi.System:
    """Mass matrix depends on q."""
    q, v = vi.coordinates("a", "b")
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    return vi.System(q, v, kinetic + 9.81 * (2 * ca.cos(q[0]) + ca.cos(q[1])))


def cart_pendulum() -> vi.System:
    """A cyclic coordinate and a mass matrix that depends on q."""
    q, v = vi.coordinates("x", "theta")
    kinetic = v[0] ** 2 + v[0] * v[1] * ca.cos(q[1]) + v[1] ** 2 / 2
    return vi.System(q, v, kinetic + 9.81 * ca.cos(q[1]))


def driven_damped() -> vi.System:
    """A force that depends on velocity and time, and a Lagrangian that depends on time."""
    q, v, t = *vi.coordinates("a", "b"), vi.time()
    lagrangian = (
        (v[0] ** 2 + (1 + q[0] ** 2) * v[1] ** 2) / 2
        + ca.cos(q[0]) * (1 + ca.sin(2 * t) / 2)
        - q[1] ** 2
    )
    force = ca.vertcat(-0.3 * v[0] + ca.cos(3 * t), -0.1 * v[1] ** 3 + 0.2 * q[0])
    return vi.System(q, v, lagrangian, force=force, t=t)


def end_error(motion: vi.Trajectory, exact: vi.Trajectory) -> tuple[float, float]:
    """Largest error of q and of p at the last node."""
    return float(np.abs(motion.q[-1] - exact.q[-1]).max()), float(
        np.abs(motion.p[-1] - exact.p[-1]).max()
    )


def slopes(steps: list[int], errors: np.ndarray, floor: float) -> np.ndarray:
    """Observed orders from the three finest step numbers whose errors lie above the round-off
    floor.
    """
    good = [i for i in range(len(steps)) if (errors[i] > floor).all()][-3:]
    assert len(good) == 3, f"fewer than three errors above the floor {floor}: {errors}"
    x, y = np.log([steps[i] for i in good]), np.log(errors[good])
    return -np.array([np.polyfit(x, column, 1)[0] for column in y.T])


def rocking() -> vi.System:
    """Two balls and a floor: impacts, bodies that come to rest and contacts that hold."""
    q, v = vi.coordinates("x", "y", "z")
    gaps = ca.vertcat(q[1], q[2] - q[1], 2.0 - q[0])
    fall = ca.sumsqr(v) / 2 - 9.81 * (q[1] + q[2]) - 0.3 * q[0] ** 2
    return vi.System(q, v, fall, contact=gaps, restitution=[0.5, 0.8, 1.0])


def cartesian_pendulum(gravity=9.81) -> vi.System:
    """A bob on a rod, in Cartesian coordinates."""
    q, v = vi.coordinates("x", "y")
    return vi.System(q, v, ca.sumsqr(v) / 2 - gravity * q[1], constraint=ca.sumsqr(q) - 1)


def resting_chain() -> vi.System:
    """Nine links, every second one light, that stiff springs and dampers bring to rest within
    seconds: of its speeds nothing is left but round-off of the springs.
    """
    q, v = vi.coordinates(*[f"a{i}" for i in range(9)])
    kinetic = height = vx = vy = y = 0
    for i in range(9):
        mass = 3.0 if i % 2 else 0.03
        vx, vy = vx + 0.3 * ca.cos(q[i]) * v[i], vy + 0.3 * ca.sin(q[i]) * v[i]
        y = y - 0.3 * ca.cos(q[i])
        kinetic += mass / 2 * (vx**2 + vy**2) + mass * 0.00375 * v[i] ** 2
        height += mass * y
    pull = -600 * (v - ca.vertcat(0, v[:-1]))
    springs = -1000 * (q - np.linspace(-0.8, 0.8, 9)) - 3 * v
    force = springs + pull - ca.vertcat(pull[1:], 0)
    return vi.System(q, v, kinetic - 9.81 * height, force=force)


def damped_beam(elements: int = 10) -> vi.System:
    """A cantilever of stiff links whose joints are damped: rates of 13 to 5000."""
    q, v = vi.coordinates(*[f"a{i}" for i in range(elements)])
    part, kinetic, potential, y, vx, vy = 1 / elements, 0.0, 0.0, 0.0, 0.0, 0.0
    bends, rates = q - ca.vertcat(0, q[:-1]), v - ca.vertcat(0, v[:-1])
    for i in range(elements):
        vx, vy = vx - part * ca.sin(q[i]) * v[i], vy + part * ca.cos(q[i]) * v[i]
        y = y + part * ca.sin(q[i])
        kinetic += part / 2 * (vx**2 + vy**2) + part**3 / 24 * v[i] ** 2
        potential += part * 9.81 * y
    potential += 10 * elements * ca.sumsqr(bends)
    damping = 0.05 * elements * (rates - ca.vertcat(rates[1:], 0))
    return vi.System(q, v, kinetic - potential, force=-damping)
