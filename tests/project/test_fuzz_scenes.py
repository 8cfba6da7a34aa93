"""Random scenes with all that a scene may have: a finite motion or the project's own error.

`test_fuzz.py` does the same with scenes that have little besides L. The long command, ``pytest -m
long tests/project/test_fuzz_scenes.py``, takes many more.
"""

from __future__ import annotations

import casadi as ca
from fuzzing import NUMBERS, RULES, UNITS, both, expressions, judged
from hypothesis import strategies as st

import varint as vi


def value(expression: ca.SX, q: ca.SX, q0: list[float]) -> float:
    return float(ca.Function("value", [q], [expression], {"allow_free": False})(q0))


@st.composite
def mixed(draw):
    """A scene with constraints, rows of velocities, contacts, forces and controls, and a start
    that may obey them.
    """
    n = draw(st.integers(1, 3))
    q, v = vi.coordinates(*"xyz"[:n])
    t, unit, push = vi.time(), draw(UNITS), ca.SX.sym("push")
    places, all_of_them = [*ca.vertsplit(q), t], [*ca.vertsplit(q), *ca.vertsplit(v), t]
    q0, v0 = ([draw(st.floats(-2, 2)) for _ in range(n)] for _ in range(2))
    kinetic = ca.sumsqr(v) / 2 + (draw(expressions(all_of_them, 2)) if draw(st.booleans()) else 0)
    lagrangian = unit * (kinetic - draw(expressions(places, 2)))
    extras = {}
    if draw(st.booleans()):
        extras["force"] = ca.vertcat(
            *(unit * draw(expressions([*all_of_them, push], 1)) for _ in range(n))
        )
        extras |= {"control": push} if ca.depends_on(extras["force"], push) else {}
    rows = [draw(expressions(ca.vertsplit(q), 2)) for _ in range(draw(st.integers(0, n - 1)))]
    if rows:  # the first is made zero at the start, so that there is something to step
        extras["constraint"] = ca.vertcat(*(row - value(row, q, q0) for row in rows))
    if n > 1 and draw(st.integers(0, 2)) == 0:
        extras["nonholonomic"] = ca.horzcat(
            *(draw(expressions(ca.vertsplit(q), 1)) for _ in range(n))
        )
    if draw(st.integers(0, 2)) == 0:
        gap = draw(expressions(ca.vertsplit(q), 2))
        extras["contact"] = gap - value(gap, q, q0) + draw(st.sampled_from([0.0, 1e-3, 0.1, 1.0]))
        extras["restitution"] = draw(st.sampled_from([0.0, 0.3, 1.0]))
    system = vi.System(q, v, lagrangian, t=t, **extras)
    start = dict(
        h=draw(st.sampled_from([1e-3, 0.01, 0.1, 1.0, -0.05])),
        steps=draw(st.integers(1, 12)),
        save_every=draw(st.integers(1, 3)),
        backend="interpreted",
    )
    if "control" in extras and draw(st.booleans()):
        start["u"] = draw(NUMBERS)
    return system, draw(RULES), q0, v0, start


def kind_case(case):
    def run():
        system, rule, q0, v0, start = case
        if system.structure.constraints or system.structure.nonholonomic:
            q0, v0 = vi.project(system, q0, v0)
        return vi.simulate(system, rule, q0=q0, v0=v0, **start)

    judged(run)


test_scenes_of_every_kind_end_in_a_finite_result_or_a_clear_error, test_many_scenes = both(
    mixed(), kind_case, 60, 6000
)
