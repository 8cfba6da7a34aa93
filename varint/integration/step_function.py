"""One step as a differentiable CasADi function for users' own graphs."""

from __future__ import annotations

import casadi as ca

from varint.discrete.composed import base_of, shares
from varint.discrete.lagrangian import Interval, interval
from varint.discrete.scales import BALANCED, scale_function
from varint.integration.plan import plan
from varint.integration.steppers.stepper import State, Stepper, state_parts
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System


def step_function(system: System, rule: Rule | None = None) -> ca.Function:
    """One step (q0, p0) → (q1, p1) of `system` by `rule` as a CasADi function, differentiable to
    any order.

    Solves p0 = −D1 L_d − f⁻ for q1 and returns p1 = D2 L_d + f⁺ (Marsden & West 2001, §1.5).

    Parameters
    ----------
    system : System
    rule : Rule, optional
        Default: the scene's own.

    Returns
    -------
    Function
        Inputs ``q0 (n)``, ``p0 (n)``, ``u (k, r)``: controls at the rule's nodes, ``params``,
        ``t``, ``h``; outputs ``q1 (n)``, ``p1 (n)``, ``residual``: size of the equations that
        remains, relative to the momenta; check it.

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


@per_scene
def _step_function(system: System, rule: Rule) -> ca.Function:
    counting = counting_step_function(system, rule)
    inputs = counting.mx_in()
    outputs = [counting.name_out(i) for i in range(3)]
    return ca.Function(
        "step", inputs, counting.call(inputs, True, False)[:3], counting.name_in(), outputs
    )


@per_scene
def counting_step_function(system: System, rule: Rule) -> ca.Function:
    """`step_function` with one more output: the iterations of the step."""
    stepper = plan(system, rule).build(system, rule)
    inputs = _inputs(system, rule)
    x = stepper.start(*_of_stepper(inputs))
    after = _step_from(system, stepper, x, inputs)
    names = ["q0", "p0", "u", "params", "t", "h"], ["q1", "p1", "residual", "iterations"]
    return ca.Function("step", inputs, [after.q, after.p, after.residual, after.iterations], *names)


@per_scene
def guided_step_function(system: System, rule: Rule) -> ca.Function | None:
    """(q0, p0, u, params, t, h, mean velocities (Q_j − q0)/h to start from, (n·d,)) → q1, p1; None
    where a step has no unknowns of this kind.
    """
    stepper, n = plan(system, rule).build(system, rule), system.structure.n
    if not stepper.guided:
        return None
    inputs, means = _inputs(system, rule), ca.MX.sym("means", n * rule.degree)
    first = state_parts(stepper.start(*_of_stepper(inputs)), n)
    memory = ca.vertcat(means, first.memory[means.numel() :, :])
    after = _step_from(system, stepper, first._replace(memory=memory).vector, inputs)
    return ca.Function("guided_step", [*inputs, means], [after.q, after.p])


def _inputs(system: System, rule: Rule) -> list[ca.MX]:
    """q, p, u, c, t, h"""
    n, r = system.structure.n, len(rule.nodes)
    q, p, u = ca.MX.sym("q0", n), ca.MX.sym("p0", n), ca.MX.sym("u", system.structure.controls, r)
    return [q, p, u, ca.MX.sym("params", system.c.numel()), ca.MX.sym("t"), ca.MX.sym("h")]


def _of_stepper(inputs: list[ca.MX]) -> tuple[ca.MX, ...]:
    """The same as steppers want them."""
    q, p, u, c, t, h = inputs
    return q, p, ca.vec(u), t, h, c


def _step_from(system: System, stepper: Stepper, x: ca.MX, inputs: list[ca.MX]) -> State:
    """The state after a step from the state x."""
    q, p, u, c, t, h = inputs
    scale = scale_function(system, BALANCED)(q, p, _typical(u), t, h, c)
    return state_parts(stepper.step(x, ca.vec(u), t, h, c, scale), system.structure.n)


def _typical(u: ca.MX) -> ca.MX:
    """Mean size of each control over the nodes."""
    return ca.sum2(ca.fabs(u)) / max(u.shape[1], 1)


@per_scene
def path_function(system: System, rule: Rule) -> ca.Function:
    """(q0, p0, u, params, t, h) → increments Q_j − q0, and reactions, at the control points of
    the step.
    """
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


@per_scene
def action_function(system: System, rule: Rule) -> ca.Function:
    """(q0, p0, u, params, t, h) → discrete action L_d of the step that starts there."""
    if base := base_of(system, rule):
        return over_parts(system, rule, action_function(system, base))
    one = interval(system, rule)
    return along_step(system, rule, one, [one.action])


def over_parts(system: System, rule: Rule, of_part: ca.Function) -> ca.Function:
    """(q0, p0, u, params, t, h) → the sum of a function of these over the steps that a composition
    has.
    """
    base = base_of(system, rule)
    assert base is not None
    step, inputs, total = step_function(system, base), _inputs(system, rule), ca.MX(0)
    q, p, u, c, t, h = inputs
    for share, begun in shares(system, rule):
        part = q, p, u[:, : len(base.nodes)], c, t + begun * h, share * h
        total += of_part(*part[:2], ca.vec(part[2]), *part[3:])
        q, p, _ = step(*part)
    of_all = ca.Function("parts", inputs, [total])
    flat = [ca.MX.sym(of_part.name_in(i), x.numel()) for i, x in enumerate(inputs)]
    controls = ca.reshape(flat[2], *u.shape)
    return ca.Function("over_parts", flat, [of_all(*flat[:2], controls, *flat[3:])])


def along_step(
    system: System, rule: Rule, one: Interval, outputs: list[ca.SX], reactions: ca.SX | None = None
) -> ca.Function:
    """(q0, p0, u, params, t, h) → expressions of the step's interval, along the step that starts
    there.

    They may also depend on symbols `reactions`, (n, d + 1): the momenta that constraints give at
    the control points.
    """
    path = path_function(system, rule)
    inputs = [ca.MX.sym(path.name_in(i), path.numel_in(i)) for i in range(path.n_in())]
    q, _, u, c, t, h = inputs
    # constraints do no work: λ·g = 0
    outputs = ca.substitute(outputs, [one.lam], [ca.SX.zeros(*one.lam.shape)])
    impulses = (
        ca.SX.sym("reactions", one.dq.shape[0], one.dq.shape[1] + 1)
        if reactions is None
        else reactions
    )
    symbols = [one.q0, ca.vec(one.dq), impulses, ca.vec(one.u), one.c, one.t, one.h]
    values = ca.Function("along", symbols, outputs, {"cse": True})
    found = values.call([q, *path(*inputs), u, c, t, h])
    # CasADi drops outputs that are zero
    return ca.Function("along_step", inputs, [ca.densify(x) for x in found])
