"""Which conditions contradict each other, where no motion keeps them all.

Ends and bounds are softened, mechanics and links are not, and the sum of all violations is made
least, min Σ w (e⁺ + e⁻) (Chinneck, Feasibility and Infeasibility in Optimization, §6.1). In this
sum few conditions are broken, and by much; the multipliers of the others say which of them stand in
the way.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from varint.control.active import bounded_integrals, bounded_quantities
from varint.control.problem import ControlProblem
from varint.control.scaling import choose_scales
from varint.control.transcription import PhaseTranscription
from varint.nlp.arrangement import plain_order
from varint.nlp.elastic import elastic_scales, soften
from varint.nlp.program import NonlinearProgram, Program
from varint.nlp.solver import SolverResult, build_solver

START = 10.0  # times the price of other conditions: what can be reached from the start is asked
BROKEN = 1e-6  # in units of the problem: a condition off by less is kept
PULLS = 1e-3  # of the price of a violation: multipliers below this do not stand in the way
ACTS = 1e-2  # of a condition's largest multiplier: the times where it stands in the way
LISTED = 8  # conditions in a message
ITERATIONS = 500


@dataclass(frozen=True, eq=False)
class Condition:
    """Something asked of a motion: its name, what holds it in the program, and when (NaN: once)."""

    name: str
    held: np.ndarray
    times: np.ndarray
    is_row: bool
    price: float = 1.0


@dataclass(frozen=True, eq=False)
class Contradiction:
    """The motion that violates the conditions least.

    Attributes
    ----------
    x : ndarray
        The unknowns of that motion.
    broken : tuple of (str, float, (float, float))
        Conditions that it breaks, by how much at most (negative: below), and from when to when.
    opposed : tuple of (str, (float, float))
        Conditions that it keeps and that stand in the way of the others.
    """

    x: np.ndarray
    broken: tuple[tuple[str, float, tuple[float, float]], ...]
    opposed: tuple[tuple[str, tuple[float, float]], ...]

    def __str__(self) -> str:
        if not self.broken:
            return "all conditions can be kept"
        broken = [
            f"{name} is {abs(size):.3g} too {'high' if size > 0 else 'low'}{_when(span)}"
            for name, size, span in self.broken[:LISTED]
        ]
        opposed = [f"{name}{_when(span)}" for name, span in self.opposed[:LISTED]]
        return (
            f"in the motion nearest to all of them {'; '.join(broken)}; in the way of that stand "
            f"{', '.join(opposed) or 'the equations of motion'}"
        )


def least_violation(problem: ControlProblem, outcome: SolverResult) -> Contradiction | None:
    """The motion near the last iterate that violates ends and bounds least; None where none is
    found.
    """
    nlp, x = outcome.nlp, outcome.x
    if not np.isfinite(x).all():
        return None
    conditions = [c for part in problem.phases for c in _conditions(part, outcome)]
    rows, unknowns = (
        np.unique(np.concatenate([c.held for c in conditions if c.is_row is kind] + [_NONE]))
        for kind in (True, False)
    )
    scales = replace(choose_scales(problem, x), f=1.0)
    sizes = np.append(1 / scales.g[rows], scales.x[unknowns])
    index = np.append(rows, -1 - unknowns)
    price = np.ones(len(index))
    for condition in conditions:
        price[np.isin(index, _keys(condition))] = condition.price
    elastic = soften(_without_cost(nlp), rows, unknowns, price / sizes)
    solver = build_solver(
        elastic.nlp,
        "ipopt",
        {"ipopt": {"max_iter": ITERATIONS}},
        elastic_scales(elastic, scales),
        plain_order(elastic.nlp),
    )
    found = solver(elastic.start(x), progress=False)
    if not found.success:
        return None
    excess = dict(zip(index.tolist(), (elastic.excess(found.x) / sizes).tolist(), strict=True))
    pulls = np.append(found.lam_g[rows], found.lam_g[nlp.rows :]) * sizes
    pull = dict(zip(index.tolist(), np.abs(pulls).tolist(), strict=True))
    unit = dict(zip(index.tolist(), sizes.tolist(), strict=True))
    broken, opposed = [], []
    for condition in conditions:
        keys = _keys(condition).tolist()
        off = np.array([excess[k] for k in keys])
        pulled = np.array([pull[k] for k in keys])
        if np.abs(off).max(initial=0.0) > BROKEN:
            worst = int(np.argmax(np.abs(off)))
            span = _span(condition.times[np.abs(off) > BROKEN])
            broken.append((condition.name, float(off[worst] * unit[keys[worst]]), span))
        elif pulled.max(initial=0.0) > PULLS:
            opposed.append(
                (condition.name, pulled.max(), _span(condition.times[pulled > ACTS * pulled.max()]))
            )
    broken.sort(key=lambda entry: -abs(entry[1]))
    opposed.sort(key=lambda entry: -entry[1])
    return Contradiction(
        found.x[: nlp.unknowns],
        tuple(broken),
        tuple((name, span) for name, _, span in opposed),
    )


_NONE = np.zeros(0, dtype=int)


def _keys(condition: Condition) -> np.ndarray:
    """Rows, or −1 − i for the unknown i."""
    return condition.held if condition.is_row else -1 - condition.held


def _conditions(part: PhaseTranscription, outcome: SolverResult) -> list[Condition]:
    """What was asked of a phase: its ends, and the bounds along its path."""
    nlp, phase, slots = outcome.nlp, part.phase, part.slots
    found, at_ends = [], set()
    sides = (
        ("start", 0, phase.start, part.rows.start, phase.bounds.at_points.numel()),
        ("end", 1, phase.end, part.rows.last, 0),
    )
    once = np.array([np.nan])
    for side, k, end, rows, others in sides:
        price = 1.0 if k else START
        for letter, names, index, given in (
            ("q", phase.system.names, slots.q[-k], end.q),
            ("v", phase.system.names, slots.v[k], end.v),
            ("states", phase.states.names(phase.system), slots.states[-k], end.states),
        ):
            for i in np.flatnonzero(np.isfinite(given[1:]).any(axis=0)):
                name = f"{side}.{letter}.{names[i]}{_asked(*given[1:, i])}"
                found.append(Condition(name, index[[i]], once, False, price))
                at_ends.add(int(index[i]))
        first = len(rows) - others - end.low.size
        for j in range(end.low.size):
            row, name = rows[[first + j]], f"{end.rows[j]} at the {side}"
            name += _asked(end.low[j], end.high[j])
            found.append(Condition(name, row[row >= 0], once, True, price))
    if phase.free_duration and np.isfinite(phase.duration[1:]).any():
        name = f"duration{_asked(*phase.duration[1:])}"
        found.append(Condition(name, slots.shared[[1]], once, False))
    for quantity in (*bounded_quantities(part, outcome), *bounded_integrals(part, outcome)):
        held = quantity.held.ravel()
        kept = held >= 0
        if not quantity.is_row:
            limited = np.isfinite(nlp.x_low[held]) | np.isfinite(nlp.x_high[held])
            kept &= limited & ~np.isin(held, list(at_ends))
        if kept.any() and quantity.sides():
            name = f"{quantity.name}{_asked(quantity.low, quantity.high)}"
            places, at = np.unique(held[kept], return_index=True)
            times = quantity.times.ravel()[kept][at]
            found.append(Condition(name, places, times, quantity.is_row))
    return found


def _asked(low: float, high: float) -> str:
    if low == high:
        return f" = {low:g}"
    if not np.isfinite(low):
        return f" <= {high:g}"
    return f" >= {low:g}" if not np.isfinite(high) else f" in {low:g} … {high:g}"


def _span(times: np.ndarray) -> tuple[float, float]:
    return float(times.min()), float(times.max())


def _when(span: tuple[float, float]) -> str:
    return "" if np.isnan(span[0]) else f" (t = {span[0]:.4g} … {span[1]:.4g})"


def _without_cost(nlp: NonlinearProgram) -> NonlinearProgram:
    """The same conditions, and nothing to be made least."""
    own = nlp.program
    x, p = ca.MX.sym("x", nlp.unknowns), ca.MX.sym("p", len(nlp.p))
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.rows)
    zero, names = ca.MX.zeros(1), ["x", "p"]
    none = ca.MX.zeros(nlp.unknowns)
    program = Program(
        ca.Function("nlp", [x, p], [zero, own.value(x, p)[1]], names, ["f", "g"]),
        ca.Function("nlp_grad_f", [x, p], [zero, none], names, ["f", "grad_f_x"]),
        own.jacobian,
        ca.Function(
            "nlp_hess_l",
            [x, p, lam_f, lam_g],
            [own.hessian(x, p, 0.0, lam_g)],
            [*names, "lam_f", "lam_g"],
            ["triu_hess_gamma_x_x"],
        ),
    )
    return replace(nlp, program=program)
