"""The scene of a machine: its Lagrangian, forces, constraints and controls."""

from __future__ import annotations

import casadi as ca

from varint.errors import InputError
from varint.multibody.data import Machine
from varint.multibody.forces import generalised_force, spring_potential
from varint.multibody.lagrangian import gravity_potential, joint_energies, kinetic_energy
from varint.multibody.loops import constraint_rows
from varint.multibody.motion import motions_of
from varint.multibody.tree import tree_of
from varint.scene.system import System


def assemble(machine: Machine) -> System:
    """The machine as a `System`; raises InputError where it does not hang together."""
    if not machine.q.numel():
        raise InputError("nothing can move: the model has no joint but fixed ones")
    tree, motions = tree_of(machine.bodies, machine.joints.values()), motions_of(machine)
    lagrangian = (
        kinetic_energy(tree, motions)
        - gravity_potential(tree, motions, machine.gravity)
        - spring_potential(machine, tree, motions)
        + joint_energies(machine.joints, motions)
    )
    return System(
        machine.q,
        machine.v,
        lagrangian,
        constraint=constraint_rows(machine, tree, motions),
        force=generalised_force(machine, tree, motions),
        control=ca.vertcat(ca.SX(0, 1), *(x.u for x in machine.actuators.values())),
        params=machine.params,
    )
