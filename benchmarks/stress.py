"""Scenes that break integrators, and what of each survives: `python benchmarks/stress.py` prints
one line a scene.

Every function returns what it measured; `tests/integration/test_stress.py` bounds the same numbers
for shorter runs.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from time import perf_counter

import casadi as ca
import numpy as np
from tools.record import save

import varint as vi
from varint.rules.compositions import COMPOSITIONS

RULES = [
    *(vi.gauss(stages) for stages in range(1, 11)),
    *(vi.lobatto(stages) for stages in range(2, 11)),
    *(vi.composition(name) for name in COMPOSITIONS),
]
GROWS = 2 + 1e-9  # |trace| of a step that is not stable


def oscillator() -> vi.System:
    q, v = vi.coordinates("x")
    return vi.System(q, v, v**2 / 2 - q**2 / 2)


def traces(rule: vi.Rule, h_omega: np.ndarray) -> np.ndarray:
    """|trace| of one step of the harmonic oscillator, by exact derivatives: above 2 the
    (symplectic) step grows.
    """
    step = vi.step_function(oscillator(), rule)
    q, p, h = ca.MX.sym("q"), ca.MX.sym("p"), ca.MX.sym("h")
    out = step(q0=q, p0=p, t=0, h=h, u=ca.DM(0, len(rule.nodes)), params=ca.DM(0, 1))
    trace = ca.jacobian(out["q1"], q) + ca.jacobian(out["p1"], p)
    function = ca.Function(
        "trace", [h], [ca.substitute(trace, ca.vertcat(q, p), ca.DM([0.3, 0.4]))]
    )
    return np.abs(np.array(function.map(len(h_omega))(h_omega))).ravel()


def stability_limit(rule: vi.Rule, most: float = 30.0, grid: float = 1e-3) -> float:
    """The first hω at which a step grows, to 1e-3, scanned up to `most` (∞ if there is none)."""
    h = np.arange(grid, most, grid)
    grows = traces(rule, h) > GROWS
    return float(h[np.argmax(grows)]) if grows.any() else np.inf


def stability_in_theory(rule: vi.Rule, most: float = 30.0, grid: float = 1e-3) -> float:
    """The same from the literature: Gauss rules are stable, Lobatto rules the partitioned Lobatto
    IIIA–IIIB pair (Hairer, Lubich & Wanner II.2.2), compositions products of kicks and drifts."""
    if rule.points and rule.points != rule.nodes:
        return np.inf
    grows = (abs(_trace_in_theory(rule, h)) > GROWS for h in np.arange(grid, most, grid))
    return next((float((i + 1) * grid) for i, unstable in enumerate(grows) if unstable), np.inf)


def _trace_in_theory(rule: vi.Rule, h: float) -> float:
    """Trace of one step of q' = p, p' = −q."""
    if not rule.points:
        matrix = np.eye(2)
        for i, kick in enumerate(rule.kicks):
            if i:
                matrix = np.array([[1.0, rule.drifts[i - 1] * h], [0.0, 1.0]]) @ matrix
            matrix = np.array([[1.0, 0.0], [-kick * h, 1.0]]) @ matrix
        return float(np.trace(matrix))
    a, other, b = _lobatto_pair(len(rule.nodes))
    ones, eye = np.ones(len(b)), np.eye(len(b))
    stages = np.linalg.solve(
        np.block([[eye, -h * a], [h * other, eye]]), np.kron(np.eye(2), ones[:, None])
    )
    q, p = stages[: len(b)], stages[len(b) :]
    return float(1 + h * b @ p[:, 0] + 1 - h * b @ q[:, 1])


@cache
def _lobatto_pair(stages: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tables of Lobatto IIIA and IIIB, and the weights: b_i â_ij + b_j a_ji = b_i b_j."""
    legendre = np.polynomial.legendre.Legendre.basis(stages - 1)
    c = (1 + np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])) / 2
    powers = np.arange(1, stages + 1)
    inverse = np.linalg.inv(c[:, None] ** (powers - 1))
    a = (c[:, None] ** powers / powers) @ inverse
    return a, a[-1] - a.T * a[-1] / a[-1][:, None], a[-1]


