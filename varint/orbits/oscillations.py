"""The linear equations about an equilibrium, and their solutions across the symmetries."""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from varint.errors import InputError
from varint.numerics.arrays import call, is_definite
from varint.orbits.phase import (
    VANISHING,
    hamiltonian_fields,
    independent,
    integrals,
    state_of,
)
from varint.orbits.reduction import Reduced, reduce, signature
from varint.orbits.rest import Equilibrium, left_at, round_off_at
from varint.scene.memory import per_system
from varint.scene.system import System

ZERO = 1e-7  # of the fastest rate: those of neutral modes, which round-off makes of its root
FREE = 1e-9  # relative: singular values of independent constraints
TOGETHER = 1e-6  # of the fastest rate: exponents this close count as one
SINGULAR = 1e-13  # of the largest singular value: a direction without mass
UNSURE = 0.1  # of a stiffness: what it changes by within the error of the place, where it has none
FARTHER = 4.0  # steps of Newton's method to a place where several meet, one being too short
AWAY = 0.1  # of the coordinates, or of 1: how far elsewhere is


class Linearised(NamedTuple):
    """M ẍ + C ẋ + K x = 0 on the tangents Z of the constraints, δq = Z x; `momentum` = ∂p/∂q."""

    mass: np.ndarray
    rates: np.ndarray
    stiffness: np.ndarray
    tangents: np.ndarray
    inertia: np.ndarray
    momentum: np.ndarray


def linearised(at: Equilibrium) -> Linearised:
    """The linear equations about an equilibrium; stiffness that is none but for the error of the
    place left out.
    """
    mass, mixed, stiff, by_v, rows = _matrices(at, at.q)
    n = len(at.q)
    tangents = np.eye(n)
    if len(rows):
        size = np.linalg.norm(rows, axis=1, keepdims=True)
        _, values, right = np.linalg.svd(rows / np.where(size > 0, size, 1.0))
        tangents = right[int((values > FREE * values.max(initial=0.0)).sum()) :].T
    z = tangents
    sure = _sure(at, z.T @ stiff @ z, z.T @ mass @ z, z)
    return Linearised(z.T @ mass @ z, z.T @ (mixed - mixed.T - by_v) @ z, sure, z, mass, mixed)


def is_degenerate(at: Equilibrium) -> bool:
    """Whether some direction has no stiffness, so that equilibria may go on along it."""
    if at.system.structure.nonholonomic:
        return False
    linear = linearised(at)
    own = _own(linear.mass)
    scaled = linear.stiffness / np.outer(own, own)
    if not scaled.size or not np.isfinite(scaled).all():
        return False
    values = np.linalg.svd(scaled, compute_uv=False)
    return bool((values <= SINGULAR * values.max(initial=0.0)).any())


def loose_directions(at: Equilibrium) -> np.ndarray:
    """Directions of the coordinates without stiffness, (n, k)."""
    linear = linearised(at)
    own = _own(linear.mass)
    _, values, vectors = np.linalg.svd(linear.stiffness / np.outer(own, own))
    return linear.tangents @ (vectors[values <= SINGULAR * values.max()].T / own[:, None])


def _own(mass: np.ndarray) -> np.ndarray:
    """Roots of the masses, by which stiffness is measured."""
    own = np.sqrt(np.abs(np.diag(mass)))
    return np.where(own > 0, own, 1.0)


