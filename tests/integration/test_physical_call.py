"""Runs in fictitious time by one call of the core: the same numbers as the watched way, in both
gears.
"""

import casadi as ca
import numpy as np
import pytest

import varint as vi
from varint.integration.time_transformation import inner_run, transformed_run

MODELS = {
    "kepler": (vi.models.kepler(e=0.9), 20.0),
    "arenstorf": (vi.models.arenstorf(), 17.0),
    "pythagorean": (vi.models.pythagorean_three_body(), 6.0),
    "pendulum": (vi.models.pendulum(), 5.0),  # the fewest coordinates
}


def start_of(name: str) -> dict:
    model, duration = MODELS[name]
    return dict(
        q0=model.q0, v0=model.v0, duration=duration, time_scale="auto", h=0.6, rule=vi.gauss(6)
    )


def watched(monkeypatch, system, **how):
    """The same run without the call of the core."""
    with monkeypatch.context() as patch:
        patch.setattr(transformed_run, "physical_call", lambda *ignored: None)
        return vi.simulate(system, **how)


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("more", [{}, {"iteration_tol": 1e-6}, {"save_every": 7}, {"t0": 3.0}])
def test_nodes_are_those_of_the_watched_way(name, more, monkeypatch):
    system = MODELS[name][0].system
    how = start_of(name) | more
    found = vi.simulate(system, **how)
    other = watched(monkeypatch, system, **how)
    assert np.array_equal(found.k, other.k)
    for x in ("t", "q", "p"):
        assert np.array_equal(getattr(found, x)[:-1], getattr(other, x)[:-1])
    assert found.t[-1] == pytest.approx(other.t[-1], rel=1e-14)
    assert found.q[-1] == pytest.approx(other.q[-1], rel=1e-9, abs=1e-12)
    assert np.array_equal(found.c, other.c)
    assert np.array_equal(found.fictitious.c, other.fictitious.c)
    assert found.rule == other.rule and found.h == other.h
    times = np.linspace(found.t[0], found.t[-1], 9)
    assert found.at(times).q == pytest.approx(other.at(times).q, rel=1e-9, abs=1e-10)
    assert found.energy == pytest.approx(found.energy[0], rel=1e-5)


@pytest.mark.parametrize("name", MODELS)  # of 2, 3 and 7 coordinates with the clock
def test_both_gears_give_the_same_bytes(name):
    system, how = MODELS[name][0].system, start_of(name)
    one, other = (vi.simulate(system, backend=backend, **how) for backend in ("native", "compiled"))
    assert one.q.tobytes() == other.q.tobytes() and one.t.tobytes() == other.t.tobytes()
    assert one.p.tobytes() == other.p.tobytes()


def test_a_run_is_one_call_of_the_core(monkeypatch):
    calls = []
    real = inner_run.run_until

    def counted(*arguments, **how):
        calls.append(real(*arguments, **how))
        return calls[-1]

    monkeypatch.setattr(inner_run, "run_until", counted)
    monkeypatch.setattr(transformed_run, "prepare", lambda *ignored: pytest.fail("prepared"))
    motion = vi.simulate(MODELS["kepler"][0].system, **start_of("kepler"))
    assert len(calls) == 1 and len(calls[0].t) == len(motion)


def test_it_leads_back():
    model, duration = MODELS["pythagorean"]
    how = dict(time_scale="auto", h=0.5, rule=vi.gauss(6))
    there = vi.simulate(model.system, q0=model.q0, v0=model.v0, duration=duration, **how)
    how["h"] = -0.5
    back = vi.simulate(model.system, q0=there.q[-1], v0=there.v[-1], duration=-duration, **how)
    assert back.t[-1] == pytest.approx(-duration, rel=1e-14)
    assert back.q[-1] == pytest.approx(np.array(model.q0), abs=1e-8)


def test_the_end_may_be_a_node():
    system = MODELS["kepler"][0].system
    how = start_of("kepler") | {"time_scale": vi.close_encounters(ca.norm_2(system.q))}
    node = vi.simulate(system, **how).t[12]
    found = vi.simulate(system, **(how | {"duration": node}))
    assert found.t[-1] == pytest.approx(node, rel=1e-14) and len(found) == 13


def test_more_nodes_than_there_is_room_for(monkeypatch):
    monkeypatch.setattr("varint.codegen.until.ROOM", 300)
    found = vi.simulate(MODELS["kepler"][0].system, **start_of("kepler"))
    monkeypatch.undo()
    again = vi.simulate(MODELS["kepler"][0].system, **start_of("kepler"))
    assert len(found) == len(again) > 300 // 9
    assert np.array_equal(found.q[:-1], again.q[:-1])


def test_a_run_leaves_those_before_it_alone():
    system, how = MODELS["kepler"][0].system, start_of("kepler")
    first = vi.simulate(system, **how)
    inner = first.fictitious
    arrays = first.t, first.q, first.p, first.k, first.c, inner.t, inner.q, inner.p, inner.c
    before = [x.copy() for x in arrays]
    vi.simulate(system, **(how | {"v0": 1.01 * np.array(how["v0"])}))
    assert all(np.array_equal(*pair) for pair in zip(before, arrays, strict=True))


def test_of_nodes_further_apart_than_the_run_is_long_the_ends_are_kept():
    system, how = MODELS["kepler"][0].system, start_of("kepler")
    whole, ends = (vi.simulate(system, save_every=every, **how) for every in (1, 10**30))
    for x in ("t", "q", "p", "k"):
        assert np.array_equal(getattr(ends, x), getattr(whole, x)[[0, -1]])
