"""Runs beside loops of the same methods written by hand in C for one scene each.

python benchmarks/by_hand.py

A chain of 32 masses with nonlinear springs by `composition('blanes-moan6')` and `gauss(4)`, a ball
on a spring that bounces on a slope by `lobatto(3)`, and a slider crank of three bodies with eight
multipliers by `trapezoidal()` (RATTLE) and `lobatto(3)`. The loops by hand
(benchmarks/tools/by_hand) know their scene and nothing else: no compensated sums, no carrying on,
no watch for folds or steps that are too large; forces, Jacobians and bands are written out, and
iterations stop where varint's do. What is timed of varint is the whole call of `simulate`, which
keeps the start and the end alone. All take turns in one process; the processor's time, the least
and the median of the turns. `difference` is that of the coordinates at the end, relative to the
largest: that of round-off, for both take the same discrete motion.
"""

from __future__ import annotations

from collections.abc import Callable
from ctypes import CDLL, c_double, c_long, c_void_p
from dataclasses import dataclass
from time import process_time

import casadi as ca
import numpy as np
from tools.built import library
from tools.record import save, table

import varint as vi

TURNS = 41
BACKENDS = "compiled", "native"
SAME = 1e-10  # ends: no other rule and no other stopping level comes so near
LINKS, A, B = 32, 0.25, 0.1
GRAVITY, STIFFNESS, SLOPE, FLOOR, RESTITUTION = 9.81, 40.0, 0.2, -1.5, 0.95


@dataclass(frozen=True)
class Case:
    """A run, and the function that takes (q, v) at the start to (q, v) at its end by hand."""

    about: str
    system: vi.System
    rule: vi.Rule
    q0: np.ndarray
    v0: np.ndarray
    h: float
    steps: int
    by_hand: Callable[[np.ndarray, np.ndarray], None]


def chain() -> list[Case]:
    q, v = vi.coordinates(*(f"x{i}" for i in range(LINKS)))
    d = ca.vertcat(q, 0) - ca.vertcat(0, q)
    potential = ca.sum1(d**2 / 2 + A * d**3 / 3 + B * d**4 / 4)
    system = vi.System(q, v, ca.sumsqr(v) / 2 - potential)
    built = library(f"#define N {LINKS}\n#define A {A}\n#define B {B}\n", "by_hand/chain.c")
    place = np.arange(1, LINKS + 1) * np.pi / (LINKS + 1)
    start = 0.2 * np.sin(place) + 0.1 * np.sin(5 * place), np.zeros(LINKS)
    h, steps = 0.1, 10_000
    pushed = vi.composition("blanes-moan6")
    kicks, drifts = np.array(pushed.kicks), np.array(pushed.drifts)
    rule = vi.gauss(4)
    nodes, weights = np.array(rule.nodes), np.array(rule.weights)
    powers = np.vander(nodes, increasing=True)
    upper = nodes[:, None] * powers / np.arange(1, 5)
    once = upper @ np.linalg.inv(powers)  # a_ij: integrals of the polynomials that are 1 at c_j
    twice = np.ascontiguousarray(once @ once)
    # polynomials through the stages of two steps, at those of the next
    behind = np.vander(np.concatenate([nodes - 1, nodes]), increasing=True)
    further = np.vander(nodes + 1, len(behind), increasing=True) @ np.linalg.inv(behind)

    def composed(q: np.ndarray, v: np.ndarray) -> None:
        call(built, "composition", q, v, h, steps, len(kicks), kicks, drifts)

    def collocated(q: np.ndarray, v: np.ndarray) -> None:
        call(built, "gauss", q, v, h, steps, nodes, twice, weights, further.copy())

    about = f"chain of {LINKS} springs"
    return [
        Case(about, system, pushed, *start, h, steps, composed),
        Case(about, system, rule, *start, h, steps, collocated),
    ]


