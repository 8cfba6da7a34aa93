"""Random scenes of every kind and random bad input to every verb: a finite result or the project's
own error, in time.

`test_fuzz.py` does the same for `simulate` with scenes that have little besides L. The long
command, ``pytest -m long tests/project/test_fuzz_verbs.py``, takes many more inputs.
"""

from __future__ import annotations

import contextlib
import io
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_fuzz import NUMBERS, RUBBISH, RULES, UNITS, C, Q, V, explore, expressions

import varint as vi
from varint.__main__ import main

SECONDS = 60  # an input that takes longer hangs
# inputs: default, long
SCALE = dict(kinds=(60, 6000), verbs=(400, 12_000), solvers=(60, 2000), shell=(100, 3000))


@contextlib.contextmanager
def in_time() -> Iterator[None]:
    """Fail where the work inside hangs."""
    if not hasattr(signal, "SIGALRM") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def late(*_):
        raise TimeoutError(f"no end within {SECONDS} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def judged(call: Callable[[], object]) -> None:
    """Run the call; anything but a finite result or the project's own error fails the test."""
    with warnings.catch_warnings(), in_time():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)
        try:
            result = call()
        except vi.VarintError as error:
            assert str(error) not in ("", "nan") and ".cpp" not in str(error)  # no dump of CasADi's
            result = getattr(error, "trajectory", None)
    if isinstance(result, vi.Trajectory):
        arrays = [result.q, result.p, result.t]
    elif isinstance(result, vi.Ensemble):
        arrays = [np.ma.compressed(result.q), np.ma.compressed(result.p)]
    else:
        arrays = []
    assert all(np.isfinite(x).all() for x in arrays)


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


