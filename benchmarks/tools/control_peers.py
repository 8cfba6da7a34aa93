"""Kelly's cart-pole by several toolkits for optimal control, each as its manual has it: solved from
nothing, then for ends a little further off, from the last solution and without building where the
tool can.

Run as a program, `python control_peers.py varint "gauss(4)" 30`, it prints what one tool measures
in a process of its own: seconds of processor time, compilers' among them, to import it, to build
and solve for the first time, and for each further end, with the costs.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import resource
import sys
import tempfile
from collections.abc import Callable, Iterator
from time import process_time

import numpy as np

ENDS = [1.0 + 0.01 * k for k in range(4)]
EXACT = 58.80766745816687  # of the first end
LIMIT, WAY, TIME = 20.0, 2.0, 2.0
M1, M2, LENGTH, GRAVITY = 1.0, 0.3, 0.5, 9.81
SETTINGS = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False}
Runs = Iterator[float]


def accelerations(sin, cos, turn, push):
    """x'' and θ'' of the cart-pole, for whatever kind of numbers."""
    whole = M1 + M2 * (1 - cos**2)
    swing = push + M2 * LENGTH * sin * turn**2
    return (
        (swing + M2 * GRAVITY * cos * sin) / whole,
        -(swing * cos + (M1 + M2) * GRAVITY * sin) / (LENGTH * whole),
    )


def guess(s: np.ndarray) -> np.ndarray:
    """The straight line and its velocities at fractions of the time, (4, M)."""
    return np.array([s, np.pi * s, 0 * s + 0.5, 0 * s + np.pi / 2])


def varint(rule: str, steps: int) -> Runs:
    """This toolkit."""
    import casadi as ca

    import varint as vi

    stages = int(rule.removeprefix("gauss(").removesuffix(")"))
    q, v = vi.coordinates("x", "theta")
    push = ca.SX.sym("push")
    kinetic = (M1 + M2) * v[0] ** 2 / 2 + M2 * LENGTH * ca.cos(q[1]) * v[0] * v[1]
    kinetic += M2 * LENGTH**2 * v[1] ** 2 / 2
    lagrangian = kinetic + M2 * GRAVITY * LENGTH * ca.cos(q[1])
    cart = vi.System(q, v, lagrangian, force=ca.vertcat(push, 0), control=push)
    motion = vi.optimal_control(
        cart,
        vi.gauss(stages),
        duration=TIME,
        steps=steps,
        cost=push**2,
        q0=[0, 0],
        v0=[0, 0],
        end=dict(q=[ENDS[0], np.pi], v=[0, 0]),
        bounds=[(-LIMIT, push, LIMIT), (-WAY, q[0], WAY)],
        progress=False,
    )
    yield motion.cost
    for end in ENDS[1:]:
        motion = motion.again(end=dict(q=[end, np.pi]))
        yield motion.cost


def hermite_simpson(_: str, steps: int) -> Runs:
    """The separated form by hand in CasADi's Opti."""
    import casadi as ca

    f, opti, h = _rates(), ca.Opti(), TIME / steps
    x, middle = opti.variable(4, steps + 1), opti.variable(4, steps)
    u, between = opti.variable(1, steps + 1), opti.variable(1, steps)
    cost = 0
    for k in range(steps):
        f0, fm, f1 = f(x[:, k], u[k]), f(middle[:, k], between[k]), f(x[:, k + 1], u[k + 1])
        opti.subject_to(middle[:, k] == (x[:, k] + x[:, k + 1]) / 2 + h / 8 * (f0 - f1))
        opti.subject_to(x[:, k + 1] == x[:, k] + h / 6 * (f0 + 4 * fm + f1))
        cost += h / 6 * (u[k] ** 2 + 4 * between[k] ** 2 + u[k + 1] ** 2)
    s = np.linspace(0, 1, steps + 1)
    opti.set_initial(middle, guess(s[:-1] + 0.5 / steps))
    return _by_hand(opti, x, [u, between], cost)


def trapezoidal(_: str, steps: int) -> Runs:
    """Trapezoidal collocation by hand in CasADi's Opti."""
    import casadi as ca

    f, opti, h = _rates(), ca.Opti(), TIME / steps
    x, u, cost = opti.variable(4, steps + 1), opti.variable(1, steps + 1), 0
    for k in range(steps):
        both = f(x[:, k], u[k]) + f(x[:, k + 1], u[k + 1])
        opti.subject_to(x[:, k + 1] == x[:, k] + h / 2 * both)
        cost += h / 2 * (u[k] ** 2 + u[k + 1] ** 2)
    return _by_hand(opti, x, [u], cost)


