"""Many steps at once, each from its own state and of its own size: by the loop of the scene where
there is one, else by the interpreted step.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from varint.numerics.arrays import over_columns
from varint.results.records import StepsAgain
from varint.rules.rule import Rule
from varint.scene.system import System

if TYPE_CHECKING:
    from varint.codegen.kernel import Kernel

# (q, p, u, t, h) of many steps, each of its own size → q and p at their ends
Steps = Callable[..., tuple[np.ndarray, np.ndarray]]


def steps_of(system: System, rule: Rule, kernel: Kernel | None, c: np.ndarray) -> Steps:
    """By a compiled loop, where there is one and it can."""
    from varint.integration.step_function import step_function

    def interpreted(
        q: np.ndarray, p: np.ndarray, u: np.ndarray, t: np.ndarray, h: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        found = over_columns(step_function(system, rule), q, p, u, c, t[:, None], h[:, None])
        return found[0], found[1]

    def compiled(
        q: np.ndarray, p: np.ndarray, u: np.ndarray, t: np.ndarray, h: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        from varint.codegen.kernel import take_parts

        assert kernel is not None
        rows, good = take_parts(kernel, q, p, c, t=t, h=h, u=u)
        ends = rows[:, 0].copy(), rows[:, 1].copy()
        if not good.all():
            bad = np.flatnonzero(~good)
            for kept, new in zip(
                ends, interpreted(q[bad], p[bad], u[bad], t[bad], h[bad]), strict=True
            ):
                kept[bad] = new
        return ends

    return interpreted if kernel is None else compiled


def in_gear(rule: Rule, system: System, c: np.ndarray) -> Steps:
    """By the loop that is there at once."""
    from varint.integration.compiled_loop import kernel_in_gear

    return steps_of(system, rule, kernel_in_gear(system, rule), c)


def interpreted(rule: Rule, system: System, c: np.ndarray) -> Steps:
    """By CasADi's own interpreter."""
    return steps_of(system, rule, None, c)


@lru_cache(maxsize=64)
def steps_again(
    rule: Rule, by: Callable[[Rule, System, np.ndarray], Steps] = in_gear
) -> StepsAgain:
    """How the steps of a motion by a rule are taken once more."""
    at_once = _at_once if by is in_gear else None
    return StepsAgain(partial(by, rule), partial(_action, rule), by is interpreted, at_once)


def _at_once(motion: Any, times: np.ndarray) -> tuple[np.ndarray, ...] | None:
    from varint.integration.times_at_once import states_by_core

    return states_by_core(motion, times)


def _action(rule: Rule, system: System) -> ca.Function:
    from varint.integration.step_function import action_function

    return action_function(system, rule)
