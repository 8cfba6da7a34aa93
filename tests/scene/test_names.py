"""Names of symbols: parameters in the order of their declaration, and none that is that of time."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest

import varint as vi


def scene() -> vi.System:
    q, v = vi.coordinates("theta")
    c = vi.Parameters(mass=1.0, length=2.0, g=9.81, damping=0.1)
    lagrangian = c.mass * (c.length**2 * v**2 / 2 + c.g * c.length * ca.cos(q))
    return vi.System(q, v, lagrangian, force=-c.damping * v, params=c)


def test_parameters_stand_in_the_order_of_their_declaration_everywhere():
    system, order = scene(), ["mass", "length", "g", "damping"]
    assert [x.name() for x in ca.vertsplit(system.c)] == order
    assert list(system.defaults) == order and system.default_vector.tolist() == [1, 2, 9.81, 0.1]
    assert f"params={order}" in repr(system)
    texts = [repr(system.params)]
    for wrong in (lambda: system.params.lenght, lambda: run(system, lenght=1.0)):
        with pytest.raises((AttributeError, vi.InputError)) as error:
            wrong()
        texts.append(str(error.value))
    for text in texts:
        assert re.findall(r"\b(mass|length|g|damping)\b", text) == order, text


def run(system: vi.System, **params: float) -> vi.Trajectory:
    return vi.simulate(system, q0=1.0, v0=0.0, h=0.1, steps=1, params=params)


@pytest.mark.parametrize("what", ["coordinate", "control", "parameter"])
def test_what_has_the_name_of_time_is_refused_with_what_to_do(what):
    q, v = vi.coordinates("t" if what == "coordinate" else "x")
    control = ca.SX.sym("t") if what == "control" else None
    c = vi.Parameters(t=1.0) if what == "parameter" else None
    force = control if control is not None else c.t if c is not None else 0
    with pytest.raises(vi.InputError, match="'t' is the name of time, and of a coordinate"):
        vi.System(q, v, v**2 / 2, force=ca.SX(force), control=control, params=c)


def test_time_may_have_another_name_and_leave_its_own():
    q, v = vi.coordinates("t")
    s = ca.SX.sym("s")
    assert vi.System(q, v, v**2 / 2 - s * q, t=s).names == ("t",)


def test_a_name_stands_for_its_symbol_wherever_an_expression_is_asked_for():
    system = vi.models.cart_pole().system
    motion = vi.simulate(
        system, vi.gauss(2), q0=[0.1, 0.2], v0=[0.3, 0.4], h=0.05, steps=20, u=[1.0]
    )
    n = len(system.names)
    for i, name in enumerate(system.names):
        assert np.array_equal(motion[name], motion.q[:, i])
        assert np.array_equal(motion[f"{name}_dot"], motion.v[:, i])
        assert np.array_equal(motion.value(name), motion.q[:, i])
    [control] = system.control_names
    assert (motion[control] == 1.0).all() and np.array_equal(motion["t"], motion.t)
    figure = motion.plot(system.names[0], system.names[n - 1])
    assert [len(axes.lines) for axes in figure.axes] == [1, 1]
    with pytest.raises(vi.InputError, match="is 'angle', no symbol's name; known: "):
        motion["angle"]


@pytest.mark.parametrize("name", ["x y", "x, y", "x,y"])
def test_one_string_of_several_names_is_refused_with_what_to_write(name):
    with pytest.raises(vi.InputError, match=r"write coordinates\('x', 'y'\) for 2 of them"):
        vi.coordinates(name)


def test_velocities_in_the_place_of_coordinates_are_refused():
    q, v = vi.coordinates("x", "y")
    with pytest.raises(vi.InputError, match="q and v have changed places"):
        vi.System(v, q, ca.sumsqr(v) / 2)