def legendre(points: str, steps: int) -> Runs:
    """Collocation at so many Legendre points by hand in CasADi's Opti."""
    import casadi as ca

    r = int(points)
    places = ca.collocation_points(r, "legendre")
    slopes, end, weights = ca.collocation_coeff(places)
    f, opti, h = _rates(), ca.Opti(), TIME / steps
    x, u, cost = opti.variable(4, steps + 1), opti.variable(r, steps), 0
    inner = opti.variable(4, r * steps)
    for k in range(steps):
        z = inner[:, r * k : r * (k + 1)]
        path = ca.horzcat(x[:, k], z)
        for j in range(r):
            opti.subject_to(ca.mtimes(path, slopes[:, j]) == h * f(z[:, j], u[j, k]))
        opti.subject_to(x[:, k + 1] == ca.mtimes(path, end))
        cost += h * ca.dot(weights, u[:, k] ** 2)
    s = (np.arange(steps)[:, None] + np.array(places)).ravel() / steps
    opti.set_initial(inner, guess(s))
    return _by_hand(opti, x, [u], cost)


def _rates():
    """x' = f(x, u) as a CasADi function."""
    import casadi as ca

    state, force = ca.SX.sym("x", 4), ca.SX.sym("u")
    a = accelerations(ca.sin(state[1]), ca.cos(state[1]), state[3], force)
    return ca.Function("f", [state, force], [ca.vertcat(state[2:], *a)])


def _by_hand(opti, x, controls: list, cost) -> Runs:
    """What is written by hand, end by end: warm from its last solution and multipliers."""
    import casadi as ca

    end = opti.parameter(4)
    opti.subject_to(x[:, 0] == 0)
    opti.subject_to(x[:, -1] == end)
    for control in controls:
        opti.subject_to(opti.bounded(-LIMIT, ca.vec(control), LIMIT))
    opti.subject_to(opti.bounded(-WAY, ca.vec(x[0, :]), WAY))
    opti.minimize(cost)
    opti.set_initial(x, guess(np.linspace(0, 1, x.shape[1])))
    plain, quiet = {"expand": True, "print_time": False}, {"print_level": 0, "sb": "yes"}
    opti.solver("ipopt", plain, quiet)
    opti.set_value(end, [ENDS[0], np.pi, 0, 0])
    found = opti.solve()
    yield float(found.value(cost))
    near = {"warm_start_init_point": "yes", "mu_init": 1e-9}
    pushed = "bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push"
    near |= {f"warm_start_{what}": 1e-8 for what in pushed}
    opti.solver("ipopt", plain, quiet | near)
    for far in ENDS[1:]:
        opti.set_initial(found.value_variables())
        opti.set_initial(opti.lam_g, found.value(opti.lam_g))
        opti.set_value(end, [far, np.pi, 0, 0])
        found = opti.solve()
        yield float(found.value(cost))


def rockit(order: str, steps: int) -> Runs:
    """rockit: direct collocation of degree 4, piecewise constant or linear controls."""
    import casadi as ca
    from rockit import DirectCollocation, Ocp

    def as_function(symbol):
        """The last solution as a function of time: the way to a guess that works here."""
        times, values = found.sample(symbol, grid="control")
        values = np.atleast_2d(values.T).T
        return ca.interpolant("last", "linear", [times], values.ravel())(ocp.t)

    ocp = Ocp(T=TIME)
    x, end = ocp.state(4), ocp.parameter(4)
    u = ocp.control(order={"constant": 0, "linear": 1}[order])
    a = accelerations(ca.sin(x[1]), ca.cos(x[1]), x[3], u)
    ocp.set_der(x, ca.vertcat(x[2:], *a))
    ocp.subject_to(ocp.at_t0(x) == 0)
    ocp.subject_to(ocp.at_tf(x) == end)
    ocp.subject_to((u <= LIMIT) >= -LIMIT)
    ocp.subject_to((x[0] <= WAY) >= -WAY)
    ocp.add_objective(ocp.integral(u**2))
    ocp.set_initial(x, ca.vertcat(ocp.t / 2, np.pi * ocp.t / 2, 0.5, np.pi / 2))
    ocp.solver("ipopt", SETTINGS | {"expand": True})
    ocp.method(DirectCollocation(N=steps, degree=4))
    ocp.set_value(end, [ENDS[0], np.pi, 0, 0])
    found = ocp.solve()
    yield float(found.value(ocp.objective))
    for far in ENDS[1:]:
        ocp.set_initial(x, as_function(x))
        ocp.set_initial(u, as_function(u))
        ocp.set_value(end, [far, np.pi, 0, 0])
        found = ocp.solve()
        yield float(found.value(ocp.objective))


