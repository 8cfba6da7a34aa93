"""A whole run as a CasADi function with derivatives, for users' own graphs and solvers."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.integration.plan import plan
from varint.integration.problem import time_grid
from varint.rules.rule import Rule
from varint.scene.inputs import number
from varint.scene.memory import per_system
from varint.scene.system import System, require_system
from varint.sensitivities.contact_shot import ContactShot
from varint.sensitivities.external import external
from varint.sensitivities.loops import sweeper
from varint.sensitivities.shot import Shot

CALLS = 20  # that a flow is expected to have, when it is decided whether to compile its loops


def flow(
    system: System,
    rule: Rule | None = None,
    *,
    h: float,
    steps: int,
    nodes: Sequence[int] | None = None,
    t0: float = 0.0,
    backend: str = "auto",
) -> ca.Function:
    """A run of `steps` steps as a CasADi function (q0, v0, params, u) → (q, v) at chosen nodes.

    It runs the same loops as `simulate` and carries tangents and adjoints through them where CasADi
    asks for derivatives: Jacobians by whichever is fewer, products with a row by one adjoint sweep,
    Hessians as Σ Tᵀ ∂²(μ·x') T of tangents T and adjoints μ. It stands in graphs of your own, under
    `nlpsol`, `rootfinder`, `jacobian` and `hessian`.

    Parameters
    ----------
    system : System
        With contacts, too: impacts, stops and detachments come as they do from the start at hand,
        and derivatives go through them (saltation matrices, and what these curve).
    rule : Rule, optional
        Default: the scene's own.
    h, steps : float, int
    nodes : sequence of int, optional
        At which q and v are wanted, in rising order. Default: the last one.
    t0 : float
    backend : {"auto", "compiled", "native", "interpreted"}
        As in `simulate`.

    Returns
    -------
    Function
        Inputs ``q0 (n)``, ``v0 (n)``, ``params (C)`` in the order of ``system.c`` (left out: the
        defaults), ``u (k, steps)``, held over each step; outputs ``q (n, nodes)``, ``v (n,
        nodes)``. Where a run cannot begin or be finished they are NaN, from which solvers turn
        back, and so are derivatives where a contact is grazed. First and second derivatives are
        exact. A Hessian costs the square of the number of inputs: of many controls take
        Gauss–Newton from the Jacobian, or an approximation
        (``ipopt.hessian_approximation="limited-memory"``).

    Raises
    ------
    InputError
        If the Lagrangian is of first order in the velocities, or a node is none of the run.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> fall = vi.flow(vi.System(q, v, v**2 / 2 - 9.81 * q), h=0.1, steps=10)
    >>> speed = ca.MX.sym("speed")
    >>> height = fall(q0=0, v0=speed)["q"]
    >>> throw = ca.rootfinder("throw", "newton", {"x": speed, "g": height - 1.0})
    >>> round(float(throw(x0=1.0)["x"]), 9)  # 1 = v − g/2
    5.905
    """
    require_system(system)
    if system.structure.degenerate:
        raise InputError("flow takes scenes whose Lagrangian is regular in the velocities")
    h, steps = time_grid(h, steps, None)
    wanted = (steps,) if nodes is None else tuple(np.ravel(nodes).tolist())
    whole = all(isinstance(k, (int, np.integer)) and 0 <= k <= steps for k in wanted)
    if not wanted or not whole or any(a >= b for a, b in pairwise(wanted)):
        raise InputError(f"nodes must be rising whole numbers from 0 to {steps}, got {nodes!r}")
    chosen = plan(system, rule).rule
    return _flow(system, chosen, h, steps, tuple(int(k) for k in wanted), number("t0", t0), backend)


@per_system
def _flow(
    system: System,
    rule: Rule,
    h: float,
    steps: int,
    nodes: tuple[int, ...],
    t0: float,
    backend: str,
) -> ca.Function:
    if system.structure.contacts:
        through = ContactShot(system, rule, h, steps, nodes, t0, backend)
        return external("flow", through)
    by = sweeper(system, rule, CALLS * steps, backend)
    return external("flow", Shot(system, rule, h, steps, nodes, t0, by))
