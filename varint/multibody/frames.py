"""Frames of bodies and markers as expressions of the coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from varint.multibody.data import Anchor, Machine, Placement
from varint.multibody.kinematics import STILL, Motions, Twist, places, twists
from varint.multibody.motion import motions_of
from varint.multibody.quantities import compose
from varint.multibody.tree import GROUND, Tree, tree_of


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame of a machine, as expressions of its coordinates and their rates.

    Attributes
    ----------
    position : SX (3,)
        Of its origin, in space.
    rotation : SX (3, 3)
        From its axes to those of space.
    velocity : SX (3,)
        Of its origin, along the axes of space.
    angular_velocity : SX (3,)
        Along the axes of space.
    q, v : SX (n,)
        The model's coordinates and their rates.
    """

    position: ca.SX
    rotation: ca.SX
    velocity: ca.SX
    angular_velocity: ca.SX
    q: ca.SX
    v: ca.SX

    @cached_property
    def jacobian(self) -> ca.SX:
        """J (6, n) with (velocity, angular velocity) = J v."""
        return ca.jacobian(ca.vertcat(self.velocity, self.angular_velocity), self.v)


def frame_of(machine: Machine, anchor: Anchor) -> Frame:
    """The frame fixed to a body; only the links that lead to it are looked at."""
    tree, motions = tree_of(machine.bodies, machine.joints.values()), motions_of(machine)
    place, twist = fixed_frames(tree, motions, [anchor])[0]
    return Frame(
        ca.densify(ca.SX(place.position)),
        ca.densify(ca.SX(place.rotation)),
        ca.densify(ca.mtimes(place.rotation, twist.v)),
        ca.densify(ca.mtimes(place.rotation, twist.omega)),
        machine.q,
        machine.v,
    )


def fixed_frames(
    tree: Tree, motions: Motions, anchors: list[Anchor]
) -> list[tuple[Placement, Twist]]:
    """Place in space, and twist along their own axes, of frames fixed to bodies."""
    spots, speeds = places(tree.links, motions), twists(tree.links, motions)
    found = []
    for anchor in anchors:
        link, place = tree.bodies[anchor.body]
        place = compose(place, anchor.placement)
        if link == GROUND:
            found.append((place, STILL))
            continue
        omega, v = speeds[link]
        back = ca.SX(place.rotation).T
        own = Twist(
            ca.mtimes(back, omega), ca.mtimes(back, v + ca.cross(omega, ca.SX(place.position)))
        )
        found.append((compose(spots[link], place), own))
    return found
