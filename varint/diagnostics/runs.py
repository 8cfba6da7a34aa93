"""Runs for diagnostics: by a rule, or by any step function with the signature of
`varint.step_function`.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from varint.discrete.lagrangian import point_function
from varint.discrete.legendre import velocity_function
from varint.errors import InputError
from varint.integration.plan import plan
from varint.integration.problem import RunOptions, Start, initial_value_problem
from varint.integration.simulate import simulate
from varint.integration.step_function import step_function
from varint.numerics.arrays import LARGEST_BLOCK, blocks, call
from varint.numerics.limits import check_memory, check_steps
from varint.rules.rule import Rule
from varint.scene.inputs import finite_array
from varint.scene.restitution import restitution_at
from varint.scene.system import System, parameters_by_name

EPS = np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class Scene:
    """A system, a method and a start.

    Attributes
    ----------
    system : System
    method : Rule or Function
        A rule, or a step function (q0, p0, u, params, t, h) → (q1, p1, residual).
    rule : Rule
        The rule, or for a step function the rule whose nodes its controls are given at.
    q, p : ndarray (n,)
    t : float
    u : ndarray (k,)
        Constant controls.
    c : ndarray
        Parameter values.
    """

    system: System
    method: Rule | ca.Function
    rule: Rule
    q: np.ndarray
    p: np.ndarray
    t: float
    u: np.ndarray
    c: np.ndarray

    @property
    def is_held(self) -> bool:
        """Whether the start lies on constraints, so that it cannot be moved freely."""
        s = self.system.structure
        return bool(s.constraints or s.nonholonomic)

    @property
    def dissipates(self) -> bool:
        """Whether impacts lose energy."""
        return bool((restitution_at(self.system, self.c) < 1).any())

    @property
    def name(self) -> str:
        return str(self.method) if isinstance(self.method, Rule) else self.method.name()

    @property
    def step(self) -> ca.Function:
        """The step function."""
        return (
            step_function(self.system, self.method)
            if isinstance(self.method, Rule)
            else self.method
        )

    @property
    def controls(self) -> np.ndarray:
        """Controls of one step, column by column, as the step function takes them."""
        return np.tile(self.u, self.step.size_in(2)[1]) if self.u.size else np.zeros(0)

    def energy(self, q: np.ndarray, p: np.ndarray, t: np.ndarray) -> np.ndarray:
        """H at states (N, n)."""
        s = self.system
        x, y, time, c = (
            ca.MX.sym("q", len(self.q)),
            ca.MX.sym("p", len(self.q)),
            ca.MX.sym("t"),
            ca.MX.sym("c", self.c.size),
        )
        v = velocity_function(s)(x, y, time, c)
        value = ca.dot(v, y) - point_function(s)(x, v, 0, time, c)[0]
        f = ca.Function("energy", [x, y, time, c], [value])
        return np.array(f(q.T, p.T, t[None], self.c)).ravel()


def scene(system: System, method: Rule | ca.Function | None, start: Start) -> Scene:
    """Checked input of a diagnostic; `method` None: the scene's own rule."""
    rule = plan(system, method if isinstance(method, Rule) else None).rule
    method = rule if method is None else method
    if not isinstance(method, (Rule, ca.Function)):
        raise InputError(
            f"give a rule or a step function like that of step_function(system), got {method!r}"
        )
    k = system.structure.controls
    u = np.zeros(k) if start.u is None else finite_array("u", start.u).reshape(-1)
    start = start._replace(u=u if k else None)
    problem = initial_value_problem(system, rule, start, RunOptions(h=1.0, steps=1))
    if isinstance(method, ca.Function):
        _check_signature(method, system)
    return Scene(system, method, rule, problem.q0, problem.p0, problem.t0, u, problem.c)


def _check_signature(step: ca.Function, system: System) -> None:
    n = system.structure.n
    sizes = (n, n, None, system.c.numel(), 1, 1)
    if (
        step.n_in() != 6
        or step.n_out() < 2
        or any(size is not None and step.numel_in(i) != size for i, size in enumerate(sizes))
    ):
        raise InputError(
            f"{step} is no step function of this system: it must map q0 ({n}), p0 ({n}), u, params "
            f"({system.c.numel()}), t, h to q1, p1 and more, as step_function(system) does"
        )


def march(scene: Scene, h: float, steps: int, q: Any = None, p: Any = None, t: float | None = None):
    """q (N + 1, n), p (N + 1, n) and times (N + 1,) of a run from the scene's start or from (q,
    p) at time t.
    """
    q, p = (scene.q if q is None else q), (scene.p if p is None else p)
    t = scene.t if t is None else t
    if isinstance(scene.method, Rule):
        u = scene.u if scene.u.size else None
        # orders are measured from steps on that are too large: no news here
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "the energy (went|is not defined)")
            motion = simulate(
                scene.system,
                scene.method,
                q0=q,
                p0=p,
                h=h,
                steps=steps,
                t0=t,
                params=parameters_by_name(scene.system, scene.c),
                u=u,
                progress=False,
            )
        # impacts add nodes between those of the grid
        grid = np.unique(motion.k, return_index=True)[1]
        return motion.q[grid], motion.p[grid], motion.t[grid]
    check_steps(float(t), float(h), steps)
    check_memory(f"a run of {steps} steps", (steps + 1) * 2 * len(q), "take fewer steps")
    times = t + h * np.arange(steps + 1)
    n, x, states, k = len(q), np.concatenate([q, p]), [np.concatenate([q, p])[None]], 0
    for count in blocks(steps, LARGEST_BLOCK // 10):
        rolled = _roll(scene.method, count)
        found = call(
            rolled,
            x,
            np.tile(scene.controls, count),
            np.tile(scene.c, count),
            times[k : k + count],
            np.full(count, h),
        )
        states.append(found[0].reshape(count, 2 * n))
        x, k = states[-1][-1].copy(), k + count
    path = np.concatenate(states)
    return path[:, :n], path[:, n:], times


@lru_cache(maxsize=64)
def _roll(step: ca.Function, count: int) -> ca.Function:
    n = step.numel_in(0)
    x, u, c = (
        ca.MX.sym("x", 2 * n),
        ca.MX.sym("u", step.numel_in(2)),
        ca.MX.sym("c", step.numel_in(3)),
    )
    t, h = ca.MX.sym("t"), ca.MX.sym("h")
    q1, p1, *_ = step.call([x[:n], x[n:], ca.reshape(u, *step.size_in(2)), c, t, h])
    one = ca.Function("one", [x, u, c, t, h], [ca.densify(ca.vertcat(q1, p1))])
    return one.mapaccum(count) if count > 1 else one


PASS, FAIL, SKIP = "✓", "✗", "–"


def mark(passed: bool | None) -> str:
    """✓, ✗, or – where a property is not expected of the scene."""
    return SKIP if passed is None else PASS if passed else FAIL