def _sure(at: Equilibrium, stiff: np.ndarray, mass: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The stiffness, zero along directions in which it changes within the error of the place: at a
    degenerate one, as of U = x³, Newton's method comes to where it is small, of either sign.
    """
    if not stiff.size or not np.isfinite(stiff).all():
        return stiff
    own = _own(mass)
    scaled = stiff / np.outer(own, own)
    left, values, right = np.linalg.svd(scaled)
    forces = z.T @ left_at(at, at.q) / own
    noise = np.abs(z.T) @ round_off_at(at) / own
    for u, value, along in zip(left.T, values, right, strict=True):
        if value <= SINGULAR * values[0]:
            continue
        off = max(abs(float(u @ forces)), float(np.abs(u) @ noise)) * FARTHER / value
        for q in (at.q + off * (z @ (along / own)), at.q - off * (z @ (along / own))):
            there = z.T @ _matrices(at, q)[2] @ z / np.outer(own, own)
            if not abs(u @ there @ along - value) <= UNSURE * value:
                stiff = stiff - value * np.outer(u * own, along * own)
                break
    return stiff


def _matrices(at: Equilibrium, q: np.ndarray) -> list[np.ndarray]:
    """M, ∂p/∂q, −∂²(L + λ·g)/∂q² − ∂F/∂q, ∂F/∂v and G at rest at some place."""
    flat = call(_second_derivatives(at.system), q, at.multipliers, at.c)
    return [x.reshape(len(q), -1).T for x in flat]


@per_system
def _second_derivatives(system: System) -> ca.Function:
    """(q, λ, c) → ∂²L/∂v², ∂²L/∂v∂q, −∂²(L + λ·g)/∂q² − ∂F/∂q, ∂F/∂v, G at rest, dense."""
    s = system
    still, lam = ca.SX.zeros(s.v.shape), ca.SX.sym("lam", s.structure.velocity_rows)
    gradient = s.generalised_force
    if s.structure.constraints:
        gradient = gradient + ca.jacobian(s.constraint, s.q).T @ lam
    parts = [
        s.mass_matrix,
        ca.jacobian(s.momentum, s.q),
        -ca.jacobian(gradient, s.q),
        ca.jacobian(s.force, s.v),
        ca.jacobian(s.constraint, s.q),
    ]
    outputs = [ca.densify(ca.substitute(x, s.v, still)) for x in parts]
    return ca.Function("second_derivatives", [s.q, lam, s.c], outputs, {"cse": True})


class Modes(NamedTuple):
    """Exponents and shapes of the modes, the signs of their energies, whether the energy is
    definite, and how many directions are neutral.
    """

    exponents: np.ndarray
    shapes: np.ndarray
    signatures: tuple[int | None, ...]
    definite: bool
    neutral: int


def is_regular(mass: np.ndarray) -> bool:
    """Whether a mass matrix has an inverse, whatever its coordinates are measured by."""
    own = np.sqrt(np.abs(np.diag(mass)))
    if not own.all():
        return False
    values = np.linalg.svd(mass / np.outer(own, own), compute_uv=False)
    return bool((values > SINGULAR * values.max(initial=0.0)).all())


def modes_at(at: Equilibrium) -> Modes:
    """Small oscillations about an equilibrium, across its symmetries."""
    linear = linearised(at)
    if not is_regular(linear.mass):
        there = ", ".join(f"{n}={x:.6g}" for n, x in zip(at.system.names, at.q, strict=True))
        raise InputError(
            f"the mass matrix is singular at {there}: the coordinates describe no motions about "
            "it, as angles at their pole; take others, such as Cartesian ones with a constraint"
        )
    m, z = len(linear.mass), linear.tangents
    damped = at.system.structure.forced
    inverse = np.linalg.inv(linear.mass)
    matrix = np.block(
        [
            [np.zeros((m, m)), np.eye(m)],
            [-inverse @ linear.stiffness, -inverse @ linear.rates],
        ]
    )
    # δq = Z x, δp = ∂p/∂q δq + M δv
    into = np.block([[z, np.zeros_like(z)], [linear.momentum @ z, linear.inertia @ z]])
    n = len(at.q)
    form = into[:n].T @ into[n:]
    form = form - form.T
    reduced = _reduced(at, matrix, form, into)
    energy = np.block([[linear.stiffness, np.zeros((m, m))], [np.zeros((m, m)), linear.mass]])
    inner = reduced.basis.T @ energy @ reduced.basis
    values, vectors = np.linalg.eig(reduced.matrix)
    vectors = reduced.basis @ vectors
    plain = not damped and not np.abs(linear.rates).max(initial=0.0) and is_definite(linear.mass)
    if plain and len(reduced.matrix) == 2 * m:
        values, vectors = _without_gyroscopic(linear)
    fastest = float(np.abs(values).max(initial=0.0))
    small = ZERO * fastest
    values = np.where(np.abs(values.real) <= small, 0.0, values.real) + 1j * np.where(
        np.abs(values.imag) <= small, 0.0, values.imag
    )
    neutral = int((values == 0).sum())
    kept = [i for i in range(len(values)) if _listed(values[i], damped)]
    kept.sort(key=lambda i: (-values[i].real, values[i].imag))
    signs: list[int | None] = []
    for i in kept:
        s = values[i]
        same = np.abs(values - s) <= TOGETHER * fastest
        basis = np.linalg.qr(vectors[:, same])[0]
        signs.append(signature(form, basis) if not damped and s.imag and not s.real else None)
    shapes = np.array([z @ vectors[:m, i] for i in kept]).reshape(len(kept), n).astype(complex)
    for row in shapes:
        row /= row[np.abs(row).argmax()]
    size = np.sqrt(np.abs(np.diag(inner))) if len(inner) else np.ones(0)
    size = np.where(size > 0, size, 1.0)
    spread = np.linalg.eigvalsh((inner + inner.T) / 2 / np.outer(size, size))
    sure = 1e-12 * float(np.abs(spread).max(initial=0.0))
    definite = bool(len(spread)) and bool((spread > sure).all() or (spread < -sure).all())
    return Modes(values[kept], shapes, tuple(signs), definite, neutral)


def _listed(s: complex, damped: bool) -> bool:
    """Whether it stands for its pair, or quadruplet."""
    if s == 0 or s.imag < 0:
        return False
    return damped or s.real > 0 or (s.real == 0 and s.imag > 0)


def _reduced(at: Equilibrium, matrix: np.ndarray, form: np.ndarray, into: np.ndarray) -> Reduced:
    """The linear motion across the symmetries."""
    n = len(at.q)
    if at.system.structure.forced:
        empty = np.zeros((0, len(matrix)))
        return reduce(matrix, form, empty, empty)
    known = integrals(at.system, at.c, at.q, None)
    x = state_of(at.system, at.q, np.zeros(n), 0.0, at.c)
    # elsewhere, for the size that gradients have: here those of rotations about it may vanish
    far = x + AWAY * max(float(np.abs(x).max()), 1.0) * np.linspace(1.0, 2.0, 2 * n)
    first = int(known.energy)  # the energy is stationary here
    rows, ordinary = (known.gradients(y, at.c)[first:] @ into for y in (x, far))
    size = np.linalg.norm(rows, axis=1)
    kept = size > VANISHING * np.maximum(np.linalg.norm(ordinary, axis=1), size)
    rows = independent(rows[kept])
    return reduce(matrix, form, rows, hamiltonian_fields(form, rows))


def _without_gyroscopic(linear: Linearised) -> tuple[np.ndarray, np.ndarray]:
    """Exponents and states of K u = ω² M u: real shapes, frequencies to round-off."""
    root = np.linalg.cholesky(linear.mass)
    half = np.linalg.solve(root, linear.stiffness)
    squares, turned = np.linalg.eigh(np.linalg.solve(root, half.T))
    shapes = np.linalg.solve(root.T, turned)
    rates = np.sqrt(-squares.astype(complex))
    values = np.concatenate([rates, -rates])
    states = np.hstack([np.vstack([shapes, shapes * rates]), np.vstack([shapes, -shapes * rates])])
    return values, states