PUSH = ca.SX.sym("push")
SCENE = vi.System(
    Q,
    V,
    ca.dot(C.masses, V**2) / 2 - C.stiffness * ca.sumsqr(Q),
    force=ca.vertcat(PUSH, 0),
    control=PUSH,
    params=C,
)
PLAIN = vi.System(Q, V, ca.dot(C.masses, V**2) / 2 - C.stiffness * ca.sumsqr(Q) ** 2, params=C)
START = dict(q0=[1.0, 0.0], v0=[0.0, 1.0])
TWO = dict(q0=[[1.0, 0.0], [0.5, 0.2]], v0=[0.0, 1.0])
SOME = st.one_of(
    RUBBISH,
    st.sampled_from([Q[0], V[0] ** 2, PUSH, SCENE, vi.gauss(2), [(0, Q[0], 1)], dict(q=[0, 0])]),
)
GRID = ("steps", "duration", "save_every", "h", "apart", "states", "windows", "starts", "stages")
CALLS = {
    "ensemble": (
        vi.ensemble,
        (SCENE, vi.gauss(2)),
        TWO | dict(h=0.1, steps=3, u=0.3, backend="interpreted"),
        (
            "q0",
            "v0",
            "p0",
            "h",
            "steps",
            "duration",
            "t0",
            "u",
            "params",
            "save_every",
            "executor",
            "progress",
            "backend",
        ),
    ),
    "simulate to a tolerance": (
        vi.simulate,
        (PLAIN,),
        START | dict(duration=0.2, tol=1e-3, backend="interpreted"),
        ("q0", "v0", "p0", "duration", "t0", "u", "params", "save_every", "tol", "until", "rule"),
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
        (
            "q0",
            "q1",
            "h",
            "t0",
            "params",
        ),
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
        (
            "q0",
            "v0",
            "p0",
            "h",
            "steps",
            "windows",
            "params",
            "t0",
            "u",
        ),
    ),
    "reversibility_defect": (
        vi.diagnostics.reversibility_defect,
        (PLAIN, vi.gauss(2)),
        START | dict(h=0.05, steps=9),
        (
            "q0",
            "v0",
            "p0",
            "h",
            "steps",
            "params",
            "t0",
            "u",
        ),
    ),
    "symplectic_defect": (
        vi.diagnostics.symplectic_defect,
        (PLAIN, vi.gauss(2)),
        START | dict(h=0.05),
        (
            "q0",
            "v0",
            "p0",
            "h",
            "states",
            "apart",
            "params",
            "t0",
            "u",
        ),
    ),
    "constraint_drift": (
        vi.diagnostics.constraint_drift,
        (PLAIN, vi.gauss(2)),
        START | dict(h=0.05, steps=9),
        (
            "q0",
            "v0",
            "p0",
            "h",
            "steps",
            "params",
            "t0",
            "u",
        ),
    ),
    "convergence": (
        vi.diagnostics.convergence,
        (PLAIN, vi.gauss(1)),
        START | dict(duration=1.0, steps=(4, 8, 16)),
        (
            "q0",
            "v0",
            "p0",
            "duration",
            "steps",
            "order",
            "reference",
            "params",
            "t0",
            "u",
        ),
    ),
}
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
        (
            "before",
            "after",
            "contact",
            "sticks",
            "restitution",
            "relabel",
            "offset",
            "time",
        ),
    ),
    "mpc": (feedback, (), dict(q=[1, 0], v=[0, 0]), ("q", "v", "previous", "t")),
    "closed_loop": (
        vi.closed_loop,
        (CONTROLLER,),
        dict(q0=[1, 0], v0=[0, 0], steps=1),
        (
            "q0",
            "v0",
            "steps",
            "plant",
            "disturbance",
        ),
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


@st.composite
def spoilt(draw, calls: dict):
    """A good call of one of the verbs with one to three of its arguments replaced by rubbish."""
    function, arguments, good, names = calls[draw(st.sampled_from(sorted(calls)))]
    call = dict(good)
    for name in draw(st.lists(st.sampled_from(names), min_size=1, max_size=3, unique=True)):
        rubbish = draw(SOME)
        if (
            name in GRID
            and isinstance(rubbish, (int, float))
            and not isinstance(rubbish, bool)
            and abs(rubbish) > 1000
        ):
            rubbish = 7  # long runs are no test of input
        if name == "params" and draw(st.booleans()):
            rubbish = {draw(st.sampled_from(["stiffness", "masses", "mass"])): rubbish}
        if name in ("start", "end") and draw(st.booleans()):
            rubbish = {draw(st.sampled_from(["q", "v", "p", "bounds", "periodic", "x"])): rubbish}
        if name == "bounds" and draw(st.booleans()):
            rubbish = [(rubbish, draw(st.sampled_from([Q[0], PUSH, V[1]])), draw(SOME))]
        call[name] = rubbish
    if (
        isinstance(call.get("duration"), float)
        and isinstance(call.get("h"), float)
        and abs(call["h"]) < 1e-3
    ):
        call["h"] = 0.1
    return function, arguments, call


def call_case(case):
    function, arguments, call = case
    judged(lambda: function(*arguments, **call))


WORDS = st.one_of(
    st.sampled_from(
        [
            "run",
            "check",
            "bench",
            "list",
            "kepler",
            "pendulum",
            "--rule",
            "--h",
            "--duration",
            "--steps",
        ]
    ),
    st.sampled_from(
        [
            "gauss(2)",
            "gauss(-1)",
            "lobatto",
            "nan",
            "inf",
            "-1",
            "0",
            "1e-3",
            "0.1",
            "--plot",
            "--save",
        ]
    ),
    st.text(max_size=4),
)


@st.composite
def command_lines(draw):
    """Words of the command line; where a run would be long, it is made short."""
    words = draw(st.lists(WORDS, max_size=6))
    if words[:1] in (["check"], ["bench"]) and len(words) > 1 and words[1] in vi.models.catalogue:
        words[0] = "run"  # checks of whole models are no test of input
    return (
        [*words, "--duration", draw(st.sampled_from(["0.1", "nan", "-1", "inf", "1e-300"]))]
        if words
        else words
    )


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """A folder for what command lines write."""
    before = os.getcwd()
    os.chdir(tmp_path_factory.mktemp("shell"))
    yield
    os.chdir(before)


def shell_case(elsewhere, words):
    def run():
        text = io.StringIO()
        with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
            try:
                code = main(words)
            except SystemExit as end:  # of argparse, which says what is wrong
                code = end.code
        assert code in (0, 1, 2) and "Traceback" not in text.getvalue()

    judged(run)


def both(strategy, case: Callable, kind: str):
    """The test with few inputs, and with many."""
    few, many = SCALE[kind]
    return explore(given(strategy)(case), few), pytest.mark.long(
        explore(given(strategy)(case), many)
    )


test_scenes_of_every_kind_end_in_a_finite_result_or_a_clear_error, test_many_scenes = both(
    mixed(), kind_case, "kinds"
)
test_bad_input_to_every_verb_ends_in_a_result_or_a_clear_error, test_much_bad_input = both(
    spoilt(CALLS), call_case, "verbs"
)
test_bad_boundary_problems_end_in_a_result_or_a_clear_error, test_many_bad_problems = both(
    spoilt(SOLVERS), call_case, "solvers"
)
test_command_lines_end_with_an_exit_code_and_no_traceback, test_many_command_lines = both(
    command_lines(), shell_case, "shell"
)
