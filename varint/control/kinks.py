"""Kinks of costs and bounds in the controls: |u|, max(u, 0), a norm of forces. Solvers of smooth
problems run long at them, and fail.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from varint.control.phase import CheckedPhase

MOST_NODES = 2000  # operations of an expression that is looked at (CasADi writes it by recursion)
LONGEST = 40  # letters of an expression in a message
JUMPS = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE)
BENT = (ca.OP_FABS, ca.OP_FMAX, ca.OP_FMIN)  # smooth enough where they are squared
ROOTS = (ca.OP_SQRT, ca.OP_HYPOT)
KINKS = re.compile("fabs|fmax|fmin|sign|sqrt|hypot|[<=]")  # a look a hundred times as fast
ROUNDED = "tanh(x / ε) with a small ε makes a jump smooth"
UNDER = "add a small ε² under the root"
IN_COSTS = {
    ca.OP_FABS: "write vi.abs(…)",
    ca.OP_FMAX: "write vi.max(…, …)",
    ca.OP_FMIN: "(a + b − sqrt((a − b)² + ε²)) / 2 is a smooth minimum",
    ca.OP_SIGN: ROUNDED,
    ca.OP_SQRT: UNDER,
    ca.OP_HYPOT: UNDER,
} | dict.fromkeys(JUMPS, ROUNDED)
IN_BOUNDS = IN_COSTS | {
    ca.OP_FABS: "a bound |x| <= b is (-b, x, b)",
    ca.OP_FMAX: "max(x, y) <= b is (None, x, b), (None, y, b)",
    ca.OP_FMIN: "min(x, y) >= b is (b, x, None), (b, y, None)",
    ca.OP_SQRT: "bound the square of a norm",
    ca.OP_HYPOT: "bound the square of a norm",
}


def warn_of_kinks(phases: list[CheckedPhase], stacklevel: int) -> None:
    """Before a solver starts."""
    if words := kinks_in_words(phases):
        warnings.warn(
            f"{words}. Solvers run long at a kink and may fail; away from it nothing is wrong",
            stacklevel=stacklevel + 1,
        )


def kinks_in_words(phases: list[CheckedPhase]) -> str:
    """Kinks in the controls of what was given, and what to write for them; empty without any."""
    said: list[str] = []
    for phase in phases:
        given, u = phase.given, phase.system.control
        bounds = [x[1] for x in given.bounds or () if isinstance(x, tuple)]
        for where, expressions, cures in (
            ("the cost", (given.cost,), IN_COSTS),
            ("a bound", bounds, IN_BOUNDS),
        ):
            for op, words in [x for e in expressions for x in _kinks(e, u)]:
                said.append(f"{words} in {where} has a kink in the controls: {cures[op]}")
    return "; ".join(dict.fromkeys(said))


def _kinks(expression: Any, u: ca.SX) -> list[tuple[int, str]]:
    """Operations with a kink or jump in these symbols, and how they read."""
    whole = ca.SX(expression)
    if not u.numel() or ca.n_nodes(whole) > MOST_NODES or not KINKS.search(str(whole)):
        return []
    waiting, seen, found = list(whole.nonzeros()), set[int](), list[tuple[int, str]]()
    while waiting:
        node = ca.SX(waiting.pop())
        if not node.n_dep() or node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        op, parts = node.op(), [node.dep(i) for i in range(node.n_dep())]
        bent = op in IN_COSTS and ca.depends_on(node, u)
        if bent and (op not in ROOTS or _vanishes(node, u)):
            words = str(node)
            found.append((op, words if len(words) <= LONGEST else f"{words[:LONGEST]}…"))
        waiting += [y for x in parts for y in _inner(op, x, parts)]
    return found


def _inner(op: int, part: ca.SX, parts: list[ca.SX]) -> list[ca.SX]:
    """An operand, or what is inside it where its kink does not show: |u|², |u| u, max(u, 0)²."""
    if part.op() not in BENT:
        return [part]
    power = op in (ca.OP_POW, ca.OP_CONSTPOW) and parts[1].is_constant() and float(parts[1]) >= 2
    factor = op == ca.OP_MUL and any(
        ca.depends_on(x, ca.vertcat(*ca.symvar(part))) for x in parts if x.op() != part.op()
    )
    hidden = op == ca.OP_SQ or power or factor
    return [part.dep(i) for i in range(part.n_dep())] if hidden else [part]


def _vanishes(node: ca.SX, u: ca.SX) -> bool:
    """Is a root zero where these symbols are, whatever the others are?"""
    others = [x for x in ca.symvar(node) if not ca.depends_on(x, u)]
    at_rest: Callable[..., ca.DM] = ca.Function("root", [ca.vertcat(*others), u], [node])
    values = np.random.default_rng(0).uniform(0.5, 1.5, len(others))
    return float(at_rest(values, np.zeros(u.numel()))) == 0.0
