"""What judges the answers of lessons 5 to 8: oscillations, orbits, phase space, rigid bodies."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.course.judges import (
    CLOSE,
    TYPED,
    accelerations,
    expression_of,
    numbers,
    numbers_of,
    random_states,
    values_of,
)
from varint.integration.simulate import simulate
from varint.models.pendulums import double_pendulum
from varint.models.tops import body_rates, euler_rates, free_rigid_body, heavy_top
from varint.scene.system import System, coordinates

SHORT = 1e-6  # of a step that shows its rate of change
RATE_ERROR = 1e-4  # of that rate, relative: its next term is of the size of SHORT
STAYS = 1e-3  # of a radius or an angle that should be constant, along three revolutions


def frequencies(system: System) -> np.ndarray:
    """Those of small oscillations about q = 0, rising: ω² M x = K x."""
    rest = ca.DM.zeros(system.structure.n)
    parts = [system.mass_matrix, -ca.hessian(system.lagrangian, system.q)[0]]
    mass, stiffness = ca.Function("linear", [system.q, system.v, system.c], parts)(
        rest, rest, system.default_vector
    )
    squares = np.linalg.eigvals(np.linalg.solve(mass.full(), stiffness.full()))
    return np.sqrt(np.sort(squares.real))


def double_pendulum_frequencies(answer: Any) -> str:
    model = double_pendulum()
    return numbers(answer, frequencies(model.system), "frequency of it")


def coupling(answer: Any) -> str:
    """The normal modes drift apart by half a turn in the time that hands all motion over."""
    [k] = numbers_of(answer, 1)
    x, v = coordinates("x1", "x2")
    scene = System(x, v, ca.sumsqr(v) / 2 - 2 * ca.sumsqr(x) - k * (x[0] - x[1]) ** 2 / 2)
    if not k > 0:
        return "the coupling must be a positive number"
    slow, fast = frequencies(scene)
    time = np.pi / (fast - slow)
    return "" if abs(time - 20) <= TYPED * 20 else f"with {k:.6g} it takes {time:.5g} s"


def circular_speed(answer: Any) -> str:
    [speed] = numbers_of(answer, 1)
    q, v = coordinates("x", "y")
    orbit = simulate(
        System(q, v, ca.sumsqr(v) / 2 - ca.sumsqr(q) ** 2 / 4),
        q0=[2, 0],
        v0=[0, speed],
        duration=10.0,
    )
    radii = np.hypot(*orbit.q.T)
    if np.ptp(radii) <= 2 * STAYS:
        return ""
    return f"with {speed:.6g} r goes from {radii.min():.4g} to {radii.max():.4g}"


def power(answer: Any) -> str:
    """Radial oscillations of the effective potential beside the angular velocity on the circle."""
    [n] = numbers_of(answer, 1)
    if not n > 0:
        return "n must be positive"
    r, p = ca.SX.sym("r"), ca.SX.sym("p")
    momentum = ca.sqrt(ca.gradient(r**n, r) * r**3)  # of the circle r
    effective = r**n + p**2 / (2 * r**2)
    bend = ca.substitute(ca.hessian(effective, r)[0], p, momentum)
    turned = ca.Function("turned", [r], [2 * ca.pi * momentum / r**2 / ca.sqrt(bend)])(1.0)
    found = float(np.degrees(float(turned)))
    return (
        "" if abs(found - 120) <= TYPED * 120 else f"with n = {n:.6g} they are {found:.5g}° apart"
    )


def _point(at: np.ndarray) -> str:
    return f"q = {at[0]:.3g}, p = {at[1]:.3g}"


def symplectic_step(answer: Any) -> str:
    """One step must keep areas, det ∂(q', p')/∂(q, p) = 1, and follow Hamilton's equations."""
    q, p, h = (ca.SX.sym(name) for name in "qph")
    new = expression_of(answer, (q, p, h), 2, "step(q, p, h)")
    area = ca.det(ca.jacobian(new, ca.vertcat(q, p)))
    rate = (new - ca.vertcat(q, p)) / h - ca.vertcat(p, -ca.sin(q))
    for at in random_states(2):
        [[stretched]] = values_of(area, (q, p, h), (*at, 0.3))
        if not abs(stretched - 1) <= CLOSE:
            return f"at {_point(at)} a step of 0.3 multiplies areas by {stretched:.6g}"
        wrong = values_of(rate, (q, p, h), (*at, SHORT)).ravel()
        if not np.abs(wrong).max() <= RATE_ERROR:
            return (
                f"at {_point(at)} short steps do not follow q̇ = p, ṗ = −sin q: "
                f"they are off by {wrong[0]:.3g} and {wrong[1]:.3g}"
            )
    return ""


def canonical_momentum(answer: Any) -> str:
    """{Q, P} = 1."""
    q, p = ca.SX.sym("q"), ca.SX.sym("p")
    new = ca.vertcat(ca.sqrt(2 * q) * ca.cos(p), expression_of(answer, (q, p), 1, "momentum(q, p)"))
    bracket = ca.det(ca.jacobian(new, ca.vertcat(q, p)))
    for at in random_states(2, 0.2, 1.2):
        [[value]] = values_of(bracket, (q, p), at)
        if not abs(value - 1) <= CLOSE:
            return f"at {_point(at)} the bracket {{Q, P}} is {value:.6g}, not 1"
    return ""


def euler_equations(answer: Any) -> str:
    """Compared with what the Lagrangian in Euler angles gives."""
    system = free_rigid_body(inertia=(1.0, 2.0, 3.0)).system
    omega = ca.SX.sym("omega", 3)
    claimed = expression_of(answer, (omega,), 3, "omega_dot(omega)")
    rates = body_rates(system.q, system.v)
    slopes = ca.Function(
        "slopes", [system.q, system.v], [ca.jacobian(rates, system.q), ca.jacobian(rates, system.v)]
    )
    angles = np.array([0.3, 1.1, -0.4])
    for w in random_states(3):
        v = euler_rates(angles[None], w[None])[0]
        by_q, by_v = (x.full() for x in slopes(angles, v))
        wanted = by_q @ v + by_v @ accelerations(system, angles, v)
        found = values_of(claimed, (omega,), (w,)).ravel()
        if not np.abs(found - wanted).max() <= CLOSE * 10:
            return f"at ω = {w.round(3)} dω/dt is {wanted.round(4)}, not {found.round(4)}"
    return ""


def steady_precession(answer: Any) -> str:
    [rate] = numbers_of(answer, 1)
    if not rate > 5:
        return "that is not the fast one of the two precessions"
    lean, momentum, model = 1.0, 5.0, heavy_top()
    spin = momentum / 0.5 - rate * np.cos(lean)
    motion = simulate(model.system, q0=[0, lean, 0], v0=[rate, 0, spin], duration=6 * np.pi / rate)
    nods = float(np.ptp(motion.q[:, 1]))
    return "" if nods <= STAYS else f"with {rate:.6g} the axis nods by {nods:.3g} rad"
