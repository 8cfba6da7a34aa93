"""Runs for diagnostics: by a rule, or by any step function with the signature of `varint.step_function`."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from varint.arrays import LARGEST_BLOCK, blocks, call
from varint.discrete import point_function
from varint.errors import InputError
from varint.grid import affordable, checked_steps
from varint.legendre import velocity_function
from varint.parameters import finite_array
from varint.rules import Rule
from varint.stepping.initial import initial_task
from varint.stepping.plan import plan
from varint.stepping.simulate import simulate
from varint.stepping.step_function import step_function
from varint.system import System


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
        return bool(self.system.structure.contacts and (self.system.restitution < 1).any())

    @property
    def name(self) -> str:
        return str(self.method) if isinstance(self.method, Rule) else self.method.name()

    @property
    def step(self) -> ca.Function:
        """The step function."""
        return step_function(self.system, self.method) if isinstance(self.method, Rule) else self.method

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


def scene(
    system: System,
    method: Rule | ca.Function | None,
    *,
    q0: Any,
    v0: Any,
    p0: Any = None,
    u: Any = None,
    params: Mapping[str, Any] | None = None,
    t0: float = 0.0,
) -> Scene:
    """Checked input of a diagnostic; `method` None: the scene's own rule."""
    rule = plan(system, method if isinstance(method, Rule) else None).rule
    method = rule if method is None else method
    if not isinstance(method, (Rule, ca.Function)):
        raise InputError(f"give a rule or a step function like that of step_function(system), got {method!r}")
    arguments = dict(h=1.0, steps=1, duration=None, t0=t0, params=params, save_every=1)
    k = system.structure.controls
    u = np.zeros(k) if u is None else finite_array("u", u).reshape(-1)
    task = initial_task(system, rule, q0=q0, v0=v0, p0=p0, u=u if k else None, **arguments)  # type: ignore[arg-type]
    if isinstance(method, ca.Function):
        _check_signature(method, system)
    return Scene(system, method, rule, task.q0, task.p0, task.t0, u, task.c)


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
    """q (N + 1, n), p (N + 1, n) and times (N + 1,) of a run from the scene's start or from (q, p) at time t."""
    q, p = (scene.q if q is None else q), (scene.p if p is None else p)
    t = scene.t if t is None else t
    if isinstance(scene.method, Rule):
        values, first = {}, 0
        for name, default in scene.system.defaults.items():
            values[name] = scene.c[first : first + default.size].reshape(default.shape, order="F")
            first += default.size
        u = scene.u if scene.u.size else None
        with warnings.catch_warnings():  # orders are measured from steps on that are too large: no news here
            warnings.filterwarnings("ignore", "the energy (went|is not defined)")
            motion = simulate(
                scene.system, scene.method, q0=q, p0=p, h=h, steps=steps, t0=t, params=values, u=u, progress=False
            )
        grid = np.unique(motion.k, return_index=True)[1]  # impacts add nodes between those of the grid
        return motion.q[grid], motion.p[grid], motion.t[grid]
    checked_steps(float(t), float(h), steps)
    affordable(f"a run of {steps} steps", (steps + 1) * 2 * len(q), "take fewer steps")
    times = t + h * np.arange(steps + 1)
    n, x, states, k = len(q), np.concatenate([q, p]), [np.concatenate([q, p])[None]], 0
    for count in blocks(steps, LARGEST_BLOCK // 10):
        rolled = _rolled(scene.method, count)
        found = call(
            rolled, x, np.tile(scene.controls, count), np.tile(scene.c, count), times[k : k + count], np.full(count, h)
        )
        states.append(found[0].reshape(count, 2 * n))
        x, k = states[-1][-1].copy(), k + count
    path = np.concatenate(states)
    return path[:, :n], path[:, n:], times


@lru_cache(maxsize=64)
def _rolled(step: ca.Function, count: int) -> ca.Function:
    n = step.numel_in(0)
    x, u, c = ca.MX.sym("x", 2 * n), ca.MX.sym("u", step.numel_in(2)), ca.MX.sym("c", step.numel_in(3))
    t, h = ca.MX.sym("t"), ca.MX.sym("h")
    q1, p1, *_ = step.call([x[:n], x[n:], ca.reshape(u, *step.size_in(2)), c, t, h])
    one = ca.Function("one", [x, u, c, t, h], [ca.densify(ca.vertcat(q1, p1))])
    return one.mapaccum(count) if count > 1 else one
