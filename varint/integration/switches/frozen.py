"""The smooth scene between two switches: steps and kinks of forces and potentials are decided by
parameters, so that it is one scene for all branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.integration.switches.reading import Node, Switches
from varint.numerics.operations import Operations, operations_of
from varint.scene.memory import per_system
from varint.scene.parameters import Parameters, with_more
from varint.scene.system import System

MOST_SWITCHES = 40  # of one scene


class FrozenScene(NamedTuple):
    """A scene whose steps and kinks are decided by parameters.

    Attributes
    ----------
    system : System
        With one more vector of parameters, s (m,).
    s, sigma : SX (m,)
        Those parameters, and what switches: s is its sign, or its whole part where it counts.
    counts : array of bool (m,)
        Which of them count, as `floor` does.
    """

    system: System
    s: ca.SX
    sigma: ca.SX
    counts: np.ndarray


@per_system
def frozen_scene(system: System) -> FrozenScene | None:
    """The scene with its switches as parameters; None where it has none, or more than forces and
    potentials switch, or it is no scene of free coordinates and no controls.
    """
    s = system
    held = ca.vertcat(s.constraint, s.contact, ca.vec(s.nonholonomic))
    if held.numel() or s.control.numel() or s.rays or s.kinetics or s.structure.degenerate:
        return None
    inputs = [s.q, s.v, s.t, s.c]
    operations = operations_of(ca.Function("scene", inputs, [s.lagrangian, ca.densify(s.force)]))
    moving = ca.vertcat(s.q, s.v, s.t)
    read = Switches(moving)
    nodes = _read(read, operations, inputs)
    if read.bounded:
        read = Switches(moving, kinks=True)
        nodes = _read(read, operations, inputs)
    count = len(read.symbols)
    if not 0 < count <= MOST_SWITCHES:
        return None
    lagrangian, force = (
        ca.vertcat(*(nodes[i].value for i in output.nodes)) for output in operations.outputs
    )
    params = with_more(s.params or Parameters(), **{(name := _free_name(s)): np.ones(count)})
    values = params._symbols[name]
    lagrangian, force, sigma = ca.substitute(
        [lagrangian, force, ca.vertcat(*read.sigma)], [ca.vertcat(*read.symbols)], [values]
    )
    if ca.depends_on(ca.gradient(lagrangian, s.v), values):
        return None
    frozen = System(s.q, s.v, lagrangian, force=ca.sparsify(force), params=params, t=s.t)
    return FrozenScene(frozen, values, sigma, np.array(read.counts))


def _read(read: Switches, operations: Operations, inputs: Sequence[ca.SX]) -> list[Node]:
    """All operations, one after the other."""
    nodes: list[Node] = []
    for name, *taken in operations.nodes:
        if name == "const":
            nodes.append(read.number(taken[0]))
        elif name == "input":
            nodes.append(read.given(inputs[taken[0]][taken[1]]))
        else:
            nodes.append(read.read(name, *(nodes[i] for i in taken)))
    return nodes


def _free_name(system: System) -> str:
    """A name that none of the scene's symbols begins with."""
    s, name = system, "switch"
    known = [x.name() for x in ca.symvar(ca.vertcat(s.q, s.v, s.t, s.c))]
    while any(x.startswith(name) for x in known):
        name += "_"
    return name
