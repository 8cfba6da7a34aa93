"""Reactions of constraints as expressions, for bounds and costs."""

from __future__ import annotations

import casadi as ca

from varint.discrete.constraints import saddle_parts
from varint.errors import InputError
from varint.scene.memory import per_system
from varint.scene.system import System, require_system


def reactions(system: System) -> ca.SX:
    """Multipliers λ of the constraints, then of the non-holonomic rows, as expressions of q, v, u,
    t and the parameters.

    The reaction is Wᵀλ with W = [∂g/∂q; A]: λ is the force along a constraint's gradient, positive
    where it pushes towards growing g.

    Parameters
    ----------
    system : System
        With m holonomic constraints and k non-holonomic rows.

    Returns
    -------
    SX (m + k,)

    Raises
    ------
    InputError
        If nothing holds the scene.

    Notes
    -----
    From M a − Wᵀλ = ∂L/∂q + F − (∂p/∂q) v − ∂p/∂t and the constraints differentiated twice, d(W v
    + w)/dt = 0 (Hairer & Wanner, Solving Ordinary Differential Equations II, §VII.1).

    Examples
    --------
    The pull of a rod is m (g cos θ + ℓ θ̇²): at the lowest point at rest the weight.

    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x", "y")
    >>> bob = vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * q[1], constraint=ca.norm_2(q) - 1)
    >>> pull = ca.Function("pull", [q, v], [-vi.reactions(bob)])
    >>> round(float(pull([0, -1], [0, 0])), 9)
    9.81
    """
    require_system(system)
    if not system.structure.velocity_rows:
        raise InputError(
            "reactions takes a scene with constraint= or nonholonomic= rows; nothing holds this "
            "one. Closed contacts of a phase are constraints of its scene"
        )
    return _reactions(system)


@per_system
def _reactions(system: System) -> ca.SX:
    matrix, right, scale = saddle_parts(system)
    return -(scale * ca.solve(matrix, right))[system.structure.n :]
