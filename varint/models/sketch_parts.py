"""Geometry that sketches of models share."""

from __future__ import annotations

import casadi as ca

from varint.scene.parameters import Parameters
from varint.scene.system import System


def parameters_of(s: System) -> Parameters:
    assert s.params is not None  # every model has its quantities as parameters
    return s.params


def arm(angle: ca.SX, length: ca.SX | float = 1.0) -> ca.SX:
    """From the pin of a pendulum to its bob, the angle from the downward vertical."""
    return length * ca.vertcat(ca.sin(angle), -ca.cos(angle))


def polar(r: ca.SX, angle: ca.SX) -> ca.SX:
    return r * ca.vertcat(ca.cos(angle), ca.sin(angle))


def axis(theta: ca.SX, phi: ca.SX) -> ca.SX:
    return ca.vertcat(ca.sin(theta) * ca.cos(phi), ca.sin(theta) * ca.sin(phi), ca.cos(theta))