def energy_error(motion: vi.Trajectory) -> float:
    """Largest energy error relative to the largest kinetic energy."""
    kinetic = np.abs((motion.p * motion.v).sum(axis=1)).max() / 2
    return float(np.abs(motion.energy - motion.energy[0]).max() / kinetic)


def chaotic_double_pendulum(duration: float = 1000.0, h: float = 0.01) -> float:
    """Energy error of the double pendulum released at rest from (π/2, π/2)."""
    q, v = vi.coordinates("a", "b")
    kinetic = v[0] ** 2 + v[1] ** 2 / 2 + v[0] * v[1] * ca.cos(q[0] - q[1])
    system = vi.System(q, v, kinetic + 9.81 * (2 * ca.cos(q[0]) + ca.cos(q[1])))
    motion = vi.simulate(
        system,
        vi.gauss(6),
        q0=[np.pi / 2, np.pi / 2],
        v0=[0, 0],
        h=h,
        duration=duration,
        save_every=10,
    )
    return energy_error(motion)


def stiff_chain(h_omega: float, duration: float = 200.0) -> tuple[float, float]:
    """(energy error, change of the invariants) of the Fermi–Pasta–Ulam chain with ω = 50 by
    gauss(2).
    """
    model = vi.models.fpu_chain()
    omega = 50.0
    motion = vi.simulate(
        model.system,
        vi.gauss(2),
        q0=model.q0,
        v0=model.v0,
        h=h_omega / omega,
        steps=int(duration * omega / h_omega),
    )
    values = (
        [motion.value(x) for x in model.invariants.values()]
        if model.invariants
        else [motion.energy]
    )
    drift = max(float(np.ptp(x) / max(np.abs(x).max(), 1e-300)) for x in values)
    return energy_error(motion), drift


def near_collision(e: float, steps_an_orbit: int = 4000, orbits: int = 3) -> str:
    """What a fixed step makes of a Kepler ellipse of eccentricity e from its far end: a result,
    an alarm, a refusal.
    """
    q, v = vi.coordinates("x", "y")
    system = vi.System(q, v, ca.sumsqr(v) / 2 + 1 / ca.norm_2(q))
    start = dict(q0=[1 + e, 0], v0=[0, np.sqrt((1 - e) / (1 + e))], h=2 * np.pi / steps_an_orbit)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            motion = vi.simulate(system, vi.gauss(4), steps=orbits * steps_an_orbit, **start)
        except vi.ConvergenceError as error:
            return f"refused at t = {error.time:.3f}: {error.cause.split(':')[0]}"
    size = f"energy error {energy_error(motion):.1e}"
    return f"alarm, {size}" if caught else size


def gimbal_lock(angle: float) -> str:
    """A fast heavy top in Euler angles that passes within `angle` of the pole of its
    coordinates.
    """
    model = vi.models.heavy_top()
    q0 = np.array(model.q0, dtype=float)
    q0[list(model.system.names).index("theta")] = angle
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            motion = vi.simulate(model.system, vi.gauss(4), q0=q0, v0=model.v0, h=1e-3, steps=2000)
        except (vi.ConvergenceError, vi.InputError) as error:
            return f"refused: {str(error)[:90]}"
    return f"{'alarm, ' if caught else ''}energy error {energy_error(motion):.1e}"


def folding_linkage(angle: float, h: float) -> str:
    """A parallelogram of four bars driven through the configuration in which it is flat, from an
    angle before it.

    There its constraints lose their rank, and it may go on as a parallelogram or as an
    antiparallelogram.
    """
    q, v = vi.coordinates("x1", "y1", "x2", "y2")
    bars = ca.vertcat(
        ca.sumsqr(q[:2]) - 1, ca.sumsqr(q[2:] - q[:2]) - 4, ca.sumsqr(q[2:] - ca.DM([2.0, 0])) - 1
    )
    linkage = vi.System(q, v, ca.sumsqr(v) / 2, constraint=bars)
    c, s = np.cos(angle), np.sin(angle)
    start = dict(q0=[c, s, 2 + c, s], v0=[2 * s, -2 * c, 2 * s, -2 * c])
    try:
        motion = vi.simulate(linkage, vi.lobatto(3), h=h, steps=round(2 / h), **start)
    except (vi.ConvergenceError, vi.InputError) as error:
        return f"refused: {str(error)[:110]}"
    gap = float(np.abs(motion.value(linkage.constraint)).max())
    kept = np.abs(motion.q[-1, 3] - motion.q[-1, 1]) < 1e-3
    return (
        f"passed as {'a ' if kept else 'an anti'}parallelogram, |g| {gap:.1e}, energy error "
        f"{energy_error(motion):.1e}"
    )


