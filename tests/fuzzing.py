"""Random expressions and spoilt calls, and the judgement of what comes of them: a finite result or
the project's own error, in time.
"""

from __future__ import annotations

import contextlib
import signal
import threading
import warnings
from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import varint as vi

# By default numbers in the sources of all modules imported so far are drawn, too: inputs would
# depend on which tests ran before.
with contextlib.suppress(ImportError, AttributeError):  # names that Hypothesis may take back
    from hypothesis.internal.conjecture import providers

    providers._get_local_constants = providers.Constants

SECONDS = 60  # an input that takes longer hangs
UNITS = st.sampled_from([1e-20, 1e-6, 1.0, 1.0, 1.0, 1e6, 1e20])
NUMBERS = st.one_of(
    st.floats(-3, 3),
    st.sampled_from(
        [0.0, -1.0, 1e-300, 1e-20, 1e20, 1e300, float("nan"), float("inf"), -float("inf")]
    ),
)
RUBBISH = st.one_of(
    st.none(),
    st.text(max_size=3),
    st.booleans(),
    st.binary(max_size=2),
    st.lists(st.text(max_size=2), max_size=3),
    st.dictionaries(st.text(max_size=2), st.integers(), max_size=2),
    st.just(ca.SX.sym("foreign")),
    st.just(object()),
    st.just(ca.MX.sym("m")),
    st.complex_numbers(max_magnitude=2),
    st.lists(NUMBERS, max_size=4),
    NUMBERS,
    st.integers(-5, 10**9),
)
RULES = st.sampled_from(
    [
        None,
        None,
        vi.midpoint(),
        vi.gauss(2),
        vi.gauss(4),
        vi.lobatto(3),
        vi.trapezoidal(),
        vi.composition("verlet"),
    ]
)
FUNCTIONS = (
    ca.sin,
    ca.cos,
    ca.exp,
    ca.sqrt,
    ca.log,
    ca.tanh,
    ca.fabs,
    lambda x: x**2,
    lambda x: 1 / x,
    lambda x: -x,
)
C = vi.Parameters(stiffness=1.0, masses=[1.0, 2.0])
Q, V = vi.coordinates("x", "y")
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
START_NAMES = ("q0", "v0", "p0", "params", "t0", "u")
SOME = st.one_of(
    RUBBISH,
    st.sampled_from([Q[0], V[0] ** 2, PUSH, SCENE, vi.gauss(2), [(0, Q[0], 1)], dict(q=[0, 0])]),
)
GRID = ("steps", "duration", "save_every", "h", "apart", "states", "windows", "starts", "stages")


@st.composite
def expressions(draw, symbols: list, depth: int):
    """A random expression of the symbols: sums, products, quotients and functions that are not
    defined everywhere.
    """
    if depth == 0 or draw(st.integers(0, 4)) == 0:
        return draw(st.sampled_from([*symbols, ca.SX(draw(st.floats(-2, 2)))]))
    if draw(st.booleans()):
        return draw(st.sampled_from(FUNCTIONS))(draw(expressions(symbols, depth - 1)))
    a, b = draw(expressions(symbols, depth - 1)), draw(expressions(symbols, depth - 1))
    return draw(st.sampled_from([a + b, a * b, a - b, a / b]))


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


def judged(call: Callable[[], object], dump: str = ".cpp") -> None:
    """Run the call; anything but a finite result or the project's own error fails the test.

    What is in `dump`, in small letters, stands in no error.
    """
    with warnings.catch_warnings(), in_time():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", UserWarning)
        try:
            result = call()
        except vi.VarintError as error:
            assert str(error) not in ("", "nan") and dump not in str(error).lower()
            result = getattr(error, "trajectory", None)
    if isinstance(result, vi.Trajectory):
        arrays = [result.q, result.p, result.t]
    elif isinstance(result, vi.Ensemble):
        arrays = [np.ma.compressed(result.q), np.ma.compressed(result.p)]
    else:
        arrays = []
    assert all(np.isfinite(x).all() for x in arrays)


@st.composite
def spoilt(draw, calls: dict, rubbish=SOME, short: tuple[str, ...] = GRID):
    """A good call of one of the verbs with one to three of its arguments replaced by rubbish."""
    function, arguments, good, names = calls[draw(st.sampled_from(sorted(calls)))]
    call = dict(good)
    for name in draw(st.lists(st.sampled_from(names), min_size=1, max_size=3, unique=True)):
        wrong = draw(rubbish)
        if (
            name in short
            and isinstance(wrong, (int, float))
            and not isinstance(wrong, bool)
            and abs(wrong) > 1000
        ):
            wrong = 7  # long runs are no test of input
        if name == "params" and draw(st.booleans()):
            wrong = {draw(st.sampled_from(["stiffness", "masses", "mass", C.stiffness])): wrong}
        if name in ("start", "end") and draw(st.booleans()):
            wrong = {draw(st.sampled_from(["q", "v", "p", "bounds", "periodic", "x"])): wrong}
        if name == "bounds" and draw(st.booleans()):
            wrong = [(wrong, draw(st.sampled_from([Q[0], PUSH, V[1]])), draw(rubbish))]
        call[name] = wrong
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


def explore(test, count: int):
    """The test with `count` inputs, however slow some of them are to make; those that fail are
    made small.
    """
    return settings(
        max_examples=count,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        database=None,
        derandomize=True,
        phases=(Phase.generate, Phase.shrink),
    )(test)


def both(strategy, case: Callable, few: int, many: int):
    """The test with few inputs, and with many."""
    return explore(given(strategy)(case), few), pytest.mark.long(
        explore(given(strategy)(case), many)
    )
