"""Events of contacts and crossings, differentiated: when they come, and what a blow does.

An event at which e(x, t) = 0 comes later by δt = −(e_x δx + e_t δt₀ + …)/ė, and a blow takes the
state x to R(x, t): together the saltation matrix (Leine & Nijmeijer 2004, §7.2), of the discrete
motion here. Where ė = 0 the motion grazes, and has no derivative.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from varint.discrete.constraints import ActiveSet, every_row_function, multiplier_function
from varint.discrete.legendre import velocity_function
from varint.errors import InputError
from varint.numerics.arrays import call
from varint.results.records import Event
from varint.scene.memory import per_system
from varint.scene.system import System
from varint.sensitivities.grazing import grazing
from varint.sensitivities.parts import Slopes, with_size
from varint.sensitivities.second_order import second_derivatives
from varint.sensitivities.start import state_function

GRAZING = 1e-8  # of what velocities contribute to a rate: one as small is zero
AT_REST = 1e-9  # of the velocities: a row that moves no faster holds
SAME_BLOW = 1e-8  # relative: momenta this close are the same


def crossing_slopes(scene: System, expression: ca.SX) -> ca.Function:
    """(q, p, t, c, u) → derivatives of an expression of q, v, t, c with respect to (q, p), t, c
    and u.
    """
    return _slopes(*_crossing_symbols(scene, expression))


def _crossing_symbols(scene: System, expression: ca.SX) -> tuple[list[ca.MX], ca.MX]:
    value = state_function(scene, expression)
    q, p, t, c = inputs = [ca.MX.sym(f"a{i}", value.numel_in(i)) for i in range(4)]
    return [*inputs, ca.MX.sym("u", scene.control.numel())], value(q, p, t, c)


def _push_symbols(scene: System, row: int) -> tuple[list[ca.MX], ca.MX]:
    """The multiplier of a row that holds."""
    sizes = (scene.q.numel(), scene.q.numel(), 1, scene.c.numel(), scene.control.numel())
    q, p, t, c, u = inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes)]
    v = velocity_function(scene)(q, p, t, c)
    return inputs, multiplier_function(scene)(q, v, u, t, c)[0][row]


class _Zero(NamedTuple):
    """What becomes zero at an event: the gap of a contact in a scene, or the multiplier of a row
    that holds there.
    """

    scene: System
    place: int
    holds: bool


@per_system
def _zero_slopes(system: System, *at: Any) -> ca.Function:
    return _slopes(*_zero_symbols(system, _Zero(*at)))


@per_system
def _zero_hessian(system: System, *at: Any) -> ca.Function:
    return _hessian(*_zero_symbols(system, _Zero(*at)))


def _zero_symbols(system: System, zero: _Zero) -> tuple[list[ca.MX], ca.MX]:
    if zero.holds:
        return _push_symbols(zero.scene, zero.place)
    return _crossing_symbols(zero.scene, system.contact[zero.place])


def _slopes(inputs: list[ca.MX], value: ca.MX) -> ca.Function:
    q, p, t, c, u = inputs
    found = [ca.densify(ca.jacobian(value, x)) for x in (ca.vertcat(q, p), t, c, u)]
    return ca.Function("crossing", inputs, found)


def _hessian(inputs: list[ca.MX], value: ca.MX) -> ca.Function:
    """Its second derivatives with respect to all of them."""
    return ca.Function("curved", inputs, [second_derivatives(inputs, value)])


def event_slopes(system: System, active_set: ActiveSet, event: Event) -> ca.Function:
    """`crossing_slopes` of what becomes zero where a contact closes, or lets go."""
    return _zero_slopes(system, *_zero(system, active_set, event))


def event_hessian(system: System, active_set: ActiveSet, event: Event) -> ca.Function:
    """(q, p, t, c, u) → its second derivatives with respect to all of them."""
    return _zero_hessian(system, *_zero(system, active_set, event))


def _zero(system: System, active_set: ActiveSet, event: Event) -> _Zero:
    scene, contact = active_set.scene(system), event.contact
    assert contact is not None
    if event.kind != "detachment":
        return _Zero(scene, contact, False)
    return _Zero(scene, _row_of(system, active_set, event), True)


def _row_of(system: System, active_set: ActiveSet, event: Event) -> int:
    """The place of a contact that lets go among the rows that hold."""
    contact = event.contact
    if contact not in active_set.contacts or len(active_set.contacts) < len(active_set.holding):
        raise InputError(
            f"contact {contact} lets go at t = {event.time:g} of contacts that hold the motion "
            "together more than once: which of them pushes how much is not known"
        )
    return len(active_set.rows) + active_set.contacts.index(contact)


def to_event(
    slopes: Slopes,
    crossing: ca.Function,
    state: tuple[np.ndarray, np.ndarray, float],
    c: np.ndarray,
    u: tuple[np.ndarray, np.ndarray, np.ndarray],
    passed: float,
    fast: np.ndarray,
) -> Slopes:
    """A part that ends where a function of the state is zero: its duration varies by −ė⁻¹ δe.

    `u` are the controls there (k,), their slope by the share of the step in units of time, and what
    they depend on, (k, r·k); `passed` the steps from the start of the run to there, and `fast` (n,)
    the speeds in play.

    Raises
    ------
    ConvergenceError
        If the rate ė is zero up to round-off.
    """
    q, p, t = state
    n2, many = slopes.clock, len(c)
    now, rate_of_u, table = u
    of_x, of_t, of_c, of_u = call(crossing, q, p, np.array([t]), c, now)
    of_u = of_u.reshape(-1)
    along = np.append(of_x, of_t + of_u @ rate_of_u)
    part = slopes.of_size[0, : n2 + 1]
    rate = along @ part
    size = np.abs(along) @ np.maximum(np.abs(part), np.append(fast, np.zeros(len(p) + 1)))
    if not abs(rate) > GRAZING * size:
        raise grazing(int(passed), t)
    of_z = along @ slopes.of_z[0, : n2 + 1]
    of_z[n2 + 1 : n2 + 1 + many] += of_c
    of_grid = of_u @ rate_of_u  # the share of the step is counted from its own beginning
    of_z[n2 + 1 + many] -= of_grid * passed
    of_z[n2 + 2 + many] -= of_grid
    by_u = along @ slopes.of_u[0, : n2 + 1] + of_u @ table
    return with_size(slopes, -of_z[None] / rate, -by_u[None] / rate)


class Blow(NamedTuple):
    """An impact as a map of momenta.

    Attributes
    ----------
    scene : System
        What moves until then.
    kept : tuple of int
        Rows of constraints and contacts that hold meanwhile.
    hit : int
        The row that is hit.
    bounces : bool
    given : tuple of ndarray
        q, p, t, c, and what is added to the coefficient of restitution: 0.
    """

    scene: System
    kept: tuple[int, ...]
    hit: int
    bounces: bool
    given: tuple[np.ndarray, ...]


def blow_of(
    system: System, active_set: ActiveSet, event: Event, time: float, c: np.ndarray
) -> Blow:
    """The map of an impact that was recorded."""
    assert event.contact is not None
    q, p = np.array(event.q), np.array(event.p_before)
    v, late = np.array(event.v_before), np.array(event.v_after)
    t, n = np.array([time]), len(q)
    first = system.structure.constraints + system.structure.nonholonomic
    rows, slope = call(every_row_function(system), q, v, t, c)
    after = call(every_row_function(system), q, late, t, c)[0]
    fast = np.abs(slope.reshape(n, -1).T) @ np.maximum(np.abs(v), np.abs(late)) + 1e-300
    hit = first + event.contact
    rest = AT_REST * fast[first:]
    still = [i for i in active_set.contacts if abs(rows[first + i]) <= rest[i]]
    holding = [i for i in still if abs(after[first + i]) <= rest[i]]
    kept = (
        *active_set.rows,
        *range(system.structure.constraints, first),
        *(first + i for i in holding if i != event.contact),
    )
    bounces = bool(abs(after[hit]) > rest[event.contact])
    scene = replace(active_set, contacts=tuple(still)).scene(system)
    return Blow(scene, kept, hit, bounces, (q, p, t, c, np.zeros(1)))


def blow(
    system: System, active_set: ActiveSet, event: Event, time: float, c: np.ndarray
) -> np.ndarray:
    """What an impact makes of changes: the rows (q, p, t) of its derivative with respect to z.

    Raises
    ------
    InputError
        If the momenta behind it are not those of the event.
    """
    assert event.contact is not None
    b, wanted = blow_of(system, active_set, event, time, c), np.array(event.p_after)
    found, *slopes = call(_blow_slopes(system, *b[:4]), *b.given)
    change = np.abs(wanted - b.given[1]).max()
    if not np.abs(found - wanted).max() <= SAME_BLOW * change:
        raise InputError(
            f"the impact at t = {event.time:g} was dealt to several bodies in a way that cannot "
            "be followed: its derivative is not known"
        )
    n, many, contacts = len(wanted), len(c), system.contact.numel()
    of_q, of_p, of_t, of_c, of_e = (x.reshape(-1, n).T for x in slopes)
    matrix = np.zeros((2 * n + 1, 2 * n + 3 + many + contacts))
    matrix[:n, :n] = np.eye(n)
    matrix[2 * n, 2 * n] = 1.0
    matrix[n : 2 * n, : 2 * n + 1] = np.hstack([of_q, of_p, of_t])
    matrix[n : 2 * n, 2 * n + 1 : 2 * n + 1 + many] = of_c
    if b.bounces:
        matrix[n : 2 * n, 2 * n + 3 + many + event.contact] = of_e[:, 0]
    return matrix


@per_system
def _blow_slopes(
    system: System, scene: System, kept: tuple[int, ...], hit: int, bounces: bool
) -> ca.Function:
    """(q, p, t, c, e) → p behind the blow of one row while others are kept, and its derivatives."""
    inputs, after = _blow_symbols(system, scene, kept, hit, bounces)
    slopes = [ca.densify(ca.jacobian(after, x)) for x in inputs]
    return ca.Function("blow", inputs, [ca.densify(after), *slopes])


@per_system
def blow_hessian(
    system: System, scene: System, kept: tuple[int, ...], hit: int, bounces: bool
) -> ca.Function:
    """(q, p, t, c, e, μ) → ∂²(μ·p)/∂(q, p, t, c, e)² of p behind a blow."""
    inputs, after = _blow_symbols(system, scene, kept, hit, bounces)
    mu = ca.MX.sym("mu", after.numel())
    curved = second_derivatives(inputs, ca.dot(mu, after), mu)
    return ca.Function("blow_hessian", [*inputs, mu], [curved])


def _blow_symbols(
    system: System, scene: System, kept: tuple[int, ...], hit: int, bounces: bool
) -> tuple[list[ca.MX], ca.MX]:
    """q, p, t, c, e, and p behind the blow of one row while others are kept.

    [M −Wᵀ; W 0] [Δv; Λ] = [0; −(1 + e) ṙ], p⁺ = p + Wᵀ Λ.
    """
    s, n = system, system.structure.n
    rows, slope = every_row_function(s)(s.q, s.v, s.t, s.c)
    chosen = [*kept, hit]
    seen = ca.Function(
        "seen",
        [s.q, s.v, s.t, s.c],
        [ca.densify(s.mass_matrix), ca.densify(slope[chosen, :]), rows[hit]],
        {"cse": True},
    )
    sizes = (n, n, 1, s.c.numel(), 1)
    q, p, t, c, e = inputs = [ca.MX.sym(f"a{i}", size) for i, size in enumerate(sizes)]
    mass, along, rate = seen(q, velocity_function(scene)(q, p, t, c), t, c)
    m = len(chosen)
    matrix = ca.blockcat([[mass, -along.T], [along, ca.MX.zeros(m, m)]])
    if bounces:
        first = hit - system.structure.constraints - system.structure.nonholonomic
        e += ca.Function("own", [s.c], [s.bounce[first]])(c)
    right = ca.vertcat(ca.MX.zeros(n + m - 1), -(1 + e) * rate)
    impulse = ca.solve(matrix, right, "qr")[n:]
    return inputs, p + ca.mtimes(along.T, impulse)