def random_lagrangian(rng: np.random.Generator) -> tuple[vi.System, dict]:
    """A scene of one to three coordinates with a random potential, coupling and mass, and a
    random start.
    """
    n = int(rng.integers(1, 4))
    q, v = vi.coordinates(*"xyz"[:n])

    def expression(symbols: list[ca.SX], depth: int) -> ca.SX:
        if depth == 0 or rng.random() < 0.2:
            return (
                symbols[rng.integers(len(symbols))]
                if rng.random() < 0.7
                else ca.SX(rng.uniform(-2, 2))
            )
        if rng.random() < 0.5:
            functions = (
                ca.sin,
                ca.cos,
                ca.exp,
                ca.sqrt,
                ca.log,
                ca.tanh,
                lambda x: x**2,
                lambda x: 1 / x,
            )
            return functions[rng.integers(len(functions))](expression(symbols, depth - 1))
        a, b = expression(symbols, depth - 1), expression(symbols, depth - 1)
        return (a + b, a * b, a - b, a / b)[rng.integers(4)]

    places = ca.vertsplit(q)
    kinetic = ca.sumsqr(v) / 2 * (1 if rng.random() < 0.5 else 1 + expression(places, 2) ** 2)
    system = vi.System(q, v, kinetic - expression(places, 4))
    h = float(rng.choice([1e-3, 0.01, 0.1, 1.0]))
    return system, dict(q0=rng.uniform(-2, 2, n), v0=rng.uniform(-2, 2, n), h=h, steps=50)


def random_lagrangians(count: int, seed: int = 1) -> str:
    """How many random scenes run, raise the alarm, or are refused; any other end is an error."""
    rng = np.random.default_rng(seed)
    ends = {"ran": 0, "raised the alarm": 0, "failed on the way": 0, "were refused": 0}
    for _ in range(count):
        system, start = random_lagrangian(rng)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                motion = vi.simulate(system, backend="interpreted", **start)
                end = "raised the alarm" if caught else "ran"
            except vi.ConvergenceError as error:
                motion, end = error.trajectory, "failed on the way"
            except vi.InputError:
                motion, end = None, "were refused"
        if motion is not None and not (np.isfinite(motion.q).all() and np.isfinite(motion.p).all()):
            raise AssertionError(f"a motion of {system.lagrangian} is not finite")
        ends[end] += 1
    return ", ".join(f"{number} {end}" for end, number in ends.items())


def hanging_chain(links: int) -> tuple[vi.System, np.ndarray]:
    """A chain of rods in Cartesian coordinates, and its start stretched out sideways."""
    names = [f"{axis}{i}" for i in range(links) for axis in "xy"]
    q, v = vi.coordinates(*names)
    points = [ca.SX.zeros(2), *(q[2 * i : 2 * i + 2] for i in range(links))]
    length = 1.0 / links
    rods = ca.vertcat(*(ca.sumsqr(b - a) / (2 * length) - length / 2 for a, b in pairwise(points)))
    heights = ca.sum1(ca.vertcat(*(q[2 * i + 1] for i in range(links))))
    system = vi.System(q, v, (ca.sumsqr(v) / 2 - 9.81 * heights) / links, constraint=rods)
    start = np.zeros(2 * links)
    start[::2] = length * np.arange(1, links + 1)
    return system, start


def whipping_chain(links: int, steps: int, h: float = 1e-4) -> tuple[float, float]:
    """(largest |g| relative to a link, energy error) of a chain of rods let go from the
    horizontal.
    """
    system, start = hanging_chain(links)
    motion = vi.simulate(
        system, vi.lobatto(2), q0=start, v0=np.zeros(2 * links), h=h, steps=steps, save_every=10
    )
    gap = float(np.abs(motion.value(system.constraint)).max()) * links
    return gap, energy_error(motion)


