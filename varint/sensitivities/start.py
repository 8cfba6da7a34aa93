"""How a run begins: from (q0, v0) or (q0, p0), and what that makes of changes of both."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from varint.discrete.constraints import multiplier_function
from varint.discrete.legendre import velocity_function
from varint.errors import InputError
from varint.numerics.arrays import call
from varint.results.dense_output import controls_at_nodes
from varint.results.trajectory import Trajectory
from varint.scene.expressions import in_own_symbols
from varint.scene.memory import lately, per_system
from varint.scene.system import System
from varint.sensitivities.pieces import scene_of

REMEMBERED = 64  # expressions of a system that are kept as text


@per_system
def momentum_slopes(system: System) -> ca.Function:
    """(q, v, t, c) → ∂p/∂q, ∂p/∂v, ∂p/∂c, ∂p/∂t of p = ∂L/∂v."""
    s = system
    slopes = [ca.densify(ca.jacobian(s.momentum, x)) for x in (s.q, s.v, s.c, s.t)]
    return ca.Function("momentum_slopes", [s.q, s.v, s.t, s.c], slopes, {"cse": True})


@per_system
def momentum_function(system: System) -> ca.Function:
    """(q, v, t, c) → p = ∂L/∂v."""
    s = system
    return ca.Function("momentum", [s.q, s.v, s.t, s.c], [ca.densify(s.momentum)])


def start_slopes(motion: Trajectory, node: int = 0) -> list[np.ndarray]:
    """∂p/∂q (n, n), ∂p/∂v (n, n), ∂p/∂c (n, C), ∂p/∂t (n, 1) at a node."""
    n = motion.q.shape[1]
    at = motion.q[node], motion.v[node], motion.t[node : node + 1], motion.c
    flat = call(momentum_slopes(motion.system), *at)
    return [x.reshape(-1, n).T for x in flat]


def state_function(system: System, expression: ca.SX) -> ca.Function:
    """(q, p, t, c) → an expression of q, v, t and the parameters, a column.

    Raises
    ------
    InputError
        If it depends on controls, which belong to steps and not to nodes.
    """
    s = system
    own = ca.vec(ca.densify(in_own_symbols(expression, s)))
    if s.structure.controls and ca.depends_on(own, s.control):
        raise InputError(
            "an expression of the nodes depends on controls, which belong to the steps between "
            "them; write it without, or as the running loss"
        )
    value = ca.Function("value", [s.q, s.v, s.t, s.c], [own], {"cse": True})
    velocity = velocity_function(s)
    if not ca.depends_on(own, s.v):
        at = [s.q, ca.SX.sym("p", s.structure.n), s.t, s.c]
        return ca.Function("of_state", at, [value(s.q, s.v, s.t, s.c)], {"cse": True})
    q, p, t, c = symbols_for(velocity)
    return ca.Function("of_state", [q, p, t, c], [value(q, velocity(q, p, t, c), t, c)])


def symbols_for(of_state: ca.Function) -> list[Any]:
    """q, p, t, c for a function of a state: SX, the faster, where it is written out."""
    kind = ca.SX if of_state.is_a("SXFunction") else ca.MX
    return [kind.sym(name, of_state.size1_in(i)) for i, name in enumerate("qptc")]


def slopes_of(system: System, outputs: ca.SX) -> ca.Function:
    """(q, p, t, c) → derivatives of expressions with respect to (q, p), c and t."""
    return _slopes(system, as_text(system, outputs))


def as_text(system: System, expression: ca.SX) -> str:
    """The function (q, v, t, u, c) → an expression, serialised: the same for the same expression,
    which is not written again.
    """
    known, written = _texts(system), expression.serialize()  # symbols by their names

    def made() -> str:
        s, own = system, in_own_symbols(expression, system)
        density = ca.Function("density", [s.q, s.v, s.t, s.control, s.c], [own], {"cse": True})
        return density.serialize()

    return lately(known, written, made, REMEMBERED)


@per_system
def _texts(system: System) -> dict[str, str]:
    """Functions by the expressions that they were made of."""
    return {}


@per_system
def _slopes(system: System, text: str) -> ca.Function:
    s = system
    outputs = ca.Function.deserialize(text)(s.q, s.v, s.t, s.control, s.c)
    value = state_function(system, outputs)
    q, p, t, c = inputs = symbols_for(value)
    out = value(*inputs)
    slopes = [ca.densify(ca.jacobian(out, x)) for x in (ca.vertcat(q, p), c, t)]
    return ca.Function("output_slopes", inputs, slopes, {"cse": True})


def output_slopes(system: System) -> ca.Function:
    """`slopes_of` q and v."""
    return slopes_of(system, ca.vertcat(system.q, system.v))


def scenes_at(motion: Trajectory, nodes: slice) -> list[tuple[Any, System]]:
    """Those of some nodes, and the scene that moves on from them, for every active set."""
    if motion.active_set is None or not motion.system.structure.contacts:
        return [(slice(None), scene_of(motion))]
    held = motion.active_set[nodes]
    return [(held == i, motion.active_sets[i].scene(motion.system)) for i in np.unique(held)]


def rate_at(motion: Trajectory, node: int) -> np.ndarray:
    """d(q, p)/dt of the continuous motion at a node, (2n,)."""
    ((_, scene),) = scenes_at(motion, slice(node, node + 1))
    u = controls_at_nodes(motion)[node]
    t = motion.t[node : node + 1]
    return call(rate_function(scene), motion.q[node], motion.p[node], t, u, motion.c)[0]


@per_system
def rate_function(system: System) -> ca.Function:
    """(q, p, t, u, c) → d(q, p)/dt."""
    s, n = system, system.structure.n
    a = ca.SX.sym("a", n)
    slope = ca.jtimes(s.momentum, s.q, s.v) + ca.jtimes(s.momentum, s.v, a)
    slope += ca.jacobian(s.momentum, s.t)
    gain = ca.Function("gain", [s.q, s.v, a, s.t, s.c], [ca.densify(slope)])
    sizes = (n, n, 1, s.control.numel(), s.c.numel())
    q, p, t, u, c = inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes)]
    v = velocity_function(s)(q, p, t, c)
    acceleration = multiplier_function(s)(q, v, u, t, c)[1]
    return ca.Function("rate", inputs, [ca.vertcat(v, gain(q, v, acceleration, t, c))])
