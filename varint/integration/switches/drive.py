"""How fast a branch moves at a state: its small motions, and explicit time, of which these do not
tell.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from varint.integration.small_motions import frequency_at_start
from varint.integration.switches.accelerations import acceleration
from varint.integration.switches.branch import branch_scene
from varint.integration.switches.frozen import frozen_scene
from varint.numerics.arrays import call, over_columns
from varint.results.records import State
from varint.scene.memory import per_system
from varint.scene.system import System

LOOKS = 256  # times at which it is looked at


def fastest_small_motion(system: System, state: State, c: np.ndarray) -> float:
    """Largest frequency ω of small motions about a state of a smooth scene; with constraints, the
    largest |λ| of δq'' = (∂a/∂q) δq + (∂a/∂v) δq' ~ exp(λt), a the accelerations along them.
    """
    if not (system.structure.constraints or system.structure.nonholonomic):
        return frequency_at_start(system, state.q, state.v, state.t, c) or 0.0
    n, at = system.structure.n, (state.q, state.v, np.array([state.t]))
    slopes = call(_slope_function(system), *at, c)[0].reshape(2 * n, n).T
    matrix = np.vstack([np.eye(n, 2 * n, n), slopes])
    if not np.isfinite(matrix).all():
        return 0.0
    return float(np.abs(np.linalg.eigvals(matrix)).max())


@per_system
def _slope_function(system: System) -> ca.Function:
    """(q, v, t, c) → ∂a/∂(q, v) of the accelerations a along the constraints."""
    s, a = system, acceleration(system, system.force)
    assert a is not None
    slopes = ca.densify(ca.jacobian(a, ca.vertcat(s.q, s.v)))
    return ca.Function("slopes", [s.q, s.v, s.t, s.c], [slopes], {"cse": True})


@per_system
def _rates(system: System) -> ca.Function | None:
    """(q, v, t, c) → first and third derivatives by time of forces and of what switches; None where
    none depends on time.
    """
    scene, frozen = branch_scene(system), frozen_scene(system)
    assert scene is not None and frozen is not None
    s = scene.system
    x = ca.vertcat(s.generalised_force, s.momentum, frozen.sigma)
    first = ca.jacobian(x, s.t)
    third = ca.jacobian(ca.jacobian(first, s.t), s.t)
    if not ca.depends_on(third, s.t):  # a polynomial of low degree
        return None
    outputs = [ca.densify(first), ca.densify(third)]
    return ca.Function("rates", [s.q, s.v, s.t, s.c], outputs, {"cse": True})


def drive_frequency(system: System, state: State, c: np.ndarray, total: float) -> float:
    """Largest frequency ω of drives and of switches that depend on time, by |d³x/dt³| = ω² |dx/dt|
    along the run; zero where there is none.

    `c` are all parameters, the numbers behind the switches included.
    """
    function = _rates(system)
    if function is None:
        return 0.0
    t = state.t + total * (np.arange(LOOKS) + 0.5) / LOOKS
    first, third = over_columns(function, state.q, state.v, t[:, None], c)
    first, third = np.abs(first).max(axis=0), np.abs(third).max(axis=0)
    some = (first > 0) & np.isfinite(first + third)
    return math.sqrt(float((third[some] / first[some]).max(initial=0.0)))
