"""Ways to judge an answer by computing: each returns what is wrong, in words, or nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from varint.discrete.constraints import multiplier_function
from varint.errors import InputError, parsed_or_refused
from varint.notation.names import plain_name
from varint.scene.system import System

CLOSE = 1e-9  # of expressions that are equal, relative to their size: round-off, amply
TYPED = 1e-3  # of numbers as people write them: three digits
STATES = 20  # random ones at which two expressions are compared: one would do almost surely
SPREAD = 1.5  # of coordinates and velocities at these states


def number(answer: Any, wanted: float, unit: str = "") -> str:
    """Wrong where a number is not the wanted one to three digits."""
    [found] = numbers_of(answer, 1)
    if abs(found - wanted) <= TYPED * abs(wanted):
        return ""
    way = "too large" if found > wanted else "too small"
    return f"{found:.6g}{unit and ' ' + unit} is {way}"


def numbers(answer: Any, wanted: Sequence[float] | np.ndarray, what: str) -> str:
    """Wrong where numbers, in any order, are not the wanted ones to three digits."""
    found = np.sort(numbers_of(answer, len(wanted)))
    apart = np.abs(found - np.sort(wanted)) > TYPED * np.abs(np.sort(wanted))
    return f"{found[apart][0]:.6g} is no {what}" if apart.any() else ""


def same_motion(answer: Any, scene: System, states: np.ndarray | None = None) -> str:
    """Wrong where accelerations differ from those of `scene`, at random states or the given ones.

    Lagrangians that differ by a factor or by the total derivative of a function of q have the same
    motions, and are both right.

    Parameters
    ----------
    answer : System
    scene : System
    states : ndarray (k, 2n), optional
        q and v, which obey the constraints of `scene`.
    """
    if not isinstance(answer, System):
        raise InputError(f"the answer must be a varint.System, got {type(answer).__name__}")
    n = scene.structure.n
    if answer.structure.n != n:
        wanted = "one coordinate" if n == 1 else f"{n} coordinates"
        return f"there must be {wanted}, there are {answer.structure.n}"
    for state in random_states(2 * n) if states is None else states:
        q, v = np.split(state, 2)
        off = _off_constraints(answer, q, v)
        found, right = accelerations(answer, q, v), accelerations(scene, q, v)
        for i in range(n):
            size = max(1.0, abs(right[i]))
            if off or not abs(found[i] - right[i]) <= CLOSE * size:
                wrong = f"the acceleration is {found[i]:.3g}, not {right[i]:.3g}"
                return f"at {_state_in_words(scene.names, q, v)} {off or wrong}"
    return ""


def _state_in_words(names: Sequence[str], q: np.ndarray, v: np.ndarray) -> str:
    letters = [plain_name(name, dots) for dots in (0, 1) for name in names]
    return ", ".join(f"{letter} = {x:.3g}" for letter, x in zip(letters, [*q, *v], strict=True))


def _off_constraints(answer: System, q: np.ndarray, v: np.ndarray) -> str:
    """Where the answer's constraints forbid a state."""
    g = ca.vec(answer.constraint)
    rate = ca.jtimes(g, answer.q, answer.v)
    at = ca.Function("g", [answer.q, answer.v, answer.t, answer.c], [ca.vertcat(g, rate)])
    values = at(q, v, 0.0, answer.default_vector).full().ravel()
    return "your constraint does not vanish" if np.abs(values).max(initial=0) > CLOSE else ""


def accelerations(system: System, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """dv/dt (n,) at t = 0, reactions of the constraints included."""
    at = multiplier_function(system)
    controls = np.zeros(system.control.numel())
    return at(q, v, controls, 0.0, system.default_vector)[1].full().ravel()


def conserved(answer: Any, scene: System) -> str:
    """Wrong where a function (q, v) → quantity changes along the motion, or says no more than the
    energy.
    """
    q, v = scene.q, scene.v
    quantity = expression_of(answer, (q, v), 1, "quantity(q, v)")
    state = ca.vertcat(q, v)
    slopes = ca.vertcat(ca.jacobian(quantity, state), ca.jacobian(scene.energy, state))
    at = ca.Function("quantity", [q, v, scene.t, scene.c], [slopes])
    more = False
    for x in random_states(state.numel()):
        here = np.split(x, 2)
        own, energy = at(*here, 0.0, scene.default_vector).full()
        rate = own @ np.concatenate([here[1], accelerations(scene, *here)])
        if not abs(rate) <= CLOSE * max(1.0, np.abs(own).sum()):
            where = f"q = {here[0].round(3)}, v = {here[1].round(3)}"
            return f"at {where} it changes by {rate:.3g} a second"
        across = own - energy * (own @ energy) / (energy @ energy)
        more |= bool(np.abs(across).max() > CLOSE * max(1.0, np.abs(own).max()))
    return "" if more else "it is conserved, but it is a number or a function of the energy alone"


def expression_of(answer: Any, arguments: Sequence[Any], size: int, spelling: str) -> ca.SX:
    """What a function of the reader's makes of CasADi symbols, as a column of `size`."""
    if not callable(answer):
        raise InputError(f"the answer must be a function {spelling}, got {type(answer).__name__}")

    value = answer(*arguments)  # what goes wrong in the reader's own function is told as it is
    parts = value if isinstance(value, (tuple, list, np.ndarray)) else [value]
    column: ca.SX = parsed_or_refused(
        lambda: ca.vertcat(*(ca.vec(ca.SX(x)) for x in parts)),
        lambda: f"{spelling} must return expressions, it returns {value!r}",
    )
    if column.numel() != size:
        raise InputError(f"{spelling} must return {size} expressions, it returns {column.numel()}")
    known = {x.element_hash() for given in arguments for x in ca.vertsplit(given)}
    strange = [str(x) for x in ca.symvar(column) if x.element_hash() not in known]
    if strange:
        raise InputError(f"{spelling} returns symbols other than its arguments: {strange}")
    return ca.densify(column)


def values_of(expression: ca.SX, symbols: Sequence[ca.SX], points: Sequence[Any]) -> np.ndarray:
    """An expression's values at one point."""
    return ca.Function("values", list(symbols), [expression])(*points).full()


def numbers_of(answer: Any, count: int) -> np.ndarray:
    """A number, or several."""
    found: np.ndarray = parsed_or_refused(
        lambda: np.asarray(answer, dtype=float).ravel(),
        lambda: f"the answer must be {count} number{'s' * (count > 1)}, got {answer!r}",
    )
    if found.shape != (count,) or not np.isfinite(found).all():
        raise InputError(f"the answer must be {count} finite numbers, got {answer!r}")
    return found


def random_states(size: int, low: float = -SPREAD, high: float = SPREAD) -> np.ndarray:
    """The same random points (STATES, size) for everybody."""
    return np.random.default_rng(1788).uniform(low, high, (STATES, size))  # Mécanique analytique
