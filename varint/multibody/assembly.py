"""The scene of a machine: its Lagrangian, forces, constraints and controls."""

from __future__ import annotations

import casadi as ca

from varint.errors import InputError
from varint.multibody.data import Machine
from varint.multibody.joints import QUATERNION_AT
from varint.multibody.lagrangian import gravity_potential, joint_energies, kinetic_energy
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
        + joint_energies(machine.joints, motions)
    )
    return System(
        machine.q,
        machine.v,
        lagrangian,
        constraint=unit_quaternions(machine),
        params=machine.params,
    )


def unit_quaternions(machine: Machine) -> ca.SX:
    """|q|² − 1 of every joint that turns by a quaternion."""
    norms = [
        ca.sumsqr(joint.q[QUATERNION_AT[joint.kind] :]) - 1
        for joint in machine.moving
        if joint.kind in QUATERNION_AT
    ]
    return ca.vertcat(ca.SX(0, 1), *norms)
