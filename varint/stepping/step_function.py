"""One step as a differentiable CasADi function for users' own graphs."""

from __future__ import annotations

import casadi as ca

from varint.discrete import Interval, interval, point_function
from varint.legendre import velocity_function
from varint.rules import Rule
from varint.stepping.plan import plan
from varint.system import System, per_system

SMALLEST = 1e-6  # of the typical size: a coordinate at rest is measured against the moving ones
# The same in a step that is differentiated: rows of sizes that differ more cost digits of the linear solve, 1e-16 times
# their ratio. Newton's method is quadratic: its last correction leaves round-off whatever the sizes.
BALANCED = 1e-2
UNKNOWN = 1e-100  # of what rests with nothing to push it: below all units, so that Newton's method iterates on


def step_function(system: System, rule: Rule | None = None) -> ca.Function:
    """One step (q0, p0) → (q1, p1) of `system` by `rule` as a CasADi function, differentiable to any order.

    Solves p0 = −D1 L_d − f⁻ for q1 and returns p1 = D2 L_d + f⁺ (Marsden & West 2001, §1.5).

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: the scene's own.

    Returns
    -------
    Function
        Inputs ``q0 (n)``, ``p0 (n)``, ``u (k, r)``: controls at the rule's nodes, ``params``, ``t``, ``h``; outputs
        ``q1 (n)``, ``p1 (n)``, ``residual``: size of the equations that remains, relative to the momenta; check it.

    Raises
    ------
    InputError
        If the rule cannot step the scene.

    Examples
    --------
    >>> import casadi as ca
    >>> import varint as vi
    >>> q, v = vi.coordinates("x")
    >>> step = vi.step_function(vi.System(q, v, v**2 / 2 - 9.81 * q), vi.gauss(2))
    >>> out = step(q0=0, p0=1, t=0, h=0.5)
    >>> round(float(out["q1"]), 12), round(float(out["p1"]), 12)
    (-0.72625, -3.905)
    """
    return _step_function(system, plan(system, rule).rule)


@per_system
def _step_function(system: System, rule: Rule) -> ca.Function:
    counting = counting_step_function(system, rule)
    inputs = counting.mx_in()
    outputs = [counting.name_out(i) for i in range(3)]
    return ca.Function("step", inputs, counting.call(inputs, True, False)[:3], counting.name_in(), outputs)


@per_system
def counting_step_function(system: System, rule: Rule) -> ca.Function:
    """`step_function` with one more output: the iterations of the step."""
    stepper, n, r = plan(system, rule).build(system, rule), system.structure.n, len(rule.nodes)
    q, p, u = ca.MX.sym("q0", n), ca.MX.sym("p0", n), ca.MX.sym("u", system.structure.controls, r)
    t, h, c = ca.MX.sym("t"), ca.MX.sym("h"), ca.MX.sym("params", system.c.numel())
    column = ca.vec(u)
    scale = scale_function(system, BALANCED)(q, p, _typical(u), t, h, c)
    x = stepper.step(stepper.start(q, p, column, t, h, c), column, t, h, c, scale)
    q1, _, p1 = ca.vertsplit(x[: 3 * n], n)
    count = x[-2] if stepper.counts else ca.MX(0)
    names = ["q0", "p0", "u", "params", "t", "h"], ["q1", "p1", "residual", "iterations"]
    return ca.Function("step", [q, p, u, c, t, h], [q1, p1, x[-1], count], *names)


def _typical(u: ca.MX) -> ca.MX:
    """Mean size of each control over the nodes."""
    return ca.sum2(ca.fabs(u)) / max(u.shape[1], 1)


