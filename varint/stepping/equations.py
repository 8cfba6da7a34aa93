"""The equations of one step as a record: what the interpreted steppers and the compiled loops solve alike."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


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
        What the remaining residual is measured by, row by row.
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
    increment: ca.SX
    gain: ca.SX

    @property
    def scaled(self) -> ca.SX:
        """`left` in units of its rows, as a function of the unknowns in units of theirs."""
        return ca.densify(ca.substitute(self.left, self.y, self.y * self.y_size) / self.row_size)

    @property
    def remains(self) -> ca.SX:
        """The residual by what it is judged by."""
        return ca.densify(self.left / self.judged)
