"""Optimal control: assembly of large problems, and cost error against time beside other
transcriptions.

Run: python benchmarks/optimal_control.py. Results: benchmarks/results/optimal_control*.json and
.png.

1. Cart with 4 links, midpoint, 2000 steps, 12,015 unknowns: the same program assembled from
   one-interval kernels (interpreted, compiled) and differentiated by CasADi through ``map``; build
   and solve times and their ratios.
2. Ready problems by Ipopt and, as a chain of stages, by Fatrop.
3. Kelly's cart-pole, J = 58.80766745816687: error of J against build and solve time for this
   toolkit's rules, for hand-written collocation in CasADi (trapezoidal, Hermite–Simpson,
   Gauss–Legendre), and for rockit and opty where they are installed. opty's time includes its
   compiler's, a good part of it.
"""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from pathlib import Path
from time import perf_counter

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np
from tools.control_peers import opty
from tools.record import FOLDER, save, table

import varint as vi
from varint.control.build import build_control_solver as built_solver
from varint.control.guess import build_start
from varint.control.problem import transcribe
from varint.nlp.options import IPOPT

EXACT = 58.80766745816687
QUIET = {"ipopt": IPOPT, "print_time": False}
REPEATS = 3
METHODS = {"varint midpoint()": 1, "varint gauss(2)": 2, "varint gauss(3)": 3, "varint gauss(4)": 4}
STEPS = {1: (20, 40, 80, 160), 2: (20, 40, 80, 160), 3: (15, 30, 60, 90), 4: (12, 25, 40, 60)}


def cart_with_links(links: int = 4) -> tuple[vi.System, ca.SX]:
    """A cart with a chain of hanging links, pushed."""
    q, v = vi.coordinates("x", *(f"a{i}" for i in range(links)))
    push = ca.SX.sym("push")
    place, lagrangian = ca.vertcat(q[0], 0), v[0] ** 2 / 2
    for i in range(links):
        place = place + 0.5 * ca.vertcat(ca.sin(q[1 + i]), -ca.cos(q[1 + i]))
        lagrangian += 0.1 * ca.sumsqr(ca.jtimes(place, q, v)) / 2 - 0.1 * 9.81 * place[1]
    return vi.System(
        q, v, lagrangian, force=ca.vertcat(push, ca.SX.zeros(links)), control=push
    ), push


def large_problem(steps: int = 2000) -> None:
    """The same program, its derivatives from kernels or from CasADi's `map`."""
    system, push = cart_with_links()
    n = system.structure.n
    phase = vi.Phase(
        system,
        vi.midpoint(),
        4.0,
        steps,
        push**2,
        start=dict(q=[0] * n, v=[0] * n),
        end=dict(q=[1] + [0] * (n - 1), v=[0] * n),
        bounds=[(-0.4, push, 0.4)],
    )
    rows, cost = [], {}
    # so that the cache holds the kernels: the compiler is timed apart
    transcribe([phase], [], 0.0, "compiled")
    for backend in ("interpreted", "compiled"):
        build, solve = [], []
        for _ in range(REPEATS):
            began = perf_counter()
            one = transcribe([phase], [], 0.0, backend)
            x = build_start(one)
            run = built_solver(one, x)
            build.append(perf_counter() - began)
            outcome = run(x, progress=False)
            solve.append(outcome.seconds)
        cost[backend] = outcome.cost
        rows.append(
            {
                "assembly": f"one-interval kernels, {backend}",
                "build s": min(build),
                "solve s": min(solve),
            }
        )
    one = transcribe([phase], [], 0.0, "interpreted")
    build, solve = [], []
    for _ in range(REPEATS):
        began = perf_counter()
        z, p = ca.MX.sym("x", one.unknowns), ca.MX.sym("p", len(one.nlp.p))
        f, g = one.nlp.program.value(z, p)  # a map over the intervals: CasADi differentiates it
        plain = ca.nlpsol("plain", "ipopt", {"x": z, "p": p, "f": f, "g": g}, QUIET)
        build.append(perf_counter() - began)
        began = perf_counter()
        found = plain(
            x0=x,
            p=one.nlp.p,
            lbx=one.nlp.x_low,
            ubx=one.nlp.x_high,
            lbg=one.nlp.g_low,
            ubg=one.nlp.g_high,
        )
        solve.append(perf_counter() - began)
    rows.append({"assembly": "CasADi map", "build s": min(build), "solve s": min(solve)})
    for value in cost.values():
        assert abs(float(found["f"]) - value) <= 1e-8 * abs(value)
    for row in rows:
        row["solve / map"] = row["solve s"] / rows[-1]["solve s"]
    print(
        f"cart with 4 links, midpoint, {steps} steps, {one.unknowns} unknowns, "
        f"{outcome.iterations} iterations"
    )
    table(rows)
    save("optimal_control_assembly", rows)