@per_system
def scale_function(system: System, smallest: float = SMALLEST) -> ca.Function:
    """(q, p, u, t, h, c) → typical sizes of velocities and momenta, (2n,), from one look at the start of a step.

    A coordinate at rest is measured against the moving ones by its energy: v² M and p²/M compare metres with radians,
    where v with v and p with p would not. Controls count by their typical size, since a motion from rest may have no
    other. The sizes only decide when Newton's method stops, so their derivatives are defined to be zero. None is less
    than `smallest` of the largest.
    """
    n = system.structure.n
    q, p, u = ca.MX.sym("q", n), ca.MX.sym("p", n), ca.MX.sym("u", system.structure.controls)
    t, h, c = ca.MX.sym("t"), ca.MX.sym("h"), ca.MX.sym("c", system.c.numel())
    velocity, point = velocity_function(system), point_function(system)
    v = velocity(q, p, t, c)
    gain = [ca.plus(*point(q, v, u, at, c)[2:]) for at in (t, t + h)]  # a push may begin with zero
    push = ca.fmax(*(ca.fabs(h * x) for x in gain))
    twist = ca.fabs(ca.jacobian(system.momentum, system.q))
    parts = [ca.fabs(system.mass_matrix), ca.densify(twist + twist.T)]
    mass, twist = ca.Function("parts", [system.q, system.v, system.t, system.c], parts)(q, v, t, c)
    inertia = inertia_function(system)(q, p, t, c)
    # what the push does where nothing holds against it counts too: constraints may let it do nothing
    v_size = ca.fabs(v) + ca.fabs(velocity(q, p + h * gain[0], t + h, c) - v) + push / inertia
    p_size = ca.fabs(p) + push + ca.mtimes(mass, v_size)
    # the momentum of a massless coordinate may be zero, the terms that add up to it are not
    p_size += ca.if_else(ca.diag(mass) > 0, 0, ca.mtimes(twist, ca.fabs(h) * v_size))
    least = smallest * ca.norm_inf(v_size * ca.sqrt(inertia))
    sizes = [ca.fmax(v_size, least / ca.sqrt(inertia)), ca.fmax(p_size, least * ca.sqrt(inertia))]
    sizes = [ca.fmax(x, UNKNOWN) for x in sizes]
    options = {"is_diff_out": [False], "never_inline": True}
    return ca.Function("scale", [q, p, u, t, h, c], [ca.vertcat(*sizes)], options)


@per_system
def inertia_function(system: System) -> ca.Function:
    """(q, p, t, c) → what compares p with v in each coordinate, (n,): the mass, and |p|/|v| where there is none."""
    s = system
    q, p, t, c = (ca.MX.sym(name, x.numel()) for name, x in zip("qptc", (s.q, s.q, s.t, s.c), strict=True))
    v = velocity_function(s)(q, p, t, c)
    own = ca.Function("masses", [s.q, s.v, s.t, s.c], [ca.densify(ca.fabs(ca.diag(s.mass_matrix)))])(q, v, t, c)
    largest, p_size, v_size = ca.mmax(own), ca.norm_inf(p), ca.norm_inf(v)
    ratio = ca.if_else(p_size * v_size > 0, p_size / v_size, 1)
    return ca.Function("inertia", [q, p, t, c], [ca.if_else(own > 0, own, ca.if_else(largest > 0, largest, ratio))])


@per_system
def path_function(system: System, rule: Rule) -> ca.Function:
    """(q0, p0, u, params, t, h) → increments Q_j − q0, and reactions, at the control points of the step."""
    stepper = plan(system, rule).build(system, rule)
    sizes = (
        system.structure.n,
        system.structure.n,
        system.structure.controls * len(rule.nodes),
        system.c.numel(),
        1,
        1,
    )
    inputs = [ca.MX.sym(x, k) for x, k in zip(("q", "p", "u", "c", "t", "h"), sizes, strict=True)]
    q, p, u, c, t, h = inputs
    x = stepper.start(q, p, u, t, h, c)
    typical = _typical(ca.reshape(u, system.structure.controls, len(rule.nodes)))
    scale = scale_function(system, BALANCED)(q, p, typical, t, h, c)
    increments = stepper.path(x, u, t, h, c, scale)
    points = increments.numel() // system.structure.n + 1
    none = ca.MX(system.structure.n, points)
    reactions = stepper.reactions(x, u, t, h, c, scale) if stepper.reactions else none
    return ca.Function("path", inputs, [increments, ca.densify(reactions)])


@per_system
def action_function(system: System, rule: Rule) -> ca.Function:
    """(q0, p0, u, params, t, h) → discrete action L_d of the step that starts there."""
    one = interval(system, rule)
    return along_step(system, rule, one, [one.action])


def along_step(
    system: System, rule: Rule, one: Interval, outputs: list[ca.SX], reactions: ca.SX | None = None
) -> ca.Function:
    """(q0, p0, u, params, t, h) → expressions of the step's interval, along the step that starts there.

    They may also depend on symbols `reactions`, (n, d + 1): the momenta that constraints give at the control points.
    """
    path = path_function(system, rule)
    inputs = [ca.MX.sym(path.name_in(i), path.numel_in(i)) for i in range(path.n_in())]
    q, _, u, c, t, h = inputs
    outputs = ca.substitute(outputs, [one.lam], [ca.SX.zeros(*one.lam.shape)])  # constraints do no work: λ·g = 0
    pushes = ca.SX.sym("reactions", one.dq.shape[0], one.dq.shape[1] + 1) if reactions is None else reactions
    symbols = [one.q0, ca.vec(one.dq), pushes, ca.vec(one.u), one.c, one.t, one.h]
    values = ca.Function("along", symbols, outputs, {"cse": True})
    found = values.call([q, *path(*inputs), u, c, t, h])
    return ca.Function("along_step", inputs, [ca.densify(x) for x in found])  # CasADi drops outputs that are zero
