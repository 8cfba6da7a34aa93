"""One spelling for one thing: names of public arguments agree, and old names say the new one."""

from __future__ import annotations

import inspect

import casadi as ca
import numpy as np
import pytest

import varint as vi

PUBLIC = {
    f"{module.__name__}.{name}": thing
    for module in (vi, vi.diagnostics)
    for name in module.__all__
    if callable(thing := getattr(module, name))
}
ARGUMENTS = {
    name: inspect.signature(thing).parameters
    for name, thing in PUBLIC.items()
    if not (inspect.isclass(thing) and issubclass(thing, Exception))
}
Q, V = vi.coordinates("x", "y")
PUSH = ca.SX.sym("push")
CART = vi.System(Q, V, ca.sumsqr(V) / 2 - Q[1] ** 2, force=ca.vertcat(PUSH, 0), control=PUSH)
FREE = vi.System(Q, V, ca.sumsqr(V) / 2 + ca.cos(Q[0]) - Q[1])
SPAN = dict(duration=1.0, steps=4)


def test_every_argument_is_spelled_out():
    passed_on = {
        name
        for name, arguments in ARGUMENTS.items()
        if any(x.kind is x.VAR_KEYWORD for x in arguments.values())
    }
    assert passed_on == {"varint.Parameters"}  # whose keywords are the user's own names


def test_a_start_has_the_same_names_in_every_verb():
    starts = {name: set(x) for name, x in ARGUMENTS.items() if {"q0", "start", "q_start"} & set(x)}
    starts.pop("varint.Controller")  # how its solver starts, no motion
    assert {
        "simulate",
        "ensemble",
        "least_action",
        "paths",
        "optimal_control",
        "Phase",
        "project",
    } <= {name.rpartition(".")[2] for name in starts}
    for name, arguments in starts.items():
        assert "q0" in arguments, name
        if "start" in arguments:
            assert {"v0", "p0"} <= arguments, name


def test_values_of_parameters_are_the_same_kind_of_thing_in_every_verb():
    kinds = {name: str(x["params"].annotation) for name, x in ARGUMENTS.items() if "params" in x}
    kinds.pop("varint.Symmetry")  # the values that it was found for, an array
    kinds.pop("varint.Gradient")  # derivatives by them
    kinds.pop("varint.Fit")  # what they came out as
    kinds.pop("varint.Estimate")
    assert "ParameterValues | Callable" in kinds.pop("varint.closed_loop")  # that change with time
    assert len(kinds) > 15
    for name, kind in kinds.items():
        assert kind.endswith("ParameterValues | None"), name


def test_a_wanted_accuracy_of_the_motion_alone_is_called_tol():
    assert {name for name, x in ARGUMENTS.items() if "tol" in x} == {
        "varint.simulate",
        "varint.ensemble",
        "varint.refine",
        "varint.least_action",
        "varint.paths",
    }


def test_paths_begin_at_q0_also_called_q_start():
    for verb in (vi.least_action, lambda *a, **k: vi.paths(*a, **k, starts=2)[0]):
        one = verb(FREE, q0=[0, 0], q_end=[1, 1], **SPAN)
        other = verb(FREE, q_start=[0, 0], q_end=[1, 1], **SPAN)
        np.testing.assert_array_equal(one.q, other.q)
        with pytest.raises(vi.InputError, match="q0 and q_start are two names of the start"):
            verb(FREE, q0=[0, 0], q_start=[0, 0], q_end=[1, 1], **SPAN)
    with pytest.raises(vi.InputError, match="give q0 and q_end, or periodic=True"):
        vi.least_action(FREE, q_end=[1, 1], **SPAN)
    with pytest.raises(vi.InputError, match="give q0, where the paths begin"):
        vi.paths(FREE, q_end=[1, 1], **SPAN)


def controlled(**start):
    return vi.optimal_control(
        CART, cost=PUSH**2, end=dict(q=[1, None], v=[0, None]), **SPAN, **start
    )


@pytest.mark.parametrize(
    ("names", "dictionary"),
    [
        (dict(q0=[0, 1], v0=[0, 1]), dict(q=[0, 1], v=[0, 1])),
        (dict(q0=[0, 1], p0=[0, 1]), dict(q=[0, 1], p=[0, 1])),
        (
            dict(q0=np.zeros(2), v0=[vi.free(0, -1, 1), None]),
            dict(q=[0, 0], v=[vi.free(0, -1, 1), None]),
        ),
    ],
)
def test_optimal_controls_begin_at_q0_and_v0(names, dictionary):
    one, other = controlled(**names), controlled(start=dictionary)
    np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_array_equal(one.u, other.u)
    for name, value in names.items():
        with pytest.raises(vi.InputError, match=f"given twice: leave out {name} or start=dict"):
            controlled(start=dictionary, **{name: value})


def test_what_else_holds_at_the_start_goes_with_q0():
    motion = controlled(q0=[0, 0], start=dict(bounds=[(0.5, V[1], 0.5)]))
    np.testing.assert_allclose((*motion.q[0], motion.v[0, 1]), (0, 0, 0.5), atol=1e-9)
    with pytest.raises(vi.InputError, match="start must be a dictionary"):
        controlled(q0=[0, 0], start=[0, 0])


def test_phases_begin_at_q0_and_v0():
    end = dict(q=[1, None], v=[0, None])
    phase = vi.Phase(CART, None, 1.0, 4, PUSH**2, end=end, q0=[0, 1], v0=[0, 1])
    [alone] = vi.optimal_phases([phase])
    np.testing.assert_array_equal(alone.u, controlled(q0=[0, 1], v0=[0, 1]).u)
    refined = vi.refine(alone, 1e-6)
    np.testing.assert_allclose(refined.q[0], [0, 1], atol=1e-12)
    with pytest.raises(vi.InputError, match="gets its start with every call"):
        vi.mpc(phase)


@pytest.mark.parametrize(("old", "new"), [("phases", "active_sets"), ("phase", "active_set")])
def test_old_names_of_active_sets_work_for_one_release(old, new):
    model = vi.models.bouncing_ball()
    motion = vi.simulate(model.system, q0=model.q0, v0=model.v0, h=0.1, steps=20)
    with pytest.warns(DeprecationWarning, match=rf"Trajectory.{old} is called {new} now") as said:
        value = getattr(motion, old)
    assert said[0].filename == __file__
    assert value is getattr(motion, new) and len(value)


def test_importing_everything_leaves_python_its_own_names():
    names: dict = {}
    exec("from varint import *", names)
    assert {"System", "simulate"} <= set(names) and not {"abs", "max"} & set(names)
    assert {"abs", "max"} <= set(dir(vi))
