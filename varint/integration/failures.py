"""Why a step failed, in words, and what to try: judged at the last good node and one step ahead
of it.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from varint.discrete.constraints import every_row_function, position_rows_function
from varint.discrete.inertia import scaled_mass
from varint.discrete.lagrangian import point_function
from varint.discrete.tolerances import RESIDUAL_LIMIT
from varint.errors import ConvergenceError
from varint.integration.energy_check import EnergyJump, energy_jump, first_jump, undefined_at
from varint.integration.second_looks import has_steps
from varint.integration.small_motions import frequencies, local_matrices
from varint.integration.walls import CLOSE, Failure, jumping_cause
from varint.numerics.arrays import median, over_columns
from varint.results.trajectory import Trajectory

LOOKED_AT = 20  # nodes before the failure
STEEPER = 5.0  # growth of the fastest frequency over these nodes that speaks of a collision
FAST = 0.5  # h ω above which the step may be too large
LOST = 1e-3  # of the inertia that a coordinate had over these nodes
SAMPLES = 10
AHEAD = 1.5  # steps to look ahead along the velocity
# of what it was over these nodes: a singular value of the constraints that speaks of a singularity
NEARER = 0.2
# smallest eigenvalue of a scaled mass matrix, or singular value of constraints, that is nearly zero
WEAK = 1e-6


def failure(
    motion: Trajectory, step: int, residual: float, on_failure: str | None
) -> ConvergenceError:
    """The error of a step that failed; between two saved nodes it belongs to the steps after the
    last of them.

    Where the energy leapt before, the run was lost there: how far steps go on that have none of the
    motion's solutions says nothing of the scene, and another way to solve them ends elsewhere.
    """
    if astray := first_jump(motion):
        return _went_astray(*astray, on_failure)
    t = float(motion.t[0] + motion.h * (step - motion.k[0]))
    if np.isfinite(residual):
        what = f"left a residual of {residual:.1e} (limit {RESIDUAL_LIMIT:g})"
        if residual <= RESIDUAL_LIMIT:
            what = (
                f"did not settle: little is left of its equations ({residual:.1e}), but what "
                "solves them still changed when the iteration ended"
            )
    else:
        what = "gave values that are not finite"
    hint = "; on_failure='subdivide' redoes such a step in smaller parts" if on_failure else ""
    if on_failure == "subdivide":
        left = (
            "values that are not finite" if np.isnan(residual) else f"a residual of {residual:.1e}"
        )
        what, hint = (
            "has no solution, nor have 2, 4, … 1024 parts one on which they agree (at the end "
            f"{left})",
            "",
        )
    return ConvergenceError(
        lambda cause: (
            f"the step after t = {t:g} (step {step}) {what}. Likely: {cause}{hint}. "
            f"Error.trajectory has the {len(motion)} nodes before it"
        ),
        step=step,
        time=t,
        residual=residual,
        trajectory=motion,
        cause=lambda: likely_cause(motion),
    )


def _went_astray(motion: Trajectory, jump: EnergyJump, on_failure: str | None) -> ConvergenceError:
    """The error of the step after a motion, which was solved and led to another energy."""
    hint = "; on_failure='subdivide' redoes steps that fail, not those" if on_failure else ""
    what = f"led astray, and a later one has no solution. Likely: {jump.cause}{hint}"
    return _without_residual(motion, int(motion.k[-1]), float(motion.t[-1]), what, jump.cause)


def leap_over(motion: Trajectory, last: Failure) -> ConvergenceError | None:
    """The error of a run that came to its end only since its steps leapt over where the `last` one
    had failed: behind that its energy is another one.
    """
    steps, failed = last
    if (astray := first_jump(motion)) is None:
        return None
    before, jump = astray
    whole = abs(motion.h) * (len(motion) - 1)
    if abs(jump.time - failed.time) > CLOSE * (abs(motion.h) + whole / steps):
        return None
    return _went_astray(before, jump, None)


def refusal(motion: Trajectory, step: int, time: float, why: str) -> ConvergenceError:
    """The error of a step that cannot be done, whatever its size, which begins at that time."""
    what = f"cannot be done: {why}"
    return _without_residual(motion, step, time, what, why, refused=True)


def _without_residual(
    motion: Trajectory, step: int, time: float, what: str, cause: str, *, refused: bool = False
) -> ConvergenceError:
    """The error of a step that is not to be taken, however well it can be solved."""
    return ConvergenceError(
        f"the step after t = {time:g} (step {step}) {what}. "
        f"Error.trajectory has the {len(motion)} nodes before it",
        step=step,
        time=time,
        residual=float("nan"),
        trajectory=motion,
        cause=cause,
        refused=refused,
    )


@np.errstate(all="ignore")
def likely_cause(motion: Trajectory) -> str:
    """The likely cause of the failure of the step after the trajectory's last node, with what to
    try.
    """
    if jump := energy_jump(motion):
        return jump.cause
    last = motion[-LOOKED_AT:]
    causes = [*_singular(last), *_undefined(last)]
    speeds = np.abs(motion.h) * frequencies(last)
    if len(speeds) and speeds[-1] > STEEPER * median(speeds):
        causes.append(
            "a collision or near approach (the stiffness grew "
            f"{(speeds[-1] / median(speeds)) ** 2:.1g}-fold over the last {len(speeds)} nodes; "
            f"h ω = {speeds[-1]:.2g} now): try a smaller h"
        )
    elif len(speeds) and speeds[-1] > FAST:
        causes.append(
            f"h is too large for the fastest motion (h ω = {speeds[-1]:.2g} at the last node): try "
            "a smaller h"
        )
    if not causes and has_steps(last.system):
        causes.append(jumping_cause(last.system))
    return (
        "; or ".join(causes)
        or "h is too large for this motion or the scene is close to singular: try a smaller h"
    )


def _singular(motion: Trajectory) -> list[str]:
    """A mass matrix or constraints that nearly lose their rank at the last node."""
    structure, names = motion.system.structure, motion.system.names
    found = []
    if not (structure.degenerate or structure.constraints or structure.nonholonomic):
        masses = local_matrices(motion)[0]
        mass, inertia = masses[-1], np.abs(np.einsum("mii->mi", masses))
        lost = inertia[-1] < LOST * inertia.max(axis=0)
        if lost.any():
            found.append(
                "a singular configuration (the inertia of "
                f"{[names[i] for i in np.flatnonzero(lost)]} vanishes, as at a pole or in gimbal "
                "lock): use coordinates that are regular there, or start elsewhere"
            )
        scaled = scaled_mass(mass)
        regular = (np.diag(mass) != 0).all() and np.isfinite(scaled).all()
        values, vectors = np.linalg.eigh(scaled) if regular else (np.zeros(1), None)
        weakest = int(np.argmin(np.abs(values)))
        if abs(values[weakest]) < WEAK and np.isfinite(mass).all():
            part = np.ones(len(names)) if vectors is None else np.abs(vectors[:, weakest])
            weak = [name for name, x in zip(names, part, strict=True) if x > 0.1 * part.max()]
            found.append(
                f"a singular configuration (the mass matrix nearly loses its rank in {weak}): use "
                "coordinates that are regular there, or start elsewhere"
            )
    if structure.constraints:
        found += _dependent_rows(motion)
    return found


def _dependent_rows(motion: Trajectory) -> list[str]:
    """Constraint rows whose gradients nearly depend on one another at the last node or where it
    leads.
    """
    last, system = motion[-1], motion.system
    if not np.isfinite(last.q).all():
        return []
    v = last.v if np.isfinite(last.v).all() else np.zeros_like(last.q)  # rows that hold none
    ahead = last.q + motion.h * np.linspace(0, AHEAD, SAMPLES)[:, None] * v
    times = np.append(motion.t, last.t + motion.h * np.linspace(0, AHEAD, SAMPLES))
    slope = over_columns(
        position_rows_function(system), np.vstack([motion.q, ahead]), times[:, None], motion.c
    )[1]
    rows = slope.reshape(len(times), system.structure.n, -1).transpose(0, 2, 1)
    rows = rows[:, : system.structure.constraints]
    size = np.linalg.norm(rows, axis=2, keepdims=True)
    nodes = len(motion)
    lost = np.flatnonzero(
        size[nodes:, :, 0].min(axis=0) < NEARER * size[:nodes, :, 0].max(axis=0)
    ).tolist()
    if lost:
        return [
            f"a singular configuration (the gradients of the constraint rows {lost} nearly vanish, "
            "as at a corner or an end of the allowed curve): try a smaller h, start elsewhere, or "
            "write the constraint without a corner"
        ]
    rows = rows / np.where(size > 0, size, 1)
    if not np.isfinite(rows).all():
        return []
    left, values, _ = np.linalg.svd(rows)
    least = values.min(axis=1) if rows.shape[1] <= rows.shape[2] else np.zeros(len(rows))
    worst = nodes + int(np.argmin(least[nodes:]))
    if least[worst] >= WEAK and least[worst] >= NEARER * least[:nodes].max():
        return []
    part = np.abs(left[worst, :, -1])
    tied = np.flatnonzero(part > 0.1 * part.max()).tolist()
    return [
        f"a singular configuration (the gradients of the constraint rows {tied} nearly depend on "
        "one another, as where a linkage folds or is stretched out, and the motion is not "
        "determined): try a smaller h, start elsewhere, or drop a redundant constraint"
    ]


def _undefined(motion: Trajectory) -> list[str]:
    """Derivatives of L that are not finite ahead along the velocity, as far as nodes are apart."""
    last = motion[-1]
    if not np.isfinite(last.v).all():
        return []
    far = motion.h * (int(motion.k[-1] - motion.k[-2]) if len(motion) > 1 else 1) or motion.h
    passed = far * np.linspace(0, 1, 11)[1:, None]
    ahead, t = last.q + passed * last.v, last.t + passed
    point = point_function(motion.system)
    u = np.zeros(motion.system.structure.controls)
    v = np.broadcast_to(last.v, ahead.shape)
    values = np.concatenate(over_columns(_dense(point), ahead, v, u, t, motion.c), axis=1)
    what = "the Lagrangian or the force"
    if np.isfinite(values).all():
        what, values = (
            "a constraint or the gap of a contact",
            np.concatenate(
                over_columns(position_rows_function(motion.system), ahead, t, motion.c)
                + over_columns(every_row_function(motion.system), ahead, 0 * v, t, motion.c),
                axis=1,
            ),
        )
    if np.isfinite(values).all():
        return []
    i = int(np.argmin(np.isfinite(values).all(axis=1)))
    return [f"{what} is not defined where the step leads, {undefined_at(ahead[i], float(t[i, 0]))}"]


def _dense(point: ca.Function) -> ca.Function:
    symbols = [ca.SX.sym(f"x{i}", point.size1_in(i)) for i in range(point.n_in())]
    return ca.Function("dense_point", symbols, [ca.densify(x) for x in point(*symbols)])
