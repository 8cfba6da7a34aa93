"""The terms that a potential is a sum of, where each is a function of one linear or quadratic form
of the coordinates, as of a distance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import or_
from typing import NamedTuple

import casadi as ca

from varint.discrete.legendre import mass_solve
from varint.errors import VarintError
from varint.numerics.operations import operations_of, values_of
from varint.scene.memory import per_system
from varint.scene.system import System


@dataclass(frozen=True, eq=False)
class _Graph:
    """A potential as operations: their expressions, and a bit for each coordinate that they use."""

    system: System
    nodes: list[tuple]
    expressions: list[ca.SX]
    used: list[int]


@per_system
def potential_terms(system: System) -> list[Term] | None:
    """The terms of the potential; None where one of them is no function of one form."""
    try:
        potential, constants = ca.densify(potential_of(system)), constants_of(system)
        operations = operations_of(ca.Function("V", [system.q, constants], [potential]))
    except VarintError:
        return None
    nodes, inverse = operations.nodes, inverse_mass(system)
    graph = _Graph(system, nodes, values_of(nodes, [system.q, constants]), _coordinates(nodes))
    found = []
    for factor, root in _terms(graph, operations.outputs[0].nodes[0]):
        term = _term(graph, root, inverse, factor)
        if term is None:
            return None
        found.append(term)
    return found


def potential_of(system: System) -> ca.SX:
    """−V: what the Lagrangian is at rest."""
    return ca.substitute(system.lagrangian, system.v, ca.SX.zeros(system.structure.n))


def inverse_mass(system: System) -> ca.SX:
    return mass_solve(system.mass_matrix, ca.SX.eye(system.structure.n))


def constants_of(system: System) -> ca.SX:
    """Parameters, and the time where the scene depends on it."""
    return system.c if system.structure.autonomous else ca.vertcat(system.c, system.t)


def _coordinates(nodes: list[tuple]) -> list[int]:
    """A bit for each coordinate that a node depends on."""
    found: list[int] = []
    for name, *operands in nodes:
        if name == "input":
            found.append(1 << operands[1] if operands[0] == 0 else 0)
        else:
            found.append(0 if name == "const" else reduce(or_, (found[i] for i in operands)))
    return found


def _terms(graph: _Graph, root: int) -> list[tuple[ca.SX, int]]:
    """Terms that add up to a node, each with a factor free of q; no sign matters."""
    found, open_nodes, moving = [], [(ca.SX(1), root)], graph.used
    while open_nodes:
        factor, i = open_nodes.pop()
        if not moving[i]:
            continue
        name, *operands = graph.nodes[i]
        if name in ("add", "sub"):
            a, b = operands
            open_nodes += [(factor, a), (factor, b)]
        elif name in ("neg", "assign"):
            open_nodes.append((factor, operands[0]))
        elif name == "twice":
            open_nodes.append((2 * factor, operands[0]))
        elif name == "mul" and not all(moving[j] for j in operands):
            a, b = sorted(operands, key=lambda j: bool(moving[j]))
            open_nodes.append((factor * graph.expressions[a], b))
        elif name == "div" and not moving[operands[1]]:
            open_nodes.append((factor / graph.expressions[operands[1]], operands[0]))
        else:
            found.append((factor, i))
    return found[::-1]


def _forms(graph: _Graph, root: int) -> list[int]:
    """Nodes through which all of q enters a term, the innermost first."""
    found: list[int] = []
    front = {root}
    while front:
        if len(front) == 1:
            found += front
        i = max(front)
        front.remove(i)
        name, *operands = graph.nodes[i]
        if name == "input":
            break
        front |= {j for j in operands if graph.used[j]}
    return found[::-1]


def _in_form(graph: _Graph, root: int, form: int, s: ca.SX) -> ca.SX:
    """A term with a symbol in place of the form through which q enters."""
    known: dict[int, ca.SX] = {form: s}
    inside = {root}
    open_nodes = [root]
    while open_nodes:
        for j in graph.nodes[open_nodes.pop()][1:]:
            if j == form or j in inside:
                continue
            if not graph.used[j]:
                known[j] = graph.expressions[j]
                continue
            inside.add(j)
            open_nodes.append(j)
    if root == form:
        return s
    order = [*known, *sorted(inside)]
    place = {j: k for k, j in enumerate(order)}
    nodes: list[tuple] = [("input", 0, k) for k in range(len(known))]
    for j in sorted(inside):
        name, *operands = graph.nodes[j]
        nodes.append((name, *(place[i] for i in operands)))
    return values_of(nodes, [ca.vertcat(*known.values())])[place[root]]


class Term(NamedTuple):
    """V(s) of a linear or quadratic form s: the term and the form as expressions, which operation
    the form is, the factor of the term, a symbol s and in it V, V', V''; |∇s|², tr a² and tr a of
    a = M⁻¹ ∂²s/∂q², a ∇s·M⁻¹∇s, and whether the form is linear.
    """

    term: ca.SX
    form: ca.SX
    operation: int
    factor: ca.SX
    s: ca.SX
    value: ca.SX
    first: ca.SX
    second: ca.SX
    speed: ca.SX
    size: ca.SX
    trace: ca.SX
    gap: ca.SX
    linear: bool

    def at_form(self, x: ca.SX) -> ca.SX:
        return ca.substitute(x, self.s, self.form)


def _term(graph: _Graph, root: int, inverse: ca.SX, factor: ca.SX) -> Term | None:
    """What the rate of a term is made of; None where it is a function of no single form."""
    system = graph.system
    for i in _forms(graph, root):
        form = graph.expressions[i]
        used = [j for j in range(system.q.numel()) if graph.used[i] >> j & 1]
        q = system.q[used]
        curvature, slope = ca.hessian(form, q)
        if not ca.depends_on(curvature, q):
            break
    else:
        return None
    s, inverse = ca.SX.sym("s"), inverse[used, used]
    value = factor * _in_form(graph, root, i, s)
    first = ca.gradient(value, s)
    second = ca.gradient(first, s)
    ahead = inverse @ slope
    speed = ca.dot(slope, ahead)
    a = inverse @ curvature
    size, trace = ca.sum1(ca.vec(a * a.T)), ca.trace(a)
    about = size, trace, ca.dot(slope, a @ inverse @ slope), curvature.is_zero()
    return Term(graph.expressions[root], form, i, factor, s, value, first, second, speed, *about)
