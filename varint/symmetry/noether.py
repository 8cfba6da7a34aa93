"""Noether's theorem for the user's own Lagrangian: its symmetries, what they conserve, and what
keeps them.
"""

from __future__ import annotations

from types import NoneType
from typing import Any

import casadi as ca
import numpy as np

from varint.errors import InputError, parsed_or_refused
from varint.rules.rule import Rule
from varint.scene.inputs import finite_array
from varint.scene.parameters import ParameterValues
from varint.scene.system import System, parameter_values
from varint.symmetry.basis import generators
from varint.symmetry.confirm import Draft, confirm, draft, moves
from varint.symmetry.gauge import quadratic_gauge
from varint.symmetry.jumps import jumps
from varint.symmetry.naming import groups_of, name_of, reach
from varint.symmetry.sampling import Region
from varint.symmetry.search import null_space
from varint.symmetry.symmetry import Symmetry
from varint.symmetry.table import Symmetries
from varint.symmetry.verify import IDENTICAL, TOLERANCE, Proof, broken_by, proof

__all__ = ["Symmetries", "Symmetry", "noether", "symmetries"]

MOST_COORDINATES = 40  # with a matrix A of unknowns each; above, one matrix for all particles
SEED = 1918  # of the random points; the year of Noether's theorem


def symmetries(
    system: System,
    rule: Rule | None = None,
    *,
    params: ParameterValues | None = None,
    near: Any = None,
) -> Symmetries:
    """All affine point symmetries ξ = A q + b + c t of L, δL = dK/dt with K at most quadratic in q,
    and time shifts.

    Each conserves ``J = p·ξ + τ H − K``, unless forces, constraints or contacts break it.

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Say in the table what this rule keeps; default: what rules keep in general.
    params : dict, optional
        Search at these parameter values (``{}``: at the defaults), where a symmetry may hold that
        is lost for others. Default: symmetries for all parameter values.
    near : array (n,), optional
        Coordinates around which the Lagrangian is defined, for scenes that are not defined near the
        origin.

    Returns
    -------
    Symmetries
        A sequence of `Symmetry` that prints as a table.

    Raises
    ------
    InputError
        If the Lagrangian is not finite at random points (give `near`), or its terms differ too much
        in size.

    Notes
    -----
    What follows from the others is not listed: with total momentum P and boost P t − M X the
    angular momentum X × P of the centre of mass is conserved on its own.

    Affine point symmetries only: neither the Runge–Lenz vector (no point symmetry) nor symmetries
    with generators such as cos(ωt) are found; `noether` checks any generator ξ(q, t). With more
    than 40 coordinates A is looked for only within single particles, told by coordinate names such
    as x1, y1, x2, y2, and within small groups that nothing couples to others; with very many only
    among the matrices that act alike on all particles. The table says so.

    Symmetries of L that forces, constraints or contacts break are listed too: what they add to J is
    known, see `Trajectory.momentum_map`. Combinations of them that the whole scene keeps come in
    their place.

    References
    ----------
    Olver, Applications of Lie Groups to Differential Equations, §4.4, 5.3.

    Examples
    --------
    >>> import varint as vi
    >>> q, v = vi.coordinates("x", "y")
    >>> B = vi.Parameters(B=1.0)
    >>> charge = vi.System(q, v, (v.T @ v + B.B * (q[0] * v[1] - q[1] * v[0])) / 2, params=B)
    >>> [s.name for s in vi.symmetries(charge)][1:]
    ['magnetic translation along x', 'magnetic translation along y', 'rotation about z']
    """
    _require_rule(rule)
    region = _region(system, params, near)
    rng = np.random.default_rng(SEED)
    groups = groups_of(system, MOST_COORDINATES)
    basis = generators(region, groups, rng)
    drafts = [draft(region, groups, vector, rng) for vector in basis.vectors]
    places = jumps(region, rng)
    kept, lost = confirm(region, drafts, places.at, rng)
    found = sorted((_symmetry(region, *x, rng=rng) for x in kept), key=_order)
    notes = [reach(system, groups)] if reach(system, groups) else []
    if found and places.unseen:
        notes.append(
            "the Lagrangian has conditions that change where no point was found: rows hold beyond "
            "these only if it does not jump there"
        )
    if lost:
        notes.append(
            f"{lost} more hold nearly, or where the Lagrangian was sampled, but not identically"
        )
    for symmetry in found:
        if symmetry.tested != IDENTICAL.tested:
            notes.append(f"{symmetry.name}: held {symmetry.tested}, not shown to hold elsewhere")
    if basis.dependent:
        notes.append(
            f"{basis.dependent} more conserve functions of these quantities: rotations of the "
            "centre of mass alone"
        )
    if basis.unrecognised:
        notes.append(
            f"{basis.unrecognised} more with coefficients that are not simple"
            + (": give params={}" if region.c is None and system.c.numel() else "")
        )
    if basis.unclear:
        notes.append(
            f"the scene keeps {basis.unclear} combinations that depend on the parameters: give "
            f"params={{}}"
        )
    if basis.left_out:
        notes.append(
            f"{basis.left_out} more of L alone: linear ones that the rest of the scene breaks"
        )
    if region.c is None and system.c.numel():
        there = Region(system, system.default_vector, region.near)
        here = null_space(there, groups, rng).basis.shape[1]
        if here > basis.dimension:
            notes.append(
                f"{here - basis.dimension} more at the default parameters: give params={{}}"
            )
    return Symmetries(tuple(found), rule, "\n".join(notes))


