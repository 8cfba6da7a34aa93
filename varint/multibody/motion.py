"""The joints' coordinates as expressions: their own symbols, or what they follow."""

from __future__ import annotations

import casadi as ca

from varint.errors import InputError
from varint.multibody.data import Coupling, Machine
from varint.multibody.kinematics import Motions


def motions_of(machine: Machine) -> Motions:
    """(q, v) of every joint; a follower's are functions of its leader's: v = dq/dq_leader v_leader.

    Raises
    ------
    InputError
        If couplings follow each other in a circle.
    """
    found = {joint.name: (joint.q, joint.v) for joint in machine.moving}
    waiting = list(machine.couplings)
    while waiting:
        ready = [coupling for coupling in waiting if coupling.leader in found]
        if not ready:
            names = [coupling.follower for coupling in waiting]
            raise InputError(f"joints {names} follow each other; one of them must lead")
        for coupling in ready:
            found[coupling.follower] = _followed(coupling, *found[coupling.leader])
        waiting = [coupling for coupling in waiting if coupling.follower not in found]
    return found


def _followed(coupling: Coupling, q: ca.SX, v: ca.SX) -> tuple[ca.SX, ca.SX]:
    value, slope = ca.SX(0), ca.SX(0)
    for coefficient in reversed(coupling.coefficients):
        slope = slope * q + value
        value = value * q + coefficient
    return value, slope * v
