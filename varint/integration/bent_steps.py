"""Steps in which a force bends sharply with the velocity: smoothed dry friction, drag by v |v|.

Steps that resolve all else err there alone, each by what the place of the bend within it makes of
it: of two runs the finer one may err by more than the coarse one, and what differences tell of an
order is luck. The highest coefficients of the force along the way, in Legendre polynomials, show
which steps these are; done once more in parts they show what each of them errs by. Their
sum was 0.3 to 80 times the error of the run in 98 of 100 random ones.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np

from varint.integration.force_bounds import push
from varint.integration.narrow_places import PARTS, parted_by, scales_with_momenta
from varint.numerics.operations import operations_of
from varint.rules.rule import Rule
from varint.scene.memory import per_scene
from varint.scene.system import System

# of what is wanted: most last two runs are no further apart, which counts on no order. All 18 of
# 65,000 random calls that erred by more than was asked without a word had runs further apart
CLOSE = 0.25
LOW = 6  # order of rules below which errors are made in all steps: none of them is luck
MOST_LOOKS = 16  # at the force in a step: as many as the rule has orders, no more
# of what all steps may make: coefficients of one that is done once more. They are mostly larger
# than its error, seldom a tenth of it
BENT = 0.03
SURE = 3.0  # times the sum that is found, for errors that grow
_POLYNOMIAL = frozenset(("assign", "lift", "neg", "add", "sub", "mul", "sq", "twice"))
_POWERS = frozenset(("pow", "constpow"))


@per_scene
def bends_with_velocity(system: System) -> bool:
    """Whether forces depend on velocities, and not as polynomials do."""
    s = system
    if not s.structure.force_on_velocity:
        return False
    others = ca.vertcat(s.q, s.t, s.control, s.c)
    operations = operations_of(ca.Function("f", [s.v, others], [ca.densify(s.force)])).nodes
    depends: list[bool] = []
    for name, *taken in operations:
        if name in ("const", "input"):
            depends.append(name == "input" and taken[0] == 0)
            continue
        on_v = [depends[i] for i in taken]
        if any(on_v) and not (
            name in _POLYNOMIAL
            or (name == "div" and not on_v[1])
            or (name in _POWERS and _is_whole(operations[taken[1]]))
        ):
            return True
        depends.append(any(on_v))
    return False


def _is_whole(node: tuple) -> bool:
    return node[0] == "const" and node[1] >= 0 and float(node[1]).is_integer()


def looks_at_bends(system: System, rule: Rule) -> np.ndarray | None:
    """Parts of a step at which forces are looked at, and what makes their two highest Legendre
    coefficients of the values there, (3, m); None where no step errs by luck.
    """
    if rule.order < LOW or not rule.nodes or not bends_with_velocity(system):
        return None
    return _looks(min(rule.order, MOST_LOOKS))


@cache
def closer_looks(count: int) -> np.ndarray:
    """`looks_at_bends` so often and at both ends, (5, m + 2): behind what makes the two highest
    coefficients stands what makes of forces how far those at the ends are off the polynomial
    through all others, as a part of the step that no other look is in.
    """
    x, weights = np.polynomial.legendre.leggauss(count)
    degrees = np.arange(count)
    values = np.polynomial.legendre.legvander(x, count - 1) * weights[:, None] * (degrees + 0.5)
    found = np.zeros((5, count + 2))
    found[0], found[1:3, 1:-1] = [0.0, *(1 + x) / 2, 1.0], values[:, -2:].T
    found[3:, 1:-1] = (values @ (-1.0) ** degrees, values.sum(axis=1))
    found[3, 0] = found[4, -1] = -1.0
    found[3:] *= found[0, 1]
    return found


@cache
def _looks(count: int) -> np.ndarray:
    x, weights = np.polynomial.legendre.leggauss(count)
    degrees = np.arange(count)
    values = np.polynomial.legendre.legvander(x, count - 1) * weights[:, None] * (degrees + 0.5)
    return np.ascontiguousarray([(1 + x) / 2, *values[:, -2:].T])


def made_by_bends(
    system: System,
    rule: Rule,
    rows: np.ndarray,
    when: tuple[float, float],
    c: np.ndarray,
    scales: np.ndarray,
    wanted: float,
    again: Callable[[int, int], np.ndarray | None],
) -> float:
    """What steps err by in which forces bend sharply with velocities, or more than is wanted;
    infinite where they cannot be done once more.

    Parameters
    ----------
    system : System
    rule : Rule
    rows : array (N + 1, 3, n)
        q, p and v of nodes.
    when : tuple of float
        The first time, and the step.
    c : array
    scales : array (n,)
        Of coordinates.
    wanted : float
        What all steps may make.
    again : callable
        (node, count) → nodes of so many of the `PARTS` of steps from there; None where they fail.
    """
    looks = looks_at_bends(system, rule)
    if looks is None:
        return 0.0
    made, both = 0.0, scales_with_momenta(rows, scales)
    sharp = (_sharpness(system, looks, rows, when, c) / both[1]).max(axis=1)
    bent = ~(sharp * len(sharp) <= BENT * wanted)
    ends = np.flatnonzero(np.diff(bent, prepend=False, append=False))
    for first, last in zip(ends[::2].tolist(), ends[1::2].tolist(), strict=True):
        fine = again(first, PARTS * (last - first))
        if fine is None:
            return math.inf
        apart = parted_by(fine[::PARTS, :2], rows[first : last + 1, :2], both)
        made += SURE * float(apart.max())
        if made > wanted:
            break
    return made


def _sharpness(
    system: System,
    looks: np.ndarray,
    rows: np.ndarray,
    when: tuple[float, float],
    c: np.ndarray,
) -> np.ndarray:
    """Impulses (N, n) of the two highest coefficients in every step."""
    (q, _, v), (begin, h), count = rows.swapaxes(0, 1), when, len(rows) - 1
    t = (begin + h * np.arange(count))[:, None]
    seen = np.zeros((2, count, q.shape[1]))
    for x, *highest in looks.T:
        one, y = x * x * (3 - 2 * x), 1 - x  # Hermite's cubic polynomial, and its slope
        way = q[1:] - q[:-1]
        place = q[:-1] + one * way + h * (x * y) * (y * v[:-1] - x * v[1:])
        speed = 6 * x * y / h * way + y * (1 - 3 * x) * v[:-1] + x * (1 - 3 * y) * v[1:]
        force = push(system)(c, place, speed, t + x * h)[0]
        seen += np.multiply.outer(highest, force)
    impulses: np.ndarray = np.abs(seen).sum(axis=0) * abs(h)
    return impulses