def noether(
    system: System,
    xi: Any,
    gauge: Any = 0,
    *,
    tau: float = 0,
    name: str | None = None,
    params: ParameterValues | None = None,
    near: Any = None,
) -> Symmetry:
    """A user's own generator ξ(q, t), verified: δL = ∂L/∂q·ξ + ∂L/∂v·ξ̇ = dK/dt; conserved is ``J =
    p·ξ − K``.

    Parameters
    ----------
    system : System
    xi : SX (n,)
        Generator, any function of q, t and the parameters, also nonlinear.
    gauge : SX
        K(q, t), where L changes by a total derivative.
    tau : float
        Rate of a shift of time that goes with it, q → q + s (ξ + τ v); then δL − d(τL)/dt = dK/dt
        and ``J = p·ξ + τ H − K``.
    name : str, optional
    params : dict, optional
        Parameter values at which to verify; default: all.
    near : array (n,), optional
        Coordinates around which the Lagrangian is defined.

    Returns
    -------
    Symmetry

    Raises
    ------
    InputError
        If it is no symmetry of L: with the residual, and the gauge term that would make it one if
        there is one.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("r", "phi")
    >>> kepler = vi.System(q, v, (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2 + 1 / q[0])
    >>> vi.noether(kepler, [0, 1])
    Symmetry(cyclic coordinate phi: ∂phi)
    """
    region = _region(system, params, near)
    field = _field("the generator xi", xi, system, system.structure.n)
    gauge = _field("the gauge term", gauge, system, 1)
    if not isinstance(tau, (int, float)) or not np.isfinite(tau):
        raise InputError(f"tau must be a number, got {tau!r}")
    if not isinstance(name, (str, NoneType)):
        raise InputError(f"name must be a word for the symmetry, got {name!r}")
    if field.is_zero() and not tau:
        raise InputError(
            "the generator is zero: xi = 0 and tau = 0 change nothing and conserve nothing"
        )
    shift = ca.SX(float(tau))
    rng = np.random.default_rng(SEED)
    shown = proof(region, field, shift, gauge, rng)
    if not shown.holds:
        raise InputError(_refusal(region, Draft(field, shift, gauge), shown, rng))
    for jump in jumps(region, rng).at:
        if any(x.any() for x in moves(region, [Draft(field, shift, gauge)], (jump,))):
            raise InputError(
                f"no symmetry of the Lagrangian: L jumps where {jump} passes zero or a whole "
                "number, and the generator leads across; smooth the step, or take one along it"
            )
    return _symmetry(region, Draft(field, shift, gauge), shown.tested, name, rng=rng)


def _refusal(region: Region, draft: Draft, shown: Proof, rng) -> str:
    if shown.left > TOLERANCE:
        text = f"δL − dK/dt is {shown.left:.1e} of the size of its terms at {shown.where}"
    else:
        text = f"δL − dK/dt does not vanish identically, though {shown.tested}"
    text = f"no symmetry of the Lagrangian: {text}"
    other = quadratic_gauge(region, draft.xi, draft.tau, rng)
    if proof(region, draft.xi, draft.tau, other, rng).holds:
        return f"{text}; with gauge={other} it is one"
    return (
        f"{text} (a symmetry leaves less than {TOLERANCE:g}); check signs, or give the gauge term "
        "K with δL = dK/dt"
    )


def _symmetry(
    region: Region, draft: Draft, tested: str, name: str | None = None, *, rng
) -> Symmetry:
    s, (xi, tau, gauge) = region.system, draft
    broken = broken_by(region, xi, tau, rng)
    name = name or name_of(s, xi, tau, gauge)
    return Symmetry(s, name, xi, tau, gauge, broken, region.c if s.c.numel() else None, tested)


def _order(symmetry: Symmetry) -> int:
    """Time, translations, rotations, boosts, others."""
    words = ("time translation", "translation", "cyclic", "rotation", "boost")
    return next((i for i, word in enumerate(words) if word in symmetry.name), len(words))


def _region(system: System, params: ParameterValues | None, near: Any) -> Region:
    if not isinstance(system, System):
        raise InputError(f"symmetries are those of a varint System, got {type(system).__name__}")
    if near is not None:
        near = finite_array("near", near).reshape(-1)
        if near.shape != (system.structure.n,) or not np.isfinite(near).all():
            raise InputError(
                f"near must be {system.structure.n} finite numbers, one for each of "
                f"{list(system.names)}"
            )
    return Region(system, None if params is None else parameter_values(system, params), near)


def _require_rule(rule: Any) -> None:
    if rule is not None and not isinstance(rule, Rule):
        raise InputError(f"rule must be a varint Rule such as gauss(2), got {rule!r}")


def _field(what: str, value: Any, system: System, size: int) -> ca.SX:
    """An expression of q, t and the parameters with `size` components."""
    value = parsed_or_refused(
        lambda: ca.densify(
            ca.SX(ca.vertcat(*value) if isinstance(value, (list, tuple)) else value)
        ),
        lambda: f"{what} must be an expression of q, t and the parameters, got {value!r}",
    )
    if value.shape != (size, 1):
        raise InputError(f"{what} has shape {value.shape}; it must have ({size}, 1)")
    known = {x.element_hash() for x in ca.symvar(ca.vertcat(system.q, system.t, system.c))}
    strange = sorted(x.name() for x in ca.symvar(value) if x.element_hash() not in known)
    if strange:
        raise InputError(
            f"{what} depends on {strange}; a point symmetry is a function of {list(system.names)}, "
            "t and the parameters (generators with velocities, as that of the Runge–Lenz vector, "
            "are no point symmetries)"
        )
    return value
