"""Typical sizes of velocities and momenta, by which the equations of a step are made
dimensionless.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from varint.discrete.lagrangian import point_function
from varint.discrete.legendre import velocity_function
from varint.discrete.term_sizes import term_sizes
from varint.numerics.arrays import call
from varint.scene.memory import per_scene
from varint.scene.system import System

SMALLEST = 1e-6  # of the typical size: a coordinate at rest is measured against the moving ones
# The same in a step that is differentiated: rows of sizes that differ more cost digits of the
# linear solve, 1e-16 times their ratio. Newton's method is quadratic: its last correction leaves
# round-off whatever the sizes.
BALANCED = 1e-2
# of what rests with nothing to push it: below all units, so that Newton's method iterates on
UNKNOWN = 1e-100
# of the terms that a momentum is made of in a step: Newton's method stops at 1e-12 of them, 1e-13
# may remain, and double precision adds them up to about 1e-15
ROUNDED = 1e-3
# operations of a scene's forces and momenta that take less time as they are than to be called
SHORT = 200


@per_scene
def scale_function(system: System, smallest: float = SMALLEST) -> ca.Function:
    """(q, p, u, t, h, c) → typical sizes of velocities and momenta, (2n,), from one look at the
    start of a step.

    A coordinate at rest is measured against the moving ones by its energy: v² M and p²/M compare
    metres with radians, where v with v and p with p would not. Controls count by their typical
    size, since a motion from rest may have no other. The sizes only decide when Newton's method
    stops, so their derivatives are defined to be zero. None is less than `smallest` of the largest.
    """
    start = _start(system)
    q, p, _, t, h, c = start
    velocity = velocity_function(system)

    def later(pushed: ca.MX) -> ca.MX:
        return velocity(q, pushed, t + h, c)

    sizes = _sizes(system, smallest, start, velocity(q, p, t, c), later)
    options = {"is_diff_out": [False], "never_inline": True}
    return ca.Function("scale", start, [sizes], options)


@per_scene
def opening_function(system: System) -> ca.Function:
    """(q, p, u, t, h, c) → the sizes of `scale_function` and the velocity, (3n,): the same numbers,
    of which nothing is differentiated, so that the operations of small scenes are one list, or two
    between velocities that have no formula.
    """
    start, point = _start(system), point_function(system)
    q, p, _, t, h, c = start
    velocity = velocity_function(system)
    now = velocity(q, p, t, c)

    def later(pushed: ca.MX) -> ca.MX:
        return velocity(q, pushed, t + h, c)

    if not point.is_a("SXFunction") or point.n_instructions() > SHORT:
        sizes = scale_function(system)(*start)
    elif velocity.is_a("SXFunction"):
        sizes = _sizes(system, SMALLEST, start, now, later)
        return _in_operations(ca.Function("opening", start, [ca.vertcat(sizes, now)]))
    else:
        sizes = _sizes_of_lists(system, start, now, later)
    return ca.Function("opening", start, [ca.vertcat(sizes, now)])


def _sizes_of_lists(
    system: System, start: list[ca.MX], now: ca.MX, later: Callable[[ca.MX], ca.MX]
) -> ca.MX:
    """`_sizes` by two lists of operations: of the momentum that a push leads to, and the rest."""
    v, moved = (ca.MX.sym(name, system.structure.n) for name in ("v", "moved"))
    pushes = list[ca.MX]()

    def at_push(pushed: ca.MX) -> ca.MX:
        pushes.append(pushed)
        return moved

    given = [*start, v]
    rest = ca.Function("sizes", [*given, moved], [_sizes(system, SMALLEST, start, v, at_push)])
    push = _in_operations(ca.Function("push", given, pushes))
    then = later(push(*start, now)) if pushes else now
    return _in_operations(rest)(*start, now, then)


def _in_operations(function: ca.Function) -> ca.Function:
    """A function with the operations of all that it calls in place of the calls, none of which is
    simplified; itself where one of them is a solve.
    """
    before = ca.GlobalOptions.getSimplificationOnTheFly()
    ca.GlobalOptions.setSimplificationOnTheFly(False)
    try:
        return function.expand()
    except RuntimeError:
        return function
    finally:
        ca.GlobalOptions.setSimplificationOnTheFly(before)


def _start(system: System) -> list[ca.MX]:
    """q, p, u, t, h, c."""
    n = system.structure.n
    sizes = n, n, system.structure.controls, 1, 1, system.c.numel()
    return [ca.MX.sym(name, size) for name, size in zip("qputhc", sizes, strict=True)]


def _sizes(
    system: System,
    smallest: float,
    start: list[ca.MX],
    v: ca.MX,
    later: Callable[[ca.MX], ca.MX],
) -> ca.MX:
    """The sizes at a start with the velocity v; `later` is that of another momentum, a step
    later.
    """
    q, p, u, t, h, c = start
    point = point_function(system)
    gain = [ca.plus(*point(q, v, u, at, c)[2:]) for at in (t, t + h)]  # a push may begin with zero
    generalised_force = ca.fmax(*(ca.fabs(h * x) for x in gain))
    gyroscopic = ca.fabs(ca.jacobian(system.momentum, system.q))
    parts = [ca.fabs(system.mass_matrix), ca.densify(gyroscopic + gyroscopic.T)]
    mass, gyroscopic = ca.Function("parts", [system.q, system.v, system.t, system.c], parts)(
        q, v, t, c
    )
    inertia = _inertia_at(system, q, p, v, t, c)
    if system.structure.degenerate:  # pushes are velocities
        velocity = velocity_function(system)
        direction = [q, t], [v, ca.MX(1)]
        change = [ca.jtimes(velocity(q, p, t, c), x, y) for x, y in zip(*direction, strict=True)]
        v_size = ca.fabs(v) + ca.fabs(h * ca.plus(*change))
    elif system.structure.quadratic_kinetic:
        # what the push does where nothing holds against it counts too: constraints may let it do
        # nothing
        gained = ca.fabs(later(p + h * gain[0]) - v) + generalised_force / inertia
        v_size = ca.fabs(v) + gained / _turns(system)(q, v, u, t, h, c, gain[0] / inertia, inertia)
    else:  # p + h·gain may belong to no velocity at all (soap films, light rays): stay where p is
        along = _along_function(system)(q, v, t, c)
        v_size = ca.fabs(v) + ca.fmax(*(ca.fabs(h * (x - along)) for x in gain)) / inertia
    p_size = ca.fabs(p) + generalised_force + ca.mtimes(mass, v_size)
    # the momentum of a massless coordinate may be zero, the terms that add up to it are not
    p_size += ca.if_else(ca.diag(mass) > 0, 0, ca.mtimes(gyroscopic, ca.fabs(h) * v_size))
    least = smallest * ca.norm_inf(v_size * ca.sqrt(inertia))
    sizes = [ca.fmax(v_size, least / ca.sqrt(inertia)), ca.fmax(p_size, least * ca.sqrt(inertia))]
    return ca.vertcat(*(ca.fmax(x, UNKNOWN) for x in sizes))


@per_scene
def _turns(system: System) -> ca.Function:
    """(q, v, u, t, h, c, a, M) → by how much less than h a a step changes the velocity where it
    lasts for longer than the force goes on to push: max(1, hω), ω² = |M⁻¹ ∂F/∂q a| / |a|.
    """
    s, n = system, system.structure.n
    h, a, mass = ca.SX.sym("h"), ca.SX.sym("a", n), ca.SX.sym("mass", n)
    inputs = [s.q, s.v, s.control, s.t, s.c]
    _, _, gradient, force = point_function(s)(*inputs)
    turned = ca.densify(ca.jtimes(gradient + force, s.q, a))
    size = ca.sum1(mass * a**2)
    square = ca.if_else(size > 0, ca.sqrt(ca.sum1(turned**2 / mass) / size), 0)
    turns = ca.fmax(1, ca.fabs(h) * ca.sqrt(square))
    bounded = ca.if_else(turns < np.inf, turns, 1)  # what is not a number is found elsewhere
    return ca.Function("turns", [*inputs[:4], h, s.c, a, mass], [bounded], {"cse": True})


@per_scene
def _along_function(system: System) -> ca.Function:
    """(q, v, t, c) → change of ∂L/∂v in time at fixed v."""
    s = system
    change = ca.jtimes(s.momentum, s.q, s.v) + ca.jacobian(s.momentum, s.t)
    return ca.Function("along", [s.q, s.v, s.t, s.c], [ca.densify(change)], {"cse": True})


@per_scene
def _parts_functions(system: System) -> tuple[ca.Function, ca.Function]:
    """(q, v, u, t, c) → ∂L/∂v; ∂L/∂q + F."""
    inputs = [system.q, system.v, system.control, system.t, system.c]
    _, momentum, gradient, force = point_function(system)(*inputs)
    return tuple(
        ca.Function("parts", inputs, [ca.densify(x)], {"cse": True})
        for x in (momentum, gradient + force)
    )


@np.errstate(all="ignore")
def rounding_sizes(
    system: System,
    q: np.ndarray,
    p: np.ndarray,
    u: np.ndarray,
    t: np.ndarray,
    h: np.ndarray,
    c: np.ndarray,
) -> np.ndarray:
    """Velocities and momenta (2n,) below which round-off of the terms of a step hides all motion.

    A scene that settles has momenta that tend to zero, while the forces that hold it do not: their
    sum vanishes, its round-off does not.
    """
    v = call(velocity_function(system), q, p, t, c)[0]
    momentum, generalised_force = _parts_functions(system)
    terms = np.max([term_sizes(generalised_force, q, v, u, at, c) for at in (t, t + h)], axis=0)
    least = ROUNDED * (term_sizes(momentum, q, v, u, t, c) + np.abs(h) * terms)
    sizes = np.concatenate([least / call(inertia_function(system), q, p, t, c)[0], least])
    return np.where(np.isfinite(sizes), sizes, 0.0)


@per_scene
def inertia_function(system: System) -> ca.Function:
    """(q, p, t, c) → what compares p with v in each coordinate, (n,): the mass, and |p|/|v|
    where there is none.
    """
    s = system
    q, p, t, c = (
        ca.MX.sym(name, x.numel()) for name, x in zip("qptc", (s.q, s.q, s.t, s.c), strict=True)
    )
    found = _inertia_at(s, q, p, velocity_function(s)(q, p, t, c), t, c)
    return ca.Function("inertia", [q, p, t, c], [found])


def _inertia_at(system: System, q: ca.MX, p: ca.MX, v: ca.MX, t: ca.MX, c: ca.MX) -> ca.MX:
    s = system
    own = ca.Function(
        "masses", [s.q, s.v, s.t, s.c], [ca.densify(ca.fabs(ca.diag(s.mass_matrix)))]
    )(q, v, t, c)
    largest, p_size, v_size = ca.mmax(own), ca.norm_inf(p), ca.norm_inf(v)
    ratio = ca.if_else(p_size * v_size > 0, p_size / v_size, 1)
    return ca.if_else(own > 0, own, ca.if_else(largest > 0, largest, ratio))
