"""Random Lagrangians and random bad input: every call ends in a result without NaN or in the
project's own error.

2,000 inputs in the default run; 100,000 with ``pytest -m long tests/project/test_fuzz.py``. Of its
time about half goes into drawing the scenes, half into building their functions; the steps
themselves take little.
"""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import varint as vi

QUICK, LONG = (300, 1700), (15_000, 85_000)  # scenes, inputs
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
        extras["constraint"] = draw(expressions(ca.vertsplit(q), 2))
    elif draw(st.integers(0, 6)) == 0:
        extras["contact"] = draw(expressions(ca.vertsplit(q), 1))
        extras["restitution"] = draw(st.floats(0, 1))
    return vi.System(q, v, lagrangian, t=t, **extras)


def judged(call) -> str:
    """Run the call; anything but a finite result or the project's own error fails the test."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", category=UserWarning, module="varint|tests|test_fuzz")
        warnings.simplefilter("ignore", UserWarning)
        try:
            motion = call()
        except vi.VarintError as error:
            assert str(error) and "casadi" not in str(error).lower() and str(error) != "nan"
            motion = getattr(error, "trajectory", None)
            if motion is None:
                return type(error).__name__
    assert (
        np.isfinite(motion.q).all() and np.isfinite(motion.p).all() and np.isfinite(motion.t).all()
    )
    return "result"


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
GOOD = dict(
    q0=[1.0, 0.0], v0=[0.0, 1.0], h=0.1, steps=4, u=0.3, backend="interpreted", save_every=1
)
NAMES = [
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
    "until",
    "events",
    "backend",
    "on_failure",
    "rule",
    "iteration_tol",
    "time_scale",
]


@st.composite
def spoilt(draw):
    """Good arguments with one to three of them replaced by rubbish."""
    call = dict(GOOD)
    for name in draw(st.lists(st.sampled_from(NAMES), min_size=1, max_size=3, unique=True)):
        value = draw(RUBBISH)
        if (
            name in ("steps", "duration", "save_every")
            and isinstance(value, (int, float))
            and abs(value) > 1000
        ):
            value = 7  # long runs are no test of input
        if name == "params" and draw(st.booleans()):
            value = {draw(st.sampled_from(["stiffness", "masses", "mass", C.stiffness])): value}
        call[name] = value
    if (
        isinstance(call.get("duration"), float)
        and isinstance(call["h"], float)
        and abs(call["h"]) < 1e-3
    ):
        call["h"] = 0.1
    return call


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


def scene_case(case):
    system, rule, start = case
    judged(lambda: vi.simulate(system, rule, **start))


def input_case(call):
    judged(lambda: vi.simulate(SCENE, **call))


test_random_lagrangians_end_in_a_finite_result_or_a_clear_error = explore(
    given(well_formed())(scene_case), QUICK[0]
)
test_random_input_ends_in_a_finite_result_or_a_clear_error = explore(
    given(spoilt())(input_case), QUICK[1]
)
test_many_random_lagrangians = pytest.mark.long(explore(given(well_formed())(scene_case), LONG[0]))
test_much_random_input = pytest.mark.long(explore(given(spoilt())(input_case), LONG[1]))
