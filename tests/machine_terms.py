"""What other programs say of a machine too: mass matrix and forces in joint velocities."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

import varint.multibody as mb
from varint.multibody.joints import QUATERNION_AT


class Terms(NamedTuple):
    """``M v̇ + bias = force`` of a machine in joint velocities ν, q̇ = N(q) ν."""

    mass_matrix: np.ndarray
    bias: np.ndarray  # without springs, forces and controls
    spring: np.ndarray
    force: np.ndarray
    constraint: np.ndarray


def terms_of(model: mb.Model) -> Callable[[np.ndarray, np.ndarray, np.ndarray], Terms]:
    """(q, ν, u) → `Terms`; ν of a quaternion is the angular velocity along the body's axes."""
    s = model.system()
    springs = sum(
        (
            ca.sumsqr(joint.q - joint.passive.rest) * joint.passive.stiffness / 2
            for joint in model.machine.moving
        ),
        ca.SX(0),
    )
    momentum = ca.gradient(s.lagrangian, s.v)
    bias = ca.jtimes(momentum, s.q, s.v) - ca.gradient(s.lagrangian + springs, s.q)
    found = ca.Function(
        "terms",
        [s.q, s.v, s.control],
        [ca.jacobian(momentum, s.v), bias, -ca.gradient(springs, s.q), s.force, s.constraint],
        {"cse": True},
    )

    def terms(q: np.ndarray, nu: np.ndarray, u: np.ndarray) -> Terms:
        n = kinematic_matrix(model, q)
        v = n @ nu
        rate = kinematic_matrix(model, v) - kinematic_matrix(model, 0 * q)  # N is affine in q
        mass, bias, spring, force, constraint = (x.full() for x in found(q, v, u))
        bias = bias[:, 0] + mass @ (rate @ nu)
        return Terms(
            n.T @ mass @ n, n.T @ bias, n.T @ spring[:, 0], n.T @ force[:, 0], constraint[:, 0]
        )

    return terms


def kinematic_matrix(model: mb.Model, q: np.ndarray) -> np.ndarray:
    """N with q̇ = N ν: the identity, and ½ q ∘ (0, ω) for unit quaternions."""
    blocks, first = [], 0
    for joint in model.machine.moving:
        size = len(joint.coordinates)
        plain = QUATERNION_AT.get(joint.kind, size)
        blocks += [np.eye(plain)]
        if plain < size:
            w, x, y, z = q[first + plain : first + size]
            blocks += [np.array([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]]) / 2]
        first += size
    rows, columns = sum(len(x) for x in blocks), sum(x.shape[1] for x in blocks)
    n, row, column = np.zeros((rows, columns)), 0, 0
    for block in blocks:
        n[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return n


def places_of(model: mb.Model, names: list[str]) -> Callable[[np.ndarray], np.ndarray]:
    """q → (len(names), 12): positions, and rotations row by row, of bodies and markers."""
    frames = [model.frame(name) for name in names]
    rows = [ca.vertcat(x.position, ca.vec(x.rotation.T)).T for x in frames]
    found = ca.Function("places", [model.q], [ca.vertcat(*rows)], {"cse": True})
    return lambda q: found(q).full()


def off(found: np.ndarray, expected: np.ndarray) -> float:
    """Largest difference, relative to the largest entry (of all zeros: absolute)."""
    found, expected = np.asarray(found), np.asarray(expected)
    size = np.abs(expected).max(initial=0.0)
    return float(np.abs(found - expected).max(initial=0.0) / (size or 1.0))
