"""Random Lagrangians and random bad input to `simulate`: every call ends in a result without NaN or
in the project's own error.

2,000 inputs in the default run; 100,000 with ``pytest -m long tests/project/test_fuzz.py``. Of its
time about half goes into drawing the scenes, half into building their functions; the steps
themselves take little.
"""

from __future__ import annotations

import casadi as ca
from fuzzing import (
    RUBBISH,
    RULES,
    SCENE,
    START,
    START_NAMES,
    UNITS,
    both,
    expressions,
    judged,
    spoilt,
)
from hypothesis import strategies as st

import varint as vi

DUMP = "casadi"  # in no error of a simulation


@st.composite
def systems(draw):
    """A scene with a random potential, coupling, mass, force, constraint or contact, in random
    units.
    """
    n = draw(st.integers(1, 3))
    q, v = vi.coordinates(*"xyz"[:n])
    t, unit = vi.time(), draw(UNITS)
    symbols = [*ca.vertsplit(q), t]
    kinetic = ca.sumsqr(v) / 2
    for _ in range(draw(st.integers(0, 1))):
        kinetic += draw(expressions([*symbols, *ca.vertsplit(v)], 2))
    lagrangian = unit * (kinetic - draw(expressions(symbols, 3)))
    extras = {}
    if draw(st.integers(0, 4)) == 0:
        extras["force"] = ca.vertcat(
            *(unit * draw(expressions([*symbols, *ca.vertsplit(v)], 1)) for _ in range(n))
        )
    if n > 1 and draw(st.integers(0, 4)) == 0:
        extras["constraint"] = draw(
            expressions(ca.vertsplit(q), 2).filter(lambda row: ca.depends_on(row, q))
        )
    elif draw(st.integers(0, 6)) == 0:
        extras["contact"] = draw(expressions(ca.vertsplit(q), 1))
        extras["restitution"] = draw(st.floats(0, 1))
    return vi.System(q, v, lagrangian, t=t, **extras)


@st.composite
def well_formed(draw):
    """A random scene and a start that has the right shape."""
    system = draw(systems())
    n, size = system.structure.n, st.floats(-2, 2)
    start = dict(
        q0=[draw(size) for _ in range(n)],
        v0=[draw(size) for _ in range(n)],
        h=draw(st.sampled_from([1e-3, 0.01, 0.1, 1.0, -0.05])),
        steps=draw(st.integers(1, 12)),
        save_every=draw(st.integers(1, 3)),
        backend="interpreted",
    )
    if draw(st.integers(0, 9)) == 0:
        start["on_failure"] = "subdivide"
    return system, draw(RULES), start


def scene_case(case):
    system, rule, start = case
    judged(lambda: vi.simulate(system, rule, **start), DUMP)


def input_case(case):
    function, arguments, call = case
    judged(lambda: function(*arguments, **call), DUMP)


GOOD = START | dict(h=0.1, steps=4, u=0.3, backend="interpreted", save_every=1)
GRID_NAMES = ("steps", "duration", "save_every")
NAMES = (
    *START_NAMES,
    *GRID_NAMES,
    "h",
    "until",
    "events",
    "backend",
    "on_failure",
    "rule",
    "iteration_tol",
    "time_scale",
)
BAD = spoilt({"simulate": (vi.simulate, (SCENE,), GOOD, NAMES)}, RUBBISH, GRID_NAMES)

test_random_lagrangians_end_in_a_finite_result_or_a_clear_error, test_many_random_lagrangians = (
    both(well_formed(), scene_case, 300, 15_000)
)
test_random_input_ends_in_a_finite_result_or_a_clear_error, test_much_random_input = both(
    BAD, input_case, 1700, 85_000
)
