"""The smooth scene between two switches: steps and kinks of forces and potentials are decided by
parameters, so that it is one scene for all branches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.integration.cuts import cuts_of
from varint.integration.switches.reading import Node, Switches
from varint.numerics.operations import Operations, operations_of
from varint.scene.memory import per_system
from varint.scene.parameters import Parameters, with_more
from varint.scene.structure import jumps
from varint.scene.system import System

MOST_SWITCHES = 40  # of one scene


class FrozenScene(NamedTuple):
    """A scene whose steps and kinks are decided by parameters.

    Attributes
    ----------
    system : System
        With two more vectors of parameters, the controls (k,) and s (m,), and the same rows.
    s, sigma : SX (m,)
        Those parameters, and what switches: s is its sign, or its whole part where it counts.
    counts : array of bool (m,)
        Which of them count, as `floor` does.
    controls : SX (k,)
        The parameters that stand for controls.
    """

    system: System
    s: ca.SX
    sigma: ca.SX
    counts: np.ndarray
    controls: ca.SX


@per_system
def frozen_scene(system: System) -> FrozenScene | None:
    """The scene with its switches as parameters, contacts left open; None where it has none, or
    more than forces, potentials and, by time alone, inertia switch, or it has no masses.
    """
    s = system
    if s.structure.degenerate or jumps(s.contact, ca.vertcat(s.q, s.t)):
        return None
    inputs = [s.q, s.v, s.t, s.c, s.control]
    operations = operations_of(ca.Function("scene", inputs, [s.lagrangian, ca.densify(s.force)]))
    moving = ca.vertcat(s.q, s.v, s.t)
    if jumps(ca.vertcat(s.constraint, ca.vec(s.nonholonomic)), moving):
        return None
    cuts = cuts_of(s) is not None
    read = Switches(moving, cuts)
    nodes = _read(read, operations, inputs)
    if read.bounded:
        read = Switches(moving, cuts, kinks=True)
        nodes = _read(read, operations, inputs)
    count = len(read.symbols)
    if not 0 < count <= MOST_SWITCHES:
        return None
    expressions = [
        *(ca.vertcat(*(nodes[i].value for i in output.nodes)) for output in operations.outputs),
        ca.vertcat(*read.sigma),
    ]
    params, old, new = s.params or Parameters(), [ca.vertcat(*read.symbols)], []
    many = s.control.numel()
    if many:
        params = with_more(params, **{(name := free_name(s, "control")): np.zeros(many)})
        new, old = [params._symbols[name]], [s.control, *old]
    params = with_more(params, **{(name := free_name(s, "switch")): np.ones(count)})
    values = params._symbols[name]
    lagrangian, force, sigma = ca.substitute(expressions, old, [*new, values])
    inertial = ca.which_depends(ca.gradient(lagrangian, s.v), values, 1, False)
    if any(inertial):  # momenta do not jump where time alone switches inertia
        by_time = _by_time(sigma, values, ca.vertcat(s.q, s.v, *new))
        if s.kinetics or not all(by_time[i] for i in range(count) if inertial[i]):
            return None
    frozen = _smooth(s, lagrangian, force, params, ca.depends_on(lagrangian, values))
    controls = ca.vertcat(ca.SX(0, 1), *new)
    return FrozenScene(frozen, values, sigma, np.array(read.counts), controls)


def _by_time(sigma: ca.SX, values: ca.SX, others: ca.SX) -> list[bool]:
    """Which switches depend on none of the others, also by way of switches read before them."""
    found: list[bool] = []
    for i in range(values.numel()):
        parts = [x for j, x in enumerate(ca.vertsplit(values)) if j >= i or not found[j]]
        found.append(not ca.depends_on(sigma[i], ca.vertcat(others, *parts)))
    return found


def with_force(system: System, force: ca.SX) -> System:
    """The smooth scene with another force."""
    return _smooth(system, system.lagrangian, force, system.params, False)


def _smooth(
    system: System, lagrangian: ca.SX, force: ca.SX, params: Parameters | None, otherwise: bool
) -> System:
    """A scene of the same coordinates and constraints, without controls; is its L another?"""
    s, kinetics = system, system.kinetics
    return System(
        s.q,
        s.v,
        lagrangian,
        force=ca.sparsify(force),
        constraint=s.constraint,
        nonholonomic=s.nonholonomic,
        params=params,
        t=s.t,
        kinetics=kinetics.of_other_potential() if kinetics and otherwise else kinetics,
        rays=s.rays,
    )


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


def free_name(system: System, name: str) -> str:
    """A name that none of the scene's symbols begins with."""
    s = system
    known = [x.name() for x in ca.symvar(ca.vertcat(s.q, s.v, s.t, s.c, s.control))]
    while any(x.startswith(name) for x in known):
        name += "_"
    return name
