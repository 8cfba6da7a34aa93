"""Random bad input to every verb that solves for a path or a control: a result or the project's own
error, in time.

The long command, ``pytest -m long tests/project/test_fuzz_problems.py``, takes many more inputs.
"""

from __future__ import annotations

from fuzzing import PLAIN, PUSH, SCENE, Q, both, call_case, spoilt

import varint as vi

HORIZON = vi.Phase(SCENE, vi.gauss(2), 1.0, 3, PUSH**2 + Q[0] ** 2, bounds=[(-9, PUSH, 9)])
CONTROLLER = vi.mpc(HORIZON, backend="interpreted")


def phases(**link):
    return vi.optimal_phases([HORIZON, HORIZON], [vi.Link(**link)], progress=False)


def feedback(q, v, previous=None, t=None):
    return CONTROLLER(q, v, previous, t)


SOLVERS = {
    "least_action": (
        vi.least_action,
        (PLAIN, vi.gauss(2)),
        dict(q_start=[0, 0], q_end=[1, 1], duration=1.0, steps=4),
        (
            "q0",
            "q_start",
            "q_end",
            "duration",
            "steps",
            "t0",
            "guess",
            "u",
            "params",
            "bounds",
            "periodic",
            "symmetry",
            "energy",
        ),
    ),
    "closed path": (
        vi.least_action,
        (PLAIN, vi.gauss(2)),
        dict(periodic=True, guess=[[1, 0], [0, 1], [-1, 0], [0, -1]], duration=5.0, steps=6),
        ("duration", "steps", "t0", "guess", "params", "bounds", "periodic", "symmetry", "energy"),
    ),
    "paths": (
        vi.paths,
        (PLAIN, vi.gauss(2)),
        dict(q_start=[0, 0], q_end=[1, 1], duration=1.0, steps=4, starts=2),
        (
            "q0",
            "q_start",
            "q_end",
            "duration",
            "steps",
            "starts",
            "winding",
            "spread",
            "seed",
            "t0",
            "params",
            "energy",
        ),
    ),
    "multistart": (
        vi.multistart,
        (HORIZON,),
        dict(starts=2),
        ("starts", "spread", "seed", "t0", "solver", "options"),
    ),
    "phases": (
        phases,
        (),
        dict(before=0, after=1),
        ("before", "after", "contact", "sticks", "restitution", "relabel", "offset", "time"),
    ),
    "mpc": (feedback, (), dict(q=[1, 0], v=[0, 0]), ("q", "v", "previous", "t")),
    "closed_loop": (
        vi.closed_loop,
        (CONTROLLER,),
        dict(q0=[1, 0], v0=[0, 0], steps=1),
        ("q0", "v0", "steps", "plant", "disturbance"),
    ),
    "optimal_control": (
        vi.optimal_control,
        (SCENE, vi.gauss(2)),
        dict(
            duration=1.0,
            steps=3,
            cost=PUSH**2,
            start=dict(q=[0, 0], v=[0, 0]),
            end=dict(q=[1, 0]),
            progress=False,
        ),
        (
            "duration",
            "steps",
            "cost",
            "terminal_cost",
            "start",
            "end",
            "bounds",
            "control",
            "params",
            "guess",
            "mesh",
            "t0",
            "solver",
            "options",
        ),
    ),
}

test_bad_boundary_problems_end_in_a_result_or_a_clear_error, test_many_bad_problems = both(
    spoilt(SOLVERS), call_case, 60, 2000
)