def mpopt(points: str, steps: int) -> Runs:
    """mpopt: Legendre–Gauss–Radau points, so many in each of `steps` segments; it builds a problem
    anew for every end, and starts from the last solution.
    """
    import casadi as ca
    from mpopt import mp

    found = None
    for far in ENDS:
        ocp = mp.OCP(n_states=4, n_controls=1)

        def rates(x, u, t):
            return [x[2], x[3], *accelerations(ca.sin(x[1]), ca.cos(x[1]), x[3], u[0])]

        ocp.dynamics[0] = rates
        ocp.running_costs[0] = lambda x, u, t: u[0] ** 2
        ocp.terminal_constraints[0] = lambda xf, tf, x0, t0, far=far: [
            xf[0] - far,
            xf[1] - np.pi,
            xf[2],
            xf[3],
        ]
        ocp.x00[0], ocp.xf0[0] = guess(np.array([0.0, 1.0])).T
        ocp.x00[0] = 0.0
        ocp.lbx[0][0], ocp.ubx[0][0] = -WAY, WAY
        ocp.lbu[0], ocp.ubu[0] = -LIMIT, LIMIT
        ocp.lbtf[0] = ocp.ubtf[0] = ocp.tf0[0] = TIME
        ocp.validate()
        one = mp.mpopt(ocp, steps, int(points), "LGR")
        start = None if found is None else {"x0": found["x"]}
        found = one.solve(start, nlp_solver_options=SETTINGS)
        yield float(found["f"])


def opty(method: str, steps: int) -> Runs:
    """opty: its equations of motion and first derivatives compiled from SymPy; it builds a problem
    anew for every end, and starts from the last solution.
    """
    import sympy as sp
    from opty import Problem

    t = sp.Symbol("t")
    x, angle, speed, rate, push = (
        sp.Function(name)(t) for name in ("x", "angle", "speed", "rate", "push")
    )
    motion = sp.Matrix(
        [
            x.diff(t) - speed,
            angle.diff(t) - rate,
            (M1 + M2) * speed.diff(t)
            + M2 * LENGTH * (rate.diff(t) * sp.cos(angle) - rate**2 * sp.sin(angle))
            - push,
            LENGTH * rate.diff(t) + speed.diff(t) * sp.cos(angle) + GRAVITY * sp.sin(angle),
        ]
    )
    nodes, h = steps + 1, TIME / steps

    def middle(free: np.ndarray) -> np.ndarray:
        u = free[4 * nodes :]
        return (u[1:] + u[:-1]) / 2

    def cost(free: np.ndarray) -> float:
        return float(h * (middle(free) ** 2).sum())

    def gradient(free: np.ndarray) -> np.ndarray:
        slope = np.zeros_like(free)
        slope[4 * nodes : -1] += h * middle(free)
        slope[4 * nodes + 1 :] += h * middle(free)
        return slope

    start = np.append(guess(np.linspace(0, 1, nodes)).ravel(), np.zeros(nodes))
    for far in ENDS:
        ends = ((x, 0, far), (angle, 0, np.pi), (speed, 0, 0), (rate, 0, 0))
        held = [
            s.subs(t, at) - value
            for s, *values in ends
            for at, value in zip((0, TIME), values, strict=True)
        ]
        one = Problem(
            cost,
            gradient,
            motion,
            (x, angle, speed, rate),
            nodes,
            h,
            instance_constraints=held,
            bounds={push: (-LIMIT, LIMIT), x: (-WAY, WAY)},
            integration_method=method,
            time_symbol=t,
        )
        for name, value in (("print_level", 0), ("sb", "yes"), ("tol", 1e-10)):
            one.add_option(name, value)
        start, found = one.solve(start)
        yield float(found["obj_val"])


