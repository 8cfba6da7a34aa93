"""Costs of ready control problems by another method: Gauss–Legendre collocation of x' = f(x, u) on
the state (q, v).

It shares with the toolkit the Lagrangian and the forces of a problem, and nothing of its
discretisation: the equations of motion are solved for the accelerations, states and their slopes
are unknowns, CasADi differentiates the program. Every cost is computed with 5 points a step and
with 6 points on twice as many steps; the difference is its accuracy. Writes e.json. Run: python
tests/reference/collocation.py
"""

from __future__ import annotations

import json
from pathlib import Path

import casadi as ca
import numpy as np

import varint as vi

PROBLEMS = {
    "E01_hovercraft": ("hovercraft", 30, "a second minimum costs 11.344179499"),
    "E02_carried_load": (
        "carried_load_reduced",
        25,
        "two arms with a load, in the load's coordinates",
    ),
    "E03_acrobot": ("swing_up_acrobot", 80, "one of many local minima: that of the model's guess"),
    "E04_falling_cat": ("falling_cat", 40, "angular momentum zero"),
    "E05_overhead_crane": (
        "overhead_crane",
        150,
        "free time, bounds met: kinks limit the accuracy",
    ),
}
IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-12, "bound_relax_factor": 0.0, "max_iter": 2000}


def dynamics(phase: vi.Phase) -> ca.Function:
    """(x, u) → (x', cost rate, bounded expressions)."""
    s = phase.system
    push = ca.gradient(s.lagrangian, s.q) + s.force - ca.jtimes(s.momentum, s.q, s.v)
    rate = ca.vertcat(s.v, ca.solve(s.mass_matrix, push))
    held = ca.vertcat(ca.SX(0, 1), *(x for _, x, _ in phase.bounds))
    values = [
        ca.substitute(ca.densify(x), s.c, s.default_vector) for x in (rate, ca.SX(phase.cost), held)
    ]
    return ca.Function("f", [ca.vertcat(s.q, s.v), s.control], values)


def cost(phase: vi.Phase, guess: vi.Trajectory, steps: int, points: int) -> float:
    """Least cost by collocation with so many points a step."""
    f, (free_time, low, high) = dynamics(phase), _time(phase.duration)
    n, k = f.size1_in(0), f.size1_in(1)
    c, d = _tables(points)
    T, h = ca.MX.sym("T"), None
    h = T / steps
    X, S, U = (
        ca.MX.sym("X", n, steps + 1),
        ca.MX.sym("S", n * points, steps),
        ca.MX.sym("U", k * points, steps),
    )
    x0, s, u, t = (
        ca.SX.sym("x", n),
        ca.SX.sym("s", n, points),
        ca.SX.sym("u", k, points),
        ca.SX.sym("h"),
    )
    rows, total, held = [], ca.SX(0), []
    stages = ca.repmat(x0, 1, points) + t * ca.mtimes(s, ca.DM(c).T)
    for i in range(points):
        rate, value, bound = f(stages[:, i], u[:, i])
        rows.append(s[:, i] - rate)
        total += t * float(d[i]) * value
        held.append(bound)
    end = x0 + t * ca.mtimes(s, ca.DM(d))
    step = ca.Function(
        "step", [x0, ca.vec(s), ca.vec(u), t], [ca.vertcat(*rows), end, total, ca.vertcat(*held)]
    )
    matched, ends, costs, bounded = step.map(steps)(X[:, :-1], S, U, ca.repmat(h, 1, steps))
    x = ca.vertcat(ca.vec(X), ca.vec(S), ca.vec(U), T)
    g = ca.vertcat(ca.vec(matched), ca.vec(ends - X[:, 1:]), ca.vec(bounded))
    bounds = np.array([(a, b) for a, _, b in phase.bounds]).reshape(-1, 2)
    equal = np.zeros(steps * (n * points + n))
    lbg, ubg = (np.concatenate([equal, np.tile(side, steps * points)]) for side in bounds.T)
    lbx, ubx = np.full(x.numel(), -np.inf), np.full(x.numel(), np.inf)
    start, stop = (np.concatenate([e["q"], e["v"]]) for e in (phase.start, phase.end))
    lbx[:n] = ubx[:n] = start
    lbx[n * steps : n * (steps + 1)] = ubx[n * steps : n * (steps + 1)] = stop
    lbx[-1], ubx[-1] = low, high
    nodes = np.linspace(0, 1, steps + 1)
    inside = (nodes[:-1, None] + np.array(_points(points)) / steps).ravel()
    span = guess.t[0] + guess.duration * nodes
    states = np.hstack([guess.at(span).q, guess.at(span).v])
    there = guess.at(guess.t[0] + guess.duration * inside)
    controls = guess.u_at(guess.t[0] + guess.duration * inside)
    rates = np.array(f.map(len(inside))(np.hstack([there.q, there.v]).T, controls.T)[0]).T
    x_start = np.concatenate(
        [states.ravel(), rates.ravel(), controls.ravel(), [guess.duration if free_time else low]]
    )
    solver = ca.nlpsol(
        "solve",
        "ipopt",
        {"x": x, "f": ca.sum2(costs), "g": g},
        {"ipopt": IPOPT, "print_time": False},
    )
    found = solver(x0=x_start, lbx=lbx, ubx=ubx, lbg=lbg, ubg=ubg)
    assert solver.stats()["success"], solver.stats()["return_status"]
    return float(found["f"])


def _points(points: int) -> list[float]:
    return ca.collocation_points(points, "legendre")


def _tables(points: int) -> tuple[np.ndarray, np.ndarray]:
    """∫_0^{c_i} and ∫_0^1 of the Lagrange polynomials of the slopes."""
    c = np.array(_points(points))
    powers = np.arange(1, points + 1)
    inverse = np.linalg.inv(c[:, None] ** (powers - 1))
    return (c[:, None] ** powers / powers) @ inverse, (1 / powers) @ inverse


def _time(duration) -> tuple[bool, float, float]:
    if isinstance(duration, float):
        return False, duration, duration
    return True, float(duration.lower), float(duration.upper)


def main() -> None:
    entries = {}
    for name, (factory, steps, note) in PROBLEMS.items():
        model = getattr(vi.models, factory)()
        guess = model.solve()[0]
        rough, fine = (cost(model.phases[0], guess, n, r) for n, r in ((steps, 5), (2 * steps, 6)))
        print(
            f"{name:20} {rough:.12f} {fine:.12f} {abs(fine - rough) / fine:.1e}  varint "
            f"{guess.cost:.12f}"
        )
        entries[name] = {
            "title": factory,
            "model": model.claim,
            "reference": {"J": fine},
            "accuracy": abs(fine - rough) / fine,
            "source": ["tests/reference/collocation.py: Gauss–Legendre collocation in (q, v)"],
            "verification": {
                "method1": f"5 points, {steps} steps",
                "method2": f"6 points, {2 * steps} steps",
                "max_diff": abs(fine - rough),
            },
            "notes": note,
        }
    (Path(__file__).parent / "e.json").write_text(
        json.dumps(entries, indent=1, ensure_ascii=False) + "\n"
    )


if __name__ == "__main__":
    main()
