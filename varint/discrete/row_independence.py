"""How independent constraint rows are where a scene is: at a fold of a linkage they are not."""

from __future__ import annotations

import casadi as ca

from varint.discrete.constraints import velocity_rows
from varint.scene.memory import per_scene
from varint.scene.system import System

# of the largest distance of a row from the others during the run: nearer ones have energies off by
# 1e-6 to 10 of the kinetic energy, those that are farther none (four-bar linkages, all rules)
FOLDED = 1e-6
# of the row's gradient at the node before: where a constraint's curve crosses itself or ends
VANISHED = 1e-6


@per_scene
def folds(system: System) -> bool:
    """Whether the rank of the constraint rows may depend on where the scene is."""
    s = system
    return bool(s.structure.constraints) and ca.depends_on(
        ca.jacobian(velocity_rows(s), s.v), ca.vertcat(s.q, s.t)
    )


def pivot_and_lengths(system: System) -> tuple[ca.SX, ca.SX]:
    """The smallest pivot of R Rᵀ = L D Lᵀ, R the rows scaled to length one, and their lengths.

    A pivot is the squared distance of a row from the span of those eliminated before it, and much
    cheaper than a singular value. One row has the pivot one.
    """
    rows = ca.jacobian(velocity_rows(system), system.v)
    size = ca.densify(ca.sqrt(ca.sum2(rows**2)))
    if rows.shape[0] == 1:
        return ca.SX(1.0), size
    scaled = ca.mtimes(ca.diag(1 / size), rows)
    pivots = ca.ldl(ca.mtimes(scaled, scaled.T))[0]
    return ca.mmin(ca.densify(pivots)), size


@per_scene
def pivot_function(system: System) -> ca.Function:
    """(q, t, c) → the smallest pivot and the rows' lengths."""
    s = system
    return ca.Function("pivots", [s.q, s.t, s.c], list(pivot_and_lengths(s)), {"cse": True})
