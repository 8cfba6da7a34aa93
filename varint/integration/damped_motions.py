"""How fast a motion turns where dampers are stiff: what they stop at once takes few steps.

Beside a damper that is stiffer than its spring a small motion has two rates, one far above its
frequency without the damper and one far below. By the frequencies alone a beam of twenty elements
with dampers in its joints begins with thousands of steps, none of which anything is seen in. Here
the equations of motion are linear about the start: motions go like exp(λ t). First steps are for
the fastest one, and steps may grow to what lasts.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from varint.integration.small_motions import (
    FEW,
    MOST_AT_ALL,
    angle_turned,
    by_momentum,
    damping_function,
    frequency_of_columns,
    local_function,
    uncontrolled,
)
from varint.numerics.arrays import call
from varint.scene.memory import per_scene
from varint.scene.system import System

STIFF = 2.0  # times as fast as the fastest frequency must dampers be
FAST = 50.0  # radians that they turn by at least: less takes no more time than this look
FASTEST = 1e9  # radians that they turn by at most: first steps for more do not grow to what lasts
LASTS = 20.0  # what falls by less than e to this in the whole duration


def may_be_damped(system: System) -> bool:
    """Whether forces on velocities may be stiff, in a scene that is looked at for this: linear
    scenes have maps.
    """
    s = system.structure
    held = s.constraints or s.nonholonomic or s.contacts
    free = not (held or s.degenerate or s.linear or system.rays)
    return free and s.force_on_velocity and s.n <= MOST_AT_ALL


def are_stiff(local: np.ndarray, n: int, duration: float, turned: float) -> bool:
    """Whether forces stop something sooner than the fastest frequency without them turns, by so
    much in the duration. By what `look_function` gives, one behind the other.
    """
    size, limit = n * n, max(STIFF * turned, FAST)
    mass, damping = local[:size], local[2 * size :]
    inertia = mass[:: n + 1].tolist()
    if _sums_of_rows(mass, n) == inertia:  # each alone: sums of rows bound the rate
        rows = zip(_sums_of_rows(damping, n), inertia, strict=True)
        if not limit < max((row / m for row, m in rows if m), default=0.0) * abs(duration):
            return False
    rate = frequency_of_columns(mass.tolist(), damping.tolist(), n)
    if rate is None or not rate < math.inf:
        return False
    return limit < rate * rate * abs(duration)


def _sums_of_rows(columns: np.ndarray, n: int) -> list[float]:
    """Of the sizes of a matrix, column after column."""
    if n > FEW:
        return np.abs(columns).reshape(n, n).sum(axis=0).tolist()
    numbers = columns.tolist()
    return [sum(map(abs, numbers[i::n])) for i in range(n)]  # a third of the time


def damped_turns(
    system: System, q: np.ndarray, p: np.ndarray, t: float, c: np.ndarray, duration: float
) -> tuple[float, float] | None:
    """By how much the motions that last turn in the duration, and the fastest one; None where this
    cannot be told, or is too much.
    """
    n = len(q)
    mass, *slopes = (x.reshape(n, n).T for x in call(_linear(system), q, p, np.array((t,)), c))
    matrix = np.zeros((2 * n, 2 * n))
    matrix[range(n), range(n, 2 * n)] = 1.0
    try:
        matrix[n:] = np.linalg.solve(mass, np.hstack(slopes))
        rates = np.linalg.eigvals(matrix)
    except np.linalg.LinAlgError:
        return None
    fast = np.abs(rates)
    lasts = fast[-rates.real * duration < LASTS].max(initial=0.0)  # backwards all grows
    fastest = float(fast.max()) * abs(duration)
    return (angle_turned(duration, float(lasts)), fastest) if fastest < FASTEST else None


def has_slopes_without(system: System, fastest: float) -> bool:
    """Whether a machine that tells its own velocities, whose iterations have no slopes, should be
    run by its Lagrangian alone: where steps for so fast a motion take longer than writing out its
    inertia.
    """
    return system.kinetics is not None and fastest >= system.structure.n**3


@per_scene
def by_lagrangian(system: System) -> System:
    """A machine by its Lagrangian alone: what it knows of its velocities makes its iterations
    shorter, but they have no slopes.
    """
    s = system
    return System(s.q, s.v, s.lagrangian, force=s.force, control=s.control, params=s.params, t=s.t)


@per_scene
def _linear(system: System) -> ca.Function:
    """(q, p, t, c) → M, ∂(M a)/∂q and ∂(M a)/∂v by Lagrange's equations."""
    s = system
    inertial = ca.jtimes(s.momentum, s.q, s.v) + ca.jacobian(s.momentum, s.t)
    push = ca.gradient(s.lagrangian, s.q) + uncontrolled(s) - inertial
    slopes = [s.mass_matrix, ca.jacobian(push, s.q), ca.jacobian(push, s.v)]
    function = ca.Function("linear", [s.q, s.v, s.t, s.c], [ca.densify(x) for x in slopes])
    return by_momentum(s, function)


@per_scene
def look_function(system: System) -> ca.Function:
    """(q, p, t, c) → M and ∂(∂L/∂q + F)/∂q with `turning`, and ∂F/∂v where dampers may be stiff;
    of v in the place of p where momenta do not tell of it.
    """
    s, found = system, local_function(system)
    if may_be_damped(s):
        at = s.q, s.v, s.t, s.c
        found = ca.Function("local", at, [*found.call(at), damping_function(s).call(at)[1]])
    return by_momentum(s, found) if s.structure.quadratic_kinetic else found
