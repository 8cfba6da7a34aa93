"""What a scene takes from the time alone: its signals, such as a drive, or the place of a body that
is led; and how fast they may vary.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca

from varint.errors import VarintError
from varint.numerics.operations import operations_of, values_of
from varint.scene.memory import per_system
from varint.scene.system import System

LINEAR = frozenset(("neg", "assign", "twice"))
TURNING = frozenset(("sin", "cos", "exp", "sinh", "cosh"))


class Signals(NamedTuple):
    """Signals (k,) of t and c, and the fastest rate ω(c) at which they turn or grow; None where
    something else than waves, powers and exponentials of time varies, as a pulse does.
    """

    values: ca.SX
    rate: ca.SX | None


NOTHING = Signals(ca.SX(0, 1), ca.SX(0))


@per_system
def signals_of(system: System) -> Signals:
    """The largest parts of forces and momenta that depend on time, and not on where the scene is;
    all that depends on time where these are not made of elementary operations.
    """
    s = system
    if s.structure.autonomous:
        return NOTHING
    acting = ca.densify(ca.vertcat(s.generalised_force, s.momentum))
    try:
        operations = operations_of(ca.Function("acting", [s.t, s.c, s.q, s.v], [acting]))
    except VarintError:
        return Signals(ca.SX(0, 1), None)
    nodes = operations.nodes
    values = values_of(nodes, [s.t, s.c, s.q, s.v])
    timed, moving = _depend(nodes, (0,)), _depend(nodes, (2, 3))
    used = set(operations.outputs[0].nodes)
    used |= {j for i, node in enumerate(nodes) if moving[i] for j in _operands(node)}
    found = [i for i in sorted(used) if timed[i] and not moving[i]]
    rates = _rates(s, nodes, values, timed, moving)
    fastest: ca.SX | None = ca.SX(0)
    for i in found:
        rate = rates[i]
        fastest = None if rate is None or fastest is None else ca.fmax(fastest, rate)
    return Signals(ca.vertcat(ca.SX(0, 1), *(values[i] for i in found)), fastest)


def _operands(node: tuple) -> tuple[int, ...]:
    return () if node[0] in ("const", "input") else node[1:]


def _depend(nodes: list[tuple], arguments: tuple[int, ...]) -> list[bool]:
    found: list[bool] = []
    for node in nodes:
        own = node[0] == "input" and node[1] in arguments
        found.append(own or any(found[j] for j in _operands(node)))
    return found


def _rates(
    system: System, nodes: list[tuple], values: list[ca.SX], timed: list[bool], moving: list[bool]
) -> list[ca.SX | None]:
    """How fast each node turns or grows with the time alone: products by the sum of both."""
    found: list[ca.SX | None] = []
    for i, node in enumerate(nodes):
        name, operands = node[0], _operands(node)
        known = [x for j in operands if (x := found[j]) is not None]
        rate: ca.SX | None = None
        if not timed[i] or name == "input":
            rate = ca.SX(0)
        elif moving[i] or len(known) < len(operands):
            rate = None
        elif name in ("add", "sub"):
            rate = ca.fmax(*known)
        elif name == "mul":
            rate = known[0] + known[1]
        elif name in LINEAR or (name == "div" and not timed[operands[1]]):
            rate = known[0]
        elif name == "if_else_zero" and not timed[operands[0]]:
            rate = known[1]
        elif name == "sq":
            rate = 2 * known[0]
        elif name in TURNING:
            slope = ca.jacobian(values[operands[0]], system.t)
            rate = None if ca.depends_on(slope, system.t) else ca.fabs(slope)
        found.append(rate)
    return found
