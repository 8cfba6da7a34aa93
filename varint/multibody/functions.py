"""Inverse dynamics and its parts as CasADi functions of numbers or expressions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from varint.multibody.assembly import kinetics_of
from varint.multibody.data import Machine
from varint.multibody.dynamics import efforts
from varint.multibody.forces import dissipation, spring_potential
from varint.multibody.kinematics import Motions
from varint.multibody.lagrangian import joint_energies
from varint.multibody.motion import motions_of
from varint.multibody.stretching import stretching_energy, stretching_inertias
from varint.multibody.tree import Tree, tree_of
from varint.scene.parameters import parameter_vector


@dataclass(frozen=True)
class Dynamics:
    """Inverse dynamics, mass matrix, bias and gravity of a machine, by recursion over its tree.

    Each is a CasADi ``Function`` that takes numbers or expressions; where the model has parameters,
    their vector ``c`` (`System.c`) is its last input. Loops are left open: their reactions are for
    the caller to add. On quaternions the forces are conjugate to their rates; along a quaternion
    itself they say nothing.

    Attributes
    ----------
    inverse : Function
        (q, v, a) → τ (n,): the generalised forces that make the machine move so, M a + bias.
    bias : Function
        (q, v) → τ (n,): Coriolis and centrifugal forces, gravity, springs, dampers and friction,
        with the sign of what balances them.
    gravity : Function
        q → τ (n,): what holds the machine against gravity alone.
    mass_matrix : Function
        q → M (n, n).

    References
    ----------
    R. Featherstone, Rigid Body Dynamics Algorithms, Springer 2008, §5.3 and §6.2.

    Examples
    --------
    >>> import varint.multibody as mb
    >>> world = mb.Model()
    >>> arm = world.body(2.0, com=(0.5, 0, 0), inertia=0.1, name="arm")
    >>> joint = world.revolute(world, arm, axis=(0, -1, 0))
    >>> world.dynamics.inverse(0, 0, 1)
    DM(10.41)
    >>> world.dynamics.mass_matrix(0), world.dynamics.gravity(0)
    (DM(0.6), DM(9.81))
    """

    machine: Machine

    @cached_property
    def inverse(self) -> ca.Function:
        m, a = self.machine, ca.SX.sym("a", self.machine.v.numel())
        return self._function("inverse", {"q": m.q, "v": m.v, "a": a}, self._effort(a))

    @cached_property
    def bias(self) -> ca.Function:
        m = self.machine
        return self._function("bias", {"q": m.q, "v": m.v}, self._effort(0 * m.v))

    @cached_property
    def gravity(self) -> ca.Function:
        m, still = self.machine, 0 * self.machine.v
        found = ca.substitute(self._recursion(still, m.gravity), m.v, still)
        return self._function("gravity", {"q": m.q}, found)

    @cached_property
    def mass_matrix(self) -> ca.Function:
        found = kinetics_of(self.machine, self._tree, self._motions).mass_matrix
        return self._function("mass_matrix", {"q": self.machine.q}, found)

    @cached_property
    def _tree(self) -> Tree:
        return tree_of(self.machine.bodies, self.machine.joints.values())

    @cached_property
    def _motions(self) -> Motions:
        return motions_of(self.machine)

    def _function(self, name: str, inputs: dict[str, ca.SX], found: ca.SX) -> ca.Function:
        if (c := parameter_vector(self.machine.params)).numel():
            inputs = inputs | {"c": c}
        outputs = ["M" if name == "mass_matrix" else "tau"]
        return ca.Function(
            name, list(inputs.values()), [ca.densify(found)], list(inputs), outputs, {"cse": True}
        )

    def _recursion(self, a: ca.SX, gravity: Any) -> ca.SX:
        """Forces on the coordinates that give the links these accelerations."""
        m, motions = self.machine, self._motions
        state, rates = ca.vertcat(m.q, m.v), ca.vertcat(m.v, a)
        gained = {name: ca.jtimes(v, state, rates) for name, (_, v) in motions.items()}
        total = ca.SX.zeros(m.v.numel())
        for joint, effort in efforts(self._tree, motions, gained, gravity).items():
            total += ca.mtimes(ca.jacobian(motions[joint][1], m.v).T, effort)
        return total

    def _effort(self, a: ca.SX) -> ca.SX:
        """The same, with rotors, springs, dampers and friction."""
        m, motions = self.machine, self._motions
        stored = joint_energies(m.joints, motions) - spring_potential(m, self._tree, motions)
        stored += stretching_energy(m.joints, motions, stretching_inertias(m, self._tree))
        momentum = ca.gradient(stored, m.v)
        rate = ca.jtimes(momentum, ca.vertcat(m.q, m.v), ca.vertcat(m.v, a))
        lost = ca.gradient(dissipation(m, self._tree, motions), m.v)
        return self._recursion(a, m.gravity) + rate - ca.gradient(stored, m.q) + lost
