"""The builder of machines: what users call one after the other; `system` makes the scene of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from varint.multibody.assembly import assemble
from varint.multibody.data import (
    NOTHING,
    Actuator,
    Anchor,
    Body,
    Coupling,
    Joint,
    Loop,
    Machine,
    Passive,
    Spring,
)
from varint.multibody.frames import Frame, frame_of
from varint.multibody.functions import Dynamics
from varint.multibody.joints import direction_across, joint_of
from varint.multibody.names import anchor_of, body_name, ground, joint_name, new_name, refuse_taken
from varint.multibody.parts import (
    body_of,
    bounds_of,
    coupling_of,
    loop_of,
    motor_of,
    named,
    spring_of,
    thrust_of,
)
from varint.multibody.quantities import not_negative, point
from varint.multibody.symbolic import make_symbolic
from varint.scene.parameters import Parameters
from varint.scene.system import System

Part = TypeVar("Part", Loop, Spring, Actuator)
Pair = tuple[Any, Any]


class Model:
    """A machine: bodies in a tree of joints, loops that close it, springs, actuators, markers.

    Coordinates stand in the order in which their joints were made.

    Parameters
    ----------
    gravity : array (3,) or SX, optional
        Acceleration of gravity (default (0, 0, −9.81)).
    params : Parameters, optional
        Named constants that the model's expressions are written in; `symbolic` adds to them.
    creep : float, optional
        Speed (of the coordinate, rad/s or m/s) below which dry friction turns over smoothly,
        ``−f v/√(v² + creep²)`` (default 1e-3).

    Attributes
    ----------
    machine : Machine
        All parts as plain data.
    bodies, joints, markers : dict
        Those of `machine`, by name.

    Examples
    --------
    >>> import varint as vi
    >>> import varint.multibody as mb
    >>> world = mb.Model()
    >>> upper = world.body(1.0, com=(0, 0, -0.5), inertia=0.1, name="upper")
    >>> lower = world.body(1.0, com=(0, 0, -0.5), inertia=0.1, name="lower")
    >>> shoulder = world.revolute(world, upper, axis=(0, 1, 0), name="shoulder")
    >>> elbow = world.revolute(upper, lower, axis=(0, 1, 0), at=(0, 0, -1), name="elbow")
    >>> hand = world.marker(lower, at=(0, 0, -1), name="hand")
    >>> world.system()
    System(q=[shoulder, elbow])
    >>> ca.evalf(ca.substitute(world.frame("hand").position, world.q, ca.DM([0, 0])))
    DM([0, 0, -2])
    """

    def __init__(
        self,
        gravity: Any = (0.0, 0.0, -9.81),
        *,
        params: Parameters | None = None,
        creep: float = 1e-3,
    ):
        self.machine = Machine(
            point("gravity", gravity),
            not_negative("creep", creep),
            Parameters() if params is None else params,
        )
        self.bodies, self.joints = self.machine.bodies, self.machine.joints
        self.markers = self.machine.markers
        self._system: System | None = None

    def __repr__(self) -> str:
        return f"Model(bodies={list(self.bodies)}, joints={list(self.joints)})"

    def body(
        self,
        mass: Any = 0.0,
        com: Any = (0.0, 0.0, 0.0),
        inertia: Any = 0.0,
        name: str | None = None,
        *,
        visuals: Sequence[Any] = (),
    ) -> Body:
        """A rigid body; a joint must lead to it.

        Parameters
        ----------
        mass : float or SX
        com : array (3,) or SX
            Centre of mass in the body's frame.
        inertia : float, array (3,) or (3, 3), or SX
            About the centre of mass, along the body's axes: of a ball, principal moments, or the
            matrix.
        name : str, optional
        visuals : sequence
            What drawings show of it; nothing else looks into it.

        Raises
        ------
        InputError
            If the mass or a principal moment is negative, the matrix is not symmetric, or one
            moment is larger than the sum of the others, which no rigid body has. One alone,
            (0, 0, I), is taken: it is all that a body needs that turns about one axis.
        """
        name = new_name("body", name, self.bodies)
        self.bodies[name] = body_of(name, mass, com, inertia, visuals)
        self._system = None
        return self.bodies[name]

    def revolute(
        self,
        parent: Any,
        child: Any,
        axis: Any = (0.0, 0.0, 1.0),
        at: Any = (0.0, 0.0, 0.0),
        name: str | None = None,
        *,
        child_at: Any = (0.0, 0.0, 0.0),
        passive: Passive = NOTHING,
        limits: Any = None,
    ) -> Joint:
        """A hinge: the child turns about an axis; at q = 0 its frame is that of the joint.

        Parameters
        ----------
        parent, child : Body, str or the model itself
            The model stands for the ground.
        axis : array (3,)
            In the joint's frame.
        at : array (3,), SX or Placement
            Where the joint's frame stands in the parent: a position, or `placed` with a rotation.
        name : str, optional
            Of the joint and its coordinate (default the child's).
        child_at : array (3,), SX or Placement
            Where the joint's frame stands in the child (default its origin).
        passive : Passive
            Inertia of the rotor, damping, dry friction and spring of its coordinate.
        limits : (lower, upper) or Limits
            Kept as data, see `bounds`.
        """
        ats = (at, child_at)
        return self._joint("revolute", name, parent, child, (axis,), ats, passive, limits)

    def prismatic(
        self,
        parent: Any,
        child: Any,
        axis: Any = (0.0, 0.0, 1.0),
        at: Any = (0.0, 0.0, 0.0),
        name: str | None = None,
        *,
        child_at: Any = (0.0, 0.0, 0.0),
        passive: Passive = NOTHING,
        limits: Any = None,
    ) -> Joint:
        """A slide: the child moves along an axis. Parameters as in `revolute`."""
        ats = (at, child_at)
        return self._joint("prismatic", name, parent, child, (axis,), ats, passive, limits)

    def universal(
        self,
        parent: Any,
        child: Any,
        axes: Any = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        at: Any = (0.0, 0.0, 0.0),
        name: str | None = None,
        *,
        child_at: Any = (0.0, 0.0, 0.0),
        passive: Passive = NOTHING,
    ) -> Joint:
        """Two hinges in one point: about the first axis, then about the second, which turns with
        it; coordinates ``name_1``, ``name_2``. Other parameters as in `revolute`.
        """
        return self._joint("universal", name, parent, child, tuple(axes), (at, child_at), passive)

    def spherical(
        self,
        parent: Any,
        child: Any,
        at: Any = (0.0, 0.0, 0.0),
        name: str | None = None,
        *,
        child_at: Any = (0.0, 0.0, 0.0),
        damping: Any = 0.0,
    ) -> Joint:
        """A ball joint by unit quaternion, ``name_qw`` … ``name_qz``, body to parent; a damping
        torque −d ω. Other parameters as in `revolute`.
        """
        ats = (at, child_at)
        return self._joint("spherical", name, parent, child, (), ats, Passive(damping=damping))

    def planar(
        self,
        parent: Any,
        child: Any,
        normal: Any = (0.0, 0.0, 1.0),
        at: Any = (0.0, 0.0, 0.0),
        name: str | None = None,
        *,
        direction: Any = None,
        child_at: Any = (0.0, 0.0, 0.0),
        damping: Any = 0.0,
    ) -> Joint:
        """Motion in a plane: ``name_x`` along `direction`, ``name_y`` across it, then turned by
        ``name_angle`` about the normal. Other parameters as in `revolute`.
        """
        axes = (normal, direction_across(normal) if direction is None else direction)
        ats = (at, child_at)
        return self._joint("planar", name, parent, child, axes, ats, Passive(damping=damping))

    def free(
        self,
        parent: Any,
        child: Any,
        at: Any = (0.0, 0.0, 0.0),
        name: str | None = None,
        *,
        damping: Any = 0.0,
    ) -> Joint:
        """No joint at all: position ``name_x`` … and unit quaternion ``name_qw`` … in the parent;
        damping −d times velocity and angular velocity.
        """
        ats = (at, (0.0, 0.0, 0.0))
        return self._joint("free", name, parent, child, (), ats, Passive(damping=damping))

    def fixed(
        self, parent: Any, child: Any, at: Any = (0.0, 0.0, 0.0), name: str | None = None
    ) -> Joint:
        """The child is fixed in the parent; their inertias become one."""
        return self._joint("fixed", name, parent, child, (), (at, (0.0, 0.0, 0.0)), NOTHING)

    def mimic(
        self, follower: Any, leader: Any, multiplier: Any = 1.0, offset: Any = 0.0
    ) -> Coupling:
        """One coordinate follows another, ``q = multiplier q_leader + offset``; it is no coordinate
        of the system any more. Gears are mimics with their ratio, −z₁/z₂ for teeth that mesh.

        Parameters
        ----------
        follower, leader : Joint or str
            Revolute or prismatic.
        multiplier, offset : float or SX
        """
        return self.couple(follower, leader, (offset, multiplier))

    def screw(self, slide: Any, turn: Any, pitch: Any) -> Coupling:
        """A prismatic joint follows a revolute one by `pitch` for each full turn."""
        return self.couple(slide, turn, (0.0, pitch / (2 * np.pi)))

    def couple(self, follower: Any, leader: Any, coefficients: Sequence[Any]) -> Coupling:
        """One coordinate is a polynomial of another, ``q = Σ_k coefficients[k] q_leaderᵏ``."""
        self.machine.couplings.append(
            coupling_of(self.machine, named(follower), named(leader), coefficients)
        )
        self._system = None
        return self.machine.couplings[-1]

    def loop(
        self, kind: str, a: Any, b: Any, name: str | None = None, *, length: Any = None
    ) -> Loop:
        """Close a loop by a constraint between two frames.

        Parameters
        ----------
        kind : str
            "point": the origins coincide (a ball joint, 3 rows); "axis": and the third axes are
            parallel (a hinge, 5); "weld": the frames coincide (6); "distance": the origins are
            `length` apart (a rod, 1); "line": the origin of b stays on the third axis of a (2);
            "plane": b stays in the plane through a across it (1). Rows that hold whatever the
            coordinates are, as out of a plane mechanism's plane, are left out.
        a, b : str, Body, Anchor, or (body, place)
        length : float or SX
            Of "distance".
        """
        name = new_name("loop", name, self.machine.loops)
        loop = loop_of(name, kind, self._anchor(a), self._anchor(b), length)
        return self._added(self.machine.loops, loop)

    def spring(
        self,
        a: Any,
        b: Any,
        stiffness: Any = 0.0,
        rest: Any = 0.0,
        damping: Any = 0.0,
        name: str | None = None,
    ) -> Spring:
        """Spring and damper along the line between two frames' origins, ½ k (ℓ − rest)² and −d
        dℓ/dt; without rest length and damping they may meet.
        """
        name = new_name("spring", name, self.machine.springs)
        spring = spring_of(name, self._anchor(a), self._anchor(b), stiffness, rest, damping)
        return self._added(self.machine.springs, spring)

    def motor(
        self,
        joint: Any,
        name: str | None = None,
        *,
        index: int = 0,
        gear: Any = 1.0,
        limits: tuple[float, float] | None = None,
    ) -> Actuator:
        """A control u with the generalised force ``gear u`` on a joint's coordinate.

        Parameters
        ----------
        joint : Joint or str
        name : str, optional
            Of the control (default ``joint_u``).
        index : int, optional
            Which of the joint's coordinates.
        gear : float or SX, optional
        limits : (float, float), optional
            Least and largest u, see `bounds`; by default the joint's limit of effort.
        """
        motor = motor_of(self.machine, named(joint), name, index, gear, limits)
        new_name("actuator", motor.name, self.machine.actuators)
        return self._added(self.machine.actuators, motor)

    def thrust(
        self,
        frame: Any,
        name: str | None = None,
        *,
        gear: Any = 1.0,
        limits: tuple[float, float] | None = None,
        kind: str = "thrust",
    ) -> Actuator:
        """A control u with the force ``gear u`` along a frame's third axis at its origin, or of
        kind "torque" with the torque about it.
        """
        name = new_name("actuator", name, self.machine.actuators)
        pushed = thrust_of(name, kind, self._anchor(frame), gear, limits)
        return self._added(self.machine.actuators, pushed)

    def symbolic(self, *names: str) -> Parameters:
        """Make numbers of the model parameters of its system, for `fit` and ``params=``.

        Parameters
        ----------
        *names : str
            "arm.mass", "arm.com", "arm.inertia", "elbow.damping", "elbow.armature", "spring1.rest",
            "gravity", …; the parameter is called ``arm_mass``.

        Returns
        -------
        Parameters
            All parameters of the model.
        """
        for name in names:
            make_symbolic(self.machine, name)
        self._system = None
        return self.machine.params

    def bounds(self) -> list[tuple[float, ca.SX, float]]:
        """Limits of joints and actuators as ``bounds`` of `optimal_control`."""
        return bounds_of(self.machine)

    def marker(self, body: Any, at: Any = (0.0, 0.0, 0.0), name: str | None = None) -> Anchor:
        """A frame fixed to a body, or to the model's own ground, for `frame`, loops, drawings."""
        name = new_name("marker", name, self.markers | self.bodies)
        self.markers[name] = self._anchor((body, at))
        return self.markers[name]

    def frame(self, name: Any) -> Frame:
        """Place and velocity of a body or marker as expressions of `q` and `v`.

        Parameters
        ----------
        name : str, Body or Anchor
        """
        return frame_of(self.machine, self._anchor(name))

    @property
    def q(self) -> ca.SX:
        """Coordinates of the system, (n,)."""
        return self.machine.q

    @property
    def v(self) -> ca.SX:
        """Rates of the coordinates, (n,)."""
        return self.machine.v

    @property
    def dynamics(self) -> Dynamics:
        """Inverse dynamics, mass matrix, bias and gravity as CasADi functions."""
        return Dynamics(self.machine)

    def system(self) -> System:
        """The machine as a scene: Lagrangian by recursion over the tree, forces, constraints.

        Raises
        ------
        InputError
            If the machine does not hang together or nothing can move.
        """
        if self._system is None:
            self._system = assemble(self.machine)
        return self._system

    def _anchor(self, given: Any) -> Anchor:
        return anchor_of(self.machine, ground(self, given))

    def _joint(
        self, kind: str, name: Any, parent, child, axes: tuple, ats: Pair, passive, limits=None
    ) -> Joint:
        parent, child = ground(self, (parent, child))
        name = joint_name(self.machine, child, name)
        outer = body_name(self.machine, parent)
        inner = body_name(self.machine, child)
        joint = joint_of(kind, name, outer, inner, axes, *ats, passive, limits)
        refuse_taken(self.machine, joint.coordinates)
        self.joints[name] = joint
        self._system = None
        return joint

    def _added(self, parts: dict[str, Part], part: Part) -> Part:
        parts[part.name] = part
        self._system = None
        return part
