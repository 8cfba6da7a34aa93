"""Optimal control: assembly of large problems, solvers, and cost error against time beside other
transcriptions and toolkits.

Run: python benchmarks/optimal_control.py; the third part alone with `--resume`, which leaves what
the record holds, or with names of tools, which are measured anew. Results:
benchmarks/results/optimal_control*.json and .png.

1. Cart with 4 links, midpoint, 2000 steps, 12,015 unknowns: the same program assembled from
   one-interval kernels (interpreted, compiled) and differentiated by CasADi through ``map``; build
   and solve times and their ratios.
2. Ready problems by Ipopt and, as a chain of stages, by Fatrop.
3. Kelly's cart-pole, J = 58.80766745816687: error of J against processor time, from nothing and
   again, for this toolkit's rules, for collocation written by hand in CasADi (trapezoidal,
   Hermite–Simpson, Gauss–Legendre), and for mpopt, rockit, dymos and opty where they are installed.
"""

from __future__ import annotations

import sys
from time import perf_counter

import casadi as ca
from tools.control_tools import main as by_tools
from tools.record import save, table

import varint as vi
from varint.control.build import build_control_solver as built_solver
from varint.control.guess import build_start
from varint.control.problem import transcribe
from varint.nlp.options import IPOPT

QUIET = {"ipopt": IPOPT, "print_time": False}
REPEATS = 3


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


if __name__ == "__main__":
    words = sys.argv[1:]
    if not words:
        large_problem()
        stage_solver()
    by_tools(words)
