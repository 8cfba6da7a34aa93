"""The scene of a machine: its Lagrangian, forces, constraints and controls."""

from __future__ import annotations

import casadi as ca

from varint.errors import InputError
from varint.multibody.articulated import velocity_of_momentum
from varint.multibody.data import Machine
from varint.multibody.dynamics import armature_matrix, mass_matrix
from varint.multibody.forces import generalised_force, spring_potential
from varint.multibody.kinematics import Motions
from varint.multibody.lagrangian import gravity_potential, joint_energies, kinetic_energy
from varint.multibody.loops import constraint_rows
from varint.multibody.motion import motions_of
from varint.multibody.resistance import stiffness_and_damping
from varint.multibody.slopes import link_slopes
from varint.multibody.stretching import (
    rays_of,
    stretching_energy,
    stretching_inertias,
    stretching_matrix,
)
from varint.multibody.tree import Tree, tree_of
from varint.multibody.weightless import refuse_weightless
from varint.scene.kinetics import Kinetics
from varint.scene.system import System


def assemble(machine: Machine) -> System:
    """The machine as a `System`; raises InputError where it does not hang together or a joint moves
    nothing.
    """
    if not machine.q.numel():
        raise InputError("nothing can move: the model has no joint but fixed ones")
    tree, motions = tree_of(machine.bodies, machine.joints.values()), motions_of(machine)
    kinetics = kinetics_of(machine, tree, motions)
    refuse_weightless(machine, tree, kinetics.mass_matrix)
    lagrangian = (
        kinetic_energy(tree, motions)
        - gravity_potential(tree, motions, machine.gravity)
        + other_energies(machine, tree, motions)
    )
    return System(
        machine.q,
        machine.v,
        lagrangian,
        constraint=constraint_rows(machine, tree, motions),
        force=generalised_force(machine, tree, motions),
        control=ca.vertcat(ca.SX(0, 1), *(x.u for x in machine.actuators.values())),
        params=machine.params,
        kinetics=kinetics,
        rays=rays_of(machine),
    )


def other_energies(machine: Machine, tree: Tree, motions: Motions) -> ca.SX:
    """What L has besides the links' kinetic energy and weight."""
    return (
        joint_energies(machine.joints, motions)
        - spring_potential(machine, tree, motions)
        + stretching_energy(machine.joints, motions, stretching_inertias(machine, tree))
    )


def slopes_of(machine: Machine, tree: Tree, motions: Motions) -> ca.SX:
    """∂L/∂q and ∂L/∂v (2 n,): of the links by recursion."""
    state = ca.vertcat(machine.q, machine.v)
    other = ca.gradient(other_energies(machine, tree, motions), state)
    return link_slopes(tree, motions, machine.gravity, state) + other


def kinetics_of(machine: Machine, tree: Tree, motions: Motions) -> Kinetics:
    """Mass matrix by composite bodies, derivatives of L by recursion; the inverse Legendre
    transform by articulated bodies where no joint follows another.
    """
    joints, v = list(machine.joints.values()), machine.v
    stretching = stretching_inertias(machine, tree)
    matrix = mass_matrix(tree, motions, v) + armature_matrix(joints, motions, v)
    matrix += stretching_matrix(machine.joints, motions, stretching, v)
    known = {
        "slopes": slopes_of(machine, tree, motions),
        **stiffness_and_damping(machine, tree, motions),
    }
    if machine.couplings:
        return Kinetics(matrix)._replace(**known)
    momenta = {joint.name: ca.SX.sym(f"p_{joint.name}", joint.v.numel()) for joint in joints}
    armatures = {joint.name: joint.passive.armature for joint in joints}
    rates = velocity_of_momentum(tree, motions, momenta, armatures, stretching)
    order = [joint.name for joint in joints if joint.v.numel()]
    return Kinetics(
        matrix,
        ca.vertcat(*(momenta[name] for name in order)),
        ca.vertcat(*(rates[name] for name in order)),
        **known,
    )
