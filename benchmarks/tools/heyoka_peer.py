"""A varint system as a heyoka Taylor integrator: the same expression graph, node by node."""

import casadi as ca
import heyoka as hy
import numpy as np

from varint.codegen.algebra import graph_of
from varint.codegen.graph import Graph
from varint.codegen.mechanics import acceleration, force, velocity
from varint.discrete.legendre import mass_solve
from varint.scene.system import System

INFIX = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": lambda a, b: a / b,
    "neg": lambda a: -a,
    "rsqrt": lambda a: a**-0.5,
    "pow": lambda a, b: a**b,
}


def expressions(graph: Graph, inputs: list[list]) -> list[list]:
    """The outputs of a graph as heyoka expressions of these inputs."""
    values = []
    for name, *rest in graph.nodes:
        if name == "const":
            values.append(rest[0])
        elif name == "input":
            values.append(inputs[rest[0]][rest[1]])
        else:
            values.append((INFIX.get(name) or getattr(hy, name))(*(values[i] for i in rest)))
    return [[values[i] for i in output] for output in graph.outputs]


def taylor(system: System, form: str, tol: float):
    """An adaptive Taylor integrator with q and v ("velocities") or q and p ("momenta") as its
    state.
    """
    q, v = system.q, system.v
    n = q.numel()
    names = [f"x{i}" for i in range(2 * n)]
    x = list(hy.make_vars(*names))
    if form == "velocities":
        if system.structure.separable:
            right = acceleration(system)
        else:  # M a = ∂L/∂q + F − ∂p/∂q v − ∂p/∂t
            changes = ca.jtimes(system.momentum, q, v) + ca.jacobian(system.momentum, system.t)
            right = mass_solve(system.mass_matrix, force(system) - changes)
        f = ca.Function("f", [q, v, system.t, system.c], [v, ca.cse(right)])
    else:
        p = ca.SX.sym("p", n)
        speed = velocity(system, p)
        f = ca.Function(
            "f", [q, p, system.t, system.c], ca.cse([speed, ca.substitute(force(system), v, speed)])
        )
    numbers = system.default_vector.tolist()
    rows = expressions(graph_of(f), [x[:n], x[n:], [hy.time], numbers])
    # a constant is a float
    rates = [y if isinstance(y, hy.expression) else hy.expression(y) for y in rows[0] + rows[1]]
    return hy.taylor_adaptive(list(zip(x, rates, strict=True)), np.zeros(2 * n), tol=tol)
