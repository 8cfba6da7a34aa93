"""Scenes whose symmetries are known: particles with pair potentials, central forces."""

from __future__ import annotations

import casadi as ca
import numpy as np

import varint as vi


def particles(count: int, axes: str, potential, masses=None) -> vi.System:
    """Particles with a pair potential V(r²)."""
    q, v = vi.coordinates(*(f"{a}{i + 1}" for i in range(count) for a in axes))
    masses = np.ones(count) if masses is None else masses
    r = ca.reshape(q, len(axes), count)
    kinetic = sum(
        m * ca.sumsqr(v[len(axes) * i : len(axes) * (i + 1)]) / 2 for i, m in enumerate(masses)
    )
    pairs = [(i, j) for i in range(count) for j in range(i)]
    return vi.System(q, v, kinetic - sum(potential(ca.sumsqr(r[:, i] - r[:, j])) for i, j in pairs))


def gravity(r2):
    return -1 / ca.sqrt(r2)


def spring(r2):
    return r2 / 2


def central(potential, axes="xy") -> vi.System:
    q, v = vi.coordinates(*axes)
    return vi.System(q, v, ca.sumsqr(v) / 2 - potential(ca.sumsqr(q)))
