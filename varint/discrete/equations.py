"""The equations of one step as a record: what the interpreted steppers and the compiled loops
solve alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from varint.discrete.lagrangian import Interval, interval, point_function
from varint.rules.rule import Rule
from varint.scene.memory import per_system
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class Equations:
    """Equations of a step as SX expressions of its own symbols.

    Attributes
    ----------
    y : SX
        Unknowns: mean velocities (Q_j − q0)/h, multipliers, or both.
    q, p, u, t, h, c : SX
        Start of the step, controls (k·r, column by column), time, step, parameters.
    scale : SX (2n,)
        Typical sizes of velocities and momenta.
    sizes : SX
        Sizes that follow from the place in space; empty without constraints.
    left : SX
        What vanishes, in the order of the unknowns.
    y_size, row_size : SX
        Sizes of the unknowns and of the rows, which make both dimensionless.
    judged : SX
        What the remaining residual is measured by, row by row, as a function of the gain besides.
    gained : SX (n,)
        The symbol that `judged` has for the gain.
    increment, gain : SX (n,)
        q1 − q0, and what the momentum gains by forces and reactions, before projection.
    """

    y: ca.SX
    q: ca.SX
    p: ca.SX
    u: ca.SX
    t: ca.SX
    h: ca.SX
    c: ca.SX
    scale: ca.SX
    sizes: ca.SX
    left: ca.SX
    y_size: ca.SX
    row_size: ca.SX
    judged: ca.SX
    gained: ca.SX
    increment: ca.SX
    gain: ca.SX

    @property
    def scaled(self) -> ca.SX:
        """`left` in units of its rows, as a function of the unknowns in units of theirs."""
        return ca.densify(ca.substitute(self.left, self.y, self.y * self.y_size) / self.row_size)

    @property
    def remains(self) -> ca.SX:
        """The residual by what it is judged by."""
        return ca.densify(self.left / ca.substitute(self.judged, self.gained, self.gain))


# of the largest momentum, and of |∂p/∂q| |q|: round-off of 1e-16 in these stays below 1e-12
QUIET = 1e-3


@per_system
def implicit_equations(system: System, rule: Rule) -> Equations:
    """e_j = 0 at the inner control points and e_d = p0 + Σ_j e_j at the end, for z_j = (Q_j −
    q0)/h.
    """
    one = interval(system, rule)
    n, d = one.dq.shape
    z, p, scale = ca.SX.sym("z", n, d), ca.SX.sym("p", n), ca.SX.sym("scale", 2 * n)
    rows = ca.horzcat(one.inner, one.p_plus - p - one.total)
    rows, total = ca.substitute([rows, one.total], [one.dq], [one.h * z])
    v_scale, p_scale = scale[:n], scale[n:]
    judged = ca.fmax(p_scale, _roundable(system, one, one.q0, z[:, -1], p))
    return Equations(
        ca.vec(z),
        one.q0,
        p,
        ca.vec(one.u),
        one.t,
        one.h,
        one.c,
        scale,
        ca.SX(0, 1),
        ca.densify(ca.vec(rows)),
        ca.repmat(v_scale, d, 1),
        ca.repmat(p_scale, d, 1),
        ca.repmat(judged, d, 1),
        ca.SX.sym("gained", n),
        one.h * z[:, -1],
        ca.densify(total),
    )


VANISHES = 1e-30  # of a basis function: what its own rounding leaves at a node


def start_row(system: System, rule: Rule, e: Equations) -> ca.SX:
    """−e_0 − p0 (n,), which vanishes with the rows of `implicit_equations` and may stand for that
    of the end: forces at nodes where ℓ_0 vanishes do not enter.
    """
    one, point = interval(system, rule), point_function(system)
    row = -e.p
    for i, (share, slope) in enumerate(
        zip(rule.basis[:, 0].tolist(), rule.slopes[:, 0].tolist(), strict=True)
    ):
        state = one.q_nodes[:, i], one.v_nodes[:, i], one.u[:, i], one.t_nodes[i], one.c
        _, momentum, gradient, force = point(*state)
        row -= rule.weights[i] * slope * momentum
        if abs(share) > VANISHES:
            row -= one.h * rule.weights[i] * share * (gradient + force)
    return ca.densify(ca.substitute(row, one.dq, e.h * ca.reshape(e.y, one.dq.shape)))


def _roundable(system: System, one: Interval, q: ca.SX, v: ca.SX, p: ca.SX) -> ca.SX:
    """Sizes (n,) of what adds up to the momenta at q, v: their sum may vanish, its round-off does
    not.

    A component that hardly moves is given `QUIET` of the largest, compared by energy (p²/M: metres
    with radians).
    """
    state = [system.q, system.v, system.t, system.c], [q, v, one.t, one.c]
    gyroscopic = ca.jacobian(system.momentum, system.q)
    mass, gyroscopic = ca.substitute([ca.fabs(system.mass_matrix), ca.fabs(gyroscopic)], *state)
    step = ca.fabs(one.h * v)
    parts = (
        ca.fabs(p)
        + mass @ ca.fabs(v)
        + (gyroscopic + gyroscopic.T) @ step
        + QUIET * (gyroscopic @ ca.fabs(q))
    )
    inertia = ca.diag(mass)
    largest = ca.norm_inf(ca.if_else(inertia > 0, parts / ca.sqrt(inertia), 0))
    return ca.fmax(parts, QUIET * ca.sqrt(inertia) * largest)