def stage_solver() -> None:
    """Ipopt on the plain program and Fatrop on the chain of stages; kernels interpreted."""
    rows = []
    for name in (
        "swing_up_cart_pole",
        "swing_up_pendulum",
        "overhead_crane",
        "swing_up_rod",
        "orbit_transfer",
    ):
        phases = vi.models.control_catalogue[name]().phases
        row: dict = {"problem": name}
        for solver in ("ipopt", "fatrop"):
            found = [
                vi.optimal_phases(phases, solver=solver, backend="interpreted")[0]
                for _ in range(REPEATS)
            ]
            row[f"{solver} iterations"] = found[0].solution.iterations
            row[f"{solver} ms"] = 1e3 * min(x.solution.timings["solve"] for x in found)
            row[f"{solver} cost"] = found[0].cost
        row["difference of cost"] = abs(row.pop("fatrop cost") / row.pop("ipopt cost") - 1)
        rows.append(row)
    table(rows)
    save("optimal_control_solvers", rows)


def dynamics() -> ca.Function:
    """First-order form x' = f(x, u) of Kelly's cart-pole, for the collocation codes."""
    system = vi.models.cart_pole().system
    s = system
    force = ca.gradient(s.lagrangian, s.q) + s.force - ca.jtimes(s.momentum, s.q, s.v)
    rate = ca.substitute(ca.solve(s.mass_matrix, force), s.c, s.default_vector)
    return ca.Function("f", [ca.vertcat(s.q, s.v), s.control], [ca.vertcat(s.v, rate)])


def collocation(kind: str, steps: int) -> float:
    """Cost by hand-written collocation; trapezoidal, hermite-simpson or legendre with 2–4
    points.
    """
    f, h = dynamics(), 2.0 / steps
    x0, x1 = ca.SX.sym("x0", 4), ca.SX.sym("x1", 4)
    if kind == "trapezoidal":
        u = ca.SX.sym("u", 2)
        inner = ca.SX(0, 1)
        rows = x1 - x0 - h / 2 * (f(x0, u[0]) + f(x1, u[1]))
        cost = h / 2 * ca.sumsqr(u)
    elif kind == "Hermite–Simpson":
        u = ca.SX.sym("u", 3)
        inner = ca.SX.sym("xm", 4)
        f0, fm, f1 = f(x0, u[0]), f(inner, u[1]), f(x1, u[2])
        rows = ca.vertcat(
            inner - (x0 + x1) / 2 - h / 8 * (f0 - f1), x1 - x0 - h / 6 * (f0 + 4 * fm + f1)
        )
        cost = h / 6 * (u[0] ** 2 + 4 * u[1] ** 2 + u[2] ** 2)
    else:
        r = int(kind.split()[1])
        rule = vi.gauss(r)
        u, slopes = ca.SX.sym("u", r), ca.SX.sym("k", 4, r)
        inner = ca.vec(slopes)
        stages = ca.repmat(x0, 1, r) + h * slopes @ ca.DM(rule.collocation).T
        rows = ca.vertcat(
            *(slopes[:, i] - f(stages[:, i], u[i]) for i in range(r)),
            x1 - x0 - h * slopes @ ca.DM(rule.weights),
        )
        cost = h * ca.dot(ca.DM(rule.weights), u**2)
    # controls at the ends are shared by neighbours
    shared = kind in (
        "trapezoidal",
        "Hermite–Simpson",
    )
    step = ca.Function("step", [x0, x1, inner, u], [rows, cost])
    X = ca.MX.sym("X", 4, steps + 1)
    Z = ca.MX.sym("Z", inner.numel(), steps)
    if shared:
        ends, middle = ca.MX.sym("U", 1, steps + 1), ca.MX.sym("M", u.numel() - 2, steps)
        U = ca.vertcat(ends[:-1], middle, ends[1:])
        unknowns = [ca.vec(X), ca.vec(Z), ca.vec(ends), ca.vec(middle)]
    else:
        U = ca.MX.sym("U", u.numel(), steps)
        unknowns = [ca.vec(X), ca.vec(Z), ca.vec(U)]
    rows_all, costs = step.map(steps)(X[:, :-1], X[:, 1:], Z, U)
    x = ca.vertcat(*unknowns)
    nlp = ca.nlpsol(
        "collocation",
        "ipopt",
        {"x": x, "f": ca.sum2(costs), "g": ca.vec(rows_all)},
        QUIET | {"expand": True},
    )
    line = np.linspace(0, 1, steps + 1)
    guess = np.concatenate(
        [np.array([line, np.pi * line, 0 * line + 0.5, 0 * line + np.pi / 2]).T.ravel()]
    )
    start, low, high = np.zeros(x.numel()), np.full(x.numel(), -np.inf), np.full(x.numel(), np.inf)
    start[: guess.size] = guess
    if kind == "Hermite–Simpson":
        middles = (line[1:] + line[:-1]) / 2
        start[guess.size : guess.size + 4 * steps] = np.array(
            [middles, np.pi * middles, 0 * middles + 0.5, 0 * middles + np.pi / 2]
        ).T.ravel()
    low[:4] = high[:4] = 0
    low[4 * steps : 4 * steps + 4] = high[4 * steps : 4 * steps + 4] = [1, np.pi, 0, 0]
    n_u = sum(part.numel() for part in unknowns[2:])
    low[-n_u:], high[-n_u:] = -20, 20
    return float(nlp(x0=start, lbx=low, ubx=high, lbg=0, ubg=0)["f"])