def round_off_drift(steps: int) -> tuple[float, float]:
    """(slope, size) of the relative energy error of the pendulum by blanes-moan4 over many
    steps, sampled.
    """
    q, v = vi.coordinates("theta")
    system = vi.System(q, v, v**2 / 2 + ca.cos(q))
    every = max(steps // 2000, 1)
    motion = vi.simulate(
        system, vi.composition("kahan-li8"), q0=1.0, v0=0.0, h=0.05, steps=steps, save_every=every
    )
    error = (motion.energy - motion.energy[0]) / abs(motion.energy[0])
    half = len(error) // 2
    return float(error[half:].mean() - error[:half].mean()), float(np.abs(error).max())


def units(length: float, time: float, mass: float, rule: vi.Rule) -> float:
    """How far a Kepler orbit in polar coordinates in these units is from the same orbit in units
    of one.
    """

    def orbit(length: float, time: float, mass: float) -> np.ndarray:
        q, v = vi.coordinates("r", "phi")
        kinetic = (v[0] ** 2 + q[0] ** 2 * v[1] ** 2) / 2
        system = vi.System(q, v, mass * (kinetic + length**3 / time**2 / q[0]))
        start = dict(
            q0=[0.4 * length, 0.0],
            v0=[0.0, 5.0 / time],
            h=0.02 * time,
            steps=300,
            backend="interpreted",
        )
        return vi.simulate(system, rule, **start).q / [length, 1.0]

    return float(np.abs(orbit(length, time, mass) - orbit(1.0, 1.0, 1.0)).max())


def report(rows: list[dict], name: str, call: Callable[[], str]) -> None:
    began = perf_counter()
    found = call()
    rows.append({"what": name, "found": found})
    print(f"{name:48} {found}   [{perf_counter() - began:.1f} s]", flush=True)


def main() -> None:
    rows: list[dict] = []
    for rule in RULES:
        found = (stability_limit(rule), stability_in_theory(rule))
        words = ["none to 30" if limit == np.inf else f"{limit:.3f}" for limit in found]
        report(
            rows,
            f"stability limit hω of {rule}",
            lambda words=words: "{}, in theory {}".format(*words),
        )
    report(
        rows,
        "double pendulum from (π/2, π/2), T = 1000",
        lambda: f"energy error {chaotic_double_pendulum():.1e}",
    )
    for h_omega in (0.5, 5.0, 30.0):
        report(
            rows,
            f"FPU chain, hω = {h_omega:g}",
            lambda h=h_omega: "energy error {:.1e}, invariants {:.1e}".format(*stiff_chain(h)),
        )
    for e in (0.9, 0.99, 0.999, 0.9999, 1 - 1e-8):
        report(rows, f"Kepler, e = {e:.9g}, 4000 steps an orbit", lambda e=e: near_collision(e))
    for angle in (1e-1, 1e-2, 1e-4, 1e-8, 0.0):
        report(rows, f"heavy top, {angle:g} from the pole", lambda angle=angle: gimbal_lock(angle))
    for angle, h in ((0.0, 1e-2), (1.0, 1e-2), (1.0, 1e-3), (1.0, 3.7e-3)):
        report(
            rows,
            f"parallelogram, {angle:g} before it folds, h = {h:g}",
            lambda a=angle, h=h: folding_linkage(a, h),
        )
    report(rows, "2000 random Lagrangians", lambda: random_lagrangians(2000))
    text = "|g| {:.1e} of a link, energy error {:.1e}"
    for links, steps in ((20, 20_000), (200, 5000)):
        report(
            rows,
            f"chain of {links} rods, {steps} steps",
            lambda n=links, k=steps: text.format(*whipping_chain(n, k)),
        )
    drift = "mean drift {:.1e}, largest {:.1e}"
    report(rows, "pendulum, 1e8 steps", lambda: drift.format(*round_off_drift(10**8)))
    scales = (1e-20, 1.0, 1e20)
    for rule in (vi.gauss(2), vi.lobatto(3), vi.gauss(8)):
        worst = max(units(a, b, c, rule) for a in scales for b in scales for c in scales)
        report(rows, f"units 1e-20 to 1e20, {rule}", lambda worst=worst: f"differ by {worst:.1e}")
    save("stress", rows)


if __name__ == "__main__":
    main()
