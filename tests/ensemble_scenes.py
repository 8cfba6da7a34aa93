"""Scenes whose members differ in starts, parameters and controls."""

from __future__ import annotations

import casadi as ca

import varint as vi


def swinging() -> vi.System:
    c = vi.Parameters(length=1.0, g=9.81)
    q, v = vi.coordinates("theta")
    return vi.System(q, v, c.length**2 * v**2 / 2 + c.g * c.length * ca.cos(q), params=c)


def pushed() -> vi.System:
    q, v, push = *vi.coordinates("x", "theta"), ca.SX.sym("push")
    lagrangian = v[0] ** 2 + v[0] * v[1] * ca.cos(q[1]) + v[1] ** 2 / 2 + 9.81 * ca.cos(q[1])
    return vi.System(q, v, lagrangian, force=ca.vertcat(push, 0), control=push)


def falling() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - q + ca.sqrt(q))