def by_varint(stages: int, steps: int) -> float:
    """Cost by this toolkit."""
    return vi.models.swing_up_cart_pole(steps, stages).solve()[0].cost


def by_rockit(steps: int) -> float:
    """Cost by rockit's direct collocation of degree 4 (Radau), piecewise constant controls."""
    import rockit

    f = dynamics()
    ocp = rockit.Ocp(T=2.0)
    x, u = ocp.state(4), ocp.control()
    ocp.set_der(x, f(x, u))
    ocp.subject_to(ocp.at_t0(x) == 0)
    ocp.subject_to(ocp.at_tf(x) == ca.DM([1, np.pi, 0, 0]))
    ocp.subject_to((u <= 20) >= -20)
    ocp.add_objective(ocp.integral(u**2))
    ocp.set_initial(x, ca.vertcat(ocp.t / 2, np.pi * ocp.t / 2, 0.5, np.pi / 2))
    ocp.solver("ipopt", QUIET)
    ocp.method(rockit.DirectCollocation(N=steps, degree=4))
    solution = ocp.solve()
    return float(solution.value(ocp.objective))


def quietly(run):
    """A run whose compiler and solver keep their messages and files to themselves."""
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        os.chdir(folder)
        try:
            return run()
        finally:
            os.chdir(here)


def timed(run, repeats: int = REPEATS) -> tuple[float, float]:
    """(median seconds, cost): build and solve from nothing."""
    seconds, cost = [], 0.0
    for _ in range(repeats):
        began = perf_counter()
        cost = run()
        seconds.append(perf_counter() - began)
    return float(np.median(seconds)), cost


def peers() -> dict[str, list[tuple[int, float, float]]]:
    """Those that are installed."""
    rows = {}
    try:
        rows["rockit, degree 4"] = [
            (n, *timed(lambda n=n: quietly(lambda: by_rockit(n)))) for n in STEPS[1]
        ]
    except ImportError:
        print("rockit is not installed; left out")
    try:
        rows["opty, midpoint"] = [
            (n, *timed(lambda n=n: quietly(lambda: next(opty("midpoint", n))), 1))
            for n in STEPS[1][1::2]
        ]
    except ImportError:
        print("opty or cyipopt is not installed; left out")
    return rows


def work_and_precision() -> None:
    """Table and figure of cost error against time."""
    found: dict[str, list[tuple[int, float, float]]] = {}
    for name, stages in METHODS.items():
        found[name] = [(n, *timed(lambda n=n, s=stages: by_varint(s, n))) for n in STEPS[stages]]
    for kind in ("trapezoidal", "Hermite–Simpson", "Legendre 2", "Legendre 3", "Legendre 4"):
        order = {"trapezoidal": 1, "Hermite–Simpson": 2}.get(kind) or int(kind[-1])
        found[kind] = [(n, *timed(lambda n=n, k=kind: collocation(k, n))) for n in STEPS[order]]
    found |= peers()
    rows = [
        {
            "method": name,
            "steps": steps,
            "ms": 1e3 * seconds,
            "relative error of J": abs(cost / EXACT - 1),
        }
        for name, runs in found.items()
        for steps, seconds, cost in runs
    ]
    table(rows)
    save("optimal_control", rows)
    figure, axes = plt.subplots(figsize=(7.5, 5), layout="constrained")
    for i, name in enumerate(found):
        mine = [row for row in rows if row["method"] == name]
        axes.loglog(
            [row["ms"] for row in mine],
            [max(row["relative error of J"], 1e-15) for row in mine],
            "o-" if name.startswith("varint") else "s--",
            ms=4,
            label=name,
            color=plt.get_cmap("tab20")(i),
        )
    axes.set(
        xlabel="build and solve, ms",
        ylabel="relative error of the cost",
        title="Cart-pole swing-up: error of the cost against time",
    )
    axes.legend(fontsize="small", ncols=2)
    axes.grid(alpha=0.3)
    figure.savefig(FOLDER / "optimal_control.png", dpi=120)


if __name__ == "__main__":
    large_problem()
    stage_solver()
    work_and_precision()
