"""What a machine is made of, as plain data: bodies, joints, couplings, loops, springs, actuators,
markers.

Lengths, masses and so on are in any consistent units. Whatever is a number may be an expression
of the model's parameters instead: numbers are kept as arrays, expressions as ``SX``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.scene.parameters import Parameters

WORLD = "world"  # the name of the ground: the body that does not move


class Placement(NamedTuple):
    """Where a frame stands in another one: ``x_outer = position + rotation @ x_inner``.

    Attributes
    ----------
    position : array (3,) or SX
    rotation : array (3, 3) or SX
    """

    position: Any
    rotation: Any


class Limits(NamedTuple):
    """What a joint's coordinate, speed and effort are bounded by; infinite where nothing is."""

    lower: float = -np.inf
    upper: float = np.inf
    speed: float = np.inf
    effort: float = np.inf


class Passive(NamedTuple):
    """What acts in a joint by itself, on each of its coordinates.

    Attributes
    ----------
    armature : float or SX
        Inertia of the rotor as the joint feels it, ½ a q̇².
    damping, friction : float or SX
        Forces −d q̇, and f against the motion whatever its speed (see ``creep`` of `Model`).
    stiffness, rest : float or SX
        Spring −k (q − rest).
    """

    armature: Any = 0.0
    damping: Any = 0.0
    friction: Any = 0.0
    stiffness: Any = 0.0
    rest: Any = 0.0


UNLIMITED, NOTHING = Limits(), Passive()


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body: mass, centre of mass and inertia about it, in the body's own axes.

    Attributes
    ----------
    name : str
    mass : float or SX
    com : array (3,) or SX
        Centre of mass, from the body's origin.
    inertia : array (3, 3) or SX
        About the centre of mass, along the body's axes.
    visuals : tuple
        What drawings show of it; nothing here looks into it.
    """

    name: str
    mass: Any
    com: Any
    inertia: Any
    visuals: tuple[Any, ...] = ()


@dataclass(frozen=True, eq=False)
class Joint:
    """How a body moves in its parent: one joint leads to each body.

    The body's frame stands in its parent's at ``placement ∘ motion(q) ∘ child_placement⁻¹``: where
    the joint is in the parent, how it moves, and where it is in the child.

    Attributes
    ----------
    name, kind, parent, child : str
        Kinds: "revolute", "prismatic", "universal", "spherical", "planar", "free", "fixed".
    axes : array (k, 3)
        Unit vectors in the joint's frame: the axis of a revolute or prismatic joint, the two of a
        universal one, the normal and the first direction of a planar one; else (0, 3).
    placement, child_placement : Placement
    q, v : SX (k,)
        Its coordinates and their rates, in the order of `coordinates`. Quaternions are (w, x, y,
        z).
    coordinates : tuple of str
        Their names.
    passive : Passive
        Of ball and free joints the damping alone, of the angular velocity and the velocity.
    limits : Limits
    """

    name: str
    kind: str
    parent: str
    child: str
    axes: np.ndarray
    placement: Placement
    child_placement: Placement
    q: ca.SX
    v: ca.SX
    coordinates: tuple[str, ...]
    passive: Passive = NOTHING
    limits: Limits = UNLIMITED


class Medium(NamedTuple):
    """A medium that bodies move through, and how fast it streams itself."""

    density: Any
    viscosity: Any
    wind: Any = (0.0, 0.0, 0.0)


class Coupling(NamedTuple):
    """The coordinate of one joint follows that of another: ``q = Σ_k coefficients[k] q_leaderᵏ``.

    Mimic joints, gears and screws: the follower is no coordinate of the system.
    """

    follower: str
    leader: str
    coefficients: tuple[Any, ...]


class Anchor(NamedTuple):
    """A frame fixed to a body."""

    body: str
    placement: Placement


@dataclass(frozen=True, eq=False)
class Loop:
    """What closes a loop, as constraints between two frames a and b.

    Attributes
    ----------
    name : str
    kind : str
        "point": the origins coincide (3 rows); "axis": and their third axes are parallel (5);
        "weld": the frames coincide (6); "distance": the origins are `length` apart (1);
        "line": the origin of b stays on the third axis of a (2); "plane": in the plane across
        it (1).
    a, b : Anchor
    length : float or SX
        Of "distance".
    """

    name: str
    kind: str
    a: Anchor
    b: Anchor
    length: Any = 0.0


@dataclass(frozen=True, eq=False)
class Spring:
    """Spring and damper between the origins of two frames: tension k (ℓ − rest) + d dℓ/dt."""

    name: str
    a: Anchor
    b: Anchor
    stiffness: Any
    rest: Any
    damping: Any


@dataclass(frozen=True, eq=False)
class Actuator:
    """A control and where it acts.

    Attributes
    ----------
    name : str
        Of the control.
    kind : str
        "joint": a generalised force ``gear u`` on the coordinate `index` of a joint; "thrust" and
        "torque": a force or torque ``gear u`` along the third axis of a frame.
    joint : str
        Of kind "joint".
    index : int
    anchor : Anchor or None
        Of the other kinds.
    gear : float or SX
    limits : (float, float)
        Least and largest control.
    u : SX
        The control's symbol.
    """

    name: str
    kind: str
    joint: str
    index: int
    anchor: Anchor | None
    gear: Any
    limits: tuple[float, float]
    u: ca.SX


@dataclass(eq=False)
class Machine:
    """All parts of a machine by name, as `Model` collects them.

    Attributes
    ----------
    gravity : array (3,) or SX
    creep : float or SX
        Speed below which dry friction turns over smoothly.
    params : Parameters
        The constants that expressions are written in.
    bodies, joints, loops, springs, actuators, markers : dict
    couplings : list of Coupling
    medium : Medium or None
    home : dict
        Joint → its coordinates in the pose that a file describes, where they are not zero.
    """

    gravity: Any
    creep: Any
    params: Parameters
    bodies: dict[str, Body] = field(default_factory=dict)
    joints: dict[str, Joint] = field(default_factory=dict)
    couplings: list[Coupling] = field(default_factory=list)
    loops: dict[str, Loop] = field(default_factory=dict)
    springs: dict[str, Spring] = field(default_factory=dict)
    actuators: dict[str, Actuator] = field(default_factory=dict)
    markers: dict[str, Anchor] = field(default_factory=dict)
    medium: Medium | None = None
    home: dict[str, np.ndarray] = field(default_factory=dict)

    @property
    def moving(self) -> list[Joint]:
        """The joints whose coordinates are those of the system: all but followers."""
        followers = {coupling.follower for coupling in self.couplings}
        return [joint for joint in self.joints.values() if joint.name not in followers]

    @property
    def q(self) -> ca.SX:
        """Coordinates, (n,)."""
        return ca.vertcat(ca.SX(0, 1), *(joint.q for joint in self.moving))

    @property
    def v(self) -> ca.SX:
        """Their rates, (n,)."""
        return ca.vertcat(ca.SX(0, 1), *(joint.v for joint in self.moving))