def ball() -> list[Case]:
    q, v = vi.coordinates("x", "y")
    stretched = ca.norm_2(q) - 1
    L = ca.sumsqr(v) / 2 - GRAVITY * q[1] - STIFFNESS * stretched**2 / 2
    slope = q[1] - FLOOR - SLOPE * q[0]
    system = vi.System(q, v, L, contact=slope, restitution=RESTITUTION)
    numbers = {
        "GRAVITY": GRAVITY,
        "STIFFNESS": STIFFNESS,
        "SLOPE": SLOPE,
        "FLOOR": FLOOR,
        "RESTITUTION": RESTITUTION,
    }
    text = "".join(f"#define {name} ({value})\n" for name, value in numbers.items())
    built = library(text, "by_hand/ball.c")
    h, steps = 0.01, 10_000

    def bounced(q: np.ndarray, v: np.ndarray) -> None:
        state = np.concatenate([q, v])
        hits = call(built, "run", state, h, steps)
        assert hits > 0, hits
        q[:], v[:] = state[:2], state[2:]

    start = np.array([0.3, -0.7]), np.array([0.5, -1.0])
    return [Case("ball on a slope", system, vi.lobatto(3), *start, h, steps, bounced)]


def crank() -> list[Case]:
    model = vi.models.slider_crank()
    c = model.system.defaults
    bodies = [c[name] for name in ("m1", "m1", "J1", "m2", "m2", "J2", "m3", "m3", "J3")]
    text = f"#define L1 {c['l1']}\n#define L2 {c['l2']}\n#define GRAVITY {c['gravity']}\n"
    text += f"#define MASSES {', '.join(str(float(m)) for m in bodies)}\n"
    built = library(text, "by_hand/crank.c")
    masses = np.array(bodies, float)
    h, steps = 1e-3, 5000

    def loop(name: str) -> Callable[[np.ndarray, np.ndarray], None]:
        def run(q: np.ndarray, v: np.ndarray) -> None:
            p = masses * v
            assert call(built, name, q, p, h, steps) > 0
            v[:] = p / masses

        return run

    return [
        Case("slider crank", model.system, rule, model.q0, model.v0, h, steps, loop(name))
        for rule, name in ((vi.trapezoidal(), "rattle"), (vi.lobatto(3), "lobatto"))
    ]


def call(built: CDLL, name: str, *arguments: np.ndarray | float) -> int:
    """A function of the library, arrays by their memory, whole numbers as `long`."""
    function = built[name]
    function.restype = c_long
    return function(*map(_in_c, arguments))


def _in_c(x: np.ndarray | float) -> c_void_p | c_long | c_double:
    if isinstance(x, np.ndarray):
        return c_void_p(x.ctypes.data)
    return c_long(x) if isinstance(x, int) else c_double(x)


def measure(case: Case) -> dict[str, object]:
    """Microseconds a step of all ways, taking turns; their ends side by side."""

    def varint(backend: str) -> vi.Trajectory:
        return vi.simulate(
            case.system,
            case.rule,
            q0=case.q0,
            v0=case.v0,
            h=case.h,
            steps=case.steps,
            save_every=case.steps,
            backend=backend,
        )

    motions = {backend: varint(backend) for backend in BACKENDS}
    q, v = case.q0.copy(), case.v0.copy()
    case.by_hand(q, v)
    end = motions["compiled"]
    difference = float(abs(end.q[-1] - q).max() / abs(end.q).max())
    if not difference < SAME:
        raise SystemExit(f"{case.about}, {case.rule.name}: ends differ by {difference:.1e}")

    def hand() -> None:
        case.by_hand(case.q0.copy(), case.v0.copy())

    ways: dict[str, Callable[[], object]] = {"by hand": hand}
    ways |= {backend: lambda backend=backend: varint(backend) for backend in BACKENDS}
    times: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(TURNS):
        for name, way in ways.items():
            began = process_time()
            way()
            times[name].append(process_time() - began)
    row: dict[str, object] = {"scene": case.about, "rule": case.rule.name, "steps": case.steps}
    row |= {f"{name}, µs a step": min(t) / case.steps * 1e6 for name, t in times.items()}
    for backend in BACKENDS:
        row[f"{backend}/hand"] = min(times[backend]) / min(times["by hand"])
        row[f"{backend}/hand, medians"] = float(
            np.median(times[backend]) / np.median(times["by hand"])
        )
    return row | {"difference": difference}


def main() -> None:
    rows = [measure(case) for make in (chain, ball, crank) for case in make()]
    table(rows)
    save("by_hand", rows)


if __name__ == "__main__":
    main()
