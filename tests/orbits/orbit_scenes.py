"""Scenes of the tests of orbits."""

import casadi as ca

import varint as vi


def duffing():
    q, v = vi.coordinates("x")
    return vi.System(q, v, (v**2 - q**2 - q**4 / 2) / 2)


def pendulum():
    q, v = vi.coordinates("theta")
    c = vi.Parameters(length=1.0, g=1.0)
    return vi.System(q, v, c.length**2 * v**2 / 2 + c.g * c.length * ca.cos(q), params=c)


def double_pendulum_held():
    """Two equal rods by constraints, in Cartesian coordinates."""
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    rods = ca.vertcat(ca.sumsqr(q[:2]) - 1, ca.sumsqr(q[2:] - q[:2]) - 1)
    return vi.System(q, v, ca.sumsqr(v) / 2 - 9.81 * (q[1] + q[3]), constraint=rods)


def springs(*squares, signs=None):
    """Oscillators of these squared frequencies, of positive or negative energy."""
    pairs = list(zip(squares, signs or [1] * len(squares), strict=True))
    q, v = vi.coordinates(*(f"x{i}" for i in range(len(squares))))
    terms = [s * (v[i] ** 2 - w * q[i] ** 2) / 2 for i, (w, s) in enumerate(pairs)]
    return vi.System(q, v, sum(terms))
