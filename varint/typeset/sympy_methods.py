"""What an object of SymPy's Lagrange's or Kane's method was made of, as a Lagrangian."""

from __future__ import annotations

from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from varint.errors import InputError
from varint.notation.extra import sympy_module, time_symbol


class Given(NamedTuple):
    """What a scene is made of in SymPy."""

    lagrangian: Any
    coordinates: list[Any]
    constraints: list[Any]
    forces: list[Any]


def given_of_method(method: Any) -> Given | None:
    """The parts of the scene; None of what is neither method."""
    sp = sympy_module("from_sympy()")
    from sympy.physics.mechanics import KanesMethod, LagrangesMethod

    if isinstance(method, LagrangesMethod):
        return _of_lagrange(sp, method)
    return _of_kane(sp, method) if isinstance(method, KanesMethod) else None


def _of_lagrange(sp: Any, method: Any) -> Given:
    path = list(method.q)
    holonomic = list(method._hol_coneqs)  # public are only their derivatives
    rolling = list(method.coneqs)[len(holonomic) :]
    forces = _generalised(sp, path, method.forcelist, method.inertial, {})
    return Given(method._L[0], path, [*holonomic, *rolling], forces)


def _of_kane(sp: Any, method: Any) -> Given:
    """T − V of the bodies, with the generalised speeds u as functions of q and q̇."""
    path, frame = list(method.q), method._inertial
    if not method.bodies:
        raise InputError("the object of KanesMethod has no bodies; give it bodies=[…]")
    if method._uaux:
        raise InputError(
            f"the object of KanesMethod has auxiliary speeds, {list(method._uaux)}; give one "
            "without, varint's multipliers are the reactions"
        )
    if not method._qdot_u_map or len(method.u) != len(path):
        raise InputError(
            f"the object of KanesMethod has {len(method.u)} generalised speeds for {len(path)} "
            "coordinates; there must be one for each, with kinematic equations"
        )
    mapping, rates = method._k_ku_implicit, sp.Matrix([x.diff(time_symbol()) for x in path])
    rest = method._k_kqdot_implicit * rates + method._f_k_implicit
    speeds = dict(zip(method.u, -mapping.LUsolve(rest), strict=True))
    for body in method.bodies:
        _require_integrable(sp, body, path, frame, speeds)
    energy = sum(
        body.kinetic_energy(frame) - sp.sympify(body.potential_energy) for body in method.bodies
    )
    holonomic = list(method._f_h)
    rolling = [
        e.xreplace(speeds) for e in (method._k_nh * method.u + method._f_nh if method._udep else [])
    ]
    held = sp.Matrix(holonomic).jacobian(path) if holonomic else sp.zeros(0, len(path))
    for e in rolling:
        rows = held.col_join(sp.Matrix([e]).jacobian(rates))
        if sp.simplify(rows).rank(simplify=True) == rows.rows:
            holonomic.append(e)  # no derivative of what is held already
            held = rows
    forces = _generalised(sp, path, method.loads, frame, speeds)
    return Given(sp.sympify(energy).xreplace(speeds), path, holonomic, forces)


def _require_integrable(sp: Any, body: Any, path: list[Any], frame: Any, speeds: Any) -> None:
    """Refuse velocities in which rolling is built in: T of those has no Euler–Lagrange equations.

    Of the position r(q), ∂_j ∂v/∂q̇_i = ∂_i ∂v/∂q̇_j; of the rotation, the same of ω but for
    (∂ω/∂q̇_j) × (∂ω/∂q̇_i). Looked at in numbers at two states.
    """
    centre = getattr(body, "masscenter", None) or body.point
    given = [(centre.vel(frame), 0)]
    if hasattr(body, "frame"):
        given.append((body.frame.ang_vel_in(frame), 1))
    clock, rng = time_symbol(), np.random.default_rng(1)
    for vector, turns in given:
        found = vector.xreplace(speeds)
        partial = [found.diff(x.diff(clock), frame) for x in path]
        for i, j in combinations(range(len(path)), 2):
            crossed = partial[i].diff(path[j], frame) - partial[j].diff(path[i], frame)
            left = (crossed - turns * partial[j].cross(partial[i])).to_matrix(frame)
            terms = [left, *(partial[k].to_matrix(frame) for k in (i, j))]
            for _ in range(2):
                values = {x: rng.uniform(0.5, 1) for x in path}
                known = [np.abs(np.array(_valued(e, values, rng), float)).max() for e in terms]
                if known[0] > 1e-9 * (1 + max(known[1:])) ** 2:
                    raise InputError(
                        f"the velocity of {body.name} is no derivative of a position in "
                        f"{path[i]} and {path[j]}: rolling is built into it, and its kinetic "
                        "energy gives other equations; write all coordinates and give what rolls "
                        "as velocity_constraints"
                    )


def _valued(matrix: Any, values: dict[Any, float], rng: np.random.Generator) -> list[float]:
    """Entries with numbers for everything that is open."""
    plain = matrix.xreplace(values)
    strangers = sorted(plain.free_symbols, key=str)
    for x in strangers:
        values[x] = rng.uniform(0.5, 1)
    return [float(e) for e in plain.xreplace(values)]


def _generalised(sp: Any, path: list[Any], loads: Any, frame: Any, speeds: Any) -> list[Any]:
    """Q_i = Σ F · ∂v/∂q̇_i; a torque acts on a frame, a force on a point."""
    from sympy.physics.vector import ReferenceFrame

    forces = [sp.Integer(0)] * len(path)
    for where, force in loads or []:
        turns = isinstance(where, ReferenceFrame)
        speed = where.ang_vel_in(frame) if turns else where.vel(frame)
        for i, x in enumerate(path):
            rate = x.diff(time_symbol())
            forces[i] += speed.xreplace(speeds).diff(rate, frame).dot(force).xreplace(speeds)
    return forces if any(force != 0 for force in forces) else []
