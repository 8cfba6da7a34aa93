"""A configuration in which a scene rests, by Newton's method."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.errors import ConvergenceError, InputError
from varint.numerics.arrays import call
from varint.scene.inputs import number
from varint.scene.memory import per_system
from varint.scene.system import System, parameters_by_name, require_system

RANK = 1e-11  # of the largest singular value: directions along which equilibria go on
MOST_ITERATIONS, HALVINGS = 60, 12
FINE = 1e-14  # of the coordinates: corrections that are round-off
LOOKS, LAST = 8, 1000.0  # places at which round-off is looked at, and how many last digits away
BALANCED = 1e-9  # of the forces' own sizes: what is left where all balance


@dataclass(frozen=True, eq=False, repr=False)
class Equilibrium:
    """A configuration in which a scene rests.

    Attributes
    ----------
    system : System
        Of a relative equilibrium the scene in its turning frame, `corotating`.
    q : ndarray (n,)
    multipliers : ndarray (m,)
        Reactions λ of the constraints: ∂L/∂q + F + Gᵀλ = 0.
    c : ndarray
        Parameter values, in the order of ``system.c``.
    residual : float
        What is left of the forces, relative to their own sizes.
    """

    system: System
    q: np.ndarray
    multipliers: np.ndarray
    c: np.ndarray
    residual: float

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """Parameter values by name."""
        return parameters_by_name(self.system, self.c)

    @cached_property
    def energy(self) -> float:
        """Energy at rest, −L(q, 0); of a relative equilibrium that of the turning frame."""
        s = self.system
        there = ca.Function("energy", [s.q, s.v, s.t, s.c], [s.energy])
        return float(there(self.q, np.zeros(len(self.q)), 0.0, self.c))

    def __repr__(self) -> str:
        parts = zip(self.system.names, self.q, strict=True)
        return f"Equilibrium({', '.join(f'{name}={x:.10g}' for name, x in parts)})"


class Held(NamedTuple):
    """One more equation and one more unknown: a value J(q, c), held, and the parameter that gives
    way.
    """

    expression: ca.SX
    value: float
    parameter: int


def require_restful(system: System) -> None:
    """Refuse scenes that cannot rest, or whose rest is another question."""
    require_system(system)
    s = system.structure
    if not s.autonomous:
        raise InputError("the scene depends on time: it has no equilibria, but periodic()")
    if s.contacts or s.degenerate or s.controls:
        raise InputError(
            "equilibria are those of scenes without contacts and controls whose Lagrangian is "
            "regular in the velocities"
        )


def rest(system: System, q: np.ndarray, c: np.ndarray, held: Held | None = None) -> Equilibrium:
    """The equilibrium near a configuration.

    Raises
    ------
    ConvergenceError
        If Newton's method finds none.
    """
    balance = _balance(system) if held is None else _make_balance(system, held)
    n, rows = system.structure.n, system.structure.velocity_rows
    free = [] if held is None else [held.parameter]
    target = np.zeros(0) if held is None else np.array([number("momentum", held.value)])
    x = np.concatenate([q, np.zeros(rows), c[free]])
    values = c.copy()

    def forces(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        values[free] = x[n + rows :]
        left, slope, size = call(balance, x[:n], x[n : n + rows], values, target)
        return left, slope.reshape(len(x), -1).T, size

    left, slope, size = forces(x)
    if rows and np.isfinite(left).all() and np.isfinite(slope).all():
        # the reactions that balance best: from none Newton's method goes far off
        x[n : n + rows] = np.linalg.lstsq(slope[:n, n : n + rows], -left[:n], rcond=RANK)[0]
        left, slope, size = forces(x)
    if not (np.isfinite(left).all() and np.isfinite(slope).all()):
        raise InputError(
            f"the forces or their derivatives are not finite at q={q}: start elsewhere"
        )
    for _ in range(MOST_ITERATIONS):
        step = np.linalg.lstsq(slope, -left, rcond=RANK)[0]
        if (np.abs(step) <= FINE * np.maximum(np.abs(x), FINE)).all():
            break
        for halving in range(HALVINGS):
            trial = x + step / 2**halving
            after = forces(trial)
            sound = all(np.isfinite(y).all() for y in after)
            if sound and np.linalg.norm(after[0]) < np.linalg.norm(left):
                x, (left, slope, size) = trial, after
                break
        else:
            break
    worst = np.abs(left) / np.maximum(size, 1e-300)
    scale = float(size[:n].max(initial=0.0))
    residual = float(np.max(np.append(np.abs(left[:n]) / (scale or 1.0), worst[n:])))
    if not residual <= BALANCED and float(np.abs(left).max()) > BALANCED * BALANCED:
        raise ConvergenceError(
            f"no equilibrium was found near {q}: {residual:.1e} of the forces is left; start "
            "closer, or look in a box",
            step=0,
            time=0.0,
            residual=residual,
        )
    forces(x)
    return Equilibrium(system, x[:n], x[n : n + rows], values.copy(), residual)


def left_at(at: Equilibrium, q: np.ndarray) -> np.ndarray:
    """What is left of the forces at some place with the reactions of an equilibrium, (n,)."""
    left: np.ndarray = call(_balance(at.system), q, at.multipliers, at.c, np.zeros(0))[0]
    return left[: len(q)]


def round_off_at(at: Equilibrium) -> np.ndarray:
    """How much the forces change from one last digit of the coordinates to others, (n,)."""
    here, digit = left_at(at, at.q), np.spacing(np.abs(at.q))
    moved = [
        at.q + LAST * digit * np.sin(k * k + 1.7 * k * np.arange(1, len(digit) + 1))
        for k in range(1, LOOKS + 1)
    ]
    changes = [np.abs(left_at(at, q) - here) for q in moved]
    found: np.ndarray = np.max(changes, axis=0)
    return found


@per_system
def _balance(system: System) -> ca.Function:
    return _make_balance(system, None)


def _make_balance(system: System, held: Held | None) -> ca.Function:
    """(q, λ, c, J) → what is left of the forces, the constraints and J, its slope by the unknowns,
    and the sizes of its terms.
    """
    s = system
    still = ca.SX.zeros(s.v.shape)
    lam, value = ca.SX.sym("lam", s.structure.velocity_rows), ca.SX.sym("J", int(held is not None))
    gradient = ca.gradient(s.lagrangian, s.q)
    rows = ca.vertcat(ca.jacobian(s.constraint, s.q), s.nonholonomic)
    force, reaction = ca.substitute(ca.vertcat(gradient, s.force), s.v, still), rows.T @ lam
    n = s.structure.n
    left = ca.vertcat(force[:n] + force[n:] + reaction, s.constraint)
    pieces = ca.fabs(force[:n]) + ca.fabs(force[n:]) + ca.fabs(reaction)
    # what a change of the coordinates by their own sizes makes of every row
    bent = ca.fabs(ca.jacobian(left[:n], s.q)) @ (ca.fabs(s.q) + 1e-3)
    held_size = ca.fabs(ca.jacobian(s.constraint, s.q)) @ (ca.fabs(s.q) + 1e-3)
    size, unknown = ca.vertcat(pieces + bent, held_size), ca.vertcat(s.q, lam)
    if held is not None:
        there = ca.substitute(held.expression, s.v, still)
        left, unknown = ca.vertcat(left, there - value), ca.vertcat(unknown, s.c[held.parameter])
        size = ca.vertcat(size, ca.fabs(there) + ca.fabs(value))
    slope = ca.jacobian(left, unknown)
    outputs = [ca.densify(x) for x in (left, slope, size)]
    return ca.Function("balance", [s.q, lam, s.c, value], outputs, {"cse": True})