def dymos(order: str, steps: int) -> Runs:
    """dymos: Gauss–Lobatto segments of this order; SLSQP of SciPy, for it brings no Ipopt."""
    import dymos as dm
    import openmdao.api as om

    class CartPole(om.ExplicitComponent):
        def initialize(self):
            self.options.declare("num_nodes", types=int)

        def setup(self):
            n = self.options["num_nodes"]
            for name in ("theta", "turn", "push"):
                self.add_input(name, shape=(n,))
            for name in ("speed_rate", "turn_rate", "effort"):
                self.add_output(name, shape=(n,))
            self.declare_partials("*", "*", method="cs", rows=np.arange(n), cols=np.arange(n))
            self.declare_coloring(wrt="*", method="cs", show_summary=False)

        def compute(self, inputs, outputs):
            theta, push = inputs["theta"], inputs["push"]
            a = accelerations(np.sin(theta), np.cos(theta), inputs["turn"], push)
            outputs["speed_rate"], outputs["turn_rate"] = a
            outputs["effort"] = push**2

    problem = om.Problem(reports=None)
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-6, maxiter=200, disp=False)
    problem.driver.declare_coloring(show_summary=False, show_sparsity=False)
    phase = dm.Phase(
        ode_class=CartPole,
        transcription=dm.GaussLobatto(num_segments=steps, order=int(order), compressed=True),
    )
    problem.model.add_subsystem("swing", dm.Trajectory()).add_phase("phase", phase)
    phase.set_time_options(fix_initial=True, fix_duration=True, units=None)
    both = dict(fix_initial=True, fix_final=True, units=None, shape=(1,))
    phase.add_state("x", rate_source="speed", lower=-WAY, upper=WAY, **both)
    phase.add_state("theta", rate_source="turn", targets=["theta"], **both)
    phase.add_state("speed", rate_source="speed_rate", **both)
    phase.add_state("turn", rate_source="turn_rate", targets=["turn"], **both)
    phase.add_state("cost", rate_source="effort", fix_initial=True, units=None, shape=(1,))
    phase.add_control("push", targets=["push"], units=None, lower=-LIMIT, upper=LIMIT)
    phase.add_objective("cost", loc="final")
    problem.setup()
    phase.set_time_val(0.0, TIME)
    middle, last = guess(np.array([0.5]))[:, 0], (1.0, np.pi, 0.0, 0.0)
    for name, a, b in zip(("x", "theta", "speed", "turn"), middle, last, strict=True):
        phase.set_state_val(name, [0.0, a, b], [0.0, 1.0, 2.0])
    phase.set_state_val("cost", [0.0, 60.0])
    phase.set_control_val("push", [0.0, 0.0])
    for far in ENDS:
        states = problem.get_val("swing.phase.states:x")
        states[-1] = far
        problem.set_val("swing.phase.states:x", states)
        problem.run_driver()
        yield float(problem.get_val("swing.phase.timeseries.cost")[-1, 0])


TOOLS: dict[str, Callable[[str, int], Runs]] = {
    "varint": varint,
    "Hermite–Simpson": hermite_simpson,
    "trapezoidal": trapezoidal,
    "Legendre": legendre,
    "rockit": rockit,
    "mpopt": mpopt,
    "opty": opty,
    "dymos": dymos,
}
MODULES = {name: name for name in ("varint", "rockit", "mpopt", "opty", "dymos")}


def seconds_used() -> float:
    """Processor time of this process and of those that it started: it does not see who else uses
    the machine.
    """
    others = resource.getrusage(resource.RUSAGE_CHILDREN)
    return process_time() + others.ru_utime + others.ru_stime


def main(tool: str, setting: str, steps: int) -> dict:
    """What one tool measures."""
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        os.chdir(folder)
        began = seconds_used()
        __import__("casadi")
        if tool in MODULES:
            __import__(MODULES[tool])
        marks, costs = [seconds_used()], []
        for cost in TOOLS[tool](setting, steps):
            marks.append(seconds_used())
            costs.append(cost)
        os.chdir("/")
    seconds = np.diff(marks)
    return {
        "import s": marks[0] - began,
        "first s": float(seconds[0]),
        "again s": float(np.median(seconds[1:])),
        "error": abs(costs[0] / EXACT - 1),
        "costs": costs,
    }


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], sys.argv[2], int(sys.argv[3]))))
