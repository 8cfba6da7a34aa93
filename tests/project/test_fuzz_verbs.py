"""Random bad input to every verb but those that solve for a path: a finite result or the project's
own error, in time.

The long command, ``pytest -m long tests/project/test_fuzz_verbs.py``, takes many more inputs.
"""

from __future__ import annotations

import casadi as ca
from fuzzing import PLAIN, SCENE, START, START_NAMES, Q, V, both, call_case, spoilt

import varint as vi

TWO = dict(q0=[[1.0, 0.0], [0.5, 0.2]], v0=[0.0, 1.0])
CALLS = {
    "ensemble": (
        vi.ensemble,
        (SCENE, vi.gauss(2)),
        TWO | dict(h=0.1, steps=3, u=0.3, backend="interpreted"),
        (*START_NAMES, "h", "steps", "duration", "save_every", "executor", "progress", "backend"),
    ),
    "ensemble to a tolerance": (
        vi.ensemble,
        (PLAIN,),
        TWO | dict(duration=0.2, tol=1e-3, at=[0.1, 0.2]),
        (*START_NAMES, "duration", "save_every", "at", "tol", "executor", "backend", "rule"),
    ),
    "simulate to a tolerance": (
        vi.simulate,
        (PLAIN,),
        START | dict(duration=0.2, tol=1e-3, backend="interpreted"),
        (*START_NAMES, "duration", "save_every", "tol", "until", "rule"),
    ),
    "simulate in variable steps": (
        vi.simulate,
        (PLAIN,),
        START | dict(h=0.05, duration=0.2, time_scale=1 + Q[0] ** 2, backend="interpreted"),
        (
            "q0",
            "v0",
            "p0",
            "h",
            "steps",
            "duration",
            "t0",
            "params",
            "save_every",
            "iteration_tol",
            "until",
            "events",
            "time_scale",
            "rule",
        ),
    ),
    "symmetries": (vi.symmetries, (PLAIN,), {}, ("rule", "params", "near")),
    "noether": (
        vi.noether,
        (PLAIN,),
        dict(xi=[-Q[1], Q[0]]),
        ("xi", "gauge", "tau", "name", "params", "near"),
    ),
    "project": (vi.project, (PLAIN,), dict(q0=[1.0, 0.0]), ("q0", "v0", "t0", "params")),
    "step_function": (vi.step_function, (PLAIN,), {}, ("rule",)),
    "start_momentum": (
        vi.start_momentum,
        (PLAIN, vi.gauss(2)),
        dict(q0=[1.0, 0.0], q1=[1.0, 0.1], h=0.1),
        ("q0", "q1", "h", "t0", "params"),
    ),
    "System": (
        vi.System,
        (Q, V),
        dict(lagrangian=ca.sumsqr(V)),
        (
            "lagrangian",
            "constraint",
            "nonholonomic",
            "contact",
            "restitution",
            "force",
            "control",
            "params",
            "t",
        ),
    ),
    "gauss": (vi.gauss, (), dict(stages=2), ("stages",)),
    "lobatto": (vi.lobatto, (), dict(stages=2), ("stages",)),
    "composition": (vi.composition, (), dict(name="verlet"), ("name",)),
    "energy_slope": (
        vi.diagnostics.energy_slope,
        (PLAIN, vi.gauss(2)),
        START | dict(h=0.05, steps=60),
        (*START_NAMES, "h", "steps", "windows"),
    ),
    "reversibility_defect": (
        vi.diagnostics.reversibility_defect,
        (PLAIN, vi.gauss(2)),
        START | dict(h=0.05, steps=9),
        (*START_NAMES, "h", "steps"),
    ),
    "symplectic_defect": (
        vi.diagnostics.symplectic_defect,
        (PLAIN, vi.gauss(2)),
        START | dict(h=0.05),
        (*START_NAMES, "h", "states", "apart"),
    ),
    "constraint_drift": (
        vi.diagnostics.constraint_drift,
        (PLAIN, vi.gauss(2)),
        START | dict(h=0.05, steps=9),
        (*START_NAMES, "h", "steps"),
    ),
    "convergence": (
        vi.diagnostics.convergence,
        (PLAIN, vi.gauss(1)),
        START | dict(duration=1.0, steps=(4, 8, 16)),
        (*START_NAMES, "duration", "steps", "order", "reference"),
    ),
}

test_bad_input_to_every_verb_ends_in_a_result_or_a_clear_error, test_much_bad_input = both(
    spoilt(CALLS), call_case, 400, 12_000
)
